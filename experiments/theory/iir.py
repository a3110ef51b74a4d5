"""IIR models of one input and one output, by least squares and by instrumental variables; `pem` has the third way.

They are what the dissertation holds its FIR models against, sections 3.2 and 3.7. A model may well be unstable: nothing
here simulates its plant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg.lapack
import scipy.signal

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.method.identify import identify
from gtmbench.method.residual import Residual
from gtmbench.values.record import FloatArray, Record, check_record, frozen
from theory.state_space import StateSpace, companion

_TRUSTED = 1e-4  # of a column's length, what those before it must leave: of less, squares would lose too many digits
Channels = tuple[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class IirModel:
    """A(q) y(k) = B(q) u(k) + C(q) e(k) + offset, with white e: what arx and iv4 find (C = 1), and pem for one output.

    Strictly proper, as Matlab has it unless told otherwise. The offset takes up the means of u and y; subtracting them
    would do as well but for the ends of a record, where it costs exactness.

    Attributes
    ----------
    denominator, numerator, noise_numerator : shape (n + 1,)
        1, a_1, ..., a_n; 0, b_1, ..., b_n; 1, c_1, ..., c_n: factors of q^0, ..., q^-n.
    offset : float
        In the output's unit.
    channels : tuple of str
        Names of u and y.
    sample_period_s : float
    converged : bool
        Whether the search had settled; True where nothing is searched for.
    """

    denominator: FloatArray
    numerator: FloatArray
    noise_numerator: FloatArray
    offset: float
    channels: Channels
    sample_period_s: float
    converged: bool = True

    @property
    def order(self) -> int:
        """Degree n of the denominator."""
        return len(self.denominator) - 1

    @property
    def plant(self) -> StateSpace:
        """B/A, from u to y, in companion form: ``.poles``, ``.markov(count)``, ``.at(z)``."""
        return companion(self.numerator, self.denominator)

    def innovations(self, record: Record) -> Residual:
        """Return e(k), the error of the one-step prediction, for k = n..l; NaN before.

        The first n samples begin the recursion, with e = 0: exact where C = 1, else but for 1/C's transient.

        Raises
        ------
        InputError
            Where the record lacks a channel or has another sample period.
        """
        u, y = signals(record, self.channels, self.order, self.order + 1)
        record.check_period(self.sample_period_s, "the model was identified at")
        errors = np.full((len(y), 1), np.nan)
        errors[self.order :, 0] = innovations(self, u, y)
        return Residual(
            values=frozen(errors),
            time_s=record.time_s,
            outputs=self.channels[1:],
            look_ahead_s=0.0,
            sample_period_s=self.sample_period_s,
        )


def arx(record: Record, *, order: int, channels: Channels = ("u", "y")) -> IirModel:
    """Return the model of least squares: least sum over k = n..l of (A(q) y(k) - B(q) u(k) - offset)^2.

    Raises
    ------
    InputError
        Where a channel is missing or holds NaN, or the record is too short.

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal(100)
    >>> y = companion([1.0], [1.0, -1.1]).simulate(u[:, np.newaxis])[:, 0]  # y(k) = 1.1 y(k-1) + u(k-1)
    >>> model = arx(Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=1.0), order=1)
    >>> model.denominator.round(9), model.plant.poles.real.round(9)
    (array([ 1. , -1.1]), array([1.1]))
    """
    u, y = signals(record, channels, order, 3 * order + 1)
    return model_of(solve(regressor(u, y, order), y[order:]), record, channels)


def iv4(record: Record, *, order: int, instrument: str, reach: int = 50, channels: Channels = ("u", "y")) -> IirModel:
    """Return the model of four-stage instrumental variables.

    1. What the instrument's present and past explain of u and y, by causal FIR models of order `reach`. 2. A model,
    with the lags of that as instruments for the lags of u and y. 3. An autoregression of order 2 n of its residual.
    4. Stage 2 once more, on signals that are filtered by it.

    Matlab's iv4 begins with what a simulated ARX model makes of u, which diverges where that model is unstable; FIR
    models don't. Given the exogenous signal c for instrument, noise that is fed back into u does no harm. With u
    itself, it is Matlab's choice, consistent without feedback only.

    Raises
    ------
    InputError
        As `arx`.

    Examples
    --------
    >>> from theory.closed_loop import loop_records
    >>> from theory.plants import example_3_2
    >>> loop = example_3_2()
    >>> record = loop_records(loop.plant, loop.gain, samples=2000, snr=1e8)[0]
    >>> iv4(record, order=7, instrument="c").plant.poles.real[-3:].round(2)
    array([1.6, 1.7, 1.8])
    """
    u, y = signals(record, channels, order, 2 * reach + 7 * order + 1)
    data = np.vstack([u, y, *(_explained(record, name, instrument, reach) for name in channels)])[:, reach:]
    first = model_of(_by_instruments(data, order), record, channels)
    left = innovations(first, *data[:2])
    whitening = np.concatenate([[1.0], -solve(lagged(left, 2 * order), left[2 * order :])])
    theta = _by_instruments(scipy.signal.lfilter(whitening, 1.0, data)[:, 2 * order :], order)
    theta[-1] /= whitening.sum()
    return model_of(theta, record, channels)


def signals(record: Record, channels: Channels, order: int, needed: int) -> tuple[FloatArray, FloatArray]:
    """Return u and y, checked."""
    check_record(record)
    whole("order", order, 1)
    u, y = (record[name] for name in channels)
    for name, values in zip(channels, (u, y), strict=True):
        if not np.all(np.isfinite(values)):
            raise InputError(f"channel '{name}' misses samples; an IIR model needs a stretch without gaps")
    if len(y) < needed:
        raise InputError(f"{len(y)} samples are too few for an IIR model of order {order}; record {needed} or more")
    return u, y


def lagged(values: FloatArray, order: int) -> FloatArray:
    """Return rows x(k-1), ..., x(k-n) for k = n..l.

    >>> lagged(np.array([1.0, 2.0, 3.0, 4.0]), 2)
    array([[2., 1.],
           [3., 2.]])
    """
    return np.lib.stride_tricks.sliding_window_view(values[:-1], order)[:, ::-1]


def regressor(u: FloatArray, y: FloatArray, order: int) -> FloatArray:
    """Return what theta = (a, b, offset) multiplies to make y(k), k = n..l, but for e."""
    return np.hstack([-lagged(y, order), lagged(u, order), np.ones((len(y) - order, 1))])


def solve(columns: FloatArray, target: FloatArray) -> FloatArray:
    """Return the least-squares solution; the smallest one, of columns scaled alike, where they lack rank."""
    both = np.column_stack([columns, target])
    scale = np.linalg.norm(both, axis=0)
    scale[scale == 0.0] = 1.0
    both /= scale
    root, failed = scipy.linalg.lapack.dpotrf(both.T @ both, clean=1)
    if failed or root.diagonal().min() < _TRUSTED:
        root = np.linalg.qr(both, mode="r")
    rounding = len(both) * np.finfo(float).eps
    theta = np.linalg.lstsq(root[:, :-1], root[:, -1], rcond=rounding)[0]
    return np.asarray(theta * (scale[-1] / scale[:-1]))


def innovations(model: IirModel, u: FloatArray, y: FloatArray) -> FloatArray:
    """Return e(k), k = n..l."""
    left = np.convolve(y, model.denominator, "valid") - np.convolve(u, model.numerator, "valid") - model.offset
    return np.asarray(scipy.signal.lfilter([1.0], model.noise_numerator, left))


def model_of(
    theta: FloatArray, record: Record, channels: Channels, noise: FloatArray | None = None, *, converged: bool = True
) -> IirModel:
    """Return the model of theta = (a, b, offset) and of C; without one, C = 1."""
    order = len(theta) // 2
    return IirModel(
        denominator=frozen(np.concatenate([[1.0], theta[:order]])),
        numerator=frozen(np.concatenate([[0.0], theta[order:-1]])),
        noise_numerator=frozen(np.eye(1, order + 1)[0] if noise is None else noise),
        offset=float(theta[-1]),
        channels=channels,
        sample_period_s=record.sample_period_s,
        converged=converged,
    )


def _explained(record: Record, channel: str, instrument: str, reach: int) -> FloatArray:
    """Return what causal lags of the instrument predict of a channel; NaN for the first `reach` samples."""
    if channel == instrument:
        return record[channel]
    operator = identify(record, inputs=[instrument], outputs=[channel], causal_order=reach, noncausal_order=0)
    return operator.predict(record)[:, 0]


def _by_instruments(data: FloatArray, order: int) -> FloatArray:
    """Solve Z'y = Z'Phi theta, with Z the lags of what is explained; data: u, y, and what is explained of them."""
    u, y, u_seen, y_seen = data
    basis = np.linalg.qr(regressor(u_seen, y_seen, order))[0]
    return solve(basis.T @ regressor(u, y, order), basis.T @ y[order:])
