"""What a study returns: what its trials share, and every trial."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from gtmbench.bench.fault import Fault
from gtmbench.bench.trim import Trim
from gtmbench.method.alarms import Alarms
from gtmbench.method.residual import Residual, WindowedNorm
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import Record
from gtmbench.study.scenario import Setup
from gtmbench.study.score import Verdict


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """What the trials of a study share: a flight, its healthy measurements, operator and threshold.

    Attributes
    ----------
    setup, trim, flight
        What was flown; `flight` is truth.
    operator : Transmissibility
        Identified on measurements with the first noise seed.
    threshold : float
        From measurements with the second noise seed, in the output's unit.
    healthy : Record
        Measurements with the third noise seed: those that are broken in the trials.
    residual, norm
        Of `healthy`.
    armed_s : float or None
        When the norm of `healthy` first came down to the threshold: alarms are possible from then on.
    false_alarms : int
    healthy_hours : float
        Alarms on healthy records that neither operator nor threshold has seen, and the hours watched, armed.
    """

    setup: Setup
    trim: Trim
    flight: Record
    healthy: Record
    operator: Transmissibility
    threshold: float
    residual: Residual = field(repr=False)
    norm: WindowedNorm = field(repr=False)
    armed_s: float | None
    false_alarms: int
    healthy_hours: float


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
    """One fault, tried: the verdict and what it was reached on.

    Attributes
    ----------
    residual, norm, alarms
        What the method made of the broken measurements.
    baseline : Baseline
        Shared by the trials of a study.
    """

    residual: Residual = field(repr=False)
    norm: WindowedNorm = field(repr=False)
    alarms: Alarms = field(repr=False)
    baseline: Baseline = field(repr=False)

    def row(self) -> dict[str, object]:
        """Return the trial as one row of the results: plain values, units in the names."""
        verdict = {item.name: getattr(self, item.name) for item in fields(Verdict)}
        return {
            "scenario": self.scenario,
            "fault": self.fault,
            "channel": self.channel,
            **verdict,
            "threshold": self.baseline.threshold,
            "severity": self.severity,
            "unit": self.unit,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Scenarios of one setup, run: what they share, and every trial."""

    baseline: Baseline
    trials: tuple[Trial, ...]
