"""A log that is packed: behind gzip, one of a zip's, or all its tables; unpacked aside, under a bound."""

from __future__ import annotations

import gzip
import os
import stat
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

import numpy as np

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES, reading
from gtmbench.intake.formats.raw import RawLog
from gtmbench.intake.formats.table_folder import MOST_TABLES, is_folder_of_tables

_PACKED_AT_MOST, _SMALL_BYTES = 100, 1 << 24  # times; what may always be unpacked
_PIECE = 1 << 20
_LONGEST_NAME = 100
_NO_LOGS = (".md", ".pdf", ".png", ".jpg", ".jpeg", ".html", ".xml", ".json", ".yaml", ".yml", ".toml", ".py", ".m")
Reads = Callable[[Path], RawLog]


def read_gzip(path: Path, read: Reads) -> RawLog:
    """Read the log in a gzip."""
    with reading(path, "gzip"), gzip.open(path) as packed, tempfile.TemporaryDirectory() as folder:
        name = path.name.removesuffix(".gz")
        aside = Path(folder, "log" + _suffix(name))
        _unpack(packed, aside, _most_bytes(path))
        return _read_aside(aside, name, read)


def read_zip(path: Path, part: str, read: Reads) -> RawLog:
    """Read the only log in a zip, the one that is named, or its tables where they are one flight's."""
    with reading(path, "zip"), zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory() as folder:
        logs = {member.filename: member for member in archive.infolist() if _may_be_log(member)}
        if part and part not in logs:
            raise InputError(f"it has no '{part}'; there is {', '.join(list(logs)[:12]) or 'no log'}")
        if not logs:
            raise InputError("it holds no log")
        if len(logs) > 1 and not part:
            return _read_tables(path, archive, list(logs.values()), Path(folder), read)
        member = logs[part or next(iter(logs))]
        aside = Path(folder, "log" + _suffix(member.filename))
        with archive.open(member) as packed:
            _unpack(packed, aside, _most_bytes(path))
        return _read_aside(aside, member.filename, read)


def _read_tables(
    path: Path, archive: zipfile.ZipFile, members: Sequence[zipfile.ZipInfo], folder: Path, read: Reads
) -> RawLog:
    """Read the tables of one flight, as a folder of them; refuse any other files."""
    names = [PurePosixPath(member.filename) for member in members]
    left, inner = _most_bytes(path), os.path.commonpath([name.parent for name in names])
    aside = [folder / one_line(str(name.relative_to(inner)))[-_LONGEST_NAME:] for name in names]
    if len(set(aside)) == len(aside) <= MOST_TABLES and {name.suffix.lower() for name in names} <= {".csv", ".txt"}:
        for member, table in zip(members, aside, strict=True):
            if not table.resolve().is_relative_to(folder.resolve()):
                raise InputError(f"it names a file outside of itself, {one_line(member.filename)[:80]}")
            table.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(member) as packed:
                left -= _unpack(packed, table, left)
        if is_folder_of_tables(folder):
            return _read_aside(folder, path.name, read)
    raise InputError(f"it holds {len(members)} files; say which is meant: {path}:{names[0]}")


def _may_be_log(member: zipfile.ZipInfo) -> bool:
    name = PurePosixPath(member.filename)
    hidden = any(each.startswith((".", "__MACOSX")) and each != ".." for each in name.parts)
    is_link = stat.S_ISLNK(member.external_attr >> 16)
    is_word = name.suffix.lower() in _NO_LOGS or {"readme", "license", "meta"} & {name.stem.lower(), name.parent.name}
    return not bool(member.is_dir() or hidden or is_link or is_word)


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix[:12]


def _most_bytes(path: Path) -> int:
    return min(LARGEST_FILE_BYTES, _SMALL_BYTES + _PACKED_AT_MOST * path.stat().st_size)


def _unpack(packed: IO[bytes] | gzip.GzipFile, aside: Path, most: int) -> int:
    """Write what is packed to a file, and return its size."""
    with aside.open("wb", buffering=0) as plain:
        while piece := packed.read(_PIECE):
            try:
                plain.write(piece)
            except OSError as error:
                why = f"it can't be unpacked in {aside.parent.parent}: {error.strerror}"
                raise InputError(f"{why}; make room there, or set TMPDIR to another folder") from error
            if plain.tell() > most:
                raise InputError("it unpacks to far more than its size; unpack it, if it is a log")
        return plain.tell()


def _read_aside(aside: Path, name: str, read: Reads) -> RawLog:
    """Read what was unpacked; its columns are loaded while it is there, and it goes by its own name."""
    try:
        raw = read(aside)
    except InputError as error:
        raise InputError(str(error).replace(str(aside), one_line(name)[:200])) from error
    series = tuple(replace(each, load=partial(np.asarray, each.load())) for each in raw.series)
    events = partial(tuple, raw.events())  # they may be read from tables, too
    return replace(raw, kind=f"packed {raw.kind}", series=series, batches=None, events=events)
