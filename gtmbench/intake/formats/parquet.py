"""Parquet tables: columns are read when they are used, so that a wide file costs what is taken from it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.formats.limits import check_columns, check_values, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries, dates_in_seconds

if TYPE_CHECKING:
    import pyarrow as pa


def read_parquet(path: Path) -> RawLog:
    """Read a table's schema; its columns follow when they are asked for."""
    import pyarrow.parquet as pq

    series, ignored, notes = [], [], []
    with reading(path, "Parquet table"):
        metadata, schema = pq.read_metadata(path), pq.read_schema(path)
        check_columns(schema.names)
        check_values(metadata.num_rows, "one of its columns")
        for field in schema:
            if _is_date(field.type):
                values, note = dates_in_seconds(_column(path, field.name, "datetime64[ns]"))
                series.append(RawSeries(name=field.name, load=partial(np.asarray, values), unit="s"))
                notes.append(f"column '{field.name}': {note}")
            elif _is_number(field.type):
                series.append(RawSeries(name=field.name, load=partial(_column, path, field.name, None)))
            else:
                ignored.append(field.name)
    return RawLog(kind="Parquet", series=tuple(series), ignored=tuple(ignored), notes=tuple(notes))


def _column(path: Path, name: str, dtype: str | None) -> NDArray[Any]:
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    with reading(path, "Parquet table"):
        column = pq.read_table(path, columns=[name]).column(0)
        if dtype is not None:
            return np.asarray(pc.cast(column, pa.timestamp("ns"), safe=False).to_numpy(), dtype=dtype)
        if column.null_count or not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
            column = pc.cast(column, pa.float64(), safe=False)
        return np.asarray(column.to_numpy())


def _is_date(kind: pa.DataType) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_timestamp(kind))


def _is_number(kind: pa.DataType) -> bool:
    import pyarrow as pa

    types = pa.types
    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind) or types.is_boolean(kind))


FORMAT = Format(name="Parquet", magic=(b"PAR1",), suffixes=(".parquet",), read=read_parquet)
