"""Gyros of a further IMU that are off: by the same kinds as those that are watched, whoever drives the attitude."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from gtmbench.engine.explanation import TIMES_S, Explanation
from gtmbench.engine.explanations import gyros, noise
from gtmbench.engine.flight import Flight, means_about
from gtmbench.engine.imus.imu import FlightImu, gyro_of, rough_of
from gtmbench.engine.relation import Effect

_USUAL_S, _LEAST_POWER = 10.0, 1e-3  # over which shares are told, in (deg/s)^2
_FADES_S = (0.0, TIMES_S[1])  # IMUs part at once; of the attitude it is enough to know about how it follows


def explanations(flight: Flight) -> list[Explanation]:
    """Return them for each gyro of each further IMU, of sizes as those of the watched ones."""
    return [
        each
        for imu in flight.compared
        for each in (*_of(flight.by(_as_watched(imu, flight)), imu), *map(_noise, imu.channels))
    ]


def _noise(channel: str) -> Explanation:
    """Return a gyro that gets noisy, of size one in the logarithm of its power."""
    effect = partial(_rougher, channel=channel)
    return Explanation(suspect=channel, kind="noise", effect=effect, price=noise.PRICE, low=0.0, least=noise.LEAST)


def _rougher(flight: Flight, *, channel: str) -> Effect:
    return Effect(channels={rough_of(channel): np.ones(len(flight))})


def _as_watched(imu: FlightImu, flight: Flight) -> FlightImu:
    """Return an IMU that reads of each turn what it usually does of one that the watched IMU reads.

    Its own noise is in y, and would explain itself as a gain; the watched one's is in the regressors as well.
    """
    half = max(round(0.5 * _USUAL_S / flight.blocks.period_s), 1)
    read, watched = np.nan_to_num(imu.gyros), flight.gyros
    mean, of_watched = means_about(read, half), means_about(watched, half)
    shared = means_about(read * watched, half) - mean * of_watched
    power = means_about(watched**2, half) - of_watched**2
    share = shared / np.maximum(power, _LEAST_POWER)
    return replace(imu, gyros=mean + share * (watched - of_watched))


def _of(own: Flight, imu: FlightImu) -> Iterator[Explanation]:
    names = [name for name, whole in gyros.kinds().items() if not whole.of_motion]
    for each in (one for one in gyros.of_kinds(own, names) if one.fades_s in _FADES_S):
        yield replace(
            each,
            suspect=gyro_of(each.suspect, imu.name),
            base=each.base and _named(each.base, imu),
            effect=partial(_moved, own=own, imu=imu, effect=each.effect),
        )


def _named(base: str, imu: FlightImu) -> str:
    """Return the name of an explanation as it is of an IMU's gyro."""
    gyro, _, rest = base.partition(" ")
    return f"{gyro_of(gyro, imu.name)} {rest}"


def _moved(_: Flight, *, own: Flight, imu: FlightImu, effect: Callable[[Flight], Effect]) -> Effect:
    """Return an effect of a flight that is watched by an IMU as one of the IMU's channels."""
    said = effect(own)
    wrong = said.gyros if said.gains is None else said.gains
    channels = None if wrong is None else dict(zip(imu.channels, wrong.T, strict=True))
    return Effect(channels=channels, turned=said.turned, turning=said.turning)
