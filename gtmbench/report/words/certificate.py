"""A certificate in words: from which size on faults of each sensor would have been seen, in a line and as a table."""

from __future__ import annotations

from gtmbench.checks import listed
from gtmbench.faults.registry import how_of, loaded_faults
from gtmbench.log.judging.certificate import SHARE, Certificate, SmallestSeen
from gtmbench.report.words.units import duration_text, padded, per_second
from gtmbench.values.attitude_estimators import FASTEST_S, SLOWEST_S
from gtmbench.values.channels import unit_of

_NAMES = {"scale_factor": "scale error"}


def certificate_text(certificate: Certificate) -> str:
    """Say in a sentence from which size on a bias of each sensor would have been detected."""
    rows = [row for row in certificate.rows if row.kind == "bias"]
    if not rows:
        return f"Nobody can tell which faults would have been detected: {certificate.missing}."
    seen = [row for row in rows if row.size is not None]
    units = {unit_text(row) for row in seen}
    sizes = [f"{row.sensor} {size_text(row, row.size) if len(units) > 1 else _two(row.size or 0.0)}" for row in seen]
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
        return f"{_two(100.0 * size)} %"
    return f"{_two(size)} {unit_text(row)}".rstrip()


def unit_text(row: SmallestSeen) -> str:
    """Return the unit of a row's sizes; "" for a scale error, which is a share."""
    cls = loaded_faults()[row.kind]
    size = next(each for each in cls.parameters() if cls.shape is not None and each.name == cls.shape.figure)
    unit = unit_of(row.sensor) if size.unit is None else size.unit
    return per_second(unit) if size.per_second else unit


def _share(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _two(value: float) -> str:
    """Write two digits that count."""
    return f"{float(f'{value:.2g}'):.6g}"
