"""Rows as they come in, laid on a clock that is known before: a monitor's. Nothing waits for the end of a log.

`open_log` looks at all of a clock before it says what it is. A live source has no end, so here the clock is given, and
stamps have to stand on it: samples may be left out and rows sent twice, what is longer than that is a gap. Everything
else (another rate, a clock that drifts, late rows, readings that are only repeated) is refused, with the reason:
`open_log` mends it, and needs the whole log to.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import naming
from gtmbench.clock import FloatArray
from gtmbench.errors import InputError
from gtmbench.intake.formats.raw import RawLog, measured, origin_of
from gtmbench.intake.formats.registry import read_raw
from gtmbench.intake.fresh import SENSORS, fresh_rows
from gtmbench.intake.lattice import JITTER
from gtmbench.intake.mapping import Chosen, Turns, choose, choose_of, split_mapping
from gtmbench.intake.resampling import PAUSE
from gtmbench.intake.stamps import LATEST_S, NEAR, own_rows
from gtmbench.intake.times import beyond_seconds, time_column
from gtmbench.record import Record

_WHOLE = "open the log as a whole"


class LiveClock:
    """An even clock on which rows are laid as they come in.

    Parameters
    ----------
    channels : sequence of str
    sample_period_s : float

    Examples
    --------
    >>> clock = LiveClock(["p"], 0.1)
    >>> clock.push(np.array([5.0, 5.1]), np.array([[1.0], [2.0]]))
    (Record(2 samples, 5..5.1 s, every 0.1 s: p),)
    >>> [(chunk.start_s, chunk["p"].tolist()) for chunk in clock.push(np.array([5.3, 9.0]), np.array([[4.0], [5.0]]))]
    [(5.2, [nan, 4.0]), (9.0, [5.0])]
    """

    def __init__(self, channels: Sequence[str], sample_period_s: float) -> None:
        self._channels, self._period_s = tuple(channels), sample_period_s
        self._start_s, self._count = 0.0, 0  # of the stretch since the last gap
        self._last_s, self._last = np.zeros(0), np.zeros((0, len(self._channels)))  # the row before, where there is one

    def push(self, time_s: FloatArray, values: FloatArray) -> tuple[Record, ...]:
        """Return what some rows make: a record, more where there are gaps; none where they only repeat the one before.

        A record continues the one before where it begins a sample after it; else there is a gap.

        Raises
        ------
        InputError
            Where stamps don't stand on the clock; nothing is changed then.
        """
        known = np.abs(time_s) < LATEST_S
        time_s = np.concatenate([self._last_s, time_s[known]])
        values = np.concatenate([self._last, values[known]])
        kept = self._once(time_s, values)
        time_s, values, begins = time_s[kept], values[kept], len(self._last_s)
        if len(time_s) == begins:
            return ()
        gaps = np.flatnonzero(np.diff(time_s) > PAUSE * self._period_s) + 1
        chunks, start_s, count = [], self._start_s, self._count
        for first, stop in pairwise([begins, *gaps[gaps > begins].tolist(), len(time_s)]):
            if first == 0 or first in gaps:
                start_s, count = float(time_s[first]), 0
            chunk = self._laid(time_s[first:stop], values[first:stop], start_s, count)
            chunks.append(chunk)
            count += len(chunk)
        self._start_s, self._count, self._last_s, self._last = start_s, count, time_s[-1:], values[-1:]
        return tuple(chunks)

    def _once(self, time_s: FloatArray, values: FloatArray) -> NDArray[np.int64]:
        """Return the rows that aren't the one before, sent again."""
        steps = np.diff(time_s)
        near = np.abs(steps) < NEAR * self._period_s
        same = np.all((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1])), axis=1)
        wrong = np.flatnonzero((near & ~same) | (~near & (steps < 0.0)))
        if len(wrong):
            row_s, after_s = time_s[wrong[0] + 1], time_s[wrong[0]]
            raise InputError(f"a row of {row_s:.10g} s comes after {after_s:.10g} s: late, or another; {_WHOLE}")
        return np.flatnonzero(np.concatenate([[True], ~near])) if len(time_s) else np.zeros(0, dtype=np.int64)

    def _laid(self, time_s: FloatArray, values: FloatArray, start_s: float, count: int) -> Record:
        places = (time_s - start_s) / self._period_s
        nearest = np.rint(places)
        off = np.abs(places - nearest) > JITTER
        if off.any():
            place = int(np.argmax(off))
            raise InputError(
                f"the stamp {time_s[place]:.10g} s stands {abs(places[place] - nearest[place]):.2g} of a sample beside "
                f"the monitor's clock, every {self._period_s:g} s since {start_s:.10g} s: another rate, or one that "
                f"drifts; {_WHOLE}"
            )
        rows = nearest.astype(np.int64) - count
        laid = np.full((int(rows[-1]) + 1, len(self._channels)), np.nan, order="F")
        laid[rows] = values
        there = np.ones(laid.shape, dtype=bool)  # a sample that was left out of all channels is no sensor's
        there[rows] = np.isfinite(values)
        return Record(
            laid,
            channels=self._channels,
            sample_period_s=self._period_s,
            start_s=start_s + round(count * self._period_s, 9),
            there=there,
        )


def live_chunks(
    path: str | Path,
    sample_period_s: float,
    *,
    needs: Sequence[str],
    witnesses: Sequence[str] = (),
    mapping: Sequence[str] = (),
) -> Iterator[Record]:
    """Give a table's rows as a live source would send them, on a clock that is known: a piece at a time, none kept.

    Parameters
    ----------
    path : str or Path
        Parquet: of other formats no part can be read alone.
    sample_period_s : float
        Of the monitor.
    needs, witnesses, mapping : sequence of str
        As `open_log` takes them.

    Raises
    ------
    InputError
        Where it can't be read so, saying why; that may turn up late.
    """
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
        for batch in _batches(raw, [time, *(choice.series.name for choice in chosen)]):
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


def _time(raw: RawLog, mapped: str | None) -> tuple[str, float]:
    """Return the column that tells the time, and how many of its units are a second."""
    if raw.batches is None:
        raise InputError(f"read as {raw.kind}: no part of it can be read alone, as of Parquet; {_WHOLE}")
    series, _, per_second = time_column(raw, mapped)
    if beyond_seconds(raw, series) is not None or series.unit:  # dates are stated in seconds
        raise InputError(f"column '{series.name}' holds dates, or whole seconds only; {_WHOLE}")
    return series.name, per_second


def _batches(raw: RawLog, names: Sequence[str]) -> Iterator[Mapping[str, NDArray[Any]]]:
    assert raw.batches is not None  # the time wouldn't be known
    return raw.batches(list(dict.fromkeys(names)))


def _brought(choice: Chosen, batch: Mapping[str, NDArray[Any]], turns: Turns) -> FloatArray:
    """Return a batch of a channel, in its unit."""
    values: FloatArray = batch[choice.series.name].astype(np.float64)
    measured(values)
    choice.bring(values, turns)
    return values


def _shared(
    chosen: Sequence[Chosen], needs: Sequence[str], stamps: NDArray[Any], values: FloatArray
) -> tuple[list[Chosen], FloatArray]:
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
