"""The installation of gyros and attitude, learnt from a record as it comes: its first part, then slowly followed.

Slow motion alone is looked at, in blocks of two seconds, each about its own means: what wanders slower than a block is
no installation's. The first blocks settle it, later ones are believed ten seconds after they came, and only where they
look as those before: a fault that begins isn't learnt. What isn't shown decisively, and what no healthy sensor has, is
left as it was read. A fault that was there from the first sample on is learnt as healthy, within these limits.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.installation.installation import Installation
from gtmbench.detectors.predicting import predicts
from gtmbench.detectors.protocol import Monitor
from gtmbench.method.pseudo_inputs import derived, reproduces
from gtmbench.method.regression.equations import interpolated
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record, joined

_BLOCK_S, _FIRST, _WAIT = 2.0, 12, 5  # blocks that settle it, and that a block waits until it is believed
_HALF_S = 0.15  # to either side: slow motion
_MOST_LATE_S = 1.0  # after hours of clocks that run apart
_SCALE, _AXIS, _LATE_S, _DRIFT = 0.03, 0.035, 0.03, 3e-4  # deviations that healthy sensors may have
# the same, by the unknowns in their order
_HEALTHY = np.array([_SCALE if i % 4 == 0 else _AXIS for i in range(9)] + [_LATE_S, _DRIFT])
_BLUNT = np.array([0.001] * 9 + [2e-4, 1e-6])  # what noise in the attitude, and all that is left out, make of them
_WITHIN = 3.0  # of these
_DECISIVE = 3.0  # deviations from 0 by which something has to be shown
_FEWEST = 5  # blocks that settle anything
_LEAST_POWER = 1e-12  # a division's guard, where nothing moves
_ALIKE = 6.0  # times the median block's residual: more is no installation's
_KEPT = 200  # blocks
_TURNS = 6  # of a robust fit: each weighs blocks by what the one before left
_LEAST_THERE = 0.5  # of a block's samples
_E, _TIME, _RATE = 9, 9, 10  # places among the 11 unknowns: E row by row, lag, drift


@dataclass(frozen=True, kw_only=True, eq=False)
class _Block:
    """Slow motion of some rows: attitude's body rates and their slopes, and gyros of more rows to either side."""

    time_s: float
    rates: FloatArray = field(repr=False)
    slopes: FloatArray = field(repr=False)
    gyros: FloatArray = field(repr=False)
    there: BoolArray = field(repr=False)
    period_s: float

    def moments(self, shift: int) -> tuple[FloatArray, FloatArray]:
        """Return [a a' e]'[a a' e] / rows of every axis, shape (3, 5, 5), and the means of e and (a, a'), unremoved.

        e = gyro(k - shift) - a(k) + shift Ts a'(k), which is E a + t a' + bias.
        """
        margin = (len(self.gyros) - len(self.rates)) // 2
        gyros = self.gyros[margin - shift : margin - shift + len(self.rates)]
        left = gyros - self.rates + shift * self.period_s * self.slopes
        products, means = np.empty((3, 5, 5)), np.empty((3, 5))
        for axis in range(3):
            columns = np.column_stack([self.rates, self.slopes[:, axis], left[:, axis]])[self.there]
            means[axis] = columns.mean(axis=0)
            columns = columns - means[axis]
            products[axis] = columns.T @ columns / len(columns)
        return products, means


class Learner:
    """What is known of an installation, block by block, beside the one that is expected."""

    def __init__(self, sample_period_s: float, expected: Installation | None = None) -> None:
        self._period_s = sample_period_s
        self._rows = max(round(_BLOCK_S / sample_period_s), 8)
        plain = Installation() if expected is None else expected
        self._plain = np.append((plain.gyros - np.eye(3)).ravel(), [plain.late_s, plain.drift])
        self._prior = _HEALTHY**-2.0
        self._axes: BoolArray = np.ones(3, dtype=np.bool_)  # whose gyro is heeded
        self._first: list[_Block] = []
        self._waiting: deque[_Block] = deque()
        self._powers: deque[FloatArray] = deque(maxlen=_KEPT)
        self._hessian, self._right = np.diag(self._prior), self._prior * self._plain
        self._since_s = 0.0
        self._bias = np.zeros(3)
        self._half = max(round(_HALF_S / sample_period_s), 1)
        self.is_settled = False
        self.installation = Installation()

    @property
    def margin(self) -> int:
        """Rows beside a block that it looks at, to either side."""
        return self._half + round(_MOST_LATE_S / self._period_s) + 2

    @property
    def rows(self) -> int:
        """Rows of a block."""
        return self._rows

    def take(self, record: Record, rows: range) -> None:
        """Learn from a block of a record, which has `margin` rows more on either side; of its ends, what there is."""
        block = self._block(record, rows)
        if block is None:
            return
        if not self.is_settled:
            self._first.append(block)
            if len(self._first) == _FIRST:
                self.settle()
            return
        self._waiting.append(block)
        if len(self._waiting) > _WAIT:
            self._believe(self._waiting.popleft())

    def settle(self) -> None:
        """Learn from the first blocks, unless they are too few."""
        if self.is_settled or len(self._first) < _FEWEST:
            return
        self.is_settled = True
        self._since_s = self._first[0].time_s
        state = self._fitted()
        for _ in GYROS:
            broken = self._beyond(state)[:_E].reshape(3, 3).any(axis=1)
            if not np.any(broken & self._axes):
                break
            # no healthy gyro reads so: it tells nothing of the lag either
            self._axes = np.asarray(self._axes & ~broken, dtype=np.bool_)
            state = self._fitted()
        self._first = []
        self._tell()

    def _fitted(self) -> FloatArray:
        """Return the unknowns by the first blocks, those left out whose residual isn't like the others'."""
        state = np.zeros(_E + 2)
        for _ in range(_TURNS):
            found = [block.moments(self._shift(block, state)) for block in self._first]
            powers = np.array(
                [self._power(block, moments, state) for block, (moments, _) in zip(self._first, found, strict=True)]
            )
            usual = np.maximum(np.median(powers, axis=0), _LEAST_POWER)
            self._hessian, self._right = np.diag(self._prior), self._prior * self._plain
            for block, (moments, _), power in zip(self._first, found, powers, strict=True):
                if self._is_alike(power, usual):
                    self._add(block, moments, usual)
            state = np.linalg.solve(self._hessian, self._right)
        self._powers.clear()
        self._powers.extend(powers)
        means = [self._mean(block, means, state) for block, (_, means) in zip(self._first, found, strict=True)]
        self._bias = np.median(means, axis=0)
        return state

    def _is_alike(self, power: FloatArray, usual: FloatArray) -> bool:
        return bool((power <= _ALIKE * usual)[self._axes].all())

    def _believe(self, block: _Block) -> None:
        state = np.linalg.solve(self._hessian, self._right)
        moments, _ = block.moments(self._shift(block, state))
        power = self._power(block, moments, state)
        usual = np.maximum(np.median(self._powers, axis=0), _LEAST_POWER)
        if not self._is_alike(power, usual):
            return
        self._powers.append(power)
        self._add(block, moments, usual)
        self._tell()

    def _block(self, record: Record, rows: range) -> _Block | None:
        """Return the slow motion of a block, None where too much of it is missing."""
        margin = self.margin
        first, last = rows.start - margin, rows.stop + margin
        inside = range(max(first, 0), min(last, len(record)))
        part = record.part(inside)
        values = np.column_stack(
            [part.matrix(GYROS), *derived(part, [f"{name}_att" for name in GYROS], among=ATTITUDE)]
        )
        there: BoolArray = np.asarray(np.isfinite(values).all(axis=1), dtype=np.bool_)
        own = slice(rows.start - inside.start, rows.stop - inside.start)
        if np.mean(there[own]) < _LEAST_THERE:
            return None
        padded = np.pad(interpolated(values), ((inside.start - first, last - inside.stop), (0, 0)), mode="edge")
        padded[1:-1, :3] = (padded[:-2, :3] + 4.0 * padded[1:-1, :3] + padded[2:, :3]) / 6.0  # as slopes see rates
        taps = np.hanning(2 * self._half + 3)[1:-1]
        slow = np.array([np.convolve(column, taps / taps.sum(), mode="valid") for column in padded.T]).T
        slopes = (slow[2:, 3:] - slow[:-2, 3:]) / (2.0 * self._period_s)
        edge = margin - self._half  # of slow motion, beside the block
        return _Block(
            time_s=record.start_s + 0.5 * (rows.start + rows.stop - 1) * self._period_s,
            rates=slow[edge : edge + len(rows), 3:],
            slopes=slopes[edge - 1 : edge - 1 + len(rows)],
            gyros=slow[:, :3],
            there=there[own],
            period_s=self._period_s,
        )

    def _shift(self, block: _Block, state: FloatArray) -> int:
        late_s = state[_TIME] + state[_RATE] * (block.time_s - self._since_s)
        return round(float(np.clip(late_s, -_MOST_LATE_S, _MOST_LATE_S)) / self._period_s)

    def _of(self, block: _Block, axis: int) -> FloatArray:
        """Return what makes (E of an axis, lag at the block) of the unknowns, shape (4, 11)."""
        picks = np.zeros((4, _E + 2))
        picks[[0, 1, 2], [3 * axis, 3 * axis + 1, 3 * axis + 2]] = 1.0
        picks[3, _TIME], picks[3, _RATE] = 1.0, block.time_s - self._since_s
        return picks

    def _power(self, block: _Block, moments: FloatArray, state: FloatArray) -> FloatArray:
        """Return the residual's mean square of every axis."""
        powers = np.empty(3)
        for axis in range(3):
            minus = np.append(-self._of(block, axis) @ state, 1.0)
            powers[axis] = minus @ moments[axis] @ minus
        return powers

    def _mean(self, block: _Block, means: FloatArray, state: FloatArray) -> FloatArray:
        return np.array([means[axis] @ np.append(-self._of(block, axis) @ state, 1.0) for axis in range(3)])

    def _add(self, block: _Block, moments: FloatArray, power: FloatArray) -> None:
        count = float(np.count_nonzero(block.there)) / (self._half + 1)  # rows within a filter's length say the same
        for axis in np.flatnonzero(self._axes).tolist():
            picks = self._of(block, axis)
            weight = count / float(power[axis])
            self._hessian = self._hessian + weight * picks.T @ moments[axis][:4, :4] @ picks
            self._right = self._right + weight * picks.T @ moments[axis][:4, 4]

    def _tell(self) -> None:
        covariance = np.asarray(np.linalg.inv(self._hessian), dtype=np.float64)
        off = np.asarray(covariance @ self._right - self._plain, dtype=np.float64)
        state = _shown_unknowns(off, np.asarray(covariance + np.diag(_BLUNT**2)))
        beyond = self._beyond(state + self._plain)
        state[:_E] *= ~np.repeat(beyond[:_E].reshape(3, 3).any(axis=1), 3)
        state[_TIME:] *= not beyond[_TIME:].any()
        self.installation = Installation(
            gyros=np.eye(3) + state[:_E].reshape(3, 3),
            bias=self._bias,
            late_s=float(state[_TIME]),
            drift=float(state[_RATE]),
            since_s=self._since_s,
        )

    def _beyond(self, state: FloatArray) -> BoolArray:
        """Tell which unknowns no healthy sensor has."""
        return np.asarray(np.abs(state - self._plain) > _WITHIN * _HEALTHY)


def _shown_unknowns(state: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the unknowns given that those are 0 which aren't shown decisively, the least shown first."""
    left = list(range(len(state)))
    state = state.copy()
    while left:
        ratios = np.abs(state[left]) / np.sqrt(np.diag(covariance)[left])
        least = int(np.argmin(ratios))
        if ratios[least] >= _DECISIVE:
            break
        place = left.pop(least)
        share = covariance[:, place] / covariance[place, place]
        state, covariance = state - share * state[place], covariance - np.outer(share, covariance[place])
        state[place] = 0.0
    return state


class Corrector:
    """A stretch's rows as they come, their installation undone; the learner goes on from stretch to stretch.

    Rows wait until the first blocks have settled what is undone; later none waits.
    """

    def __init__(self, learner: Learner) -> None:
        self._learner = learner
        self._rows: Record | None = None  # the last that are still needed, and those to come
        self._skipped = 0  # rows before them
        self._given = self._learnt = 0  # rows of the stretch
        self._waited = 0  # samples, by the last row given

    def push(self, chunk: Record) -> list[Record]:
        """Return the rows that can be given now."""
        self._rows = chunk if self._rows is None else joined([self._rows, chunk.select(self._rows.channels)])
        learner, count = self._learner, self._skipped + len(self._rows)
        given: list[Record] = []
        while self._learnt + learner.rows + learner.margin <= count:
            stop = self._learnt + learner.rows + learner.margin
            given += self._give(stop if learner.is_settled else 0)  # with what was known before
            learner.take(self._rows, range(self._learnt - self._skipped, self._learnt + learner.rows - self._skipped))
            self._learnt += learner.rows
        given += self._give(count if learner.is_settled else 0)
        self._forget()
        return given

    def end(self) -> list[Record]:
        """Return the rows that are left; as they were read, where too little has come to settle anything."""
        if self._rows is None:
            return []
        self._learner.settle()
        return self._give(self._skipped + len(self._rows))

    def _give(self, stop: int) -> list[Record]:
        if self._rows is None or stop <= self._given:
            return []
        rows = range(self._given - self._skipped, stop - self._skipped)
        self._given = stop
        record, self._waited = self._learner.installation.undone(self._rows, rows, self._waited)
        return [record]

    def _forget(self) -> None:
        assert self._rows is not None
        needed = min(self._given, self._learnt) - self._learner.margin - self._skipped
        if needed > self._learner.rows:
            self._rows = self._rows.part(range(needed, len(self._rows)))
            self._skipped += needed


def expected_of(monitor: Monitor) -> Installation | None:
    """Return the installation that a monitor was calibrated with, where kinematic operators tell its lag and scales."""
    if not predicts(monitor):
        return None
    gyros, late = np.eye(3), []
    for place, name in enumerate(GYROS):
        operator = monitor.operators.get(name)
        if operator is not None and len(operator.inputs) == 1 and reproduces(operator.inputs[0], name):
            markov = operator.markov[:, 0, 0]
            gyros[place, place] = markov.sum()
            late.append(-float(operator.lags @ markov / markov.sum()) * operator.sample_period_s)
    return Installation(gyros=gyros, late_s=float(np.mean(late)) if late else 0.0)


def has_motion(monitor: Monitor) -> bool:
    """Whether a monitor hears all gyros and the whole attitude, at a rate of its own."""
    return {*GYROS, *ATTITUDE} <= set(monitor.channels) and monitor.sample_period_s is not None


def corrected(records: Sequence[Record], expected: Installation | None = None) -> tuple[list[Record], Installation]:
    """Return stretches of one flight with their installation undone, as a stream would have them, and what it is.

    `records`: in time, with gyros and the whole attitude, of one sample period. `expected`: that their monitor was
    calibrated with; plain unless told.
    """
    learner = Learner(records[0].sample_period_s, expected)
    given = []
    for record in records:
        corrector = Corrector(learner)
        parts = [*corrector.push(record), *corrector.end()]
        given.append(joined(parts))
    return given, learner.installation
