"""How a table becomes a log's file, or several; each function takes a folder, the entry and its tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, CHANNELS, GYROS
from tests.helpers.intake_files import dataflash_text
from tests.verdicts.entries import Entry

_G = 9.80665
_US = 1e6
_ALOUD = {"p": "gyro_x", "q": "gyro_y", "r": "gyro_z", "phi": "roll", "theta": "pitch", "psi": "yaw"}
Tables = Sequence[pd.DataFrame]


def csv(folder: Path, entry: Entry, tables: Tables) -> Path:
    """Write a table as `gtmbench fly` does, with units in its names."""
    return _csv(folder / f"{entry.name}.csv", tables[0].rename(columns=_headers(tables[0])))


def radians(folder: Path, entry: Entry, tables: Tables) -> Path:
    """Write gyros and angles in radians, by other names."""
    return _csv(folder / f"{entry.name}.csv", _aloud(tables[0]))


def mirrored(folder: Path, entry: Entry, tables: Tables) -> Path:
    """Write y and z axes that point the other way, in radians; the entry's mapping turns them back."""
    table = _aloud(tables[0])
    turned = [name for name in ("gyro_y_rad_s", "gyro_z_rad_s", "pitch_rad", "yaw_rad") if name in table]
    return _csv(folder / f"{entry.name}.csv", table.assign(**{name: -table[name] for name in turned}))


MIRRORED = ("q=-gyro_y_rad_s:rad/s", "r=-gyro_z_rad_s:rad/s", "theta=-pitch_rad:rad", "psi=-yaw_rad:rad")


def two_tables(folder: Path, entry: Entry, tables: Tables) -> Path:
    """Write one log as a folder of two tables, gyros with accelerometers and attitude, each with its own rows."""
    table = tables[0].rename(columns=_headers(tables[0]))
    angles = [name for name in table if name in {CHANNELS[angle].header for angle in ATTITUDE}]
    place = folder / entry.name
    place.mkdir()
    _csv(place / "imu.csv", table.drop(columns=angles))
    _csv(place / "attitude.csv", table[["time_s", *angles]].dropna(how="all", subset=angles))
    return place


def beside_gyros(folder: Path, entry: Entry, tables: Tables) -> Path:
    """Write two logs into a folder: the entry's own, and gyros alone of another flight, under other names."""
    place = _own(folder, entry, tables)
    table = tables[0]
    another = {
        f"gyro_{axis}_rad_s": np.radians(table[name])[::-1].to_numpy() for axis, name in zip("xyz", GYROS, strict=True)
    }
    _csv(place / "gyros.csv", pd.DataFrame({"time_s": table["time_s"], **another}))
    return place


def beside_later(folder: Path, entry: Entry, tables: Tables) -> Path:
    """Write two logs into a folder: the gyros and angles of one flight, and the attitude of one that began later."""
    place = _own(folder, entry, tables)
    later = tables[0].assign(time_s=tables[0]["time_s"] + tables[0]["time_s"].iloc[-1] + 60.0)
    _csv(place / "attitude.csv", later[["time_s", *ATTITUDE]].rename(columns=_headers(later)))
    return place


def ardupilot(folder: Path, entry: Entry, tables: Tables) -> Path:
    """Write an ArduPilot text log: IMU, IMU2 ... and an attitude."""
    messages = {}
    for number, table in enumerate(tables, start=1):
        forces = _G * table[list(ACCELEROMETERS)].to_numpy() * [1.0, 1.0, -1.0]
        values = np.column_stack([np.radians(table[list(GYROS)].to_numpy()), forces])
        columns = "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
        messages[f"IMU{number if number > 1 else ''}"] = ("Qffffff", columns, _rows(table, values, 6))
    angles = tables[0][list(ATTITUDE)].to_numpy(copy=True)
    angles[:, 2] %= 360.0
    messages["ATT"] = ("Qccc", "TimeUS,Roll,Pitch,Yaw", _rows(tables[0], angles, 2))
    path = folder / f"{entry.name}.log"
    path.write_bytes(dataflash_text(messages))
    return path


def _rows(table: pd.DataFrame, values: np.ndarray, digits: int) -> list[tuple[float, ...]]:
    stamps = np.round(_US * table["time_s"]).astype(int).tolist()
    return [(stamp, *row) for stamp, row in zip(stamps, np.round(values, digits).tolist(), strict=True)]


def _own(folder: Path, entry: Entry, tables: Tables) -> Path:
    place = folder / entry.name
    place.mkdir()
    csv(place, entry, tables)
    return place


def _headers(table: pd.DataFrame) -> dict[str, str]:
    return {name: CHANNELS[name].header for name in table if name in CHANNELS}


def _aloud(table: pd.DataFrame) -> pd.DataFrame:
    columns: dict[str, pd.Series] = {"time_ms": 1000.0 * table["time_s"]}
    for name in table.columns[1:]:
        if name in _ALOUD:
            columns[f"{_ALOUD[name]}_{'rad_s' if name in GYROS else 'rad'}"] = np.radians(table[name])
        else:
            columns[CHANNELS[name].header] = table[name]
    return pd.DataFrame(columns)


def _csv(path: Path, table: pd.DataFrame) -> Path:
    table.to_csv(path, index=False, float_format="%.10g")
    return path


WRITTEN: Mapping[str, Callable[[Path, Entry, Tables], Path]] = {
    each.__name__: each for each in (csv, radians, mirrored, two_tables, beside_gyros, beside_later, ardupilot)
}
