"""Gyros whose readings stand still while both others move: a sensor, or its bus, that has frozen.

No model is asked. A gyro's noise changes every reading, or does so often; how long it ever stands still where nothing
is wrong is learnt, for counts are coarse and telemetry repeats. What gyros do together tells of none of them: it is a
logger's pause, an aircraft that stands, or the ground of a simulator. Nor does one that
ever repeats readings, whose noise may stay within a count while the others' steps over one, unless these move by more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.values.channels import GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, Span, runs

FROZEN = "reads one value"  # test of such alarms
_LEAST_S, _OF_USUAL = 3.0, 5.0  # it stands still; times the longest that it does so where identified
_SAME = 1e-6  # of its deviation: interpolation rounds
_LIVE = 0.5  # of the other gyros' steps that aren't zero meanwhile
_MOVES_DEG_S = 0.2  # of the others' deviations: less is noise within counts of an aircraft that stands
_FEW = 3  # values, between which noise within counts steps
_FEWEST_S = 15.0  # of what is healthy


def frozen_gyros(records: Sequence[Record], healthy: Sequence[Span]) -> tuple[Alarm, ...]:
    """Return an alarm of each time that a gyro stands still while both others move.

    Parameters
    ----------
    records : sequence of Record
        In time; those without p, q and r tell nothing.
    healthy : sequence of (start, end)
        Where it is learnt for how long each stands still by itself; with less than 15 s of it nothing is told.

    Examples
    --------
    >>> read = np.random.default_rng(1).standard_normal((1000, 3))
    >>> read[600:800, 1] = 0.5
    >>> record = Record(read, channels=GYROS, sample_period_s=0.1)
    >>> [(alarm.verdict, alarm.onset_s, alarm.time_s) for alarm in frozen_gyros([record], [(0.0, 50.0)])]
    [('q failed', 60.0, 63.0)]
    """
    told = [record for record in records if {*GYROS} <= set(record.channels)]
    if not (told and healthy):
        return ()
    stills = [_still(record) for record in told]
    usual_s, known_s = np.zeros(len(GYROS)), 0.0
    for record, still in zip(told, stills, strict=True):
        for first_s, last_s in healthy:
            within = (record.time_s >= first_s) & (record.time_s <= last_s)
            known_s += np.count_nonzero(within) * record.sample_period_s
            usual_s = np.maximum(usual_s, [_longest(own & within) * record.sample_period_s for own in still.T])
    if known_s < _FEWEST_S:
        return ()
    least_s = np.maximum(_LEAST_S, _OF_USUAL * usual_s)
    found = [
        alarm for record, still in zip(told, stills, strict=True) for alarm in _of(record, still, least_s, usual_s)
    ]
    return tuple(sorted(found, key=lambda alarm: alarm.time_s))


def _still(record: Record) -> BoolArray:
    """Tell which readings are the one before, shape (rows, 3); one that is missing isn't."""
    gyros = record.matrix(GYROS)
    steps = np.full(gyros.shape, np.inf)
    steps[1:] = np.abs(np.diff(gyros, axis=0))
    return np.asarray(np.nan_to_num(steps, nan=np.inf) <= _SAME * _deviations(gyros))


def _deviations(gyros: FloatArray) -> FloatArray:
    """Return the deviation of each gyro, 0 where none of its readings is there."""
    return np.array([float(np.std(own[np.isfinite(own)])) if np.isfinite(own).any() else 0.0 for own in gyros.T])


def _within_counts(others: FloatArray, *, repeats: bool) -> bool:
    """Tell whether the others show no more than noise within counts: few values, or little where a gyro repeats any."""
    is_little = repeats and _deviations(others).min() < _MOVES_DEG_S
    return bool(is_little or min(len(np.unique(own[np.isfinite(own)])) for own in others.T) <= _FEW)


def _longest(still: BoolArray) -> int:
    starts, ends = runs(still)
    return int((ends - starts).max(initial=0))


def _of(record: Record, still: BoolArray, least_s: FloatArray, usual_s: FloatArray) -> Iterator[Alarm]:
    """Give the alarms of a record."""
    gyros = record.matrix(GYROS)
    for axis, gyro in enumerate(GYROS):
        starts, ends = runs(still[:, axis])
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            moves = np.delete(~still[start:end], axis, axis=1).mean(axis=0)
            lasts_s = (end - start) * record.sample_period_s
            if lasts_s < least_s[axis] or moves.min() < _LIVE:
                continue
            if _within_counts(np.delete(gyros[start:end], axis, axis=1), repeats=usual_s[axis] > 0.0):
                continue
            onset_s = float(record.time_s[start - 1])
            known_s = onset_s + float(least_s[axis])
            before = f"for {usual_s[axis]:.2g} s at most" if usual_s[axis] else "at no time"
            reason = (
                f"the reading of {gyro} stands at {record[gyro][start]:.3g} deg/s for {lasts_s:.0f} s while both "
                f"others move; in the part learnt from it stood still {before}"
            )
            lasts = end == len(record)
            judged = Judgement(
                time_s=known_s,
                sensor=gyro,
                candidates=(gyro,),
                kind="stuck" if lasts else None,  # a deadzone reads one value for a while, too
                parameters={"value": float(record[gyro][start]), "onset_s": onset_s},
                reason=reason,
            )
            yield Alarm(
                number=axis,
                time_s=known_s,
                onset_s=onset_s,
                source=gyro,
                test=FROZEN,
                judgements=(judged,),
                ended_s=None if lasts else float(record.time_s[end]),
            )
