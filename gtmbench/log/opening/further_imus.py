"""The IMUs of a log beside the one that is watched, and the samples of their gyros."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

from gtmbench.engine.imus.imu import gyro_of
from gtmbench.engine.samples import Samples
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_samples
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.imus import Imu as LoggedImu
from gtmbench.intake.read import ReadLog
from gtmbench.values.channels import GYROS
from gtmbench.values.ranges import OutOfRange

_FEWEST, _MOST = 2, 3  # that are compared, the watched one among them
_LONGEST_S = 2e4  # of a log whose IMUs are compared

ImuSamples = Mapping[str, Sequence[Samples]]


def watched_imu(log: FlightLog) -> LoggedImu | None:
    """Return the IMU whose gyros are a log's p, q and r; None where none of them is, or the log has one."""
    columns = {source.column for source in log.sources if source.channel in GYROS}
    found = next((imu for imu in log.imus if set(imu.columns) & columns), None)
    return found if len(log.imus) >= _FEWEST else None


def imu_samples(read: ReadLog, log: FlightLog, mapping: Sequence[str]) -> tuple[ImuSamples, list[OutOfRange]]:
    """Return what the gyros of a log's other IMUs read, by the IMU's name, in deg/s; none of a log that is too long.

    And what no gyro reads, which isn't among it.
    """
    span_s = log.span_s
    if len(log.imus) < _FEWEST or span_s[1] - span_s[0] > _LONGEST_S:
        return {}, []
    watched, found, beyond = watched_imu(log), {}, []
    rest = [text for text in mapping if text.partition("=")[0].strip() not in GYROS]
    for imu in log.imus[:_MOST]:
        if watched is None or imu.name != watched.name:
            with contextlib.suppress(InputError):
                samples = log_samples(read, GYROS, [*rest, *imu.mapping])
                found[imu.name] = [Samples(samples[gyro].time_s, samples[gyro].values) for gyro in GYROS]
                beyond += [
                    replace(each, channel=gyro_of(gyro, imu.name))
                    for gyro in GYROS
                    if (each := samples[gyro].out_of_range) is not None
                ]
    return found, beyond
