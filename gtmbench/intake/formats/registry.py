"""Any log: which format a file is, by its first bytes, or why none. A new format is a file here, and an entry.

A log that is packed, behind gzip, one of a zip's, or all its tables, is unpacked aside, under a bound.
"""

from __future__ import annotations

import gzip
import os
import re
import stat
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

import numpy as np

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.writing import is_file, is_folder, no_such
from gtmbench.intake.formats import (
    arrays,
    dataflash,
    excel,
    mcap,
    parquet,
    rosbag,
    table_folder,
    tlog,
    ulog,
)
from gtmbench.intake.formats.csv import read_csv
from gtmbench.intake.formats.csv_cells import rewrite_csv
from gtmbench.intake.formats.dialects import with_dialect
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES, reading
from gtmbench.intake.formats.raw import Cells, Format, RawLog
from gtmbench.intake.formats.table_folder import MOST_TABLES, is_folder_of_tables

FORMATS = (
    parquet.FORMAT,
    ulog.FORMAT,
    dataflash.FORMAT,
    mcap.FORMAT,
    tlog.FORMAT,
    tlog.PLANNER,
    tlog.PAPARAZZI,
    rosbag.FORMAT,
    arrays.MATLAB,
    arrays.NUMPY,
    excel.FORMAT,
    table_folder.ALFA,
    table_folder.KITTI,
    table_folder.FORMAT,
)
CSV = Format(name="CSV", magic=(), suffixes=(), read=read_csv, rewrite=rewrite_csv)  # whatever begins as none of them

_OURS = {
    ".rrd": "a recording, which `gtmbench view` opens",
    ".toml": "a scenario, which `gtmbench run` flies",
    ".json": "results, or a monitor; a log is watched with one by `gtmbench monitor LOG --detector {}`",
}
_NEVER_NOTES = (parquet.FORMAT, ulog.FORMAT, dataflash.FORMAT, mcap.FORMAT, tlog.FORMAT, rosbag.FORMAT)
_GZIP, _ZIP = b"\x1f\x8b", b"PK\x03\x04"
_HEAD_BYTES = 600  # that tell a format
_READ = (
    "read are CSV, Parquet, PX4's ULog, ArduPilot's DataFlash, MAVLink's tlog, Paparazzi, ROS bags, MCAP, MATLAB, "
    "HDF5, NumPy, Excel and folders of tables"
)


def split_part(log: str | Path) -> tuple[Path, str]:
    """Return a log's path and which part of it is meant: ``flight.mat:run1/imu``, a branch; "" for all of it.

    >>> split_part("none.mat:run1/imu"), split_part("none.csv")
    ((PosixPath('none.mat'), 'run1/imu'), (PosixPath('none.csv'), ''))
    """
    before, colon, part = str(log).rpartition(":")
    if colon and before and not _is_there(Path(log)) and (_is_there(Path(before)) or Path(before).suffix):
        return Path(before), part
    return Path(log), ""


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def read_raw(path: Path, part: str = "") -> RawLog:
    """Return what a log's file holds, or a part of it: a branch, a sheet, a system, one of a zip's files."""
    form = _form(path)
    if part and not form.has_parts:
        raise InputError(f"{path}:{part}: a log that is {form.name} has no parts; leave ':{part}' out")
    raw = form.read(path, part) if form.has_parts else form.read(path)
    printable = tuple(replace(series, name=one_line(series.name)) for series in raw.series)
    return with_dialect(replace(raw, series=printable))


def is_log_name(name: str) -> bool:
    """Whether a file that is called so goes by the name of a log.

    >>> is_log_name("flight.ULG"), is_log_name("notes.txt")
    (True, False)
    """
    return Path(name).suffix.lower() in (".csv", *(suffix for form in FORMATS for suffix in form.suffixes))


def is_log(path: Path) -> bool:
    """Whether a file goes by the name of a log, or begins as one; any CSV does. Some folders are one log."""
    if is_log_folder(path):
        return True
    if not is_file(path):
        return False
    if is_log_name(path.name):
        return True
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False
    return any(form.begins(head) for form in FORMATS)


def is_log_folder(path: Path) -> bool:
    """Whether a folder is one log."""
    try:
        return path.is_dir() and _folder_format(path) is not None
    except OSError:
        return False


def _folder_format(path: Path) -> Format | None:
    """Return the format of which a folder is one log; None where it isn't one, or a log lies beside its tables."""
    form = next((form for form in FORMATS if form.is_folder and form.is_folder(path)), None)
    if form in (table_folder.ALFA, table_folder.FORMAT) and any(map(_is_another_log, path.iterdir())):
        return None
    return form


def _is_another_log(file: Path) -> bool:
    """Tell whether a file beside tables is another log of an autopilot, of ROS or of ours: it has another name."""
    if file.suffix.lower() == ".csv" or file.name.startswith(".") or not file.is_file():
        return False
    with file.open("rb") as opened:
        head = opened.read(_HEAD_BYTES)
    if not any(form.begins(head) for form in _NEVER_NOTES):
        return False
    return not any(re.match(rf"{re.escape(file.stem)}[-_. ]", table.stem) for table in file.parent.glob("*.csv"))


def rewrite_raw(path: Path, out: Path, cells: Sequence[Cells]) -> None:
    """Write a log's file anew with other values in some cells; everything else stays as it is."""
    form = _form(path)
    if form.rewrite is None:
        written = " and ".join(each.name for each in (CSV, *FORMATS) if each.rewrite)
        raise InputError(f"{path} is {form.name}, which is only read here; {written} are written")
    form.rewrite(path, out, cells)


def is_written(path: Path) -> bool:
    """Whether a log's format is written here, not only read."""
    return _form(path).rewrite is not None


def _form(path: Path) -> Format:
    return _packed(path) or _format(path)


def _packed(path: Path) -> Format | None:
    """Return what reads a log that is packed; None of others."""
    if is_folder(path):
        return None
    head = _head(path)
    if head.startswith(_GZIP):
        return Format(name="packed", magic=(), suffixes=(), read=read_gzip)
    is_book = path.suffix.lower() in excel.FORMAT.suffixes
    if head.startswith(_ZIP) and not is_book and not any(form.begins(head) for form in FORMATS):
        return Format(name="zip", magic=(), suffixes=(), read=read_zip, has_parts=True)
    return None


def _format(path: Path) -> Format:
    """Return the format of a file by its first bytes, or of a folder."""
    if is_folder(path) and (whole := _folder_format(path)) is not None:
        return whole
    head = _head(path)
    if path.suffix.lower() in _OURS:
        raise InputError(f"{path} is no log but, by its name, {_OURS[path.suffix.lower()].format(path)}; {_READ}")
    for form in FORMATS:
        if form.begins(head):
            return form
    suffix = path.suffix.lower()
    if suffix == ".mat" or (head.startswith(_ZIP) and suffix in excel.FORMAT.suffixes):  # these may begin as they like
        return arrays.MATLAB if suffix == ".mat" else excel.FORMAT
    if why := why_unreadable(head, path):
        raise InputError(f"{path} {why}; {_READ}")
    if any(suffix in form.suffixes for form in FORMATS):
        raise InputError(f"{path} doesn't begin as a {path.suffix} file does (it begins {head[:8]!r}); {_READ}")
    return CSV


def _head(path: Path) -> bytes:
    """Return a file's first bytes, or say why it isn't to be read."""
    try:
        if path.exists() and not path.is_file():
            what = f"is a folder; give the logs in it, as {path}/*.csv" if path.is_dir() else "isn't a file"
            raise InputError(f"{path} {what}; {_READ}")
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


_FIRST = 64  # bytes that tell text
_CSV = "export the log as CSV"
# what a file begins with, what it is and what would do; the first that fits
_LOG, _SHEET = "give the log (.bin, .ulg or .tlog)", "save its sheet as CSV, names and units in its first line"
_DECODED = "make a CSV of it with blackbox_decode, or export one in the Blackbox Explorer"
_FROM_MAVLOGDUMP = "give the log itself, or a folder of tables: mavlogdump.py --types IMU --format csv, and so on"
_PARAMETER = rb"#?\s*[A-Z][A-Z0-9_]{2,15}[,\t ]+[-0-9.]+\s*\n"
_KINDS = (
    (rb".{0,500}H Product:Blackbox", "is a racing quad's black box (Betaflight, INAV)", _DECODED),
    (rb"version https://git-lfs", "is a pointer of Git LFS, not the file itself", "type: git lfs pull"),
    (rb"\d{4}-\d\d-\d\d [\d:.]+: [A-Z0-9_]+ \{", "is what mavlogdump.py prints", _FROM_MAVLOGDUMP),
    (rb".{0,400}<kml", "is a KML track: positions only, no gyros", _LOG),
    (rb".{0,400}<gpx", "is a GPX track: positions only, no gyros", _LOG),
    (rb"\$G[PN]", "holds NMEA sentences of a GPS: positions only, no gyros", _LOG),
    (rb"#NOTE:|# Onboard parameters|" + 3 * _PARAMETER, "holds parameters of an autopilot, not a flight", _LOG),
    (rb"\x89PNG|\xff\xd8\xff|GIF8|BM.{4}\0\0\0\0|RIFF.{4}WEBP", "is a picture", "give the log itself"),
    (rb"\0\0\0.ftyp", "is a video", "give the log itself"),
    (rb"\xd0\xcf\x11\xe0|PK\x03\x04.{26}mimetype", "is a spreadsheet's workbook", _SHEET),
    (rb"PK\x03\x04", "is packed once more", "unpack the outer one first"),
    (rb"\x28\xb5\x2f\xfd", "is packed by zstd", "unpack it first"),
    (rb"BZh\d", "is packed by bzip2", "unpack it first"),
    (rb"\xfd7zXZ|7z\xbc\xaf", "is packed by xz or 7-Zip", "unpack it first"),
    (rb"CDF[\x01\x02]", "is a file of netCDF", _CSV),
    (rb"\x80[\x02-\x05].{0,12}[c\x8c]", "is a pickle, which could run anything", "save the arrays as .npz"),
    (rb"\s*\[?\{", "begins as a file of JSON does, not as a log", _CSV),
    (rb"\s*<", "begins as a file of HTML or XML does, not as a log", _CSV),
    (rb"%PDF", "begins as a file of PDF does, not as a log", _CSV),
)
_BY_NAME = {
    ".bbl": ("is called as a racing quad's black box is", _DECODED),
    ".bfl": ("is called as a racing quad's black box is", _DECODED),
    ".px4log": ("is called as a log of PX4 from before 2016 is", "make a CSV of it with sdlog2_dump.py"),
}


def why_unreadable(head: bytes, path: Path) -> str:
    """Return what a file is that can't be read, and what would do; "" where nothing tells."""
    begins = head.removeprefix(b"\xef\xbb\xbf")
    known = next((told for pattern, *told in _KINDS if re.match(pattern, begins, re.DOTALL)), None)
    if told := known or _BY_NAME.get(path.suffix.lower()):
        return "; ".join(told)
    if b"\0" in head[:_FIRST] and head[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        return f"is of no format that is known (it begins {head[:8]!r}); {_CSV}"
    return ""


_PACKED_AT_MOST, _SMALL_BYTES = 100, 1 << 24  # times; what may always be unpacked
_PIECE = 1 << 20  # bytes that are unpacked at once
_LONGEST_NAME = 100  # characters of an unpacked table's name
_NO_LOGS = (".md", ".pdf", ".png", ".jpg", ".jpeg", ".html", ".xml", ".json", ".yaml", ".yml", ".toml", ".py", ".m")


def read_gzip(path: Path) -> RawLog:
    """Read the log in a gzip."""
    with reading(path, "gzip"), gzip.open(path) as packed, tempfile.TemporaryDirectory() as folder:
        name = path.name.removesuffix(".gz")
        aside = Path(folder, "log" + _suffix(name))
        _unpack(packed, aside, _most_bytes(path))
        return _read_aside(aside, name)


def read_zip(path: Path, part: str) -> RawLog:
    """Read the only log in a zip, the one that is named, or its tables where they are one flight's."""
    with reading(path, "zip"), zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory() as folder:
        logs = {member.filename: member for member in archive.infolist() if _may_be_log(member)}
        if part and part not in logs:
            raise InputError(f"it has no '{part}'; there is {', '.join(list(logs)[:12]) or 'no log'}")
        if not logs:
            raise InputError("it holds no log")
        if len(logs) > 1 and not part:
            return _read_tables(path, archive, list(logs.values()), Path(folder))
        member = logs[part or next(iter(logs))]
        aside = Path(folder, "log" + _suffix(member.filename))
        with archive.open(member) as packed:
            _unpack(packed, aside, _most_bytes(path))
        return _read_aside(aside, member.filename)


def _read_tables(path: Path, archive: zipfile.ZipFile, members: Sequence[zipfile.ZipInfo], folder: Path) -> RawLog:
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
            return _read_aside(folder, path.name)
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


def _read_aside(aside: Path, name: str) -> RawLog:
    """Read what was unpacked, once, and load its columns while it is there; it goes by its own name."""
    try:
        raw = _format(aside).read(aside)
    except InputError as error:
        raise InputError(str(error).replace(str(aside), one_line(name)[:200])) from error
    series = tuple(replace(each, load=partial(np.asarray, each.load())) for each in raw.series)
    events = partial(tuple, raw.events())  # they may be read from tables, too
    return replace(raw, kind=f"packed {raw.kind}", series=series, batches=None, events=events)
