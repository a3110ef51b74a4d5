"""An attitude that contradicts the accelerometers: by both together the aircraft would fall for longer than any does.

The specific force f is acceleration less gravity, so its part along the vertical is 1 g and the vertical acceleration.
In means over ten seconds that acceleration is small, in a steep turn as on the ground: 0.7 g for ten seconds is 69 m/s.
Where the attitude says so nevertheless, it isn't the aircraft's: mostly gyros that drive it read an offset. A fault
that is there from the first sample is learnt as healthy by whatever compares gyros with that attitude.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.study.log.seconds import SECOND_S, of_seconds, trailing_means
from gtmbench.values.channels import ACCELEROMETERS
from gtmbench.values.record import FloatArray, Record

_WINDOW = 10  # seconds
_KNOWN = 0.8  # of a window
_LEAST_G, _FORCE_G = 0.3, 0.7  # of the vertical force; of all of the force, for a fall has none
_LASTS = 5  # seconds of such means
_USUAL_G = 0.7  # that it has in some second, or accelerometers are read otherwise than they are mounted


def up_of(record: Record) -> FloatArray:
    """Return where up is, along forward, right and up of the aircraft, as its attitude tells.

    >>> record = Record([[30.0, 0.0], [0.0, 90.0]], channels=["phi", "theta"], sample_period_s=0.1)
    >>> up_of(record).round(2) + 0.0
    array([[ 0.  , -0.5 ,  0.87],
           [ 1.  ,  0.  ,  0.  ]])
    """
    phi, theta = np.deg2rad(record["phi"]), np.deg2rad(record["theta"])
    return np.column_stack([np.sin(theta), -np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])


def _force(record: Record) -> FloatArray:
    """Return the vertical part of the specific force, as the attitude tells where up is, and all of it."""
    force = record.matrix(ACCELEROMETERS)
    return np.column_stack([(force * up_of(record)).sum(axis=1), np.linalg.norm(force, axis=1)])


def contradiction(records: Sequence[Record]) -> str:
    """Say for how long the attitude contradicts the accelerometers; "" where it doesn't, or nothing tells.

    Parameters
    ----------
    records : sequence of Record
        In time; those without phi, theta or accelerometers tell nothing.

    Examples
    --------
    >>> channels = ["phi", "theta", "nx", "ny", "nz"]
    >>> level = Record([[0.0, 0.0, 0.0, 0.0, 1.0]] * 600, channels=channels, sample_period_s=0.1)
    >>> tumbling = level.replace("phi", np.where(level.time_s < 20.0, 0.0, 6.0 * (level.time_s - 20.0)))
    >>> contradiction([level]), contradiction([tumbling])[:41]
    ('', 'for 24 s from 27 s on the attitude contra')
    """
    told = [record for record in records if {"phi", "theta", *ACCELEROMETERS} <= set(record.channels)]
    if not told:
        return ""
    start_s = told[0].start_s
    force = np.full((int((told[-1].end_s - start_s) / SECOND_S) + 1, 2), np.nan)  # vertical, and all of it
    for record in told:
        seconds = of_seconds(record, start_s, _force)
        force[seconds.at] = seconds.means
    vertical, whole = trailing_means(force, _WINDOW, _KNOWN).T
    wrong = np.flatnonzero((vertical < _LEAST_G) & (whole > _FORCE_G))
    if not (len(wrong) >= _LASTS and np.nanmax(force[:, 0]) > _USUAL_G):
        return ""
    return (
        f"for {len(wrong) * SECOND_S:.0f} s from {start_s + (wrong[0] - _WINDOW + 1) * SECOND_S:.0f} s on the attitude "
        f"contradicts the accelerometers: by both the vertical force is {vertical[wrong].min():.2g} g, so the attitude "
        "isn't the aircraft's, and gyros that drive it may be wrong"
    )
