"""Gyros and angles that stand still while the others tell of motion: no model of noise makes that."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.finding import FROZEN, Finding
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect
from gtmbench.engine.sums import CELL
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, runs

_LEAST_S, _OF_USUAL = 1.0, 3.0  # how long one value is read; times the longest that such sensors do otherwise
_MOVES_DEG_S, _ABOUT, _SHARE = 0.5, 5, 0.3  # spread of a rate, over blocks about each; in how much of the time
_CERTAIN = 50.0  # nats
_SAME = 1e-9  # of a value, or deg/s: rounding

Held = list[tuple[int, int]]  # first block and the one behind the last


def frozen_sensors(flight: Flight) -> tuple[Finding, ...]:
    """Return where gyros and angles stand still; none of an IMU or attitude whose three all do: it is the logger."""
    turning = np.repeat(_spread(flight.blocks.rates).max(axis=1, keepdims=True), 3, axis=1)
    own = [(GYROS, flight), *((imu.channels, flight.by(imu)) for imu in flight.compared)]
    gyros = [
        each
        for sensors, watched in own
        for each in _of_three(watched, sensors, watched.blocks.gyros, _held(watched)[:3], turning)
    ]
    angles = _of_three(flight, ATTITUDE, flight.blocks.angles, _held(flight)[3:], _spread(flight.blocks.gyros))
    return (*gyros, *angles)


def _of_three(
    flight: Flight, sensors: Sequence[str], reads: FloatArray, held: Sequence[Held], spread: FloatArray
) -> list[Finding]:
    """Return where one of three sensors stands still, by what they read and how the flight turns beside each.

    What such sensors do otherwise leaves the longest of each aside: two of them may stand, one after the other.
    """
    found = []
    lengths = [sorted((last - first for first, last in each), reverse=True) for each in held]
    usual = max([0, *(length for own in lengths for length in own[1:2])])
    for place, sensor in enumerate(sensors):
        for first, last in held[place]:
            if first <= 1 and last >= len(flight) - 1:
                continue  # a column that was never a sensor's
            moves = np.mean(spread[first:last, place] > _MOVES_DEG_S)
            is_long = (last - first) * flight.blocks.period_s > _LEAST_S and last - first > _OF_USUAL * usual
            if is_long and moves > _SHARE:
                value = float(np.nan_to_num(reads[min(first + 1, len(flight) - 1), place]))
                found.append(_finding(flight, sensor, value, first, last))
    return [] if len({each.best.suspect for each in found}) == len(sensors) else found


def _held(flight: Flight) -> list[Held]:
    """Return in which blocks each gyro and angle reads one value throughout, before a gap and behind it, too."""
    blocks = flight.blocks
    still = blocks.held_s >= blocks.period_s * (1.0 - 1e-9)
    reads = np.column_stack([blocks.gyros, blocks.angles])
    spans = (zip(*(ends.tolist() for ends in runs(each)), strict=True) for each in still.T)
    return [_joined(each, own) for each, own in zip(spans, reads.T, strict=True)]


def _joined(held: Iterable[tuple[int, int]], reads: FloatArray) -> Held:
    """Return spans in which one value is read as one where nothing is read between them: a gap moves no sensor."""
    found: Held = []
    for first, last in held:
        before = found[-1] if found else (0, 0)
        is_gap = bool(found) and np.isnan(reads[before[1] : first]).all()
        if is_gap and np.isclose(reads[before[1] - 1], reads[first], rtol=_SAME, atol=_SAME):
            found[-1] = before[0], last
        else:
            found.append((first, last))
    return found


def _spread(rates: FloatArray) -> FloatArray:
    """Return the spread of rates over blocks about each, by axis, in deg/s."""
    rates = np.nan_to_num(rates)
    width = min(2 * _ABOUT + 1, len(rates))
    windows = np.lib.stride_tricks.sliding_window_view(rates, width, axis=0).std(axis=-1)
    before = (len(rates) - len(windows)) // 2
    return np.pad(windows, ((before, len(rates) - len(windows) - before), (0, 0)), mode="edge")


def _finding(flight: Flight, sensor: str, reads: float, first: int, last: int) -> Finding:
    start_s, period_s = flight.blocks.start_s, flight.blocks.period_s
    onset_s = start_s + first * period_s
    explanation = Explanation(suspect=sensor, kind=FROZEN, effect=partial(_nothing))
    return Finding(
        first=first // CELL,
        last=-(-last // CELL),
        onset_s=onset_s,
        end_s=start_s + last * period_s,
        onset_range_s=(onset_s - period_s, onset_s + period_s),
        ranked=((explanation, 0.0),),
        size=reads,
        interval=(reads, reads),
        evidence=_CERTAIN,
        own_axis=_CERTAIN,
        shown=_CERTAIN,
        shows_s=onset_s + _LEAST_S,
        lasts=last >= len(flight),
    )


def _nothing(_: Flight) -> Effect:
    return Effect()
