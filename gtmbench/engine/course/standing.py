"""Sensors that read one value while the aircraft flies, for much longer than they ever do otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from gtmbench.engine.blocks import held_for_s
from gtmbench.engine.hindsight.cleared_sensors import OF_USUAL
from gtmbench.engine.samples import Samples
from gtmbench.values.channels import GPS_VELOCITY, MAGNETOMETER, names_of
from gtmbench.values.record import Span

LEAST_S = 10.0  # a barometer holds a value for half as long while nothing climbs
_BEGUN_S = 1.0  # after which a sensor reads anything
_MOST = 0.9  # of the flight: what hardly ever moved was never a sensor's
_FEWEST = 20  # samples, or one value in so long says nothing
# those of which one axis alone stands, and the others go on
_ALONE = (*GPS_VELOCITY, *MAGNETOMETER, "nx", "ny", "nz", "tas", "alpha", "beta", "altitude")
_HORIZONTAL = GPS_VELOCITY[:2]


class Stands(NamedTuple):
    """A channel that reads one value."""

    channel: str
    span_s: Span
    reads: float
    doubt: str = ""  # why it may be as healthy as ever; "" where it failed

    @property
    def sensor(self) -> str:
        """The sensor that the channel is of."""
        return names_of(self.channel)[-1]


def standing(sensors: Mapping[str, Samples], flown_s: Span) -> Iterator[Stands]:
    """Give which channels read one value in flight.

    Where two sensors stand at a time, it may be the log that does; where one stands from the beginning, it isn't on
    yet. Where a GPS reads none along one axis alone, it tells no course: at a walk, receivers leave it at 0.

    `sensors`, by channel. `flown_s`, (start, end): from when to when the aircraft flies.

    >>> time_s = np.arange(0.0, 60.0, 0.1)
    >>> read = np.random.default_rng(1).standard_normal(600)
    >>> read[300:] = read[300]
    >>> found = standing({"tas": Samples(time_s, read)}, (0.0, 60.0))
    >>> [(each.channel, *map(round, each.span_s), each.doubt) for each in found]
    [('tas', 30, 60, '')]
    """
    found = [each for name in _ALONE if name in sensors for each in _in_flight(name, sensors[name], flown_s)]
    for each in found:
        start_s, end_s = each.span_s
        beside = [other.sensor for other in found if other.span_s[0] < end_s and other.span_s[1] > start_s]
        others = [sensor for sensor in beside if sensor != each.sensor]
        if start_s <= flown_s[0] + _BEGUN_S:
            yield each._replace(doubt="it reads one value since the flight began")
        elif others:
            yield each._replace(doubt=f"it reads one value, and so does {others[0]}")
        elif each.reads != 0.0 or {*_HORIZONTAL} & {other.channel for other in found} != {each.channel}:
            yield each


def _in_flight(name: str, samples: Samples, flown_s: Span) -> Iterator[Stands]:
    time_s, values = samples
    there = np.isfinite(values) & (time_s >= flown_s[0]) & (time_s <= flown_s[1])
    if np.count_nonzero(there) >= _FEWEST:
        yield from _of(name, Samples(time_s[there], values[there]))


def _of(name: str, samples: Samples) -> Iterator[Stands]:
    held_s = held_for_s(samples.time_s, samples.values)
    ends = np.flatnonzero(np.append(held_s[1:] == 0.0, [True]) & (held_s > 0.0))
    if not len(ends):
        return
    order = ends[np.argsort(-held_s[ends])]
    usual_s = float(held_s[order[1]]) if len(order) > 1 else samples.step_s
    lasts_s, end_s = float(held_s[order[0]]), float(samples.time_s[order[0]])
    count = np.count_nonzero((samples.time_s >= end_s - lasts_s) & (samples.time_s <= end_s))
    never_moved = lasts_s > _MOST * float(np.ptp(samples.time_s))
    if lasts_s > max(LEAST_S, OF_USUAL * usual_s) and count >= _FEWEST and not never_moved:
        yield Stands(name, (end_s - lasts_s, end_s), float(samples.values[order[0]]))
