"""A log without a heading: why one is of no use, and how the yaw gyro stands in for it.

Bank and pitch still tell what p and q should read, as far as the aircraft does not turn. How it turns, r says: so
signs, units and axes are checked as with a whole attitude. What r itself reads, nothing contradicts.
"""

from __future__ import annotations

import numpy as np

from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.self_check.motion import terms_of
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import Record

_HARDLY, _STILL_DEG = 0.5, 1e-9  # of the rows in which the bank is known; a heading that never moves
_ON_EDGE = 0.1  # of cos phi cos theta: below, r says nothing of the heading


def no_heading(log: FlightLog) -> str:
    """Say why a log's heading is of no use: it never moves while bank or pitch do, or hardly is there; "" if of use."""
    angles = np.concatenate([record.matrix(ATTITUDE) for record in log.segments])
    known = np.isfinite(angles)
    counts = known.sum(axis=0)
    if counts[2] < _HARDLY * counts[0]:
        return f"psi is missing in {100.0 * (1.0 - counts[2] / counts[0]):.0f} % of the log"
    spread = [float(np.ptp(angles[known[:, i], i])) if counts[i] else 0.0 for i in range(len(ATTITUDE))]
    if spread[2] > _STILL_DEG or max(spread[:2]) <= _STILL_DEG:
        return ""
    return f"the heading never changes: psi reads {angles[known[:, 2], 2][0]:.6g} all the time"


def with_heading(record: Record) -> Record:
    """Return a record with the heading, in deg, that its r, phi and theta make; it begins with 0.

    >>> turning = Record([[6.0, 0.0, 0.0]] * 101, channels=["r", "phi", "theta"], sample_period_s=0.1)
    >>> with_heading(turning)["psi"][[1, 50]].round(9)
    array([ 0.6, 30. ])
    """
    angles = np.column_stack([record["phi"], record["theta"], np.zeros(len(record))])
    phi, theta = np.deg2rad(angles[:, :2]).T
    upright = np.cos(phi) * np.cos(theta)
    pitching = terms_of(angles, record.sample_period_s)[:, 5]
    rate = (record["r"] + np.nan_to_num(pitching)) / np.where(np.abs(upright) < _ON_EDGE, np.nan, upright)
    steps = 0.5 * record.sample_period_s * np.nan_to_num(rate[:-1] + rate[1:])
    heading = np.where(np.isfinite(rate), np.concatenate([[0.0], np.cumsum(steps)]), np.nan)
    return Record(
        np.column_stack([record.values, heading]),
        channels=[*record.channels, "psi"],
        sample_period_s=record.sample_period_s,
        start_s=record.start_s,
    )
