"""Sums of products over any window of a log, at a cost that doesn't depend on its length.

All that a likelihood ratio needs of an equation are sums over the window of products of two columns: what is left, the
regressors, each explanation's signature. They are kept as running sums over cells of a second. Two things make that
more than a cumulative sum. The mean of each chunk of four seconds wanders by itself: it is marginalised, so a window's
sum is one over its whole chunks and over what it cuts of the first and the last. And a signature that an estimator
makes depends on its onset a, by what the attitude forgets from then on: it is

    s(t; a) = b(t) - sum_j k_j(a) d_j(t) exp(-(t - a) / tau),

whose d_j, the answers to an attitude that was off about earth axis j, are columns that fade from chunk to chunk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gtmbench.engine.constants import by_chunks
from gtmbench.engine.equation import Equation, rows_per_chunk
from gtmbench.engine.explanation import TIMES_S, Explanation, kept_a_block
from gtmbench.engine.flight import Flight
from gtmbench.engine.noise import ORDER
from gtmbench.engine.relation import Effect, Relation
from gtmbench.values.pieces import pieces
from gtmbench.values.record import BoolArray, FloatArray, IntArray

CELL = ORDER  # blocks: what a filter forgets
_AT_ONCE = 50  # cells whose products are worked out together: they stay in the cache
_KEPT = 20_000  # blocks of a flight of which effects are kept: an hour's take 70 MB
_BESIDE = 5  # chunks: an onset that is dated again is moved by less


def blocks_of_cells(first: int, last: int, count: int) -> BoolArray:
    """Tell which of so many blocks lie in cells [first, last), shape (count,).

    >>> np.flatnonzero(blocks_of_cells(1, 2, 100)).tolist() == list(range(CELL, 2 * CELL))
    True
    """
    found = np.zeros(count, dtype=bool)
    found[first * CELL : last * CELL] = True
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class WhiteRows:
    """Which explanations an equation feels, and what multiplies their signatures' parts."""

    own: IntArray  # shape (signatures,): which explanations it feels
    times: tuple[float, ...]  # by which signatures fade, in seconds
    fading: IntArray  # shape (signatures,): which of these times each fades by; -1 for none
    bases: IntArray  # shape (signatures,): which signature each grows from; -1 for none
    # shape (cells + 1, explanations, 3): by how much the attitude would be off at each cell's beginning, in earth axes,
    # deg; of all explanations, for all equations share it
    every_state: FloatArray = field(repr=False)
    every_since: FloatArray = field(repr=False)  # shape (cells + 1, explanations): the base's multiplier

    @cached_property
    def grown(self) -> IntArray:
        """Which signatures grow from another one, which fades as they do."""
        return np.flatnonzero(self.bases >= 0)

    @cached_property
    def faded(self) -> IntArray:
        """Which signatures fade."""
        return np.flatnonzero(self.fading >= 0)

    def states(self, cells: IntArray) -> FloatArray:
        """Return by how much the attitude would be off at some cells' beginnings, shape (cells, signatures, 3)."""
        return self.every_state[cells[:, np.newaxis], self.own]

    def since(self, cells: IntArray) -> FloatArray:
        """Return the bases' multipliers at some cells; what a base doesn't change needs none of it."""
        return np.asarray(self.every_since[cells[:, np.newaxis], self.own] * (self.bases >= 0))


class SignatureSet:
    """What each explanation is off by in a relation's equations, from the log's beginning on; worked out once."""

    def __init__(self, flight: Flight, explanations: Sequence[Explanation]) -> None:
        self.flight, self.explanations = flight, tuple(explanations)
        self.cells = -(-len(flight) // CELL)
        names = {each.name: place for place, each in enumerate(explanations)}
        self.bases = np.array([names[each.base] if each.base else -1 for each in explanations])
        self.times = TIMES_S if any(each.fades_s for each in explanations) else ()
        times = {fades_s: place for place, fades_s in enumerate(self.times)}
        self.fading = np.array([times[each.fades_s] if each.fades_s else -1 for each in explanations])
        rows = np.minimum(np.arange(self.cells + 1) * CELL, len(flight) - 1)
        self._before = np.maximum(rows - 1, 0)
        self._states = np.zeros((self.cells + 1, len(self.explanations), 3))
        self._since = np.zeros((self.cells + 1, len(self.explanations)))
        self._effects: list[Effect | None] = [None] * len(self.explanations)
        for place, each in enumerate(self.explanations):
            effect = self.effect(place)
            if each.fades_s and effect.turned is not None:
                self._states[1:, place] = effect.turned[self._before[1:]]
            if each.since is not None:
                self._since[:, place] = each.since(flight)[rows]

    def effect(self, place: int) -> Effect:
        """Return what an explanation is off by; of a long flight it is worked out anew, for memory."""
        known = self._effects[place]
        effect = self.explanations[place].effect(self.flight) if known is None else known
        if len(self.flight) <= _KEPT:
            self._effects[place] = effect
        return effect

    def place_of(self, explanation: Explanation) -> int:
        """Return which of all explanations one is, by its name."""
        return next(place for place, each in enumerate(self.explanations) if each.name == explanation.name)

    def over(
        self, relation: Relation, channel: int, constants: FloatArray, place: int, first: int, last: int
    ) -> FloatArray | None:
        """Return an explanation's signature over cells [first, last), zero elsewhere, shape (blocks,); None if nil."""
        explanation, flight = self.explanations[place], self.flight
        begin, end = first * CELL, min(last * CELL, len(flight))
        answer = relation.answer(flight, self.effect(place), channel, constants)
        if answer is None or not np.any(answer[begin:end]):
            return None
        since, base, state = self._at_onset(place, first)
        of_base = relation.answer(flight, self.effect(base), channel, constants) if since else None
        own = answer if of_base is None else answer - since * of_base
        if explanation.fades_s:
            forgotten = self.forgotten(relation, channel, constants)[:, self.fading[place]]
            own = own - forgotten @ state * self._faded(place, begin)
        found = np.zeros(len(flight))
        found[begin:end] = own[begin:end]
        return found

    def turned(self, place: int, first: int, last: int) -> FloatArray:
        """Return how far an attitude is off that follows an explanation from a cell on, in deg, shape (blocks, 3)."""
        begin, end = first * CELL, min(last * CELL, len(self.flight))
        turned, explanation = self.effect(place).turned, self.explanations[place]
        if turned is None or not explanation.fades_s:
            return np.zeros((0, 3))
        since, base, state = self._at_onset(place, first)
        of_base = self.effect(base).turned if since else None
        turned = turned if of_base is None else turned - since * of_base
        kept = kept_a_block(self.flight, explanation.fades_s)
        return np.asarray((turned - np.multiply.outer(kept * self._faded(place, begin), state))[begin:end])

    def _at_onset(self, place: int, cell: int) -> tuple[float, int, FloatArray]:
        """Return what multiplies the base of an explanation from a cell on, which base, and the attitude's state."""
        since, base = float(self._since[cell, place]), int(self.bases[place])
        return since, base, np.asarray(self._states[cell, place] - since * self._states[cell, base])

    def _faded(self, place: int, begin: int) -> FloatArray:
        """Return how much is left of what was before a block, from it on."""
        factor = kept_a_block(self.flight, self.explanations[place].fades_s)
        return np.asarray(factor ** np.maximum(np.arange(len(self.flight)) - begin, 0))

    def answers(self, equations: Sequence[Equation]) -> list[tuple[WhiteRows, list[FloatArray]]]:
        """Return the signatures that each equation feels, whitened, each of shape (blocks,)."""
        found: list[list[tuple[int, FloatArray]]] = [[] for _ in equations]
        for place in range(len(self.explanations)):
            effect = self.effect(place)
            for equation, own in zip(equations, found, strict=True):
                answer = equation.relation.answer(self.flight, effect, equation.channel, equation.constants)
                if answer is not None and np.any(answer):
                    own.append((place, equation.whitened(answer)))
        return [(self._columns([place for place, _ in own]), [answer for _, answer in own]) for own in found]

    def _columns(self, felt: Sequence[int]) -> WhiteRows:
        own = np.array(felt, dtype=np.int64)
        places = {place: at for at, place in enumerate(felt)}
        return WhiteRows(
            own=own,
            times=self.times,
            fading=self.fading[own],
            bases=np.array([places.get(int(self.bases[place]), -1) for place in felt], dtype=np.int64),
            every_state=self._states,
            every_since=self._since,
        )

    def forgotten(self, relation: Relation, channel: int, constants: FloatArray) -> FloatArray:
        """Return the answer to an attitude that was off by one degree about each earth axis, and forgets it.

        Shape (blocks, times, 3).
        """
        flight = self.flight
        found = np.zeros((len(flight), len(self.times), 3))
        for axis in range(3):
            off = np.zeros((len(flight), 3))
            off[:, axis] = 1.0
            for place, fades_s in enumerate(self.times):
                kept = kept_a_block(flight, fades_s)
                effect = Effect(turned=kept * off, turning=-0.5 * (1.0 + kept) / fades_s * off)
                answer = relation.answer(flight, effect, channel, constants)
                if answer is not None:
                    found[:, place, axis] = answer
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Products:
    """Running sums of products of an equation's columns over cells, from nothing on; shapes (cells + 1, ...).

    The columns are, in order: what is left, the regressors, the signatures, and what fades (times by earth axes).
    `first` and `second` say which two each product is of, `rates` by how much a block's fades, in 1 / blocks.
    """

    equation: Equation
    columns: WhiteRows
    first: IntArray = field(repr=False)
    second: IntArray = field(repr=False)
    rates: FloatArray = field(repr=False)
    sums: FloatArray = field(repr=False)
    means: FloatArray = field(repr=False)
    mean_rates: FloatArray = field(repr=False)
    powers: FloatArray = field(repr=False)
    counts: FloatArray = field(repr=False)
    per_chunk: int  # cells
    regressors: int

    @property
    def cells(self) -> int:
        """How many there are."""
        return len(self.sums) - 1

    @property
    def fading(self) -> int:
        """The first product that fades; all behind it do."""
        return len(self.rates) - int(np.count_nonzero(self.rates))

    @property
    def without_signatures(self) -> Products:
        """The same of what is left and the regressors alone: what is asked once nothing more is searched."""
        known = 1 + self.regressors
        count, none = known * (known + 1) // 2, self.columns.own[:0]
        return replace(
            self,
            columns=replace(self.columns, own=none, bases=none, fading=none, times=()),
            first=self.first[:count],
            second=self.second[:count],
            rates=self.rates[:count],
            sums=self.sums[:, :count].copy(),
            means=self.means[:, :known].copy(),
            mean_rates=self.mean_rates[:known],
        )


def products_of(
    signatures: SignatureSet, equation: Equation, answers: tuple[WhiteRows, list[FloatArray]], beside: FloatArray
) -> Products:
    """Return the products of an equation; `beside` are further regressors, shape (blocks, ...), not yet whitened."""
    flight = signatures.flight
    columns, own = answers
    regressors = np.column_stack([equation.regressors, equation.whitened(beside)])
    per_chunk = rows_per_chunk(flight)
    forgotten = signatures.forgotten(equation.relation, equation.channel, equation.constants)
    fading = [
        _fading(equation, forgotten[:, at], flight, fades_s, per_chunk) for at, fades_s in enumerate(columns.times)
    ]
    known, count = 1 + regressors.shape[1], len(own)
    every = [equation.errors, *regressors.T, *own, *(column for each in fading for column in each.T)]
    first, second = _pairs(columns, known, count)
    rates = np.zeros(len(every))
    rates[known + count :] = np.repeat([-np.log(kept_a_block(flight, fades_s)) for fades_s in columns.times], 3)
    mean = by_chunks(equation.mean, CELL)
    sums, means = _of_cells(every, mean, first, second)
    return Products(
        equation=equation,
        columns=columns,
        first=first,
        second=second,
        rates=rates[first] + rates[second],
        sums=sums,
        means=means,
        mean_rates=rates,
        powers=running(np.square(mean).sum(axis=1)),
        counts=running(by_chunks(equation.known.astype(float), CELL).sum(axis=1)),
        per_chunk=per_chunk // CELL,
        regressors=regressors.shape[1],
    )


def _fading(equation: Equation, answers: FloatArray, flight: Flight, fades_s: float, per_chunk: int) -> FloatArray:
    """Return what fades, whitened, relative to the beginning of each block's chunk, shape (blocks, 3)."""
    factor = kept_a_block(flight, fades_s)
    since = np.arange(len(flight)) % per_chunk
    return equation.whitened_decay(answers, factor) * (factor**since)[:, np.newaxis]


def _pairs(columns: WhiteRows, known: int, count: int) -> tuple[IntArray, IntArray]:
    """Return which columns are multiplied: see `WindowSums.window` for the order."""
    signature = known + np.arange(count)
    fades = known + count + np.arange(3)
    # in this order, which `_split` takes apart: known with known (a triangle), signatures with known, with themselves,
    # with what they grow from, with what they forget; then what fades with known, and with itself: all behind it fades
    pairs: list[tuple[int, int]] = [(i, j) for i in range(known) for j in range(i, known)]
    pairs += [(int(s), j) for s in signature for j in range(known)]
    pairs += [(int(s), int(s)) for s in signature]
    pairs += [(known + at, known + int(columns.bases[at])) for at in columns.grown.tolist()]
    pairs += [(known + at, int(f + 3 * columns.fading[at])) for at in columns.faded.tolist() for f in fades]
    for time in range(len(columns.times)):
        pairs += [(int(f + 3 * time), j) for f in fades for j in range(known)]
    for time in range(len(columns.times)):
        pairs += [(int(fades[i] + 3 * time), int(fades[j] + 3 * time)) for i in range(3) for j in range(3)]
    first, second = np.array(pairs, dtype=np.int64).T
    return first, second


def _of_cells(
    columns: Sequence[FloatArray], mean: FloatArray, first: IntArray, second: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return running sums of products over cells, and of columns times the mean's."""
    sums, means = np.zeros((len(mean) + 1, len(first))), np.zeros((len(mean) + 1, len(columns)))
    picked = first * len(columns) + second
    for begin in range(0, len(mean), _AT_ONCE):
        rows = slice(begin * CELL, (begin + _AT_ONCE) * CELL)
        part = by_chunks(np.column_stack([column[rows] for column in columns]), CELL)
        end = begin + len(part)
        turned = np.ascontiguousarray(part.transpose(0, 2, 1))
        every = turned @ part  # all are eight times as many as are kept, and a twelfth of the work of picking before
        sums[begin + 1 : end + 1] = every.reshape(len(part), -1).take(picked, axis=1)
        means[begin + 1 : end + 1] = (turned @ mean[begin:end, :, np.newaxis])[..., 0]
    np.cumsum(sums, axis=0, out=sums)
    np.cumsum(means, axis=0, out=means)
    return sums, means


@dataclass(frozen=True, kw_only=True, eq=False)
class Window:
    """An equation's sums over windows, for signatures that begin at an onset; the first axis is that of windows."""

    errors: FloatArray  # shape (windows,): e'e
    products: FloatArray  # shape (windows, regressors): X'e
    squares: FloatArray  # shape (windows, regressors, regressors): X'X
    cross: FloatArray  # shape (windows, signatures): s'e
    mixed: FloatArray  # shape (windows, signatures, regressors): s'X
    power: FloatArray  # shape (windows, signatures): s's
    counts: FloatArray  # shape (windows,): known blocks


class WindowSums:
    """Sums of an equation's products over windows, the mean of each chunk marginalised.

    `wander`: by how much means of chunks wander; the equation's own by default, 0 for not at all.
    """

    def __init__(self, products: Products, wander: float | None = None) -> None:
        self.products = products
        wander = products.equation.wander if wander is None else wander
        self._precision = np.inf if wander <= 0.0 else wander**-2.0
        self.cells = products.cells
        self._sums_from: dict[int | None, tuple[int, FloatArray]] = {}  # by how many products: from a chunk on

    @cached_property
    def _rates(self) -> tuple[FloatArray, IntArray]:
        """The few rates by which products fade, and which is each one's of those that do."""
        rates, each = np.unique(self.products.rates[self.products.fading :], return_inverse=True)
        return rates, each

    def _whole(self, first: int, stop: int, count: int | None) -> tuple[FloatArray, int]:
        """Return sums from each chunk up to the last that was asked for, and which chunk is the first of them.

        What fades is relative to a chunk's beginning. Shape (chunks + 1, products). A search asks for one window of
        hours: the chunks between are summed up, and some beside, for windows that are moved a bit.
        """
        begin, found = self._sums_from.get(count, (first, None))
        end = begin if found is None else begin + len(found) - 1
        if found is not None and begin <= first and stop <= end:
            return found, begin
        most = -(-self.cells // self.products.per_chunk)
        begin, end = max(min(begin, first - _BESIDE), 0), min(max(end, stop + _BESIDE), most)
        edges = np.minimum(np.arange(begin, end + 1) * self.products.per_chunk, self.cells)
        found = np.zeros((len(edges), len(self.products.rates[:count])))
        for part in pieces(len(edges) - 1, _AT_ONCE):
            found[part] = self._piece(edges[part], edges[part.start + 1 : part.stop + 1], count)
        # S(c) = sum(c) + S(c + 1); of what fades S(c) = sum(c) + exp(-rate) S(c + 1)
        fading = self.products.fading
        np.cumsum(found[::-1, :fading], axis=0, out=found[::-1, :fading])
        if found.shape[1] > fading:
            kept = np.exp(-self.products.rates[fading:] * self.products.per_chunk * CELL)
            for at in range(len(found) - 2, -1, -1):
                found[at, fading:] += kept * found[at + 1, fading:]
        self._sums_from[count] = begin, found
        return found, begin

    def _piece(self, first: IntArray, last: IntArray, count: int | None = None) -> FloatArray:
        """Return sums over cells within one chunk each, what fades relative to the chunk's beginning.

        `count`: of the first products alone: those of what is left and the regressors.
        """
        # sum of a b over the cells, as a difference of running sums
        raw = self.products.sums[last, :count]
        raw -= self.products.sums[first, :count]
        if np.isinf(self._precision):
            return raw
        columns = None if count is None else 1 + self.products.regressors
        # the mean mu of a chunk wanders by N(0, w^2): integrated out, it takes (sum a m)(sum b m) / (sum m^2 + w^-2), m
        # what a constant looks like behind the whitening
        mean = self.products.means[last, :columns] - self.products.means[first, :columns]
        power = self.products.powers[last] - self.products.powers[first] + self._precision
        of_mean = (mean / power[:, np.newaxis]).take(self.products.first[:count], axis=1)
        of_mean *= mean.take(self.products.second[:count], axis=1)
        raw -= of_mean
        return raw

    def between(self, first: IntArray, last: IntArray, count: int | None = None) -> FloatArray:
        """Return sums over cells [first, last), what fades relative to the first; shape (windows, products).

        `count` asks for the first products alone.
        """
        # [first, last) is what it cuts of its first chunk, whole chunks, and what it cuts of its last
        width = self.products.per_chunk
        chunk, behind = (first // width) * width, (last // width) * width
        begin = np.minimum(chunk + width, self.cells)
        found = self._fade(self._piece(first, np.minimum(begin, last), count), chunk - first)
        # what fades is kept relative to the beginning of its own chunk: each part is brought to `first`
        cut = np.flatnonzero((behind > chunk) & (last > behind))
        if len(cut):
            found[cut] += self._fade(self._piece(behind[cut], last[cut], count), (behind - first)[cut])
        # S(at) - S(to), sums from a chunk to the end: of what fades, the second has faded for as long as lies between
        between = behind > begin
        if between.any():
            at, to = (begin // width)[between], (behind // width)[between]
            since = first[between]
            whole, own = self._whole(int(at.min()), int(to.max()), count)
            found[between] += self._fade(whole[at - own], begin[between] - since)
            found[between] -= self._fade(whole[to - own], behind[between] - since)
        return found

    def _fade(self, sums: FloatArray, cells: IntArray) -> FloatArray:
        """Return sums with what fades as it is after some cells, in place; shape (windows, products)."""
        fading = self.products.fading
        if sums.shape[1] > fading:
            rates, each = self._rates
            sums[:, fading:] *= np.exp(-np.multiply.outer(cells * CELL, rates)).take(each, axis=1)
        return sums

    def window(self, onset: IntArray, first: IntArray, last: IntArray) -> Window:
        """Return the sums over cells [first, last) for signatures that begin at `onset`, at or before `first`."""
        own, columns = self.products, self.products.columns
        # s(t; a) = b(t) - g(a) b_0(t) - sum_j k_j(a) d_j(t) exp(-(t - a) / tau): every product with s is one of these
        # terms
        sums, since = _split(self.between(first, last), own), columns.since(onset)
        with_known, power, grown, faded = sums.with_known, sums.power, columns.grown, columns.faded
        base, times = columns.bases[grown], since[:, grown]
        # what grows from its onset: (b - g b_0)'x, and its square b'b - 2 g b'b_0 + g^2 b_0'b_0
        of_base = times[:, :, np.newaxis] * with_known[:, base]
        power[:, grown] += times * (times * power[:, base] - 2.0 * sums.with_base)
        with_known[:, grown] -= of_base
        if len(faded):
            time, base = columns.fading[faded], np.where(columns.bases >= 0, columns.bases, np.arange(len(columns.own)))
            rate = own.mean_rates[1 + own.regressors + len(columns.own) + 3 * time]
            # k(a): how far the attitude would have been off at the onset had the fault begun with the log; what it
            # grows from takes its own part of that, and until `first` it has faded
            states = columns.states(onset)
            states = states[:, faded] - since[:, faded, np.newaxis] * states[:, base[faded]]
            states *= np.exp(-np.multiply.outer((first - onset) * CELL, rate))[:, :, np.newaxis]
            with_fading = sums.with_fading
            with_fading = (
                with_fading - since[:, faded, np.newaxis] * with_fading[:, np.searchsorted(faded, base[faded])]
            )
            # the same for what is forgotten: - k'd'x, and - 2 k'd'(b - g b_0) + k'd'd k
            with_known[:, faded] -= np.einsum("wsj,wsjk->wsk", states, sums.fading_known[:, time])
            forgotten = np.einsum("wsi,wsij->wsj", states, sums.fading[:, time]) - 2.0 * with_fading
            power[:, faded] += np.vecdot(states, forgotten)
        return Window(
            errors=sums.known[:, 0, 0],
            products=sums.known[:, 0, 1:],
            squares=sums.known[:, 1:, 1:],
            cross=with_known[:, :, 0],
            mixed=with_known[:, :, 1:],
            power=np.maximum(power, 0.0),
            counts=self.known_blocks(first, last),
        )

    def known(self, first: IntArray, last: IntArray) -> FloatArray:
        """Return the sums over cells [first, last) of what is left and the regressors; they don't fade."""
        count = 1 + self.products.regressors
        return _symmetric(self.between(first, last, count * (count + 1) // 2), count)

    def chunk_means(self, first: IntArray, last: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return sums of columns times the mean's, and the mean's squares, over cells that lie in one chunk each."""
        return self.products.means[last] - self.products.means[first], self.products.powers[
            last
        ] - self.products.powers[first]

    def signature_means(self, onset: int, edges: IntArray, signature: int) -> FloatArray:
        """Return the same of a signature that begins at `onset`, over cells from each edge to the next.

        `edges`, shape (pieces + 1,): each piece lies in one chunk. `signature`: which of the equation's.
        """
        own, columns = self.products, self.products.columns
        known = 1 + own.regressors
        means = self.products.means[edges[1:]] - self.products.means[edges[:-1]]
        at = np.array([onset])
        base, since, states = int(columns.bases[signature]), columns.since(at)[0, signature], columns.states(at)[0]
        # (b - g b_0)'m of each piece; then less k'd'm, d as faded from the onset to the piece's chunk
        found = means[:, known + signature] - (since * means[:, known + base] if base >= 0 else 0.0)
        time = int(columns.fading[signature])
        if time >= 0:
            state = states[signature] - (since * states[base] if base >= 0 else 0.0)
            first = known + len(columns.own) + 3 * time
            chunk = (edges[:-1] // own.per_chunk) * own.per_chunk
            faded = np.exp(-(chunk - onset) * CELL * own.mean_rates[first])
            found = found - faded * (means[:, first : first + 3] @ state)
        return np.asarray(found)

    def known_blocks(self, first: IntArray, last: IntArray) -> FloatArray:
        """Return how many blocks of cells [first, last) are known."""
        return np.asarray(self.products.counts[last] - self.products.counts[first])


def running(values: FloatArray) -> FloatArray:
    """Return running sums over the first axis, from nothing on."""
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Split:
    """Sums by what they are of."""

    known: FloatArray
    with_known: FloatArray
    power: FloatArray
    with_base: FloatArray
    with_fading: FloatArray
    fading_known: FloatArray
    fading: FloatArray


def _split(sums: FloatArray, own: Products) -> _Split:
    """Return sums of products by what they are of, in the order of `_pairs`."""
    known, count, times, windows = 1 + own.regressors, len(own.columns.own), len(own.columns.times), len(sums)
    grown, faded = len(own.columns.grown), 3 * len(own.columns.faded)
    lengths = [known * (known + 1) // 2, count * known, count, grown, faded, times * 3 * known, times * 9]
    parts = np.split(sums, np.cumsum(lengths)[:-1], axis=1)
    return _Split(
        known=_symmetric(parts[0], known),
        with_known=parts[1].reshape(windows, count, known),
        power=parts[2],
        with_base=parts[3],
        with_fading=parts[4].reshape(windows, -1, 3),
        fading_known=parts[5].reshape(windows, times, 3, known),
        fading=parts[6].reshape(windows, times, 3, 3),
    )


def _symmetric(sums: FloatArray, count: int) -> FloatArray:
    found = np.empty((len(sums), count, count))
    rows, columns = np.triu_indices(count)
    found[:, rows, columns] = sums
    found[:, columns, rows] = sums
    return found
