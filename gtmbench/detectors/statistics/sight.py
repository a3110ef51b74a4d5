"""Sight: whether thresholds let a residual's tests see anything at all.

A monitor that can't alarm ends every flight with "nothing found". So before one watches, some faults that nobody could
overlook are put on white noise, as a healthy whitened residual is, and pushed through statistic and thresholds.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from gtmbench.detectors.statistics.statistic import LEAST_BASELINE, Allowance, Statistic
from gtmbench.detectors.statistics.whitening import White
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray

_STEP = 20.0  # deviations, beyond what is tolerated
_NOISE = 10.0  # times the noise, beyond what is tolerated
_LASTS_S = 5.0  # as long a step has to be seen by a monitor that isn't broken
_FAR = 1e6  # deviations
_MOST_SAMPLES = 5_000_000  # of a baseline and a window: more is no monitor, but a broken file


def check_sight(
    where: str,
    thresholds: Mapping[str, float],
    statistic: Statistic,
    tolerance: Allowance,
    sample_period_s: float,
    *,
    deviation: float = 1.0,
) -> None:
    """Refuse thresholds that nothing passes, or everything does.

    `where`: whose thresholds they are, for the error. `thresholds`, by label: infinity stands for a test that doesn't
    judge, for the records were shorter than its window. `deviation`: of the healthy residual, in its unit, for the one
    statistic that isn't whitened. InputError where a test's threshold is below all that it can be, or above; where no
    test sees a step of the mean of 20 deviations that lasts 5 s, or ten times the noise for as long.

    >>> test = Statistic(windows_s=(1.0,))
    >>> check_sight("p", {"mean 1 s": 21.0, "energy 1 s": 24.0}, test, Allowance(), 0.01)
    >>> check_sight("p", {"mean 1 s": 21.0, "energy 1 s": 1e308}, test, Allowance(), 0.01)
    Traceback (most recent call last):
    ...
    gtmbench.errors.InputError: p, 'energy 1 s' is 1e+308; nothing passes that: the grossest fault reaches 5.03e+05
    """
    units = {"energy": deviation, "level": np.inf}  # a level has a unit of its own, and no bound
    unit = units.get(statistic.name, 1.0)
    healthy, seen = _extremes(statistic, tolerance, sample_period_s)
    for label, threshold in thresholds.items():
        if threshold < 0.0 <= healthy[label][0]:
            raise InputError(
                f"{where}, '{label}' is {threshold:.3g}; the test is never below 0, so all would be alarms"
            )
        if max(fault[label] for fault in seen.values()) * unit <= threshold < np.inf:
            grossest = max(_grossest(statistic, tolerance, sample_period_s)[label] * unit, 0.0)
            if grossest <= threshold:
                raise InputError(
                    f"{where}, '{label}' is {threshold:.3g}; nothing passes that: the grossest fault reaches "
                    f"{grossest:.3g}"
                )
    for words, fault in seen.items():
        shows = (label for label, value in fault.items() if value > healthy[label][1])
        if not any(fault[label] * unit > thresholds[label] for label in shows):
            lasts_s = _lasting(statistic, sample_period_s) * sample_period_s
            raise InputError(f"{where} are blind: {words} for {lasts_s:g} s passes none; run `gtmbench calibrate`")


@lru_cache(maxsize=64)
def _extremes(
    statistic: Statistic, tolerance: Allowance, sample_period_s: float
) -> tuple[dict[str, tuple[float, float]], dict[str, dict[str, float]]]:
    """Return what each test is on healthy noise, least and greatest, and the greatest under faults that must be seen.

    Both begin beyond what is tolerated.
    """
    noise, quiet = _noise(statistic, sample_period_s)
    some = slice(quiet, quiet + _lasting(statistic, sample_period_s))
    step, loud = noise.copy(), noise.copy()
    step[some] += tolerance.mean + _STEP
    loud[some] *= _NOISE * np.sqrt(tolerance.high)
    healthy = {
        score.label: (float(np.nanmin(score.values)), float(np.nanmax(score.values)))
        for score in statistic.scores(noise, White.steady(noise), sample_period_s, tolerance)
    }
    return healthy, {
        f"a step of {_STEP:g} deviations": _greatest(statistic, tolerance, sample_period_s, step),
        f"{_NOISE:g} times the noise": _greatest(statistic, tolerance, sample_period_s, loud),
    }


@lru_cache(maxsize=64)
def _grossest(statistic: Statistic, tolerance: Allowance, sample_period_s: float) -> dict[str, float]:
    """Return the greatest that each test can be: under far steps, far noise and silence as long as its window."""
    noise, quiet = _noise(statistic, sample_period_s)
    after = np.arange(len(noise)) >= quiet
    faults = [np.where(after, value, noise) for value in (_FAR, -_FAR, _FAR * np.sign(noise), 0.0)]
    reached = [_greatest(statistic, tolerance, sample_period_s, values) for values in faults]
    return {label: max(values[label] for values in reached) for label in reached[0]}


def _noise(statistic: Statistic, sample_period_s: float) -> tuple[FloatArray, int]:
    """Return white noise, and after how many samples every test is ready; as many follow as the longest window has."""
    longest = statistic.rows(sample_period_s)[-1]
    quiet = max(round(statistic.baseline_s / LEAST_BASELINE / sample_period_s), 6) + longest
    lasting = max(longest, _lasting(statistic, sample_period_s))
    if quiet + lasting > _MOST_SAMPLES:
        raise InputError(f"{quiet + lasting} samples would have to pass before all tests judge; make windows shorter")
    return np.random.default_rng(1).standard_normal(quiet + lasting), quiet


def _lasting(statistic: Statistic, sample_period_s: float) -> int:
    """Return for how many samples a fault lasts that must be seen: 5 s, and as long as the shortest window."""
    return max(round(_LASTS_S / sample_period_s), statistic.rows(sample_period_s)[0] + 1)


def _greatest(
    statistic: Statistic, tolerance: Allowance, sample_period_s: float, values: FloatArray
) -> dict[str, float]:
    scores = statistic.scores(values, White.steady(values), sample_period_s, tolerance)
    return {score.label: float(np.nanmax(score.values)) for score in scores}
