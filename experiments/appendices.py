"""Theorem 1 of the dissertation and the lemmas and propositions of its appendices A and B, on random models.

Run ``python experiments/appendices.py [--quick] [--out DIR]``. Whether motions satisfy an operator's differential
equation is decided exactly, and evaluated in floating point with exact derivatives; Proposition B.2 needs the columns
of C at D to be zero. Floating point without polynomials, for large models, is held against the exact operators.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import scipy.linalg
from sympy import QQ
from sympy.polys.matrices import DomainMatrix

from dissertation.reproduction import Reproduction, flat, reproduce
from gtmbench.report.figures.panels import panels
from gtmbench.report.style import COLOURS
from theory.exact import exact_operator
from theory.motions import holds_for_free_responses, relative_residual, with_input
from theory.numeric import NumericOperator
from theory.rational import adjugate_times
from theory.state_space import StateSpace

# w1 a line in time, w3 and w4 a growing oscillation, w5 a decay
GENERATOR = scipy.linalg.block_diag([[0.0, 1.0], [0.0, 0.0]], [[0.1, 2.0], [-2.0, 0.1]], [[-0.5]]).tolist()
TIME_S = np.linspace(0.0, 3.0, 121)


def main(page: Reproduction) -> None:
    """Print Theorem 1, appendix A, what large models take, and appendix B."""
    theorem_1(page)
    companion_powers(page)
    companion_forms(page)
    responses(page)
    large_models(page)
    adjugates(page)


def random_model(rng: np.random.Generator, *, m: int, outputs: int, n: int, hidden: bool = False) -> dict[str, Any]:
    """Return matrices of tenths; with `hidden`, the last state is uncontrollable and moves the others."""
    shapes = {"A": (n, n), "B": (n, m), "Ci": (m, n), "Co": (outputs, n), "Di": (m, m), "Do": (outputs, m)}
    model = {name: rng.integers(-20, 21, shape) / 10 for name, shape in shapes.items()}
    if hidden:
        model["A"][-1, :-1] = model["B"][-1] = 0.0
    return model


def theorem_1(page: Reproduction) -> None:
    """Hold (2.32), and what is left when more is cancelled, on models with and without an uncontrollable mode."""
    count = 8 if page.quick else 40
    for hidden in (False, True):
        held = np.zeros(3, dtype=int)
        for run in range(count):
            rng = np.random.default_rng([int(hidden), run])
            m = int(rng.integers(1, 4))
            model = random_model(rng, m=m, outputs=int(rng.integers(1, 3)), n=int(rng.integers(3, 6)), hidden=hidden)
            T = exact_operator(**model)
            whole = with_input(**model, generator=GENERATOR, G=rng.integers(-3, 4, (m, len(GENERATOR))))
            held += [
                holds_for_free_responses(operator, **whole) for operator in (T.theorem_1, T.system_equation, T.reduced)
            ]
        models = "with an uncontrollable mode" if hidden else "random"
        page.claim(
            f"Theorem 1, (2.32), models: {models}",
            "satisfied by any x0 and u",
            f"exactly, by {held[0]} of {count}, m = 1 to 3",
            agrees=bool(held[0] == count),
            note="u: lines, a growing oscillation, a decay",
            runs=count,
            values=[held[0], count],
        )
        page.unprinted(
            f"(2.32) with more cancelled, {models}",
            f"delta^(m-1): {held[1]} of {count}; every common factor: {held[2]} of {count}",
            holds=[*held[1:]] == [count, 0 if hidden else count],
            runs=count,
            note="common factors are the uncontrollable modes, which motions have" if hidden else "",
            values=held[1:],
        )


def companion_powers(page: Reproduction) -> None:
    """Hold Lemma A.1: f_ij = f_ji, where f_ij is chi_i times the j-th power of the companion matrix."""
    count = 8 if page.quick else 40
    symmetric = 0
    for run in range(count):
        rng = np.random.default_rng(run)
        n = int(rng.integers(2, 8))
        alpha = np.array([int(number) for number in rng.integers(-9, 10, n)], dtype=object)
        A = np.vstack([np.eye(n, dtype=int)[1:].astype(object), -alpha])
        chi, power, f = (
            np.vstack([np.eye(n, dtype=int).astype(object), -alpha]),
            np.eye(n, dtype=int).astype(object),
            [],
        )
        for _ in range(n + 1):
            f.append(chi @ power)
            power = power @ A
        symmetric += all(np.array_equal(f[j][i], f[i][j]) for i in range(n + 1) for j in range(n + 1))
    page.claim(
        "Lemma A.1, f_ij = f_ji, i, j = 0..n",
        "for every alpha",
        f"exactly, for {symmetric} of {count}, n = 2 to 7",
        agrees=symmetric == count,
        runs=count,
        values=[symmetric, count],
    )


def companion_forms(page: Reproduction) -> None:
    """Hold Lemma A.2: at t = 0 its sides are rows of numbers, and exp(A_c t) is on the right of both."""
    count = 8 if page.quick else 40
    held = sum(second_lemma(np.random.default_rng([12, run])) for run in range(count))
    page.claim(
        "Lemma A.2, (A.11), (A.12)",
        "both sides equal, all t",
        f"exactly, for {held} of {count}, n = 2 to 5",
        agrees=held == count,
        note="p exp(A_c t) = A_c exp(A_c t); Gamma from the adjugate, with D for (A.11), without for (A.12)",
        runs=count,
        values=[held, count],
    )


def second_lemma(rng: np.random.Generator) -> bool:
    """Tell whether (A.11) and (A.12) hold for a random companion form."""
    n = int(rng.integers(2, 6))
    A = np.vstack([np.eye(n, dtype=int)[1:], rng.integers(-9, 10, n)])
    Ci, Co = rng.integers(-9, 10, (2, 1, n))
    Di, Do = rng.integers(1, 10, (2, 1, 1))
    model = {"A": A, "B": np.eye(n, dtype=int)[:, -1:], "Ci": Ci, "Co": Co}
    exact = A.astype(object)
    sides = [
        sum(c * row @ np.linalg.matrix_power(exact, k) for k, c in enumerate(reversed(flat(gamma)[0])))
        for T in (exact_operator(**model, Di=Di, Do=Do), exact_operator(**model))
        for gamma, row in ((T.gamma_o, Ci.astype(object)), (T.gamma_i, Co.astype(object)))
    ]
    return all(np.array_equal(left, right) for left, right in (sides[:2], sides[2:]))


def responses(page: Reproduction) -> None:
    """Hold Lemmas A.3 to A.5 in floating point, the derivatives exact, stable and unstable, one input and three."""
    count = 5 if page.quick else 30
    for lemma, free, forced in (("A.3, (A.16), x0", 1, 0), ("A.4, (A.19), u", 0, 1), ("A.5, (A.22), x0 and u", 1, 1)):
        off = {}
        for abscissa in (-0.3, 0.5):  # the greatest real part of a pole
            for m in (1, 3):
                some = [motion([m, run], m, abscissa, free, forced)[2] for run in range(count)]
                off[f"{'stable' if abscissa < 0 else 'unstable'}, m = {m}"] = np.max(np.abs(some))
        worst = max(off.values())
        page.claim(
            f"Lemma {lemma}",
            "both sides equal",
            f"to {worst:.1e} of the terms",
            agrees=bool(worst < 1e-8),
            note=f"{count} models each, stable and unstable, m = 1 and, as (2.32), 3",
            runs=count,
            values=off,
        )
    figure, axes = panels(2, 2, (11.0, 6.0))
    for column, (abscissa, title) in enumerate(((-0.3, "a stable model"), (0.5, "an unstable model"))):
        y_i, y_o, off = motion([1, 0], 1, abscissa, 1, 0)
        axes[0][column].plot(TIME_S, y_i, color=COLOURS["p"], label="$y_i$, pseudo input")
        axes[0][column].plot(TIME_S, y_o, color=COLOURS["q"], label="$y_o$, pseudo output")
        axes[0][column].set_title(title)
        axes[0][column].set_ylabel("free response")
        axes[0][column].legend(loc="best")
        axes[1][column].plot(TIME_S, off / np.finfo(float).eps, ".", color=COLOURS["healthy"])
        axes[1][column].set_ylabel("residual over terms / 2.2e-16")
        axes[1][column].set_xlabel("time (s)")
    figure.suptitle(
        r"Lemma A.3: $\Gamma_o(p)\, y_i = \Gamma_i(p)\, y_o$ for free responses from nonzero initial conditions"
    )
    page.draw("lemma_a_3", figure)


def motion(seed: list[int], m: int, abscissa: float, free: int, forced: int) -> tuple[Any, Any, Any]:
    """Return y_i, y_o and the relative residual of (2.32) of one motion of a random model, shapes (times, channels)."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, m=m, outputs=1, n=4)
    shift = abscissa - np.linalg.eigvals(model["A"]).real.max()
    model["A"] = (model["A"] + shift * np.eye(4)).round(1)
    whole = with_input(**model, generator=GENERATOR, G=rng.integers(-3, 4, (m, len(GENERATOR))))
    start = np.concatenate([free * rng.standard_normal(4), forced * rng.standard_normal(len(GENERATOR))])
    off = relative_residual(exact_operator(**model).theorem_1, **whole, x0=start, time_s=TIME_S)
    A, Ci, Co = (np.asarray(whole[name], dtype=float) for name in ("A", "Ci", "Co"))
    states = np.array([scipy.linalg.expm(A * t) @ start for t in TIME_S])
    return states @ Ci.T, states @ Co.T, off


def large_models(page: Reproduction) -> None:
    """Hold the operator in floating point against the exact one, and against Go Gi^-1 where that is too large."""
    count, off = (5 if page.quick else 20), []
    for run in range(count):
        model = random_model(np.random.default_rng([9, run]), m=2, outputs=2, n=5)
        exact, numeric = exact_operator(**model), NumericOperator(model=stacked(model))
        points = 3.0 * np.exp(1j * np.linspace(0.0, 3.0, 20))
        off.append(np.max(np.abs(numeric.at(points) / exact.at(points) - 1.0)))
        zeros = [(numeric.zeros(o, i), exact.zeros(o, i)) for o, i in np.ndindex(2, 2)]
        off += [np.max(np.abs(ours / theirs - 1.0)) for ours, theirs in [(numeric.poles, exact.poles), *zeros]]
    ours = f"as the exact one to {max(off):.1e}"
    page.unprinted("(2.49) without polynomials, 5 states", ours, holds=max(off) < 1e-9, runs=count, values=max(off))
    model = stacked(random_model(np.random.default_rng(9), m=3, outputs=2, n=40))
    T, points = NumericOperator(model=model), 1j * np.linspace(0.1, 10.0, 100)
    G = model.at(points)
    off = np.max(np.abs(T.at(points) @ G[:, :3] - G[:, 3:])) / np.max(np.abs(G))
    page.unprinted(
        "(2.49) without polynomials, 40 states, 3 inputs",
        f"T Gi = Go to {off:.1e}; {len(T.poles)} poles",
        holds=off < 1e-9 and len(T.poles) == 40,
        values=T.poles,
    )


def stacked(model: dict[str, Any]) -> StateSpace:
    """Return the model with its pseudo inputs above its pseudo outputs, (2.4)."""
    rows = (np.vstack([model[name + "i"], model[name + "o"]]) for name in ("C", "D"))
    return StateSpace(model["A"], model["B"], *rows)


def adjugates(page: Reproduction) -> None:
    """Hold Propositions B.1 and B.2, and where the latter fails."""
    count = 20 if page.quick else 200
    held = sum(first_proposition(np.random.default_rng([1, run])) for run in range(count))
    page.claim(
        "Proposition B.1, (B.1), also singular A",
        "for every A and i",
        f"exactly, for {held} of {count}",
        agrees=held == count,
        runs=count,
        values=[held, count],
    )
    general, blank = (
        sum(second_proposition(np.random.default_rng([2, run]), blank=blank) for run in range(count))
        for blank in (False, True)
    )
    page.claim(
        "Proposition B.2, (B.2), columns of C at D zero",
        "equal",
        f"exactly, for {blank} of {count}",
        agrees=blank == count,
        note="as in Theorem 6; C_[.,D] S nonsingular needs d <= n/2",
        runs=count,
        values=[blank, count],
    )
    page.claim(
        "Proposition B.2, (B.2), as stated, any C",
        "equal",
        f"for {general} of {count}",
        agrees=general == count,
        differs="misprint: the columns of C at D must be zero",
        holds=general == 0,
        runs=count,
        values=[general, count],
    )


def first_proposition(rng: np.random.Generator) -> bool:
    """Tell whether (B.1) holds for a random A, of reduced rank every other time, and every i."""
    n = int(rng.integers(2, 7))
    rank = int(rng.integers(0, n + 1)) if rng.random() < 0.5 else n
    A = whole_numbers(rng.integers(-5, 6, (n, rank)) @ rng.integers(-5, 6, (rank, n)))
    adjugate = adjugate_times(A, A.eye(n, QQ))[0]
    others = [[k for k in range(n) if k != i] for i in range(n)]
    sums = (
        adjugate.extract(rest, [i]) + adjugate_times(A.extract(rest, rest), A.extract(rest, [i]))[0]
        for i, rest in enumerate(others)
    )
    return all(total.is_zero_matrix for total in sums)


def second_proposition(rng: np.random.Generator, *, blank: bool) -> bool:
    """Tell whether (B.2) holds for a random A and C, with `blank` one whose columns at D are zero."""
    n = int(rng.integers(4, 8))
    d = int(rng.integers(1, n // 2 + 1))
    order = rng.permutation(n).tolist()
    D, rest = order[:d], order[d:]
    A, C = whole_numbers(rng.integers(-9, 10, (n, n))), rng.integers(1, 10, (d, n))
    C[:, D] *= not blank
    C = whole_numbers(C)
    R = adjugate_times(A, A.eye(n, QQ).extract(range(n), D))[0]
    S = adjugate_times(A.extract(rest, rest), A.extract(rest, D))[0]
    below = C.extract(range(d), rest) * S
    if not (C * R).det() or not below.det():
        return second_proposition(rng, blank=blank)  # the proposition excludes it
    return bool(R.extract(rest, range(d)) * (C * R).inv() == S * below.inv())


def whole_numbers(values: Any) -> DomainMatrix:
    """Return an array of whole numbers as an exact matrix over the rationals."""
    return DomainMatrix([[QQ(int(value)) for value in row] for row in values], values.shape, QQ)


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
