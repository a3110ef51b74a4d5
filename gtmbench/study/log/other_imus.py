"""The other IMUs of a log, each judged over all of it, as the one that is watched is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gtmbench.engine.hindsight.cleared import Hindsight, hindsight_of
from gtmbench.engine.judged import judged
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.imus import Imu
from gtmbench.intake.units import unit
from gtmbench.study.log.flight import flight_of_records
from gtmbench.study.log.imu_comparison import channels_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record, Span
from gtmbench.verdict.timeline import Claim


def of_other_imus(
    side_by_side: FlightLog, imus: Sequence[Imu], watched: str, *, is_driven: bool, excused_s: Sequence[Span]
) -> Iterator[tuple[str, Hindsight]]:
    """Give each IMU beside the one that is watched, by name, and what its gyros and the attitude say of each other.

    Parameters
    ----------
    side_by_side : FlightLog
        With the gyros of all IMUs and the attitude.
    imus : sequence of Imu
    watched : str
        The name of the one that is watched.
    is_driven : bool
    excused_s : sequence of (start, end)
    """
    for imu in imus:
        channels, known = channels_of(imu), unit(imu.unit)
        if known is not None and imu.name != watched and {*channels} <= set(side_by_side.channels):
            records = [_as_own(record, channels, known.factor) for record in side_by_side.segments]
            flight = flight_of_records(records, is_driven=is_driven, is_assumed=True).without(excused_s)
            said = hindsight_of(flight.blocks, is_driven=is_driven)
            if said.changes:  # something shifted: the engine may say what
                found = judged(flight)
                said = Hindsight(claims=found.claims, changes=found.cleared.changes)
            yield imu.name, said


def claims_of(name: str, said: Hindsight) -> Iterator[Claim]:
    """Give what is claimed of an IMU's gyros: of the attitude, the IMU that is watched tells."""
    yield from ((f"{gyro} of {name}", span) for gyro in GYROS for span in said.claims[gyro])


def _as_own(record: Record, channels: Sequence[str], factor: float) -> Record:
    """Return a record whose p, q and r are an IMU's, in deg/s."""
    values = np.column_stack([factor * record.matrix(channels), record.matrix(ATTITUDE)])
    period_s, start_s = record.sample_period_s, record.start_s
    return Record(values, channels=[*GYROS, *ATTITUDE], sample_period_s=period_s, start_s=start_s)
