"""Running scenarios: trim, fly, measure, identify, threshold, then one trial a fault."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from gtmbench.bench.fault import Fault
from gtmbench.bench.faults import inject
from gtmbench.bench.flight import fly
from gtmbench.bench.sensors import measure
from gtmbench.bench.trim import trim
from gtmbench.channels import unit_of
from gtmbench.errors import InputError
from gtmbench.method.alarms import alarms, threshold
from gtmbench.method.identify import identify
from gtmbench.method.residual import Residual, WindowedNorm, residual, windowed_norm
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import Record
from gtmbench.study.fault_spec import FaultSpec, build
from gtmbench.study.scenario import Scenario, Setup, load_scenario
from gtmbench.study.score import score
from gtmbench.study.severity import resolve
from gtmbench.study.trial import Baseline, Study, Trial

Progress = Callable[[str, int, int], None]
_SEED_STEP = 1000  # between the noise seeds of one study's records, so that studies with near seeds share none


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
    setup = _common_setup(scenarios)
    if seed is not None:
        setup = replace(setup, seed=seed)
    specs = [(scenario.name, spec) for scenario in scenarios for spec in scenario.faults]
    total = 4 + setup.alarm.healthy_records + len(specs)
    done = 0

    def tell(step: str) -> None:
        nonlocal done
        progress(step, done, total)
        done += 1

    baseline = _baseline(setup, tell)
    reference = baseline.flight.between(*setup.severity_reference_s)
    trials = []
    for name, spec in specs:
        tell(f"{spec.kind} of {spec.channel}")
        trials.append(_trial(name, _fault(spec, reference), baseline))
    progress("done", total, total)
    return Study(baseline=baseline, trials=tuple(trials))


def _common_setup(scenarios: Sequence[Scenario]) -> Setup:
    if not scenarios:
        raise InputError("no scenario given")
    first = scenarios[0]
    names = [scenario.name for scenario in scenarios]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"two scenarios go by the name '{twice[0]}'; rename one file, or run them one at a time")
    for other in scenarios[1:]:
        if other.setup != first.setup:
            one, two = asdict(first.setup), asdict(other.setup)
            key = next(key for key in one if one[key] != two[key])
            raise InputError(
                f"scenarios '{first.name}' and '{other.name}' differ in {key} ({one[key]} and {two[key]}); a study has "
                "one flight and one operator, so run them one at a time"
            )
    return first.setup


def _baseline(setup: Setup, tell: Callable[[str], None]) -> Baseline:
    tell("trim")
    trimmed = trim(setup.aircraft)
    tell("fly")
    flight = fly(setup.aircraft, setup.excitation, setup.duration_s, setup.seed)

    def sensed(number: int) -> Record:
        return measure(flight, snr=setup.snr, noise=setup.noise, seed=setup.seed + _SEED_STEP * number)

    tell("identify")
    operator = identify(
        sensed(0).between(*setup.operator.identify_s),
        inputs=setup.operator.inputs,
        outputs=setup.operator.outputs,
        causal_order=setup.operator.causal_order,
        noncausal_order=setup.operator.noncausal_order,
    )
    tell("threshold")
    _, norm = _residual_and_norm(operator, sensed(1), setup)
    start_s, end_s = setup.alarm.threshold_s
    limit = threshold(norm, start_s=start_s, end_s=end_s, factor=setup.alarm.threshold_factor)
    healthy = sensed(2)
    healthy_residual, healthy_norm = _residual_and_norm(operator, healthy, setup)
    watched = []
    for number in range(setup.alarm.healthy_records):
        tell(f"healthy record {number + 1}")
        norm = healthy_norm if number == 0 else _residual_and_norm(operator, sensed(2 + number), setup)[1]
        watched.append(alarms(norm, limit, start_s=setup.alarm.watch_from_s))
    armed = [raised.armed_s for raised in watched if not math.isnan(raised.armed_s)]
    return Baseline(
        setup=setup,
        trim=trimmed,
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


def _fault(spec: FaultSpec, reference: Record) -> Fault:
    return build(spec, {name: resolve(share, reference, spec.channel) for name, share in spec.severities.items()})


def _trial(scenario: str, fault: Fault, baseline: Baseline) -> Trial:
    setup = baseline.setup
    broken = inject(baseline.healthy, fault)
    found, norm = _residual_and_norm(baseline.operator, broken, setup)
    raised = alarms(norm, baseline.threshold, start_s=setup.alarm.watch_from_s)
    operator = baseline.operator
    channels = (*operator.inputs, *operator.outputs)
    verdict = score(raised, norm, fault=fault, healthy=baseline.healthy, broken=broken, channels=channels)
    return Trial(
        **asdict(verdict),
        scenario=scenario,
        fault=fault.kind,
        channel=fault.channel,
        severity=fault.severities,
        unit=unit_of(fault.channel),
        injected=fault,
        record=broken,
        residual=found,
        norm=norm,
        alarms=raised,
        baseline=baseline,
    )
