"""Sensors that jump once, between two readings, by more than an aircraft or the air moves in that time, and stay there.

Relations between sensors tell what lasts: a second after its step an altitude climbs as fast as before. What jumps to
and fro is noise, and what jumps often has readings of that size.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.samples import Samples
from gtmbench.values.channels import ACCELEROMETERS, FT_S_PER_KT, G_M_S2, GPS_VELOCITY, M_PER_FT
from gtmbench.values.record import FloatArray, Span

_M_S = 1.0 / (FT_S_PER_KT * M_PER_FT)  # in kt
# the least jump of a channel, in its unit, and the most that it changes by a second: no aircraft of these climbs at
# 100 m/s, meets a gust that grows by 2.5 g, or turns against the air by 60 deg/s
_JUMPS: Mapping[str, tuple[float, float]] = {
    "altitude": (10.0 / M_PER_FT, 100.0 / M_PER_FT),
    "tas": (4.0 * _M_S, 2.5 * G_M_S2 * _M_S),
    "alpha": (2.0, 60.0),
    "beta": (2.0, 60.0),
}
_GPS_LEAST_M_S = 2.5  # noise of a receiver is a tenth of it
_FORCE_G, _ABOUT_S = 2.0, 5.0  # more is felt in an impact; so long before and behind a jump
_OF_OTHERS = 4.0  # times the next largest change between two readings
_BESIDE_S = 15.0  # before and behind it is flown; what begins later may be a landing
STAYS_S, _STAYS = 2.0, 0.5  # its share of what medians before and behind are apart
_SLOWEST_S = 0.25  # between readings
_GAP = 2.5  # times the usual step


def jumps(sensors: Mapping[str, Samples], flown_s: Span) -> Iterator[tuple[str, float, float]]:
    """Give which channels jump in flight, when, and by how much in their unit.

    `sensors`, by channel. `flown_s`, (start, end): from when to when the aircraft flies.

    >>> time_s = np.arange(0.0, 60.0, 0.1)
    >>> read = np.random.default_rng(1).standard_normal(600)
    >>> list(jumps({"altitude": Samples(time_s, read)}, (0.0, 60.0)))
    []
    >>> read[300:] += 150.0
    >>> found = jumps({"altitude": Samples(time_s, read)}, (0.0, 60.0))
    >>> [(name, round(at_s), round(size, -1)) for name, at_s, size in found]
    [('altitude', 30, 150.0)]
    """
    for name, (least, rate) in _JUMPS.items():
        if name in sensors and sensors[name].step_s <= _SLOWEST_S:
            found = _of(name, sensors[name], flown_s, least, rate)
            yield from (each for each in found if _has_airspeed(sensors, each[1]))


def gps_jumps(course: Course) -> Iterator[tuple[str, float, float]]:
    """Give which axis of a GPS's velocity jumps in flight, when, and by how much: where no accelerometer felt it.

    Over a second its velocity changes by so much more than forces make; before and behind it doesn't, and at no other
    time by nearly as much.
    """
    if not course.has(*GPS_VELOCITY, *ACCELEROMETERS):
        return
    flight, wide = course.flight, course.second + 2
    apart = np.where(
        flight.flown[:, np.newaxis], course.rates(course.velocity) - course.over_second(course.pulled), 0.0
    )
    beside = np.zeros_like(apart)
    beside[wide:-wide] = apart[wide:-wide] - 0.5 * (apart[: -2 * wide] + apart[2 * wide :])
    sizes = np.linalg.norm(np.nan_to_num(beside), axis=1)
    peak = int(np.argmax(sizes))
    near = np.abs(np.arange(len(sizes)) - peak) <= 2 * wide
    if sizes[peak] < max(_GPS_LEAST_M_S, _OF_OTHERS * sizes[~near].max(initial=0.0)):
        return
    at_s = float(flight.blocks.time_s[int(np.argmax(near & (sizes > 0.5 * sizes[peak])))])
    start_s, end_s = flight.flown_s
    if start_s + _BESIDE_S < at_s < end_s - _BESIDE_S and _is_calm(course, at_s):
        axis = int(np.argmax(np.abs(beside[peak])))
        yield GPS_VELOCITY[axis], at_s, float(beside[peak, axis])


def _is_calm(course: Course, at_s: float) -> bool:
    """Tell whether GPS and force are read all about a time, and no impact, nor an antenna that is turned to the ground.

    A crash takes a GPS its sky.
    """
    blocks = course.flight.blocks
    about = (blocks.time_s > at_s - _ABOUT_S) & (blocks.time_s < at_s + _ABOUT_S)
    velocity, felt = course.velocity[about], course.columns(ACCELEROMETERS)[about]
    if not (np.isfinite(velocity).all() and np.isfinite(felt).all()):
        return False
    return bool(np.linalg.norm(felt, axis=1).max() < _FORCE_G * G_M_S2 and felt[:, 2].max() < 0.0)


def _has_airspeed(sensors: Mapping[str, Samples], at_s: float) -> bool:
    """Tell whether an airspeed was there before a time, where it is measured: else that is when the flight begins."""
    if "tas" not in sensors:
        return True
    before = _between(sensors["tas"], at_s - STAYS_S, at_s)
    return not len(before) or abs(float(np.median(before))) >= _JUMPS["tas"][0]


def _between(samples: Samples, since_s: float, until_s: float) -> FloatArray:
    there = (samples.time_s >= since_s) & (samples.time_s < until_s) & np.isfinite(samples.values)
    return np.asarray(samples.values[there])


def hidden_jump(name: str, samples: Samples, flown_s: Span, time_s: FloatArray) -> FloatArray:
    """Return the largest jump of a channel that may hide at some times, in its unit; infinite where none is told."""
    least, rate = _JUMPS[name]
    changes = _changes(samples, flown_s)
    hidden = np.full(len(time_s), np.inf)
    if len(changes.size) and samples.step_s <= _SLOWEST_S:
        largest = float(np.abs(changes.size).max())
        there = (time_s > flown_s[0] + _BESIDE_S) & (time_s < flown_s[1] - _BESIDE_S)
        hidden[there] = largest + max(least + rate * samples.step_s, _OF_OTHERS * largest)
    return hidden


class _Changes(NamedTuple):
    """Changes between readings that follow each other in flight: when, by how much, and after how long."""

    time_s: FloatArray
    size: FloatArray
    steps_s: FloatArray


def _changes(samples: Samples, flown_s: Span) -> _Changes:
    there = np.isfinite(samples.values)
    time_s, values = samples.time_s[there], samples.values[there]
    own = (time_s[1:] >= flown_s[0]) & (time_s[1:] <= flown_s[1])
    return _Changes(time_s[1:][own], np.diff(values)[own], np.diff(time_s)[own])


def _of(name: str, samples: Samples, flown_s: Span, least: float, rate: float) -> Iterator[tuple[str, float, float]]:
    changes = _changes(samples, flown_s)
    even = changes.steps_s < _GAP * samples.step_s
    sizes = np.where(even, changes.size, 0.0)
    if np.count_nonzero(even) < 2:
        return
    second, first = np.argsort(np.abs(sizes))[-2:]
    size, at_s = float(sizes[first]), float(changes.time_s[first])
    if abs(size) < max(least + rate * float(changes.steps_s[first]), _OF_OTHERS * abs(float(sizes[second]))):
        return
    before, behind = _between(samples, at_s - STAYS_S, at_s), _between(samples, at_s, at_s + STAYS_S)
    if not (np.ptp(before) > 0.0 and np.ptp(behind) > 0.0):
        return  # it stands still, or wasn't on before
    stays = float(np.median(behind) - np.median(before)) / size > _STAYS
    if stays and flown_s[0] + _BESIDE_S < at_s < flown_s[1] - _BESIDE_S:
        yield name, at_s, size
