"""A log that is packed: one behind gzip, or one of a zip's; unpacked under a bound, and by no name of the archive's."""

from __future__ import annotations

import gzip
import stat
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

import numpy as np

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES, reading
from gtmbench.intake.formats.raw import RawLog

_PACKED_AT_MOST, _SMALL_BYTES = 100, 1 << 24  # times; what may always be unpacked
_PIECE = 1 << 20
_NO_LOGS = (
    ".md",
    ".pdf",
    ".png",
    ".jpg",
    ".jpeg",
    ".html",
    ".xml",
    ".json",
    ".yaml",
    ".yml",
    ".toml",
    ".py",
    ".m",
)
Reads = Callable[[Path], RawLog]


def read_gzip(path: Path, read: Reads) -> RawLog:
    """Read the log in a gzip."""
    with reading(path, "gzip"), gzip.open(path) as packed:
        return _unpacked(path, packed, path.name.removesuffix(".gz"), read)


def read_zip(path: Path, part: str, read: Reads) -> RawLog:
    """Read the only log in a zip, or the one that is named."""
    with reading(path, "zip"), zipfile.ZipFile(path) as archive:
        logs = {member.filename: member for member in archive.infolist() if _may_be_log(member)}
        if part and part not in logs:
            raise InputError(f"it has no '{part}'; there is {', '.join(list(logs)[:12]) or 'no log'}")
        if not logs:
            raise InputError("it holds no log")
        if len(logs) > 1 and not part:
            raise InputError(f"it holds {len(logs)} files; say which is meant: {path}:{next(iter(logs))}")
        member = logs[part or next(iter(logs))]
        with archive.open(member) as packed:
            return _unpacked(path, packed, member.filename, read)


def _may_be_log(member: zipfile.ZipInfo) -> bool:
    name = PurePosixPath(member.filename)
    hidden = any(each.startswith((".", "__MACOSX")) and each != ".." for each in name.parts)
    is_link = stat.S_ISLNK(member.external_attr >> 16)
    is_word = name.suffix.lower() in _NO_LOGS or name.stem.lower() in ("readme", "license")
    return not (member.is_dir() or hidden or is_link or is_word)


def _unpacked(path: Path, packed: IO[bytes] | gzip.GzipFile, name: str, read: Reads) -> RawLog:
    """Read what is packed, by way of a file that is gone afterwards: its columns are loaded while it is there."""
    most = min(LARGEST_FILE_BYTES, _SMALL_BYTES + _PACKED_AT_MOST * path.stat().st_size)
    with tempfile.TemporaryDirectory() as folder:
        aside = Path(folder, "log" + PurePosixPath(name).suffix[:12])
        with aside.open("wb") as plain:
            while piece := packed.read(_PIECE):
                plain.write(piece)
                if plain.tell() > most:
                    raise InputError(f"it unpacks to more than {most} bytes; unpack it, if it is a log")
        try:
            raw = read(aside)
        except InputError as error:
            raise InputError(str(error).replace(str(aside), one_line(name)[:200])) from error
        series = tuple(replace(each, load=partial(np.asarray, each.load())) for each in raw.series)
        return replace(raw, kind=f"packed {raw.kind}", series=series, batches=None)
