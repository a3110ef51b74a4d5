"""A magnetometer as the witness between a yaw gyro and a heading that the gyros drive.

The gyros carry the field's direction along without any estimator. Where they are right, the field that they carry back
stays where it was; a gyro's error turns it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.values.channels import GYROS, MAGNETOMETER
from gtmbench.values.record import BoolArray, FloatArray, Record, check_record

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

MAGNETOMETER_ITSELF = "magnetometer"
SHORTEST_S = 10.0  # of a stretch on which a slow error can be judged
_STEP = 0.25  # of a stretch, from one healthy stretch to the next
_FEWEST = 8  # healthy stretches of that length, before they bound anything
_SHORTER = 0.8  # times the length, where there are too few
_OF_HEALTHY = 2.0  # times the largest of healthy stretches is still healthy
_PRESENT = 0.8  # of the magnetometer's usual readings have to be there
_SURE = 2.0  # times the bound: an error that is neither healthy nor hidden by what is
_AGREES = 0.3  # of an error, by which the heading may show more of it, beside the bound
_BETTER = 0.5  # of the squares that another gyro leaves, at most, may the yaw gyro leave
_SECANT = 1.5  # times the bound would a disturbance on a straight way have left
_PARABOLA = 0.298  # RMS about its mean of a parabola's arc of height 1
_OF_TURN, _TURN_DEG = 1.5, 10.0  # times the largest turn of a healthy stretch, and beside it, for which bounds hold
_YAW = 2


@dataclass(frozen=True, kw_only=True)
class FieldOpinion:
    """What a magnetometer says about a yaw gyro that turns otherwise than the heading, or accelerometers about a gyro.

    Attributes
    ----------
    sensor : str or None
        "r", or of accelerometers "p" or "q", too: the gyro is wrong. "psi": the gyro is right, so the heading wanders.
        "magnetometer": its field isn't the Earth's alone. None: it can't tell.
    reason : str
        Why.
    error_deg_s : float
        What the gyro reads more than the field or the force turns, and more than where healthy, as a mean over the
        stretch; NaN where it isn't known.
    bound_deg_s : float
        What healthy stretches of that length don't exceed; NaN where it isn't known.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.FieldOpinion(sensor=None, reason="gyros or magnetometer have gaps there").error_deg_s
    nan
    """

    sensor: str | None
    reason: str
    error_deg_s: float = np.nan
    bound_deg_s: float = np.nan


@dataclass(frozen=True, kw_only=True)
class _HeadingFit:
    """How a stretch's field is explained by an error of each gyro, which grows evenly."""

    errors_deg_s: FloatArray  # mean over the stretch, shape (3,), by gyro
    left: FloatArray  # RMS of what an error of each gyro leaves, in means over a second, of the field's strength
    strength: float  # largest change of the field's strength from the stretch's beginning, as a share of that
    turn_deg: float  # largest turn of the aircraft since the stretch's beginning, as the gyros tell, or less r's error
    across: float  # share of the field across the yaw axis


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadingWitness:
    """A magnetometer that was learnt on healthy records.

    Let C(k) be the rotation that the gyros integrate to since the stretch began, and m(k) the magnetometer's reading.
    Of a gyro that reads w + d where w is true,

        n(k) = C(k) m(k),   dn/dt = C (d x m),   so   n(k) = n(0) + sum_i integral of d_i C (e_i x m) dt.

    For each gyro alone d = a + b t is found by least squares. All errors of calibration and of motion are in what
    healthy stretches of the same length show: their median, which is a constant error of the gyro, is taken off, and
    twice the largest that is left is a bound. Of a stretch too long to find so many of, it is what the longest show
    of which there are enough; then no disturbance is named, for the field may change more in a longer time.

    A disturbance of the magnetometer may look like a turn, and a heading that relies on that magnetometer turns with
    it. On a straight way a disturbance that turns the field by an angle A about the yaw axis weakens it across that
    axis to cos(A/2) in between. So r is accused only where A is so large that the fit would have left that. A
    disturbance that moves along a circle about the yaw axis looks the same as an error of r.

    Attributes
    ----------
    healthy : tuple of Record
        With p, q, r in deg/s and mag_x, mag_y, mag_z in any unit.

    Raises
    ------
    InputError
        If there is no record, or one lacks a channel.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.fly(duration_s=125.0, seed=1)
    >>> flight = gb.with_magnetometer(gb.measure(truth, noise="t2"), truth, gb.Magnetometer())
    >>> broken = gb.inject(flight, gb.Bias(channel="r", onset_s=90.0, size=5.0))
    >>> witness = gb.HeadingWitness(healthy=(flight.between(0.0, 85.0),))
    >>> witness.judge(broken, 90.0, 120.0, error_deg_s=2.5).sensor  # a driven heading follows the gyro by half
    'r'
    >>> witness.judge(flight, 90.0, 120.0, error_deg_s=3.0).sensor  # the heading turns, and the gyro doesn't
    'psi'
    """

    healthy: tuple[Record, ...]

    def __post_init__(self) -> None:
        if not self.healthy:
            raise InputError("no healthy record; give at least one, from which the magnetometer is learnt")
        for record in self.healthy:
            check_record(record)
            record.columns(_NEEDED)

    def judge(self, record: Record, start_s: float, end_s: float, *, error_deg_s: float) -> FieldOpinion:
        """Say which is wrong, the yaw gyro or the heading.

        Parameters
        ----------
        record : Record
            The channels of `healthy`, at their rate.
        start_s, end_s : float
            Since when and until when r and the heading's rate differ.
        error_deg_s : float
            What r reads more than the heading turns, and more than where healthy, as a mean over that stretch.

        Raises
        ------
        InputError
            If the record lacks a channel, has another rate, or the stretch isn't in it.
        """
        check_record(record)
        record.columns(_NEEDED)
        self.healthy[0].check_period(record.sample_period_s, "the healthy records")
        claimed = number("error_deg_s", error_deg_s)
        stretch = record.between(start_s, end_s)
        length_s = len(stretch) * stretch.sample_period_s
        if length_s < SHORTEST_S:
            return left_open(f"{length_s:.3g} s are too short for the magnetometer; it needs {SHORTEST_S:g} s")
        fit = _fit(stretch, self._usual_share)
        if fit is None:
            return left_open("gyros or magnetometer have gaps there")
        usual, is_as_long = self._usual(length_s)
        if len(usual) < _FEWEST:
            return left_open(
                f"it needs {_FEWEST} healthy stretches of {SHORTEST_S:g} s or more, and there are {len(usual)}"
            )
        opinion = _judged(fit, usual, claimed, length_s)
        if opinion.sensor == MAGNETOMETER_ITSELF and not is_as_long:
            return replace(opinion, sensor=None)
        return opinion

    def bound_deg_s(self, length_s: float) -> float:
        """Return how well a stretch of some length tells r's error, in deg/s; NaN where too little is healthy.

        A yaw gyro is accused only where it is off by twice that, at least.
        """
        usual, _ = self._usual(number("length_s", length_s, SHORTEST_S))
        return _middle_and_bound(usual)[1] if len(usual) >= _FEWEST else np.nan

    @cached_property
    def _usual_share(self) -> float:
        """Share of rows with a reading, for the magnetometer may be slower than the record."""
        rows = np.concatenate([np.isfinite(record.matrix(MAGNETOMETER)).all(axis=1) for record in self.healthy])
        return float(rows.mean())

    def _usual(self, length_s: float) -> tuple[list[_HeadingFit], bool]:
        """Return healthy stretches, and whether they are of that length, or shorter for want of enough."""
        lasts_s = length_s
        while len(fits := self._stretches(lasts_s)) < _FEWEST and lasts_s > SHORTEST_S:
            lasts_s = max(_SHORTER * lasts_s, SHORTEST_S)
        return fits, lasts_s == length_s

    def _stretches(self, length_s: float) -> list[_HeadingFit]:
        fits: list[_HeadingFit] = []
        for record in self.healthy:
            rows = round(length_s / record.sample_period_s)
            step = max(int(_STEP * rows), 1)
            parts = (record.part(range(first, first + rows)) for first in range(0, len(record) - rows + 1, step))
            fits += [fit for part in parts if (fit := _fit(part, self._usual_share)) is not None]
        return fits


_NEEDED = (*GYROS, *MAGNETOMETER)


def left_open(reason: str, error: float = np.nan, bound: float = np.nan) -> FieldOpinion:
    """Return the opinion of a witness that can't tell."""
    return FieldOpinion(sensor=None, reason=reason, error_deg_s=error, bound_deg_s=bound)


def _judged(fit: _HeadingFit, usual: Sequence[_HeadingFit], claimed: float, length_s: float) -> FieldOpinion:
    """Return the opinion about a stretch, given how healthy ones of the same length are."""
    middle, bound = _middle_and_bound(usual)
    error = float(fit.errors_deg_s[_YAW]) - middle
    left = _OF_HEALTHY * max(float(each.left.max()) for each in usual)
    strength = _OF_HEALTHY * max(each.strength for each in usual)
    turn_deg = max(each.turn_deg for each in usual)
    if fit.turn_deg > _OF_TURN * turn_deg + _TURN_DEG:  # uncalibrated iron shows in other attitudes
        why = f"the aircraft turns by {fit.turn_deg:.0f} deg, and by {turn_deg:.0f} deg at most in healthy stretches"
        return left_open(why, error, bound)
    if fit.strength > strength:
        why = f"the field's strength changes by {100.0 * fit.strength:.2g} %, healthy at most {100.0 * strength:.2g} %"
        return FieldOpinion(sensor=MAGNETOMETER_ITSELF, reason=why, error_deg_s=error, bound_deg_s=bound)
    if abs(claimed) < _SURE * bound:
        return left_open(f"the magnetometer knows r to {bound:.2g} deg/s only", error, bound)
    if fit.left[_YAW] > left:
        return left_open("no steady error of r explains how the field turns", error, bound)
    if abs(error) <= bound:
        why = f"r and the field turn alike, to {bound:.2g} deg/s"
        return FieldOpinion(sensor="psi", reason=why, error_deg_s=error, bound_deg_s=bound)
    # a heading that the gyro drives follows it, so that it shows less of the error than the field does
    if claimed * error < 0.0 or abs(claimed) > bound + (1.0 + _AGREES) * abs(error) or abs(error) < _SURE * bound:
        return left_open(
            f"by the field r is off by {error:.2g} deg/s, by the heading {claimed:.2g} deg/s", error, bound
        )
    if fit.left[_YAW] ** 2 > _BETTER * np.delete(fit.left, _YAW).min() ** 2:
        return left_open("an error of another gyro explains the field as well", error, bound)
    angle = min(abs(error) * length_s, 180.0)
    if _PARABOLA * fit.across * (1.0 - np.cos(np.deg2rad(angle / 2.0))) < _SECANT * left:
        return left_open(f"a disturbance of the magnetometer may turn the field by {angle:.0f} deg, too", error, bound)
    why = f"r reads {error:+.2g} deg/s more than the field turns"
    return FieldOpinion(sensor="r", reason=why, error_deg_s=error, bound_deg_s=bound)


def _middle_and_bound(usual: Sequence[_HeadingFit]) -> tuple[float, float]:
    """Return r's usual error on healthy stretches, and by how much more than that an error isn't healthy."""
    errors = np.array([each.errors_deg_s[_YAW] for each in usual])
    middle = float(np.median(errors))
    return middle, float(_OF_HEALTHY * np.abs(errors - middle).max())


def _fit(stretch: Record, usual_share: float) -> _HeadingFit | None:
    """Return how errors of each gyro explain a stretch; None where too much is missing."""
    rates, field = np.deg2rad(stretch.matrix(GYROS)), stretch.matrix(MAGNETOMETER)
    read: BoolArray = np.asarray(np.isfinite(field).all(axis=1), dtype=np.bool_)
    if not np.isfinite(rates).all() or np.count_nonzero(read) < max(_PRESENT * usual_share * len(read), 20.0):
        return None
    field, time_s = field[read], stretch.time_s[read] - stretch.time_s[0]
    strength = float(np.linalg.norm(field, axis=1).mean())
    if strength == 0.0:
        return None
    path = carried_by(rates, stretch.sample_period_s)
    carried = path[read]
    turned = carried.apply(field) / strength
    errors, left = np.empty(3), np.empty(3)
    for axis in range(3):
        rate = carried.apply(np.cross(np.eye(3)[axis], field)) / strength
        errors[axis], left[axis] = _explained(turned, rate, time_s)
    size = _second_means(np.linalg.norm(field, axis=1)[:, np.newaxis], time_s)[:, 0]
    corrected = carried_by(rates - np.array([0.0, 0.0, errors[_YAW]]), stretch.sample_period_s)
    turns = [float(np.rad2deg(each.magnitude().max())) for each in (path, corrected)]
    return _HeadingFit(
        errors_deg_s=np.rad2deg(errors),
        left=left,
        strength=float(np.max(np.abs(size / size[0] - 1.0))),
        turn_deg=min(turns),
        across=float(np.hypot(field[:, 0], field[:, 1]).mean()) / strength,
    )


def carried_by(rates: FloatArray, period_s: float) -> Rotation:
    """Return C(k), from body axes at row k to those at row 0, by the mean of the gyros at both ends of a step."""
    from scipy.spatial.transform import Rotation  # takes longer than all of ours

    steps = Rotation.from_rotvec(0.5 * period_s * (rates[1:] + rates[:-1])).as_matrix()
    path = np.empty((len(rates), 3, 3))
    path[0] = np.eye(3)
    for row, step in enumerate(steps):
        path[row + 1] = path[row] @ step
    return Rotation.from_matrix(path)


def _explained(turned: FloatArray, rate: FloatArray, time_s: FloatArray) -> tuple[float, float]:
    """Return the mean error in rad/s and the RMS that it leaves; `rate` is dn/dt of 1 rad/s, shape (readings, 3)."""
    from scipy.integrate import cumulative_trapezoid  # takes longer than all of ours

    centre = 0.5 * (time_s[0] + time_s[-1])
    half = max(0.5 * (time_s[-1] - time_s[0]), 1e-9)
    growing = rate * ((time_s - centre) / half)[:, np.newaxis]
    # n(0) falls out with the means, axis by axis, which leaves two unknowns: a and b
    paths = [cumulative_trapezoid(each, time_s, axis=0, initial=0.0) for each in (rate, growing)]
    design = np.column_stack([(path - path.mean(axis=0)).ravel() for path in paths])
    target = (turned - turned.mean(axis=0)).ravel()
    found, *_ = np.linalg.lstsq(design, target, rcond=None)
    rest = _second_means((target - design @ found).reshape(turned.shape), time_s)
    return float(found[0]), float(np.sqrt(np.mean(np.sum(rest**2, axis=1))))


def _second_means(values: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return means over each second, of columns, shape (seconds, columns)."""
    _, second = np.unique(np.floor(time_s).astype(int), return_inverse=True)
    sums = np.column_stack([np.bincount(second, column) for column in values.T])
    return np.asarray(sums / np.bincount(second)[:, np.newaxis])
