"""The accelerometers of a log, and its GPS, as the witness between a gyro and its angle.

They need the attitude only where a stretch begins, before most of what a gyro's fault bends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from gtmbench.detectors.crosscheck.relations import ACCEL, GPS
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.method.force_witness import SHORTEST_S, ForceWitness
from gtmbench.method.heading_witness import FieldOpinion
from gtmbench.study.log.field_witnesses import BOUND_S, FORCES
from gtmbench.study.log.other_sensors import kind_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record, Span

_LEAST_DEG_S = 0.7  # a smaller error of a gyro may be warming, or a new calibration


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
