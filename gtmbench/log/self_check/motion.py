"""What gyros and attitude say of the same rotation: their slow motion's covariances, from which every guess is scored.

The rates of a yaw-pitch-roll attitude are sums of six terms, and turning an angle's sign turns the signs of terms. So
the covariances of gyros and terms at all lags, taken once, score every sign, unit, swap and lag without the data.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from gtmbench.method.regression.equations import HALF, interpolated, slow
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.pieces import pieces, rows_of_piece
from gtmbench.values.record import BoolArray, FloatArray, Record

LONGEST_LAG_S = 1.0  # that sensors of one aircraft have
_FEWEST = 20  # rows of a piece
_AROUND_S, _USUAL = 2.0, 0.9  # of the rows that move
_AT_REST = 1e-3  # of the greatest mean square
_MOST_ROWS, _BLOCK = 9000, 900  # what is looked at: the blocks that move most
_FINE_S, _MOST_THINNED = 0.04, 8  # of a sample period: faster records are thinned, for slow motion needs no more


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """A stretch of a record: gyros and angles as they were read, row by row, in deg and deg/s; NaN where missing."""

    gyros: FloatArray
    angles: FloatArray
    period_s: float

    @cached_property
    def motion(self) -> float:
        """How much the gyros move: the sum of their variances."""
        there = self.gyros[np.isfinite(self.gyros).all(axis=1)]
        return float(there.var(axis=0).sum()) if len(there) else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Moments:
    """Second moments of slow motion over all pieces."""

    gyros: FloatArray  # mean squares of p, q, r, shape (3,)
    terms: FloatArray = field(repr=False)  # covariance of the six terms of the attitude's rates, shape (6, 6)
    cross: FloatArray = field(repr=False)  # covariance of a gyro now with a term `lags_s` later, shape (3, 6, lags)
    lags_s: FloatArray = field(repr=False)


def pieces_of(records: Iterable[Record]) -> list[Piece]:
    """Return the pieces of some records that move most, in time, thinned where samples come fast."""
    blocks = [block for record in records for block in _blocks(record)]
    by_motion = sorted(range(len(blocks)), key=lambda place: -blocks[place].motion)
    kept, rows = [], 0
    for place in by_motion:
        if rows < _MOST_ROWS:
            kept.append(place)
            rows += len(blocks[place].gyros)
    return [blocks[place] for place in sorted(kept)]


def _blocks(record: Record) -> list[Piece]:
    every = min(max(1, round(_FINE_S / record.sample_period_s)), _MOST_THINNED)
    gyros, angles = (_thinned(record, channels, every) for channels in (GYROS, ATTITUDE))
    whole = np.asarray(np.isfinite(gyros).all(axis=1) & np.isfinite(angles).all(axis=1), dtype=np.bool_)
    count = max(1, round(len(gyros) / _BLOCK))
    edges = np.linspace(0, len(gyros), count + 1).astype(int).tolist()
    period_s = record.sample_period_s * every
    return [
        Piece(gyros=gyros[first:last], angles=angles[first:last], period_s=period_s)
        for first, last in pairwise(edges)
        if np.count_nonzero(whole[first:last]) >= _FEWEST
    ]


def _thinned(record: Record, channels: Sequence[str], every: int) -> FloatArray:
    """Return means of so many rows; angles run on without jumps, so that their means mean something."""
    if every == 1:
        return record.matrix(channels)
    means = np.empty((len(record) // every, len(channels)))
    for rows in pieces(len(means)):
        part = record.part(range(rows.start * every, rows.stop * every)).matrix(channels)
        means[rows] = part.reshape(rows.stop - rows.start, every, -1).mean(axis=1)
    return means


def terms_of(angles: FloatArray, period_s: float) -> FloatArray:
    """Return the six terms of the attitude's rates, in deg/s, NaN at the ends.

    phi', psi' sin theta, theta' cos phi, psi' cos theta sin phi, psi' cos theta cos phi, theta' sin phi.
    """
    phi, theta, _ = np.deg2rad(angles).T
    phi_rate, theta_rate, psi_rate = slopes(angles, period_s).T
    sin_phi, cos_phi, cos_theta = np.sin(phi), np.cos(phi), np.cos(theta)
    return np.column_stack(
        [
            phi_rate,
            psi_rate * np.sin(theta),
            theta_rate * cos_phi,
            psi_rate * cos_theta * sin_phi,
            psi_rate * cos_theta * cos_phi,
            theta_rate * sin_phi,
        ]
    )


def slopes(angles: FloatArray, period_s: float) -> FloatArray:
    """Return central differences; an angle may run from 360 deg to 0."""
    slopes = np.full(angles.shape, np.nan)
    steps = angles[2:] - angles[:-2]
    slopes[1:-1] = (steps - 360.0 * np.rint(steps / 360.0)) / (2.0 * period_s)
    return slopes


def rates_from(signs: Sequence[float]) -> FloatArray:
    """Return what makes p, q, r of the terms where the angles' signs are turned, shape (6, 3)."""
    phi, theta, psi = signs
    rates = np.zeros((6, 3))
    rates[0, 0], rates[1, 0] = phi, -psi * theta
    rates[2, 1], rates[3, 1] = theta, psi * phi
    rates[4, 2], rates[5, 2] = psi, -theta * phi
    return rates


def attitude_rates(record: Record) -> FloatArray:
    """Return the rates that a record's attitude turns at about the gyros' axes, in deg/s, shape (rows, 3)."""
    return np.asarray(terms_of(record.matrix(ATTITUDE), record.sample_period_s) @ rates_from((1.0, 1.0, 1.0)))


def slow_motion(values: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return columns' slow motion about its mean, 0 where samples are missing, and which rows are whole."""
    there = np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)
    slowed = slow(interpolated(values))
    if there.any():
        slowed = slowed - slowed[there].mean(axis=0)
    return slowed * there[:, np.newaxis], there


def slow_pieces(columns: Sequence[FloatArray]) -> Iterator[tuple[FloatArray, BoolArray]]:
    """Give columns' slow motion piece by piece, and which rows are whole: as of all of them at once.

    A piece ends where as many rows as the filter sees are whole; where there are none, it goes on.
    """
    count, begin = len(columns[0]), 0
    while begin < count:
        stop = _joint(columns, begin + rows_of_piece())
        first, last = max(begin - HALF, 0), min(stop + HALF, count)
        values = np.column_stack([column[first:last] for column in columns])
        there = np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)
        own = slice(begin - first, stop - first)
        yield slow(interpolated(values))[own], there[own]
        begin = stop


def _joint(columns: Sequence[FloatArray], row: int) -> int:
    """Return the first row from one on about which all that the filter sees is whole, or one past the last."""
    count, width, step = len(columns[0]), 2 * HALF, rows_of_piece()
    for first in range(row - HALF, count - width, step):
        whole = np.logical_and.reduce([np.isfinite(column[first : first + step + width]) for column in columns])
        counts = np.cumsum(np.concatenate([[0], whole]))
        fits = np.flatnonzero(counts[width:] - counts[:-width] == width)
        if len(fits):
            return first + int(fits[0]) + HALF
    return count


def moments(pieces: Sequence[Piece], angles: Sequence[FloatArray]) -> Moments:
    """Return the covariances of gyros with the rates of some angles, piece by piece."""
    period_s = pieces[0].period_s
    most = round(LONGEST_LAG_S / period_s)
    slowed = [
        slow_motion(np.column_stack([piece.gyros, terms_of(attitude, period_s)]))
        for piece, attitude in zip(pieces, angles, strict=True)
    ]
    gyros, terms, cross, rows = np.zeros(3), np.zeros((6, 6)), np.zeros((3, 6, 2 * most + 1)), 0.0
    for (both, there), weight in zip(slowed, _weights([both for both, _ in slowed], period_s), strict=True):
        weighed = both * np.sqrt(weight)[:, np.newaxis]
        y, u = weighed[:, :3], weighed[:, 3:]
        gyros += np.square(y).sum(axis=0)
        terms += u.T @ u
        cross += _lagged(y, u, most)
        rows += float(weight[there].sum())
    count = max(rows, 1e-300)
    return Moments(
        gyros=gyros / count,
        terms=terms / count,
        cross=cross / count,
        lags_s=np.arange(-most, most + 1, dtype=np.float64) * period_s,
    )


def _weights(motions: Sequence[FloatArray], period_s: float) -> list[FloatArray]:
    """Return each row's weight: what moves more than nearly all rows counts as if it moved as much, and no more.

    A tumble at the end isn't all of a flight, nor is the jump of an estimator that starts anew.
    """
    weights = [np.ones(len(motion)) for motion in motions]
    for columns in (slice(0, 3), slice(3, None)):
        powers = [_power(motion[:, columns], period_s) for motion in motions]
        usual = _usual(np.concatenate(powers))
        for weight, power in zip(weights, powers, strict=True):
            weight *= usual / np.maximum(power, max(usual, 1e-300))
    return weights


def _usual(powers: FloatArray) -> float:
    """Return what most rows that move at all don't exceed."""
    return float(np.quantile(powers[powers >= _AT_REST * powers.max()], _USUAL))


def _power(values: FloatArray, period_s: float) -> FloatArray:
    """Return the mean square about every row."""
    window = np.ones(min(max(1, round(_AROUND_S / period_s)), len(values)))
    return np.convolve(np.square(values).sum(axis=1), window / len(window), mode="same")


def _lagged(y: FloatArray, u: FloatArray, most: int) -> FloatArray:
    """Return the sums of y(k) u(k + lag) for lags up to `most` either way, shape (gyros, terms, lags)."""
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(len(y) + most + 1, real=True)
    sums = irfft(np.conj(rfft(y.T, size))[:, np.newaxis] * rfft(u.T, size)[np.newaxis], size)
    return np.concatenate([sums[:, :, size - most :], sums[:, :, : most + 1]], axis=2)


def turned(pieces: Sequence[Piece], order: Sequence[int], factors: Sequence[float]) -> list[FloatArray]:
    """Return the pieces' angles in another order, each times a factor."""
    return [piece.angles[:, list(order)] * np.asarray(factors) for piece in pieces]


def shifted(angles: Sequence[FloatArray], late_s: Mapping[int, float], period_s: float) -> list[FloatArray]:
    """Return angles read so much earlier, by column: what is late comes in time."""
    moved = []
    for values in angles:
        rows = np.arange(len(values), dtype=np.float64)
        columns = values.copy()
        for column, seconds in late_s.items():
            at = rows + seconds / period_s
            columns[:, column] = np.where((at >= 0) & (at <= rows[-1]), np.interp(at, rows, values[:, column]), np.nan)
        moved.append(columns)
    return moved
