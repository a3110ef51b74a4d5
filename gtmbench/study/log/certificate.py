"""What a monitor would have seen on a log: the smallest faults of each sensor that would have alarmed, and been named.

Faults are put on the log that was watched, at times spread over it. Whether one alarms is worked out on its sensor's
own residual alone (`Superposition`); whether it is named, by watching the log about some of these times anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from heapq import heappush, heappushpop

import numpy as np

from gtmbench.detectors.bank.calibrated import bank_residuals
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.monitor.superposition import Superposition
from gtmbench.detectors.protocol import Detector, Monitor, Watch
from gtmbench.faults.additive import Bias, Drift, Noise
from gtmbench.faults.fault import Fault, inject
from gtmbench.faults.shaping import Deadzone, ScaleFactor

SHARE = 0.9  # of the time watched
_ONSETS = 20  # tried
_FINE = 1.1  # sizes this near are one
_STEP = 4.0  # from a size that isn't seen to the next
_LEAST = 1e-3  # of the largest: no smaller one is looked for
_RANGE = 30.0  # times what a sensor and its residual do: the largest fault that is tried
_TURNED = 2.0  # a scale error that turns the sign
_NAMED_OF = 3  # onsets that are watched anew
_TIMES = (1.0, 1.5, 2.0, 3.0, 5.0)  # the size that is seen
_ARMING_S = 5.0  # before what statistics look back at, where a record is watched anew
_JUDGED_S = 10.5  # after the alarm: when a fault that is to be named has been


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of fault that is tried, by one parameter.

    Attributes
    ----------
    fault : type of Fault
    parameter : str
        Its size: how far it is from where the fault changes nothing.
    within_s : float
        How long after its onset it has to alarm.
    """

    fault: type[Fault]
    parameter: str
    within_s: float = 10.0

    def at(self, sensor: str, onset_s: float, size: float, *, is_turned: bool) -> Fault:
        """Return the fault of a size, upwards or, where it has two directions and is turned, downwards."""
        value = -size if is_turned and self.parameter in _DIRECTED else size
        value += self.fault is ScaleFactor
        return self.fault(channel=sensor, onset_s=onset_s, **{self.parameter: value})


_DIRECTED = ("size", "slope", "factor")
KINDS = (
    Kind(fault=Bias, parameter="size"),
    Kind(fault=Drift, parameter="slope", within_s=20.0),
    Kind(fault=ScaleFactor, parameter="factor"),
    Kind(fault=Deadzone, parameter="half_width"),
    Kind(fault=Noise, parameter="deviation"),
)


@dataclass(frozen=True, kw_only=True)
class Smallest:
    """The smallest fault of a kind that would have been seen.

    Attributes
    ----------
    sensor, kind : str
    size : float or None
        In the sensor's unit, of a drift in that per second; of a scale factor, how far it is from 1. None where no size
        would have been seen often enough.
    share : float
        Of the time watched in which one of this size, or of the largest that was tried, would have alarmed.
    within_s : float
        How long after its onset.
    named_from : float or None
        From which size on it would have been named, too, and no other sensor; None where not up to five times `size`.
    """

    sensor: str
    kind: str
    size: float | None
    share: float
    within_s: float
    named_from: float | None = None


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """What a monitor would have seen on a log.

    Attributes
    ----------
    rows : tuple of Smallest
        One a sensor and kind.
    watched_s : float
        How long an alarm was possible, of any residual: what shares are of.
    missing : str
        Why there is none, where there are no rows.
    """

    rows: tuple[Smallest, ...] = field(default=(), repr=False)
    watched_s: float = 0.0
    missing: str = ""

    def of(self, sensor: str, kind: str) -> Smallest | None:
        """Return the row of a sensor and a kind; None where there is none."""
        return next((row for row in self.rows if (row.sensor, row.kind) == (sensor, kind)), None)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """A fault of a kind at one time, of whatever size."""

    kind: Kind
    on: Superposition
    onset_s: float
    within_s: float
    is_turned: bool
    most: float
    is_telling: bool

    def fault(self, size: float) -> Fault:
        """Return it with a size."""
        return self.kind.at(self.on.sensor, self.onset_s, size, is_turned=self.is_turned)

    def is_seen(self, size: float) -> bool:
        """Tell whether it raises an alarm in time, and wouldn't without it."""
        return self.is_telling and self.on.alarm_row(self.fault(size), self.within_s) is not None

    def smallest(self, low: float) -> float:
        """Return about the smallest size above one that isn't seen that is; inf where not even the largest is."""
        if not self.is_telling:
            return np.inf
        high = min(_STEP * low, self.most)
        while not self.is_seen(high):
            if high >= self.most:
                return np.inf
            low, high = high, min(_STEP * high, self.most)
        while high > _FINE * low:
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if self.is_seen(middle) else (middle, high)
        return high

    def is_named(self, size: float) -> bool:
        """Tell whether its sensor is named, and no other, when the record about it is watched anew."""
        fault, record, monitor = self.fault(size), self.on.record, self.on.monitor
        row = self.on.alarm_row(fault, self.within_s)
        if row is None:
            return False
        before_s = monitor.bank.statistic.looks_back(record.sample_period_s) * record.sample_period_s + _ARMING_S
        until_s = record.time_s[row] + monitor.look_ahead_of(self.on.sensor) + _JUDGED_S
        about = record.between(max(self.onset_s - before_s, record.start_s), min(until_s, record.end_s))
        said = monitor.watch(inject(about, fault)).faults
        named = {alarm.sensor for alarm in said if alarm.sensor is not None and alarm.time_s >= self.onset_s}
        return named == {self.on.sensor}


def certificate_of(monitor: Monitor | Detector, watches: Sequence[Watch]) -> Certificate:
    """Work out what a monitor would have seen on records that it watched.

    Parameters
    ----------
    monitor : Monitor or Detector
    watches : sequence of Watch
    """
    if not isinstance(monitor, BankMonitor):
        return Certificate(missing=f"{monitor.name} is no bank")
    sensors = [spec.output for spec in monitor.bank.diagnostic if spec.output in monitor.bank.suspects]
    if not sensors:
        return Certificate(missing="no sensor that it suspects has a residual of its own")
    watched_s = sum(np.count_nonzero(watch.armed) for watch in watches) * monitor.sample_period_s
    residuals = [bank_residuals(monitor, watch.record, sensors) for watch in watches]
    rows = []
    for sensor in sensors:
        on = [
            Superposition(
                monitor=monitor,
                sensor=sensor,
                record=watch.record,
                raw=residual.raw[sensor],
                spread=residual.spread.get(sensor),
                armed=watch.scores[sensor].armed,
            )
            for watch, residual in zip(watches, residuals, strict=True)
        ]
        for kind in KINDS:
            trials = _trials(kind, on, watches)
            if trials:
                rows.append(_smallest(trials))
    return Certificate(rows=tuple(rows), watched_s=watched_s, missing="" if rows else "too little was watched")


def _trials(kind: Kind, on: Sequence[Superposition], watches: Sequence[Watch]) -> list[_Trial]:
    """Return a kind's trials, their onsets spread evenly over the time watched that leaves time to alarm."""
    longest_s = max((np.count_nonzero(watch.armed) * watch.record.sample_period_s for watch in watches), default=0.0)
    within_s = min(kind.within_s, round(0.5 * longest_s, 1))
    begins: list[tuple[Superposition, float]] = []
    for each, watch in zip(on, watches, strict=True):
        enough = len(watch.record) - round(within_s / watch.record.sample_period_s)
        begins += [
            (each, time_s) for time_s in watch.record.time_s[: max(enough, 0)][watch.armed[: max(enough, 0)]].tolist()
        ]
    count = min(_ONSETS, len(begins))
    most = _most(kind, on, within_s) if begins else 0.0
    trials = []
    for i in range(count):
        each, onset_s = begins[(2 * i + 1) * len(begins) // (2 * count)]
        nothing = Bias(channel=each.sensor, onset_s=onset_s, size=0.0)
        trials.append(
            _Trial(
                kind=kind,
                on=each,
                onset_s=onset_s,
                within_s=within_s,
                is_turned=bool(i % 2),
                most=most,
                is_telling=each.alarm_row(nothing, within_s) is None,
            )
        )
    return trials


def _most(kind: Kind, on: Sequence[Superposition], within_s: float) -> float:
    """Return the largest size that is tried."""
    readings = np.concatenate([each.record[each.sensor] for each in on])
    if kind.fault is ScaleFactor:
        return _TURNED
    if kind.fault is Deadzone:
        return float(np.nanmax(np.abs(readings), initial=0.0))  # nothing is left
    large = _RANGE * float(np.nanstd(readings) + np.nanstd(np.concatenate([each.raw for each in on])))
    return large / within_s if kind.fault is Drift else large


def _smallest(trials: Sequence[_Trial]) -> Smallest:
    """Return the size that is seen in so many of some trials, by the few that are hardest."""
    spare = int((1.0 - SHARE) * len(trials) + 1e-9)
    hardest: list[float] = []  # sizes of these, the smallest first
    for trial in trials:
        if len(hardest) <= spare:
            heappush(hardest, trial.smallest(trial.most * _LEAST))
        elif not (np.isinf(hardest[0]) or trial.is_seen(hardest[0])):
            heappushpop(hardest, trial.smallest(hardest[0]))
    size = hardest[0]
    kind, sensor = trials[0].kind, trials[0].on.sensor
    tried = min(size, trials[0].most)
    return Smallest(
        sensor=sensor,
        kind=kind.fault.kind,
        size=None if np.isinf(size) else size,
        share=float(np.mean([trial.is_seen(tried) for trial in trials])),
        within_s=trials[0].within_s,
        named_from=None if np.isinf(size) else _named_from(trials, size),
    )


def _named_from(trials: Sequence[_Trial], size: float) -> float | None:
    """Return from which size on some of the trials that are seen are named; None where not up to a few times theirs."""
    seen = [trial for trial in trials if trial.is_seen(size)]
    times = list(_TIMES)
    for i in range(min(_NAMED_OF, len(seen))):
        trial = seen[(2 * i + 1) * len(seen) // (2 * _NAMED_OF)]
        while times and (times[0] * size > trial.most or not trial.is_named(times[0] * size)):
            times.pop(0)
    return times[0] * size if times else None
