"""The verdict on a watched log: its first line, and the few that follow it.

The first line says what happened. Then come, a label each: why and from when, how sure that is, what could not be
watched, from which size on a fault would have been detected, what the monitor was learnt from, what was read as what,
and what to type next. Everything else is details (`gtmbench.report.words.log`).
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from gtmbench.checks import listed
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.monitor.regime import FAILURE
from gtmbench.detectors.protocol import is_ready
from gtmbench.intake.flight_log import FlightLog
from gtmbench.report.log_findings import (
    State,
    alarm_bound,
    began_s,
    faults_of,
    passed_alarms,
    seconds_by_state,
    stretches,
)
from gtmbench.report.words.certificate import certificate_text
from gtmbench.report.words.judgement import kind_text, slow_text, source_text, witness_text
from gtmbench.report.words.monitor import title_text
from gtmbench.report.words.other_sensors import failed_sensors_text, sensor_why
from gtmbench.report.words.units import capitalised, counted, duration_text
from gtmbench.study.log.contacts import CONTACTS
from gtmbench.study.log.louder import Louder
from gtmbench.study.log.watched import WatchedLog
from gtmbench.values.channels import ATTITUDE, GYROS, unit_of
from gtmbench.values.record import Span
from gtmbench.verdict.verdict import Outcome

SENSORS = {
    "p": "roll gyro",
    "q": "pitch gyro",
    "r": "yaw gyro",
    "phi": "bank angle",
    "theta": "pitch angle",
    "psi": "heading",
    "alpha": "angle-of-attack vane",
    "beta": "sideslip vane",
    "nx": "forward accelerometer",
    "ny": "lateral accelerometer",
    "nz": "vertical accelerometer",
    "tas": "airspeed",
}
_LABEL = 13  # characters, with the space behind
_LINES = 2  # a label has no more
_FEW = 2  # alarms that are told one by one where more of them tell nothing
SHORT_S = 0.05  # of what wasn't watched: less isn't told
_MOST = 3  # faults, doubts or spans that are told one by one
_NOT_WATCHED = {
    State.IDENTIFIED: "learnt from",
    State.ARMING: "arming",
    State.DISARMED: "after an alarm",
    State.LOST: "samples missing",
    State.ENDS: "record's end",
    State.OUTSIDE: "motion beyond what was learnt",
    State.LEFT_OUT: "left out",
    State.GAP: "gaps",
}


def sensor_text(name: str) -> str:
    """Name a sensor as an engineer does.

    >>> sensor_text("q"), sensor_text("strain_3")
    ('pitch gyro (q)', 'strain_3')
    """
    return f"{SENSORS[name]} ({name})" if name in SENSORS else name


def verdict_text(watched: WatchedLog) -> str:
    """Say in one sentence what happened: which sensor failed and when, that no fault was found, or why nobody can tell.

    The time is when the fault began, as far as its kind or the test tells.
    """
    failed = failed_sensors_text(watched.failed_sensors)
    if failed:
        return f"{failed} {_gyros_text(watched, ' of a gyro')}"
    return _gyros_text(watched)


def _gyros_text(watched: WatchedLog, of: str = "") -> str:
    """Say the same of gyros and attitude alone."""
    if watched.outcome is Outcome.UNKNOWN:
        return (
            _until_text(watched) or f"Cannot tell{f' whether a fault{of}' if of else ''}: {'; '.join(causes(watched))}."
        )
    faults = [same for same in faults_of(watched).values() if not same[0].doubt]
    if faults:
        told = [_fault_text(same) for same in faults[:_MOST]]
        more = f"; and {len(faults) - _MOST} more" if len(faults) > _MOST else ""
        return f"{capitalised('; '.join(told))}{more}."
    passed = passed_alarms(watched)
    alarms = f" {capitalised(counted(passed, 'alarm'))} had nothing left to explain." if passed else ""
    watched_of = f"{duration_text(watched.armed_hours)} of {duration_text(_length_s(watched) / 3600.0)}"
    blind = _unheard(watched)
    but = f"; {_listed(blind)} {'is' if len(blind) == 1 else 'are'} not watched" if blind else ""
    return f"No fault{of} found in {watched_of}{but}.{alarms}"


def _until_text(watched: WatchedLog) -> str:
    """Say that nothing was found until a crash, where only the crash and what follows can't be told; else nothing."""
    doubtful = [alarm for alarm in watched.alarms if not alarm.has_passed]
    reasons = [alarm.doubt for alarm in doubtful]
    if not doubtful or not {*reasons} <= {*CONTACTS, FAILURE} or not watched.check.passed:
        return ""
    first_s = min(alarm.onset_s for alarm in doubtful)
    before = [each.start_s for each in watched.excursions if each.reason in reasons and each.end_s >= first_s]
    return f"No fault found until {min(first_s, *before[:1]):.1f} s; cannot tell from then on: {reasons[0]}."


def causes(watched: WatchedLog) -> list[str]:
    """Return why a log's verdict is that nobody can tell, the weightiest first."""
    wrong = list(dict.fromkeys(cause.text for cause in watched.check.causes))
    if wrong:
        return [" or ".join(wrong)]
    if watched.check.stops:
        return [watched.check.stops[0].text]
    doubtful = [alarm for alarm in watched.alarms if alarm.doubt and not alarm.has_passed]
    weak = [*([doubt_text(doubtful)] if doubtful else []), *_unseen(watched)]
    return weak or list(watched.reasons[:1]) or ["no stretch is long enough to be watched"]


def doubt_text(doubtful: Sequence[Alarm]) -> str:
    """Say which alarms may be no fault, and what else may have raised them."""
    told = _listed([f"{alarm.source} at {alarm.time_s:.1f} s" for alarm in doubtful], most=_FEW)
    doubts = _listed(list(dict.fromkeys(alarm.doubt for alarm in doubtful)), most=1)
    return f"{counted(len(doubtful), 'alarm')} ({told}) may be no fault: {doubts}"


def labelled(watched: WatchedLog) -> list[tuple[str, str]]:
    """Return what follows the verdict: a label and what is said under it, those that say something."""
    told = [
        ("Why", _why(watched)),
        ("How sure", _certainty(watched)),
        ("Not watched", _not_watched(watched)),
        ("Sensitivity", [certificate_text(watched.certificate)] if watched.watches else []),
        ("Learnt from", _learnt(watched)),
        ("Read as", _read_as(watched)),
        ("Next", _next(watched)),
    ]
    return [(label, " ".join(sentences)) for label, sentences in told if sentences]


def summary_lines(watched: WatchedLog, width: int = 80) -> list[str]:
    """Return the verdict and the lines that follow it, as wide as a screen."""
    lines = textwrap.wrap(verdict_text(watched), width)
    for label, text in labelled(watched):
        lines += textwrap.wrap(
            f"{label:{_LABEL}}{text}",
            width,
            subsequent_indent=" " * _LABEL,
            break_on_hyphens=False,
            max_lines=_LINES,
            placeholder=" ...",
        )
    return lines


def _fault_text(same: Sequence[Alarm]) -> str:
    """Say who failed, when and how; of a fault that is found again, how often."""
    first = same[0]
    at = f"at {began_s(first):.1f} s"
    if len(same) > 1:
        at += f" (found {len(same)} times, last at {same[-1].time_s:.1f} s)"
    judged = first.last
    if judged is None:
        return f"something failed {at}"
    if judged.sensor is None:
        who = "the attitude" if set(judged.candidates) <= set(ATTITUDE) else "a sensor"
        return f"{who} failed {at}: cannot tell which of {_listed(judged.candidates, 'or')}"
    if judged.swapped:
        return f"the {sensor_text(judged.sensor)} and the {sensor_text(str(judged.partner))} have changed places {at}"
    imu = f" of {judged.imu}" if judged.imu else ""
    parameters = {name: value for name, value in judged.parameters.items() if name != "onset_s"}
    unit = unit_of(judged.sensor)
    known = judged.kind is not None and judged.kind != UNKNOWN
    kind = (
        f": {kind_text(str(judged.kind), parameters, judged.errors, unit, judged.partner)}" if known else _size(judged)
    )
    return f"the {sensor_text(judged.sensor)}{imu} failed {at}{kind}"


def _size(judged: Judgement) -> str:
    """Return how far a witness measured a sensor off, in brackets; nothing where none did.

    >>> said = "MAG: the magnetometer knows r to 4 deg/s only; accelerometers: r reads -2.1 deg/s more"
    >>> _size(Judgement(time_s=9.0, sensor="r", candidates=("r",), witness=said))
    ' (accelerometers: r reads -2.1 deg/s more)'
    """
    measured = (said for said in judged.witness.split("; ") if f": {judged.sensor} reads " in said)
    return next((f" ({said})" for said in measured), "")


def _why(watched: WatchedLog) -> list[str]:
    if watched.check.causes:
        return [_sentence(cause.why) for cause in watched.check.causes[:1]]
    told = [(alarm, watch) for watch in watched.watches for alarm in watch.faults if not alarm.has_passed]
    lines = []
    for alarm, watch in told[:_MOST]:
        source = source_text(alarm, watch) or "test statistic"
        reason = "" if alarm.last is None or not alarm.last.reason else f": {alarm.last.reason}"
        named = "" if alarm.isolated_s is None else f", named at {alarm.isolated_s:.2f} s"
        lines.append(f"Alarm at {alarm.time_s:.2f} s by the {source}{named}{reason}{_by_witness(alarm)}.")
    lines += [
        f"{capitalised(alarm.last.reason)}." for alarm in (*watched.standing, *watched.frozen) if alarm.last is not None
    ]
    lines += [sensor_why(each) for each in watched.failed_sensors[:_MOST]]
    return lines + [
        f"Alarm at {alarm.time_s:.2f} s by {slow_text(alarm)}{_by_witness(alarm)}."
        for alarm in watched.slow_alarms[: _MOST - len(lines)]
    ]


def _by_witness(alarm: Alarm) -> str:
    """Return which witness was asked, and what it tells; nothing where none was."""
    witness = witness_text(alarm)
    return f"; {witness}" if witness else ""


def _certainty(watched: WatchedLog) -> list[str]:
    """Say what a verdict is worth."""
    bound = alarm_bound(watched)
    if watched.outcome is not Outcome.HEALTHY or bound is None:
        decided = [alarm for alarm in watched.alarms if alarm.sensor is not None and not alarm.doubt]
        if not decided:
            return []
        late_s = max((alarm.isolated_s or alarm.time_s) - alarm.time_s for alarm in decided)
        return [f"Decided {late_s:.1f} s after the alarm; no other sensor explains it."]
    seen = "No false alarm" if not passed_alarms(watched) else f"{counted(passed_alarms(watched), 'false alarm')}"
    return [
        f"{seen} in {duration_text(watched.armed_hours)} (95 %: at most {bound:.{int(bound < 10.0)}f} an hour). "
        "A fault from the first sample on is learnt as healthy."
    ]


def _not_watched(watched: WatchedLog) -> list[str]:
    lengths_s = seconds_by_state(stretches(watched))
    total = {state: lengths_s.get(state, 0.0) for state in _NOT_WATCHED}
    largest = sorted((state for state in total if total[state] >= SHORT_S), key=lambda state: -total[state])
    parts = [f"{_NOT_WATCHED[state]} {total[state]:.1f}" for state in largest[:_MOST]]
    rest_s = sum(total.values()) - sum(total[state] for state in largest[:_MOST])
    others = [f"others {rest_s:.1f}"] if rest_s >= SHORT_S else []
    why = [f"{reason.rstrip('.')}." for reason in watched.unwatched.values()]
    return [*why, *([f"{sum(total.values()):.1f} s: {', '.join([*parts, *others])}."] if parts else [])]


def _learnt(watched: WatchedLog) -> list[str]:
    monitor, spans = watched.monitor, watched.identified_s
    title = title_text(monitor)
    if not is_ready(monitor):
        return [f"Nothing: {title} was not calibrated."]
    if spans:
        chosen = ", assumed healthy" if watched.is_assumed_healthy else ""
        return [f"{_spans(spans)} of this log{chosen} ({title})."]
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
    return [f"{what}; {1.0 / log.sample_period_s:.4g} Hz.", *guessed_text(log)]


def guessed_text(log: FlightLog) -> list[str]:
    """Say what was guessed of a log's columns, and by what, in one sentence; nothing where nothing was."""
    by_reason: dict[tuple[str, str], list[str]] = {}
    for source in log.sources:
        if source.guessed:
            by_reason.setdefault((source.unit, source.guessed), []).append(
                f"{'-' if source.sign < 0 else ''}{source.channel}"
            )
    told = [f"{', '.join(names)} in {unit} by {why}" for (unit, why), names in by_reason.items()]
    return [f"Guessed: {'; '.join(told)}."] if told else []


def guessed_options(log: FlightLog) -> list[str]:
    """Return what to type for a log to be read so without a guess, in one line; none where nothing was guessed."""
    options = [source.option for source in log.sources if source.guessed and source.column]
    return [" ".join(options)] if options else []


def _next(watched: WatchedLog) -> list[str]:
    """Say what to type."""
    typed = list(dict.fromkeys(cause.to_type for cause in watched.check.causes if cause.to_type))
    if typed:
        return [f"Add {' or '.join(typed)}"]
    if watched.outcome is Outcome.UNKNOWN and watched.identified_s:
        return ["--identify SPAN|LOG for more healthy flight; --details for the rest."]
    if watched.outcome is Outcome.FAILED:
        return ["--report F.html or --record F.rrd shows it; --details for the rest."]
    return ["--details for the rest, with the sizes of detectable faults."]


def _unseen(watched: WatchedLog) -> list[str]:
    """Say whose silence says nothing."""
    names: list[str] = []
    hidden = [f"a fault of {_listed(names, 'or')} would hardly show"] if names else []
    return [*[_louder_text(each) for each in watched.louder], *hidden]


def _louder_text(louder: Louder) -> str:
    return (
        f"the residual of {louder.sensor} was {louder.times:.2g} times as large from {louder.start_s:.1f} to "
        f"{louder.end_s:.1f} s as where it was learnt, and no test could tell why"
    )


def _unheard(watched: WatchedLog) -> list[str]:
    """Return the gyros that no verdict is about; of a monitor that names no sensor nobody knows."""
    suspects = watched.monitor.suspects if is_ready(watched.monitor) else ()
    return [name for name in GYROS if suspects and name not in suspects]


def _length_s(watched: WatchedLog) -> float:
    return sum(len(segment) * segment.sample_period_s for segment in watched.log.segments)


def _spans(spans: Iterable[Span]) -> str:
    return _listed([f"{start_s:.1f} to {end_s:.1f} s" for start_s, end_s in spans])


def _listed(names: Sequence[str], word: str = "and", most: int = _MOST + 1) -> str:
    """Write a list: ``p, q or phi``; of a long one how many more there are."""
    return f"{', '.join(names[:most])} and {len(names) - most} more" if len(names) > most else listed(names, word)


def _sentence(text: str) -> str:
    return f"{capitalised(text.rstrip('.'))}."
