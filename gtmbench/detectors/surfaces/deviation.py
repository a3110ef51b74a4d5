"""Tests of deviations: whether a surface is off, answers its command less, or later, than it did in the minute before.

Over a window the deviation d of a surface is fitted by what it was commanded, u, and how fast that changed, v:

    d = a + b u + c v + e.

A healthy surface has the a, b and c of the minute before. An offset is another a; a loss of effectiveness, and a jam
(b = -1), another b; a slow servo another c. Each is judged by its change beyond a tolerance, over its standard error,
in nats: T^2/2. What no surface explains has a only, and its level beside those of the surfaces: a sensor of the flow
that is noisy or stuck shows there. The error is that of the noise now: the greater of what gusts and sensors leave in
the window and in the minute before. So stronger gusts make the tests less sensitive, not false.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.surfaces.answer import Deviations
from gtmbench.values.record import BoolArray, FloatArray

BLOCK_S = 0.25  # between judgements
_BASE_S, _LEAST_BASE_S = 60.0, 20.0  # what a window is compared with
_RECENT_S = 10.0
OFFSET, SLOPE, RATE, LEVEL = "offset", "slope", "rate", "level"
_TESTS = (
    (OFFSET, 1.0),
    (OFFSET, 4.0),
    (OFFSET, 15.0),
    (SLOPE, 5.0),
    (SLOPE, 20.0),
    (RATE, 20.0),
    (LEVEL, 5.0),
    (LEVEL, 20.0),
)
WINDOWS_S = tuple(window_s for _, window_s in _TESTS)
LABELS = tuple(f"{kind} {window_s:g} s" for kind, window_s in _TESTS)
TOLERATED = {OFFSET: 0.1, SLOPE: 0.1, RATE: 0.04, LEVEL: 0.4}  # deg; of 1; seconds; of a logarithm
_LEFT_TOLERATED = 0.3  # deviations of what no surface explains
_PRIOR = 1e-3  # of a command's mean square: one that stands still tells nothing of its effect
_ENOUGH = 0.8  # of samples, or blocks, that must be there
_FORGETS = 8  # blocks after a hole
HORIZON = round((_BASE_S + 20.0) / BLOCK_S) + _FORGETS + 1  # blocks that a test looks back at
_LEAST_LEVEL = 0.1  # how much logarithms of squares vary at least
_QUIET = 0.5  # of the noise that was learnt: air that is calmer isn't trusted to show the model's own errors


class Blocks(NamedTuple):
    """Sums over blocks of the products of 1, u, v and d, of every surface and of all that is left.

    Attributes
    ----------
    sums : shape (blocks, series, 4, 4)
    there : shape (blocks,)
        Whether enough samples of a block were.
    """

    sums: FloatArray
    there: BoolArray

    def joined(self, other: Blocks) -> Blocks:
        """Return these and the next."""
        return Blocks(np.concatenate([self.sums, other.sums]), np.concatenate([self.there, other.there]))

    def last(self, blocks: int) -> Blocks:
        """Return the last ones."""
        first = max(len(self.there) - blocks, 0)
        return Blocks(self.sums[first:], self.there[first:])


def blocks_of(deviations: Deviations, there: BoolArray, rows: int) -> Blocks:
    """Return the sums of whole blocks of `rows` samples; what is left over at the end isn't used.

    Parameters
    ----------
    deviations : Deviations
    there : shape (samples,)
        Where no channel misses its sample.
    rows : int
    """
    count = len(there) // rows
    left = deviations.left
    still = np.zeros_like(left)
    d = np.column_stack([deviations.off, left])[: count * rows]
    u = np.column_stack([deviations.commanded, still])[: count * rows]
    v = np.column_stack([deviations.slew, still])[: count * rows]
    x = np.stack([np.ones_like(d), u, v, d], axis=-1).reshape(count, rows, d.shape[1], 4)
    sums = np.einsum("brsi,brsj->bsij", x, x, optimize=True)
    return Blocks(sums, there[: count * rows].reshape(count, rows).mean(axis=1) >= _ENOUGH)


class Changes(NamedTuple):
    """What has changed in every window that ends with a block, of every test.

    Attributes
    ----------
    change, error : shape (blocks, tests, series)
        In the test's unit; the error is that of white noise, sample by sample.
    """

    change: FloatArray
    error: FloatArray


def changes(blocks: Blocks, floor: FloatArray) -> Changes:
    """Return the changes of all tests of all blocks, NaN where there isn't enough before them.

    Parameters
    ----------
    blocks : Blocks
    floor : shape (series,)
        The least noise, in the series' units.
    """
    count, series = blocks.sums.shape[:2]
    used = _used(blocks.there)
    sums = np.concatenate(
        [np.zeros((1, series, 4, 4)), np.cumsum(np.where(used[:, None, None, None], blocks.sums, 0.0), axis=0)]
    )
    held = np.concatenate([[0], np.cumsum(used)])
    shape = (count, len(_TESTS), series)
    change, error = np.full(shape, np.nan), np.full(shape, np.nan)
    base, least, recent = (round(span_s / BLOCK_S) for span_s in (_BASE_S, _LEAST_BASE_S, _RECENT_S))
    for test, (kind, window_s) in enumerate(_TESTS):
        window = round(window_s / BLOCK_S)
        ends = np.arange(window + least, count + 1)
        firsts = np.maximum(ends - window - base, 0)
        late = ends - window - recent
        enough = held[ends] - held[ends - window] >= _ENOUGH * window
        enough &= held[ends - window] - held[firsts] >= _ENOUGH * least
        enough &= held[ends - window] - held[late] >= _ENOUGH * recent
        ends, firsts, late = ends[enough], firsts[enough], late[enough]
        if not len(ends):
            continue
        begins = ends - window
        before, lately, now = sums[begins] - sums[firsts], sums[begins] - sums[late], sums[ends] - sums[begins]
        normal = _fit(before)
        noise = np.maximum(
            _left(before, normal) / before[..., 0, 0],
            _left(lately, normal) / lately[..., 0, 0],
        )
        if kind == LEVEL:
            change[ends - 1, test], error[ends - 1, test] = _louder(now, before, normal, floor), 1.0
        else:
            change[ends - 1, test], error[ends - 1, test] = _judged(kind, now, normal, noise, floor)
    return Changes(change, error)


def _used(there: BoolArray) -> BoolArray:
    """Return which blocks are used: those that are there, once the filters have forgotten the last that wasn't."""
    after_hole = np.concatenate([np.zeros(_FORGETS, dtype=int), np.cumsum(~there)])
    return np.asarray(after_hole[_FORGETS:] == after_hole[: len(there)]) if len(there) else there


def _fit(sums: FloatArray) -> FloatArray:
    """Return a, b and c by least squares, shape (..., 3)."""
    return np.asarray(np.linalg.solve(_inner(sums), sums[..., :3, 3:])[..., 0])


def _inner(sums: FloatArray) -> FloatArray:
    """Return the products of 1, u and v, a little larger where a command stands still."""
    inner = sums[..., :3, :3].copy()
    samples = inner[..., 0, 0]
    for i in (1, 2):
        inner[..., i, i] += _PRIOR * np.maximum(inner[..., i, i], samples)
    return inner


def _left(sums: FloatArray, fit: FloatArray) -> FloatArray:
    """Return the squares that a fit leaves of d."""
    inner = np.einsum("...i,...ij,...j->...", fit, sums[..., :3, :3], fit, optimize=True)
    mixed = np.einsum("...i,...i->...", fit, sums[..., :3, 3], optimize=True)
    return np.asarray(np.maximum(sums[..., 3, 3] - 2.0 * mixed + inner, 0.0))


def _louder(now: FloatArray, before: FloatArray, normal: FloatArray, floor: FloatArray) -> FloatArray:
    """Return by what power of e a window's squares exceed those before, less what all series do: gusts shake all."""
    least = np.square(_QUIET * floor)
    level = np.maximum(_left(now, normal) / now[..., 0, 0], least)
    usual = np.maximum(_left(before, normal) / before[..., 0, 0], least)
    grown = np.log(level / usual)
    return np.asarray(np.maximum(grown - np.maximum(np.median(grown, axis=1, keepdims=True), 0.0), 0.0))


def _judged(
    kind: str, now: FloatArray, normal: FloatArray, noise: FloatArray, floor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how a window differs from what is normal, and by how much white noise alone would make it."""
    samples = now[..., 0, 0]
    beyond = now[..., :3, 3] - np.einsum("...ij,...j->...i", now[..., :3, :3], normal, optimize=True)
    left = _left(now, normal)
    if kind == OFFSET:
        change = beyond[..., 0] / samples
        own = left / samples - change**2
        spread = np.asarray(1.0 / samples, dtype=np.float64)
    else:
        at = 1 if kind == SLOPE else 2
        inner = _inner(now)
        fit = np.linalg.solve(inner, beyond[..., np.newaxis])[..., 0]
        change = fit[..., at]
        own = (left - np.einsum("...i,...i->...", fit, beyond, optimize=True)) / samples
        spread = np.asarray(np.linalg.inv(inner)[..., at, at], dtype=np.float64)
    level = np.maximum(np.maximum(own, noise), np.square(_QUIET * floor))
    return change, np.sqrt(level * spread)


@dataclass(frozen=True, kw_only=True, eq=False)
class Normal:
    """What changes are usual on healthy flight.

    Attributes
    ----------
    noise : shape (series,)
        Deviation of what a minute's fit leaves.
    colour : shape (tests, series)
        How many times the error of white noise changes really vary: neighbouring samples are alike.
    """

    noise: FloatArray
    colour: FloatArray

    def nats(self, found: Changes, surfaces: int) -> FloatArray:
        """Return T^2/2 of all tests, shape (blocks, tests, series); NaN where a test tells nothing."""
        tolerated = np.array([[TOLERATED[kind]] for kind, _ in _TESTS])
        limits = np.broadcast_to(tolerated, found.change.shape[1:]).copy()
        limits[np.ix_([kind == OFFSET for kind, _ in _TESTS], range(surfaces, limits.shape[1]))] = _LEFT_TOLERATED
        with np.errstate(invalid="ignore", divide="ignore"):
            t = np.maximum(np.abs(found.change) - limits, 0.0) / (self.colour * found.error)
        t[:, [i for i, (kind, _) in enumerate(_TESTS) if kind == LEVEL], :surfaces] = np.nan
        t[:, [i for i, (kind, _) in enumerate(_TESTS) if kind in (SLOPE, RATE)], surfaces:] = np.nan
        return np.asarray(0.5 * np.square(np.minimum(t, 1e3)))

    def smallest(self, found: Changes, thresholds: FloatArray) -> FloatArray:
        """Return the least change that each test would alarm of, shape (blocks, tests, series), in the test's unit.

        Parameters
        ----------
        found : Changes
        thresholds : shape (tests, series)
            In nats.
        """
        tolerated = np.array([[TOLERATED[kind]] for kind, _ in _TESTS])
        return np.asarray(tolerated + np.sqrt(2.0 * thresholds) * self.colour * found.error)


def normal_of(healthy: Sequence[Blocks]) -> Normal:
    """Return what is usual, of the blocks of healthy records."""
    series = healthy[0].sums.shape[1]
    levels = []
    for blocks in healthy:
        base = round(_LEAST_BASE_S / BLOCK_S)
        for first in range(0, len(blocks.there) - base + 1, base):
            part = blocks.sums[first : first + base].sum(axis=0)
            levels.append(_left(part, _fit(part)) / part[..., 0, 0])
    noise = np.sqrt(np.median(np.array(levels), axis=0)) if levels else np.ones(series)
    ratios: list[FloatArray] = []
    for blocks in healthy:
        found = changes(blocks, noise)
        with np.errstate(invalid="ignore", divide="ignore"):
            ratios.append(found.change / found.error)
    joined = np.concatenate(ratios)
    with np.errstate(invalid="ignore"):
        colour = np.sqrt(np.nanmean(np.square(joined), axis=0))
    least = np.array([[_LEAST_LEVEL if kind == LEVEL else 1.0] for kind, _ in _TESTS])
    return Normal(noise=noise, colour=np.maximum(np.nan_to_num(colour, nan=1.0), least))
