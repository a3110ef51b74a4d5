"""Sensors that stand still together: a logger that writes old rows, or a box whose gyros freeze or are read late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.isolation.case import Case
from gtmbench.faults.replacing import Jam, Stale
from gtmbench.values.channels import GYROS
from gtmbench.values.record import BoolArray, FloatArray, runs

_OFTEN, _OFTENER = 10.0, 4.0  # rows that repeat in several channels at once, beyond so many times as before
_TOGETHER = 0.8  # of the rows that any channel repeats, that all do


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
        repeated = _repeats(readings)
        before = _repeats([case.habits[name].before for name in group])
        if repeated.sum() < _OFTEN + _OFTENER * before.mean() * len(repeated):
            continue
        if all(repeated.sum() >= _TOGETHER * _repeats([values]).sum() for values in readings):
            return [_stands(case, name, repeated) for name in group]
    return []


def _stands(case: Case, channel: str, repeated: BoolArray) -> Judgement:
    """Return that a sensor stands still, or that it is read every so often."""
    starts, ends = runs(repeated)
    longest = float((ends - starts).max())
    if longest > 0.5 * float(repeated.sum()):
        value = float(case.record[channel][case.sure + int(starts[np.argmax(ends - starts)])])
        return Judgement(
            time_s=case.end_s, sensor=channel, candidates=(channel,), kind=Jam.kind, parameters={"value": value}
        )
    hold_s = case.period_s * len(repeated) / max(float(np.count_nonzero(~repeated)), 1.0)
    return Judgement(
        time_s=case.end_s, sensor=channel, candidates=(channel,), kind=Stale.kind, parameters={"hold_s": hold_s}
    )


def _repeats(readings: Sequence[FloatArray]) -> BoolArray:
    """Tell which rows are the same as the one before, in every channel."""
    rows = min(len(values) for values in readings)
    return np.asarray(np.all([np.diff(values[-rows:]) == 0.0 for values in readings], axis=0))
