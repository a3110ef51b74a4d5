"""A flight divided where its answer to commands changes most, all equations together."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.surfaces.commanded import AIRSPEED, Commanded
from gtmbench.detectors.surfaces.identification import SETTLES_S, STEP_S, in_coloured_noise
from gtmbench.values.record import FloatArray

_CHUNK_S = 4.0  # as closely as a flight is divided
BEFORE_S, AFTER_S = 40.0, 10.0  # the least that tells effects, and that shows a change
_CHANCE = 9.2  # of squared deviations: odds of 100 to 1
_RIDGE, _NOTHING = 3.0, 1e-9  # a priori precision; a division's guard


def divided(commanded: Commanded) -> tuple[float, float, float] | None:
    """Return when the effects change most, and between when it may be; None of what is too short."""
    rows, told = round(_CHUNK_S / STEP_S), np.zeros(0)
    for name, part in commanded.relations.items():
        if name == AIRSPEED:
            continue
        # chunk by chunk [effects, causes]'[effects, causes], white and of one size, and running sums of these
        white = in_coloured_noise([part]).white(part)
        white = white[: len(white) // rows * rows]
        white = white / np.maximum(np.sqrt(np.mean(np.square(white), axis=0)), 1e-12)
        chunks = white.reshape(-1, rows, white.shape[1])
        before = np.cumsum(np.einsum("mki,mkj->mij", chunks, chunks), axis=0)
        whole = _misfit(before[-1])
        # by how much two answers, one before a chunk's end and one behind it, misfit less than one for all; in
        # deviations, summed over the relations
        gained = whole - _misfit(before[:-1]) - _misfit(before[-1] - before[:-1])
        gained = gained * len(white) / np.maximum(whole, _NOTHING)
        told = gained if not len(told) else told[: len(gained)] + gained[: len(told)]
    first, last = round(BEFORE_S / _CHUNK_S), len(told) - round(AFTER_S / _CHUNK_S) - 1
    if last <= first:
        return None
    # the division that gains most, and all that chance may have beaten
    near = first + np.flatnonzero(told[first:last] > told[first:last].max() - _CHANCE)
    ends = (first + int(np.argmax(told[first:last])), int(near.min()) - 1, int(near.max()) + 1)
    onset_s, earliest_s, latest_s = (commanded.start_s + SETTLES_S + _CHUNK_S * (end + 1) for end in ends)
    return onset_s, earliest_s, latest_s


def _misfit(products: FloatArray) -> FloatArray:
    """Return the squares that the best effects leave, by products of causes and, last, of what is explained."""
    inner, mixed = products[..., :-1, :-1], products[..., :-1, -1:]
    whole = inner + _RIDGE * np.eye(inner.shape[-1])
    return np.asarray(products[..., -1, -1] - (mixed * np.linalg.solve(whole, mixed)).sum(axis=(-1, -2)))
