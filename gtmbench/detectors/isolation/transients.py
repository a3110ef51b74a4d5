"""Transients: what a short disturbance was that no residual shows any more.

An attitude angle enters bank C by its slope, so a step of it (a bias that comes at once) shows for as long as filters
remember and then hardly: residuals are healthy again while the sensor isn't. A reading that was off for a while and
came back looks alike, but not the same: its two edges differ in sign. Matched filters tell them apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.effects import Path
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.values.record import FloatArray

_PULSES = (1, 2, 3, 5, 8, 13, 21)  # rows
_REMEMBERED = 60  # rows of a step's response that are looked at, at most


@dataclass(frozen=True, kw_only=True)
class Transient:
    """The best explanation of a short disturbance: a step or a pulse of one sensor's readings.

    `gain` is by how much -2 log likelihood is better than with nothing at all.
    """

    channel: str
    is_step: bool
    size: float
    row: int
    gain: float


def transients(case: Case, suspects: Sequence[Suspect]) -> list[Transient]:
    """Return the best step and the best pulse of every suspect, the best first."""
    rows = slice(case.start, case.judged.start)
    entered = {path.output for suspect in suspects for path in suspect.paths}
    white = {output: np.nan_to_num(case.white[output][rows]) for output in entered}
    found: list[Transient] = []
    for suspect in suspects:
        direct = [path for path in suspect.paths if not path.through]  # what an angle bends doesn't come at once
        ways = [_matches(path, white[path.output], case.period_s) for path in direct]
        found.extend(_best(suspect, of_shape, is_step=i == 0) for i, of_shape in enumerate(zip(*ways, strict=True)))
    return sorted(found, key=lambda each: -each.gain)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Match:
    """How far a change of one shape, wherever it begins, is in a residual."""

    response: FloatArray
    matched: FloatArray
    weight: float | FloatArray
    lead: int


def _matches(path: Path, white: FloatArray, period_s: float) -> Iterator[_Match]:
    """Give the step's, then the pulses'."""
    for rows in (_REMEMBERED, *_PULSES):
        response, weight, lead = _response(path, np.ones(rows), period_s, is_step=rows == _REMEMBERED)
        matched = np.correlate(white, response, "full")[len(response) - 1 :]
        yield _Match(response=response, matched=matched, weight=weight, lead=lead)


def _best(suspect: Suspect, ways: Sequence[_Match], *, is_step: bool) -> Transient:
    """Return where, and how large, a change of one shape explains most."""
    count = len(ways[0].matched)
    rows = np.arange(count)
    along, power = np.zeros(count), np.full(count, 1e-12)
    for way in ways:
        weights = np.broadcast_to(way.weight, len(suspect.measured))[:count]
        along[way.lead :] += weights[way.lead :] * way.matched[: count - way.lead]
        inside = np.cumsum(np.square(way.response))  # a response that runs out of the rows has less of itself there
        room = np.minimum(count - rows + way.lead, len(way.response)) - 1
        power += np.square(weights) * inside[np.maximum(room, 0)]
    gain = np.square(along) / power
    row = int(np.argmax(gain))
    return Transient(
        channel=suspect.channel,
        is_step=is_step,
        size=float(along[row] / power[row]),
        row=suspect.case.start + row,
        gain=float(gain[row]),
    )


def _response(
    path: Path, shape: FloatArray, period_s: float, *, is_step: bool
) -> tuple[FloatArray, float | FloatArray, int]:
    """Return what a change does to a residual, by what it is weighed row by row, and how many rows ahead it begins."""
    if path.of_slope is None:
        return (
            np.convolve(shape, path.kernel)[: len(shape) + (0 if is_step else len(path.kernel) - 1)],
            path.of_value,
            path.ahead,
        )
    padded = np.concatenate([[0.0, 0.0], shape, np.full(2, shape[-1] if is_step else 0.0)])
    slope = (padded[2:] - padded[:-2]) / (2.0 * period_s)
    response = np.convolve(slope, path.kernel)
    if is_step:
        response = response[: len(path.kernel) + 2]
    return response, path.of_slope, path.ahead + 1
