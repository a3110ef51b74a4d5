"""Flight: from trim through an excitation to a record of truth."""

from __future__ import annotations

import math
from array import array
from operator import call
from pathlib import Path

import jsbsim
import numpy as np

from gtmbench.bench import excitation as excitations
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S, Aircraft
from gtmbench.bench.engine import simulating, writers
from gtmbench.bench.equilibrium import Trim, trimmed_engine
from gtmbench.bench.fleet import load_aircraft
from gtmbench.channels import CHANNELS, COMMANDS, Role
from gtmbench.checks import number, whole
from gtmbench.errors import EnvelopeError
from gtmbench.record import FloatArray, Record

LONGEST_S = 24 * 3600.0

# Moderate turbulence, JSBSim's Milspec model: type 3, severity 3, 25 ft/s wind at 20 ft above ground.
_TURBULENCE = {
    "atmosphere/turb-type": 3,
    "atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps": 25.0,
    "atmosphere/turbulence/milspec/severity": 3,
}
_LOOKED_STEPS = 100  # how often a flight looks whether it is within its envelope
_SUMMED = ("psi", "north", "east")  # made of what is read when all has been flown
_BREATH_FT_S = 1e-9  # a wind too weak to be felt, and far above what rounding leaves (1e-13)


def fly(
    aircraft: str | Path | Aircraft = "gtm",
    excitation: str | excitations.Excitation = "dissertation",
    duration_s: float = 500.0,
    seed: int = 1,
    *,
    altitude_ft: float | None = None,
    tas_kt: float | None = None,
) -> Record:
    """Trim, fly and record: every channel of the table, noise-free, at 100 Hz.

    The commands of sample k hold from k Ts to (k + 1) Ts; sample 0 is the trim itself.

    Parameters
    ----------
    aircraft : str, Path or Aircraft
        A name that ``gtmbench list --all`` shows, or the path of an aircraft's folder.
    excitation : str or Excitation
        A name that ``gtmbench list`` shows, or a sum such as ``multisine+turbulence``, which is scaled to the aircraft;
        an `Excitation` is flown as it is.
    duration_s : float
        Seconds; the record has 100 samples a second and one more.
    seed : int
        Of multisine phases and turbulence. The same arguments give the same bits, in any process; on a CPU without
        fused multiply-add, where sines end in other bits, the same flight to 1e-9.
    altitude_ft, tas_kt : float, optional
        Another condition than the aircraft's own.

    Raises
    ------
    InputError
        Where a name, the duration or the seed can't be meant.
    TrimError
        Where the aircraft can't be trimmed.
    EnvelopeError
        Where the flight leaves the range of the aircraft's model.

    Examples
    --------
    >>> flight = fly(duration_s=2.0)
    >>> len(flight), flight["nz"][0].round(1)
    (201, np.float64(1.0))
    """
    duration_s = number("duration_s", duration_s, SAMPLE_PERIOD_S, LONGEST_S)
    seed = whole("seed", seed)
    craft = load_aircraft(aircraft)
    steps = round(duration_s / SAMPLE_PERIOD_S)
    time_s = np.round(np.arange(steps + 1) * SAMPLE_PERIOD_S, 9)
    moved = _moved(craft, excitation, time_s, seed)
    fdm, trimmed = trimmed_engine(craft, altitude_ft=altitude_ft, tas_kt=tas_kt)
    commands = _commands(craft, trimmed, moved, len(time_s))
    if moved.turbulence:
        _set_turbulence(fdm, craft.psi_deg, seed)
    with simulating(fdm, craft):
        read = _fly(fdm, craft, commands)
    record = _record(read, commands[: len(read)], trimmed)
    _check_envelope(record, craft, f"excitation '{excitation}'" if isinstance(excitation, str) else "the excitation")
    return record


def _moved(
    aircraft: Aircraft, excitation: str | excitations.Excitation, time_s: FloatArray, seed: int
) -> excitations.Excitation:
    if not isinstance(excitation, str):
        return excitation
    return excitations.excitation(excitation, time_s, seed).scaled(aircraft.excitation)


def _commands(aircraft: Aircraft, trimmed: Trim, moved: excitations.Excitation, samples: int) -> FloatArray:
    """Return the commands, shape (samples, 4): trim plus excitation, within the limits."""
    columns = []
    for name in COMMANDS:
        low, high = aircraft.limits[name]
        columns.append(np.clip(trimmed.commands[name] + moved.surfaces.get(name, np.zeros(samples)), low, high))
    return np.column_stack(columns)


def _set_turbulence(fdm: jsbsim.FGFDMExec, heading_deg: float, seed: int) -> None:
    """Make the air turbulent, with the gusts' axes along and across the track, as MIL-F-8785C means them.

    JSBSim turns the gusts' axes by the heading of the steady wind. In still air that is the heading of what rounding
    leaves of airspeed less ground speed, 1e-14 ft/s any way, which other bits of the trim or another CPU's sines turn
    by any angle: the flight would be another one. A breath of wind gives the axes a direction. JSBSim turns them the
    other way round (by the transposed matrix), hence the sign.
    """
    fdm["atmosphere/wind-north-fps"] = _BREATH_FT_S
    fdm["atmosphere/wind-east-fps"] = fdm["atmosphere/wind-down-fps"] = 0.0
    fdm["atmosphere/psiw-rad"] = math.radians(-heading_deg)  # turns the wind, and the first step's gusts with it
    fdm["simulation/randomseed"] = seed
    for name, value in _TURBULENCE.items():
        fdm[name] = value


def _fly(fdm: jsbsim.FGFDMExec, aircraft: Aircraft, commands: FloatArray) -> FloatArray:
    """Step through the commands; return the properties of the channels before each step and after the last.

    A flight that leaves the envelope ends within a second of that.
    """
    properties = fdm.get_property_manager()

    def node(name: str) -> jsbsim.FGPropertyNode:
        known = properties.get_node(name)
        assert known is not None  # the engine has checked every channel's
        return known

    flown = [channel for channel in CHANNELS.values() if channel.role is not Role.COMMAND]
    read = [node(channel.jsbsim).get_double_value for channel in flown]
    columns, factors, write = zip(*writers(fdm, aircraft), strict=True)
    bounds = [
        (node(channel.jsbsim).get_double_value, channel.scale, *aircraft.envelope[channel.name])
        for channel in flown
        if channel.name in aircraft.envelope and channel.name not in _SUMMED
    ]
    run = fdm.run
    samples = array("d")  # no Python object outlives its step, so the garbage collector stays asleep
    keep = samples.extend
    for step, values in enumerate((commands[:-1, columns] * factors).tolist(), start=1):
        keep(map(call, read))
        for to_property, value in zip(write, values, strict=True):
            to_property(value)
        run()
        if step % _LOOKED_STEPS == 0 and not all(low <= now() * scale <= high for now, scale, low, high in bounds):
            break
    keep(map(call, read))
    return np.array(samples).reshape(-1, len(read))


def _record(read: FloatArray, commands: FloatArray, trimmed: Trim) -> Record:
    flown = [channel for channel in CHANNELS.values() if channel.role is not Role.COMMAND]
    values = read * np.array([channel.scale for channel in flown])
    names = [channel.name for channel in flown]
    for name in ("north", "east"):  # read as speeds: their trapezoidal sum is the way flown
        speed = values[:, names.index(name)]
        values[:, names.index(name)] = np.concatenate(
            [[0.0], np.cumsum((speed[1:] + speed[:-1]) * (SAMPLE_PERIOD_S / 2.0))]
        )
    heading = names.index("psi")
    if np.all(np.isfinite(values[:, heading])):
        values[:, heading] = np.unwrap(values[:, heading], period=360.0)
        # JSBSim's heading lies in 0..360; start where the trim says
        values[:, heading] += 360.0 * round((trimmed.yaw_deg - values[0, heading]) / 360.0)
    return Record(np.column_stack([values, commands]), channels=[*names, *COMMANDS], sample_period_s=SAMPLE_PERIOD_S)


def _check_envelope(record: Record, aircraft: Aircraft, what: str) -> None:
    outside = []
    for channel, (low, high) in aircraft.envelope.items():
        values = record[channel]
        beyond = np.flatnonzero(~((values >= low) & (values <= high)))
        if len(beyond):
            outside.append((int(beyond[0]), channel, values[beyond[0]], low, high))
    if outside:
        first, channel, value, low, high = min(outside)
        unit = CHANNELS[channel].unit
        raise EnvelopeError(
            f"{what} throws '{aircraft.name}' out of its envelope: {channel} is {value:.4g} {unit} at "
            f"t = {record.time_s[first]:g} s, the model holds from {low:g} to {high:g} {unit}; "
            "fly shorter, or choose a gentler excitation"
        )
