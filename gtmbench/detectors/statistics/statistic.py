"""Test statistics: what a residual is turned into before it is held against a threshold.

Each takes one residual, as it is and whitened, and returns one or several scores. Row k of a score uses rows up to k,
so it is known when the residual's row k is. Missing rows are passed over: a window holds the last samples that exist.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from gtmbench.detectors.statistics.whitening import White
from gtmbench.method.residual import moving_sum
from gtmbench.values.record import FloatArray

_LONG_S = 20.0  # windows over which it is looked at what healthy noise does
_FAR = 4.0  # deviations that an operator's error may have: one for all samples, it isn't averaged
_LOUDEST = 9.0  # times the power that was learnt: noise that wanders so far is a fault
_STEADY, _WIDENED = 0.03, 2.5  # sigma that is as good as none; how much more of it widens what a mean may be
_KNOWN = 1e-15  # sigma^2 that is as good as none: ratios of n nats are off by n^2 / 2 of it
LEAST_BASELINE = 9  # part of the baseline that must be there
MOST = 100.0  # deviations: what one sample may weigh, so that sums stay exact after a spike


_BothSums = tuple[FloatArray, FloatArray]  # of samples up to each, and of their squares
Carried = dict[str, tuple[float, int]]  # by label: a cumulative sum, and how many samples ago it left zero


@dataclass(frozen=True, kw_only=True)
class Allowance:
    """What a healthy whitened residual may do beyond noise: manoeuvres, gusts and imperfect sensors make it so."""

    mean: float = 0.0  # change of its mean, in deviations: tests of the mean judge what exceeds it
    # low, high: mean square over a long window, 1 at the time of identification: tests of the energy judge what lies
    # outside
    low: float = 1.0
    high: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """How far a residual may be off where its operator is uncertain."""

    # raw, white, shape (samples,): by which the residual, as it is and whitened, is divided before its energy is
    # judged; 1 where all is known
    raw: FloatArray = field(repr=False)
    white: FloatArray = field(repr=False)
    # shape (samples,): of windows of so many samples: the variance of their mean about that of the baseline before, in
    # whitened samples, from the operator's error alone. That is one error, at all samples: windows don't average it out
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

    `uncertain` is the share of the variance of `values` that an operator's error has, 0 where all is known; `unsteady`,
    `slow` and `loud` as in `White`.
    """

    values: FloatArray
    plain: FloatArray
    means: Mapping[int, FloatArray]
    uncertain: FloatArray
    unsteady: FloatArray
    slow: FloatArray
    loud: FloatArray

    @cached_property
    def sums(self) -> _BothSums:
        """Of `values`."""
        return _both_sums(self.values)

    @cached_property
    def plain_sums(self) -> _BothSums:
        """Of `plain`."""
        return self.sums if self.plain is self.values else _both_sums(self.plain)


@dataclass(frozen=True, kw_only=True, eq=False)
class RawScore:
    """A statistic over time, to be held against a threshold of its own."""

    label: str  # which test, of what, over which window
    values: FloatArray = field(repr=False)  # shape (samples,): NaN where it doesn't exist (yet)
    # shape (samples,): how many rows back the change that it tells of began
    reach: int | np.ndarray[tuple[int], np.dtype[np.int_]] = field(repr=False)
    # of a log-likelihood ratio in nats: how often it looks at new noise. 0 for other statistics
    looks_per_row: float = 0.0
    most: float = np.inf  # which no fault passes

    def least_threshold(self, crossings_per_row: float) -> float:
        """Return the threshold that white Gaussian noise asks for, P(ratio > z) = exp(-z) a look; -inf without theory.

        No threshold goes below it: a tolerance, or few healthy hours, may leave nothing to see in the tail.
        """
        return float(np.log(self.looks_per_row / crossings_per_row)) if self.looks_per_row else -np.inf


@dataclass(frozen=True, kw_only=True)
class Statistic:
    """A kind of test and its parameters; windows in seconds, shifts and ratios in deviations and variances."""

    name: str = "glr"  # a key of `STATISTICS`: ``glr``, ``cusum``, ``whitened_energy`` or ``energy``
    # lengths of the windows; ``cusum`` has none
    windows_s: tuple[float, ...] = (0.08, 0.16, 0.32, 0.64, 1.28, 2.56, 5.12, 10.24, 20.48)
    # the mean before a window, over so many seconds, is what its mean is compared with: a bias since turn-on, or one
    # that wanders slowly, is no change. At least a ninth of it must be there
    baseline_s: float = 60.0
    # shift, ratio: change of mean (deviations of the whitened residual) and of variance that ``cusum`` is tuned to
    shift: float = 0.25
    ratio: float = 2.0
    two_sided: bool = True  # whether too little energy alarms as well (a jam removes the sensor's noise)

    def scores(
        self,
        raw: FloatArray,
        white: White,
        sample_period_s: float,
        tolerance: Allowance,
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
        self, raw: FloatArray, white: White, spread: Spread | None = None
    ) -> tuple[np.ndarray[tuple[int], np.dtype[np.int_]], Given]:
        """Return the rows where there is a sample, and what the statistic is made of there."""
        plain = raw if self.name == "energy" else white.values
        there = np.flatnonzero(np.isfinite(plain))
        most = 1e150 if self.name == "energy" else MOST
        clipped = plain[there]
        np.clip(clipped, -most, most, out=clipped)
        own = slice(None) if len(there) == len(plain) else there  # what needn't be copied isn't
        unsteady, slow, loud = white.unsteady[own], white.slow[own], white.loud[own]
        if spread is None:
            known = np.broadcast_to(0.0, len(there))
            noise = {"uncertain": known, "unsteady": unsteady, "slow": slow, "loud": loud}
            return there, Given(values=clipped, plain=clipped, means={}, **noise)
        by = spread.raw if self.name == "energy" else spread.white
        return there, Given(
            values=np.clip((plain / by)[own], -most, most),
            plain=clipped,
            means={rows: values[own] for rows, values in spread.means.items()},
            uncertain=(1.0 - 1.0 / np.square(spread.white))[own],
            unsteady=unsteady,
            slow=slow,
            loud=loud,
        )

    def of(
        self,
        given: Given,
        sample_period_s: float,
        tolerance: Allowance,
        *,
        at: range | None = None,
        carried: Carried | None = None,
    ) -> Iterator[RawScore]:
        """Yield the scores of samples that exist, a test after the other; `reach` counts such samples.

        Values are there until the next test is asked for: its own may take their place.

        `at`: only of these; those before are looked back at. `looks_back` of them are enough. `carried`: where
        ``cusum`` stood with the sample before these; told anew.
        """
        some = range(len(given.values)) if at is None else at
        return STATISTICS[self.name](self, given, sample_period_s, tolerance, some, {} if carried is None else carried)

    def looks_back(self, sample_period_s: float) -> int:
        """Return how many samples before one its statistics look at: a baseline and the longest window."""
        return max(round(self.baseline_s / sample_period_s), 6) + self.rows(sample_period_s)[-1] + 1

    def rows(self, sample_period_s: float) -> list[int]:
        """Return the windows' lengths in samples, each once; the shortest has 4."""
        return sorted({max(round(window_s / sample_period_s), 4) for window_s in self.windows_s})


def _energy(
    test: Statistic, given: Given, sample_period_s: float, _: Allowance, at: range, __: Carried
) -> Iterator[RawScore]:
    """E(k) of (4.12): sqrt of the sum of squares of the raw residual over w + 1 samples."""
    squares = np.square(given.values[: at.stop])
    norms = ((rows, np.sqrt(_trailing(squares, rows + 1, at))) for rows in test.rows(sample_period_s))
    return _sides(test, "energy", norms, sample_period_s)


def _whitened_energy(
    test: Statistic, given: Given, sample_period_s: float, _: Allowance, at: range, __: Carried
) -> Iterator[RawScore]:
    """RMS of the whitened residual over a window; healthy: about 1."""
    squares = np.square(given.values[: at.stop])
    rms = ((rows, np.sqrt(_trailing(squares, rows, at) / rows)) for rows in test.rows(sample_period_s))
    return _sides(test, "whitened energy", rms, sample_period_s)


def _cusum(
    test: Statistic, given: Given, sample_period_s: float, tolerance: Allowance, at: range, carried: Carried
) -> Iterator[RawScore]:
    """Page's cumulative sums of log-likelihood ratios: mean +-shift, variance times and over ratio."""
    base, _ = _baseline(given.sums[0], test, sample_period_s, gap=1, at=at)  # a sample isn't compared with itself
    centred = given.values[at.start : at.stop] - base
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
    for label, step in steps.items():
        stood, since = carried.get(label, (0.0, 0))
        sums = stood + np.cumsum(np.where(ready, step, 0.0))
        low = np.minimum.accumulate(np.minimum(sums, 0.0))
        zero = np.maximum.accumulate(np.where(sums <= low, np.arange(len(sums)), -since))
        values, reach = sums - low, np.arange(len(sums)) - zero
        if len(values):
            carried[label] = (float(values[-1]), int(reach[-1]) + 1)
        yield RawScore(label=f"cusum {label}", values=np.where(ready, values, np.nan), reach=reach, looks_per_row=0.1)


def _glr(
    test: Statistic, given: Given, sample_period_s: float, tolerance: Allowance, at: range, __: Carried
) -> Iterator[RawScore]:
    """Generalised likelihood ratios over windows of L samples, in nats.

    Of another mean than m0 before: z^2 = (|m1 - m0| - t)^2 / (1/L + 1/M + 2 w + v) beyond the tolerance t, w the
    variance that slow noise gives a mean, v what the operator's error does. Of another variance: s, the mean square
    about m0 over the nearest end of the tolerated range, which is wider where the operator's error dominates. `glr`
    makes ratios of them.
    """
    low = tolerance.low if test.two_sided else 0.0
    steadiness, slow = Steadiness.of(given.unsteady[at.start : at.stop]), given.slow[at.start : at.stop]
    for rows in test.rows(sample_period_s):
        shift, power, length = _windows(given.plain_sums, rows, test, sample_period_s, at)
        variance: float | FloatArray = 0.0
        high: float | FloatArray = tolerance.high
        if given.values is not given.plain:
            _, power, _ = _windows(given.sums, rows, test, sample_period_s, at)
            uncertain = _trailing(given.uncertain, rows, at) / rows
            high = np.maximum(tolerance.high, 1.0 + (_FAR**2 - 1.0) * uncertain)
            variance = given.means[rows][at.start : at.stop] if rows in given.means else 0.0
        chance = 1.0 / rows + 1.0 / length + 2.0 * slow + variance
        of_mean, of_energy = glr(shift, power, rows, chance, tolerance.mean, low, high, steadiness)
        window = f"{rows * sample_period_s:g} s"
        looks = min(8.0 / rows, 1.0)  # overlapping windows: several a length
        yield RawScore(label=f"mean {window}", values=of_mean, reach=rows, looks_per_row=looks)
        yield RawScore(label=f"energy {window}", values=of_energy, reach=rows, looks_per_row=looks)


@dataclass(frozen=True, kw_only=True, eq=False)
class Steadiness:
    """How steady noise is, as `glr` weighs it: shaped like the windows' rows, or one for all.

    With sigma^2 the noise's unsteadiness, its power is as well known as from nu = 2 / sigma^2 samples.
    """

    worth: FloatArray  # nu
    widened: FloatArray  # times a mean's variance: the noise's colour wanders with its power
    # quieter, louder: of what was learnt, what power may be: exp(-2 sigma) and exp(2 sigma), but never more than
    # `_LOUDEST`
    quieter: FloatArray
    louder: FloatArray

    @classmethod
    def of(cls, unsteady: float | FloatArray) -> Steadiness:
        """Return that of sigma^2."""
        sigma = np.sqrt(unsteady)
        wide = np.exp(2.0 * sigma)
        return cls(
            worth=2.0 / np.maximum(unsteady, _KNOWN),
            widened=np.minimum(np.exp(_WIDENED * np.maximum(sigma - _STEADY, 0.0)), _LOUDEST),
            quieter=1.0 / wide,
            louder=np.minimum(wide, _LOUDEST),
        )


def glr(
    shift: FloatArray,
    power: FloatArray,
    rows: int | FloatArray,
    chance: float | FloatArray,
    tolerance: float | FloatArray,
    low: float | FloatArray,
    high: float | FloatArray,
    steadiness: Steadiness,
) -> tuple[FloatArray, FloatArray]:
    """Return the two ratios of `_glr`, in nats: windows of `rows`, `chance` the shift's variance.

    A shift of z deviations is judged by Student's ratio, (nu + L)/2 log(1 + z^2 / (nu + L v)), v the window's variance
    about its own mean, and a power s by that of two samples, (nu + L)/2 log((nu + L s) / (nu + L)) - L/2 log s.
    Besides, power may be louder or quieter than what was learnt, and a mean's variance larger, but never beyond
    `_LOUDEST`: that is no noise any more. Where sigma is 0 these are z^2 / 2 and L/2 (s - 1 - log s), and they are
    never more.
    """
    worth, known = steadiness.worth, steadiness.worth + rows
    # v, the variance about the window's own mean, and z^2
    within = np.maximum(power - np.square(shift), 0.0)
    square = np.square(np.maximum(np.abs(shift) - tolerance, 0.0)) / chance
    of_mean = 0.5 * known * np.log1p(square / (worth + rows * within))
    # never more than noise of that unsteadiness allows, never less than what no noise is loud enough for
    np.minimum(of_mean, square / (2.0 * steadiness.widened), out=of_mean)
    np.maximum(of_mean, square / (2.0 * _LOUDEST), out=of_mean)
    # s: 1 within the tolerated range, else over its nearer end
    ratio = power / np.minimum(np.maximum(power, low * steadiness.quieter), high * steadiness.louder)
    of_energy = 0.5 * known * np.log1p(rows * (ratio - 1.0) / known) - 0.5 * rows * np.log(ratio)
    loud = power / (high * _LOUDEST)
    if (loud > 1.0).any():
        np.maximum(loud, 1.0, out=loud)
        np.maximum(of_energy, 0.5 * rows * (loud - 1.0 - np.log(loud)), out=of_energy)
    return of_mean, of_energy


@lru_cache(maxsize=256)
def ordinary_powers(rows: int, nats: float) -> tuple[float, float]:
    """Return the powers of windows between which L/2 (s - 1 - log s), which no ratio exceeds, is below so many nats.

    >>> low, high = ordinary_powers(100, 10.0)
    >>> round(low, 2), round(high, 2)
    (0.49, 1.77)
    >>> ordinary_powers(4, 200.0)[0]  # however quiet
    0.0
    """
    powers = np.geomspace(1e-12, 1e6, 20_000)
    near = powers[0.5 * rows * (powers - 1.0 - np.log(powers)) < nats]
    return (float(near[0]) if near[0] > powers[0] else 0.0), float(near[-1])


def over(values: FloatArray, threshold: float) -> FloatArray:
    """Return values over their threshold: above 1 where they pass it, also where both are negative."""
    if 0.0 < threshold < np.inf:
        return values / threshold
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(threshold / values if threshold < 0.0 else values / threshold)


STATISTICS: dict[str, Callable[[Statistic, Given, float, Allowance, range, Carried], Iterator[RawScore]]] = {
    "glr": _glr,
    "cusum": _cusum,
    "whitened_energy": _whitened_energy,
    "energy": _energy,
}


def _windows(
    w: _BothSums, rows: int, test: Statistic, sample_period_s: float, at: range
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return, at some samples, `rows` samples' mean and mean square about the mean before, and its length."""
    plain, squares = w
    base, length = _baseline(plain, test, sample_period_s, gap=rows, at=at)
    # m1, then E w^2 of the window; about m0 that is E w^2 - 2 m0 m1 + m0^2, in place
    shift = _before(plain, 0, at) - _before(plain, rows, at)
    shift /= rows
    power = _before(squares, 0, at) - _before(squares, rows, at)
    power /= rows
    more = base * shift
    more *= 2.0
    power -= more
    shift -= base
    base *= base
    power += base
    return shift, np.maximum(power, 1e-12, out=power), length


def _sides(test: Statistic, name: str, norms: Iterable[tuple[int, FloatArray]], period_s: float) -> Iterator[RawScore]:
    """Yield the scores of norms over windows of so many samples: too high, and too low."""
    for rows, norm in norms:
        window = f"{name} {rows * period_s:g} s"
        yield RawScore(label=f"{window} high", values=norm, reach=rows)
        if test.two_sided:
            yield RawScore(label=f"{window} low", values=-norm, reach=rows, most=0.0)


def _trailing(values: FloatArray, length: int, at: range) -> FloatArray:
    """Return sums of `length` values up to each of some, NaN where there aren't so many."""
    values = values[max(at.start - length + 1, 0) : at.stop]
    sums = np.full(len(values), np.nan)
    complete = len(values) - length + 1
    if complete > 0:
        sums[length - 1 :] = moving_sum(values, length)[:complete]
    return sums[len(values) - len(at) :]


def _both_sums(w: FloatArray) -> _BothSums:
    return _sums(w), _sums(w * w)


def _sums(values: FloatArray) -> FloatArray:
    sums = np.empty(len(values) + 1)
    sums[0] = 0.0
    np.cumsum(values, out=sums[1:])
    return sums


def _before(sums: FloatArray, lag: int, at: range, otherwise: float = np.nan) -> FloatArray:
    """Return the sums up to `lag` samples before each of some."""
    start, stop = at.start + 1 - lag, at.stop + 1 - lag
    if start >= 0:
        return sums[start:stop]
    return np.concatenate([np.full(min(-start, len(at)), otherwise), sums[: max(stop, 0)]])


def least_baseline(rows: int) -> int:
    """Return how many rows of a baseline of so many must be there: a ninth, and no mean is of none.

    >>> least_baseline(1500), least_baseline(6)
    (166, 1)
    """
    return max(rows // LEAST_BASELINE, 1)


def _baseline(
    sums: FloatArray, test: Statistic, sample_period_s: float, *, gap: int, at: range
) -> tuple[FloatArray, FloatArray]:
    """Return the mean of up to `baseline_s` before the last `gap` rows, and over how many; NaN where too few."""
    longest = max(round(test.baseline_s / sample_period_s), 6)
    total = _before(sums, gap, at, 0.0) - _before(sums, gap + longest, at, 0.0)
    first = at.start + 1 - gap
    if first >= longest:
        length = np.array(float(longest))
    else:
        length = np.arange(first, first + len(at), dtype=float)
        np.minimum(length, longest, out=length)
        length[: max(least_baseline(longest) - first, 0)] = np.nan
    total /= length
    return total, length


def tolerance_of(whites: Sequence[FloatArray], test: Statistic, sample_period_s: float) -> Allowance:
    """Return what healthy whitened residuals do beyond noise, three times the greatest over long windows.

    The windows hold 20 s (a fortieth of all samples, where there are few). Of the means' changes, what noise explains
    (four deviations) is left out, and likewise of the mean squares.
    """
    given = [np.clip(white[np.isfinite(white)], -MOST, MOST) for white in whites]
    rows = max(min(round(_LONG_S / sample_period_s), sum(map(len, given)) // 40), 4)
    shifts, powers = [0.0], [1.0]
    for w in given:
        shift, power, length = _windows(_both_sums(w), rows, test, sample_period_s, range(len(w)))
        some = np.arange(rows - 1, len(w), max(rows // 2, 1))
        some = some[np.isfinite(power[some])]
        shifts += (np.abs(shift[some]) - 4.0 * np.sqrt(1.0 / rows + 1.0 / length[some])).tolist()
        chance = 4.0 * np.sqrt(2.0 / rows)
        powers += (power[some] - np.clip(power[some] - 1.0, -chance, chance)).tolist()
    return Allowance(
        mean=3.0 * max(shifts),
        low=1.0 / (1.0 + 3.0 * (1.0 / max(min(powers), 1e-3) - 1.0)),
        high=1.0 + 3.0 * (max(powers) - 1.0),
    )
