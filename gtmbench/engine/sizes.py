"""The smallest faults that would have been found, had they begun in a span and stayed.

A fault of size s at an onset raises the evidence of the window from there to the log's end by s^2 / (2 d^2), d the
size's deviation, up to the t-type ratio's bend. Windows that end before the log does promise nothing: what they are
judged by would hold the fault as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.engine.evidence import PRIOR_BLOCKS, Evidence
from gtmbench.engine.findings import Findings
from gtmbench.engine.search import BOUND
from gtmbench.engine.sums import CELL
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

SUSPICION = 20.0  # nats, untempered: more than this left anywhere is neither clear nor a failure
_LASTS = 8.0 / 7.0  # the best eighth of a window doesn't count
_CONTRADICTED = 2.0  # times the evidence: witnesses take half of it at most
_SHORTEST_S = 7.0  # of a window that promises anything


@dataclass(frozen=True, kw_only=True, eq=False)
class Promise:
    """What would have been found of a gyro, by the cell in which it begins; infinite where nothing would.

    Attributes
    ----------
    error_deg_s : shape (cells,)
    gain : shape (cells,)
        k of e = k y; a factor of 1 / (1 - k).
    """

    error_deg_s: FloatArray
    gain: FloatArray


def promises(findings: Findings) -> tuple[Promise, ...]:
    """Return what is promised of p, q and r."""
    model = findings.model
    first = np.arange(1, max(model.cells - round(_SHORTEST_S / model.cell_s), 1) + 1, dtype=np.int64)
    first = first[first < model.cells - 2]
    if not len(first):
        nothing = np.full(model.cells, np.inf)
        return tuple(Promise(error_deg_s=nothing, gain=nothing) for _ in GYROS)
    seen = findings.to_end(first)
    return tuple(
        Promise(error_deg_s=_size(findings, seen, gyro, "bias"), gain=_size(findings, seen, gyro, "scale"))
        for gyro in GYROS
    )


def _size(findings: Findings, seen: Evidence, gyro: str, kind: str) -> FloatArray:
    """Return the smallest size of a kind that shows, whatever the estimator, shape (cells,)."""
    model = findings.model
    at = [place for place, each in enumerate(model.explanations) if (each.suspect, each.kind) == (gyro, kind)]
    blocks = PRIOR_BLOCKS + CELL * (seen.last - seen.onset - 1.0)[:, np.newaxis]
    needed = _LASTS * _CONTRADICTED * np.maximum(BOUND * findings.tempers[at], SUSPICION)
    size = seen.deviation[:, at] * np.sqrt(blocks * np.expm1(2.0 * needed / blocks))
    worst = size.max(axis=1)
    if kind == "scale":
        turns = model.turns_deg_s(seen.onset, seen.last)[:, GYROS.index(gyro)]
        is_often = 2.0 * model.flight.gyro_step_s <= model.flight.blocks.period_s
        worst = np.where(turns > 1.0, worst, np.inf) if is_often else np.full(len(worst), np.inf)
    found = np.full(model.cells, np.inf)
    found[seen.onset] = worst
    found[:-1] = np.maximum(found[:-1], found[1:])  # it begins within the cell: the next window may have to show it
    return found
