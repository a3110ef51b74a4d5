"""Contacts with the ground: what a touchdown or an impact raised is told as a stretch that wasn't watched.

The ground pushes in a way that no monitor has learnt, so residuals rise, and say nothing of a sensor. After a soft
contact, which raises nothing before or after it, nothing is open. A hard one, in which the aircraft turned harder than
ever, may be a crash that a sensor caused: it is over only if the aircraft flew on, watched, without an alarm. A sensor
that had failed lastingly would have raised one then. Where it didn't fly on, nothing after a crash tells of a sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import OUTSIDE, Alarm, Judgement
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import FAILURE, IMPACT, TOUCHDOWN
from gtmbench.detectors.protocol import Watch
from gtmbench.study.log.records import LIVELY_DEG_S, turning_by_second
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray

CONTACTS = (TOUCHDOWN, IMPACT)  # reasons
_FLIES_ON_S = 10  # seconds in which it turns, watched and without an alarm
_NEAR_S = 1.0  # of an alarm, an excursion that shows how hard the contact was


def is_contact(alarm: Alarm) -> bool:
    """Tell whether an alarm is explained by a contact with the ground, so that it is no finding any more."""
    return alarm.has_passed and alarm.last is not None and alarm.last.reason in CONTACTS


def over(watches: Sequence[Watch], excursions: Sequence[Excursion]) -> tuple[Watch, ...]:
    """Return watches in which nothing is left to explain of alarms that a contact raised, where that is over.

    Parameters
    ----------
    watches : sequence of Watch
        In time.
    excursions : sequence of Excursion
        Of the whole log.
    """
    if not any(_is_of_contact(alarm) for watch in watches for alarm in watch.alarms):
        return tuple(watches)
    open_s = [alarm.onset_s for watch in watches for alarm in watch.faults if _is_open(alarm)]
    flown_s = _flown_s(watches)

    def explained(alarm: Alarm) -> Alarm:
        if not _is_of_contact(alarm):
            return alarm
        about = [each for each in excursions if _is_near(each, alarm)]
        ended_s = max([alarm.time_s if alarm.ended_s is None else alarm.ended_s, *(each.end_s for each in about)])
        until_s = min((time_s for time_s in open_s if time_s > ended_s), default=np.inf)
        is_soft = alarm.test == OUTSIDE and not any(each.is_hard for each in about)
        is_gone = alarm.test == OUTSIDE or alarm.ended_s is not None
        is_over = is_soft or (is_gone and _flies_on(flown_s, ended_s, until_s))
        return _explained(alarm, ended_s) if is_over else alarm

    return tuple(replace(watch, alarms=tuple(map(explained, watch.alarms))) for watch in watches)


def but_after_crashes(
    told: Sequence[Alarm], watches: Sequence[Watch], excursions: Sequence[Excursion]
) -> tuple[Alarm, ...]:
    """Return alarms of slow tests whose doubts, where they begin in a crash or after it, are put down to that.

    An attitude that tumbled is no reference any more.

    Parameters
    ----------
    told : sequence of Alarm
    watches : sequence of Watch
        As `over` returns them.
    excursions : sequence of Excursion
        Of the whole log.
    """
    if not any(alarm.doubt for alarm in told):
        return tuple(told)
    crashes = _crashes(watches, excursions)

    def put_down(alarm: Alarm) -> Alarm:
        crash = next((each for each in crashes if each.start_s <= alarm.onset_s), None)
        if crash is None or alarm.last is None or not alarm.doubt:
            return alarm
        return replace(alarm, judgements=(*alarm.judgements, replace(alarm.last, doubt=crash.reason)))

    return tuple(map(put_down, told))


def crash_of(watches: Sequence[Watch], excursions: Sequence[Excursion]) -> Excursion | None:
    """Return the first hard contact, or failure, after which the aircraft doesn't fly on; None where it always does.

    Parameters
    ----------
    watches : sequence of Watch
    excursions : sequence of Excursion
        Of the whole log.
    """
    return min(_crashes(watches, excursions), key=lambda each: each.start_s, default=None)


def _crashes(watches: Sequence[Watch], excursions: Sequence[Excursion]) -> list[Excursion]:
    """Return the hard contacts, and the failures that an autopilot tells of, after which the aircraft doesn't fly."""
    hard = [each for each in excursions if each.reason == FAILURE or (each.is_hard and each.reason in CONTACTS)]
    flown_s = _flown_s(watches) if hard else np.zeros(0)
    return [each for each in hard if not _flies_on(flown_s, each.end_s)]


def _flown_s(watches: Sequence[Watch]) -> FloatArray:
    """Return the seconds of watches in which the aircraft turned, and an alarm was possible."""
    times_s = [np.zeros(0)]
    for watch in watches:
        if {*GYROS, *ATTITUDE} <= set(watch.record.channels):
            seconds_s, turning = turning_by_second([watch.record])
            rows = np.searchsorted(watch.record.time_s, seconds_s)
            times_s.append(seconds_s[(turning > LIVELY_DEG_S) & watch.armed[rows]])
    return np.concatenate(times_s)


def _flies_on(flown_s: FloatArray, start_s: float, end_s: float = np.inf) -> bool:
    """Tell whether it flew for long enough between two times."""
    return int(np.count_nonzero((flown_s >= start_s) & (flown_s < end_s))) >= _FLIES_ON_S


def _is_of_contact(alarm: Alarm) -> bool:
    return alarm.is_first and not alarm.has_passed and alarm.doubt in CONTACTS


def _is_open(alarm: Alarm) -> bool:
    return not alarm.has_passed and not _is_of_contact(alarm)


def _is_near(excursion: Excursion, alarm: Alarm) -> bool:
    last_s = alarm.time_s if alarm.ended_s is None else alarm.ended_s
    return excursion.start_s <= last_s + _NEAR_S and excursion.end_s >= alarm.onset_s - _NEAR_S


def _explained(alarm: Alarm, ended_s: float) -> Alarm:
    judged = Judgement(time_s=max(ended_s, alarm.time_s), sensor=None, candidates=(), reason=alarm.doubt)
    return replace(alarm, judgements=(*alarm.judgements, judged))
