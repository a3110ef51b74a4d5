"""What the engine found over a whole log, in words; and from which size on what would have been: the certificate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gtmbench.checks import listed
from gtmbench.engine.curves import ErrorCurve
from gtmbench.engine.finding import Finding
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.engine.judged import Judged
from gtmbench.engine.named import judgement_of
from gtmbench.faults.registry import how_of, loaded_faults
from gtmbench.log.judging.certificate import SHARE, Certificate, SmallestSeen
from gtmbench.report.words.timeline import fault_text
from gtmbench.report.words.units import duration_text, padded, per_second, percent_text, two_digits
from gtmbench.values.attitude_estimators import FASTEST_S, SLOWEST_S
from gtmbench.values.channels import OF_OWN_RATE, SENSORS, unit_of

if TYPE_CHECKING:
    from gtmbench.engine.course.judged import CourseJudged

_NAMES = {"scale_factor": "scale error"}


def certificate_text(certificate: Certificate) -> str:
    """Say in a sentence from which size on a bias of each sensor would have been detected."""
    rows = [row for row in certificate.rows if row.kind == "bias"]
    if not rows:
        return f"Nobody can tell which faults would have been detected: {certificate.missing}."
    seen = [row for row in rows if row.size is not None]
    units = {unit_text(row) for row in seen}
    sizes = [f"{row.sensor} {size_text(row, row.size) if len(units) > 1 else two_digits(row.size)}" for row in seen]
    blind = " or ".join(row.sensor for row in rows if row.size is None)
    longest_s = max(row.within_s for row in seen or rows)
    within = f"would have been detected within {longest_s:g} s (at {_share(SHARE)} of start times)"
    if not seen:
        return f"No bias of {blind}, however large, {within}."
    unit = f" {units.pop()}".rstrip() if len(units) == 1 else ""
    return f"A bias above {', '.join(sizes)}{unit} {within}" + (f"; none of {blind}." if blind else ".")


def certificate_table(certificate: Certificate) -> list[list[str]]:
    """Return the smallest faults of every sensor, a row a sensor, with a heading; nothing where there are none."""
    rows = certificate.rows
    if not rows:
        return []
    sensors, kinds = (list(dict.fromkeys(getattr(row, name) for row in rows)) for name in ("sensor", "kind"))
    table = [["", *(_NAMES.get(kind, kind) for kind in kinds)]]
    for sensor in sensors:
        own = [certificate.of(sensor, kind) for kind in kinds]
        cells = [
            f"in {_share(row.share)}" if row and row.size is None else row and size_text(row, row.size) for row in own
        ]
        table.append([sensor, *(cell or "-" for cell in cells)])
        if certificate.is_named:
            table.append(["  named", *("-" if row is None else size_text(row, row.named_from) for row in own)])
    return table


def certificate_lines(certificate: Certificate) -> list[str]:
    """Return the table of all sensors and kinds, with its meaning; nothing where there is none."""
    table = certificate_table(certificate)
    if not table:
        return []
    lines = ["  ".join(line).rstrip() for line in padded(table)]
    return [f"{certificate_title(certificate)}:", *(f"  {line}" for line in [*lines, *certificate_notes(certificate)])]


def certificate_title(certificate: Certificate) -> str:
    """Return what the table is of; of each kind the longest time that a sensor's size takes."""
    longest_s: dict[str, float] = {}
    for row in certificate.rows:
        longest_s[row.kind] = max(row.within_s, longest_s.get(row.kind, 0.0))
    usual_s = min(longest_s.values())
    longer = [f"{_NAMES.get(kind, kind)} {time_s:g} s" for kind, time_s in longest_s.items() if time_s > usual_s]
    within = f"within {usual_s:g} s" + (f" ({', '.join(longer)})" if longer else "")
    watched = f"{duration_text(certificate.watched_s / 3600.0)} watched"
    return f"Smallest faults that would have been detected {within}, at {_share(SHARE)} of start times in the {watched}"


def certificate_notes(certificate: Certificate) -> list[str]:
    """Return what the table's cells mean that aren't sizes, what it rests on, and what has no row."""
    rows, notes = certificate.rows, []
    if any(row.size is None for row in rows):
        notes.append("in ... %: even the largest fault tried would have been detected this rarely")
    for kind, cls in loaded_faults().items():
        unseen = [row.sensor for row in rows if row.kind == kind and row.size is None]
        if unseen and cls.typical is not None and cls.typical.largest:
            never = f"would not have been detected at {_share(SHARE)} of start times"
            notes.append(f"A {cls.typical.largest} {listed(unseen, 'or')} {never}")
    if any(row.time_constant_s is not None for row in rows):
        notes.append(
            "The attitude is taken to follow a gyro's fault, by an estimator with a time constant of "
            f"{FASTEST_S:g} or {SLOWEST_S:g} s; each size is the larger of the two."
        )
    return [*notes, *certificate.unwatched]


def size_text(row: SmallestSeen, size: float | None) -> str:
    """Write a size of a row's kind of fault with its unit; a scale error in percent."""
    if size is None:
        return "-"
    if how_of(row.kind) == "gain":
        return f"{two_digits(100.0 * size)} %"
    return f"{two_digits(size)} {unit_text(row)}".rstrip()


def unit_text(row: SmallestSeen) -> str:
    """Return the unit of a row's sizes; "" for a scale error, which is a share."""
    cls = loaded_faults()[row.kind]
    size = next(each for each in cls.parameters() if cls.shape is not None and each.name == cls.shape.figure)
    unit = unit_of(row.sensor) if size.unit is None else size.unit
    return per_second(unit) if size.per_second else unit


def _share(share: float) -> str:
    return f"{100.0 * share:.0f} %"


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
        (f"{start_s:.1f}", f"{end_s:.1f}", f"{name}: stuck at {reads:.3g}", "", "it reads one value in flight", doubt)
        for name, (start_s, end_s), reads, doubt in stands
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
