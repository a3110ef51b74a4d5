"""Sensors of a flight sample by sample, each on its own stamps, brought to blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gtmbench.engine.blocks import BLOCK_S, Blocks, held_for_s, rates_deg_s
from gtmbench.engine.flight import Flight
from gtmbench.errors import InputError
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, IntArray

FORCES = ("nx", "ny", "nz")
_LAGS_S = np.linspace(-0.4, 0.4, 17)  # of the attitude's stamps behind the gyros'; a longer lag is a wrong reading
_TELL_LAG = 6000  # blocks: of twenty minutes a lag is known to a millisecond
_BETTER = 0.02  # of the misfit without a lag: less is chance
_LOUDEST = 0.9  # of squared differences: larger ones tell of jumps, and count as much
_LONGEST_S = 86_400.0  # a pause costs what a flight does: 28 h of it took 15 GB
_EDGE_S = 1e-6  # by which rounding puts a stamp beyond an edge
_GAP, _FEWEST = 2.5, 3  # times the usual step; samples of a block by which it is told whether something shakes


class Samples(NamedTuple):
    """A sensor's samples: their times, increasing, and their values."""

    time_s: FloatArray
    values: FloatArray

    @property
    def step_s(self) -> float:
        """The usual time between two."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else np.inf


def flight_of(sensors: Mapping[str, Samples], *, is_driven: bool, is_assumed: bool = False) -> Flight:
    """Return a flight of p, q, r, phi, theta and psi, and of nx, ny and nz where they are there.

    Blocks are a fifth of a second, or as long as the slowest of gyros and attitude takes for a sample. An attitude that
    is logged late is taken so much earlier.

    >>> slow, fast = np.arange(0.0, 20.0, 0.1), np.arange(0.0, 20.0, 0.004)
    >>> turning = {"r": Samples(fast, np.full(5000, 3.0)), "psi": Samples(slow, 3.0 * slow)}
    >>> rest = {name: Samples(slow, 0.0 * slow) for name in ("p", "q", "phi", "theta")}
    >>> flight = flight_of({**rest, **turning}, is_driven=False)
    >>> flight.blocks.rates[7].round(6).tolist(), flight.blocks.gyros[7].round(6).tolist()
    ([0.0, 0.0, 3.0], [0.0, 0.0, 3.0])
    """
    sensors = {**sensors, **_earlier(sensors, attitude_lag_s(sensors))}
    edges = _edges(sensors)
    angles = np.column_stack([_at(sensors[name], edges) for name in ATTITUDE])
    period_s = float(edges[1] - edges[0])
    stamps_s = tuple(each.time_s[np.isfinite(each.values)] for each in (sensors[name] for name in ATTITUDE))
    blocks = Blocks(
        start_s=float(edges[0]),
        period_s=period_s,
        gyros=gyros_between([sensors[name] for name in GYROS], edges, stamps_s),
        rates=rates_deg_s(angles, period_s),
        euler_rates=np.diff(angles, axis=0) / period_s,
        angles=angles[:-1],
        rough=np.column_stack([rough_between(sensors[name], edges) for name in GYROS]),
        held_s=np.column_stack([held_between(sensors[name], edges) for name in (*GYROS, *ATTITUDE)]),
    )
    step_s = max(sensors[name].step_s for name in GYROS)
    if not set(FORCES) <= sensors.keys():
        return Flight(
            blocks=blocks, angle_stamps_s=stamps_s, gyro_step_s=step_s, is_driven=is_driven, is_assumed=is_assumed
        )
    forces = [_moments(sensors[name], edges) for name in FORCES]
    return Flight(
        blocks=blocks,
        forces=np.column_stack([mean for mean, _ in forces]),
        shaking=forces[2][1],
        felt_rough=np.column_stack([rough_between(sensors[name], edges) for name in FORCES]),
        angle_stamps_s=stamps_s,
        gyro_step_s=step_s,
        is_driven=is_driven,
        is_assumed=is_assumed,
    )


def _earlier(sensors: Mapping[str, Samples], lag_s: float) -> dict[str, Samples]:
    """Return the attitude so much earlier; angles that share their times still do."""
    times = {id(sensors[name].time_s): sensors[name].time_s for name in ATTITUDE}
    earlier = {key: time_s - lag_s for key, time_s in times.items()}
    return {name: Samples(earlier[id(sensors[name].time_s)], sensors[name].values) for name in ATTITUDE}


def attitude_lag_s(sensors: Mapping[str, Samples]) -> float:
    """Return by how much the attitude's stamps are late behind the gyros': where both turn most alike.

    The least of the mean squared difference over lags, its largest tenth clipped, by a parabola through three. Of a
    long log the liveliest twenty minutes tell it.

    >>> time_s = np.arange(0.0, 60.0, 0.05)
    >>> level = {name: Samples(time_s, 0.0 * time_s) for name in (*GYROS, *ATTITUDE)}
    >>> rolls = {"p": Samples(time_s, 5.0 * np.cos(time_s)), "phi": Samples(time_s + 0.12, 5.0 * np.sin(time_s))}
    >>> round(attitude_lag_s({**level, **rolls}), 2)
    0.12
    """
    edges = _edges(sensors)
    gyros = np.column_stack([means_between(sensors[name], edges) for name in GYROS])
    if len(gyros) > _TELL_LAG:
        sensors, gyros, edges = _liveliest(sensors, gyros, edges)
    misfits = np.array([_misfit(sensors, gyros, edges, lag_s) for lag_s in _LAGS_S])
    if not np.isfinite(misfits).all() or not np.ptp(misfits) > 0.0:
        return 0.0
    best, none = int(np.argmin(misfits)), len(misfits) // 2
    if best in (0, len(misfits) - 1) or misfits[none] - misfits[best] < _BETTER * misfits[none]:
        return 0.0
    before, least, behind = misfits[best - 1 : best + 2]
    bend = before - 2.0 * least + behind
    return float(_LAGS_S[best] + 0.5 * (before - behind) / bend * (_LAGS_S[1] - _LAGS_S[0]))


def _liveliest(
    sensors: Mapping[str, Samples], gyros: FloatArray, edges: FloatArray
) -> tuple[Mapping[str, Samples], FloatArray, FloatArray]:
    """Return what tells a lag of the part of a log in which it turns most."""
    turned = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.square(gyros)).sum(axis=1))])
    first = int(np.argmax(turned[_TELL_LAG:] - turned[:-_TELL_LAG]))
    edges, gyros = edges[first : first + _TELL_LAG + 1], gyros[first : first + _TELL_LAG]
    return (
        {name: _cut(sensors[name], edges[0] + _LAGS_S[0], edges[-1] + _LAGS_S[-1]) for name in ATTITUDE},
        gyros,
        edges,
    )


def _cut(samples: Samples, start_s: float, end_s: float) -> Samples:
    """Return samples from the last before a time to the first behind another."""
    first = max(int(np.searchsorted(samples.time_s, start_s)) - 1, 0)
    own = slice(first, int(np.searchsorted(samples.time_s, end_s)) + 1)
    return Samples(samples.time_s[own], samples.values[own])


def _misfit(sensors: Mapping[str, Samples], gyros: FloatArray, edges: FloatArray, lag_s: float) -> float:
    angles = np.column_stack([_at(sensors[name], edges + lag_s) for name in ATTITUDE])
    square = np.square(gyros - rates_deg_s(angles, float(edges[1] - edges[0])))
    square = square[np.isfinite(square).all(axis=1)]
    if not len(square):
        return float("nan")
    return float(np.minimum(square, np.quantile(square, _LOUDEST, axis=0)).mean(axis=0).sum())


def _edges(sensors: Mapping[str, Samples]) -> FloatArray:
    """Return where blocks begin and end, shape (blocks + 1,)."""
    own = [sensors[name] for name in (*GYROS, *ATTITUDE)]
    period_s = float(max([BLOCK_S, *(each.step_s for each in own)]))
    start_s = max(float(each.time_s[0]) for each in own)
    end_s = min(float(each.time_s[-1]) for each in own)
    if end_s - start_s > _LONGEST_S:
        raise InputError(
            f"gyros and attitude span {(end_s - start_s) / 3600.0:.1f} h, pauses among it; at most "
            f"{_LONGEST_S / 3600.0:g} h are judged at once: cut the log"
        )
    count = max(int((end_s - start_s) / period_s + 1e-6), 1)
    return np.asarray(start_s + period_s * np.arange(count + 1), dtype=np.float64)


def _in_gap(samples: Samples, edges: FloatArray, stamps_s: FloatArray | None = None) -> BoolArray:
    """Tell between which edges samples are missing, shape (blocks,); up to the stamps about a gap, where there are."""
    steps = np.diff(samples.time_s)
    late = np.flatnonzero(steps > max(_GAP * samples.step_s, edges[1] - edges[0]))
    firsts_s, lasts_s = samples.time_s[late], samples.time_s[late + 1]
    if stamps_s is not None:
        firsts_s = stamps_s[np.maximum(np.searchsorted(stamps_s, firsts_s, side="right") - 1, 0)]
        lasts_s = stamps_s[np.minimum(np.searchsorted(stamps_s, lasts_s), len(stamps_s) - 1)]
    found = np.zeros(len(edges) - 1, dtype=bool)
    for first_s, last_s in zip(firsts_s, lasts_s, strict=True):
        found[max(np.searchsorted(edges, first_s, side="right") - 1, 0) : np.searchsorted(edges, last_s)] = True
    return found


def _at(samples: Samples, edges: FloatArray) -> FloatArray:
    """Return an angle at edges, without turns, NaN beside a gap."""
    there = np.isfinite(samples.values)
    if np.count_nonzero(there) < 2:
        return np.full(len(edges), np.nan)
    time_s, values = samples.time_s[there], np.unwrap(samples.values[there], period=360.0)
    found = np.interp(edges, time_s, values)
    gap = _in_gap(Samples(time_s, values), edges)
    found[:-1][gap] = np.nan
    found[1:][gap] = np.nan
    found[(edges < time_s[0] - _EDGE_S) | (edges > time_s[-1] + _EDGE_S)] = np.nan
    return np.asarray(found)


def edges_of(blocks: Blocks) -> FloatArray:
    """Return where blocks begin and end, shape (blocks + 1,)."""
    return np.asarray(blocks.start_s + blocks.period_s * np.arange(len(blocks) + 1), dtype=np.float64)


def gyros_between(gyros: Sequence[Samples], edges: FloatArray, angle_stamps_s: Sequence[FloatArray]) -> FloatArray:
    """Return what gyros read between edges as angles tell it that are read at some stamps, shape (blocks, 3).

    An angle goes straight from stamp to stamp, and so does the integral of its gyro: or where edges fall between stamps
    would look like a gain. Without stamps it is each gyro's mean.
    """
    stamps_s = angle_stamps_s or (None,) * len(GYROS)
    return np.column_stack([means_between(each, edges, own_s) for each, own_s in zip(gyros, stamps_s, strict=True)])


def means_between(samples: Samples, edges: FloatArray, stamps_s: FloatArray | None = None) -> FloatArray:
    """Return means between edges of what goes straight from sample to sample, and its integral from stamp to stamp."""
    there = np.isfinite(samples.values)
    if np.count_nonzero(there) < 2:
        return np.full(len(edges) - 1, np.nan)
    time_s, values = samples.time_s[there], samples.values[there]
    stamps_s = None if stamps_s is None or len(stamps_s) < 2 else stamps_s
    area = _integral(time_s, values, edges if stamps_s is None else stamps_s)
    if stamps_s is not None:
        area = np.interp(edges, stamps_s, area)
    found = np.diff(area) / np.diff(edges)
    found[_in_gap(Samples(time_s, values), edges, stamps_s)] = np.nan
    found[(edges[:-1] < time_s[0] - _EDGE_S) | (edges[1:] > time_s[-1] + _EDGE_S)] = np.nan
    return np.asarray(found)


def _integral(time_s: FloatArray, values: FloatArray, until_s: FloatArray) -> FloatArray:
    """Return the integral of what goes straight from sample to sample, from the first on."""
    areas = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time_s))])
    before = np.clip(np.searchsorted(time_s, until_s, side="right") - 1, 0, len(time_s) - 1)
    at = np.interp(until_s, time_s, values)
    return np.asarray(areas[before] + 0.5 * (values[before] + at) * (until_s - time_s[before]))


def _block_of(time_s: FloatArray, edges: FloatArray) -> tuple[IntArray, BoolArray]:
    at = np.searchsorted(edges, time_s, side="right").astype(np.int64) - 1
    return at, (at >= 0) & (at < len(edges) - 1)


def rough_between(samples: Samples, edges: FloatArray) -> FloatArray:
    """Return mean squares of second differences between edges; NaN where there is none."""
    steps = np.diff(samples.time_s)
    even = np.maximum(steps[1:], steps[:-1]) < _GAP * samples.step_s
    square = np.square(np.diff(samples.values, n=2))[even]
    at, inside = _block_of(samples.time_s[1:-1][even], edges)
    inside &= np.isfinite(square)
    counts = np.bincount(at[inside], minlength=len(edges) - 1)
    sums = np.bincount(at[inside], square[inside], minlength=len(edges) - 1)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def held_between(samples: Samples, edges: FloatArray) -> FloatArray:
    """Return for how long a sensor has read one value, at the end of each block; 0 where samples are missing."""
    held = held_for_s(samples.time_s, samples.values)
    before = np.clip(np.searchsorted(samples.time_s, edges[1:] + 1e-9, side="right") - 1, 0, len(held) - 1)
    return np.where(_in_gap(samples, edges), 0.0, held[before])


def _moments(samples: Samples, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means and standard deviations of samples between edges; NaN where there are none, or too few."""
    there = np.isfinite(samples.values)
    at, inside = _block_of(samples.time_s[there], edges)
    values, at = samples.values[there][inside], at[inside]
    counts = np.bincount(at, minlength=len(edges) - 1)
    mean = np.bincount(at, values, minlength=len(edges) - 1) / np.maximum(counts, 1)
    power = np.bincount(at, np.square(values - mean[at]), minlength=len(edges) - 1) / np.maximum(counts, 1)
    return np.where(counts > 0, mean, np.nan), np.where(counts >= _FEWEST, np.sqrt(power), np.nan)
