"""How far means wander about a window: where they do so before and behind it as well, a fault there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.engine.evidence import outside
from gtmbench.engine.model import Model
from gtmbench.engine.sums import WindowSums
from gtmbench.values.record import FloatArray

_AROUND_S = 15.0  # before and behind
_TILT = ("p", "q")  # references pull at both axes of the tilt alike


@dataclass(frozen=True, kw_only=True)
class Place:
    """A window of cells and an explanation in it, of a size."""

    onset: int
    last: int
    explanation: int
    size: float


def wanders_beside(model: Model, place: Place) -> FloatArray:
    """Return how far means of chunks wander in a window beside an explanation, shape (equations,); NaN if unknown."""
    return np.array([_wander(sums, model, place) for sums in model.sums])


def restless_sums(model: Model, place: Place, *, is_around: bool = False) -> tuple[WindowSums, ...]:
    """Return sums in which means wander as they do beside an explanation; and about it, where that is asked."""
    wanders = np.nan_to_num(wanders_beside(model, place))
    if is_around:
        wanders = np.maximum(wanders, _around(model, place, wanders))
    names = [(sums.products.equation.relation.name, sums.products.equation.relation.channels) for sums in model.sums]
    tilt = [
        at
        for at, (sums, (name, channels)) in enumerate(zip(model.sums, names, strict=True))
        if name == "attitude" and channels[sums.products.equation.channel] in _TILT
    ]
    if tilt:
        wanders[tilt] = wanders[tilt].max()
    return tuple(
        sums if wander <= sums.products.equation.wander else WindowSums(sums.products, float(wander))
        for sums, wander in zip(model.sums, wanders, strict=True)
    )


def _around(model: Model, place: Place, wanders: FloatArray) -> FloatArray:
    """Return how far means wander before a window, and behind it whether the explanation goes on there or not."""
    width = max(round(_AROUND_S / model.cell_s), 2)
    found = wanders.copy()
    if place.onset >= width // 2:
        before = Place(onset=max(place.onset - width, 0), last=place.onset, explanation=place.explanation, size=0.0)
        found = np.fmax(found, wanders_beside(model, before))
    end = min(place.last + width, model.cells)
    if end - place.last >= width // 2:
        goes_on = Place(onset=place.onset, last=end, explanation=place.explanation, size=place.size)
        is_over = Place(onset=place.last, last=end, explanation=place.explanation, size=0.0)
        behind = np.fmin(wanders_beside(model, goes_on), wanders_beside(model, is_over))
        found = np.fmax(found, behind)
    return found


def _wander(sums: WindowSums, model: Model, place: Place) -> float:
    """Return the root mean square of means of chunks, with what is not known of them."""
    own, columns = sums.products, sums.products.columns
    begin = min(place.onset + 1, place.last)
    edges = np.unique(
        [begin, *range(-(-begin // own.per_chunk) * own.per_chunk, place.last, own.per_chunk), place.last]
    )
    if len(edges) < 2:
        return float("nan")
    # per piece of a chunk: m'(e, X) and m'm, m what a constant looks like behind the whitening
    means, precisions = sums.chunk_means(edges[:-1], edges[1:])
    if not precisions.sum() > 0.0:
        return float("nan")
    onset, last = np.array([place.onset]), np.array([place.last])
    inside = sums.window(onset, np.array([begin]), last)
    rest = outside(model, sums, onset, last)
    shift = rest.shift[0]
    known = 1 + own.regressors
    at = np.flatnonzero(columns.own == place.explanation)
    signature = sums.signature_means(place.onset, edges, int(at[0])) if len(at) else np.zeros(len(edges) - 1)
    mixed = inside.mixed[0, at[0]] if len(at) else np.zeros(own.regressors)
    squares = inside.squares[0]
    # the constants with the fault taken out: shift + (X'X + P)^-1 X'(e - X shift - size s)
    gain = np.linalg.inv(squares + rest.precision[0])
    constants = shift + gain @ (inside.products[0] - squares @ shift - place.size * mixed)
    # each piece's mean by least squares, its own wander as its prior, and what is not known of it: its own 1 / (m'm +
    # w^-2), and what the constants leave open
    own_precision = precisions + max(own.equation.wander, 1e-6) ** -2.0
    left = (means[:, 0] - means[:, 1:known] @ constants - place.size * signature) / own_precision
    columns_mean = means[:, 1:known] / own_precision[:, np.newaxis]
    unknown = 1.0 / own_precision + np.einsum("ck,kl,cl->c", columns_mean, gain, columns_mean)
    return float(np.sqrt(np.mean(np.square(left) + np.maximum(unknown, 0.0))))  # which rounding may turn below none
