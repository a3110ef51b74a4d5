"""The regime: how hard the motion is, held against what a monitor was identified on.

Gyros and attitude both tell how fast the aircraft turns, and how fast that changes; accelerometers tell the specific
force. Motion is beyond what was identified where both gyros and attitude say so, or the accelerometers do: one sensor's
fault can't pass for motion. It is a contact with the ground only where all of them say so, and for a short while. A
monitor's residuals say nothing there, nor while an estimator is reset: a touchdown, a crash and a tumble look like
faults.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gtmbench.detectors.excursion import APART_S, BEYOND, COVERED, MOTION, Excursion
from gtmbench.detectors.isolation.case import ACCELEROMETERS
from gtmbench.intake.events import Event, EventKind
from gtmbench.method.pseudo_inputs import derived
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.clock import even_times_s
from gtmbench.values.pieces import pieces
from gtmbench.values.record import BoolArray, FloatArray, Record, joined, runs

_BEFORE_S, _AFTER_S = 0.3, 1.0  # of such a row, that count with it
_TURNING = (("gyros_deg_s", "attitude_deg_s"), ("gyros_deg_s2", "attitude_deg_s2"))  # of each pair, both must say so
_KEYS = (*_TURNING[0], *_TURNING[1], "force_g")
_MIDDLES = tuple(f"{name}_middle_deg_s" for name in GYROS)  # what gyros read of no motion
_FROM_ATTITUDE = ("p_att", "q_att", "r_att")
_MOTION = (*GYROS, *ATTITUDE, *ACCELEROMETERS)
LATE_S = APART_S + _BEFORE_S  # after a row, until it is known whether it is beyond

IMPACT = "impact or touchdown"
TOUCHDOWN, RESET, FAILURE = "touchdown", "an estimator's reset", "a failure that the autopilot reports"
PUSHED = "acceleration beyond what was learnt"  # accelerometers alone say so: that is no contact with the ground
_TELLING = (FAILURE, TOUCHDOWN, IMPACT, PUSHED, RESET, MOTION)  # the more telling first
_LASTING = (FAILURE, TOUCHDOWN, IMPACT, PUSHED)  # afterwards nothing may be as it was
_BLOW_S = 5.0  # no push of the ground lasts longer: then accelerometers are wrong, or the motion is another
# what is about an event, from so long before to so long after; a touchdown is told when it is sure
_ABOUT = {
    EventKind.RESET: (RESET, 0.5, 2.5),
    EventKind.TOUCHDOWN: (TOUCHDOWN, 3.0, 2.5),
    EventKind.FAILURE: (FAILURE, 2.5, 2.5),
}


@dataclass(frozen=True, kw_only=True)
class Regime:
    """How hard the motion was that a monitor was identified on."""

    # ``gyros_deg_s`` and ``attitude_deg_s``, how fast it turned as either tells, ``gyros_deg_s2`` and
    # ``attitude_deg_s2``, how fast that changed; ``force_g``, the specific force's distance from 1 g; what 99.9 % of
    # the rows don't exceed. Those that the records don't tell aren't there
    limits: Mapping[str, float]
    # what the gyros read in the middle, in deg/s, which isn't counted as motion
    middles: tuple[float, ...] = (0.0, 0.0, 0.0)

    @classmethod
    def from_provenance(cls, provenance: Mapping[str, Any]) -> Regime:
        """Return what a monitor's provenance tells; no limits where it doesn't."""
        told = provenance.get("regime")
        table = told if isinstance(told, Mapping) else {}
        known = {key: float(value) for key, value in table.items() if isinstance(value, (int, float))}
        limits = {key: known[key] for key in _KEYS if key in known}
        return cls(limits=limits, middles=tuple(known.get(key, 0.0) for key in _MIDDLES))

    @classmethod
    def of(cls, records: Iterable[Record]) -> Regime:
        """Return the regime of records with gyros and a whole attitude, accelerometers where there are any."""
        moving = list(records)
        middles = _middles(moving)
        sizes = [_sizes(record, middles) for record in moving]
        limits = {}
        for key in _KEYS:
            values = np.concatenate([size[key] for size in sizes if key in size] or [np.zeros(0)])
            values = values[np.isfinite(values)]
            if len(values):
                limits[key] = float(np.quantile(values, COVERED))
        return cls(limits=limits, middles=middles)

    @property
    def table(self) -> dict[str, float]:
        """As plain values, which `told` reads."""
        return {**self.limits, **dict(zip(_MIDDLES, self.middles, strict=True))} if self.limits else {}

    def excursions(self, record: Record, events: Iterable[Event] = ()) -> tuple[Excursion, ...]:
        """Return the stretches of a record that are beyond it, and those about what the log tells of, in time."""
        told = [excursion for event in events if (excursion := _excursion_of(event, record)) is not None]
        return _joined([*self.stretches(record), *told])

    def stretches(self, record: Record) -> list[Excursion]:
        """Return the stretches of a record that are beyond it, in time."""
        stream = RegimeStream(self, record.sample_period_s)
        for rows in pieces(len(record)):
            stream.take(record.part(range(rows.start, rows.stop)))
        return list(stream.excursions)

    def beyond(self, record: Record) -> tuple[BoolArray, BoolArray]:
        """Return the rows in which it turns harder than that, and those in which the specific force is greater.

        A later row may add to the last `LATE_S`, and takes nothing away.
        """
        never = np.zeros(len(record), dtype=bool)
        if not self.limits:
            return never, never
        sizes = _sizes(record, self.middles)
        beyond = {key: sizes[key] > BEYOND * limit for key, limit in self.limits.items() if key in sizes}
        near = {key: _widened(rows, record.sample_period_s, APART_S, APART_S) for key, rows in beyond.items()}
        turning = np.logical_or.reduce([near.get(gyros, never) & near.get(angles, never) for gyros, angles in _TURNING])
        return turning, beyond.get("force_g", never)


class RegimeStream:
    """A regime held against rows as they come in: after any of them, the stretches are those of the rows so far."""

    def __init__(self, regime: Regime, period_s: float) -> None:
        self._regime, self._period_s = regime, period_s
        self._lead = round(APART_S / period_s) + 2  # rows beside one that it depends on, a slope's slope among it
        self._before, self._after = round(_BEFORE_S / period_s), round(_AFTER_S / period_s)
        self._rows: Record | None = None  # the last ones
        self._flags = np.zeros((0, 2), dtype=bool)  # turning and force, of the rows from `_first` on
        self._first = self._stop = 0
        self._start_s = 0.0
        self._past: list[Excursion] = []

    @property
    def excursions(self) -> tuple[Excursion, ...]:
        """The stretches so far, in time; the last may go on."""
        turning, force = self._flags.T
        return (*self._past, *_stretches(turning, force, self._first, self._start_s, self._period_s))

    def take(self, rows: Record) -> None:
        """Take the next rows, with whatever channels tell of motion."""
        motion = _motion_in(rows)
        if self._rows is None:
            self._start_s = rows.start_s
        known = motion if self._rows is None else joined([self._rows, motion])
        self._stop += len(rows)
        flags = np.column_stack(self._regime.beyond(known))
        begin = self._stop - len(known)  # row of the first of these
        final = max(begin + (self._lead if begin else 0), self._first)
        self._flags = np.concatenate([self._flags[: final - self._first], flags[final - begin :]])
        self._rows = known.part(range(max(len(known) - 2 * self._lead - 1, 0), len(known)))
        self._close()

    def _close(self) -> None:
        """Put the stretches that nothing can be added to behind, with the rows up to them."""
        settled = self._stop - self._lead - self._before - 1  # what is found later begins behind
        beyond = np.flatnonzero(self._flags.any(axis=1)) + self._first
        last = int(beyond[-1]) if len(beyond) else -1
        if last + self._after + 1 < settled:
            self._past = list(self.excursions)
            kept = max(settled, self._first)
            self._flags, self._first = self._flags[kept - self._first :], kept


def _motion_in(rows: Record) -> Record:
    """Return what tells of motion, missing where the rows haven't got it."""
    values = np.full((len(rows), len(_MOTION)), np.nan)
    for place, name in enumerate(_MOTION):
        if name in rows:
            values[:, place] = rows[name]
    return Record(values, channels=_MOTION, sample_period_s=rows.sample_period_s, start_s=rows.start_s)


def _stretches(turning: BoolArray, force: BoolArray, row: int, start_s: float, period_s: float) -> list[Excursion]:
    """Return the stretches about rows that are beyond a regime, the first of them `row` of a record."""
    found = []
    starts, ends = runs(_widened(turning | force, period_s, _BEFORE_S, _AFTER_S))
    for first, stop in zip(starts.tolist(), ends.tolist(), strict=True):
        since_s, until_s = (
            float(even_times_s(start_s, period_s, range(row + k, row + k + 1))[0]) for k in (first, stop - 1)
        )
        is_hard = bool(turning[first:stop].any())
        is_long = until_s - since_s > _BLOW_S
        pushed = MOTION if is_long else IMPACT if is_hard else PUSHED
        reason = pushed if force[first:stop].any() else MOTION
        found.append(replace(_excursion(since_s, until_s, reason), is_hard=is_hard))
    return found


def _excursion_of(event: Event, record: Record) -> Excursion | None:
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
        widened = replace(
            _excursion(last.start_s, end_s, reason), is_judged=last.is_judged, is_hard=last.is_hard or each.is_hard
        )
        joined[joined.index(last)] = widened
        if each.is_judged > last.is_judged:
            joined.append(each)
    return tuple(sorted(joined, key=lambda each: each.start_s))


def _widened(beyond: BoolArray, period_s: float, before_s: float, after_s: float) -> BoolArray:
    before, after = (round(span_s / period_s) for span_s in (before_s, after_s))
    reach = np.convolve(beyond, np.ones(before + after + 1))[before : before + len(beyond)]
    return np.asarray(reach > 0.5)


def _sizes(record: Record, middles: Sequence[float]) -> dict[str, FloatArray]:
    """Return how hard the motion is, row by row."""
    sizes = {}
    if {*GYROS, *ATTITUDE} <= set(record.channels):
        told = np.column_stack(derived(record, _FROM_ATTITUDE))
        for i, rates in enumerate((record.matrix(GYROS) - np.array(middles), told)):
            sizes[_TURNING[0][i]], sizes[_TURNING[1][i]] = _turning(rates, record.sample_period_s)
    if set(ACCELEROMETERS) <= set(record.channels):
        force = np.linalg.norm(record.matrix(ACCELEROMETERS), axis=1)
        sizes["force_g"] = np.abs(force - 1.0)
    return sizes


def _middles(records: Sequence[Record]) -> tuple[float, ...]:
    """Return the medians of what gyros read."""
    gyros = [record.matrix(GYROS) for record in records if {*GYROS} <= set(record.channels)]
    there = np.concatenate([each[np.isfinite(each).all(axis=1)] for each in gyros] or [np.zeros((0, 3))])
    return tuple(np.median(there, axis=0).tolist()) if len(there) else (0.0, 0.0, 0.0)


def _turning(rates: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the size of the rates and of their slope."""
    slopes = np.full(rates.shape, np.nan)
    slopes[1:-1] = (rates[2:] - rates[:-2]) / (2.0 * period_s)
    return np.linalg.norm(rates, axis=1), np.linalg.norm(slopes, axis=1)
