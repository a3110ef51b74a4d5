"""The time constant of the estimator that makes an attitude, from a log itself: how hard references pull it.

Of an estimator with x' = f(x, y) + (z - x) / tau, y the gyros and z the references, e = x' - f(x, y) is what its
references add to the attitude's rate. Where accelerometers tell the references, as of a slow aircraft they do, a
regression of e on z - x gives 1/tau, and its constant the gyros' biases.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.attitude import ATTITUDE, GYROS
from gtmbench.method.pseudo_inputs import derive
from gtmbench.record import FloatArray, Record

ACCELEROMETERS = ("ny", "nz")
_SMOOTH_S = 0.2  # over which both are means: the gyros' noise isn't in the references
_BLOCKS = 12  # over which the slopes' scatter is their error
_SHORTEST_S = 30.0
_SURE, _ALIKE = 0.15, 1.5  # relative error of a time constant, and by what roll's and pitch's may differ
_EXPLAINED = 0.5  # of what references add has to be explained


@dataclass(frozen=True, kw_only=True)
class TimeConstant:
    """How long an estimator trusts its gyros.

    Attributes
    ----------
    time_constant_s, deviation_s : float
        It, and its standard error.
    """

    time_constant_s: float
    deviation_s: float


def time_constant_of(records: Sequence[Record]) -> TimeConstant | None:
    """Return the time constant of an estimator whose references accelerometers tell; None where nothing shows it.

    It has to explain most of what references add to the rates of roll, to 15 %; nothing is said of an estimator that is
    corrected by something else, as by GPS.

    Parameters
    ----------
    records : sequence of Record
        p, q, r in deg/s, phi, theta, psi in deg, ny, nz in g; others are passed over.

    Examples
    --------
    >>> level = Record([[0.0] * 6] * 500, channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.1)
    >>> time_constant_of([level]) is None
    True
    """
    wanted = {*GYROS, *ATTITUDE, *ACCELEROMETERS}
    usable = [record for record in records if wanted <= set(record.channels)]
    if sum(len(record) * record.sample_period_s for record in usable) < _SHORTEST_S:
        return None
    pairs = [_pair(record) for record in usable]
    pulls, offs = (np.concatenate(each) for each in zip(*pairs, strict=True))
    there = np.isfinite(pulls) & np.isfinite(offs)
    if np.count_nonzero(there) < 10 * _BLOCKS:
        return None
    return _regressed(pulls[there], offs[there])


def _pair(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return what references add to the rate of roll, and how far the accelerometers' roll is from the attitude's."""
    rows = max(round(_SMOOTH_S / record.sample_period_s), 1)
    rates = derive(record, ["p_att"])["p_att"]
    # ny is to the right and nz up, in g: steady and level, 0 and 1
    told = np.degrees(np.arctan2(-record["ny"], record["nz"]))
    every = slice(rows // 2, None, rows)
    return _means(rates - record["p"], rows)[every], _means(told - record["phi"], rows)[every]


def _means(values: FloatArray, rows: int) -> FloatArray:
    return np.convolve(values, np.full(rows, 1.0 / rows), mode="same")


def _regressed(pulls: FloatArray, offs: FloatArray) -> TimeConstant | None:
    """Return the time constant by least squares; its error by the scatter over blocks."""
    slopes = [
        _slope(*block) for block in zip(np.array_split(pulls, _BLOCKS), np.array_split(offs, _BLOCKS), strict=True)
    ]
    slope = _slope(pulls, offs)
    error = float(np.std(slopes, ddof=1)) / math.sqrt(_BLOCKS)
    left = float(np.var(pulls - slope * offs))
    if not slope > 0.0 or error > _SURE * slope or left > (1.0 - _EXPLAINED) * float(np.var(pulls)):
        return None
    return TimeConstant(time_constant_s=1.0 / slope, deviation_s=error / slope**2)


def _slope(pulls: FloatArray, offs: FloatArray) -> float:
    about = offs - offs.mean()
    power = float(about @ about)
    return float(about @ pulls) / power if power > 0.0 else 0.0
