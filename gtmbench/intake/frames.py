"""Which way sensors point whose columns are known: axes left and up, or a sensor mounted otherwise, by their motion.

Gyros that are turned against the attitude by a right-handed rotation of whole quarters are in another frame; that is
told and undone. A sign that differs on one axis alone, or two axes swapped, are no rotation: something else is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from gtmbench.intake.formats.raw import Meaning, RawLog, RawSeries
from gtmbench.intake.physics import rates_beside_attitude
from gtmbench.intake.units import unit
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray

Known = Mapping[str, tuple[RawSeries, Meaning]]
_AGREES = 0.8  # correlation of every axis with the one that it is
_WITHIN = 0.3  # of a gain, as a logarithm: a rotation changes none, and another unit is no rotation
_BETTER = 0.5  # by which the mean correlation exceeds that of the axes as they are named; two turned signs make 1.3
_MOST_ROWS = 5_000_000  # half a day at 100 Hz: of more, six columns at once would cost more than the log's reading does
_UP = (1.0, -1.0, -1.0)


@dataclass(frozen=True, kw_only=True)
class _Rotation:
    """Which axis of the aircraft each axis of a sensor is, and whether it points there or away."""

    places: tuple[int, ...]
    signs: tuple[float, ...]

    @property
    def matrix(self) -> FloatArray:
        return np.asarray(np.eye(3)[list(self.places)] * np.array(self.signs)[:, np.newaxis])

    @property
    def is_named(self) -> bool:
        return self.places == (0, 1, 2) and min(self.signs) > 0.0


def in_frame(raw: RawLog, known: Known) -> dict[str, tuple[RawSeries, Meaning]]:
    """Return the channels that have to be read otherwise than they are named, and how.

    `raw`: its clocks known. `known`: channels that are settled: a column and what it is.
    """
    if not {*GYROS, *ATTITUDE} <= set(known) or not raw.clocks:
        return {}
    if any(len({known[name][0].clock for name in channels}) > 1 for channels in (GYROS, ATTITUDE)):
        return {}
    if max(len(raw.clocks[known[name][0].clock]) for name in ("p", "phi")) > _MOST_ROWS:
        return {}
    rotation = _rotation(raw, known)
    if rotation is None:
        return {}
    is_up = rotation.places == (0, 1, 2) and rotation.signs == _UP
    if is_up and _feels_down(known):
        why = "the gyros, beside which its axes point left and up"
        return {name: _turned(known[name], name, -1.0, why) for name in ATTITUDE[1:]}
    why = f"the attitude, beside which {'axes point left and up' if is_up else 'the sensor is mounted turned'}"
    sensors = [GYROS]
    if set(ACCELEROMETERS) <= set(known) and len({known[name][0].clock for name in (*ACCELEROMETERS, *GYROS)}) == 1:
        sensors.append(ACCELEROMETERS)
    found = {}
    for channels in sensors:
        for name, place, sign in zip(channels, rotation.places, rotation.signs, strict=True):
            down = (-1.0) ** ((name == "nz") + (channels[place] == "nz"))  # a load factor points up
            if (channels[place], sign) != (name, 1.0):
                found[channels[place]] = _turned(known[name], channels[place], sign * down, why)
    return found


def _turned(column: tuple[RawSeries, Meaning], channel: str, sign: float, why: str) -> tuple[RawSeries, Meaning]:
    series, meaning = column
    return series, replace(meaning, channel=channel, sign=meaning.sign * sign, guessed=why)


def _feels_down(known: Known) -> bool:
    """Tell whether accelerometers beside the gyros feel gravity as axes do that point right and down."""
    if "nz" not in known or known["nz"][0].clock != known["p"][0].clock:
        return False
    series, meaning = known["nz"]
    return float(np.nanmean(series.values())) * meaning.sign > 0.0


def _rotation(raw: RawLog, known: Known) -> _Rotation | None:
    """Return the rotation by which gyros show the attitude's motion; None of none, or none that is plain."""
    told = rates_beside_attitude(
        raw, [known[name][0] for name in GYROS], [known[name][0] for name in ATTITUDE], _factors(known, ATTITUDE)
    )
    if told is None:
        return None
    rates, turning = told
    rates = rates * _factors(known, GYROS)
    there = np.isfinite(rates).all(axis=1) & np.isfinite(turning).all(axis=1)
    deviations = rates[there].std(axis=0), turning[there].std(axis=0)
    if min(map(np.min, deviations)) <= 0.0:
        return None
    y, u = ((own[there] - own[there].mean(axis=0)) / by for own, by in zip((rates, turning), deviations, strict=True))
    correlations = y.T @ u / len(y)
    rotations = [
        rotation
        for places in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
        if np.linalg.det((rotation := _Rotation(places=places, signs=signs)).matrix) > 0.0
    ]
    best = max(rotations, key=lambda each: float(np.sum(each.matrix * correlations)))
    agrees = np.sum(best.matrix * correlations, axis=1)
    gains = np.abs(np.log(deviations[0] / deviations[1][list(best.places)]))
    is_plain = agrees.min() > _AGREES and gains.max() < _WITHIN and agrees.mean() - np.trace(correlations) / 3 > _BETTER
    return best if is_plain and not best.is_named else None


def _factors(known: Known, channels: tuple[str, ...]) -> FloatArray:
    """Return what brings columns to the channels' units and signs."""
    told = [(unit(known[name][1].unit), known[name][1].sign) for name in channels]
    return np.array([sign * (of.factor if of else 1.0) for of, sign in told])
