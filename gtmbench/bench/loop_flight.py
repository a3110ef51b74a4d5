"""What a flight in the loop gives: its truth, what the sensors read, and its events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gtmbench.errors import GtmbenchError
from gtmbench.values.channels import COMMANDS
from gtmbench.values.record import Record, with_columns

if TYPE_CHECKING:
    from gtmbench.bench.stepping import OutsideSpans

DEPARTURE, ENVELOPE, OUT_OF_LOOP = "departure", "envelope", "out of loop"
SURFACE_FAILED = "surface failed"


@dataclass(frozen=True, kw_only=True)
class LoopEvent:
    """An event in a closed-loop flight.

    Attributes
    ----------
    time_s : float
    kind : str
        "departure": the aircraft is first beyond a limit of its ``[departure]``; "envelope": it left the range of its
        model, or its estimator's theta that of Euler angles, where the flight ends; "out of loop": a fault began on a
        channel that the autopilot doesn't read; "surface failed": a `SurfaceWatch` has named a surface; and the events
        of an `Accommodation`.
    channel : str
    value : float or None
        The channel's value in its unit, if it matters.
    fault : str or None
        The kind of a surface's fault, where it is known: there is an event when a surface is named, and another when
        the kind shows.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly_in_loop(duration_s=4.0, faults=gb.SignFlip(channel="q", onset_s=2.0))
    >>> event = flight.events[0]
    >>> event.kind, 2.0 < event.time_s < 4.0
    ('departure', True)
    """

    time_s: float
    kind: str
    channel: str
    value: float | None = None
    fault: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopFlight:
    """A flight with an autopilot in the loop.

    Attributes
    ----------
    truth : Record
        Every channel, as `fly` gives it; it ends early if the aircraft left its envelope.
    sensed : Record
        The sensor readings, noise and faults included, before any accommodation.
    events : tuple of LoopEvent
        In the order of their times.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly_in_loop(duration_s=2.0)
    >>> flight.departed_s is None, len(flight.truth) == len(flight.sensed)
    (True, True)
    >>> [name for name in flight.readings(commands=True).channels if name not in flight.sensed]
    ['elevator', 'aileron', 'rudder', 'throttle']
    """

    truth: Record = field(repr=False)
    sensed: Record = field(repr=False)
    events: tuple[LoopEvent, ...]

    @property
    def departed_s(self) -> float | None:
        """When the aircraft departed or left its envelope; None if it didn't."""
        return departed_s(self.events)

    def readings(self, *, commands: bool = False) -> Record:
        """Return `sensed`, optionally with the surface commands."""
        return with_columns(self.sensed, COMMANDS, [self.truth.matrix(COMMANDS)]) if commands else self.sensed


def departed_s(events: Sequence[LoopEvent]) -> float | None:
    """Return when a departure, or the end of an envelope, comes first among events; None: never."""
    return min((event.time_s for event in events if event.kind in (DEPARTURE, ENVELOPE)), default=None)


def event_of(kind: str, flight: Record, outside: OutsideSpans) -> LoopEvent:
    """Return the event of a flight that is first outside of some spans."""
    return LoopEvent(time_s=float(flight.time_s[outside.row]), kind=kind, channel=outside.channel, value=outside.value)


class ControllerError(GtmbenchError):
    """A controller of your own has failed in flight: it raised, or its commands can't be flown.

    Attributes
    ----------
    flight : LoopFlight
        What was flown until then.

    Examples
    --------
    >>> import gtmbench as gb
    >>> def asleep(readings, time_s):
    ...     return None
    >>> try:
    ...     gb.fly_in_loop(controller=asleep)
    ... except gb.ControllerError as error:
    ...     print(str(error).split(";")[0], len(error.flight.truth))
    controller 'asleep' at 0 s: commands are None 1
    """

    flight: LoopFlight
