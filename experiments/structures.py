"""Chapter 5 of the dissertation: structures driven by forces and by prescribed motions.

Run ``python experiments/structures.py [--quick] [--out DIR]``. Every printed polynomial of the mass-spring examples
comes out exactly; the force-driven and the displacement-driven operators are equal there, on random structures whose
masses may couple, and, in floating point, on a chain of forty masses. Example 5.8.2, the beam, is in ``beam.py``.
"""

from __future__ import annotations

import sys
from fractions import Fraction
from itertools import combinations, product
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dissertation.figures import draw_both_ways, draw_structure
from dissertation.reproduction import (
    Reproduction,
    claim_equal,
    claim_polynomials,
    flat,
    reproduce,
)
from gtmbench.errors import InputError
from gtmbench.report.figures.panels import panels
from gtmbench.values.record import FloatArray
from theory.motions import holds_for_free_responses
from theory.numeric import NumericOperator
from theory.polynomials import write_polynomial
from theory.rational import RationalOperator, coefficients
from theory.structures import Structure, displacement_driven, force_driven, mass_spring
from theory.structures import unit_columns as columns
from theory.structures import unit_rows as rows

SPRINGS = ((0, 1), (1, 2), (1, 4), (1, 5), (2, 3), (3, 6), (4, 5), (4, 6))
FIG_5_1 = mass_spring([1] * 6, dict.fromkeys(SPRINGS, 1))
PLACES = {0: (0.0, 1.0), 1: (1.0, 1.0), 2: (1.9, 1.9), 3: (3.1, 1.9), 4: (2.5, 0.75), 5: (1.75, -0.2), 6: (4.0, 1.0)}
K = [[4, -1, 0, -1, -1, 0], [-1, 2, -1, 0, 0, 0], [0, -1, 2, 0, 0, -1]]
K += [[-1, 0, 0, 3, -1, -1], [-1, 0, 0, -1, 2, 0], [0, 0, -1, -1, 0, 2]]
K_2 = [[4, 0, -1, -1, 0], [0, 2, 0, 0, -1], [-1, 0, 3, -1, -1], [-1, 0, -1, 2, 0], [0, -1, -1, 0, 2]]
K_D = [[4, -1, -1, 0], [-1, 3, -1, -1], [-1, -1, 2, 0], [0, -1, 0, 2]]
FIRST = ["p^8+9p^6+27p^4+32p^2+14", "p^10+13p^8+61p^6+124p^4+102p^2+25", "p^8+11p^6+40p^4+54p^2+22"]
FIRST += ["p^6+8p^4+21p^2+16", "p^6+8p^4+19p^2+15", "p^6+10p^4+28p^2+19"]
SECOND = ["p^6+8p^4+19p^2+14", "p^8+11p^6+40p^4+54p^2+22", "p^10+13p^8+61p^6+126p^4+111p^2+30"]
SECOND += ["p^6+9p^4+23p^2+18", "2p^4+13p^2+16", "p^8+11p^6+40p^4+55p^2+24"]
BOTH = [polynomial for pair in zip(FIRST, SECOND, strict=True) for polynomial in pair]
MOVED = ["p^6+7p^4+14p^2+8", "p^2+3", "p^4+5p^2+6", "p^4+6p^2+7", "p^4+6p^2+7", "p^2+5", "p^2+3"]
MOVED += ["p^6+9p^4+23p^2+13"]
DET_FORCED = "p^14+17p^12+115p^10+396p^8+735p^6+709p^4+300p^2+28"
DET_MOVED = "p^10+13p^8+62p^6+133p^4+125p^2+38"
A_11 = "p^22+28p^20+342p^18+2394p^16+10611p^14+31052p^12+60672p^10+78167p^8+63850p^6+30491p^4+7184p^2+532"
A_21 = "-p^24-31p^22-426p^20-3420p^18-17793p^16-62885p^14-153828p^12-260183p^10-298351p^8-222041p^6-98657p^4"
A_21 += "-22084p^2-1596"
A_22 = "p^26+33p^24+487p^22+4244p^20+24291p^18+96077p^16+268987p^14+536787p^12+758045p^10+740576p^8+478889p^6"
A_22 += "+188907p^4+38580p^2+2660"


def main(page: Reproduction) -> None:
    """Print section 5.7, the mass-spring examples of section 5.8, and what goes beyond them."""
    theorems(page)
    one_driven(page)
    two_driven(page)
    free_responses(page)
    chain(page)
    figures(page)


def theorems(page: Reproduction) -> None:
    """Hold Theorems 5 and 6, and what (5.55) and (5.114) print, on random structures."""
    count = 5 if page.quick else 40
    cases = (("Theorem 5, (5.89), one driven mass", 1), ("Theorem 6, (5.95), 2 or 3 driven masses", 3))
    for (theorem, most), coupled in product(cases, (False, True)):
        trials = [trial(np.random.default_rng([most, run]), most, coupled=coupled) for run in range(count)]
        equal, literal = (sum(equality[i] for equality in trials) for i in (0, 1))
        ours = f"exactly, in {equal} of {count} random structures"
        name = f"{theorem}, {'coupled masses' if coupled else 'diagonal M'}"
        note = "(5.71): I without the columns D, not k" if most > 1 else ""
        stands = {"runs": count, "values": [equal, count]}
        if not coupled:
            page.claim(name, "T^F = T^D", ours, agrees=equal == count, note=note, **stands)
            continue
        note = "; ".join(filter(None, ("(5.1) and (5.29) have M diagonal; Ex. 5.8.2 hasn't", note)))
        page.unprinted(name, f"T^F = T^D {ours}", holds=equal == count, note=note, **stands)
        page.unprinted(
            f"{theorem}, coupled, -K_[D,.] e_D alone",
            f"T^F = T^D in {literal} of {count}",
            holds=literal == 0,
            note="as (5.114), which lacks the inertial coupling -p^2 M_[D,.] e_D; (5.55) has M diagonal",
            runs=count,
            values=[literal, count],
        )


def trial(rng: np.random.Generator, most: int, *, coupled: bool) -> tuple[bool, bool]:
    """Tell of one random structure whether T^F = T^D, and whether it would be without inertial coupling to D."""
    n = int(rng.integers(5, 8))
    springs = {ends: tenths(rng, 1, 30) for ends in combinations(range(n + 1), 2) if rng.random() < 0.5}
    lumped = mass_spring([tenths(rng, 10, 40) for _ in range(n)], springs)
    off = np.triu([[tenths(rng, -3, 3) * coupled / n for _ in range(n)] for _ in range(n)], 1)
    structure = Structure(np.array(lumped.M) + off + off.T, lumped.K)
    # fewer than n/2, for with n/2 both are Wo Wi^-1 whatever the structure is
    driven = [int(k) + 1 for k in rng.permutation(n)[: rng.integers(min(2, most), min((n - 1) // 2, most) + 1)]]
    Wi, Wo = rng.integers(-3, 4, (len(driven), n)), rng.integers(-3, 4, (2, n))
    here = np.isin(np.arange(1, n + 1), driven)
    uncoupled = Structure(np.where(here == here[:, np.newaxis], np.array(structure.M), 0), structure.K)
    try:
        forced, moved = driven_both_ways(structure, driven, Wi, Wo)
        literal = displacement_driven(uncoupled, driven, Wi, Wo)
    except InputError:  # Gamma_i is singular, which the definitions exclude
        return trial(rng, most, coupled=coupled)
    return forced.equals(moved), forced.equals(literal)


def tenths(rng: np.random.Generator, least: int, most: int) -> Fraction:
    """Return a random multiple of 1/10 from least/10 to most/10."""
    return Fraction(int(rng.integers(least, most + 1)), 10)


def driven_both_ways(structure: Structure, driven: list[int], Wi: Any, Wo: Any) -> tuple[RationalOperator, ...]:
    """Return T^F and T^D, the driven masses left out of the outputs of both."""
    blank = ([[0 if k + 1 in driven else w for k, w in enumerate(row)] for row in W] for W in (Wi, Wo))
    forced = force_driven(structure, columns(driven, structure.masses), *blank)
    return forced, displacement_driven(structure, driven, Wi, Wo)


def without(matrix: Any, driven: list[int]) -> Any:
    """Return a matrix without the rows and columns of some masses."""
    return np.delete(np.delete(np.array(matrix), np.array(driven) - 1, 0), np.array(driven) - 1, 1)


def one_driven(page: Reproduction) -> None:
    """Hold Example 5.8.1, one driven mass."""
    page.number("Ex. 5.8.1, (5.100), K", printed=K, ours=FIG_5_1.K, tolerance=0)
    page.number("(5.100), K_[2,2]", printed=K_2, ours=without(FIG_5_1.K, [2]), tolerance=0)
    first, last = rows([1], 6), rows([6], 6)
    every = force_driven(FIG_5_1, columns([2], 6), first, rows(range(1, 7), 6))
    claim_polynomials(page, "(5.101), adj(p^2 M + K) e_2", FIRST, flat(every.gamma_o))
    others = displacement_driven(FIG_5_1, [2], first, rows([1, 3, 4, 5, 6], 6))
    claim_polynomials(
        page, "(5.102), -adj(p^2 M_[2,2] + K_[2,2]) K_[2,.] e_2", FIRST[:1] + FIRST[2:], flat(others.gamma_o)
    )
    forced, moved = driven_both_ways(FIG_5_1, [2], first, last)
    for name, operator in (("(5.103), T^F from q1 to q6", forced), ("(5.104), T^D from q1 to q6", moved)):
        ours = flat(operator.gamma_o) + flat(operator.gamma_i)
        claim_polynomials(page, f"{name}: numerator; denominator", [FIRST[5], FIRST[0]], ours)
    claim_equal(page, "Ex. 5.8.1, T^F and T^D", forced.equals(moved))
    roots = {"poles": forced.poles, "zeros": forced.zeros()}
    above = [
        f"{name} {np.array2string(own[(own.imag > 0) & (own.real > -1e-9)], precision=7)}"
        for name, own in roots.items()
    ]
    page.unprinted(
        "Ex. 5.8.1, poles and zeros", ", ".join(above), values=roots, note="in rad/s, with their images in both axes"
    )


def two_driven(page: Reproduction) -> None:
    """Hold Example 5.8.3, two driven masses."""
    page.number("Ex. 5.8.3, (5.116), K", printed=K, ours=FIG_5_1.K, tolerance=0)
    page.number("(5.116), K_[D,D]", printed=K_D, ours=without(FIG_5_1.K, [2, 3]), tolerance=0)
    Wi, Wo = rows([1, 4], 6), rows([5, 6], 6)
    every = force_driven(FIG_5_1, columns([2, 3], 6), Wi, rows(range(1, 7), 6))
    claim_polynomials(page, "(5.117), adj(p^2 M + K) [e_2 e_3]", BOTH, flat(every.gamma_o))
    forced, moved = driven_both_ways(FIG_5_1, [2, 3], Wi, Wo)
    claim_polynomials(page, "(5.118), Gamma_i", BOTH[:2] + BOTH[6:8], flat(forced.gamma_i))
    claim_polynomials(page, "(5.119), Gamma_o", BOTH[8:], flat(forced.gamma_o))
    rest = displacement_driven(FIG_5_1, [2, 3], Wi, rows([1, 4, 5, 6], 6))
    claim_polynomials(page, "(5.120), -adj(p^2 M_[D,D] + K_[D,D]) K_[D,.] e_D", MOVED, flat(rest.gamma_o))
    claim_polynomials(page, "(5.121), Gamma_i,d", MOVED[:4], flat(moved.gamma_i))
    claim_polynomials(page, "(5.121), Gamma_o,d", MOVED[4:], flat(moved.gamma_o))
    products = []
    for number, det, operator, other in (("(5.122)", DET_MOVED, forced, moved), ("(5.127)", DET_FORCED, moved, forced)):
        factor = other.theorem_1.denominator
        claim_polynomials(page, f"{number}, the determinant in front", [det], [coefficients(factor)])
        products.append(flat(operator.theorem_1.numerators * factor))
        names = "(5.123)-(5.126), A" if operator is forced else "(5.128)-(5.131), A_d"
        claim_polynomials(page, names, [A_11, A_11, A_21, A_22], products[-1])
    claim_equal(page, "(5.132), (5.133), A and A_d", products[0] == products[1])
    claim_equal(page, "(5.134), T^F and T^D", forced.equals(moved))
    short = forced.reduced
    numerators = [write_polynomial(polynomial) for polynomial in flat(short.numerators)]
    denominator = write_polynomial(coefficients(short.denominator))
    values = flat(short.numerators)
    page.unprinted(
        "Ex. 5.8.3, T reduced",
        f"[{', '.join(numerators[:2])}; {', '.join(numerators[2:])}] / ({denominator})",
        note="a factor of degree 12 is cancelled, which the free responses allow",
        values={"numerators": values, "denominator": coefficients(short.denominator)},
    )


def free_responses(page: Reproduction) -> None:
    """Theorems 3 and 4: nonzero q(0) and q'(0) satisfy the operators too, and so does what is left of them."""
    A = np.block([[np.zeros((6, 6), int), np.eye(6, dtype=int)], [-np.array(K), np.zeros((6, 6), int)]])
    cases = (("Theorem 3, (5.26)", "5.8.1", [2], [1], [6]), ("Theorem 4, (5.48)", "5.8.3", [2, 3], [1, 4], [5, 6]))
    for theorem, example, driven, inputs, outputs in cases:
        Wi, Wo = rows(inputs, 6), rows(outputs, 6)
        T, blank = driven_both_ways(FIG_5_1, driven, Wi, Wo)[0], np.zeros((len(inputs), 6), int)
        Ci, Co = np.hstack([Wi, blank]), np.hstack([Wo, blank[: len(outputs)]])
        held = [
            holds_for_free_responses(operator, A, Ci, Co) for operator in (T.theorem_1, T.system_equation, T.reduced)
        ]
        page.claim(
            f"{theorem}, Ex. {example}, any q(0), q'(0)",
            "satisfied",
            f"{'satisfied' if held[0] else 'not satisfied'}, exactly; reduced: {'too' if held[2] else 'not'}",
            agrees=held[0],
            holds=all(held),
            values=held,
        )


def chain(page: Reproduction) -> None:
    """Theorem 5 in floating point, for a chain from a wall whose middle is driven: no polynomials are expanded."""
    n, k = 40, 21
    structure = mass_spring([1.0] * n, {(i, i + 1): 1.0 for i in range(n)})
    W = rows([1, n], n)
    forced, moved = (
        NumericOperator(model=model)
        for model in (structure.states(columns([k], n), W), structure.driven_states([k], W))
    )
    points = 0.1 + 1j * np.linspace(0.0, 2.2, 200)
    off = np.max(np.abs(forced.at(points) / moved.at(points) - 1.0))
    result = "Theorem 5, 40 masses, m21 driven, q1 to q40"
    page.claim(result, "T^F = T^D", f"to {off:.1e}", agrees=off < 1e-9, values=off)
    page.unprinted(
        "Theorem 5, 40 masses, poles",
        f"{len(forced.poles)}, +-j {abs(forced.poles[0]):.7g} to {abs(forced.poles[-1]):.7g} rad/s",
        note="those of the 19 masses beyond m21: 2 sin((2i-1) pi/78)",
        values=forced.poles,
    )


def figures(page: Reproduction) -> None:
    """Draw Fig. 5.1 and the operators of both examples."""
    frequencies = np.linspace(0.01, 2.8, 1400)
    figure, axes = panels(1, 2, (11.0, 4.2))
    draw_structure(axes[0][0], PLACES, {(i, j): f"$k_{{{i}{j}}}$" for i, j in SPRINGS}, driven=[2])
    axes[0][0].set_title("force f or prescribed motion on $m_2$; all 1 kg, 1 N/m")
    magnitude(axes[0][1], frequencies, [2], [1, 6], 0, 0)
    axes[0][1].set_title("from $q_1$ to $q_6$, (5.103) and (5.104)")
    figure.suptitle("Fig. 5.1 and Example 5.8.1: the two operators are one")
    page.draw("fig_5_1", figure)
    figure, axes = panels(2, 2, (11.0, 6.6))
    for (o, i), axis in zip(np.ndindex(2, 2), np.ravel(axes), strict=True):
        magnitude(axis, frequencies, [2, 3], [1, 4, 5, 6], o, i)
        axis.set_title(f"from $q_{(1, 4)[i]}$ to $q_{(5, 6)[o]}$")
    figure.suptitle("Example 5.8.3: $m_2$ and $m_3$ driven, (5.134)")
    page.draw("ex_5_8_3", figure)


def magnitude(axis: Axes, frequencies: FloatArray, driven: list[int], watched: list[int], o: int, i: int) -> None:
    """Draw an entry of T^F and of T^D from models of their own."""
    W = rows(watched, 6)
    models = FIG_5_1.states(columns(driven, 6), W), FIG_5_1.driven_states(driven, W)
    draw_both_ways(
        axis, frequencies, *(np.abs(NumericOperator(model=model).at(1j * frequencies)[:, o, i]) for model in models)
    )
    axis.set_xlabel("$\\omega$ (rad/s)")


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
