"""What the engine found over a whole log, in words: what explains it and how likely that is, and what shows it."""

from __future__ import annotations

from collections.abc import Sequence

from gtmbench.engine.course.judged import CourseJudged
from gtmbench.engine.curves import ErrorCurve
from gtmbench.engine.finding import Finding
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.engine.judged import Judged
from gtmbench.engine.named import judgement_of
from gtmbench.report.words.timeline import fault_text
from gtmbench.report.words.units import percent_text
from gtmbench.values.channels import OF_OWN_RATE, SENSORS

COLUMNS = ("from (s)", "to (s)", "what", "how likely", "shown by", "why it names nobody")
_SENSORS = frozenset((*SENSORS, *OF_OWN_RATE))


def finding_rows(judged: Judged | None, course: CourseJudged | None = None) -> list[tuple[str, ...]]:
    """Return a row of `COLUMNS` for each finding: of gyros and attitude in order of time, then of other sensors."""
    return [*_rows(judged), *_rows(course), *_standing(course)]


def finding_lines(judged: Judged | None, course: CourseJudged | None = None) -> list[str]:
    """Return the same as lines; none where nothing was found."""
    return [
        *_lines("gyros and attitude", _rows(judged)),
        *_lines("other sensors", [*_rows(course), *_standing(course)]),
    ]


def _lines(whose: str, rows: Sequence[tuple[str, ...]]) -> list[str]:
    lines = []
    for start, end, what, chances, shown, why in rows:
        lines.append(f"  {start} to {end}  {what}")
        told = (("how likely", chances), ("shown by", shown), ("names nobody", why))
        lines += [f"    {label}: {text}" for label, text in told if text]
    head = f"what explains {whose} over the whole log (times in s on the log's clock):"
    return [head, *lines] if lines else []


def _rows(judged: Judged | CourseJudged | None) -> list[tuple[str, ...]]:
    if judged is None or judged.model is None:
        return []
    titles = {each.name: each for each in judged.model.relations}
    return [
        (
            f"{each.onset_s:.1f}",
            f"{each.end_s:.1f}",
            each.best.kind
            if each.best.is_healthy
            else f"{each.best.suspect}: {fault_text(each.best.suspect, judgement_of(each, each.end_s))}",
            chances_text(each),
            "; ".join(f"{titles[name].title(channel)} ({nats:.0f} nats)" for name, channel, nats in each.shown_by),
            _why_nobody(each),
        )
        for each in judged.found
    ]


def _standing(course: CourseJudged | None = None) -> list[tuple[str, ...]]:
    """Return a row for each sensor that reads one value while the aircraft flies."""
    stands = () if course is None else course.stands
    return [
        (f"{start_s:.1f}", f"{end_s:.1f}", f"{name}: stuck at {reads:.3g}", "", "it reads one value in flight", "")
        for name, (start_s, end_s), reads in stands
    ]


def made_text(curve: ErrorCurve) -> str:
    """Say which fault a curve's prediction is of."""
    return f"{curve.kind.replace('_', ' ')} of {curve.sensor}"


def chances_text(finding: Finding) -> str:
    """Say how likely explanations are, the likeliest first."""
    told = []
    for suspect, kind, chance in finding.chances:  # what isn't a sensor's says itself whose it is
        of = f" of {suspect}" if gyro_and_imu(suspect)[0] in _SENSORS else ""
        told.append(f"{kind.replace('_', ' ')}{of} {percent_text(chance)}")
    return ", ".join(told)


def _why_nobody(finding: Finding) -> str:
    if finding.doubt:
        return finding.doubt
    if finding.best.is_healthy:
        return "it is no fault"
    if finding.is_healthy:
        return (
            "a healthy cause may explain it as well: what leans or passes so soon may be the references', or the air's"
        )
    return ""
