"""Banks on samples as they come in: chunk for chunk what `watch` says of the whole record.

Between chunks a stream remembers, per residual, the samples that its statistics look back at and a minute more
(with the shipped banks 60 + 20.5 + 60 s), and for diagnoses the rows of the bank's channels and of witnesses, residuals
and predictions of the last two minutes and a bit (`alarms.span_rows`, kept in a table of twice that length). So it
takes the same memory after an hour as after five minutes; only the alarms add up.

Chunks go through the functions that `watch` uses, with the rows before that these look back at. Single samples have a
path of their own (`rows.RowByRow`) that costs some ten microseconds: it tells scores, and where one could be an alarm,
the same functions decide.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.clock import lateness_s
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.calibrated import bank_residuals
from gtmbench.detectors.monitor.alarms import AlarmLogic, span_rows
from gtmbench.detectors.monitor.memory import Memory
from gtmbench.detectors.monitor.rows import RowByRow
from gtmbench.detectors.monitor.scores import Track, extend, reach_of
from gtmbench.errors import InputError
from gtmbench.record import FloatArray, Record, check_record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gtmbench.detectors.bank.calibrated import CalibratedBank

_FEW = 8  # rows of a chunk, up to which they are taken one by one


class BankStream:
    """A bank's monitor at work on samples as they come in; see the module's text.

    Parameters
    ----------
    monitor : CalibratedBank
    """

    def __init__(self, monitor: CalibratedBank) -> None:
        self._monitor = monitor
        self._period_s = monitor.sample_period_s
        self._tracks = {output: Track(monitor, output) for output in monitor.operators}
        self._reach = reach_of(monitor)
        self._memory = Memory(monitor, 0.0, 2 * max(span_rows(monitor), self._reach))
        self._logic = AlarmLogic(monitor, self._memory, self._tracks)
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

        Raises
        ------
        InputError
            Where the chunk doesn't continue the one before, lacks a channel or has another sample period; it changes
            nothing.
        """
        columns, own = self._checked(chunk), len(self._memory.channels)
        values = chunk.values
        count = len(values)
        if not count:
            return ()
        if not self._memory.stop:
            self._memory.start_s = chunk.start_s
        if self._rows is None or count > _FEW or chunk.is_in_part_unknown:
            wider = np.column_stack([values, np.full(count, np.nan)]) if -1 in columns else values
            taken = wider[:, columns]
            self._logic.missing.take(chunk.there[:, columns[:own]])
            return self._take(taken)
        told: dict[int, Alarm] = {}
        for row in values.tolist():
            row.append(math.nan)
            told |= {alarm.number: alarm for alarm in self._take_one([row[column] for column in columns])}
        return tuple(told[number] for number in sorted(told))

    def _take_one(self, row: list[float]) -> tuple[Alarm, ...]:
        """Take one sample: where nothing can come of it, no more than its scores are looked at."""
        rows, logic = self._rows, self._logic
        logic.missing.take_one(row[: len(self._memory.channels)])
        scores = None if rows is None else rows.take(row)
        if rows is None or scores is None:  # it begins, or there is something that only the arrays' functions take
            return self._take(np.array([row]))
        if logic.is_quiet(scores):
            rows.pass_over()
            logic.take(scores)
            return ()
        rows.reopen()
        return self._went_on()

    def _take(self, values: FloatArray) -> tuple[Alarm, ...]:
        """Take samples by the functions that work on arrays."""
        begin = self._memory.stop
        self._memory.take(values)
        stop = self._memory.stop
        first = max(begin - self._reach, 0)
        residuals = bank_residuals(self._monitor, self._memory.record(range(first, stop)))
        for output, row, raw, spread in extend(self._tracks, residuals, first, range(begin, stop)):
            self._memory.put(output, row, raw, spread)
        if self._rows is not None:
            self._rows.is_stale = True
        return self._went_on()

    def _went_on(self) -> tuple[Alarm, ...]:
        told = self._logic.run(self._memory.stop)
        for track in self._tracks.values():
            track.forget()
        if told and self._rows is not None:
            self._rows.is_stale = True  # rows may have been taken out
        return told

    def _checked(self, chunk: Record) -> list[int]:
        """Refuse a chunk that isn't the next; return where what is taken stands in it, -1 where it doesn't."""
        check_record(chunk)
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
