"""Chapter 2 of the dissertation: transmissibility operators as matrices of rational functions of p = d/dt.

Run ``python experiments/exact_operators.py [--quick] [--out DIR]``. Every printed polynomial comes out exactly, symbols
included; a common factor in p can't always be cancelled, but that of Theorem 1 can. The theorem itself and the lemmas
behind it, on random models, are in ``appendices.py``.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import scipy.linalg
import sympy

from dissertation.figures import draw_structure
from dissertation.reproduction import (
    Reproduction,
    claim_equal,
    claim_polynomials,
    flat,
    reproduce,
)
from gtmbench.report.figures.panels import panels
from theory.exact import exact_operator
from theory.motions import holds_for_free_responses, relative_residual, with_input
from theory.rational import Coefficients, RationalOperator, coefficients
from theory.structures import force_driven, mass_spring, unit_columns, unit_rows

p = sympy.Symbol("p")
MODEL_2_4_2: dict[str, Any] = {
    "A": [[-1, 1, 0], [0, -1, 1], [0, 0, -1]],
    "B": [[1, 0], [0, 1], [1, 1]],
    "Ci": [[1, 0, 0], [0, 1, 0]],
    "Co": [[0, 0, 1]],
    "Di": [[1, 0], [0, 0]],
    "Do": [[0, 0]],
}
# w1 a line in time, w3, w4 a growing oscillation: u1 = w1 + w3, u2 = w2 - 2 w4
GENERATOR = [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0.1, 2], [0, 0, -2, 0.1]]
G = [[1, 0, 1, 0], [0, 1, 0, -2]]
START = [1.0, -2.0, 0.5, 0.3, -0.2, 1.0, 0.0]  # x(0) and w(0)


def main(page: Reproduction) -> None:
    """Print chapter 2 in the order of the text."""
    common_factors(page)
    two_masses(page)
    two_inputs(page)
    three_masses(page)
    figures(page)


def common_factors(page: Reproduction) -> None:
    """Hold Examples 2.2.1 and 2.2.2: their signals, and models whose uncontrollable mode is the difference."""
    t = sympy.Symbol("t")
    for name, factor, y_i, y_o in (
        ("Ex. 2.2.1", p, t + 1, t + 5),
        ("Ex. 2.2.2", p + 1, sympy.Integer(1), 1 + sympy.exp(-t)),
    ):
        first, second = (applied(factor, signal, t) for signal in (y_i, y_o))
        page.claim(
            f"{name}, ({factor}) y_i and ({factor}) y_o",
            "1 and 1, but y_i /= y_o",
            f"{first} and {second}, y_o - y_i = {sympy.simplify(y_o - y_i)}",
            agrees=bool(first == second == 1 and sympy.simplify(y_o - y_i) != 0),
        )
        pole = sympy.solve(factor, p)[0]
        model = {"A": [[pole, 0], [0, pole]], "Ci": [[1, 0]], "Co": [[1, 1]]}
        T = exact_operator(**model, B=[[1], [0]])
        kept, lost = (holds_for_free_responses(form, **model) for form in (T.theorem_1, T.reduced))
        page.unprinted(
            f"{name}, such motions of a model",
            f"delta {'cancels' if kept else 'does not cancel'}, {factor} {'does' if lost else 'does not'}",
            holds=kept and not lost,
            note="y_i = x1, y_o = x1 + x2, x1' = a x1 + u, x2' = a x2: x2 is uncontrollable",
            values=[kept, lost],
        )


def applied(operator: Any, signal: Any, t: Any) -> Any:
    """Return a polynomial of p = d/dt on a signal."""
    terms = sympy.Poly(operator, p).all_terms()
    return sympy.simplify(sum(c * sympy.diff(signal, t, power[0]) for power, c in terms))


def two_masses(page: Reproduction) -> None:
    """Hold Example 2.4.1, with symbols."""
    m1, m2, k1, k2 = sympy.symbols("m1 m2 k1 k2")
    omega = sympy.Matrix([[-(k1 + k2) / m1, k2 / m1], [k2 / m2, -k2 / m2]])
    model = second_order(omega, [1, 2])
    T = exact_operator(**model, B=[[0], [0], [1 / m1], [0]])
    mass = m1 * m2
    claim_symbolic(page, "Ex. 2.4.1, (2.55), Gamma_i", [(m2 * p**2 + k2) / mass], flat(T.gamma_i))
    claim_symbolic(page, "(2.56), Gamma_o", [k2 / mass], flat(T.gamma_o))
    delta = p**4 + (k2 * m1 + (k1 + k2) * m2) / mass * p**2 + k1 * k2 / mass
    claim_symbolic(page, "(2.57), delta", [delta], [coefficients(T.delta)])
    claim_ratio(page, "Ex. 2.4.1, T", k2, m2 * p**2 + k2, T)
    held = holds_for_free_responses(T.reduced, **model)
    page.claim("(2.63), (2.66), any q(0), q'(0)", "satisfied", "satisfied" if held else "not satisfied", agrees=held)


def two_inputs(page: Reproduction) -> None:
    """Hold Example 2.4.2, two inputs, and what (2.74) and (2.75) misprint."""
    T = exact_operator(**MODEL_2_4_2)
    q, r = p + 1, p + 2
    claim_symbolic(page, "Ex. 2.4.2, delta", [p**3 + 3 * p**2 + 3 * p + 1], [coefficients(T.delta)])
    claim_symbolic(page, "(2.71), Gamma_i", [q**2 * r + 1, r, q, q * r], flat(T.gamma_i))
    claim_symbolic(page, "(2.72), Gamma_o", [q**2, q**2], flat(T.gamma_o))
    full = [*flat(T.theorem_1.numerators), coefficients(T.theorem_1.denominator)]
    rest = p**2 + 3 * p + 1
    claim_symbolic(page, "(2.73), numerators; denominator", [q**4, q**3 * rest, q**3 * r**2], full)
    claim_polynomials(
        page,
        "(2.75), left; right, pseudo inputs 1 and 2",
        ["p^5+7p^4+19p^3+25p^2+16p+4", "p^4+4p^3+6p^2+4p+1", "p^5+6p^4+13p^3+13p^2+6p+1"],
        [full[2], full[0], full[1]],
    )
    right, printed = (with_input(**model, generator=GENERATOR, G=G) for model in (MODEL_2_4_2, without_feedthrough()))
    for name, whole in (("x1 + u1 and x2", right), ("x1 and x2, as printed", printed)):
        off = np.abs(relative_residual(T.theorem_1, **whole, x0=START, time_s=np.linspace(0.0, 10.0, 201))).max()
        held, misprint = holds_for_free_responses(T.theorem_1, **whole), whole is printed
        page.claim(
            f"(2.75) with {name}",
            "holds",
            f"{'holds exactly' if held else 'does not hold'}; residual up to {off:.1e} of its terms",
            agrees=held and off < 1e-12,
            differs="misprint: by (2.70) the first pseudo input is x1 + u1" if misprint else "",
            note="with u1, u2 of lines and oscillations",
            values=off,
        )
    held = holds_for_free_responses(T.system_equation, **right)
    short = [*flat(T.reduced.numerators), coefficients(T.reduced.denominator)]
    claim_symbolic(page, "(2.79) without (p+1)^3", [q, rest, r**2], short)
    note = "(2.79) has this factor on both sides"
    ours = "holds" if held else "does not hold"
    page.unprinted("(2.79) without (p+1)^3, any x(0), u", ours, holds=held, note=note)
    zeros = [T.zeros(0, i).real for i in (0, 1)]
    page.unprinted(
        "Ex. 2.4.2, T reduced: poles; zeros; properness",
        f"{T.poles.real}; {zeros[0]} and {zeros[1].round(7)}; {T.properness}, {'stable' if T.stable else 'not stable'}",
        values={"poles": T.poles, "zeros": zeros, "relative degree": T.relative_degree},
    )


def without_feedthrough() -> dict[str, Any]:
    """Return the model whose first pseudo input is x1 alone, as (2.74) and (2.75) have it."""
    return MODEL_2_4_2 | {"Di": [[0, 0], [0, 0]]}


def three_masses(page: Reproduction) -> None:
    """Hold Example 2.4.3, with symbols."""
    m1, m2, m3, k01, k12, k13, k23 = sympy.symbols("m1 m2 m3 k01 k12 k13 k23")
    structure = mass_spring([m1, m2, m3], {(0, 1): k01, (1, 2): k12, (1, 3): k13, (2, 3): k23})
    omega = -sympy.Matrix(structure.M).inv() * sympy.Matrix(structure.K)
    B = [[0], [0], [0], [1 / m1], [0], [0]]
    T = {(j, i): exact_operator(**second_order(omega, [i, j]), B=B) for j, i in ((2, 1), (3, 1), (3, 2))}
    k = k12 * k13 + k12 * k23 + k13 * k23
    first = m2 * m3 * p**4 + (m3 * (k12 + k23) + m2 * (k13 + k23)) * p**2 + k
    second, third, mass = k12 * m3 * p**2 + k, k13 * m2 * p**2 + k, m1 * m2 * m3
    claim_symbolic(page, "Ex. 2.4.3, (2.88), Gamma_1", [first / mass], flat(T[2, 1].gamma_i))
    claim_symbolic(page, "(2.89), Gamma_2", [second / mass], flat(T[2, 1].gamma_o))
    claim_symbolic(page, "(2.90), Gamma_3", [third / mass], flat(T[3, 1].gamma_o))
    claim_ratio(page, "(2.91), T_2,1", second, first, T[2, 1])
    claim_ratio(page, "(2.92), T_3,1", third, first, T[3, 1])
    claim_ratio(page, "(2.93), T_3,2", third, second, T[3, 2])
    chained = [T[3, 2].gamma_o * T[2, 1].gamma_o * T[3, 1].gamma_i, T[3, 2].gamma_i * T[2, 1].gamma_i * T[3, 1].gamma_o]
    equal = bool(chained[0] == chained[1])
    claim_equal(page, "(2.96), (2.97), T_3,2 T_2,1 and T_3,1", equal)


def second_order(omega: Any, masses: list[int]) -> dict[str, Any]:
    """Return x = [q; q'] of q'' = omega q, (2.52), with the displacements of two masses as y_i and y_o."""
    n = omega.shape[0]
    A = sympy.Matrix(sympy.BlockMatrix([[sympy.zeros(n), sympy.eye(n)], [omega, sympy.zeros(n)]]))
    Ci, Co = (unit_rows([k], 2 * n) for k in masses)
    return {"A": A, "Ci": Ci, "Co": Co}


def claim_symbolic(page: Reproduction, result: str, printed: list[Any], ours: list[Coefficients]) -> None:
    """Hold polynomials against the printed ones, factors and symbols and all."""
    expected = [tuple(sympy.Poly(polynomial, p).all_coeffs()) for polynomial in printed]
    claim_polynomials(page, result, [written(polynomial) for polynomial in printed], ours, expected=expected)


def claim_ratio(page: Reproduction, result: str, numerator: Any, denominator: Any, ours: RationalOperator) -> None:
    """Hold a SISO operator against the printed numerator and denominator, up to a common constant."""
    leading = sympy.Poly(denominator, p).LC()
    claim_polynomials(
        page,
        f"{result}: numerator; denominator",
        [written(numerator), written(denominator)],
        list(ours.entry(0, 0)),
        expected=[tuple(sympy.Poly(part / leading, p).all_coeffs()) for part in (numerator, denominator)],
        note="ours has 1 in front of the highest power below",
    )


def written(expression: Any) -> str:
    """Return an expression of p as the source writes it."""
    return str(expression).replace("**", "^").replace("*", "")


def figures(page: Reproduction) -> None:
    """Draw Figs. 2.1 and 2.2 with their operators, all masses and springs 1, and the misprint of (2.75)."""
    frequencies = np.linspace(0.01, 2.5, 1500)
    line = {0: (0.0, 0.0), 1: (1.1, 0.0), 2: (2.3, 0.0)}
    triangle = {0: (0.0, 0.0), 1: (1.1, 0.0), 2: (2.3, 0.7), 3: (2.3, -0.7)}
    springs = {(0, 1): "$k_1$", (1, 2): "$k_2$"}
    other = {(i, j): f"$k_{{{i}{j}}}$" for i, j in ((0, 1), (1, 2), (1, 3), (2, 3))}
    for name, places, joined, pairs in (
        ("2_1", line, springs, [(2, 1)]),
        ("2_2", triangle, other, [(2, 1), (3, 1), (3, 2)]),
    ):
        figure, axes = panels(1, 2, (11.0, 3.8))
        draw_structure(axes[0][0], places, joined, driven=[1])
        axes[0][0].set_title("the force f acts on $m_1$")
        n = len(places) - 1
        structure = mass_spring([1, 2, 1][:n], {ends: 1 + k for k, ends in enumerate(joined)})
        for (j, i), style in zip(pairs, ("-", "--", ":"), strict=False):
            T = force_driven(structure, unit_columns([1], n), unit_rows([i], n), unit_rows([j], n))
            axes[0][1].semilogy(
                frequencies, np.abs(T.at(1j * frequencies)[:, 0, 0]), style, label=f"from $q_{i}$ to $q_{j}$"
            )
        axes[0][1].set_xlabel("$\\omega$ (rad/s)")
        axes[0][1].set_ylabel("$|T(j\\omega)|$")
        axes[0][1].legend(loc="best")
        axes[0][1].set_title(f"masses {', '.join('121'[:n])} kg; springs {', '.join('1234'[: len(joined)])} N/m")
        figure.suptitle(f"Fig. {name.replace('_', '.')}, Example {'2.4.1' if name == '2_1' else '2.4.3'}")
        page.draw(f"fig_{name}", figure)
    misprint(page)


def misprint(page: Reproduction) -> None:
    """Draw a motion of Example 2.4.2 and what (2.75) leaves of it, with its pseudo input and with the printed one."""
    time_s = np.linspace(0.0, 10.0, 401)
    right, printed = (with_input(**model, generator=GENERATOR, G=G) for model in (MODEL_2_4_2, without_feedthrough()))
    A, C = (np.asarray(matrix, dtype=float) for matrix in (right["A"], np.vstack([right["Ci"], right["Co"]])))
    signals = np.array([C @ scipy.linalg.expm(A * t) @ START for t in time_s])
    equation = exact_operator(**MODEL_2_4_2).theorem_1
    figure, axes = panels(1, 2, (11.0, 4.0))
    for signal, name in zip(signals.T, ("$x_1 + u_1$", "$x_2$", "$x_3$, pseudo output"), strict=True):
        axes[0][0].plot(time_s, signal, label=name)
    axes[0][0].set_ylabel("signal")
    for whole, name in ((right, "with $x_1 + u_1$"), (printed, "with $x_1$, as printed")):
        off = np.abs(relative_residual(equation, **whole, x0=START, time_s=time_s))[:, 0]
        axes[0][1].semilogy(time_s, np.maximum(off, 1e-18), label=name)
    axes[0][1].set_ylabel("residual of (2.75) over its terms")
    for axis in axes[0]:
        axis.set_xlabel("time (s)")
        axis.legend(loc="best", fontsize="small")
    figure.suptitle("Example 2.4.2, from nonzero initial conditions, under lines and growing oscillations")
    page.draw("ex_2_4_2", figure)


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
