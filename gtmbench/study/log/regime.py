"""The regime: how hard a log's motion is, held against what a monitor was identified on.

Gyros and attitude both tell how fast the aircraft turns, and how fast that changes; accelerometers tell the specific
force. Motion is beyond what was identified where both gyros and attitude say so, or the accelerometers do: one sensor's
fault can't pass for motion. A monitor's residuals say nothing there, nor while an estimator is reset: a touchdown, a
crash and a tumble look like faults.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtmbench.detectors.isolation.case import ACCELEROMETERS
from gtmbench.detectors.monitor.excursions import Excursion
from gtmbench.intake.events import Event, EventKind
from gtmbench.record import BoolArray, FloatArray, Record, runs
from gtmbench.study.log.self_check.motion import ANGLES, GYROS, rates_from, terms_of

_COVERED = 0.999  # of the identified rows
_BEYOND = 1.5  # times what these reach: less costs names, more misses touchdowns
_BEFORE_S, _AFTER_S = 0.3, 1.0  # of such a row, that count with it
_TURNING = (("gyros_deg_s", "attitude_deg_s"), ("gyros_deg_s2", "attitude_deg_s2"))  # of each pair, both must say so
_KEYS = (*_TURNING[0], *_TURNING[1], "force_g")
_APART_S = 0.15  # an attitude may be late

MOTION, IMPACT = "motion beyond what was identified", "impact or touchdown"
TOUCHDOWN, RESET, FAILURE = "touchdown", "an estimator's reset", "a failure that the autopilot tells of"
_TELLING = (FAILURE, TOUCHDOWN, IMPACT, RESET, MOTION)  # the more telling first
_LASTING = (FAILURE, TOUCHDOWN, IMPACT)  # afterwards nothing may be as it was
# what is about an event, from so long before to so long after; a touchdown is told when it is sure
_ABOUT = {
    EventKind.RESET: (RESET, 0.5, 2.5),
    EventKind.TOUCHDOWN: (TOUCHDOWN, 3.0, 2.5),
    EventKind.FAILURE: (FAILURE, 2.5, 2.5),
}


@dataclass(frozen=True, kw_only=True)
class Regime:
    """How hard the motion was that a monitor was identified on.

    Attributes
    ----------
    limits : mapping of str to float
        ``gyros_deg_s`` and ``attitude_deg_s``, how fast it turned as either tells, ``gyros_deg_s2`` and
        ``attitude_deg_s2``, how fast that changed; ``force_g``, the specific force's distance from 1 g; what 99.9 % of
        the rows don't exceed. Those that the records don't tell aren't there.
    """

    limits: Mapping[str, float]

    @classmethod
    def told(cls, provenance: Mapping[str, Any]) -> Regime:
        """Return what a monitor's provenance tells; no limits where it doesn't."""
        told = provenance.get("regime")
        limits = told if isinstance(told, Mapping) else {}
        return cls(limits={key: float(limits[key]) for key in _KEYS if isinstance(limits.get(key), (int, float))})

    @classmethod
    def of(cls, records: Iterable[Record]) -> Regime:
        """Return the regime of records with gyros and a whole attitude, accelerometers where there are any."""
        sizes = [_sizes(record) for record in records]
        limits = {}
        for key in _KEYS:
            values = np.concatenate([size[key] for size in sizes if key in size] or [np.zeros(0)])
            values = values[np.isfinite(values)]
            if len(values):
                limits[key] = float(np.quantile(values, _COVERED))
        return cls(limits=limits)

    def excursions(self, record: Record, events: Iterable[Event] = ()) -> tuple[Excursion, ...]:
        """Return the stretches of a record that are beyond it, and those about what the log tells of, in time."""
        told = [excursion for event in events if (excursion := _told(event, record)) is not None]
        if not self.limits:
            return _joined(told)
        sizes = _sizes(record)
        never = np.zeros(len(record), dtype=bool)
        beyond = {key: sizes[key] > _BEYOND * limit for key, limit in self.limits.items() if key in sizes}
        near = {key: _widened(rows, record.sample_period_s, _APART_S, _APART_S) for key, rows in beyond.items()}
        turning = np.logical_or.reduce([near.get(gyros, never) & near.get(angles, never) for gyros, angles in _TURNING])
        force = beyond.get("force_g", never)
        return _joined([*_stretches(record, turning, force), *told])


def _stretches(record: Record, turning: BoolArray, force: BoolArray) -> list[Excursion]:
    found = []
    starts, ends = runs(_widened(turning | force, record.sample_period_s, _BEFORE_S, _AFTER_S))
    for first, stop in zip(starts.tolist(), ends.tolist(), strict=True):
        start_s, end_s = record.time_s[[first, stop - 1]].tolist()
        found.append(_excursion(start_s, end_s, IMPACT if force[first:stop].any() else MOTION))
    return found


def _told(event: Event, record: Record) -> Excursion | None:
    """Return the stretch about an event; None where it lies beside the record, or changes nothing."""
    if event.kind not in _ABOUT:
        return None
    reason, before_s, after_s = _ABOUT[event.kind]
    start_s, end_s = max(event.time_s - before_s, record.start_s), min(event.time_s + after_s, record.end_s)
    if start_s >= end_s:
        return None
    return replace(_excursion(start_s, end_s, reason), is_judged=event.kind is not EventKind.RESET)


def _excursion(start_s: float, end_s: float, reason: str) -> Excursion:
    settles_s = np.inf if reason in _LASTING else Excursion.settles_s
    return Excursion(start_s=start_s, end_s=end_s, reason=reason, settles_s=settles_s)


def _joined(excursions: Iterable[Excursion]) -> tuple[Excursion, ...]:
    """Return excursions in time; of those that meet one takes the reason of the more telling, those alike are one."""
    joined: list[Excursion] = []
    for each in sorted(excursions, key=lambda each: (each.is_judged, each.start_s)):
        last = next((other for other in joined if each.start_s <= other.end_s and other.start_s <= each.end_s), None)
        if last is None:
            joined.append(each)
            continue
        reason = min((last.reason, each.reason), key=_TELLING.index)
        end_s = last.end_s if each.is_judged > last.is_judged else max(last.end_s, each.end_s)
        widened = replace(_excursion(last.start_s, end_s, reason), is_judged=last.is_judged)
        joined[joined.index(last)] = widened
        if each.is_judged > last.is_judged:
            joined.append(each)
    return tuple(sorted(joined, key=lambda each: each.start_s))


def _widened(beyond: BoolArray, period_s: float, before_s: float, after_s: float) -> BoolArray:
    before, after = (round(span_s / period_s) for span_s in (before_s, after_s))
    reach = np.convolve(beyond, np.ones(before + after + 1))[before : before + len(beyond)]
    return np.asarray(reach > 0.5)


def _sizes(record: Record) -> dict[str, FloatArray]:
    """Return how hard the motion is, row by row."""
    sizes = {}
    if {*GYROS, *ANGLES} <= set(record.channels):
        gyros = record.matrix(GYROS)
        told = terms_of(record.matrix(ANGLES), record.sample_period_s) @ rates_from((1.0, 1.0, 1.0))
        for i, rates in enumerate((gyros - _middle(gyros), told)):
            sizes[_TURNING[0][i]], sizes[_TURNING[1][i]] = _turning(rates, record.sample_period_s)
    if set(ACCELEROMETERS) <= set(record.channels):
        force = np.linalg.norm(record.matrix(ACCELEROMETERS), axis=1)
        sizes["force_g"] = np.abs(force - 1.0)
    return sizes


def _middle(gyros: FloatArray) -> FloatArray:
    there = np.isfinite(gyros).all(axis=1)
    return np.median(gyros[there], axis=0) if there.any() else np.zeros(3)


def _turning(rates: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the size of the rates and of their slope."""
    slopes = np.full(rates.shape, np.nan)
    slopes[1:-1] = (rates[2:] - rates[:-2]) / (2.0 * period_s)
    return np.linalg.norm(rates, axis=1), np.linalg.norm(slopes, axis=1)
