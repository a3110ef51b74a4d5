"""Scoring: the one place that is handed the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.bench.fault import Fault
from gtmbench.method.alarms import Alarms
from gtmbench.method.residual import WindowedNorm
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
        d Ts and (w + 1) Ts. They bound when a window that lies wholly after the onset is known; a strong fault is
        found before that, for the windows before it hold its first samples.
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
    raised: Alarms,
    norm: WindowedNorm,
    *,
    fault: Fault,
    healthy: Record,
    broken: Record,
    channels: Sequence[str],
) -> Verdict:
    """Hold a detector's alarms on a broken record against the fault that was injected.

    Parameters
    ----------
    raised : Alarms
        Dated when they could be raised.
    norm : WindowedNorm
        What the alarms were raised from.
    fault : Fault
        The truth.
    healthy, broken : Record
        The measurements before and after `inject`.
    channels : sequence of str
        The channels that the detector uses: a fault on another one is a miss for that reason.

    Examples
    --------
    >>> from gtmbench.bench.faults import Drift, inject
    >>> from gtmbench.method.alarms import alarms
    >>> healthy = Record([1.0, 1.0, 1.0, 1.0], channels=["p"], sample_period_s=1.0)
    >>> fault = Drift(channel="p", onset_s=1.0, slope=2.0)
    >>> broken = inject(healthy, fault)
    >>> norm = WindowedNorm(values=broken["p"], time_s=broken.time_s, window=0, look_ahead_s=0.0, sample_period_s=1.0)
    >>> verdict = score(alarms(norm, 4.0), norm, fault=fault, healthy=healthy, broken=broken, channels=["p"])
    >>> verdict.detected, verdict.detection_delay_s, verdict.peak_ratio
    (True, 2.0, 1.25)
    """
    before = raised.time_s < fault.onset_s - 1e-9
    after = raised.time_s[~before]
    known = (norm.known_s >= fault.onset_s - 1e-9) & ~np.isnan(norm.values)
    peak_ratio = float(norm.values[known].max() / raised.threshold) if known.any() else 0.0
    altered = altered_share(fault, healthy, broken)
    detected = len(after) > 0
    return Verdict(
        onset_s=fault.onset_s,
        detected=detected,
        alarm_time_s=round(float(after[0]), 9) if detected else None,
        detection_delay_s=round(float(after[0]) - fault.onset_s, 9) if detected else None,
        look_ahead_s=round(raised.look_ahead_s, 9),
        window_s=round(raised.window_s, 9),
        peak_ratio=peak_ratio,
        altered_share=altered,
        false_alarms=int(before.sum()),
        reason="" if detected else _reason(fault.channel in channels, known.any(), altered, raised, peak_ratio),
    )


def altered_share(fault: Fault, healthy: Record, broken: Record) -> float:
    """Return the share of samples in a fault's active interval at which the broken signal differs from the healthy."""
    active = fault.active(healthy.time_s)
    was, became = healthy[fault.channel][active], broken[fault.channel][active]
    altered = (was != became) & ~(np.isnan(was) & np.isnan(became))
    return float(np.mean(altered)) if len(altered) else 0.0


def _reason(used: bool, watched: np.bool_, altered: float, raised: Alarms, peak_ratio: float) -> str:
    if not used:
        return "the detector doesn't use this channel"
    if not watched:
        return "no complete window ends after the onset"
    if altered == 0.0:
        return "the fault changed no sample"
    if np.isnan(raised.armed_s):
        return "the norm never came down to the threshold, so no alarm was possible"
    if peak_ratio > 1.0:
        return "the norm stood above the threshold since before the onset"
    return f"the norm reached {100.0 * peak_ratio:.0f} % of the threshold"
