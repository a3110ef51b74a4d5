"""A study in words: the table at the end of a run, and what stands below it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gtmbench.bench.loop_flight import OUT_OF_LOOP
from gtmbench.checks import listed
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.report.words.judgement import fault_text, kind_text, severity_text, trial_text
from gtmbench.report.words.monitor import monitor_lines
from gtmbench.report.words.units import counted, or_dash
from gtmbench.study.run import Rescue
from gtmbench.study.trial import Baseline, Study, Trial
from gtmbench.values.channels import unit_of


def title(baseline: Baseline) -> str:
    """Name what watched: ``dissertation, [p q beta] -> r``, ``C``."""
    operator = getattr(baseline.monitor, "operator", None)
    return f"{baseline.detector}, {operator.name}" if isinstance(operator, Transmissibility) else baseline.detector


def trial_rows(study: Study) -> tuple[list[str], list[list[str]], list[str]]:
    """Return columns, rows and which columns are numbers: of a table of trials, what is nowhere left out."""
    rows = [_cells(trial) for trial in study.trials]
    left_out: set[str] = set()
    if all(trial.scenario == trial.fault for trial in study.trials):  # the package's own
        left_out.add("scenario")
    if not any(trial.also for trial in study.trials):
        left_out.add("also")
    if not any(trial.events for trial in study.trials):
        left_out.add("departed (s)")
    columns = [name for name in rows[0] if name not in left_out]
    numbers = ("severity", "delay (s)", "departed (s)", "named (s)", "peak")
    return columns, [[row[name] for name in columns] for row in rows], [name for name in columns if name in numbers]


def _cells(trial: Trial) -> dict[str, str]:
    departed_s = None if trial.departure_time_s is None else trial.departure_time_s - trial.onset_s
    return {
        "detector": trial.detector,
        "scenario": trial.scenario,
        "fault": trial.fault,
        "channel": trial.channel,
        "severity": severity_text(trial),
        "also": "; ".join(f"{fault_text(fault)}, from {fault.onset_s:g} s" for fault in trial.also),
        "delay (s)": or_dash(trial.detection_delay_s, ".2f"),
        "departed (s)": or_dash(departed_s, ".2f"),
        "named (s)": or_dash(trial.isolation_delay_s, ".2f"),
        "peak": f"{trial.peak_ratio:.2f}" if trial.watch.scores else "-",
        "verdict": _verdict(trial),
        "kind": _kind(trial),
    }


def _verdict(trial: Trial) -> str:
    verdict = trial.verdict or "detected" if trial.detected else "missed"
    if trial.reason:
        verdict += f"{' -' if trial.detected else ':'} {trial.reason}"
    if trial.named_wrong:
        verdict += " (wrong)"
    if trial.ended_s is not None:
        verdict += f", ended at {trial.ended_s:.2f} s"
    early = counted(trial.false_alarms, "false alarm")
    return f"{verdict}; {early} before the onset" if trial.false_alarms else verdict


def _kind(trial: Trial) -> str:
    if trial.kind is None:
        return "-"
    values = {estimate.name: estimate.value for estimate in trial.parameters}
    intervals = {each.name: (each.low, each.high) for each in trial.parameters if not math.isnan(each.low)}
    likeliest = trial.candidates[0] if trial.candidates else trial.channel
    kind = kind_text(trial.kind, values, intervals, unit_of(likeliest), trial.partner, trial.injected)
    return kind + ("" if trial.kind_right or trial.kind == UNKNOWN else " (wrong)")


def study_verdict(study: Study) -> str:
    """Say in a sentence what every detector found, and how often it alarmed without a fault."""
    told = [_detector_verdict(baseline, study.trials_of(baseline.detector)) for baseline in study.baselines]
    if len(told) == 1:
        return f"{told[0]}."
    return f"{'; '.join(f'{each.detector}: {said}' for each, said in zip(study.baselines, told, strict=True))}."


def _count(trials: Sequence[Trial], name: str) -> int:
    """Return of how many trials something holds."""
    return sum(bool(getattr(trial, name)) for trial in trials)


def _stuck(baseline: Baseline) -> list[str]:
    """Return the scores that can't tell anything: they stood above their thresholds from the start."""
    return [score.name for score in baseline.watch.scores.values() if score.is_stuck_above]


def _detector_verdict(baseline: Baseline, trials: Sequence[Trial]) -> str:
    if stuck := _stuck(baseline):
        return f"Cannot tell: {listed(stuck)} stood above the threshold before anything failed"
    found = f"{_count(trials, 'detected')} of {counted(len(trials), 'fault')} detected"
    if baseline.monitor.suspects:
        wrong = _count(trials, "named_wrong") or "none"
        found += f", {_count(trials, 'isolated')} sensors named rightly, {wrong} wrongly"
    alarms = counted(baseline.false_alarms, "false alarm") if baseline.false_alarms else "no false alarm"
    differing = _count(trials, "unexpected")
    otherwise = f"; {differing} not as its scenario expects" if differing else ""
    return f"{found}; {alarms} in {baseline.healthy_hours:.2f} h of healthy flight{otherwise}"


def rescue_verdict(rescue: Rescue) -> str:
    """Say in a sentence whether flying without the broken sensor saved the aircraft."""
    since = rescue.onset_s
    told = {
        name: "flies on" if flight.departed_s is None else f"departs {flight.departed_s - since:.1f} s after the onset"
        for name, flight in rescue.flights.items()
    }
    saved = rescue.rescued.departed_s is None and rescue.unaided.departed_s is not None
    first = "Saved" if saved else "Not saved" if rescue.rescued.departed_s is not None else "No need to save it"
    return f"{first}: without accommodation the aircraft {told['unaided']}, with it the aircraft {told['rescued']}."


def summary_lines(study: Study) -> list[str]:
    """Say of every detector how much it found, what alarmed without a fault, and what it is."""
    lines = []
    for baseline in study.baselines:
        trials, bound = study.trials_of(baseline.detector), rate_bound(baseline.false_alarms, baseline.healthy_hours)
        limit = "" if bound is None else f" (at most {bound:.1f} an hour at 95 % confidence)"
        watched = f"healthy flight watched: {baseline.healthy_hours:.2f} h{limit}"
        own = [
            *_found_lines(baseline, trials),
            *_departure_lines(trials),
            f"false alarms: {baseline.false_alarms}; {watched}",
            *_expectation_lines(trials),
        ]
        if stuck := _stuck(baseline):
            own.append(
                f"can't tell: on the healthy record {', '.join(stuck)} stood above the threshold from "
                f"{baseline.watch.record.start_s:g} s on and never came down, so no alarm was possible"
            )
        own += monitor_lines(baseline.monitor, baseline.watch)
        lines += [f"{baseline.detector}:", *(f"  {line}" for line in own)] if len(study.baselines) > 1 else own
    return lines


def _found_lines(baseline: Baseline, trials: Sequence[Trial]) -> list[str]:
    """Say how much was found; and what to try where nothing was, if something could have been."""
    detected = _count(trials, "detected")
    line = f"detected: {detected} of {len(trials)}"
    if baseline.monitor.suspects:
        isolated, wrong, right_20s, right = (
            _count(trials, name) for name in ("isolated", "named_wrong", "kind_right_20s", "kind_right")
        )
        line += (
            f"; the right sensor named: {isolated}, a wrong one: {wrong}; the right kind of fault 20 s after the "
            f"alarm: {right_20s}, at the end: {right}"
        )
    if detected or _stuck(baseline):
        return [line]
    nearest = max((trial.peak_ratio for trial in trials if trial.watch.scores), default=None)
    reached = "" if nearest is None else f" (the nearest score reached {100.0 * nearest:.0f} % of its threshold)"
    other = "another detector: gtmbench list" if baseline.monitor.suspects else "a bank: --detector C"
    said = f"nothing was detected{reached}; try a more severe fault, a longer flight after the onset, or {other}"
    return [line, said]


def _departure_lines(trials: Sequence[Trial]) -> list[str]:
    """Say of trials in the loop how many departed, and which faults the autopilot doesn't fly on."""
    departed = [(trial.departure_time_s, trial.alarm_time_s) for trial in trials if trial.departure_time_s is not None]
    late = sum(alarm_s is None or alarm_s > departed_s for departed_s, alarm_s in departed)
    lines = [f"departed: {len(departed)} of {len(trials)}, {late} of them without an alarm before"] if departed else []
    unread = {event.channel for trial in trials for event in trial.events if event.kind == OUT_OF_LOOP}
    if unread:
        lines.append(f"not in the loop: the autopilot doesn't read {listed(sorted(unread))}")
    return lines


def _expectation_lines(trials: Sequence[Trial]) -> list[str]:
    """Say how many trials went as the scenarios expect, and where reality differs."""
    expected = [trial for trial in trials if trial.expected is not None]
    if not expected:
        return []
    differing = [trial for trial in expected if trial.unexpected]
    return [
        f"expectations met: {len(expected) - len(differing)} of {len(expected)}",
        *(f"not as expected: {trial_text(trial)}: {'; '.join(trial.unexpected)}" for trial in differing),
    ]
