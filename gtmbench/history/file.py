"""A history's file: a row a constant, of all flights of all airframes that were entered; Parquet, sealed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.locks import alone, lock_beside
from gtmbench.files.plain import Column, Row, table_of
from gtmbench.files.seals import SLOT, fill_slot, is_intact
from gtmbench.files.writing import atomic_write, is_file, is_folder
from gtmbench.history.entry import Constant, Entry

SCHEMA = 1
IN_FOLDER = ".gtmbench-history.parquet"  # of a folder of logs: hidden, so that it is none of them
_PATIENCE_S = 60.0  # for another process that writes it
_MOST_BYTES = 500_000_000  # more is no history
_COLUMNS = {
    "digest": Column("string", "of the log's file, SHA-256"),
    "log": Column("string", "the file's name"),
    "airframe": Column("string", "by the hardware's identifier, else as it was given or by its folder"),
    "hardware": Column("string", "the autopilot's identifier; empty where the log states none"),
    "temperature_c": Column("float", "the IMU's, the median of the flight; null where it isn't logged"),
    "begins": Column("bool", "whether an installation begins with this flight"),
    "sensor": Column("string", "whose constant; null of a flight that tells none"),
    "constant": Column("string", "which; of a noise the natural logarithm of its standard deviation"),
    "value": Column("double", "in deg/s, deg, s or as a factor"),
    "deviation": Column("float", "the standard deviation of what the flight tells it by"),
    "apart": Column("bool", "whether it was another than before, and counts in no prediction"),
}


def history_file(given: Path) -> Path:
    """Return the file that is meant: of a folder of logs, the one in it."""
    return given / IN_FOLDER if is_folder(given) else given


def read_history(path: Path) -> tuple[Entry, ...]:
    """Return the flights of a history as they were entered; none without a file. InputError: damaged, or none."""
    if not is_file(path):
        if path.exists():
            raise InputError(f"--history is {path}, which is no file; give a file's name, such as airframe.parquet")
        return ()
    import pyarrow as pa
    import pyarrow.parquet as pq

    remedy = "it is left as it is: give another --history, or bring back a copy of it"
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path} has {path.stat().st_size} bytes, which no history has; {remedy}")
        content = path.read_bytes()
        table = pq.read_table(pa.BufferReader(content))
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path} is no history that can be read ({one_line(str(error))[:120]}); {remedy}") from error
    told = (table.schema.metadata or {}).get(b"gtmbench.schema")
    if told is None or not set(_COLUMNS) <= set(table.column_names):
        raise InputError(f"{path} is no history but another table; {remedy}")
    if told != str(SCHEMA).encode():
        raise InputError(f"{path} is a history by another version of gtmbench; {remedy}")
    if not is_intact(content):
        raise InputError(f"{path} isn't what was written, by its digest: altered or damaged; {remedy}")
    by_digest: dict[str, list[Row]] = {}
    for row in table.to_pylist():
        by_digest.setdefault(row["digest"], []).append(row)
    return tuple(_entry(own) for own in by_digest.values())


def enter(path: Path, entry: Entry) -> bool:
    """Enter a flight beside what others enter meanwhile; return whether it is new: each log is entered once."""
    if not path.parent.is_dir():
        raise InputError(f"can't write {path}: folder {path.parent} doesn't exist; create it first")
    with alone(lock_beside(path), f"another process writes {path}", patience_s=_PATIENCE_S):
        entries = read_history(path)
        if any(each.digest == entry.digest for each in entries):
            return False
        _write(path, [*entries, entry])
    return True


def _write(path: Path, entries: Sequence[Entry]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = table_of([row for entry in entries for row in _rows(entry)], _COLUMNS, schema=SCHEMA)
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), b"digest": SLOT})
    content = pa.BufferOutputStream()
    pq.write_table(table, content, compression="zstd")
    with atomic_write(path) as aside:
        aside.write_bytes(fill_slot(content.getvalue().to_pybytes()))


def _rows(entry: Entry) -> list[Row]:
    own: Row = {
        "digest": entry.digest,
        "log": one_line(entry.log),
        "airframe": entry.airframe,
        "hardware": entry.hardware,
        "temperature_c": entry.temperature_c if math.isfinite(entry.temperature_c) else None,
        "begins": entry.begins,
    }
    told: list[Row] = [
        {
            "sensor": each.sensor,
            "constant": each.name,
            "value": each.value,
            "deviation": each.deviation,
            "apart": each.key in entry.apart,
        }
        for each in entry.constants
    ]
    return [own | row for row in told or [{"apart": False}]]


def _entry(rows: Sequence[Row]) -> Entry:
    first, told = rows[0], [row for row in rows if row["sensor"] is not None]
    return Entry(
        digest=first["digest"],
        log=first["log"],
        airframe=first["airframe"],
        hardware=first["hardware"],
        temperature_c=math.nan if first["temperature_c"] is None else first["temperature_c"],
        constants=tuple(
            Constant(sensor=row["sensor"], name=row["constant"], value=row["value"], deviation=row["deviation"])
            for row in told
        ),
        apart=frozenset((row["sensor"], row["constant"]) for row in told if row["apart"]),
        begins=first["begins"],
    )
