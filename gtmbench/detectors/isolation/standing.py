"""Sensors whose own readings show it, several at once: they repeat the same rows, stand still, or are rounded.

A logger writes old rows, a box's gyros freeze or are read late. No noise does that, in however many sensors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.isolation.case import Case
from gtmbench.faults.kinds.replacing import Jam, Stale
from gtmbench.faults.kinds.shaping import Quantisation
from gtmbench.values.channels import GYROS
from gtmbench.values.record import BoolArray, FloatArray, IntArray, runs

_OFTEN, _OFTENER = 10.0, 4.0  # rows that repeat in several channels at once, beyond so many times as before
_TOGETHER = 0.8  # of the rows that any channel repeats, that all do
_PLAIN = 60.0  # of -2 log likelihood: what plainly stands still
_SEVERAL = 3  # sensors: one alone is judged by what it does
_WHOLE, _EXACT = 1e-3, 1e-6  # of a quantum; of a limit


def standing_still(case: Case) -> list[Judgement]:
    """Return what is said of each of all channels, or of all gyros, where these repeat the same rows; else nothing.

    Noise never repeats in several sensors at once. Counts do where nothing moves, so that other sensors have to.
    """
    channels = [name for name in case.monitor.bank.suspects if name in case.habits]
    gyros = [name for name in channels if name in GYROS]
    since = slice(case.sure, case.judged.stop)
    for group in (channels, gyros):
        others = [name for name in channels if name not in group]
        is_counted = any(case.habits[name].is_counted for name in group)
        if len(group) < len(GYROS) or (is_counted and not (others and all(map(case.moves, others)))):
            continue
        readings = [case.record[name][since] for name in group]
        repeated = repeats(readings)
        before = repeats([case.habits[name].before for name in group])
        if repeated.sum() < _OFTEN + _OFTENER * before.mean() * len(repeated):
            continue
        if all(repeated.sum() >= _TOGETHER * repeats([values]).sum() for values in readings):
            return [_stands(case, name, repeated) for name in group]
    return []


def standing_beside(case: Case, told: Judgement) -> list[Judgement]:
    """Return what is said of sensors that stand still, beside those that are named: their own readings show it.

    Where nobody is named, one that stands still is what has been weighed already; two are two.
    """
    since = slice(case.sure, case.judged.stop)
    found = []
    for name, surprise in case.surprises.items():
        repeated = repeats([case.record[name][since]])
        if name not in told.failed and surprise > _PLAIN and repeated[-int(_OFTEN) :].all():
            found.append(_stands(case, name, repeated))
    return found if told.failed or len(found) > 1 else []


def rounded(case: Case) -> list[Judgement]:
    """Return what is said of each of three sensors or more that are rounded since the onset, as by a logger."""
    since = slice(case.sure, case.judged.stop)
    found = []
    for name, habit in case.habits.items():
        readings = case.record[name][since]
        quantum = None if habit.is_counted else quantum_of(readings)
        if quantum is not None:
            found.append(_judgement(case, name, Quantisation.kind, {"quantum": quantum}))
    return found if len(found) >= _SEVERAL else []


def quantum_of(readings: FloatArray) -> float | None:
    """Return of what coarse readings are whole multiples; None where they aren't, or hardly repeat.

    >>> quantum_of(np.array([0.5, 1.0, 1.0, 1.5, 1.0, 0.5, 0.5, 1.0])), quantum_of(np.arange(8.0) ** 0.5)
    (0.5, None)
    """
    there = readings[np.isfinite(readings)]
    values = np.unique(np.round(there, 9)) if np.any(np.diff(there) == 0.0) else there
    if not 1 < len(values) <= max(len(readings) // 4, 3):
        return None
    quantum = float(np.min(np.diff(values)))
    return quantum if quantum > 0.0 and whole(values, quantum).all() else None


def whole(readings: FloatArray, quantum: float) -> BoolArray:
    """Tell which readings are whole multiples of a quantum."""
    counts = readings / quantum
    return np.asarray(np.abs(counts - np.rint(counts)) <= _WHOLE)


def meeting(sizes: FloatArray, limit: float) -> IntArray:
    """Return where sizes are a limit exactly."""
    return np.flatnonzero(np.abs(sizes - limit) <= _EXACT * limit)


def passing(sizes: FloatArray, limit: float) -> IntArray:
    """Return where sizes are beyond a limit."""
    return np.flatnonzero(sizes > limit * (1.0 + _EXACT))


def _stands(case: Case, channel: str, repeated: BoolArray) -> Judgement:
    """Return that a sensor stands still, or that it is read every so often."""
    starts, ends = runs(repeated)
    longest = float((ends - starts).max())
    if longest > 0.5 * float(repeated.sum()):
        value = float(case.record[channel][case.sure + int(starts[np.argmax(ends - starts)])])
        return _judgement(case, channel, Jam.kind, {"value": value})
    hold_s = case.period_s * len(repeated) / max(float(np.count_nonzero(~repeated)), 1.0)
    return _judgement(case, channel, Stale.kind, {"hold_s": hold_s})


def _judgement(case: Case, channel: str, kind: str, parameters: dict[str, float]) -> Judgement:
    return Judgement(time_s=case.end_s, sensor=channel, candidates=(channel,), kind=kind, parameters=parameters)


def repeats(readings: Sequence[FloatArray]) -> BoolArray:
    """Tell which rows are the same as the one before, in every channel."""
    rows = min(len(values) for values in readings)
    return np.asarray(np.all([np.diff(values[-rows:]) == 0.0 for values in readings], axis=0))
