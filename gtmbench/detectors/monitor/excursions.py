"""What comes of excursions: no residual is judged there, and what follows is held against what was before.

A score that would have risen in one is told, as an alarm that can't be: a fault there looks the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import OUTSIDE, Alarm, Judgement
from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.excursion import Excursion, rows_about, rows_of
from gtmbench.detectors.monitor.missing import NEVER
from gtmbench.detectors.monitor.residuals import RecordResiduals
from gtmbench.detectors.monitor.scores import Crossing, ScoreTrack, reach_of, rises_in
from gtmbench.values.clock import even_times_s
from gtmbench.values.record import FloatArray, Record

_SOON_S = 10.0  # after an excursion: what begins then may come of it


def blots(monitor: CalibratedBank, record: Record, excursions: Sequence[Excursion]) -> list[tuple[str, range]]:
    """Return which rows of which residual stand on samples of an excursion."""
    reach = {output: round(monitor.history_of(output) / record.sample_period_s) for output in monitor.operators}
    silent = [rows_of(excursion, record) for excursion in excursions if not excursion.is_judged]
    spans = [rows for rows in silent if rows]
    return [
        (output, range(max(rows.start - reach[output], 0), min(rows.stop + reach[output], len(record))))
        for output in reach
        for rows in spans
    ]


def blotted(raw: Mapping[str, FloatArray], out: Iterable[tuple[str, range]]) -> dict[str, FloatArray]:
    """Return residuals without some rows."""
    left = dict(raw)
    for output, rows in out:
        left[output] = left[output].copy() if left[output] is raw[output] else left[output]
        left[output][rows.start : rows.stop] = np.nan
    return left


def rises_of(residuals: RecordResiduals, before: Mapping[str, FloatArray]) -> list[Crossing]:
    """Return where the scores of a record rise, piece by piece; `before` as `ScoreTrack` has it."""
    monitor, found = residuals.monitor, list[Crossing]()
    tracks = {output: ScoreTrack.of(monitor, output, before.get(output)) for output in monitor.operators}
    for rows in residuals.pieces():
        first = max(rows.start - reach_of(monitor), 0)
        part = residuals.part(range(first, rows.stop), rows.start)
        found += rises_in(tracks, part, first, rows, residuals.record.start_s)
    return found


class Excursions:
    """The alarms of excursions, by the row with which each is known.

    `start_s`: of row 0. `known_s`: up to when it is known whether one goes on.
    """

    def __init__(
        self,
        monitor: CalibratedBank,
        start_s: float,
        excursions: Sequence[Excursion],
        rises: Sequence[Crossing],
        known_s: float,
    ) -> None:
        self._monitor, self._start_s, self._known_s = monitor, start_s, known_s
        silent = [excursion for excursion in excursions if not excursion.is_judged]
        pairs = [(each, alarm) for each in silent for alarm in self._first(each, rises)]
        self.alarms = sorted((alarm for _, alarm in pairs), key=lambda each: each[0])  # each with its row
        self._shaken = [(excursion, excursion.end_s + _SOON_S) for excursion, _ in pairs]
        self._shaken += [(excursion, excursion.end_s) for excursion in excursions if excursion.is_judged]

    def just_before(self, time_s: float, since_s: float) -> Excursion | None:
        """Return the excursion that an alarm, which tells of something since another time, may be the settling after.

        Only one in which a score would have risen; or where it is judged all the same.
        """
        for excursion, until_s in self._shaken:
            if excursion.start_s <= time_s and since_s < until_s:
                return excursion
        return None

    def due(self, told: int) -> int:
        """Return the row with which the next is known, once so many have been told."""
        return self.alarms[told][0] if told < len(self.alarms) else NEVER

    def _first(self, excursion: Excursion, rises: Sequence[Crossing]) -> Iterator[tuple[int, Alarm]]:
        """Give the first alarm that an excursion would have raised, if any, and the row with which it is known."""
        monitor, period_s = self._monitor, self._monitor.sample_period_s
        rows = rows_about(excursion, self._start_s, period_s)
        within = [
            (rise.row + round(monitor.look_ahead_of(rise.output) / period_s), rise.output, rise.onset_row)
            for rise in rises
            if rise.row in rows
        ]
        if not within:
            return
        known, output, onset = min(within)
        time_s, onset_s = (float(even_times_s(self._start_s, period_s, range(k, k + 1))[0]) for k in (known, onset))
        suspects = tuple(name for name in monitor.bank.suspects if output in monitor.bank.affects(name))
        judged = Judgement(time_s=time_s, sensor=None, candidates=suspects, doubt=excursion.reason)
        alarm = Alarm(number=0, time_s=time_s, onset_s=onset_s, source=output, test=OUTSIDE, judgements=(judged,))
        if excursion.end_s < self._known_s:
            alarm = replace(alarm, ended_s=excursion.end_s, end_known_s=max(excursion.end_s, time_s))
        yield known, alarm
