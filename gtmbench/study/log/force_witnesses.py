"""The accelerometers of a log, and its GPS, as the witness between a gyro and its angle.

They need the attitude only where a stretch begins. They are asked where something else left a gyro or its angle open;
and where nothing rose, over half a minute and a minute, for they may know a gyro better than a restless attitude does.
There, too, p or q is named only where the attitude differs from it the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.crosscheck.relations import ACCEL, GPS
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.method.force_witness import SHORTEST_S, ForceWitness
from gtmbench.method.heading_witness import FieldOpinion
from gtmbench.study.log.field_witnesses import BOUND_S, FORCES, claimed_deg_s, open_gyro
from gtmbench.study.log.other_sensors import kind_of
from gtmbench.study.log.slow_means import SLOW, SlowMeans
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record, Span

_LEAST_DEG_S = 0.7  # a smaller error of a gyro may be warming, or a new calibration
_WINDOWS_S, _EVERY_S = (30.0, 60.0), 15.0  # that are asked about where nothing rose
_TIMES = 2  # windows of a length in a row that have to accuse a gyro


@dataclass(frozen=True, kw_only=True, eq=False)
class LoggedForces:
    """The accelerometers of a log, and its GPS where it has one, which know what is usual.

    Attributes
    ----------
    name : str
    columns : tuple of str
    records : tuple of Record
        The log's segments with their channels.
    learnt : ForceWitness
    """

    name: str
    columns: tuple[str, ...]
    records: tuple[Record, ...] = field(repr=False)
    learnt: ForceWitness = field(repr=False)

    @cached_property
    def bounds_deg_s(self) -> Mapping[str, float]:
        """How well they know each gyro over `BOUND_S`, in deg/s; NaN where too little is healthy."""
        return self.learnt.bounds_deg_s(BOUND_S)

    @property
    def least_deg_s(self) -> float:
        """The smallest error for which they name a gyro, in deg/s."""
        return _LEAST_DEG_S

    def knows(self, gyro: str) -> bool:
        """Tell whether they can be asked about a gyro; of r nothing shows without a GPS."""
        return gyro != GYROS[2] or self.learnt.has_gps

    def judge(self, record: Record, gyro: str, span: Span, error_deg_s: float) -> FieldOpinion:
        """Say whether a gyro is wrong."""
        return self.learnt.judge(record, *span, gyro=gyro, error_deg_s=error_deg_s)


def force_witnesses(
    sensors: Sequence[SensorReadings], segments: Sequence[Record], healthy: Sequence[Record]
) -> tuple[LoggedForces, ...]:
    """Return the accelerometers of a log, with its GPS, as one witness; none where nothing teaches them.

    Parameters
    ----------
    sensors : sequence of SensorReadings
    segments, healthy : sequence of Record
        With p, q, r, phi, theta and psi: the log, and what of it is healthy.
    """
    first = {kind: each for each in reversed(sensors) if (kind := kind_of(each)) in (ACCEL, GPS)}
    taught = [record for record in healthy if record.end_s - record.start_s > SHORTEST_S]
    if ACCEL not in first or not taught:
        return ()

    def beside(record: Record) -> Record:
        laid = record.select((*GYROS, *ATTITUDE))
        for kind in (ACCEL, GPS):
            laid = first[kind].beside(laid) if kind in first else laid
        return laid

    return (
        LoggedForces(
            name=FORCES,
            columns=tuple(column for kind in (ACCEL, GPS) if kind in first for column in first[kind].columns),
            records=tuple(map(beside, segments)),
            learnt=ForceWitness(healthy=tuple(map(beside, taught))),
        ),
    )


def found_by_forces(
    witnesses: Sequence[LoggedForces], means: SlowMeans, told: Sequence[Alarm], last_s: float
) -> tuple[Alarm, ...]:
    """Return an alarm of the first gyro that accelerometers accuse where nothing else rose before.

    No second sensor is named by an attitude that the first one bent; and none of r, which only a GPS's turns show. What
    left this gyro or its angle open doesn't stand in the way.

    Parameters
    ----------
    witnesses : sequence of LoggedForces
    means : SlowMeans
        What each gyro reads more than the attitude turns.
    told : sequence of Alarm
        All that was said of gyros and angles.
    last_s : float
        Until when was learnt.
    """
    found = [
        alarm
        for witness in witnesses
        for gyro in GYROS[:2]
        if (alarm := _first_accusation(witness, gyro, means, last_s)) is not None
        and alarm.time_s < min((each.onset_s for each in told if _is_of_another(each, gyro)), default=np.inf)
    ]
    return (min(found, key=lambda alarm: alarm.time_s),) if found else ()


def _is_of_another(alarm: Alarm, gyro: str) -> bool:
    """Tell whether an alarm that lasts is of more than a gyro and its angle, of which it can't tell the one."""
    return not alarm.has_passed and open_gyro(alarm) != gyro


def _first_accusation(witness: LoggedForces, gyro: str, means: SlowMeans, last_s: float) -> Alarm | None:
    """Return an alarm of the first windows in a row that accuse a gyro; None where none do."""
    each = (next(_accusations(witness, gyro, means, last_s, window_s), None) for window_s in _WINDOWS_S)
    told = [first for first in each if first is not None]
    if not told:
        return None
    span, opinion = min(told, key=lambda first: first[0][1])
    judged = Judgement(
        time_s=span[1],
        sensor=gyro,
        candidates=(gyro,),
        kind="bias",
        parameters={"size": opinion.error_deg_s, "onset_s": span[0]},
        witness=f"{witness.name}: {opinion.reason}",
    )
    return Alarm(
        number=len(means.alarms), time_s=span[1], onset_s=span[0], source=gyro, test=SLOW, judgements=(judged,)
    )


def _accusations(
    witness: LoggedForces, gyro: str, means: SlowMeans, last_s: float, window_s: float
) -> Iterator[tuple[Span, FieldOpinion]]:
    """Give the windows of a length that accuse a gyro together with those before them."""
    in_a_row = 0
    for record in witness.records:
        for start_s in np.arange(max(record.start_s, last_s), record.end_s - window_s, _EVERY_S).tolist():
            span = (start_s, start_s + window_s)
            claimed = claimed_deg_s(means, GYROS.index(gyro), span)
            opinion = witness.judge(record, gyro, span, claimed) if np.isfinite(claimed) else None
            is_accused = opinion is not None and opinion.sensor == gyro and abs(opinion.error_deg_s) >= _LEAST_DEG_S
            in_a_row = in_a_row + 1 if is_accused else 0
            if opinion is not None and in_a_row >= _TIMES:
                yield span, opinion
