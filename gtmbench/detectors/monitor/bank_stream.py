"""Banks on samples as they come in: chunk for chunk what `watch` says of the whole record.

Between chunks a stream remembers, per residual, the samples that its statistics look back at and a minute more
(with the shipped banks 60 + 20.5 + 60 s), and for diagnoses the rows of the bank's channels and of witnesses, residuals
and predictions of the last two minutes and a bit (`alarms.span_rows`, kept in a table of twice that length). So it
takes the same memory after an hour as after five minutes; only the alarms add up.

Chunks go through the functions that `watch` uses, with the rows before that these look back at. Single samples have a
path of their own that is cheaper (`sample_scores.RowByRow`): it tells scores, and where one could be an alarm, the same
functions decide.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.calibrated import BankResiduals, bank_residuals
from gtmbench.detectors.gate import taken_inside
from gtmbench.detectors.monitor.alarms import AlarmEngine, span_rows
from gtmbench.detectors.monitor.memory import Memory
from gtmbench.detectors.monitor.sample_scores import RowByRow
from gtmbench.detectors.monitor.scores import reach_of
from gtmbench.errors import InputError
from gtmbench.values.clock import lateness_s
from gtmbench.values.record import BoolArray, FloatArray, Record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gtmbench.detectors.bank.calibrated import CalibratedBank

_FEW = 20  # rows of a chunk, up to which they are taken one by one: from some 30 on, arrays cost less


class BankStream:
    """A bank's monitor at work on samples as they come in; see the module's text."""

    def __init__(self, monitor: CalibratedBank) -> None:
        self._monitor = monitor
        self._period_s = monitor.sample_period_s
        self._reach = reach_of(monitor)
        self._memory = Memory(monitor, 0.0, 2 * max(span_rows(monitor), self._reach))
        self._engine = AlarmEngine(monitor, self._memory)
        self._tracks, self._logic = self._engine.tracks, self._engine.logic
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
        stop = self._memory.stop
        first = max(begin - self._reach, 0)
        residuals = bank_residuals(self._monitor, self._memory.record(range(first, stop)))
        self._engine.take(self._judged_of(residuals, first, range(begin, stop)), first, range(begin, stop), there)
        if self._rows is not None:
            self._rows.is_stale = True
        return self._went_on()

    def _judged_of(self, residuals: BankResiduals, _first: int, _rows: range) -> BankResiduals:
        """Return what is judged of residuals, of rows from the first on, that some rows make known: all of it."""
        return residuals

    def _went_on(self) -> tuple[Alarm, ...]:
        told = self._engine.run(self._memory.stop)
        self._engine.forget()
        if told and self._rows is not None:
            self._rows.is_stale = True  # rows may have been taken out
        return told

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
