"""Which way sensors point whose columns are known, by their motion; and accelerometers' unit, where none is stated.

Gyros that are turned against the attitude by a right-handed rotation of whole quarters are in another frame; that is
told and undone. A sign that differs on one axis alone, or two axes swapped, are no rotation: something else is wrong.
Accelerometers feel one g most of the time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gtmbench.intake.formats.raw import Meaning, RawLog, RawSeries
from gtmbench.intake.names import triples
from gtmbench.intake.open_columns import rates_beside_attitude
from gtmbench.intake.units import unit
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, G_M_S2, GYROS
from gtmbench.values.clock import FloatArray

Known = Mapping[str, tuple[RawSeries, Meaning]]
_AGREES = 0.8  # correlation of every axis with the one that it is
_WITHIN = 0.3  # of a gain, as a logarithm: a rotation changes none, and another unit is no rotation
_BETTER = 0.5  # by which the mean correlation exceeds that of the axes as they are named; two turned signs make 1.3
_MOST_ROWS = 5_000_000  # half a day at 100 Hz: of more, six columns at once would cost more than the log's reading does


def in_frame(raw: RawLog, known: Known) -> dict[str, tuple[RawSeries, Meaning]]:
    """Return the channels that have to be read otherwise than they are named, and how."""
    if not {*GYROS, *ATTITUDE} <= set(known) or not raw.clocks:
        return {}
    if any(len({known[name][0].clock for name in channels}) > 1 for channels in (GYROS, ATTITUDE)):
        return {}
    if max(len(raw.clocks[known[name][0].clock]) for name in ("p", "phi")) > _MOST_ROWS:
        return {}
    rotation = _rotation(raw, known)
    if rotation is None:
        return {}
    is_up = np.array_equal(rotation, np.diag((1.0, -1.0, -1.0)))  # forward, left, up
    if is_up and _feels_down(known):
        why = "the gyros, beside which its axes point left and up"
        return {name: _turned(known[name], name, -1.0, why) for name in ATTITUDE[1:]}
    why = f"the attitude, beside which {'axes point left and up' if is_up else 'the sensor is mounted turned'}"
    sensors = [GYROS]
    if set(ACCELEROMETERS) <= set(known) and len({known[name][0].clock for name in (*ACCELEROMETERS, *GYROS)}) == 1:
        sensors.append(ACCELEROMETERS)
    found = {}
    for channels in sensors:
        for name, axis in zip(channels, rotation, strict=True):
            (place,) = np.flatnonzero(axis)
            down = (-1.0) ** ((name == "nz") + (channels[place] == "nz"))  # a load factor points up
            if (channels[place], axis[place]) != (name, 1.0):
                found[channels[place]] = _turned(known[name], channels[place], float(axis[place]) * down, why)
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


def _rotation(raw: RawLog, known: Known) -> FloatArray | None:
    """Return the rotation by which gyros show the attitude's motion; None of none, or none that is plain.

    A row an axis of the sensor: which axis of the aircraft it is, and whether it points there (1) or away (-1).
    """
    from scipy.spatial.transform import Rotation

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
    quarters = np.rint(Rotation.create_group("O").as_matrix()) + 0.0  # all that turn axes into axes
    best: FloatArray = max(quarters, key=lambda each: float(np.sum(each * correlations)))
    agrees = np.sum(best * correlations, axis=1)
    gains = np.abs(np.log(deviations[0] / (np.abs(best) @ deviations[1])))
    is_plain = agrees.min() > _AGREES and gains.max() < _WITHIN and agrees.mean() - np.trace(correlations) / 3 > _BETTER
    return best if is_plain and not np.array_equal(best, np.eye(3)) else None


def _factors(known: Known, channels: tuple[str, ...]) -> FloatArray:
    """Return what brings columns to the channels' units and signs."""
    told = [(unit(known[name][1].unit), known[name][1].sign) for name in channels]
    return np.array([sign * (of.factor if of else 1.0) for of, sign in told])


# so many are 1 g
_UNITS = {"g": 1.0, "mg": 1e3, "m/s2": G_M_S2, "cm/s2": 100 * G_M_S2} | {
    f"{1 / counts:.12g} g": float(counts) for counts in (2**power for power in range(8, 16))
}
_UNIT_WITHIN, _OTHER_UNITS = 0.03, 0.1  # of a unit, as a logarithm: which it is, and how far all others have to be
_ALONG = 0.8  # of what is felt: the way that z points


def forces_by_gravity(raw: RawLog, known: Known) -> dict[str, tuple[RawSeries, Meaning]]:
    """Return the accelerometers beside the gyros, in the unit and on the axes that gravity shows; none elsewhere.

    They are mounted as the gyros of the same sensor are, and gravity has to agree with that. Milligrams can't be told
    from 1,024 counts a g: neither is taken.

    `raw`: its clocks known. `known`: channels that are settled: a column and what it is.
    """
    clocks = {known[name][0].clock for name in GYROS if name in known}
    if not set(GYROS) <= set(known) or set(ACCELEROMETERS) & set(known) or len(clocks) > 1:
        return {}
    (clock,) = clocks
    settled = {id(series) for series, _ in known.values()}
    beside = [each for each in triples(raw.series) if each.kind == "acceleration" and each.clock == clock]
    own = [each for each in beside if not each.stated and not each.meanings and not settled & set(map(id, each.series))]
    if len(own) != 1:
        return {}
    felt = np.column_stack([series.values() for series in own[0].series])
    felt = felt[np.isfinite(felt).all(axis=1)]
    usual = float(np.median(np.linalg.norm(felt, axis=1))) if len(felt) else 0.0
    off = {name: abs(math.log(usual / size)) for name, size in _UNITS.items()} if usual > 0.0 else {}
    near = sorted(off, key=off.__getitem__)[:2]
    signs = [known[name][1].sign for name in GYROS]
    if not off or off[near[0]] > _UNIT_WITHIN or off[near[1]] < _OTHER_UNITS:
        return {}
    if float(np.mean(felt[:, 2])) * signs[2] > -_ALONG * usual:
        return {}
    signs[2] = -signs[2]  # a load factor points up
    why = f"gravity: it feels {usual:.4g} most of the time"
    return {
        channel: (series, Meaning(channel=channel, unit=near[0], sign=sign, guessed=why))
        for channel, series, sign in zip(ACCELEROMETERS, own[0].series, signs, strict=True)
    }
