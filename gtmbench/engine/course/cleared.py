"""Where a sensor of a course is clear: an error as large as its promise, begun there, would show within seconds.

Over a window a size s has the deviation d. It shows if s^2 / (2 d^2) exceeds what a finding needs, so the least is
s = d sqrt(2 (B t + price)), with B the bound of findings and t what chance makes more of it on this log. A sensor that
fewer than two relations hold is never clear.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.findings import Findings
from gtmbench.engine.search import BOUND, WINDOWS_S
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY, MAGNETOMETER
from gtmbench.values.record import BoolArray, FloatArray, IntArray, runs
from gtmbench.verdict.timeline import Claim, SensorSpan, Sizes, State

# the largest error beside which a sensor is clear, in its unit; of a magnetometer as a share of the field
_PROMISES: dict[str, float] = (
    {"tas": 10.0, "altitude": 100.0, "alpha": 3.0, "beta": 3.0}
    | dict.fromkeys(ACCELEROMETERS, 0.2)
    | dict.fromkeys(GPS_VELOCITY, 3.0)
    | dict.fromkeys(MAGNETOMETER, 0.2)
)
_WHOLE = (("gps", GPS_VELOCITY), ("magnetometer", MAGNETOMETER))  # sensors that are clear as a whole
_WITHIN_S = WINDOWS_S[2]
_WITNESSES = 2
_ABOVE = 1.5  # times the least that is a failure: what is as large is found too small as often as not
_SPARE = 2.0  # times what the window itself tells: means are more restless beside a fault
_FIRST = 1.25  # times the bound, as while nothing is known


def cleared(course: Course, findings: Findings) -> Iterator[Claim]:
    """Give where sensors are clear, and up to which size.

    Parameters
    ----------
    course : Course
    findings : Findings
        Of the course, with everything that was found taken away.
    """
    alone = [name for name in _PROMISES if name not in (*GPS_VELOCITY, *MAGNETOMETER)]
    for sensor, channels in (*_WHOLE, *((name, (name,)) for name in alone)):
        if course.has(*channels):
            yield from _of(course, findings, sensor, channels)


def _of(course: Course, findings: Findings, sensor: str, channels: tuple[str, ...]) -> Iterator[Claim]:
    seen, model = findings.scan.seen, findings.model
    rows = np.flatnonzero(seen.last - seen.onset == max(round(_WITHIN_S / model.cell_s), 3))
    shares = np.zeros(len(rows))
    for channel in channels:
        sizes = _least(findings, course, channel, rows)
        shares = np.maximum(shares, sizes / _promise(course, channel))
    if not len(rows):
        return
    order = np.argsort(seen.onset[rows])
    onsets, shares = seen.onset[rows][order], shares[order]
    step = int(np.median(np.diff(onsets))) if len(onsets) > 1 else 1
    start_s, unit = model.flight.blocks.start_s, max(_promise(course, name) for name in channels)
    for first, stop in _runs(np.asarray(shares <= 1.0), onsets, step):
        sizes_ = Sizes(error=float(unit * shares[first:stop].max()), within_s=_WITHIN_S)
        begin_s = start_s + float(onsets[first]) * model.cell_s
        end_s = start_s + float(onsets[stop - 1] + step) * model.cell_s
        yield sensor, SensorSpan(start_s=begin_s, end_s=end_s, state=State.CLEAR, sizes=sizes_)


def _runs(clear: BoolArray, onsets: IntArray, step: int) -> Iterator[tuple[int, int]]:
    """Give runs of windows that follow each other and are clear."""
    breaks = np.flatnonzero(np.diff(onsets) > step) + 1
    for begin, end in zip([0, *breaks.tolist()], [*breaks.tolist(), len(onsets)], strict=True):
        starts, ends = runs(clear[begin:end])
        yield from ((begin + int(a), begin + int(b)) for a, b in zip(starts, ends, strict=True))


def _promise(course: Course, channel: str) -> float:
    return _PROMISES[channel] * (course.strength if channel in MAGNETOMETER else 1.0)


def _least(findings: Findings, course: Course, channel: str, rows: IntArray) -> FloatArray:
    """Return the least constant error of a channel that shows in windows, in its unit; infinite for none."""
    model = findings.model
    place = next(at for at, each in enumerate(model.explanations) if each.name == f"{channel} bias")
    holding = {each.equation.relation.name for each in model.products if place in each.columns.own}
    if len(holding) < _WITNESSES:
        return np.full(len(rows), np.inf)
    needed = _FIRST * BOUND * float(findings.tempers[place]) + model.explanations[place].price
    deviation = np.maximum(findings.scan.seen.deviation[rows, place], _to_the_end(findings, place, rows))
    least = _SPARE * np.sqrt(2.0 * needed) * deviation
    return np.asarray(np.maximum(least, _ABOVE * model.explanations[place].least) * abs(course.unit_of(channel)))


def _to_the_end(findings: Findings, place: int, rows: IntArray) -> FloatArray:
    """Return how well an error is known that begins with windows and stays: what is before them alone tells of it."""
    seen, cells = findings.scan.seen, findings.model.cells
    last = np.flatnonzero(seen.last == cells)
    order = last[np.argsort(seen.onset[last])]
    at = np.searchsorted(seen.onset[order], seen.onset[rows])
    known = np.append(seen.deviation[order, place], np.inf)
    return np.asarray(np.maximum(known[at], known[np.maximum(at - 1, 0)]))
