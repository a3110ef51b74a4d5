"""Any log: which format a file is, by its first bytes. A new format is a file beside this one and an entry here."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.disk import is_file, no_such
from gtmbench.intake.formats import dataflash, mcap, parquet, ulog
from gtmbench.intake.formats.csv import read_csv
from gtmbench.intake.formats.csv_cells import rewrite_csv
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES
from gtmbench.intake.formats.raw import Cells, Format, RawLog

FORMATS = (parquet.FORMAT, ulog.FORMAT, dataflash.FORMAT, mcap.FORMAT)
CSV = Format(name="CSV", magic=(), suffixes=(), read=read_csv, rewrite=rewrite_csv)  # whatever begins as none of them

_PACKED = ((b"\x1f\x8b", "gzip"), (b"PK\x03\x04", "zip"), (b"\x28\xb5\x2f\xfd", "zstd"), (b"BZh", "bzip2"))
_OURS = {
    ".rrd": "a recording, which `gtmbench view` opens",
    ".toml": "a scenario, which `gtmbench run` flies",
    ".json": "results, or a monitor; a log is watched with one by `gtmbench monitor LOG --detector {}`",
}
_WORKBOOKS = (".xlsx", ".xlsm", ".xls", ".ods")
_BOOK = re.compile(rb"\xd0\xcf\x11\xe0|PK\x03\x04.{26}(\[Content_Types|_rels|docProps|xl/|mimetype)", re.DOTALL)
_OTHERS = ((b"{", "JSON"), (b"[{", "JSON"), (b"<", "HTML or XML"), (b"%PDF", "PDF"), (b"MATLAB", "MATLAB"))
_HEAD_BYTES = 64
_READ = f"read are {', '.join(form.name for form in (CSV, *FORMATS[:-1]))} and {FORMATS[-1].name}"


def read_raw(path: Path) -> RawLog:
    """Return what a log's file holds.

    Raises
    ------
    InputError
        Where it isn't a file, is too large, isn't of a known format, or is broken.
    """
    return _printable(_format(path).read(path))


def is_log(path: Path) -> bool:
    """Whether a file goes by the name of a log, or begins as one; any CSV does."""
    if not is_file(path):
        return False
    if path.suffix.lower() in (".csv", *(suffix for form in FORMATS for suffix in form.suffixes)):
        return True
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError:
        return False
    return any(head.startswith(form.magic) for form in FORMATS)


def rewrite_raw(path: Path, out: Path, cells: Sequence[Cells]) -> None:
    """Write a log's file anew with other values in some cells; everything else stays as it is.

    Raises
    ------
    InputError
        Where the format isn't written, or a column can't hold a value.
    """
    _writer(path)(path, out, cells)


def check_written(path: Path) -> None:
    """Refuse a log whose format isn't written."""
    _writer(path)


def _writer(path: Path) -> Callable[[Path, Path, Sequence[Cells]], None]:
    form = _format(path)
    if form.rewrite is None:
        written = " and ".join(each.name for each in (CSV, *FORMATS) if each.rewrite)
        raise InputError(f"{path} is {form.name}, which is only read here; {written} are written: export it as one")
    return form.rewrite


def _format(path: Path) -> Format:
    """Return the format of a file by its first bytes."""
    head = _head(path)
    if _BOOK.match(head) or (head.startswith(b"PK\x03\x04") and path.suffix.lower() in _WORKBOOKS):
        raise InputError(
            f"{path} is a spreadsheet's workbook; save its sheet as CSV, names and units in its first line"
        )
    for magic, packing in _PACKED:
        if head.startswith(magic):
            raise InputError(f"{path} is packed by {packing}; unpack it first")
    if path.suffix.lower() in _OURS:
        raise InputError(f"{path} is no log but, by its name, {_OURS[path.suffix.lower()].format(path)}; {_READ}")
    for form in FORMATS:
        if head.startswith(form.magic):
            return form
    if any(path.suffix.lower() in form.suffixes for form in FORMATS):
        raise InputError(f"{path} doesn't begin as a {path.suffix} file does (it begins {head[:8]!r}); {_READ}")
    begins = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    for magic, kind in _OTHERS:
        if begins.startswith(magic):
            raise InputError(f"{path} begins as a file of {kind} does, not as a log; export the log as CSV; {_READ}")
    return CSV


def _printable(raw: RawLog) -> RawLog:
    """Return a log whose columns have names that can be printed."""
    return replace(raw, series=tuple(replace(series, name=one_line(series.name)) for series in raw.series))


def _head(path: Path) -> bytes:
    """Return a file's first bytes, or say why it isn't to be read."""
    try:
        if path.exists() and not path.is_file():
            if path.is_dir():
                raise InputError(f"{path} is a folder; give the logs in it, as {path}/*.csv; {_READ}")
            raise InputError(f"{path} isn't a file; {_READ}")
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(no_such(path)) from error
    except PermissionError as error:
        raise InputError(f"{path} can't be read: its permissions don't allow it; type: chmod u+r {path}") from error
    except (OSError, ValueError) as error:  # ValueError: a zero in the name
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    if size > LARGEST_FILE_BYTES:
        raise InputError(f"{path} has {size} bytes; at most {LARGEST_FILE_BYTES} are read: cut the log")
    if not head:
        raise InputError(f"{path} is empty; {_READ}")
    return head
