"""A log as blocks of a fifth of a second: what the gyros read, and by how much the attitude turned meanwhile.

Over a block the attitude turns by a rotation vector, in body axes, that is the integral of the body rates. So the noise
of an angle counts at the edges of a block alone, and sums over blocks telescope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.values.attitude_estimators import STEEPEST_DEG, to_earth
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, Span

BLOCK_S = 0.2  # as short as telemetry's samples are apart; with half or twice of it nothing changes
_SAME = 1e-6  # of a channel's spread: interpolation rounds


@dataclass(frozen=True, kw_only=True, eq=False)
class Blocks:
    """Blocks of a log, from its first sample on; NaN where samples are missing."""

    # start_s, period_s: where the first begins, and how long each is
    start_s: float
    period_s: float
    # gyros, rates, euler_rates, shape (blocks, 3): means of p, q, r; the attitude's body rates, by the rotation between
    # the ends of a block; and what phi, theta and psi turn by themselves, in deg/s
    gyros: FloatArray = field(repr=False)
    rates: FloatArray = field(repr=False)
    euler_rates: FloatArray = field(repr=False)
    angles: FloatArray = field(repr=False)  # shape (blocks, 3): phi, theta and psi at the beginning, in deg
    # shape (blocks, 3): mean squares of the gyros' second differences, in (deg/s)^2: six times the variance of white
    # noise
    rough: FloatArray = field(repr=False)
    # shape (blocks, 6): for how long p, q, r, phi, theta, psi have read one value, at the end of a block
    held_s: FloatArray = field(repr=False)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.gyros)

    @property
    def time_s(self) -> FloatArray:
        """When each begins, shape (blocks,)."""
        return np.asarray(self.start_s + self.period_s * np.arange(len(self)), dtype=np.float64)

    @property
    def end_s(self) -> float:
        """When the last ends."""
        return self.start_s + self.period_s * len(self)

    def within(self, spans: Sequence[Span]) -> BoolArray:
        """Tell which lie in any of some spans, or touch one, shape (blocks,)."""
        found = np.zeros(len(self), dtype=bool)
        for first_s, last_s in spans:
            found |= (self.time_s + self.period_s >= first_s) & (self.time_s <= last_s)
        return found


def blocks_of(records: Sequence[Record]) -> Blocks:
    """Return the blocks of records with p, q, r, phi, theta and psi, in time and of one sample period.

    >>> time_s = np.arange(0.0, 10.0, 0.05)
    >>> level, turning = 0.0 * time_s, 3.0 * time_s
    >>> values = np.column_stack([level, level, level + 3.0, level, level, turning])
    >>> found = blocks_of([Record(values, channels=[*GYROS, *ATTITUDE], sample_period_s=0.05)])
    >>> len(found), found.rates[7].round(6).tolist(), found.gyros[7].tolist()
    (49, [0.0, 0.0, 3.0], [0.0, 0.0, 3.0])
    """
    first = records[0]
    rows = max(1, round(BLOCK_S / first.sample_period_s))
    period_s = rows * first.sample_period_s
    count = int((records[-1].end_s - first.start_s) / period_s + 1e-6)
    whole = {name: np.full((count, width), np.nan) for name, width in _WIDTHS.items()}
    for record in records:
        begin = int(np.ceil((record.start_s - first.start_s) / period_s - 1e-6))
        skipped = round((first.start_s + begin * period_s - record.start_s) / first.sample_period_s)
        own = min((len(record) - 1 - skipped) // rows, count - begin)
        if own > 0:
            part = record.part(range(skipped, skipped + own * rows + 1))
            for name, values in _of_record(part, rows, period_s).items():
                whole[name][begin : begin + own] = values
    return Blocks(start_s=first.start_s, period_s=period_s, **whole)


_WIDTHS = {"gyros": 3, "rates": 3, "euler_rates": 3, "angles": 3, "rough": 3, "held_s": 6}  # columns of each field


def _of_record(record: Record, rows: int, period_s: float) -> dict[str, FloatArray]:
    """Return what the blocks of a record hold; it has a row more than they."""
    gyros, angles = record.matrix(GYROS), record.matrix(ATTITUDE)
    edges = angles[::rows]
    second = np.full(gyros.shape, np.nan)
    second[1:-1] = np.square(gyros[2:] - 2.0 * gyros[1:-1] + gyros[:-2])
    second[0], second[-1] = second[1], second[-2]
    return {
        "gyros": _means(gyros, rows),
        "rates": rates_deg_s(edges, period_s),
        "euler_rates": np.diff(edges, axis=0) / period_s,
        "angles": edges[:-1],
        "rough": second[:-1].reshape(-1, rows, 3).mean(axis=1),
        "held_s": _held_s(np.column_stack([gyros, angles]), record.sample_period_s)[rows::rows],
    }


def _means(values: FloatArray, rows: int) -> FloatArray:
    """Return means between edges, by the trapezoidal rule: both edges count by half."""
    between = 0.5 * (values[1:] + values[:-1])
    return np.asarray(between.reshape(-1, rows, values.shape[1]).mean(axis=1))


def rates_deg_s(angles: FloatArray, period_s: float) -> FloatArray:
    """Return the body rates between attitudes a period apart, shape (rows - 1, 3); NaN where it is too steep."""
    turned = _turns_deg(angles)
    turned[(np.abs(angles[:, 1]) > STEEPEST_DEG)[:-1]] = np.nan
    return turned / period_s


def _turns_deg(angles: FloatArray) -> FloatArray:
    """Return the rotation vectors, in body axes, from each attitude to the next, shape (rows - 1, 3)."""
    matrices = np.moveaxis(to_earth(np.radians(angles).T), -1, 0)
    step = np.einsum("kji,kjl->kil", matrices[:-1], matrices[1:])
    vector = 0.5 * np.column_stack(
        [step[:, 2, 1] - step[:, 1, 2], step[:, 0, 2] - step[:, 2, 0], step[:, 1, 0] - step[:, 0, 1]]
    )
    cosine = 0.5 * (np.trace(step, axis1=1, axis2=2) - 1.0)
    sine = np.linalg.norm(vector, axis=1)
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    return np.asarray(np.degrees(vector * scale[:, np.newaxis]))


def _held_s(values: FloatArray, period_s: float) -> FloatArray:
    """Return for how long each column has read one value, up to each row."""
    time_s = np.asarray(period_s * np.arange(len(values)), dtype=np.float64)
    return np.column_stack([held_for_s(time_s, column) for column in values.T])


def held_for_s(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return for how long a sensor has read one value, up to each sample.

    >>> held_for_s(np.arange(5.0), np.array([1.0, 2.0, 2.0, 2.0, 3.0])).tolist()
    [0.0, 0.0, 1.0, 2.0, 0.0]
    """
    there = np.isfinite(values)
    spread = float(values[there].std()) if there.any() else 0.0
    moved = np.ones(len(values), dtype=bool)
    moved[1:] = ~(np.abs(np.diff(values)) <= _SAME * spread)  # a missing value is none that is held
    last = np.maximum.accumulate(np.where(moved, np.arange(len(values)), 0))
    return np.asarray(time_s - time_s[last])
