"""Parameter uncertainty: what the records leave open of an operator, and so how wrong it may be on other motion.

A minute of flight excites few directions. On another manoeuvre the residual is then noise plus what the Markov
parameters leave open, phi(k)'(theta - theta_hat); its deviation follows from their covariance, and what is judged is
the residual over it: motion that nobody has flown widens what is normal, a fault in known motion stands out as before.
theta - theta_hat is one error at all samples, so that a window's mean of it follows from the window's mean of phi(k),
or of F' phi(k), F F' the covariance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.statistics.statistic import Spread, Statistic
from gtmbench.method.pseudo_inputs import derive
from gtmbench.method.regression.equations import HALF as HALF
from gtmbench.method.regression.equations import fir, held, regressors, slow
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, IntArray, Record

_CHUNK, _CHUNK_OF_FEW = 512, 2048  # rows: what they are turned into stays in the cache
_KEPT = 1024  # rows whose F' phi(k) is remembered: some 10 MB
_COLUMNS = 64  # of F, at a time


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterUncertainty:
    """What the records leave open of an operator."""

    # shape (parameters, parameters): F, with F F' the covariance of the Markov parameters, in their units; rows: lag -d
    # to r, input by input within
    root: FloatArray = field(repr=False)
    # raw, white: variance of the model's error over that of the noise is this times |F' phi(k)|^2: of the residual as
    # it is, and whitened. From stretches that identification hadn't seen
    raw: float
    white: float
    # samples to either side from which slow motion is told from noise, `HALF`; 0 where F' smooths by itself, as of
    # kinematic operators, whose gain, delay and curvature alone are open
    half: int = HALF

    def spread(
        self,
        operator: Transmissibility,
        record: Record,
        coefficients: FloatArray,
        test: Statistic,
        rows: slice = slice(None),
    ) -> Spread:
        """Return sqrt(1 + variance of the model's error over that of the noise) at every sample; 1 before some rows.

        A row stands on samples up to `half` + d after it (one more for derivatives). The record's last rows lack some:
        there motion is taken to go on by odd reflection. Who watches judges a row only once it is known.

        `record`: with the channels that the operator's inputs derive from. `coefficients`, shape (n + 1,): of the
        whitening filter. `test`: whose windows' means are judged. `rows`: that are asked for: of others, what costs
        most isn't worked out.
        """
        first, stop, _ = rows.indices(len(record))
        inputs = derive(record, operator.inputs).matrix(operator.inputs)[: stop + self.half + operator.noncausal_order]
        return self.of_inputs(operator, inputs, coefficients, test, first)

    def of_inputs(
        self, operator: Transmissibility, inputs: FloatArray, coefficients: FloatArray, test: Statistic, first: int = 0
    ) -> Spread:
        """Return the spread of all rows of an operator's inputs, shape (rows, inputs); 1 of some rows before `first`.

        A missing sample is bridged by the last one before it. Rows whose window phi(k) isn't complete have no residual,
        and a spread of 1. Motion begins with the first row that is complete, or the one before (a derivative lacks its
        first).
        """
        windows = test.rows(operator.sample_period_s) if test.name == "glr" else []
        powers = np.zeros((2 + len(windows), len(inputs)))
        there = np.asarray(np.isfinite(inputs).all(axis=1))
        begin = max(int(np.argmax(there)) - 1, 0) if there.any() else len(inputs)
        motion, ahead = held(inputs[begin:] - operator.input_means), operator.noncausal_order
        if len(motion) > max(self.half, ahead):
            baseline = round(test.baseline_s / operator.sample_period_s)
            motion = slow(motion) if self.half else motion
            lags = operator.causal_order + ahead + 1
            leverage = _Leverage(self.root, motion, lags, coefficients, windows, baseline)
            found = leverage.since(first + ahead - begin)
            rows = np.arange(len(motion))
            gaps = np.maximum.accumulate(np.where(there[begin:], -1, rows))
            found[:, rows - gaps < lags] = 0.0
            powers[:, begin : len(inputs) - ahead] = found[:, ahead:]  # phi(k) ends with row k + d
        raw, white, *means = np.array([[self.raw], *[[self.white]] * (1 + len(windows))]) * powers
        return Spread(raw=np.sqrt(1.0 + raw), white=np.sqrt(1.0 + white), means=dict(zip(windows, means, strict=True)))

    def weighed(self, alone: Spread) -> Spread:
        """Return the spread of rows from the one that factors of 1 give them."""
        return Spread(
            raw=np.sqrt(1.0 + self.raw * (alone.raw**2 - 1.0)),
            white=np.sqrt(1.0 + self.white * (alone.white**2 - 1.0)),
            means={rows: self.white * variance for rows, variance in alone.means.items()},
        )


class _Leverage:
    """|F' phi(k)|^2 of motion, of whitened motion, and of the shifts of its windows' means from their baselines.

    Motion is slow motion about the operator's means, whitened motion the same behind the whitening filter, phi(k) the
    window of `lags` rows that ends with one; and of windows' means it is
    |F' (mean of phi over a window's rows - that over the baseline's before)|^2.

    F' (mean of phi over L rows) is the mean of F' phi, which is there for the whitened motion: so the means of short
    windows cost no products of their own. Those of long ones, and of rows about motion's first, are worked out as they
    stand above, from sums of the motion: F' phi has a hundred times its columns, and isn't remembered for so long.

    `windows`: rows of each. `baseline`: rows before a window.
    """

    def __init__(
        self,
        root: FloatArray,
        motion: FloatArray,
        lags: int,
        coefficients: FloatArray,
        windows: Sequence[int],
        baseline: int,
    ) -> None:
        self._root, self._motion, self._lags = list(_columns(root)), motion, lags
        self._rows_at_once = _CHUNK_OF_FEW if len(root) <= _COLUMNS else _CHUNK
        before = np.repeat(motion[:1], len(coefficients) - 1, axis=0)
        self._white = fir(np.concatenate([before, motion]), coefficients)
        self._sums = np.concatenate([np.zeros((1, motion.shape[1])), np.cumsum(self._white, axis=0)])
        self._windows, self._baseline = np.array(windows, dtype=int), baseline
        self._past = np.zeros((2, 0, len(root)))  # F' phi(k) of the last rows, summed up; of its baseline

    def since(self, first: int) -> FloatArray:
        """Return it, shape (2 + windows, rows); 0 of some rows before `first`."""
        found, count = np.zeros((2 + len(self._windows), len(self._motion))), self._rows_at_once
        for start in range(max(first, 0), len(self._motion), count):
            rows = range(start, min(start + count, len(self._motion)))
            found[:, rows.start : rows.stop] = self._of(rows)
        return found

    def _of(self, rows: range) -> FloatArray:
        first = max(rows.start - self._lags + 1, 0)
        seen = slice(first, rows.stop)
        white = self._of_noise(self._white[seen], rows)
        powers = [_square(self._of_noise(self._motion[seen], rows)), _square(white)]
        if not len(self._windows):
            return np.array(powers)
        baseline, *shifts = self._shifts(np.arange(first, rows.stop) + 1)
        sums, kept = np.cumsum(white, axis=0), self._past.shape[1]
        past = np.concatenate([self._past, np.stack([sums, self._of_noise(baseline, rows)])], axis=1)
        for window, shift in zip(self._windows.tolist(), shifts, strict=True):
            if window > min(kept, rows.start - self._lags):  # where motion begins, windows are shorter
                powers.append(_square(self._of_noise(shift, rows)))
            else:
                before, base = past[:, kept - window : kept - window + len(rows)]
                powers.append(_square((past[0, kept:] - before) / window + base))
        self._past = past[:, -_KEPT:].copy()
        self._past[0] -= sums[-1]
        return np.array(powers)

    def _of_noise(self, motion: FloatArray, rows: range) -> FloatArray:
        """Return F' phi(k) of some rows, of motion up to them from `lags` before; there was none before it began."""
        nothing = np.zeros((len(rows) + self._lags - 1 - len(motion), motion.shape[1]))
        phi = regressors(np.concatenate([nothing, motion]), self._lags)
        return np.concatenate([phi[:, first:] @ columns for first, columns in self._root], axis=1)

    def _shifts(self, end: IntArray) -> FloatArray:
        """Return, of every window, the mean of its rows less that of up to the baseline's before, at each end.

        Of one without rows first, which has the baseline alone.
        """
        begin = np.maximum(end - np.append(0, self._windows)[:, np.newaxis], 0)
        first = np.maximum(begin - self._baseline, 0)
        middle = self._sums[begin]
        recent = (self._sums[end] - middle) / np.maximum(end - begin, 1)[..., np.newaxis]
        return np.asarray(recent - (middle - self._sums[first]) / np.maximum(begin - first, 1)[..., np.newaxis])


def _columns(root: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Yield F some columns at a time, without the rows of 0 that they begin with, and their number: half a triangle."""
    for start in range(0, len(root), _COLUMNS):
        columns = root[:, start : start + _COLUMNS]
        first = int(np.argmax(columns.any(axis=1)))
        yield first, np.ascontiguousarray(columns[first:])


def _square(rows: FloatArray) -> FloatArray:
    return np.asarray(np.vecdot(rows, rows))
