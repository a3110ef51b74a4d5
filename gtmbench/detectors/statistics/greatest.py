"""The greatest of all scores over a stretch, for whoever needn't know at which row: no logarithm but of two numbers.

A window's ratio of the mean grows with |m1 - m0|, that of the energy with the mean square's distance from the tolerated
range, so the extremes of both are all that is worked out of the rows.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gtmbench.detectors.statistics.statistic import Given, Statistic, Tolerance, glr, over
from gtmbench.record import FloatArray

_BLOCK = 4096  # rows at a time: what is worked out of them stays in the cache


def greatest_score(
    test: Statistic,
    given: Given,
    sample_period_s: float,
    tolerance: Tolerance,
    thresholds: Mapping[str, float],
    at: range,
) -> float:
    """Return the greatest value over its threshold of all tests at some samples; -inf where there is none.

    What `Statistic.of` gives row for row, up to rounding.

    Parameters
    ----------
    test : Statistic
    given : Given
    sample_period_s : float
    tolerance : Tolerance
    thresholds : mapping of label to float
    at : range
        Of samples, those before are looked back at.

    Examples
    --------
    >>> from gtmbench.detectors.statistics.statistic import Statistic
    >>> test, w = Statistic(windows_s=(0.5,), baseline_s=10.0), np.random.default_rng(1).standard_normal(400)
    >>> given = Given(values=w, plain=w, means={}, uncertain=w)
    >>> thresholds, at = {"mean 0.5 s": 8.0, "energy 0.5 s": 10.0}, range(100, 400)
    >>> rows = [score.values / thresholds[score.label] for score in test.of(given, 0.1, Tolerance(), at=at)]
    >>> float(np.max(rows)) - greatest_score(test, given, 0.1, Tolerance(), thresholds, at) < 1e-9
    True
    """
    whole = test.looks_back(sample_period_s) if _has_short_cut(test, given) else len(given.values)
    split = min(max(at.start, whole), at.stop)
    greatest = _row_for_row(test, given, sample_period_s, tolerance, thresholds, range(at.start, split))
    if split == at.stop:
        return greatest
    extremes = _extremes(test, given, sample_period_s, range(split, at.stop))
    return max(greatest, _of_extremes(test, extremes, sample_period_s, tolerance, thresholds))


def _has_short_cut(test: Statistic, given: Given) -> bool:
    return test.name == "glr" and given.values is given.plain


def _row_for_row(
    test: Statistic,
    given: Given,
    sample_period_s: float,
    tolerance: Tolerance,
    thresholds: Mapping[str, float],
    at: range,
) -> float:
    if not at:
        return -np.inf
    return max(
        float(np.fmax.reduce(over(score.values, thresholds[score.label]), initial=-np.inf))
        for score in test.of(given, sample_period_s, tolerance, at=at)
    )


def _extremes(test: Statistic, given: Given, sample_period_s: float, at: range) -> FloatArray:
    """Return, a window a row, the greatest |m1 - m0| and the least and greatest mean square about m0."""
    windows = test.rows(sample_period_s)
    longest = max(round(test.baseline_s / sample_period_s), 6)
    found = np.tile([0.0, np.inf, -np.inf], (len(windows), 1))
    plain, squares = given.sums.plain, given.sums.squares
    for start in range(at.start, at.stop, _BLOCK):
        stop = min(start + _BLOCK, at.stop)
        first = start + 1 - windows[-1]
        means = plain[first : stop + 1] - plain[first - longest : stop + 1 - longest]  # before each row
        means /= longest
        total, square = plain[start + 1 : stop + 1], squares[start + 1 : stop + 1]
        shift, power, base_square = np.empty((3, stop - start))
        for row, rows in zip(found, windows, strict=True):
            base = means[windows[-1] - rows :][: stop - start]
            np.subtract(total, plain[start + 1 - rows : stop + 1 - rows], out=shift)
            shift /= rows
            np.subtract(square, squares[start + 1 - rows : stop + 1 - rows], out=power)
            power /= rows
            shift -= base  # m1 - m0; the mean square about m0 is that about 0 less m0 (m0 + 2 (m1 - m0))
            np.multiply(shift, 2.0, out=base_square)
            base_square += base
            base_square *= base
            power -= base_square
            low, high = row[1:]
            row[:] = max(row[0], shift.max(), -shift.min()), min(low, power.min()), max(high, power.max())
    return found


def _of_extremes(
    test: Statistic,
    extremes: FloatArray,
    sample_period_s: float,
    tolerance: Tolerance,
    thresholds: Mapping[str, float],
) -> float:
    low = tolerance.low if test.two_sided else 0.0
    longest = max(round(test.baseline_s / sample_period_s), 6)
    greatest = -np.inf
    for (shift, least, most), rows in zip(extremes.tolist(), test.rows(sample_period_s), strict=True):
        power = np.maximum([least, most], 1e-12)
        of_mean, of_energy = glr(
            np.full(2, shift), power, rows, 1.0 / rows + 1.0 / longest, tolerance.mean, low, tolerance.high
        )
        window = f"{rows * sample_period_s:g} s"
        scores = (over(of_mean, thresholds[f"mean {window}"]), over(of_energy, thresholds[f"energy {window}"]))
        greatest = max(greatest, *(float(score.max()) for score in scores))
    return greatest
