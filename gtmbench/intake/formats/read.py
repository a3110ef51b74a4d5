"""Any log: which format a file is, by its first bytes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.intake.formats import dataflash, mcap, ulog
from gtmbench.intake.formats.csv import read_csv
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES
from gtmbench.intake.formats.parquet import read_parquet
from gtmbench.intake.formats.raw import RawLog

_READ = "read are CSV, Parquet, PX4 ULog, ArduPilot DataFlash (.bin, .log) and MCAP"
_READERS = (
    (ulog.MAGIC, ulog.read_ulog),
    (mcap.MAGIC, mcap.read_mcap),
    (dataflash.HEAD, dataflash.read_dataflash),
    (b"FMT,", dataflash.read_dataflash),
    (b"PAR1", read_parquet),
)
_PACKED = ((b"\x1f\x8b", "gzip"), (b"PK\x03\x04", "zip"), (b"\x28\xb5\x2f\xfd", "zstd"), (b"BZh", "bzip2"))
_BINARY = {".ulg", ".ulog", ".mcap", ".bin", ".parquet"}


def read_raw(path: Path) -> RawLog:
    """Return what a log's file holds.

    Raises
    ------
    InputError
        Where it isn't a file, is too large, isn't of a known format, or is broken.
    """
    head = _head(path)
    for magic, packing in _PACKED:
        if head.startswith(magic):
            raise InputError(f"{path} is packed by {packing}; unpack it first")
    for magic, reader in _READERS:
        if head.startswith(magic):
            return _named(reader(path))
    if path.suffix.lower() in _BINARY:
        raise InputError(f"{path} doesn't begin as a {path.suffix} file does (it begins {head[:8]!r}); {_READ}")
    return _named(read_csv(path))


def _named(raw: RawLog) -> RawLog:
    """Return a log whose columns have names that can be printed."""
    return replace(raw, series=tuple(replace(one, name=one_line(one.name)) for one in raw.series))


def _head(path: Path) -> bytes:
    """Return a file's first bytes, or say why it isn't to be read."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} isn't a file; {_READ}")
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(16)
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a zero in the name
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    if size > LARGEST_FILE_BYTES:
        raise InputError(f"{path} has {size} bytes; at most {LARGEST_FILE_BYTES} are read: cut the log")
    if not head:
        raise InputError(f"{path} is empty; {_READ}")
    return head
