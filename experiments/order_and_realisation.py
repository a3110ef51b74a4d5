"""Sections 3.2 and 3.8 of the dissertation: a plant's order, and the plant itself, from estimated Markov parameters.

Block-Hankel matrices of least nuclear norm near the estimate show the order: of (3.1) from a causal FIR model in
Fig. 3.4, of both parts of (3.98) from a noncausal one, identified in its loop, in Figs. 3.14 and 3.15. ERA realises
both, which put together are the plant again. Singular values count that survive every gamma from the size of the
estimate's own error, which its scatter over the experiments tells, to four times that.

Run ``python experiments/order_and_realisation.py [--quick] [--out DIR]``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.signal

import gtmbench as gb
from dissertation.reproduction import Reproduction, listed, reproduce
from gtmbench.report.figures.panels import panels
from gtmbench.values.record import FloatArray
from theory.closed_loop import loop_records
from theory.laurent import laurent, reflected, split
from theory.nuclear_norm import nuclear_norm_path
from theory.pem import pem
from theory.plants import example_3_2, example_3_2_1, example_3_2_2
from theory.realisation import hankel_singular_values, realise
from theory.state_space import StateSpace, companion

RUNS, SNR = 100, 10.0
SAMPLES_3_2, SAMPLES_3_3 = 10_000, 5000  # of an experiment, in examples 3.2.1 and 3.2.2, and in 3.3
LAGS, REACH = 25, 19  # of example 3.3: r = d, and those of them that 10 blocks take
# (3.101) has L_1..L_19; (3.103) L_0..L_-18, turned about. What comes first stands for H_0, which isn't in either
SIDES = {"stable": range(REACH + 1), "unstable": range(1, -REACH, -1)}
LONG = range(40)  # 20 blocks, section 3.2
CIRCLE = np.exp(1j * np.linspace(0.0, np.pi, 401))
LS, IV = gb.LeastSquares(), gb.InstrumentalVariables(instruments=("c",), past=20)
PRINTED = {
    "(3.111), G_s(z)": ([0.07241, 0.02234, 0.01606, -0.00113], [1.0, 1.3020, 0.7590, 0.3697, 0.08392]),
    "(3.112), G_u(1/z)": ([0.0096, -0.0898, 0.0147, -0.00002], [1.0, -1.7680, 1.0400, -0.2028]),
    "(3.113), G_u(z)": ([0.00002, -0.0147, 0.0898, -0.0096], [0.2028, -1.0400, 1.7680, -1.0]),
    "(3.114), G(z)": (
        [0.0001, -0.0001, -0.0006, 1.0070, 0.0018, 0.1573, -0.0694, 0.0016],
        [1.0, -3.8249, 2.8011, 2.8991, -1.6149, -0.9494, -1.0912, -0.4138],
    ),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Average:
    """Parameters averaged over experiments, lags -d..r; the standard errors of the averages; d."""

    mean: FloatArray
    error: FloatArray
    d: int = 0

    def at(self, lags: range) -> FloatArray:
        """Return the parameters of some lags."""
        return self.mean[np.array(lags) + self.d]

    def size(self, lags: range) -> float:
        """Return the size of their error, without the first one's, which isn't in the Hankel matrix."""
        return float(np.linalg.norm(self.error[np.array(lags[1:]) + self.d]))


def averaged(estimates: Sequence[FloatArray], d: int = 0) -> Average:
    """Return the average of the experiments' parameters."""
    return Average(
        mean=np.mean(estimates, axis=0), error=np.std(estimates, axis=0, ddof=1) / np.sqrt(len(estimates)), d=d
    )


def fir(records: Sequence[gb.Record], estimator: object, r: int, d: int) -> Average:
    """Return the FIR model of lags -d..r, u to y."""
    names, orders = {"inputs": ["u"], "outputs": ["y"]}, {"causal_order": r, "noncausal_order": d}
    operators = [gb.identify(record, **names, **orders, estimator=estimator) for record in records]
    return averaged([operator.markov[:, 0, 0] for operator in operators], d)


def iir(records: Sequence[gb.Record], order: int, of: Callable[[StateSpace], FloatArray]) -> Average:
    """Return the average of something that PEM's IIR models of this order have."""
    return averaged([of(pem(record, order=order).plant) for record in records])


def markov(plant: StateSpace) -> FloatArray:
    """Return H_0, H_1, ... for section 3.2."""
    return plant.markov(len(LONG))[:, 0, 0]


def survivors(
    page: Reproduction, number: str, title: str, model: Average, lags: range, exact: FloatArray
) -> tuple[int, object]:
    """Draw the singular values over gamma; return how many survive, and the figures behind that."""
    size = model.size(lags)
    steps = np.array([-1.0, 0.0, 0.5, 1.0, 2.0]) if page.quick else np.arange(-3.0, 3.1, 0.25)
    path = nuclear_norm_path(model.at(lags), size * 4.0**steps)
    order, true = path.order(size), hankel_singular_values(exact)
    figure, [[axis]] = panels(1, 1, (9.5, 4.8))
    for i, values in enumerate(path.singular_values.T):
        style = {"c": "C0", "lw": 1.5} if i < order else {"c": "0.6", "lw": 0.7}
        label = {0: f"{order} survive", order: "the others"}.get(i)
        axis.loglog(path.gammas, values, ".-", ms=4, label=label, **style)
    shown = true[true > 1e-12 * true[0]]
    axis.plot(np.full(len(shown), path.gammas[0]), shown, "_", color="C3", ms=14, mew=2, label="of the exact plant")
    axis.axvspan(size, 4.0 * size, color="C2", alpha=0.15, label="1 to 4 of the estimate's own errors")
    axis.axhline(path.floor, color="k", ls=":", lw=1.0, label="below: what the solver leaves")
    axis.set_ylim(path.floor / 30.0, 3.0 * max(path.singular_values.max(), true[0]))
    axis.set_xlabel(r"$\gamma$ (unit of the Markov parameters)")
    axis.set_ylabel(r"singular values of $\mathcal{H}(\bar H(\gamma))$")
    figure.legend(loc="outside right upper", fontsize="small")
    figure.suptitle(f"{title} (Fig. {number})")
    page.draw(f"fig_{number.replace('.', '_')}", figure)
    values = {f"gamma = {4.0**step:.4g} errors": row for step, row in zip(steps, path.singular_values, strict=True)}
    return order, {"order": order, "error": size, **values, "plain": hankel_singular_values(model.at(lags))}


def section_3_2(page: Reproduction) -> None:
    """Figs. 3.3, 3.4 and 3.8: IIR models of order 20, and the FIR model of order 50."""
    runs = 2 if page.quick else RUNS
    plant, loop = example_3_2_1(), example_3_2_2()
    exact, settings = markov(plant), {"samples": SAMPLES_3_2, "snr": SNR}
    records = loop_records(plant, np.zeros((1, plant.order)), runs=RUNS, noise="output", **settings)  # no feedback
    model = iir(records[:runs], 20, markov)
    rule = "survivors are counted from 1 to 4 of the estimate's own errors: our rule"
    order, values = survivors(page, "3.3", "IIR model of order 20 of (3.1), by PEM", model, LONG, exact)
    page.claim(
        "Fig. 3.3, IIR of order 20: surviving",
        "5",
        f"{order}",
        agrees=order == 5,
        differs="which count comes out hangs on PEM's search, which isn't Matlab's",
        note=f"the order is 7; {runs} experiments; {rule}",
        runs=runs,
        values=values,
    )
    order, values = survivors(page, "3.4", "FIR model of order 50 of (3.1)", fir(records, LS, 50, 0), LONG, exact)
    note = f"{RUNS} experiments; {rule}"
    page.claim("Fig. 3.4, FIR of order 50: surviving", "7", f"{order}", agrees=order == 7, note=note, values=values)
    true = hankel_singular_values(exact)
    page.unprinted("Fig. 3.4, exact singular values", listed(true[:7]), values=true)

    exact = markov(loop.plant)
    model = iir(loop_records(loop.plant, loop.gain, runs=runs, **settings), 20, markov)
    order, values = survivors(page, "3.8", "IIR model of order 20 of (3.5), by PEM", model, LONG, exact)
    page.claim(
        "Fig. 3.8, IIR of order 20: surviving",
        "5",
        f"{order}",
        agrees=order == 5,
        differs="which wrong count comes out hangs on PEM's search",
        holds=order != 7,
        note=f"the order is 7; {runs} experiments; v is in u two steps before it is in y, so PEM is biased whatever "
        "the order, to poles of magnitude 1.2 for 1.6 to 1.8",
        runs=runs,
        values=values,
    )
    true = hankel_singular_values(exact)
    note = "not even exact parameters, which grow by 1.8 a step, show 7"
    true /= true[0]
    page.unprinted("Fig. 3.8, exact singular values / largest", listed(true[:7]), note=note, values=true)


def example_3_3(page: Reproduction) -> None:
    """Orders by Figs. 3.14 and 3.15, systems by ERA, (3.111) to (3.114), and Fig. 3.16."""
    example = example_3_2()
    plant, settings = example.plant, {"samples": SAMPLES_3_3, "runs": RUNS, "snr": SNR}
    series = laurent(plant, causal_order=LAGS, noncausal_order=LAGS).coefficients[:, 0, 0]
    records = loop_records(plant, example.gain, **settings)
    model = fir(records, IV, LAGS, LAGS)
    orders = []
    note = (
        "by instruments, not PEM: under process noise LS and PEM are biased, see below; gammas about the estimate's "
        "own error, for the printed 1e-10..1e-8 leave it untouched"
    )
    for (part, lags), number, printed in zip(SIDES.items(), ("3.14", "3.15"), (4, 3), strict=True):
        title, exact = f"{part.capitalize()} part of (3.98)", series[np.array(lags) + LAGS]
        order, values = survivors(page, number, title, model, lags, exact)
        result = f"Fig. {number}, order of the {part} part"
        page.claim(result, f"{printed}", f"{order}", agrees=order == printed, note=note, values=values)
        orders.append(order)
    for result, lags in zip(("(3.101)", "(3.103), turned about"), SIDES.values(), strict=True):
        true = hankel_singular_values(series[np.array(lags) + LAGS])
        page.unprinted(f"{result}, exact singular values", listed(true[true > 1e-12 * true[0]]), values=true)
    realised = rebuilt(model, *orders)
    transfer_functions(page, plant, realised)
    figure_3_16(page, plant, model, realised, records[: 5 if page.quick else RUNS])
    some = records[: 20 if page.quick else RUNS]
    pem_fir = fir(some, gb.PredictionError(noise_order=10), LAGS, LAGS)
    reading(page, "v unmeasured, LS", fir(records, LS, LAGS, LAGS), plant)
    reading(page, "v unmeasured, PEM", pem_fir, plant, runs=len(some))
    reading(page, "v unmeasured, IV", model, plant)
    on_output = loop_records(plant, example.gain, noise="output", **settings)
    reading(page, "v on y, LS", fir(on_output, LS, LAGS, LAGS), plant)


def rebuilt(model: Average, stable: int, unstable: int) -> StateSpace:
    """Return the plant by ERA from lags -19..19."""
    chosen = model.at(range(-REACH, REACH + 1))
    return realise(chosen, noncausal_order=REACH, stable_order=stable, unstable_order=unstable)


def transfer_functions(page: Reproduction, plant: StateSpace, realised: StateSpace) -> None:
    """Hold ERA's coefficients, and the printed ones, against the exact ones."""
    exact, ours = fractions(plant), fractions(realised)
    for result, printed in PRINTED.items():
        page.unprinted(f"{result}, exact", written(exact[result]), values=exact[result])
        theirs, mine = (distance(companion(*parts), companion(*exact[result])) for parts in (printed, ours[result]))
        cells = f"{result}, by ERA", written(printed), written(ours[result])
        page.claim(
            *cells,
            agrees=all(np.allclose(*pair, rtol=0.0, atol=5e-5) for pair in zip(printed, ours[result], strict=True)),
            differs="another estimator, other realisations of the noise",
            holds=mine <= theirs,
            note=f"off from the exact one by {mine:.2g} in L2, the printed by {theirs:.2g}",
            values={"coefficients": ours[result], "distance": mine, "of the printed": theirs},
        )


def fractions(plant: StateSpace) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return numerators and denominators as (3.111) to (3.114) have them; G_u with what D there is."""
    stable, unstable = split(plant)
    strict, turned = (
        fraction(system) for system in (stable, reflected(StateSpace(unstable.A, unstable.B, unstable.C, plant.D)))
    )
    back = (-turned[0][::-1] + 0.0, -turned[1][::-1])
    return dict(zip(PRINTED, ((strict[0][1:], strict[1]), turned, back, fraction(plant)), strict=True))


def fraction(system: StateSpace) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator by falling powers of z; rounding is no coefficient."""
    [numerator], denominator = scipy.signal.ss2tf(system.A, system.B, system.C, system.D)
    return np.where(np.abs(numerator) > 1e-12 * np.abs(numerator).max(), numerator, 0.0), denominator


def distance(first: StateSpace, second: StateSpace) -> float:
    """Return the L2 norm of a difference on the unit circle, by Laurent coefficients, which fall by 0.75 a lag."""
    both = [laurent(system, causal_order=100, noncausal_order=100).coefficients for system in (first, second)]
    return float(np.linalg.norm(both[0] - both[1]))


def written(given: tuple[Sequence[float] | FloatArray, Sequence[float] | FloatArray]) -> str:
    """Return numerator / denominator."""
    return " / ".join(listed(part) for part in given)


def response(given: Average | StateSpace) -> FloatArray:
    """Return the frequency response at CIRCLE."""
    if isinstance(given, StateSpace):
        return given.at(CIRCLE)[:, 0, 0]
    return CIRCLE[:, np.newaxis] ** -np.arange(-given.d, len(given.mean) - given.d) @ given.mean


def figure_3_16(
    page: Reproduction, plant: StateSpace, model: Average, realised: StateSpace, records: Sequence[gb.Record]
) -> None:
    """Draw how far the frequency responses are off."""
    responses = {
        "IIR, n = 5": iir(records, 5, response).mean,
        "ERA, (3.111) + (3.113)": sum(response(companion(*PRINTED[name])) for name in list(PRINTED)[:3:2]),
        "FIR, r = d = 25": response(model),
        "ERA, ours": response(realised),
    }
    off = {name: response(plant) - values for name, values in responses.items()}
    figure, axes = panels(2, 1, (7.5, 6.5))
    for (name, values), colour in zip(off.items(), ("C3", "C8", "C0", "C2"), strict=True):
        axes[0][0].semilogy(np.angle(CIRCLE), np.abs(values), color=colour, label=name)
        axes[1][0].plot(np.angle(CIRCLE), np.angle(values), ".", ms=2, color=colour)
    axes[0][0].set_ylabel(r"$|G(e^{j\theta}) - \hat G(e^{j\theta})|$ (1)")
    axes[0][0].legend(fontsize="small")
    axes[1][0].set(xlabel=r"$\theta$ (rad a sample)", ylabel="phase (rad)")
    figure.suptitle("Error of the frequency response of (3.98) (Fig. 3.16)")
    page.draw("fig_3_16", figure)
    iir_off, printed, fir_off, era_off = (float(np.abs(errors).mean()) for errors in off.values())
    page.claim(
        "Fig. 3.16, mean magnitude of the error",
        "FIR < ERA, IIR",
        f"FIR {fir_off:.2g}; ERA {era_off:.2g}; IIR {iir_off:.2g}",
        agrees=fir_off < min(era_off, iir_off),
        differs="ERA from all of L_-19..L_19 is better still, noise averages out of it",
        holds=era_off < fir_off < min(printed, iir_off),
        note=f"the printed ERA, (3.111) + (3.113), is off by {printed:.2g}; IIR: {len(records)} experiments",
        runs=len(records),
        values={"FIR": fir_off, "ERA": era_off, "IIR": iir_off, "printed ERA": printed},
    )


def reading(page: Reproduction, name: str, model: Average, plant: StateSpace, runs: int | None = None) -> None:
    """State what one estimator makes of one kind of noise: example 3.3 says PEM, and not where v enters."""
    orders = []
    for lags in SIDES.values():
        size = model.size(lags)
        orders.append(nuclear_norm_path(model.at(lags), size * np.array([1.0, 2.0, 4.0])).order(size))
    systems = {"FIR": model, "ERA": rebuilt(model, *orders)}
    off = {key: float(np.mean(np.abs(response(system) - response(plant)))) for key, system in systems.items()}
    ours = f"{orders[0]} and {orders[1]}; FIR {off['FIR']:.2g}, ERA {off['ERA']:.2g}"
    values = {"orders": orders, **off}
    page.unprinted(f"Ex. 3.3, {name}: orders, error", ours, holds=orders == [4, 3], runs=runs, values=values)


def main(page: Reproduction) -> None:
    """Print every row."""
    section_3_2(page)
    example_3_3(page)


if __name__ == "__main__":
    sys.exit(reproduce(main, __file__, __doc__))
