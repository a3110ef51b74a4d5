"""How the log of an entry is made: a flight, what its sensors read, what breaks, what the logger does to the table.

Flights are flown once a run (`gtmbench.testing.shared_flights`); everything else follows from the entry's seed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record
from tests.verdicts.alterations import DONE
from tests.verdicts.entries import EVERY, Broken, Entry
from tests.verdicts.log_files import WRITTEN

_FLIGHT_HZ = 100.0
_BUMP_HZ, _BUMP_FADES_S = 5.0, 0.25  # of the gear and the wing, and how soon it is over
_BUMP_DEG = {"phi": 1.2, "theta": 0.8, "psi": 0.3}  # by how much a touchdown shakes the attitude
_BUMP_G, _BUMP_LASTS_S = 1.8, 0.12
_SEED_OF_IMU = 7919


@dataclass(frozen=True, kw_only=True, eq=False)
class Made:
    """A log that was made.

    Attributes
    ----------
    path : Path
        The log, or the folder of several.
    tables : tuple of DataFrame
        What each IMU's gyros, and the sensors beside them, read: ``time_s`` and the channels, as they were written.
    """

    path: Path
    tables: tuple[pd.DataFrame, ...] = field(repr=False)

    @property
    def last_s(self) -> float:
        """The time of the last row, since the first."""
        return float(self.tables[0]["time_s"].iloc[-1] - self.tables[0]["time_s"].iloc[0])


def made(entry: Entry, folder: Path) -> Made:
    """Make the log of an entry in a folder."""
    tables = tuple(_altered(readings(entry, imu), entry) for imu in range(1, len(entry.imus) + 1))
    return Made(path=WRITTEN[entry.file](folder, entry, tables), tables=tables)


def readings(entry: Entry, imu: int = 1) -> Record:
    """Return what the sensors read, broken and through the estimator, at the entry's rate; of one of the IMUs."""
    truth, healthy = _measured(
        entry.seed, entry.duration_s, entry.excitation, entry.rate_hz, entry.noise, entry.stand_s, entry.bumps_s
    )
    broken = _mounted(healthy, entry, imu)
    own = [each.fault for each in entry.faults if each.imu == imu]
    broken = gb.inject(broken, own) if own else broken
    return broken if entry.attitude == "own" else estimated_attitude(broken, truth, entry.attitude, entry.seed)


def _mounted(record: Record, entry: Entry, imu: int) -> Record:
    """Return the readings of an IMU, turned about the vertical axis and with noise of its own."""
    if imu == 1:
        return record
    how = entry.imus[imu - 1]
    angle = np.radians(how.get("turned_deg", 0.0))
    turn = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    random = np.random.default_rng([entry.seed, _SEED_OF_IMU, imu])
    gyros = record.matrix(GYROS) @ turn.T + how.get("noise", 0.3) * random.standard_normal((len(record), 3))
    for axis, name in enumerate(GYROS):
        record = record.replace(name, gyros[:, axis])
    return record


@cache
def _measured(
    seed: int,
    duration_s: float,
    excitation: str,
    rate_hz: float,
    noise: float,
    stand_s: float,
    bumps_s: tuple[float, ...],
) -> tuple[Record, Record]:
    """Return the truth at a rate, and what sensors read of it."""
    flown = fly_once(excitation=excitation, duration_s=duration_s - stand_s, seed=seed).select(EVERY)
    values = _stood(flown.values, round(stand_s * _FLIGHT_HZ))
    time_s = np.arange(len(values)) / _FLIGHT_HZ
    for bump_s in bumps_s:
        values = values + _bump(time_s - bump_s)
    steps = np.arange(round(time_s[-1] * rate_hz) + 1) / rate_hz
    sampled = np.column_stack([np.interp(steps, time_s, column) for column in values.T])
    truth = Record(sampled, channels=EVERY, sample_period_s=1.0 / rate_hz)
    measured = gb.measure(truth, noise="t2", seed=seed)
    quiet = truth.values + noise * (measured.matrix(EVERY) - truth.values)
    return truth, Record(quiet, channels=EVERY, sample_period_s=1.0 / rate_hz)


def _stood(values: FloatArray, rows: int) -> FloatArray:
    """Return a flight before which the aircraft stands for some rows, in the attitude that it begins with."""
    still = np.repeat(values[:1], rows, axis=0)
    still[:, [EVERY.index(name) for name in (*GYROS, "nx", "ny", "alpha", "beta", "tas")]] = 0.0
    still[:, EVERY.index("nz")] = 1.0
    return np.vstack([still, values])


def _bump(since_s: FloatArray) -> FloatArray:
    """Return what a contact with the ground adds: a shake that attitude and gyros agree about, and a push upwards."""
    added = np.zeros((len(since_s), len(EVERY)))
    after = since_s >= 0.0
    shape = np.where(after, np.exp(-since_s.clip(0.0) / _BUMP_FADES_S) * np.sin(2 * np.pi * _BUMP_HZ * since_s), 0.0)
    for gyro, angle in zip(GYROS, ATTITUDE, strict=True):
        added[:, EVERY.index(angle)] = _BUMP_DEG[angle] * shape
        added[:, EVERY.index(gyro)] = np.gradient(_BUMP_DEG[angle] * shape, 1.0 / _FLIGHT_HZ)
    added[:, EVERY.index("nz")] = _BUMP_G * (after & (since_s < _BUMP_LASTS_S))
    return added


def _altered(record: Record, entry: Entry) -> pd.DataFrame:
    """Return the table that a logger keeps of readings."""
    table = pd.DataFrame({name: record[name] for name in entry.channels})
    table.insert(0, "time_s", np.round(entry.clock_s + np.arange(len(table)) / entry.rate_hz, 6))
    for step in entry.done:
        how = {key: value for key, value in step.items() if key != "do"}
        table = DONE[step["do"]](table, **how)
    return table


def sensors_of(entry: Entry, table: pd.DataFrame) -> tuple[str, ...]:
    """Return the sensors whose readings stand in a table."""
    return tuple(name for name in table.columns if name in entry.channels)


def broken_between(broken: Broken, last_s: float) -> tuple[float, float]:
    """Return from when to when a sensor is broken, in seconds since the log's first sample."""
    fault = broken.fault
    return fault.onset_s, last_s if fault.duration_s is None else min(last_s, fault.onset_s + fault.duration_s)
