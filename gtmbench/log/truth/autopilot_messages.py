"""The autopilot's word beside ours: what it said of its sensors and estimators on the same log, and who was first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gtmbench.detectors.alarm import Alarm
from gtmbench.intake.events import Event, EventKind

NEAR_S = 30.0  # of an alarm: further away it is about something else
SENSORS = ("gyro", "accelerometer")


@dataclass(frozen=True, kw_only=True)
class Beside:
    """An alarm of ours, and the autopilot's word that stands nearest."""

    alarm: Alarm
    # of a sensor if there is such a one near, else of an estimator or of the flight; None where there is none near
    word: Event | None

    @property
    def ahead_s(self) -> float | None:
        """By how many seconds our alarm came before it."""
        return None if self.word is None else self.word.time_s - self.alarm.time_s


def words_of(events: Iterable[Event]) -> tuple[Event, ...]:
    """Return what an autopilot says is wrong: complaints, failures, an estimator that takes over.

    >>> told = [Event(kind=EventKind.ARM, time_s=1.0, text=""), Event(kind=EventKind.FAILURE, time_s=2.0, text="crash")]
    >>> [event.text for event in words_of(told)]
    ['crash']
    """
    return tuple(event for event in events if event.kind in (EventKind.COMPLAINT, EventKind.FAILURE) or event.about)


def of_sensors(words: Iterable[Event]) -> tuple[Event, ...]:
    """Return those that are about gyros and accelerometers."""
    return tuple(word for word in words if word.about in SENSORS)


def beside(alarms: Iterable[Alarm], words: Sequence[Event]) -> tuple[Beside, ...]:
    """Return every alarm with the word that stands beside it.

    >>> word = Event(kind=EventKind.COMPLAINT, time_s=12.5, text="gyro 1 isn't healthy", about="gyro", number=1)
    >>> beside([Alarm(number=0, time_s=11.0, onset_s=10.0, source="q")], [word])[0].ahead_s
    1.5
    """
    return tuple(Beside(alarm=alarm, word=_nearest(alarm.time_s, words)) for alarm in alarms)


def _nearest(time_s: float, words: Sequence[Event]) -> Event | None:
    near = [word for word in words if abs(word.time_s - time_s) <= NEAR_S]
    return min(of_sensors(near) or near, key=lambda word: abs(word.time_s - time_s), default=None)


def first_between(words: Iterable[Event], start_s: float, end_s: float) -> Event | None:
    """Return the first word within a time, of a sensor where there is one."""
    within = [word for word in words if start_s <= word.time_s < end_s]
    return min(of_sensors(within) or within, key=lambda word: word.time_s, default=None)
