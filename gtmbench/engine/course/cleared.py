"""Where a sensor of a course is clear: an error of some size that began there, or before, and stayed would show.

From a window that begins at an onset and ends with the log a size is known as s +- d. No error beyond |s| + k d hides
in it, with d as much wider as chance makes more of an explanation on this log than noise would. Nothing that was found
is taken away: whatever it was, it may have been this sensor's. An error that began before a time goes on there, so what
is excluded at a time is the largest of all windows that began until then.

The level of an altitude enters no relation. What is excluded of it are steps, which its readings show by themselves,
and what it drifts in twenty seconds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.jumps import hidden_jump
from gtmbench.engine.finding import Finding
from gtmbench.engine.findings import Findings, tempers_of
from gtmbench.engine.hindsight.cleared_sensors import OFTEN
from gtmbench.engine.model import Model
from gtmbench.engine.samples import Samples
from gtmbench.engine.search import BOUND, Scan
from gtmbench.values.channels import WHOLE
from gtmbench.values.record import BoolArray, FloatArray, runs
from gtmbench.verdict.timeline import Claim, SensorSpan, Sizes, State, unjudged

# beside which error no sensor is called clear, in its channels' unit: twice what our users ask for
_MOST: Mapping[str, float] = {
    "accelerometers": 0.4,
    "gps": 6.0,
    "tas": 20.0,
    "alpha": 6.0,
    "beta": 6.0,
    "altitude": 200.0,
    "magnetometer": 0.0,  # one relation holds it
}
_DEVIATIONS = float(np.sqrt(2.0 * BOUND))  # of a size: as many as make a finding
_WITNESSES = 2  # relations that have to hold a sensor
_STRONG = 3.0 * BOUND  # nats, whatever chance makes on this log: by then an error of it is likelier than none
_SHOWS = "it parts from what others tell, and no explanation holds"
_WITHIN_S = 60.0  # behind an onset
_SPARE = 1.2  # times an error that may be there: what grows to it shows less
_LEVEL, _DRIFTS_S = "altitude", 20.0  # what drifts by nature is cleared of drifts that last as long


def cleared(
    course: Course, findings: Findings, sensors: Mapping[str, Samples], found: Sequence[Finding]
) -> Iterator[Claim]:
    """Give where sensors are clear, and up to which size.

    `findings`: of the course. `sensors`, by channel: as they are read. `found`: what is told of: where it may be an
    error of the sensor itself, it may go on to the log's end.
    """
    scan, tempers = findings.whole, tempers_of(findings.whole)
    model = scan.model
    at_s = np.asarray(model.flight.blocks.start_s + model.cell_s * np.arange(model.cells), dtype=np.float64)
    for sensor, most in _MOST.items():
        channels = WHOLE.get(sensor, (sensor,))
        if not course.has(*channels):
            continue
        known = _known(model, channels)
        for each in found:
            if {*each.suspects} & {*channels}:
                known[each.first :] = False
        sizes = np.max([_hidden(scan, tempers, each) * abs(course.unit_of(each)) for each in channels], axis=0)
        if sensor == _LEVEL:
            sizes = np.maximum(sizes, hidden_jump(sensor, sensors[sensor], model.flight.flown_s, at_s))
        if np.isnan(sizes).any():
            shows_s = float(at_s[int(np.argmax(np.isnan(sizes)))])
            yield sensor, unjudged((shows_s, float(at_s[-1]) + model.cell_s), _SHOWS)
        starts, ends = runs(known & (sizes <= most))
        for first, stop in zip(starts.tolist(), ends.tolist(), strict=True):
            hidden = Sizes(error=float(np.quantile(sizes[first:stop], OFTEN, method="higher")), within_s=_WITHIN_S)
            start_s, end_s = float(at_s[first]), float(at_s[stop - 1]) + model.cell_s
            yield sensor, SensorSpan(start_s=start_s, end_s=end_s, state=State.CLEAR, sizes=hidden)


def _known(model: Model, channels: Sequence[str]) -> BoolArray:
    """Tell in which cells as many relations hold a sensor as clear it."""
    own = {place for place, each in enumerate(model.explanations) if each.suspect in channels}
    known: dict[str, BoolArray] = {}
    for each in model.products:
        if own & {*each.columns.own.tolist()}:
            name = each.equation.relation.name
            known[name] = known.get(name, np.zeros(model.cells, dtype=bool)) | (np.diff(each.counts) > 0.0)
    return np.asarray(sum(known.values(), start=np.zeros(model.cells, dtype=int)) >= _WITNESSES)


def _hidden(scan: Scan, tempers: FloatArray, channel: str) -> FloatArray:
    """Return the largest error of a channel that may hide in each cell: a constant, or of a level what drifts to it.

    NaN from where on one shows, whatever keeps it from being a finding.
    """
    seen, model = scan.seen, scan.model
    kind, lasts, over_s = (
        ("drift", round(_DRIFTS_S / model.cell_s), _DRIFTS_S) if channel == _LEVEL else ("bias", 0, 1.0)
    )
    place = next(at for at, each in enumerate(model.explanations) if each.name == f"{channel} {kind}")
    rows = np.flatnonzero(seen.last - seen.onset == lasts if lasts else seen.last == model.cells)
    rows = rows[np.argsort(seen.onset[rows])]
    hidden = np.full(model.cells, np.inf)
    if len(rows):
        wider = _DEVIATIONS * float(np.sqrt(tempers[place]))
        own, doubt = np.abs(seen.size[rows, place]), wider * seen.deviation[rows, place]
        is_there = (own > np.maximum(doubt, model.explanations[place].least)) | (scan.left[rows, place] > _STRONG)
        sizes = np.where(is_there, np.nan, _SPARE * over_s * (own + doubt))
        at = np.searchsorted(seen.onset[rows], np.arange(model.cells))
        inside = (np.arange(model.cells) >= seen.onset[rows[0]]) & (at < len(rows))
        hidden[inside] = np.maximum.accumulate(sizes)[at[inside]]
    return hidden
