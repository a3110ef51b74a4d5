"""NumPy's archives (.npz) and arrays (.npy); no pickle in them is opened."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from gtmbench.intake.formats.apart import Arrays
from gtmbench.intake.formats.arrays import log_of_arrays
from gtmbench.intake.formats.limits import check_unpacked, check_values, reading
from gtmbench.intake.formats.raw import Format, RawLog

_KIND = "NumPy archive"


def read_numpy(path: Path, part: str = "") -> RawLog:
    """Read an archive's arrays, fields of a structured one as arrays of their own; objects are left out."""
    with reading(path, _KIND), path.open("rb") as file:
        if file.read(2) != b"PK":
            file.seek(0)
            return log_of_arrays("NumPy array", _fields("", np.load(file, allow_pickle=False)), part)
        arrays: Arrays = {}
        left_out = []
        with zipfile.ZipFile(file) as archive:
            check_unpacked(sum(member.file_size for member in archive.infolist()), path)
            for name in archive.namelist():
                if name.endswith(".npy"):
                    with archive.open(name) as member:
                        version = np.lib.format.read_magic(member)
                        read_header = getattr(np.lib.format, f"read_array_header_{version[0]}_0")
                        shape, _, dtype = read_header(member)
                    check_values(float(np.prod(shape, dtype=float)), f"its array '{name[:-4][:60]}'")
                    if dtype.hasobject:
                        left_out.append(name[:-4])
                        continue
                    with archive.open(name) as member:
                        arrays |= _fields(name[:-4], np.lib.format.read_array(member, allow_pickle=False))
        notes = [f"left out, pickled objects: {', '.join(left_out[:12])}"] if left_out else []
        return log_of_arrays(_KIND, arrays, part, notes=notes)


def _fields(name: str, array: np.ndarray) -> Arrays:
    if array.dtype.names is None:
        return {name or "array": array}
    return {f"{name}/{field}".strip("/"): array[field] for field in array.dtype.names}


FORMAT = Format(
    name="NumPy (.npz)",
    magic=(b"\x93NUMPY",),
    pattern=rb"PK\x03\x04.{26}[^\x00/]{1,200}\.npy",
    suffixes=(".npz", ".npy"),
    read=read_numpy,
    has_parts=True,
)
