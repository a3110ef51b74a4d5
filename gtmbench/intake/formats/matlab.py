"""MATLAB's files: scipy reads those up to v7.2, h5py v7.3 and any other HDF5; structs are branches of a tree."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.intake.formats.apart import Arrays, read_apart
from gtmbench.intake.formats.arrays import log_of_arrays
from gtmbench.intake.formats.limits import MOST_COLUMNS, check_values, reading
from gtmbench.intake.formats.raw import Format, RawLog

_HDF5 = b"\x89HDF\r\n\x1a\n"
_DEPTH = 8
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
    facts, arrays = read_apart("matlab", "h5py" if is_hdf5 else "scipy", path, kind)
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


FORMAT = Format(
    name="MATLAB (.mat) and HDF5",
    magic=(b"MATLAB 5", b"MATLAB 7", _HDF5),
    suffixes=(".mat", ".h5", ".hdf5"),
    read=read_matlab,
    has_parts=True,
)
