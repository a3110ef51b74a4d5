"""Banks on samples as they come in; `watch` hands a whole record to the same stream, in pieces.

Between chunks a stream remembers, per residual, the samples that its statistics look back at and a minute more
(with the shipped banks 60 + 20.5 + 60 s), and for diagnoses the rows of the bank's channels and of witnesses, residuals
and predictions of the last two minutes and a bit (`alarms.span_rows`, kept in a table of twice that length). So it
takes the same memory after an hour as after five minutes; only the alarms add up.

Chunks go through functions that work on arrays, with the rows before that these look back at. Matrix products round
otherwise where rows begin elsewhere, so residuals in other chunks differ by some 1e-14. Single samples have a path of
their own that costs a thirteenth (`sample_scores.RowByRow`): it tells scores, and where one could be an alarm, the same
functions decide.

Records that begin alike: what one bank makes of the rows that they share is worked out once.

The trials of a flight break one healthy record, each from its onset on. Up to there they are the same rows, whose
scores and noise a stream has taken already.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, bank_residuals
from gtmbench.detectors.gate import taken_inside
from gtmbench.detectors.monitor.alarms import AlarmLogic, span_rows
from gtmbench.detectors.monitor.excursions import blotted
from gtmbench.detectors.monitor.open_faults import Arming
from gtmbench.detectors.monitor.residuals import Memory, RecordResiduals
from gtmbench.detectors.monitor.sample_scores import RowByRow
from gtmbench.detectors.monitor.scores import ScoreTrack, extend, reach_of
from gtmbench.detectors.statistics.statistic import Spread
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress
from gtmbench.values.clock import lateness_s
from gtmbench.values.pieces import pieces
from gtmbench.values.record import BoolArray, FloatArray, Record

_NONE: Mapping[str, FloatArray] = MappingProxyType({})
_FEW = 20  # rows of a chunk, up to which they are taken one by one: from some 30 on, arrays cost less


class BankStream:
    """A bank's monitor at work on samples as they come in; see the module's text.

    `rows`: that come at most. `before`, by output: healthy residuals on which the noise was learnt; of the others it is
    learnt on what comes. `about`: what else `AlarmLogic` has.
    """

    def __init__(
        self, monitor: CalibratedBank, *, rows: float = math.inf, before: Mapping[str, FloatArray] = _NONE, **about: Any
    ) -> None:
        self._monitor = monitor
        self._period_s = monitor.sample_period_s
        self._reach = reach_of(monitor)
        self._memory = Memory(monitor, 0.0, int(min(2 * max(span_rows(monitor), self._reach), rows)))
        self._tracks = {output: ScoreTrack.of(monitor, output, before.get(output)) for output in monitor.operators}
        self._logic = AlarmLogic(monitor, self._memory, self._tracks, **about)
        self._left_out: list[tuple[str, range]] = []  # rows of residuals
        self._rows = RowByRow(monitor, self._memory, self._tracks) if RowByRow.can(monitor) else None
        self._known: tuple[tuple[str, ...], list[int]] | None = None  # channels of the chunk before, and where ours are

    @property
    def armed(self) -> Mapping[str, bool]:
        """Whether each residual's score could raise an alarm with the next sample."""
        return MappingProxyType({arming.output: arming.armed for arming in self._logic.arming})

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far, as it is known by now."""
        return tuple(self._logic.alarms)

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise or tell more of: the same alarm, by its number, again.

        InputError where the chunk doesn't continue the one before, lacks a channel or has another sample period; it
        changes nothing.
        """
        chunk = taken_inside(chunk)
        columns = self._checked(chunk)
        if not len(chunk):
            return ()
        if not self._memory.stop:
            self._memory.start_s = chunk.start_s
        return self._take_few(chunk, columns) if self._is_few(chunk) else self._take_many(chunk, columns)

    def _is_few(self, chunk: Record) -> bool:
        """Tell whether rows are taken one by one."""
        return self._rows is not None and len(chunk) <= _FEW and not chunk.is_in_part_unknown

    def _laid(self, chunk: Record, columns: list[int]) -> tuple[FloatArray, BoolArray]:
        """Return what is taken of a chunk, and which samples of the bank's channels are there."""
        values = chunk.values
        wider = np.column_stack([values, np.full(len(values), np.nan)]) if -1 in columns else values
        return wider[:, columns], np.asarray(chunk.there[:, columns[: len(self._memory.channels)]])

    def _take_many(self, chunk: Record, columns: list[int]) -> tuple[Alarm, ...]:
        """Take samples together."""
        return self._take(*self._laid(chunk, columns))

    def _take_few(self, chunk: Record, columns: list[int]) -> tuple[Alarm, ...]:
        """Take samples one by one."""
        told: dict[int, Alarm] = {}
        for row in chunk.values.tolist():
            row.append(math.nan)
            told |= {alarm.number: alarm for alarm in self._take_one([row[column] for column in columns])}
        return tuple(told[number] for number in sorted(told))

    def _take_one(self, row: list[float]) -> tuple[Alarm, ...]:
        """Take one sample: where nothing can come of it, no more than its scores are looked at."""
        rows, logic, own = self._rows, self._logic, len(self._memory.channels)
        scores = None if rows is None else rows.take(row)
        if rows is None or scores is None:  # it begins, or there is something that only the arrays' functions take
            return self._take(np.array([row]), np.isfinite([row[:own]]))
        logic.missing.take_one(row[:own])
        if logic.is_quiet(scores) and not rows.may_be_spike:
            rows.pass_over()
            logic.take(scores)
            return ()
        rows.reopen()
        return self._went_on()

    def _take(self, values: FloatArray, there: BoolArray) -> tuple[Alarm, ...]:
        """Take samples by the functions that work on arrays."""
        begin = self._memory.stop
        self._memory.take(values)
        rows = range(begin, self._memory.stop)
        first = max(begin - self._reach, 0)
        self._logic.missing.take(there)
        judged = self._judged_of(self._residuals_of(range(first, rows.stop), begin), first, rows)
        for output, row, raw, spread in extend(self._tracks, judged, first, rows):
            self._put(output, row, raw, spread)
        if self._rows is not None:
            self._rows.is_stale = True
        return self._went_on()

    def _residuals_of(self, rows: range, new: int) -> BankResiduals:
        """Return the residuals as some rows give them, which are new from one of them on."""
        return bank_residuals(self._monitor, self._memory.record(rows), new - rows.start)

    def _put(self, output: str, row: int, raw: FloatArray, spread: Spread | None) -> None:
        """Remember what a track took, from a row on."""
        self._memory.put(output, row, raw, spread)

    def _judged_of(self, residuals: BankResiduals, first: int, _rows: range) -> BankResiduals:
        """Return what is judged of residuals, of rows from the first on, that some rows make known."""
        out = ((output, range(max(of.start - first, 0), of.stop - first)) for output, of in self._left_out)
        return replace(residuals, raw=blotted(residuals.raw, [each for each in out if each[1].stop > 0]))

    def _went_on(self) -> tuple[Alarm, ...]:
        told = self._logic.run(self._memory.stop)
        self._forget()
        if told and self._rows is not None:
            self._rows.is_stale = True  # rows may have been taken out
        return told

    def _forget(self) -> None:
        """Let go of scores that nobody looks back at."""
        for track in self._tracks.values():
            track.forget()

    def _checked(self, chunk: Record) -> list[int]:
        """Refuse a chunk that isn't the next; return where what is taken stands in it, -1 where it doesn't."""
        if chunk.sample_period_s != self._period_s:
            chunk.check_period(self._period_s, "the monitor was calibrated at")
        if self._known is None or chunk.channels != self._known[0]:
            self._monitor.bank.check_channels(chunk.channels)
            places = {name: place for place, name in enumerate(chunk.channels)}
            known = (chunk.channels, [places.get(name, -1) for name in self._memory.taken])
        else:
            known = self._known
        if self._memory.stop and len(chunk):
            due_s = self._memory.start_s + round(self._memory.stop * self._period_s, 9)
            if lateness_s(chunk.start_s, due_s, self._period_s):
                raise InputError(
                    f"the chunk begins at {chunk.start_s:.10g} s, but {due_s:.10g} s is next; fill the gap with NaN or "
                    "begin a new stream"
                )
        self._known = known
        return known[1]


def shared_values(monitor: CalibratedBank, logic: AlarmLogic) -> Iterator[object]:
    """Give what copies of a stream share: it is never changed."""
    yield from (monitor, monitor.bank, monitor.bank.statistic)
    yield from (*monitor.tolerances.values(), *monitor.whiteners.values(), *monitor.thresholds.values())
    yield from logic.values


class RecordStream(BankStream):
    """A stream that takes a whole record in pieces, so that a day costs the memory of twenty minutes.

    What it takes is worked out for a stream's chunks and for a record alike; of a record it keeps every score, and how
    much wider what is normal became. `left_out`: rows of residuals that aren't judged. `about`: as `BankStream` has it.
    """

    def __init__(self, residuals: RecordResiduals, left_out: Sequence[tuple[str, range]], **about: Any) -> None:
        record = residuals.record
        super().__init__(residuals.monitor, rows=len(record), keeps_changes=True, **about)
        self._of, self._left_out = residuals, list(left_out)
        self._memory.start_s = record.start_s
        self._memory.leave_out(left_out)
        self.scores = {output: np.full(len(record), np.nan) for output in self._tracks}
        self.widening = {output: np.ones(len(record)) for output in residuals.monitor.uncertainties}

    @property
    def armings(self) -> Sequence[Arming]:
        """Since when each residual could raise an alarm."""
        return self._logic.arming

    @property
    def noise_levels(self) -> dict[str, float]:
        """The noise's deviation over that of the calibration, by output, where it was learnt."""
        return {output: track.level for output, track in self._tracks.items() if track.level > 0.0}

    def take_all(self, progress: Progress) -> None:
        """Take the record, from where it was taken up to."""
        first, rows = self._memory.stop, len(self._of.record)
        for piece in pieces(rows - first):
            progress("watch", first + piece.start, rows)
            self.take_until(first + piece.stop)

    def take_until(self, stop: int) -> None:
        """Take the record up to a row."""
        part = self._of.record.part(range(self._memory.stop, stop))
        self._take_many(part, self._checked(part))

    def with_record(self, residuals: RecordResiduals) -> RecordStream:
        """Return a copy that goes on with another record, as long, whose rows have been the same so far."""
        other = copy.copy(self)
        memo: dict[int, Any] = {id(each): each for each in shared_values(self._monitor, self._logic)}
        parts = (self._memory, self._tracks, self._logic, self.scores, self.widening)
        other._memory, other._tracks, other._logic, other.scores, other.widening = copy.deepcopy(parts, memo)
        other._of, other._rows = residuals, None
        return other

    def _residuals_of(self, rows: range, new: int) -> BankResiduals:
        return self._of.part(rows, new)

    def _put(self, output: str, row: int, raw: FloatArray, spread: Spread | None) -> None:
        super()._put(output, row, raw, spread)
        if spread is not None:
            self.widening[output][row : row + len(raw)] = spread.white

    def _forget(self) -> None:
        for output, track in self._tracks.items():
            self.scores[output][track.first : track.stop] = track.values
        super()._forget()


class BegunWatch:
    """The beginning of a record that is taken once, for others that begin so.

    `begin`: gives a stream of the record that has taken nothing of it yet.
    """

    def __init__(self, record: Record, begin: Callable[[], RecordStream]) -> None:
        self._record, self._begin = record, begin
        self._taken, self._stop = begin(), 0

    def stream(self, residuals: RecordResiduals) -> RecordStream | None:
        """Return a stream of another record that has taken the rows that it shares with this one; None without any."""
        stop = self._shared(residuals.record)
        if not stop:
            return None
        if stop < self._stop:
            self._taken, self._stop = self._begin(), 0
        if stop > self._stop:
            self._taken.take_until(stop)
            self._stop = stop
        return self._taken.with_record(residuals)

    def _shared(self, record: Record) -> int:
        """Return how many rows two records share; none, where they differ otherwise."""
        mine = self._record
        if (mine.channels, mine.start_s, len(mine)) != (record.channels, record.start_s, len(record)):
            return 0
        is_same = ((mine.values == record.values) | (np.isnan(mine.values) & np.isnan(record.values))).all(axis=1)
        return len(record) if is_same.all() else int(np.argmin(is_same))
