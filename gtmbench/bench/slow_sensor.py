"""A sensor that is read more slowly than a record has rows, put beside the others: rows between readings are NaN."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.errors import InputError
from gtmbench.values.record import BoolArray, FloatArray, Record, check_record


def check_beside(readings: Record, truth: Record, channels: Sequence[str], sensor: str) -> None:
    """Refuse readings that aren't those of a flight, row for row, or that hold such a sensor already."""
    check_record(readings)
    check_record(truth)
    if len(readings) != len(truth) or readings.sample_period_s != truth.sample_period_s:
        raise InputError(
            f"the readings have {len(readings)} rows and the truth has {len(truth)}, or their rates differ; give the "
            f"flight that was measured"
        )
    if taken := [name for name in channels if name in readings]:
        raise InputError(f"the readings have {', '.join(taken)} already; a record holds one {sensor}")


def is_read(truth: Record, rate_hz: float, sensor: str) -> BoolArray:
    """Return the rows in which a sensor of some rate is read; refuse one that is faster than the record."""
    every = 1.0 / (rate_hz * truth.sample_period_s)
    if every < 1.0 - 1e-9:
        raise InputError(
            f"the {sensor} is read at {rate_hz:g} Hz, the record at {1.0 / truth.sample_period_s:g}; "
            f"give at most that rate_hz"
        )
    # the reading whose turn it is since the row before; the tolerance keeps 1/0.01 rows from being 99.999...
    turn = np.floor(np.arange(len(truth)) / every + 1e-6)
    return np.asarray(np.diff(turn, prepend=-1.0) != 0.0)


def beside(readings: Record, channels: Sequence[str], values: FloatArray, rows: BoolArray) -> Record:
    """Return readings with a sensor's channels, whose values are there in some rows."""
    read = np.where(rows[:, np.newaxis], values, np.nan)
    return Record(
        np.column_stack([readings.values, read]),
        channels=[*readings.channels, *channels],
        sample_period_s=readings.sample_period_s,
        start_s=readings.start_s,
        there=np.column_stack([readings.there, np.isfinite(read)]),
    )
