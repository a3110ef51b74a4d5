"""Two-output Hammerstein systems, chapter 6: what least squares between the outputs tends to, and how fast.

u is white, w_1 = N_1(u), w_2 = N_2(u), y_1 = G_1 w_1, y_2 = G_2 w_2. By Theorem 7 an FIR model from y_1 to y_2 tends to
gamma theta', with theta' the Markov parameters of G_2/G_1. The proof passes through expectations of ratios,
(6.21)-(6.23), which needn't exist. A shorter way: w_2 = E w_2 + gamma w_1 + e, with gamma of (6.29) and e white, of
mean 0, uncorrelated with w_1. So y_2 is gamma G_2/G_1 y_1 + G_2 e and a constant, and G_2 e is uncorrelated with every
sample of y_1: to least squares it is noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from scipy.linalg import toeplitz
from scipy.signal import correlate
from scipy.stats.distributions import rv_frozen

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray, frozen
from theory.state_space import StateSpace

Nonlinearity = Callable[[FloatArray], FloatArray]
_BREAKS = (0.0,)  # sign(u) jumps there
_NODES = 16  # of Gauss-Legendre quadrature, a panel
_COARSE, _FINE = (200, 1e-200), (400, 1e-300)  # panels between breaks; probability left out on an infinite side
_EXACT = 1e-12  # of a mean, relative to that of the magnitudes
_NIL = 1e-10  # correlations below are rounding
_FORGOTTEN = 1e-17  # what may be left of an impulse response where it is cut off


def mean(function: Nonlinearity, density: rv_frozen, breaks: tuple[float, ...] = _BREAKS) -> float:
    """Return E f(U), to 12 digits of ``E |f(U)|``.

    Parameters
    ----------
    function : callable
        f, of arrays; smooth but for the breaks.
    density : frozen distribution of scipy.stats
        Of U; continuous.
    breaks : tuple of float, optional
        Where f may jump or have a kink.

    Raises
    ------
    InputError
        Where f(U) has no finite mean, or isn't smooth somewhere else.

    Examples
    --------
    >>> from scipy.stats import norm, uniform
    >>> round(mean(np.square, uniform(-3.0, 6.0)), 12), round(mean(np.square, norm()), 12)
    (3.0, 1.0)
    """
    with np.errstate(over="ignore", invalid="ignore"):
        coarse, fine = (function(u) * w for u, w in (_nodes(density, breaks, *how) for how in (_COARSE, _FINE)))
    first, refined = float(np.sum(coarse)), float(np.sum(fine))
    if not abs(refined - first) <= _EXACT * np.sum(np.abs(fine)) < np.inf:
        raise InputError(
            f"a mean comes out as {first:.6g} and, with finer steps and farther out, {refined:.6g}; assumption 2 asks "
            "for finite means, so take nonlinearities that grow less, and name in breaks where they jump"
        )
    return refined


def centred(function: Nonlinearity, density: rv_frozen, breaks: tuple[float, ...] = _BREAKS) -> Nonlinearity:
    """Return f - E f(U): what examples 6.5.2 and 6.5.5 do, there with the realisation's mean."""
    offset = mean(function, density, breaks)
    return lambda u: function(u) - offset


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """The two memoryless nonlinearities of Fig. 6.1, and the density of the white input that drives both.

    Attributes
    ----------
    first, second : callable
        N_1 and N_2, of arrays.
    density : frozen distribution of scipy.stats
    breaks : tuple of float, optional
        Where either may jump or have a kink.

    Raises
    ------
    InputError
        Where assumptions 2 and 3 fail: E N_1 = 0, E N_1 N_2 and E N_1^2 not 0, all finite with their variances.

    Examples
    --------
    Example 6.4.1, 7 a^4/11 with a = 2:

    >>> from scipy.stats import uniform
    >>> pair = Pair(first=lambda u: u**3, second=lambda u: u**7, density=uniform(-2.0, 4.0))
    >>> round(pair.scale, 12), round(7 * 2**4 / 11, 12)
    (10.181818181818, 10.181818181818)
    """

    first: Nonlinearity
    second: Nonlinearity
    density: rv_frozen
    breaks: tuple[float, ...] = _BREAKS

    def __post_init__(self) -> None:
        offset, power = self._mean(self.first), self._power
        for fourth in (lambda u: self.first(u) ** 4, lambda u: (self.first(u) * self.second(u)) ** 2):
            self._mean(fourth)
        if abs(offset) > _NIL * np.sqrt(power):
            raise InputError(
                f"E N_1 is {offset:.6g}; assumption 3 asks for 0, so take centred(N_1, density), the mean removed"
            )
        if abs(self._product) <= _NIL * np.sqrt(power * self._mean(lambda u: self.second(u) ** 2)):
            raise InputError(
                f"E N_1 N_2 is {self._product:.6g} and E N_1^2 is {power:.6g}; assumption 3 asks for others than 0, "
                "else y_1 tells least squares nothing of y_2: take another nonlinearity"
            )

    @cached_property
    def scale(self) -> float:
        """The factor E N_1 N_2 / E N_1^2 of (6.29): theta-hat tends to so many times theta'."""
        return self._product / self._power

    @cached_property
    def correlation(self) -> float:
        """Of N_1(U) and N_2(U), -1..1: what is missing to 1 is noise to least squares."""
        return self._product / float(np.sqrt(self._power * self._mean(lambda u: self._other(u) ** 2)))

    @cached_property
    def noise(self) -> float:
        """E e^2 / E N_1^2, with e = N_2 - E N_2 - gamma N_1."""
        return self._mean(lambda u: self._left(u) ** 2) / self._power

    @cached_property
    def excess(self) -> float:
        """(E N_1^2 e^2 - E N_1^2 E e^2) / (E N_1^2)^2: e is uncorrelated with N_1, but not independent of it."""
        return self._mean(lambda u: (self.first(u) * self._left(u)) ** 2) / self._power**2 - self.noise

    @cached_property
    def _power(self) -> float:
        return self._mean(lambda u: self.first(u) ** 2)

    @cached_property
    def _product(self) -> float:
        return self._mean(lambda u: self.first(u) * self._other(u))

    @cached_property
    def _other(self) -> Nonlinearity:
        return centred(self.second, self.density, self.breaks)

    def _left(self, u: FloatArray) -> FloatArray:
        return self._other(u) - self.scale * self.first(u)

    def _mean(self, function: Nonlinearity) -> float:
        return mean(function, self.density, self.breaks)


def without_nonlinearities(G1: StateSpace, G2: StateSpace, parameters: int) -> FloatArray:
    """Return what theta-hat of (6.4) tends to where N_1(u) = N_2(u) = u, shape (parameters,).

    These are H'_0, H'_1, ... of G_2/G_1 but for what cutting the model off costs, which falls geometrically where all
    zeros of G_1 lie inside the unit circle. Elsewhere it is the best causal FIR model, and G_2/G_1 has no such series.

    Raises
    ------
    InputError
        Where a system isn't SISO or asymptotically stable, or so few parameters are all 0 (assumptions 1 and 4).

    Examples
    --------
    >>> from theory.state_space import companion
    >>> G1, G2 = companion([1.0, -0.5], [1.0, 0.3]), companion([1.0, 0.0], [1.0, 0.3])
    >>> without_nonlinearities(G1, G2, 40)[:4].round(9)
    array([1.   , 0.5  , 0.25 , 0.125])
    """
    first, second = _responses(G1, G2)
    theta = np.linalg.solve(toeplitz(_lags(first, first, parameters)), _lags(second, first, parameters))
    if np.abs(theta).max() <= _NIL * np.linalg.norm(second) / np.linalg.norm(first):
        raise InputError(
            f"theta' of {parameters} Markov parameters is 0, against assumption 4; take more, or a G_2 that isn't 0"
        )
    return theta


def covariance(pair: Pair, G1: StateSpace, G2: StateSpace, parameters: int) -> FloatArray:
    """Return what l times the covariance of theta-hat tends to, shape (parameters, parameters); l samples.

    noise Gamma^-1 M Gamma^-1 + excess theta' theta'^T, with Gamma of (6.26), M_ij the sum over t of r_1(t+i-j) r_2(t),
    and r_1, r_2 the autocorrelations of the impulse responses. The second term comes of e that depends on N_1; it
    scales all Markov parameters alike, so normalised ones don't know it. (What the model cuts off is left out.)

    Raises
    ------
    InputError
        As `without_nonlinearities`.
    """
    first, second = _responses(G1, G2)
    theta = without_nonlinearities(G1, G2, parameters)
    gamma = toeplitz(_lags(first, first, parameters))
    both = toeplitz(_lags(correlate(first, first), correlate(second, second), parameters))
    inverse = np.linalg.inv(gamma)
    return np.asarray(pair.noise * inverse @ both @ inverse + pair.excess * np.outer(theta, theta))


def _responses(*systems: StateSpace) -> list[FloatArray]:
    """Return impulse responses of equal length, until they have died."""
    radius = 0.0
    for system in systems:
        largest = float(np.abs(system.poles).max(initial=0.0))
        if largest >= 1.0 or (system.outputs, system.inputs) != (1, 1) or not (np.any(system.D) or np.any(system.C)):
            raise InputError(
                f"{system} with poles up to |z| = {largest:.6g}; assumption 1 asks for stationary outputs, so give G_1 "
                "and G_2 that are SISO, stable and not 0"
            )
        radius = max(radius, largest)
    memory = int(np.log(_FORGOTTEN) / np.log(radius)) if radius > 0.0 else 0
    length = max(system.order for system in systems) + 1 + memory
    return [system.markov(length)[:, 0, 0] for system in systems]


def _lags(leading: FloatArray, lagging: FloatArray, count: int) -> FloatArray:
    """Return the sums over k of leading(k + i) lagging(k), arrays of equal length, for i = 0..count-1."""
    sums = correlate(leading, lagging)[len(lagging) - 1 :][: whole("parameters", count, 1)]
    return np.pad(sums, (0, count - len(sums)))


@lru_cache(maxsize=8)
def _nodes(density: rv_frozen, breaks: tuple[float, ...], panels: int, remote: float) -> tuple[FloatArray, FloatArray]:
    """Return the nodes of composite Gauss-Legendre quadrature, and the weights, densities included."""
    ends = np.array(density.support())
    low, high = np.where(np.isfinite(ends), ends, [density.ppf(remote), density.isf(remote)])
    corners = np.unique([low, *(place for place in breaks if low < place < high), high])
    edges = np.unique(np.concatenate([np.linspace(a, b, panels + 1) for a, b in pairwise(corners)]))
    x, w = np.polynomial.legendre.leggauss(_NODES)
    half = np.diff(edges)[:, np.newaxis] / 2.0
    u = (edges[:-1, np.newaxis] + half * (1.0 + x)).ravel()
    return frozen(u), frozen((half * w).ravel() * density.pdf(u))
