"""What a study returns: what its trials share, and every trial."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields

from gtmbench.bench.autopilot import Trim
from gtmbench.bench.loop_flight import LoopEvent, departed_s
from gtmbench.detectors.protocol import Monitor, Watch
from gtmbench.faults.fault import Fault
from gtmbench.study.fault_tables import Expectation
from gtmbench.study.scenario import Setup
from gtmbench.study.score import Verdict
from gtmbench.values.channels import COMMANDS, unit_of
from gtmbench.values.notebook import card
from gtmbench.values.record import FloatArray, Record


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """The data that the trials of one detector share.

    Attributes
    ----------
    detector : str
        Its name, unique in the study.
    setup, trim, flight
        The setup, the trim and the flight (truth).
    healthy : Record
        The measurements that the trials break.
    monitor : Monitor
        The detector, calibrated.
    watch : Watch
        The result on `healthy`, from `setup.alarm.watch_from_s` on.
    false_alarms : int
    healthy_hours : float
        False alarms on healthy records outside calibration, and the hours watched, as `gtmbench.study.score` defines
        them.

    Examples
    --------
    >>> import gtmbench as gb
    >>> trial = gb.run("jam", faults=[gb.Jam(channel="p", onset_s=300.0)])[0]
    >>> shared = trial.baseline
    >>> shared.detector, shared.monitor.operator.name, shared.false_alarms, round(3600 * shared.healthy_hours)
    ('dissertation', '[p q beta] -> r', 0, 2257)
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


@dataclass(frozen=True, kw_only=True, eq=False)
class InjectedFaults:
    """A fault put into healthy measurements, or several."""

    # scenario, fault, channel: the scenario's name, the fault's kind, the channel that broke: of several faults, the
    # first's
    scenario: str
    fault: str
    channel: str
    # severity: the fault's parameters as absolute figures, in the channel's unit (per second for slopes)
    severity: dict[str, float]
    unit: str  # the channel's
    injected: Fault = field(repr=False)
    # also: further faults of the same record, in the order in which they act on what those before them left
    also: tuple[Fault, ...] = ()
    flight: Record = field(repr=False)  # the truth that was measured: the study's flight, or in a loop the fault's own
    # record: the broken measurements; in a loop they end where the aircraft left its envelope
    record: Record = field(repr=False)
    events: tuple[LoopEvent, ...] = ()  # what happened in the loop

    @property
    def departure_time_s(self) -> float | None:
        """When the aircraft departed or left its envelope; None if it didn't."""
        return departed_s(self.events)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that break, the first fault's own first."""
        return tuple(dict.fromkeys(channel for fault in (self.injected, *self.also) for channel in fault.changes))

    def broken(self, channel: str) -> FloatArray:
        """Return what was read of a channel that breaks; of a surface, which nothing reads, where it was driven."""
        return self.flight[f"{channel}_actual"] if channel in COMMANDS else self.record[channel]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial(InjectedFaults, Verdict):
    """One fault, or several in one record, watched by one detector: the verdict and its evidence.

    Attributes
    ----------
    detector : str
        The detector's name.
    watch : Watch
        The result on the broken record, from `setup.alarm.watch_from_s` on.
    baseline : Baseline
        Shared by the trials of this detector.
    expected : Expectation or None
        What the scenario expects of this detector, if anything.

    Examples
    --------
    >>> import gtmbench as gb
    >>> trial = gb.run("jam", faults=[gb.Jam(channel="p", onset_s=300.0)])[0]
    >>> trial.channel, trial.detected, round(trial.detection_delay_s, 1), trial.watch.scores["E(k)"].unit
    ('p', True, 3.5, 'deg/s')
    """

    detector: str
    watch: Watch = field(repr=False)
    baseline: Baseline = field(repr=False)
    expected: Expectation | None = None

    def _repr_html_(self) -> str:
        title = f"Trial: {self.fault} of {self.channel}, watched by {self.detector}"
        return card(title, {"verdict": self.in_short, **self._facts()})

    @property
    def unexpected(self) -> tuple[str, ...]:
        """How the verdict differs from the expectation, in words; empty if it doesn't."""
        return () if self.expected is None else tuple(_differences(self, self.expected))

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
            "settings": settings_of(self.injected),
            "also": [fault_row(fault) for fault in self.also],
            "departure_time_s": self.departure_time_s,
            "expected": self.expected and {**asdict(self.expected), "isolate_as": list(self.expected.isolate_as)},
            "unexpected": list(self.unexpected),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Scenarios of one flight, watched by one detector or several.

    Attributes
    ----------
    baselines : tuple of Baseline
        One a detector, in the given order.
    trials : tuple of Trial
        Detector by detector, each in the order of the scenarios.

    Examples
    --------
    >>> import gtmbench as gb
    >>> study = gb.run_study([gb.load_scenario("jam")])
    >>> [(trial.channel, trial.detected) for trial in study.trials]
    [('p', True), ('q', True), ('r', True)]
    >>> study.baseline.detector, study.baseline.false_alarms
    ('dissertation', 0)
    """

    baselines: tuple[Baseline, ...]
    trials: tuple[Trial, ...]

    def _repr_html_(self) -> str:
        facts = {
            each.detector: f"{sum(trial.detected for trial in self.trials_of(each.detector))} of "
            f"{len(self.trials_of(each.detector))} detected, {each.false_alarms} false alarms in "
            f"{each.healthy_hours:.2f} h of healthy flight"
            for each in self.baselines
        }
        columns = ("detector", "fault", "channel", "onset (s)", "verdict")
        rows = [(each.detector, each.fault, each.channel, f"{each.onset_s:g}", each.in_short) for each in self.trials]
        return card("Study", facts, columns=columns, rows=rows)

    @property
    def baseline(self) -> Baseline:
        """The first detector's."""
        return self.baselines[0]

    def trials_of(self, detector: str) -> tuple[Trial, ...]:
        """Return the trials of one detector."""
        return tuple(trial for trial in self.trials if trial.detector == detector)


def fault_row(fault: Fault) -> dict[str, object]:
    """Return a fault as plain values, by the names that a trial's row has."""
    return {
        "fault": fault.kind,
        "channel": fault.channel,
        "onset_s": fault.onset_s,
        "severity": fault.severities,
        "unit": unit_of(fault.channel),
        "settings": settings_of(fault),
    }


def settings_of(fault: Fault) -> dict[str, object]:
    """Return what else is said of a fault, as plain values: its settings, its duration, how it comes in and goes.

    >>> from gtmbench.faults.kinds.additive import Noise
    >>> settings_of(Noise(channel="p", onset_s=300, deviation=2, ramp_s=5))
    {'seed': 0, 'ramp_s': 5}
    """
    own = {item.name: getattr(fault, item.name) for item in fault.parameters() if not item.is_severity}
    times = {name: value for name in ("duration_s", "ramp_s") if (value := getattr(fault, name))}
    spells = {} if fault.intermittent is None else asdict(fault.intermittent)
    return {**own, **times, **{f"intermittent_{name}": value for name, value in spells.items()}}


def _differences(verdict: Verdict, expected: Expectation) -> Iterator[str]:
    """Say where a verdict differs from what is expected."""
    delay_s = verdict.detection_delay_s
    if expected.undetectable_because:
        if delay_s is not None:
            yield f"alarm {delay_s:.2f} s after the onset, expected none ({expected.undetectable_because})"
        return
    within_s = expected.detect_within_s
    by = "" if within_s is None else f" within {within_s:g} s"
    if delay_s is None:
        yield f"missed, expected an alarm{by}"
        return
    if within_s is not None and delay_s > within_s + 1e-9:
        yield f"alarm {delay_s:.2f} s after the onset, expected{by}"
    wanted = expected.isolate_as
    is_within = verdict.sensor == wanted[0] if len(wanted) == 1 else bool(verdict.candidates)
    if wanted and not (is_within and set(verdict.candidates) <= set(wanted)):
        yield f"{verdict.verdict or 'no sensor named'}, expected {' or '.join(wanted)}"
    if expected.kind is not None and verdict.kind != expected.kind:
        yield f"kind {verdict.kind or 'not told'}, expected {expected.kind}"
