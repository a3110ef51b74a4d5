"""Slow faults: each gyro less the rate that the attitude turns at, in means over 10 and 30 s.

An estimator integrates its gyros, so a fault shows only in how references pull the attitude back: too slowly for a test
that looks at seconds. In means over tens of seconds it shows whole. Attitude and gyros part in health, too: references
wander, turning shows scale errors, and samples that come too seldom alias vibration. So calm seconds count for more
(`mean_errors`), and a mean is held against its own deviation, by as many of them as it ever reached where identified.

What has risen is a doubt at first. Whoever is wrong has been so in one direction: summed up, that is an angle by which
the attitude would be off if the gyro were right. No estimator's bank or pitch is off by two thirds of a right angle, so
beyond that the gyro is named; a heading may be off by much more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.alarm import OUTSIDE, Alarm, Judgement
from gtmbench.detectors.excursion import Excursion
from gtmbench.faults.additive import Bias, Drift
from gtmbench.study.log.mean_errors import ErrorSeconds, MeanErrors, error_seconds, mean_errors, weighted_means
from gtmbench.study.log.seconds import SECOND_S, seconds_in, trailing_means
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, Span, runs

SLOW = "mean against the attitude"  # test of such alarms
LEAST_DEG_S = 0.1  # a mean error that is ever called a failure, where the attitude is an estimator's
WINDOWS = (10, 30)  # seconds
_FLOOR_DEG_S = 0.3
_OF_HEALTHY, _DEVIATIONS = 3.0, 4.0  # times the largest of healthy means, in deviations; deviations of its own
_GROWS_AS = 1.0 / 6.0  # power of a window's length: an estimator's wander falls with its cube root, not its root
_LASTS = 0.5  # of the bound: below, it has ended
_NAMED_DEG, _HEADING_DEG, _OPEN_DEG = 60.0, 360.0, 90.0  # how far the attitude would be off
# so long, so much, of so many seconds that are known: less may be warming, or a new calibration
_NAMED_S, _LATELY_S, _NAMED_DEG_S, _WHOLE = 15, 5, 1.0, 0.9
_BESIDE, _TURNING, _EVEN = 0.5, 0.3, 0.5  # of an error's mean: another axis's; of the turning; its median
_UPRIGHT = 0.35  # of the vertical along p's or q's axis: a bank or pitch of 20 deg
_GROWS = 1.0  # of its mean, by which an error grows: a drift


@dataclass(frozen=True, kw_only=True, eq=False)
class SlowMeans:
    """What each gyro reads more than the attitude turns, second by second.

    Attributes
    ----------
    start_s : float
    error : FloatArray
        In deg/s, shape (seconds, 3), about what is usual where identified; NaN where nothing is known.
    weight : FloatArray
        How much each second tells, shape (seconds, 3).
    bounds : mapping of window to FloatArray
        What a weighted mean over so many seconds up to each has to exceed, shape (seconds, 3).
    is_watched : BoolArray
        Shape (seconds,): not where identified.
    is_driven : bool
        Whether the gyros drive the attitude.
    alarms : tuple of Alarm
    """

    start_s: float
    error: FloatArray = field(repr=False)
    weight: FloatArray = field(repr=False)
    bounds: Mapping[int, FloatArray] = field(repr=False)
    is_watched: BoolArray = field(repr=False)
    is_driven: bool
    alarms: tuple[Alarm, ...] = ()

    @property
    def watched_s(self) -> float:
        """For how long a mean of every gyro could have risen."""
        known = np.logical_or.reduce([np.isfinite(self.excess(window)).all(axis=1) for window in WINDOWS])
        return float(np.count_nonzero(known & self.is_watched)) * SECOND_S

    def mean(self, window: int) -> FloatArray:
        """Return the weighted means over so many seconds up to each."""
        return weighted_means(self.error, self.weight, window)

    def excess(self, window: int) -> FloatArray:
        """Return how many times their bounds these are."""
        return np.asarray(np.abs(self.mean(window)) / self.bounds[window])


def slow_means(
    records: Sequence[Record],
    *,
    healthy: Sequence[Span],
    excursions: Sequence[Excursion] = (),
    is_driven: bool,
    least_deg_s: float = LEAST_DEG_S,
    seconds: ErrorSeconds | None = None,
) -> SlowMeans | None:
    """Compare gyros and attitude over tens of seconds; None where too little of it is healthy.

    Parameters
    ----------
    records : sequence of Record
        In time, with p, q, r, phi, theta and psi.
    healthy : sequence of (start, end)
        What was identified on.
    excursions : sequence of Excursion
        Stretches in which nothing can be told; hard motion alone hides no slow fault.
    is_driven : bool
        Whether the gyros drive the attitude.
    least_deg_s : float
        No smaller mean error raises an alarm.
    seconds : ErrorSeconds, optional
        What `error_seconds` makes of the records, where that is known.

    Examples
    --------
    >>> level = {"p": 0.0, "q": 0.0, "r": 0.0, "phi": 0.0, "theta": 0.0, "psi": 0.0}
    >>> record = Record([list(level.values())] * 2000, channels=list(level), sample_period_s=0.1)
    >>> broken = record.replace("q", np.where(record.time_s < 100.0, 0.0, 1.8))
    >>> found = slow_means([broken], healthy=[(0.0, 60.0)], is_driven=True)
    >>> [(alarm.time_s, alarm.verdict) for alarm in found.alarms]
    [(102.0, 'q failed')]
    """
    start_s = records[0].start_s
    seconds = error_seconds(records, start_s, excursions) if seconds is None else seconds
    usual = seconds_in(healthy, start_s, len(seconds.error))
    errors = mean_errors(seconds, usual)
    if errors is None:
        return None
    compared = SlowMeans(
        start_s=start_s,
        error=errors.error,
        weight=errors.weight,
        bounds=_bounds(errors, usual, max(_FLOOR_DEG_S, least_deg_s)),
        is_watched=~usual,
        is_driven=is_driven,
    )
    alarms = tuple(_alarm(number, compared, seconds, fault) for number, fault in enumerate(_faults(compared)))
    return replace(compared, alarms=alarms)


def beyond(alarms: Sequence[Alarm], told: Sequence[Alarm]) -> list[Alarm]:
    """Return what slow tests tell beyond some alarms: what one of these names, or leaves open, already is left out.

    Parameters
    ----------
    alarms, told : sequence of Alarm
    """
    sure = [alarm for alarm in alarms if alarm.accuses]
    return [each for each in told if not any(_is_told(each, alarm) for alarm in sure)]


def but_beside(told: Sequence[Alarm], alarms: Sequence[Alarm]) -> tuple[Alarm, ...]:
    """Return alarms of slow tests that name no gyro while another's residual rose: a bent attitude shows in all.

    Parameters
    ----------
    told : sequence of Alarm
    alarms : sequence of Alarm
        The monitor's own.
    """
    left = [alarm for alarm in alarms if not alarm.has_passed and alarm.test != OUTSIDE]  # which isn't judged there

    def doubted(slow: Alarm) -> Alarm:
        beside = next((each for each in left if each.source != slow.source and _overlap(slow, each)), None)
        if beside is None or slow.last is None or not slow.accuses:
            return slow
        doubt = f"{slow.source} differs from the attitude, but {beside.source} rose, too: it may be bent"
        judged = replace(slow.last, sensor=None, doubt=doubt, reason=f"{beside.source} rose at {beside.time_s:.1f} s")
        return replace(slow, judgements=(judged,))

    return tuple(map(doubted, told))


def _overlap(slow: Alarm, alarm: Alarm) -> bool:
    """Tell whether two alarms tell of one time."""
    until_s = np.inf if slow.ended_s is None else slow.ended_s
    ended_s = np.inf if alarm.ended_s is None else alarm.ended_s
    return alarm.onset_s <= until_s and ended_s >= slow.onset_s


def _is_told(slow: Alarm, alarm: Alarm) -> bool:
    """Tell whether an alarm is of the same axis, and its fault there while the mean was off."""
    return _overlap(slow, alarm) and (slow.sensor is None or slow.sensor in alarm.candidates)


def mean_error_deg_s(alarm: Alarm) -> float | None:
    """Return how far a gyro reads off on average, as far as an alarm's last judgement says; None where it says nothing.

    >>> judged = Judgement(time_s=30.0, sensor="p", candidates=("p",), kind="drift", parameters={"slope": -0.02})
    >>> mean_error_deg_s(Alarm(number=0, time_s=12.0, onset_s=10.0, source="p", judgements=(judged,)))
    0.4
    """
    last = alarm.last
    if last is None or last.kind not in (Bias.kind, Drift.kind) or not last.candidates:
        return None
    likeliest = last.sensor or last.candidates[0]
    if likeliest in ATTITUDE:  # whose drift is a gyro's bias
        return abs(last.parameters["slope"]) if last.kind == Drift.kind else None
    if likeliest not in GYROS:
        return None
    if last.kind == Bias.kind:
        return abs(last.parameters["size"])
    return abs(last.parameters["slope"]) * max(last.time_s - last.parameters.get("onset_s", alarm.onset_s), 0.0)


# ---- bounds ----


def _bounds(errors: MeanErrors, usual: BoolArray, floor: float) -> dict[int, FloatArray]:
    """Return what healthy means don't exceed.

    Where a window hardly fits into what is healthy, its few means count together with what a shorter one's largest
    comes to.
    """
    bounds: dict[int, FloatArray] = {}
    largest, before = np.full(3, np.inf), WINDOWS[0]
    for window in WINDOWS:
        means, deviation = errors.mean(window), errors.deviation(window)
        within = trailing_means(usual.astype(np.float64), window) == 1.0
        healthy = np.abs(means / deviation)[within & np.isfinite(means).any(axis=1)]
        own_largest = np.nanmax(healthy, axis=0, initial=0.0)
        of_shorter = largest * (window / before) ** _GROWS_AS
        largest, before = own_largest if len(healthy) >= window else np.maximum(own_largest, of_shorter), window
        bounds[window] = np.maximum(floor, np.maximum(_OF_HEALTHY * largest, _DEVIATIONS) * deviation)
    return bounds


# ---- faults ----


@dataclass(frozen=True, kw_only=True)
class _Fault:
    """A stretch in which one gyro's error is the largest: since when, when known, until when; others that rose, too."""

    axis: int
    onset: int
    known: int
    stop: int
    lasts: bool
    others: tuple[int, ...]


def _faults(compared: SlowMeans) -> Iterator[_Fault]:
    """Give the stretches in which means of any gyro stand above their bounds; those that overlap are one."""
    rises = [(known, onset, stop, axis) for axis in range(3) for onset, known, stop in _rises(compared, axis)]
    groups: list[list[tuple[int, int, int, int]]] = []
    for rise in sorted(rises):
        if groups and rise[1] < max(stop for _, _, stop, _ in groups[-1]):
            groups[-1].append(rise)
        else:
            groups.append([rise])
    end = len(compared.error)
    for group in groups:
        angles = [abs(_summed(compared, axis, onset, stop)) for _, onset, stop, axis in group]
        _, onset, stop, axis = group[int(np.argmax(angles))]
        others = tuple(sorted({each[3] for each in group} - {axis}))
        yield _Fault(
            axis=axis,
            onset=onset,
            known=min(each[0] for each in group if each[3] == axis),
            stop=stop,
            lasts=stop >= end - 1,
            others=others,
        )


def _rises(compared: SlowMeans, axis: int) -> Iterator[tuple[int, int, int]]:
    """Give since when an error lasts, when it is known, and when it has ended, in seconds."""
    excess = {window: np.nan_to_num(compared.excess(window)[:, axis]) for window in WINDOWS}
    most = np.max(list(excess.values()), axis=0)
    starts, ends = runs(np.asarray(most > _LASTS))
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        risen = np.flatnonzero((most[start:end] > 1.0) & compared.is_watched[start:end])
        if len(risen):
            known = start + int(risen[0])
            window = next(window for window in WINDOWS if excess[window][known] > 1.0)
            yield _onset(compared, axis, known, window), known, end


def _onset(compared: SlowMeans, axis: int, known: int, window: int) -> int:
    """Return the second since which most is wrong of those whose mean has risen."""
    first = max(known - window + 1, 0)
    own = np.nan_to_num(compared.error[first : known + 1, axis])
    wrong = np.sign(own.sum()) * own - 0.5 * compared.bounds[window][known, axis]
    return first + int(np.argmax(np.cumsum(wrong[::-1])[::-1]))


def _summed(compared: SlowMeans, axis: int, onset: int, stop: int) -> float:
    """Return the angle, in deg, by which the attitude would be off at last if the gyro were right."""
    return float(np.nansum(compared.error[onset:stop, axis]) * SECOND_S)


def _alarm(number: int, compared: SlowMeans, seconds: ErrorSeconds, fault: _Fault) -> Alarm:
    """Return the alarm of an error, with what is known of it as soon as it is."""
    gyro, angle = GYROS[fault.axis], ATTITUDE[fault.axis]
    told_s = compared.start_s + (fault.known + 1) * SECOND_S
    judged = _doubted(compared, fault, told_s)
    for stop in range(fault.known + 1, fault.stop + 1):
        if (sensor := _judged(compared, seconds, fault, stop)) is not None:
            judged_s = compared.start_s + stop * SECOND_S
            judged = _decided(compared, fault, sensor, angle, judged_s)
            break
    return Alarm(
        number=number,
        time_s=told_s,
        onset_s=compared.start_s + fault.onset * SECOND_S,
        source=gyro,
        test=SLOW,
        judgements=(judged,),
        ended_s=None if fault.lasts else compared.start_s + fault.stop * SECOND_S,
    )


def _judged(compared: SlowMeans, seconds: ErrorSeconds, fault: _Fault, stop: int) -> str | None:
    """Return who is wrong by what is known until a second: the gyro's name, "" for it or the angle, or None."""
    part = compared.error[fault.onset : stop]
    own = part[np.isfinite(part[:, fault.axis]), fault.axis]
    if len(own) < max(_NAMED_S, _WHOLE * len(part)) or abs(float(own.mean())) < _NAMED_DEG_S:
        return None
    mean, off = float(own.mean()), abs(float(own.sum()) * SECOND_S)
    is_heading = fault.axis == 2
    weights = np.nan_to_num(np.abs(part[:, fault.axis]))
    upright = float(np.nansum(weights * seconds.up[fault.onset : stop, fault.axis]) / weights.sum())
    if not is_heading and upright > _UPRIGHT:
        return None  # a heading that is corrected, as after a fault of r, turns about this axis
    beside = [abs(float(np.nanmean(part[:, axis]))) for axis in range(3) if np.isfinite(part[:, axis]).any()]
    turning = np.linalg.norm(np.delete(np.nanmean(seconds.motion[fault.onset : stop], axis=0), fault.axis))
    is_even = min(float(np.median(own)), float(own[-_LATELY_S:].mean()), key=abs) / mean > _EVEN  # and lasts
    is_alone = sorted(beside)[-2] < _BESIDE * abs(mean) if len(beside) > 1 else True
    if not (is_even and is_alone and abs(mean) > _TURNING * float(turning)):
        return None
    if compared.is_driven and off > (_HEADING_DEG if is_heading else _NAMED_DEG):
        return GYROS[fault.axis]
    return "" if off > (_OPEN_DEG if is_heading or not compared.is_driven else np.inf) else None


def _decided(compared: SlowMeans, fault: _Fault, sensor: str, angle: str, judged_s: float) -> Judgement:
    gyro = GYROS[fault.axis]
    kind, parameters = _kind(compared, fault)
    return Judgement(
        time_s=judged_s,
        sensor=sensor or None,
        candidates=(gyro,) if sensor else (gyro, angle),
        kind=kind,
        parameters=parameters,
        reason="" if sensor else f"a drift of {angle} explains it as well",
    )


def _kind(compared: SlowMeans, fault: _Fault) -> tuple[str, dict[str, float]]:
    """Return what an error is like: a bias, or a drift that grows by more than its mean."""
    part = compared.error[fault.onset : fault.stop, fault.axis]
    known = np.flatnonzero(np.isfinite(part))
    slope, _ = np.polyfit(known * SECOND_S, part[known], 1)
    mean, onset_s = float(part[known].mean()), compared.start_s + fault.onset * SECOND_S
    if slope * mean > 0.0 and abs(slope) * len(part) * SECOND_S > _GROWS * abs(mean):
        return "drift", {"slope": float(slope), "onset_s": onset_s}
    return "bias", {"size": mean, "onset_s": onset_s}


def _doubted(compared: SlowMeans, fault: _Fault, told_s: float) -> Judgement:
    gyro, angle = GYROS[fault.axis], ATTITUDE[fault.axis]
    part = compared.error[fault.onset : fault.stop, fault.axis]
    return Judgement(
        time_s=told_s,
        sensor=None,
        candidates=(gyro, angle),
        doubt=f"the means of {gyro} and of the attitude differ by {abs(float(np.nanmean(part))):.2g} deg/s "
        f"for {len(part)} s",
        reason="too little to tell the gyro from the attitude",
    )
