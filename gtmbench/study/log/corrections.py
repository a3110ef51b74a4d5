"""Corrections: how much of every turn the references take back from an attitude that the gyros drive.

Such an attitude turns as its gyros say, so a gyro of a wrong scale and its attitude agree. But references know better,
and pull back what was turned too far or too little. Of a gyro that reads y with a gain g, the part d = 1 - 1/g is
wrong: 0 of a right one, 2 of one with a turned sign, -0.43 of one that reads 0.7 of its turns. Carried into the Earth's
axes by the attitude C, what is wrong adds up, and is corrected within the estimator's time constant tau,

    z_i' = C e_i y_i - z_i / tau,   y - x = sum_i d_i C' z_i / tau

with x the attitude's rate. So d_i is found by a regression of gyro i's y - x on the last seconds' turns, beside a
constant, what gyro and attitude differ by in scale and axes, and a delay between them, whose error is the rate's
change. tau isn't known: the usual one is taken, unless another explains far more.

References may be wrong as well. Accelerometers that take thrust for the vertical pull back a part of every turn though
gyros are right. But a part it is: so a gyro is suspected only where d has
left all from 0 to 1, and what it was where identified. One that reads a little too much, whose d is 0.2, never shows.
Nor do five seconds decide alone, for in an impact gyros miss a turn, too. r is never named: iron of a fifth of the
field, which comes near a compass while the aircraft circles, looks like r of half its scale, or of a turned sign.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.excursion import Excursion
from gtmbench.method.regression.slow import interpolated
from gtmbench.study.log.bent import but_behind
from gtmbench.study.log.mean_errors import ErrorSeconds, error_seconds
from gtmbench.study.log.seconds import FEWEST, SECOND_S, of_seconds, seconds_in, trailing_means
from gtmbench.values.attitude import USUAL_S
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, Span, runs

CORRECTED = "corrections of turns"  # test of such alarms
WINDOWS, STEP = (20, 30, 60), 5  # seconds; from one end of windows to the next
_TAUS_S = (2.0, USUAL_S, 10.0)
_USUAL = 1  # of these
_NAMEABLE = (0, 1)  # axes: what a compass beside iron takes back of r by heading looks like a wrong scale, or sign
_KNOWN = 0.8  # of a window
_WANDER_DEG_S, _OF_TURN = 0.2, 0.05  # noise of a second's error beside that of its samples: always; of its turning
# a priori deviations: of scale and axes; of the other gyros' d; of a delay
_SCALE, _OTHERS, _DELAY_S = 0.02, 0.5, 0.05
_UNKNOWNS, _GAINS, _OWN = 8, 3, 5.0  # of an axis; the first that is a scale; of how many data tell
_BETTER = 9.0  # of chi squared, by which another time constant has to explain more
_LEAST_SCATTER = 0.3  # of errors' variance, over what is expected: less is chance
_FLOOR, _DEVIATIONS, _OF_HEALTHY = 0.25, 4.0, 3.0  # of a bound; of its own; times the largest where identified
_LASTS, _NAMED = 0.5, 1.25  # bounds: below, it has ended; that name a gyro
_OTHER = 0.5  # times its excess may another gyro's be
_APART, _TOGETHER = 0.15, 0.25  # of a turn, by which an attitude turns otherwise than a gyro that drives it
_EACH = 0.5  # of the excess has to be left without any five seconds
_TURNED = 1.0  # d beyond which a sign is turned


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrections:
    """Which part of its readings is wrong of each gyro, by what references take back.

    Attributes
    ----------
    start_s : float
        Windows end every five seconds from then on.
    usual : FloatArray
        The part where identified, shape (3,).
    wrong, bound : FloatArray
        The part, and by how much it has to leave what it may be, shape (windows, ends, 3); NaN where it isn't known.
    is_watched : BoolArray
        Shape (ends,): not where identified.
    alarms : tuple of Alarm
    """

    start_s: float
    usual: FloatArray
    wrong: FloatArray = field(repr=False)
    bound: FloatArray = field(repr=False)
    is_watched: BoolArray = field(repr=False)
    alarms: tuple[Alarm, ...] = ()

    @property
    def excess(self) -> FloatArray:
        """By how many bounds the part has left all from 0 to 1 and the usual one, shape (windows, ends, 3)."""
        return _beside(self.wrong, self.usual) / self.bound

    def end_s(self, row: int) -> float:
        """Return when a window ends."""
        return self.start_s + (row + 1) * STEP * SECOND_S


def corrections(
    records: Sequence[Record],
    *,
    healthy: Sequence[Span],
    watched: Sequence[Span] | None = None,
    excursions: Sequence[Excursion] = (),
    is_alone: bool = True,
    seconds: ErrorSeconds | None = None,
) -> Corrections | None:
    """Return what references take back of turns; None where too little is healthy.

    Parameters
    ----------
    records : sequence of Record
        In time, with p, q, r, phi, theta and psi; the gyros drive the attitude.
    healthy : sequence of (start, end)
        What was identified on.
    watched : sequence of (start, end), optional
        What may hold a fault; all else by default. Seconds that are neither tell nothing, as an impact before.
    excursions : sequence of Excursion
        Stretches in which nothing can be told.
    is_alone : bool
        Whether the log has one IMU. Of several any may drive the attitude, so that one is named only if the attitude is
        seen to turn as it reads.
    seconds : ErrorSeconds, optional
        What `error_seconds` makes of the records, where that is known.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flown = gb.measure(gb.fly(excitation="multisine+turbulence", duration_s=160.0, seed=3), noise="t2", seed=3)
    >>> flight = gb.decimate(gb.filtered_attitude(flown, time_constant_s=5.0, seed=3), 10)
    >>> turned = gb.SignFlip(channel="p", onset_s=90.0)
    >>> broken = gb.inject(flight, turned, attitude=gb.AttitudeEstimator(time_constant_s=5.0))
    >>> [(alarm.verdict, alarm.last.kind) for alarm in corrections([broken], healthy=[(0.0, 80.0)]).alarms]
    [('p failed', 'sign_flip')]
    """
    start_s = records[0].start_s
    seconds = error_seconds(records, start_s, excursions) if seconds is None else seconds
    count = len(seconds.error) // STEP
    if count == 0:
        return None
    usual = seconds_in(healthy, start_s, len(seconds.error))
    may_fail = ~usual if watched is None else seconds_in(watched, start_s, len(seconds.error)) & ~usual
    seconds = replace(seconds, error=np.where((usual | may_fail)[:, np.newaxis], seconds.error, np.nan))
    sums = _sums(seconds, _turned(records, start_s, len(seconds.error)))
    is_usual, is_watched = (
        np.asarray(each[: count * STEP].reshape(count, STEP).all(axis=1), dtype=np.bool_) for each in (usual, may_fail)
    )
    if np.diff(sums.known)[is_usual].sum() < FEWEST:
        return None
    compared = _compared(start_s, sums, is_usual, is_watched)
    rises = [(axis, *rise) for axis in range(3) for rise in _rises(compared, sums, axis)]
    alarms = [_alarm(number, compared, seconds, sums, *rise, is_alone=is_alone) for number, rise in enumerate(rises)]
    compared = replace(compared, alarms=tuple(sorted(alarms, key=lambda alarm: alarm.time_s)))
    return replace(compared, alarms=but_behind(compared.alarms, compared.alarms))


def _beside(wrong: FloatArray, usual: FloatArray) -> FloatArray:
    """Return by how much a part lies beside all from 0 to 1 and the usual one; negative within."""
    return np.asarray(np.maximum(np.minimum(usual, 0.0) - wrong, wrong - np.maximum(usual, 1.0)))


# ---- what was turned ----


def _turned(records: Sequence[Record], start_s: float, count: int) -> FloatArray:
    """Return C' z_i / tau, what an estimator remembers of gyro i, about each axis; shape (taus, count, 3, 3)."""
    taus_s = np.array(_TAUS_S)[:, np.newaxis, np.newaxis]
    kept = taus_s / (taus_s + SECOND_S)
    turned = np.full((len(_TAUS_S), count, 3, 3), np.nan)
    for record in records:
        seconds = of_seconds(record, start_s, _carried)
        if not len(seconds.at):
            continue
        to_earth, rates = (each.reshape(-1, 3, 3) for each in np.split(seconds.means, 2, axis=1))
        memory = np.zeros((len(rates) + 1, len(_TAUS_S), 3, 3))
        halves = 0.5 * SECOND_S * (rates + np.concatenate([np.zeros((1, 3, 3)), rates[:-1]]))
        for row, half in enumerate(halves):
            memory[row + 1] = kept * (memory[row] + half)
        turned[:, seconds.at] = np.einsum("nji,ntjk->tnik", to_earth, memory[1:] / taus_s)
    return turned


def _carried(record: Record) -> FloatArray:
    """Return C, from body to Earth's axes, and its columns times the gyros; shape (rows, 18)."""
    sines, cosines = (of(np.deg2rad(interpolated(record.matrix(ATTITUDE)))).T for of in (np.sin, np.cos))
    (s_phi, s_theta, s_psi), (c_phi, c_theta, c_psi) = sines, cosines
    rows = [
        [c_theta * c_psi, s_phi * s_theta * c_psi - c_phi * s_psi, c_phi * s_theta * c_psi + s_phi * s_psi],
        [c_theta * s_psi, s_phi * s_theta * s_psi + c_phi * c_psi, c_phi * s_theta * s_psi - s_phi * c_psi],
        [-s_theta, s_phi * c_theta, c_phi * c_theta],
    ]
    to_earth = np.array(rows).transpose(2, 0, 1)
    rates = to_earth * interpolated(record.matrix(GYROS))[:, np.newaxis]
    return np.concatenate([to_earth.reshape(-1, 9), rates.reshape(-1, 9)], axis=1)


# ---- the regression ----


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sums:
    """Normal equations of every axis by each time constant, summed up to every fifth second.

    Unknowns of an axis are d of its gyro, those of the others, what scale and axes make of p, q and r, a delay, and a
    constant.
    """

    equations: FloatArray  # shape (taus, fifths + 1, 3, unknowns + 1, unknowns + 1): the error comes last
    known: FloatArray  # seconds that are known, shape (fifths + 1,)
    turned: FloatArray  # by the usual time constant, shape (seconds, 3), of each gyro about its axis
    weight: FloatArray  # of each second, 0 where one isn't known, shape (seconds, 3)


def _sums(seconds: ErrorSeconds, turned: FloatArray) -> _Sums:
    turn = np.linalg.norm(seconds.motion, axis=1)[:, np.newaxis]
    is_known = np.asarray(np.isfinite(seconds.error).all(axis=1) & np.isfinite(turned[0]).all(axis=(1, 2)))
    weight = 1.0 / (seconds.variance + _WANDER_DEG_S**2 + np.square(_OF_TURN * turn))
    weight = np.where(is_known[:, np.newaxis], weight, 0.0)
    count = len(turn) // STEP
    motion = seconds.motion
    change = np.gradient(motion, SECOND_S, axis=0) if len(motion) > 1 else np.zeros(motion.shape)
    change = np.where(np.isfinite(change), change, 0.0)
    equations = np.zeros((len(turned), count + 1, 3, _UNKNOWNS + 1, _UNKNOWNS + 1))
    for tau, axis in np.ndindex(len(turned), 3):
        order = [axis, *(other for other in range(3) if other != axis)]
        own = [motion, change[:, axis], np.ones(len(turn)), seconds.error[:, axis]]
        rows = np.column_stack([turned[tau][:, axis, order], *own])
        rows = np.where(is_known[:, np.newaxis], rows, 0.0)
        each, weighted = (
            of[: count * STEP].reshape(count, STEP, -1) for of in (rows, rows * weight[:, axis, np.newaxis])
        )
        equations[tau, 1:, axis] = np.cumsum(each.swapaxes(1, 2) @ weighted, axis=0)
    known = is_known[: count * STEP].reshape(count, STEP).sum(axis=1)
    return _Sums(
        equations=equations,
        known=np.concatenate([[0.0], np.cumsum(known)]),
        turned=turned[_USUAL].diagonal(axis1=1, axis2=2),
        weight=weight,
    )


_A_PRIORI = np.diag([0.0, *[_OTHERS**-2.0] * 2, *[_SCALE**-2.0] * 3, _DELAY_S**-2.0, 0.0])


class _Fit(NamedTuple):
    """Least squares by equations of shape (..., unknowns + 1, unknowns + 1)."""

    found: FloatArray
    inverse: FloatArray
    left: FloatArray  # of squares, with the a priori's


def _fitted(equations: FloatArray, a_priori: FloatArray) -> _Fit:
    inverse = np.asarray(np.linalg.inv(equations[..., :-1, :-1] + a_priori + 1e-9 * np.eye(_UNKNOWNS)), np.float64)
    target = equations[..., :-1, -1]
    found = (inverse @ target[..., np.newaxis])[..., 0]
    return _Fit(found, inverse, np.maximum(equations[..., -1, -1] - (found * target).sum(axis=-1), 0.0))


def _solved(equations: FloatArray, known: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return d and its deviation, shape (windows, 3), by equations of shape (taus, windows, 3, ...)."""
    found, inverse, left = _fitted(equations, _A_PRIORI)
    free = np.maximum(known - _OWN, 1.0)[:, np.newaxis]
    is_better = left[_USUAL] - left.min(axis=0) > _BETTER * left[_USUAL] / free
    best = np.where(is_better, left.argmin(axis=0), _USUAL)[np.newaxis]
    d, variance, rest = (
        np.take_along_axis(each, best, axis=0)[0] for each in (found[..., 0], inverse[..., 0, 0], left)
    )
    return d, np.sqrt(np.maximum(rest / free, _LEAST_SCATTER) * variance)


def _compared(start_s: float, sums: _Sums, is_usual: BoolArray, is_watched: BoolArray) -> Corrections:
    """Return the parts of all windows, with bounds: how far they left 0 to 1 where identified counts thrice."""
    own = np.diff(sums.equations, axis=1)[:, is_usual].sum(axis=1)[:, np.newaxis]
    (usual,), _ = _solved(own, np.diff(sums.known)[is_usual].sum(keepdims=True))
    wrong, bound = np.full((2, len(WINDOWS), len(is_usual), 3), np.nan)
    largest = np.zeros(3)
    for number, window in enumerate(WINDOWS):
        steps = window // STEP
        if len(is_usual) < steps:
            continue
        known = sums.known[steps:] - sums.known[:-steps]
        part, deviation = _solved(sums.equations[:, steps:] - sums.equations[:, :-steps], known)
        part[known < _KNOWN * window] = np.nan
        within = trailing_means(is_usual.astype(np.float64), steps)[steps - 1 :] == 1.0
        strays = _beside(part, usual)[within] / deviation[within]
        largest = np.fmax(largest, np.max(np.nan_to_num(strays), axis=0, initial=0.0))
        wrong[number, steps - 1 :] = part
        bound[number, steps - 1 :] = np.maximum(_FLOOR, np.maximum(_OF_HEALTHY * largest, _DEVIATIONS) * deviation)
    return Corrections(start_s=start_s, usual=usual, wrong=wrong, bound=bound, is_watched=is_watched)


# ---- faults ----


def _largest(compared: Corrections) -> FloatArray:
    """Return the excess of whichever window shows most, 0 where none is known, shape (ends, 3)."""
    return np.asarray(np.max(np.nan_to_num(compared.excess), axis=0))


def _is_steady(compared: Corrections, sums: _Sums, axis: int, row: int) -> bool:
    """Tell whether no five seconds of a window decide: without any of them half of the excess is left."""
    number = _window(compared, axis, row)
    fifths = range(row + 1 - WINDOWS[number] // STEP, row + 1)
    own, known = np.diff(sums.equations[:, fifths[0] : row + 2], axis=1), np.diff(sums.known[fifths[0] : row + 2])
    without, _ = _solved(own.sum(axis=1, keepdims=True) - own, known.sum() - known)
    whole = _beside(compared.wrong[number, row], compared.usual)[axis]
    return bool((_beside(without, compared.usual)[:, axis] > _EACH * whole).all())


def _names(compared: Corrections, sums: _Sums, axis: int, row: int, is_alone: bool) -> bool:
    """Tell whether a window names a gyro: no five seconds decide, and the attitude turns as it reads.

    Where the attitude doesn't, another gyro drives it, and may be wrong itself. How much more the gyro reads at once is
    the scale that this axis has if it isn't known a priori.
    """
    if not _is_steady(compared, sums, axis, row):
        return False
    steps, own = WINDOWS[_window(compared, axis, row)] // STEP, _GAINS + axis
    loose = _A_PRIORI.copy()
    loose[own, own] = 1.0
    fit = _fitted(sums.equations[:, row + 1, axis] - sums.equations[:, row + 1 - steps, axis], loose)
    best = int(fit.left.argmin())
    free = max(sums.known[row + 1] - sums.known[row + 1 - steps] - _OWN, 1.0)
    scale = abs(float(fit.found[best, own]))
    unsure = 2.0 * np.sqrt(max(fit.left[best] / free, _LEAST_SCATTER) * fit.inverse[best, own, own])
    return bool(scale - unsure < _APART if is_alone else scale + unsure < _TOGETHER)


def _window(compared: Corrections, axis: int, row: int) -> int:
    """Return the number of the window that shows most."""
    return int(np.argmax(np.nan_to_num(compared.excess[:, row, axis])))


def _rises(compared: Corrections, sums: _Sums, axis: int) -> Iterator[tuple[int, int]]:
    """Give the windows' end at which an excess is known, and that at which it has ended."""
    excess = _largest(compared)[:, axis]
    starts, stops = runs(np.asarray(excess > _LASTS))
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        risen = (start + np.flatnonzero((excess[start:stop] > 1.0) & compared.is_watched[start:stop])).tolist()
        known = next((row for row in risen if _is_steady(compared, sums, axis, row)), None)
        if known is not None:
            yield known, stop


def _alarm(
    number: int,
    compared: Corrections,
    seconds: ErrorSeconds,
    sums: _Sums,
    axis: int,
    known: int,
    stop: int,
    *,
    is_alone: bool,
) -> Alarm:
    excess = _largest(compared)
    others = np.delete(excess, axis, axis=1).max(axis=1)
    sure = (excess[:, axis] > _NAMED) & (others < np.minimum(_OTHER * excess[:, axis], 1.0)) & compared.is_watched
    rows = range(known, stop) if axis in _NAMEABLE else ()
    decided = next((row for row in rows if sure[row] and _names(compared, sums, axis, row, is_alone)), None)
    row = known + int(np.argmax(excess[known:stop, axis])) if decided is None else decided
    part = float(compared.wrong[_window(compared, axis, row), row, axis])
    onset_s = compared.start_s + _onset(seconds, sums, axis, part, known) * SECOND_S
    judged = _doubted if decided is None else _decided
    return Alarm(
        number=number,
        time_s=compared.end_s(known),
        onset_s=onset_s,
        source=GYROS[axis],
        test=CORRECTED,
        judgements=(judged(axis, part, compared.end_s(known if decided is None else row), onset_s),),
        ended_s=None if stop >= len(excess) else compared.end_s(stop),
    )


def _onset(seconds: ErrorSeconds, sums: _Sums, axis: int, part: float, known: int) -> int:
    """Return the second since which such a part explains most of the windows that rose."""
    stop = (known + 1) * STEP
    rows = slice(max(stop - WINDOWS[-1], 0), stop)
    pulled, weight = part * sums.turned[rows, axis], sums.weight[rows, axis]
    gained = np.nan_to_num(weight * (seconds.error[rows, axis] - 0.5 * pulled) * pulled)
    return rows.start + int(np.argmax(np.cumsum(gained[::-1])[::-1]))


def _decided(axis: int, part: float, judged_s: float, onset_s: float) -> Judgement:
    is_turned = part > _TURNED
    return Judgement(
        time_s=judged_s,
        sensor=GYROS[axis],
        candidates=(GYROS[axis],),
        kind="sign_flip" if is_turned else "scale_factor",
        parameters={"onset_s": onset_s} | ({} if is_turned else {"factor": 1.0 / (1.0 - part)}),
    )


def _doubted(axis: int, part: float, judged_s: float, _onset_s: float) -> Judgement:
    gyro = GYROS[axis]
    return Judgement(
        time_s=judged_s,
        sensor=None,
        candidates=(gyro, ATTITUDE[axis]),
        doubt=f"the attitude is pulled back by {part:.2g} of what {gyro} turns it",
        reason="too little to tell the gyro from the attitude's references",
    )
