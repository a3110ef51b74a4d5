"""Recursive identification: the operator of all samples so far, at any time, with bounded memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.identify import operator_of
from gtmbench.method.problem import (
    Constant,
    Problem,
    about_zero,
    check_constant_kind,
    check_parameters,
    operator_names,
    too_few,
    unknowns_of,
)
from gtmbench.method.regression.stretches import check_constant, merged, moments
from gtmbench.method.regression.triangle import Triangle, absorb, written_out
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.clock import lateness_s
from gtmbench.values.record import FloatArray, Record, check_record

_LARGEST = 1e150  # what can be squared and summed
_BLOCK = 64  # samples that are taken into the triangle together


class RecursiveIdentification:
    """Recursive least squares with forgetting: equation k weighs lambda^(l-k), l the last sample pushed.

    Its state is the triangular array R of [Phi, 1, y], updated by reflections (the square-root form of recursive least
    squares, which never squares the data's condition), and the sums behind means and RMS values. The column of ones is
    the constant's, and allows the final means to be removed. So its result equals that of `identify` with weights
    lambda^(l-k), whatever the pieces; with lambda = 1 it is the batch result.

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
    constant : str
        As for `identify`.

    Raises
    ------
    InputError
        If names, orders or the forgetting factor are invalid.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u = rng.standard_normal(400)
    >>> record = gb.Record(np.column_stack([u, 2.0 * u]), channels=["u", "y"], sample_period_s=0.01)
    >>> running = gb.RecursiveIdentification(inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=0)
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
        constant: Constant = "estimated",
    ) -> None:
        self.inputs: tuple[str, ...]
        self.outputs: tuple[str, ...]
        self.inputs, self.outputs = operator_names(inputs, outputs)
        self.causal_order: int = whole("causal_order", causal_order)
        self.noncausal_order: int = whole("noncausal_order", noncausal_order)
        self.forgetting: float = number("forgetting", forgetting, 0.0, 1.0, above=True)
        self.estimator: LeastSquares = LeastSquares() if estimator is None else estimator
        if not isinstance(self.estimator, LeastSquares):
            raise InputError(f"estimator is {self.estimator!r}; recursion is for gtmbench.LeastSquares(...)")
        check_constant_kind(constant)
        self.constant: Constant = constant
        lags, channels = self.causal_order + self.noncausal_order + 1, len(self.inputs) + len(self.outputs)
        check_parameters(lags, len(self.inputs))
        parameters = lags * len(self.inputs)
        # weights forgetting^k sum to 1 / (1 - forgetting) samples: fewer than parameters determine nothing
        if (1.0 - self.forgetting) * parameters > 1.0:
            raise InputError(
                f"forgetting {self.forgetting:g} remembers {1.0 / (1.0 - self.forgetting):.3g} samples for "
                f"{parameters} Markov parameters; choose {1.0 - 0.1 / parameters:.6g} or more"
            )
        size = parameters + 1 + len(self.outputs)
        # R of [Phi 1 y] = Q R, the normal equations' root: it is updated without ever squaring a condition number
        self._root = np.zeros((size, size), order="F")
        self._moments: FloatArray | None = None
        self._origin = np.zeros(channels)  # values are taken in about the first ones' median
        self._recent = np.zeros((0, channels))  # the last r + d samples
        self._pending: list[FloatArray] = []
        self._weight = 0.0
        self._counts = [0, 0]  # samples taken in, equations
        self._end: tuple[float, float] | None = None  # time of the next sample, sample period

    def push(self, record: Record) -> None:
        """Add one or more samples.

        Samples with a missing value (or one beyond 1e150) are left out, as with a weight of 0, but earlier samples age
        as with every sample; a gap doesn't age them. A record that doesn't continue the one before begins a new
        stretch: no equation spans the gap.

        Raises
        ------
        InputError
            If a channel is missing, the sample period has changed or time goes back; then nothing is added.
        """
        check_record(record)
        values = record.matrix((*self.inputs, *self.outputs))
        if self._end is not None:
            expected_s, period_s = self._end
            record.check_period(period_s, "those before every")
            if lateness_s(record.start_s, expected_s, period_s):
                self._flush()
                self._recent = self._recent[:0]
        self._end = (record.start_s + len(record) * record.sample_period_s, record.sample_period_s)
        for start in range(0, len(values), _BLOCK):
            self._pending.append(values[start : start + _BLOCK].copy())  # a view would hold all
            if sum(map(len, self._pending)) >= _BLOCK:
                self._flush()

    def operator(self) -> Transmissibility:
        """Return the operator of all samples so far.

        Raises
        ------
        InputError
            If there are too few, or a channel has been constant.

        Warns
        -----
        RankWarning
            As `identify` does.
        """
        self._flush()
        lags, (samples, equations) = self.causal_order + self.noncausal_order + 1, self._counts
        nothing = np.zeros(len(self._origin))
        problem = Problem(
            stretches=(),  # the triangle stands for them
            instruments=(),
            inputs=self.inputs,
            outputs=self.outputs,
            causal_order=self.causal_order,
            noncausal_order=self.noncausal_order,
            centre=nothing,
            scale=nothing,
            sample_period_s=0.0 if self._end is None else self._end[1],
            constant=self.constant,
        )
        if self._moments is None or equations < problem.unknowns:
            raise too_few(samples, self.inputs, equations, problem.unknowns, unknowns_of(problem), lags)
        weight, centre, squares = self._moments
        rms = np.sqrt(squares / weight)
        check_constant(problem.channels, centre, rms)
        centre, rms = about_zero(centre, rms) if self.constant == "none" else (centre, rms)
        problem = replace(problem, centre=centre, scale=rms)
        return operator_of(problem, self.estimator.reduced(problem, self._triangle(problem)), self.estimator)

    def _triangle(self, problem: Problem) -> Triangle:
        """Return R of the centred, scaled equations: the column of ones takes the means away."""
        count, size, shift = len(self.inputs), problem.parameters, problem.centre - self._origin
        shifts = np.concatenate([np.tile(shift[:count], problem.lags), shift[count:]])
        scales = np.concatenate([np.tile(problem.scale[:count], problem.lags), problem.scale[count:]])
        centred = (np.delete(self._root, size, axis=1) - np.outer(self._root[:, size], shifts)) / scales
        means = np.zeros(centred.shape[1])
        if problem.with_constant:
            both = np.asarray(np.linalg.qr(np.column_stack([self._root[:, size], centred]), mode="r"))
            means, centred = both[0, 1:] / both[0, 0], both[1:, 1:]
        return Triangle(
            root=np.asarray(np.linalg.qr(centred, mode="r")),
            targets=len(self.outputs),
            equations=self._counts[1],
            weight=self._weight,
            solver="householder",
            means=means,
        )

    def _flush(self) -> None:
        """Take the pending samples in, run by run of those without a missing value."""
        if not self._pending:
            return
        values = np.vstack(self._pending)
        self._pending = []
        complete = np.asarray((np.abs(values) < _LARGEST).all(axis=1))  # and not NaN
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
        if self._moments is not None:
            self._moments[[0, 2]] *= factor
        self._weight *= factor

    def _take(self, values: FloatArray) -> None:
        """Take consecutive complete samples in."""
        now = moments(values.T, self.forgetting ** np.arange(len(values) - 1.0, -1.0, -1.0))
        if self._moments is None:
            self._origin = np.median(values, axis=0)
        self._moments = now if self._moments is None else merged(self._moments, now)
        values = values - self._origin
        self._counts[0] += len(values)
        joined = np.vstack([self._recent, values])
        ends = self.causal_order + self.noncausal_order
        count = len(joined) - ends
        if count > 0:
            regressor, targets = written_out(joined.T, len(self.inputs), ends + 1, self.causal_order)
            rows = np.hstack([regressor, np.ones((count, 1)), targets])
            weights = self.forgetting ** (np.arange(count - 1, -1, -1) + self.noncausal_order)
            self._root = absorb(self._root, np.sqrt(weights)[:, np.newaxis] * rows)
            self._weight += float(weights.sum())
            self._counts[1] += count
        self._recent = joined[max(len(joined) - ends, 0) :]
