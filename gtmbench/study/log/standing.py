"""Gyros that read a turn while the aircraft stands: accelerometers hold one direction, and the attitude tumbles.

A body that turns at omega sees the specific force f turn by f' = -omega x f. Where f stays, the part of omega across it
is zero, up to an acceleration that turns just along with the aircraft. Such a turn isn't flown without noise: so an
aircraft stands where accelerometers and gyros are as quiet as on the ground, and f is 1 g and stays. If gyros read a
turn across f there, and the attitude that they drive turns along, it is the gyros that are wrong: mostly an offset that
nobody calibrated. A raw gyro's offset that its estimator corrects isn't told, for its attitude stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm, Judgement
from gtmbench.detectors.protocol import Watch
from gtmbench.study.log.imu_comparison import with_doubt
from gtmbench.study.log.seconds import SECOND_S, Seconds, of_seconds
from gtmbench.study.log.self_check.motion import attitude_rates
from gtmbench.study.log.vertical import up_of
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, runs

STANDING = "while it stands"  # test of such alarms
_QUIET_G, _QUIET_DEG_S = 0.02, 0.6  # the largest deviations of a second, of the specific force and of a gyro
_DEAD_G = 1e-5  # of a second's deviation: it reads one value
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


def but_of_others(watch: Watch, standing: Sequence[Alarm]) -> Watch:
    """Return a watch that accuses nobody but gyros that are known to be wrong: these have bent the attitude.

    Parameters
    ----------
    watch : Watch
    standing : sequence of Alarm
        As `standing_gyros` returns them.
    """
    wrong = {alarm.source for alarm in standing}

    def doubtful(alarm: Alarm) -> Alarm:
        is_other = bool(wrong) and alarm.accuses and alarm.test != MISSING and not {*alarm.candidates} <= wrong
        return with_doubt(alarm, f"{' and '.join(sorted(wrong))} bent the attitude") if is_other else alarm

    return replace(watch, alarms=tuple(map(doubtful, watch.alarms)))


def _of_record(record: Record, number: int) -> Iterator[Alarm]:
    """Give the alarms of a record, of every stretch in which it stands."""
    seconds = of_seconds(record, record.start_s, lambda part: part.matrix((*GYROS, *ACCELEROMETERS)))
    for first, stop in _stretches(is_quiet(seconds)):
        part = record.part(range(int(seconds.first_row[first]), int(seconds.stop_row[stop - 1])))
        reads, means = seconds.means[first:stop, :3].mean(axis=0), seconds.means[first:stop, 3:]
        tumbled_deg = spread_deg(up_of(part))
        if spread_deg(means) > _STAYS_DEG or tumbled_deg < _TUMBLES_DEG:
            continue
        along = np.abs(means.mean(axis=0)) / np.linalg.norm(means.mean(axis=0))
        turns = np.nanmean(attitude_rates(part), axis=0)
        wrong = (np.abs(reads) > _LEAST_DEG_S) & (reads * turns > 0.0) & (along < _ACROSS)
        for axis in np.flatnonzero(wrong).tolist():
            reason = (
                f"the aircraft stands for {stop - first} s by its accelerometers, while {GYROS[axis]} reads "
                f"{reads[axis]:.2g} deg/s and the attitude tilts by {tumbled_deg:.0f} deg"
            )
            start_s = part.start_s
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


def is_quiet(seconds: Seconds) -> BoolArray:
    """Tell which seconds are as quiet as on the ground; sensors without any noise are dead, and tell nothing."""
    gyros, force = seconds.deviations[:, :3], seconds.deviations[:, 3:]
    is_1_g = np.abs(np.linalg.norm(seconds.means[:, 3:], axis=1) - 1.0) < _FROM_1_G
    is_live = (force > _DEAD_G).any(axis=1)
    return np.asarray(is_live & is_1_g & (force < _QUIET_G).all(axis=1) & (gyros < _QUIET_DEG_S).all(axis=1))


def spread_deg(directions: FloatArray) -> float:
    """Return how far directions turn from the first of them at most."""
    known = directions[np.isfinite(directions).all(axis=1)]
    units = known / np.linalg.norm(known, axis=1)[:, np.newaxis]
    return float(np.degrees(np.arccos(np.clip(units @ units[0], -1.0, 1.0))).max()) if len(units) else 0.0
