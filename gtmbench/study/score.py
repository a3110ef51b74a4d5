"""Scoring: the one place that is handed the truth, and where the words of every table are defined.

Of one watch of a record with one fault, for any detector:

- *armed*: where an alarm was possible (`Score.armed`): the score exists, it has been known at or below its threshold
  since watching began, and no judgement has disarmed it. A score that stands above from the start isn't armed.
- *hours watched*: the hours in which any score was armed.
- *false alarm*: an alarm that could be raised before the onset, or at any time on a healthy record, and that first told
  of a fault: alarms which the detector itself counts to the fault of an earlier one are that one, once.
- *detected*: an alarm could be raised at or after the onset. The first such alarm is what counts.
- *delay*: from the onset to when it could be raised, look-ahead and windows counted.
- *isolated*: the sensor that the alarm's fault ends up with is the one that failed. None where the detector names none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.record import Record

NO_ALARM = "no alarm came"  # all that can be said of a miss, where a detector shows no score
_TIE = 1e-9  # seconds
_JUDGED_S = 20.0


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter of the kind of fault that was found, in the channel's unit (per second for slopes; times in s).

    Attributes
    ----------
    name : str
    value : float
    error : float
        Standard error; NaN where the record doesn't tell.
    true : float or None
        What was injected; None where sensor or kind is another.
    """

    name: str
    value: float
    error: float
    true: float | None


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a detector made of one fault. Fields on isolation are None (or empty) where the detector names no sensor.

    Attributes
    ----------
    onset_s : float
    detected : bool
        Whether an alarm could be raised at or after the onset.
    alarm_time_s, detection_delay_s : float or None
        When the first such alarm could be raised, and how long after the onset.
    look_ahead_s : float
        The part of every delay that the detector waits for samples to come.
    peak_ratio : float
        Greatest score known at or after the onset over its threshold, of those that the sensor's fault enters; 0
        without any.
    altered_share : float
        Share of samples in the active interval at which the broken signal differs from the healthy one.
    false_alarms : int
        Alarms before the onset.
    isolated : bool or None
        Whether the sensor that it names is the one that failed.
    isolated_s, isolation_delay_s : float or None
        When that decision was possible, and how long after the onset.
    sensor : str or None
        The sensor that it names; None while undecided.
    candidates : tuple of str
    verdict : str
        In words; empty where the fault was missed.
    kind : str or None
        The kind of fault at the end.
    kind_right, kind_right_20s : bool or None
        Whether that is the kind injected, of the sensor that failed: at the end, and as judged 20 s after the alarm.
    parameters : tuple of ParameterEstimate
        Of that kind, at the end.
    ended_s, end_error_s : float or None
        When the fault had gone, and how much later than in truth.
    reason : str
        Why a fault was missed; empty where it was detected.
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
    isolated_s: float | None = None
    isolation_delay_s: float | None = None
    sensor: str | None = None
    candidates: tuple[str, ...] = ()
    verdict: str = ""
    kind: str | None = None
    kind_right: bool | None = None
    kind_right_20s: bool | None = None
    parameters: tuple[ParameterEstimate, ...] = ()
    ended_s: float | None = None
    end_error_s: float | None = None
    reason: str


def score(watch: Watch, *, fault: Fault, healthy: Record, broken: Record) -> Verdict:
    """Hold what a detector said of a broken record against the fault that was injected.

    Parameters
    ----------
    watch : Watch
        Of the broken record, or of its part from the time on that is watched.
    fault : Fault
        The truth.
    healthy, broken : Record
        The measurements before and after `inject`.

    Examples
    --------
    >>> from gtmbench.faults.fault import inject
    >>> from gtmbench.faults.kinds import Drift
    >>> from gtmbench.detectors.function import FunctionDetector
    >>> healthy = Record([1.0, 1.0, 1.0, 1.0], channels=["p"], sample_period_s=1.0)
    >>> fault = Drift(channel="p", onset_s=1.0, slope=2.0)
    >>> broken = inject(healthy, fault)
    >>> limit = FunctionDetector(lambda record: record.time_s[record["p"] > 4.0], name="limit").calibrate([healthy])
    >>> verdict = score(limit.watch(broken), fault=fault, healthy=healthy, broken=broken)
    >>> verdict.detected, verdict.detection_delay_s, verdict.isolated
    (True, 2.0, None)
    """
    if not isinstance(watch, Watch):
        raise InputError(
            f"a {type(watch).__name__} was given for a Watch; score what a monitor's watch(record) returns, such as "
            "gb.DissertationOperator(...).calibrate(records).watch(broken)"
        )
    told = first_after(watch.alarms, fault.onset_s)
    altered = altered_share(fault, healthy, broken)
    peak = _peak_ratio(watch, fault)
    return Verdict(
        onset_s=fault.onset_s,
        detected=told is not None,
        alarm_time_s=None if told is None else round(told.time_s, 9),
        detection_delay_s=None if told is None else _since(told.time_s, fault.onset_s),
        look_ahead_s=round(watch.monitor.look_ahead_s, 9),
        peak_ratio=peak,
        altered_share=altered,
        false_alarms=len(false_alarms(watch, fault.onset_s)),
        reason="" if told is not None else _reason(watch, fault, altered, peak),
        **({} if not watch.monitor.suspects else _isolation(watch, told, fault, broken)),
    )


def first_after(alarms: Iterable[Alarm], onset_s: float) -> Alarm | None:
    """Return the first alarm that could be raised at or after an onset: the one that counts."""
    return next((alarm for alarm in alarms if alarm.time_s >= onset_s - _TIE), None)


def false_alarms(watch: Watch, onset_s: float = math.inf) -> tuple[Alarm, ...]:
    """Return the alarms before an onset that first told of a fault; on a healthy record, all of those."""
    return tuple(alarm for alarm in watch.faults if alarm.time_s < onset_s - _TIE)


def altered_share(fault: Fault, healthy: Record, broken: Record) -> float:
    """Return the share of samples in a fault's active interval at which the broken signal differs from the healthy."""
    active = fault.active(healthy.time_s)
    was, became = healthy[fault.channel][active], broken[fault.channel][active]
    altered = (was != became) & ~(np.isnan(was) & np.isnan(became))
    return float(np.mean(altered)) if len(altered) else 0.0


def _isolation(watch: Watch, told: Alarm | None, fault: Fault, broken: Record) -> dict[str, Any]:
    """Return the fields on isolation. What is said of a fault stands with the alarm that first told of it."""
    judged = None if told is None else next(alarm for alarm in watch.alarms if alarm.number == told.fault)
    last = None if judged is None else judged.last
    if told is None or judged is None or last is None:
        return {
            "isolated": False,
            "kind_right": False,
            "kind_right_20s": False,
            "verdict": "" if told is None else "alarm",
        }
    isolated_s = judged.isolated_s if judged.sensor == fault.channel else None
    if isolated_s is not None:  # of a fault that an earlier alarm had told of: no sooner than this one
        isolated_s = max(isolated_s, told.time_s)
    by_20s = judged.at(told.time_s - judged.time_s + _JUDGED_S)
    gone_s = None if fault.duration_s is None else fault.onset_s + fault.duration_s
    return {
        "isolated": isolated_s is not None,
        "isolated_s": isolated_s,
        "isolation_delay_s": _since(isolated_s, fault.onset_s),
        "sensor": judged.sensor,
        "candidates": last.candidates,
        "verdict": judged.verdict,
        "kind": last.kind,
        "kind_right": _is_right(last, fault),
        "kind_right_20s": by_20s is not None and _is_right(by_20s, fault),
        "parameters": _parameters(last, fault, broken),
        "ended_s": judged.ended_s,
        "end_error_s": None if gone_s is None else _since(judged.ended_s, gone_s),
    }


def _since(time_s: float | None, start_s: float) -> float | None:
    return None if time_s is None else round(time_s - start_s, 9)


def _is_right(judged: Judgement, fault: Fault) -> bool:
    return judged.kind == fault.kind and judged.candidates[:1] == (fault.channel,)


def _parameters(judged: Judgement, fault: Fault, broken: Record) -> tuple[ParameterEstimate, ...]:
    truth = _truth(fault, broken) if _is_right(judged, fault) else {}
    return tuple(
        ParameterEstimate(
            name=name, value=float(value), error=float(judged.errors.get(name, math.nan)), true=truth.get(name)
        )
        for name, value in judged.parameters.items()
    )


def _truth(fault: Fault, broken: Record) -> dict[str, float]:
    """Return the true parameters by the names a diagnosis has: severities, the onset, and where a jam stands."""
    truth = {**fault.severities, "onset_s": fault.onset_s}
    if fault.kind == "jam":
        stuck = broken[fault.channel][fault.active(broken.time_s)]
        stuck = stuck[np.isfinite(stuck)]
        if len(stuck):
            truth["value"] = float(stuck[0])
    return truth


def _entered(watch: Watch, fault: Fault) -> list[Score]:
    """Return the scores that a fault enters; one that doesn't say whose faults those are may be entered by any."""
    return [score for score in watch.scores.values() if fault.channel in (score.channels or (fault.channel,))]


def _peak_ratio(watch: Watch, fault: Fault) -> float:
    return max((score.peak(fault.onset_s) for score in _entered(watch, fault)), default=0.0)


def _reason(watch: Watch, fault: Fault, altered: float, peak: float) -> str:
    if watch.monitor.channels and fault.channel not in watch.monitor.channels:
        return f"{watch.monitor.name} doesn't use this channel"
    if altered == 0.0:
        return "the fault changed no sample"
    own = _entered(watch, fault)
    if not own:
        return NO_ALARM
    disarmed = [score.disarmed_s for score in own if score.disarmed_s is not None]
    if len(disarmed) == len(own):
        return f"no longer watched since {max(disarmed):.2f} s: what an earlier alarm told of was taken to last"
    if not any((score.exists & (score.known_s >= fault.onset_s - _TIE)).any() for score in own):
        return "no score is known after the onset"
    if not any(score.armed.any() for score in own):
        return "can't tell: the score never came down to its threshold"
    if peak > 1.0:
        return "the score stood above its threshold since before the onset"
    return f"the score reached {100.0 * peak:.0f} % of its threshold"
