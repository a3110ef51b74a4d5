"""Test statistics: what a residual is turned into before it is held against a threshold.

Each takes one residual, as it is and whitened, and returns one or several series. Row k of a series uses rows up to k,
so it is known when the residual's row k is. Missing rows are passed over: a window holds the last samples that exist.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.bank.spread import Given, Spread
from gtmbench.method.residual import moving_sum
from gtmbench.record import FloatArray

_LONG_S = 20.0
_FAR = 4.0  # deviations that an operator's error may have: one for all samples, it isn't averaged
_MOST = 100.0  # deviations: what one sample may weigh, so that sums stay exact after a spike


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """What a healthy whitened residual may do beyond noise: manoeuvres, gusts and imperfect sensors make it so.

    Attributes
    ----------
    mean : float
        Change of its mean, in deviations: tests of the mean judge what exceeds it.
    low, high : float
        Mean square over a long window, 1 at the time of identification: tests of the energy judge what lies outside.
    """

    mean: float = 0.0
    low: float = 1.0
    high: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """A statistic over time, to be held against a threshold of its own.

    Attributes
    ----------
    label : str
        Which test, of what, over which window.
    values : shape (samples,)
        NaN where it doesn't exist (yet).
    reach : int or shape (samples,)
        How many rows back the change that it tells of began.
    looks_per_row : float
        Of a log-likelihood ratio in nats: how often it looks at new noise. 0 for other statistics.
    """

    label: str
    values: FloatArray = field(repr=False)
    reach: int | np.ndarray[tuple[int], np.dtype[np.int_]] = field(repr=False)
    looks_per_row: float = 0.0

    def least_threshold(self, crossings_per_row: float) -> float:
        """Return the threshold that white Gaussian noise asks for, P(ratio > z) = exp(-z) a look; -inf without theory.

        No threshold goes below it: a tolerance, or few healthy hours, may leave nothing to see in the tail.
        """
        return float(np.log(self.looks_per_row / crossings_per_row)) if self.looks_per_row else -np.inf


@dataclass(frozen=True, kw_only=True)
class Statistic:
    """A kind of test and its parameters; windows in seconds, shifts and ratios in deviations and variances.

    Attributes
    ----------
    name : str
        A key of `STATISTICS`: ``glr``, ``cusum``, ``whitened_energy`` or ``energy``.
    windows_s : tuple of float
        Lengths of the windows; ``cusum`` has none.
    baseline_s : float
        The mean before a window, over so many seconds, is what its mean is compared with: a bias since turn-on, or
        one that wanders slowly, is no change. At least a sixth of it must be there.
    shift, ratio : float
        Change of mean (deviations of the whitened residual) and of variance that ``cusum`` is tuned to.
    two_sided : bool
        Whether too little energy alarms as well (a jam removes the sensor's noise).
    """

    name: str = "glr"
    windows_s: tuple[float, ...] = (0.08, 0.16, 0.32, 0.64, 1.28, 2.56, 5.12, 10.24, 20.48)
    baseline_s: float = 60.0
    shift: float = 0.25
    ratio: float = 2.0
    two_sided: bool = True

    def series(
        self,
        raw: FloatArray,
        white: FloatArray,
        sample_period_s: float,
        tolerance: Tolerance,
        spread: Spread | None = None,
    ) -> list[Series]:
        """Return the series of one residual, raw (in the output's unit) and whitened, row for row beside it."""
        plain = raw if self.name == "energy" else white
        by = 1.0 if spread is None else spread.raw if self.name == "energy" else spread.white
        there = np.flatnonzero(np.isfinite(plain))
        most = 1e150 if self.name == "energy" else _MOST
        given = Given(
            values=np.clip((plain / by)[there], -most, most),
            plain=np.clip(plain[there], -most, most),
            means={} if spread is None else {rows: values[there] for rows, values in spread.means.items()},
            doubtful=np.zeros(len(there)) if spread is None else (1.0 - 1.0 / np.square(spread.white))[there],
        )
        found = STATISTICS[self.name](self, given, sample_period_s, tolerance)
        placed = []
        for series in found:
            values = np.full(len(raw), np.nan)
            values[there] = series.values
            reach = np.zeros(len(raw), dtype=int)
            began = np.maximum(np.arange(len(there)) - series.reach, 0)
            reach[there] = there - there[began]
            placed.append(replace(series, values=values, reach=reach))
        return placed

    def rows(self, sample_period_s: float) -> list[int]:
        """Return the windows' lengths in samples, each once; the shortest has 4."""
        return sorted({max(round(window_s / sample_period_s), 4) for window_s in self.windows_s})


def _energy(test: Statistic, given: Given, sample_period_s: float, _: Tolerance) -> list[Series]:
    """E(k) of (4.12): sqrt of the sum of squares of the raw residual over w + 1 samples."""
    found = []
    for rows in test.rows(sample_period_s):
        norm = np.sqrt(_trailing(np.square(given.values), rows + 1))
        found += _sides(test, f"energy {rows * sample_period_s:g} s", norm, -norm, rows)
    return found


def _whitened_energy(test: Statistic, given: Given, sample_period_s: float, _: Tolerance) -> list[Series]:
    """RMS of the whitened residual over a window; healthy: about 1."""
    found = []
    for rows in test.rows(sample_period_s):
        rms = np.sqrt(_trailing(np.square(given.values), rows) / rows)
        found += _sides(test, f"whitened energy {rows * sample_period_s:g} s", rms, -rms, rows)
    return found


def _cusum(test: Statistic, given: Given, sample_period_s: float, tolerance: Tolerance) -> list[Series]:
    """Page's cumulative sums of log-likelihood ratios: mean +-shift, variance times and over ratio."""
    w = given.values
    base, _ = _baseline(_sums(w), test, sample_period_s, gap=1)  # a sample isn't compared with itself
    centred = w - base
    ready = np.isfinite(centred)
    x = np.where(ready, centred, 0.0)
    square = np.square(x)
    steps = {
        "mean up": test.shift * (x - tolerance.mean) - test.shift**2 / 2.0,
        "mean down": test.shift * (-x - tolerance.mean) - test.shift**2 / 2.0,
        "variance up": 0.5 * square / tolerance.high * (1.0 - 1.0 / test.ratio) - 0.5 * np.log(test.ratio),
    }
    if test.two_sided:
        steps["variance down"] = 0.5 * square / tolerance.low * (1.0 - test.ratio) + 0.5 * np.log(test.ratio)
    found = []
    for label, step in steps.items():
        sums = np.cumsum(np.where(ready, step, 0.0))
        low = np.minimum.accumulate(np.minimum(sums, 0.0))
        zero = np.maximum.accumulate(np.where(sums <= low, np.arange(len(sums)), 0))
        values = np.where(ready, sums - low, np.nan)
        found.append(
            Series(label=f"cusum {label}", values=values, reach=np.arange(len(sums)) - zero, looks_per_row=0.1)
        )
    return found


def _glr(test: Statistic, given: Given, sample_period_s: float, tolerance: Tolerance) -> list[Series]:
    """Generalised likelihood ratios over windows of L samples, in nats.

    Of another mean than m0 before: (|m1 - m0| - t)^2 / (2 (1/L + 1/M + v)) beyond the tolerance t, v the variance that
    the operator's error gives it. Of another variance: L/2 (s - 1 - log s), s the mean square about m0 over the
    nearest end of the tolerated range, which is wider where the operator's error dominates.
    """
    found = []
    for rows in test.rows(sample_period_s):
        _, power, _ = _windows(given.values, rows, test, sample_period_s)
        shift, _, length = _windows(given.plain, rows, test, sample_period_s)
        beyond = np.maximum(np.abs(shift) - tolerance.mean, 0.0)
        of_mean = np.square(beyond) / (2.0 * (1.0 / rows + 1.0 / np.maximum(length, 1) + given.means.get(rows, 0.0)))
        low = tolerance.low if test.two_sided else 0.0
        high = np.maximum(tolerance.high, 1.0 + (_FAR**2 - 1.0) * _trailing(given.doubtful, rows) / rows)
        ratio = power / np.clip(power, low, high)
        of_energy = 0.5 * rows * (ratio - 1.0 - np.log(ratio))
        window = f"{rows * sample_period_s:g} s"
        looks = min(8.0 / rows, 1.0)  # overlapping windows: several a length
        found.append(Series(label=f"mean {window}", values=of_mean, reach=rows, looks_per_row=looks))
        found.append(Series(label=f"energy {window}", values=of_energy, reach=rows, looks_per_row=looks))
    return found


STATISTICS: dict[str, Callable[[Statistic, Given, float, Tolerance], list[Series]]] = {
    "glr": _glr,
    "cusum": _cusum,
    "whitened_energy": _whitened_energy,
    "energy": _energy,
}


def _windows(
    w: FloatArray, rows: int, test: Statistic, sample_period_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the last rows' mean and mean square about the mean before them, and how many rows that stands on."""
    sums, squares = _sums(w), _sums(np.square(w))
    base, length = _baseline(sums, test, sample_period_s, gap=rows)
    mean, power = np.full(len(w), np.nan), np.full(len(w), np.nan)
    mean[rows - 1 :] = (sums[rows:] - sums[:-rows]) / rows
    power[rows - 1 :] = (squares[rows:] - squares[:-rows]) / rows
    return mean - base, np.maximum(power - 2.0 * base * mean + np.square(base), 1e-12), length


def _sides(test: Statistic, label: str, high: FloatArray, low: FloatArray, rows: int) -> list[Series]:
    up = Series(label=f"{label} high", values=high, reach=rows)
    return [up, Series(label=f"{label} low", values=low, reach=rows)] if test.two_sided else [up]


def _trailing(values: FloatArray, length: int) -> FloatArray:
    """Return sums of the last `length` values, NaN before there are so many."""
    sums = np.full(len(values), np.nan)
    complete = len(values) - length + 1
    if complete > 0:
        sums[length - 1 :] = moving_sum(values, length)[:complete]
    return sums


def _sums(values: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(values)])


def _baseline(sums: FloatArray, test: Statistic, sample_period_s: float, *, gap: int) -> tuple[FloatArray, FloatArray]:
    """Return the mean of up to `baseline_s` before the last `gap` rows, and how many rows it stands on."""
    longest = max(round(test.baseline_s / sample_period_s), 6)
    end = np.arange(1, len(sums)) - gap  # one past the last row of the baseline
    begin = np.maximum(end - longest, 0)
    length = end - begin
    enough = length >= longest // 6
    total = sums[np.maximum(end, 0)] - sums[begin]
    return np.where(enough, total / np.maximum(length, 1), np.nan), np.where(enough, length, 0).astype(float)


def tolerance_of(
    whites: Sequence[FloatArray], test: Statistic, sample_period_s: float, *, noise: float = 0.0
) -> Tolerance:
    """Return what healthy whitened residuals do beyond noise, three times the greatest seen over long windows.

    The windows hold 20 s (a fortieth of all samples, where there are few). Of the means' changes, what noise explains
    (four deviations) is left out; of the mean squares `noise` deviations, which matter where windows are short.
    """
    given = [np.clip(white[np.isfinite(white)], -_MOST, _MOST) for white in whites]
    rows = max(min(round(_LONG_S / sample_period_s), sum(map(len, given)) // 40), 4)
    shifts, powers = [0.0], [1.0]
    for w in given:
        shift, power, length = _windows(w, rows, test, sample_period_s)
        some = np.arange(rows - 1, len(w), max(rows // 2, 1))
        some = some[np.isfinite(power[some])]
        shifts += (np.abs(shift[some]) - 4.0 * np.sqrt(1.0 / rows + 1.0 / length[some])).tolist()
        chance = noise * np.sqrt(2.0 / rows)
        powers += (power[some] - np.clip(power[some] - 1.0, -chance, chance)).tolist()
    return Tolerance(
        mean=3.0 * max(shifts),
        low=1.0 / (1.0 + 3.0 * (1.0 / max(min(powers), 1e-3) - 1.0)),
        high=1.0 + 3.0 * (max(powers) - 1.0),
    )
