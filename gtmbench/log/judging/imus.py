"""The IMUs of a log beside the one that is watched: what the engine says of each, and how it is mounted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.engine.hindsight.cleared_sensors import Failure, hindsight_of
from gtmbench.engine.imus.agreement import factors, late
from gtmbench.engine.imus.imu import FlightImu
from gtmbench.engine.judged import Judged, failure_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import Claim, State, unjudged

_TOLD_FACTOR, _TOLD_LATE_S = 0.015, 0.005  # of what an IMU reads otherwise all along: less isn't worth a word
_REFLECTED = "has an odd number of axes turned round, which no mounting does"


@dataclass(frozen=True, kw_only=True)
class ImuClaims:
    """What is told of the IMUs beside the one that is watched: claims of their gyros, and sentences."""

    claims: tuple[Claim, ...] = ()
    lines: tuple[str, ...] = ()


def imu_claims(judged: Judged, claims: Sequence[Claim]) -> ImuClaims:
    """Return where the gyros of other IMUs are clear, beside all that failed, and how they are mounted."""
    failures: dict[str, list[Failure]] = {}
    for sensor, span in claims:
        if span.state in (State.FAILED, State.SUSPECTED):
            failures.setdefault(sensor, []).append(failure_of(span))
    told = [
        _judged(judged, imu, failures) if imu.mounting.is_along_axes else _askew(judged, imu)
        for imu in judged.flight.imus
    ]
    return ImuClaims(
        claims=tuple(claim for each in told for claim in each.claims),
        lines=tuple(line for each in told for line in each.lines),
    )


def _judged(judged: Judged, imu: FlightImu, failures: Mapping[str, Sequence[Failure]]) -> ImuClaims:
    flight = judged.flight.by(imu)
    own = {gyro: failures.get(name, ()) for gyro, name in zip(GYROS, imu.columns, strict=True)}
    beside = {angle: failures.get(angle, ()) for angle in ATTITUDE}
    said = hindsight_of(flight.blocks, is_driven=flight.is_driven, is_sure=False, failures=own | beside)
    claims = tuple((name, span) for gyro, name in zip(GYROS, imu.columns, strict=True) for span in said.claims[gyro])
    lines = (*_installed(judged, imu), *(f"{imu.name}: {change.text}." for change in said.changes))
    return ImuClaims(claims=claims, lines=lines)


def _installed(judged: Judged, imu: FlightImu) -> Iterator[str]:
    """Say how an IMU is mounted, and what it reads otherwise all along: neither is a fault."""
    if imu.mounting.turned_deg:
        yield (
            f"{imu.name} is mounted turned by {imu.mounting.turned_deg:.0f} deg: "
            f"its {imu.mounting.text} read the aircraft's p, q, r."
        )
    flight, everywhere = judged.flight, np.ones(len(judged.flight), dtype=bool)
    for axis in range(len(GYROS)):
        low, high = factors(imu.gyros[:, axis], flight.blocks.gyros[:, axis], everywhere & flight.judged)
        off = low - 1.0 if low > 1.0 else min(high - 1.0, 0.0)
        if _TOLD_FACTOR <= abs(off) < np.inf:
            yield f"{imu.columns[axis]} reads {abs(off):.0%} {'more' if off > 0.0 else 'less'} of each turn."
    late_s = late(flight, imu)
    if abs(late_s) >= _TOLD_LATE_S:
        yield f"{imu.name} is {1e3 * abs(late_s):.0f} ms {'late' if late_s > 0.0 else 'early'}."


def _askew(judged: Judged, imu: FlightImu) -> ImuClaims:
    """Return what is told of an IMU whose axes lie along none of the aircraft's."""
    span_s = judged.flight.blocks.start_s, judged.flight.blocks.end_s
    reason, to_do = f"is mounted turned by {imu.mounting.turned_deg:.0f} deg", "give its columns with --map to judge it"
    if imu.mounting.is_reflected:
        reason, to_do = _REFLECTED, "its columns, or their signs, are wrong"
    claims = tuple((name, unjudged(span_s, f"{imu.name} {reason}")) for name in imu.channels)
    return ImuClaims(claims=claims, lines=(f"{imu.name} {reason}; {to_do}.",))
