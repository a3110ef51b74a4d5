"""Scoring: the one place that is handed the truth, and where the words of every table are defined.

Of one watch of a record with one fault or several, for any detector:

- *onset*: of several faults in one record, the earliest.

- *armed*: where an alarm was possible (`Score.armed`): the score exists, it has been known at or below its threshold
  since watching began, and no judgement has disarmed it. A score that stands above from the start isn't armed.
- *hours watched*: the hours in which any score was armed.
- *false alarm*: an alarm that could be raised before the onset, or at any time on a healthy record, and that first told
  of a fault: alarms which the detector itself counts to the fault of an earlier one are that one, once.
- *detected*: an alarm could be raised at or after the onset. The first such alarm is what counts.
- *delay*: from the onset to when it could be raised, look-ahead and windows counted.
- *failed*: a channel is, from the onset of the first fault that changes it on, whether the fault lasts or not.
- *isolated*: the sensor that the alarm's fault ends up with is one that had failed by when it was named. Of several
  sensors that failed, any is right: an alarm tells of one. None where the detector names none.
- *named wrong*: one sensor is named in the end, and it isn't one that had failed. Neither isolated nor named wrong:
  missed, or left undecided, and then `candidates` are what it is left between.
- *axis right*: there are candidates, and all lie on the axes of sensors that had failed. A gyro and the angle that it
  turns are one axis (p and phi, q and theta, r and psi); any other sensor is one of its own.
- a sensor of several channels (magnetometer, gps, accelerometers) has failed where one of its channels has.
- *kind right*: the kind is that of a fault of the sensor that is named, or likeliest, begun by then, or what physically
  is the same (`SAME_KINDS`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import FAULTS, how_of
from gtmbench.faults.shape import Same
from gtmbench.values.channels import COMMANDS, OF_OWN_RATE, axis_of, names_of
from gtmbench.values.notebook import card, figure
from gtmbench.values.record import BoolArray, FloatArray, Record

NO_ALARM = "no alarm came"  # all that can be said of a miss, where a detector shows no score
_TIE = 1e-9  # seconds
_JUDGED_S = 20.0  # after the alarm


# the kind injected, the kind told: when both would have read the same, by the readings before, and since the fault
SAME_KINDS: Mapping[tuple[str, str], Same] = {
    (kind, told): same for kind, cls in FAULTS.items() for told, same in cls.same_as.items()
}


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter of the kind of fault that was found, in the channel's unit (per second for slopes; times in s)."""

    name: str
    value: float
    low: float  # low, high: between which it lies with a probability of 95 %; NaN where the record doesn't tell
    high: float
    true: float | None  # what was injected; None where sensor or kind is another


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The score of a detector on one fault. Without isolation, its fields on isolation are None or empty.

    Attributes
    ----------
    onset_s : float
        The onset; the earliest of several faults.
    detected : bool
        Whether an alarm could be raised at or after the onset.
    alarm_time_s, detection_delay_s : float or None
        When the first such alarm could be raised, in seconds, and its delay from the onset.
    look_ahead_s : float
        The part of every delay in which the detector waits for samples.
    peak_ratio : float
        Greatest test statistic over its threshold, known at or after the onset, among those that the sensor's fault
        enters; 0 without any.
    altered_share : float
        Share of samples at which a broken signal differs from the healthy one while a fault of it is active; NaN of a
        surface, whose deflection isn't read.
    false_alarms : int
        Alarms before the onset.
    isolated : bool or None
        Whether the named sensor had failed.
    named_wrong : bool or None
        Whether it finally names a single sensor that hadn't failed.
    axis_right : bool or None
        Whether there are candidates, all of them on the axis of a sensor that had failed: p or phi, q or theta, r or
        psi.
    isolated_s, isolation_delay_s : float or None
        When that decision was possible, in seconds, and its delay from the onset.
    sensor : str or None
        The named sensor; None while undecided.
    candidates : tuple of str
    verdict : str
        In words; empty if the fault was missed.
    kind : str or None
        The final kind of fault; "unknown" if it is none of the known kinds.
    partner : str or None
        The other sensor of a kind that mixes two.
    kind_right, kind_right_20s : bool or None
        Whether that kind was injected into the sensor, or is physically the same: at the end, and as judged 20 s after
        the alarm.
    parameters : tuple of ParameterEstimate
        The final estimates for that kind.
    ended_s, end_error_s : float or None
        When the fault ended by the diagnosis, and how much later than in truth.
    reason : str
        Why a fault was missed, or why no sensor is named although one could be; empty otherwise.

    Examples
    --------
    >>> import gtmbench as gb
    >>> healthy = gb.Record([1.0, 1.0, 1.0, 1.0], channels=["p"], sample_period_s=1.0)
    >>> fault = gb.Bias(channel="p", onset_s=2.0, size=9.0)
    >>> broken = gb.inject(healthy, fault)
    >>> monitor = gb.FunctionDetector(lambda record: record.time_s[record["p"] > 4.0][:1], name="limit").calibrate()
    >>> verdict = gb.score(monitor.watch(broken), fault=fault, healthy=healthy, broken=broken)
    >>> verdict.detected, verdict.detection_delay_s, verdict.false_alarms
    (True, 0.0, 0)
    """

    onset_s: float
    detected: bool
    alarm_time_s: float | None
    detection_delay_s: float | None
    look_ahead_s: float
    peak_ratio: float
    altered_share: float
    false_alarms: int
    isolated: bool | None = None
    named_wrong: bool | None = None
    axis_right: bool | None = None
    isolated_s: float | None = None
    isolation_delay_s: float | None = None
    sensor: str | None = None
    candidates: tuple[str, ...] = ()
    verdict: str = ""
    kind: str | None = None
    partner: str | None = None
    kind_right: bool | None = None
    kind_right_20s: bool | None = None
    parameters: tuple[ParameterEstimate, ...] = ()
    ended_s: float | None = None
    end_error_s: float | None = None
    reason: str

    @property
    def in_short(self) -> str:
        """In words: ``detected after 1.46 s: q failed``, ``missed``."""
        if self.detection_delay_s is None:
            return f"missed: {self.reason}"
        said = f": {self.verdict}" if self.verdict else ""
        return f"detected after {self.detection_delay_s:.2f} s{said}"

    def _repr_html_(self) -> str:
        return card("Verdict", {"verdict": self.in_short, **self._facts()})

    def _facts(self) -> dict[str, object]:
        """Return what a notebook tells of it."""
        facts: dict[str, object] = {
            "onset": f"{self.onset_s:g} s",
            "alarm": "none" if self.alarm_time_s is None else f"{self.alarm_time_s:.2f} s",
            "peak over threshold": figure(self.peak_ratio, ".3g"),
            "false alarms before": self.false_alarms,
        }
        if self.sensor is not None:
            facts["sensor"] = f"{self.sensor}, {'right' if self.isolated else 'wrong'}"
        if self.kind is not None and self.kind_right is not None:
            facts["kind"] = f"{self.kind}, {'right' if self.kind_right else 'wrong'}"
        return facts


def score(watch: Watch, *, fault: Fault, healthy: Record, broken: Record, also: Sequence[Fault] = ()) -> Verdict:
    """Score a detector's result on a broken record against the injected faults.

    Parameters
    ----------
    watch : Watch
        The result on the broken record, or on its watched part.
    fault : Fault
        The truth.
    healthy, broken : Record
        The measurements before and after `inject`.
    also : sequence of Fault
        Further faults of the same record.

    Examples
    --------
    >>> import gtmbench as gb
    >>> healthy = gb.Record([1.0, 1.0, 1.0, 1.0], channels=["p"], sample_period_s=1.0)
    >>> fault = gb.Drift(channel="p", onset_s=1.0, slope=2.0)
    >>> broken = gb.inject(healthy, fault)
    >>> limit = gb.FunctionDetector(lambda record: record.time_s[record["p"] > 4.0], name="limit").calibrate([healthy])
    >>> verdict = gb.score(limit.watch(broken), fault=fault, healthy=healthy, broken=broken)
    >>> verdict.detected, verdict.detection_delay_s, verdict.isolated
    (True, 2.0, None)
    """
    if not isinstance(watch, Watch):
        raise InputError(
            f"a {type(watch).__name__} was given for a Watch; score what a monitor's watch(record) returns, such as "
            "gb.DissertationOperator(...).calibrate(records).watch(broken)"
        )
    truth = Truth(faults=(fault, *also), broken=broken)
    told = first_after(watch.alarms, truth.onset_s)
    altered = altered_share(truth.faults, healthy, broken)
    peak = max((score.peak(truth.onset_s) for score in _entered(watch, truth)), default=0.0)
    return Verdict(
        onset_s=truth.onset_s,
        detected=told is not None,
        alarm_time_s=None if told is None else round(told.time_s, 9),
        detection_delay_s=None if told is None else _since(told.time_s, truth.onset_s),
        look_ahead_s=round(watch.monitor.look_ahead_s, 9),
        peak_ratio=peak,
        altered_share=altered,
        false_alarms=len(false_alarms(watch, truth.onset_s)),
        **{"reason": "" if told is not None else _reason(watch, truth, altered, peak)}
        | ({} if not watch.monitor.suspects else _isolation(watch, told, truth)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """What was injected into a record, and what became of it."""

    faults: tuple[Fault, ...]
    broken: Record

    @property
    def onset_s(self) -> float:
        """The earliest onset."""
        return min(fault.onset_s for fault in self.faults)

    @property
    def channels(self) -> frozenset[str]:
        """What the faults change."""
        return _changed(self.faults)

    def begun(self, time_s: float) -> tuple[Fault, ...]:
        """Return the faults that had begun by a time."""
        return tuple(fault for fault in self.faults if fault.onset_s <= time_s + _TIE)

    def failed(self, time_s: float) -> frozenset[str]:
        """Return the channels that had failed by a time, and the sensors that these are parts of."""
        return _named(self.begun(time_s))

    def judged_right(self, judged: Judgement, time_s: float) -> Fault | None:
        """Return the fault, begun by a time, that a judgement has the kind of, and the sensor."""
        likeliest = set(judged.candidates[:1])
        own = (fault for fault in self.begun(time_s) if likeliest & _named([fault]))
        return next((fault for fault in own if self._is_kind(fault, judged.kind, time_s)), None)

    def _is_kind(self, fault: Fault, kind: str | None, time_s: float) -> bool:
        """Tell whether a fault is of a kind, by name or physically by what has been read up to a time."""
        if kind is None or kind == fault.kind:
            return kind is not None
        if fault.channel not in self.broken:  # a surface: nothing was read of what it did
            return False
        same, read_s, reads = SAME_KINDS.get((fault.kind, kind)), self.broken.time_s, self.broken[fault.channel]
        before = reads[(read_s < fault.onset_s - _TIE) & np.isfinite(reads)]
        since = reads[self._there(fault) & (read_s <= time_s + _TIE) & np.isfinite(reads)]
        return same is not None and len(since) > 0 and same.reads(before, since)

    def _there(self, fault: Fault) -> BoolArray:
        """Tell when a fault is active, and no longer coming on."""
        read_s = self.broken.time_s
        return np.asarray(fault.active(read_s) & (read_s >= fault.onset_s + fault.ramp_s - _TIE))

    def parameters(self, fault: Fault) -> dict[str, float]:
        """Return the true parameters by the names a diagnosis has: the class's, the onset, where a constant stands."""
        numbers = {item.name: getattr(fault, item.name) for item in fault.parameters() if item.value_type is float}
        true = {**numbers, "onset_s": fault.onset_s, "value": self.stuck_at(fault)}
        return {name: float(value) for name, value in true.items() if value is not None}

    def stuck_at(self, fault: Fault) -> float | None:
        """Return what a sensor reads that a fault has stuck; None of other kinds, and where it never got there."""
        if fault.shape is not None and how_of(fault.kind) in ("constant", "beyond"):
            return fault.severities[fault.shape.parameter]
        if how_of(fault.kind) != "last" or fault.channel not in self.broken:
            return None
        reads = self.broken[fault.channel][self._there(fault)]
        reads = reads[np.isfinite(reads)]
        return float(reads[0]) if len(reads) else None

    def gone_s(self, sensor: str | None) -> float | None:
        """Return when the last fault of a sensor ends (of any, where it never failed); None where one lasts."""
        own = [fault for fault in self.faults if sensor in _named([fault])] or self.faults
        ends_s = [math.inf if fault.duration_s is None else fault.onset_s + fault.duration_s for fault in own]
        return max(ends_s) if max(ends_s) < math.inf else None


def _changed(faults: Iterable[Fault]) -> frozenset[str]:
    return frozenset(channel for fault in faults for channel in fault.changes)


def _named(faults: Iterable[Fault]) -> frozenset[str]:
    return frozenset(name for channel in _changed(faults) for name in names_of(channel))


def first_after(alarms: Iterable[Alarm], onset_s: float) -> Alarm | None:
    """Return the first alarm that could be raised at or after an onset: the one that counts."""
    return next((alarm for alarm in alarms if alarm.time_s >= onset_s - _TIE), None)


def false_alarms(watch: Watch, onset_s: float = math.inf) -> tuple[Alarm, ...]:
    """Return the alarms before an onset that first told of a fault; on a healthy record, all of those."""
    return tuple(alarm for alarm in watch.faults if alarm.time_s < onset_s - _TIE)


def altered_share(faults: Sequence[Fault], healthy: Record, broken: Record | Mapping[str, FloatArray]) -> float:
    """Return the share of samples of faults' active intervals at which a broken signal differs from the healthy.

    Of what is broken, the channels that the faults change are enough. NaN of faults of surfaces alone: commands, if
    they are recorded, don't show what a surface did.
    """
    altered = []
    changed = dict.fromkeys(channel for fault in faults for channel in fault.changes)
    if changed.keys() <= set(COMMANDS):
        return math.nan
    for channel in (name for name in changed if name not in COMMANDS):
        own = [fault.active(healthy.time_s) for fault in faults if channel in fault.changes]
        active = np.logical_or.reduce(own)
        was, became = healthy[channel][active], broken[channel][active]
        if channel in OF_OWN_RATE:  # between its readings there is nothing to alter
            was, became = was[np.isfinite(was)], became[np.isfinite(was)]
        altered.append((was != became) & ~(np.isnan(was) & np.isnan(became)))
    samples = np.concatenate(altered)
    return float(np.mean(samples)) if len(samples) else 0.0


def _isolation(watch: Watch, told: Alarm | None, truth: Truth) -> dict[str, Any]:
    """Return the fields on isolation. What is said of a fault stands with the alarm that first told of it."""
    judged = None if told is None else next(alarm for alarm in watch.alarms if alarm.number == told.fault)
    last = None if judged is None else judged.last
    if told is None or judged is None or last is None:
        return {
            "isolated": False,
            "named_wrong": False,
            "axis_right": False,
            "kind_right": False,
            "kind_right_20s": False,
            "verdict": "" if told is None else "alarm",
        }
    named_s = judged.isolated_s
    if named_s is not None:  # of a fault that an earlier alarm had told of: no sooner than this one
        named_s = max(named_s, told.time_s)
    isolated = named_s is not None and {*last.failed} <= truth.failed(named_s)
    last_s = max(last.time_s, told.time_s)
    on_axes = {name for channel in truth.failed(last_s) for name in axis_of(channel)}
    right = truth.judged_right(last, last_s)
    by_20s = judged.at(told.time_s - judged.time_s + _JUDGED_S)
    right_20s = by_20s and truth.judged_right(by_20s, max(by_20s.time_s, told.time_s))
    gone_s = truth.gone_s(judged.sensor)
    return {
        "isolated": isolated,
        "named_wrong": named_s is not None and not isolated,
        "axis_right": bool(last.candidates) and on_axes.issuperset(last.candidates),
        "isolated_s": named_s if isolated else None,
        "isolation_delay_s": _since(named_s, truth.onset_s) if isolated else None,
        "sensor": judged.sensor,
        "candidates": last.candidates,
        "verdict": judged.verdict,
        "kind": last.kind,
        "partner": last.partner,
        "reason": last.reason,
        "kind_right": right is not None,
        "kind_right_20s": right_20s is not None,
        "parameters": _parameters(last, {} if right is None else truth.parameters(right)),
        "ended_s": judged.ended_s,
        "end_error_s": None if gone_s is None else _since(judged.ended_s, gone_s),
    }


def _since(time_s: float | None, start_s: float) -> float | None:
    return None if time_s is None else round(time_s - start_s, 9)


def _parameters(judged: Judgement, true: Mapping[str, float]) -> tuple[ParameterEstimate, ...]:
    return tuple(
        ParameterEstimate(name=name, value=float(value), low=low, high=high, true=true.get(name))
        for name, value in judged.parameters.items()
        for low, high in [judged.intervals.get(name, (math.nan, math.nan))]
    )


def _entered(watch: Watch, truth: Truth) -> list[Score]:
    """Return the scores that a fault enters; one that doesn't say whose faults those are may be entered by any."""
    return [score for score in watch.scores.values() if truth.channels & set(score.channels or truth.channels)]


def _reason(watch: Watch, truth: Truth, altered: float, peak: float) -> str:
    if watch.monitor.channels and not truth.channels & set(watch.monitor.channels):
        return f"{watch.monitor.name} doesn't use this channel"
    if altered == 0.0:
        return "the fault changed no sample"
    own = _entered(watch, truth)
    if not own:
        return NO_ALARM
    disarmed = [score.disarmed_s for score in own if score.disarmed_s is not None]
    if len(disarmed) == len(own):
        return f"no longer watched since {max(disarmed):.2f} s: the fault of an earlier alarm was taken to last"
    if not any((score.exists & (score.known_s >= truth.onset_s - _TIE)).any() for score in own):
        return "no score is known after the onset"
    if not any(score.armed.any() for score in own):
        return "can't tell: the score never came down to its threshold"
    if not any((score.armed & (score.known_s <= truth.onset_s + _TIE)).any() for score in own):
        return "can't tell: it was there before watching began, so it was learnt as healthy"
    if peak > 1.0:
        return "the score stood above its threshold since before the onset"
    return f"the score reached {100.0 * peak:.0f} % of its threshold"
