"""Test statistics: what a residual is turned into before it is held against a threshold.

Each takes one residual, as it is and whitened, and returns one or several scores. Row k of a score uses rows up to k,
so it is known when the residual's row k is. Missing rows are passed over: a window holds the last samples that exist.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.method.residual import moving_sum
from gtmbench.record import FloatArray

_LONG_S = 20.0
_FAR = 4.0  # deviations that an operator's error may have: one for all samples, it isn't averaged
MOST = 100.0  # deviations: what one sample may weigh, so that sums stay exact after a spike


Carried = dict[str, tuple[float, int]]  # by label: a cumulative sum, and how many samples ago it left zero


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
class Spread:
    """How far a residual may be off where its operator is uncertain.

    Attributes
    ----------
    raw, white : shape (samples,)
        By which the residual, as it is and whitened, is divided before its energy is judged; 1 where all is known.
    means : mapping of int to array of shape (samples,)
        Of windows of so many samples: the variance of their mean about that of the baseline before, in whitened
        samples, from the operator's error alone. That is one error, at all samples: windows don't average it out.
    """

    raw: FloatArray = field(repr=False)
    white: FloatArray = field(repr=False)
    means: Mapping[int, FloatArray] = field(default_factory=dict, repr=False)

    def between(self, rows: slice) -> Spread:
        """Return some rows."""
        means = {window: values[rows] for window, values in self.means.items()}
        return Spread(raw=self.raw[rows], white=self.white[rows], means=means)

    @staticmethod
    def joined(parts: Sequence[Spread]) -> Spread:
        """Return parts that follow each other as one; at least one, of the same windows."""
        return Spread(
            raw=np.concatenate([part.raw for part in parts]),
            white=np.concatenate([part.white for part in parts]),
            means={window: np.concatenate([part.means[window] for part in parts]) for window in parts[0].means},
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Given:
    """What a statistic is made of: a residual over its spread, and as it is; `means` as in `Spread`.

    `uncertain` is the share of the variance of `values` that an operator's error has, 0 where all is known.
    """

    values: FloatArray
    plain: FloatArray
    means: Mapping[int, FloatArray]
    uncertain: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class RawScore:
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

    def scores(
        self,
        raw: FloatArray,
        white: FloatArray,
        sample_period_s: float,
        tolerance: Tolerance,
        spread: Spread | None = None,
    ) -> list[RawScore]:
        """Return the scores of one residual, raw (in the output's unit) and whitened, row for row beside it."""
        there, given = self.given(raw, white, spread)
        placed = []
        for score in self.of(given, sample_period_s, tolerance):
            values = np.full(len(raw), np.nan)
            values[there] = score.values
            reach = np.zeros(len(raw), dtype=int)
            began = np.maximum(np.arange(len(there)) - score.reach, 0)
            reach[there] = there - there[began]
            placed.append(replace(score, values=values, reach=reach))
        return placed

    def given(
        self, raw: FloatArray, white: FloatArray, spread: Spread | None = None
    ) -> tuple[np.ndarray[tuple[int], np.dtype[np.int_]], Given]:
        """Return the rows where there is a sample, and what the statistic is made of there."""
        plain = raw if self.name == "energy" else white
        there = np.flatnonzero(np.isfinite(plain))
        most = 1e150 if self.name == "energy" else MOST
        clipped = np.clip(plain[there], -most, most)
        if spread is None:
            return there, Given(values=clipped, plain=clipped, means={}, uncertain=np.zeros(len(there)))
        by = spread.raw if self.name == "energy" else spread.white
        return there, Given(
            values=np.clip((plain / by)[there], -most, most),
            plain=clipped,
            means={rows: values[there] for rows, values in spread.means.items()},
            uncertain=(1.0 - 1.0 / np.square(spread.white))[there],
        )

    def of(
        self,
        given: Given,
        sample_period_s: float,
        tolerance: Tolerance,
        *,
        last: int | None = None,
        carried: Carried | None = None,
    ) -> list[RawScore]:
        """Return the scores of samples that exist, one after the other; `reach` counts such samples.

        Parameters
        ----------
        given : Given
        sample_period_s : float
        tolerance : Tolerance
        last : int, optional
            Only of so many at the end; those before are looked back at. `looks_back` of them are enough.
        carried : dict, optional
            Where ``cusum`` stood with the sample before the last ones; told anew.
        """
        count = len(given.values) if last is None else last
        return STATISTICS[self.name](self, given, sample_period_s, tolerance, count, {} if carried is None else carried)

    def looks_back(self, sample_period_s: float) -> int:
        """Return how many samples before one its statistics look at: a baseline and the longest window."""
        return max(round(self.baseline_s / sample_period_s), 6) + self.rows(sample_period_s)[-1] + 1

    def rows(self, sample_period_s: float) -> list[int]:
        """Return the windows' lengths in samples, each once; the shortest has 4."""
        return sorted({max(round(window_s / sample_period_s), 4) for window_s in self.windows_s})


def _energy(
    test: Statistic, given: Given, sample_period_s: float, _: Tolerance, last: int, __: Carried
) -> list[RawScore]:
    """E(k) of (4.12): sqrt of the sum of squares of the raw residual over w + 1 samples."""
    squares = np.square(given.values)
    norms = {rows: np.sqrt(_trailing(squares, rows + 1, last)) for rows in test.rows(sample_period_s)}
    return _sides(test, "energy", norms, sample_period_s)


def _whitened_energy(
    test: Statistic, given: Given, sample_period_s: float, _: Tolerance, last: int, __: Carried
) -> list[RawScore]:
    """RMS of the whitened residual over a window; healthy: about 1."""
    squares = np.square(given.values)
    rms = {rows: np.sqrt(_trailing(squares, rows, last) / rows) for rows in test.rows(sample_period_s)}
    return _sides(test, "whitened energy", rms, sample_period_s)


def _cusum(
    test: Statistic, given: Given, sample_period_s: float, tolerance: Tolerance, last: int, carried: Carried
) -> list[RawScore]:
    """Page's cumulative sums of log-likelihood ratios: mean +-shift, variance times and over ratio."""
    w = given.values
    base, _ = _baseline(_sums(w), test, sample_period_s, gap=1, last=last)  # a sample isn't compared with itself
    centred = w[len(w) - last :] - base
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
    scores = []
    for label, step in steps.items():
        stood, since = carried.get(label, (0.0, 0))
        sums = stood + np.cumsum(np.where(ready, step, 0.0))
        low = np.minimum.accumulate(np.minimum(sums, 0.0))
        zero = np.maximum.accumulate(np.where(sums <= low, np.arange(len(sums)), -since))
        values, reach = sums - low, np.arange(len(sums)) - zero
        if len(values):
            carried[label] = (float(values[-1]), int(reach[-1]) + 1)
        scores.append(
            RawScore(label=f"cusum {label}", values=np.where(ready, values, np.nan), reach=reach, looks_per_row=0.1)
        )
    return scores


def _glr(
    test: Statistic, given: Given, sample_period_s: float, tolerance: Tolerance, last: int, __: Carried
) -> list[RawScore]:
    """Generalised likelihood ratios over windows of L samples, in nats.

    Of another mean than m0 before: (|m1 - m0| - t)^2 / (2 (1/L + 1/M + v)) beyond the tolerance t, v the variance that
    the operator's error gives it. Of another variance: L/2 (s - 1 - log s), s the mean square about m0 over the
    nearest end of the tolerated range, which is wider where the operator's error dominates.
    """
    scores = []
    low = tolerance.low if test.two_sided else 0.0
    plain, values = _Sums.of(given.plain), None if given.values is given.plain else _Sums.of(given.values)
    for rows in test.rows(sample_period_s):
        shift, power, length = _windows(plain, rows, test, sample_period_s, last)
        variance: float | FloatArray = 0.0
        high: float | FloatArray = tolerance.high
        if values is not None:
            _, power, _ = _windows(values, rows, test, sample_period_s, last)
            uncertain = _trailing(given.uncertain, rows, last) / rows
            high = np.maximum(tolerance.high, 1.0 + (_FAR**2 - 1.0) * uncertain)
            variance = given.means[rows][len(given.plain) - last :] if rows in given.means else 0.0
        chance = 1.0 / rows + 1.0 / np.maximum(length, 1) + variance
        of_mean, of_energy = glr(shift, power, rows, chance, tolerance.mean, low, high)
        window = f"{rows * sample_period_s:g} s"
        looks = min(8.0 / rows, 1.0)  # overlapping windows: several a length
        scores.append(RawScore(label=f"mean {window}", values=of_mean, reach=rows, looks_per_row=looks))
        scores.append(RawScore(label=f"energy {window}", values=of_energy, reach=rows, looks_per_row=looks))
    return scores


def glr(
    shift: FloatArray,
    power: FloatArray,
    rows: int | FloatArray,
    chance: float | FloatArray,
    tolerance: float | FloatArray,
    low: float | FloatArray,
    high: float | FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the two ratios of `_glr`, of arrays of any shape: windows of `rows`, `chance` the shift's variance."""
    beyond = np.maximum(np.abs(shift) - tolerance, 0.0)
    ratio = power / np.minimum(np.maximum(power, low), high)
    return beyond * beyond / (2.0 * chance), 0.5 * rows * (ratio - 1.0 - np.log(ratio))


STATISTICS: dict[str, Callable[[Statistic, Given, float, Tolerance, int, Carried], list[RawScore]]] = {
    "glr": _glr,
    "cusum": _cusum,
    "whitened_energy": _whitened_energy,
    "energy": _energy,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sums:
    """Sums of samples and of their squares, up to each."""

    plain: FloatArray
    squares: FloatArray

    @classmethod
    def of(cls, w: FloatArray) -> _Sums:
        return cls(plain=_sums(w), squares=_sums(w * w))


def _windows(
    w: _Sums, rows: int, test: Statistic, sample_period_s: float, last: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return, at the last samples, `rows` samples' mean and mean square about the mean before, and its length."""
    base, length = _baseline(w.plain, test, sample_period_s, gap=rows, last=last)
    mean = (_before(w.plain, 0, last) - _before(w.plain, rows, last)) / rows
    power = (_before(w.squares, 0, last) - _before(w.squares, rows, last)) / rows
    return mean - base, np.maximum(power - 2.0 * base * mean + base * base, 1e-12), length


def _sides(test: Statistic, name: str, norms: dict[int, FloatArray], sample_period_s: float) -> list[RawScore]:
    """Return the scores of norms over windows of so many samples: too high, and too low."""
    scores = []
    for rows, norm in norms.items():
        window = f"{name} {rows * sample_period_s:g} s"
        scores.append(RawScore(label=f"{window} high", values=norm, reach=rows))
        if test.two_sided:
            scores.append(RawScore(label=f"{window} low", values=-norm, reach=rows))
    return scores


def _trailing(values: FloatArray, length: int, last: int) -> FloatArray:
    """Return sums of `length` values up to each of the last ones, NaN where there aren't so many."""
    values = values[max(len(values) - last - length + 1, 0) :]
    sums = np.full(len(values), np.nan)
    complete = len(values) - length + 1
    if complete > 0:
        sums[length - 1 :] = moving_sum(values, length)[:complete]
    return sums[len(values) - last :]


def _sums(values: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(values)])


def _before(sums: FloatArray, lag: int, last: int, otherwise: float = np.nan) -> FloatArray:
    """Return the sums up to `lag` samples before each of the last ones."""
    stop = len(sums) - lag
    if stop >= last:
        return sums[stop - last : stop]
    return np.concatenate([np.full(last - max(stop, 0), otherwise), sums[: max(stop, 0)]])


def _baseline(
    sums: FloatArray, test: Statistic, sample_period_s: float, *, gap: int, last: int
) -> tuple[FloatArray, FloatArray]:
    """Return the mean of up to `baseline_s` before the last `gap` rows, and how many rows it stands on."""
    longest = max(round(test.baseline_s / sample_period_s), 6)
    length = np.clip(np.arange(len(sums) - last, len(sums)) - gap, 0, longest)
    enough = length >= longest // 6
    total = _before(sums, gap, last, 0.0) - _before(sums, gap + longest, last, 0.0)
    return np.where(enough, total / np.maximum(length, 1), np.nan), np.where(enough, length, 0).astype(float)


def tolerance_of(
    whites: Sequence[FloatArray], test: Statistic, sample_period_s: float, *, noise: float = 0.0
) -> Tolerance:
    """Return what healthy whitened residuals do beyond noise, three times the greatest over long windows.

    The windows hold 20 s (a fortieth of all samples, where there are few). Of the means' changes, what noise explains
    (four deviations) is left out; of the mean squares `noise` deviations, which matter where windows are short.
    """
    given = [np.clip(white[np.isfinite(white)], -MOST, MOST) for white in whites]
    rows = max(min(round(_LONG_S / sample_period_s), sum(map(len, given)) // 40), 4)
    shifts, powers = [0.0], [1.0]
    for w in given:
        shift, power, length = _windows(_Sums.of(w), rows, test, sample_period_s, len(w))
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
