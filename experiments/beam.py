"""Example 5.8.2 of the dissertation: a simply supported beam, driven by a force and by a prescribed motion.

Run ``python experiments/beam.py [--quick] [--out DIR]``. The two operators are equal, with (5.114) repaired. The
printed coefficients (5.115) don't come out: the density is missing, but density, stiffness and cross section only scale
p, and what doesn't depend on the scale of p differs too.
"""

from __future__ import annotations

import sys
from fractions import Fraction
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dissertation.figures import draw_both_ways
from dissertation.reproduction import Reproduction, claim_equal, listed, reproduce
from gtmbench.report.figures.panels import panels
from gtmbench.report.style import COLOURS
from theory.numeric import NumericOperator
from theory.polynomials import read_polynomial, write_polynomial
from theory.rational import Coefficients, RationalOperator, coefficients
from theory.structures import Structure, displacement_driven, force_driven, unit_columns

MODULUS, LENGTH, HEIGHT, WIDTH = 200e9, 0.100, 0.010, 0.001  # Pa, m
DRIVEN, SENSED = 0.0833, 0.0211  # x_a, x_s, m
DENSITY = 7850.0  # kg/m^3
MODES = 4  # r
ASSUMED = "missing: density (7850 kg/m^3, steel), the axis of I (w h^3/12), r (4: (5.115) has degree 2(r-1))"
PRINTED = [read_polynomial(text) for text in ("p^6+156.4p^4-18140p^2+3454000", "63.38p^6+14260p^4+805700p^2+9591000")]


def main(page: Reproduction) -> None:
    """Print what the example gives, and where (5.115) differs from it."""
    structure, inputs, outputs = beam()
    force = unit_columns([MODES], MODES)
    forced = force_driven(structure, force, inputs, outputs)
    moved = displacement_driven(structure, [MODES], inputs, outputs)
    omega = frequencies()
    page.unprinted("Ex. 5.8.2, omega_1..omega_4 (rad/s)", listed(omega), note=ASSUMED, values=omega)
    claim_equal(page, "Ex. 5.8.2, T^F and T^D", forced.equals(moved))
    floating(page, structure, [*inputs, *outputs])
    literal = displacement_driven(without_coupling(structure), [MODES], inputs, outputs)
    right = literal.gamma_o == moved.gamma_o
    page.claim(
        "(5.114), what drives the rest",
        "-K_[r,.] e_r q_d",
        "-K_[r,.] e_r q_d" if right else "-(p^2 M + K)_[r,.] e_r q_d",
        agrees=right,
        differs="misprint: inertia couples, too",
        holds=literal.equals(forced),
        note="T^D survives, for here both are alike but for p^2 + omega_r^2",
    )
    scaled = [in_seconds(coefficients(part)) for part in parts(forced)]
    scaled = [[c / scaled[0][0] for c in part] for part in scaled]
    page.claim(
        "(5.115), coefficients",
        fraction(PRINTED),
        fraction(scaled),
        agrees=alike(scaled),
        differs="no density gives the printed ones, see below",
        values=scaled,
    )
    shortest = [in_seconds(part) for part in forced.entry(0, 0)]
    page.claim(
        "(5.115), reduced",
        fraction(PRINTED),
        fraction(shortest),
        agrees=alike(shortest),
        differs="ours has degree 4, the printed one no common factor to lose",
        values=shortest,
    )
    invariants(page, forced)
    draw(page, structure, inputs, outputs)


def floating(page: Reproduction, structure: Structure, W: Any) -> None:
    """Hold T^F and T^D against each other where no polynomial is expanded, each from a model of its own."""
    forced, moved = (np.abs(T.at(0.05 + 1j * np.linspace(0.1, 17.0, 50))) for T in models(structure, W))
    off = float(np.max(np.abs(moved / forced - 1.0)))
    page.claim("Ex. 5.8.2, T^F and T^D, floating point", "equal", f"to {off:.1e}", agrees=off < 1e-9, values=off)


def models(structure: Structure, W: Any) -> tuple[NumericOperator, NumericOperator]:
    """Return T^F and T^D in floating point; p in units of omega_1."""
    forced, moved = structure.states(unit_columns([MODES], MODES), W), structure.driven_states([MODES], W)
    return NumericOperator(model=forced), NumericOperator(model=moved)


def fraction(given: Any) -> str:
    """Return numerator over denominator."""
    return " over ".join(write_polynomial([float(c) for c in part]) for part in given)


def alike(given: Any) -> bool:
    """Tell whether coefficients are the printed ones to four digits."""
    return all(
        len(ours) == len(theirs) and np.allclose(np.array(ours, float), np.array(theirs, float), rtol=5e-4, atol=0.0)
        for ours, theirs in zip(given, PRINTED, strict=True)
    )


def invariants(page: Reproduction, forced: RationalOperator) -> None:
    """State what doesn't depend on the scale of p, which is all that density, E, I and L set."""
    theirs = [float(PRINTED[0][k] / PRINTED[1][k]) for k in (-1, 0)]
    structure, inputs, outputs = beam()
    modal = Structure(np.eye(MODES, dtype=int), np.diag([i**4 for i in range(1, MODES + 1)]))
    at_a, at_s = [shapes(DRIVEN)], [shapes(SENSED)]
    readings = {
        "driven by e_r, as (5.113)": forced,
        "driven by v(x_a), as (5.115)": force_driven(structure, np.transpose(at_a), inputs, outputs),
        "all four modes in the outputs": force_driven(modal, np.transpose(at_a), at_a, at_s),
    }
    for name, operator in readings.items():
        numerator, denominator = (coefficients(part) for part in parts(operator))
        page.number(
            f"(5.115), T(0) and T(inf), {name}",
            [float(f"{ratio:.4g}") for ratio in theirs],
            [float(numerator[k] / denominator[k]) for k in (-1, 0)],
            tolerance=2e-4,  # of four digits above over four below
            differs="neither depends on density, E, I or L",
        )
    numerator, denominator = parts(forced)
    shared = coefficients(numerator.gcd(denominator).monic())
    ring = numerator.ring
    theirs = [ring.from_list([ring.domain.convert(c) for c in polynomial]) for polynomial in PRINTED]
    degrees = theirs[0].gcd(theirs[1]).degree(), len(shared) - 1
    page.claim(
        "(5.115), degree of what both parts share",
        f"{degrees[0]}",
        f"{degrees[1]}",
        agrees=degrees[0] == degrees[1],
        differs="the r-th component of the outputs is zero, so both hold p^2 + omega_r^2, whatever the beam is",
        holds=degrees[1] == 2,
        values=[float(c) for c in shared],
    )
    backwards(page)


def backwards(page: Reproduction) -> None:
    """State what (5.115) divides by: four modes at x_s, their frequencies as i, not as i^2."""
    at_s, squares = [shapes(SENSED)], np.diag([i**2 for i in range(1, MODES + 1)])
    modal = Structure(np.eye(MODES, dtype=int), squares)
    denominator = parts(force_driven(modal, np.transpose(at_s), at_s, at_s))[1]
    ours, theirs = (
        [float(c / polynomial[0]) for c in polynomial[::2]] for polynomial in (coefficients(denominator), PRINTED[1])
    )
    scale = theirs[1] / ours[1]
    off = max(abs(c * scale**k / t - 1.0) for k, (c, t) in enumerate(zip(ours, theirs, strict=True)))
    page.unprinted(
        "(5.115), its denominator backwards",
        f"omega_i^2 = {scale:.4g} i^2, all four modes at x_s: to {off:.1e}, the print's precision",
        holds=off < 5e-4,
        note="found by trying, the scale fitted: Omega seems to stand for Omega^2, and x_s for x_a; that doesn't "
        "explain the numerator",
        values=[scale, off],
    )


def frequencies() -> Any:
    """Return omega_i of (5.107), i = 1..r, in rad/s."""
    stiffness, mass = MODULUS * WIDTH * HEIGHT**3 / 12.0, DENSITY * WIDTH * HEIGHT
    return (np.arange(1, MODES + 1) * np.pi / LENGTH) ** 2 * np.sqrt(stiffness / mass)


def shapes(x: float) -> list[Fraction]:
    """Return v_i(x), i = 1..r, to 15 digits."""
    return [Fraction(f"{np.sin(i * np.pi * x / LENGTH):.15f}") for i in range(1, MODES + 1)]


def beam() -> tuple[Structure, Any, Any]:
    """Return (5.113) in the coordinates (5.112), time in units of 1/omega_1, and the rows v(x_a, r) and v(x_s, r).

    The last coordinate is the displacement at x_a, which the outputs leave out.
    """
    at_a = shapes(DRIVEN)
    S = np.array([[Fraction(int(i == j)) for j in range(MODES)] for i in range(MODES)])
    S[:, -1] = [-v / at_a[-1] for v in at_a[:-1]] + [1 / at_a[-1]]  # (5.111)
    squares = np.array([i**4 for i in range(1, MODES + 1)])
    inputs, outputs = ([[*shapes(x)[:-1], 0]] for x in (DRIVEN, SENSED))
    return Structure(S @ S.T, S * squares @ S.T), inputs, outputs


def without_coupling(structure: Structure) -> Structure:
    """Return the structure without the inertia between x_a and the rest, as (5.114) has it."""
    M = np.array(structure.M)
    M[-1, :-1] = M[:-1, -1] = 0
    return Structure(M, structure.K)


def parts(operator: RationalOperator) -> tuple[Any, Any]:
    """Return eta_o and eta_i, (5.18) and (5.19), which may share factors."""
    return operator.theorem_1.numerators[0, 0].element, operator.theorem_1.denominator


def in_seconds(scaled: Coefficients) -> list[float]:
    """Return coefficients of powers of p in rad/s from those of p in units of omega_1."""
    return [float(c) * frequencies()[0] ** k for k, c in enumerate(scaled)]


def draw(page: Reproduction, structure: Structure, inputs: Any, outputs: Any) -> None:
    """Draw the beam's modes and T from models of their own for both ways of driving it."""
    figure, axes = panels(1, 2, (11.0, 4.2))
    draw_modes(axes[0][0])
    hertz = np.linspace(10.0, 40_000.0, 3000)
    scaled, axis, W = 2j * np.pi * hertz / frequencies()[0], axes[0][1], [*inputs, *outputs]
    draw_both_ways(axis, hertz / 1e3, *(np.abs(T.at(scaled)[:, 0, 0]) for T in models(structure, W)))
    axis.set_xlabel("frequency (kHz), for steel")
    axis.set_title("from $x_a$ to $x_s$, three of four modes: (5.115)")
    figure.suptitle("Example 5.8.2: the beam driven by a force and by a prescribed motion at $x_a$")
    page.draw("ex_5_8_2", figure)


def draw_modes(axis: Axes) -> None:
    """Draw the mode shapes, where the beam is driven and where it's watched."""
    x = np.linspace(0.0, LENGTH, 400)
    for i, tint in enumerate((COLOURS["p"], COLOURS["q"], COLOURS["r"], COLOURS["beta"]), 1):
        axis.plot(1e3 * x, np.sin(i * np.pi * x / LENGTH), color=tint, label=f"$v_{i}$")
    for name, place in (("$x_a$", DRIVEN), ("$x_s$", SENSED)):
        axis.axvline(1e3 * place, color=COLOURS["healthy"], ls=":")
        axis.text(1e3 * place, 1.08, name, ha="center")
    axis.set_ylim(-1.2, 1.25)
    axis.set_xlabel("x (mm)")
    axis.set_ylabel("$v_i(x)$")
    axis.set_title("modes; driven at $x_a$, watched at $x_s$")
    axis.legend(loc="lower left", ncols=2, fontsize="small")


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
