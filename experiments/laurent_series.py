"""Sections 3.3 to 3.5 and Example 3.1 of the dissertation: Laurent series of rational matrices.

Run ``python experiments/laurent_series.py [--quick] [--out DIR]``. A rational matrix has a Laurent series in every
annulus between its poles; its coefficients about the unit circle, and in no other annulus, are bounded (Theorem 2), and
noncausal FIR models identified in closed loop are these (Fig. 3.12). All of it takes seconds, --quick or not.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Final

import numpy as np
import scipy.signal
from matplotlib.figure import Figure
from matplotlib.patches import Wedge
from numpy.typing import ArrayLike

import gtmbench as gb
from dissertation.reproduction import Reproduction, listed, reproduce
from gtmbench.method.problem import Constant
from gtmbench.report.figures.panels import panels
from theory import plants
from theory.annuli import annuli, inner_spectral_radius, spectral_radius
from theory.closed_loop import loop_records
from theory.laurent import LaurentSeries, laurent, reflected, scaled, split
from theory.state_space import StateSpace
from theory.transfer_matrix import transfer_matrix

EXACT: Final = 1e-12  # where the source prints fractions
ORDERS: Final = {"causal_order": 25, "noncausal_order": 25}  # r and d of Fig. 3.12
FAR: Final = {"causal_order": 200, "noncausal_order": 200}  # what Theorem 2 is judged by
EXAMPLES: Final[dict[str, StateSpace]] = {
    "Ex. 3.4.1": transfer_matrix([[np.poly([1.0, 0.5])]], np.poly([2.0, 3.0])).proper,
    "Ex. 3.4.2": transfer_matrix([[[1.0]]], np.poly([0.5, 1.5])).proper,
    "(3.1)": plants.example_3_2_1(),
    "(3.5)": plants.example_3_2_2().plant,
    "(3.95)": plants.example_3_1().plant,
    "(3.98)": plants.example_3_2().plant,
}


def polynomials(system: StateSpace) -> tuple[np.ndarray, np.ndarray]:
    """Return numerators, shape (outputs, inputs, n + 1), and the monic denominator, falling powers of z."""
    columns = [scipy.signal.ss2tf(system.A, system.B, system.C, system.D, input=i) for i in range(system.inputs)]
    rows = [np.reshape(above, (system.outputs, -1)) for above, _ in columns]  # flat where there are no states
    return np.stack(rows, axis=1), np.atleast_1d(columns[0][1])


def part_row(page: Reproduction, result: str, part: StateSpace, numerator: ArrayLike, denominator: ArrayLike) -> None:
    """Hold a numerator and a denominator, falling powers of z, against printed ones with a factor taken out."""
    above, below = polynomials(part)
    ours = np.concatenate([above[0, 0], below]) * np.ravel(denominator)[0] + 0.0  # no -0
    printed = np.concatenate([np.ravel(numerator), np.ravel(denominator)])
    page.number(f"{result}: numerator, denominator", printed, ours, tolerance=EXACT)


def series_row(page: Reproduction, name: str, series: LaurentSeries) -> None:
    """State the coefficients in the middle; every one is in the row's values."""
    entry = "" if series.coefficients[0].size == 1 else " of G_1,1"
    middle = series.coefficients[series.noncausal_order - 1 : series.noncausal_order + 2, 0, 0]
    values = {"lags": series.lags, "L": series.coefficients}
    page.unprinted(f"{name}, L_-1 L_0 L_1{entry}", listed(middle), values=values)


def examples_3_4(page: Reproduction) -> None:
    """Hold the parts, the reflections and H_u,0 of Examples 3.4.1 and 3.4.2 against the printed ones."""
    for name, D, zero, *parts in (
        ("Ex. 3.4.1", 1.0, -11 / 12, ([0], [1]), ([0, 3.5, -5.5], [1, -5, 6]), ([-5.5, 3.5, 0], [6, -5, 1])),
        ("Ex. 3.4.2", 0.0, -2 / 3, ([0, -1], [1, -0.5]), ([0, 1], [1, -1.5]), ([1, 0], [-1.5, 1])),
    ):
        G = EXAMPLES[name]
        stable, unstable = split(G)
        back = reflected(unstable)
        page.number(f"{name}, D", D, G.D[0, 0], tolerance=EXACT)
        for part, system, printed in zip(("G_s", "G_u", "G_u,ref"), (stable, unstable, back), parts, strict=True):
            part_row(page, f"{name}, {part}", system, *printed)
        page.number(f"{name}, H_u,0", zero, back.D[0, 0], tolerance=EXACT)
        series_row(page, name, laurent(G, **ORDERS))


def proposition_3(page: Reproduction) -> None:
    """Hold the radii of every example against those of its reflection."""
    table = {}
    for name, G in EXAMPLES.items():
        radii = [[inner_spectral_radius(system), spectral_radius(system)] for system in (G, reflected(G))]
        table[name] = {"G": radii[0], "G_ref": radii[1], "products": np.multiply(radii[0], radii[1][::-1])}
    off = max(np.abs(row["products"] - 1.0).max() for row in table.values())
    ours = f"in {len(table)} systems, to {off:.1g}"
    page.claim("Prop. 3, (3.14)", "radii of G_ref: reciprocals", ours, agrees=off < 1e-10, values=table)


def proposition_4(page: Reproduction) -> None:
    """Hold Definition 5, by the poles of G, against the stability of G_ref, by those of its realisation."""
    systems = {**EXAMPLES, **{f"{name}, G_u": split(G)[1] for name, G in EXAMPLES.items() if any(abs(G.poles) > 1.0)}}
    table = {
        name: [bool(np.all(np.abs(G.poles) > 1.0)), bool(np.all(np.abs(reflected(G).poles) < 1.0))]
        for name, G in systems.items()
    }
    strongly = sum(first for first, _ in table.values())
    page.claim(
        "Prop. 4, strongly unstable",
        "iff G_ref is stable",
        f"in {len(table)} systems, {strongly} of them strongly unstable",
        agrees=all(first == second for first, second in table.values()) and 0 < strongly < len(table),
        values=table,
    )


def lemma_1(page: Reproduction) -> None:
    """Hold both parts on scaled examples, whose outermost and innermost poles lie on either side of the unit circle."""
    table = {}
    for name, G in EXAMPLES.items():
        for radius in (0.8, 1.25):
            inner, outer = (scaled(G, rho(G) / radius) for rho in (inner_spectral_radius, spectral_radius))
            for part, system in (("i)", reflected(inner)), ("ii)", outer)):  # (3.15) are the Markov parameters of G_ref
                size = np.linalg.norm(system.markov(FAR["causal_order"] + 1), axis=(1, 2))
                bounded = bool(size[len(size) // 2 :].max() <= size[: len(size) // 2].max())
                table[f"{part} {name}, radius {radius}"] = [bounded, radius >= 1.0 if part == "i)" else radius <= 1.0]
    bounded = sum(first for first, _ in table.values())
    page.claim(
        "Lemma 1, coefficients (3.15), (3.12)",
        "bounded: rho_inner >= 1, rho <= 1",
        f"in {bounded} bounded of {len(table)} series",
        agrees=0 < bounded < len(table) and all(holds for bounded, holds in table.values() if bounded),
        note=f"examples scaled to radii 0.8 and 1.25, judged by the lags 0..{FAR['causal_order']}",
        values=table,
    )


def judged(series: LaurentSeries) -> list[bool]:
    """Return whether coefficients look square summable, convergent to 0, bounded: their far half against the near."""
    size = np.linalg.norm(series.coefficients, axis=(1, 2))
    far = np.abs(series.lags) > FAR["causal_order"] / 2
    summable = np.sum(size[far] ** 2) < 1e-6 * np.sum(size**2)
    convergent = size[far].max() < 1e-6 * size.max()
    return [bool(summable), bool(convergent), bool(size[far].max() <= size[~far].max())]


def theorem_2(page: Reproduction) -> None:
    """Judge the coefficients in all maximal annuli, and show that the theorem's assumption is needed."""
    table = []
    for name, G in EXAMPLES.items():
        for annulus in annuli(G):
            series = laurent(G, radius=annulus.radius, **FAR)
            verdicts = [*judged(series), 1.0 in annulus]
            table.append({"system": name, "rho_1": annulus.inner, "rho_2": annulus.outer, "i to iv": verdicts})
    bounded = [row["system"] for row in table if all(row["i to iv"])]
    page.claim(
        "Theorem 2",
        "i) to iv) are equivalent",
        f"in all {len(table)} annuli; {len(bounded)} bounded",
        agrees=bounded == list(EXAMPLES) and all(len(set(row["i to iv"])) == 1 for row in table),
        note="one bounded series a system, judged by the lags -200..200",
        values=table,
    )
    integrator = laurent(transfer_matrix([[[1.0]]], [1.0, -1.0]), radius=2.0, **FAR)
    verdicts = [*judged(integrator), 1.0 in integrator.annulus]
    ours = ", ".join("holds" if holds else "fails" for holds in verdicts)
    note = "bounded all the same: it needs the assumption, stated after it, that no pole lies on the unit circle"
    result = "Theorem 2, i) to iv) for 1 / (z - 1) in P(1)"
    page.unprinted(result, ours, holds=verdicts == [False, False, True, False], note=note, values=verdicts)


def scaling(page: Reproduction) -> None:
    """Refuse a pole on the circle and offer the scaling; check it in all annuli of all examples."""
    G = transfer_matrix([[[1.0]]], np.poly([0.5, 1.0, 2.0]))
    told = ""
    try:
        laurent(G, **ORDERS)
    except gb.InputError as error:
        told = str(error)
    inside = laurent(G, radius=0.7, **ORDERS).annulus
    page.claim(
        "(3.30), a pole at 1",
        "scale: rho_s < alpha < 1",
        f"refused; offered and found: A({inside.inner:.4g}, {inside.outer:.4g})",
        agrees="radius=0.71 (0.5 < |z| < 1)" in told and np.allclose([inside.inner, inside.outer], [0.5, 1.0]),
        values=told,
    )
    errors = np.array([scaled_errors(G, annulus.radius) for G in EXAMPLES.values() for annulus in annuli(G)])
    note = "relative to the largest; close poles of companion matrices cost digits"
    results = ("(3.31), L_alpha,i = alpha^-i L_i", "(3.13), (3.17), (3.22), sum of the series")
    for result, off in zip(results, errors.T, strict=True):
        ours = f"in {len(off)}, to {off.max():.1g}"
        page.claim(result, "in every annulus", ours, agrees=bool(np.all(off < 1e-9)), note=note, values=off)


def scaled_errors(system: StateSpace, alpha: float) -> tuple[float, float]:
    """Return by how much (3.31), and the sum of the series of G(alpha z) on the unit circle, are off."""
    far = laurent(scaled(system, alpha), causal_order=2000, noncausal_order=2000)
    near = laurent(system, causal_order=60, noncausal_order=60, radius=alpha)
    rescaled = near.coefficients * alpha ** -near.lags[:, np.newaxis, np.newaxis].astype(float)
    z = np.exp(1j * np.linspace(0.0, 6.0, 25))
    values = system.at(alpha * z)
    return (
        float(np.abs(rescaled - far.coefficients[1940:2061]).max() / np.abs(far.coefficients).max()),
        float(np.abs(far.at(z) - values).max() / np.abs(values).max()),
    )


def example_3_1(page: Reproduction) -> None:
    """Hold Example 3.1 against the print, identify it in closed loop, and draw Fig. 3.12."""
    example = plants.example_3_1()
    above, below = polynomials(example.plant)
    printed = [[[0.0, -1.0, 6.3], [0.0, 5.0, -11.9]], [[0.0, 4.0, -14.0], [0.0, -12.0, 26.0]]]
    page.number("(3.95) from (3.96), numerators", printed, above, tolerance=EXACT)
    page.number("(3.95) from (3.96), denominator", [1.0, -2.0, 0.35], below, tolerance=EXACT)
    page.number("(3.97), K", [[2.5446, 0.4259], [1.3095, 0.2707]], example.gain, tolerance=5e-5)
    true = laurent(example.plant, **ORDERS)
    page.number("Ex. 3.1, rho_s", 0.1938, true.annulus.inner, tolerance=5e-5)
    page.number("Ex. 3.1, rho_u", 1.8062, true.annulus.outer, tolerance=5e-5)
    series_row(page, "Ex. 3.1", true)
    fits = {samples: identified(example, true, samples) for samples in (1_000, 10_000, 100_000)}
    operator, error, bound = fits[10_000]
    largest = np.abs(true.coefficients).max()
    page.claim(
        "Fig. 3.12, identified coefficients",
        "on the true ones",
        f"off by at most {error:.2g} of {largest:.4g}",
        agrees=error <= bound < 0.01 * largest,
        note=f"10,000 samples assumed; least squares can be off by ||e|| / sigma_min(Phi) = {bound:.2g}",
        values={"L": operator.markov, "largest error": error, "bound": bound},
    )
    sides = [np.abs(operator.markov[side]).max() for side in (true.lags > 0, true.lags < 0)]
    ours = f"largest: {sides[0]:.4g} and {sides[1]:.4g}"
    agrees = min(sides) > 10.0 * bound
    page.claim("Fig. 3.12, components", "causal and noncausal", ours, agrees=agrees, values=sides)
    far = laurent(example.plant, **FAR)
    cut = np.abs(far.coefficients[np.abs(far.lags) > ORDERS["causal_order"]]).sum(axis=0).max()
    ways: dict[str, Constant] = {"estimated": "estimated", "the records' means": "records"}
    others = {way: identified(example, true, 10_000, constant)[1] for way, constant in ways.items()}
    page.unprinted(
        "Fig. 3.12, error over samples",
        ", ".join(f"{samples:,}: {error:.2g}" for samples, (_, error, _) in fits.items()),
        note=f"lags left out add up to {cut:.2g}; no constant, as printed. Of 10,000 samples with a constant "
        + ", ".join(f"{error:.2g} ({way})" for way, error in others.items()),
        values={"left out": cut, **{str(samples): fit[1:] for samples, fit in fits.items()}, **others},
    )
    page.draw("fig_3_12", markov_figure(true, operator))


def identified(
    example: plants.Example, true: LaurentSeries, samples: int, constant: Constant = "none"
) -> tuple[gb.Transmissibility, float, float]:
    """Identify by least squares, noise-free; return the operator, its largest error, and the bound ||e|| / sigma_min.

    e is what the true coefficients, cut off, leave of the outputs; sigma_min is the regressor's least singular value.
    """
    (record,) = loop_records(example.plant, example.gain, samples=samples, seed=1)
    operator = gb.identify(record, inputs=["u0", "u1"], outputs=["y0", "y1"], constant=constant, **ORDERS)
    left = record.matrix(["y0", "y1"]) - replace(operator, markov=true.coefficients).predict(record)
    least = np.linalg.svd(operator.root[0], compute_uv=False)[-1] * operator.input_rms.min()
    error = np.abs(operator.markov - true.coefficients).max()
    return operator, float(error), float(np.sqrt(np.nansum(left**2)) / least)


def markov_figure(true: LaurentSeries, operator: gb.Transmissibility) -> Figure:
    """Draw Fig. 3.12: dots true, circles identified."""
    figure, axes = panels(2, 2, (9.0, 6.5))
    for o, i in np.ndindex(2, 2):
        axis = axes[o][i]
        axis.plot(true.lags, true.coefficients[:, o, i], ".", color="#1f77b4", ms=5, label="true")
        axis.plot(operator.lags, operator.markov[:, o, i], "o", mfc="none", color="#d62728", ms=8, label="identified")
        axis.set(xlabel="lag i (samples); negative: noncausal", ylabel="$L_i$", title=f"$G_{{{o + 1},{i + 1}}}$")
    axes[0][0].legend()
    figure.suptitle("Example 3.1 in closed loop: true and identified Laurent coefficients, r = d = 25 (Fig. 3.12)")
    return figure


def annuli_figure(name: str, system: StateSpace) -> Figure:
    """Draw the annuli between the poles, and the coefficients of the series in each."""
    every, edge = annuli(system), 2.25
    figure, axes = panels(1, 1 + len(every), (13.0, 3.8))
    plane = axes[0][0]
    for annulus, axis, shade in zip(every, axes[0][1:], ("#c6dbef", "#fdd0a2", "#c7e9c0"), strict=True):
        outer = min(annulus.outer, 2.0 * edge)
        plane.add_patch(Wedge((0.0, 0.0), outer, 0.0, 360.0, width=outer - annulus.inner, color=shade))
        series = laurent(system, causal_order=8, noncausal_order=8, radius=annulus.radius)
        axis.stem(series.lags, series.coefficients[:, 0, 0], linefmt="k-", markerfmt="k.", basefmt="k-")
        kind = "bounded" if 1.0 in annulus else "unbounded"
        axis.set(xlabel="lag i", ylabel="$L_i$", facecolor=shade)
        axis.set_title(f"{annulus.inner:g} < |z| < {annulus.outer:g}: {kind}".replace("inf", "∞"), fontsize="medium")
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    plane.plot(np.cos(angle), np.sin(angle), "k--", lw=1.0, label="unit circle")
    plane.plot(system.poles.real, system.poles.imag, "kx", ms=9, mew=2, label="poles")
    plane.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal", xlabel="Re z", ylabel="Im z")
    plane.legend(loc="lower left", fontsize="small")
    figure.suptitle(f"{name}: three annuli, three Laurent series (Definition 2, Theorem 2)")
    return figure


def main(page: Reproduction) -> None:
    """Print every row and draw every figure, in the order of the text."""
    proposition_3(page)
    proposition_4(page)
    examples_3_4(page)
    lemma_1(page)
    theorem_2(page)
    page.draw("annuli", annuli_figure("Example 3.4.2", EXAMPLES["Ex. 3.4.2"]))
    scaling(page)
    example_3_1(page)


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
