"""Clocks as they were logged, put in order: stray, late and doubled stamps, and clocks that were set back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.flight_log import Remark, remark
from gtmbench.intake.lattice import rounded_coarsely
from gtmbench.values.clock import FloatArray
from gtmbench.values.pieces import joined, pieces
from gtmbench.values.record import BoolArray

IntArray = NDArray[np.int64]

FAR_S = 3600.0  # a step that is longer is no pause in logging: the clock was set
SHORTEST_STEP_S = 1e-9  # between samples; what is closer stands still
LATEST_S = 1e14  # three million years; what is later is no time
NEAR = 0.25  # of a period: stamps that are closer are one sample, logged twice
_FEW = 10  # samples: what goes astray and comes back within so few isn't a clock that was set
_MOST_STEPS_BACK = 0.1  # of the samples


@dataclass(frozen=True, kw_only=True, eq=False)
class Clock:
    """Stamps in order of time."""

    # which of the log's rows are kept, in order of time; a slice of all of them where nothing was to be done
    rows: IntArray | slice
    time_s: FloatArray  # when they are; several may be at one time


def cleaned(clocks: Mapping[str, FloatArray]) -> tuple[dict[str, Clock], tuple[float, ...], list[Remark]]:
    """Return clocks in order, the times at which they were set back, and remarks.

    What follows where a clock was set back is dated later than the log says, so that times stay in order. Stamps may
    stand there twice: which rows are one sample, their values tell (`single`).

    Raises an InputError where stamps are in no order, or some clocks were set back and others weren't.
    """
    if all(_is_in_order(time_s) for time_s in clocks.values()):
        return {name: Clock(rows=slice(None), time_s=time_s) for name, time_s in clocks.items()}, (), []
    remarks: list[Remark] = []
    by_clock = {name: _stretches(name, time_s, remarks) for name, time_s in clocks.items()}
    if len(set(map(len, by_clock.values()))) > 1:
        told = ", ".join(f"{name} {len(stretches) - 1} times" for name, stretches in by_clock.items())
        raise InputError(
            f"clocks were set back differently ({told}): which stretches belong together? cut the log there"
        )
    shifts_s, breaks_s = _shifts(clocks, list(by_clock.values()), remarks)
    ordered = {}
    for name, stretches in by_clock.items():
        times = [
            clocks[name][rows] + shift_s if shift_s else clocks[name][rows]
            for rows, shift_s in zip(stretches, shifts_s, strict=True)
        ]
        ordered[name] = Clock(rows=np.concatenate(stretches), time_s=np.concatenate(times))
    return ordered, tuple(breaks_s), remarks


def cleaned_alone(time_s: FloatArray) -> Clock | None:
    """Return one clock in order; None where it is in none, or was set back: what follows is dated later than logged."""
    try:
        clocks, breaks_s, _ = cleaned({"": time_s})
    except InputError:
        return None
    return None if breaks_s else clocks[""]


def _is_in_order(time_s: FloatArray) -> bool:
    """Tell whether stamps are all there and never step back or far: then there is nothing to clean."""
    if len(time_s) < 2 or not time_s[-1] - time_s[0] > SHORTEST_STEP_S * len(time_s):
        return False
    for rows in pieces(len(time_s) - 1):
        part = time_s[rows.start : rows.stop + 1]
        steps = np.diff(part)
        if not np.all((np.abs(part[1:]) < LATEST_S) & (steps >= 0.0) & (steps <= FAR_S)):
            return False
    return bool(abs(time_s[0]) < LATEST_S)


def _stretches(name: str, time_s: FloatArray, remarks: list[Remark]) -> list[IntArray]:
    """Return the rows between settings of a clock."""
    rows = np.flatnonzero(np.abs(time_s) < LATEST_S)
    if len(rows) < 2:
        raise InputError(f"{_label(name)}rows that have a time: {len(rows)}; a log has more")
    if len(rows) < len(time_s):
        lost = len(time_s) - len(rows)
        text = f"{_label(name)}{lost} rows have no time and are left out"
        remarks.append(remark("missing", time_s[rows[0]], time_s[rows[-1]], text))
    rows = _without_strays(name, rows, time_s, remarks)
    steps = np.diff(time_s[rows])
    period_s = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    cuts = np.flatnonzero((steps < 0) | (steps > FAR_S)) + 1
    if period_s < SHORTEST_STEP_S or len(cuts) > _FEW + _MOST_STEPS_BACK * len(rows):
        raise _in_no_order(name, steps)
    runs = np.split(rows, cuts)
    stretches: list[IntArray] = []
    for number, run in enumerate(runs):
        following = time_s[runs[number + 1][0]] if number + 1 < len(runs) else math.nan
        _join(stretches, remarks, name, run, time_s, following, period_s)
    stretches = [rows[np.argsort(time_s[rows], kind="stable")] for rows in stretches]
    if not any(np.diff(time_s[own]).any() for own in stretches):  # but for what was left out
        raise _in_no_order(name, steps)
    for own in stretches:
        steps = np.diff(time_s[own])
        # a clock may jump on by a month; what stands behind is no part of the same flight
        if steps.max(initial=0.0) > 3e6:
            place = int(steps.argmax())
            raise InputError(
                f"{_label(name)}the clock jumps on by {steps[place]:.4g} s behind {time_s[own[place]]:.10g} s; cut the "
                "log there, for no flight goes on so much later"
            )
    return stretches


def _in_no_order(name: str, steps: FloatArray) -> InputError:
    forward, back = np.count_nonzero(steps > 0), np.count_nonzero(steps < 0)
    return InputError(
        f"{_label(name)}time stands still or jumps: {forward} of {len(steps)} steps go forward, {back} back; "
        + ("sort the rows by time; or " if back else "")
        + "is this the column that tells the time? --map time=COLUMN:UNIT"
    )


def _without_strays(name: str, rows: IntArray, time_s: FloatArray, remarks: list[Remark]) -> IntArray:
    """Return the rows without single stamps that are far from where their neighbours stand."""
    steps = np.diff(time_s[rows])
    if len(steps) < 2 or not np.any(steps > 0):
        return rows
    period_s = float(np.median(steps[steps > 0]))
    far = np.abs(steps) > _FEW * period_s
    between = steps[1:] + steps[:-1]
    astray = np.flatnonzero(far[:-1] & far[1:] & (between >= 0) & (between < 3 * period_s)) + 1
    others = np.sort(np.delete(time_s[rows], astray))
    astray = np.array([row for row in astray if not _fills(others, time_s[rows[row]], period_s)], dtype=int)
    for row in astray:
        beside = time_s[rows[row - 1]]
        text = f"{_label(name)}a stamp of {time_s[rows[row]]:.10g} s stands beside {beside:.10g} s: its row is left out"
        remarks.append(remark("clock jump", beside, beside, text))
    return np.delete(rows, astray)


def _fills(time_s: FloatArray, stamp_s: float, period_s: float) -> bool:
    """Tell whether a stamp fits a place that others left free for one: then its row only stands somewhere else."""
    place = int(np.searchsorted(time_s, stamp_s))
    if not 0 < place < len(time_s):
        return False
    before_s, after_s = time_s[place - 1], time_s[place]
    return bool(after_s - before_s < 2.5 * period_s and abs(0.5 * (before_s + after_s) - stamp_s) < 0.25 * period_s)


def _join(
    stretches: list[IntArray],
    remarks: list[Remark],
    name: str,
    run: IntArray,
    time_s: FloatArray,
    following_s: float,
    period_s: float,
) -> None:
    """Add a run of rising stamps: to the stretch before, as a new one, or not at all."""
    if not stretches:
        stretches.append(run)
        return
    end_s, start_s = float(time_s[stretches[-1]].max()), float(time_s[run[0]])
    if len(run) < _FEW and abs(start_s - end_s) > 1.0 and end_s <= following_s <= end_s + FAR_S:
        text = f"{_label(name)}{len(run)} stamps around {start_s:.10g} s stand after {end_s:.10g} s: left out"
        remarks.append(remark("clock jump", end_s, end_s, text))
    elif start_s >= end_s:
        stretches[-1] = np.concatenate([stretches[-1], run])
    elif _is_late(time_s[stretches[-1]], time_s[run], period_s):
        stretches[-1] = np.concatenate([stretches[-1], run])
        text = f"{_label(name)}{start_s:.10g} s stands after {end_s:.10g} s: sorted"
        remarks.append(remark("out of order", start_s, end_s, text))
    else:
        stretches.append(run)


def _is_late(before: FloatArray, run: FloatArray, period_s: float) -> bool:
    """Tell samples that came late from a clock that was set back: late ones fill places that were left free."""
    end_s, start_s = before.max(), run[0]
    places = (end_s - start_s) / period_s + 1.0
    taken = np.count_nonzero(before[-10_000:] >= start_s) + np.count_nonzero(run <= end_s)
    return bool(end_s - start_s < 60.0 and taken < 1.5 * places + 1.0)


def _shifts(
    clocks: Mapping[str, FloatArray], by_clock: list[list[IntArray]], remarks: list[Remark]
) -> tuple[list[float], list[float]]:
    """Return how much later every stretch is dated, and the times between them."""
    shifts_s, breaks_s = [0.0], []
    for before, after in pairwise(range(len(by_clock[0]))):
        pairs = list(zip(clocks.values(), by_clock, strict=True))
        end_s = max(float(time_s[stretches[before]].max()) for time_s, stretches in pairs) + shifts_s[-1]
        start_s = min(float(time_s[stretches[after]].min()) for time_s, stretches in pairs)
        shift_s = math.ceil(end_s - start_s) + 1.0
        shifts_s.append(shift_s)
        breaks_s.append(0.5 * (end_s + start_s + shift_s))
        back = f"the clock went back from {end_s - shifts_s[-2]:.10g} to {start_s:.10g} s"
        text = f"{back}: what follows is dated {shift_s:g} s later"
        remarks.append(remark("clock jump", end_s, start_s + shift_s, text))
    return shifts_s, breaks_s


def own_rows(time_s: FloatArray, is_filled: BoolArray) -> IntArray | None:
    """Return the rows of a column that has samples of its own, None where it shares its table's.

    >>> own_rows(np.array([0.0, 0.1, 1.0, 1.1, 2.0, 2.1]), np.array([True, False] * 3))
    array([0, 2, 4])
    """
    if is_filled.all():
        return None
    rows = np.flatnonzero(is_filled)
    if len(rows) < 3:
        return None
    is_sparse = np.median(np.diff(rows)) >= 2
    # half as uneven as all of a table's rows: a column's own stamps
    return rows if is_sparse or _unevenness(time_s[rows]) < 0.5 * _unevenness(time_s) else None


def _unevenness(time_s: FloatArray) -> float:
    """Return how far steps are from their median, at the mean; long ones count as one that is missed."""
    steps = np.diff(time_s)
    typical_s = float(np.median(steps))
    return float(np.mean(np.minimum(np.abs(steps / typical_s - 1.0), 1.0))) if typical_s > 0 else math.inf


def single(
    label: str, time_s: FloatArray, values: FloatArray, breaks_s: Sequence[float]
) -> tuple[IntArray, FloatArray, FloatArray, list[Remark]]:
    """Return the rows that are samples, when they are, what they hold, and remarks; times are in order, not rising yet.

    Stamps that are only rounded coarsely are spread evenly. Rows at one time, or nearly, are one sample, of which every
    column's first number is taken; unless they come after a pause that is as long as all of them: then they were
    measured in it, and stamped late.

    `label`: whose stamps they are, for a message. `time_s`, `values`: shapes (rows,) and (rows, columns). `breaks_s`:
    when the clock was set: nothing is moved over that.
    """
    edges = [0, *np.searchsorted(time_s, breaks_s).tolist(), len(time_s)]
    remarks: list[Remark] = []
    kept, times, merged = [], [], []
    for first, last in pairwise(edges):
        if first < last:
            rows, own_s, own = _single(label, time_s[first:last], values[first:last], remarks)
            kept.append(rows + first)
            times.append(own_s)
            merged.append(own)
    return joined(kept, np.int64), joined(times, np.float64), joined(merged, np.float64), remarks


def _single(
    label: str, time_s: FloatArray, values: FloatArray, remarks: list[Remark]
) -> tuple[IntArray, FloatArray, FloatArray]:
    steps = np.diff(time_s)
    least_s = float(steps.min(initial=np.inf))
    if least_s == 0.0 and (spread := rounded_coarsely(time_s)) is not None:
        text = f"{label}stamps are rounded to {steps[steps > 0].min():.4g} s: samples are spread evenly over them"
        remarks.append(remark("duplicate", float(time_s[0]), float(time_s[-1]), text))
        return np.arange(len(time_s)), spread, values
    forwards = steps if least_s > 0.0 else steps[steps > 0]
    period_s = float(np.median(forwards, overwrite_input=True)) if len(forwards) else 0.0
    del steps, forwards
    rows = np.arange(len(time_s))
    if least_s >= NEAR * period_s:
        return rows, time_s, values
    slipped_s = in_their_places(time_s, values, period_s)
    moved = np.flatnonzero(slipped_s != time_s)
    if len(moved):
        text = (
            f"{label}{len(moved)} rows are stamped late, together with the next: they stand where the pause before is"
        )
        remarks.append(remark("slipped", float(slipped_s[moved[0]]), float(slipped_s[moved[-1]]), text))
    steps = np.diff(slipped_s)
    doubled = np.flatnonzero(steps < NEAR * period_s) + 1
    if not len(doubled):
        return rows, slipped_s, values
    first_s, last_s = float(time_s[doubled[0]]), float(time_s[doubled[-1]])
    text = f"{label}{len(doubled)} stamps stand there twice, or nearly: the first row is taken"
    kept = np.delete(rows, doubled)
    merged = _first_numbers(values, kept)
    filled = np.count_nonzero(np.any(np.isfinite(merged) & ~np.isfinite(values[kept]), axis=1))
    if filled:
        text += f", and of {filled} what it lacks from the second"
    remarks.append(remark("duplicate", first_s, last_s, text))
    return kept, slipped_s[kept], merged


def _first_numbers(values: FloatArray, starts: IntArray) -> FloatArray:
    """Return every column's first number of the rows from each start to before the next, NaN where there is none."""
    count = len(values)
    ends = np.append(starts[1:], count)
    merged = values[starts]
    for column, own in zip(merged.T, values.T, strict=True):
        numbers = np.where(np.isfinite(own), np.arange(count), count)
        first = np.minimum.accumulate(numbers[::-1])[::-1][starts]
        there = first < ends
        column[there] = own[first[there]]
    return merged


def is_waited_for(step_s: float, period_s: float) -> bool:
    """Tell whether behind such a step more rows of its last time may come, that were measured in it."""
    return 2.0 - 2 * NEAR <= step_s / period_s <= _FEW + 2 * NEAR


def in_their_places(time_s: FloatArray, values: FloatArray, period_s: float) -> FloatArray:
    """Return stamps where rows of one time that hold different samples are put into the pause before them."""
    near = np.concatenate([[False], np.diff(time_s) < NEAR * period_s])
    if not near.any():
        return time_s
    starts = np.flatnonzero(~near)
    counts = np.diff(np.append(starts, len(time_s)))
    ends_s = time_s[starts + counts - 1]
    pauses_s = ends_s - np.append(np.nan, time_s[starts[1:] - 1])
    same = (values[1:] == values[:-1]) | ~np.isfinite(values[1:]) | ~np.isfinite(values[:-1])
    repeats = near & np.append(False, np.all(same, axis=1))
    own = (counts > 1) & (counts <= _FEW) & ~np.logical_or.reduceat(repeats, starts)
    own &= np.abs(pauses_s / period_s - counts) <= 2 * NEAR
    left = np.repeat(starts + counts, counts) - np.arange(len(time_s)) - 1  # rows behind, of the same time
    spread_s = np.repeat(ends_s, counts) - left * np.repeat(pauses_s / counts, counts)
    return np.where(np.repeat(own, counts), spread_s, time_s)


def _label(name: str) -> str:
    return f"{name}: " if name else ""
