"""Running scenarios: trim, fly, calibrate what watches, break a sensor, watch, and hold it against the truth.

A departure stands beside its rescue: the same flight, the same fault, without accommodation and with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from gtmbench.bench.aircraft import Aircraft
from gtmbench.bench.loop import fly_in_loop
from gtmbench.bench.loop_flight import LoopFlight
from gtmbench.detectors.accommodation.without_sensor import Accommodate
from gtmbench.detectors.protocol import Monitor, Watch
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.jobs.progress import Progress, Tell, counted, silent
from gtmbench.log.opening.driven_attitude import with_origin
from gtmbench.method.driven_attitude import Origin
from gtmbench.study.fault_tables import FaultSpec, spec_of
from gtmbench.study.flights import Flown, common_setup, fly_setup
from gtmbench.study.scenario import AlarmSetup, OperatorSetup, Scenario, Setup, load_scenario
from gtmbench.study.score import false_alarms, score
from gtmbench.study.trial import Baseline, Study, Trial
from gtmbench.study.watchers import (
    calibrated,
    calibration_steps,
    check_watchers,
    need_commands,
    own_detector,
    resolved,
)
from gtmbench.values.attitude_estimators import OWN
from gtmbench.values.record import Record


def run(
    scenario: str | Path | Scenario,
    *,
    seed: int | None = None,
    detectors: Sequence[object] = (),
    faults: Sequence[Fault | Sequence[Fault]] = (),
) -> list[Trial]:
    """Run one scenario, from trim to verdicts, and return its trials.

    Parameters
    ----------
    scenario : str, Path or Scenario
        A TOML file, or the name of one of the package's (``drift``).
    seed : int, optional
        Replaces the scenario's.
    detectors : sequence
        The detectors, as in `run_study`; by default the scenario's own operator.
    faults : sequence of Fault, or of sequences of Fault
        Replace the scenario's, one trial each (several together are one); your own class works, too.

    Raises
    ------
    GtmbenchError
        The subclass for the cause: a bad scenario, no trim, a flight out of its envelope.

    Examples
    --------
    >>> import gtmbench as gb
    >>> trials = gb.run("jam")
    >>> [(trial.channel, trial.detected) for trial in trials]
    [('p', True), ('q', True), ('r', True)]
    """
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    if faults:
        loaded = replace(loaded, faults=tuple(spec_of(fault, loaded.setup.duration_s) for fault in faults))
    return list(run_study([loaded], detectors=detectors, seed=seed).trials)


def run_study(
    scenarios: Sequence[Scenario],
    *,
    detectors: Sequence[object] = (),
    seed: int | None = None,
    progress: Progress = silent,
) -> Study:
    """Run scenarios that share a flight, watched by one detector or several.

    Each detector is calibrated first, unless it is a monitor already. The dissertation's, and any that is tied to its
    excitation, is calibrated on two healthy records of the study's own flight; others on a dozen healthy flights with
    rich excitation and the study's sensors. All watch the same records from `watch_from_s` on.

    Parameters
    ----------
    scenarios : sequence of Scenario
        Scenarios that state neither snr nor noise have the T2's noise if any detector but their own operator watches.
    detectors : sequence
        Detectors, monitors, banks, functions from a record to times of alarms, or names, as in `find_detector`.
        ``"dissertation"`` is the scenarios' own, with their ``[operator]`` and ``[alarm]``, and the default.
    seed : int, optional
        Replaces the scenarios'.
    progress : callable
        Called with the step, the number done and the total.

    Raises
    ------
    InputError
        If the scenarios' setups differ, a detector is invalid or doesn't fit their records, or was calibrated on
        other sensors: before anything is flown.

    Examples
    --------
    >>> import gtmbench as gb
    >>> def spin(record):
    ...     return record.time_s[abs(record["p"]) > 90.0][:1]
    >>> study = gb.run_study([gb.load_scenario("jam")], detectors=["dissertation", gb.FunctionDetector(spin)])
    >>> [(trial.detector, trial.channel) for trial in study.trials if trial.detected]
    [('dissertation', 'p'), ('dissertation', 'q'), ('dissertation', 'r')]
    """
    watchers = resolved(detectors)
    own = [watcher is own_detector for watcher in watchers.values()]
    if not any(own):
        scenarios = [_without_operator(scenario) for scenario in scenarios]
    if not all(own):
        scenarios = [with_noise(scenario) for scenario in scenarios]
    setup = common_setup(scenarios, seed)
    named = {
        name: watcher(setup) if watcher is own_detector else knowing(watcher, setup.attitude)
        for name, watcher in watchers.items()
    }
    specs = [(scenario.name, spec) for scenario in scenarios for spec in scenario.faults]
    check_watchers(named, setup)
    steps = 2 + calibration_steps(named) + len(named) * (setup.alarm.healthy_records + len(specs))
    tell = counted(progress, steps)
    flown = fly_setup(setup, need_commands(named), tell)
    study = _studied(flown, calibrated(named, flown, tell), specs, tell)
    progress("done", steps, steps)
    return study


def knowing(watcher: Any, attitude: str) -> Any:
    """Return what watches; a bank that is yet to calibrate is told that the gyros drive its flights' attitude.

    >>> from gtmbench.detectors.registry import find_detector
    >>> [knowing(find_detector("C"), attitude).bank.attitude_from_gyros for attitude in ("own", "kalman")]
    [False, True]
    """
    if attitude == OWN:
        return watcher
    return with_origin(watcher, Origin(is_driven=True, why="as the scenario says"))


def _without_operator(scenario: Scenario) -> Scenario:
    """Return a scenario without the settings that no detector uses, so that they can't keep scenarios apart."""
    alarm = scenario.setup.alarm
    kept = AlarmSetup(watch_from_s=alarm.watch_from_s, healthy_records=alarm.healthy_records)
    return replace(scenario, setup=replace(scenario.setup, operator=OperatorSetup(), alarm=kept))


def with_noise(scenario: Scenario) -> Scenario:
    """Return a scenario with the T2's noise where it states none: that is what monitors are calibrated on."""
    if scenario.states_noise:
        return scenario
    return replace(scenario, setup=replace(scenario.setup, snr=None, noise="t2"))


def _studied(flown: Flown, monitors: dict[str, Monitor], specs: Sequence[tuple[str, FaultSpec]], tell: Tell) -> Study:
    """Watch the healthy records, then every fault, with every monitor."""
    healthy = flown.sensed(2)
    watches: dict[str, list[Watch]] = {name: [] for name in monitors}
    for number in range(flown.setup.alarm.healthy_records):
        record = healthy if number == 0 else flown.sensed(2 + number)
        for name, monitor in monitors.items():
            tell(f"healthy record {number + 1}")
            watches[name].append(watched(monitor, record, flown.setup))
    baselines = {
        name: Baseline(
            detector=name,
            setup=flown.setup,
            trim=flown.trim,
            flight=flown.truth,
            healthy=healthy,
            monitor=monitor,
            watch=watches[name][0],
            false_alarms=sum(len(false_alarms(watch)) for watch in watches[name]),
            healthy_hours=sum(watch.armed_hours for watch in watches[name]),
        )
        for name, monitor in monitors.items()
    }
    trials: dict[str, list[Trial]] = {name: [] for name in monitors}
    for scenario, spec in specs:
        broken, unbroken = flown.broken(scenario, spec)
        for name, monitor in monitors.items():
            tell(f"{broken.fault} of {broken.channel}")
            watch = watched(monitor, broken.record, flown.setup)
            verdict = score(watch, fault=broken.injected, also=broken.also, healthy=unbroken, broken=broken.record)
            trials[name].append(
                Trial(
                    **vars(verdict),
                    **vars(broken),
                    detector=name,
                    watch=watch,
                    baseline=baselines[name],
                    expected=spec.expect.get(name),
                )
            )
    return Study(baselines=tuple(baselines.values()), trials=tuple(trial for of in trials.values() for trial in of))


def watched(monitor: Monitor, record: Record, setup: Setup, **more: Any) -> Watch:
    """Watch a record of a study, from where its scenarios say. `more`: that the monitor's `watch` takes."""
    return monitor.watch(record.between(min(setup.alarm.watch_from_s, record.end_s), record.end_s), **more)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rescue:
    """Two flights that are one until the accommodation acts."""

    faults: tuple[Fault, ...]
    unaided: LoopFlight = field(repr=False)  # unaided, rescued: without accommodation, and with it
    rescued: LoopFlight = field(repr=False)
    # watch: what the accommodation's monitor said of what the rescued aircraft's sensors read
    watch: Watch = field(repr=False)

    @property
    def onset_s(self) -> float:
        """When the first fault began."""
        return min(fault.onset_s for fault in self.faults)

    @property
    def flights(self) -> dict[str, LoopFlight]:
        """Both, by what they are."""
        return {"unaided": self.unaided, "rescued": self.rescued}


def fly_rescue(
    faults: Sequence[Fault],
    accommodate: Accommodate,
    *,
    aircraft: str | Path | Aircraft = "gtm",
    duration_s: float = 60.0,
    seed: int = 1,
    sensors: str | None = None,
    altitude_ft: float | None = None,
    tas_kt: float | None = None,
) -> Rescue:
    """Fly through turbulence with faults in the loop, without accommodation and with it."""
    if not faults:
        raise InputError("nothing breaks, so there is nothing to rescue from; give a fault")
    fly = partial(
        fly_in_loop, aircraft, "turbulence", duration_s, seed, sensors=sensors, altitude_ft=altitude_ft, tas_kt=tas_kt
    )
    unaided, rescued = fly(faults=faults), fly(faults=faults, accommodate=accommodate)
    watch = accommodate.monitor.watch(rescued.sensed)
    return Rescue(faults=tuple(faults), unaided=unaided, rescued=rescued, watch=watch)
