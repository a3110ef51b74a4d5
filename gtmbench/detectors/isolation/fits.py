"""Fits of fault hypotheses: the suspect and the kind of fault whose undoing makes all residuals healthy again.

A suspect's record is corrected as if it had that fault: y - (F(v) - v), v its virtual sensor. The residuals of the
corrected record, whitened, are healthy noise if the hypothesis is right, so their sum of squares is its -2 log
likelihood to a constant; hypotheses compete by the BIC.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, residuals_of
from gtmbench.detectors.isolation.hypotheses import HYPOTHESES, Deviance, Fit, Parameters, Stretch
from gtmbench.detectors.virtual import integrable, integrated_angle
from gtmbench.record import FloatArray, Record

_MOST = 20.0  # deviations that one sample may count for
_EARLIEST_S = 60.0  # before the fault is sure: no earlier onset is tried
_HOPELESS = 200.0  # of -2 log likelihood


@dataclass(frozen=True, kw_only=True)
class FittedHypothesis(Fit):
    """The fit of a suspect, and its BIC: log(samples) a parameter added, residuals that it leaves alone included.

    `left` is the mean square of the suspect's own residuals, whitened, once corrected: about 1 if that explains them.
    """

    channel: str
    bic: float
    left: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Rows of a record that an alarm is judged on, and everything that hypotheses share.

    Attributes
    ----------
    record : Record
        From before the onset to the end of the horizon.
    start, sure : int
        Rows of it: the suspect isn't believed from `start` on, the fault is surely there from `sure` on, and
        residuals are judged from there to the end, as far as they are known.
    shift : dict
        Means of the residuals before the fault (biases), in the outputs' units.
    """

    monitor: CalibratedBank
    record: Record
    residuals: BankResiduals = field(repr=False)
    start: int
    sure: int
    shift: dict[str, float]

    @property
    def stop(self) -> int:
        """One past the last row."""
        return len(self.record)

    def energy(self, raw: dict[str, FloatArray]) -> tuple[float, int]:
        """Return the sum of squares of some residuals, whitened, over the rows judged, and how many they are."""
        total, count = 0.0, 0
        for output, values in raw.items():
            squares = self.squares(output, values)
            there = squares[np.isfinite(squares)]
            total += float(np.sum(there))
            count += len(there)
        return total, count

    def squares(self, output: str, values: FloatArray) -> FloatArray:
        """Return the squares of a residual, whitened about its mean before the fault, over the rows judged.

        Only rows that are known at their end; none counts for more than `_MOST` deviations.
        """
        whitener = self.monitor.whiteners[output]
        ahead = round(self.monitor.corrected_look_ahead_of(output) / self.record.sample_period_s)
        begin = max(self.sure - whitener.order, 0)
        white = whitener.whiten(values[begin : max(self.stop - ahead, begin)] - self.shift[output])[self.sure - begin :]
        if output in self.residuals.spread:
            white = white / self.residuals.spread[output].white[self.sure :][: len(white)]
        return np.asarray(np.square(np.clip(white, -_MOST, _MOST)))


def shift_of(monitor: CalibratedBank, output: str, before: FloatArray) -> float:
    """Return the mean of a residual before a fault, about that of its identification."""
    there = before[np.isfinite(before)]
    return float(there.mean()) - monitor.whiteners[output].mean if len(there) else 0.0


def ranked_hypotheses(case: Case, channels: tuple[str, ...]) -> list[FittedHypothesis]:
    """Return every kind of fault of the suspects that have a virtual sensor, best first.

    A suspect whose channel leaves far more than the best hypothesis so far, as it is and all replaced by the virtual
    sensor, isn't tried further.
    """
    healthy, count = case.energy(dict(case.residuals.raw))
    penalty = float(np.log(max(count, 2)))
    suspects = [_Suspect.of(case, channel, healthy) for channel in channels]
    ranking: list[FittedHypothesis] = []
    for suspect in sorted((each for each in suspects if each is not None), key=lambda suspect: suspect.bound):
        if ranking and suspect.bound > min(fit.bic for fit in ranking) + _HOPELESS:
            continue
        for hypothesis in HYPOTHESES.values():
            fit = hypothesis.fit(suspect.stretch, suspect.deviance)
            if fit is not None:
                bic = fit.deviance + (len(fit.parameters) * penalty + suspect.others)
                left = fit.deviance / max(suspect.count, 1)
                ranking.append(FittedHypothesis(**vars(fit), channel=suspect.channel, bic=bic, left=left))
    return sorted(ranking, key=lambda fit: fit.bic)


def within_reach(ranking: Sequence[FittedHypothesis]) -> tuple[str, ...]:
    """Return the suspects that more data may still prove right."""
    return tuple(dict.fromkeys(fit.channel for fit in ranking if fit.bic <= ranking[0].bic + _HOPELESS))


def standard_errors(case: Case, best: FittedHypothesis) -> Parameters:
    """Return standard errors of a hypothesis' parameters."""
    suspect = _Suspect.of(case, best.channel, 0.0)
    return {} if suspect is None else HYPOTHESES[best.kind].errors(suspect.stretch, suspect.deviance, best)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Suspect:
    """A suspect with its virtual sensor: `others` is the energy of the residuals that it doesn't enter."""

    channel: str
    stretch: Stretch
    deviance: Deviance
    others: float
    count: int
    bound: float

    @classmethod
    def of(cls, case: Case, channel: str, healthy: float) -> _Suspect | None:
        """Return a suspect, or None where nothing predicts it."""
        virtual = virtual_sensor(case, channel)
        if virtual is None:
            return None
        affected = case.monitor.bank.affects(channel)
        own, count = case.energy({name: case.residuals.raw[name] for name in affected})
        stretch = stretch_of(case, channel, virtual)

        def deviance(reads: FloatArray) -> float:
            values = corrected(case, channel, virtual, reads)
            return case.energy(corrected_residuals(case, channel, values))[0]

        others = healthy - own
        # the two ends: all that was measured is the fault (what is left is the virtual sensor), or nothing is
        bound = min(deviance(stretch.measured), own) + others
        return cls(channel=channel, stretch=stretch, deviance=deviance, others=others, count=count, bound=bound)


def stretch_of(case: Case, channel: str, virtual: FloatArray) -> Stretch:
    """Return the rows of a suspect that its kind of fault is fitted to."""
    rows = slice(case.sure, case.stop)
    time_s = case.record.time_s
    return Stretch(
        channel=channel,
        measured=case.record[channel][rows],
        virtual=virtual[rows],
        before=float(case.record[channel][case.sure - 1]),
        time_s=time_s[rows],
        earliest_s=float(time_s[case.sure]) - max(_EARLIEST_S, 2.0 * float(time_s[case.sure] - time_s[case.start])),
        sample_period_s=case.record.sample_period_s,
    )


def virtual_sensor(case: Case, channel: str) -> FloatArray | None:
    """Return what a suspect should have read over a case, or None where nothing predicts it."""
    if channel in case.residuals.predicted:
        return np.asarray(
            case.residuals.predicted[channel] + case.shift[channel] + case.monitor.whiteners[channel].mean
        )
    if integrable(channel, case.monitor.bank.channels):
        return integrated_angle(case.record, channel, case.start)
    return None


def corrected(case: Case, channel: str, virtual: FloatArray, reads: FloatArray) -> FloatArray:
    """Return a suspect's channel with a fault undone: the virtual sensor until it is surely there, then y - F + v."""
    values = np.array(case.record[channel])
    values[case.start : case.sure] = virtual[case.start : case.sure]
    values[case.sure : case.stop] += virtual[case.sure : case.stop] - reads
    return values


def corrected_residuals(case: Case, channel: str, values: FloatArray) -> dict[str, FloatArray]:
    """Return the residuals that a suspect enters, with its channel replaced."""
    bank = case.monitor.bank
    feeds = [spec.output for spec in bank.residuals if channel in bank.sources(spec)]
    residuals = {}
    if feeds:
        residuals = dict(residuals_of(bank, case.record.replace(channel, values), case.monitor.operators, feeds).raw)
    if channel in case.residuals.raw:
        residuals[channel] = case.residuals.raw[channel] + (values - case.record[channel])
    return residuals
