"""Example 1.1 of the dissertation: why identification in the time domain.

Run ``python experiments/why_time_domain.py [--quick] [--out DIR]``. A stable system starts far from rest, and its
frequency response is estimated from noise-free data that begin N samples later, as in Figs. 1.1 and 1.2. Least squares
in the time domain is exact whenever the data begin. Cross-spectra aren't, however long one waits: every segment begins
in some state. Longer records don't help (1.3) either, for it sums over as many more frequencies.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.fft import rfft
from scipy.signal import stft

import gtmbench as gb
from dissertation.reproduction import Reproduction, reproduce
from gtmbench.method.problem import Constant
from gtmbench.report.figures.panels import panels
from gtmbench.values.record import FloatArray
from theory.iir import arx
from theory.state_space import StateSpace

SYSTEM = StateSpace([[-0.5, 0.2], [0.0, 0.7]], [[4.0], [1.0]], [[1.25, -3.0]], [[0.0]])  # (1.1)
STATES = StateSpace(SYSTEM.A, SYSTEM.B, np.eye(2), np.zeros((2, 1)))
START = [1000.0, 1000.0]
REPEATED = 500  # N of Fig. 1.1
SHORT, LONG = 10_000, 100_000  # L
FEW = 10  # experiments, beside those that Fig. 1.2 has
DEAD = 30  # samples: 0.7^30 of 1000 is 0.02, against outputs of 5
REACH = 50  # of the FIR model
SEGMENTS = 8  # of the cross-spectra, Hamming windows that overlap by half

Estimate = NDArray[np.complex128]
Method = Callable[[FloatArray, FloatArray], Estimate]


def points(samples: int) -> int:
    """Return M_L, the least power of two that isn't below L."""
    return 1 << (samples - 1).bit_length()


def ratio(u: FloatArray, y: FloatArray) -> Estimate:
    """Return the ratio of raw transforms, at frequencies 0..pi."""
    return np.asarray(rfft(y, points(len(y))) / rfft(u, points(len(u))))


def spectra(u: FloatArray, y: FloatArray) -> Estimate:
    """Return the cross-spectrum over the spectrum of u."""
    length = 2 * len(u) // (SEGMENTS + 1)
    how = {"window": "hamming", "nperseg": length, "noverlap": length // 2, "nfft": points(len(u))}
    U, Y = stft(np.stack([u, y]), **how, boundary=None, padded=False)[2]
    return np.asarray(np.sum(U.conj() * Y, axis=1) / np.sum(np.abs(U) ** 2, axis=1))


def as_record(u: FloatArray, y: FloatArray) -> gb.Record:
    """Return a record of u and y."""
    return gb.Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=1.0)


def iir(order: int) -> Method:
    """Return least squares with an ARX model, which takes a constant beside u and y: exact for any means."""

    def method(u: FloatArray, y: FloatArray) -> Estimate:
        model = arx(as_record(u, y), order=order)
        return np.asarray(rfft(model.numerator, points(len(u))) / rfft(model.denominator, points(len(u))))

    return method


def fir(constant: Constant) -> Method:
    """Return least squares with an FIR model, and a constant that is estimated, the records' means', or none."""

    def method(u: FloatArray, y: FloatArray) -> Estimate:
        names = {"inputs": ["u"], "outputs": ["y"]}
        operator = gb.identify(as_record(u, y), **names, causal_order=REACH, noncausal_order=0, constant=constant)
        return np.asarray(rfft(operator.markov[:, 0, 0], points(len(u))))

    return method


METHODS: Mapping[str, tuple[Method, int]] = {
    "raw ratio, L = 10,000": (ratio, SHORT),
    "raw ratio, L = 100,000": (ratio, LONG),
    "spectra, L = 10,000": (spectra, SHORT),
    "spectra, L = 100,000": (spectra, LONG),
    "ARX(1), L = 10,000": (iir(1), SHORT),
    "FIR(50) less means, L = 10,000": (fir("records"), SHORT),
    "FIR(50) and a constant, L = 10,000": (fir("estimated"), SHORT),
    "FIR(50), L = 10,000": (fir("none"), SHORT),
    "ARX(2), L = 10,000": (iir(2), SHORT),
}


def error(estimate: Estimate) -> float:
    """Return e of (1.3), over the whole circle: all frequencies but 0 and pi count twice."""
    z = np.exp(1j * np.linspace(0.0, np.pi, len(estimate)))
    squares = (np.abs(SYSTEM.at(z)[:, 0, 0]) - np.abs(estimate)) ** 2
    return float(np.sqrt(2.0 * np.sum(squares) - squares[0] - squares[-1]))


def repeated_input(page: Reproduction) -> None:
    """Fig. 1.1: the response to an input and to its repetition differ by the free response."""
    N = REPEATED
    u0 = np.random.default_rng(1).standard_normal((N, 1))
    u = np.concatenate([u0, u0])
    y, x = SYSTEM.simulate(u), STATES.simulate(u)
    difference = (y[:N] - y[N:])[:, 0]
    free = -SYSTEM.simulate(np.zeros((N, 1)), x[N])[:, 0]
    off = float(np.abs(difference - free).max() / np.abs(free).max())
    page.claim(
        "Fig. 1.1, y(k) - y(k+N)",
        "isn't 0, for x(N) isn't",
        f"-C A^k x(N) to {off:.0e}",
        agrees=off < 1e-13,
        values={"x(N)": x[N], "difference": difference[:51]},
    )
    drawn, ((axis,),) = panels(1, 1, (7.0, 4.0))
    axis.plot(difference[:51], "o", label="y(k) - y(k+N)")
    axis.plot(free[:51], "k-", lw=1.0, label="$-C A^k x(N)$")
    axis.set_xlabel("k (samples)")
    axis.set_ylabel("difference of outputs")
    axis.legend()
    drawn.suptitle(f"Fig. 1.1: an input and its repetition, N = {N}, x(0) = 0")
    page.draw("fig_1_1", drawn)


def experiments(starts: list[int], runs: int) -> FloatArray:
    """Return u and y of the experiments, shape (runs, 2, samples)."""
    u = np.stack([np.random.default_rng([1, run]).standard_normal(max(starts) + LONG) for run in range(runs)])
    return np.stack([u, SYSTEM.simulate(u[..., np.newaxis], START)[..., 0]], axis=1)


def errors(data: FloatArray, starts: list[int]) -> dict[str, FloatArray]:
    """Return e of (1.3) for every method and every N."""
    return {
        name: np.array([error(np.mean([method(*record) for record in data[:, :, N : N + L]], axis=0)) for N in starts])
        for name, (method, L) in METHODS.items()
    }


def errors_against_the_start(page: Reproduction) -> None:
    """Fig. 1.2: e of (1.3) against N."""
    starts, runs = ([1, 10, 100, 1000], 10) if page.quick else ([1, 3, 10, 30, 100, 300, 1000], 100)
    data = experiments(starts, runs)
    errors_of = errors(data, starts)
    few = error(np.mean([spectra(*record) for record in data[:FEW, :, starts[-1] : starts[-1] + SHORT]], axis=0))
    note = f"N = {', '.join(map(str, starts))}; {runs} experiments"
    arx2, fir50 = errors_of["ARX(2), L = 10,000"], errors_of["FIR(50), L = 10,000"]
    page.claim(
        "Fig. 1.2, ARX(2)",
        "not affected by N",
        f"at most {arx2.max():.1e}",
        agrees=bool(arx2.max() < 1e-10),
        note=note,
        runs=runs,
        values={"N": starts, "error": arx2},
    )
    cut = error(rfft(SYSTEM.markov(REACH + 1)[:, 0, 0], points(SHORT)))
    page.claim(
        "Fig. 1.2, FIR(50), no constant",
        "not affected by N",
        f"{fir50.min():.3g}..{fir50.max():.3g}; cut off: {cut:.3g}",
        agrees=bool(np.all(np.abs(fir50 / cut - 1.0) < 0.1)),
        note="cut off: the true response without what lies beyond 50 lags",
        runs=runs,
        values={"N": starts, "error": fir50, "cut off": cut},
    )
    spectra_least = min(float(errors_of[f"spectra, L = {L:,}"].min()) for L in (SHORT, LONG))
    page.claim(
        "Fig. 1.2, spectra over time domain",
        "time domain much better",
        f"{spectra_least / fir50.max():.1e} (FIR), {spectra_least / arx2.max():.1e} (ARX)",
        agrees=bool(fir50.max() < 1e-2 * spectra_least),
        note="least error of spectra, any N and L, over the greatest of the time domain",
        runs=runs,
    )
    less, with_one = (errors_of[f"FIR(50) {how}, L = 10,000"] for how in ("less means", "and a constant"))
    page.unprinted(
        "Fig. 1.2, FIR(50), a constant estimated, means removed",
        f"{with_one.min():.3g}..{with_one.max():.3g}; {less[0]:.2g} at N = 1, then {less[-1]:.2g}",
        note="the means of u and y don't belong to each other at the ends of a record",
        runs=runs,
        values={"estimated": with_one, "records' means": less},
    )
    wrong = errors_of["ARX(1), L = 10,000"]
    ours = f"{wrong.min():.0f}..{wrong.max():.0f}"
    page.unprinted("Fig. 1.2, ARX(1)", ours, note="too low an order", runs=runs, values=wrong)
    frequency_domain(page, starts, errors_of, few, runs)
    page.draw("fig_1_2", figure(starts, errors_of, runs))


def frequency_domain(
    page: Reproduction, starts: list[int], errors_of: dict[str, FloatArray], few: float, runs: int
) -> None:
    """Hold cross-spectra against what waiting and longer records would do if they helped.

    `few` is the error of the first few experiments alone.
    """
    short, long = errors_of["spectra, L = 10,000"], errors_of["spectra, L = 100,000"]
    late = np.array(starts) >= DEAD
    page.claim(
        "Fig. 1.2, spectra, waiting",
        "doesn't help",
        f"{short[late].min():.3g}..{short[late].max():.3g} from N = {np.array(starts)[late][0]} on",
        agrees=all(curve[late].max() < 2.0 * curve[late].min() for curve in (short, long)),
        note=f"{short[0]:.3g} at N = 1; 8 Hamming segments: ours. The level hangs on the number of experiments, which "
        f"are averaged before (1.3): {few:.3g} from the first {FEW}, {short[-1]:.3g} from {runs} (N = {starts[-1]})",
        runs=runs,
        values={"N": starts, f"L = {SHORT}": short, f"L = {LONG}": long, f"{FEW} experiments": few},
    )
    longer = float(np.median(long[late]) / np.median(short[late]))
    rms = [float(np.median(curve[late]) / np.sqrt(points(L))) for curve, L in ((short, SHORT), (long, LONG))]
    page.unprinted(
        "Fig. 1.2, spectra, ten times the length",
        f"{longer:.2f} times the error",
        holds=0.5 < longer < 2.0,  # an average over the points would fall to 0.32
        note="the text speaks of waiting only. (1.3) sums over M_L points; the RMS of a point falls from "
        f"{rms[0]:.1e} to {rms[1]:.1e}",
        runs=runs,
        values={"ratio": longer, "RMS of a point": rms},
    )
    raw = [errors_of[f"raw ratio, L = {L:,}"] for L in (SHORT, LONG)]
    page.unprinted(
        "Fig. 1.2, raw ratio of transforms",
        f"{np.median(raw[0][late]):.2g}, L = {LONG:,}: {np.median(raw[1][late]):.2g}",
        note="medians over N; a ratio's mean has heavy tails, so (1.3) jumps by chance",
        runs=runs,
        values={"N": starts, f"L = {SHORT}": raw[0], f"L = {LONG}": raw[1]},
    )


def figure(starts: list[int], errors_of: dict[str, FloatArray], runs: int) -> Figure:
    """Draw every error against N."""
    drawn, ((axis,),) = panels(1, 1, (9.0, 5.5))
    for i, (name, values) in enumerate(errors_of.items()):
        axis.loglog(starts, values, "o-" if METHODS[name][1] == SHORT else "s--", color=f"C{i}", label=name)
    axis.set_xlabel("N, where the data begin (samples)")
    axis.set_ylabel(r"$e_{N,L}$, (1.3)")
    drawn.legend(loc="outside right center", fontsize="small")
    drawn.suptitle(f"Fig. 1.2: error of the frequency response, {runs} experiments, x(0) = [1000 1000]")
    return drawn


def main(page: Reproduction) -> None:
    """Print every row and draw both figures."""
    repeated_input(page)
    errors_against_the_start(page)


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
