"""The noise of a residual, learnt where it is watched: its level, its colour, its tail, and how steady it is.

Calibration gives a whitening filter for the sensors that it has seen. The sensors of a record may be quieter, louder or
otherwise coloured, and none of that is a fault. So behind that filter stands a second, short one, fitted to the record
itself: to its first seven seconds, and from then on to the last twenty, half a second old. Four things are learnt:

- level and colour: an autoregressive model of what the calibrated filter leaves, by Yule-Walker equations;
- the tail: samples are clipped where they are rarer than Gaussian ones would be, so that no window's mean is one
  outlier's; where the tail is heavy, what follows a gross outlier within a quarter of a second is its echo;
- how steady that is: sigma^2, the variance of the logarithm of the noise's power beyond chance, from products of the
  powers of neighbouring blocks, which chance leaves at 0. Noise that wanders widens what is normal;
- how slow it is: the variance of means that no averaging takes away, which a short filter can't whiten, from means over
  half a second to eight.

Nothing is learnt while something is suspected: from where a window departs from what was learnt, the filter is held,
and the blocks of that window are taken out of what was learnt, until two seconds look healthy again.
"""

from __future__ import annotations

import copy
import math
import statistics
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from gtmbench.detectors.statistics.noise_model import (
    CLIPPED,
    CLIPS,
    COUNT,
    FAST,
    FIRST,
    FOURTH,
    FOURTHS,
    LAGS,
    LATE,
    LEAST,
    LOW,
    MEANS,
    MEMORY,
    NEIGHBOURS,
    SIZE,
    SLOW,
    SQUARED_MEANS,
    SQUARES,
    SUB,
    SUM,
    Ends,
    LearntBlocks,
    LearntNoiseModel,
)
from gtmbench.detectors.statistics.statistic import Steadiness, glr, ordinary_powers
from gtmbench.detectors.statistics.whitening import LOUD, White, Whitener, loud_in
from gtmbench.values.record import BoolArray, FloatArray

IntArray = np.ndarray[tuple[int], np.dtype[np.int_]]

# blocks: the filter changes from one to the next
BLOCK_S = 0.5
_FEWEST_ROWS = 5  # of one
_LEAST_THERE = 0.5  # of its rows
_GAP = 1  # blocks that are too young to be learnt: faults change them, too
_AT_ONCE = (16, 128)  # blocks that are whitened together: after a change of state, which comes again soon, and at most
_KEPT = MEMORY + LATE + _GAP + 16  # blocks: with those that a suspicion may take out
_MOST_POWER, _MOST_SUM = 4.0, 6.0  # that a block, or a part of one, counts for
_ORDER_S, _ORDERS = 0.08, (2, 16)  # of the second filter: as long as a sensor's own lag, in these bounds

# outliers: what is rare and large in a heavy tail is the sensor's, what lasts is a fault's
_HEAVY, _GROSS = 3.5, 8.0  # the clip below which the tail is heavy; deviations of a gross outlier
_LOUDEST = 5.0  # deviations that one counts for where the tail is Gaussian, so that it isn't noise
_ECHO_S, _APART_S, _OF_ECHO = 0.25, 1.0, 1.0  # of operators and filters; until the next; deviations it may count for
_MEDIAN = 0.6745  # deviations: half of a normal noise's samples are smaller
_LASTING_S, _OF_LASTING = 0.5, 1.5  # what is as loud for longer is no outlier: it counts as so often its median does

# suspicions: a window that departs by so many nats stops the learning; white noise does so once in exp(12) looks
_SUSPECTED = 12.0  # of the shortest window; longer ones look at new noise more rarely
_SUSPECTED_S = (0.08, 0.32, 1.28, 5.12)  # each four times the one before: a change is seen within four times its length
_CALM, _LONGEST = 4, 240  # blocks: healthy ones that end a suspicion; after as many what is there is the noise


class NoiseFollower:
    """A residual's noise as its rows come in: the same in whatever chunks, with a memory that doesn't grow.

    `whitener`: of the calibration. `row`: the first that it will be given. `before`, shape (rows,): of the residual,
    rows just before that one.

    >>> calibrated = Whitener(coefficients=np.ones(1), mean=0.0, deviation=1.0)
    >>> follower = NoiseFollower(calibrated, 0.01)
    >>> quiet = 0.3 * np.random.default_rng(1).standard_normal(4000)
    >>> white = follower.push(quiet)
    >>> bool(abs(np.nanstd(white.values) - 1.0) < 0.05), round(follower.level, 1)
    (True, 0.3)
    """

    def __init__(
        self, whitener: Whitener, sample_period_s: float, *, row: int = 0, before: FloatArray | None = None
    ) -> None:
        self._calibrated = whitener
        self._block = max(round(BLOCK_S / sample_period_s), _FEWEST_ROWS)
        self._order = second_order(sample_period_s)
        self._echo, self._apart = (max(round(span_s / sample_period_s), 1) for span_s in (_ECHO_S, _APART_S))
        self.outliers: int = 0  # gross ones so far
        self._outlier = -self._apart  # row of the last gross one, about the open block's first
        self._lasting = lasting_rows(sample_period_s)
        self._loud = np.zeros(self._lasting - 1)  # sizes before the open block, as they are
        self._windows = suspicion_rows(sample_period_s)
        self._typical = 0.0
        self._ring = np.zeros((0, LAGS.start + self._order + 1))  # blocks that were learnt, the newest last
        self._held: LearntNoiseModel | None = None
        self._calm = self._held_for = 0
        self.first_level: float = math.nan  # as `level`, when it was first learnt
        self._given = np.full((self.order, 2), np.nan)  # raw and spread: rows before the open block, and its own
        if before is not None and len(before):
            known = before[-self.order :]
            self._given[self.order - len(known) :] = np.column_stack([known, np.ones(len(known))])
        self._told = 0  # rows of the open block that were returned
        self._at_once = _AT_ONCE[0]
        self.row: int = row  # the next that will be returned
        self.first_rows: list[range] = []  # rows that were returned late: the noise was learnt on them
        self._ends = Ends.nothing(self._order)
        self._white = np.zeros(self._windows[-1])  # the last before the open block
        self._open: LearntBlocks | None = None  # of the open block
        self._past: list[
            tuple[int, LearntNoiseModel, float]
        ] = []  # of the blocks before: first rows, and the mean that was known

    @property
    def order(self) -> int:
        """How many rows before one its whitened residual looks back at."""
        return self._calibrated.order + self._order

    @property
    def is_learnt(self) -> bool:
        """Whether the first seconds are over."""
        return len(self._ring) > 0

    @property
    def is_held(self) -> bool:
        """Whether something is suspected, so that nothing is learnt."""
        return self._held is not None

    @property
    def level(self) -> float:
        """The deviation of the noise over that of the calibration; NaN until it is learnt."""
        return float(self._current().local[0]) if self.is_learnt else math.nan

    @property
    def whitener(self) -> Whitener:
        """What the next row is whitened by, as one filter; the calibrated one until that is learnt."""
        return self._as_one(self._current(), 0, self._calibrated.mean) if self.is_learnt else self._calibrated

    def whitener_at(self, row: int) -> Whitener:
        """Return what a row was whitened by; of those that `drop_before` hasn't dropped."""
        for first, model, mean in self._past:
            if first <= row < first + len(model.clip) * self._block:
                return self._as_one(model, (row - first) // self._block, mean)
        return self.whitener

    def copy(self) -> NoiseFollower:
        """Return another that goes on from here; they share arrays, as neither changes one that it stands on."""
        other = copy.copy(self)
        other._open, other._past, other.first_rows = None, [*self._past], [*self.first_rows]
        return other

    def drop_before(self, row: int) -> None:
        """Forget what rows before one were whitened by."""
        self.first_rows = [rows for rows in self.first_rows if rows.stop > row]
        self._past = [part for part in self._past if part[0] + len(part[1].clip) * self._block > row]

    def _as_one(self, model: LearntNoiseModel, block: int, mean: float) -> Whitener:
        """Return the two filters as one, from the raw residual to what is white."""
        calibrated, taps, scale = self._calibrated, model.taps[block], float(model.scale[block])
        return Whitener(
            coefficients=np.convolve(calibrated.coefficients, taps / taps[0]),
            mean=mean,
            deviation=calibrated.deviation / (float(taps[0]) * scale),
            most=float(model.clip[block]) * scale,
            loudest=float(_loudest(model.clip[block])) * scale,
            unsteady=float(model.unsteady[block]),
            slow=float(model.slow[block]),
        )

    @property
    def rows_alike(self) -> int:
        """How many rows, the next first, are whitened alike; 0 while it learns."""
        return self._block - self._told if self.is_learnt else 0

    @property
    def sizes(self) -> FloatArray:
        """Of the last rows, whitened, before they were clipped."""
        model = self._current()
        x, spread = self._behind_calibrated(self._given), self._given[self.order :, 1]
        own = _filled(np.abs(self._second(x, model.taps) / spread)) if len(spread) else spread
        return np.concatenate([self._loud, own])[-self._lasting :] * float(model.scale[0])

    def push(self, raw: FloatArray, spread: FloatArray | None = None) -> White:
        """Return what the next rows make known: nothing while it learns, then all of these, then row for row.

        The last of them is the last row pushed, or there are none; `row` says which row is next.

        `raw`, shape (rows,): the residual; NaN where it is missing. `spread`, shape (rows,): how far it may be off for
        its operator's error: what is learnt is learnt from the residual over it.
        """
        off = np.ones(len(raw)) if spread is None else spread
        self._given = np.concatenate([self._given, np.column_stack([raw, off])])
        parts: list[White] = []
        while self.is_learnt or self._learn():
            blocks = (len(self._given) - self.order) // self._block
            if not blocks:
                parts.append(self._opened())
                self.row += len(parts[-1])
                break
            asked = min(blocks, self._at_once)
            white, done = self._advance(asked)
            self._at_once = min(2 * self._at_once, _AT_ONCE[1]) if done == asked else _AT_ONCE[0]
            parts.append(white.between(slice(self._told, done * self._block)))
            self.row += len(parts[-1])
            self._given, self._told = self._given[done * self._block :], 0
        return White.joined(parts)

    # ---- what the next rows are whitened by ----

    def _learn(self) -> bool:
        """Learn from the first blocks, once they are there; return whether they are."""
        block = self._block
        count = (len(self._given) - self.order) // block
        rows = self._given[self.order : self.order + count * block, 0]
        there = np.flatnonzero(np.isfinite(rows).reshape(count, block).mean(axis=1) >= _LEAST_THERE)
        if len(there) < FIRST:
            return False
        stop = (int(there[FIRST - 1]) + 1) * block
        first = rows[:stop][np.isfinite(rows[:stop])]
        middle = float(np.median(first))
        most = 6.0 * float(np.median(np.abs(first - middle))) + 1e-300
        mean = float(np.mean(np.clip(first, middle - most, middle + most)))
        self._calibrated = replace(self._calibrated, mean=mean)
        self._ends = Ends.nothing(self._order)
        given = self._given[: self.order + stop]
        x, spread = self._behind_calibrated(given), given[self.order :, 1]
        self._typical = max(1.4826 * float(np.nanmedian(np.abs(x[self._order :] / spread))), LEAST)
        blocks = stop // block
        learnt = LearntBlocks(np.zeros((0, self._ring.shape[1])), blocks, np.full(blocks, blocks), block)
        self._measure(learnt, x, spread)
        self._ring = learnt.new[there[:FIRST]]
        if math.isnan(self.first_level):
            self.first_level = self.level
        self.first_rows.append(range(self.row, self.row + stop))  # no block is open
        return True

    def _current(self) -> LearntNoiseModel:
        """Return what the open block is whitened by."""
        if self._held is not None:
            return self._held
        if self._open is None:
            self._open = self._learnt(1)
        return self._open.model

    def _learnt(self, blocks: int) -> LearntBlocks:
        """Return what the next blocks will have learnt from those before each."""
        end = np.maximum(len(self._ring) + np.arange(blocks) - _GAP, 1)
        return LearntBlocks(self._ring, blocks, end, self._block)

    # ---- what blocks tell: each step stands on those before ----

    def _measure(
        self, learnt: LearntBlocks, x: FloatArray, spread: FloatArray
    ) -> tuple[tuple[FloatArray, IntArray, FloatArray], Ends]:
        """Take all that blocks tell; return them as `_whitened` does, and what the next blocks look back at."""
        self._measure_sizes(learnt.new, x, spread)
        clipped = self._measure_colour(learnt.new, x, spread, learnt.local)
        self._measure_tail(learnt.new, x, spread, learnt.taps)
        white = self._whitened(x, spread, learnt.taps, *learnt.tail[:2])
        return white, Ends(clipped, *self._measure_steadiness(learnt.new, white[0]))

    def _measure_sizes(self, table: FloatArray, x: FloatArray, spread: FloatArray) -> None:
        own = x[self._order :] / spread
        table[:, COUNT] = np.isfinite(own).reshape(len(table), -1).sum(axis=1)
        sizes = np.minimum(np.abs(own), 30.0 * self._typical)
        table[:, SIZE] = _filled(sizes).reshape(len(table), -1).sum(axis=1)

    def _measure_colour(self, table: FloatArray, x: FloatArray, spread: FloatArray, local: FloatArray) -> FloatArray:
        """Take products of samples some lags apart; return the clipped samples that the next rows' lags reach."""
        most = np.repeat(CLIPS[-1] * local, self._block)
        own = _within(_filled(x[self._order :] / spread), most)
        joined = np.concatenate([self._ends.clipped, own])
        for lag in range(self._order + 1):
            products = own * joined[self._order - lag : len(joined) - lag]
            table[:, LAGS.start + lag] = products.reshape(len(table), -1).sum(axis=1)
        return joined[len(joined) - self._order :]

    def _measure_tail(self, table: FloatArray, x: FloatArray, spread: FloatArray, taps: FloatArray) -> None:
        own = _filled(self._second(x, taps) / spread)
        for i, most in enumerate(CLIPS.tolist()):
            squares = np.square(_within(own, most))
            table[:, CLIPPED.start + i] = squares.reshape(len(table), -1).sum(axis=1)
        table[:, FOURTH] = np.square(squares).reshape(len(table), -1).sum(axis=1)

    def _measure_steadiness(self, table: FloatArray, z: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """Take means, and products of the powers of neighbouring blocks, and of their parts, each less 1.

        Return the last of these powers, and of the blocks' sums.
        """
        there = _filled(z)
        table[:, SUM] = there.reshape(len(table), -1).sum(axis=1)
        sums_before = self._measure_means(table)
        powers, bursts, sums = self._powers_of(there)
        table[:, SQUARES], table[:, FOURTHS] = (np.power(sums, power).mean(axis=1) for power in (2, 4))
        both, lags = np.concatenate([self._ends.powers, powers]), NEIGHBOURS
        before = sum(both[lags - lag : len(both) - lag] for lag in range(1, lags + 1)) / lags
        table[:, [SLOW, LOW]] = both[lags:] * before
        parts = np.concatenate([[self._ends.burst], bursts.ravel()])
        table[:, FAST] = (parts[1:] * parts[:-1]).reshape(bursts.shape).mean(axis=1)
        return both[-lags:], float(parts[-1]), sums_before

    def _measure_means(self, table: FloatArray) -> FloatArray:
        """Take squares of sums over some blocks, over their rows; return the last blocks' sums."""
        own = np.concatenate([self._ends.sums, table[:, SUM]])
        sums = np.concatenate([[0.0], np.cumsum(own)])
        stop = np.arange(len(self._ends.sums), len(own)) + 1
        for i, length in enumerate(MEANS):
            table[:, SQUARED_MEANS.start + i] = np.square(sums[stop] - sums[stop - length]) / (length * self._block)
        return own[-len(self._ends.sums) :]

    def _powers_of(self, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return powers less 1: of blocks, that of samples and that of short sums; of their parts; and these sums.

        A block a row.
        """
        blocks = z.reshape(-1, self._block)
        parts = blocks[:, : self._block // SUB * SUB].reshape(len(blocks), SUB, -1)
        sums = _within(parts.sum(axis=2) / math.sqrt(parts.shape[2]), _MOST_SUM)
        powers = np.column_stack([np.square(blocks).mean(axis=1), np.square(sums).mean(axis=1)])
        bursts = np.square(parts).mean(axis=2)
        return np.minimum(powers, _MOST_POWER) - 1.0, np.minimum(bursts, _MOST_POWER) - 1.0, sums

    def _behind_calibrated(self, given: FloatArray) -> FloatArray:
        """Return what the calibrated filter leaves of rows, and of `_order` before them."""
        return self._calibrated.whiten(given[:, 0])[self._calibrated.order :]

    def _second(self, x: FloatArray, taps: FloatArray) -> FloatArray:
        """Return rows behind both filters; of the second one a row a block, or one for all."""
        windows = np.lib.stride_tricks.sliding_window_view(x, self._order + 1)[:, ::-1]
        blocks = windows.reshape(len(taps), -1, self._order + 1)
        return np.asarray((blocks @ taps[:, :, np.newaxis]).ravel())

    def _whitened(
        self, x: FloatArray, spread: FloatArray, taps: FloatArray, clips: FloatArray, scales: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return rows over their spread, clipped and of variance 1, where gross outliers are, and all rows' sizes."""
        z = self._second(x, taps) / spread
        clip, scale = (np.repeat(of, len(z) // len(of)) for of in (clips, scales))
        sizes = np.concatenate([self._loud, _filled(np.abs(z))])
        own = sizes[len(self._loud) :]
        gross = np.flatnonzero((own > _GROSS) & (clip < _HEAVY))
        clip = np.where(own > _GROSS, _loudest(clip), clip)
        outliers, last = [], self._outlier
        while len(gross := gross[np.searchsorted(gross, last + self._apart) :]):
            last = int(gross[0])
            outliers.append(last)
        for row in (self._outlier, *outliers):
            clip[max(row + 1, 0) : max(row + 1 + self._echo, 0)] = _OF_ECHO
        beyond = np.flatnonzero(own > clip)
        if len(beyond):
            before = np.lib.stride_tricks.sliding_window_view(sizes, self._lasting)[beyond]
            clip[beyond] = np.maximum(clip[beyond], _OF_LASTING * np.median(before, axis=1))
        return _within(z, clip) * scale, np.array(outliers, dtype=int), own

    def _loud_in(self, sizes: FloatArray, scale: FloatArray) -> FloatArray:
        """Return 1 of rows that are loud by themselves, by their sizes before they were clipped."""
        loud = loud_in(sizes * scale)
        rows = np.flatnonzero(loud)
        if len(rows):
            around = np.lib.stride_tricks.sliding_window_view(np.concatenate([self._loud, sizes]), self._lasting)[rows]
            loud[rows] = sizes[rows] * scale[rows] > loudness(np.median(around, axis=1) * scale[rows])
        return loud

    # ---- rows ----

    def _opened(self) -> White:
        """Return the rows of the open block that haven't been returned."""
        rows = len(self._given) - self.order
        told, self._told = self._told, rows
        if told == rows:
            return White.joined([])
        model, spread = self._current(), self._given[self.order :, 1]
        z, _, sizes = self._whitened(self._behind_calibrated(self._given), spread, model.taps, model.clip, model.scale)
        unsteady, slow = (np.full(rows - told, of[0]) for of in (model.unsteady, model.slow))
        loud = self._loud_in(sizes, np.full(rows, model.scale[0]))[told:]
        return White(values=(z * spread)[told:], unsteady=unsteady, slow=slow, loud=loud)

    def _advance(self, blocks: int) -> tuple[White, int]:
        """Whiten complete blocks and learn from them; return them, and how many are done: up to a change of state.

        A block that misses half of its rows, which isn't learnt from, is the last one.
        """
        # x: behind the calibrated filter, each block with the rows before it that the second filter looks back at
        given = self._given[: self.order + blocks * self._block]
        x = self._behind_calibrated(given)
        there = np.isfinite(x[self._order :]).reshape(blocks, -1).mean(axis=1) >= _LEAST_THERE
        if not there.all():
            blocks = int(np.argmin(there)) + 1
            given, x = given[: self.order + blocks * self._block], x[: self._order + blocks * self._block]
        spread = given[self.order :, 1]
        learnt = self._open if blocks == 1 and self._open is not None else self._learnt(blocks)
        ends = self._ends
        # z: behind the second filter too, of deviation 1; while something is suspected, by the filter of before
        if self._held is None:
            (z, outliers, sizes), ends = self._measure(learnt, x, spread)
            model = learnt.model
        else:
            model = self._held.repeated(blocks)
            z, outliers, sizes = self._whitened(x, spread, model.taps, model.clip, model.scale)
        # may these blocks be learnt? Only as far as no window departs from what was learnt before them
        joined = np.concatenate([self._white, _filled(z)])
        suspected = self._suspected(joined, model)
        if self._held is not None:
            done = self._wait(suspected > 0)
        elif suspected.any():
            done = int(np.argmax(suspected > 0)) + 1
            self._suspect(learnt.new[:done], -(-int(suspected[done - 1]) // self._block))
        else:
            done, self._ends = blocks, ends
            self._remember(learnt.new)
        rows = done * self._block
        loud = self._loud_in(sizes, np.repeat(model.scale, self._block))
        self._white = joined[rows : rows + len(self._white)]
        self._loud = np.concatenate([self._loud, sizes[:rows]])[rows:]
        outliers = outliers[outliers < rows]
        self.outliers += len(outliers)
        self._outlier = int(outliers[-1] if len(outliers) else self._outlier) - rows
        self._open = None
        self._past.append((self.row - self._told, model.first(done), self._calibrated.mean))
        unsteady, slow = (np.repeat(of, self._block) for of in (model.unsteady, model.slow))
        return White(values=z * spread, unsteady=unsteady, slow=slow, loud=loud), done

    def _remember(self, table: FloatArray) -> None:
        """Add blocks to what was learnt; those that miss half of their rows tell nothing."""
        there = table[:, COUNT] >= _LEAST_THERE * self._block
        self._ring = np.concatenate([self._ring, table[there]])[-_KEPT:]

    def _suspected(self, joined: FloatArray, model: LearntNoiseModel) -> IntArray:
        """Return of each block the rows of the longest window that departs from what was learnt; 0 where none does.

        Rows before the blocks come first.
        """
        sums, squares = (np.concatenate([[0.0], np.cumsum(of)]) for of in (joined, joined * joined))
        first = len(self._white) + 1
        base, unsteady, slow = (np.repeat(of, self._block) for of in (model.base, model.unsteady, model.slow))
        reach = np.zeros(len(base), dtype=int)
        for rows in self._windows:
            least = _SUSPECTED - math.log(rows / self._windows[0])
            mean = (sums[first:] - sums[first - rows : len(sums) - rows]) / rows
            shift = mean - base
            power = (squares[first:] - squares[first - rows : len(sums) - rows]) / rows - (mean + shift) * base
            np.maximum(power, 1e-12, out=power)
            # steady noise would have to be as far off: nearly no row is, and logarithms are dear
            low, high = ordinary_powers(rows, least)
            some = np.flatnonzero((shift * shift > 2.0 * least / rows) | (power < low) | (power > high))
            if len(some):
                chance = 1.0 / rows + slow[some]
                nats = glr(shift[some], power[some], rows, chance, 0.0, 1.0, 1.0, Steadiness.of(unsteady[some]))
                reach[some[np.maximum(*nats) > least]] = rows
        return np.asarray(reach.reshape(-1, self._block).max(axis=1))

    def _suspect(self, table: FloatArray, back: int) -> None:
        """Hold what was learnt before something was there that is suspected: since `back` blocks before the last."""
        healthy = len(table) - 1 - back
        if healthy > 0:
            self._remember(table[:healthy])
        else:
            self._ring = self._ring[: max(len(self._ring) + healthy, min(len(self._ring), FIRST))]
        self._held = self._learnt(1).model
        self._calm = self._held_for = 0

    def _wait(self, suspected: BoolArray) -> int:
        """Wait until nothing is suspected any more, or for too long; return how many blocks that took."""
        for done, is_suspected in enumerate(suspected.tolist(), 1):
            self._calm = 0 if is_suspected else self._calm + 1
            self._held_for += 1
            if self._calm == _CALM:
                self._held, self._ends = None, Ends.nothing(self._order)
                return done
            if self._held_for == _LONGEST:
                self._reset()
                return done
        return len(suspected)

    def _reset(self) -> None:
        self._ring, self._held, self._open = self._ring[:0], None, None
        self._ends = Ends.nothing(self._order)


def _filled(values: FloatArray) -> FloatArray:
    """Return values, 0 where they are missing."""
    there = np.isfinite(values)
    return values if there.all() else np.where(there, values, 0.0)


def loudness(usual: FloatArray) -> FloatArray:
    """Return beyond how many deviations samples are loud whose neighbours' usual sizes are so much.

    >>> loudness(np.array([0.5, 1.349])).round(2).tolist()
    [4.0, 8.0]
    """
    return np.asarray(LOUD * np.maximum(usual / _MEDIAN, 1.0))


def _loudest(clip: FloatArray) -> FloatArray:
    """Return what a gross outlier counts for, by the clip of the noise that it is in."""
    return np.where(clip == CLIPS[-1], _LOUDEST, clip)


def _within(values: FloatArray, most: float | FloatArray) -> FloatArray:
    return np.asarray(np.minimum(np.maximum(values, -most), most))


def follower(whitener: Whitener, sample_period_s: float, before: FloatArray | None = None) -> NoiseFollower:
    """Return one for a record from its row 0 on, which has learnt on what was before, where that is long enough.

    `before`, shape (rows,): of the same sensors' healthy residual.
    """
    if before is not None:
        noise = NoiseFollower(whitener, sample_period_s, row=-len(before))
        noise.push(before)
        if noise.is_learnt:
            return noise
    return NoiseFollower(whitener, sample_period_s)


def followed(
    whitener: Whitener, residual: FloatArray, sample_period_s: float, spread: FloatArray | None = None
) -> White:
    """Return a whole record's residual whitened by the noise that is learnt on it; NaN where there is too little.

    Parameters are those of `NoiseFollower`, and of its `push`.
    """
    white = NoiseFollower(whitener, sample_period_s).push(residual, spread)
    return white if len(white) == len(residual) else White.steady(np.full(len(residual), np.nan))


def lasting_rows(sample_period_s: float) -> int:
    """Return over how many rows something has to be loud to be no outlier."""
    return max(round(_LASTING_S / sample_period_s), _FEWEST_ROWS)


def lasting(sizes: Iterable[float]) -> float:
    """Return what a row counts for at least, by the sizes of the last ones, its own among them.

    >>> lasting([1.0, 2.0, 9.0])
    3.0
    """
    return _OF_LASTING * statistics.median(sizes)


def suspicion_rows(sample_period_s: float) -> list[int]:
    """Return the lengths of the windows that suspicions are found in, in samples, the shortest first.

    >>> suspicion_rows(0.01)
    [8, 32, 128, 512]
    """
    return sorted({max(round(span_s / sample_period_s), 4) for span_s in _SUSPECTED_S})


def second_order(sample_period_s: float) -> int:
    """Return how many coefficients the filter has that is learnt on the record.

    >>> second_order(0.01), second_order(0.1)
    (8, 2)
    """
    return int(np.clip(round(_ORDER_S / sample_period_s), *_ORDERS))
