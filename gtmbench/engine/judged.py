"""What the engine says of p, q and r: where each failed, is clear up to which size, or can't be judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.engine.constants import by_chunks
from gtmbench.engine.doubts import doubted
from gtmbench.engine.evidence import axis_number
from gtmbench.engine.finding import FROZEN, Finding, Side
from gtmbench.engine.findings import Findings, findings_of
from gtmbench.engine.flight import Flight
from gtmbench.engine.sides import constants_of_gyro
from gtmbench.engine.sizes import SUSPICION, Promise, promises
from gtmbench.engine.sums import CELL
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, runs
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, unjudged

_COARSER = 1.4  # from a stated size to the next: what is twice as bad is told apart
_KNOWN = 0.5  # of a cell's blocks
_MOST_OFFSET_DEG_S, _MOST_GAIN, _SURE = 5.0, 0.2, 3.0  # of a healthy gyro; deviations
_LEFT = "something is left there that no explanation accounts for"
_NEAR_S = (10.0, 30.0)  # before a change that is dated: its onset may lie there; of what grows, or needs motion
_STILL_S, _OF_USUAL, _STILL = 3.0, 3.0, "it reads one value"  # times the longest that the others do
_MASKED, _AT_END = "gyros or attitude are missing", "too little follows"


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """What the engine says of a flight.

    Attributes
    ----------
    flight : Flight
    found : tuple of Finding
        One each a fault, with doubts.
    claims : mapping of sensor to tuple of SensorSpan
        Of p, q and r, and of angles that are suspected with them.
    findings : Findings
        Its evidence.
    """

    flight: Flight
    found: tuple[Finding, ...]
    claims: Mapping[str, tuple[SensorSpan, ...]] = field(repr=False)
    findings: Findings = field(repr=False)


def judged(flight: Flight, *, is_weighted: bool = False) -> Judged:
    """Return what the engine says of a flight.

    Examples
    --------
    >>> from gtmbench.engine.blocks import blocks_of
    >>> from gtmbench.values.record import Record
    >>> random = np.random.default_rng(1)
    >>> time_s = 0.1 * np.arange(1200)
    >>> angles = np.column_stack([np.sin(0.5 * time_s), np.sin(0.31 * time_s), 2.0 * np.sin(0.2 * time_s)])
    >>> gyros = np.gradient(angles, 0.1, axis=0) + 0.1 * random.standard_normal((1200, 3))
    >>> gyros[800:, 1] += 3.0
    >>> flown = Record(np.column_stack([gyros, angles]), channels=[*GYROS, *ATTITUDE], sample_period_s=0.1)
    >>> said = judged(Flight(blocks=blocks_of([flown]), is_driven=False))
    >>> [(each.named, each.best.kind, round(each.onset_s), round(each.size)) for each in said.found]
    [('q', 'bias', 81, 2)]
    """
    findings = findings_of(flight, is_weighted=is_weighted)
    found = doubted(findings.model, findings.found)
    claims: dict[str, list[SensorSpan]] = {name: [] for name in (*GYROS, *ATTITUDE)}
    for axis, promise in enumerate(promises(findings)):
        claims[GYROS[axis]] += _cleared(flight, findings, axis, promise)
    for each in found:
        for sensor, span in _of_finding(flight, each):
            claims[sensor].append(span)
    return Judged(
        flight=flight, found=found, claims={name: tuple(spans) for name, spans in claims.items()}, findings=findings
    )


def _of_finding(flight: Flight, finding: Finding) -> Iterator[tuple[str, SensorSpan]]:
    """Give what a finding claims, sensor by sensor."""
    start_s, end_s = _span(flight, finding)
    sensors = [name for name in finding.suspects if axis_number(name) >= 0]
    axes = sorted({axis for each, _ in finding.ranked if each.is_healthy for axis in each.axes})
    excused = [*(GYROS[axis] for axis in axes), *(ATTITUDE[axis] for axis in axes)]
    why = f"{finding.best.suspect}, {finding.best.kind}: from {finding.onset_s:.0f} to {finding.end_s:.0f} s"
    for sensor in excused:  # an excuse never clears
        yield sensor, unjudged((start_s, end_s), why)
    near_s = _NEAR_S[finding.best.kind not in ("bias", "step", FROZEN, "noise")]
    for sensor in dict.fromkeys([*sensors, *excused]):
        yield sensor, unjudged((start_s - near_s, start_s), f"something changed at about {finding.onset_s:.0f} s")
    judgement = Judgement(
        time_s=finding.end_s,
        sensor=finding.named,
        candidates=tuple(sensors),
        kind=finding.best.kind,
        parameters={"size": finding.size},
        reason=finding.doubt,
    )
    is_one_axis = len({axis_number(name) for name in finding.suspects}) == 1 and not finding.doubt
    for sensor in sensors:
        if finding.named and finding.side is not Side.OPEN:
            yield sensor, SensorSpan(start_s=start_s, end_s=end_s, state=State.FAILED, judgement=judgement)
        elif is_one_axis:
            yield (
                sensor,
                SensorSpan(
                    start_s=start_s, end_s=end_s, state=State.SUSPECTED, suspects=tuple(sensors), judgement=judgement
                ),
            )
        else:
            why = finding.doubt or f"{' or '.join(finding.suspects)} changed at {finding.onset_s:.0f} s"
            yield sensor, unjudged((start_s, end_s), why)


def _span(flight: Flight, finding: Finding) -> tuple[float, float]:
    """Return the broken side of a finding; both of one that leaves it open."""
    start_s = flight.blocks.start_s
    whole_s = start_s + len(flight) * flight.blocks.period_s
    if finding.side is Side.BEFORE:
        return start_s, finding.onset_s
    return (start_s, whole_s) if finding.side is Side.OPEN else (finding.onset_s, finding.end_s)


def _cleared(flight: Flight, findings: Findings, axis: int, promise: Promise) -> Iterator[SensorSpan]:
    """Give where a gyro is clear, and up to which size, and why it isn't elsewhere."""
    reasons = _reasons(flight, findings, axis)
    classes = _classes(promise, reasons)
    cell_s, start_s = CELL * flight.blocks.period_s, flight.blocks.start_s
    end_s = start_s + len(flight) * flight.blocks.period_s
    edges = np.flatnonzero(np.diff(classes)) + 1
    for first, last in zip([0, *edges.tolist()], [*edges.tolist(), len(classes)], strict=True):
        span_s = (start_s + first * cell_s, min(start_s + last * cell_s, end_s))
        if classes[first] < 0:
            yield unjudged(span_s, reasons[first] or _AT_END)
            continue
        error, gain = float(promise.error_deg_s[first:last].max()), float(promise.gain[first:last].max())
        factors = (1.0 / (1.0 + gain), 1.0 / (1.0 - gain)) if gain < 1.0 else None
        sizes = Sizes(error=error, within_s=end_s - span_s[0], factors=factors)
        yield SensorSpan(start_s=span_s[0], end_s=span_s[1], state=State.CLEAR, sizes=sizes)


def _classes(promise: Promise, reasons: Sequence[str]) -> FloatArray:
    """Return a number for each cell, the same for neighbours that are stated together; negative where not judged."""
    with np.errstate(divide="ignore"):
        sizes = np.floor(np.log(promise.error_deg_s) / np.log(_COARSER)) + 1000.0
    texts = {text: -1.0 - place for place, text in enumerate(dict.fromkeys(reasons))}
    unknown = ~np.isfinite(promise.error_deg_s) | np.array([bool(text) for text in reasons])
    return np.where(unknown, [texts[text] for text in reasons], sizes)


def _reasons(flight: Flight, findings: Findings, axis: int) -> list[str]:
    """Return why a gyro isn't judged, cell by cell; "" where it is."""
    cells = findings.model.cells
    found = [""] * cells
    there = np.isfinite(flight.blocks.gyros[:, axis]) & flight.judged
    missing = by_chunks(there.astype(float), CELL).mean(axis=1) < _KNOWN
    throughout = _beyond(findings, axis)
    if throughout:
        return [throughout] * cells
    still = _stands_still(flight, axis)
    for mask, text in ((_unexplained(findings, axis), _LEFT), (still, _STILL), (missing, _MASKED)):
        starts, ends = runs(mask)
        for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
            found[first:last] = [text] * (last - first)
    return found


def _beyond(findings: Findings, axis: int) -> str:
    """Say which constant of a gyro no healthy one has, throughout the log; "" for none."""
    known = constants_of_gyro(findings.model, axis)
    if known is None:
        return "nothing is known of it and the attitude together"
    offset, gain, offset_error, gain_error = known
    if abs(offset) - _SURE * offset_error > _MOST_OFFSET_DEG_S:
        return f"{GYROS[axis]} reads {offset:+.1f} deg/s, against the attitude, throughout"
    if abs(gain) - _SURE * gain_error > _MOST_GAIN:
        return f"{GYROS[axis]} and the attitude don't turn alike throughout"
    return ""


def _stands_still(flight: Flight, axis: int) -> BoolArray:
    """Tell in which cells a gyro reads one value for longer than the others do."""
    held_s = flight.blocks.held_s
    usual_s = float(np.delete(held_s[:, : len(GYROS)], axis, axis=1).max(initial=0.0))
    ends = np.flatnonzero(held_s[:, axis] > max(_STILL_S, _OF_USUAL * usual_s))
    found = np.zeros(-(-len(flight) // CELL), dtype=bool)
    for end in ends.tolist():
        begin = max(end - int(held_s[end, axis] / flight.blocks.period_s), 0)
        found[begin // CELL : end // CELL + 1] = True
    return found


def _unexplained(findings: Findings, axis: int) -> BoolArray:
    """Tell in which cells something about a gyro is left that no finding explains."""
    model, (onset, last) = findings.model, findings.windows
    mine = np.array([not each.is_healthy and axis_number(each.suspect) == axis for each in model.explanations])
    found = np.zeros(model.cells, dtype=bool)
    for window in np.flatnonzero(findings.odd[:, mine].max(axis=1, initial=-np.inf) > SUSPICION):
        found[onset[window] : last[window]] = True
    return found
