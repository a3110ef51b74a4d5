"""The prediction-error method for IIR models of one output: an innovations form of order n is an ARMAX(n, n, n)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg
import scipy.signal

from gtmbench.values.record import FloatArray, Record, frozen
from theory.iir import Channels, IirModel, innovations, lagged, model_of, regressor, signals, solve

_LONG = 30  # lags, at least, of the ARX model that the search starts from
_FEW = 10  # iterations, after which the better start is chosen
_SETTLED = 1e-6  # a step that gains less of the criterion is the last; noise moves it by 1 / samples
_EDGE = 0.999  # how near to the circle C's roots may start
_STUCK = 1e10  # damping at which no step goes down any more


def pem(record: Record, *, order: int, channels: Channels = ("u", "y"), most_iterations: int = 100) -> IirModel:
    """Return the model whose innovations, (3.66), have the least mean square over k = n..l, (3.88).

    A(q) y(k) = B(q) u(k) + C(q) e(k) + offset, C with all its roots inside the unit circle. A is free: the predictor
    doesn't need it stable. Found by Levenberg and Marquardt's method from the better of two starts: least squares
    (C = 1), and least squares with the errors of a long ARX model for e (Hannan and Rissanen). Beyond the plant's order
    there are many minima, which differ by less than noise does.

    Raises
    ------
    InputError
        As `arx`.

    Examples
    --------
    >>> u, e = np.random.default_rng(1).standard_normal((2, 5000))
    >>> y = scipy.signal.lfilter([0.0, 1.0], [1.0, -0.5], u) + scipy.signal.lfilter([1.0, 0.3], [1.0, -0.5], e)
    >>> model = pem(Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=1.0), order=1)
    >>> model.denominator.round(1), model.numerator.round(1), model.noise_numerator.round(1)
    (array([ 1. , -0.5]), array([0., 1.]), array([1. , 0.3]))
    """
    measured = signals(record, channels, order, 8 * order + 8)
    means = [float(values.mean()) for values in measured]  # without them the offset hardly depends on the rest
    u, y = (values - mean for values, mean in zip(measured, means, strict=True))
    least = model_of(solve(regressor(u, y, order), y[order:]), record, channels)
    started = [_searched(start, u, y, _FEW) for start in (least, _two_stage(least, u, y))]
    best = min(started, key=lambda model: _squares(model, u, y))
    fitted = best if best.converged else _searched(best, u, y, most_iterations)
    offset = fitted.offset + float(fitted.denominator.sum() * means[1] - fitted.numerator.sum() * means[0])
    return replace(fitted, offset=offset)


def _searched(model: IirModel, u: FloatArray, y: FloatArray, most_iterations: int) -> IirModel:
    """Go down; steps that don't, or that leave C unstable, are damped more."""
    damping, least = 1e-4, _squares(model, u, y)
    for _ in range(most_iterations):
        slope, errors = _slope(model, u, y)
        scale = np.maximum(np.linalg.norm(slope, axis=0), np.finfo(float).tiny)
        products = slope.T @ slope / np.outer(scale, scale)
        gradient = slope.T @ errors / scale
        before = least
        while least >= before:
            if damping > _STUCK:
                return replace(model, converged=True)
            damped = products + damping * np.eye(len(products))
            tried = _moved(model, -scipy.linalg.solve(damped, gradient, assume_a="pos") / scale)
            least = _squares(tried, u, y) if _stable(tried) else np.inf
            damping *= 10.0
        model, damping = tried, max(damping / 100.0, 1e-12)
        if before - least <= _SETTLED * before:
            return replace(model, converged=True)
    return replace(model, converged=False)


def _squares(model: IirModel, u: FloatArray, y: FloatArray) -> float:
    errors = innovations(model, u, y)
    return float(errors @ errors)


def _stable(model: IirModel) -> bool:
    return bool(np.all(np.abs(np.roots(model.noise_numerator)) < 1.0))


def _moved(model: IirModel, step: FloatArray) -> IirModel:
    """Return the model of theta + step; theta = (a, b, c, offset)."""
    a, b, c = np.pad(step[:-1].reshape(3, -1), ((0, 0), (1, 0)))
    return replace(
        model,
        denominator=frozen(model.denominator + a),
        numerator=frozen(model.numerator + b),
        noise_numerator=frozen(model.noise_numerator + c),
        offset=model.offset + float(step[-1]),
    )


def _slope(model: IirModel, u: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return de(k)/dtheta, k = n..l, one column a parameter, and e(k).

    They are y, -u and -e, lagged, and -1, all filtered by 1/C from k = n on. So the column of lag i + 1 is that of lag
    i a sample later, and what its own first sample, y(n-i-1) or u(n-i-1), excites besides.
    """
    n, errors = model.order, innovations(model, u, y)
    begins = np.vstack([y[n - 1 : -1], u[n - 1 : -1], errors, np.ones(len(errors)), np.eye(1, len(errors))[0]])
    of_y, of_u, of_e, of_one, impulse = scipy.signal.lfilter([1.0], model.noise_numerator, begins)
    columns = np.zeros((3 * n + 1, len(errors)))
    columns[0], columns[n], columns[-1] = of_y, -of_u, -of_one
    for i in range(1, n):
        columns[i], columns[n + i] = y[n - 1 - i] * impulse, -u[n - 1 - i] * impulse
        columns[[i, n + i], 1:] += columns[[i - 1, n + i - 1], :-1]
    for i in range(n):
        columns[2 * n + i, i + 1 :] = -of_e[: -1 - i]
    return columns.T, errors


def _two_stage(least: IirModel, u: FloatArray, y: FloatArray) -> IirModel:
    """Return the model of least squares with the errors of a long ARX model for e.

    Roots of C are reflected into the circle, which leaves e as white as it was.
    """
    n = least.order
    length = min(max(_LONG, 2 * n), len(y) // 4)
    columns = regressor(u, y, length)
    errors = y[length:] - columns @ solve(columns, y[length:])
    theta = solve(np.hstack([regressor(u[length:], y[length:], n), lagged(errors, n)]), y[length + n :])
    a, b, (offset, *c) = np.split(theta, [n, 2 * n])
    roots = np.roots(np.concatenate([[1.0], c]))
    size = np.maximum(np.abs(roots), np.finfo(float).tiny)
    noise = np.poly(roots / size * np.minimum(np.minimum(size, 1.0 / size), _EDGE)).real
    return replace(
        least,
        denominator=frozen(np.concatenate([[1.0], a])),
        numerator=frozen(np.concatenate([[0.0], b])),
        noise_numerator=frozen(noise),
        offset=float(offset),
    )
