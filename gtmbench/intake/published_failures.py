"""Failures that somebody put into a flight or saw in it, as is said: what a monitor of that log can be scored on.

Some are stated beside the logs: UAV-SEAD (Kabaoglu and Sariel 2026, state estimation anomaly dataset for UAVs) has its
logs in ``ulg_files``, in folders by date; ``mapping.json`` beside that folder has, by a log's path in it without its
ending, classes of anomalies, and for each the columns in which somebody saw it, with begin and end in microseconds.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.writing import check_size, is_file
from gtmbench.values.channels import GYROS

GYRO = "gyro"  # a sensor of three axes


@dataclass(frozen=True, kw_only=True)
class Injection:
    """A failure that a simulator or an autopilot was commanded to make, or that a published data set states.

    Attributes
    ----------
    sensor : str
        ``gyro``, ``accelerometer``, ``magnetometer``, ...; what isn't a sensor in the log's words (``motor``).
    number : int or None
        The number of that sensor, from 1; None for all.
    channels : tuple of str
        The channels among p, q, r that it affects; empty for another sensor.
    kind : str
        The kind of fault if there is a matching one, otherwise the log's word.
    size : float or None
        In `unit`: a bias's value, a scale factor's deviation from 1, or the spread of noise.
    unit : str
    onset_s, end_s : float
        On the log's clock; the end is None where it lasts.
    text : str
        In the log's words.

    Examples
    --------
    >>> import gtmbench as gb
    >>> failure = gb.Injection(
    ...     sensor="gyro", number=1, channels=("p", "q", "r"), kind="bias", size=0.1, unit="rad/s", onset_s=40.0,
    ...     end_s=None, text="SIM_GYR1_BIAS_X 0.1",
    ... )
    >>> failure.channels, failure.end_s is None
    (('p', 'q', 'r'), True)
    """

    sensor: str
    number: int | None
    channels: tuple[str, ...]
    kind: str
    size: float | None = None
    unit: str = ""
    onset_s: float
    end_s: float | None
    text: str


def injected(sensor: str, number: int | None, kind: str, span: tuple[float, float | None], text: str) -> Injection:
    """Return the failure of a sensor in all of its axes, or of what is no sensor."""
    (onset_s, end_s), axes = span, GYROS if sensor == GYRO else ()
    return Injection(sensor=sensor, number=number, channels=axes, kind=kind, onset_s=onset_s, end_s=end_s, text=text)


def spells(changes: Sequence[tuple[float, float]], usual: float) -> Iterator[tuple[float, float | None, float]]:
    """Give (onset, end, value furthest from the usual one) wherever a setting was another than usual.

    >>> list(spells([(1.0, 0.0), (2.0, 0.1), (3.0, 0.4), (5.0, 0.0), (7.0, 1.0)], usual=0.0))
    [(2.0, 5.0, 0.4), (7.0, None, 1.0)]
    """
    onset_s, furthest = None, usual
    for time_s, value in changes:
        if value != usual:
            onset_s = time_s if onset_s is None else onset_s
            furthest = max(furthest, value, key=lambda each: abs(each - usual))
        elif onset_s is not None:
            yield onset_s, time_s, furthest
            onset_s, furthest = None, usual
    if onset_s is not None:
        yield onset_s, None, furthest


def in_time(injections: Iterable[Injection]) -> tuple[Injection, ...]:
    """Return injections by onset; those of one gyro that differ in their axes alone, and come at once, are one."""
    alike: dict[object, Injection] = {}
    for each in sorted(injections, key=lambda each: (each.onset_s, each.number or 0, each.channels)):
        key = (each.sensor, each.number, each.kind, each.size, each.onset_s, each.end_s)
        before = alike.get(key)
        if before is not None:
            channels = tuple(name for name in GYROS if name in (*before.channels, *each.channels))
            each = replace(before, channels=channels, text=f"{before.text}, {each.text}")
        alike[key] = each
    return tuple(replace(each, text=one_line(each.text)) for each in alike.values())


_FILE, _LOGS = "mapping.json", "ulg_files"
_LARGEST_BYTES = 200_000_000  # more is no table that somebody published
_HEALTHY = "Normal"
_LAYERS = 3  # folders between a log and the file, at most


def annotated_failures(path: Path) -> list[Injection]:
    """Return what is said of a log in the mapping.json of its data set; nothing where there is none."""
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


def _joined(ranges: list[tuple[float, float, str]]) -> list[tuple[float, float, tuple[str, ...]]]:
    """Return ranges that overlap as one, with the columns of all.

    >>> _joined([(5.0, 9.0, "b"), (0.0, 2.0, "a"), (1.0, 3.0, "b"), (2.0, 2.5, "a")])
    [(0.0, 3.0, ('a', 'b')), (5.0, 9.0, ('b',))]
    """
    joined: list[tuple[float, float, tuple[str, ...]]] = []
    for begin, end, column in sorted(ranges):
        if joined and begin <= joined[-1][1]:
            first, last, columns = joined[-1]
            joined[-1] = (first, max(last, end), tuple(dict.fromkeys((*columns, column))))
        else:
            joined.append((begin, end, (column,)))
    return joined
