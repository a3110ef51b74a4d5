"""Banks on samples as they come in: chunk for chunk what `watch` says of the whole record.

Between chunks a stream remembers, per residual, the samples that its statistics look back at and a minute more
(with the shipped banks 60 + 20.5 + 60 s), and for diagnoses the rows of the bank's channels and of witnesses, residuals
and predictions of the last two minutes and a bit (`alarms.span_rows`, kept in a table of twice that length). So it
takes the same memory after an hour as after five minutes; only the alarms add up.

Where the monitor knows how hard the motion was that it was identified on, a stream tells of excursions, as `watch`
does: what is beyond is known some tenths of a second later, so the stream goes back to a state that it kept, and on
without those rows. What it said meanwhile is told anew, by its number; an alarm that isn't there any more has passed.

Chunks go through the functions that `watch` uses, with the rows before that these look back at. Single samples have a
path of their own (`rows.RowByRow`) that costs some ten microseconds: it tells scores, and where one could be an alarm,
the same functions decide.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmbench.clock import lateness_s
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.bank.calibrated import bank_residuals
from gtmbench.detectors.monitor.alarms import AlarmLogic, span_rows
from gtmbench.detectors.monitor.excursions import blotted
from gtmbench.detectors.monitor.memory import Memory
from gtmbench.detectors.monitor.rows import RowByRow
from gtmbench.detectors.monitor.scores import Track, extend, reach_of
from gtmbench.detectors.monitor.surroundings import Surroundings
from gtmbench.errors import InputError
from gtmbench.record import BoolArray, FloatArray, Record, check_record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gtmbench.detectors.bank.calibrated import CalibratedBank
    from gtmbench.detectors.monitor.regime import Regime

_EVERY_S = 1.0  # a state is kept, to go back to
_FEW = 8  # rows of a chunk, up to which they are taken one by one


class BankStream:
    """A bank's monitor at work on samples as they come in; see the module's text.

    Parameters
    ----------
    monitor : CalibratedBank
    regime : Regime, optional
        How hard the motion was that it was identified on.
    """

    def __init__(self, monitor: CalibratedBank, regime: Regime | None = None) -> None:
        self._monitor = monitor
        self._period_s = monitor.sample_period_s
        self._tracks = {output: Track(monitor, output) for output in monitor.operators}
        self._reach = reach_of(monitor)
        self._memory = Memory(monitor, 0.0, 2 * max(span_rows(monitor), self._reach))
        self._logic = AlarmLogic(monitor, self._memory, self._tracks)
        self._rows = RowByRow(monitor, self._memory, self._tracks) if RowByRow.can(monitor) else None
        self._known: tuple[tuple[str, ...], list[int]] | None = None  # channels of the chunk before, and where ours are
        self._around = Surroundings(monitor, regime) if regime is not None and regime.limits else None
        self._kept: list[_Kept] = []
        self._there: list[tuple[int, BoolArray]] = []  # which samples are there, of the last rows, by the first of them

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
        if self._around is not None:
            return self._take_beside(chunk, columns)
        if self._rows is None or count > _FEW or chunk.is_in_part_unknown:
            self._logic.missing.take(chunk.there[:, columns[:own]])
            return self._take(_laid(values, columns))
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

    def _take_beside(self, chunk: Record, columns: list[int]) -> tuple[Alarm, ...]:
        """Take samples, and what they tell of motion: it may be that rows before have to be taken again."""
        assert self._around is not None
        own, before = len(self._memory.channels), list(self._logic.alarms)
        values, there = _laid(chunk.values, columns), np.asarray(chunk.there[:, columns[:own]])
        changed = self._around.take(chunk)
        if changed is not None and changed < self._memory.stop:
            earlier, was_there = self._go_back(changed)
            values, there = np.concatenate([earlier, values]), np.concatenate([was_there, there])
        self._memory.left_out = self._around.left_out(self._memory.first)
        late = max(len(values) - self._around.horizon, 0)
        for rows in (slice(late), slice(late, None)):
            if len(values[rows]):
                self._keep()
                self._there.append((self._memory.stop, there[rows]))
                self._logic.missing.take(there[rows])
                self._take(values[rows])
        return _news(before, self._logic.alarms)

    def _keep(self) -> None:
        """Keep the state, once a second and whenever much is taken at once; forget those that nobody goes back to."""
        assert self._around is not None
        stop, every = self._memory.stop, round(_EVERY_S / self._period_s)
        if self._kept and stop - self._kept[-1].stop < min(every, self._around.horizon):
            return
        self._kept.append(_Kept.of(stop, [*self._tracks.values(), self._logic], self._shared))
        old = sum(kept.stop <= stop - self._around.horizon for kept in self._kept)
        self._kept = self._kept[max(old - 1, 0) :]
        self._there = [part for part in self._there if part[0] + len(part[1]) > self._kept[0].stop]

    def _go_back(self, row: int) -> tuple[FloatArray, BoolArray]:
        """Go back to a state before a row; return what has to be taken again, and which of that is there."""
        self._kept = [kept for kept in self._kept if kept.stop <= row] or self._kept[:1]
        kept = self._kept.pop()
        kept.restore([*self._tracks.values(), self._logic])
        there = np.concatenate([part[max(kept.stop - first, 0) :] for first, part in self._there])
        self._there = []
        return self._memory.back_to(kept.stop), there

    def _shared(self) -> Iterator[object]:
        """Give what states share: it is never changed."""
        yield from (
            self._monitor,
            self._monitor.bank,
            self._monitor.bank.statistic,
            self._memory,
            *self._tracks.values(),
        )
        yield from (*self._monitor.tolerances.values(), *self._monitor.whiteners.values())
        yield from (*self._monitor.thresholds.values(), self._logic.excursions, *self._logic.alarms)

    def _take(self, values: FloatArray) -> tuple[Alarm, ...]:
        """Take samples by the functions that work on arrays."""
        begin = self._memory.stop
        self._memory.take(values)
        stop = self._memory.stop
        first = max(begin - self._reach, 0)
        residuals = bank_residuals(self._monitor, self._memory.record(range(first, stop)))
        if self._around is not None:
            self._around.hear(residuals, first, range(begin, stop))
            self._logic.excursions = self._around.alarms()
            residuals = replace(residuals, raw=blotted(residuals.raw, _behind(self._memory.left_out, first)))
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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Kept:
    """The state of a stream at a row, to go back to."""

    stop: int
    states: list[dict[str, Any]] = field(repr=False)

    @classmethod
    def of(cls, stop: int, parts: Sequence[object], shared: Callable[[], Iterable[object]]) -> _Kept:
        """Copy the state of some parts, but for what is shared."""
        memo = {id(each): each for each in shared()}
        return cls(stop=stop, states=[copy.deepcopy(vars(part), memo) for part in parts])

    def restore(self, parts: Sequence[object]) -> None:
        """Give some parts their state back, which is theirs from then on."""
        for part, state in zip(parts, self.states, strict=True):
            vars(part).clear()
            vars(part).update(state)


def _laid(values: FloatArray, columns: list[int]) -> FloatArray:
    """Return some columns of samples, missing where there is none."""
    wider = np.column_stack([values, np.full(len(values), np.nan)]) if -1 in columns else values
    return wider[:, columns]


def _behind(out: Iterable[tuple[str, range]], first: int) -> list[tuple[str, range]]:
    """Return rows as they are counted from another one."""
    counted = ((output, range(max(rows.start - first, 0), max(rows.stop - first, 0))) for output, rows in out)
    return [(output, rows) for output, rows in counted if rows]


def _news(before: Sequence[Alarm], now: Sequence[Alarm]) -> tuple[Alarm, ...]:
    """Return the alarms that are others than before; one that isn't there any more has passed."""
    gone = [
        replace(alarm, judgements=(*alarm.judgements, Judgement(time_s=alarm.time_s, sensor=None, candidates=())))
        for alarm in before[len(now) :]
    ]
    return (*(alarm for i, alarm in enumerate(now) if before[i : i + 1] != [alarm]), *gone)
