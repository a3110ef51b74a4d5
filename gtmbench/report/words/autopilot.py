"""The autopilot's word, injected failures and the IMUs of a log, in words: beside what the monitor said."""

from __future__ import annotations

from gtmbench.checks import listed
from gtmbench.intake.events import Event
from gtmbench.intake.published_failures import Injection
from gtmbench.log.truth.autopilot_messages import SENSORS, Beside, beside, of_sensors, words_of
from gtmbench.log.truth.score import NAMED, Scored, ScoredLog, scored
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.words.units import counted

_MOST = 6


def autopilot_lines(watched: WatchedLog) -> list[str]:
    """Return what the autopilot said, each of our alarms with its word; nothing of a log that tells no events."""
    words = words_of(watched.log.events)
    if not watched.log.events:
        return []
    sensors, rest = of_sensors(words), ", nor of its estimator"
    if words:
        rest = f"; {counted(len(words), 'word')} of its estimator or the flight, first {word_text(words[0])}"
    lines = [f"autopilot: {word_text(word)}" for word in sensors[:_MOST]]
    lines = lines or [f"autopilot: nothing of {' or '.join(SENSORS)}{rest}"]
    if sensors[_MOST:]:
        lines.append(f"autopilot: {len(sensors) - _MOST} words more of {' or '.join(SENSORS)}")
    alarms = [alarm for alarm in watched.alarms if not alarm.has_passed]
    return [*lines, *(f"autopilot: {beside_text(each)}" for each in beside(alarms[:_MOST], words))]


def word_text(word: Event) -> str:
    """Write what the autopilot said, and when."""
    return f"'{word.text}' at {word.time_s:.2f} s"


def beside_text(each: Beside) -> str:
    """Write an alarm of ours with the autopilot's word."""
    what = f"beside our alarm at {each.alarm.time_s:.2f} s"
    if each.word is None or each.ahead_s is None:
        return f"{what}: nothing"
    when = "later" if each.ahead_s >= 0.0 else "before"
    return f"{what}: {word_text(each.word)}, {abs(each.ahead_s):.2f} s {when}"


def injection_text(injection: Injection) -> str:
    """Write a failure that was injected: of what, how much, from when to when."""
    which = injection.sensor if injection.number is None else f"{injection.sensor} {injection.number}"
    who = f"{', '.join(injection.channels)} of {which}" if injection.channels else which
    size = "" if injection.size is None else f" {injection.size:.3g} {injection.unit}".rstrip()
    until = "on" if injection.end_s is None else f"to {injection.end_s:.2f} s"
    since = f"{injection.onset_s:.2f} s {until}" if injection.end_s is None else f"{injection.onset_s:.2f} {until}"
    return f"{who}: {injection.kind}{size} from {since}"


def injection_lines(watched: WatchedLog) -> list[str]:
    """Return the failures that the log says were injected, each with both delays."""
    rows = scored(watched).rows if watched.log.injections else ()
    lines = [f"injected: {injection_text(row.injection)}; {_answer_text(row)}" for row in rows[:_MOST]]
    return [*lines, f"injected: {len(rows) - _MOST} failures more"] if rows[_MOST:] else lines


def _answer_text(row: Scored) -> str:
    ours = "we: nothing" if row.alarm is None else f"we {row.delay_s:.2f} s later: {row.alarm.verdict}"
    theirs = "nothing" if row.word is None else f"{row.word_delay_s:.2f} s later, '{row.word.text}'"
    return f"{f'{row.why_not}; ' if row.why_not else ''}{ours}; the autopilot: {theirs}"


def imu_lines(watched: WatchedLog) -> list[str]:
    """Return what the IMUs say of each other; nothing of a log that has one."""
    if len(watched.log.imus) < 2 or not (watched.watches or watched.judged):
        return []
    if not watched.further_imus:
        names = listed([imu.name for imu in watched.log.imus])
        return [f"IMUs: {names} can't be compared: no attitude, no common time, or too long"]
    names = listed(watched.compared_imus)
    lines = []
    for each in watched.judged.found if watched.judged else ():
        if each.parts_imus:
            told = "" if each.accuses else f"; {each.doubt or 'no failure is needed for that'}"
            who = f"{listed(each.suspects, 'or')} does with {each.best.kind}"
            lines.append(f"IMUs: they part from {each.onset_s:.1f} s on, as {who}{told}")
    return lines or [f"IMUs: {names} agree in what their means tell"]


def score_verdict(scores: ScoredLog) -> str:
    """Say in a sentence how many of the failures that a log says were injected were found."""
    trials = scores.trials
    if not trials:
        return "Cannot score: no injected failure lies in what was watched."
    found = [row for row in trials if row.alarm is not None]
    named = sum(row.said == NAMED for row in found)
    return (
        f"{len(found)} of {counted(len(trials), 'injected failure')} found, {named} with the right sensor named; "
        f"{_false_text(len(scores.false_alarms), 'alarm')}."
    )


def score_report(scores: ScoredLog) -> list[str]:
    """Return the lines below the table of a scored log."""
    trials = scores.trials
    found = [row for row in trials if row.alarm is not None]
    told = [row for row in trials if row.word is not None and row.word.about in SENSORS]
    said = {row.said: sum(each.said == row.said for each in found) for row in found}
    of = counted(len(trials), "failure")
    ours = ", ".join(f"{count} {what}" for what, count in said.items())
    what = f" ({ours})" if ours else ""
    wrong = [alarm for row in trials for alarm in row.others]
    also = f"; {counted(len(wrong), 'further alarm')} named wrong" if wrong else ""
    return [
        f"we: {len(found)} of {of} found{what}{also}; {_false_text(len(scores.false_alarms), 'alarm')}",
        f"the autopilot: {len(told)} of {of} reported as a sensor's; {_false_text(len(scores.false_words), 'word')}",
    ]


def _false_text(count: int, what: str) -> str:
    return f"{counted(count, f'false {what}')} outside of them"
