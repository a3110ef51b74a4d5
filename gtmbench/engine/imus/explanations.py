"""Gyros of a further IMU that are off: by the same kinds as those that are watched, whoever drives the attitude."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from gtmbench.engine.effect import Effect
from gtmbench.engine.explanation import TIMES_S, Explanation
from gtmbench.engine.explanations import bias, drift, noise, scale
from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.imu import Imu, gyro_of, rough_of
from gtmbench.values.record import FloatArray

_USUAL_S, _LEAST_POWER = 10.0, 1e-3  # over which shares are told, in (deg/s)^2
_KINDS = (bias, drift, scale)
_FADES_S = (0.0, TIMES_S[1])  # IMUs part at once; of the attitude it is enough to know about how it follows


def explanations(flight: Flight) -> list[Explanation]:
    """Return them for each gyro of each further IMU, of sizes as those of the watched ones."""
    return [
        each
        for imu in flight.imus
        for each in (*_of(flight.by(_as_watched(imu, flight)), imu), *map(_noise, imu.channels))
    ]


def _noise(channel: str) -> Explanation:
    """Return a gyro that gets noisy, of size one in the logarithm of its power."""
    effect = partial(_rougher, channel=channel)
    return Explanation(suspect=channel, kind="noise", effect=effect, price=noise.PRICE, low=0.0, least=noise.LEAST)


def _rougher(flight: Flight, *, channel: str) -> Effect:
    return Effect(channels={rough_of(channel): np.ones(len(flight))})


def _as_watched(imu: Imu, flight: Flight) -> Imu:
    """Return an IMU that reads of each turn what it usually does of one that the watched IMU reads.

    Its own noise is in y, and would explain itself as a gain; the watched one's is in the regressors as well.
    """
    width = max(round(_USUAL_S / flight.blocks.period_s), 2)
    read, watched = np.nan_to_num(imu.gyros), flight.gyros
    mean, of_watched = about(read, width), about(watched, width)
    shared = about(read * watched, width) - mean * of_watched
    power = about(watched**2, width) - of_watched**2
    share = shared / np.maximum(power, _LEAST_POWER)
    return replace(imu, gyros=mean + share * (watched - of_watched))


def _of(own: Flight, imu: Imu) -> Iterator[Explanation]:
    for kind in _KINDS:
        for each in (one for one in kind.explanations(own) if one.fades_s in _FADES_S):
            yield replace(
                each,
                suspect=gyro_of(each.suspect, imu.name),
                base=each.base and _named(each.base, imu),
                effect=partial(_moved, own=own, imu=imu, effect=each.effect),
            )


def about(values: FloatArray, width: int) -> FloatArray:
    """Return means of so many rows about each, fewer at the ends.

    >>> about(np.array([1.0, 2.0, 6.0, 7.0]), 3).tolist()
    [1.5, 3.0, 5.0, 6.5]
    """
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    rows = np.arange(len(values))
    first, last = np.maximum(rows - width // 2, 0), np.minimum(rows + (width + 1) // 2, len(values))
    return np.asarray((sums[last] - sums[first]) / (last - first).reshape(-1, *[1] * (values.ndim - 1)))


def _named(base: str, imu: Imu) -> str:
    """Return the name of an explanation as it is of an IMU's gyro."""
    gyro, _, rest = base.partition(" ")
    return f"{gyro_of(gyro, imu.name)} {rest}"


def _moved(_: Flight, *, own: Flight, imu: Imu, effect: Callable[[Flight], Effect]) -> Effect:
    """Return an effect of a flight that is watched by an IMU as one of the IMU's channels."""
    said = effect(own)
    wrong = said.gyros if said.gains is None else said.gains
    channels = None if wrong is None else dict(zip(imu.channels, wrong.T, strict=True))
    return Effect(channels=channels, turned=said.turned, turning=said.turning)
