"""A calibrated bank: operators, whitening filters and thresholds; the residuals that it leaves, and how healthy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.statistics.learnt_noise import second_order
from gtmbench.detectors.statistics.statistic import Allowance, Spread, Steadiness, glr
from gtmbench.detectors.statistics.uncertainty import ParameterUncertainty
from gtmbench.detectors.statistics.whitening import Whitener
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, derived
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, Record, check_record, sealed

Thresholds = Mapping[str, Mapping[str, float]]  # of a residual (by output), of a score (by label)


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedBank:
    """Everything that watching needs: load it in any process, on any machine, and it judges alike."""

    bank: Bank
    operators: Mapping[str, Transmissibility]  # by output
    whiteners: Mapping[str, Whitener]  # by output
    tolerances: Mapping[str, Allowance]  # by output
    thresholds: Thresholds  # by output
    sample_period_s: float
    # where it comes from: records, hours, the false-alarm rate asked for and the bound shown
    provenance: Mapping[str, object]
    # by output: of operators that stand on little flight; none of those that stand on much
    uncertainties: Mapping[str, ParameterUncertainty] = field(default_factory=dict)

    @property
    def is_cautious(self) -> bool:
        """Whether it stands on little flight: what alarms may be motion that it doesn't know, or its model's error."""
        return bool(self.uncertainties)

    def look_ahead_of(self, output: str) -> float:
        """How long after a sample its residual is judged: d Ts, a sample for derivatives, what uncertainty looks at."""
        operator = self.operators[output]
        ahead = operator.noncausal_order + any(name in PSEUDO_INPUTS for name in operator.inputs)
        ahead = max(ahead, int(output in PSEUDO_INPUTS))
        ahead += self.uncertainties[output].half if output in self.uncertainties else 0
        return round(ahead * self.sample_period_s, 9)

    @property
    def knows_noise(self) -> bool:
        """Whether its residuals are judged as they are: their noise isn't learnt where they are watched."""
        return self.bank.statistic.name == "energy"

    def history_of(self, output: str) -> float:
        """How long before a sample its whitened residual looks back."""
        learnt = 0 if self.knows_noise else second_order(self.sample_period_s)
        rows = self.operators[output].causal_order + self.whiteners[output].order + learnt + 1
        return round(rows * self.sample_period_s, 9)


@dataclass(frozen=True, kw_only=True, eq=False)
class BankResiduals:
    """The residuals of a bank on a record, row for row beside it; in the outputs' units."""

    # raw, predicted, by output, shape (samples,): e(k), and the prediction: the virtual sensor
    raw: Mapping[str, FloatArray] = field(repr=False)
    predicted: Mapping[str, FloatArray] = field(repr=False)
    # by output: by which residuals are divided before they are judged; those without aren't
    spread: Mapping[str, Spread] = field(default_factory=dict, repr=False)


def bank_residuals(monitor: CalibratedBank, record: Record, new: int = 0) -> BankResiduals:
    """Return the residuals of a bank on a record with its channels, each by its own operator.

    `new`: the first row whose readings are new. Of residuals that were known before it, the spread isn't worked out.
    """
    residuals = without_spread(monitor, record)
    spread = {
        output: spread_of(monitor, record, output, new) for output in residuals.raw if output in monitor.uncertainties
    }
    return replace(residuals, spread=MappingProxyType(spread))


def spread_of(monitor: CalibratedBank, record: Record, output: str, new: int = 0) -> Spread:
    """Return how far an uncertain residual may be off on a record with the bank's channels; `new` as above."""
    first = new - round(monitor.look_ahead_of(output) / monitor.sample_period_s)
    return monitor.uncertainties[output].spread(
        monitor.operators[output],
        record.select(monitor.bank.channels),
        monitor.whiteners[output].coefficients,
        monitor.bank.statistic,
        slice(max(first, 0), None),
    )


def without_spread(monitor: CalibratedBank, record: Record, outputs: Iterable[str] | None = None) -> BankResiduals:
    """Return what `bank_residuals` does, but not how far they may be off, which costs most of it."""
    check_record(record)
    record.check_period(monitor.sample_period_s, "the monitor was calibrated at")
    monitor.bank.check_channels(record.channels)
    return residuals_of(monitor.bank, record, monitor.operators, outputs)


def residuals_of(
    bank: Bank,
    record: Record,
    operators: Mapping[str, Transmissibility],
    outputs: Iterable[str] | None = None,
) -> BankResiduals:
    """Derive what the operators of a bank need, predict, subtract."""
    raw, predicted = {}, {}
    specs = [spec for spec in bank.residuals if outputs is None or spec.output in outputs]
    names = tuple(dict.fromkeys(name for spec in specs for name in (spec.output, *spec.inputs)))
    # once: the residuals of a bank share angles and slopes
    columns = dict(zip(names, derived(record, names, among=bank.channels), strict=True))
    for spec in specs:
        operator = operators[spec.output]
        hat = operator.predicted([columns[name] for name in operator.inputs])[:, 0]
        raw[spec.output], predicted[spec.output] = sealed(columns[spec.output] - hat), sealed(hat)
    return BankResiduals(raw=MappingProxyType(raw), predicted=MappingProxyType(predicted))


MOST = 20.0  # deviations that one sample may count for


def energy(white: FloatArray) -> float:
    """Return a sum of squares in which no sample counts for more than `MOST` deviations; NaN is passed over."""
    return float(np.sum(np.square(np.clip(white[np.isfinite(white)], -MOST, MOST))))


def greatest(
    monitor: CalibratedBank, output: str, white: FloatArray, *, is_corrected: bool = False, enough: float = np.inf
) -> float:
    """Return how far a whitened residual gets towards its thresholds, 1 being there, over windows laid end to end.

    It stops at the first window that is beyond `enough`, where nobody asks how far the others are.

    The mean before is taken to be known, as the calibrated test knows it from the minute before an alarm. One that is
    corrected for a fault may be quiet: what was stuck had no noise. Of statistics other than the likelihood ratios the
    mean square is judged, by six deviations of chance.
    """
    whitener = monitor.whiteners[output]
    there = np.clip(white[np.isfinite(white)], -MOST, MOST)
    test, tolerance = monitor.bank.statistic, monitor.tolerances[output]
    period_s = monitor.sample_period_s
    if test.name != "glr":
        over = float(np.mean(np.square(there))) - tolerance.high if len(there) else 0.0
        return float(over / (6.0 * np.sqrt(2.0 / max(len(there), 1))))
    least = 0.0
    sums, squares = (np.concatenate([[0.0], np.cumsum(values)]) for values in (there, there * there))
    baseline, steadiness = test.baseline_s / period_s, Steadiness.of(whitener.unsteady)
    for rows in test.rows(period_s):
        # windows end to end, from the last sample back
        ends = np.arange(len(there), rows - 1, -rows)
        if not len(ends):
            break
        mean = (sums[ends] - sums[ends - rows]) / rows
        power = np.maximum((squares[ends] - squares[ends - rows]) / rows, 1e-12)
        low = tolerance.low if test.two_sided and not is_corrected else 0.0
        chance = 1.0 / rows + 1.0 / baseline + 2.0 * whitener.slow
        of_mean, of_energy = glr(mean, power, rows, chance, tolerance.mean, low, tolerance.high, steadiness)
        window = f"{rows * period_s:g} s"
        limits = monitor.thresholds[output]
        least = max(least, float(of_mean.max()) / limits[f"mean {window}"])
        least = max(least, float(of_energy.max()) / limits[f"energy {window}"])
        if least > enough:
            break
    return least
