"""Parquet tables: columns are read when they are used, so that a wide file costs what is taken; cells put anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.formats.clock_texts import ClockTexts, clock_of_dates, clock_of_durations
from gtmbench.intake.formats.limits import check_columns, check_unpacked, check_values, reading
from gtmbench.intake.formats.raw import Cells, Format, RawLog, RawSeries
from gtmbench.values.pieces import rows_of_piece
from gtmbench.values.record import sealed

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq


def read_parquet(path: Path) -> RawLog:
    """Read a table's schema; its columns follow when they are asked for."""
    import pyarrow.parquet as pq

    series, ignored, columns = [], [], _Columns(path)
    with reading(path, "Parquet table"):
        metadata, schema = pq.read_metadata(path), pq.read_schema(path)
        check_columns(schema.names)
        check_values(metadata.num_rows, "one of its columns")
        check_unpacked(8.0 * metadata.num_rows, path)
        for field in schema:
            told = _clock(path, field) if _is_clock(field.type) else None
            if told is not None:
                series.append(told.series(field.name))
            elif _is_number(field.type):
                series.append(RawSeries(name=field.name, load=partial(columns.column, field.name)))
            else:
                ignored.append(field.name)
    batches = partial(_batches, path)
    return RawLog(kind="Parquet", series=tuple(series), ignored=tuple(ignored), batches=batches)


class _Columns:
    """Columns of a table: those that were asked for last are kept, for a log is opened several times."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kept: dict[str, NDArray[Any]] = {}  # the latest at the end

    def column(self, name: str) -> NDArray[Any]:
        """Return a column as it is stored; nobody may write to it."""
        values = self._kept.pop(name, None)
        if values is None:
            values = sealed(_column(self._path, name, None))
        self._kept[name] = values
        # the six channels of an hour and their times are 20 MB
        while len(self._kept) > 1 and sum(each.nbytes for each in self._kept.values()) > 64_000_000:
            del self._kept[next(iter(self._kept))]
        return values


def _batches(path: Path, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
    import pyarrow.parquet as pq

    with reading(path, "Parquet table"), pq.ParquetFile(path, pre_buffer=False) as table:
        for batch in table.iter_batches(columns=list(names), batch_size=rows_of_piece()):
            yield {name: _numbers(batch.column(name), None) for name in names}


def _column(path: Path, name: str, dtype: str | None) -> NDArray[Any]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    with reading(path, "Parquet table"), pq.ParquetFile(path, pre_buffer=False) as table:
        values: NDArray[Any] | None = None
        first = 0
        # a table of all of it would stand beside it
        for batch in table.iter_batches(columns=[name], batch_size=rows_of_piece()):
            part = _numbers(batch.column(name), dtype)
            if values is None:
                values = np.empty(table.metadata.num_rows, dtype=part.dtype)
            elif part.dtype.kind != values.dtype.kind:  # whole numbers, of which some are missing
                values = values.astype(np.float64)
            values[first : first + len(part)] = part
            first += len(part)
            del part, batch
        pa.default_memory_pool().release_unused()
        return np.zeros(0) if values is None else values


def _numbers(column: pa.Array, dtype: str | None) -> NDArray[Any]:
    import pyarrow as pa
    import pyarrow.compute as pc

    if dtype is not None:
        kind = pa.timestamp("ns") if dtype.startswith("datetime") else pa.duration("ns")
        dates = pc.cast(column, kind, safe=False)
        return np.asarray(dates.to_numpy(zero_copy_only=False), dtype=dtype)
    if column.null_count or not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        column = pc.cast(column, pa.float64(), safe=False)
    # Arrow's own way to numpy imports pandas
    return np.asarray(column.to_numpy(zero_copy_only=False) if column.null_count else np.from_dlpack(column))


def _is_clock(kind: pa.DataType) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))


def _clock(path: Path, field: pa.Field) -> ClockTexts | None:
    """Return what a column of dates or durations tells; None where all are missing."""
    import pyarrow as pa

    if pa.types.is_timestamp(field.type):
        return clock_of_dates(_column(path, field.name, "datetime64[ns]"), is_utc=field.type.tz is not None)
    nanoseconds = _column(path, field.name, "timedelta64[ns]")
    return clock_of_durations(nanoseconds.astype(np.int64), ~np.isnat(nanoseconds))


def _is_number(kind: pa.DataType) -> bool:
    import pyarrow as pa

    types = pa.types
    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind) or types.is_boolean(kind))


def rewrite_parquet(path: Path, out: Path, cells: Sequence[Cells]) -> None:
    """Write a table anew, group of rows by group of rows, with other values in some cells."""
    import pyarrow.parquet as pq

    with reading(path, "Parquet table"), pq.ParquetFile(path) as source:
        first = 0
        with pq.ParquetWriter(out, source.schema_arrow, store_schema=False, **_layout(source.metadata)) as target:
            for number in range(source.num_row_groups):
                table = source.read_row_group(number)
                for each in cells:
                    table = _replaced(table, each, first)
                target.write_table(table, row_group_size=max(table.num_rows, 1))
                first += table.num_rows
            if source.metadata.metadata is not None:  # the key by which Arrow finds its own types again included
                target.add_key_value_metadata(source.metadata.metadata)


def _layout(metadata: pq.FileMetaData) -> dict[str, Any]:
    """Return how a file is laid out, as `ParquetWriter` takes it: what its first group of rows says."""
    layout: dict[str, Any] = {"version": metadata.format_version}
    if metadata.num_row_groups:
        group = metadata.row_group(0)
        columns = [group.column(place) for place in range(group.num_columns)]
        layout |= {
            "compression": {
                each.path_in_schema: each.compression.replace("UNCOMPRESSED", "NONE").lower() for each in columns
            },
            "use_dictionary": [
                each.path_in_schema for each in columns if any("DICTIONARY" in name for name in each.encodings)
            ],
            "write_statistics": [each.path_in_schema for each in columns if each.is_stats_set],
            "use_deprecated_int96_timestamps": any(each.physical_type == "INT96" for each in columns),
            "sorting_columns": group.sorting_columns or None,
        }
    return layout


def _replaced(table: pa.Table, cells: Cells, first: int) -> pa.Table:
    """Return a group of rows, the first of which is the table's row `first`, with other values in a column."""
    import pyarrow as pa
    import pyarrow.compute as pc

    own = (cells.rows >= first) & (cells.rows < first + table.num_rows)
    rows, values = cells.rows[own] - first, cells.values[own]
    if not len(rows):
        return table
    place = table.schema.names.index(cells.column.name)
    field = table.schema.field(place)
    order = np.argsort(rows)
    is_new = np.zeros(table.num_rows, dtype=bool)
    is_new[rows] = True
    column = table.column(place).combine_chunks()
    new = pc.replace_with_mask(column, is_new, _as(field, values[order]))
    return table.set_column(place, field, pa.chunked_array([new], type=field.type))


def _as(field: pa.Field, values: NDArray[np.float64]) -> pa.Array:
    """Return values as a column holds them, or say why it can't."""
    import pyarrow as pa
    import pyarrow.compute as pc

    whole = pa.types.is_integer(field.type)
    given = pa.array(np.rint(values) if whole else values, from_pandas=field.nullable)
    try:
        return pc.cast(given, field.type, safe=whole)
    except pa.ArrowInvalid as error:
        raise InputError(f"column '{field.name}' is {field.type}, which can't hold what it would have to") from error


FORMAT = Format(name="Parquet", magic=(b"PAR1",), suffixes=(".parquet",), read=read_parquet, rewrite=rewrite_parquet)
