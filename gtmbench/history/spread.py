"""What earlier flights say a constant will be: a prediction interval from their spread and each one's own error.

A constant of flight i is x_i = a + k (T_i - T) + u_i + e_i: e_i of the standard deviation that the flight tells it by,
u_i of one that is the same for all flights of the airframe, k the share of the temperature where that is logged. The
spread s of u solves

    sum_i r_i^2 / (s^2 + d_i^2) = degrees of freedom

(Paule and Mandel's estimate), and is never less than what is usual of such a sensor. Gyros of one IMU are alike: what
the three have in common counts as ten flights of each one's own (Smyth's moderated variances). A new flight's constant
then follows Student's law about its prediction, with as many degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import lgamma, log, log1p, pi

import numpy as np

from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.history.entry import MISALIGNMENT, Constant, Entry, kind_of
from gtmbench.values.record import BoolArray, FloatArray, IntArray

Key = tuple[str, str]
FEWEST = 5  # flights: a spread of fewer is known to less than a factor of two
_ROUNDS = 12  # of bisection: then a spread is known to a few thousandths
_MOST = 1e4  # times the usual spread
_ALIKE = 10.0  # flights: then spreads of gyros that are alike differ by a quarter


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What a constant of the next flight is by the flights before it."""

    flights: int  # by how many
    # value, deviation: Student's law's centre and scale, the new flight's own error among it
    value: float
    deviation: float
    degrees: float  # its degrees of freedom
    spread: float  # by how much flights differ
    # low, high: the least and the greatest so far
    low: float
    high: float

    def chance(self, value: float) -> float:
        """Return how likely a value is that lies at least as far off."""
        from scipy.special import stdtr  # half a second to import

        return 2.0 * float(stdtr(self.degrees, -abs(value - self.value) / self.deviation))

    def log_density(self, value: float, tolerance: float = 0.0) -> float:
        """Return the logarithm of its probability density at a value; known to a tolerance, it is wider."""
        nu, scale = self.degrees, (self.deviation**2 + tolerance**2) ** 0.5
        top = lgamma(0.5 * (nu + 1.0)) - lgamma(0.5 * nu) - 0.5 * log(nu * pi) - log(scale)
        return top - 0.5 * (nu + 1.0) * log1p(((value - self.value) / scale) ** 2 / nu)

    def reach(self, chance: float) -> float:
        """Return how far off a value is that is as unlikely."""
        from scipy.special import stdtrit

        return -float(stdtrit(self.degrees, 0.5 * chance)) * self.deviation


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """Fits of constants over flights, weighted by the spread and each one's own error; the first axis is theirs."""

    theta: FloatArray = field(repr=False)  # shape (constants, columns)
    covariance: FloatArray = field(repr=False)  # shape (constants, columns, columns)
    # spread, degrees, shape (constants,)
    spread: FloatArray
    degrees: FloatArray


def fitted(
    values: FloatArray,
    deviations: FloatArray,
    columns: FloatArray,
    prior: FloatArray,
    least: FloatArray,
    alike: IntArray,
) -> Lines:
    """Return fits of values over flights.

    `values`, `deviations`, shape (constants, flights): NaN where a flight doesn't tell it. `columns`, shape (flights,
    columns). `prior`, shape (constants, columns): standard deviations about zero; infinite of what nothing is known of.
    Only the latter cost a degree of freedom. `least`, shape (constants,): of the spread. `alike`, shape (constants,): a
    number that those have in common which tell one spread.
    """
    there = np.isfinite(values)
    own, variance = np.where(there, values, 0.0), np.where(there, np.square(deviations), 1.0)
    degrees = there.sum(axis=1) - np.isinf(prior).sum(axis=1).astype(float)
    ridge = np.einsum("ki,ij->kij", prior**-2.0, np.eye(prior.shape[1]))

    def solved(spread: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        weights = there / (np.square(spread)[:, np.newaxis] + variance)
        covariance = np.linalg.inv(np.einsum("kn,ni,nj->kij", weights, columns, columns) + ridge)
        theta = np.einsum("kij,kn,nj,kn->ki", covariance, weights, columns, own, optimize=True)
        misfit = (weights * np.square(own - theta @ columns.T)).sum(axis=1)
        return theta, covariance, misfit

    def spreads(whose: IntArray) -> FloatArray:
        """Return the spread of each constant that those of its number have in common."""
        of = np.bincount(whose, degrees)[whose]

        def is_wider(spread: FloatArray) -> BoolArray:
            return np.asarray(np.bincount(whose, solved(spread)[2])[whose] > of)

        low, high = np.log(least), np.where(is_wider(least), np.log(_MOST * least), np.log(least))
        for _ in range(_ROUNDS):
            middle = 0.5 * (low + high)
            wider = is_wider(np.exp(middle))
            low, high = np.where(wider, middle, low), np.where(wider, high, middle)
        return np.asarray(np.exp(0.5 * (low + high)))

    of_others = np.minimum(_ALIKE, np.bincount(alike, degrees)[alike] - degrees)
    squares = degrees * spreads(np.arange(len(own))) ** 2 + of_others * spreads(alike) ** 2
    spread = np.sqrt(squares / (degrees + of_others))
    theta, covariance, _ = solved(spread)
    return Lines(theta=theta, covariance=covariance, spread=spread, degrees=degrees + of_others)


def alike_of(keys: Sequence[Key]) -> IntArray:
    """Return a number for each constant that those of one kind and one IMU have in common."""
    kinds = [
        (gyro_and_imu(sensor)[1], MISALIGNMENT if name.startswith(MISALIGNMENT) else name) for sensor, name in keys
    ]
    numbers = {kind: number for number, kind in enumerate(dict.fromkeys(kinds))}
    return np.array([numbers[kind] for kind in kinds], dtype=np.int64)


def constants_by_flight(earlier: Sequence[Entry], keys: Sequence[Key]) -> tuple[FloatArray, FloatArray]:
    """Return constants and deviations, shape (constants, flights): NaN where a flight tells none, or is apart."""
    nothing = Constant(sensor="", name="", value=np.nan, deviation=np.nan)
    told = [[nothing if key in each.apart else each.by_key.get(key, nothing) for each in earlier] for key in keys]
    shape = len(keys), len(earlier)
    values = np.array([[each.value for each in row] for row in told], dtype=np.float64).reshape(shape)
    return values, np.array([[each.deviation for each in row] for row in told], dtype=np.float64).reshape(shape)


def warmth(flights: Sequence[Entry]) -> FloatArray | None:
    """Return how much warmer flights were than on average, in K; None where one of them doesn't tell."""
    temperatures = np.array([each.temperature_c for each in flights])
    return temperatures - temperatures.mean() if len(flights) and np.isfinite(temperatures).all() else None


def predicted(earlier: Sequence[Entry], entry: Entry) -> Mapping[Key, Prediction]:
    """Return what a flight's constants are by earlier ones; none of those that fewer than five tell."""
    keys = tuple(entry.by_key)
    values, deviations = constants_by_flight(earlier, keys)
    enough = np.isfinite(values).sum(axis=1) >= FEWEST
    if not enough.any():
        return {}
    keys = tuple(key for key, is_told in zip(keys, enough, strict=True) if is_told)
    values, deviations = values[enough], deviations[enough]
    kinds = [kind_of(name) for _, name in keys]
    per_k, least = np.array([each.per_k for each in kinds]), np.array([each.spread for each in kinds])
    warmer = warmth([*earlier, entry])
    columns = np.column_stack([np.ones(len(earlier)), np.zeros(len(earlier)) if warmer is None else warmer[:-1]])
    own = np.array([1.0, 0.0 if warmer is None else warmer[-1]])
    prior = np.column_stack([np.full(len(keys), np.inf), np.maximum(per_k, 1e-9)])
    lines = fitted(values, deviations, columns, prior, least, alike_of(keys))
    # temperatures that nobody logged differ by 10 K: a standard deviation
    unlogged = per_k * 10.0 if warmer is None else 0.0 * per_k
    errors = np.array([entry.by_key[key].deviation for key in keys])
    of_line = np.einsum("i,kij,j->k", own, lines.covariance, own)
    deviation = np.sqrt(lines.spread**2 + of_line + unlogged**2 + errors**2)
    flights = np.isfinite(values).sum(axis=1)
    low, high = np.nanmin(values, axis=1), np.nanmax(values, axis=1)
    return {
        key: Prediction(
            flights=int(flights[at]),
            value=float(lines.theta[at] @ own),
            deviation=float(deviation[at]),
            degrees=float(lines.degrees[at]),
            spread=float(lines.spread[at]),
            low=float(low[at]),
            high=float(high[at]),
        )
        for at, key in enumerate(keys)
    }
