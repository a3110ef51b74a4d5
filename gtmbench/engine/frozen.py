"""Gyros that stand still while the attitude turns about their axis or others move: no model of noise makes that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.finding import FROZEN, Finding
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect
from gtmbench.engine.sums import CELL
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, runs

_LEAST_S, _OF_USUAL = 1.0, 3.0  # how long one value is read; times the longest that the gyros do otherwise
_MOVES_DEG_S, _ABOUT, _SHARE = 0.5, 5, 0.3  # the attitude's spread, over blocks about each; in how much of the time
_CERTAIN = 50.0  # nats


def frozen_gyros(flight: Flight) -> tuple[Finding, ...]:
    """Return where gyros stand still; none of an IMU whose three all do, for then it is the logger."""
    own = [(GYROS, flight), *((imu.channels, flight.by(imu)) for imu in flight.compared)]
    return tuple(each for sensors, watched in own for each in _of_gyros(watched, sensors))


def _of_gyros(flight: Flight, sensors: Sequence[str]) -> list[Finding]:
    found = [each for axis in range(3) for each in _of_axis(flight, axis, sensors[axis])]
    return [] if len({each.best.suspect for each in found}) == len(GYROS) else found


def _of_axis(flight: Flight, axis: int, sensor: str) -> Iterator[Finding]:
    held = _held(flight, axis)
    others = max((length for other in range(3) if other != axis for _, _, length in _held(flight, other)), default=0)
    lengths = sorted((length for _, _, length in held), reverse=True)
    usual = max([others, *lengths[1:2]])
    spread = _spread(flight)
    for first, last, length in held:
        moves = np.mean(spread[first:last] > _MOVES_DEG_S)
        if first <= 1 and last >= len(flight) - 1:
            continue  # a column that was never a sensor's
        if length * flight.blocks.period_s > _LEAST_S and length > _OF_USUAL * usual and moves > _SHARE:
            yield _finding(flight, axis, sensor, first, last)


def _held(flight: Flight, axis: int) -> list[tuple[int, int, int]]:
    """Return in which blocks a gyro reads one value throughout, and how many these are."""
    still = flight.blocks.held_s[:, axis] >= flight.blocks.period_s * (1.0 - 1e-9)
    starts, ends = runs(still)
    return [(first, last, last - first) for first, last in zip(starts.tolist(), ends.tolist(), strict=True)]


def _spread(flight: Flight) -> FloatArray:
    """Return the spread of the attitude's rate over blocks about each, the largest of the axes, in deg/s."""
    rates = np.nan_to_num(flight.blocks.rates)
    width = min(2 * _ABOUT + 1, len(rates))
    windows = np.lib.stride_tricks.sliding_window_view(rates, width, axis=0).std(axis=-1).max(axis=1)
    before = (len(rates) - len(windows)) // 2
    return np.pad(windows, (before, len(rates) - len(windows) - before), mode="edge")


def _finding(flight: Flight, axis: int, sensor: str, first: int, last: int) -> Finding:
    start_s, period_s = flight.blocks.start_s, flight.blocks.period_s
    onset_s = start_s + first * period_s
    reads = float(np.nan_to_num(flight.blocks.gyros[min(first + 1, len(flight) - 1), axis]))
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
