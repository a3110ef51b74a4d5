"""In which unit gyros read that state none, by how fast aircraft turn.

The bounds come from the gyros of 172 recorded flights of multirotors and small aircraft, in units that their formats
document. 99.9 % of the readings of the fastest axis lie below 880 deg/s. In 40 of the logs, which stand or hover, they
lie below 3 deg/s, and none of those shows gyros and attitude that tell of one motion about all three axes. The noise at
rest settles nothing: from simulators to vibrating frames it spans a factor of a thousand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gtmbench.intake.formats.raw import RawSeries

_USUALLY = 99.9  # %
_FASTEST_RAD_S, _RANGE_DEG_S = math.radians(920.0), 2500.0  # of aircraft; of gyros
_CALM_DEG_S = 3.0  # below, no log's gyros and attitude tell of one motion
_FEWEST = 200  # readings: a few seconds, or the fastest thousandth is one of them


def only_deg_s(gyros: Sequence[RawSeries]) -> str:
    """Return what shows that gyros read in deg/s, as no aircraft turns so fast in rad/s; "" where nothing does.

    >>> turns = 40.0 * np.sin(np.arange(0.0, 60.0, 0.02))
    >>> def gyros(factor):
    ...     return [RawSeries(name=name, load=lambda: factor * turns) for name in "xyz"]
    >>> only_deg_s(gyros(1.0)), only_deg_s(gyros(1 / 57.3)), only_deg_s(gyros(0.2))
    ('readings up to 40, which are no rad/s', '', '')
    """
    most = _fastest(gyros)
    is_shown = _FASTEST_RAD_S < most <= _RANGE_DEG_S
    return f"readings up to {most:.3g}, which are no rad/s" if is_shown else ""


def hardly_moves_in_deg_s(gyros: Sequence[RawSeries]) -> str:
    """Return what shows that gyros which tell of one motion with an attitude read in rad/s; "" where nothing does."""
    most = _fastest(gyros)
    return f"readings up to {most:.3g}, which in deg/s are too calm to fit an attitude" if most < _CALM_DEG_S else ""


def _fastest(gyros: Sequence[RawSeries]) -> float:
    """Return the readings of the fastest axis, but for a few; NaN where there are too few to tell."""
    values = np.column_stack([each.values() for each in gyros])
    values = values[np.isfinite(values).all(axis=1)]
    return float(np.percentile(np.abs(values), _USUALLY, axis=0).max()) if len(values) >= _FEWEST else math.nan
