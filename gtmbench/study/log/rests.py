"""Gyros at rest: on the ground each reads its own bias, whatever an attitude says, and r as well as p and q.

While an aircraft stands (`standing.is_quiet`: as quiet as on the ground, the specific force is 1 g and stays; a GPS
says that it doesn't move), it turns at the Earth's 0.004 deg/s. So what a gyro reads at rest after a flight, less what
it read at rest before, is by how much its bias has changed: 0.02 to 0.25 deg/s in health over six minutes. A lasting
fault shows whole. One that comes and goes may not, nor one of scale: so nobody is cleared.

A gyro may have been calibrated anew where logging paused. Then all three change; where the other two kept a bias that
a calibration had taken away, nobody calibrated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.crosscheck.relations import GPS
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.study.log.field_witnesses import claimed_deg_s, open_gyro
from gtmbench.study.log.other_sensors import kind_of
from gtmbench.study.log.seconds import SECOND_S, of_seconds
from gtmbench.study.log.slow_means import SlowMeans
from gtmbench.study.log.standing import is_quiet, spread_deg
from gtmbench.values.channels import ACCELEROMETERS, GYROS
from gtmbench.values.record import FloatArray, Record, runs

AT_REST = "gyros at rest"  # who says it, and the test of such alarms
_SHORTEST_S, _STAYS_DEG = 4, 2.0  # of a rest without its first and last second; by which the specific force turns
_SCATTER_DEG_S = 0.35  # of a gyro's means over seconds
_MOVES_M_S = 1.5  # by a GPS
_BOUND_DEG_S, _WARMS_S = 0.5, 600.0  # that a bias changes in health; in which warming adds as much
_SURE, _SAME = 2.0, 0.6  # times the bound: a fault by itself; of what the attitude says, at least
_KEPT_DEG_S, _CALIBRATED_DEG_S = 0.25, 0.3  # by which the others changed; of a bias that a calibration takes away


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """A stretch in which an aircraft stands.

    Attributes
    ----------
    segment : int
        Of the log, between gaps.
    start_s, end_s : float
    reads : FloatArray
        What p, q and r read, in deg/s, shape (3,).
    """

    segment: int
    start_s: float
    end_s: float
    reads: FloatArray = field(repr=False)


def rests_of(
    records: Sequence[Record], sensors: Sequence[SensorReadings] = (), until_s: float = np.inf
) -> tuple[Rest, ...]:
    """Return the rests of a log, in time.

    Parameters
    ----------
    records : sequence of Record
        In time, between gaps; those without gyros or accelerometers tell nothing.
    sensors : sequence of SensorReadings
        Whose GPS says whether it moves.
    until_s : float
        When it crashes: what a gyro reads afterwards tells nothing of its flight.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal((600, 6)) * ([0.05] * 3 + [0.002] * 3)
    >>> still = noise + [0.3, -0.1, -0.5, 0.0, 0.0, 1.0]
    >>> still[200:400] += 20.0 * noise[200:400]
    >>> record = Record(still, channels=[*GYROS, *ACCELEROMETERS], sample_period_s=0.05)
    >>> [(each.start_s, each.end_s, each.reads.round(1).tolist()) for each in rests_of([record])]
    [(1.0, 9.0, [0.3, -0.1, -0.5]), (21.0, 29.0, [0.3, -0.1, -0.5])]
    """
    gps = next((each for each in sensors if kind_of(each) == GPS), None)
    return tuple(
        rest
        for number, record in enumerate(records)
        if {*GYROS, *ACCELEROMETERS} <= set(record.channels)
        for rest in _rests(number, record)
        if rest.start_s < until_s and (gps is None or not _moves(gps, rest))
    )


def _rests(number: int, record: Record) -> Iterator[Rest]:
    seconds = of_seconds(record, record.start_s, lambda part: part.matrix((*GYROS, *ACCELEROMETERS)))
    starts, ends = runs(is_quiet(seconds))
    for first, stop in zip((starts + 1).tolist(), (ends - 1).tolist(), strict=True):
        gyros, force = seconds.means[first:stop, :3], seconds.means[first:stop, 3:]
        if (
            stop - first >= _SHORTEST_S
            and spread_deg(force) < _STAYS_DEG
            and (gyros.std(axis=0) < _SCATTER_DEG_S).all()
        ):
            start_s = record.start_s + float(seconds.at[first]) * SECOND_S
            end_s = record.start_s + float(seconds.at[stop - 1] + 1) * SECOND_S
            yield Rest(segment=number, start_s=start_s, end_s=end_s, reads=gyros.mean(axis=0))


def _moves(gps: SensorReadings, rest: Rest) -> bool:
    """Tell whether a GPS says that the aircraft moves; without a reading nothing says so."""
    rows = (gps.time_s >= rest.start_s) & (gps.time_s <= rest.end_s)
    speeds_m_s = np.linalg.norm(gps.values[rows, :2], axis=1)
    return bool(len(speeds_m_s) and np.median(speeds_m_s) > _MOVES_M_S)


@dataclass(frozen=True, kw_only=True, eq=False)
class Changed:
    """By how much a gyro's bias changed from one rest to another.

    Attributes
    ----------
    before, after : Rest
    error_deg_s : float
    bound_deg_s : float
        Which it doesn't exceed in health.
    """

    before: Rest
    after: Rest
    error_deg_s: float
    bound_deg_s: float

    @property
    def text(self) -> str:
        """What they say."""
        return (
            f"{self.error_deg_s:+.2g} deg/s more at {self.after.start_s:.0f} s than at {self.before.start_s:.0f} s, "
            f"while the aircraft stands (a bias changes by up to {self.bound_deg_s:.2g} deg/s)"
        )


def changes_of(rests: Sequence[Rest], gyro: str, since_s: float, after_s: float) -> Iterator[Changed]:
    """Give by how much a gyro's bias changed from the last rest before a time to each that begins after another.

    Nothing where it may have been calibrated anew in between.
    """
    before = [rest for rest in rests if rest.end_s <= since_s]
    axis = GYROS.index(gyro)
    for after in rests if before else ():
        if after.start_s >= after_s and not _may_be_calibrated(before[-1], after, axis):
            apart_s = after.start_s - before[-1].end_s
            yield Changed(
                before=before[-1],
                after=after,
                error_deg_s=float(after.reads[axis] - before[-1].reads[axis]),
                bound_deg_s=_BOUND_DEG_S * (1.0 + apart_s / _WARMS_S),
            )


def _may_be_calibrated(before: Rest, after: Rest, axis: int) -> bool:
    """Tell whether logging paused, and the other gyros don't show that no calibration was done."""
    others = np.delete(before.reads, axis), np.delete(after.reads, axis)
    is_kept = (np.abs(others[1] - others[0]) < _KEPT_DEG_S).all() and np.abs(others[1]).max() > _CALIBRATED_DEG_S
    return before.segment != after.segment and not is_kept


def settled_at_rest(alarm: Alarm, rests: Sequence[Rest], means: SlowMeans, last_s: float) -> Alarm:
    """Return an alarm that leaves a gyro or its angle open with the gyro named, where that reads as wrong at rest.

    Parameters
    ----------
    alarm : Alarm
    rests : sequence of Rest
    means : SlowMeans
        What each gyro reads more than the attitude turns.
    last_s : float
        Until when was learnt: rests before tell what is usual.
    """
    gyro = open_gyro(alarm)
    if gyro is None or alarm.last is None:
        return alarm
    until_s = np.inf if alarm.ended_s is None else alarm.ended_s
    for changed in changes_of(rests, gyro, min(last_s, alarm.onset_s), alarm.onset_s):
        claimed = claimed_deg_s(means, GYROS.index(gyro), (alarm.onset_s, min(until_s, changed.after.end_s)))
        agrees = claimed * changed.error_deg_s > 0.0 and abs(changed.error_deg_s) > _SAME * abs(claimed)
        if agrees and abs(changed.error_deg_s) > changed.bound_deg_s:
            return replace(alarm, judgements=(*alarm.judgements, _named(gyro, changed, alarm.last)))
    return alarm


def found_at_rest(rests: Sequence[Rest], means: SlowMeans, told: Sequence[Alarm], last_s: float) -> tuple[Alarm, ...]:
    """Return an alarm of each gyro that reads more at rest than it did before, where nothing else said so before.

    It is named by twice what a bias changes by in health, where nobody else is accused; less is a doubt.

    Parameters
    ----------
    rests : sequence of Rest
    means : SlowMeans
    told : sequence of Alarm
        All that was said of gyros and angles.
    last_s : float
        Until when was learnt: rests before tell what is usual.
    """
    found: list[Alarm] = []
    for gyro in GYROS:
        changes = changes_of(rests, gyro, last_s, last_s)
        changed = next((each for each in changes if abs(each.error_deg_s) > each.bound_deg_s), None)
        if changed is None:
            continue
        known_s = changed.after.start_s + _SHORTEST_S * SECOND_S
        before = [alarm for alarm in told if not alarm.has_passed and alarm.time_s < known_s]
        is_sure = abs(changed.error_deg_s) > _SURE * changed.bound_deg_s
        if any(alarm.accuses or (alarm.source == gyro and not is_sure) for alarm in before):
            continue
        doubt = f"{gyro} reads {changed.error_deg_s:+.2g} deg/s more at rest than before"
        doubtful = Judgement(time_s=known_s, sensor=None, candidates=(gyro,), doubt=doubt)
        found.append(
            Alarm(
                number=len(means.alarms) + len(found),
                time_s=known_s,
                onset_s=changed.after.start_s,
                source=gyro,
                test=AT_REST,
                judgements=(_named(gyro, changed, doubtful) if is_sure else doubtful,),
            )
        )
    return tuple(found)


def _named(gyro: str, changed: Changed, last: Judgement) -> Judgement:
    return replace(
        last,
        time_s=max(last.time_s, changed.after.start_s + _SHORTEST_S * SECOND_S),
        sensor=gyro,
        candidates=(gyro,),
        doubt="",
        reason="",
        witness=f"{AT_REST}: {gyro} reads {changed.text}",
    )
