"""Chapter 6 of the dissertation: a Hammerstein system's outputs give its linear operator, up to a factor.

Run ``python experiments/hammerstein.py [--quick] [--out DIR]``. Five pairs of nonlinearities: the factor (6.29),
predicted and measured, and the error (6.34) of normalised Markov parameters against the length of the record, beside
what theory says of it: sqrt(2/pi) standard deviations. Short records lie above it: (6.34) divides by H_0-hat, which may
come close to 0 there.

The samples start when the outputs are stationary (assumption 1). Identification finds a constant of y_2 with the
operator, which (6.4) has not: right where N_2 has a mean (examples 4 and 5), and what the realisation's mean of N_1
(examples 2 and 5) does to y_2 goes with it.

Misprints: the exponent of (6.1) runs down, mu - i; (6.2) has H_0..H_mu, theta H_0..H_(mu-1), as here; (6.34) sums 201
terms over 200. G_2/G_1 is biproper, so H_d, which normalises, is H_0.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import lfilter
from scipy.stats import norm, uniform

import gtmbench as gb
from dissertation.figures import blank, block, wire
from dissertation.reproduction import Reproduction, listed, reproduce
from gtmbench.report.figures.panels import panels
from gtmbench.values.record import FloatArray
from theory.hammerstein import Pair, centred, covariance, without_nonlinearities
from theory.state_space import companion

B1, A1 = [0.0, 0.0, 4.0, 1.0], np.poly([0.6, -0.8, 0.9])  # (6.31), falling powers
B2, A2 = [0.0, 0.0, 2.0, 5.0], np.poly([0.55, -0.6, 0.4])  # (6.32)
G1, G2 = companion(B1, A1), companion(B2, A2)
MU = 30  # Markov parameters of the model, H_0..H_29; not printed
LINEAR = companion(np.polymul(A1, B2), np.polymul(A2, B1)).markov(MU)[:, 0, 0]  # H' of (6.33)
REALISATIONS = 200  # (6.34)
CONSTANT = "a constant is estimated, unlike in (6.4)"
SHOWN = [2, 3, 4, 5]  # of Figs. 6.5-6.9
UNTIL_STATIONARY = 400  # samples: 0.9^400 is 5e-19
DEVIATIONS = 4.5  # that chance is allowed
WIDE, NORMAL = uniform(-5.0, 10.0), norm()
EXAMPLES = {
    "sign(u), sin(u)": Pair(first=np.sign, second=np.sin, density=WIDE),
    "u² - M(u²), cos(u)": Pair(first=centred(np.square, NORMAL), second=np.cos, density=NORMAL),
    "sinh(u), u³": Pair(first=np.sinh, second=lambda u: u * u * u, density=NORMAL),
    "sign(u), exp(u)": Pair(first=np.sign, second=np.exp, density=WIDE),
    "u² exp(u) - M(u² exp(u)), sin(u) + 10": Pair(
        first=centred(lambda u: u * u * np.exp(u), WIDE), second=lambda u: np.sin(u) + 10.0, density=WIDE
    ),
}


def outputs(pair: Pair, samples: int, rng: np.random.Generator) -> gb.Record:
    """Return stationary y_1 and y_2 of Fig. 6.1."""
    u = pair.density.rvs(samples + UNTIL_STATIONARY, random_state=rng)
    values = np.column_stack([lfilter(B1, A1, pair.first(u)), lfilter(B2, A2, pair.second(u))])
    return gb.Record(values[UNTIL_STATIONARY:], channels=["y1", "y2"], sample_period_s=1.0)


def estimates(pair: Pair, lengths: list[int], runs: int, seed: int) -> FloatArray:
    """Return theta-hat of (6.4) from so many first samples of every realisation, shape (runs, lengths, MU)."""
    markov = np.empty((runs, len(lengths), MU))
    orders = {"causal_order": MU - 1, "noncausal_order": 0}
    for run in range(runs):
        record = outputs(pair, max(lengths), np.random.default_rng([seed, run]))
        for i, length in enumerate(lengths):
            operator = gb.identify(record.between(0, length - 1), inputs=["y1"], outputs=["y2"], **orders)
            markov[run, i] = operator.markov[:, 0, 0]
    return markov


def predicted(pair: Pair) -> tuple[float, FloatArray]:
    """Return, for one sample, the deviation of H_0-hat/H'_0 and (6.34) of every normalised Markov parameter.

    Divide by the root of the length. A normal variable's mean magnitude is sqrt(2/pi) of its deviation.
    """
    relative = covariance(pair, G1, G2, MU) / np.outer(LINEAR, LINEAR)
    ratio = np.diag(relative) - 2.0 * relative[0] + relative[0, 0]  # of H_i/H_0, to first order
    return float(np.sqrt(relative[0, 0])), np.sqrt(2.0 / np.pi * np.maximum(ratio, 0.0)) / abs(pair.scale)


def linear_operator(page: Reproduction) -> None:
    """State H' exactly, and what the model's length costs."""
    page.unprinted("(6.33), H'_0..H'_5", listed(LINEAR[:6]), values=LINEAR[:6])
    normal = LINEAR / LINEAR[0]
    page.unprinted("(6.33), normalised H'_2..H'_5", listed(normal[SHOWN]), values=normal[SHOWN])
    costs = {}
    for mu in (6, 10, 20, 30):
        limit = without_nonlinearities(G1, G2, mu)
        costs[mu] = float(np.max(np.abs(limit[SHOWN] / limit[0] / normal[SHOWN] - 1.0)))
    page.unprinted(
        "(6.3), bias of H_2..H_5 by mu",
        " ".join(f"{mu}: {cost:.0e}" for mu, cost in costs.items()),
        note=f"relative, of any length of record; mu is missing: {MU}",
        values=costs,
    )


def example_6_4_1(page: Reproduction) -> None:
    """Hold the factor of u^3 and u^7, uniform on -a..a, against the printed one."""
    widths = np.array([0.5, 1.0, 2.0, 5.0])
    scales = [Pair(first=lambda u: u**3, second=lambda u: u**7, density=uniform(-a, 2.0 * a)).scale for a in widths]
    ratio = np.array(scales) / (7.0 * widths**4 / 11.0)
    page.number("Ex. 6.4.1, factor over 7 a^4/11, four a", np.ones(4), ratio, tolerance=1e-12)
    factors = [pair.scale for pair in EXAMPLES.values()]
    page.unprinted("(6.29), factors of Ex. 6.5.1..6.5.5", listed(factors), values=factors)


def example(page: Reproduction, number: int, name: str, pair: Pair) -> None:
    """Hold the factor and the errors of one example against theory, and draw its figure."""
    runs = 50 if page.quick else REALISATIONS
    lengths = [round(10.0 ** (half / 2)) for half in range(4, 10 if page.quick else 12)]
    markov = estimates(pair, lengths, runs, number)
    single, error = predicted(pair)
    factor(page, number, pair, markov[:, -1, 0] / LINEAR[0], single / np.sqrt(lengths[-1]))
    normal = LINEAR / LINEAR[0]
    measured = np.mean(np.abs(markov / markov[:, :, :1] / normal - 1.0), axis=0)[:, SHOWN]  # (6.34)
    expected = error[SHOWN] / np.sqrt(lengths)[:, np.newaxis]
    far_from_0 = single / abs(pair.scale) / np.sqrt(lengths) < 0.2  # H_0-hat, which (6.34) divides by
    settled = far_from_0 & (np.array(lengths) > 20 * MU)  # theory's l isn't l - MU + 1, less the parameters
    ratio = (measured / expected)[settled]
    slopes = np.polyfit(np.log(lengths)[settled], np.log(measured[settled]), 1)[0]
    chance = DEVIATIONS * np.sqrt((np.pi / 2.0 - 1.0) / runs)  # of a mean of magnitudes of normal variables
    page.claim(
        f"Fig. 6.{number + 4}, (6.34) of H_2..H_5",
        "falls with the length",
        f"slope {slopes.min():.2f}..{slopes.max():.2f}, {ratio.min():.2f}..{ratio.max():.2f} of theory",
        agrees=bool(np.all(np.abs(ratio - 1.0) < chance)),
        note=f"slope -1/2 is theory; from {np.array(lengths)[settled][0]} samples on; (6.34) is the mean of {runs}; "
        f"{CONSTANT}; mu is missing: {MU}",
        runs=runs,
        values={"lengths": lengths, "measured": measured, "theory": expected, "slopes": slopes},
    )
    page.draw(f"fig_6_{number + 4}", figure(f"Fig. 6.{number + 4}: N₁, N₂ = {name}", lengths, measured, expected))


def factor(page: Reproduction, number: int, pair: Pair, ratios: FloatArray, deviation: float) -> None:
    """Hold H_0-hat/H'_0 of the longest records against (6.29)."""
    mean, spread = float(np.mean(ratios)), float(np.std(ratios))
    runs = len(ratios)
    agrees = abs(mean - pair.scale) < DEVIATIONS * deviation / np.sqrt(runs)
    agrees &= abs(spread / deviation - 1.0) < DEVIATIONS / np.sqrt(2.0 * runs)
    page.claim(
        f"Ex. 6.5.{number}, H_0-hat over H'_0",
        "tends to (6.29)",
        f"{mean:.4g} ± {spread / np.sqrt(runs):.1g} ({pair.scale:.7g})",
        agrees=bool(agrees),
        note=f"in brackets (6.29); one realisation is off by {spread:.2g}, theory has {deviation:.2g}; {CONSTANT}",
        runs=runs,
        values={"scale": pair.scale, "correlation": pair.correlation, "mean": mean, "deviation": spread},
    )


def figure(title: str, lengths: list[int], measured: FloatArray, expected: FloatArray) -> Figure:
    """Draw (6.34) against the length."""
    drawn, ((axis,),) = panels(1, 1, (7.0, 4.6))
    for i, (ours, theory) in enumerate(zip(measured.T, expected.T, strict=True)):
        axis.loglog(lengths, ours, "o", color=f"C{i}", label=f"$H_{SHOWN[i]}$")
        axis.loglog(lengths, theory, "-", color=f"C{i}", lw=1.0)
    axis.plot([], [], "k-", lw=1.0, label="theory, slope -1/2")
    axis.set_xlabel("length of the record (samples)")
    axis.set_ylabel("mean relative error of $H_i/H_0$, (6.34)")
    axis.legend()
    drawn.suptitle(title)
    return drawn


def draw_systems(page: Reproduction) -> None:
    """Figs. 6.1 to 6.4: the system and its operator, and the one without nonlinearities."""
    figure, axes = panels(1, 2, (11.0, 3.0))
    for axis, mark, title in zip(axes[0], ("", "'"), ("Figs. 6.1, 6.2", "Figs. 6.3, 6.4"), strict=True):
        for i, y in ((1, 2.0), (2, 0.0)):
            wire(axis, [(0.0, 1.0), (0.6, 1.0), (0.6, y), (3.3 if mark else 1.2, y)], "u")
            if not mark:
                block(axis, (1.8, y), f"$N_{i}$", width=1.2)
                wire(axis, [(2.4, y), (3.3, y)])
            block(axis, (3.9, y), f"$G_{i}$", width=1.2)
            wire(axis, [(4.5, y), (6.3, y)])
            axis.text(6.4, y, f"$y_{i}{mark}$", va="center")
        block(axis, (5.4, 1.0), f"$\\mathcal{{G}}{mark}$", width=0.9)
        wire(axis, [(5.4, 2.0), (5.4, 1.35)], style="--")
        wire(axis, [(5.4, 0.65), (5.4, 0.05)], style="--")
        axis.set_title(title)
        blank(axis)
    page.draw("fig_6_1", figure)


def main(page: Reproduction) -> None:
    """Print every row and draw every figure."""
    draw_systems(page)
    linear_operator(page)
    example_6_4_1(page)
    for number, (name, pair) in enumerate(EXAMPLES.items(), 1):
        example(page, number, name, pair)


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
