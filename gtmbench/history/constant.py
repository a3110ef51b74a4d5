"""A constant of a sensor over a flight, and what constants of a kind differ by in health."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

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
    >>> read.kind.unit, read.interval
    ('deg', (0.2, 0.6))
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

    @property
    def interval(self) -> tuple[float, float]:
        """Between which it lies with 95 %."""
        off = 1.96 * self.deviation
        return round(self.value - off, 2), round(self.value + off, 2)


def kind_of(name: str) -> ConstantKind:
    """Return what holds for a constant's kind: ``misalignment p`` is a misalignment."""
    return KINDS[MISALIGNMENT if name.startswith(MISALIGNMENT) else name]
