"""Kinematic operators, from an attitude's rates to a gyro or back: physics fixes all but lag, smoothing and noise.

What reads the same motion twice has a gain of 1 at 0 Hz, a delay, and next to no curvature about 0 Hz. These three are
the operator's moments, sum of h_i, of i h_i and of i^2 h_i; they alone tell what slow motion leaves in the residual, so
that an operator that has them right holds for faster motion than was flown. They are found first, from slow motion and
freed of the noise that shrinks them; the other directions are free to pass as little noise as the records let them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.method.regression.equations import ALIKE, Equations, about_means, autocovariance, signal_of
from gtmbench.values.record import FloatArray

_TURNS, _SETTLED = 6, 1e-4  # of the same kind, at most; a change of the variance by which it is settled
LEAST_VARIANCE = 1e-12  # of the residual, over the output's
_DECISIVE = 4.0  # deviations by which the records have to contradict what physics fixes
_TAP = 0.3  # deviation of a Markov parameter in a direction that has none of the moments
_SLOW_S = 0.15  # to either side: what is left lies below 3 Hz, where an attitude's rates hold little noise
_SHARES = (1.0, 0.5, 0.0)  # of the residual's noise that the input may hold: nobody knows


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What is expected of the moments: their means are (1, 0, `curvature`)."""

    # second moment about the delay, in samples squared: a third of a central difference, as input or as output
    curvature: float
    # gain, delay, bend: deviations of the gain, the delay (samples) and the second moment (samples squared)
    gain: float
    delay: float
    bend: float


def fit(
    samples: Sequence[Equations], *, constant: bool, lags: int, ahead: int, sample_period_s: float, expected: Expected
) -> tuple[FloatArray, FloatArray, float]:
    """Return the kinematic operator of some records: h, its covariance and the residual's variance.

    h, of shape (lags,), lag -d first, has the least residual among the operators with given moments, min ||y - U h||^2
    subject to A h = c.

    `samples`: one input, in the output's units; about their means if a `constant` is estimated. `lags`, `ahead`: r + d
    + 1 and d.
    """
    # normal equations of all records; neighbouring ones say the same on slow motion, so ALIKE count as one
    lag = np.arange(-ahead, lags - ahead, dtype=np.float64)
    products = _summed(samples, lags)
    gram, right, power = products[:-1, :-1], products[:-1, -1], float(products[-1, -1])
    count = max(sum(float(piece.weights.sum()) for piece in samples) / ALIKE, 1.0)
    half = round(_SLOW_S / sample_period_s)
    motion = [_slowed(piece, half) for piece in samples]
    motion = about_means(motion, lags)[0] if constant else motion
    mean, covariance, _ = _moments(motion, lag, expected, max(half, ALIKE))
    # A h = c: row m of A takes sum i^m h_i. Of h only what lies in A's null space is free
    among = np.vander(lag, len(mean), increasing=True).T
    wanted, slope = _raw(mean)
    inverse = np.linalg.pinv(among)
    free = np.linalg.svd(among)[2][len(wanted) :].T  # directions without any of these moments
    variance = max(power / count, LEAST_VARIANCE)
    # min ||y - U h||^2 + s^2 |z|^2 / tap^2 over h = A^+ c + N z
    for _ in range(2):  # what is left over settles with the first
        hessian = free.T @ gram @ free + variance / _TAP**2 * np.eye(free.shape[1])
        smoothing = np.eye(lags) - free @ np.linalg.solve(hessian, free.T @ gram)
        h = smoothing @ inverse @ wanted + free @ np.linalg.solve(hessian, free.T @ right)
        left = power - 2.0 * float(h @ right) + float(h @ gram @ h)
        variance = max(left / count, LEAST_VARIANCE)
    # the moments' own uncertainty, and that of the free directions, are independent
    of_moments = smoothing @ inverse @ slope
    alone = free @ np.linalg.solve(hessian, free.T) * (variance / ALIKE)
    return h, of_moments @ covariance @ of_moments.T + alone, variance


def _summed(pieces: Sequence[Equations], lags: int) -> FloatArray:
    nothing = np.zeros(lags)
    return np.asarray(sum((piece.products(nothing, lags) for piece in pieces), np.zeros((lags + 1, lags + 1))))


def _raw(mean: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the moments about 0, (g, g t, g (m + t^2)) of (g, t, m), and their derivatives."""
    if len(mean) < 3:
        return mean, np.eye(len(mean))
    g, t, m = mean.tolist()
    slope = np.array([[1.0, 0.0, 0.0], [t, g, 0.0], [m + t * t, 2.0 * g * t, g]])
    return np.array([g, g * t, g * (m + t * t)]), slope


def _slowed(piece: Equations, half: int) -> Equations:
    """Return the slow motion of a piece, so many samples to either side; of a short one, as slow as it can be."""
    width = min(half, (len(piece.y) - 1) // 4)
    taps = np.hanning(2 * width + 3)[1:-1]
    taps /= taps.sum()
    u, y = (np.convolve(values, taps, mode="valid") for values in (piece.u[:, 0], piece.y))
    return Equations(u=u[:, np.newaxis], y=y, weights=piece.weights[width : len(piece.y) - width])


# mean and covariance of (g, t, m): gain, delay and second moment about it, in samples; of few lags the gain alone; and
# which of gain and second moment the records have otherwise than physics, by their places
_Moments = tuple[FloatArray, FloatArray, Sequence[int]]


def _moments(motion: Sequence[Equations], lag: FloatArray, expected: Expected, alike: float) -> _Moments:
    """Return the moments that slow motion shows.

    y(k) = g u(k - s) + b (u(k - s))' + c (u(k - s))''/2 about a delay of s samples, b and c by differences. With so
    many equations in a row being `alike`, G = Phi'Phi and S what of it is motion, the sums Phi'e, freed of noise, are
    N(S x, v G) of what x is beside the nominal. How much of the residual's noise the input holds isn't known: as much
    as contradicts physics least, and the most of these.
    """
    lags, ahead = len(lag), int(-lag[0])
    products = _summed(motion, lags) * (ALIKE / alike)
    gram, right, power = products[:-1, :-1], products[:-1, -1], float(products[-1, -1])
    count = max(sum(float(piece.weights.sum()) for piece in motion) / alike, 1.0)
    # with fewer than three lags there is no difference to be had: the gain alone is found
    deviations = np.array([expected.gain, expected.delay, expected.bend])[: 3 if lags > 2 else 1]
    precision = np.diag(np.maximum(deviations, 1e-9) ** -2)
    shift, late = int(np.clip(0, lag[0] + 1, lag[-1] - 1)) if lags > 2 else 0, 0.0  # and what is late beside it
    h = np.eye(lags)[shift + ahead]
    for _ in range(_TURNS):
        # about the whole delay so far: the unit impulse there, the central difference and half the second one
        basis = _basis(lags, shift + ahead)
        nominal = basis[:, 0]
        prior = np.array([0.0, -shift, expected.curvature + late**2])[: len(deviations)]
        noise = autocovariance(motion, h, lags) * count
        left = power - 2.0 * float(h @ right) + float(h @ gram @ h)
        variance = max(left / count, LEAST_VARIANCE)
        own = basis.T @ gram @ basis
        found = []
        # errors in variables: the input's noise shrinks every moment by S/G, and only a share of it is known
        for share in _SHARES:
            signal = signal_of(own, share * basis.T @ noise @ basis)
            sums = basis.T @ (right - (gram - share * noise) @ nominal)
            weight = np.linalg.solve(own + 1e-9 * np.diag(_sizes(own)), signal).T / variance
            hessian = precision + weight @ signal
            step = np.asarray(np.linalg.solve(hessian, weight @ sums + precision @ prior), dtype=np.float64)
            found.append((step, _pinned(step, np.asarray(np.linalg.inv(hessian)), shift, lag, expected)))
        step, best = min(found, key=lambda each: len(each[1][2]))
        before, h = h, nominal + basis @ step
        if len(step) < 3 or np.abs(h - before).max() < _SETTLED:
            break
        # b / g is what is late beside the whole delay; beyond half a sample the whole delay moves, and all begins anew
        late = float(step[1] / (1.0 + step[0]))
        moved = int(np.clip(shift + np.rint(late), lag[0] + 1, lag[-1] - 1))
        if moved != shift:
            shift, late, h = moved, late - (moved - shift), np.eye(lags)[moved + ahead]
    return best


def _basis(lags: int, place: int) -> FloatArray:
    """Return what passes u unchanged from a place, its change with the delay, and with the second moment."""
    if lags < 3:
        return np.eye(lags)[:, [place]]
    basis = np.zeros((lags, 3))
    basis[place - 1 : place + 2] = [[0.0, -0.5, 0.5], [1.0, 0.0, -1.0], [0.0, 0.5, 0.5]]
    return basis


def _pinned(step: FloatArray, covariance: FloatArray, shift: int, lag: FloatArray, expected: Expected) -> _Moments:
    """Return the moments of a step from the nominal delay; what physics fixes as it is, unless contradicted."""
    g = 1.0 + float(step[0])
    if len(step) < 3:
        if abs(g - 1.0) > _DECISIVE * np.sqrt(covariance[0, 0]):
            return np.array([g]), covariance, [0]
        return np.ones(1), covariance, []
    b, c = step[1:].tolist()
    # y = g u(k - s) + b u' + c u''/2: a delay of t = b/g and a spread of m = c/g - t^2; their covariance by the slopes
    # of (g, t, m) over (g, b, c)
    t, m = b / g, c / g - (b / g) ** 2
    slope = np.array([[1.0, 0.0, 0.0], [-t / g, 1.0 / g, 0.0], [(2.0 * t * t - c / g) / g, -2.0 * t / g, 1.0 / g]])
    mean, covariance = np.array([g, t, m]), slope @ covariance @ slope.T
    left = covariance  # once what physics fixes is known
    contradicted = []
    # known exactly, one place moves the others as they vary with it, and less is left to vary (a conditional normal)
    for place, value in ((2, expected.curvature), (0, 1.0)):
        off = value - mean[place]
        if abs(off) > _DECISIVE * np.sqrt(covariance[place, place]):
            contradicted.append(place)
            continue
        share = left[:, place] / left[place, place]
        mean, left = mean + share * off, left - np.outer(share, left[place])
    mean[1] = np.clip(mean[1] + shift, lag[0], lag[-1])
    return mean, covariance, contradicted


def _sizes(gram: FloatArray) -> FloatArray:
    """Return the diagonal, 1 where it is 0: an attitude at rest, to the last digit, tells nothing."""
    diagonal = np.diag(gram)
    return np.where(diagonal > 0.0, diagonal, 1.0)
