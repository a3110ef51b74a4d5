"""Doubt: how far an operator may be wrong on motion that the records it was identified on didn't hold.

A minute of flight excites few directions. On another manoeuvre the residual is then noise plus what the Markov
parameters leave open, phi(k)'(theta - theta_hat); its deviation follows from their covariance, and what is judged is
the residual over it: motion that nobody has seen widens what is normal, a fault in known motion stands out as before.
theta - theta_hat is one error at all samples, so that a window's mean of it follows from the window's mean of phi(k).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from gtmbench.detectors.bank.spread import Spread
from gtmbench.detectors.bank.statistics import Statistic
from gtmbench.method.pseudo_inputs import derive
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import FloatArray, Record

HALF = 5  # samples to either side that `slow` takes
_CUTOFF = 0.1  # of the sample rate
_CHUNK = 4096


@dataclass(frozen=True, kw_only=True, eq=False)
class Doubt:
    """What the records leave open of an operator.

    Attributes
    ----------
    root : shape (parameters, parameters)
        F, with F F' the covariance of the Markov parameters, in their units; rows: lag -d to r, input by input within.
    raw, white : float
        Variance of the model's error over that of the noise is this times |F' phi(k)|^2: of the residual as it is, and
        whitened. Found on stretches that identification hadn't seen.
    """

    root: FloatArray = field(repr=False)
    raw: float
    white: float

    def spread(self, operator: Transmissibility, record: Record, coefficients: FloatArray, test: Statistic) -> Spread:
        """Return sqrt(1 + variance of the model's error over that of the noise) at every sample.

        Parameters
        ----------
        operator : Transmissibility
        record : Record
            With the channels that the operator's inputs derive from.
        coefficients : shape (n + 1,)
            Of the whitening filter.
        test : Statistic
            Whose windows' means are judged.
        """
        motion = slow(derive(record, operator.inputs).matrix(operator.inputs) - operator.input_means)
        lags = operator.causal_order, operator.noncausal_order
        white = whitened(motion, coefficients)
        windows = test.rows(record.sample_period_s) if test.name == "glr" else []
        before = round(test.baseline_s / record.sample_period_s)
        return Spread(
            raw=np.sqrt(1.0 + self.raw * leverage(motion, *lags, self.root)),
            white=np.sqrt(1.0 + self.white * leverage(white, *lags, self.root)),
            means={rows: self.white * leverage(shifts(white, rows, before), *lags, self.root) for rows in windows},
        )


def leverage(motion: FloatArray, causal_order: int, noncausal_order: int, root: FloatArray) -> FloatArray:
    """Return |F' phi(k)|^2, row for row; at the ends, where phi isn't complete, that of the next row that is."""
    lags = causal_order + noncausal_order + 1
    found = np.zeros(len(motion))
    if len(motion) < lags:
        return found
    for start in range(0, len(motion) - lags + 1, _CHUNK):
        phi = regressors(motion[start : start + _CHUNK + lags - 1], lags)
        at = start + causal_order
        found[at : at + len(phi)] = np.square(phi @ root).sum(axis=1)
    found[:causal_order] = found[causal_order]
    found[len(motion) - noncausal_order :] = found[len(motion) - noncausal_order - 1]
    return found


def regressors(motion: FloatArray, lags: int) -> FloatArray:
    """Return phi(k), one row a complete window of `lags` samples: lag -d (the newest sample) to r, input by input."""
    windows = np.lib.stride_tricks.sliding_window_view(motion, lags, axis=0)  # (rows, inputs, lags)
    return windows[:, :, ::-1].transpose(0, 2, 1).reshape(len(windows), -1)


def shifts(motion: FloatArray, rows: int, before: int) -> FloatArray:
    """Return the mean of the last `rows` rows less that of up to `before` rows before them, row for row."""
    sums = np.concatenate([np.zeros((1, motion.shape[1])), np.cumsum(motion, axis=0)])
    end = np.arange(1, len(sums))
    begin = np.maximum(end - rows, 0)
    first = np.maximum(begin - before, 0)
    recent = (sums[end] - sums[begin]) / (end - begin)[:, np.newaxis]
    return np.asarray(recent - (sums[begin] - sums[first]) / np.maximum(begin - first, 1)[:, np.newaxis])


def whitened(motion: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return every column through a whitening filter, its first rows as if what was before had been the first row."""
    order = len(coefficients) - 1
    longer = np.concatenate([np.repeat(motion[:1], order, axis=0), motion])
    return np.column_stack([np.convolve(column, coefficients, mode="valid") for column in longer.T])


def slow(values: FloatArray) -> FloatArray:
    """Return columns freed of what lies above a tenth of the sample rate; missing samples are bridged.

    Zero phase, `HALF` samples to either side; odd reflection at the ends. Above, derivatives are mostly noise.
    """
    columns = []
    for column in values.T:
        there = np.flatnonzero(np.isfinite(column))
        if len(there) == 0:
            columns.append(np.zeros(len(column)))
            continue
        filled = np.interp(np.arange(len(column)), there, column[there])
        ends = np.pad(filled, HALF, mode="reflect", reflect_type="odd") if len(filled) > HALF else filled
        columns.append(np.convolve(ends, _taps(), mode="valid") if len(filled) > HALF else filled)
    return np.column_stack(columns)


@cache
def _taps() -> FloatArray:
    from scipy.signal import firwin

    return np.asarray(firwin(2 * HALF + 1, 2.0 * _CUTOFF, window=("kaiser", 5.0)))
