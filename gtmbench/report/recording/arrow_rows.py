"""An .rrd as rows on stdout, an Arrow stream: a program of its own, which `read_recording` runs.

rerun's reader ends its process (a Rust panic, which aborts) on about one of a hundred damaged files, and says on stderr
what it likes: both stay in here. Nothing of gtmbench is imported, for it has to start at once.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from rerun.chunk import Chunk, RrdReader

Floats = npt.NDArray[np.float64]
Line = tuple[str | int, Floats, Floats]  # a name, or a position within the entity; times in s, values
Told = tuple[float, str, float, str | None]  # time in s, series, value, text

_WORDS = pa.dictionary(pa.int32(), pa.string())
_SCHEMA = pa.schema({"entity": _WORDS, "series": _WORDS, "time_s": pa.float64(), "value": pa.float64(), "text": _WORDS})
_AXES = {"Transform3D:translation": "xyz", "Transform3D:quaternion": "xyzw"}
_MOST_LINES = 1000  # of an entity: a damaged file can say millions
_MOST_ROWS = 200_000_000  # that fit into memory


def main(path: str, *, rows: bool) -> None:
    """Write the recording's application and, where they are wanted, its rows; any error is the process's end."""
    reader = RrdReader(path)
    recording, *others = reader.recordings()
    if rows and others:
        raise ValueError(f"{len(others) + 1} recordings in one file")
    store = reader.store(store=recording)  # needs the footer; a stream would take what ends before it for whole
    schema = _SCHEMA.with_metadata({"application": recording.application_id})
    with pa.ipc.new_stream(sys.stdout.buffer, schema) as out:
        for batch in _batches(store.stream()) if rows else ():
            out.write_batch(batch)


def _batches(chunks: Iterable[Chunk]) -> Iterator[pa.RecordBatch]:
    """Gather every entity's chunks, which stand in a file in any order; give entities by name, in time."""
    lines: dict[str, list[Line]] = defaultdict(list)
    told: dict[str, list[Told]] = defaultdict(list)
    names: dict[str, list[str]] = {}
    count = 0
    for chunk in chunks:
        batch, entity = chunk.to_record_batch(), chunk.entity_path
        of_lines, said = list(_lines(batch)), list(_events_of(batch))
        count += len(said) + sum(len(values) for _, _, values in of_lines)
        if count > _MOST_ROWS:
            raise ValueError(f"more than {_MOST_ROWS} rows")
        lines[entity] += of_lines
        told[entity] += said
        if given := _names(batch, entity):
            names[entity] = given if "Lines:channels" in batch.schema.names else names.get(entity, given)
    for entity in sorted(lines):
        yield from _entity(entity, lines[entity], told[entity], names.get(entity, []))


def _entity(entity: str, lines: list[Line], told: list[Told], names: list[str]) -> Iterator[pa.RecordBatch]:
    parts: dict[str | int, list[Line]] = defaultdict(list)
    for line in lines:
        parts[line[0]].append(line)
    for key, of in parts.items():
        time_s, values = np.concatenate([part[1] for part in of]), np.concatenate([part[2] for part in of])
        order = np.argsort(time_s, kind="stable")
        name = key if isinstance(key, str) else names[key] if key < len(names) else f"{_last(entity)} {key}"
        yield _batch(entity, name, time_s[order], values[order], None)
    if told:
        when, series, value, text = zip(*sorted(told, key=lambda row: row[0]), strict=True)
        yield _batch(entity, series, np.array(when), np.array(value), text)


def _batch(
    entity: str, series: str | Sequence[str], time_s: Floats, value: Floats, text: Sequence[str | None] | None
) -> pa.RecordBatch:
    words = [_words(column, len(time_s)) for column in (entity, series, text)]
    return pa.record_batch([words[0], words[1], pa.array(time_s), pa.array(value), words[2]], schema=_SCHEMA)


def _words(given: str | Sequence[str | None] | None, rows: int) -> pa.DictionaryArray:
    """Return words as codes: one a row, or the same (or nothing) in all rows."""
    if given is None or isinstance(given, str):
        missing = np.full(rows, given is None)
        return pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32), mask=missing), [given or ""])
    return pa.array(given, pa.string()).dictionary_encode()


def _names(batch: pa.RecordBatch, entity: str) -> list[str]:
    """Return what an entity's lines are called: channels, else what the viewer shows where there are several."""
    if "Lines:channels" in batch.schema.names:
        return _first(batch, "Lines:channels")
    shown = _first(batch, "SeriesLines:names") + _first(batch, "SeriesPoints:names")
    return shown if len(shown) > 1 else [_last(entity)] * len(shown)


def _lines(batch: pa.RecordBatch) -> Iterator[Line]:
    for name in ("Scalars:scalars", *_AXES):
        if name not in batch.schema.names:
            continue
        column = batch.column(name)
        sizes, values = column.value_lengths().fill_null(0).to_numpy().astype(np.int64), column.flatten()
        if pa.types.is_fixed_size_list(values.type):
            sizes, values = sizes * values.type.list_size, values.flatten()
        if sizes.max(initial=0) > _MOST_LINES:
            raise ValueError(f"{sizes.max()} lines in one entity")
        numbers = values.cast(pa.float64()).to_numpy(zero_copy_only=False)
        rows = np.repeat(np.arange(len(sizes)), sizes)
        position = np.arange(len(rows)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        time_s = _time_s(batch)[rows]
        for number in range(sizes.max(initial=0)):
            at = position == number
            axis = _AXES.get(name)
            yield f"{name.partition(':')[2]} {axis[number]}" if axis else number, time_s[at], numbers[at]


def _events_of(batch: pa.RecordBatch) -> Iterator[Told]:
    """Give what has words: events, verdicts, and Markov parameters with their lags."""
    if "TextLog:text" in batch.schema.names:
        levels = batch.column("TextLog:level").to_pylist()
        for time_s, level, text in zip(_time_s(batch), levels, batch.column("TextLog:text").to_pylist(), strict=True):
            yield float(time_s), (level or [""])[0], np.nan, (text or [""])[0]
    fields, texts = _first(batch, "Verdict:fields"), _first(batch, "Verdict:texts")
    for field, value, text in zip(fields, _first(batch, "Verdict:values"), texts, strict=True):
        yield np.nan, field, np.nan if value is None else value, text
    for lags, bars in zip(_first(batch, "BarChart:abscissa"), _first(batch, "BarChart:values"), strict=True):
        for lag, value in zip(lags["buffer"], bars["buffer"], strict=True):
            yield np.nan, "markov", float(value), f"lag {lag:g}"


def _first(batch: pa.RecordBatch, component: str) -> list[Any]:
    """Return what an entity that knows no time holds, in Python's types."""
    held = batch.column(component)[-1].as_py() if component in batch.schema.names and batch.num_rows else None
    return list(held or [])


def _time_s(batch: pa.RecordBatch) -> Floats:
    if "time" not in batch.schema.names:
        return np.full(batch.num_rows, np.nan)
    nanoseconds = batch.column("time").cast(pa.int64())
    return np.asarray(nanoseconds.to_numpy(zero_copy_only=False) / 1e9, dtype=np.float64)


def _last(entity: str) -> str:
    return entity.rpartition("/")[2]


if __name__ == "__main__":
    main(sys.argv[1], rows=sys.argv[2:] == ["rows"])
