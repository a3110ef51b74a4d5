"""Which of two readings holds what they differ by: a gyro's, or the attitude's, which tells of the same rate.

What a fault adds to one of two readings p and d comes with that reading and not with the other, whatever its shape. So
where no kind explains their difference e = p - d, its coherence with each of them tells whose it is: the share of e's
power that a linear filter of p explains is

    sum over f of |S_pe|^2 / S_pp  over  sum over f of S_ee,

at the frequencies f where e is far beyond healthy noise. Two things look like their opposite. A fault that takes motion
away, as a jam does, seems to add it to the other reading; therefore the other one must be as strong as the gyro was
before the fault. And an autopilot that flies on the faulty reading moves the aircraft against the fault, until the
faulty reading looks as it did and the right one doesn't; therefore only frequencies count that are beyond autopilots.
Those below make a sensor likelier, and no more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gtmbench.detectors.isolation.case import Case
from gtmbench.values.channels import GYROS, axis_of
from gtmbench.values.record import BoolArray, FloatArray

_SEGMENT_S = 2.56  # 256 samples at 100 Hz: a power of two
_FEWEST = 6  # segments, which overlap by half
_BEYOND = 4.0  # times the healthy residual's power: a fault is there
_WITH, _WITHOUT = 0.5, 0.3  # shares of e: the least of whose it is, the most of the other
_STRONGER, _LEANING = 2.5, 1.5  # times the other's power where e is: to be clear, to be likely
_AS_BEFORE, _STEADY = 2.0, 1.5  # times by which the other's power there differs from the gyro's before the fault
_BEYOND_AUTOPILOTS_HZ = 3.0  # above it no loop moves the aircraft
_LEAKED = 1e-3  # of the strongest frequency: a window leaks as much into others
_NOTHING = 1e-300  # a logarithm's guard


class Excess(NamedTuple):
    """Whose the difference of two readings is."""

    holder: str  # the sensor that is likelier to hold it
    is_clear: bool  # whether it must be that one


def whose_excess(case: Case, channel: str) -> Excess | None:
    """Return which sensor of a channel's axis holds what its two readings differ by; None where that is open."""
    gyro, *angles = axis_of(channel)
    habit = case.habits.get(gyro)
    if gyro not in GYROS or not angles or gyro not in case.residuals.raw or habit is None or case.driving:
        return None
    span = max(2 * round(0.5 * _SEGMENT_S / case.period_s), 8)
    readings = case.record[gyro][case.judged]
    predicted = readings - (case.residuals.raw[gyro][case.judged] - case.shift[gyro])
    turns = np.arange(2, span // 2 + 1) / span
    healthy = case.monitor.whiteners[gyro].power(2.0 * np.pi * turns)
    found = held_by(readings, predicted, habit.before, healthy, turns / case.period_s > _BEYOND_AUTOPILOTS_HZ)
    return None if found is None else Excess((gyro, angles[0])[found[0]], found[1])


def held_by(
    readings: FloatArray, predicted: FloatArray, before: FloatArray, healthy: FloatArray, fast: BoolArray
) -> tuple[int, bool] | None:
    """Return which of two readings holds what they differ by, 0 or 1, and whether that is clear; None where it is open.

    `readings`, `predicted`, shape (rows,): p and d. `before`, shape (any,): what was read before the fault, in the same
    unit. `healthy`, shape (span // 2 - 1,): the spectrum of p - d without a fault, at the frequencies of a segment of
    `span` rows but the two lowest. `fast`, shape (span // 2 - 1,): which of these are beyond autopilots.

    >>> rng = np.random.default_rng(1)
    >>> motion, added = rng.standard_normal((2, 2000))
    >>> healthy, fast = np.full(127, 0.01), np.arange(127) > 5
    >>> held_by(motion + 3 * added, motion, motion, healthy, fast)
    (0, True)
    >>> held_by(motion, motion + 3 * added, motion, healthy, fast)
    (1, True)
    >>> held_by(motion, 1.5 * motion, motion, healthy, fast)  # likelier that than a gain of the first
    (1, False)
    >>> held_by(motion, 0 * motion, motion, healthy, fast)  # the second is stuck
    """
    span = 2 * (len(healthy) + 1)
    found = _spectra(np.array([readings, predicted, readings - predicted]), span)
    usual = np.square(np.abs(_spectra(before[np.newaxis], span)[0]))
    if found.shape[1] < _FEWEST or not len(usual):
        return None
    power = np.square(np.abs(found)).mean(axis=1) + _NOTHING
    coherent = np.square(np.abs((found[:2].conj() * found[2]).mean(axis=1))) / power[:2]
    known = usual.mean(axis=0) + _NOTHING
    loud = power[2] > np.maximum(_BEYOND * healthy, _LEAKED * power[2].max())

    def compared(there: BoolArray) -> tuple[int, FloatArray, list[float]]:
        """Return the stronger reading, shares, and by how much it is stronger, and the other weaker and livelier."""
        weights = power[2, there] / power[2, there].sum()
        levels = np.log(np.array([power[0], power[1], known, known + healthy]))[:, there] @ weights
        holder = int(levels[1] > levels[0])
        other = levels[1 - holder]
        ratios = np.exp([levels[holder] - other, levels[2] - other, other - levels[3]]).tolist()
        return holder, coherent[:, there].sum(axis=1) / power[2, there].sum(), ratios

    if (loud & fast).any():
        holder, shares, (stronger, weaker, livelier) = compared(loud & fast)
        is_whose = shares[holder] >= _WITH and shares[1 - holder] <= _WITHOUT
        if is_whose and stronger >= _STRONGER and max(weaker, livelier) <= _AS_BEFORE:
            return holder, True
    if loud.any():
        holder, _, (stronger, weaker, _) = compared(loud)
        if stronger >= _LEANING and weaker <= _STEADY:
            return holder, False
    return None


def _spectra(series: FloatArray, span: int) -> np.ndarray[tuple[int, int, int], np.dtype[np.complex128]]:
    """Return the spectra of segments that overlap by half and miss no row: shape (series, segments, span // 2 - 1).

    About their straight lines, by Hann's window, without the two lowest frequencies.
    """
    if series.shape[1] < span:
        return np.zeros((len(series), 0, span // 2 - 1), dtype=complex)
    cut = np.lib.stride_tricks.sliding_window_view(series, span, axis=1)[:, :: span // 2]
    cut = cut[:, np.isfinite(cut).all(axis=(0, 2))]
    place, window = np.linspace(-1.0, 1.0, span), np.hanning(span)
    slope = (cut @ place) / float(place @ place)
    flat = cut - cut.mean(axis=2, keepdims=True) - slope[:, :, np.newaxis] * place
    return np.asarray(np.fft.rfft(flat * window, axis=2)[:, :, 2:] / np.sqrt(np.sum(window**2)))
