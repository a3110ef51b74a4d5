"""Whom only one choice of what is healthy accuses: what nobody said to be healthy may hold a fault, or too little."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress
from gtmbench.study.log.corrections import CORRECTED
from gtmbench.study.log.corrections import WINDOWS as CORRECTED_OVER
from gtmbench.study.log.field_witnesses import FORCES
from gtmbench.study.log.healthy import chosen
from gtmbench.study.log.imu_comparison import with_doubt
from gtmbench.study.log.learnt import learnt
from gtmbench.study.log.mishaps import mishaps
from gtmbench.study.log.rests import AT_REST
from gtmbench.study.log.said import Said, doubted, listened
from gtmbench.study.log.seconds import SECOND_S
from gtmbench.study.log.slow_means import SLOW, WINDOWS

_APART_S = 6.0  # before an accusation, what is learnt from anew: it has to have listened when the fault begins
_SOON_S = 10.0  # between the onsets of one fault


def agreed(said: Said, progress: Progress) -> Said:
    """Doubt whom only one choice of what is healthy accuses, where nobody said what is.

    The other choice is all that was flown before the first accusation, or a mishap: a fault shows by both. What came
    before that, taxi and standing, teaches no choice anything. Whom accelerometers name beside the attitude needs no
    second choice.

    Parameters
    ----------
    said : Said
        As `doubted` returns it.
    progress : callable
    """
    opened, accused = said.learnt.opened, list(_accusing(said))
    if opened.asked.says_healthy or not said.learnt.identified_s or not accused:
        return said
    first_s, last_s = said.learnt.identified_s[0]
    until_s = min(_begun_s(alarm, last_s) for alarm in accused)
    moving = () if opened.own.motion is None else opened.own.motion.segments
    grieved_s = [each.span[0] for each in mishaps(opened.log.events, moving)]
    until_s = min([until_s, *(time_s for time_s in grieved_s if time_s > last_s)])
    others: list[Alarm] = []
    with contextlib.suppress(InputError):  # too little to learn from: nobody else accuses
        again = replace(opened, asked=replace(opened.asked, spans=((first_s, until_s),)))
        other = doubted(listened(learnt(chosen(again), progress), progress), progress)
        others = [*_accusing(other), *(other.corrections.alarms if other.corrections else ())]
    doubt = (
        f"it shows if {first_s:.0f} to {last_s:.0f} s are taken as healthy, not if {first_s:.0f} to {until_s:.0f} s are"
    )

    def doubtful(alarm: Alarm) -> Alarm:
        is_alone = _accuses(alarm) and not any(_agree(alarm, other) for other in others)
        return with_doubt(alarm, doubt) if is_alone else alarm

    return _each(said, doubtful)


def _begun_s(alarm: Alarm, last_s: float) -> float:
    """Return until when another choice may learn: a slow fault began before its mean rose.

    It learns on more than the choice that ends at `last_s` where it can.
    """
    until_s = alarm.onset_s - _APART_S
    earlier_s = until_s - WINDOWS[-1] * SECOND_S
    return earlier_s if alarm.test == SLOW and earlier_s > last_s else until_s


def _each(said: Said, change: Callable[[Alarm], Alarm]) -> Said:
    """Return what was said with every alarm changed."""
    watches = tuple(replace(watch, alarms=tuple(map(change, watch.alarms))) for watch in said.watches)
    means = said.means and replace(said.means, alarms=tuple(map(change, said.means.alarms)))
    gains = said.gains and replace(said.gains, alarms=tuple(map(change, said.gains.alarms)))
    pulls = said.corrections and replace(said.corrections, alarms=tuple(map(change, said.corrections.alarms)))
    return replace(said, watches=watches, means=means, gains=gains, corrections=pulls)


def _accusing(said: Said) -> Iterator[Alarm]:
    """Give the alarms that must be a fault, by what was learnt."""
    yield from (alarm for watch in said.watches for alarm in watch.alarms if _accuses(alarm))
    for slow in (said.means, said.gains, said.corrections):
        yield from (alarm for alarm in (slow.alarms if slow else ()) if _accuses(alarm))


def _accuses(alarm: Alarm) -> bool:
    """Tell whether an alarm must be a fault by a model; of missing samples none tells, and some witnesses need none."""
    return alarm.test != MISSING and alarm.is_first and alarm.accuses and not _by_witness(alarm)


def _by_witness(alarm: Alarm) -> bool:
    """Tell whether accelerometers named it, or its readings at rest: these measured it, whatever a monitor learnt."""
    return alarm.last is not None and alarm.last.witness.startswith((f"{FORCES}: ", f"{AT_REST}: "))


def _agree(alarm: Alarm, other: Alarm) -> bool:
    """Tell whether another alarm is of the same fault.

    What references take back shows in windows that are long, and whose bounds hang on the choice: a doubt is enough.
    """
    soon_s = CORRECTED_OVER[-1] * SECOND_S if CORRECTED in (alarm.test, other.test) else _SOON_S
    is_told = other.accuses or alarm.test == CORRECTED
    return (
        bool(set(alarm.candidates) & set(other.candidates)) and is_told and abs(alarm.onset_s - other.onset_s) <= soon_s
    )
