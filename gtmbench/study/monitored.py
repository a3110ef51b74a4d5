"""Running scenarios with a monitor: fly, measure, break, watch, and hold what it found against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from gtmbench.bench.trim import Trim
from gtmbench.detectors.bank.bank import Bank, load_bank
from gtmbench.detectors.bank.detector import BankMonitor
from gtmbench.detectors.protocol import Watch, watch
from gtmbench.errors import InputError
from gtmbench.files import is_file, shipped_banks
from gtmbench.record import Record
from gtmbench.study.calibrated import FLIGHTS, calibrated
from gtmbench.study.flown import Flown, Progress, common_setup, counted, fly_setup
from gtmbench.study.monitor_score import MonitorVerdict, score_watch
from gtmbench.study.scenario import AlarmSetup, OperatorSetup, Scenario, Setup
from gtmbench.study.trial import Injection


@dataclass(frozen=True, kw_only=True, eq=False)
class MonitoredBaseline:
    """What the trials of a monitored study share.

    Attributes
    ----------
    setup, trim, flight
        What was flown; `flight` is truth.
    healthy : Record
        The measurements that are broken in the trials; the same as without a monitor.
    monitor : BankMonitor
    watched : Watch
        Of `healthy`, from `setup.alarm.watch_from_s` on.
    false_alarms : int
    healthy_hours : float
        Alarms on the healthy records, and the hours in which there could be one.
    """

    setup: Setup
    trim: Trim
    flight: Record = field(repr=False)
    healthy: Record = field(repr=False)
    monitor: BankMonitor
    watched: Watch = field(repr=False)
    false_alarms: int
    healthy_hours: float


@dataclass(frozen=True, kw_only=True, eq=False)
class MonitoredTrial(Injection, MonitorVerdict):
    """One fault, watched by a monitor: the verdict and what it was reached on.

    Attributes
    ----------
    watched : Watch
        Of the broken record, from `setup.alarm.watch_from_s` on.
    baseline : MonitoredBaseline
        Shared by the trials of a study.
    """

    watched: Watch = field(repr=False)
    baseline: MonitoredBaseline = field(repr=False)

    def row(self) -> dict[str, object]:
        """Return the trial as one row of the results, units in the names."""
        verdict = {item.name: getattr(self, item.name) for item in fields(MonitorVerdict)}
        return {
            "scenario": self.scenario,
            "fault": self.fault,
            "channel": self.channel,
            **verdict,
            "candidates": list(self.candidates),
            "parameters": [vars(one) for one in self.parameters],
            "severity": self.severity,
            "unit": self.unit,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class MonitoredStudy:
    """Scenarios of one flight, watched by one monitor: what they share, and every trial."""

    baseline: MonitoredBaseline
    trials: tuple[MonitoredTrial, ...]


def find_monitor(source: str | Path) -> BankMonitor | Bank:
    """Return a calibrated monitor from its file (.json), or a bank, by name or TOML file, that is yet to calibrate.

    Raises
    ------
    InputError
        Naming what there is.

    Examples
    --------
    >>> find_monitor("C").name
    'C'
    """
    path = Path(source)
    if path.suffix != ".json":
        return load_bank(source)
    if not is_file(path):
        raise InputError(
            f"{path}: no such monitor; `gtmbench calibrate --out {path.name}` writes one, or give a bank: "
            f"{', '.join(shipped_banks())}"
        )
    from gtmbench.detectors.bank.files import load_monitor

    return load_monitor(path)


def run_monitored(
    scenarios: Sequence[Scenario],
    monitor: BankMonitor | Bank,
    *,
    seed: int | None = None,
    progress: Progress = lambda _step, _done, _of: None,
) -> MonitoredStudy:
    """Run scenarios that share a flight, watched by a monitor; their ``[operator]`` and thresholds aren't used.

    Of ``[alarm]``, `watch_from_s` and `healthy_records` hold. Scenarios that state neither snr nor noise have the T2's
    noise here.

    Parameters
    ----------
    scenarios : sequence of Scenario
    monitor : BankMonitor or Bank
        A bank is calibrated first, on flights of its own with the scenarios' sensors.
    seed : int, optional
        Instead of the scenarios'.
    progress : callable
        Told the step, how many are done, and of how many.

    Raises
    ------
    InputError
        Where the scenarios' setups differ, or the monitor doesn't fit their records.
    """
    setup = common_setup([_without_detector(scenario) for scenario in scenarios], seed)
    specs = [(scenario.name, spec) for scenario in scenarios for spec in scenario.faults]
    total = 2 + setup.alarm.healthy_records + len(specs) + (FLIGHTS + 1 if isinstance(monitor, Bank) else 0)
    tell = counted(progress, total)
    flown = fly_setup(setup, tell)
    ready = calibrated(monitor, flown, tell) if isinstance(monitor, Bank) else monitor
    healthy = flown.sensed(2)
    watches = []
    for number in range(setup.alarm.healthy_records):
        tell(f"healthy record {number + 1}")
        watches.append(_watched(ready, healthy if number == 0 else flown.sensed(2 + number), setup))
    baseline = _baseline(flown, ready, healthy, watches)
    trials = []
    for name, spec in specs:
        tell(f"{spec.kind} of {spec.channel}")
        trials.append(_trial(flown.broken(name, spec, healthy), baseline))
    progress("done", total, total)
    return MonitoredStudy(baseline=baseline, trials=tuple(trials))


def _without_detector(scenario: Scenario) -> Scenario:
    """Return a scenario without what a monitor doesn't use, so that it can't keep scenarios apart.

    Where it doesn't state its sensors' noise, they are the T2's, which monitors are calibrated on unless told.
    """
    alarm = scenario.setup.alarm
    kept = AlarmSetup(watch_from_s=alarm.watch_from_s, healthy_records=alarm.healthy_records)
    setup = replace(scenario.setup, operator=OperatorSetup(), alarm=kept)
    return replace(scenario, setup=setup if scenario.states_noise else replace(setup, snr=None, noise="t2"))


def _baseline(flown: Flown, monitor: BankMonitor, healthy: Record, watches: list[Watch]) -> MonitoredBaseline:
    return MonitoredBaseline(
        setup=flown.setup,
        trim=flown.trim,
        flight=flown.flight,
        healthy=healthy,
        monitor=monitor,
        watched=watches[0],
        false_alarms=sum(len(seen.findings) for seen in watches),
        healthy_hours=sum(seen.armed_hours for seen in watches),
    )


def _watched(monitor: BankMonitor, record: Record, setup: Setup) -> Watch:
    """Watch a record; the series behind the levels are let go: they are most of the memory."""
    seen = watch(monitor, record.between(min(setup.alarm.watch_from_s, record.end_s), record.end_s))
    return replace(seen, levels={output: replace(level, series=()) for output, level in seen.levels.items()})


def _trial(broken: Injection, baseline: MonitoredBaseline) -> MonitoredTrial:
    seen = _watched(baseline.monitor, broken.record, baseline.setup)
    verdict = score_watch(seen, fault=broken.injected, healthy=baseline.healthy, broken=broken.record)
    return MonitoredTrial(**vars(verdict), **vars(broken), watched=seen, baseline=baseline)
