"""Arrays in a tree, as MATLAB, HDF5 and NumPy keep them: those of as many rows are a table. NumPy's own files."""

from __future__ import annotations

import os
import re
import zipfile
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.intake.formats.apart import Arrays
from gtmbench.intake.formats.limits import MOST_COLUMNS, check_unpacked, check_values, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries

_FEWEST = 20  # rows of a table
_MOST_BESIDE = 64  # columns of an array
_SAMPLE_RATE = re.compile(r"(?i)(.*/)?(fs|sr|f_?sample|(sample|sampling)_?(rate|freq|frequency)(_?hz)?|rate_?hz)")
_STEP = re.compile(r"(?i)(.*/)?(dt|ts|t_?s|sample_?(time|period)(_?s)?|delta_?t)")
_LONGEST_STEP_S, _LEAST_RATE_HZ = 1.0, 1.0
_TIME = re.compile(r"(?i)(.*[./_])?(t|time|times|timestamps?|stamps?)([_ ]?\(?\[?(s|ms|us|ns|secs?|seconds)\)?\]?)?")


def log_of_arrays(
    kind: str, arrays: Arrays, part: str = "", *, labels: Mapping[str, Sequence[str]] = {}, notes: Sequence[str] = ()
) -> RawLog:
    """Return a log of arrays by their paths, ``flight/imu/gyro``: columns of an array are ``gyro[0]``, ``gyro[1]``.

    `arrays`: dates as such; stamps of whole numbers as they are. `part`: the branch that is meant: of its paths only
    what follows is a name; "" for the whole tree. `labels`: what the columns of an array are called, where the file
    says so. Raises an InputError where the branch isn't there, or holds no array of some rows.
    """
    chosen = _branch(arrays, part)
    columns = {
        path: list(_columns(path.removeprefix(part).strip("/").replace("/", "."), array, labels.get(path, ())))
        for path, array in chosen.items()
    }
    tables: dict[int, list[str]] = defaultdict(list)
    for path, made in columns.items():
        if made:
            tables[len(made[0][1])].append(path)
    clocks = {path: clock for rows, paths in tables.items() for path, clock in _clocks(rows, paths, columns).items()}
    if not clocks:
        raise InputError(f"it holds no column of at least {_FEWEST} numbers{_branches(arrays)}")
    if len(set(clocks.values())) == 1:
        clocks = dict.fromkeys(clocks, "")
    series = [
        RawSeries(
            name=name, load=partial(np.asarray, values), clock=clocks[path], unit="s" * (values.dtype.kind == "M")
        )
        for path, made in columns.items()
        for name, values in made
    ]
    log = RawLog(kind=kind, series=tuple(series[:MOST_COLUMNS]), notes=tuple(notes))
    if any(_TIME.fullmatch(each.name) for each in series):
        return log
    step_s, why = _step(arrays)
    if not step_s:
        return log
    return replace(
        log,
        clocks={
            clocks[path]: np.asarray(step_s * np.arange(rows), dtype=np.float64)
            for rows, paths in tables.items()
            for path in paths
        },
        time=("", "s"),
        time_guessed=why,
    )


def _step(arrays: Arrays) -> tuple[float, str]:
    """Return the seconds between samples by a number that is called so, as ``fs``, and what shows it; 0 without."""
    numbers = {
        path: float(array.ravel()[0]) for path, array in arrays.items() if array.size == 1 and array.dtype.kind in "iuf"
    }
    for path, number in numbers.items():
        if _SAMPLE_RATE.fullmatch(path) and _LEAST_RATE_HZ <= number < np.inf:
            return 1.0 / number, f"{path} = {number:g} samples a second"
        if _STEP.fullmatch(path) and 0.0 < number <= _LONGEST_STEP_S:
            return number, f"{path} = {number:g} between samples"
    return 0.0, ""


def _branch(arrays: Arrays, part: str) -> Arrays:
    """Return the arrays of a branch, or one of them."""
    chosen = {path: array for path, array in arrays.items() if not part or f"{path}/".startswith(f"{part}/")}
    if not chosen:
        raise InputError(f"it has no '{part}'{_branches(arrays)}")
    return {path: array for path, array in chosen.items() if array.dtype.kind in "iufbM"}


def _branches(arrays: Arrays) -> str:
    tables = [path for path, array in arrays.items() if array.size > 1]
    return f"; it holds {listed(tables[:12])}" if tables else ""


def _columns(name: str, array: NDArray[Any], labels: Sequence[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Give an array's columns, its longer side being the rows; none of what is too short or has more sides."""
    array = array.reshape([size for size in array.shape if size != 1] or [1])
    if array.ndim == 2 and array.shape[0] < array.shape[1]:
        array = array.T
    if array.ndim not in (1, 2) or len(array) < _FEWEST or (array.ndim == 2 and array.shape[1] > _MOST_BESIDE):
        return
    if array.ndim == 1:
        yield name, array
        return
    own = labels if len(labels) == array.shape[1] else ()
    for place, column in enumerate(array.T):
        yield (f"{name}.{own[place]}" if own else f"{name}[{place}]"), column


def _clocks(rows: int, paths: Sequence[str], columns: Mapping[str, list[tuple[str, NDArray[Any]]]]) -> dict[str, str]:
    """Return which table each array of so many rows is of: of several times each has the nearest in the tree."""
    times = [path for path in paths if any(_TIME.fullmatch(name) for name, _ in columns[path])]
    if len(times) < 2:
        return dict.fromkeys(paths, str(rows))

    def nearest(path: str) -> str:
        return max(times, key=lambda time: (len(os.path.commonpath(["/" + time, "/" + path])), -len(time)))

    return {path: nearest(path) for path in paths}


_ARCHIVE = "NumPy archive"


def read_numpy(path: Path, part: str = "") -> RawLog:
    """Read an archive's arrays, fields of a structured one as arrays of their own; objects are left out, unopened."""
    with reading(path, _ARCHIVE), path.open("rb") as file:
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
        return log_of_arrays(_ARCHIVE, arrays, part, notes=notes)


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
