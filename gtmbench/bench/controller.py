"""Controllers of one's own: what they are, and one that has taken over an aircraft."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from gtmbench.bench.loop_flight import ControllerError, LoopEvent
from gtmbench.bench.sensing import Readings
from gtmbench.bench.trim import Trim
from gtmbench.checks import one_line, shown
from gtmbench.errors import InputError
from gtmbench.imports import brought_object

Command = Callable[[Readings, float], Sequence[float]]
_WANTED = "give a function of (readings, time_s), or an object or a class with a method command(readings, time_s)"


class Controller(Protocol):
    """The protocol of a controller of your own.

    It may have a method ``start(trim)``, which is called before every flight with the steady flight (`Trim`) it begins
    in. What a controller keeps from sample to sample it should forget there; or give the class itself, without
    arguments: it is then made anew for every flight. It may say which channels it reads, ``reads = ("p", "q")``:
    then a fault of another one is an event, "out of loop". It may have a method ``told(event)``, which is called when a
    `SurfaceWatch` names a surface that failed (`LoopEvent`).

    Examples
    --------
    >>> import gtmbench as gb
    >>> class Damper:
    ...     def start(self, trim):
    ...         self.level = trim.commands
    ...
    ...     def command(self, readings, time_s):
    ...         level = self.level
    ...         return level["elevator"] + 0.3 * readings.q, level["aileron"], level["rudder"], level["throttle"]
    >>> flight = gb.fly_in_loop(duration_s=5.0, controller=Damper())
    >>> flight.departed_s is None
    True
    """

    def command(self, readings: Readings, time_s: float) -> Sequence[float]:
        """Return elevator, aileron and rudder in deg and throttle in percent, for one sample.

        Parameters
        ----------
        readings : Readings
            What the sensors read, faults included; NaN where a reading is missing. With an `Accommodation`, what that
            hands on.
        time_s : float
            In seconds since the flight began. It is called once a sample, every 0.01 s.
        """


def check_controller(controller: object) -> None:
    """Refuse what is no controller."""
    if not callable(controller) and not callable(getattr(controller, "command", None)):
        raise InputError(f"controller is {shown(controller)}; {_WANTED}")
    if isinstance(controller, type) and not callable(getattr(controller, "command", None)):
        raise InputError(f"controller is the class {controller.__name__}, which has no method command; {_WANTED}")


def name_of(controller: object) -> str:
    """Return what a controller is called in messages: its function's or class's name."""
    return str(getattr(controller, "__name__", None) or type(controller).__name__)


def take_over(controller: Any, trim: Trim) -> Command:
    """Return what commands one flight: a class is made anew, and what has `start` is told the trim."""
    check_controller(controller)
    try:
        made = controller() if isinstance(controller, type) else controller
        if callable(start := getattr(made, "start", None)):
            start(trim)
    except Exception as error:  # somebody's own controller may do anything
        raise failed(controller, "before the flight", error) from error
    command: Command = made.command if callable(getattr(made, "command", None)) else made
    return command


def listener(command: Command) -> Callable[[LoopEvent], object] | None:
    """Return the method of a controller that is told of events; None of one that has none."""
    told = getattr(getattr(command, "__self__", None), "told", None)
    return told if callable(told) else None


def failed(controller: object, when: str, error: Exception) -> ControllerError:
    """Return the error of a controller that has raised, or whose commands were refused, in a line."""
    said = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
    return ControllerError(one_line(f"controller '{name_of(controller)}' {when}: {said}"))


def found_controller(source: str) -> object:
    """Return the controller that a scenario names, ``FILE.py:OBJECT``, of a file that has been imported before."""
    controller = brought_object(source)
    check_controller(controller)
    return controller
