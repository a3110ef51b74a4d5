"""A study in words, the table at the end of a run and what stands below it; and the verdict of a campaign's scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from gtmbench.bench.loop_flight import OUT_OF_LOOP
from gtmbench.checks import listed
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.errors import InputError
from gtmbench.faults.registry import find_fault
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.report.words.judgement import fault_text, kind_text, parameter_unit, severity_text, trial_text
from gtmbench.report.words.monitor import monitor_lines
from gtmbench.report.words.units import counted, or_dash, two_digits
from gtmbench.study.run import Rescue
from gtmbench.study.scores.curves import Smallest
from gtmbench.study.scores.intervals import Estimate, Rate, Share
from gtmbench.study.scores.scoring import DetectorScores, Scores
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
        "severity": severity_text(trial.injected),
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
    told = []
    for baseline in study.baselines:
        trials, stuck = study.trials_of(baseline.detector), _stuck(baseline)
        cannot = f"Cannot tell: {listed(stuck or [''])} stood above the threshold before anything failed"
        told.append((baseline.detector, cannot if stuck else found_text(totals(baseline, trials))))
    return found_verdict(told)


def totals(baseline: Baseline, trials: Sequence[Trial]) -> dict[str, Any]:
    """Return what a detector found, in figures; what it doesn't claim to find is None."""
    named = dict.fromkeys(("isolated", "named_wrong", "axis_right", "kind_right", "kind_right_20s"))
    if baseline.monitor.suspects:
        named = {name: _count(trials, name) for name in named}
    return {
        "trials": len(trials),
        "detected": _count(trials, "detected"),
        **named,
        "expected": sum(trial.expected is not None for trial in trials),
        "unexpected": _count(trials, "unexpected"),
        **false_alarm_figures(baseline.false_alarms, baseline.healthy_hours),
    }


def false_alarm_figures(alarms: int, hours: float) -> dict[str, Any]:
    """Return how many false alarms there were in how many healthy hours, and the rate's upper 95 % bound."""
    return {"false_alarms": alarms, "healthy_hours": hours, "false_alarms_per_hour_at_most": rate_bound(alarms, hours)}


def found_text(row: Mapping[str, Any]) -> str:
    """Say what a detector found, of figures such as `totals`."""
    found = f"{or_dash(row['detected'], 'd')} of {counted(row['trials'], 'fault')} detected"
    if row["isolated"] is not None:
        found += f", {row['isolated']} sensors named rightly, {row['named_wrong'] or 'none'} wrongly"
    alarms = counted(row["false_alarms"], "false alarm") if row["false_alarms"] else "no false alarm"
    differing = row.get("unexpected")
    otherwise = f"; {differing} not as its scenario expects" if differing else ""
    return f"{found}; {alarms} in {row['healthy_hours']:.2f} h of healthy flight{otherwise}"


def found_verdict(told: Sequence[tuple[str, str]]) -> str:
    """Return what is said of each detector as a sentence, their names where there are several."""
    return f"{'; '.join(f'{name}: {said}' if len(told) > 1 else said for name, said in told)}."


def further_lines(row: Mapping[str, Any]) -> list[str]:
    """Say what a verdict leaves out: kinds, expectations, up to which rate of false alarms the flights tell."""
    lines = []
    if row["kind_right"] is not None:
        soon = f", {row['kind_right_20s']} at 20 s after the alarm" if "kind_right_20s" in row else ""
        lines.append(f"the right kind of fault: {row['kind_right']} at the end{soon}")
    if row.get("expected"):
        lines.append(f"expectations met: {row['expected'] - row['unexpected']} of {row['expected']}")
    bound = row["false_alarms_per_hour_at_most"]
    return lines if bound is None else [*lines, f"false alarms: at most {bound:.2g} an hour at 95 % confidence"]


def _count(trials: Sequence[Trial], name: str) -> int:
    return sum(bool(getattr(trial, name)) for trial in trials)


def _stuck(baseline: Baseline) -> list[str]:
    """Return the scores that can't tell anything: they stood above their thresholds from the start."""
    return [score.name for score in baseline.watch.scores.values() if score.is_stuck_above]


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
    """Say of every detector what the verdict leaves out, and what it is."""
    lines = []
    for baseline in study.baselines:
        trials = study.trials_of(baseline.detector)
        own = [
            *_advice(baseline, trials),
            *_departure_lines(trials),
            *further_lines(totals(baseline, trials)),
            *(
                f"not as expected: {trial_text(each)}: {'; '.join(each.unexpected)}"
                for each in trials
                if each.unexpected
            ),
        ]
        if stuck := _stuck(baseline):
            own.append(
                f"can't tell: on the healthy record {', '.join(stuck)} stood above the threshold from "
                f"{baseline.watch.record.start_s:g} s on and never came down, so no alarm was possible"
            )
        own += monitor_lines(baseline.monitor, baseline.watch)
        lines += [f"{baseline.detector}:", *(f"  {line}" for line in own)] if len(study.baselines) > 1 else own
    return lines


def _advice(baseline: Baseline, trials: Sequence[Trial]) -> list[str]:
    """Say what to try where nothing was found, if something could have been."""
    if _count(trials, "detected") or _stuck(baseline):
        return []
    nearest = max((trial.peak_ratio for trial in trials if trial.watch.scores), default=None)
    reached = "" if nearest is None else f" (the nearest score reached {100.0 * nearest:.0f} % of its threshold)"
    other = "another detector: gtmbench list" if baseline.monitor.suspects else "a bank: --detector C"
    return [f"nothing was detected{reached}; try a more severe fault, a longer flight after the onset, or {other}"]


def _departure_lines(trials: Sequence[Trial]) -> list[str]:
    """Say of trials in the loop how many departed, and which faults the autopilot doesn't fly on."""
    departed = [(trial.departure_time_s, trial.alarm_time_s) for trial in trials if trial.departure_time_s is not None]
    late = sum(alarm_s is None or alarm_s > departed_s for departed_s, alarm_s in departed)
    lines = [f"departed: {len(departed)} of {len(trials)}, {late} of them without an alarm before"] if departed else []
    unread = {event.channel for trial in trials for event in trial.events if event.kind == OUT_OF_LOOP}
    if unread:
        lines.append(f"not in the loop: the autopilot doesn't read {listed(sorted(unread))}")
    return lines


_MOST_NAMES = 6  # of detectors, in a sentence
_MOST_LINES = 3  # of detectors that share the first place


def share_words(found: Share) -> str:
    """Write a share with its interval.

    >>> share_words(Share(hits=9, of=10, low=0.55, high=0.998))
    '90 % [55, 99.8]'
    """
    if found.value is None:
        return "-"
    return f"{_percent(found.value)} % [{_percent(found.low)}, {_percent(found.high)}]"


def _percent(value: float) -> str:
    """Write a share in percent, as finely as it is near 0 or 1."""
    percent = 100.0 * value
    fine = 0.0 < percent < 9.95 or 90.05 < percent < 100.0
    return f"{percent:.1f}".removesuffix(".0") if fine else f"{percent:.0f}"


def rate_words(found: Rate) -> str:
    """Write a rate an hour with its interval."""
    if found.value is None:
        return "-"
    value, low, high = map(two_digits, (found.value, found.low, found.high))
    return f"{value} [{low}, {high}]"


def seconds_words(found: Estimate | None) -> str:
    """Write a delay with its interval, where it has one.

    >>> seconds_words(Estimate(value=0.274, low=0.21, high=1.5)), seconds_words(Estimate(value=61.2))
    ('0.27 [0.21, 1.50]', '61.2')
    """
    if found is None:
        return "-"
    if found.low is None or found.high is None:
        return _seconds(found.value)
    return f"{_seconds(found.value)} [{_seconds(found.low)}, {_seconds(found.high)}]"


def _seconds(value: float) -> str:
    return f"{value:.2f}" if value < 9.995 else f"{value:.1f}"


def severity_words(found: Smallest) -> str:
    """Write the smallest fault that is detected in nine of ten searches, with its interval."""
    value = found.severity
    if value.low is None or value.high is None or value.low == value.high:
        return _severity(found, value.value)
    low, high = sorted((value.low, value.high), key=lambda bound: (not math.isfinite(bound), bound))
    return f"{_severity(found, value.value)} [{_severity(found, low)}, {_severity(found, high)}]"


def _severity(found: Smallest, value: float) -> str:
    factor = 100.0 if found.share_of else 1.0
    beyond = "over " if found.severest > found.mildest else "under "
    below = "at most " if found.severest > found.mildest else "at least "
    if not math.isfinite(value):
        return f"{beyond}{factor * found.severest:.3g}"
    return f"{below if value == found.mildest else ''}{factor * value:.3g}"


def severity_unit(found: Smallest) -> str:
    """Return what a search's severities are in: the parameter's unit, or what they are a share of."""
    if found.share_of:
        return f"% of {found.share_of}"
    try:
        parameters = find_fault(found.fault).parameters()
    except InputError:  # of somebody's own, which isn't imported here
        return ""
    own = (parameter_unit(item, unit_of(found.channel)) for item in parameters if item.name == found.parameter)
    return next(own, "")


# ---- the verdict ----


def verdict_lines(scores: Scores) -> list[str]:
    """Say what a campaign comes to: who is soonest, at what price, who gets no score, what isn't known."""
    without = [f"{one.name} gets no score: {one.no_score}." for one in scores.detectors if not one.is_quiet]
    return [*_best_lines(scores), *without, *_price_lines(scores), *_thin_lines(scores)]


def _best_lines(scores: Scores) -> list[str]:
    by_name = {one.name: one for one in scores.detectors}
    if not scores.ranks:
        quiet = [one for one in scores.detectors if one.is_quiet]
        return [_merits_line(one) for one in quiet if one.merits] or ["No detector has a score of trials."]
    best = [rank.detector for rank in scores.ranks if rank.best == 1]
    if len(best) == len(scores.ranks) > 1:
        shared = f"No detector is significantly sooner than another: {_names(best)} share the first place."
        return [shared, *[_merits_line(by_name[name]) for name in best[:_MOST_LINES]]]
    if len(best) == 1:
        others = len(scores.ranks) - 1
        beats = "significantly sooner than every other" if scores.ranks[0].worst == 1 else "and none is sooner"
        first = [f"{best[0]} is the first of {others + 1} detectors, {beats}."] if others else []
        return [*first, _merits_line(by_name[best[0]])]
    shared = f"{_names(best)} share the first place: no test tells them apart."
    return [shared, *[_merits_line(by_name[name]) for name in best[:_MOST_LINES]]]


def _merits_line(one: DetectorScores) -> str:
    found = one.merits
    assert found is not None
    line = f"{one.name} detected {share_words(found.detected)} of {counted(found.trials, 'fault')}"
    if found.delays is not None:
        line += f", half of those within {seconds_words(found.delays.median)} s"
    if found.naming is not None:
        line += f"; it named the right sensor of {share_words(found.naming.right)}, a wrong one of "
        line += share_words(found.naming.wrong)
    return line + "."


def _price_lines(scores: Scores) -> list[str]:
    """Say who isn't shown to keep the target: that isn't shown by few hours."""
    open_ = [one for one in scores.detectors if one.is_quiet and one.false_alarms.high > scores.target_per_hour]
    if not open_:
        quiet = [one.name for one in scores.detectors if one.is_quiet]
        keep = "keeps" if len(quiet) == 1 else "keep"
        return [f"{_names(quiet)} {keep} to the target of {_target(scores)}, by the upper bound."] if quiet else []
    hours = max(one.false_alarms.hours for one in open_)
    keep = "keeps" if len(open_) == 1 else "keep"
    return [
        f"Whether {_names([one.name for one in open_])} {keep} to the target of {_target(scores)} is neither shown nor "
        f"refuted by {hours:.2g} h of healthy flight."
    ]


def _target(scores: Scores) -> str:
    return f"{scores.target_per_hour:g} false alarm{'s' * (scores.target_per_hour != 1.0)} an hour"


def _thin_lines(scores: Scores) -> list[str]:
    flights = max((one.merits.flights for one in scores.detectors if one.merits), default=0)
    if 0 < flights < 6:
        return [f"These figures rest on {counted(flights, 'flight')}, too few to say how delays would be on others."]
    return []


def _names(names: Sequence[str]) -> str:
    shown = list(names[:_MOST_NAMES])
    return listed(shown if len(names) <= _MOST_NAMES else [*shown, f"{len(names) - _MOST_NAMES} others"])
