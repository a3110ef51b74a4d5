"""Gyros that read a turn while the aircraft stands: accelerometers hold one direction, and the attitude tumbles.

A body that turns at omega sees the specific force f turn by f' = -omega x f. Where f stays, the part of omega across it
is zero, up to an acceleration that turns just along with the aircraft. Such a turn isn't flown without noise: so an
aircraft stands where accelerometers and gyros are as quiet as on the ground, and f is 1 g and stays. If gyros read a
turn across f there, and the attitude that they drive turns along, it is the gyros that are wrong: mostly an offset that
nobody calibrated. A raw gyro's offset that its estimator corrects isn't told, for its attitude stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.study.log.seconds import SECOND_S, rows_by_second
from gtmbench.study.log.self_check.motion import attitude_rates
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, runs

STANDING = "while it stands"  # test of such alarms
_QUIET_G, _QUIET_DEG_S = 0.02, 0.6  # the largest deviations of a second, of the specific force and of a gyro
_FROM_1_G = 0.1  # accelerometers' scale and offset
_STAYS_DEG, _TUMBLES_DEG = 2.0, 30.0  # by which the vertical turns, as accelerometers and as the attitude tell
_FEWEST_S, _LONGEST_S = 6, 20
_LEAST_DEG_S = 3.0  # of a gyro that is wrong
_ACROSS = 0.7  # of the specific force along a gyro's axis, beyond which nothing is told of it


def standing_gyros(records: Sequence[Record]) -> tuple[Alarm, ...]:
    """Return an alarm of each gyro that reads a turn while the aircraft stands and its attitude tumbles.

    Parameters
    ----------
    records : sequence of Record
        In time; those without gyros, attitude or accelerometers tell nothing.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal((400, 9)) * ([0.05] * 3 + [0.02] * 3 + [0.002] * 3)
    >>> turning = np.zeros((400, 9))
    >>> turning[:, 1], turning[:, 4], turning[:, 8] = 8.0, np.linspace(0.0, 80.0, 400), 1.0  # q, theta, nz
    >>> record = Record(turning + noise, channels=[*GYROS, *ATTITUDE, *ACCELEROMETERS], sample_period_s=0.025)
    >>> [(alarm.verdict, round(alarm.last.parameters["size"], 1)) for alarm in standing_gyros([record])]
    [('q failed', 8.0)]
    """
    found: dict[str, Alarm] = {}
    for record in records:
        if {*GYROS, *ATTITUDE, *ACCELEROMETERS} <= set(record.channels):
            for alarm in _of_record(record, len(found)):
                found.setdefault(alarm.source, alarm)
    return tuple(found.values())


def _of_record(record: Record, number: int) -> Iterator[Alarm]:
    """Give the alarms of a record, of every stretch in which it stands."""
    seconds = [rows for _, rows in rows_by_second(record, record.start_s)]
    gyros, force = record.matrix(GYROS), record.matrix(ACCELEROMETERS)
    rates, vertical = attitude_rates(record), _vertical(record)
    stands = np.array([_is_quiet(gyros[rows], force[rows]) for rows in seconds], dtype=np.bool_)
    for first, stop in _stretches(stands):
        rows = slice(seconds[first].start, seconds[stop - 1].stop)
        means = np.array([force[each].mean(axis=0) for each in seconds[first:stop]])
        tumbled_deg = _spread_deg(vertical[rows])
        if _spread_deg(means) > _STAYS_DEG or tumbled_deg < _TUMBLES_DEG:
            continue
        along = np.abs(means.mean(axis=0)) / np.linalg.norm(means.mean(axis=0))
        reads, turns = gyros[rows].mean(axis=0), np.nanmean(rates[rows], axis=0)
        wrong = (np.abs(reads) > _LEAST_DEG_S) & (reads * turns > 0.0) & (along < _ACROSS)
        for axis in np.flatnonzero(wrong).tolist():
            reason = (
                f"the aircraft stands for {stop - first} s by its accelerometers, while {GYROS[axis]} reads "
                f"{reads[axis]:.2g} deg/s and the attitude tilts by {tumbled_deg:.0f} deg"
            )
            start_s = float(record.time_s[rows.start])
            known_s = start_s + _FEWEST_S * SECOND_S
            judged = Judgement(
                time_s=known_s,
                sensor=GYROS[axis],
                candidates=(GYROS[axis],),
                kind="bias",
                parameters={"size": float(reads[axis]), "onset_s": start_s},
                reason=reason,
            )
            yield Alarm(
                number=number + axis,
                time_s=known_s,
                onset_s=start_s,
                source=GYROS[axis],
                test=STANDING,
                judgements=(judged,),
            )


def _stretches(stands: BoolArray) -> Iterator[tuple[int, int]]:
    """Give stretches in which it stands, first second and stop; long ones in parts, for sensors drift as they warm."""
    starts, ends = runs(stands)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        for first in range(start, end, _LONGEST_S):
            stop = min(first + _LONGEST_S, end)
            if stop - first >= _FEWEST_S:
                yield first, stop


def _is_quiet(gyros: FloatArray, force: FloatArray) -> bool:
    """Tell whether a second is as quiet as on the ground; sensors without any noise are dead, and tell nothing."""
    if not (np.isfinite(gyros).all() and np.isfinite(force).all()):
        return False
    shaking = force.std(axis=0)
    is_live = bool((shaking > 0.0).any())
    is_1_g = abs(float(np.linalg.norm(force.mean(axis=0))) - 1.0) < _FROM_1_G
    return bool(is_live and is_1_g and shaking.max() < _QUIET_G and gyros.std(axis=0).max() < _QUIET_DEG_S)


def _vertical(record: Record) -> FloatArray:
    """Return where up is, along forward, right and up of the aircraft, as its attitude tells."""
    phi, theta = np.deg2rad(record["phi"]), np.deg2rad(record["theta"])
    return np.column_stack([np.sin(theta), -np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])


def _spread_deg(directions: FloatArray) -> float:
    """Return how far directions turn from the first of them at most."""
    known = directions[np.isfinite(directions).all(axis=1)]
    units = known / np.linalg.norm(known, axis=1)[:, np.newaxis]
    return float(np.degrees(np.arccos(np.clip(units @ units[0], -1.0, 1.0))).max()) if len(units) else 0.0
