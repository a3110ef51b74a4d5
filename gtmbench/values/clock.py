"""Even time stamps: what they are, which period they show, and what contradicts them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError

FloatArray = NDArray[np.float64]
Value = TypeVar("Value", float, FloatArray)  # of formulas that hold for a number and for an array of them

SLACK = 0.1  # of a sample: how far from its place a chunk's first stamp may stand, for times are rounded


def same_period(one_s: float, other_s: float) -> bool:
    """Tell whether two sample periods are one, but for rounding."""
    return abs(one_s - other_s) <= 1e-6 * other_s


def lateness_s(start_s: float, due_s: float, sample_period_s: float) -> float:
    """Return how late a chunk begins, 0 where it continues what was before; refuse one that begins before.

    >>> lateness_s(3.001, 3.0, 0.02), lateness_s(4.0, 3.0, 0.02)
    (0.0, 1.0)
    """
    late_s = start_s - due_s
    if not late_s > -SLACK * sample_period_s:
        raise InputError(
            f"the chunk begins at {start_s:.10g} s, but {due_s:.10g} s is next; leave out what came before or begin a "
            "new stream"
        )
    return late_s if late_s >= SLACK * sample_period_s else 0.0


def even_times_s(start_s: float, sample_period_s: float, samples: range) -> FloatArray:
    """Return the times of some samples in seconds, rounded to the nanosecond.

    >>> even_times_s(25.0, 0.01, range(100, 102))
    array([26.  , 26.01])
    """
    time_s = np.arange(samples.start, samples.stop, dtype=np.float64)
    time_s *= sample_period_s
    np.round(time_s, 9, out=time_s)
    time_s += start_s
    return time_s


def even_period_s(time_s: FloatArray) -> float:
    """Return the sample period of evenly spaced stamps; a period whose rate is a whole number of Hz is exact."""
    if len(time_s) < 2:
        raise InputError(f"{len(time_s)} time stamps give no sample period; give at least 2, or sample_period_s")
    if not np.all(np.isfinite(time_s)):
        row = int(np.flatnonzero(~np.isfinite(time_s))[0])
        raise InputError(f"time stamp of row {row} is {time_s[row]}; every row needs its time in seconds")
    steps = np.diff(time_s)
    period = float(np.median(steps))
    if period <= 0:
        raise InputError(f"time runs backwards or stands still (median step {period:g} s); sort and clean the rows")
    grain = 2e-9 + 2.0 * float(np.spacing(np.abs(time_s).max()))  # stamps are rounded to ns, and to doubles
    uneven = np.flatnonzero(np.abs(steps - period) > 1e-3 * period + grain)
    if len(uneven):
        row = int(uneven[0])
        what = "a gap" if steps[row] > period else "a doubled or early stamp"
        raise InputError(
            f"{what} after t = {time_s[row]:g} s (row {row}): the next stamp comes {steps[row]:g} s later, the others "
            f"every {period:g} s; split the log there or resample it (or state sample_period_s, if stamps are rounded)"
        )
    mean = float((time_s[-1] - time_s[0]) / (len(time_s) - 1))
    for candidate in (1.0 / max(round(1.0 / mean), 1), round(mean, 6), round(mean, 9)):
        if abs(candidate - mean) <= 2.0 * grain / (len(time_s) - 1):
            return candidate
    return mean


def check_span(time_s: FloatArray, sample_period_s: float) -> None:
    """Refuse stamps that a stated period contradicts: rows are missing, or it is another period.

    Stamps may be rounded (to more than a period even: then some are equal, and they step by their grain) and their
    clock may drift by 1 %.
    """
    steps = np.diff(time_s)
    grain = float(steps[steps > 0].min(initial=np.inf)) if np.any(steps == 0) else 0.0
    stated_s, shown_s = len(steps) * sample_period_s, float(time_s[-1] - time_s[0])
    row = int(np.argmax(steps))
    if (
        not steps[row] < 1.5 * sample_period_s + grain
        or abs(shown_s - stated_s) > 0.01 * stated_s + sample_period_s + grain
    ):
        raise InputError(
            f"{len(time_s)} rows every {sample_period_s:g} s last {stated_s:.10g} s, but their stamps go from "
            f"{time_s[0]:.10g} to {time_s[-1]:.10g} s (the greatest step, {steps[row]:g} s, is after "
            f"{time_s[row]:.10g} s, row {row}): rows are missing or the period is another; split the log "
            "there or correct the period"
        )


@dataclass(frozen=True, kw_only=True)
class ChunkClock:
    """Where a stream stands: after `count` rows of one source, evenly spaced from `start_s` on."""

    start_s: float
    sample_period_s: float
    source: str
    count: int

    @classmethod
    def of(cls, time_s: FloatArray, sample_period_s: float, source: str) -> ChunkClock:
        """Return the clock of a chunk that stands alone, by the times of its rows."""
        start_s = float(time_s[0]) if len(time_s) else float("nan")
        return cls(start_s=start_s, sample_period_s=sample_period_s, source=source, count=len(time_s))

    def known(self, rows: int, behind: int) -> range:
        """Return the results that the last `rows` rows made known, each of them `behind` rows after its own."""
        return range(max(self.count - rows - behind, 0), max(self.count - behind, 0))

    def times_s(self, rows: range) -> FloatArray:
        """Return times as the whole record has them."""
        return even_times_s(self.start_s, self.sample_period_s, rows)


def advanced(clock: ChunkClock | None, chunk: ChunkClock) -> ChunkClock:
    """Return the clock after a chunk. InputError where the chunk doesn't continue what was before."""
    if clock is None or clock.count == 0:
        return chunk
    if chunk.source != clock.source:
        raise InputError(f"a chunk of {chunk.source} came after {clock.source}; give each a stream of its own")
    if not same_period(chunk.sample_period_s, clock.sample_period_s):
        raise InputError(
            f"the chunk is sampled every {chunk.sample_period_s:.10g} s, those before every "
            f"{clock.sample_period_s:.10g} s; resample it or begin a new stream"
        )
    due_s = clock.start_s + clock.count * clock.sample_period_s
    if chunk.count and lateness_s(chunk.start_s, due_s, clock.sample_period_s):
        raise InputError(
            f"the chunk begins at {chunk.start_s:.10g} s, but {due_s:.10g} s is next; fill the gap with NaN or begin a "
            "new stream"
        )
    return replace(clock, count=clock.count + chunk.count)
