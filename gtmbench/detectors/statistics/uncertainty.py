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
from gtmbench.method.regression.equations import fir, held, reflected, regressors, smoothed
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, Record

_CHUNK, _CHUNK_OF_FEW = 512, 2048  # rows: what they are turned into stays in the cache
_KEPT = 1024  # rows whose F' phi(k) is remembered: some 10 MB
_COLUMNS = 64  # of F, at a time
_Flags = np.ndarray[tuple[int], np.dtype[np.bool_]]


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
        """Return sqrt(1 + variance of the model's error over that of the noise) at every sample, or at some.

        A row stands on samples up to `half` + d after it (one more for derivatives). The record's last rows lack some:
        there motion is taken to go on by odd reflection. Who watches judges a row only once it is known.

        `record`: with the channels that the operator's inputs derive from. `coefficients`, shape (n + 1,): of the
        whitening filter. `test`: whose windows' means are judged. `rows`: only of these samples: of others, what costs
        most isn't worked out.
        """
        first, stop, _ = rows.indices(len(record))
        stream = SpreadStream(operator, self, coefficients, test, record.sample_period_s, first=first)
        inputs = derive(record, operator.inputs).matrix(operator.inputs)
        told = stream.push(inputs[: stop + self.half + operator.noncausal_order])
        return Spread.joined([told, stream.end()]).between(slice(first, stop))

    def weighed(self, alone: Spread) -> Spread:
        """Return the spread of rows from the one that factors of 1 give them."""
        return Spread(
            raw=np.sqrt(1.0 + self.raw * (alone.raw**2 - 1.0)),
            white=np.sqrt(1.0 + self.white * (alone.white**2 - 1.0)),
            means={rows: self.white * variance for rows, variance in alone.means.items()},
        )


class SpreadStream:
    """The spread of a residual as its operator's inputs come in; memory doesn't grow.

    Motion is slow motion about the operator's means, whitened motion the same behind the whitening filter, and

    - raw, white: sqrt(1 + f |F' phi(k)|^2), f its factor, phi(k) the window k-r..k+d of (whitened) motion;
    - means: f |F' (mean of phi over a window's rows - that over the baseline's before)|^2.

    F' (mean of phi over L rows) is the mean of F' phi, which is there for the whitened motion: so the means of short
    windows cost no products of their own. Those of long ones, and of rows about motion's first, are worked out as they
    stand above, from sums of the motion: F' phi has a hundred times its columns, and isn't remembered for so long.

    A missing sample is bridged by the last one before it. Rows whose window phi(k) isn't complete have no residual, and
    a spread of 1. Motion begins with the first row that is complete, or the one before (a derivative lacks its first).

    `coefficients`, shape (n + 1,): of the whitening filter. `test`: whose windows' means are judged (of ``glr``; the
    others judge none). `first`: the first row whose spread is asked for: those before have one of 1.
    """

    def __init__(
        self,
        operator: Transmissibility,
        uncertainty: ParameterUncertainty,
        coefficients: FloatArray,
        test: Statistic,
        sample_period_s: float,
        first: int = 0,
    ) -> None:
        self._root = list(_columns(uncertainty.root))
        self._rows_at_once = _CHUNK_OF_FEW if len(uncertainty.root) <= _COLUMNS else _CHUNK
        self._first = first
        self._half = uncertainty.half
        self._means = operator.input_means
        self._ahead = operator.noncausal_order
        self._lags = operator.causal_order + operator.noncausal_order + 1
        self._coefficients = coefficients
        self._windows = np.array(test.rows(sample_period_s) if test.name == "glr" else [], dtype=int)
        self._factors = np.array([[uncertainty.raw], *[[uncertainty.white]] * (1 + len(self._windows))])
        self._before = round(test.baseline_s / sample_period_s)
        inputs = len(operator.inputs)
        self._count = self._given = 0  # rows pushed, rows whose spread was returned
        self._last = np.zeros((0, inputs))  # the row before, bridged once motion has begun
        self._gap = -1  # the last row that isn't complete, counted from where motion began
        self._rows = 0  # since then
        self._complete: _Flags = np.zeros(0, dtype=bool)  # phi(k) of rows whose slow motion isn't known yet
        self._motion = np.zeros((0, inputs))  # the last 2 `half` rows
        self._slow: FloatArray | None = None  # the last n rows
        self._sums = _Sums(inputs, int(self._windows.max(initial=0)) + self._before + 1)  # of whitened motion
        # motion, whitened, less the mean of its baseline, shifts of its windows' means
        self._phi = np.zeros((3 + len(self._windows), self._lags - 1, inputs))
        # F' phi(k) of the last rows, the newest last: summed up from the newest, of whitened motion; of its baseline
        self._past = np.zeros((2, 0, len(uncertainty.root)))

    def push(self, inputs: FloatArray) -> Spread:
        """Return the spread of the rows that became known: all but the last `half` + d of those pushed so far.

        `inputs`, shape (rows, inputs): the next rows of the operator's inputs, derived, in its order and units; NaN
        where they are missing.
        """
        starts = range(0, max(len(inputs), 1), self._rows_at_once)
        return self._spread([self._step(inputs[start : start + self._rows_at_once]) for start in starts])

    def end(self) -> Spread:
        """Return the spread of the rows that are left, as if motion went on by odd reflection."""
        left = np.zeros((len(self._factors), self._count - self._given))
        there = max(self._count - self._ahead - self._given, 0)
        if self._half and self._slow is not None and there:
            left[:, :there] = self._leverage(reflected(self._motion), self._given + there)[:, -there:]
        self._given = self._count
        return self._spread([left])

    def _spread(self, parts: Sequence[FloatArray]) -> Spread:
        raw, white, *means = self._factors * (parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1))
        means_of = dict(zip(self._windows.tolist(), means, strict=True))
        return Spread(raw=np.sqrt(1.0 + raw), white=np.sqrt(1.0 + white), means=means_of)

    def _step(self, inputs: FloatArray) -> FloatArray:
        """Return |F' phi(k)|^2 of the rows that became known, 0 where phi isn't complete; shape (2 + windows, rows)."""
        self._count += len(inputs)
        known = max(self._count - self._ahead - self._half, 0)
        leverage = self._leverage(self._bridged(inputs - self._means), known)
        new, self._given = known - self._given, known
        if leverage.shape[1] >= new:
            return leverage[:, leverage.shape[1] - new :]
        return np.concatenate([np.zeros((len(leverage), new - leverage.shape[1])), leverage], axis=1)

    def _bridged(self, motion: FloatArray) -> FloatArray:
        """Return the rows since motion began with their gaps bridged, and note whose window is complete."""
        there = np.isfinite(motion).all(axis=1)
        if not self._rows:
            motion, there = (
                np.concatenate([self._last, motion]),
                np.concatenate([np.zeros(len(self._last), bool), there]),
            )
            first = max(int(np.argmax(there)) - 1, 0) if there.any() else len(there)
            self._last = motion[-1:]
            motion, there = held(motion[first:]), there[first:]
        elif not there.all():
            motion = held(np.concatenate([self._last, motion]))[1:]
        if len(motion):
            rows = np.arange(self._rows, self._rows + len(motion))
            gaps = np.maximum.accumulate(np.where(there, self._gap, rows))
            self._complete = np.concatenate([self._complete, rows - gaps >= self._lags])
            self._last, self._gap, self._rows = motion[-1:], int(gaps[-1]), self._rows + len(motion)
        return motion

    def _leverage(self, motion: FloatArray, known: int) -> FloatArray:
        """Return |F' phi(k)|^2 of the rows that these rows complete, the newest last: the last of so many known."""
        slow = self._slowed(motion) if self._half else motion
        if not len(slow):
            return np.zeros((len(self._factors), 0))
        order = len(self._coefficients) - 1
        before = np.repeat(slow[:1], order, axis=0) if self._slow is None else self._slow
        longer = np.concatenate([before, slow])
        self._slow = longer[len(slow) :]
        white = fir(longer, self._coefficients)
        new = np.concatenate([slow[np.newaxis], white[np.newaxis], self._shifts(white)])
        phi = np.concatenate([self._phi, new], axis=1)
        self._phi = phi[:, len(slow) :]
        complete, self._complete = self._complete[: len(slow)], self._complete[len(slow) :]
        powers = np.zeros((len(self._factors), len(slow)))
        if known > self._first - self._rows_at_once:  # so that the first that are asked for find rows to sum
            white = self._of_noise(phi[1])
            past = self._remembered(white, phi[2])
            if known > self._first:
                powers[:, complete] = self._powers(phi, white, past)[:, complete]
        return powers

    def _remembered(self, white: FloatArray, baseline: FloatArray) -> FloatArray:
        """Return `_past` with further rows, summed up from the last of those before, and remember the last of it."""
        if not len(self._windows):
            return self._past
        sums = np.cumsum(white, axis=0)
        past = np.concatenate([self._past, np.stack([sums, self._of_noise(baseline)])], axis=1)
        self._past = past[:, -_KEPT:].copy()
        self._past[0] -= sums[-1]
        return past

    def _powers(self, phi: FloatArray, white: FloatArray, past: FloatArray) -> FloatArray:
        """Return |F' phi(k)|^2 of motion, of whitened motion and of every window's shift of its mean."""
        powers = [_square(self._of_noise(phi[0])), _square(white)]
        rows, kept = len(white), past.shape[1] - len(white)
        summable = min(kept, self._sums.rows - rows - self._lags)  # where motion begins, windows are shorter
        for window, shift in zip(self._windows.tolist(), phi[3:], strict=True):
            if window > summable:
                powers.append(_square(self._of_noise(shift)))
            else:
                before, baseline = past[:, kept - window : kept - window + rows]
                powers.append(_square((past[0, kept:] - before) / window + baseline))
        return np.array(powers)

    def _of_noise(self, motion: FloatArray) -> FloatArray:
        """Return F' phi(k) of the rows that have all lags before them."""
        phi = regressors(motion, self._lags)
        return np.concatenate([phi[:, first:] @ columns for first, columns in self._root], axis=1)

    def _slowed(self, motion: FloatArray) -> FloatArray:
        """Return the slow motion of the rows that these rows complete."""
        motion = np.concatenate([self._motion, motion])
        if self._slow is None and len(motion) > HALF:
            motion = np.concatenate([reflected(motion[: HALF + 1][::-1])[::-1], motion])
        self._motion = motion[max(len(motion) - 2 * HALF, 0) :]
        return smoothed(motion)

    def _shifts(self, white: FloatArray) -> FloatArray:
        """Return, of every window, the mean of its rows less that of up to the baseline's before, row for row.

        Of one without rows first, which has the baseline alone.
        """
        self._sums.append(white)
        end = np.arange(self._sums.rows - len(white), self._sums.rows) + 1
        begin = np.maximum(end - np.append(0, self._windows)[:, np.newaxis], 0)
        first = np.maximum(begin - self._before, 0)
        middle = self._sums.at(begin)
        recent = (self._sums.at(end) - middle) / np.maximum(end - begin, 1)[..., np.newaxis]
        return np.asarray(recent - (middle - self._sums.at(first)) / np.maximum(begin - first, 1)[..., np.newaxis])


def _columns(root: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Yield F some columns at a time, without the rows of 0 that they begin with, and their number: half a triangle."""
    for start in range(0, len(root), _COLUMNS):
        columns = root[:, start : start + _COLUMNS]
        first = int(np.argmax(columns.any(axis=1)))
        yield first, np.ascontiguousarray(columns[first:])


def _square(rows: FloatArray) -> FloatArray:
    return np.asarray(np.vecdot(rows, rows))


class _Sums:
    """Sums of the first 0, 1, 2, ... rows; the last `keep` of them are remembered."""

    def __init__(self, columns: int, keep: int) -> None:
        self._values = np.zeros((2 * keep + _CHUNK_OF_FEW, columns))
        self._keep, self._first, self.rows = keep, 0, 0

    def append(self, rows: FloatArray) -> None:
        """Go on by some rows, at most `_CHUNK_OF_FEW`."""
        last = self.rows - self._first
        if last + len(rows) >= len(self._values):
            self._values[: self._keep] = self._values[last + 1 - self._keep : last + 1].copy()
            self._first += last + 1 - self._keep
            last = self._keep - 1
        self._values[last + 1 : last + 1 + len(rows)] = rows
        part = self._values[last : last + 1 + len(rows)]
        part[:] = np.cumsum(part, axis=0)
        self.rows += len(rows)

    def at(self, rows: np.ndarray[tuple[int, ...], np.dtype[np.int_]]) -> FloatArray:
        """Return the sums of the first so many rows."""
        return np.asarray(self._values[rows - self._first])
