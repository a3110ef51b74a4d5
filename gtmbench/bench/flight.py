"""Flight: from trim, which may be asked for alone, through an excitation to a record of truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gtmbench.bench.aircraft import Aircraft
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.breaking import Surfaces, check_faults, is_of_surface
from gtmbench.bench.engine import simulating
from gtmbench.bench.equilibrium import mistaken_units, trimmed_engine
from gtmbench.bench.excitation import Excitation
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.stepping import Airborne, Stepping, beyond, first_outside, take_off
from gtmbench.errors import EnvelopeError, InputError
from gtmbench.faults.fault import Fault
from gtmbench.values.channels import COMMANDS, unit_of
from gtmbench.values.record import FloatArray, Record


def fly(
    aircraft: str | Path | Aircraft = "gtm",
    excitation: str | Excitation = "dissertation",
    duration_s: float = 500.0,
    seed: int = 1,
    *,
    faults: Fault | Sequence[Fault] = (),
    altitude_ft: float | None = None,
    tas_kt: float | None = None,
) -> Record:
    """Trim, fly and record: every channel of the table, noise-free, at 100 Hz.

    The commands of sample k hold from k Ts to (k + 1) Ts; sample 0 is the trim itself. With a fault of a surface the
    record also has where the surfaces were driven: ``elevator_actual`` and so on, beside what was commanded. It ends
    where the aircraft leaves the range of its model after the onset.

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
        Seed of multisine phases and turbulence. The same arguments give the same bits in any process; on a CPU without
        fused multiply-add the flight is the same to 1e-9.
    faults : Fault or sequence of Fault
        Of surfaces (elevator, aileron, rudder) and the throttle; sensors are broken in what `measure` gives, by
        `inject`.
    altitude_ft, tas_kt : float, optional
        Another trim condition than the aircraft's own.

    Raises
    ------
    InputError
        If a name, the duration, the seed or a fault is invalid.
    TrimError
        If the aircraft can't be trimmed.
    EnvelopeError
        If the flight leaves the range of the aircraft's model, before any fault began.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly(duration_s=2.0)
    >>> len(flight), flight["nz"][0].round(1)
    (201, np.float64(1.0))
    >>> jammed = gb.fly("gtm", "multisine", duration_s=4.0, faults=gb.Jam(channel="elevator", onset_s=2.0))
    >>> bool(jammed["elevator"].std() > 0.1), float(jammed["elevator_actual"][200:].std())
    (True, 0.0)
    """
    listed = [faults] if isinstance(faults, Fault) else list(faults)
    airborne = take_off(aircraft, excitation, duration_s, seed, altitude_ft=altitude_ft, tas_kt=tas_kt)
    check_faults(listed, float(airborne.time_s[-1]))
    for fault in listed:
        if not is_of_surface(fault):
            raise InputError(
                f"{fault.kind} of {fault.channel} breaks a sensor, and the truth has none; inject it into what "
                "measure(flight) gives"
            )
    commands, surfaces = _commands(airborne), Surfaces(listed, airborne.aircraft.limits)
    with simulating(airborne.fdm, airborne.aircraft):
        read = _fly(airborne, commands, surfaces)
    commands = commands[: len(read)]
    record = airborne.record(read, commands, surfaces.actual(commands))
    left = first_outside(record, airborne.aircraft.envelope) if listed else None
    if left is not None and record.time_s[left.row] >= min(fault.onset_s for fault in listed):
        return record.part(range(left.row + 1))
    what = f"excitation '{excitation}'" if isinstance(excitation, str) else "the excitation"
    units = mistaken_units(airborne.aircraft, altitude_ft=altitude_ft, tas_kt=tas_kt)
    check_envelope(record, airborne.aircraft, what, units or "fly shorter, or choose a gentler excitation")
    return record


def _commands(airborne: Airborne) -> FloatArray:
    """Return the commands, shape (samples, 4): trim plus excitation, within the limits."""
    limits = np.array([airborne.aircraft.limits[name] for name in COMMANDS])
    trimmed = np.array([airborne.trim.commands[name] for name in COMMANDS])
    return np.asarray(np.clip(trimmed + airborne.added, limits[:, 0], limits[:, 1]))


def _fly(airborne: Airborne, commands: FloatArray, surfaces: Surfaces) -> FloatArray:
    """Step through the commands; return the properties of the channels before each step and after the last."""
    write, stepping = [(column, factor) for column, factor, _ in airborne.write], Stepping(airborne)
    for time_s, commanded in zip(airborne.time_s.tolist(), commands[:-1].tolist(), strict=False):
        driven = surfaces.driven(time_s, commanded, stepping.now)
        stepping.step([driven[column] * factor for column, factor in write])
        if beyond(stepping.now, airborne.bounds):
            break
    return stepping.read


def check_envelope(record: Record, aircraft: Aircraft, what: str, remedy: str) -> None:
    """Refuse a flight that leaves the range of its aircraft's model: what threw it out, and what to do about it."""
    if outside := first_outside(record, aircraft.envelope):
        raise EnvelopeError(
            f"{what} throws '{aircraft.name}' out of its envelope: {outside} at t = {record.time_s[outside.row]:g} s, "
            f"the model holds from {outside.low:g} to {outside.high:g} {unit_of(outside.channel)}; {remedy}"
        )


def trim(
    aircraft: str | Path | Aircraft = "gtm", *, altitude_ft: float | None = None, tas_kt: float | None = None
) -> Trim:
    """Trim an aircraft for level flight without sideslip.

    Solves udot = vdot = wdot = pdot = qdot = rdot = 0 for alpha, bank, elevator, aileron, rudder and throttle by least
    squares; pitch equals alpha up to the bank's second order, so that the flight path stays level. The result is
    rounded to 1e-8 deg (and percent of throttle), so that every CPU starts from the same trim.

    Parameters
    ----------
    aircraft : str, Path or Aircraft
        A name that ``gtmbench list --all`` shows, or the path of an aircraft's folder.
    altitude_ft, tas_kt : float, optional
        Another trim condition than the aircraft's own.

    Raises
    ------
    TrimError
        Naming the acceleration that can't be zeroed, and the command at its limit.

    Examples
    --------
    >>> import gtmbench as gb
    >>> level = gb.trim("gtm")
    >>> round(level.alpha_deg, 1), round(level.elevator_deg, 1)
    (3.0, 2.7)
    """
    craft = load_aircraft(aircraft)
    return trimmed_engine(craft, altitude_ft=altitude_ft, tas_kt=tas_kt)[1]
