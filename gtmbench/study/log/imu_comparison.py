"""Several IMUs: each held against the others and against the attitude, so that of two that disagree one can be named.

Two gyros that part tell that one of them is wrong, not which. Three may vote. Else the attitude tells, but it is an
estimator's, and one of the gyros drives it: at first it follows that gyro's fault, and the healthy one seems to lie.
Within its time constant other sensors correct it. So it is asked late, and only of tilt: heading is corrected slowly.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm, Judgement
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.imus import Imu
from gtmbench.intake.open import open_log
from gtmbench.intake.read import ReadLog
from gtmbench.intake.units import unit
from gtmbench.study.log.seconds import FEWEST, SECOND_S, beyond_gains, rows_by_second, seconds_in, trailing_means
from gtmbench.study.log.self_check.motion import attitude_rates
from gtmbench.values.channels import ATTITUDE, GYROS, axis_of
from gtmbench.values.record import BoolArray, FloatArray, Record, Span

BETWEEN, HELD = "between IMUs", "held"  # tests of such alarms
SAME = "the other IMUs read the same"
APART = "the IMUs disagree about its axis"
SHAKEN = "the means of the IMUs agree, and only noise differs: vibration"
_FASTEST_HZ = 25.0
_LONGEST_S = 2e4  # of a log that is compared
_MOST_IMUS, _MOST = 3, 6
_WINDOWS = (1, 2, 4, 8)  # blocks whose mean is judged ...
_APART, _MINUTE, _FEWEST_BEFORE = 5, 60, 10  # ... against the median of the minute before, five seconds earlier
_LEAST_DEG_S, _OF_HEALTHY, _DEVIATIONS, _OF_MOTION = 0.3, 1.5, 8.0, 0.03
_SLOW_DEG_S = 0.5  # off what it was at first: a slow drift, which a median of the minute before swallows
_NOISY = ("noise", "spikes", "oscillation", "random_walk", "unknown")  # kinds that vibration looks like
_VOTE, _ALIKE, _EITHER_HALF = 8, 0.25, 0.3
_LATE = (15, 40)  # blocks after the onset: an estimator has been corrected
_ENOUGH_LATE, _FEWEST_SHIFTS, _ABOVE = 15, 3, 4.0
_WAVERS, _WAVERS_LATE = 0.75, 0.5  # of its late mean, what differs may in five seconds
_LIES, _TELLS_TRUTH = 0.8, 0.2  # shares of the difference that a gyro's distance from the attitude has
_STILL, _MOVES, _HELD_BLOCKS = 1e-3, 0.25, 2  # of what a gyro ranges over in a block, where healthy
_SOON_S = 10.0
_QUIET, _LOUD = 0.25, 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """What the IMUs of a log say of each other.

    Attributes
    ----------
    imus : tuple of Imu
    watched : Imu or None
        The one whose p, q and r the monitor watches; None where it isn't one of them.
    alarms : tuple of Alarm
        Where two part, or one is held; its `judgements` name the channel and the IMU, or doubt.
    """

    imus: tuple[Imu, ...]
    watched: Imu | None
    alarms: tuple[Alarm, ...]
    blocks: _Blocks = field(repr=False)

    def parting(self) -> list[tuple[str, FloatArray, FloatArray]]:
        """Return what the channels differ by that part, second by second: which, times, in deg/s."""
        channels = {name for alarm in self.alarms for name in alarm.candidates}
        seconds = np.arange(len(self.blocks.motion), dtype=np.float64) + 0.5
        time_s = np.asarray(self.blocks.start_s + seconds * SECOND_S)
        return [
            (f"{name} of {self.imus[i].name} - {self.imus[j].name}", time_s, difference[:, axis])
            for axis, name in enumerate(GYROS)
            if name in channels
            for (i, j), difference in self.blocks.differences.items()
        ]

    def agree(self, alarm: Alarm) -> bool:
        """Tell whether the others read what the watched IMU reads while an alarm says that its gyro is wrong."""
        if self.watched is None or alarm.sensor not in GYROS or alarm.last is None:
            return False
        axis, own = GYROS.index(alarm.sensor), self.imus.index(self.watched)
        rows = self.blocks.rows(alarm.onset_s, max(alarm.last.time_s, alarm.onset_s + _VOTE))
        apart = self.blocks.from_attitude[own][:, axis]
        usual = _rms(apart[self.blocks.healthy])
        pairs = [each[:, axis] for pair, each in self.blocks.differences.items() if own in pair]
        beside = [_rms(each[rows]) for each in pairs]
        here = _rms(apart[rows])
        return here > _LOUD * usual and all(size < _QUIET * here for size in beside)

    def only_shakes(self, alarm: Alarm) -> bool:
        """Tell whether the means of the watched IMU and of all others agree while an alarm says that it is noisy."""
        if self.watched is None or alarm.sensor not in GYROS or alarm.last is None or alarm.last.kind not in _NOISY:
            return False
        axis, own = GYROS.index(alarm.sensor), self.imus.index(self.watched)
        rows = self.blocks.rows(alarm.onset_s, max(alarm.last.time_s, alarm.onset_s + _VOTE))
        for pair, difference in self.blocks.differences.items():
            means = np.abs(trailing_means(difference[:, axis], _WINDOWS[-1]))
            if own in pair and not np.nanmax(means[rows], initial=0.0) < _bound(means, self.blocks):
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class _Blocks:
    """Means over a second, without what two healthy gyros differ by; NaN where nothing can be told."""

    start_s: float
    healthy: BoolArray
    motion: FloatArray  # deg/s, of all axes
    differences: Mapping[tuple[int, int], FloatArray]  # of two IMUs, shape (blocks, 3)
    from_attitude: Sequence[FloatArray]  # of an IMU
    ranges: Sequence[FloatArray]  # of an IMU's readings within a second

    def rows(self, start_s: float, end_s: float) -> slice:
        first, last = (int((time_s - self.start_s) // SECOND_S) for time_s in (start_s, end_s))
        return slice(max(first, 0), max(last + 1, 0))

    def time_s(self, row: int) -> float:
        return self.start_s + row * SECOND_S


def compare(
    log: FlightLog, side_by_side: FlightLog, *, healthy: Sequence[Span], excursions: Sequence[Excursion] = ()
) -> Comparison | None:
    """Hold the IMUs of a log against each other; None where too little is there.

    Parameters
    ----------
    log : FlightLog
    side_by_side : FlightLog
        The same, as `opened_with` opens it.
    healthy : sequence of (start, end)
        What is taken as healthy: how two IMUs differ there is theirs.
    excursions : sequence of Excursion
        Stretches in which nothing can be told.
    """
    imus = log.imus[:_MOST_IMUS]
    watched = watched_imu(log, imus)
    return compared(side_by_side.segments, imus, healthy=healthy, excursions=excursions, watched=watched)


def compared(
    records: Sequence[Record],
    imus: Sequence[Imu],
    *,
    healthy: Sequence[Span],
    excursions: Sequence[Excursion] = (),
    watched: Imu | None = None,
) -> Comparison | None:
    """Do so with records that hold every IMU's gyros (`channels_of`) and the attitude; None where too little is there.

    Parameters
    ----------
    records : sequence of Record
        In time.
    imus : sequence of Imu
    healthy, excursions
        As `compare` takes them.
    watched : Imu, optional
        The one that the monitor watches.
    """
    if records[-1].end_s - records[0].start_s > _LONGEST_S:
        return None
    blocks = _blocks(records, imus, healthy, excursions)
    if np.count_nonzero(blocks.healthy & np.isfinite(blocks.motion)) < FEWEST:
        return None
    found = sorted([*_parted(blocks, imus), *_still_gyros(blocks, imus)], key=lambda alarm: alarm.time_s)
    alarms = tuple(replace(alarm, number=number, fault=number) for number, alarm in enumerate(found[:_MOST]))
    return Comparison(imus=tuple(imus), watched=watched, alarms=alarms, blocks=blocks)


def beside(watches: Iterable[Watch], comparison: Comparison | None) -> list[Watch]:
    """Return watches whose judgements say of which IMU they are, and doubt what the other IMUs contradict."""
    if comparison is None:
        return list(watches)
    return [replace(watch, alarms=tuple(_beside(alarm, comparison) for alarm in watch.alarms)) for watch in watches]


def further(alarms: Sequence[Alarm], comparison: Comparison | None) -> list[Alarm]:
    """Return what the comparison tells beyond some alarms: those that say the same of the same IMU are left out."""
    told = () if comparison is None else comparison.alarms
    return [each for each in told if not any(_is_same(each, alarm) for alarm in alarms)]


def _is_same(told: Alarm, alarm: Alarm) -> bool:
    if told.last is None or alarm.last is None or alarm.doubt or told.doubt:
        return False
    same = (told.sensor, told.last.imu) == (alarm.sensor, alarm.last.imu)
    return same and abs(told.onset_s - alarm.onset_s) <= _SOON_S


def _beside(alarm: Alarm, comparison: Comparison) -> Alarm:
    if alarm.last is None or alarm.sensor is None or alarm.doubt or alarm.test == MISSING:
        return alarm
    near = [each for each in comparison.alarms if abs(each.onset_s - alarm.onset_s) <= _SOON_S]
    axes = {axis_of(name) for each in near for name in each.candidates}
    if alarm.sensor in GYROS and comparison.agree(alarm):
        return with_doubt(alarm, SAME)
    if alarm.sensor in GYROS and comparison.only_shakes(alarm):
        return with_doubt(alarm, SHAKEN)
    if alarm.sensor in ATTITUDE and axis_of(alarm.sensor) in axes:
        return with_doubt(alarm, APART)
    if alarm.sensor not in GYROS or comparison.watched is None:
        return alarm
    named = {(each.sensor, each.last.imu) for each in near if each.last is not None and each.sensor == alarm.sensor}
    if named and (alarm.sensor, comparison.watched.name) not in named:
        return with_doubt(alarm, APART)
    return of_watched(alarm, comparison)


def of_watched(alarm: Alarm, comparison: Comparison | None) -> Alarm:
    """Return an alarm that says of which IMU the gyro is that it names: of the one that is watched."""
    if comparison is None or comparison.watched is None:
        return alarm
    own = comparison.watched.name
    return replace(
        alarm,
        judgements=tuple(replace(judged, imu=own) if judged.sensor in GYROS else judged for judged in alarm.judgements),
    )


def with_doubt(alarm: Alarm, doubt: str) -> Alarm:
    """Return an alarm that may be no fault after all, and why."""
    judged = alarm.judgements[-1].doubted(doubt)
    return replace(alarm, judgements=(*alarm.judgements, judged), ended_s=None, end_known_s=None)


def watched_imu(log: FlightLog, imus: Sequence[Imu]) -> Imu | None:
    """Return the IMU whose gyros are a log's p, q and r; None where none of them is."""
    columns = {source.column for source in log.sources if source.channel in GYROS}
    return next((imu for imu in imus if set(imu.columns) & columns), None)


def opened_with(read: ReadLog, imus: Sequence[Imu], mapping: Sequence[str]) -> FlightLog | None:
    """Return a log with the gyros of its first IMUs and the attitude on one clock; None where that can't be had."""
    imus = imus[:_MOST_IMUS]
    pairs = [pair for imu in imus for pair in zip(channels_of(imu), imu.columns, (imu.unit,) * 3, strict=True)]
    maps = [*mapping, *(f"{name}={column}:{stated}" for name, column, stated in pairs)]
    needs = [*(name for name, _, _ in pairs), *ATTITUDE]
    try:
        opened = open_log(read, mapping=maps, needs=needs)
        if opened.sample_period_s < 0.99 / _FASTEST_HZ:
            opened = open_log(read, mapping=maps, needs=needs, rate_hz=_FASTEST_HZ)
    except InputError:
        return None
    return opened


def channels_of(imu: Imu) -> list[str]:
    """Return what the gyros of an IMU are called, side by side with others."""
    return [f"{channel} of {imu.name}" for channel in GYROS]


# ---- seconds ----


def _blocks(
    segments: Sequence[Record], imus: Sequence[Imu], healthy: Sequence[Span], excursions: Sequence[Excursion]
) -> _Blocks:
    start_s = segments[0].start_s
    count = int((segments[-1].end_s - start_s) / SECOND_S) + 1
    gyros = np.full((len(imus), count, 3), np.nan)
    spans = np.full((len(imus), count, 3), np.nan)
    attitude = np.full((count, 3), np.nan)
    for record in segments:
        turned = attitude_rates(record)
        full = list(rows_by_second(record, start_s))
        for number, imu in enumerate(imus):
            known = unit(imu.unit)
            values = record.matrix(channels_of(imu)) * (known.factor if known else 1.0)
            for row, part in full:
                gyros[number, row] = values[part].mean(axis=0)
                spans[number, row] = np.ptp(values[part], axis=0)
        for row, part in full:
            attitude[row] = turned[part].mean(axis=0)
    for each in excursions:
        first, last = (int((time_s - start_s) // SECOND_S) for time_s in (each.start_s, each.end_s))
        out = slice(max(first - 1, 0), max(last + 2, 0))
        gyros[:, out], attitude[out] = np.nan, np.nan
    motion = gyros.mean(axis=0)
    within = seconds_in(healthy, start_s, count)
    calm = np.asarray(within & np.isfinite(motion).all(axis=1), dtype=np.bool_)
    pairs = list(combinations(range(len(imus)), 2))
    return _Blocks(
        start_s=start_s,
        healthy=calm,
        motion=np.linalg.norm(motion, axis=1),
        differences={(i, j): beyond_gains(gyros[i] - gyros[j], motion, calm) for i, j in pairs},
        from_attitude=[beyond_gains(gyros[i] - attitude, motion, calm) for i in range(len(imus))],
        ranges=list(spans),
    )


# ---- parting ----


def _parted(blocks: _Blocks, imus: Sequence[Imu]) -> Iterator[Alarm]:
    """Give where two IMUs part, an alarm an axis and a time."""
    for axis, channel in enumerate(GYROS):
        rises = sorted(
            (row, onset, pair, is_slow)
            for pair, difference in blocks.differences.items()
            for is_slow, find in ((False, _rises), (True, _slow_rises))
            for row, onset in find(difference[:, axis], blocks)
        )
        last = -np.inf
        for row, onset, pair, is_slow in rises:
            if row - last > _MINUTE:
                last = row
                yield _judged(blocks, imus, channel, pair, row, onset, is_slow=is_slow)


def _slow_rises(values: FloatArray, blocks: _Blocks) -> list[tuple[int, int]]:
    """Return the rows at which a mean leaves what it was at first, and since when it has."""
    off, motion = np.abs(trailing_means(values, _VOTE)), trailing_means(blocks.motion, _VOTE)
    far = np.asarray(~blocks.healthy & (off > max(_SLOW_DEG_S, _bound(off, blocks)) + _OF_MOTION * motion))
    return [(row, row - _VOTE + 1) for row in np.flatnonzero(np.diff(far, prepend=False) & far).tolist()]


def _rises(values: FloatArray, blocks: _Blocks) -> list[tuple[int, int]]:
    """Return the rows at which a mean has left what it was before, and since when."""
    before = _before(values)
    first: dict[int, int] = {}
    for window in _WINDOWS:
        moved, motion = _moved(values, before, window), trailing_means(blocks.motion, window)
        least = _LEAST_DEG_S * math.sqrt(_WINDOWS[-1] / window)  # vibration that samples alias averages out so
        risen = np.flatnonzero(~blocks.healthy & (moved > max(_bound(moved, blocks), least) + _OF_MOTION * motion))
        for row in risen.tolist():
            first[row] = max(first.get(row, 0), row - window + 1)
    return sorted(first.items())


def _moved(values: FloatArray, before: FloatArray, window: int) -> FloatArray:
    """Return how far the mean of so many blocks is off what it was before."""
    earlier = np.concatenate([np.full(window - 1, np.nan), before[: len(before) - window + 1]])
    return np.asarray(np.abs(trailing_means(values, window) - earlier[: len(values)]))


def _bound(moved: FloatArray, blocks: _Blocks) -> float:
    """Return what such means don't reach by chance; infinite where too little is healthy."""
    usual = moved[blocks.healthy & np.isfinite(moved)]
    if len(usual) < FEWEST:
        return np.inf
    return max(_LEAST_DEG_S, _OF_HEALTHY * float(usual.max()), _DEVIATIONS * 1.4826 * float(np.median(usual)))


def _before(values: FloatArray) -> FloatArray:
    """Return the median of the minute before each block, that ended five seconds earlier; zero where that is short."""
    padded = np.concatenate([np.full(_MINUTE + _APART, np.nan), values])
    earlier = np.sort(np.lib.stride_tricks.sliding_window_view(padded, _MINUTE)[: len(values)], axis=1)
    count = np.isfinite(earlier).sum(axis=1)  # those that are missing stand last
    rows = np.arange(len(values))
    low, high = (earlier[rows, np.clip(place, 0, _MINUTE - 1)] for place in ((count - 1) // 2, count // 2))
    return np.where(count >= _FEWEST_BEFORE, 0.5 * (low + high), 0.0)


def _judged(
    blocks: _Blocks,
    imus: Sequence[Imu],
    channel: str,
    pair: tuple[int, int],
    row: int,
    onset: int,
    *,
    is_slow: bool,
) -> Alarm:
    """Return the alarm of two IMUs that part: named by a vote of three, else by the attitude, else doubted.

    Where they part slowly, by what they were at first, and the attitude isn't asked.
    """
    axis = GYROS.index(channel)
    start_s, told_s = blocks.time_s(onset), blocks.time_s(row + 1)
    size = _shift(blocks.differences[pair][:, axis], onset, (0, _VOTE), is_slow=is_slow)
    if not np.isfinite(size):  # too little is known before
        size = float(np.nanmean(blocks.differences[pair][onset : row + 1, axis]))
    names = " and ".join(imus[number].name for number in pair)
    liar, judged_s = _voted_out(blocks, imus, axis, onset, is_slow=is_slow), max(told_s, blocks.time_s(onset + _VOTE))
    why = f"{names} part by {abs(size):.2g} deg/s"
    if liar is None and is_slow:
        why = f"{why}, slowly, and which is wrong can't be told"
    elif liar is None:
        liar, reason = _against_attitude(blocks, axis, pair, onset)
        judged_s = max(told_s, blocks.time_s(min(onset + _LATE[1], len(blocks.motion))))
        why = f"{why}, and which is wrong can't be told: {reason}" if reason else why
    named = liar is not None
    judged = Judgement(
        time_s=judged_s,
        sensor=channel if named else None,
        candidates=(channel,),
        imu=imus[liar].name if liar is not None else "",
        doubt="" if named else why,
        parameters={"size": abs(size)} if named and np.isfinite(size) else {},
    )
    return Alarm(
        number=0, time_s=told_s, onset_s=start_s, source=f"{channel} of {names}", test=BETWEEN, judgements=(judged,)
    )


def _shift(values: FloatArray, onset: int, late: tuple[int, int], *, is_slow: bool = False) -> float:
    """Return by how much a mean after an onset is off the median of the minute before; or off what it was at first."""
    part = values[onset + late[0] : onset + late[1]]
    part = part[np.isfinite(part)]
    earlier = values[max(onset - _APART - _MINUTE, 0) : max(onset - _APART, 0)]
    earlier = earlier[np.isfinite(earlier)]
    if len(part) < min(_ENOUGH_LATE, (late[1] - late[0]) // 2) or (len(earlier) < _FEWEST_BEFORE and not is_slow):
        return np.nan
    return float(part.mean() - (0.0 if is_slow else np.median(earlier)))


def _lasts(values: FloatArray, onset: int, late: tuple[int, int], *, is_slow: bool) -> bool:
    """Tell whether it is so in both halves: noise has no such mean."""
    middle, whole = sum(late) // 2, _shift(values, onset, late, is_slow=is_slow)
    halves = [_shift(values, onset, part, is_slow=is_slow) for part in ((late[0], middle), (middle, late[1]))]
    return bool(min(half / whole for half in halves) > _EITHER_HALF) if whole else False


def _is_steady(values: FloatArray, onset: int) -> bool:
    """Tell whether it has been about so ever since: an estimator follows what is fresh, or comes and goes."""
    whole = _shift(values, onset, _LATE)
    earlier = values[max(onset - _APART - _MINUTE, 0) : max(onset - _APART, 0)]
    shares = (values - np.nanmedian(earlier)) / whole
    for first in range(_APART, _LATE[1], _APART):
        part = shares[onset + first : onset + first + _APART]
        part = part[np.isfinite(part)]
        wavers = _WAVERS_LATE if first >= _LATE[0] else _WAVERS
        if len(part) > _APART // 2 and abs(part.mean() - 1.0) > wavers:
            return False
    return True


def _voted_out(blocks: _Blocks, imus: Sequence[Imu], axis: int, onset: int, *, is_slow: bool) -> int | None:
    """Return the IMU that parts from all others while these agree."""
    if len(imus) < 3:
        return None
    values = {pair: each[:, axis] for pair, each in blocks.differences.items()}
    shifts = {pair: abs(_shift(each, onset, (0, _VOTE), is_slow=is_slow)) for pair, each in values.items()}
    earlier = {pair: np.zeros(len(each)) if is_slow else _before(each) for pair, each in values.items()}
    parted = {
        pair: shifts[pair] > _bound(_moved(each, earlier[pair], _VOTE), blocks)
        and _lasts(each, onset, (0, _VOTE), is_slow=is_slow)
        for pair, each in values.items()
    }
    for number in range(len(imus)):
        own, others = [pair for pair in values if number in pair], [pair for pair in values if number not in pair]
        least = min(shifts[pair] for pair in own)
        if all(parted[pair] for pair in own) and max(shifts[pair] for pair in others) < _ALIKE * least:
            return number
    return None


def _against_attitude(blocks: _Blocks, axis: int, pair: tuple[int, int], onset: int) -> tuple[int | None, str]:
    """Return which of two the attitude contradicts, late, and why that isn't known otherwise."""
    if GYROS[axis] == "r":
        return None, "an estimator's heading follows its gyro for long"
    difference = _shift(blocks.differences[pair][:, axis], onset, _LATE)
    distances = [blocks.from_attitude[number][:, axis] for number in pair]
    first = _shift(distances[0], onset, _LATE)
    usual = [_usual_shift(each, onset) for each in distances]
    if not np.isfinite([difference, first, *usual]).all():
        return None, "too little is known before, or after"
    if abs(difference) < max(_ABOVE * max(usual), _LEAST_DEG_S):
        return None, "the attitude isn't good enough for so little, or it has gone"
    if not _is_steady(blocks.differences[pair][:, axis], onset):
        return None, "it isn't steady"
    share = first / difference
    if _LIES <= share <= 2.0 - _LIES:
        return pair[0], ""
    if abs(share) <= _TELLS_TRUTH:
        return pair[1], ""
    return None, "the attitude stands between them"


def _usual_shift(values: FloatArray, onset: int) -> float:
    """Return the largest such shift before an onset."""
    found = [abs(_shift(values, row, _LATE)) for row in range(_FEWEST_BEFORE + _APART, onset - _LATE[1], 5)]
    known = [size for size in found if np.isfinite(size)]
    return max(known) if len(known) >= _FEWEST_SHIFTS else np.nan


# ---- held readings ----


def _still_gyros(blocks: _Blocks, imus: Sequence[Imu]) -> Iterator[Alarm]:
    """Give the gyros whose readings stand still while others' of the same axis move, not just by their noise.

    On the ground, noise of less than a step leaves a healthy gyro's readings at one value for seconds.
    """
    for number, imu in enumerate(imus):
        for axis, channel in enumerate(GYROS):
            spans = [each[:, axis] for each in blocks.ranges]
            usual = [np.nanmedian(each[blocks.healthy]) for each in spans]
            still = spans[number] <= _STILL * usual[number]
            others = np.logical_and.reduce(
                [spans[other] >= _MOVES * usual[other] for other in _others(imus, number)]  # not where there is none
            )
            rows = np.flatnonzero(still & others & ~blocks.healthy)
            runs = np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1)
            run = next((run for run in runs if len(run) >= _HELD_BLOCKS), None)
            if run is not None:
                told_s = blocks.time_s(int(run[0]) + _HELD_BLOCKS)
                judged = Judgement(time_s=told_s, sensor=channel, candidates=(channel,), kind="jam", imu=imu.name)
                onset_s = blocks.time_s(int(run[0]))
                yield Alarm(
                    number=0,
                    time_s=told_s,
                    onset_s=onset_s,
                    source=f"{channel} of {imu.name}",
                    test=HELD,
                    judgements=(judged,),
                )


def _others(imus: Sequence[Imu], number: int) -> list[int]:
    return [other for other in range(len(imus)) if other != number]


def _rms(values: FloatArray) -> float:
    there = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(there)))) if len(there) else np.nan
