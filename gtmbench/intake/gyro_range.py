"""In which unit gyros read that state none, by how fast aircraft turn and how quiet gyros at rest are.

The bounds come from the gyros of 172 recorded flights of multirotors and small aircraft, in units that their formats
document: 99.9 % of the readings of the fastest axis lie below 880 deg/s, and below 0.64 deg/s lies the noise of the
noisiest axis at rest in 95 % of them. A log that never rests may be noisier, so that noise alone excludes no unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gtmbench.intake.formats.raw import RawSeries
from gtmbench.values.clock import FloatArray

_DEG = math.degrees(1.0)
_USUALLY = 99.9  # %
_FASTEST_DEG_S, _RANGE_DEG_S = 917.0, 2500.0  # of aircraft; of gyros
_CALM_DEG_S = 3.0, 28.0  # the fastest axis turns faster than the first in a flight; in most faster than the second
_USUAL_DEG_S = 0.64  # of noise at rest
_WINDOW = 50  # samples of the quietest stretch
_FEWEST = 200


def unit_by_range(gyros: Sequence[RawSeries]) -> tuple[str, str] | None:
    """Return the unit of three gyros, and what shows it; None where rad/s and deg/s are both possible.

    >>> time_s = np.arange(0.0, 60.0, 0.02)
    >>> noise = 0.1 * np.random.default_rng(1).standard_normal((3, len(time_s)))
    >>> def series(factor):
    ...     turns = factor * (40.0 * np.sin(time_s) * (time_s > 10.0) + noise)
    ...     return [RawSeries(name=name, load=lambda turn=turn: turn) for name, turn in zip("xyz", turns)]
    >>> unit_by_range(series(1.0)), unit_by_range(series(1 / 57.3))[0], unit_by_range(series(0.1))
    (('deg/s', 'readings up to 40.3, which are no rad/s'), 'rad/s', None)
    """
    values = np.column_stack([each.values() for each in gyros])
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) < _FEWEST:
        return None
    most, rest = float(np.percentile(np.abs(values), _USUALLY, axis=0).max()), _noise_at_rest(values)
    if _FASTEST_DEG_S / _DEG < most <= _RANGE_DEG_S:
        return "deg/s", f"readings up to {most:.3g}, which are no rad/s"
    if _CALM_DEG_S[1] / _DEG <= most < _CALM_DEG_S[0] and rest <= _USUAL_DEG_S / _DEG:
        return "rad/s", f"readings up to {most:.3g}, and a noise of {rest:.2g} at rest"
    return None


def _noise_at_rest(values: FloatArray) -> float:
    """Return the noise of the noisiest axis where each is quietest, from sample to sample."""
    count = max(1, (len(values) - 1) // _WINDOW)
    steps = np.diff(values, axis=0)[: count * _WINDOW]
    parts = np.array([part.std(axis=0) for part in np.array_split(steps, count)])
    return float(parts.min(axis=0).max()) / math.sqrt(2.0)
