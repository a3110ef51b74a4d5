"""Scoring a monitor: what it found on a broken record, held against the fault that was injected."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gtmbench.bench.fault import Fault
from gtmbench.method.monitoring.findings import Finding, Judgement
from gtmbench.method.monitoring.watch import Watch
from gtmbench.record import Record
from gtmbench.study.score import altered_share

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
class MonitorVerdict:
    """What a monitor made of one fault. The first finding whose alarm lies at or after the onset is what counts.

    Attributes
    ----------
    onset_s : float
    detected : bool
    alarm_time_s, detection_delay_s : float or None
        When the alarm could be raised, look-ahead and windows counted, and how long after the onset.
    isolated : bool
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
    kind_right, kind_right_20s : bool
        Whether that is the kind injected, of the sensor that failed: at the end, and as judged 20 s after the alarm.
    parameters : tuple of ParameterEstimate
        Of that kind, at the end.
    ended_s, end_error_s : float or None
        When the fault had gone, and how much later than in truth.
    peak_level : float
        The greatest level known at or after the onset of the residuals that the sensor enters; an alarm above 1.
    altered_share : float
        Share of samples in the active interval at which the broken signal differs from the healthy one.
    false_alarms : int
        Findings whose alarm lies before the onset.
    reason : str
        Why a fault was missed; empty where it was detected.
    """

    onset_s: float
    detected: bool
    alarm_time_s: float | None
    detection_delay_s: float | None
    isolated: bool
    isolated_s: float | None
    isolation_delay_s: float | None
    sensor: str | None
    candidates: tuple[str, ...]
    verdict: str
    kind: str | None
    kind_right: bool
    kind_right_20s: bool
    parameters: tuple[ParameterEstimate, ...]
    ended_s: float | None
    end_error_s: float | None
    peak_level: float
    altered_share: float
    false_alarms: int
    reason: str


def score_watch(seen: Watch, *, fault: Fault, healthy: Record, broken: Record) -> MonitorVerdict:
    """Hold what a monitor saw against the truth.

    Parameters
    ----------
    seen : Watch
        Of the broken record, or of its part from the time on that is watched.
    fault : Fault
        The truth.
    healthy, broken : Record
        The measurements before and after `inject`.
    """
    after = [finding for finding in seen.findings if finding.alarm_s >= fault.onset_s - _TIE]
    first = after[0] if after else None
    isolated_s = first.isolated_s if first is not None and first.sensor == fault.channel else None
    altered = altered_share(fault, healthy, broken)
    peak = _peak_level(seen, fault)
    return MonitorVerdict(
        onset_s=fault.onset_s,
        detected=first is not None,
        alarm_time_s=first.alarm_s if first else None,
        detection_delay_s=_since(first.alarm_s if first else None, fault.onset_s),
        isolated=isolated_s is not None,
        isolated_s=isolated_s,
        isolation_delay_s=_since(isolated_s, fault.onset_s),
        sensor=first.sensor if first else None,
        candidates=first.last.candidates if first else (),
        verdict=first.verdict if first else "",
        kind=first.last.kind if first else None,
        kind_right=first is not None and _right(first.last, fault),
        kind_right_20s=first is not None and _right(first.at(_JUDGED_S), fault),
        parameters=_parameters(first, fault, broken) if first else (),
        ended_s=first.ended_s if first else None,
        end_error_s=_since(first.ended_s, fault.onset_s + fault.duration_s) if first and fault.duration_s else None,
        peak_level=peak,
        altered_share=altered,
        false_alarms=len(seen.findings) - len(after),
        reason="" if first else _reason(seen, fault, altered, peak),
    )


def _since(time_s: float | None, start_s: float) -> float | None:
    return None if time_s is None else round(time_s - start_s, 9)


def _right(judged: Judgement, fault: Fault) -> bool:
    return judged.kind == fault.kind and judged.candidates[:1] == (fault.channel,)


def _parameters(found: Finding, fault: Fault, broken: Record) -> tuple[ParameterEstimate, ...]:
    truth = _truth(fault, broken) if _right(found.last, fault) else {}
    return tuple(
        ParameterEstimate(
            name=name, value=float(value), error=float(found.last.errors.get(name, math.nan)), true=truth.get(name)
        )
        for name, value in found.last.parameters.items()
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


def _peak_level(seen: Watch, fault: Fault) -> float:
    peak = 0.0
    for output in seen.monitor.bank.disturbs(fault.channel):
        level = seen.levels[output]
        known = level.values[(level.known_s >= fault.onset_s - _TIE) & np.isfinite(level.values)]
        peak = max(peak, float(known.max(initial=0.0)))
    return peak


def _reason(seen: Watch, fault: Fault, altered: float, peak: float) -> str:
    bank = seen.monitor.bank
    own = bank.disturbs(fault.channel)
    if not own:
        return f"bank {bank.name} doesn't use this channel"
    if altered == 0.0:
        return "the fault changed no sample"
    given_up = seen.given_up
    if set(own) <= set(given_up):
        return f"no longer watched since an alarm at {max(given_up[output] for output in own):.2f} s, before the onset"
    if peak > 1.0:
        return "the level stood above the threshold since before the onset"
    return f"the level reached {100.0 * peak:.0f} % of the threshold"
