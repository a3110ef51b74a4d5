"""KITTI's oxts: a folder with a file a sample, thirty numbers by their places, and the times of all in another file."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.formats.clock_texts import clock_texts
from gtmbench.intake.formats.dialects import dialects
from gtmbench.intake.formats.limits import check_values, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries

_KIND = "KITTI's oxts"
_FIRST = "0000000000.txt"


def read_kitti(path: Path) -> RawLog:
    """Read a drive's samples."""
    root = _root(path)
    assert root is not None  # it was asked for
    with reading(path, _KIND):
        names = sorted((root / "data").glob("*.txt"))
        rows = [name.read_text(encoding="ascii").split() for name in names]
        check_values(sum(map(len, rows)), "its samples")
        values = np.array(rows, dtype=np.float64)
        told = clock_texts((root / "timestamps.txt").read_text(encoding="ascii").splitlines())
        if told is None or values.ndim != 2 or len(told.seconds) != len(values):
            raise InputError(f"{len(values)} samples and {0 if told is None else len(told.seconds)} times don't match")
    series = tuple(
        RawSeries(name=str(place), load=partial(np.asarray, column)) for place, column in enumerate(values.T, 1)
    )
    raw = RawLog(kind=_KIND, series=series, clocks={"": np.asarray(told.seconds)}, notes=(told.note,), is_nameless=True)
    known = [dialect for dialect in dialects() if dialect.name == _KIND and dialect.found_in(raw)]
    return known[0].told_of(raw) if known else raw


def _root(path: Path) -> Path | None:
    """Return the folder with the samples and their times; None where there is none."""
    return next((root for root in (path, path / "oxts") if (root / "data" / _FIRST).is_file()), None)


def is_kitti(path: Path) -> bool:
    """Tell whether a folder is a drive's oxts, or holds one."""
    root = _root(path)
    return root is not None and (root / "timestamps.txt").is_file()


FORMAT = Format(name=_KIND, magic=(), suffixes=(), read=read_kitti, is_folder=is_kitti)
