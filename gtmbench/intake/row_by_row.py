"""Rows as they come in, laid on a clock that is known before: a monitor's. Nothing waits for the end of a log.

`open_log` looks at all of a clock before it says what it is. A live source has no end, so here the clock is given, and
rows are laid on it as `open_log` lays a log's (`resampling.laid`): as they are where they stand on it, else by cubics
and, where they come faster, a low-pass, so a clock may drift, stamps may jitter, and rows may be lost or sent twice; a
pause is a gap. A row waits for the few samples behind it that it depends on. Late rows, readings that are only repeated
and columns with stamps of their own are refused, with the reason: `open_log` mends them, and needs the whole log to.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import naming
from gtmbench.errors import InputError
from gtmbench.intake.formats.raw import RawLog, origin_of
from gtmbench.intake.formats.registry import read_raw
from gtmbench.intake.fresh_samples import SENSORS, fresh_rows
from gtmbench.intake.lattice import GRAINS_S, JITTER, is_rounded, typical_period
from gtmbench.intake.mapping import ChosenColumn, Turns, choose, choose_of, split_mapping
from gtmbench.intake.resampling import AFTER, HALF, PAUSE, Places, laid, low_passed, nominal, oversampling
from gtmbench.intake.stamps import LATEST_S, NEAR, in_their_places, is_waited_for, own_rows
from gtmbench.intake.times import beyond_seconds, time_column
from gtmbench.values.clock import FloatArray, same_period
from gtmbench.values.record import BoolArray, Record

Rows = tuple[FloatArray, BoolArray]  # values, and where a sample is there, if not known


class Laying:
    """A stretch without a gap, laid on an even clock from its first sample on.

    Rows are those that `resampled` makes of the whole stretch. One on which a sample stands is given with that sample,
    one between samples with the `AFTER`-th sample behind it, of a source that is filtered `HALF` rows later than that.

    `start_s`: the first sample's time. `period_s`, `typical_s`: the rows' period, and the samples'. `filtered`: whether
    a low-pass follows; by default only where the samples come faster than the rows. A track beside one that is filtered
    has to be filtered alike.

    >>> laying = Laying(5.0, 0.1, 0.1, 1)
    >>> laying.push(np.array([5.0, 5.1]), np.array([[1.0], [2.0]]))[0].ravel()
    array([1., 2.])
    >>> laying.push(np.array([5.25, 5.35]), np.array([[3.5], [4.5]]))[0].ravel()
    array([], dtype=float64)
    >>> laying.end()[0].ravel(), laying.count
    (array([3., 4.]), 4)
    """

    def __init__(
        self, start_s: float, period_s: float, typical_s: float, channels: int, *, filtered: bool | None = None
    ) -> None:
        finer = oversampling(typical_s, period_s)
        self._filtered = finer > 1 if filtered is None else filtered
        self._places = Places(start_s=start_s, period_s=period_s, typical_s=typical_s, finer=finer)
        self._near = self._places.near_s / self._places.step_s
        self._time_s, self._values = np.zeros(0), np.zeros((0, channels))
        self._next = 0  # place
        self._laid: Rows = np.zeros((0, channels)), np.zeros((0, channels), dtype=bool)  # that a filter still needs
        self.count = HALF if self._filtered else 0
        """The next row: so many periods after the start."""

    def push(self, time_s: FloatArray, values: FloatArray) -> Rows:
        """Return the rows that some samples complete."""
        self._time_s = np.concatenate([self._time_s, time_s])
        self._values = np.concatenate([self._values, values])
        if self._are_next(time_s, values):
            self._next += len(time_s)
            self.count += len(time_s)
            rows = values, np.ones(values.shape, dtype=bool)
        else:
            rows = self._laid_to(self._final())
        if len(self._time_s) > 2 * self._places.before:
            first = int(np.searchsorted(self._time_s, self._places.start_s + self._next * self._places.step_s))
            first = max(first - self._places.before, 0)
            self._time_s, self._values = self._time_s[first:], self._values[first:]
        return rows

    def end(self) -> Rows:
        """Return the rows up to the last sample."""
        stop = int(np.floor(self._place(self._time_s[-1:])[0] + 1e-6)) + 1 if len(self._time_s) else 0
        return self._laid_to(max(stop, self._next))

    def _place(self, time_s: FloatArray) -> FloatArray:
        return (time_s - self._places.start_s) / self._places.step_s

    def _are_next(self, time_s: FloatArray, values: FloatArray) -> bool:
        """Tell whether samples are the next rows, one by one."""
        places = self._place(time_s) - np.arange(self._next, self._next + len(time_s))
        return not self._filtered and bool(np.all(np.abs(places) <= self._near)) and bool(np.isfinite(values).all())

    def _final(self) -> int:
        """Return the place before which no later sample changes anything."""
        latest = self._values[-AFTER:]
        if len(latest) == AFTER and np.isfinite(latest).all():
            final_s = float(self._time_s[-AFTER])
        else:
            final_s = min(self._known_s(self._time_s[known]) for known in np.isfinite(self._values).T)
        stop = int(np.floor(self._place(np.array([final_s]))[0])) + 1 if np.isfinite(final_s) else 0
        stop = max(stop, self._next)
        first = int(np.searchsorted(self._time_s, self._places.start_s + (stop - 0.5) * self._places.step_s))
        off = self._place(self._time_s[first:]) - np.arange(stop, stop + len(self._time_s) - first)
        stands = (np.abs(off) <= self._near) & np.isfinite(self._values[first:]).all(axis=1)
        return stop + (len(stands) if stands.all() else int(np.argmin(stands)))

    def _known_s(self, own_s: FloatArray) -> float:
        """Return until when a channel whose samples are at some times is known: while it pauses, until now."""
        now_s = float(self._time_s[-1])
        if not len(own_s) or now_s - own_s[-1] > self._places.longest_s:
            return now_s
        return float(own_s[-AFTER]) if len(own_s) >= AFTER else -np.inf

    def _laid_to(self, stop: int) -> Rows:
        """Return the rows that the places before one complete, and go on to it."""
        finer = self._places.finer
        if self._filtered:  # no further than to the last place that a row's filter needs
            stop = max((stop - 1) // finer * finer + 1, self._next)
        if stop - self._next < (1 if not self._filtered else (self.count + HALF) * finer + 1 - self._next):
            return self._values[:0], np.zeros((0, self._values.shape[1]), dtype=bool)
        first = int(np.searchsorted(self._time_s, self._places.start_s + self._next * self._places.step_s))
        used = slice(max(first - self._places.before, 0), None)
        rows = laid(self._places, self._time_s[used], self._values[used], self._next, stop)
        self._next = stop
        if self._filtered:
            values, there = (np.concatenate(both) for both in zip(self._laid, rows, strict=True))
            count = (len(values) - 1) // finer + 1 - 2 * HALF
            self._laid = values[count * finer :], there[count * finer :]
            rows = low_passed(values, finer), there[HALF * finer :: finer][:count]
        self.count += len(rows[0])
        return rows


_WHOLE = "open the log as a whole"
_EXACT_S = 1e-9  # of stamps: their rounding
_SURE = 30  # steps, by which a source's period is known
_RawRows = tuple[FloatArray, FloatArray]  # times, and values
_SELDOM = 0.45  # of a monitor's rate: what comes more seldom isn't watched by it


class LiveClock:
    """An even clock on which rows are laid as they come in.

    >>> clock = LiveClock(["p"], 0.1)
    >>> clock.push(np.array([5.0, 5.1]), np.array([[1.0], [2.0]]))
    (Record(2 samples, 5..5.1 s, every 0.1 s: p),)
    >>> [(chunk.start_s, chunk["p"].tolist()) for chunk in clock.push(np.array([5.3, 9.0]), np.array([[4.0], [5.0]]))]
    [(5.2, [nan, 4.0]), (9.0, [5.0])]
    """

    def __init__(self, channels: Sequence[str], sample_period_s: float) -> None:
        self._channels, self._period_s = tuple(channels), sample_period_s
        self._typical_s: float | None = None  # the rows' own period
        self._held = np.zeros(0), np.zeros((0, len(self._channels)))  # until that is known
        self._last = self._held  # the row before, where there is one
        self._stamps = EvenStamps(sample_period_s)
        self._laying: Laying | None = None  # since the last gap
        self._start_s = 0.0

    def push(self, time_s: FloatArray, values: FloatArray) -> tuple[Record, ...]:
        """Return what some rows complete: a record, more where there are gaps; often none."""
        known = np.abs(time_s) < LATEST_S
        time_s = np.concatenate([self._held[0], time_s[known]])
        values = np.concatenate([self._held[1], values[known]])
        typical_s = self._typical_s or self._typical_of(time_s)
        if typical_s is None:
            self._held = time_s, values
            return ()
        return self._taken(time_s, values, typical_s)

    def end(self) -> tuple[Record, ...]:
        """Return what is left to be told, now that no row follows."""
        return (*self._taken(*self._held, self._typical_s or self._period_s, is_last=True), *self._ended())

    def _typical_of(self, time_s: FloatArray) -> float | None:
        steps = np.diff(time_s)
        if len(steps) and np.all(np.abs(steps[:_SURE] - self._period_s) <= 2.0 * JITTER * self._period_s):
            return self._period_s
        forwards = steps[steps > 0]
        own_s = typical_period(forwards) if len(forwards) >= _SURE else None
        return None if own_s is None else nominal(own_s, self._period_s)

    def _taken(
        self, time_s: FloatArray, values: FloatArray, typical_s: float, *, is_last: bool = False
    ) -> tuple[Record, ...]:
        check_rate(typical_s, self._period_s)
        time_s, values, waiting = self._once(time_s, values, typical_s, is_last)
        self._typical_s, self._held = typical_s, waiting
        if not len(time_s):
            return ()
        longest_s = PAUSE * max(typical_s, self._period_s)
        gaps = np.flatnonzero(np.diff(time_s, prepend=self._last[0]) > longest_s) + 1 - len(self._last[0])
        self._last = time_s[-1:], values[-1:]
        chunks: list[Record] = []
        for first, stop in pairwise([0, *gaps[gaps > 0].tolist(), len(time_s)]):
            if self._laying is None or first in gaps:
                chunks += self._ended()
                self._start_s = float(time_s[first])
                self._stamps.begin(self._start_s)
                self._laying = Laying(self._start_s, self._period_s, typical_s, len(self._channels))
            at_s = time_s[first:stop]
            if same_period(typical_s, self._period_s):
                at_s = self._stamps.even(at_s)
            chunks += self._record(self._laying.count, self._laying.push(at_s, values[first:stop]))
        return tuple(chunks)

    def _ended(self) -> list[Record]:
        """End the stretch, where there is one."""
        if self._laying is None:
            return []
        count, rows = self._laying.count, self._laying.end()
        self._laying = None
        return self._record(count, rows)

    def _record(self, count: int, rows: Rows) -> list[Record]:
        if not len(rows[0]):
            return []
        chunk = Record(
            rows[0],
            channels=self._channels,
            sample_period_s=self._period_s,
            start_s=self._start_s + round(count * self._period_s, 9),
            there=rows[1],
        )
        return [chunk]

    def _once(
        self, time_s: FloatArray, values: FloatArray, typical_s: float, is_last: bool
    ) -> tuple[FloatArray, FloatArray, _RawRows]:
        """Return rows without those that are stamped as the one before is, and such as wait for the next.

        As `single` has it: rows of one time after a pause as long as all of them were measured in it.
        """
        before, near_s = len(self._last[0]), NEAR * typical_s
        if before and len(time_s):
            own = np.diff(time_s, prepend=self._last[0])
            if own.min() >= near_s and not is_waited_for(float(own[-1]), typical_s):
                return time_s, values, (time_s[:0], values[:0])  # as nearly always
        time_s, values = np.concatenate([self._last[0], time_s]), np.concatenate([self._last[1], values])
        latest_s = np.maximum.accumulate(time_s)
        steps = time_s[1:] - latest_s[:-1]
        lacks = np.any(np.isnan(values[:-1]) & np.isfinite(values[1:]), axis=1)
        wrong = np.flatnonzero((steps < near_s) & (lacks | (steps <= -near_s)))
        if len(wrong):
            row_s, after_s = time_s[wrong[0] + 1], latest_s[wrong[0]]
            raise InputError(f"a row of {row_s:.10g} s comes after {after_s:.10g} s: late, or another; {_WHOLE}")
        apart = np.flatnonzero(np.append(True, steps >= near_s)[: len(time_s)])
        stop = len(time_s)
        if not is_last and len(apart) > 1 and apart[-1] >= before and is_waited_for(steps[apart[-1] - 1], typical_s):
            stop = int(apart[-1])
        waiting = time_s[stop:], values[stop:]
        values = values[:stop]
        moved_s = in_their_places(time_s[:stop], values, typical_s)
        kept = np.flatnonzero(np.append(True, np.diff(np.maximum.accumulate(moved_s)) >= near_s)[:stop])
        kept = kept[kept >= before]
        return moved_s[kept], values[kept], waiting


class EvenStamps:
    """Stamps that stand on an even clock but for rounding, or a little jitter, as `find_lattice` takes them."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._grains_s = [each_s for each_s in GRAINS_S if JITTER * period_s < 0.51 * each_s <= 0.51 * 0.4 * period_s]
        self._is_even = True
        self.begin(0.0)

    def begin(self, start_s: float) -> None:
        """Begin after a gap."""
        self._start_s, self._least_s, self._most_s = start_s, -_EXACT_S, _EXACT_S

    def even(self, time_s: FloatArray) -> FloatArray:
        """Return where some stamps stand."""
        if not self._is_even:
            return time_s
        self._grains_s = [grain_s for grain_s in self._grains_s if is_rounded(time_s, grain_s)]
        places = np.rint((time_s - self._start_s) / self._period_s)
        even_s = self._start_s + places * self._period_s
        off_s = time_s - even_s
        if np.abs(off_s).max(initial=0.0) <= min(-self._least_s, self._most_s):
            return even_s
        most_s = np.maximum.accumulate(np.append(self._most_s, off_s))[1:]
        least_s = np.minimum.accumulate(np.append(self._least_s, off_s))[1:]
        tolerance_s = max([0.51 * grain_s for grain_s in self._grains_s[:1]] + [JITTER * self._period_s])
        stands = 0.5 * (most_s - least_s) <= tolerance_s
        self._most_s, self._least_s, self._is_even = float(most_s[-1]), float(least_s[-1]), bool(stands.all())
        return np.where(stands, even_s, time_s)


def is_too_seldom(source_s: float, sample_period_s: float) -> bool:
    """Tell whether samples come too seldom for a monitor: what is as fast as it watches isn't in them."""
    return source_s * _SELDOM > sample_period_s


def check_rate(source_s: float, sample_period_s: float, what: str = "the rows") -> None:
    """Refuse samples that come too seldom for a monitor.

    >>> check_rate(0.1, 0.01)
    Traceback (most recent call last):
    gtmbench.errors.InputError: the rows come at 10 Hz, and the monitor watches at 100 Hz: what is so fast isn't in ...
    """
    if is_too_seldom(source_s, sample_period_s):
        raise InputError(
            f"{what} come at {1.0 / source_s:.3g} Hz, and the monitor watches at {1.0 / sample_period_s:.3g} Hz: what "
            "is so fast isn't in them; take a monitor of their rate, or one that is identified on the log"
        )


def live_chunks(
    path: str | Path,
    sample_period_s: float,
    *,
    needs: Sequence[str],
    witnesses: Sequence[str] = (),
    mapping: Sequence[str] = (),
) -> Iterator[Record]:
    """Give a table's rows as a live source would send them, on a clock that is known: a piece at a time, none kept."""
    path, columns = Path(path), split_mapping(mapping)
    raw = read_raw(path)
    with naming(path):
        time, per_second = _time(raw, columns.pop("time", None))
        chosen = choose(raw, columns, needs)
        chosen += choose_of([name for name in witnesses if name not in needs], raw, columns)
        if any(choice.late_s for choice in chosen):
            raise InputError(f"a column that is stamped late (@) isn't read row by row; {_WHOLE}")
        clock: LiveClock | None = None
        turns, origin = Turns(), None
        assert raw.batches is not None  # the time wouldn't be known
        for batch in raw.batches(list(dict.fromkeys([time, *(choice.series.name for choice in chosen)]))):
            stamps = batch[time]
            with np.errstate(all="ignore"):  # broken logs hold signalling NaNs and numbers that overflow
                values = np.column_stack([_brought(choice, batch, turns) for choice in chosen])
                if clock is None:
                    origin = origin_of(stamps, per_second)
                    chosen, values = _shared(chosen, needs, stamps, values)
                    channels = [choice.channel for choice in chosen]
                    _check_fresh(channels, values)
                    clock = LiveClock(channels, sample_period_s)
                time_s = (stamps if origin is None else stamps - origin).astype(np.float64) / per_second
                chunks = clock.push(time_s, values)
            yield from chunks
        if clock is not None:
            yield from clock.end()


def _time(raw: RawLog, mapped: str | None) -> tuple[str, float]:
    """Return the column that tells the time, and how many of its units are a second."""
    if raw.batches is None:
        raise InputError(f"read as {raw.kind}: no part of it can be read alone, as of Parquet; {_WHOLE}")
    series, _, per_second = time_column(raw, mapped)
    if beyond_seconds(raw, series) is not None or series.unit:  # dates are stated in seconds
        raise InputError(f"column '{series.name}' holds dates, or whole seconds only; {_WHOLE}")
    return series.name, per_second


def _brought(choice: ChosenColumn, batch: Mapping[str, NDArray[Any]], turns: Turns) -> FloatArray:
    """Return a batch of a channel, in its unit."""
    values: FloatArray = batch[choice.series.name].astype(np.float64)
    choice.bring(values, turns)
    return values


def _shared(
    chosen: Sequence[ChosenColumn], needs: Sequence[str], stamps: NDArray[Any], values: FloatArray
) -> tuple[list[ChosenColumn], FloatArray]:
    """Return the channels that share the table's stamps, as far as their first piece shows; a needed one has to."""
    at = stamps.astype(np.float64)
    own = [own_rows(at, np.isfinite(column)) is not None for column in values.T]
    alone = [choice.channel for choice, is_own in zip(chosen, own, strict=True) if is_own and choice.channel in needs]
    if alone:
        raise InputError(f"{', '.join(alone)}: samples at stamps of their own; {_WHOLE}")
    return [choice for choice, is_own in zip(chosen, own, strict=True) if not is_own], values[:, ~np.array(own)]


def _check_fresh(channels: Sequence[str], values: FloatArray) -> None:
    """Refuse readings that are only repeated, as far as the first piece shows."""
    for sensor in SENSORS:
        places = [place for place, name in enumerate(channels) if name in sensor]
        if len(places) > 1 and fresh_rows(values[:, places]) is not None:
            named = ", ".join(channels[place] for place in places)
            raise InputError(f"{named}: readings are repeated, fresh ones come more slowly; {_WHOLE}")
