"""What of a monitor's alarms can be believed where a gyro's fault bends the attitude, and the monitor doesn't know.

An estimator turns a gyro's error into all three angles. A monitor that was calibrated for an attitude of its own takes
that for faults of other sensors: so the first fault is believed only, and of an angle none. A monitor that knows stops
at its first fault; but means over tens of seconds may have named a gyro before, of which it heard nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.values.channels import ATTITUDE, GYROS

BENT = "a gyro that drives the attitude may have bent it, and the monitor was calibrated for one of its own"


def are_bent(faults: Sequence[Alarm]) -> list[bool]:
    """Tell of all faults of a flight so far, by their first alarms, which accuse a sensor but may not be believed.

    Examples
    --------
    >>> first, second = (Alarm(number=k, time_s=10.0 + k, onset_s=10.0 + k, source="pq"[k]) for k in (0, 1))
    >>> are_bent([first, second])
    [False, True]
    """
    left = [alarm for alarm in faults if not alarm.has_passed and alarm.test != MISSING]
    first_s = min((alarm.time_s for alarm in left), default=0.0)
    return [
        alarm.accuses and alarm.test != MISSING and (alarm.time_s > first_s or alarm.sensor in ATTITUDE)
        for alarm in faults
    ]


def doubt_behind(alarm: Alarm, named: Sequence[Alarm]) -> str:
    """Return why nobody is accused by an alarm: a gyro that was named before drives the attitude; "" where one may be.

    Parameters
    ----------
    alarm : Alarm
    named : sequence of Alarm
        What means over tens of seconds told.

    Examples
    --------
    >>> from gtmbench.detectors.alarm import Judgement
    >>> first, second = (
    ...     Alarm(
    ...         number=0, time_s=at_s, onset_s=at_s, source=gyro,
    ...         judgements=(Judgement(time_s=at_s, sensor=gyro, candidates=(gyro,)),),
    ...     )
    ...     for gyro, at_s in (("q", 168.0), ("r", 220.0))
    ... )
    >>> doubt_behind(second, [first]), doubt_behind(first, [second])
    ('q failed before, at 168.0 s, and turns the attitude since', '')
    """
    others = [
        each
        for each in named
        if each.accuses and not each.has_passed and each.sensor in GYROS and each.sensor != alarm.sensor
    ]
    first = min(others, key=lambda each: each.time_s, default=None)
    if first is None or not (alarm.accuses and alarm.judgements) or alarm.time_s <= first.time_s:
        return ""
    return f"{first.sensor} failed before, at {first.onset_s:.1f} s, and turns the attitude since"


def but_behind(alarms: Sequence[Alarm], named: Sequence[Alarm]) -> tuple[Alarm, ...]:
    """Return alarms of tests over tens of seconds that doubt whom they name after another gyro was named."""
    return tuple(_but_behind(alarm, named) for alarm in alarms)


def _but_behind(alarm: Alarm, named: Sequence[Alarm]) -> Alarm:
    doubt, last = doubt_behind(alarm, named), alarm.last
    if not doubt or last is None:
        return alarm
    return replace(alarm, judgements=(replace(last, sensor=None, doubt=doubt, kind=None, parameters={}),))
