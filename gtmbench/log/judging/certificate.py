"""What a monitor would have seen on a log: the smallest faults of each sensor that would have alarmed, and been named.

Faults are put on the log that was watched, at times spread over it. Whether one alarms is worked out on its sensor's
own residual alone (`Superposition`); whether it is named, by watching the log about some of these times anew. Where the
gyros drive the attitude, it follows their faults, as the fastest and the slowest plausible estimator makes it; the
worse of the two is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from heapq import heappush, heappushpop
from itertools import islice
from typing import Any

import numpy as np

from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.superposition import Superposition
from gtmbench.detectors.predicting import PredictingMonitor, predicts
from gtmbench.detectors.protocol import Detector, Monitor, Watch
from gtmbench.detectors.surfaces.deviation import WINDOWS_S
from gtmbench.detectors.surfaces.surfaces import SurfaceMonitor
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, inject
from gtmbench.faults.kinds.additive import Bias
from gtmbench.faults.kinds.shaping import ScaleFactor
from gtmbench.faults.registry import grows, loaded_faults
from gtmbench.faults.shape import Shape
from gtmbench.values.attitude_estimators import FASTEST_S, SLOWEST_S, AttitudeEstimator
from gtmbench.values.channels import GYROS
from gtmbench.values.pieces import deviation, pieces

SHARE = 0.9  # of the time watched
ONSETS = 20  # tried
_FINE = 1.15  # from a size that is looked at to the next
_STEPS = 50  # from a thousandth of the largest to that
_NOT_SEEN = _STEPS + 1
_RANGE = 30.0  # times what a sensor and its residual do: the largest fault that is tried
_TURNED = 2.0  # a scale error that turns the sign
_HALF = 0.5  # of the longest time watched: a fault has no longer to alarm
_NAMED_OF = 3  # onsets that are watched anew
_TIMES = (1.0, 1.5, 2.0, 3.0, 5.0)  # the size that is seen
_ARMING_S = 5.0  # before what statistics look back at, where a record is watched anew
_JUDGED_S = 10.5  # after the alarm: when a fault that is to be named has been


@dataclass(frozen=True, kw_only=True)
class TriedKind:
    """A kind of fault that is tried, by one parameter."""

    fault: type[Fault]
    shape: Shape
    within_s: float = 10.0  # how long after its onset it has to alarm

    def at(self, sensor: str, onset_s: float, size: float, *, is_turned: bool) -> Fault:
        """Return the fault of a size, upwards or, where it has two directions and is turned, downwards.

        The size is how far its parameter is from where it changes nothing.
        """
        value = -size if is_turned and self.shape.how in ("linear", "gain") else size
        parameters: dict[str, Any] = {self.shape.figure: self.shape.healthy + value}
        return self.fault(channel=sensor, onset_s=onset_s, **parameters)

    def most(self, on: Sequence[Superposition], within_s: float) -> float:
        """Return the largest size that is tried: by what sensors and residuals do, or by what the kind says."""
        parameter = next(each for each in self.fault.parameters() if each.name == self.shape.figure)
        if self.shape.of == "reach":  # nothing is left
            readings = [each.record[each.sensor] for each in on]
            return max(float(max(np.nanmax(x, initial=0.0), -np.nanmin(x, initial=0.0))) for x in readings)
        if parameter.unit is not None:
            most = self.shape.high or _TURNED
        else:
            done = [deviation(each.record[each.sensor] for each in on), deviation(each.residual.raw for each in on)]
            most = _RANGE * sum(done)
        return most / within_s if self.shape.how == "linear" and grows(self.fault) else most


def kinds() -> tuple[TriedKind, ...]:
    """Return the kinds that certificates have, by what their classes say; noise, which adds no shape, last."""
    found = [
        TriedKind(fault=cls, shape=cls.shape, within_s=cls.typical.certified_s)
        for cls in loaded_faults().values()
        if cls.shape is not None and cls.typical is not None and cls.typical.certified_s is not None
    ]
    return tuple(sorted(found, key=lambda kind: kind.shape.how == "white"))


@dataclass(frozen=True, kw_only=True)
class SmallestSeen:
    """The smallest fault of a kind that would have been seen."""

    sensor: str
    kind: str
    # In the sensor's unit, of a drift in that per second; of a scale factor, how far it is from 1. None where no size
    # would have been seen often enough.
    size: float | None
    share: float  # of the time watched in which one of this size, or of the largest that was tried, would have alarmed
    within_s: float  # how long after its onset
    # from which size on it would have been named, too, and no other sensor; None where not up to five times `size`, or
    # not asked for
    named_from: float | None = None
    # of the estimator through which the fault was put, the worse of those that are plausible; None where the attitude
    # doesn't follow the sensor
    time_constant_s: float | None = None

    @property
    def hardness(self) -> tuple[float, float]:
        """What is greater of a row that promises less: the size, then the share of the time that is left."""
        return np.inf if self.size is None else self.size, -self.share


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """What a monitor would have seen on a log."""

    rows: tuple[SmallestSeen, ...] = field(default=(), repr=False)  # one a sensor and kind
    watched_s: float = 0.0  # how long an alarm was possible, of any residual: what shares are of
    is_named: bool = False  # whether it was asked what would have been named
    missing: str = ""  # why there is none, where there are no rows
    unwatched: tuple[str, ...] = ()  # what has no row although it may fail, and why, each in a line

    def of(self, sensor: str, kind: str) -> SmallestSeen | None:
        """Return the row of a sensor and a kind; None where there is none."""
        return next((row for row in self.rows if (row.sensor, row.kind) == (sensor, kind)), None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Place:
    """Where a fault is put on a sensor: a time of a record that was watched, and by when it has to alarm."""

    monitor: PredictingMonitor
    on: Superposition
    onset_s: float
    within_s: float
    is_telling: bool  # no alarm is there without a fault
    outside: tuple[Excursion, ...] = ()

    def is_seen(self, fault: Fault) -> bool:
        """Tell whether a fault raises an alarm in time."""
        return self.on.alarm_row(fault, self.within_s) is not None

    def names(self, fault: Fault) -> bool:
        """Tell whether the fault's sensor is named, and no other, when the record about it is watched anew."""
        record, sensor = self.on.record, self.on.sensor
        row = self.on.alarm_row(fault, self.within_s)
        if row is None:
            return False
        before_s = self.monitor.basis.looks_back_s + _ARMING_S
        until_s = record.time_at(row) + self.on.residual.ahead * record.sample_period_s + _JUDGED_S
        about = record.between(max(self.onset_s - before_s, record.start_s), min(until_s, record.end_s))
        broken = inject(about, fault)
        if self.on.estimator is not None:
            try:
                broken = self.on.estimator.bent(about, broken)
            except InputError:  # beyond Euler angles, where nobody names anything
                return False
        said = self.monitor.watch(broken, outside=self.outside).faults
        return {alarm.sensor for alarm in said if alarm.sensor is not None and alarm.time_s >= self.onset_s} == {sensor}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """A fault of a kind at a place, of whatever size up to the largest that makes sense."""

    kind: TriedKind
    place: _Place
    is_turned: bool
    most: float

    def fault(self, size: float) -> Fault:
        """Return it with a size."""
        return self.kind.at(self.place.on.sensor, self.place.onset_s, size, is_turned=self.is_turned)

    def is_seen(self, size: float) -> bool:
        """Tell whether it raises an alarm in time that wouldn't be there without it."""
        return self.place.is_telling and self.place.is_seen(self.fault(size))

    def size(self, step: int) -> float:
        """Return a size that is looked at; `_STEPS` is the largest, each is `_FINE` times the one before."""
        return self.most * _FINE ** (step - _STEPS)

    def smallest(self, least: int, near: int) -> int:
        """Return the first step from `least` on whose size is seen; `_NOT_SEEN` where not even the largest is.

        It is looked for from `near` on, by strides that double, then between what is seen and what isn't.
        """
        low, high, stride = (least - 1, near, -1) if self.is_seen(self.size(near)) else (near, _NOT_SEEN, 1)
        while high - low > 1:
            middle = (low + high) // 2
            probe = max(high + stride, middle) if stride < 0 else min(low + stride, middle)
            low, high = (low, probe) if self.is_seen(self.size(probe)) else (probe, high)
            stride *= 2
        return high


def certificate_of(monitor: Monitor | Detector, watches: Sequence[Watch], *, named: bool = False) -> Certificate:
    """Work out what a monitor would have seen on records that it watched.

    `monitor`: one that predicts sensors, or knows surfaces, or there is no certificate. `named`: whether to watch the
    records about some onsets anew, too, to say from which size on a fault would have been named: seconds.

    >>> from gtmbench.detectors.bank.bank import bank_of
    >>> from gtmbench.detectors.bank_detector import calibrate
    >>> from gtmbench.values.record import Record
    >>> noise = np.random.default_rng(1).standard_normal((3000, 2))
    >>> record = Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> bank = bank_of("own", {"residuals": [{"output": "q", "inputs": ["p"]}]})
    >>> monitor = calibrate([record.between(0.0, 60.0)], bank=bank)
    >>> certificate = certificate_of(monitor, [monitor.watch(record.between(60.04, 119.0))])
    >>> bias = certificate.of("q", "bias")
    >>> bias.within_s, bias.share >= 0.9, 0.01 < bias.size < 0.2
    (10.0, True, True)
    """
    if isinstance(monitor, SurfaceMonitor):
        return _of_surfaces(monitor, watches)
    if not predicts(monitor):
        return Certificate(missing=f"{monitor.name} is no bank, so nothing says how a fault would change its scores")
    if not _certified(monitor):
        return Certificate(missing="no sensor that may be suspected has a residual of its own")
    if not any(watch.armed_hours for watch in watches):
        return Certificate(missing="at no time was an alarm possible")
    rows = [
        _hardest(tried, named=named)
        for sensor in _certified(monitor)
        for tried in _trials(monitor, watches, sensor, kinds()).values()
    ]
    missing = "" if rows else "too little of it was watched"
    seconds = sum(3600.0 * watch.armed_hours for watch in watches)
    return Certificate(rows=tuple(rows), watched_s=seconds, is_named=named and bool(rows), missing=missing)


def _certified(monitor: PredictingMonitor) -> list[str]:
    """Return the sensors that have rows: those that may be suspected and have a residual of their own."""
    return [sensor for sensor in monitor.basis.predicts if sensor in monitor.suspects]


def _of_surfaces(monitor: SurfaceMonitor, watches: Sequence[Watch]) -> Certificate:
    """Return the least offset and the least loss of effectiveness of every surface, the worst of all stretches."""
    try:
        sizes = [monitor.sizes(watch.record) for watch in watches]
    except InputError as error:
        return Certificate(missing=str(error))
    within_s, rows = max(WINDOWS_S), []
    for surface in monitor.suspects if sizes else ():
        least = [of[surface] for of in sizes]
        offset, loss = max(each.offset for each in least), max(each.loss for each in least)
        seen = SHARE if loss <= 1.0 else min(each.lost_seen for each in least)
        rows += [
            SmallestSeen(sensor=surface, kind=Bias.kind, size=offset, share=SHARE, within_s=within_s),
            SmallestSeen(
                sensor=surface,
                kind=ScaleFactor.kind,
                size=loss if loss <= 1.0 else None,
                share=seen,
                within_s=within_s,
            ),
        ]
    return Certificate(
        rows=tuple(rows),
        watched_s=sum(3600.0 * watch.armed_hours for watch in watches),
        unwatched=tuple(f"{name} is not watched: {why}" for name, why in monitor.unwatched.items()),
    )


def _estimators(monitor: PredictingMonitor, sensor: str) -> tuple[AttitudeEstimator | None, ...]:
    """Return what may make the attitude that follows a sensor: the slowest and the fastest; None where nothing does."""
    is_driven = monitor.basis.attitude_from_gyros
    if not is_driven or sensor not in GYROS or not {"phi", "theta"} <= set(monitor.channels):
        return (None,)
    return tuple(AttitudeEstimator(time_constant_s=tau) for tau in (SLOWEST_S, FASTEST_S))


def _trials(
    monitor: PredictingMonitor, watches: Sequence[Watch], sensor: str, kinds: Sequence[TriedKind]
) -> dict[TriedKind, list[list[_Trial]]]:
    """Return a sensor's trials by kind, on its own residual, put through each of the estimators that may bend it.

    No kind has any where too little was watched.
    """
    longest_s = round(_HALF * max((3600.0 * watch.armed_hours for watch in watches), default=0.0), 1)
    if longest_s <= 0.0:
        return {}
    on = [monitor.superposition(watch, sensor) for watch in watches]
    through = [[replace(each, estimator=by) for each in on] for by in _estimators(monitor, sensor)]
    places: dict[float, list[list[_Place]]] = {}
    tried = {}
    for kind in kinds:
        within_s = min(kind.within_s, longest_s)
        if within_s not in places:
            places[within_s] = _places(monitor, through, watches, within_s)
        if places[within_s][0]:
            most = kind.most(on, within_s)
            tried[kind] = [
                [_Trial(kind=kind, place=place, is_turned=bool(i % 2), most=most) for i, place in enumerate(each)]
                for each in places[within_s]
            ]
    return tried


def _places(
    monitor: PredictingMonitor, through: Sequence[Sequence[Superposition]], watches: Sequence[Watch], within_s: float
) -> list[list[_Place]]:
    """Return where faults are put, through each of some estimators; each has to alarm within some seconds."""
    onsets = _onsets(watches, within_s)
    quiet = [through[0][i].is_quiet(row, within_s) for i, row in onsets]
    return [
        [
            _Place(
                monitor=monitor,
                on=each[i],
                onset_s=watches[i].record.time_at(row),
                within_s=within_s,
                is_telling=is_telling,
                outside=watches[i].outside,
            )
            for (i, row), is_telling in zip(onsets, quiet, strict=True)
        ]
        for each in through
    ]


def _hardest(tried: Sequence[Sequence[_Trial]], *, named: bool) -> SmallestSeen:
    """Return the smallest fault of the estimator through which that is the largest."""
    row, trials = _smallest(tried[0]), tried[0]
    for others in tried[1:]:
        if row.size is None or not _is_often_seen(others, row.size):
            row, trials = max((row, trials), (_smallest(others), others), key=lambda each: each[0].hardness)
    if not named or row.size is None:
        return row
    seen = [trial for trial in trials if trial.is_seen(row.size)]
    return replace(row, named_from=_named_from(seen, row.size))


def _is_often_seen(trials: Sequence[_Trial], size: float) -> bool:
    """Tell whether a size is seen in enough of some trials; no more of them are asked."""
    spare = _spare(trials)
    return len(list(islice((trial for trial in trials if not trial.is_seen(size)), spare + 1))) <= spare


def _spare(trials: Sequence[_Trial]) -> int:
    """Return in how many of some trials a size needn't be seen."""
    return int((1.0 - SHARE) * len(trials) + 1e-9)


def _onsets(watches: Sequence[Watch], within_s: float) -> list[tuple[int, int]]:
    """Return rows spread evenly over what was watched, with their watches' numbers; each leaves time to alarm."""
    able = [
        watch.armed[: max(len(watch.record) - round(within_s / watch.record.sample_period_s), 0)] for watch in watches
    ]
    parts = [(i, rows) for i, each in enumerate(able) for rows in pieces(len(each))]
    ends = np.cumsum([np.count_nonzero(able[i][rows]) for i, rows in parts]) if parts else np.zeros(1, dtype=int)
    count = min(ONSETS, int(ends[-1]))
    onsets = []
    for chosen in ((2 * k + 1) * int(ends[-1]) // (2 * count) for k in range(count)):
        place = int(np.searchsorted(ends, chosen, side="right"))
        i, rows = parts[place]
        there = np.flatnonzero(able[i][rows])
        onsets.append((i, rows.start + int(there[chosen - int(ends[place])])))  # counted from the end
    return onsets


def _smallest(trials: Sequence[_Trial]) -> SmallestSeen:
    """Return the size that is seen in so many of some trials: that of the hardest but a few.

    What is seen at a smaller size is taken to be seen at a larger one.
    """
    # the size is that of the (spare + 1)-th hardest trial: a heap keeps so many, and the least of these is it. A trial
    # that sees at that size needs no search of its own
    spare = _spare(trials)
    hardest: list[tuple[int, int]] = []  # steps of so many trials and one, with their numbers; the smallest first
    near = _STEPS // 2
    for i, trial in enumerate(trials):
        if len(hardest) <= spare:
            heappush(hardest, (trial.smallest(0, near), i))
        elif hardest[0][0] <= _STEPS:
            heappushpop(hardest, (trial.smallest(hardest[0][0], hardest[0][0]), i))
        near = min(hardest[0][0], _STEPS)
    size = trials[0].size(hardest[0][0]) if hardest[0][0] <= _STEPS else None
    harder = {i for step, i in hardest if step > near}
    largest = trials[0].most
    seen = [trial for i, trial in enumerate(trials) if i not in harder and (size is not None or trial.is_seen(largest))]
    on = trials[0].place.on
    return SmallestSeen(
        sensor=on.sensor,
        kind=trials[0].kind.fault.kind,
        size=size,
        share=len(seen) / len(trials),
        within_s=trials[0].place.within_s,
        time_constant_s=None if on.estimator is None else on.estimator.time_constant_s,
    )


def _named_from(seen: Sequence[_Trial], size: float) -> float | None:
    """Return from which size on some of the trials that are seen are named; None where not up to a few times theirs."""
    times = [each for each in _TIMES if each * size <= seen[0].most]
    for i in range(_NAMED_OF):
        trial = seen[(2 * i + 1) * len(seen) // (2 * _NAMED_OF)]
        while times and not trial.place.names(trial.fault(times[0] * size)):
            times.pop(0)
    return times[0] * size if times else None
