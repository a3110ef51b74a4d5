"""Tests of deviations: whether a surface is off, answers its command less, or later, than it did in the minute before.

Over a window the deviation d of a surface is fitted by what it was commanded, u, and how fast that changed, v:

    d = a + b u + c v + e.

A healthy surface has the a, b and c of the minute before. An offset is another a; a loss of effectiveness, and a jam
(b = -1), another b; a slow servo another c (and b). Two tests say so: of a alone, and of b and c together, whatever a
is. The noise e is what gusts and sensors leave: coloured, and stronger or weaker by the hour. So its colour is learnt
in the minute before, and both sides are made white (`whitened.py`); its level is the greatest of that minute's, of its
last ten seconds' and of the window's own. A change x is judged by its deviations, sqrt(x' C^-1 x), C being its
covariance with that of the minute's fit, less what a tolerated change amounts to; in nats: T^2/2. Motion that is harder
than what was learnt on is less linear, so more is tolerated.

What changes are usual on healthy flight: how large, and how many deviations a change has to be to tell anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.surfaces.answer import ENOUGH, DeviationBlocks
from gtmbench.detectors.surfaces.whitened import ORDER, BlockSums, Counts, left, whitening
from gtmbench.values.record import BoolArray, FloatArray

BASE_S, LEAST_BASE_S = 60.0, 40.0  # what a window is compared with: a phugoid takes half of that
_RECENT_S = 10.0  # just before a window, by which the noise is known as it is now
OFFSET, ANSWER = "offset", "answer"
_TESTS = (  # kinds, and windows in seconds
    (OFFSET, 2.0),
    (OFFSET, 4.0),
    (OFFSET, 16.0),
    (OFFSET, 48.0),
    (ANSWER, 16.0),
    (ANSWER, 48.0),
)
KINDS = tuple(kind for kind, _ in _TESTS)
WINDOWS_S = tuple(window_s for _, window_s in _TESTS)
LABELS = tuple(f"{kind} {window_s:g} s" for kind, window_s in _TESTS)
_TOLERATED_DEG, _TOLERATED_LOSS, _TOLERATED_S = 0.1, 0.1, 0.04  # of a, b and c
# how far a, b and c of a healthy surface may be from what was identified
_NORMAL = np.diag(1.0 / np.square([3.0, 0.15, 0.05]))
_BROKEN = np.diag(1.0 / np.square([10.0, 1.0, 1.0]))  # how far a fault may change them
_FORGETS_S = 2.0  # after a hole
_QUIET = 0.5  # of the noise that was learnt: air that is calmer isn't trusted to show the model's own errors
_BLIND = 1.0  # the loss of all of a command is less than a deviation: it hardly moved
_LEAST = 1e-12  # a division's guard


class Changes(NamedTuple):
    """What has changed in every window that ends with a block, of every test; shape (blocks, tests, surfaces)."""

    # size, tolerated: how many deviations a change amounts to, and how many what is tolerated does
    size: FloatArray
    tolerated: FloatArray
    # what one deviation amounts to: degrees of an offset, or a share of the effectiveness that is lost
    error: FloatArray


class Comparing:
    """The tests at work, as blocks come in. `floor`, shape (surfaces,): the noise that was learnt, made white."""

    def __init__(self, floor: FloatArray, block_s: float) -> None:
        self._floor = np.square(_QUIET * floor)
        self._block_s = block_s
        horizon = self._blocks(BASE_S + max(WINDOWS_S))
        self._sums = BlockSums(len(floor), 4, horizon)
        self._piece = horizon  # blocks at a time: a day in one piece would need gigabytes
        self._since_hole = 0

    def push(self, new: DeviationBlocks) -> Changes:
        """Return the changes of the next blocks, NaN where there isn't enough before them."""
        used = self._used(new.there)
        found = [self._pushed(new.means[part], used[part]) for part in self._pieces(len(used))]
        if not found:
            return self._nothing(0)
        return Changes(*(np.concatenate(parts) for parts in zip(*found, strict=True)))

    def _pieces(self, count: int) -> Iterator[slice]:
        return (slice(first, first + self._piece) for first in range(0, count, self._piece))

    def _blocks(self, span_s: float) -> int:
        return max(round(span_s / self._block_s), 1)

    def _used(self, there: BoolArray) -> BoolArray:
        """Return which blocks are used: those that are there, once the filters have forgotten the last that wasn't."""
        used = np.zeros(len(there), dtype=bool)
        forgets = self._blocks(_FORGETS_S)
        for i, is_there in enumerate(there.tolist()):
            self._since_hole = self._since_hole + 1 if is_there else 0
            used[i] = self._since_hole > forgets
        return used

    def _nothing(self, count: int) -> Changes:
        return Changes(*np.full((3, count, len(_TESTS), len(self._floor)), np.nan))

    def _pushed(self, means: FloatArray, used: BoolArray) -> Changes:
        first = self._sums.count
        self._sums.push(means, used)
        made = self._nothing(len(means))
        for window_s in sorted(set(WINDOWS_S)):
            ends = self._judged(first, window_s)
            if not len(ends):
                continue
            now = self._compared(ends, window_s)
            for test, (kind, span_s) in enumerate(_TESTS):
                if span_s == window_s:
                    for into, values in zip(made, _FOUND[kind](now), strict=True):
                        into[ends - 1 - first, test] = values
        return made

    def _judged(self, first: int, window_s: float) -> Counts:
        """Return behind which new blocks a window ends that can be judged."""
        window, least, recent = map(self._blocks, (window_s, LEAST_BASE_S, _RECENT_S))
        ends = np.arange(max(first + 1, window + least), self._sums.count + 1)
        begins = ends - window
        enough = self._sums.held(begins, ends) >= ENOUGH * window
        enough &= self._sums.held(self._base(begins), begins) >= ENOUGH * least
        enough &= self._sums.held(begins - recent, begins) >= ENOUGH * recent
        return ends[enough]

    def _base(self, begins: Counts) -> Counts:
        return np.maximum(begins - self._blocks(BASE_S), 0)

    def _compared(self, ends: Counts, window_s: float) -> _Compared:
        sums, floor = self._sums, self._floor
        begins = ends - self._blocks(window_s)
        base = self._base(begins)
        held = np.repeat(sums.held(base, begins)[:, np.newaxis], len(floor), axis=1)
        taps = np.zeros((len(ends), len(floor), ORDER + 1))
        taps[..., 0] = 1.0  # as it is, at first
        fit, _, _ = fitted(sums.whitened(base, begins, taps), held)
        taps = whitening(sums.lagged(base, begins, fit))
        fit, power, covariance = fitted(sums.whitened(base, begins, taps), held)
        recent = self._blocks(_RECENT_S)
        lately = left(sums.whitened(begins - recent, begins, taps), fit) / recent
        return _Compared(
            now=sums.whitened(begins, ends, taps),
            held=np.repeat(sums.held(begins, ends)[:, np.newaxis], len(floor), axis=1),
            fit=fit,
            covariance=covariance,
            noise=np.maximum(np.maximum(power, lately), floor),
            usual=np.maximum(np.broadcast_to(floor, power.shape) / np.square(_QUIET), _LEAST),
        )


class _Compared(NamedTuple):
    """Windows beside the minute before each."""

    now: FloatArray  # shape (windows, surfaces, 4, 4): products of a window, made white
    held: FloatArray  # shape (windows, surfaces): its blocks
    # fit, covariance: a, b and c of the minute
    fit: FloatArray
    covariance: FloatArray
    # noise, usual, shape (windows, surfaces): the noise's power by then at most, and what was learnt
    noise: FloatArray
    usual: FloatArray

    @property
    def rough(self) -> FloatArray:
        """How much more than what is usual is tolerated: motion that is twice as hard is four times as nonlinear."""
        return np.asarray(np.maximum(self.noise / self.usual, 1.0))

    @property
    def beyond(self) -> FloatArray:
        """What the minute's fit doesn't explain, times 1, u and v."""
        explained = np.einsum("...ij,...j->...i", self.now[..., :3, :3], self.fit, optimize=True)
        return np.asarray(self.now[..., :3, 3] - explained)

    def level(self, explained: FloatArray) -> FloatArray:
        """Return the noise's power, of which some squares of the window are explained."""
        own = (left(self.now, self.fit) - explained) / self.held
        return np.asarray(np.maximum(own, self.noise))


def fitted(products: FloatArray, held: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a, b and c, the power of what they leave, and their covariance, by least squares and what is usual."""
    inner, mixed = products[..., :3, :3], products[..., :3, 3:]
    fit = np.asarray(np.linalg.solve(inner + np.diag([_LEAST, 1e-3, 1e-3]), mixed)[..., 0], dtype=np.float64)
    for _ in range(2):  # how much the noise is decides how much what is usual weighs
        power = np.maximum(left(products, fit) / held, _LEAST)
        whole = inner + power[..., np.newaxis, np.newaxis] * _NORMAL
        fit = np.asarray(np.linalg.solve(whole, mixed)[..., 0], dtype=np.float64)
    return fit, power, power[..., np.newaxis, np.newaxis] * np.linalg.inv(whole)


def _offset(seen: _Compared) -> Changes:
    """Return by how much a has changed, b and c being what they were."""
    inner, beyond = seen.now[..., :3, :3], seen.beyond
    ones = np.maximum(inner[..., 0, 0], _LEAST)
    change = beyond[..., 0] / ones
    earlier = _quadratic(seen.covariance, inner[..., 0, :]) / ones**2
    error = np.sqrt(seen.level(change * beyond[..., 0]) / ones + earlier)
    return Changes(np.abs(change) / error, _TOLERATED_DEG * seen.rough / error, error)


def _answer(seen: _Compared) -> Changes:
    """Return by how much b and c have changed, whatever a is."""
    inner, beyond = seen.now[..., :3, :3], seen.beyond
    whole = inner + seen.noise[..., np.newaxis, np.newaxis] * _BROKEN
    inverse = np.asarray(np.linalg.inv(whole), dtype=np.float64)
    fit: FloatArray = np.einsum("...ij,...j->...i", inverse, beyond, optimize=True)
    explained = 2.0 * np.einsum("...i,...i->...", fit, beyond) - _quadratic(inner, fit)
    level = seen.level(explained)[..., np.newaxis, np.newaxis]
    gain = inverse @ inner  # of the fit to a true change
    spread = level * gain @ inverse + gain @ seen.covariance @ np.swapaxes(gain, -1, -2)
    certain = np.asarray(np.linalg.inv(spread[..., 1:, 1:] + _LEAST * np.eye(2)), dtype=np.float64)
    change, gain = fit[..., 1:], gain[..., 1:, 1:]
    error = 1.0 / np.sqrt(np.maximum(_quadratic(certain, gain[..., 0]), _LEAST))
    signs = [gain @ np.array([_TOLERATED_LOSS, sign * _TOLERATED_S]) for sign in (-1.0, 1.0)]
    tolerated = np.sqrt(np.max([_quadratic(certain, both) for both in signs], axis=0))
    size = np.where(error > _BLIND, 0.0, np.sqrt(_quadratic(certain, change)))
    return Changes(size, tolerated * seen.rough, error)


def _quadratic(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.einsum("...i,...ij,...j->...", vector, matrix, vector, optimize=True), 0.0))


_FOUND: Mapping[str, Callable[[_Compared], Changes]] = {OFFSET: _offset, ANSWER: _answer}


def changes(blocks: DeviationBlocks, floor: FloatArray) -> Changes:
    """Return the changes of all tests of all blocks, NaN where there isn't enough before them."""
    return Comparing(floor, blocks.block_s).push(blocks)


_COLOUR_BLOCKS = 600  # that a colour is learnt from: a minute's


@dataclass(frozen=True, kw_only=True, eq=False)
class Normal:
    """What changes are usual on healthy flight."""

    # shape (surfaces,): deviation of what a minute's fit leaves: what gusts and sensors amount to, in degrees or steps
    noise: FloatArray
    white: FloatArray  # shape (surfaces,): the same, made white
    colour: FloatArray  # shape (tests, surfaces): how many times the size that white noise would give changes have

    def nats(self, found: Changes) -> FloatArray:
        """Return T^2/2 of all tests, shape (blocks, tests, surfaces); NaN where a test tells nothing."""
        t = np.maximum(found.size - found.tolerated, 0.0) / self.colour
        return np.asarray(0.5 * np.square(np.minimum(t, 1e3)))

    def smallest(self, found: Changes, thresholds: FloatArray) -> FloatArray:
        """Return the least change that each test would alarm of, shape (blocks, tests, surfaces), in the test's unit.

        `thresholds`, shape (tests, surfaces): in nats.
        """
        return np.asarray((found.tolerated + np.sqrt(2.0 * thresholds) * self.colour) * found.error)


def normal_of(healthy: Sequence[DeviationBlocks]) -> Normal:
    """Return what is usual, of the blocks of healthy records."""
    powers = []
    for blocks in healthy:
        base = round(LEAST_BASE_S / blocks.block_s)
        for first in range(0, len(blocks.there) - base + 1, base):
            part = slice(first, first + base)
            if blocks.there[part].mean() >= ENOUGH:
                powers.append(_powers(blocks.means[part], blocks.there[part]))
    surfaces = healthy[0].means.shape[1]
    noise, floor = np.sqrt(np.median(np.array(powers or [np.ones((2, surfaces))]), axis=0))
    found = [changes(blocks, floor) for blocks in healthy]
    size, tolerated, _ = (np.concatenate(each) for each in zip(*found, strict=True))
    # where more is tolerated than a deviation, sizes are those of the aircraft's own small changes, not of noise
    of_noise = np.isfinite(size) & (tolerated < 1.0)
    seen = of_noise.sum(axis=0)
    degrees = np.array([2.0 if kind == ANSWER else 1.0 for kind in KINDS])[:, np.newaxis]
    squares = np.sum(np.square(size), axis=0, where=of_noise) / np.maximum(seen, 1) / degrees
    colour = np.sqrt(np.where(seen >= _COLOUR_BLOCKS, squares, 1.0))
    return Normal(noise=noise, white=floor, colour=np.maximum(colour, 1.0))


def _powers(means: FloatArray, there: BoolArray) -> FloatArray:
    """Return the power of what a fit of some blocks leaves, as it is and made white."""
    sums = BlockSums(means.shape[1], 4, len(means))
    sums.push(means, there)
    begin, end, held = np.array([0]), np.array([sums.count]), np.full((1, means.shape[1]), there.sum())
    taps = np.zeros((1, means.shape[1], ORDER + 1))
    taps[..., 0] = 1.0
    fit, plain, _ = fitted(sums.whitened(begin, end, taps), held)
    _, white, _ = fitted(sums.whitened(begin, end, whitening(sums.lagged(begin, end, fit))), held)
    return np.array([plain[0], white[0]])
