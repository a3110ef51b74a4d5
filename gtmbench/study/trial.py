"""What a study returns: what its trials share, and every trial."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from typing import cast

from gtmbench.bench.trim import Trim
from gtmbench.deprecation import renamed
from gtmbench.detectors.protocol import Monitor, Watch
from gtmbench.detectors.windowed_norm import SCORE, NormMonitor
from gtmbench.faults.fault import Fault
from gtmbench.method.alarms import Alarms, alarms
from gtmbench.method.residual import Residual, WindowedNorm, residual, windowed_norm
from gtmbench.record import Record
from gtmbench.study.scenario import Setup
from gtmbench.study.score import Verdict


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """What the trials of one detector share.

    Attributes
    ----------
    detector : str
        Its name; no other detector of the study has it.
    setup, trim, flight
        What was flown; `flight` is truth.
    healthy : Record
        The measurements that are broken in the trials.
    monitor : Monitor
        The detector, calibrated.
    watch : Watch
        Of `healthy`, from `setup.alarm.watch_from_s` on.
    false_alarms : int
    healthy_hours : float
        False alarms on healthy records that calibration hasn't seen, and the hours watched, as `gtmbench.study.score`
        defines them.
    """

    detector: str
    setup: Setup
    trim: Trim
    flight: Record = field(repr=False)
    healthy: Record = field(repr=False)
    monitor: Monitor
    watch: Watch = field(repr=False)
    false_alarms: int
    healthy_hours: float

    watched = renamed("MonitoredBaseline.watched", "watch")
    operator = renamed("Baseline.operator", "monitor.operator")
    threshold = renamed("Baseline.threshold", "monitor.threshold")
    armed_s = renamed("Baseline.armed_s", "watch.scores['E(k)'].armed_s", lambda self: self.watch.scores[SCORE].armed_s)
    norm = renamed("Baseline.norm", "watch.scores['E(k)']", lambda self: _norm(self.watch))
    residual = renamed("Baseline.residual", "watch.residuals", lambda self: _residual(self.watch))


@dataclass(frozen=True, kw_only=True, eq=False)
class Injection:
    """A fault put into healthy measurements.

    Attributes
    ----------
    scenario, fault, channel : str
        The scenario's name, the fault's kind, the channel that broke.
    severity : dict
        The fault's parameters as absolute figures, in the channel's unit (per second for slopes).
    unit : str
        The channel's.
    injected : Fault
    record : Record
        The broken measurements.
    """

    scenario: str
    fault: str
    channel: str
    severity: dict[str, float]
    unit: str
    injected: Fault = field(repr=False)
    record: Record = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial(Injection, Verdict):
    """One fault, watched by one detector: the verdict and what it was reached on.

    Attributes
    ----------
    detector : str
        The detector's name.
    watch : Watch
        Of the broken record, from `setup.alarm.watch_from_s` on.
    baseline : Baseline
        Shared by the trials of this detector.
    """

    detector: str
    watch: Watch = field(repr=False)
    baseline: Baseline = field(repr=False)

    def row(self) -> dict[str, object]:
        """Return the trial as one row of the results: plain values, units in the names."""
        verdict = {item.name: getattr(self, item.name) for item in fields(Verdict)}
        return {
            "detector": self.detector,
            "scenario": self.scenario,
            "fault": self.fault,
            "channel": self.channel,
            **verdict,
            "candidates": list(self.candidates),
            "parameters": [asdict(estimate) for estimate in self.parameters],
            "severity": self.severity,
            "unit": self.unit,
        }

    watched = renamed("MonitoredTrial.watched", "watch")
    peak_level = renamed("MonitoredTrial.peak_level", "peak_ratio")
    window_s = renamed("Trial.window_s", "baseline.monitor.window_s")
    alarms = renamed("Trial.alarms", "watch.alarms", lambda self: _crossings(self.watch))
    norm = renamed("Trial.norm", "watch.scores['E(k)']", lambda self: _norm(self.watch))
    residual = renamed("Trial.residual", "watch.residuals", lambda self: _residual(self.watch))


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Scenarios of one flight, watched by one detector or several.

    Attributes
    ----------
    baselines : tuple of Baseline
        One a detector, in the order in which they were given.
    trials : tuple of Trial
        Detector by detector, each in the order of the scenarios.
    """

    baselines: tuple[Baseline, ...]
    trials: tuple[Trial, ...]

    @property
    def baseline(self) -> Baseline:
        """The first detector's."""
        return self.baselines[0]

    def trials_of(self, detector: str) -> tuple[Trial, ...]:
        """Return the trials of one detector."""
        return tuple(trial for trial in self.trials if trial.detector == detector)


def _residual(watch: Watch) -> Residual:
    """Return what trials held of the dissertation's operator, one release ago."""
    return residual(cast(NormMonitor, watch.monitor).operator, watch.record)


def _norm(watch: Watch) -> WindowedNorm:
    return windowed_norm(_residual(watch), window=cast(NormMonitor, watch.monitor).window)


def _crossings(watch: Watch) -> Alarms:
    return alarms(_norm(watch), cast(NormMonitor, watch.monitor).threshold)
