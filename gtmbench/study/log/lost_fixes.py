"""A GPS that loses its fix at once while the aircraft flies: nothing else has to contradict it.

Whoever flies without it knows nothing of its error, so this stands beside what the other sensors tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.crosscheck.relations import GPS
from gtmbench.detectors.excursion import Excursion
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.study.log.other_sensors import Flown, WatchedSensor, flown_of, out_of_ordinary
from gtmbench.values.record import Record

FIX = "fix"  # source and test of such alarms
_LASTS_S = 5.0  # a fix that is back sooner may have been skipped by the receiver


def with_lost_fixes(
    watched: Sequence[WatchedSensor],
    sensors: Sequence[SensorReadings],
    moving: Sequence[Record],
    excursions: Sequence[Excursion],
) -> tuple[WatchedSensor, ...]:
    """Return sensors with an alarm for each fix that a GPS lost at once in flight, among its others, in time.

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
    return tuple(
        replace(each, alarms=tuple(sorted((*each.alarms, *_alarms(sensor, flown)), key=lambda alarm: alarm.time_s)))
        if each.kind == GPS and sensor.lost
        else each
        for each, sensor in zip(watched, sensors, strict=True)
    )


def _alarms(sensor: SensorReadings, flown: Flown) -> Iterator[Alarm]:
    for number, lost in enumerate(sensor.lost):
        known_s = lost.start_s + _LASTS_S
        if lost.end_s < known_s or not np.any((flown.lively_s > lost.start_s) & (flown.lively_s < lost.end_s)):
            continue
        why = f"it lost its {lost.satellites} satellites at once, and found none for {lost.end_s - lost.start_s:.1f} s"
        judged = Judgement(time_s=known_s, sensor=GPS, candidates=(GPS,), reason=why)
        alarm = Alarm(
            number=number,
            time_s=known_s,
            onset_s=lost.start_s,
            source=FIX,
            test=FIX,
            judgements=(judged,),
            ended_s=lost.end_s,
        )
        doubt = out_of_ordinary(alarm, flown)
        yield replace(alarm, judgements=(replace(judged, doubt=doubt),))
