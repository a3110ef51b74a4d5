"""Scoring: the one place that is handed the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.bench.faults import Fault
from gtmbench.method.alarms import Alarms
from gtmbench.method.residual import WindowedNorm
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import Record


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What became of one fault.

    Attributes
    ----------
    onset_s : float
    detected : bool
        Whether an alarm was raised at or after the onset.
    alarm_time_s, detection_delay_s : float or None
        When the first such alarm could be raised, and how long after the onset.
    look_ahead_s, window_s : float
        What of the delay is the method's own: d Ts and (w + 1) Ts.
    peak_ratio : float
        Greatest E(k) known at or after the onset, over the threshold.
    altered_share : float
        Share of samples in the active interval at which the broken signal differs from the healthy one.
    false_alarms : int
        Alarms before the onset.
    reason : str
        Why a fault was missed; empty where it was detected.
    """

    onset_s: float
    detected: bool
    alarm_time_s: float | None
    detection_delay_s: float | None
    look_ahead_s: float
    window_s: float
    peak_ratio: float
    altered_share: float
    false_alarms: int
    reason: str


def score(
    raised: Alarms, norm: WindowedNorm, operator: Transmissibility, fault: Fault, healthy: Record, broken: Record
) -> Verdict:
    """Hold the alarms on a broken record, and the norm they come from, against the fault that was injected."""
    before = raised.time_s < fault.onset_s - 1e-9
    after = raised.time_s[~before]
    known = (norm.known_s >= fault.onset_s - 1e-9) & ~np.isnan(norm.values)
    peak_ratio = float(norm.values[known].max() / raised.threshold) if known.any() else 0.0
    active = fault.active(healthy.time_s)
    was, became = healthy[fault.channel][active], broken[fault.channel][active]
    altered = (was != became) & ~(np.isnan(was) & np.isnan(became))
    altered_share = float(np.mean(altered)) if len(altered) else 0.0
    detected = len(after) > 0
    return Verdict(
        onset_s=fault.onset_s,
        detected=detected,
        alarm_time_s=round(float(after[0]), 9) if detected else None,
        detection_delay_s=round(float(after[0]) - fault.onset_s, 9) if detected else None,
        look_ahead_s=round(raised.look_ahead_s, 9),
        window_s=round(raised.window_s, 9),
        peak_ratio=peak_ratio,
        altered_share=altered_share,
        false_alarms=int(before.sum()),
        reason="" if detected else _reason(peak_ratio, altered_share, bool(known.any()), raised, operator, fault),
    )


def _reason(
    peak_ratio: float, altered_share: float, watched: bool, raised: Alarms, operator: Transmissibility, fault: Fault
) -> str:
    if fault.channel not in (*operator.inputs, *operator.outputs):
        return f"the operator {operator.name} doesn't use '{fault.channel}'"
    if not watched:
        return "no complete window ends after the onset"
    if altered_share == 0.0:
        return "the fault changed no sample"
    if np.isnan(raised.armed_s):
        return "the norm never came down to the threshold, so no alarm was possible"
    if peak_ratio > 1.0:
        return "the norm stood above the threshold since before the onset"
    return f"the norm reached {100.0 * peak_ratio:.0f} % of the threshold"
