"""The relation of gyros and attitude over a whole log: y = b + A w + tau w' + e, an axis each.

The gyro reads y, the attitude turns at w (`blocks`). Offset b, directions and scales A, and a lag tau are the log's
own, found robustly over all of it; e is what chance and faults leave. Of e come three levels of each gyro, chunk by
chunk: its error, its gain, its noise (`levels`); and, of every angle, by how much it jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gtmbench.engine.blocks import Blocks
from gtmbench.engine.flight import MOST_DEG_S
from gtmbench.engine.hindsight.levels import CHUNK_S, ChunkLevel, deviation_of
from gtmbench.values.attitude_estimators import to_earth
from gtmbench.values.record import BoolArray, FloatArray, IntArray, Span, runs

_GAIN = 0.02  # by which scale and direction of gyro and attitude differ: an a priori standard deviation
_ROUNDS, _HUBER = 5, 2.0  # of the robust fit; deviations from which on a block counts less
_LIVELY_DEG_S = 1.5  # of turning: motion
# over which it is told how fast it turns; motion, of what the liveliest tenth has at least; as long it stands
_LIVELY_S, _OF_LIVELIEST, _STANDS_S = 2.0, 0.2, 20.0
_KNOWN = 0.5  # of a chunk's blocks
ERROR_FLOOR_DEG_S = 0.3  # smaller differences are installation, warming and wind
_GAIN_FLOOR, _NOISE_FLOOR = 0.1, 0.7  # of a gain; of the logarithm of a power: it doubles
_BINS, _FEWEST = 8, 12  # of chunks as lively, so many in each at least
# blocks over which an angle's jump is summed: between two samples it stands in two, or three; over the last it stays
_JUMPS = (3, 5, 20)
_LOCAL = 75  # blocks on either side, whose median is the error that isn't a jump
_JUMP_DEVIATIONS = 6.0  # of jumps as large as usual there
_HALF = 0.5  # of a share: what a quarter of a log knows it to be below
_SECOND = 10.0  # variance of second differences of an angle's noise, over that of the rates that it makes
_FELT = 0.5  # of an angle's turn, squared, by the gyros that are known


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """What is left of gyros and attitude, block by block."""

    blocks: Blocks
    # shape (blocks, 3): where each gyro's is asked to hold: nothing is missing, and nothing on that axis failed
    known: BoolArray = field(repr=False)
    # shape (blocks, 3): e, in deg/s, where nothing is missing, failed or not; NaN elsewhere
    error: FloatArray = field(repr=False)
    # offsets, gains, shape (3,): what each gyro reads more than the attitude turns over the whole log, in deg/s, and
    # how many times as far it turns; NaN where too little is known
    offsets: FloatArray
    gains: FloatArray

    @property
    def per_chunk(self) -> int:
        """How many blocks a chunk has."""
        return max(1, round(CHUNK_S / self.blocks.period_s))

    @property
    def chunk_s(self) -> float:
        """How long a chunk is."""
        return self.per_chunk * self.blocks.period_s

    def chunked(self, values: FloatArray) -> FloatArray:
        """Return values of blocks by chunks, shape (chunks, blocks, ...); the last chunk is filled with NaN."""
        own = self.per_chunk
        count = -(-len(values) // own)
        filled = np.full((count * own, *values.shape[1:]), np.nan)
        filled[: len(values)] = values
        return filled.reshape(count, own, *values.shape[1:])


def alignment_of(blocks: Blocks, failed_s: Sequence[Sequence[Span]] = ((), (), ())) -> Alignment:
    """Return the relation of a log's gyros and attitude.

    `failed_s`: where p or phi, q or theta, r or psi failed.

    >>> random = np.random.default_rng(1)
    >>> turns = 20.0 * random.standard_normal((500, 3))
    >>> read = 1.5 + 1.01 * turns + 0.1 * random.standard_normal((500, 3))
    >>> other = dict(euler_rates=turns, angles=0.0 * turns, rough=0.0 * turns, held_s=np.zeros((500, 6)))
    >>> found = alignment_of(Blocks(start_s=0.0, period_s=0.2, gyros=read, rates=turns, **other))
    >>> found.error.std(axis=0).round(1).tolist()
    [0.1, 0.1, 0.1]
    """
    regressors = _regressors(blocks)
    there = np.isfinite(blocks.gyros).all(axis=1) & np.isfinite(blocks.rates).all(axis=1)
    there &= ~_stands(blocks)
    known = np.column_stack([there & ~blocks.within(spans) for spans in failed_s])
    error = np.full(blocks.gyros.shape, np.nan)
    offsets, gains = np.full(3, np.nan), np.full(3, np.nan)
    for axis in range(3):
        own = blocks.gyros[:, axis] - blocks.rates[:, axis]
        columns = regressors[:, [*range(4), 4 + axis]]
        rows = known[:, axis] & np.isfinite(columns).all(axis=1)
        if np.count_nonzero(rows) > columns.shape[1]:
            theta = _fitted(own[rows], columns[rows])
            error[:, axis] = np.where(there, own - np.nan_to_num(columns) @ theta, np.nan)
            offsets[axis], gains[axis] = theta[0], 1.0 + theta[1 + axis]
    return Alignment(blocks=blocks, known=known, error=error, offsets=offsets, gains=gains)


def _stands(blocks: Blocks) -> BoolArray:
    """Tell in which blocks an aircraft stands that flies before or after: references wander off there.

    It turns by less than a fifth of what it does in its liveliest tenth, for a third of a minute at least.
    """
    turning = np.nan_to_num(np.linalg.norm(blocks.rates, axis=1))
    rows = max(min(round(_LIVELY_S / blocks.period_s), len(turning)), 1)
    mean = np.sqrt(np.convolve(np.square(np.minimum(turning, MOST_DEG_S)), np.ones(rows) / rows, "same"))
    moves = mean > max(_LIVELY_DEG_S, _OF_LIVELIEST * float(np.quantile(mean, 0.9)))
    stands = np.zeros(len(mean), dtype=bool)
    starts, ends = runs(~moves)
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        stands[start:end] = (end - start) * blocks.period_s >= _STANDS_S
    return stands if moves.any() else np.zeros(len(mean), dtype=bool)


def _regressors(blocks: Blocks) -> FloatArray:
    """Return 1, the three rates and their slopes, shape (blocks, 7)."""
    slopes = np.full(blocks.rates.shape, np.nan)
    slopes[1:-1] = (blocks.rates[2:] - blocks.rates[:-2]) / (2.0 * blocks.period_s)
    return np.column_stack([np.ones(len(blocks)), blocks.rates, slopes])


def of_euler_rates(blocks: Blocks, but_s: Sequence[Span] = ()) -> tuple[float, float]:
    """Return which share of what Euler rates and body rates differ by the gyros read, and its standard error.

    y - w = b + A w + s (u - w) + e of each gyro, where u are the rates of phi, theta and psi: s is 0 of gyros that read
    body rates and 1 of those that read Euler rates, whatever the noise; it is pooled over the three by its precision.
    An angle that jumps spoils body rates from there on: a quarter of the log that tells against these counts alone.

    `but_s`: what is left out.

    >>> random = np.random.default_rng(1)
    >>> body, euler = 20.0 * random.standard_normal((2, 500, 3))
    >>> other = dict(angles=0.0 * body, rough=0.0 * body, held_s=np.zeros((500, 6)))
    >>> read = euler + 5.0 * random.standard_normal((500, 3))
    >>> share, error = of_euler_rates(
    ...     Blocks(start_s=0.0, period_s=0.2, gyros=read, rates=body, euler_rates=euler, **other)
    ... )
    >>> abs(share - 1.0) < 0.05, error < 0.05
    (True, True)
    """
    there = np.isfinite(np.column_stack([blocks.gyros, blocks.rates, blocks.euler_rates])).all(axis=1)
    rows = np.flatnonzero(there & ~blocks.within(but_s))
    quarters = [_euler_share(blocks, quarter) for quarter in np.array_split(rows, 4)]
    against = [each for each in quarters if each[0] + 2.0 * each[1] < _HALF]
    return min(against, default=_euler_share(blocks, rows))


def _euler_share(blocks: Blocks, rows: IntArray) -> tuple[float, float]:
    """Return the share of some blocks, and its standard error."""
    shares, precisions = np.zeros(3), np.zeros(3)
    for axis in range(3 if len(rows) > _FEWEST else 0):
        apart = (blocks.euler_rates - blocks.rates)[rows, axis]
        columns = np.column_stack([np.ones(len(rows)), blocks.rates[rows]])
        read = (blocks.gyros - blocks.rates)[rows, axis]
        own, apart = (each - columns @ _fitted(each, columns) for each in (read, apart))
        power = float(np.square(apart).sum()) + 1e-12
        shares[axis] = float(own @ apart) / power
        left = own - shares[axis] * apart
        precisions[axis] = power / (deviation_of(left) ** 2 + 1e-12)
    if not precisions.sum() > 0.0:
        return 0.0, np.inf
    return float(shares @ precisions / precisions.sum()), float(1.0 / np.sqrt(precisions.sum()))


def _fitted(values: FloatArray, regressors: FloatArray) -> FloatArray:
    """Return parameters by Huber's weights, gains near 0 a priori."""
    weight: FloatArray = np.ones(len(values))
    theta, least = np.asarray(np.linalg.lstsq(regressors, values, rcond=None)[0]), np.inf
    chance = deviation_of(np.diff(values, 2)) / np.sqrt(_SECOND) if len(values) > 2 else 0.0
    for _ in range(_ROUNDS):
        left = values - regressors @ theta
        spread = max(deviation_of(left - np.median(left)), 1e-9)
        theta_before = theta
        least = min(least, spread)  # what the prior itself leaves is no noise: a turned sign would pass for it
        prior = np.diag([0.0, *[(max(least, chance) / _GAIN) ** 2] * 3, 1e-9][: len(theta)])
        weighted = regressors * weight[:, np.newaxis]
        theta = np.asarray(np.linalg.lstsq(weighted.T @ regressors + prior, weighted.T @ values, rcond=None)[0])
        left = values - regressors @ theta
        weight = np.asarray(np.minimum(1.0, _HUBER * spread / np.maximum(np.abs(left), 1e-12)))
        if np.allclose(theta, theta_before, atol=1e-6):
            break
    return theta


def error_level(alignment: Alignment, axis: int, known: BoolArray, wanders: float = 0.0) -> ChunkLevel:
    """Return a gyro's mean error by chunks, in deg/s, of the blocks that are known."""
    values = _means(alignment.chunked(np.where(known, alignment.error[:, axis], np.nan)))
    return ChunkLevel(
        values=values, deviations=_by_liveliness(values, _lively(alignment)), floor=ERROR_FLOOR_DEG_S, wanders=wanders
    )


def gain_level(alignment: Alignment, axis: int, known: BoolArray) -> ChunkLevel:
    """Return by how much a gyro's gain differs from the log's, by chunks: sum(e w) / sum(w w), both about means."""
    there = known & np.isfinite(alignment.error[:, axis])
    errors = alignment.chunked(np.where(there, alignment.error[:, axis], np.nan))
    turns = alignment.chunked(np.where(there, alignment.blocks.rates[:, axis], np.nan))
    own, moved = (np.nan_to_num(each - _means(each)[:, np.newaxis]) for each in (errors, turns))
    power = np.square(moved).sum(axis=1)
    enough = np.isfinite(_means(errors)) & (power > 0.0)
    values = np.where(enough, (own * moved).sum(axis=1) / np.maximum(power, 1e-12), np.nan)
    return ChunkLevel(values=values, deviations=1.0 / np.sqrt(np.maximum(power, 1e-12)), floor=_GAIN_FLOOR)


def noise_levels(alignment: Alignment, axis: int, known: BoolArray) -> tuple[ChunkLevel, ChunkLevel, ChunkLevel]:
    """Return the logarithm of a gyro's roughness by chunks, what it is more than that of the others, and theirs.

    What shakes the aircraft raises all of them; what silences the others raises the second alone.
    """
    there = alignment.known.copy()
    there[:, axis] = known
    rough = alignment.chunked(np.where(there, alignment.blocks.rough, np.nan))
    powers = np.stack([_means(rough[..., each]) for each in range(3)])
    logs = np.log(np.maximum(powers, 1e-9))
    usual = np.array([np.median(each[np.isfinite(each)]) if np.isfinite(each).any() else 0.0 for each in logs])
    others = _means(np.delete(logs - usual[:, np.newaxis], axis, axis=0).T)  # one that is missing makes no step
    alike = np.ones(len(others))
    own = ChunkLevel(values=logs[axis], deviations=alike, floor=_NOISE_FLOOR)
    beside = ChunkLevel(values=logs[axis] - others, deviations=alike, floor=_NOISE_FLOOR)
    return own, beside, ChunkLevel(values=others, deviations=alike, floor=_NOISE_FLOOR)


def noise_size(alignment: Alignment, axis: int, bounds: FloatArray) -> FloatArray:
    """Return the deviation of white noise that raises a gyro's roughness by some bounds of its logarithm."""
    powers = _means(alignment.chunked(np.where(alignment.known[:, axis], alignment.blocks.rough[:, axis], np.nan)))
    usual = np.nanmedian(powers) if np.isfinite(powers).any() else np.nan
    level = np.fmax(powers, usual)
    return np.asarray(np.sqrt(level * np.expm1(np.minimum(bounds, 50.0)) / 6.0))


class Jumps(NamedTuple):
    """By how much each angle may jump at every block, what is significant, and what stays, in deg, (blocks, 3)."""

    sizes: FloatArray
    significant: FloatArray
    stay: FloatArray


def jumps_deg(alignment: Alignment, known: BoolArray) -> Jumps:
    """Return by how much each angle may jump at every block.

    A jump of an angle turns the attitude by a rotation about that angle's axis a which no gyro reads. It stands in e of
    the blocks between two samples: a.e / a.a over the gyros that are known, times the block's length. It is summed over
    a few blocks, for what a lag leaves of a hard turn is taken back at once: it doesn't stay for seconds.

    `known`, shape (blocks, 3): whose errors tell: those of gyros that read right, but for a constant.
    """
    blocks, there = alignment.blocks, known & np.isfinite(alignment.error)
    error = np.where(there, alignment.error, np.nan)
    axes = _angle_axes(blocks.angles) * there[:, np.newaxis, :]
    felt = np.square(axes).sum(axis=2)
    turned = np.einsum("nij,nj->ni", axes, np.nan_to_num(error - _local(error))) * blocks.period_s
    turned = np.where(felt >= _FELT, turned / np.maximum(felt, _FELT), np.nan)
    lively = np.repeat(_lively(alignment), alignment.per_chunk)[: len(blocks)]
    most, significant, stay = (np.full(turned.shape, value) for value in (np.inf, np.inf, 0.0))
    for angle in range(3):
        stay[:, angle] = np.abs(_summed(turned[:, angle], _JUMPS[-1]))
    for window in _JUMPS:
        for angle in range(3):
            summed = _summed(turned[:, angle], window)
            usual = _JUMP_DEVIATIONS * _by_liveliness(summed, lively, differences=False)
            jump = np.abs(summed)
            smaller = jump + usual < most[:, angle] + significant[:, angle]
            smaller &= np.isfinite(jump + usual)
            most[smaller, angle], significant[smaller, angle] = jump[smaller], usual[smaller]
    return Jumps(sizes=most, significant=significant, stay=stay)


def _angle_axes(angles: FloatArray) -> FloatArray:
    """Return the body axes about which phi, theta and psi turn, shape (blocks, 3, 3)."""
    phi = np.radians(angles[:, 0])
    zero, one = np.zeros(len(angles)), np.ones(len(angles))
    of_phi, of_theta = np.stack([one, zero, zero], axis=1), np.stack([zero, np.cos(phi), -np.sin(phi)], axis=1)
    of_psi = to_earth(np.radians(angles).T)[2].T  # down
    return np.stack([of_phi, of_theta, of_psi], axis=1)


def _local(error: FloatArray) -> FloatArray:
    """Return running medians, by pieces of a quarter of a minute and the two beside each."""
    count = len(error)
    local = np.zeros(error.shape)
    for first in range(0, count, _LOCAL):
        about = error[max(first - _LOCAL, 0) : first + 2 * _LOCAL]
        there = np.isfinite(about).any(axis=0)
        local[first : first + _LOCAL, there] = np.nanmedian(about[:, there], axis=0)
    return local


def _summed(values: FloatArray, window: int) -> FloatArray:
    """Return sums over windows about each value; NaN where one is missing."""
    if window > len(values):
        return np.full(len(values), np.nan)
    half = window // 2
    sums = np.lib.stride_tricks.sliding_window_view(values, window).sum(axis=1)
    found = np.full(len(values), np.nan)
    found[half : half + len(sums)] = sums
    return found


def _means(chunks: FloatArray) -> FloatArray:
    """Return the mean of each row, such as a chunk; NaN where less than half of it is known."""
    there = np.isfinite(chunks)
    counts = there.sum(axis=1)
    sums = np.where(there, chunks, 0.0).sum(axis=1)
    return np.asarray(np.where(counts >= _KNOWN * chunks.shape[1], sums / np.maximum(counts, 1), np.nan))


def _lively(alignment: Alignment) -> FloatArray:
    """Return how fast the attitude turns in each chunk, in deg/s; 0 where that isn't known."""
    turns = np.linalg.norm(np.minimum(np.abs(alignment.blocks.rates), MOST_DEG_S), axis=1)
    return np.nan_to_num(np.sqrt(_means(np.square(alignment.chunked(turns)))))


def _by_liveliness(values: FloatArray, lively: FloatArray, *, differences: bool = True) -> FloatArray:
    """Return how much values scatter, of those that are about as lively; livelier ones scatter no less.

    By the differences of neighbours, which a fault parts but once; or by the values themselves.
    """
    scatter = np.full(len(values), np.nan)
    if differences:
        scatter[1:] = np.abs(np.diff(values)) / np.sqrt(2.0)
    else:
        scatter = np.abs(values)
    there = np.flatnonzero(np.isfinite(scatter))
    if not len(there):
        return np.ones(len(values))
    ordered = there[np.argsort(lively[there], kind="stable")]
    parts = np.array_split(ordered, max(1, min(_BINS, len(ordered) // _FEWEST)))
    sizes = np.maximum.accumulate([deviation_of(scatter[part]) for part in parts])
    edges = [float(lively[part[0]]) for part in parts[1:]]
    return np.maximum(sizes, 1e-6)[np.searchsorted(edges, lively, side="right")]
