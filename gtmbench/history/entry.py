"""What a history keeps of a flight: the constants that its judging learnt, by kinds, and whose they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from gtmbench.engine.course.course import OF_WHITE
from gtmbench.engine.equation import Equation, rows_per_chunk
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.engine.judged import Judged
from gtmbench.engine.relation import BETWEEN
from gtmbench.engine.sums import WindowSums
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

OFFSET, AT_REST, FACTOR, NOISE, LAG = "offset", "offset at rest", "factor", "noise", "lag"
MISALIGNMENT = "misalignment"  # towards another axis, whose name stands behind it


@dataclass(frozen=True, kw_only=True)
class ConstantKind:
    """What holds for the constants of one kind."""

    unit: str
    # by how much a healthy sensor's differs from flight to flight at least: no smaller spread is believed
    spread: float
    population: float  # by how much those of two installations differ
    failure: float  # by how much it is off of a sensor that failed
    per_k: float = 0.0  # by how much it changes with each kelvin: a standard deviation over sensors
    tells: bool = False  # whether a change of it alone is a sensor's failure; others only tell of an installation


# Spreads are the floors of the engine's relations: what a constant may change by from one part of a log to another; of
# a factor what sheets say that it changes by over a sensor's life. Failures are the relations' priors. Populations, and
# what a kelvin changes, are by the sheets of the IMUs that autopilots have (BMI055, BMI088, ICM-20602, ICM-20689,
# MPU-6000): biases of 1 deg/s, 0.01 to 0.2 deg/s a kelvin; scales of 1 to 3 %, 0.01 to 0.05 % a kelvin; axes 1 to 2 %
# askew; noises that differ by a third.
KINDS: Mapping[str, ConstantKind] = MappingProxyType(
    {
        OFFSET: ConstantKind(unit="deg/s", spread=0.1, population=1.0, failure=3.0, per_k=0.05, tells=True),
        AT_REST: ConstantKind(unit="deg/s", spread=0.1, population=1.0, failure=3.0, per_k=0.05, tells=True),
        FACTOR: ConstantKind(unit="", spread=0.005, population=0.02, failure=0.1, per_k=5e-4, tells=True),
        NOISE: ConstantKind(unit="", spread=0.1, population=0.3, failure=1.0, tells=True),
        MISALIGNMENT: ConstantKind(unit="deg", spread=0.5, population=1.0, failure=5.0),
        LAG: ConstantKind(unit="s", spread=0.01, population=0.02, failure=0.1),
    }
)


@dataclass(frozen=True, kw_only=True)
class Constant:
    """A constant of a sensor, as a flight tells it.

    >>> read = Constant(sensor="q", name="misalignment p", value=0.4, deviation=0.1)
    >>> read.kind.unit
    'deg'
    """

    sensor: str  # ``q``, ``q of IMU2``
    name: str  # ``offset``, ``factor``, ``misalignment p``, ``noise``, ..
    value: float  # in its kind's unit; of a noise the natural logarithm of its standard deviation in the sensor's unit
    deviation: float  # the standard deviation of what the flight tells it by

    @property
    def key(self) -> tuple[str, str]:
        """Which constant it is, in every flight."""
        return self.sensor, self.name

    @property
    def kind(self) -> ConstantKind:
        """What holds for all of its kind."""
        return kind_of(self.name)


def kind_of(name: str) -> ConstantKind:
    """Return what holds for a constant's kind: ``misalignment p`` is a misalignment."""
    return KINDS[MISALIGNMENT if name.startswith(MISALIGNMENT) else name]


_FEWEST = 5  # chunks whose means tell how well a noise is known
_MEDIAN = np.sqrt(0.5 * np.pi)  # the deviation of a median over that of a mean, of normal values


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A flight in a history."""

    digest: str  # of the log's file: a log is entered once
    log: str  # the file's name
    airframe: str
    hardware: str = ""  # the autopilot's identifier; "" where the log states none
    temperature_c: float = float("nan")  # the IMU's over the flight; NaN where it isn't logged
    constants: tuple[Constant, ...] = field(default=(), repr=False)
    # those that weren't as in the flights before: they are no part of what later ones are held against
    apart: frozenset[tuple[str, str]] = frozenset()
    begins: bool = False  # whether an installation begins with it: no earlier flight tells of later ones

    def is_on(self, other: Entry) -> bool | None:
        """Tell whether another flight was flown with the same autopilot; None where one of them doesn't say."""
        return self.hardware == other.hardware if self.hardware and other.hardware else None

    @cached_property
    def by_key(self) -> Mapping[tuple[str, str], Constant]:
        """Its constants, by which they are."""
        return {each.key: each for each in self.constants}


def constants_of(judged: Judged) -> tuple[Constant, ...]:
    """Return the constants that a judged flight tells of its gyros, without what was found to have failed."""
    found: dict[tuple[str, str], Constant] = {}
    turned = {imu.name for imu in judged.flight.imus if imu.mounting.turned_deg}  # whose gyros a log calls otherwise
    for sums in judged.model.sums:
        for each in _of_equation(judged, sums):
            if gyro_and_imu(each.sensor)[1] not in turned:
                found.setdefault(each.key, each)
    return tuple(found.values())


def _of_equation(judged: Judged, sums: WindowSums) -> Iterator[Constant]:
    equation = sums.products.equation
    name, sensor = equation.relation.name, equation.relation.channels[equation.channel]
    if name == "roughness":
        yield from _noise(judged, equation, sensor)
    elif name == "rest":
        value, deviation = equation.constants, _deviations(sums)
        yield Constant(sensor=sensor, name=AT_REST, value=float(value[0]), deviation=float(deviation[0]))
    elif name == "attitude" or (name.startswith(BETWEEN) and "roughness" not in name):
        own = _of_gyro(equation, sensor, _deviations(sums))
        follows = name == "attitude" and judged.flight.is_driven and not judged.flight.is_assumed
        yield from (each for each in own if each.name == OFFSET or not follows)  # it turns as its gyros say


def _of_gyro(equation: Equation, sensor: str, deviations: FloatArray) -> Iterator[Constant]:
    """Give what y = offset + gains * gyros + lag * slope tells; one that reads k of a turn has a gain of 1 - 1 / k."""
    axis = GYROS.index(gyro_and_imu(sensor)[0])
    is_between = equation.relation.name.startswith(BETWEEN)
    theta = equation.constants
    yield Constant(sensor=sensor, name=OFFSET, value=float(theta[0]), deviation=float(deviations[0]))
    for place, gyro in enumerate(GYROS, 1):
        gain, deviation = float(theta[place]), float(deviations[place])
        if place == 1 + axis:
            factor = 1.0 + gain if is_between else 1.0 / max(1.0 - gain, 1e-3)
            slope = 1.0 if is_between else factor**2
            yield Constant(sensor=sensor, name=FACTOR, value=factor, deviation=slope * deviation)
        else:
            askew = f"{MISALIGNMENT} {gyro}"
            yield Constant(
                sensor=sensor, name=askew, value=np.degrees(gain).item(), deviation=np.degrees(deviation).item()
            )
    yield Constant(sensor=sensor, name=LAG, value=float(theta[4]), deviation=float(deviations[4]))


def _deviations(sums: WindowSums) -> FloatArray:
    """Return the standard deviations of an equation's constants: the whole log's information, and their priors."""
    equation = sums.products.equation
    first, last = np.array([0], dtype=np.int64), np.array([sums.cells], dtype=np.int64)
    known = 1 + len(equation.constants)
    squares = sums.known(first, last)[0, 1:known, 1:known]
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(squares + np.diag(equation.relation.prior**-2.0)))))


def _noise(judged: Judged, equation: Equation, sensor: str) -> Iterator[Constant]:
    """Give how noisy a gyro is in motion, by its roughness; by how much means of chunks scatter, it is known."""
    values = equation.relation.values[:, equation.channel]
    values = np.where(equation.relation.asked & np.isfinite(values), values, np.nan)
    rows = rows_per_chunk(judged.flight)
    chunks = values[: len(values) // rows * rows].reshape(-1, rows)
    means = chunks[np.isfinite(chunks).mean(axis=1) > 0.5]
    if len(means) < _FEWEST:
        return
    logs = 0.5 * (np.nanmean(means, axis=1) - np.log(OF_WHITE))
    middle = float(np.median(logs))
    scatter = 1.4826 * float(np.median(np.abs(logs - middle)))
    yield Constant(sensor=sensor, name=NOISE, value=middle, deviation=_MEDIAN * scatter / float(np.sqrt(len(logs))))
