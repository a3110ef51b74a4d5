"""What a logger does to the table of a flight; each function takes it and returns another, and is no fault.

Times are counted from the table's first row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd

from gtmbench.values.channels import GYROS


def _since_s(table: pd.DataFrame) -> pd.Series:
    return table["time_s"] - table["time_s"].iloc[0]


def _rows(table: pd.DataFrame, kept: pd.Series) -> pd.DataFrame:
    return table[kept].reset_index(drop=True)


def gap(table: pd.DataFrame, *, from_s: float, to_s: float) -> pd.DataFrame:
    """Leave rows out.

    >>> gap(pd.DataFrame({"time_s": [0.0, 1.0, 2.0]}), from_s=1.0, to_s=2.0)["time_s"].tolist()
    [0.0, 2.0]
    """
    since_s = _since_s(table)
    return _rows(table, (since_s < from_s) | (since_s >= to_s))


def rate_falls(table: pd.DataFrame, *, from_s: float, every: int) -> pd.DataFrame:
    """Keep every n-th row from a time on."""
    return _rows(table, (_since_s(table) < from_s) | (np.arange(len(table)) % every == 0))


def drop(table: pd.DataFrame, *, columns: Sequence[str]) -> pd.DataFrame:
    """Leave columns out."""
    return table.drop(columns=list(columns))


def rounded(table: pd.DataFrame, *, columns: Sequence[str], step: float) -> pd.DataFrame:
    """Round columns to whole steps."""
    return table.assign(**{name: step * np.round(table[name] / step) for name in columns})


def constant(table: pd.DataFrame, *, column: str, value: float) -> pd.DataFrame:
    """Let a column read one value, as a logger fills a field that nothing feeds."""
    return table.assign(**{column: value})


def slower(table: pd.DataFrame, *, columns: Sequence[str], every: int) -> pd.DataFrame:
    """Leave cells of columns empty, but for every n-th."""
    fresh = np.arange(len(table)) % every == 0
    return table.assign(**{name: table[name].where(fresh) for name in columns})


def late(table: pd.DataFrame, *, columns: Sequence[str], by_s: float) -> pd.DataFrame:
    """Let columns come later than the others.

    >>> table = pd.DataFrame({"time_s": [0.0, 1.0, 2.0], "phi": [0.0, 4.0, 8.0]})
    >>> late(table, columns=["phi"], by_s=0.5)["phi"].tolist()
    [0.0, 2.0, 6.0]
    """
    time_s = table["time_s"]
    return table.assign(**{name: np.interp(time_s - by_s, time_s, table[name]) for name in columns})


def vibration(
    table: pd.DataFrame, *, columns: Sequence[str], amplitude: float, frequency_hz: float, from_s: float = 0.0
) -> pd.DataFrame:
    """Shake columns with a tone, each by a phase of its own, as an engine does."""
    since_s = _since_s(table)
    tones = {
        name: table[name] + amplitude * np.sin(2 * np.pi * frequency_hz * since_s + phase) * (since_s >= from_s)
        for phase, name in enumerate(columns)
    }
    return table.assign(**tones)


def euler_rates(table: pd.DataFrame, *, noise: float, seed: int) -> pd.DataFrame:
    """Write the rates of the Euler angles where the gyros' belong, with noise of so many deg/s."""
    bank, pitch = np.radians(table["phi"]), np.radians(table["theta"])
    yawing = (table["q"] * np.sin(bank) + table["r"] * np.cos(bank)) / np.cos(pitch)
    rates = np.column_stack(
        [table["p"] + np.sin(pitch) * yawing, table["q"] * np.cos(bank) - table["r"] * np.sin(bank), yawing]
    )
    rates += noise * np.random.default_rng(seed).standard_normal(rates.shape)
    return table.assign(**dict(zip(GYROS, rates.T, strict=True)))


def held(table: pd.DataFrame, *, columns: Sequence[str], every: int) -> pd.DataFrame:
    """Repeat each n-th reading until the next, as a logger that is faster than its sensor."""
    return table.assign(
        **{name: table[name].iloc[(np.arange(len(table)) // every) * every].to_numpy() for name in columns}
    )


def wrapped(table: pd.DataFrame) -> pd.DataFrame:
    """Write the heading from 0 to 360 deg."""
    return table.assign(psi=table["psi"] % 360.0)


DONE: Mapping[str, Callable[..., pd.DataFrame]] = {
    each.__name__: each
    for each in (gap, rate_falls, drop, rounded, constant, slower, late, vibration, euler_rates, held, wrapped)
}
