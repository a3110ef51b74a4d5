"""Running scenarios: trim, fly, measure, identify, threshold, then one trial a fault."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from gtmbench.method.alarms import alarms, threshold
from gtmbench.method.identify import identify
from gtmbench.method.residual import Residual, WindowedNorm, residual, windowed_norm
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import Record
from gtmbench.study.flown import Flown, Progress, Tell, common_setup, counted, fly_setup
from gtmbench.study.scenario import Scenario, Setup, load_scenario
from gtmbench.study.score import score
from gtmbench.study.trial import Baseline, Injection, Study, Trial


def run(scenario: str | Path | Scenario, *, seed: int | None = None) -> list[Trial]:
    """Run one scenario, from trim to verdicts, and return its trials.

    Parameters
    ----------
    scenario : str, Path or Scenario
        A TOML file, or the name of one of the package's (``drift``).
    seed : int, optional
        Instead of the scenario's.

    Raises
    ------
    GtmbenchError
        Of the kind that says what went wrong: a bad scenario, no trim, a flight out of its envelope.

    Examples
    --------
    >>> trials = run("jam")
    >>> [(trial.channel, trial.detected) for trial in trials]
    [('p', True), ('q', True), ('r', True)]
    """
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    return list(run_study([loaded], seed=seed).trials)


def run_study(
    scenarios: Sequence[Scenario], *, seed: int | None = None, progress: Progress = lambda _step, _done, _of: None
) -> Study:
    """Run scenarios that share a setup; `progress` is told the step, how many are done, and of how many.

    Raises
    ------
    InputError
        Where the scenarios' setups differ: one study has one flight and one operator.
    """
    setup = common_setup(scenarios, seed)
    specs = [(scenario.name, spec) for scenario in scenarios for spec in scenario.faults]
    total = 4 + setup.alarm.healthy_records + len(specs)
    tell = counted(progress, total)
    flown = fly_setup(setup, tell)
    baseline = _baseline(flown, tell)
    trials = []
    for name, spec in specs:
        tell(f"{spec.kind} of {spec.channel}")
        trials.append(_trial(flown.broken(name, spec, baseline.healthy), baseline))
    progress("done", total, total)
    return Study(baseline=baseline, trials=tuple(trials))


def _baseline(flown: Flown, tell: Tell) -> Baseline:
    setup, flight = flown.setup, flown.flight
    tell("identify")
    operator = identify(
        flown.sensed(0).between(*setup.operator.identify_s),
        inputs=setup.operator.inputs,
        outputs=setup.operator.outputs,
        causal_order=setup.operator.causal_order,
        noncausal_order=setup.operator.noncausal_order,
    )
    tell("threshold")
    _, norm = _residual_and_norm(operator, flown.sensed(1), setup)
    start_s, end_s = setup.alarm.threshold_s
    limit = threshold(norm, start_s=start_s, end_s=end_s, factor=setup.alarm.threshold_factor)
    healthy = flown.sensed(2)
    healthy_residual, healthy_norm = _residual_and_norm(operator, healthy, setup)
    watched = []
    for number in range(setup.alarm.healthy_records):
        tell(f"healthy record {number + 1}")
        norm = healthy_norm if number == 0 else _residual_and_norm(operator, flown.sensed(2 + number), setup)[1]
        watched.append(alarms(norm, limit, start_s=setup.alarm.watch_from_s))
    armed = [raised.armed_s for raised in watched if not math.isnan(raised.armed_s)]
    return Baseline(
        setup=setup,
        trim=flown.trim,
        flight=flight,
        healthy=healthy,
        operator=operator,
        threshold=limit,
        residual=healthy_residual,
        norm=healthy_norm,
        armed_s=round(armed[0], 9) if armed else None,
        false_alarms=sum(len(raised.time_s) for raised in watched),
        healthy_hours=sum(flight.end_s - armed_s for armed_s in armed) / 3600.0,
    )


def _residual_and_norm(operator: Transmissibility, record: Record, setup: Setup) -> tuple[Residual, WindowedNorm]:
    found = residual(operator, record)
    return found, windowed_norm(found, window=setup.alarm.window)


def _trial(broken: Injection, baseline: Baseline) -> Trial:
    setup = baseline.setup
    found, norm = _residual_and_norm(baseline.operator, broken.record, setup)
    raised = alarms(norm, baseline.threshold, start_s=setup.alarm.watch_from_s)
    operator = baseline.operator
    verdict = score(
        raised,
        norm,
        fault=broken.injected,
        healthy=baseline.healthy,
        broken=broken.record,
        channels=(*operator.inputs, *operator.outputs),
    )
    return Trial(**vars(verdict), **vars(broken), residual=found, norm=norm, alarms=raised, baseline=baseline)
