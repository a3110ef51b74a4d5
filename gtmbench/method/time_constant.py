"""The time constant of the estimator that makes an attitude, found from a log itself.

An estimator turns its angle x by the gyros y and pulls it to its references z: x' = f(x, y - b) + (z - x) / tau. So

    e = x' - f(x, y) = (z - x) / tau - f(x, b)

is what the references and a gyro's bias b add to the angle's rate. Where accelerometers tell the references, z - x is
known, and the regression of e on it has the slope 1/tau. The gyros' noise is no error of it, for x has integrated it.

A slope is no proof. An estimator whose references are only partly the accelerometers', z = x_0 + g (z_a - x_0) with x_0
the true angle, has e = (g (z_a - x) - (1 - g) d) / tau with d = x - x_0, the integral of e. That integral is a second
regressor, and unless its slope is next to nothing, accelerometers don't tell the references and no time constant is
told. It is what an estimator does that is corrected by GPS, or that allows for turns.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record

_MEAN_S = 0.5  # samples are means over this long: the attitude's own noise and small delays are not
_BLOCK_S = 20.0  # a block has a constant and a trend of its own, as of a bias that wanders
_FEWEST = 3  # blocks, whose scatter is the error
_SURE, _ALIKE = 0.3, 2.0  # the largest relative error, and by which factor roll and pitch may differ


@dataclass(frozen=True, kw_only=True)
class TimeConstant:
    """How long an estimator trusts its gyros."""

    # time_constant_s, deviation_s: it, and its standard error
    time_constant_s: float
    deviation_s: float


def time_constant_of(records: Sequence[Record]) -> TimeConstant | None:
    """Return the time constant of an estimator whose references accelerometers tell; None where nothing shows it.

    Roll and pitch both have to show it, each to 30 %, and may not differ by more than a factor of two.

    `records`: healthy; p, q, r in deg/s, phi, theta, psi in deg, nx, ny, nz in g. Those that lack a channel are passed
    over, and so are blocks of 20 s in which a sample is missing.

    >>> import gtmbench as gb
    >>> truth = gb.fly(excitation="doublets", duration_s=90.0)
    >>> readings = gb.measure(truth, noise="t2")
    >>> for angle, told in zip(("phi", "theta"), accelerometers_tilt(readings)):
    ...     readings = readings.replace(angle, told)  # what the estimator is corrected by
    >>> estimated = gb.filtered_attitude(readings, time_constant_s=5.0)
    >>> round(time_constant_of([estimated]).time_constant_s, 1), time_constant_of([readings]) is None
    (5.0, True)
    """
    wanted = {*GYROS, *ATTITUDE, *ACCELEROMETERS}
    usable = [record for record in records if wanted <= set(record.channels)]
    pairs = [list(axis) for axis in zip(*(block for record in usable for block in _blocks(record)), strict=True)]
    found = [_regressed(np.array(axis)) for axis in pairs if len(axis) >= _FEWEST]
    if not found or any(each is None for each in found):
        return None
    (roll, roll_error), (pitch, pitch_error) = (each for each in found if each is not None)
    apart = abs(math.log(roll / pitch))
    error = math.hypot(max(roll_error, pitch_error), 0.5 * apart)
    if error > _SURE or apart > math.log(_ALIKE):
        return None
    time_constant_s = math.sqrt(roll * pitch)
    return TimeConstant(time_constant_s=time_constant_s, deviation_s=error * time_constant_s)


def accelerometers_tilt(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return phi and theta in deg, as accelerometers tell them of an aircraft that doesn't accelerate.

    nx points forward, ny to the right, nz up, in g: level and at rest they read 0, 0 and 1.

    >>> tilted = Record([[0.5, 0.0, 0.75**0.5]], channels=["nx", "ny", "nz"], sample_period_s=1.0)
    >>> [round(float(angle[0]), 6) for angle in accelerometers_tilt(tilted)]
    [-0.0, 30.0]
    """
    nx, ny, nz = (record[name] for name in ACCELEROMETERS)
    return np.degrees(np.arctan2(-ny, nz)), np.degrees(np.arctan2(nx, np.hypot(ny, nz)))


def _blocks(record: Record) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield, block by block, roll's and pitch's e, z - x and integral of e: of shape (3, means)."""
    axes = [
        _series(record, angle, rate, told)
        for angle, rate, told in zip(("phi", "theta"), _kinematics(record), accelerometers_tilt(record), strict=True)
    ]
    rows = max(round(_MEAN_S / record.sample_period_s), 1)
    means = round(_BLOCK_S / (rows * record.sample_period_s))
    for start in range(0, len(record) - rows * means, rows * means):
        block = [axis[:, start : start + rows * means].reshape(3, means, rows).mean(axis=2) for axis in axes]
        if means > 4 and all(np.isfinite(each).all() for each in block):
            roll, pitch = (_without_trend(each) for each in block)
            yield roll, pitch


def _kinematics(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return phi' and theta' in deg/s as the gyros tell them."""
    phi, theta = np.radians(record["phi"]), np.radians(record["theta"])
    q, r = record["q"], record["r"]
    rolling = record["p"] + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi))
    return rolling, q * np.cos(phi) - r * np.sin(phi)


def _series(record: Record, angle: str, rate: FloatArray, told: FloatArray) -> FloatArray:
    """Return e, z - x and the integral of e of an angle, between the rows of a record."""
    period_s, x = record.sample_period_s, record[angle]
    pull = _turn(np.diff(x)) / period_s - 0.5 * (rate[1:] + rate[:-1])
    off = _turn(told - x)
    there = np.where(np.isfinite(pull), pull, 0.0)
    pulled = period_s * (np.cumsum(there) - 0.5 * there)
    return np.array([pull, 0.5 * (off[1:] + off[:-1]), pulled])


def _turn(angles: FloatArray) -> FloatArray:
    return np.mod(angles + 180.0, 360.0) - 180.0


def _without_trend(block: FloatArray) -> FloatArray:
    basis, _ = np.linalg.qr(np.vander(np.arange(block.shape[1], dtype=float), 2))
    return np.asarray(block - (block @ basis) @ basis.T)


def _regressed(blocks: FloatArray) -> tuple[float, float] | None:
    """Return an axis's time constant and its relative error; None where the slopes show none.

    Where z - x is in error, too, the slope of e on it is too flat and that of z - x on e too steep by what isn't
    coherent. Their geometric mean is told, and how far they are from it is part of the error; so are the scatter over
    the blocks (a jackknife) and the slope on the integral.
    """
    products = np.einsum("bim,bjm->bij", blocks, blocks)
    total = products.sum(axis=0)
    coherence = _coherence(total)
    if not coherence > 0.0:
        return None
    slope, steady = _slopes(total)
    if not slope > 0.0:
        return None
    others = np.array([_slopes(total - each)[0] for each in products])
    scatter = math.sqrt((len(others) - 1) * float(np.var(others))) / slope
    error = math.hypot(scatter, steady / slope, 1.0 / coherence - 1.0)
    return math.sqrt(total[1, 1] / total[0, 0]), error


def _coherence(products: FloatArray) -> float:
    """Return the correlation of e with z - x, zero where either stands still."""
    power = math.sqrt(products[0, 0] * products[1, 1])
    return float(products[0, 1]) / power if power > 0.0 else 0.0


def _slopes(products: FloatArray) -> tuple[float, float]:
    """Return the slopes of e on z - x and on its own integral."""
    slope, steady = np.linalg.lstsq(products[1:, 1:], products[1:, 0], rcond=None)[0].tolist()
    return slope, steady
