"""What PX4 drove its surfaces to, by control allocation's parameters: `actuator_servos`, or the pulses of its outputs.

A surface k has the torque of a full throw about each axis, CA_SV_CSk_TRQ_R, _P and _Y, and a trim. An axis that several
surfaces serve (two ailerons, elevons, a V-tail) is told by its torque over that of all of them at full throw,

    sum of TRQ_k (u_k - TRIM_k) / sum of |TRQ_k|,

so that 1 is the full throw of all. Where only pulses are logged, u follows from an output's function (201 is servo 1),
its limits and its bit of REV. Torques are positive rolling right, pitching up and yawing right, as setpoints are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.formats.raw import Meaning, RawSeries
from gtmbench.intake.units import THROW

_SERVOS, _MOTORS, _OUTPUTS = "actuator_servos", "actuator_motors", "actuator_outputs"
_AXES = {"aileron": "R", "elevator": "P", "rudder": "Y"}
_FIXED_WING, _STANDARD_VTOL = 1, 2  # CA_AIRFRAME; others' servos tilt rotors, too, or turn with the aircraft
_MOST = 8  # surfaces, and motors
_MOST_OUTPUTS = 16
_WITHOUT_TORQUE = (9, 10, 11)  # flaps and airbrakes, whatever their torques say
_FIRST_MOTOR, _FIRST_SERVO = 101, 201  # functions of outputs
_LIMITS_US = {"MIN": 1000.0, "MAX": 2000.0}  # where they aren't told
_PREFIXES = ("PWM_MAIN", "PWM_AUX")
_ROUNDING_US = 1.5
Values = NDArray[np.float64]
Topics = Mapping[str, Mapping[str, NDArray[Any]]]
_Load = Callable[[], Values]


def servo_series(settings: Mapping[str, float], topics: Topics) -> list[RawSeries]:
    """Return the surfaces and the throttle that servos and motors were driven to, each as a column.

    Parameters
    ----------
    settings : mapping
        Parameters of the autopilot by name.
    topics : mapping of topic to mapping of field to values
    """
    airframe = settings.get("CA_AIRFRAME")
    if airframe not in (_FIXED_WING, _STANDARD_VTOL) or settings.get("SYS_CTRL_ALLOC", 1) != 1:
        return []
    driven = _Driven(settings, topics)
    found = []
    for channel, axis in _AXES.items():
        torques = {surface: torque for surface in range(_MOST) if (torque := _torque(settings, surface, axis))}
        servos = [driven.servo(surface) for surface in torques]
        known = [servo for servo in servos if servo is not None]
        if known and len(known) == len(servos):
            trims = [settings.get(f"CA_SV_CS{surface}_TRIM", 0.0) for surface in torques]
            load = partial(_served, [servo[1] for servo in known], list(torques.values()), trims)
            found.append(_column(channel, load, [servo[0] for servo in known], THROW, -1.0))
    if airframe == _FIXED_WING:
        motors = [driven.motor(number) for number in range(int(min(settings.get("CA_ROTOR_COUNT", 1), _MOST)))]
        known = [motor for motor in motors if motor is not None]
        if known and len(known) == len(motors):
            load = partial(_mean, [motor[1] for motor in known])
            found.append(_column("throttle", load, [motor[0] for motor in known], "norm", 1.0))
    return found


class _Driven:
    """Servos from -1 to 1 and motors from 0 to 1: each as the name of its column, and what loads it; None: not told."""

    def __init__(self, settings: Mapping[str, float], topics: Topics) -> None:
        self._settings, self._topics = settings, topics
        self._outputs = self._found_outputs()

    def servo(self, number: int) -> tuple[str, _Load] | None:
        """Return a servo."""
        return self._of_topic(_SERVOS, number) or self._of_output(_FIRST_SERVO + number, 2.0, -1.0)

    def motor(self, number: int) -> tuple[str, _Load] | None:
        """Return a motor."""
        return self._of_topic(_MOTORS, number) or self._of_output(_FIRST_MOTOR + number, 1.0, 0.0)

    def _of_topic(self, topic: str, number: int) -> tuple[str, _Load] | None:
        values = self._topics.get(topic, {}).get(f"control[{number}]")
        return None if values is None else (f"{topic}.control[{number}]", partial(np.asarray, values, dtype=float))

    def _of_output(self, function: int, span: float, least: float) -> tuple[str, _Load] | None:
        if self._outputs is None:
            return None
        prefix, topic = self._outputs
        numbers = [number for number, of in _functions(self._settings, prefix).items() if of == function]
        if len(numbers) != 1:
            return None
        values = self._topics[topic].get(f"output[{numbers[0] - 1}]")
        if values is None:
            return None
        return f"{topic}.output[{numbers[0] - 1}]", partial(
            _turned_back, values, self._settings, prefix, numbers[0], span, least
        )

    def _found_outputs(self) -> tuple[str, str] | None:
        """Return which outputs drive servos, and the topic's instance that has them: one that fits, or none."""
        fitting = [
            (prefix, topic)
            for prefix in _PREFIXES
            for topic, fields in self._topics.items()
            if topic.partition("#")[0] == _OUTPUTS and _fits(self._settings, prefix, fields)
        ]
        return fitting[0] if len(fitting) == 1 else None


def _torque(settings: Mapping[str, float], surface: int, axis: str) -> float:
    """Return the torque of a surface's full throw; 0 where there is none."""
    is_there = surface < settings.get("CA_SV_CS_COUNT", 0)
    if not is_there or settings.get(f"CA_SV_CS{surface}_TYPE") in _WITHOUT_TORQUE:
        return 0.0
    return settings.get(f"CA_SV_CS{surface}_TRQ_{axis}", 0.0)


def _functions(settings: Mapping[str, float], prefix: str) -> dict[int, int]:
    """Return the functions of servos and motors, by the output's number."""
    of = {number: int(settings.get(f"{prefix}_FUNC{number}", 0)) for number in range(1, _MOST_OUTPUTS + 1)}
    first = (_FIRST_MOTOR, _FIRST_SERVO)
    return {number: function for number, function in of.items() if any(0 <= function - each < _MOST for each in first)}


def _fits(settings: Mapping[str, float], prefix: str, fields: Mapping[str, NDArray[Any]]) -> bool:
    """Tell whether pulses lie within an output's limits most of the time, of all that drive something."""
    numbers = _functions(settings, prefix)
    if not any(function >= _FIRST_SERVO for function in numbers.values()):
        return False
    for number in numbers:
        values = fields.get(f"output[{number - 1}]")
        if values is None or np.mean(_within(values, *_limits(settings, prefix, number))) <= 0.5:
            return False
    return True


def _limits(settings: Mapping[str, float], prefix: str, number: int) -> tuple[float, float]:
    least, most = (settings.get(f"{prefix}_{name}{number}", value) for name, value in _LIMITS_US.items())
    return min(least, most), max(least, most)


def _within(pulses: NDArray[Any], least: float, most: float) -> NDArray[np.bool_]:
    return np.asarray((pulses >= least - _ROUNDING_US) & (pulses <= most + _ROUNDING_US))


def _turned_back(
    pulses: NDArray[Any], settings: Mapping[str, float], prefix: str, number: int, span: float, begin: float
) -> Values:
    """Return what an output was asked for; NaN where it wasn't within its limits, as while disarmed."""
    least, most = _limits(settings, prefix, number)
    share = np.where(_within(pulses, least, most), (pulses - least) / max(most - least, 1.0), np.nan)
    is_reversed = int(settings.get(f"{prefix}_REV", 0)) >> (number - 1) & 1
    return np.asarray(begin + span * (1.0 - share if is_reversed else share), dtype=np.float64)


def _served(loads: Sequence[_Load], torques: Sequence[float], trims: Sequence[float]) -> Values:
    """Return how much of an axis' torque at full throw is asked for."""
    turned = sum(torque * (load() - trim) for load, torque, trim in zip(loads, torques, trims, strict=True))
    return np.asarray(turned / sum(map(abs, torques)))


def _mean(loads: Sequence[_Load]) -> Values:
    return np.asarray(np.mean([load() for load in loads], axis=0))


def _column(channel: str, load: _Load, made_of: Sequence[str], unit: str, sign: float) -> RawSeries:
    topic = made_of[0].partition(".")[0]
    name = made_of[0] if len(made_of) == 1 else f"{topic}.{channel}"
    meaning = Meaning(channel=channel, unit=unit, sign=sign)
    return RawSeries(name=name, load=load, clock=topic, meaning=meaning, made_of=tuple(made_of))
