"""A watched log in words: what it is, what watched it, what was found, and what was not watched."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from gtmbench.channels import unit_of
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.tails import rate_bound
from gtmbench.detectors.protocol import Watch
from gtmbench.intake.flight_log import FlightLog, Remark
from gtmbench.record import FloatArray, Span
from gtmbench.report.log_faults import began_s, faults_of, given_up_by
from gtmbench.report.log_spans import State, stretches
from gtmbench.report.monitor import facts, origin_text
from gtmbench.report.monitor_text import judgement_text
from gtmbench.report.text import duration_text, per_second, with_unit
from gtmbench.study.watched_log import Outcome, WatchedLog

_MOST = 12  # of remarks, of findings
_MOST_SPANS = 3


def log_report(watched: WatchedLog) -> list[str]:
    """Return the report line by line; the last lines are the outcome and what it is worth."""
    return [
        *_log_lines(watched.log),
        *_remark_lines(watched.log.remarks),
        "",
        *_monitor_lines(watched),
        "",
        *_findings_lines(watched),
        *_unwatched_lines(watched),
        *(f"note: {reason}" for reason in watched.reasons if watched.outcome is not Outcome.UNKNOWN),
        outcome_text(watched),
        *_worth_lines(watched),
    ]


def outcome_text(watched: WatchedLog) -> str:
    """Say in a line what the log comes to.

    Every fault with the time of its alarm; or that nothing was found, and how little that bounds; or why it can't be
    told.
    """
    if watched.outcome is Outcome.UNKNOWN:
        return f"could not tell: {'; '.join(watched.reasons) or 'no stretch is long enough to be watched'}"
    faults = faults_of(watched).values()
    return "; ".join(map(_fault_text, faults)) or f"nothing found{_alarms_text(watched)}"


def _fault_text(same: Sequence[Finding]) -> str:
    first, at = same[0], f"at {same[0].alarm_s:.2f} s"
    if len(same) > 1:
        at += f" (found {len(same)} times, last at {same[-1].alarm_s:.2f} s)"
    named = not first.verdict.startswith("undecided")
    return f"{first.verdict} {at}" if named else f"something failed {at}, {first.verdict}"


def _alarms_text(watched: WatchedLog) -> str:
    """Say which alarms nothing explains, how long was watched, and how few false alarms that shows."""
    passed, bound = passed_alarms(watched), alarm_bound(watched)
    alarms = f"; {passed} alarm{'s' * (passed > 1)} that nothing explains" if passed else ""
    limit = "" if bound is None else f": at most {bound:.{0 if bound >= 10.0 else 1}f} false alarms an hour at 95 %"
    return f"{alarms} in {duration_text(watched.armed_hours)} watched{limit} is all that this length shows"


def passed_alarms(watched: WatchedLog) -> int:
    """Return how many alarms had nothing left to explain: false ones."""
    return sum(not finding.last.candidates for finding in watched.findings)


def alarm_bound(watched: WatchedLog) -> float | None:
    """Return the upper 95 % bound of false alarms an hour that the log shows; None where nothing was watched."""
    return rate_bound(passed_alarms(watched), watched.armed_hours)


def _log_lines(log: FlightLog) -> list[str]:
    first, last = log.segments[0], log.segments[-1]
    length_s = sum(segment.end_s - segment.start_s for segment in log.segments)
    parts = f", {len(log.segments)} segments of {length_s:.2f} s in all" if len(log.segments) > 1 else ""
    return [
        f"{log.path.name}: {_span((first.start_s, last.end_s))}, every {log.sample_period_s:g} s{parts}",
        f"channels: {', '.join(with_unit(name, unit_of(name)) for name in log.channels)}",
        *log.method,
    ]


def _remark_lines(remarks: Sequence[Remark]) -> list[str]:
    """Return a line a remark; of a long list the first, and how many of which kind there are more."""
    lines = [f"remark: {remark_text(remark)}" for remark in remarks[:_MOST]]
    more = Counter(remark.kind for remark in remarks[_MOST:])
    if more:
        last_s = max(remark.end_s for remark in remarks[_MOST:])
        kinds = ", ".join(f"{kind} ({count})" for kind, count in more.most_common())
        lines.append(f"{more.total()} remarks more, up to {last_s:.2f} s: {kinds}")
    return lines


def remark_text(remark: Remark) -> str:
    """Write a remark: when, what, about which channel.

    >>> remark_text(Remark(kind="gap", channel=None, start_s=3.0, end_s=5.0, text="no samples for 2 s"))
    '3.00 to 5.00 s  gap: no samples for 2 s'
    """
    what = remark.kind if remark.channel is None else f"{remark.kind}, {remark.channel}"
    return f"{_span((remark.start_s, remark.end_s))}  {what}: {remark.text}"


def _span(span: Span) -> str:
    return f"{span[0]:z.2f} to {span[1]:z.2f} s"


def _spans(spans: Sequence[Span]) -> str:
    """Write spans, of many the first, and how long they are in all."""
    more = f" and {len(spans) - _MOST_SPANS} more" if len(spans) > _MOST_SPANS else ""
    total = f"; {sum(end_s - start_s for start_s, end_s in spans):.2f} s in all" if len(spans) > 1 else ""
    return ", ".join(map(_span, spans[:_MOST_SPANS])) + more + total


def _monitor_lines(watched: WatchedLog) -> list[str]:
    monitor, seen = watched.monitor, watched.watches
    on = watched.identified_s
    origin = [f"identified and calibrated on this log: {_spans(on)}"] if on else origin_text(monitor)
    lines = [f"bank {monitor.bank.name}: {monitor.bank.title}", *origin]
    for output, known in facts(monitor)["residuals"].items():
        lines.append(f"{output} from {', '.join(known['inputs'])}: {_residual_text(output, known, seen)}")
    return lines


def _residual_text(output: str, known: dict[str, Any], watches: Sequence[Watch]) -> str:
    """Say how large a residual is, when it is known, and what drift stays unseen."""
    unit, drift = known["unit"], known["slowest_drift_per_s"]
    parts = ["residual " + f"{known['rms_residual']:.3g} {unit}".rstrip() + " RMS where identified"]
    if watches:
        residual = rms([seen.residuals.raw[output] for seen in watches])
        signal = deviation([seen.record[output] for seen in watches])
        parts[0] += f", {residual:.3g} here, of a signal of {signal:.3g}"
        armed = sum(np.count_nonzero(seen.armed[output]) * seen.record.sample_period_s for seen in watches)
        parts.append(f"watched for {duration_text(armed / 3600.0)}")
    parts.append(f"known {known['look_ahead_s']:g} s later")
    if drift is not None:
        parts.append(f"a drift below {drift:.2g} {per_second(unit) if unit else 'per s'} passes")
    return "; ".join(parts)


def rms(parts: Sequence[FloatArray]) -> float:
    """Return the root mean square of what is there; NaN where nothing is."""
    values = np.concatenate([part[np.isfinite(part)] for part in parts])
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


def deviation(parts: Sequence[FloatArray]) -> float:
    """Return the RMS of what is there about its mean; NaN where nothing is."""
    values = np.concatenate([part[np.isfinite(part)] for part in parts])
    return float(np.std(values)) if len(values) else float("nan")


def _findings_lines(watched: WatchedLog) -> list[str]:
    told = [(finding, seen) for seen in watched.watches for finding in seen.findings]
    lines = [line for finding, seen in told[:_MOST] for line in _finding_lines(finding, seen)]
    return [*lines, f"{len(told) - _MOST} findings more"] if told[_MOST:] else lines


def _finding_lines(finding: Finding, seen: Watch) -> list[str]:
    """Return a finding: the alarm with what is known at the end, and how it came to that."""
    known = [f"alarm of the residual of {finding.residual} ({finding.series})", f"since about {began_s(finding):.2f} s"]
    if finding.isolated_s is not None:
        known.append(f"named at {finding.isolated_s:.2f} s")
    elif finding.last.time_s > finding.alarm_s:
        known.append(f"as known at {finding.last.time_s:.2f} s")
    if finding.ended_s is not None:
        known.append(f"gone since {finding.ended_s:.2f} s")
    elif finding.last.candidates:
        known.append("not seen to end")
    if given_up := given_up_by(finding, seen):
        known.append(f"residuals no longer watched: {', '.join(given_up)}")
    return [f"{finding.alarm_s:.2f} s  {judgement_text(finding.last)}", f"    {'; '.join(known)}"]


def _unwatched_lines(watched: WatchedLog) -> list[str]:
    """Return what wasn't watched, a line a reason."""
    lines, found = [], stretches(watched)
    for state in State:
        own = [(one.start_s, one.end_s) for one in found if one.state is state]
        if own and state is not State.WATCHED:
            lines.append(f"not watched, {state}: {_spans(own)}")
    return lines


def _worth_lines(watched: WatchedLog) -> list[str]:
    """Say what the outcome is worth: what could be there unseen, or how few false alarms the length watched shows."""
    if watched.outcome is Outcome.UNKNOWN:
        return ["no false-alarm rate is bounded: at no time was an alarm possible"]
    if watched.outcome is Outcome.FAILED:
        return [f"nothing else{_alarms_text(watched)}"]
    return [
        f"that is: no fault of {', '.join(watched.monitor.bank.suspects)} above the thresholds began while watched;",
        "one that was there before, or grows more slowly than the drifts above, isn't seen",
    ]
