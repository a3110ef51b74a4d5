"""Accelerometers, and a GPS where there is one, as the witness between a gyro and an attitude that the gyros drive.

The gyros carry the specific force into the axes in which a stretch began, without any estimator. There it is the
acceleration less gravity, whose direction stays: a gyro's error turns it. A GPS tells the acceleration; then the
direction in which the aircraft accelerates shows an error of the yaw gyro, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.method.heading_witness import FieldOpinion, carried_by, left_open
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, G_M_S2, GPS_VELOCITY, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, check_record

SHORTEST_S = 10.0  # of a stretch on which a slow error can be judged
_BLOCK_S, _STEP_ROWS_S = 1.0, 0.05  # means over which forces are compared; that rotations are integrated in
_COVERED, _PRESENT = 0.7, 0.8  # of a block's rows; of a stretch's blocks
_GYROS_PRESENT = 0.98  # of a stretch's rows, for a turn that isn't read is an error
_GAP_S = 1.1  # between two readings of a GPS, beyond which nothing is known of its velocity
_DELAY_S = 0.2  # of a GPS; another one, or none, is an error of some tenths of an acceleration's change in a second
_USUAL_S, _STEP_S = 15.0, 3.0  # healthy stretches that show what is usual, and from one to the next at least
_MOST = 20  # of these a record
_FEWEST = 5  # of these
_LEAST_DEVIATIONS = 2.0  # that few stretches show too seldom
_ATTITUDE_DEG, _ERROR_DEG_S = 45.0, 15.0  # a priori: of the attitude where a stretch begins; of a gyro's error
_STEPS = 4  # of Gauss and Newton
_SIGMAS, _FLOOR_DEG_S = 2.0, 0.2  # a bound is so many times the worst healthy stretch's deviations and this floor
_OF_TURNING = 0.05  # of what a circling aircraft turns may be errors of scale and axes
_SURE, _SURE_OF_YAW = 1.25, 2.0  # times the bound: an error that is no healthy one
_ALONE, _EACH_HALF = 0.5, 0.25  # of an error, which no other gyro may show; which each half of the time shows
_FOLLOWS, _AGREES = 0.25, 0.3  # the attitude shows so much of an error at least, and so much more at most
_LEAST_NOISE_G = 1e-3
_OF_HEALTHY = 2.0  # times what healthy stretches leave is left where an error of the gyros explains the rest


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """How errors of the gyros explain a stretch."""

    errors_deg_s: FloatArray  # means over the stretch, shape (3,), by gyro
    per_noise: FloatArray  # their deviation for a noise of 1 g in each mean, in deg/s
    noise_g: float  # RMS of what is left
    strength_g: float  # RMS of it along the force, which no turn changes
    turning_deg_s: float  # the size of the mean of all rates, less the errors


class _Usual(NamedTuple):
    """What healthy stretches show."""

    middle_deg_s: FloatArray  # shape (3,), as all but the noise
    deviations: FloatArray  # the largest of them, in the deviations that their noise explains
    noise_g: float  # the largest, as is the next
    strength_g: float


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceWitness:
    """Accelerometers that were learnt on healthy records, with a GPS where the records have one.

    Let C(k) be the rotation that the gyros integrate to since the stretch began, f(k) the specific force in body axes,
    s(k) = a(k) - g the same by the GPS, in the axes in which the stretch began; without a GPS a = 0, and its noise is
    what the aircraft accelerates. Of gyros that read w + d where w is true, with an attitude that is off by e at first,

        C(k) f(k) = s(k) + (e + sum_i integral of C e_i d_i dt) x s(k),

    in means over a second. e and d_i = a_i + b_i t are found by least squares, repeated with the gyros less d. What
    isn't seen, such as the yaw gyro's error where nothing accelerates, keeps a large deviation. Healthy stretches of
    15 s teach the usual error, how many deviations it strays from that, and the noise.

    Attributes
    ----------
    healthy : tuple of Record
        With p, q, r in deg/s, phi, theta, psi in deg and nx, ny, nz in g; gps_north, gps_east and gps_down in m/s where
        there is a GPS, NaN in rows without a reading.

    Raises
    ------
    InputError
        If there is no record, or one lacks a channel.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.fly(duration_s=125.0, seed=1)
    >>> flight = gb.with_gps(gb.measure(truth, noise="t2"), truth, gb.Gps())
    >>> broken = gb.inject(flight, gb.Bias(channel="p", onset_s=85.0, size=3.0))
    >>> witness = ForceWitness(healthy=(flight.between(0.0, 80.0),))
    >>> witness.judge(broken, 85.0, 125.0, gyro="p", error_deg_s=2.0).sensor  # an attitude follows the gyro in part
    'p'
    >>> witness.judge(flight, 85.0, 125.0, gyro="p", error_deg_s=2.0).sensor is None  # the attitude turns alone
    True
    """

    healthy: tuple[Record, ...]

    def __post_init__(self) -> None:
        if not self.healthy:
            raise InputError("no healthy record; give at least one, from which the accelerometers are learnt")
        for record in self.healthy:
            check_record(record)
            record.columns(_NEEDED)

    @cached_property
    def has_gps(self) -> bool:
        """Whether enough healthy stretches have a GPS that reads in most of them."""
        return self._usual_with_gps is not None

    def judge(self, record: Record, start_s: float, end_s: float, *, gyro: str, error_deg_s: float) -> FieldOpinion:
        """Say whether a gyro is wrong, and by how much.

        Parameters
        ----------
        record : Record
            The channels of `healthy`, at their rate.
        start_s, end_s : float
            Since when and until when the gyro and the attitude's rate differ.
        gyro : str
            ``p``, ``q`` or ``r``.
        error_deg_s : float
            What the gyro reads more than the attitude turns, and more than where healthy, as a mean over that stretch.

        Returns
        -------
        FieldOpinion
            Its sensor is the gyro, or None: that the attitude wanders is never said by accelerometers, on which it
            relies.

        Raises
        ------
        InputError
            If the record lacks a channel, has another rate, or the stretch isn't in it.
        """
        check_record(record)
        record.columns(_NEEDED)
        self.healthy[0].check_period(record.sample_period_s, "the healthy records")
        claimed, axis = number("error_deg_s", error_deg_s), GYROS.index(gyro)
        stretch = record.between(start_s, end_s)
        if len(stretch) * stretch.sample_period_s < SHORTEST_S:
            return left_open(f"{end_s - start_s:.3g} s are too short; {SHORTEST_S:g} s are needed")
        begins = np.zeros((2, 3))
        begins[1, axis] = claimed
        for usual, with_gps in ((self._usual_with_gps, True), (self._usual_alone, False)):
            fits = [fit for begin in begins if (fit := _fit(stretch, begin, with_gps=with_gps)) is not None]
            if usual is None or not fits or not (with_gps or axis != _YAW):
                continue
            opinion = _judged(min(fits, key=lambda fit: fit.noise_g), usual, gyro, claimed)
            if opinion.sensor == gyro and not _is_steady(stretch, opinion.error_deg_s, axis, usual, with_gps=with_gps):
                return replace(
                    opinion, sensor=None, reason="the error isn't in both halves: accelerometers may be wrong"
                )
            return opinion
        if self._usual_alone is None:
            return left_open(f"it needs {_FEWEST} healthy stretches of {SHORTEST_S:g} s or more")
        if axis == _YAW and not self.has_gps:
            return left_open("nothing shows r without a GPS")
        return left_open("gyros, attitude, accelerometers or GPS have gaps there")

    def bounds_deg_s(self, length_s: float) -> dict[str, float]:
        """Return how well a healthy stretch of some length tells each gyro's error, in deg/s; NaN where nothing does.

        A gyro is accused where it is off by one and a quarter times that, at least; r by twice that.
        """
        with_gps = self.has_gps
        usual = self._usual_with_gps if with_gps else self._usual_alone
        fits = list(self._healthy_fits(min(length_s, self._longest_s), with_gps=with_gps))
        if usual is None or not fits:
            return dict.fromkeys(GYROS, np.nan)
        found = np.median([_bounds(fit, usual) for fit in fits], axis=0)
        return dict(zip(GYROS, found.tolist(), strict=True))

    @property
    def _longest_s(self) -> float:
        return max(len(record) * record.sample_period_s for record in self.healthy)

    @cached_property
    def _usual_with_gps(self) -> _Usual | None:
        return self._usual(with_gps=True)

    @cached_property
    def _usual_alone(self) -> _Usual | None:
        return self._usual(with_gps=False)

    def _usual(self, *, with_gps: bool) -> _Usual | None:
        """Return what healthy stretches show; None where they are too few."""
        fits = list(self._healthy_fits(_USUAL_S, with_gps=with_gps))
        if len(fits) < _FEWEST:
            fits = list(self._healthy_fits(SHORTEST_S, with_gps=with_gps))
        return _usual_of(fits) if len(fits) >= _FEWEST else None

    def _healthy_fits(self, length_s: float, *, with_gps: bool) -> Iterator[_Fit]:
        for record in self.healthy:
            rows, step = (round(each / record.sample_period_s) for each in (length_s, _STEP_S))
            for first in range(0, len(record) - rows + 1, max(step, (len(record) - rows) // _MOST, 1)):
                fit = _fit(record.part(range(first, first + rows)), np.zeros(3), with_gps=with_gps)
                if fit is not None:
                    yield fit


_NEEDED = (*GYROS, *ATTITUDE, *ACCELEROMETERS)


_YAW = 2


# ---- what is compared ----


def _fit(stretch: Record, begin_deg_s: FloatArray, *, with_gps: bool) -> _Fit | None:
    """Return how errors of the gyros explain a stretch; None where too much is missing."""
    if with_gps and not set(GPS_VELOCITY) <= set(stretch.channels):
        return None
    known = float(np.isfinite(stretch.matrix(GYROS)).all(axis=1).mean())
    if known < _GYROS_PRESENT or not np.isfinite(stretch.matrix(ATTITUDE)[0]).all():
        return None
    blocks = _blocks(stretch, with_gps=with_gps)
    return _fitted(stretch, blocks, begin_deg_s) if blocks.is_known.mean() >= _PRESENT else None


class _Blocks(NamedTuple):
    """Means over a second of a stretch: the rows of each, the specific force by the GPS, and whether both are known.

    Some rows at a time make a step.
    """

    rows: int
    rows_a_step: int
    number: int
    expected: FloatArray  # in g, in the axes in which the stretch began, shape (blocks, 3)
    is_known: BoolArray


def _blocks(stretch: Record, *, with_gps: bool) -> _Blocks:
    from scipy.spatial.transform import Rotation  # takes longer than all of ours

    rows_a_step = max(int(_STEP_ROWS_S / stretch.sample_period_s), 1)
    rows = max(round(_BLOCK_S / (rows_a_step * stretch.sample_period_s)), 1) * rows_a_step
    count = len(stretch) // rows
    read = np.isfinite(stretch.matrix(ACCELEROMETERS)[: count * rows]).all(axis=1).reshape(count, rows)
    is_known = np.asarray(read.mean(axis=1) > _COVERED)
    to_earth = Rotation.from_euler("ZYX", stretch.matrix(ATTITUDE[::-1])[0], degrees=True).as_matrix()
    down = np.tile([0.0, 0.0, 1.0], (count, 1))
    if not with_gps:
        return _Blocks(rows, rows_a_step, count, -down @ to_earth, is_known)
    edges_s = stretch.start_s + _DELAY_S + np.arange(count + 1.0) * (rows * stretch.sample_period_s)
    velocity, is_read = _velocity(stretch, edges_s)
    step_s = rows * stretch.sample_period_s
    acceleration = np.diff(velocity, axis=0) / (step_s * G_M_S2)
    expected = (acceleration - down) @ to_earth
    return _Blocks(rows, rows_a_step, count, expected, is_known & is_read[1:] & is_read[:-1])


def _velocity(stretch: Record, at_s: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return a GPS's velocity at some times, and whether readings stand close enough on both sides."""
    velocity = stretch.matrix(GPS_VELOCITY)
    there = np.isfinite(velocity).all(axis=1)
    time_s = stretch.time_s[there]
    if len(time_s) < 2:
        return np.zeros((len(at_s), 3)), np.zeros(len(at_s), dtype=bool)
    laid = np.column_stack([np.interp(at_s, time_s, each) for each in velocity[there].T])
    behind = np.clip(np.searchsorted(time_s, at_s), 1, len(time_s) - 1)
    is_within = (at_s >= time_s[0] - _DELAY_S) & (at_s <= time_s[-1] + 2.0 * _DELAY_S)
    return laid, np.asarray((time_s[behind] - time_s[behind - 1] < _GAP_S) & is_within)


def _fitted(stretch: Record, blocks: _Blocks, begin_deg_s: FloatArray) -> _Fit:
    """Return the errors of attitude and gyros that explain a stretch best, by Gauss and Newton."""
    from scipy.spatial.transform import Rotation  # takes longer than all of ours

    steps, period_s = blocks.rows * blocks.number // blocks.rows_a_step, blocks.rows_a_step * stretch.sample_period_s

    def by_steps(values: FloatArray) -> FloatArray:
        return np.asarray(values[: steps * blocks.rows_a_step].reshape(steps, -1, 3).mean(axis=1))

    rates = np.deg2rad(by_steps(_filled(stretch.matrix(GYROS))))
    force = by_steps(_filled(stretch.matrix(ACCELEROMETERS)) * [1.0, 1.0, -1.0])
    growing = np.linspace(-1.0, 1.0, steps)[:, np.newaxis]
    prior = np.deg2rad([_ATTITUDE_DEG] * 3 + [_ERROR_DEG_S] * 6)
    found = np.concatenate([np.zeros(3), np.deg2rad(begin_deg_s), np.zeros(3)])
    known, tilt = blocks.is_known, np.eye(3)
    noise = 0.05  # g, of a priori weights
    weights = np.diag((noise / prior) ** 2)
    for _ in range(_STEPS):
        expected = blocks.expected @ tilt.T
        path = carried_by(rates - found[3:6] - growing * found[6:], period_s).as_matrix()
        turned = _means(np.einsum("kij,kj->ki", path, force), blocks)
        turns = [np.cumsum(path * each, axis=0) * period_s for each in (1.0, growing[:, :, np.newaxis])]
        angles = np.concatenate([_means(each.reshape(steps, 9), blocks).reshape(-1, 3, 3) for each in turns], 2)
        angles = np.concatenate([np.tile(np.eye(3), (blocks.number, 1, 1)), angles], axis=2)
        design = np.cross(angles, expected[:, :, np.newaxis], axis=1)[known].reshape(-1, 9)
        left = (turned - expected)[known].ravel()
        inverse = np.linalg.inv(design.T @ design + weights)
        step = inverse @ (design.T @ left - weights @ found)
        found, rest = found + step, left - design @ step
        tilt = Rotation.from_rotvec(step[:3]).as_matrix() @ tilt
    along = expected[known] / np.linalg.norm(expected[known], axis=1)[:, np.newaxis]
    strength = np.sum(rest.reshape(-1, 3) * along, axis=1)
    turning = np.rad2deg(rates.mean(axis=0) - found[3:6])
    return _Fit(
        turning_deg_s=float(np.linalg.norm(turning)),
        errors_deg_s=np.rad2deg(found[3:6]),
        per_noise=np.rad2deg(np.sqrt(np.diag(inverse)[3:6])),
        noise_g=float(np.sqrt(np.mean(rest**2))) + _LEAST_NOISE_G,
        strength_g=float(np.sqrt(np.mean(strength**2))) + _LEAST_NOISE_G,
    )


def _filled(values: FloatArray) -> FloatArray:
    """Return values with a line through what is missing; blocks that lack much are left out by whoever asks."""
    there = np.isfinite(values).all(axis=1)
    rows = np.arange(len(values))
    return np.column_stack([np.interp(rows, rows[there], each) for each in values[there].T])


def _means(values: FloatArray, blocks: _Blocks) -> FloatArray:
    """Return means over the steps of each block."""
    return np.asarray(values.reshape(blocks.number, -1, values.shape[1]).mean(axis=1))


# ---- what is concluded ----


def _usual_of(fits: Sequence[_Fit]) -> _Usual:
    """Return what healthy fits show: their weighted mean, how far they stray from it, and their noise."""
    errors, per_noise = (np.array([getattr(fit, name) for fit in fits]) for name in ("errors_deg_s", "per_noise"))
    noises = np.array([fit.noise_g for fit in fits])
    weights = 1.0 / np.square(per_noise)
    middle = np.sum(weights * errors, axis=0) / weights.sum(axis=0)
    deviations = np.max(np.abs(errors - middle) / (per_noise * noises[:, np.newaxis]), axis=0)
    strength_g = max(fit.strength_g for fit in fits)
    return _Usual(middle, np.maximum(deviations, _LEAST_DEVIATIONS), float(noises.max()), strength_g)


def _bounds(fit: _Fit, usual: _Usual) -> FloatArray:
    """Return by how much more than usual an error isn't healthy, by gyro."""
    noise = max(fit.noise_g, 0.5 * usual.noise_g)
    own = _SIGMAS * np.hypot(usual.deviations * fit.per_noise * noise, _FLOOR_DEG_S)
    return np.asarray(own + _OF_TURNING * fit.turning_deg_s)


def _is_steady(stretch: Record, error_deg_s: float, axis: int, usual: _Usual, *, with_gps: bool) -> bool:
    """Tell whether both halves of a stretch show a part of an error, as a step of an accelerometer doesn't."""
    middle, begin = len(stretch) // 2, np.zeros(3)
    begin[axis] = error_deg_s
    for rows in (range(middle), range(middle, len(stretch))):
        fit = _fit(stretch.part(rows), begin, with_gps=with_gps)
        own = np.nan if fit is None else fit.errors_deg_s[axis] - usual.middle_deg_s[axis]
        if not own * np.sign(error_deg_s) > _EACH_HALF * abs(error_deg_s):
            return False
    return True


def _judged(fit: _Fit, usual: _Usual, gyro: str, claimed: float) -> FieldOpinion:
    """Return the opinion about a stretch, given how healthy ones are."""
    axis = GYROS.index(gyro)
    errors, bounds = fit.errors_deg_s - usual.middle_deg_s, _bounds(fit, usual)
    error, bound = float(errors[axis]), float(bounds[axis])
    sure = bound * (_SURE_OF_YAW if axis == _YAW else _SURE)
    if fit.noise_g > _OF_HEALTHY * usual.noise_g:
        return left_open("no steady error of a gyro explains the forces", error, bound)
    if fit.strength_g > _OF_HEALTHY * usual.strength_g:
        return left_open("the force's strength changes, so accelerometers may be wrong", error, bound)
    if abs(error) < bound:
        if abs(claimed) < sure:
            return left_open(f"{gyro} is known to {bound:.2g} deg/s only", error, bound)
        return left_open(f"{gyro} and the forces turn alike, to {bound:.2g} deg/s", error, bound)
    others = np.delete(np.maximum(np.abs(errors) - bounds, 0.0), axis)
    if others.max() > (0.0 if axis == _YAW else _ALONE * abs(error)):  # a bent attitude turns the GPS's axes
        return left_open("another gyro's error explains the forces, too", error, bound)
    follows = claimed * error > 0.0 and _FOLLOWS * abs(error) < abs(claimed) + bound
    if not follows or abs(claimed) > bound + (1.0 + _AGREES) * abs(error) or abs(error) < sure:
        return left_open(
            f"by the forces {gyro} is off by {error:.2g} deg/s, by the attitude {claimed:.2g}", error, bound
        )
    why = f"{gyro} reads {error:+.2g} deg/s more than the forces turn"
    return FieldOpinion(sensor=gyro, reason=why, error_deg_s=error, bound_deg_s=bound)
