"""Failures that a data set states beside its logs: UAV-SEAD's ``mapping.json``.

Kabaoglu and Sariel 2026 (UAV-SEAD: state estimation anomaly dataset for UAVs). Logs lie in ``ulg_files``, in folders by
date; ``mapping.json`` beside that folder has, by a log's path in it without its ending, classes of anomalies, and for
each the columns in which somebody saw it, with begin and end in microseconds of the log's clock.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from gtmbench.errors import InputError
from gtmbench.files.disk import check_size, is_file
from gtmbench.intake.injections import Injection, injected

_FILE, _LOGS = "mapping.json", "ulg_files"
_LARGEST_BYTES = 200_000_000
_HEALTHY = "Normal"
_LAYERS = 3  # folders between a log and the file, at most


def annotated_failures(path: Path) -> list[Injection]:
    """Return what is said of a log in the mapping.json of its data set; nothing where there is none.

    Anomalies that weren't injected: of what happened by itself, so `kind` is "anomaly", and `sensor` the class in the
    data set's words.

    `path`: of the log. Raises an InputError if the file speaks of this log in another layout.
    """
    folders = path.resolve().parents[: _LAYERS + 1]
    for folder in folders:
        if folder.name == _LOGS and is_file(folder.parent / _FILE):
            key = path.resolve().relative_to(folder).with_suffix("").as_posix()
            return _stated(folder.parent / _FILE, key)
    return []


def _stated(path: Path, key: str) -> list[Injection]:
    check_size(path, "mapping of annotations", _LARGEST_BYTES)
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        of_log = told.get(key, {}).get("annotations", [])
        return list(_of_classes(of_log))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise InputError(
            f"{path}: no annotations can be read of {key}; it should hold "
            '{"LOG": {"annotations": [{"class": ..., "ranges": [[COLUMN, [[BEGIN_US, END_US]]]]}]}}'
        ) from error


def _of_classes(annotated: list[Any]) -> Iterator[Injection]:
    """Yield an injection for every time that a class of anomaly is there, whatever columns show it."""
    for of_class in annotated:
        name = str(of_class["class"])
        if name == _HEALTHY:
            continue
        ranges = [
            (float(begin), float(end), str(column)) for column, pairs in of_class["ranges"] for begin, end in pairs
        ]
        if not all(math.isfinite(begin) and begin <= end for begin, end, _ in ranges):
            raise ValueError("a range that ends before it begins")
        for begin, end, columns in _joined(ranges):
            text = f"{name}, seen in {', '.join(columns)}"
            yield replace(injected(name.lower(), None, "anomaly", (begin / 1e6, end / 1e6), text), channels=())


def _joined(ranges: list[tuple[float, float, str]]) -> Iterator[tuple[float, float, tuple[str, ...]]]:
    """Yield ranges that overlap as one, with the columns of all.

    >>> list(_joined([(5.0, 9.0, "b"), (0.0, 2.0, "a"), (1.0, 3.0, "b"), (2.0, 2.5, "a")]))
    [(0.0, 3.0, ('a', 'b')), (5.0, 9.0, ('b',))]
    """
    spell: tuple[float, float, tuple[str, ...]] | None = None
    for begin, end, column in sorted(ranges):
        if spell is not None and begin <= spell[1]:
            spell = (spell[0], max(spell[1], end), tuple(dict.fromkeys((*spell[2], column))))
            continue
        if spell is not None:
            yield spell
        spell = (begin, end, (column,))
    if spell is not None:
        yield spell
