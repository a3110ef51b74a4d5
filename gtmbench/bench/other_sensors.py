"""The sensors that a flight may have beside its own: a magnetometer and a GPS, as tables of a file state them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.gps import Gps, with_gps
from gtmbench.bench.magnetometer import Magnetometer, with_magnetometer
from gtmbench.checks import keys, naming, number, table_of
from gtmbench.values.channels import GPS_VELOCITY, MAGNETOMETER
from gtmbench.values.record import Record

_LEFT_OUT = ("field_per_ampere_ut",)  # no file states a current
_MOST_HZ = 1.0 / SAMPLE_PERIOD_S


@dataclass(frozen=True, kw_only=True)
class OtherSensors:
    """A magnetometer and a GPS, or one of them, or none. One magnetometer flies all flights, with the same iron.

    >>> OtherSensors(gps=Gps()).channels
    ('gps_north', 'gps_east', 'gps_down')
    """

    magnetometer: Magnetometer | None = None
    gps: Gps | None = None

    def __post_init__(self) -> None:
        if self.magnetometer is not None and self.magnetometer.iron_seed is None:
            object.__setattr__(self, "magnetometer", replace(self.magnetometer, iron_seed=1))

    @property
    def channels(self) -> tuple[str, ...]:
        """What they read."""
        return (MAGNETOMETER if self.magnetometer else ()) + (GPS_VELOCITY if self.gps else ())

    @property
    def facts(self) -> dict[str, object]:
        """As plain values; a sensor that isn't there goes without saying."""
        return {name: asdict(each) for name, each in vars(self).items() if each is not None}

    def beside(self, readings: Record, truth: Record, seed: int) -> Record:
        """Return the readings of a flight's other sensors with these; the seed is of their noise."""
        if self.magnetometer is not None:
            readings = with_magnetometer(readings, truth, self.magnetometer, seed=seed)
        return readings if self.gps is None else with_gps(readings, truth, self.gps, seed=seed)

    def true(self, flight: Record) -> Record:
        """Return a flight's truth with what these would read in every row without noise and delay; iron is left."""
        at_once: dict[str, Any] = {"rate_hz": 1.0 / flight.sample_period_s}
        perfect = OtherSensors(
            magnetometer=self.magnetometer and replace(self.magnetometer, noise=0.0, **at_once),
            gps=self.gps and replace(self.gps, delay_s=0.0, noise_m_s=0.0, wander_m_s=0.0, **at_once),
        )
        return perfect.beside(flight, flight, seed=0)


def gps_of(key: str, value: Any) -> Gps:
    """Return the GPS of a file's table.

    >>> gps_of("gps", {"rate_hz": 10.0}).rate_hz
    10.0
    """
    table = _table(Gps, key, value)
    with naming(key):
        gps = Gps(**table)
        number("rate_hz", gps.rate_hz, 0.0, _MOST_HZ, above=True)
    return gps


def magnetometer_of(key: str, value: Any) -> Magnetometer:
    """Return the magnetometer of a file's table.

    >>> magnetometer_of("magnetometer", {"hard_iron_ut": [1.0, 0.0, -2.0]}).hard_iron_ut
    (1.0, 0.0, -2.0)
    """
    table = _table(Magnetometer, key, value)
    with naming(key):
        magnetometer = Magnetometer(**table)
        number("rate_hz", magnetometer.rate_hz, 0.0, _MOST_HZ, above=True)
    return magnetometer


def _table(of: type, key: str, value: Any) -> dict[str, Any]:
    """Return a table's keys as the class has them, its lists as tuples."""
    known = [item.name for item in fields(of) if item.name not in _LEFT_OUT]
    table = keys(table_of(key, value), known, section=key)
    return {name: tuple(each) if isinstance(each, list) else each for name, each in table.items()}
