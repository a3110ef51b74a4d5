"""An aircraft in the air: it stands in trim, its excitation and its turbulence are ready, and it can be stepped."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import call
from pathlib import Path
from typing import NamedTuple

import jsbsim
import numpy as np

from gtmbench.bench import excitation as excitations
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S, Aircraft
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.engine import writers
from gtmbench.bench.equilibrium import trimmed_engine
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.checks import number, whole
from gtmbench.values.channels import ACTUAL, CHANNELS, COMMANDS, Role
from gtmbench.values.clock import even_times_s
from gtmbench.values.record import FloatArray, Record, Span

LONGEST_S = 24 * 3600.0  # a day
FLOWN = tuple(channel for channel in CHANNELS.values() if channel.role is not Role.COMMAND)  # what is read each step

# JSBSim's Milspec model: type 3, 25 ft/s wind at 20 ft above ground; severity 3 is moderate.
_TURBULENCE = {
    "atmosphere/turb-type": 3,
    "atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps": 25.0,
}
_SUMMED = ("psi", "north", "east")  # made of what is read when all has been flown


class Bound(NamedTuple):
    """A channel that the envelope bounds: which of `FLOWN`, its property's scale, and its span in its own unit."""

    column: int
    scale: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Airborne:
    """An aircraft that is about to fly."""

    # aircraft, trim, fdm: what it is, how it stands, and the engine that stands so
    aircraft: Aircraft
    trim: Trim
    fdm: jsbsim.FGFDMExec
    time_s: FloatArray  # shape (samples,); when it is read
    # shape (samples, 4); what the excitation adds to the commands, in the order of `COMMANDS` and in their units
    added: FloatArray
    read: list[Callable[[], float]]  # what gives the properties of `FLOWN`, one each
    # of every property that a command reaches: the command's column, a factor, and what writes it
    write: list[tuple[int, float, Callable[[float], object]]]
    bounds: list[Bound]  # the envelope, of what can be told while flying

    def record(self, read: FloatArray, commands: FloatArray, actual: FloatArray | None = None) -> Record:
        """Return the truth, of the properties read before each step and after the last, and of the commands."""
        values = read * np.array([channel.scale for channel in FLOWN])
        names = [channel.name for channel in FLOWN]
        for name in ("north", "east"):  # read as speeds: their trapezoidal sum is the way flown
            speed = values[:, names.index(name)]
            values[:, names.index(name)] = np.concatenate(
                [[0.0], np.cumsum((speed[1:] + speed[:-1]) * (SAMPLE_PERIOD_S / 2.0))]
            )
        heading = names.index("psi")
        if np.all(np.isfinite(values[:, heading])):
            values[:, heading] = np.unwrap(values[:, heading], period=360.0)
            # JSBSim's heading lies in 0..360; start where the trim says
            values[:, heading] += 360.0 * round((self.trim.yaw_deg - values[0, heading]) / 360.0)
        columns, names = [values, commands], [*names, *COMMANDS]
        if actual is not None:
            columns, names = [*columns, actual], [*names, *ACTUAL]
        return Record(np.column_stack(columns), channels=names, sample_period_s=SAMPLE_PERIOD_S)


class Stepping:
    """The one way in which an engine is stepped; it keeps what is read, a row a sample.

    `now`: the properties of `FLOWN`, as they were last read. `step`: writes what is given for every entry of
    `Airborne.write`, runs the engine by one sample and reads it anew. These are the deflections that the aircraft
    really gets: whoever commands others keeps them himself.
    """

    def __init__(self, airborne: Airborne) -> None:
        self._kept = array("d")  # no Python object outlives its step, so the garbage collector stays asleep
        self._columns = len(airborne.read)
        self.now: list[float] = list(map(call, airborne.read))
        self._kept.extend(self.now)
        self.step = self._stepper(airborne)

    def _stepper(self, airborne: Airborne) -> Callable[[Sequence[float]], None]:
        read, run, keep = airborne.read, airborne.fdm.run, self._kept.extend
        write = [to_property for _, _, to_property in airborne.write]
        further = range(airborne.aircraft.steps_a_sample - 1)

        def step(values: Sequence[float]) -> None:
            for to_property, value in zip(write, values, strict=True):
                to_property(value)
            run()
            for _ in further:
                run()
            self.now = now = list(map(call, read))
            keep(now)

        return step

    @property
    def read(self) -> FloatArray:
        """What was read, shape (samples, len(FLOWN)): a copy."""
        return self.read_from(0)

    def read_from(self, row: int) -> FloatArray:
        """Return what was read from a sample on."""
        return np.array(self._kept[row * self._columns :]).reshape(-1, self._columns)


@dataclass(frozen=True, kw_only=True)
class OutsideSpans:
    """Where a flight is first outside of some spans."""

    row: int
    channel: str
    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.channel} is {self.value:.4g} {CHANNELS[self.channel].unit}"


def beyond(now: Sequence[float], bounds: Sequence[Bound]) -> bool:
    """Say whether properties, as `Stepping.now` has them, lie outside of the envelope or are no numbers."""
    for column, scale, low, high in bounds:  # noqa: SIM110  any() makes a generator, every step
        if not low <= now[column] * scale <= high:
            return True
    return False


def first_outside(flight: Record, spans: Mapping[str, Span]) -> OutsideSpans | None:
    """Return the first sample of a flight that isn't within spans of channels, or None."""
    found = []
    for channel, (low, high) in spans.items():
        values = flight[channel]
        beyond = np.flatnonzero(~((values >= low) & (values <= high)))
        if len(beyond):
            row = int(beyond[0])
            found.append(OutsideSpans(row=row, channel=channel, value=float(values[row]), low=low, high=high))
    return min(found, key=lambda each: (each.row, each.channel), default=None)


def take_off(
    aircraft: str | Path | Aircraft,
    excitation: str | excitations.Excitation,
    duration_s: float,
    seed: int,
    *,
    altitude_ft: float | None = None,
    tas_kt: float | None = None,
) -> Airborne:
    """Trim an aircraft and make everything ready that `fly` says of its arguments."""
    duration_s = number("duration_s", duration_s, SAMPLE_PERIOD_S, LONGEST_S)
    seed = whole("seed", seed)
    craft = load_aircraft(aircraft)
    time_s = even_times_s(0.0, SAMPLE_PERIOD_S, range(round(duration_s / SAMPLE_PERIOD_S) + 1))
    if isinstance(excitation, str):
        excitation = excitations.excitation(excitation, time_s, seed).scaled(craft.excitation)
    fdm, trimmed = trimmed_engine(craft, altitude_ft=altitude_ft, tas_kt=tas_kt)
    if excitation.turbulence:
        _set_turbulence(fdm, craft.psi_deg, seed, excitation.severity)
    still = np.zeros(len(time_s))
    properties = fdm.get_property_manager()
    nodes = [properties.get_node(channel.jsbsim) for channel in FLOWN]
    return Airborne(
        aircraft=craft,
        trim=trimmed,
        fdm=fdm,
        time_s=time_s,
        added=np.column_stack([excitation.surfaces.get(name, still) for name in COMMANDS]),
        read=[node.get_double_value for node in nodes if node is not None],  # the engine has checked every channel's
        write=writers(fdm, craft),
        bounds=[
            Bound(column=column, scale=channel.scale, low=span[0], high=span[1])
            for column, channel in enumerate(FLOWN)
            if channel.name not in _SUMMED and (span := craft.envelope.get(channel.name))
        ],
    )


def _set_turbulence(fdm: jsbsim.FGFDMExec, heading_deg: float, seed: int, severity: int) -> None:
    """Make the air turbulent, with the gusts' axes along and across the track, as MIL-F-8785C means them.

    JSBSim turns the gusts' axes by the heading of the steady wind. In still air that is the heading of what rounding
    leaves of airspeed less ground speed, 1e-14 ft/s any way, which other bits of the trim or another CPU's sines turn
    by any angle: the flight would be another one. A breath of wind gives the axes a direction. JSBSim turns them the
    other way round (by the transposed matrix), hence the sign.
    """
    fdm["atmosphere/wind-north-fps"] = 1e-9  # a wind too weak to be felt, and far above what rounding leaves (1e-13)
    fdm["atmosphere/wind-east-fps"] = fdm["atmosphere/wind-down-fps"] = 0.0
    fdm["atmosphere/psiw-rad"] = math.radians(-heading_deg)  # turns the wind, and the first step's gusts with it
    fdm["simulation/randomseed"] = seed
    for name, value in _TURBULENCE.items():
        fdm[name] = value
    fdm["atmosphere/turbulence/milspec/severity"] = severity
