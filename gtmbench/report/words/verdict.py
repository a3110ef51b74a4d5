"""The verdict on a watched log: its first line, the table of its sensors, and the few lines that follow.

The first line is one pure function of a `LogVerdict`. It names every sensor for which it speaks. Then come a table of
what is known of each sensor, what holds for the whole log, and, a label each: why, how sure that is, what was read as
what, what the monitor was learnt from, and what to type next. Everything else is details (`gtmbench.report.words.log`).
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

from gtmbench.checks import listed
from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.protocol import is_ready
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.tracks import union
from gtmbench.log.judging.gps_itself import FIX
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.log_findings import alarm_bound, failed_first, passed_alarms
from gtmbench.report.words.judgement import source_text, whole_text
from gtmbench.report.words.timeline import (
    factors_text,
    fault_text,
    of_text,
    reasons_of,
    sensor_text,
    size_text,
    table_lines,
    timeline_rows,
    when_text,
    wrapped,
)
from gtmbench.report.words.units import capitalised, counted, duration_text, first_few, stamped_text, time_text
from gtmbench.values.channels import GYROS, unit_of
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import NOTHING_PREDICTS, SensorSpan, State
from gtmbench.verdict.verdict import LogVerdict, Outcome

LINES = 12  # of what is printed by default
_LONGEST = 5  # lines of the first sentence on a screen; all of it stands in the details
_LABEL = 13  # characters, with the space behind
_MOST = 3  # faults, reasons or spans that are told one by one
# where lines are short, the first of these first
_GIVES_WAY = (
    "How sure",
    "Learnt from",
    "Also clear",
    "Why",
    "Read as",
    "Not watched",
    "When",
    "Fly next",
    "History",
    "Next",
)


def first_line(verdict: LogVerdict) -> str:
    """Say in a sentence or two what happened: what failed and when, who is clear, for whom nobody can tell, and why."""
    if verdict.outcome is Outcome.HEALTHY:
        asked = verdict.scope.sensors
        total_s = verdict.timeline.motion_total_s
        judged_s = total_s * verdict.judged_share(*asked)
        clear = f"No fault found in {', '.join(asked)}: {of_text(judged_s, total_s)} judged{_sizes_text(verdict)}."
        return " ".join(filter(None, [clear, _accusations_text(verdict)]))
    first = [_accusations_text(verdict), _unjudged_text(verdict)]
    if verdict.outcome is Outcome.UNKNOWN:  # whoever is suspected wasn't asked for
        first.reverse()
    sentences = [*first, _clear_text(verdict)]
    return " ".join(sentence for sentence in sentences if sentence)


def verdict_text(watched: WatchedLog) -> str:
    """Return the first line of a watched log."""
    return first_line(watched.verdict)


def _accusations_text(verdict: LogVerdict) -> str:
    """Tell failures and suspicions in time, alike ones once; of sensors not asked where no asked one may have."""
    found: dict[tuple[str, str, str], list[Span]] = {}
    accused = [(_failure(sensor, span), span) for sensor, span in verdict.failed]
    for sensor, span in verdict.suspected:
        if sensor in verdict.scope.sensors or _is_among_others(verdict, span):
            accused.append((_suspicion(span.suspects or (sensor,), span), span))
    for words, span in accused:
        found.setdefault(words, []).append((span.start_s, span.end_s))
    in_time = sorted(((union(spans), words) for words, spans in found.items()), key=lambda each: each[0][0])
    told = [f"{who} {verb} {when_text(spans, verdict.timeline.span_s)}{how}" for spans, (who, verb, how) in in_time]
    more = f"; and {len(told) - _MOST} more" if len(told) > _MOST else ""
    return f"{capitalised('; '.join(told[:_MOST]))}{more}." if told else ""


def _is_among_others(verdict: LogVerdict, span: SensorSpan) -> bool:
    """Tell whether one of two failed that aren't asked, and how is known."""
    others = {*verdict.timeline.sensors} - {*verdict.scope.sensors}
    has_kind = span.judgement is not None and bool(span.judgement.kind)
    return has_kind and len(span.suspects) == 2 and {*span.suspects} <= others


def _failure(sensor: str, span: SensorSpan) -> tuple[str, str, str]:
    judged = span.judgement
    if judged is not None and judged.swapped:
        one, other = sorted((str(judged.sensor), str(judged.partner)))
        return f"the {sensor_text(one)} and the {sensor_text(other)}", "have changed places", ""
    imu = f" of {judged.imu}" if judged is not None and judged.imu and " of " not in sensor else ""
    axis = f", its {judged.axis.rpartition('_')[2]} axis" if judged is not None and judged.axis else ""
    fault = span.reason.rstrip(".") or fault_text(sensor, judged)
    return f"the {sensor_text(sensor)}{imu}", "failed", f"{axis}{f': {fault}' if fault else ''}"


def _suspicion(suspects: Sequence[str], span: SensorSpan) -> tuple[str, str, str]:
    if len(suspects) == 1:
        reason = f": {span.reason.rstrip('.')}" if span.reason else ""
        return f"the {sensor_text(suspects[0])}", "may have failed", reason
    names = [sensor_text(name) for name in suspects] if len(suspects) == 2 else list(suspects)
    article = "the " if len(suspects) == 2 else ""
    return f"one of {article}{listed(names)}", "failed", ": cannot tell which"


def _accused(verdict: LogVerdict) -> set[str]:
    return {sensor for sensor, _ in (*verdict.failed, *verdict.suspected)} & {*verdict.scope.sensors}


def _unjudged_text(verdict: LogVerdict) -> str:
    """Say for which asked sensors nobody can tell, and why; of those that are accused, how much isn't judged."""
    asked, accused = verdict.scope.sensors, _accused(verdict)
    if not asked:
        return "" if verdict.failed else "Cannot tell: no sensor is asked that this log has; --judge names some."
    open_ = [sensor for sensor in verdict.unjudged if sensor not in accused]
    if verdict.timeline.motion_total_s <= 0.0 and len(open_) == len(asked):
        return f"Cannot tell: {_only_reason(verdict) or 'nothing moves'}."
    groups: dict[str, list[str]] = {}
    for sensor in open_:
        groups.setdefault(reasons_of(verdict, sensor)[0], []).append(sensor)
    told = [
        f"{'' if len(names) == len(asked) else f' for {listed(names)}'}: {reason}{_partly(verdict, names)}"
        for reason, names in groups.items()
    ]
    if len(told) > _MOST:
        others = [name for names in [*groups.values()][_MOST:] for name in names]
        told = [*told[:_MOST], f" for {listed(others)}: other reasons"]
    sentences = [f"Cannot tell{';'.join(told)}."] if told else []
    for sensor in verdict.unjudged:
        if sensor in accused:
            total_s = verdict.timeline.motion_total_s
            lost = of_text(total_s * (1.0 - verdict.judged_share(sensor)), total_s)
            sentences.append(f"{sensor} is not judged in {lost}: {reasons_of(verdict, sensor)[0]}.")
    return " ".join(sentences)


def _only_reason(verdict: LogVerdict) -> str:
    """Return the reason that holds for all asked sensors and all of the log, as wrong units do; "" where none does."""
    spans = [span for sensor in verdict.scope.sensors for span in verdict.timeline.sensors.get(sensor, ())]
    reasons = {span.reason.rstrip(".") if span.state is State.NOT_JUDGED else "" for span in spans}
    return reasons.pop() if len(reasons) == 1 and reasons != {NOTHING_PREDICTS} else ""


def _partly(verdict: LogVerdict, names: Sequence[str]) -> str:
    total_s = verdict.timeline.motion_total_s
    judged_s = total_s * verdict.judged_share(*names)
    return f" ({of_text(judged_s, total_s)} judged)" if judged_s >= 0.5 else ""


def _clear_text(verdict: LogVerdict) -> str:
    """Say which asked sensors are clear, and in how much of the time, where that isn't nearly all."""
    others = {*_accused(verdict), *verdict.unjudged}
    clear = [sensor for sensor in verdict.scope.sensors if sensor not in others]
    if not clear:
        return ""
    share, total_s = verdict.judged_share(*clear), verdict.timeline.motion_total_s
    # less of the time in motion is told with "clear"
    partly = f" in the {of_text(share * total_s, total_s)} that are judged" if share < 0.95 else ""
    return f"{', '.join(clear)} {'is' if len(clear) == 1 else 'are'} clear{partly}."


def _sizes_text(verdict: LogVerdict) -> str:
    """Say what would show in all asked sensors: the worst error of each unit, and the worst factor of the gyros."""
    sizes = {sensor: verdict.sizes_of(sensor) for sensor in verdict.scope.sensors}
    known = {sensor: each for sensor, each in sizes.items() if each is not None}
    worst: dict[str, float] = {}
    for sensor, each in known.items():
        unit = unit_of(sensor)
        if unit:
            worst[unit] = max(worst.get(unit, 0.0), each.error)
    errors = [f"{size_text(size)} {unit}" for unit, size in worst.items()]
    shows = [f"an error of {listed(errors, 'or')}"] if errors else []
    gyros = {sensor: known[sensor].factors for sensor in GYROS if sensor in known}
    factors = [each for each in gyros.values() if each is not None]
    if factors:
        shows.append(factors_text((min(low for low, _ in factors), max(high for _, high in factors))))
    parts = [f"{(', or ' if len(errors) > 1 else ' or ').join(shows)} would show"] if shows else []
    blind = [sensor for sensor, each in gyros.items() if each is None]
    if blind:
        of = f" of {listed(blind, 'or')}" if factors else ""
        parts.append(f"a wrong factor{of} would not show")
    unknown = [sensor for sensor in sizes if sensor in GYROS and sensor not in known]
    if unknown:
        parts.append(f"which fault of {listed(unknown, 'or')} would show is not known")
    return "".join(f"; {part}" for part in parts)


def _also_clear(verdict: LogVerdict) -> list[str]:
    """Say which sensors that aren't asked are clear, and what would show in them."""
    others = (name for name in verdict.timeline.sensors if name not in verdict.scope.sensors)
    sizes = ((name, verdict.sizes_of(name)) for name in others)
    told = [f"{name} {size_text(each.error)} {unit_of(name)}".rstrip() for name, each in sizes if each is not None]
    return [f"where compared with others, up to {', '.join(told)}."] if told else []


def labelled(watched: WatchedLog) -> list[tuple[str, str]]:
    """Return what follows verdict and table: a label and what is said under it, those that say something."""
    told = [
        ("History", [] if watched.beside is None else watched.beside.lines),
        ("Fly next", [f"{capitalised(each.text)}." for each in watched.next_motions]),
        ("Also clear", _also_clear(watched.verdict)),
        ("Why", _why(watched)),
        ("When", stamped_text(watched.log, watched.verdict)),
        ("Not watched", _not_watched(watched)),
        ("How sure", _certainty(watched)),
        ("Read as", _read_as(watched)),
        ("Learnt from", _learnt(watched)),
        ("Next", _next(watched)),
    ]
    return [(label, " ".join(sentences)) for label, sentences in told if sentences]


def summary_lines(watched: WatchedLog, width: int = 80, most: int | None = LINES) -> list[str]:
    """Return the verdict, the table of its sensors and the lines that follow; `most` in all, None for any number."""
    return verdict_lines(watched.verdict, labelled(watched), width, most)


def verdict_lines(
    verdict: LogVerdict, labels: Sequence[tuple[str, str]], width: int = 80, most: int | None = LINES
) -> list[str]:
    """Return a verdict with its table, what holds for the whole log, and labelled lines, as `summary_lines` does."""
    lines = wrapped(first_line(verdict), width)
    if most is None:
        rows = timeline_rows(verdict)
        told = [part for text in verdict.timeline.told for part in wrapped(text, width)]
        return [*lines, *table_lines(rows, 10_000, len(rows) + 1), *told, *_labelled_lines(labels, width, None)]
    if len(lines) > _LONGEST:
        lines = [*lines[: _LONGEST - 1], f"{lines[_LONGEST - 1][: width - 4].rstrip()} ..."]
    rows = timeline_rows(verdict)
    if len(rows) > 1 and len({row[1:] for row in rows}) == 1 and rows[0].state == State.NOT_JUDGED:
        rows = []  # one reason holds for all: the first line has said it
    told = textwrap.wrap(" ".join(verdict.timeline.told), width, max_lines=1, placeholder=" ...")
    needed = [each for each in labels if each[0] == "Next"]
    lines += table_lines(rows, width, most - len(lines) - len(told) - len(needed))
    lines += told
    return [*lines, *_labelled_lines(labels, width, most - len(lines))]


def _labelled_lines(labels: Sequence[tuple[str, str]], width: int, most: int | None) -> list[str]:
    """Return labelled lines, two each at most; where lines are short one each, and the less useful give way."""

    def lines(shown: Sequence[tuple[str, str]], each: int | None) -> list[str]:
        how: dict[str, Any] = {"subsequent_indent": " " * _LABEL, "break_on_hyphens": False, "placeholder": " ..."}
        texts = (f"{label:{_LABEL}}{text}" for label, text in shown)
        return [line for text in texts for line in textwrap.wrap(text, width, max_lines=each, **how)]

    if most is None:
        return lines(labels, None)
    shown = list(labels)
    while shown:
        for each in (2, 1):
            made = lines(shown, each)
            if len(made) <= most:
                return made
        shown.remove(min(shown, key=lambda label: _GIVES_WAY.index(label[0])))
    return []


def _why(watched: WatchedLog) -> list[str]:
    if watched.check.causes:
        return [f"{capitalised(cause.why.rstrip('.'))}." for cause in watched.check.causes[:1]]
    by = {id(alarm): watch for alarm, watch in watched.raised if not alarm.has_passed}
    told = failed_first(watched.verdict, [alarm for alarm, _ in watched.raised if id(alarm) in by])
    lines = []
    for alarm in told[:_MOST]:
        source = source_text(alarm, by[id(alarm)]) or "test statistic"
        last = alarm.last
        why = "" if last is None else last.doubt if alarm.test == MISSING else last.reason
        reason = f": {why}" if why else ""
        named = "" if alarm.isolated_s is None else f", named at {time_text(alarm.isolated_s, 2)}"
        lines.append(f"Alarm at {time_text(alarm.time_s, 2)} by the {source}{named}{reason}.")
    lines += [gps_why(alarm) for alarm in watched.failed_gps[:_MOST]]
    return lines + [
        f"Alarm at {time_text(alarm.time_s, 2)} by {whole_text(alarm)}."
        for alarm in watched.whole_alarms[: _MOST - len(lines)]
    ]


def _not_watched(watched: WatchedLog) -> list[str]:
    """Say which gyros of the log nobody watches, and why, where the verdict doesn't: nobody asked about them."""
    asked = watched.verdict.scope.sensors
    return [
        f"{reason.rstrip('.')}."  # it begins with a name, which stays small
        for reason in watched.reasons
        for name in GYROS
        if name not in asked and reason.startswith(f"{name} isn't watched")
    ]


def _certainty(watched: WatchedLog) -> list[str]:
    """Say how late a fault was decided, or how few false alarms a healthy log shows."""
    bound = alarm_bound(watched)
    if watched.verdict.outcome is not Outcome.HEALTHY or bound is None:
        decided = [alarm for alarm in watched.alarms if alarm.sensor is not None and not alarm.doubt]
        if not decided:
            return []
        late_s = max((alarm.isolated_s or alarm.time_s) - alarm.time_s for alarm in decided)
        return [f"Decided {late_s:.1f} s after the alarm; no other sensor explains it."]
    seen = "No false alarm" if not passed_alarms(watched) else f"{counted(passed_alarms(watched), 'false alarm')}"
    told = f"{seen} in {duration_text(watched.armed_hours)} (95 %: at most {bound:.{int(bound < 10.0)}f} an hour)."
    if watched.beside is not None and watched.beside.predictions:
        return [told]
    return [f"{told} An error that is constant from the first sample on shows beyond 5 deg/s only; --history tells."]


def _learnt(watched: WatchedLog) -> list[str]:
    monitor, spans = watched.monitor, watched.identified_s
    title = basis_of(monitor).title
    if not is_ready(monitor):
        why = "looks at the whole log" if basis_of(monitor).is_whole else "was not calibrated"
        return [f"Nothing: {title} {why}."]
    if spans:
        chosen = ", assumed healthy" if watched.is_assumed_healthy else ""
        failed = {name for name, each in watched.verdict.failed for span in spans if each.meets(*span)}
        chosen = f", in which {_listed(sorted(failed))} failed" if failed else chosen
        told = _listed([f"{start_s:.1f} to {end_s:.1f} s" for start_s, end_s in spans])
        return [f"{told} of this log{chosen} ({title})."]
    logs = monitor.provenance.get("logs")
    named = [str(log.get("name")) for log in logs if isinstance(log, dict)] if isinstance(logs, list) else []
    return [f"{_listed(named)} ({title})." if named else f"{capitalised(title)} came calibrated."]


def _read_as(watched: WatchedLog) -> list[str]:
    log = watched.log
    own = [name for name in watched.monitor.channels if name in log.channels] or list(log.channels)
    columns: dict[str, list[str]] = {}
    for source in log.sources:
        if source.channel in own:
            table = source.column.split(".")[0] if "." in source.column else ""
            columns.setdefault(table, []).append(source.channel)
    from_ = [f"{', '.join(names)} from {table}" if table else ", ".join(names) for table, names in columns.items()]
    what = "; ".join(from_) or ", ".join(own)
    return [*_guessed_text(log), f"{what}; {1.0 / log.sample_period_s:.4g} Hz.", *_late_texts(log)]


def _late_texts(log: FlightLog) -> list[str]:
    """Say whose stamps are late, a sentence a delay: their samples were read as much earlier."""
    late: dict[float, list[str]] = {}
    for source in log.sources:
        if source.late_s:
            late.setdefault(source.late_s, []).append(source.channel)
    return [f"{', '.join(names)} by {late_s:.2g} s earlier than stamped." for late_s, names in late.items()]


def _guessed_text(log: FlightLog) -> list[str]:
    """Say what was guessed of a log's columns, and by what, in one sentence; nothing where nothing was."""
    by_reason: dict[tuple[str, str], list[str]] = {}
    for source in log.sources:
        if source.guessed:
            by_reason.setdefault((source.unit, source.guessed), []).append(
                f"{'-' if source.sign < 0 else ''}{source.channel}"
            )
    told = [f"{', '.join(names)} in {unit} by {why}" for (unit, why), names in by_reason.items()]
    return [f"Guessed: {'; '.join(told)}."] if told else []


def _next(watched: WatchedLog) -> list[str]:
    typed = list(dict.fromkeys(cause.to_type for cause in watched.check.causes if cause.to_type))
    if typed:
        return [f"Add {' or '.join(typed)}"]
    if watched.verdict.outcome is Outcome.UNKNOWN and watched.identified_s:
        return ["--healthy SPAN|LOG for more healthy flight; --details for the rest."]
    if watched.verdict.outcome is Outcome.FAILED:
        return ["--report F.html or --record F.rrd shows it; --details for the rest."]
    return ["--details for every span, with the sizes that would show."]


def _listed(names: Sequence[str]) -> str:
    return first_few(names, _MOST + 1) if len(names) > _MOST + 1 else listed(names)


def gps_why(alarm: Alarm) -> str:
    """Say by what a GPS was found that failed by itself."""
    reason = "" if alarm.last is None else alarm.last.reason
    if alarm.test == FIX:
        return f"From {alarm.onset_s:.1f} s on the GPS tells no place: {reason}."
    return f"Alarm at {alarm.onset_s:.1f} s by the GPS itself: {reason}."
