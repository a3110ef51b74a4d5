"""A bank's stream that minds how hard the motion is: in excursions nothing can be told, as `watch` has it.

What is beyond the regime is known some tenths of a second later. So the stream keeps its state every second, goes back
to one where rows turn out to be beyond, and on without them. What it said meanwhile is told anew, by its number; an
alarm that isn't there any more has passed. In the end it has said what `watch` says of the whole record.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, bank_residuals
from gtmbench.detectors.excursion import Excursion, rows_about
from gtmbench.detectors.monitor.bank_stream import BankStream, shared_values
from gtmbench.detectors.monitor.excursions import Excursions
from gtmbench.detectors.monitor.regime import LATE_S, Regime, RegimeStream
from gtmbench.detectors.monitor.scores import Crossing, ScoreTrack, rises_in
from gtmbench.values.clock import even_times_s
from gtmbench.values.record import BoolArray, FloatArray, Record, joined


class Surroundings:
    """The excursions of a stream, and which scores would have risen in them.

    `horizon`: how many rows back a row that comes in may change what is left out.
    """

    def __init__(self, monitor: CalibratedBank, regime: Regime) -> None:
        self._monitor, self._period_s = monitor, monitor.sample_period_s
        self._motion = RegimeStream(regime, self._period_s)
        self._tracks = {output: ScoreTrack.of(monitor, output) for output in monitor.operators}  # with nothing left out
        self._rises: list[Crossing] = []
        self._reach = {output: round(monitor.history_of(output) / self._period_s) for output in monitor.operators}
        self._start_s = 0.0
        self._taken = self._heard = 0  # rows
        self.horizon = round(LATE_S / self._period_s) + max(self._reach.values()) + 4
        self.excursions: tuple[Excursion, ...] = ()

    def take(self, rows: Record) -> int | None:
        """Take the next rows; return from which row on residuals are left out otherwise than was known; None as before.

        The end of an excursion that goes on is known before it comes.
        """
        if not self._taken:
            self._start_s = rows.start_s
        self._taken += len(rows)
        self._motion.take(rows)
        before, self.excursions = self.excursions, self._motion.excursions
        ends = {each.start_s: self._rows(each).stop for each in before}
        changed = [
            ends.get(each.start_s, max(self._rows(each).start - max(self._reach.values()), 0))
            for each in self.excursions
            if each not in before
        ]
        return min(changed, default=None)

    def left_out(self, since: int) -> list[tuple[str, range]]:
        """Return which rows of which residual stand on samples of an excursion, of those that go on after a row."""
        spans = [rows for rows in map(self._rows, self.excursions) if rows.stop + max(self._reach.values()) > since]
        return [
            (output, range(max(rows.start - reach, 0), rows.stop + reach))
            for output, reach in self._reach.items()
            for rows in spans
        ]

    def hear(self, residuals: BankResiduals, first: int, rows: range) -> None:
        """Take what some rows make known of residuals, as `extend` takes it; rows that come again are passed over."""
        if rows.stop <= self._heard:
            return
        new = range(max(rows.start, self._heard), rows.stop)
        self._rises += rises_in(self._tracks, residuals, first, new, self._start_s)
        self._heard = rows.stop

    def alarms(self) -> Excursions:
        """Return the excursions with the alarms that they would have raised, as known by now."""
        spans = list(map(self._rows, self.excursions))
        recent = self._heard - 2 * self.horizon
        self._rises = [rise for rise in self._rises if rise.row >= recent or any(rise.row in rows for rows in spans)]
        end_s = float(even_times_s(self._start_s, self._period_s, range(self._taken - 1, self._taken))[0])
        return Excursions(self._monitor, self._start_s, self.excursions, self._rises, end_s - LATE_S)

    def _rows(self, excursion: Excursion) -> range:
        return rows_about(excursion, self._start_s, self._period_s)


_EVERY_S = 1.0  # a state is kept
_LOOKED_S = 0.25  # after so long, at the latest, motion is looked at where samples come one by one


class MotionStream(BankStream):
    """A bank's monitor that knows its regime, at work on samples as they come in; see the module's text."""

    def __init__(self, monitor: CalibratedBank, regime: Regime) -> None:
        super().__init__(monitor)
        self._around = Surroundings(monitor, regime)
        self._few = round(_LOOKED_S / self._period_s)
        self._most_back = self._around.horizon + self._few
        self._every = min(round(_EVERY_S / self._period_s), self._most_back)
        self._parts = (*self._tracks.values(), self._logic)  # that change with rows
        self._kept: list[tuple[int, list[dict[str, Any]]]] = []  # their states before some rows
        self._there: list[tuple[int, BoolArray]] = []  # which of the last samples are there, by the first row of each
        self._waiting: list[Record] = []  # rows that were taken one by one, whose motion hasn't been looked at

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise or tell more of, as `BankStream.push` does."""
        before = list(self._logic.alarms)
        super().push(chunk)
        return _news(before, self._logic.alarms)

    def _is_few(self, chunk: Record) -> bool:
        at = self._memory.stop - self._around.horizon
        return super()._is_few(chunk) and not any(rows.stop > at for _, rows in self._left_out)

    def _take_few(self, chunk: Record, columns: list[int]) -> tuple[Alarm, ...]:
        self._keep()
        told = super()._take_few(chunk, columns)
        if self._waiting and self._waiting[-1].channels != chunk.channels:
            self._look_around()
        self._waiting.append(chunk)
        if told or sum(map(len, self._waiting)) >= self._few:
            self._look_around()
        return told

    def _take_many(self, chunk: Record, columns: list[int]) -> tuple[Alarm, ...]:
        """Take samples together; where their motion tells otherwise of rows before, with these."""
        self._look_around()
        return self._take(*self._with_earlier(self._around.take(chunk), *self._laid(chunk, columns)))

    def _take(self, values: FloatArray, there: BoolArray) -> tuple[Alarm, ...]:
        late = max(len(values) - self._most_back, 0)
        for rows in (slice(late), slice(late, None)):
            if len(values[rows]):
                self._keep()
                self._note(self._memory.stop, there[rows])
                super()._take(values[rows], there[rows])
        return ()

    def _judged_of(self, residuals: BankResiduals, first: int, rows: range) -> BankResiduals:
        """Return residuals without what stands on excursions."""
        self._hear(residuals, first, rows)
        return super()._judged_of(residuals, first, rows)

    def _hear(self, residuals: BankResiduals, first: int, rows: range) -> None:
        self._around.hear(residuals, first, rows)
        self._logic.excursions = self._around.alarms()

    def _look_around(self) -> None:
        """Look at the motion of rows that were taken one by one; where rows were beyond, take them again."""
        if not self._waiting:
            return
        rows, self._waiting = joined(self._waiting), []
        stop = self._memory.stop
        first = max(stop - len(rows) - self._reach, 0)
        self._note(stop - len(rows), np.isfinite(self._memory.record(range(stop - len(rows), stop)).values))
        changed = self._around.take(rows)
        self._hear(bank_residuals(self._monitor, self._memory.record(range(first, stop))), first, range(first, stop))
        none = np.zeros((0, len(self._memory.taken))), np.zeros((0, len(self._memory.channels)), dtype=bool)
        values, there = self._with_earlier(changed, *none)
        if len(values):
            self._take(values, there)

    def _with_earlier(self, changed: int | None, values: FloatArray, there: BoolArray) -> tuple[FloatArray, BoolArray]:
        """Return rows with those before that have to be taken again, for from a row on something else is left out."""
        if changed is not None and changed < self._memory.stop:
            earlier, was_there = self._go_back(changed)
            values, there = np.concatenate([earlier, values]), np.concatenate([was_there, there])
        self._left_out = self._around.left_out(self._memory.first)
        self._memory.leave_out(self._left_out)
        return values, there

    def _note(self, row: int, there: BoolArray) -> None:
        """Note which samples are there of the rows from one on, but for those that were noted before."""
        noted = self._there[-1][0] + len(self._there[-1][1]) if self._there else row
        self._there.append((max(row, noted), there[max(noted - row, 0) :]))

    def _keep(self) -> None:
        """Keep the state where the last is old; forget those that nobody goes back to."""
        stop = self._memory.stop
        if self._kept and stop - self._kept[-1][0] < self._every:
            return
        memo = {id(each): each for each in self._shared()}
        self._kept.append((stop, [copy.deepcopy(vars(part), memo) for part in self._parts]))
        old = sum(row <= stop - self._most_back for row, _ in self._kept)
        self._kept = self._kept[max(old - 1, 0) :]
        self._there = [part for part in self._there if part[0] + len(part[1]) > self._kept[0][0]]

    def _go_back(self, row: int) -> tuple[FloatArray, BoolArray]:
        """Go back to a state before a row; return what has to be taken again, and which of that is there."""
        self._kept = [kept for kept in self._kept if kept[0] <= row] or self._kept[:1]
        stop, states = self._kept.pop()
        for part, state in zip(self._parts, states, strict=True):
            vars(part).clear()
            vars(part).update(state)
        there = np.concatenate([part[max(stop - first, 0) :] for first, part in self._there])
        self._there = []
        return self._memory.back_to(stop), there

    def _shared(self) -> Iterator[object]:
        """Give what states share: it is never changed."""
        yield from (self._memory, *self._tracks.values())
        yield from shared_values(self._monitor, self._logic)


def _news(before: Sequence[Alarm], now: Sequence[Alarm]) -> tuple[Alarm, ...]:
    """Return the alarms that are others than before; one that isn't there any more has passed."""
    gone = [
        replace(alarm, judgements=(*alarm.judgements, Judgement(time_s=alarm.time_s, sensor=None, candidates=())))
        for alarm in before[len(now) :]
    ]
    return (*(alarm for i, alarm in enumerate(now) if before[i : i + 1] != [alarm]), *gone)
