"""Trials of a bank: what a fault doesn't touch is worked out once, and a diagnosis never.

A sensor doesn't enter its own prediction, so a gyro's fault changes its own residual by what it changes in its
readings. An angle enters residuals by way of pseudo inputs, which aren't linear: those are worked out anew, from the
onset on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank, bank_residuals, without_spread
from gtmbench.detectors.monitor.scores import IntArray, ScoreTrack, crossings, residual_scores
from gtmbench.detectors.monitor.superposition import ChangedResidual
from gtmbench.detectors.protocol import Monitor
from gtmbench.detectors.tried_faults import FAR, TIE_S, Detection, WatchedTrials, is_superposed, stretches
from gtmbench.faults.fault import Fault
from gtmbench.values.record import FloatArray, Record

_SLOPE_ROWS = 2  # on either side of a sample, that a derivative looks at, and one to spare


class _Changed(NamedTuple):
    """A residual from a row on, in place of what it was."""

    residual: ChangedResidual
    begin: int
    values: FloatArray


class BankTrials:
    """Faults put on one healthy record of a bank, one at a time.

    They are what `watch` says up to its first alarm, which it is asked for where that isn't simple: a healthy record
    with an alarm before the onset, or not armed by then; missing samples; several channels that change at once; an
    uncertain operator.

    `monitor`: the same, as what watches. `record`: healthy.
    """

    def __init__(self, bank: CalibratedBank, monitor: Monitor, record: Record) -> None:
        self._bank, self._watched = bank, WatchedTrials(monitor, record)
        self._record, self._time_s = record, record.time_s
        residuals = bank_residuals(bank, record)
        scores = residual_scores(bank, record, residuals)
        self._scores = {output: score.values for output, score in scores.items()}
        self._alarms = crossings(scores, record.start_s)
        self._residuals = {
            output: ChangedResidual(monitor=bank, output=output, raw=raw, spread=residuals.spread.get(output))
            for output, raw in residuals.raw.items()
        }

    def first_alarm_s(self, fault: Fault) -> float | None:
        """Return when the first alarm could be raised at or after a fault's onset; None where none is."""
        if not self._is_simple(fault):
            return self._watched.first_alarm_s(fault)
        found = self._followed(fault, enough=0.0)
        return self._watched.first_alarm_s(fault) if found is None else found.alarm_s

    def detection(self, fault: Fault) -> Detection:
        """Return that, and how far the scores went by the record's end."""
        found = self._followed(fault, enough=FAR) if self._is_simple(fault) else None
        return self._watched.detection(fault) if found is None else found

    def _followed(self, fault: Fault, *, enough: float) -> Detection | None:
        """Follow the residuals that a fault enters until there was an alarm and a peak that is enough, or to the end.

        None where samples miss.
        """
        alarm_s: float | None = None
        peak = 0.0
        going: list[ScoreTrack] = []
        for known in stretches(fault.onset_row(self._record), len(self._record)):
            changed = self._changed(fault, known.stop)
            if changed is None:
                return None
            going = going or [each.residual.changed_from(each.begin) for each in changed]
            scored = [
                each.residual.pushed(now, each.values[now.stop - each.begin :])
                for now, each in zip(going, changed, strict=True)
            ]
            peak = max(peak, *(float(scores.max(initial=0.0)) for _, scores in scored))
            if alarm_s is None:
                alarm_s = min(self._alarms_s(fault, changed, known, scored), default=None)
            if alarm_s is not None and peak >= enough:
                break
        return Detection(alarm_s=alarm_s, peak_ratio=min(peak, FAR))

    def _alarms_s(
        self, fault: Fault, changed: list[_Changed], known: range, scored: list[tuple[IntArray, FloatArray]]
    ) -> list[float]:
        """Return alarms that become known with some rows, the first of each residual that the fault enters.

        `scored` are the rows of each of these that have a score, and the scores.
        """
        alarms = [
            int(rows[np.argmax(scores > 1.0)]) + each.residual.ahead
            for each, (rows, scores) in zip(changed, scored, strict=True)
            if (scores > 1.0).any()
        ]
        times_s = [round(float(self._time_s[row]), 9) for row in alarms]
        return times_s + self._elsewhere_s(fault, changed, float(self._time_s[known.stop - 1]))

    def _entered(self, fault: Fault) -> tuple[str, ...]:
        """Return the residuals that a fault's channel enters."""
        return tuple(spec.output for spec in self._bank.bank.residuals if fault.channel in spec.needs)

    def _is_simple(self, fault: Fault) -> bool:
        if not is_superposed(fault, self._record):
            return False
        if any(alarm.time_s < fault.onset_s - TIE_S for alarm in self._alarms):
            return False
        if self._bank.uncertainties and self._entered(fault) != (fault.channel,):
            return False
        row = fault.onset_row(self._record)
        scores = (self._scores[output][: row - self._residuals[output].ahead] for output in self._entered(fault))
        return all((score <= 1.0).any() for score in scores)  # armed

    def _elsewhere_s(self, fault: Fault, changed: list[_Changed], until_s: float) -> list[float]:
        """Return the alarms from a fault's onset on that are raised without it."""
        begin = {each.residual.output: float(self._time_s[each.begin]) for each in changed}
        return [
            alarm.time_s
            for alarm in self._alarms
            if fault.onset_s - TIE_S <= alarm.time_s <= until_s + TIE_S
            and float(self._time_s[alarm.row]) < begin.get(alarm.output, np.inf) - TIE_S
        ]

    def _changed(self, fault: Fault, stop: int) -> list[_Changed] | None:
        """Return the residuals that a fault enters, by what is known with rows before `stop`; None where some miss."""
        row = fault.onset_row(self._record)
        was, reads = fault.onwards(self._record, stop)
        if not np.isfinite(reads).all():
            return None
        entered = self._entered(fault)
        if entered != (fault.channel,):
            return self._derived(fault.channel, entered, row, reads)
        residual = self._residuals[fault.channel]
        end = max(stop - residual.ahead, row)
        return [_Changed(residual, row, residual.raw[row:end] + (reads - was)[: end - row])]

    def _derived(self, channel: str, outputs: tuple[str, ...], row: int, broken: FloatArray) -> list[_Changed]:
        """Return residuals that are worked out anew from a row on where a channel reads otherwise."""
        operators = [self._bank.operators[output] for output in outputs]
        reach = max((max(each.causal_order, each.noncausal_order) for each in operators), default=0) + _SLOPE_ROWS
        begin = max(row - reach, 0)
        first, stop = max(begin - reach, 0), row + len(broken)
        part = self._record.between(float(self._time_s[first]), float(self._time_s[stop - 1]))
        values = np.concatenate([part[channel][: row - first], broken])
        raw = without_spread(self._bank, part.replace(channel, values), outputs).raw
        changed = []
        for output in outputs:
            residual = self._residuals[output]
            changed.append(_Changed(residual, begin, raw[output][begin - first : stop - first - residual.ahead]))
        return changed
