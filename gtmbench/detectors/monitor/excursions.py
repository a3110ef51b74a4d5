"""Excursions: stretches in which residuals say nothing, for the motion is beyond what the monitor knows.

Their rows are taken out of the residuals, so that what comes after is held against what was before. A score that would
have risen in one is told, as an alarm that can't be: a fault there looks the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.clock import even_times_s
from gtmbench.detectors.alarm import OUTSIDE, Alarm, Judgement
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.monitor.missing import NEVER
from gtmbench.detectors.monitor.scores import residual_scores
from gtmbench.method.alarms import rising
from gtmbench.record import FloatArray, Record

_SOON_S = 10.0  # after an excursion: what begins then may come of it


@dataclass(frozen=True, kw_only=True)
class Excursion:
    """A stretch in which residuals say nothing.

    Attributes
    ----------
    start_s, end_s : float
    reason : str
        What it is: ``touchdown``, ``reset``, ``motion beyond what was identified``.
    settles_s : float
        How long after it an alarm that began with it may be its own: estimators take their time.
    is_judged : bool
        Whether residuals are judged all the same: it is told, and nothing need come of it. Only an alarm that begins
        there can't be told.
    """

    start_s: float
    end_s: float
    reason: str
    settles_s: float = 10.0
    is_judged: bool = False


def rows_of(excursion: Excursion, record: Record) -> range:
    """Return the rows of a record that an excursion covers."""
    last = len(record) - 1
    first, stop = (
        (time_s - record.start_s) / record.sample_period_s for time_s in (excursion.start_s, excursion.end_s)
    )
    return range(
        min(max(int(np.ceil(first - 1e-6)), 0), last + 1), min(max(int(np.floor(stop + 1e-6)) + 1, 0), last + 1)
    )


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


class Excursions:
    """The alarms of excursions, by the row with which each is known.

    Parameters
    ----------
    monitor : CalibratedBank
    record : Record
    residuals : BankResiduals
        As they are.
    excursions : sequence of Excursion
    before : mapping of output to array, optional
        As `Track` has it.
    """

    def __init__(
        self,
        monitor: CalibratedBank,
        record: Record,
        residuals: BankResiduals,
        excursions: Sequence[Excursion],
        before: Mapping[str, FloatArray] | None = None,
    ) -> None:
        silent = [excursion for excursion in excursions if not excursion.is_judged]
        scores = residual_scores(monitor, record, residuals, before) if silent else {}
        rises = [
            (row, output, score.origins.of(row)[1])
            for output, score in scores.items()
            for row in rising(score.values, 1.0).tolist()
        ]
        pairs = [(each, alarm) for each in silent for alarm in _first(monitor, record, rises, each)]
        self._alarms = sorted((alarm for _, alarm in pairs), key=lambda each: each[0])
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

    @property
    def due(self) -> int:
        """The row with which the next is known."""
        return self._alarms[0][0] if self._alarms else NEVER

    def tell(self, row: int, number: int) -> Iterator[Alarm]:
        """Give the alarms up to a row, numbered from `number` on."""
        while self.due <= row:
            _, alarm = self._alarms.pop(0)
            yield replace(alarm, number=number, fault=number)
            number += 1


def _first(
    monitor: CalibratedBank, record: Record, rises: Sequence[tuple[int, str, int]], excursion: Excursion
) -> Iterator[tuple[int, Alarm]]:
    """Give the first alarm that an excursion would have raised, if any, and the row with which it is known.

    Of `rises` of scores, each its row, its residual and the row since which something has been there.
    """
    rows = rows_of(excursion, record)
    within = [
        (row + round(monitor.look_ahead_of(output) / record.sample_period_s), output, onset)
        for row, output, onset in rises
        if row in rows
    ]
    if not within:
        return
    known, output, onset = min(within)
    time_s, onset_s = (
        float(even_times_s(record.start_s, record.sample_period_s, range(k, k + 1))[0]) for k in (known, onset)
    )
    suspects = tuple(name for name in monitor.bank.suspects if output in monitor.bank.affects(name))
    judged = Judgement(time_s=time_s, sensor=None, candidates=suspects, doubt=excursion.reason)
    alarm = Alarm(number=0, time_s=time_s, onset_s=onset_s, source=output, test=OUTSIDE, judgements=(judged,))
    yield known, replace(alarm, ended_s=excursion.end_s, end_known_s=max(excursion.end_s, time_s))
