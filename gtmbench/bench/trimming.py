"""Trimming: an aircraft's steady level flight, at its own condition or another."""

from __future__ import annotations

from pathlib import Path

from gtmbench.bench.aircraft import Aircraft
from gtmbench.bench.equilibrium import trimmed_engine
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.trim import Trim


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
