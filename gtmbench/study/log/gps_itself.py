"""A GPS that shows by itself that it failed: it loses its fix at once in flight, or its velocity jumps as none can.

Whoever flies with it may know nothing of that, so this stands beside what the other sensors tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.crosscheck.relations import ACCEL, GPS
from gtmbench.detectors.excursion import Excursion
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.study.log.other_sensors import Flown, WatchedSensor, flown_of, kind_of, out_of_ordinary
from gtmbench.values.channels import G_M_S2
from gtmbench.values.record import Record

FIX, JUMP = "fix", "velocity jump"  # sources and tests of such alarms
_LASTS_S = 5.0  # a fix that is back sooner may have been skipped by the receiver
_JUMP_M_S, _JUMP_M_S2 = 4.0, 25.0  # at least
_LONGEST_S = 0.55  # between two readings of which the second may have jumped
_FORCE_G, _BEFORE_S, _BEHIND_S = 2.0, 5.0, 0.5  # more is read in an impact, which may turn an antenna to the ground
_BEYOND = 1.5  # times the largest acceleration that the force they read, and gravity, allow


def with_itself(
    watched: Sequence[WatchedSensor],
    sensors: Sequence[SensorReadings],
    moving: Sequence[Record],
    excursions: Sequence[Excursion],
) -> tuple[WatchedSensor, ...]:
    """Return sensors with an alarm for each fix that a GPS lost and each jump of its velocity, in time.

    Parameters
    ----------
    watched, sensors : sequence of WatchedSensor and of SensorReadings
        One for one.
    moving : sequence of Record
        The log, with p, q, r, phi, theta and psi.
    excursions : sequence of Excursion
        Contacts with the ground and motion beyond what was learnt: what begins there may be no fault.
    """
    flown = flown_of(moving, excursions)
    forces = next((each for each in sensors if kind_of(each) == ACCEL), None)

    def told(sensor: SensorReadings) -> Iterator[Alarm]:
        yield from _lost(sensor, flown)
        if forces is not None:
            yield from _jumps(sensor, forces)

    def beside(each: WatchedSensor, sensor: SensorReadings) -> WatchedSensor:
        found = [_doubted(alarm, flown) for alarm in told(sensor)]
        alarms = sorted((*each.alarms, *found), key=lambda alarm: alarm.time_s)
        return replace(each, alarms=tuple(alarms)) if found else each

    pairs = zip(watched, sensors, strict=True)
    return tuple(beside(each, sensor) if each.kind == GPS else each for each, sensor in pairs)


def _lost(sensor: SensorReadings, flown: Flown) -> Iterator[Alarm]:
    """Give the fixes that were lost at once, for five seconds or longer, while the aircraft turns."""
    for lost in sensor.lost:
        turns = np.any((flown.lively_s > lost.start_s) & (flown.lively_s < lost.end_s))
        lasts_s = lost.end_s - lost.start_s
        if turns and lasts_s >= _LASTS_S:
            why = f"it lost its {lost.satellites} satellites at once, and found none for {lasts_s:.1f} s"
            yield _alarm(FIX, (lost.start_s, lost.end_s), lost.start_s + _LASTS_S, why)


def _jumps(sensor: SensorReadings, forces: SensorReadings) -> Iterator[Alarm]:
    """Give the first of the velocity's steps that no aircraft takes and no accelerometer felt, healthy part or not."""
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
    judged = Judgement(time_s=known_s, sensor=GPS, candidates=(GPS,), reason=why)
    return Alarm(
        number=0, time_s=known_s, onset_s=span[0], source=test, test=test, judgements=(judged,), ended_s=span[1]
    )


def _doubted(alarm: Alarm, flown: Flown) -> Alarm:
    """Return an alarm with why it may be no fault, where the flight isn't ordinary about it."""
    return replace(
        alarm, judgements=tuple(replace(each, doubt=out_of_ordinary(alarm, flown)) for each in alarm.judgements)
    )
