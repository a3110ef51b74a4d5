"""Gains: how much of every turn each gyro reads, against the attitude's rate, over twenty seconds.

A gyro of a wrong scale is wrong by a part of the turn, so it hardly shows beside what manoeuvres leave of a residual,
and not at all in a mean. It shows in the gain g of the gyro's slow motion y = g x + noise on the attitude's rate x. As
both are noisy, no regression gives g, but the two of them hold it between them (Frisch's bracket):

    cov(x, y) / var(x)  <=  g  <=  var(y) / cov(x, y)

Noise of either, aliases, a delay and a lag widen the bracket and don't shift it past g. Axes that aren't quite parallel
would: so x and y are taken without what the turns about the other two axes explain of them. A gyro is suspected only
where the whole bracket has left both 1 and the gain that it had where identified, by more than it ever left that there:
samples that come seldom, and filters, make a gain that isn't 1 and hangs a little on how fast the motion is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.excursion import Excursion
from gtmbench.method.regression.slow import HALF, interpolated, slow
from gtmbench.study.log.seconds import FEWEST, SECOND_S, of_seconds, seconds_in, trailing_means
from gtmbench.study.log.self_check.motion import attitude_rates
from gtmbench.study.log.wrong_angles import SURE, for_the_gyro
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, Span, runs

GAIN = "gain against the attitude"  # test of such alarms
WINDOW, _SHORTER = 20, 10  # seconds; where what is healthy hardly holds such windows
_KNOWN = 0.8  # of a window
_TOLERANCE, _OF_HEALTHY, _DEVIATIONS = 0.12, 3.0, 5.0  # of the gain; of its largest change where identified; of its own
_LIKE = 0.25  # share of the variance that gyro and attitude have in common: below, they tell of other things
_GAUSSIAN = 3.0  # E(x^4) / E(x^2)^2 of motion that is as strong throughout
_LASTS = 0.5  # of the bound: below, it has ended
_STEEPEST_DEG = 75.0  # of pitch, for which Euler angles still tell rates
_NAMED_S, _NAMED_LEAST = 10, 0.2  # so long, and so much of the turn missing
_SCALES, _TURNS = 0.95, -0.5  # share in common of a gyro that reads multiples; gain of one with a turned sign
_OTHERS_DEG_S = 0.5  # of turns about another axis, below which they explain nothing
_OTHERS = ((1, 2), (0, 2), (0, 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Between what each gyro's gain lies over 20 s up to each second.

    Attributes
    ----------
    start_s : float
    usual : FloatArray
        What it is where identified, shape (3,).
    least, most : FloatArray
        Shape (seconds, 3); NaN where gyro and attitude move too little together.
    tolerance : FloatArray
        By what share the bracket has to leave the usual gain and 1, shape (seconds, 3).
    alike : FloatArray
        The share of the variance that both have in common, shape (seconds, 3).
    is_watched : BoolArray
        Shape (seconds,): not where identified.
    alarms : tuple of Alarm
    """

    start_s: float
    usual: FloatArray
    least: FloatArray = field(repr=False)
    most: FloatArray = field(repr=False)
    tolerance: FloatArray = field(repr=False)
    alike: FloatArray = field(repr=False)
    is_watched: BoolArray = field(repr=False)
    alarms: tuple[Alarm, ...] = ()

    @cached_property
    def excess(self) -> FloatArray:
        """By how many times the tolerance the whole bracket lies beside the usual gain and 1."""
        below, above = np.minimum(self.usual, 1.0), np.maximum(self.usual, 1.0)
        return np.asarray(np.fmax(1.0 - self.most / below, self.least / above - 1.0) / self.tolerance)


def gains(
    records: Sequence[Record],
    *,
    healthy: Sequence[Span],
    excursions: Sequence[Excursion] = (),
    is_driven: bool,
    names: bool = True,
) -> Gains | None:
    """Compare how far gyros and attitude turn; None where too little of it is healthy.

    Parameters
    ----------
    records : sequence of Record
        In time, with p, q, r, phi, theta and psi.
    healthy : sequence of (start, end)
        What was identified on.
    excursions : sequence of Excursion
        Those that aren't judged tell nothing: of hard motion, a few samples would outweigh all others.
    is_driven : bool
        Whether the gyros drive the attitude, so that it turns as they do.
    names : bool
        Whether a sensor is ever named: not where several IMUs are compared, for another one may drive the attitude.

    Examples
    --------
    >>> time_s = np.arange(0.0, 200.0, 0.1)
    >>> angles = [20.0, 10.0, 30.0] * np.sin(np.outer(time_s, [0.9, 0.7, 0.4]))
    >>> turns = attitude_rates(Record(angles, channels=ATTITUDE, sample_period_s=0.1))
    >>> turns[:, 0] *= np.where(time_s < 100.0, 1.0, 0.6)
    >>> record = Record(np.column_stack([turns, angles])[1:-1], channels=[*GYROS, *ATTITUDE], sample_period_s=0.1)
    >>> found = gains([record], healthy=[(0.0, 60.0)], is_driven=True)
    >>> [(alarm.verdict, round(alarm.last.parameters["factor"], 1)) for alarm in found.alarms]
    [('p failed', 0.6)]
    """
    start_s = records[0].start_s
    moments = _moments(records, start_s, excursions)
    usual = seconds_in(healthy, start_s, len(moments.x))
    learnt = _learnt(moments, usual)
    if learnt is None:
        return None
    gain, change = learnt
    least, most, alike, deviation = _brackets(moments, WINDOW, _rows_of_second(records))
    compared = Gains(
        start_s=start_s,
        usual=gain,
        least=least,
        most=most,
        tolerance=np.fmax(np.fmax(_TOLERANCE, _OF_HEALTHY * change), _DEVIATIONS * deviation),
        alike=alike,
        is_watched=~usual,
    )
    squares = moments.wrong(gain)

    def is_gyros(axis: int, factor: float, since: Span) -> bool:
        return is_driven and for_the_gyro(records, axis, factor, healthy=healthy, since=since) > SURE

    alarms = [
        _alarm(number, compared, axis, rise, squares[:, axis], is_gyros=is_gyros, names=names)
        for number, (axis, rise) in enumerate((axis, rise) for axis in range(3) for rise in _rises(compared, axis))
    ]
    return replace(compared, alarms=tuple(sorted(alarms, key=lambda alarm: alarm.time_s)))


# ---- brackets ----


@dataclass(frozen=True, kw_only=True, eq=False)
class _Moments:
    """Means of the attitude's rates x, of gyros y and of their products, second by second; NaN where one is missing."""

    x: FloatArray  # shape (seconds, 3), as all but the products
    y: FloatArray
    yy: FloatArray
    x4: FloatArray
    xx: FloatArray  # shape (seconds, 3, 3), of each axis with each
    yx: FloatArray

    def over(self, window: int) -> _Moments:
        """Return the means over so many seconds up to each."""
        return _Moments(**{name: trailing_means(values, window, _KNOWN) for name, values in vars(self).items()})

    def wrong(self, gain: FloatArray) -> FloatArray:
        """Return the mean squares of what gyros read beside gains times the rates, shape (seconds, 3)."""
        xx, yx = (each.diagonal(axis1=1, axis2=2) for each in (self.xx, self.yx))
        return np.asarray(self.yy - 2.0 * gain * yx + np.square(gain) * xx)


def _moments(records: Sequence[Record], start_s: float, excursions: Sequence[Excursion]) -> _Moments:
    """Return the moments of slow motion, without those of stretches in which nothing can be told."""
    count = int((records[-1].end_s - start_s) / SECOND_S) + 1
    means = np.full((count, 30), np.nan)
    for record in records:
        seconds = of_seconds(record, start_s, _products)
        means[seconds.at] = seconds.means
    for each in excursions:
        if not each.is_judged:
            first, last = (int((time_s - start_s) // SECOND_S) for time_s in (each.start_s, each.end_s))
            means[max(first, 0) : max(last + 1, 0)] = np.nan
    x, y, yy, x4, xx, yx = np.split(means, [3, 6, 9, 12, 21], axis=1)
    return _Moments(x=x, y=y, yy=yy, x4=x4, xx=xx.reshape(-1, 3, 3), yx=yx.reshape(-1, 3, 3))


def _products(record: Record) -> FloatArray:
    rates, gyros = attitude_rates(record), record.matrix(GYROS)
    there = np.isfinite(rates).all(axis=1) & np.isfinite(gyros).all(axis=1)
    there &= np.abs(record["theta"]) < _STEEPEST_DEG
    there[[0, -1]] = there[1:-1].any()  # ends have no slope
    x, y = slow(interpolated(rates)), slow(interpolated(gyros))
    x[~there], y[~there] = np.nan, np.nan
    products = [np.einsum("ni,nj->nij", of, x).reshape(-1, 9) for of in (x, y)]
    return np.concatenate([x, y, y * y, np.square(x * x), *products], axis=1)


def _rows_of_second(records: Sequence[Record]) -> float:
    """Return how many samples of slow motion a second has that aren't much alike: it holds a fifth of the band."""
    return SECOND_S / records[0].sample_period_s / HALF


def _brackets(
    moments: _Moments, window: int, rows_of_second: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the least and the largest gain, the share in common, and the gain's own deviation, relative to it."""
    means = moments.over(window)
    xx, yy, xy = _beside_others(means)
    squares = means.xx.diagonal(axis1=1, axis2=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.square(xy) / (xx * yy)
        rows = window * rows_of_second * np.minimum(_GAUSSIAN * np.square(squares) / means.x4, 1.0)
        deviation = np.sqrt((1.0 - alike) / alike / rows)
        ends = np.sort([xy / xx, yy / xy], axis=0)
    told = np.isfinite(ends).all(axis=0) & (alike > _LIKE)
    least, most, alike, deviation = (np.where(told, each, np.nan) for each in (*ends, alike, deviation))
    return least, most, alike, deviation


def _beside_others(means: _Moments) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the variances of rates and gyros, and their covariances, without what turns about other axes explain."""
    xs = means.xx - means.x[:, :, np.newaxis] * means.x[:, np.newaxis]
    yxs = means.yx - means.y[:, :, np.newaxis] * means.x[:, np.newaxis]
    xx, xy, yy = np.empty_like(means.x), np.empty_like(means.x), means.yy - np.square(means.y)
    for axis, (one, other) in enumerate(_OTHERS):
        first, both, second = xs[:, one, one], xs[:, one, other], xs[:, other, other]
        first, second = first + _OTHERS_DEG_S**2, second + _OTHERS_DEG_S**2
        of_x, of_y = ((each[:, axis, one], each[:, axis, other]) for each in (xs, yxs))
        determinant = first * second - both * both
        weights = [  # of the other axes' turns, in what x and y have of them
            ((second * a - both * b) / determinant, (first * b - both * a) / determinant) for a, b in (of_x, of_y)
        ]
        xx[:, axis] = xs[:, axis, axis] - weights[0][0] * of_x[0] - weights[0][1] * of_x[1]
        xy[:, axis] = yxs[:, axis, axis] - weights[0][0] * of_y[0] - weights[0][1] * of_y[1]
        yy[:, axis] -= weights[1][0] * of_y[0] + weights[1][1] * of_y[1]
    return xx, yy, xy


def _learnt(moments: _Moments, usual: BoolArray) -> tuple[FloatArray, FloatArray] | None:
    """Return the gains where identified, and how far the brackets ever left them there; shorter windows stray more."""
    for window in (WINDOW, _SHORTER):
        within = trailing_means(usual.astype(np.float64), window) == 1.0
        least, most, _, _ = _brackets(moments, window, 1.0)
        known = within & np.isfinite(least).any(axis=1)
        if np.count_nonzero(known) >= min(window, FEWEST):
            least, most = least[known], most[known]
            gain = np.full(3, np.nan)
            for axis in range(3):
                own = least[:, axis] > 0.0
                if own.any():
                    gain[axis] = np.median(np.sqrt(least[own, axis] * most[own, axis]))
            change = np.fmax(1.0 - most / gain, least / gain - 1.0)
            return gain, np.nanmax(np.fmax(change, 0.0), axis=0, initial=0.0)
    return None


# ---- faults ----


def _rises(compared: Gains, axis: int) -> Iterator[tuple[int, int]]:
    """Give when an excess is known, and when it has ended, in seconds."""
    excess = np.nan_to_num(compared.excess[:, axis])
    starts, ends = runs(np.asarray(excess > _LASTS))
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        risen = np.flatnonzero((excess[start:end] > 1.0) & compared.is_watched[start:end])
        if len(risen):
            yield start + int(risen[0]), end


def _alarm(
    number: int,
    compared: Gains,
    axis: int,
    rise: tuple[int, int],
    squares: FloatArray,
    *,
    is_gyros: Callable[[int, float, Span], bool],
    names: bool,
) -> Alarm:
    known, stop = rise
    onset_s = compared.start_s + _onset(squares, known) * SECOND_S
    judged = _doubted(compared, axis, rise)
    decided = [row for row in range(known, stop) if names and _is_sure(compared, axis, known, row)]
    looks = (_decided(compared, axis, row, onset_s, is_gyros=is_gyros) for row in decided[:: WINDOW // 2])
    if decided:  # the longer it lasts, the more is told of which it is
        judged = next(looks)
        judged = judged if judged.sensor else next((look for look in looks if look.sensor), judged)
    return Alarm(
        number=number,
        time_s=compared.start_s + (known + 1) * SECOND_S,
        onset_s=onset_s,
        source=GYROS[axis],
        test=GAIN,
        judgements=(judged,),
        ended_s=None if stop >= len(compared.least) - 1 else compared.start_s + stop * SECOND_S,
    )


def _onset(squares: FloatArray, known: int) -> int:
    """Return the second since which most is wrong of the window that rose."""
    first = max(known - WINDOW + 1, 0)
    own = np.nan_to_num(squares[first : known + 1])
    return first + int(np.argmax(np.cumsum((own - 0.5 * own.mean())[::-1])[::-1]))


def _is_sure(compared: Gains, axis: int, known: int, row: int) -> bool:
    """Tell whether a gyro, and no other, has missed much of its turns for long enough, up to a second.

    One that reads too much isn't: that may be an attitude which follows another gyro.
    """
    lately = slice(row - _NAMED_S + 1, row + 1)
    missing = 1.0 - compared.most[lately, axis] / compared.usual[axis]
    if row < known + _NAMED_S - 1 or not (missing >= _NAMED_LEAST).all():
        return False
    excess = compared.excess
    others = np.delete(excess[known : row + 1], axis, axis=1)
    return bool((excess[lately, axis] > 1.0).all() and not (others > _LASTS).any())


def _gain(compared: Gains, axis: int, row: int) -> float:
    """Return the gain at a second, of the usual one, in the middle of its bracket."""
    least, most = float(compared.least[row, axis]), float(compared.most[row, axis])
    return float(np.sign(most) * np.sqrt(abs(least * most)) / compared.usual[axis])


def _decided(
    compared: Gains, axis: int, row: int, onset_s: float, *, is_gyros: Callable[[int, float, Span], bool]
) -> Judgement:
    gyro, angle, factor = GYROS[axis], ATTITUDE[axis], _gain(compared, axis, row)
    time_s = compared.start_s + (row + 1) * SECOND_S
    is_named = is_gyros(axis, factor, (onset_s, time_s))
    kind: str | None = None
    parameters = {"onset_s": onset_s}
    if compared.alike[row, axis] > _SCALES:  # else it reads no multiples, as of a deadzone
        kind = "sign_flip" if factor < _TURNS else "scale_factor"
        parameters |= {} if factor < _TURNS else {"factor": factor}
    return Judgement(
        time_s=time_s,
        sensor=gyro if is_named else None,
        candidates=(gyro,) if is_named else (gyro, angle),
        kind=kind,
        parameters=parameters,
        reason="" if is_named else f"{angle} may turn too far as well",
    )


def _doubted(compared: Gains, axis: int, rise: tuple[int, int]) -> Judgement:
    known, stop = rise
    gyro, angle = GYROS[axis], ATTITUDE[axis]
    row = known + int(np.nanargmax(compared.excess[known:stop, axis]))
    return Judgement(
        time_s=compared.start_s + (known + 1) * SECOND_S,
        sensor=None,
        candidates=(gyro, angle),
        doubt=f"the gain of {gyro} against the attitude is {_gain(compared, axis, row):.2g} of what it was",
        reason="too little to tell the gyro from the attitude",
    )
