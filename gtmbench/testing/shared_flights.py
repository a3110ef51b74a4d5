"""Flights that tests share: flown once a session, whatever asks for them, in whichever process."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import numpy as np

from gtmbench.bench.flight import fly
from gtmbench.bench.sensors import measure
from gtmbench.files.artefacts import artefacts
from gtmbench.files.writing import atomic_write
from gtmbench.values.record import Record

STANDARD_EXCITATION = "multisine+turbulence"
STANDARD_SEED = 100_000  # of excitation, turbulence and noise; far from those that `gtmbench calibrate` flies


def fly_once(
    *,
    aircraft: str | Path = "gtm",
    excitation: str = STANDARD_EXCITATION,
    duration_s: float = 200.0,
    seed: int = STANDARD_SEED,
) -> Record:
    """Fly as `gtmbench.fly` does, once for the same arguments: a session's processes share the flight.

    Nothing is kept between sessions: a flight takes a second, and an old one could be of another aircraft.

    Parameters
    ----------
    aircraft, excitation, duration_s, seed
        As `gtmbench.fly` takes them.

    Examples
    --------
    >>> fly_once(duration_s=1.0) is fly_once(duration_s=1.0)
    True
    """
    return _flown(aircraft, excitation, duration_s, seed)


@cache
def standard_record() -> Record:
    """Return the T2's sensor readings on the standard flight."""
    return measure(fly_once(), noise="t2", seed=STANDARD_SEED)


@cache
def _flown(aircraft: str | Path, excitation: str, duration_s: float, seed: int) -> Record:
    shared = artefacts().flights
    if shared is None:
        return fly(aircraft, excitation, duration_s, seed)
    from filelock import FileLock

    shared.mkdir(mode=0o700, exist_ok=True)
    arguments = repr((str(aircraft), excitation, duration_s, seed))
    path = shared / f"{hashlib.sha256(arguments.encode()).hexdigest()[:16]}.npz"
    with FileLock(path.with_suffix(".lock")):  # the system gives it back should its process die
        if path.is_file():
            return _record_from(path)
        flight = fly(aircraft, excitation, duration_s, seed)
        with atomic_write(path) as aside:
            np.savez(aside, values=flight.values, channels=flight.channels, times_s=[flight.sample_period_s])
        return flight


def _record_from(path: Path) -> Record:
    with np.load(path, allow_pickle=False) as stored:  # arrays of numbers and words only
        return Record(
            stored["values"], channels=stored["channels"].tolist(), sample_period_s=float(stored["times_s"][0])
        )


@cache
def calibration_records() -> tuple[Record, ...]:
    """Return what the T2's sensors read on six other healthy flights, for detectors that a test gives uncalibrated."""
    seeds = range(STANDARD_SEED + 1, STANDARD_SEED + 7)
    return tuple(measure(fly_once(seed=seed), noise="t2", seed=seed, commands=True) for seed in seeds)
