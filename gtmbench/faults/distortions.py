"""What sensors make of a signal: formulas that faults and healthy imperfections share.

What is drawn at a sample depends on a seed and on the sample's number since the onset, and on nothing else: not on the
record's length, nor on where it is cut, nor on whether an array or a stream asks.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, Literal, overload

import numpy as np

from gtmbench.values.attitude_estimators import filtered
from gtmbench.values.clock import FloatArray, Value

Distribution = Literal["standard_normal", "random"]  # by the name of a generator's method; random: uniform on [0, 1)

_BLOCK = 1024  # numbers that are drawn together, and kept


def drawn(distribution: Distribution, seed: int, name: str, places: Value) -> Value:
    """Return the numbers at some places, 0, 1, ..., of the sequence of a seed and a name.

    `places`: whole numbers, not negative, in rising order.

    >>> whole = drawn("random", 7, "noise of p", np.arange(3000.0))
    >>> drawn("random", 7, "noise of p", 2500.0) == whole[2500].item()
    True
    """
    if isinstance(places, float):
        number, row = divmod(int(places), _BLOCK)
        return _block(distribution, seed, name, number).item(row)
    if not len(places):
        return np.zeros(0)
    numbers, rows = np.divmod(places.astype(np.int64), _BLOCK)
    first = np.searchsorted(numbers, np.unique(numbers))
    parts = np.split(rows, first[1:])
    return np.concatenate(
        [_block(distribution, seed, name, int(numbers[at]))[part] for at, part in zip(first, parts, strict=True)]
    )


@lru_cache(maxsize=64)
def _block(distribution: Distribution, seed: int, name: str, number: int) -> FloatArray:
    generator = np.random.default_rng([seed, number, *name.encode()])
    return np.asarray(getattr(generator, distribution)(_BLOCK))


Carried = tuple[float, float, float]
NOTHING: Carried = (math.nan, 0.0, 0.0)  # what a lag carries before its first sample


@overload
def clipped(y: float, low: float, high: float) -> float: ...
@overload
def clipped(y: FloatArray, low: FloatArray | float, high: FloatArray | float) -> FloatArray: ...
def clipped(y: Any, low: Any, high: Any) -> Any:
    """Return min(max(y, low), high) of a float, or of an array; NaN stays.

    >>> clipped(3.0, -1.0, 1.0), clipped(np.array([-3.0, 0.5]), -1.0, 1.0)
    (1.0, array([-1. ,  0.5]))
    """
    if isinstance(y, float):
        return low if y < low else high if y > high else y
    return np.clip(y, low, high)


def followed(at: Value, y: Value, step: float) -> Value:
    """Return at + clip(y - at, +-step), exactly y where that is near; of two, one of which is missing, the other.

    >>> followed(0.0, 3.0, 2.0), followed(2.0, 3.0, 2.0)
    (2.0, 3.0)
    >>> followed(np.zeros(3), np.array([1.0, 3.0, np.nan]), 2.0), followed(np.full(1, np.nan), np.ones(1), 2.0)
    (array([1., 2., 0.]), array([1.]))
    """
    if not isinstance(y, float):
        moved = np.where(np.abs(y - at) <= step, y, at + np.clip(y - at, -step, step))
        return np.where(np.isnan(y), at, np.where(np.isnan(at), y, moved))
    move = y - at
    if move > step:
        return at + step
    if move < -step:
        return at - step
    return y if y == y else at


def rate_limited(values: FloatArray, step: float, start: float) -> tuple[FloatArray, float]:
    """Return y_b(k) = y_b(k-1) + clip(y(k) - y_b(k-1), +-step), from y_b(-1) = start, and its last value.

    NaN stays and is passed over; a start that is NaN lets the first value pass. Only samples that are held back are
    looked at one by one.

    >>> rate_limited(np.array([0.0, 3.0, 3.0]), 2.0, 0.0)
    (array([0., 2., 3.]), 3.0)
    """
    there = ~np.isnan(values)
    path = np.concatenate([[start], values[there]])
    with np.errstate(invalid="ignore"):  # of two infinities
        leaps = np.flatnonzero(np.abs(np.diff(path)) > step) + 1
    y, done = path.tolist(), 0
    for leap in leaps.tolist():
        at = y[leap - 1]
        for row in range(leap, len(y)) if leap > done else ():
            path[row] = at = followed(at, y[row], step)
            done = row
            if at == y[row]:  # it has caught up
                break
    limited = values.copy()
    limited[there] = path[1:]
    return limited, float(path[-1])


def lagged(
    values: FloatArray, lag_s: float, sample_period_s: float, carried: Carried = NOTHING
) -> tuple[FloatArray, Carried]:
    """Return a signal behind a first-order lag tau y' + y = u, and what is carried into the next stretch.

    The signal runs straight from sample to sample, and on these ramps (so on held signals, too) the solution is exact:
    with a = exp(-Ts/tau) and g = (1 - a) tau/Ts,

        y(k) = a y(k-1) + (1 - g) u(k) + (g - a) u(k-1).

    Holding u(k-1) over the step instead would add half a sample of delay, as much as a lag of 5 ms does at 100 Hz.
    Carried are the value in which it was at rest, and u and y of the last sample from there; with nothing carried it is
    in rest at the first sample. Missing samples are passed over.

    >>> lagged(np.arange(4.0), 1e-4, 1.0)[0].round(4)
    array([0.    , 0.9999, 1.9999, 2.9999])
    """
    rest, *last = carried
    there = np.isfinite(values)
    behind = values.copy()
    if there.any():
        kept = values[there]
        rest = float(kept[0]) if math.isnan(rest) else rest
        a, now, before = _lag_gains(lag_s, sample_period_s)
        # the filter starts from zero, and so at rest, when it sees what has changed since
        moved = filtered([now, before], [1.0, -a], kept - rest, (last[0], last[1]))
        behind[there] = rest + moved
        last = [float(kept[-1] - rest), float(moved[-1])]
    return behind, (rest, last[0], last[1])


def lagged_sample(u: float, lag_s: float, sample_period_s: float, carried: Carried) -> tuple[float, Carried]:
    """Return `lagged` of one sample."""
    rest, asked, moved = carried
    if not math.isfinite(u):
        return u, carried
    rest = u if math.isnan(rest) else rest
    a, now, before = _lag_gains(lag_s, sample_period_s)
    moved = now * (u - rest) + before * asked + a * moved
    return rest + moved, (rest, u - rest, moved)


@lru_cache(maxsize=64)
def _lag_gains(lag_s: float, sample_period_s: float) -> tuple[float, float, float]:
    """Return the weights of y(k-1), u(k) and u(k-1)."""
    a = math.exp(-sample_period_s / lag_s)
    g = -math.expm1(-sample_period_s / lag_s) * lag_s / sample_period_s
    return a, 1.0 - g, g - a


def quantised(values: Value, quantum: float) -> Value:
    """Return values rounded to whole multiples of a quantum; of a float, or of an array.

    >>> quantised(np.array([-0.2, 0.3, 0.9]), 0.5)
    array([0. , 0.5, 1. ])
    """
    number = values / quantum
    whole = round(number) if isinstance(number, float) and math.isfinite(number) else np.rint(number)
    return whole * quantum + 0.0  # a sensor doesn't read -0


def random_walk(
    draws: FloatArray, gain: float, sample_period_s: float, start: float | None = None
) -> tuple[FloatArray, float | None]:
    """Return a random walk of deviation gain sqrt(t), and where it is at the end, in units of gain sqrt(Ts).

    It is made of a standard normal draw a sample. With no start it is 0 at the first sample, whose draw is unused: no
    time has passed.

    >>> random_walk(np.ones(3), 2.0, 0.25)
    (array([0., 1., 2.]), 2.0)
    """
    if not len(draws):
        return draws, start
    steps = draws.copy()
    steps[0] = 0.0 if start is None else start + steps[0]
    walk = np.cumsum(steps)
    return gain * math.sqrt(sample_period_s) * walk, float(walk[-1])
