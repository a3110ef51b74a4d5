"""A flight as the engine reads it: blocks of gyros and attitude, accelerometers beside them, and how it moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gtmbench.engine.blocks import Blocks
from gtmbench.engine.imus.imu import FlightImu
from gtmbench.values.attitude_estimators import to_earth
from gtmbench.values.channels import GYROS
from gtmbench.values.record import BoolArray, FloatArray, Span

LIVELY_S = 3.0  # over which it is told how lively the motion is; from 2 to 5 nothing changes
MOST_DEG_S = 400.0  # a rate beyond is a jump of an angle, and no turn
_LEAST_DEG_S = 0.5  # added to the liveliness: noise alone
_STILL_DEG_S, _STILL_G = 1.0, 0.02  # the most that an aircraft turns and shakes while it stands
_REPEATS_S = 3.0  # as long as a gyro that reads one value is none that stands by itself
_BESIDE_S = 10.0  # of standing: motors start, and the ground shakes
_STEEP_DEG = 80.0  # beyond, the heading turns faster than blocks follow
_FORCE_G = 0.3  # so far from 1 g the specific force points nowhere near the vertical
_LEAN_BLOCKS = 5  # over which the specific force is averaged


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """A flight in blocks of a fifth of a second.

    >>> from gtmbench.engine.blocks import blocks_of
    >>> from gtmbench.values.record import Record
    >>> level = Record(np.zeros((100, 6)), channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.1)
    >>> flight = Flight(blocks=blocks_of([level]), is_driven=False)
    >>> flight.matrices.shape, flight.lively[7].item()
    ((49, 3, 3), 0.5)
    """

    blocks: Blocks  # what gyros and attitude read
    # shape (blocks, 3): means of nx, ny, nz, in g; NaN where they are missing
    forces: FloatArray | None = field(default=None, repr=False)
    # shape (blocks,): the standard deviation of nz within a block, in g
    shaking: FloatArray | None = field(default=None, repr=False)
    # shape (blocks, 3): mean squares of second differences of nx, ny, nz, in g^2; NaN where there is none
    felt_rough: FloatArray | None = field(default=None, repr=False)
    # when phi, theta and psi are read, on the gyros' clock; none where gyros and attitude are read at once
    angle_stamps_s: tuple[FloatArray, ...] = field(default=(), repr=False)
    gyro_step_s: float = 0.0  # the longest usual time between two samples of a gyro
    # is_driven, is_assumed: whether the gyros drive the attitude, and whether that is only assumed
    is_driven: bool = True
    is_assumed: bool = False
    imus: tuple[FlightImu, ...] = field(default=(), repr=False)  # those beside the one whose gyros are in the blocks

    @property
    def compared(self) -> tuple[FlightImu, ...]:
        """The further IMUs that are judged: each of their gyros is about one of the aircraft's axes."""
        return tuple(imu for imu in self.imus if imu.mounting.is_along_axes)

    def by(self, imu: FlightImu) -> Flight:
        """Return the flight as it is watched by a further IMU alone."""
        held_s = np.column_stack([imu.held_s, self.blocks.held_s[:, len(GYROS) :]])
        blocks = replace(self.blocks, gyros=imu.gyros, rough=imu.rough, held_s=held_s)
        return replace(self, blocks=blocks, imus=(), is_assumed=True)

    def without(self, spans: Sequence[Span]) -> Flight:
        """Return the flight with gyros and attitude missing in some spans, such as a contact with the ground."""
        inside = self.blocks.within(spans)[:, np.newaxis]
        if not inside.any():
            return self
        gyros, rates = (np.where(inside, np.nan, each) for each in (self.blocks.gyros, self.blocks.rates))
        return replace(self, blocks=replace(self.blocks, gyros=gyros, rates=rates))

    @property
    def repeats(self) -> tuple[Span, ...]:
        """Where all gyros read one value each for seconds: that is the logger's, or the bus'."""
        held_s = self.blocks.held_s[:, : len(GYROS)].min(axis=1)
        ends = np.flatnonzero(held_s > _REPEATS_S)
        until_s = self.blocks.time_s[ends] + self.blocks.period_s
        return tuple(zip((until_s - held_s[ends]).tolist(), until_s.tolist(), strict=True))

    def __len__(self) -> int:
        """Return how many blocks there are."""
        return len(self.blocks)

    @cached_property
    def angles(self) -> FloatArray:
        """phi, theta and psi amid each block, in deg, without turns, shape (blocks, 3); 0 where they are missing."""
        amid = self.blocks.angles + 0.5 * self.blocks.period_s * self.blocks.euler_rates
        for angle in amid.T:
            there = np.isfinite(angle)
            angle[there] = np.unwrap(angle[there], period=360.0)
        return np.asarray(np.nan_to_num(amid))

    @cached_property
    def matrices(self) -> FloatArray:
        """Those that turn body axes into the earth's, amid each block, shape (blocks, 3, 3)."""
        of_axes: FloatArray = to_earth(np.radians(self.angles).T)
        return np.ascontiguousarray(of_axes.transpose(2, 0, 1))

    @cached_property
    def angle_axes(self) -> FloatArray:
        """The earth axes about which phi, theta and psi turn the aircraft, shape (blocks, 3, 3): the last is whose."""
        phi = np.radians(self.angles[:, 0])
        zero, one = np.zeros(len(self)), np.ones(len(self))
        of_phi = np.column_stack([one, zero, zero])
        of_theta = np.column_stack([zero, np.cos(phi), -np.sin(phi)])
        in_body = np.stack([of_phi, of_theta, self.matrices[:, 2, :]], axis=2)
        return np.asarray(np.einsum("nij,njk->nik", self.matrices, in_body))

    @cached_property
    def gyros(self) -> FloatArray:
        """What the gyros read, in deg/s, shape (blocks, 3); 0 where they are missing."""
        return np.nan_to_num(self.blocks.gyros)

    @cached_property
    def turning(self) -> FloatArray:
        """How fast phi, theta and psi turn by the gyros, in deg/s, shape (blocks, 3)."""
        phi, theta = np.radians(self.angles[:, 0]), np.radians(np.clip(self.angles[:, 1], -_STEEP_DEG, _STEEP_DEG))
        p, q, r = self.gyros.T
        yaw = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
        return np.column_stack([p + yaw * np.sin(theta), q * np.cos(phi) - r * np.sin(phi), yaw])

    @cached_property
    def spread(self) -> FloatArray:
        """The standard deviation of what each gyro reads, in deg/s, shape (3,)."""
        own = self.gyros[self.judged] if self.judged.any() else np.zeros((1, 3))
        return np.asarray(own.std(axis=0), dtype=np.float64)

    @cached_property
    def time_s(self) -> FloatArray:
        """Amid each block, since the log's first sample, shape (blocks,)."""
        return np.asarray(self.blocks.period_s * (np.arange(len(self)) + 0.5), dtype=np.float64)

    @cached_property
    def judged(self) -> BoolArray:
        """Blocks in which gyros and attitude are both there, shape (blocks,)."""
        gyros = np.isfinite(self.blocks.gyros).any(axis=1)
        return np.asarray(gyros & np.isfinite(self.blocks.rates).all(axis=1))

    @cached_property
    def lively(self) -> FloatArray:
        """The root mean square of the attitude's rate over the last seconds, in deg/s, shape (blocks,)."""
        rates = np.clip(np.nan_to_num(self.blocks.rates), -MOST_DEG_S, MOST_DEG_S)
        return np.asarray(np.sqrt(self._trailing(np.square(rates).sum(axis=1))) + _LEAST_DEG_S)

    @cached_property
    def stands(self) -> BoolArray:
        """Blocks in which the aircraft stands, by attitude and accelerometers, shape (blocks,)."""
        if self.shaking is None:
            return np.zeros(len(self), dtype=bool)
        moves = ~(np.linalg.norm(self.blocks.rates, axis=1) < _STILL_DEG_S) | ~(self.shaking < _STILL_G)
        return np.asarray(self._trailing(moves.astype(float)) < 0.5 / self._lively_blocks)

    @cached_property
    def flown(self) -> BoolArray:
        """Blocks in which it flies, and has for some seconds: motors that start, and the ground, are none of its ways.

        Where it stands, at the beginning and at the end, and some seconds beside, are left out.
        """
        stands, count = self.stands, round(_BESIDE_S / self.blocks.period_s)
        moves = np.flatnonzero(~stands & self.judged)
        found = np.zeros(len(stands), dtype=bool)
        if len(moves):
            first, last = int(moves[0]), int(moves[-1]) + 1
            begin = first + count * bool(first > 0 and stands[:first].any())
            found[begin : max(last - count * bool(stands[last:].any()), begin)] = True
        return found & self.judged

    @property
    def flown_s(self) -> Span:
        """From when to when it flies; (0, 0) where it never does."""
        rows, blocks = np.flatnonzero(self.flown), self.blocks
        if not len(rows):
            return 0.0, 0.0
        return blocks.start_s + blocks.period_s * float(rows[0]), blocks.start_s + blocks.period_s * float(rows[-1] + 1)

    @cached_property
    def lean(self) -> FloatArray:
        """The attitude's tilt less that of the specific force, about forward and right, in deg, shape (blocks, 2)."""
        if self.forces is None:
            return np.full((len(self), 2), np.nan)
        felt = np.column_stack([-self.forces[:, 0], -self.forces[:, 1], self.forces[:, 2]])
        size = np.linalg.norm(felt, axis=1, keepdims=True)
        near = np.abs(size - 1.0) < _FORCE_G
        felt = np.where(near, felt / np.maximum(size, 0.1), np.nan)
        mean = np.full(felt.shape, np.nan)
        if len(felt) >= _LEAN_BLOCKS:
            windows = np.lib.stride_tricks.sliding_window_view(felt, _LEAN_BLOCKS, axis=0)
            counts = np.isfinite(windows).sum(axis=2)
            mean[_LEAN_BLOCKS - 1 :] = np.where(counts > 0, np.nansum(windows, axis=2) / np.maximum(counts, 1), np.nan)
        tilt = np.degrees(np.cross(self.matrices[:, 2, :], mean))
        return self.levelled(np.einsum("nij,nj->ni", self.matrices, tilt))

    def levelled(self, turned: FloatArray) -> FloatArray:
        """Return rotations in earth axes about the horizontal axes of the aircraft: forward and right.

        `turned`, shape (blocks, 3).
        """
        psi = np.radians(self.angles[:, 2]).reshape(-1, *[1] * (turned.ndim - 2))
        cosine, sine = np.cos(psi), np.sin(psi)
        forward = cosine * turned[:, 0] + sine * turned[:, 1]
        right = -sine * turned[:, 0] + cosine * turned[:, 1]
        return np.stack([forward, right], axis=1)

    @property
    def _lively_blocks(self) -> int:
        return max(round(LIVELY_S / self.blocks.period_s), 1)

    def _trailing(self, values: FloatArray) -> FloatArray:
        """Return trailing means over some seconds."""
        return trailing_means(values, self._lively_blocks)


def trailing_means(values: FloatArray, count: int, fewest: int = 1) -> FloatArray:
    """Return means of up to so many rows that end with each, none below zero, where the `fewest` are known; else NaN.

    >>> trailing_means(np.array([1.0, 3.0, np.nan, 5.0]), 2).tolist()
    [1.0, 2.0, 3.0, 5.0]
    """
    there = np.isfinite(values)
    none = np.zeros((1, *values.shape[1:]))
    sums = np.concatenate([none, np.cumsum(np.where(there, values, 0.0), axis=0)])
    numbers = np.concatenate([none, np.cumsum(there, axis=0)])
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - count, 0)
    known = numbers[ends] - numbers[starts]
    mean = np.maximum(sums[ends] - sums[starts], 0.0) / np.maximum(known, 1.0)
    return np.where(known >= fewest, mean, np.nan)


def means_about(values: FloatArray, half: int) -> FloatArray:
    """Return means of each row and so many before and behind it, fewer at the ends.

    >>> means_about(np.array([1.0, 2.0, 6.0, 7.0]), 1).tolist()
    [1.5, 3.0, 5.0, 6.5]
    """
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    rows = np.arange(len(values))
    first, last = np.maximum(rows - half, 0), np.minimum(rows + half + 1, len(values))
    return np.asarray((sums[last] - sums[first]) / (last - first).reshape(-1, *[1] * (values.ndim - 1)))
