"""What a log says of its flight beside channels: resets, takeoff and touchdown, arming, failures, complaints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gtmbench.checks import one_line
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray

_AT_ONCE_S = 0.5  # of a kind and so close: one, told twice
_CALM_S = 5.0  # until a flag that rises again tells something anew
_BESIDE_S = 5.0  # of a log's first and last sample: further away no event is this flight's


class EventKind(StrEnum):
    """The kinds of events.

    A reset is a jump of attitude or heading without motion, because an estimator is reset or another one takes over.
    Resets of position, velocity and height don't touch the attitude and aren't events. A failure is a failure of the
    flight that the autopilot found. A complaint is its statement on a sensor, or its estimator's on the sensors.

    Examples
    --------
    >>> import gtmbench as gb
    >>> [kind.value for kind in gb.EventKind]
    ['reset', 'takeoff', 'touchdown', 'arm', 'disarm', 'failure', 'complaint']
    """

    RESET = "reset"
    TAKEOFF = "takeoff"
    TOUCHDOWN = "touchdown"
    ARM = "arm"
    DISARM = "disarm"
    FAILURE = "failure"
    COMPLAINT = "complaint"


# at one time
_ORDER = [EventKind(name) for name in ("complaint", "failure", "touchdown", "disarm", "arm", "takeoff", "reset")]


@dataclass(frozen=True, kw_only=True)
class Event:
    """An event that a log records.

    Attributes
    ----------
    kind : EventKind
    time_s : float
        On the log's clock.
    text : str
        In words, with the message and its value.
    about : str
        The part of the autopilot that it concerns, if any: ``gyro``, ``accelerometer``, ``estimator``.
    number : int or None
        The number of that part, from 1.

    Examples
    --------
    >>> import gtmbench as gb
    >>> jump = gb.Event(kind=gb.EventKind.RESET, time_s=31.2, text="attitude by 4 deg")
    >>> jump.kind.value, jump.time_s
    ('reset', 31.2)
    """

    kind: EventKind
    time_s: float
    text: str
    about: str = ""
    number: int | None = None


def in_order(events: Iterable[Event]) -> tuple[Event, ...]:
    """Return events in time; what several messages tell at once is one, and what ends comes before what begins.

    >>> told = [Event(kind=EventKind.RESET, time_s=t, text=text) for t, text in ((2.1, "of 3 deg"), (2.0, "heading"))]
    >>> in_order(told)
    (Event(kind=<EventKind.RESET: 'reset'>, time_s=2.0, text='heading; of 3 deg', about='', number=None),)
    """
    told: list[Event] = []
    last: dict[object, int] = {}
    for event in sorted(events, key=lambda event: (event.time_s, _ORDER.index(event.kind))):
        alike = (event.about, event.number) if event.kind is EventKind.COMPLAINT else event.kind
        place = last.get(alike)
        if place is not None and event.time_s - told[place].time_s <= _AT_ONCE_S:
            before = told[place]
            texts = dict.fromkeys([*before.text.split("; "), event.text])
            part = before if before.about else event
            told[place] = replace(before, text="; ".join(texts), about=part.about, number=part.number)
            continue
        last[alike] = len(told)
        told.append(event)
    return tuple(replace(event, text=one_line(event.text)) for event in told)


def of_flight(events: Iterable[Event], start_s: float, end_s: float) -> tuple[Event, ...]:
    """Return events in time that lie within a flight, or just beside it."""
    return in_order(event for event in events if start_s - _BESIDE_S <= event.time_s <= end_s + _BESIDE_S)


def of_kind(events: Iterable[Event], *kinds: EventKind) -> list[Event]:
    """Return the events of some kinds."""
    return [event for event in events if event.kind in kinds]


def complaints(times_s: Iterable[float], text: str, about: str, number: int | None = None) -> list[Event]:
    """Return what an autopilot says against a sensor, at some times."""
    kind = EventKind.COMPLAINT
    return [Event(kind=kind, time_s=float(at_s), text=text, about=about, number=number) for at_s in times_s]


def onsets(time_s: FloatArray, raised: BoolArray) -> list[int]:
    """Return the samples with which a flag rises that was down for 5 s; one that it begins with isn't.

    >>> onsets(np.arange(8.0), np.array([0, 1, 1, 0, 1, 0, 0, 0], dtype=bool))
    [1]
    """
    rises = np.flatnonzero(raised[1:] & ~raised[:-1]) + 1
    up = np.flatnonzero(raised)
    before = np.searchsorted(up, rises) - 1
    calm = (before < 0) | (time_s[rises] - time_s[up[np.maximum(before, 0)]] >= _CALM_S)
    return [int(row) for row in rises[calm]]


def touchdowns(contacts: Sequence[tuple[float, bool]], landings: Sequence[tuple[float, bool]]) -> list[float]:
    """Return when an aircraft touched down: a landing is told when it is over, contact with the ground as it begins.

    >>> touchdowns([(3.0, True), (4.0, False), (8.0, True)], [(1.0, False), (9.0, True)])
    [8.0]
    """
    times_s = []
    for number, (time_s, landed) in enumerate(landings):
        if landed:
            up_s = landings[number - 1][0] if number else float("-inf")
            before = [(at_s, touching) for at_s, touching in contacts if up_s < at_s <= time_s]
            times_s.append(before[-1][0] if before and before[-1][1] else time_s)
    return times_s
