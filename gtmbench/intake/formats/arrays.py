"""Arrays in a tree: MATLAB's files, HDF5's and NumPy's; those of as many rows are a table, structs are branches.

scipy reads MATLAB's files up to v7.2, h5py v7.3 and any other HDF5, numpy its own archives (.npz) and arrays (.npy).
"""

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
from gtmbench.intake.formats.limits import MOST_COLUMNS, Arrays, check_unpacked, check_values, read_apart, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries

_FEWEST = 20  # rows of a table
_MOST_BESIDE = 64  # columns of an array
_SAMPLE_RATE = re.compile(r"(?i)(.*/)?(fs|sr|f_?sample|(sample|sampling)_?(rate|freq|frequency)(_?hz)?|rate_?hz)")
_STEP = re.compile(r"(?i)(.*/)?(dt|ts|t_?s|sample_?(time|period)(_?s)?|delta_?t)")
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
        if _SAMPLE_RATE.fullmatch(path) and 1.0 <= number < np.inf:
            return 1.0 / number, f"{path} = {number:g} samples a second"
        if _STEP.fullmatch(path) and 0.0 < number <= 1.0:
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


NUMPY = Format(
    name="NumPy (.npz)",
    magic=(b"\x93NUMPY",),
    pattern=rb"PK\x03\x04.{26}[^\x00/]{1,200}\.npy",
    suffixes=(".npz", ".npy"),
    read=read_numpy,
    has_parts=True,
)


_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEPTH = 8  # of structs in structs
_LABELS = ("_label", "_labels", "_names", "_columns")  # beside a matrix: what its columns are called
_CONVERTED = (
    "{names}: a {what} can't be read from a .mat; in MATLAB type: "
    "S = table2struct({table}, 'ToScalar', true); save('flight.mat', '-struct', 'S', '-v7')"
)


def read_matlab(path: Path, part: str = "") -> RawLog:
    """Read the arrays of a file's structs; tables and other objects are named, with what converts them."""
    with path.open("rb") as file:
        is_hdf5 = _HDF5 in file.read(520)
    kind = "MATLAB v7.3 or HDF5 file" if is_hdf5 else "MATLAB file"
    facts, arrays = read_apart("arrays", "h5py" if is_hdf5 else "scipy", path, kind)
    objects, texts = facts["objects"], facts["texts"]
    notes = [f"left out: {_objects_text(objects)}"] if objects else []
    labels = {
        name.removesuffix(ending): words for name, words in texts.items() for ending in _LABELS if name.endswith(ending)
    }
    with reading(path, kind):
        if objects and not arrays:
            raise InputError(_objects_text(objects))
        return log_of_arrays(kind, arrays, part.strip("/"), labels=labels, notes=notes)


def _objects_text(objects: dict[str, str]) -> str:
    """Say which objects stand there, and what to type in MATLAB for the first of them."""
    first, what = next(iter(objects.items()))
    table = f"timetable2table({first})" if what == "timetable" else first
    return _CONVERTED.format(names=listed(list(objects)[:6]), what=what, table=table)


def arrays(path: str) -> tuple[dict[str, Any], Arrays]:
    """Return a file's arrays, its texts and the classes of its objects by their paths; in a process of its own."""
    with Path(path).open("rb") as file:
        found = dict(_of_hdf5(path) if _HDF5 in file.read(520) else _of_scipy(path))
    texts = {name: value for name, value in found.items() if isinstance(value, list)}
    objects = {name: value for name, value in found.items() if isinstance(value, str)}
    numbers = {name: value for name, value in found.items() if isinstance(value, np.ndarray)}
    return {"texts": texts, "objects": objects}, numbers


Found = Iterator[tuple[str, Any]]  # a path, and an array, a list of texts, or an object's class


def _of_scipy(path: str) -> Found:
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque, mat_struct

    for name, shape, _ in whosmat(path):
        check_values(float(np.prod(shape, dtype=float)), f"its array '{name[:60]}'")
    loaded = loadmat(path, squeeze_me=True, struct_as_record=False)
    left = [(name, value, 0) for name, value in loaded.items() if not name.startswith("__")]
    for count, (name, value, depth) in enumerate(left):
        if count > MOST_COLUMNS:
            return
        if isinstance(value, (MatlabOpaque, MatlabObject, MatlabFunction)):
            yield name, _class_of(value)
        elif isinstance(value, mat_struct) and depth < _DEPTH:
            left += [(f"{name}/{field}", getattr(value, field), depth + 1) for field in value._fieldnames]
        elif isinstance(value, np.ndarray) and value.dtype.kind in "OU" and value.size:
            flat = value.ravel()[:MOST_COLUMNS].tolist()
            if all(isinstance(each, str) for each in flat):
                yield name, flat
            elif depth < _DEPTH:  # a struct's array, or a cell's
                left += [(f"{name}({place})", each, depth + 1) for place, each in enumerate(flat[:64], 1)]
        elif isinstance(value, (np.ndarray, int, float)) and np.asarray(value).dtype.kind in "iufb":
            yield name, np.asarray(value)


def _class_of(value: Any) -> str:
    for field in ("s2", "_Class", "classname"):
        if getattr(value, "dtype", None) is not None and value.dtype.names and field in value.dtype.names:
            found = value[field].ravel()[0]
            return found.decode("latin-1") if isinstance(found, bytes) else str(found)
    return str(getattr(value, "classname", "object"))


def _of_hdf5(path: str) -> Found:
    import h5py

    seen: set[int] = set()
    with h5py.File(path, "r") as file:
        left: list[tuple[str, Any, int]] = [("", file, 0)]
        for count, (name, node, depth) in enumerate(left):
            if count > MOST_COLUMNS:
                return
            address = h5py.h5o.get_info(node.id).addr
            what = _text(node.attrs.get("MATLAB_class", b"")) if name else ""
            if address in seen:
                continue
            seen.add(address)
            if isinstance(node, h5py.Group):
                members = [
                    key for key in node if isinstance(node.get(key, getlink=True), h5py.HardLink) and key[:1] != "#"
                ]
                if depth < _DEPTH:
                    left += [(f"{name}/{key}".strip("/"), node[key], depth + 1) for key in members]
            elif "MATLAB_object_decode" in node.attrs:
                yield name, what or "object"
            elif isinstance(node, h5py.Dataset) and not (node.external or node.is_virtual):
                yield from _of_dataset(file, name, node, what)


def _of_dataset(file: Any, name: str, node: Any, what: str) -> Found:
    import h5py

    check_values(float(np.prod(node.shape or (), dtype=float)), f"its array '{name[:60]}'")
    if what == "cell" and node.size <= MOST_COLUMNS:
        cells = [file[reference] for reference in node[()].ravel() if reference]
        if all(_text(cell.attrs.get("MATLAB_class", b"")) == "char" for cell in cells):
            yield name, ["".join(map(chr, cell[()].ravel())) for cell in cells]
    elif node.dtype.names:
        for field in node.dtype.names:
            if node.dtype[field].kind in "iufb":
                yield f"{name}/{field}", node[field]
    elif node.dtype.kind in "iufb" and what != "char":
        yield name, node[()]
    elif h5py.check_string_dtype(node.dtype) and node.size <= MOST_COLUMNS:
        yield name, [_text(each) for each in np.ravel(node[()]).tolist()]


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


MATLAB = Format(
    name="MATLAB (.mat) and HDF5",
    magic=(b"MATLAB 5", b"MATLAB 7", _HDF5),
    suffixes=(".mat", ".h5", ".hdf5"),
    read=read_matlab,
    has_parts=True,
)
