"""A GPS that shows by itself that it failed: its fix is lost at once, its velocity jumps, or its place parts from that.

The engine asks what a GPS reads of a flight's course. It sees no fix that is lost, because then nothing is read, and
names no GPS that accelerometers alone contradict; but no aircraft takes such a step. Nor does it read places. A
receiver measures its velocity by the Doppler shift and its place by the signals' travel, so each is a witness of the
other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.excursion import Excursion
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.log.opening.records import LIVELY_DEG_S, turning_by_second
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, G_M_S2, GPS_VELOCITY, GYROS
from gtmbench.values.record import FloatArray, Record

FIX, JUMP, PLACE = "fix", "velocity jump", "place"  # sources and tests of such alarms
_GPS = "gps"
_LASTS_S = 5.0  # a fix that is back sooner may have been skipped by the receiver
_JUMP_M_S, _JUMP_M_S2 = 4.0, 25.0  # at least
_PAUSE_S = 1.5  # between two readings: in it, a velocity that isn't read makes up to a metre or two
_LONGEST_S = 0.55  # between two readings of which the second may have jumped
_FORCE_G, _BEFORE_S, _BEHIND_S = 2.0, 5.0, 0.5  # more is read in an impact, which may turn an antenna to the ground
# within so long a place moves by so much more or less than its velocity makes (in 25 real flights 9 m at most); one
# of both is late behind the other by half a second at most
_OVER_S, _PARTS_M, _LATE_S = 20.0, 20.0, 0.5
_BEGUN = 0.25  # of what they part by, which shows since when
_BEYOND = 1.5  # times the largest acceleration that the force they read, and gravity, allow
_ABOUT_S = 2.0  # before an excursion, and before the last motion: it may have begun already
_MOVES_S, _FEWEST_LIVELY = 10.0, 3  # after an alarm; seconds in which the aircraft turns


class _Flown(NamedTuple):
    """Where a log's flight isn't ordinary, and the seconds in which it moves."""

    excursions: tuple[Excursion, ...]
    lively_s: FloatArray

    def doubt(self, alarm: Alarm) -> str:
        """Return what the flight does where an alarm begins, if that may be its cause."""
        for each in self.excursions:
            if each.start_s - _ABOUT_S <= alarm.time_s <= each.end_s + _ABOUT_S:
                return each.reason
        if not len(self.lively_s) or alarm.time_s > self.lively_s[-1] - _ABOUT_S:
            return "it begins, or is named, as the motion ends"
        about = (self.lively_s >= alarm.time_s - _ABOUT_S) & (self.lively_s <= alarm.time_s + _MOVES_S)
        return "" if np.count_nonzero(about) >= _FEWEST_LIVELY else "it begins while nothing moves"


def gps_alarms(
    sensors: Sequence[SensorReadings], moving: Sequence[Record], excursions: Sequence[Excursion]
) -> tuple[Alarm, ...]:
    """Return an alarm for each fix that a GPS lost, its velocity's jump and its place's error, in time; some doubted.

    `excursions`: contacts with the ground and motion beyond what was learnt: what begins there may be no fault.
    """
    whole = [each for each in moving if {*GYROS, *ATTITUDE} <= set(each.channels)]
    if not whole or not any(each.channels == GPS_VELOCITY for each in sensors):
        return ()
    seconds_s, turning = turning_by_second(whole)
    flown = _Flown(excursions=tuple(excursions), lively_s=seconds_s[turning > LIVELY_DEG_S])
    forces = next((each for each in sensors if each.channels == ACCELEROMETERS), None)
    found = [alarm for each in sensors if each.channels == GPS_VELOCITY for alarm in _shown(each, forces, flown)]
    return tuple(sorted((_doubted(alarm, flown) for alarm in found), key=lambda alarm: alarm.time_s))


def _shown(sensor: SensorReadings, forces: SensorReadings | None, flown: _Flown) -> Iterator[Alarm]:
    yield from _lost(sensor, flown)
    yield from _parts(sensor)
    if forces is not None:
        yield from _jumps(sensor, forces)


def _lost(sensor: SensorReadings, flown: _Flown) -> Iterator[Alarm]:
    """Give the fixes that were lost at once, for five seconds or longer, while the aircraft turns."""
    for lost in sensor.lost:
        turns = np.any((flown.lively_s > lost.start_s) & (flown.lively_s < lost.end_s))
        lasts_s = lost.end_s - lost.start_s
        if turns and lasts_s >= _LASTS_S:
            why = f"it lost its {lost.satellites} satellites at once, and found none for {lasts_s:.1f} s"
            yield _alarm(FIX, (lost.start_s, lost.end_s), lost.start_s + _LASTS_S, why)


def _parts(sensor: SensorReadings) -> Iterator[Alarm]:
    """Give when the place first moves otherwise than the velocity makes, without a pause in between."""
    if sensor.places is None:
        return
    time_s, velocity = sensor.time_s, sensor.values[:, :2]
    steps_s = np.diff(time_s)
    made = 0.5 * (velocity[1:] + velocity[:-1]) * steps_s[:, np.newaxis]
    apart = np.diff(sensor.places, axis=0) - made
    even = np.isfinite(apart).all(axis=1) & (steps_s <= _PAUSE_S)
    apart = np.concatenate([np.zeros((1, 2)), np.cumsum(np.where(even[:, np.newaxis], apart, 0.0), axis=0)])
    pauses = np.concatenate([[0], np.cumsum(~even)])
    first = np.searchsorted(time_s, time_s - _OVER_S)
    parted_m = np.linalg.norm(apart - apart[first], axis=1)
    bound_m = _PARTS_M + _LATE_S * np.linalg.norm(velocity - velocity[first], axis=1)
    for row in np.flatnonzero((parted_m > bound_m) & (pauses == pauses[first])):
        own = slice(first[row], row + 1)
        before = np.linalg.norm(apart[own] - apart[first[row]], axis=1) < _BEGUN * parted_m[row]
        begun = int(first[row] + np.flatnonzero(before)[-1])
        over_s = float(time_s[row] - time_s[begun])
        why = f"its place moves otherwise than its velocity makes, by {parted_m[row]:.0f} m within {over_s:.2g} s"
        yield _alarm(PLACE, (float(time_s[begun]), None), float(time_s[row]), why)
        return


def _jumps(sensor: SensorReadings, forces: SensorReadings) -> Iterator[Alarm]:
    """Give the first of the velocity's steps that no aircraft takes and no accelerometer felt."""
    time_s, steps_s = sensor.time_s[1:], np.diff(sensor.time_s)
    jumps = np.linalg.norm(np.diff(sensor.values, axis=0), axis=1)
    felt = np.linalg.norm(forces.values, axis=1)
    bounds = np.maximum(_JUMP_M_S, _JUMP_M_S2 * steps_s)
    for row in np.flatnonzero((jumps > bounds) & (steps_s <= _LONGEST_S)):
        at_s, step_s = float(time_s[row]), float(steps_s[row])
        about = felt[(forces.time_s > at_s - _BEFORE_S) & (forces.time_s < at_s + _BEHIND_S)]
        rate_g = jumps[row] / step_s / G_M_S2
        if len(about) and about.max() < _FORCE_G and rate_g > _BEYOND * (about.max() + 1.0):
            why = (
                f"its velocity jumps by {jumps[row]:.1f} m/s within {step_s:.2g} s, by {rate_g:.1f} g, "
                f"while the accelerometers read {about.max():.1f} g at most"
            )
            yield _alarm(JUMP, (at_s, None), at_s, why)
            return


def _alarm(test: str, span: tuple[float, float | None], known_s: float, why: str) -> Alarm:
    judged = Judgement(time_s=known_s, sensor=_GPS, candidates=(_GPS,), reason=why)
    return Alarm(
        number=0, time_s=known_s, onset_s=span[0], source=test, test=test, judgements=(judged,), ended_s=span[1]
    )


def _doubted(alarm: Alarm, flown: _Flown) -> Alarm:
    """Return an alarm with why it may be no fault, where the flight isn't ordinary about it."""
    return replace(alarm, judgements=tuple(replace(each, doubt=flown.doubt(alarm)) for each in alarm.judgements))
