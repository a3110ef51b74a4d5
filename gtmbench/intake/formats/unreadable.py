"""What is no log that can be read, by its first bytes, and what would do instead."""

from __future__ import annotations

import re
from pathlib import Path

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
_BEGINS = tuple((re.compile(pattern, re.DOTALL), what, do) for pattern, what, do in _KINDS)
_BY_NAME = {
    ".bbl": ("is called as a racing quad's black box is", _DECODED),
    ".bfl": ("is called as a racing quad's black box is", _DECODED),
    ".px4log": ("is called as a log of PX4 from before 2016 is", "make a CSV of it with sdlog2_dump.py"),
}


def why_unreadable(head: bytes, path: Path) -> str:
    """Return what a file is that can't be read, and what would do; "" where nothing tells."""
    begins = head.removeprefix(b"\xef\xbb\xbf")
    for pattern, what, do in _BEGINS:
        if pattern.match(begins):
            return f"{what}; {do}"
    if path.suffix.lower() in _BY_NAME:
        what, do = _BY_NAME[path.suffix.lower()]
        return f"{what}; {do}"
    if b"\0" in head[:_FIRST] and head[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        return f"is of no format that is known (it begins {head[:8]!r}); {_CSV}"
    return ""
