"""Recursive identification: the operator of all samples so far, at any time, with bounded memory."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gtmbench.checks import number, whole
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.estimators.problem import Problem
from gtmbench.method.identify import operator_of
from gtmbench.method.pose import check_length, operator_names
from gtmbench.method.regression.stretches import check_constant
from gtmbench.method.regression.triangle import Triangle, absorb
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import FloatArray, Record

_BLOCK = 64  # samples that are taken into the triangle together


class RecursiveIdentification:
    """Least squares that forgets: equation k weighs lambda^(l-k), l the last sample pushed.

    Its state is the triangular array R of [Phi, 1, y], updated by reflections (the square-root form of recursive least
    squares, which never squares the data's condition), and the sums behind means and RMS values. The column of ones
    lets the means be removed that are known last. So its answer is `identify`'s with weights lambda^(l-k), whatever the
    pieces: with lambda = 1 the batch answer.

    Parameters
    ----------
    inputs, outputs : sequence of str
        Pseudo inputs and pseudo outputs.
    causal_order, noncausal_order : int
        r and d.
    forgetting : float
        lambda, 0 < lambda <= 1: ``1 / (1 - lambda)`` samples are remembered.
    estimator : LeastSquares, optional
        With its ridge or truncation.

    Raises
    ------
    InputError
        Where names, orders or the forgetting factor can't be meant.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> u = rng.standard_normal(400)
    >>> record = Record(np.column_stack([u, 2.0 * u]), channels=["u", "y"], sample_period_s=0.01)
    >>> running = RecursiveIdentification(inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=0)
    >>> for start_s in (0.0, 1.0, 2.0, 3.0):
    ...     running.push(record.between(start_s, start_s + 0.99))
    >>> running.operator().markov[:, 0, 0].round(9) + 0.0
    array([2., 0.])
    """

    def __init__(
        self,
        *,
        inputs: Sequence[str],
        outputs: Sequence[str],
        causal_order: int,
        noncausal_order: int,
        forgetting: float = 1.0,
        estimator: LeastSquares | None = None,
    ) -> None:
        self.inputs, self.outputs = operator_names(inputs, outputs)
        self.causal_order = whole("causal_order", causal_order)
        self.noncausal_order = whole("noncausal_order", noncausal_order)
        self.forgetting = number("forgetting", forgetting, 0.0, 1.0, above=True)
        self.estimator = LeastSquares() if estimator is None else estimator
        lags, channels = self.causal_order + self.noncausal_order + 1, len(self.inputs) + len(self.outputs)
        size = lags * len(self.inputs) + 1 + len(self.outputs)
        self._root = np.zeros((size, size), order="F")
        self._sums = np.zeros((3, channels))  # of weights, values and squares, about the origin
        self._origin: FloatArray | None = None
        self._recent = np.zeros((0, channels))  # the last r + d samples
        self._pending: list[FloatArray] = []
        self._weight = 0.0
        self._counts = [0, 0]  # samples taken in, equations
        self._end: tuple[float, float] | None = None  # time of the next sample, sample period

    def push(self, record: Record) -> None:
        """Take in one or more samples.

        Samples with a missing value are left out, as by a weight of 0. A record that doesn't continue the one before
        begins a new stretch: no equation reaches over the gap.

        Raises
        ------
        InputError
            Where a channel is missing or the sample period has changed; nothing is taken in then.
        """
        values = record.matrix((*self.inputs, *self.outputs))
        if self._end is not None:
            expected_s, period_s = self._end
            record.check_period(period_s, "those before every")
            if abs(record.start_s - expected_s) > 1e-3 * period_s:
                self._flush()
                self._recent = self._recent[:0]
        self._end = (record.start_s + len(record) * record.sample_period_s, record.sample_period_s)
        for start in range(0, len(values), _BLOCK):
            self._pending.append(values[start : start + _BLOCK])
            if sum(map(len, self._pending)) >= _BLOCK:
                self._flush()

    def operator(self) -> Transmissibility:
        """Return the operator of all samples so far.

        Raises
        ------
        InputError
            Where they are too few yet, or a channel has been constant.

        Warns
        -----
        RankWarning
            As `identify` does.
        """
        self._flush()
        weight, values, squares = self._sums
        with np.errstate(invalid="ignore"):
            shift = values / weight
            scale = np.sqrt(np.maximum(squares / weight - shift**2, 0.0))
        origin = np.zeros(len(shift)) if self._origin is None else self._origin
        problem = Problem(
            stretches=(),
            instruments=(),
            inputs=self.inputs,
            outputs=self.outputs,
            causal_order=self.causal_order,
            noncausal_order=self.noncausal_order,
            centre=origin + shift,
            scale=scale,
        )
        samples, equations = self._counts
        check_length(problem, samples, equations)
        check_constant(problem.channels, problem.centre, problem.scale)
        period_s = self._end[1] if self._end is not None else 0.0
        estimate = self.estimator.reduced(problem, self._triangle(problem, shift))
        return operator_of(problem, estimate, samples=equations, sample_period_s=period_s, estimator=self.estimator)

    def _triangle(self, problem: Problem, shift: FloatArray) -> Triangle:
        """Return R of the centred, scaled equations: the column of ones takes the means away."""
        count, size = len(self.inputs), problem.parameters
        shifts = np.concatenate([np.tile(shift[:count], problem.lags), shift[count:]])
        scales = np.concatenate([np.tile(problem.scale[:count], problem.lags), problem.scale[count:]])
        centred = (np.delete(self._root, size, axis=1) - np.outer(self._root[:, size], shifts)) / scales
        root = np.asarray(np.linalg.qr(centred, mode="r"))
        return Triangle(
            root=root, targets=len(self.outputs), equations=self._counts[1], weight=self._weight, solver="householder"
        )

    def _flush(self) -> None:
        """Take the pending samples in, run by run of those without a missing value."""
        if not self._pending:
            return
        values = np.vstack(self._pending)
        self._pending = []
        complete = np.asarray(np.isfinite(values).all(axis=1))
        edges = np.concatenate([[0], np.flatnonzero(np.diff(complete)) + 1, [len(values)]]).tolist()
        for start, stop in pairwise(edges):
            self._age(stop - start)
            if complete[start]:
                self._take(values[start:stop])
            else:
                self._recent = self._recent[:0]

    def _age(self, samples: int) -> None:
        """Let everything so far weigh less."""
        factor = self.forgetting**samples
        self._root *= np.sqrt(factor)
        self._sums *= factor
        self._weight *= factor

    def _take(self, values: FloatArray) -> None:
        """Take consecutive complete samples in."""
        if self._origin is None:
            self._origin = values[0].copy()
        values = values - self._origin
        weights = self.forgetting ** np.arange(len(values) - 1, -1, -1)
        self._sums += np.stack([np.full(values.shape[1], weights.sum()), weights @ values, weights @ values**2])
        self._counts[0] += len(values)
        joined = np.vstack([self._recent, values])
        ends = self.causal_order + self.noncausal_order
        count = len(joined) - ends
        if count > 0:
            inputs = len(self.inputs)
            windows = np.lib.stride_tricks.sliding_window_view(joined[:, :inputs], ends + 1, axis=0)
            target = joined[self.causal_order : self.causal_order + count, inputs:]
            rows = np.hstack([windows.transpose(0, 2, 1).reshape(count, -1), np.ones((count, 1)), target])
            weights = self.forgetting ** (np.arange(count - 1, -1, -1) + self.noncausal_order)
            self._root = absorb(self._root, np.sqrt(weights)[:, np.newaxis] * rows)
            self._weight += float(weights.sum())
            self._counts[1] += count
        self._recent = joined[max(len(joined) - ends, 0) :]
