"""Sections 3.6 and 3.7 of the dissertation: an unstable plant in its loop, by IIR and by noncausal FIR models.

Example 3.2: the errors (3.100) of LS, IV and PEM, Fig. 3.13; and who is biased by noise that enters here or there, for
in Figs. 3.6 and 3.11 it enters in different places. Run ``python experiments/closed_loop.py [--quick] [--out DIR]``.

In Fig. 3.13 it is process noise, behind the place where u is measured, as in Fig. 3.6. IIR models by IV have u for
instrument, as those of Matlab's iv4(data) have; what c would do instead is a row of its own. FIR models have c for
instrument: with the lags of (3.55) in Fig. 3.13; elsewhere IV takes 20 past lags more, and the extended method (XIV)
those of (3.55) 3 samples later, through a filter L(q) that isn't printed; lags and filter were chosen after trying. An
IIR model with a pole on the unit circle has no coefficients, and counts as 0. Fig. 3.11 is a diagram: its two places of
noise, v at u and w at y, are drawn in Fig. 3.6, whose loop all of the examples have.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mpmath import mp

import gtmbench as gb
from dissertation.figures import blank, block, junction, wire
from dissertation.reproduction import Reproduction, reproduce
from gtmbench.errors import InputError
from gtmbench.report.figures.panels import panels
from gtmbench.values.record import FloatArray
from theory.closed_loop import Noise, closed_loop, loop_records
from theory.iir import IirModel, arx, iv4
from theory.laurent import laurent
from theory.pem import pem
from theory.plants import example_3_2

SNR, R, D = 10.0, 50, 50
LENGTH, RUNS = 10_000, 50  # l of Fig. 3.13, and the experiments of (3.100)
UNSTABLE_POLES = 3
DIGITS = 100  # of what (3.55) is worked out in: from 60 on nothing changes
EXAMPLE = example_3_2()
THETA = laurent(EXAMPLE.plant, causal_order=R, noncausal_order=D).coefficients[:, 0, 0]

Records = Sequence[gb.Record]
FIR = {
    "LS": gb.LeastSquares(),
    "IV": gb.InstrumentalVariables(instruments=("c",), past=20),
    "XIV": gb.InstrumentalVariables(instruments=("c",), delay=UNSTABLE_POLES, prefilter=([1.0, 0.5], [1.0, -0.4])),
    "PEM": gb.PredictionError(noise_order=2, tolerance=1e-3),
}
IIR: dict[str, Callable[[gb.Record, int], IirModel]] = {
    "LS": lambda record, order: arx(record, order=order),
    "IV": lambda record, order: iv4(record, order=order, instrument="u"),
    "PEM": lambda record, order: pem(record, order=order),
    "IV from c": lambda record, order: iv4(record, order=order, instrument="c"),
}
MARKERS = {"LS": "o", "IV": "^", "XIV": "v", "PEM": "s"}
COLOURS = {"LS": "tab:blue", "IV": "tab:orange", "XIV": "tab:purple", "PEM": "tab:green", "IV from c": "0.5"}
SAMPLES = (2500, 10_000, 40_000)
NOISE = "process noise, its SNR against c: of the readings tried the one that gives such a figure"
LAGS = "IV with 20 lags of c more than (3.55), XIV with its lags 3 later, chosen after trying"


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where noise enters, who is biased by it, whom section 3.6 calls biased, and why these aren't the same."""

    where: str
    biased: tuple[str, ...]
    printed: tuple[str, ...] = (
        "LS",
    )  # 3.6.1; IV, XIV (3.62) and PEM (3.94) are consistent in print, wherever it enters
    why: str = ""
    note: str = ""


PLACES: dict[Noise, Place] = {
    "process": Place(
        where="behind the measured u",
        biased=("LS", "PEM"),
        why="(3.92) lacks the cross term of w0 and the u that it is fed back to",
    ),
    "measured": Place(
        where="before the measured u", biased=(), printed=(), note="(3.53) with w = 0; u and y are exact"
    ),
    "input": Place(
        where="of u's sensor, (3.38)",
        biased=("LS", "PEM"),
        why="(3.64) has no noise on u",
        note="of LS the text says so in general; (3.53), with w = 0, would have it consistent",
    ),
    "output": Place(
        where="of y's sensor, (3.39)",
        biased=(),
        why="with K x fed back, not y, nothing of w is, so w and u don't correlate",
    ),
}


def main(page: Reproduction) -> None:
    """Hold Example 3.2 against the print, and show where noise does harm."""
    K = [3.5197, -3.1272, -3.0739, 2.0825, 1.0096, 0.7134, 0.4997]
    note = "of the companion form, which isn't stated"
    page.number("Ex. 3.2, (3.99), K", K, EXAMPLE.gain[0], tolerance=5e-5, note=note)
    draw_loop(page)
    records = loop_records(EXAMPLE.plant, EXAMPLE.gain, samples=LENGTH, runs=2 if page.quick else RUNS, snr=SNR)
    figure_3_13(page, records, same_lags(page, records))
    noise_places(page)


def draw_loop(page: Reproduction) -> None:
    """Fig. 3.6, with the places of Fig. 3.11 where noise enters."""
    figure, ((axis,),) = panels(1, 1, (10.0, 3.6))
    block(axis, (6.9, 2.0), "x(k+1) = A x(k) + B u(k)", width=3.0)
    block(axis, (9.7, 2.0), "C", width=0.8)
    block(axis, (5.6, 0.6), "K", width=0.8)
    for at in ((1.4, 2.0), (4.6, 2.0), (2.3, 3.4), (11.2, 3.4)):
        junction(axis, at)
    for corners, label in (
        ([(0.3, 2.0), (1.24, 2.0)], "c"),
        ([(1.6, 2.0), (4.44, 2.0)], "$u_0$"),
        ([(4.7, 2.0), (5.4, 2.0)], ""),
        ([(8.5, 2.0), (9.3, 2.0)], "x"),
        ([(10.2, 2.0), (12.2, 2.0)], "$y_0$"),
        ([(8.85, 2.0), (8.85, 0.6), (6.0, 0.6)], ""),
        ([(5.2, 0.6), (1.4, 0.6), (1.4, 1.84)], ""),
        ([(2.3, 2.0), (2.3, 3.24)], ""),
        ([(2.46, 3.4), (3.2, 3.4)], ""),
        ([(11.2, 2.0), (11.2, 3.24)], ""),
        ([(11.36, 3.4), (12.1, 3.4)], ""),
    ):
        wire(axis, corners, label)
    for corners, label in (
        ([(4.6, 3.0), (4.6, 2.16)], "v, process"),
        ([(1.3, 3.4), (2.14, 3.4)], "v, input"),
        ([(10.2, 3.4), (11.04, 3.4)], "w, output"),
    ):
        wire(axis, corners, label, tint=COLOURS["IV"])
    for at, text in (((3.25, 3.4), "u"), ((12.15, 3.4), "y"), ((1.1, 1.6), "\u2212")):
        axis.text(*at, text, va="center")
    blank(axis)
    figure.suptitle('Fig. 3.6, and where noise may enter; "measured": u = $u_0$ + v of the process')
    page.draw("fig_3_6", figure)


def operator(record: gb.Record, estimator: object) -> gb.Transmissibility:
    """Return the noncausal FIR model."""
    return gb.identify(record, inputs=["u"], outputs=["y"], causal_order=R, noncausal_order=D, estimator=estimator)


def off(coefficients: FloatArray) -> float:
    """Return the norm in (3.100)."""
    return float(np.linalg.norm(coefficients - THETA))


def fir_error(records: Records, estimator: object) -> float:
    """Return delta of (3.100)."""
    return float(np.mean([off(operator(record, estimator).markov[:, 0, 0]) for record in records]))


def truncation(model: IirModel) -> FloatArray:
    """Return the coefficients (3.27); where a pole lies on the unit circle there are none: zeros."""
    try:
        return laurent(model.plant, causal_order=R, noncausal_order=D).coefficients[:, 0, 0]
    except InputError:
        return np.zeros_like(THETA)


def moments(delay: int, past: int) -> FloatArray:
    """Return E[u(k-i) c(k-delay-j)], i = -d..r, j = -d..r+past, of (3.55) without noise; exact, for white c."""
    i, j = np.arange(-D, R + 1), np.arange(-D, R + past + 1)
    heard = closed_loop(EXAMPLE.plant, EXAMPLE.gain).markov(R + D + past + delay + 1)[:, 0, 0]  # of c by u
    lag = delay + j - i[:, np.newaxis]
    return np.where(lag >= 0, heard[lag], 0.0)


def least_singular_values(count: int) -> FloatArray:
    """Return the least singular values of `moments` with the lags of (3.55), least first.

    Double precision hides them: they are 1e-18 to 1e-28 of a matrix that is triangular with ones. Its inverse is
    triangular, too, with the coefficients of the reciprocal series; its greatest are found by iterating on a subspace,
    in a hundred digits.
    """
    heard = moments(0, 0)[0]
    with mp.workdps(DIGITS):
        reciprocal = [mp.mpf(1)]
        for k in range(1, len(heard)):
            reciprocal.append(-sum(mp.mpf(heard[i]) * reciprocal[k - i] for i in range(1, k + 1)))
        inverse = mp.matrix(
            [[reciprocal[j - i] if j >= i else 0 for j in range(len(heard))] for i in range(len(heard))]
        )
        space = mp.matrix(np.random.default_rng(1).standard_normal((len(heard), count)).tolist())
        for _ in range(3):  # the next is 1e18 times as large: once would do
            space, _ = mp.qr(inverse.T * (inverse * space), mode="skinny")
        seen = inverse * space
        squares = mp.eigsy(seen.T * seen, eigvals_only=True)
        return np.array([float(1 / mp.sqrt(square)) for square in reversed(list(squares))])


def same_lags(page: Reproduction, records: Records) -> dict[str, float]:
    """Show what (3.55) is with instruments of the same lags as u, and with others; return their errors (3.100)."""
    delta, condition = {}, {}
    for name, delay, past in (("same", 0, 0), ("3 later", UNSTABLE_POLES, 0), ("20 more", 0, 20)):
        condition[name] = float(np.linalg.cond(moments(delay, past)))
        delta[name] = fir_error(records, gb.InstrumentalVariables(instruments=("c",), delay=delay, past=past))
    matrix, least = moments(0, 0), least_singular_values(UNSTABLE_POLES)
    triangular = not np.tril(matrix, -1).any() and bool(np.all(np.diag(matrix) == 1.0))
    rounded = np.linalg.svd(matrix, compute_uv=False)
    page.claim(
        "(3.55), A1) with its lags of c",
        "nonsingular",
        f"determinant 1, least singular values {' '.join(f'{value:.2g}' for value in least)}",
        agrees=triangular,
        holds=bool(least[-1] < 1e-15 and rounded[-1 - UNSTABLE_POLES] > 0.1),
        note="triangular with ones, for white c and without noise. As many singular values as poles are unstable are "
        f"so small that no record tells them from 0; the others are {rounded[-1 - UNSTABLE_POLES]:.2g} and more",
        values={"least singular values": least},
    )
    others = condition["3 later"], condition["20 more"]
    page.unprinted(
        "(3.55), A1) with lags of c 3 later, 20 more",
        f"condition {others[0]:.3g} and {others[1]:.3g}",
        holds=max(others) < 1e6 and delta["same"] > 5.0 * max(delta["3 later"], delta["20 more"]),
        note="(3.100) is " + ", ".join(f"{delta[name]:.4f} ({name})" for name in delta),
        runs=len(records),
        values={"condition": others, "delta": delta},
    )
    return delta


def figure_3_13(page: Reproduction, records: Records, by_lags: dict[str, float]) -> None:
    """Fig. 3.13: errors of IIR models of every order, and of one FIR model; of IV's they are known."""
    orders = [*range(1, 9), 20] if page.quick else [*range(1, 21)]
    fir = {"LS": fir_error(records, FIR["LS"]), "IV": by_lags["same"], "PEM": fir_error(records, FIR["PEM"])}
    more = by_lags["20 more"]
    iir, without = {}, {}
    for name, estimator in IIR.items():
        fits = [[truncation(estimator(record, order)) for record in records] for order in orders]
        iir[name] = [float(np.mean([off(fit) for fit in row])) for row in fits]
        without[name] = sum(not np.any(fit) for row in fits for fit in row)
    figure, ((axis,),) = panels(1, 1, (8.5, 4.8))
    for name, delta in fir.items():
        nearest = orders[int(np.argmin(iir[name]))]
        page.claim(
            f"Fig. 3.13, {name}",
            "FIR < IIR, n_mod 1 to 20",
            f"{delta:.5f} {'<' if delta < min(iir[name]) else '>='} {min(iir[name]):.5f} (n_mod {nearest})",
            agrees=delta < min(iir[name]),
            differs="(3.55) with its own lags is all but singular, see above" if name == "IV" else "",
            note=f"{len(records)} realisations; {NOISE}",
            runs=len(records),
            values={"FIR": delta, "orders": orders, "IIR": iir[name], "poles on the circle": without[name]},
        )
        size, dash = (8, "-") if name == "LS" else (4, "--")  # LS lies below PEM
        axis.semilogy(orders, iir[name], MARKERS[name] + "-", ms=size, color=COLOURS[name], label=f"IIR, {name}")
        axis.axhline(delta, ls=dash, color=COLOURS[name], label=f"FIR, r = d = {R}, {name}")
    page.unprinted(
        "Fig. 3.13, IV with 20 more lags",
        f"{more:.5f} < {min(iir['IV']):.5f}",
        holds=more < min(iir["IV"]),
        note="lags chosen after trying: they make the moments of (3.55) regular",
        runs=len(records),
        values={"FIR": more},
    )
    axis.axhline(more, ls=":", color=COLOURS["IV"], label=f"FIR, r = d = {R}, IV, 20 more lags")
    given_c = iir["IV from c"]
    better = [order for order, error in zip(orders, given_c, strict=True) if error < more]
    page.unprinted(
        "Fig. 3.13, iv4 with c for instrument",
        f"IIR < FIR (20 more lags) for n_mod {', '.join(map(str, better)) or 'none'}",
        note="iv4(data) doesn't know c, which the FIR models' IV has for instrument",
        runs=len(records),
        values={"FIR": more, "orders": orders, "IIR": given_c, "poles on the circle": without["IV from c"]},
    )
    axis.semilogy(orders, given_c, "x:", color=COLOURS["IV from c"], label="IIR, iv4 given c (not in the source)")
    axis.set(title="Fig. 3.13: errors of Laurent coefficients", xlabel="order $n_{mod}$ of IIR models")
    axis.set_ylabel(rf"$\delta_\ell$ of (3.100), $\|\theta\|$ = {np.linalg.norm(THETA):.3f} (y/u)")
    axis.set_xticks(range(1, 21))
    figure.legend(*axis.get_legend_handles_labels(), loc="outside right upper", fontsize="small")
    page.draw("fig_3_13", figure)


def consistency(
    page: Reproduction, place: Place, delta: dict[str, list[float]], fall: dict[str, float], runs: int
) -> None:
    """Hold who is biased against section 3.6: those that it is right about in one row, the others in another."""
    biased = {name: bool(fall[name] < 0.2 and errors[-1] > 1e-5) for name, errors in delta.items()}
    settled = all(biased[name] or errors[-1] < 1e-5 or 0.3 < fall[name] < 0.7 for name, errors in delta.items())
    alike = [name for name in FIR if (name in place.biased) == (name in place.printed)]
    for names, why in ((alike, ""), ([name for name in FIR if name not in alike], place.why)):
        if names:
            left = "(3.100) is " + ", ".join(f"{name} {delta[name][-1]:.2g}" for name in names)
            page.claim(
                f"3.6, noise {place.where}: {', '.join(names)}",
                verdicts({name: name in place.printed for name in names}),
                verdicts({name: biased[name] for name in names}),
                agrees=all(biased[name] == (name in place.printed) for name in names),
                differs=why,
                holds=settled and all(biased[name] == (name in place.biased) for name in names),
                note="; ".join(filter(None, (left, LAGS if "IV" in names else "", "" if why else place.note))),
                runs=runs,
                values={"samples": SAMPLES, "delta": delta, "exponent": fall},
            )


def verdicts(biased: dict[str, bool]) -> str:
    """Return who is biased and who is consistent."""
    said = {"biased": [name for name in biased if biased[name]], "consistent": [n for n in biased if not biased[n]]}
    return "; ".join(f"{', '.join(names)} {word}" for word, names in said.items() if names)


def noise_places(page: Reproduction) -> None:
    """Hold section 3.6 against errors that fall, or don't, with the length of the records."""
    runs = 3 if page.quick else 10
    figure, axes = panels(1, len(PLACES), (13.0, 4.2))
    for (noise, place), axis in zip(PLACES.items(), axes[0], strict=True):
        delta: dict[str, list[float]] = {name: [] for name in FIR}
        for samples in SAMPLES:
            records = loop_records(EXAMPLE.plant, EXAMPLE.gain, samples=samples, runs=runs, snr=SNR, noise=noise)
            for name, estimator in FIR.items():
                delta[name].append(fir_error(records, estimator))
        fall = {
            name: float(np.log(errors[0] / errors[-1]) / np.log(SAMPLES[-1] / SAMPLES[0]))
            for name, errors in delta.items()
        }
        consistency(page, place, delta, fall, runs)
        for name, errors in delta.items():
            style, size = ":" if name in place.biased else "-", 9 if name == "LS" else 5  # LS lies below PEM
            axis.loglog(SAMPLES, errors, MARKERS[name] + style, ms=size, color=COLOURS[name], label=name)
        start = delta["IV"][0]
        axis.loglog(
            SAMPLES, [start * (SAMPLES[0] / x) ** 0.5 for x in SAMPLES], "k--", lw=1.0, label=r"$1/\sqrt{\ell}$"
        )
        axis.set(title=f"noise {place.where}", xlabel=r"samples $\ell$")
        axis.set_xticks(SAMPLES, [f"{samples:,}" for samples in SAMPLES])
        axis.set_xticks([], minor=True)
    axes[0][0].set_ylabel(r"$\delta_\ell$ of (3.100) (y/u)")
    figure.suptitle(f"Errors of noncausal FIR models, {runs} realisations; dotted: biased")
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside right center")
    page.draw("noise_places", figure)


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
