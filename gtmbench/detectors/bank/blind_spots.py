"""What a bank can't tell or can't see, worked out from the bank itself (and from a monitor's tolerances), in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from gtmbench.channels import SENSORS, unit_of
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.bank.sizes import slowest_drift
from gtmbench.detectors.statistics.statistic import Statistic, Tolerance
from gtmbench.detectors.virtual import integrable

LEVEL, SLOPE, NOTHING = "level", "slope", ""
Pattern = Mapping[str, tuple[str, ...]]


def blind_spots(bank: Bank, pattern: Pattern, monitor: CalibratedBank | None = None) -> list[str]:
    """Return them as sentences.

    Parameters
    ----------
    bank : Bank
    pattern : mapping of channel to tuple of str
        Of `Signatures`.
    monitor : CalibratedBank, optional
        Adds figures: the slowest drift that its thresholds see, and windows that it can't judge.

    Examples
    --------
    >>> from gtmbench.detectors.bank.bank import load_bank
    >>> for line in blind_spots(load_bank("paper"), {name: ("level",) for name in ("r", "beta", "p", "q")})[:2]:
    ...     print(line)
    r, beta, p and q enter the same residual (r): which of them failed can't be told from which residuals rise.
    Nothing predicts p, q or beta: an alarm that one of them may explain stays undecided.
    """
    return [
        *_same(bank, pattern),
        *_contained(bank, pattern),
        *_unpredicted(bank),
        *_cancelled(pattern),
        *_driven(bank),
        *_tests(bank, monitor),
        *([] if monitor is None else _unjudged(monitor)),
        "A fault that changes no reading isn't one yet: a saturation that isn't reached, a jam of what stands still.",
        *_unused(bank),
    ]


def _groups(bank: Bank, channels: Iterable[str]) -> dict[tuple[str, ...], list[str]]:
    found: dict[tuple[str, ...], list[str]] = {}
    for channel in channels:
        found.setdefault(bank.affects(channel), []).append(channel)
    return found


def _same(bank: Bank, pattern: Pattern) -> list[str]:
    return [
        f"{_and(group)} enter the same {_residuals(outputs)}: which of them failed can't be told from which residuals "
        "rise" + (", only from whose fault explains how they rise." if len(outputs) > 1 else ".")
        for outputs, group in _groups(bank, pattern).items()
        if len(group) > 1
    ]


def _contained(bank: Bank, pattern: Pattern) -> list[str]:
    groups = _groups(bank, pattern)
    found = []
    for outputs, group in groups.items():
        inside = [name for others, names in groups.items() if set(others) < set(outputs) for name in names]
        if inside:
            where = f"{_or(group)} has risen in all of {_and(outputs)}"
            found.append(f"Until a fault of {where}, it looks like one of {_or(inside)}.")
    return found


def _unpredicted(bank: Bank) -> list[str]:
    outputs = [spec.output for spec in bank.residuals]
    lacking = [name for name in bank.channels if name not in outputs and not integrable(name, bank.channels)]
    suspects = [name for name in bank.suspects if name in lacking]
    others = [name for name in bank.channels if name not in bank.suspects]
    found = []
    if suspects:
        one = "it" if len(suspects) == 1 else "one of them"
        found.append(f"Nothing predicts {_or(suspects)}: an alarm that {one} may explain stays undecided.")
    if others:
        raised = {output: None for name in others for output in bank.affects(name)}
        what = "is no suspect" if len(others) == 1 else "are no suspects"
        where = _and(list(raised))
        found.append(f"{_and(others)} {what}: a fault there rises in {where} and is put down to a suspect, or to none.")
    return found


def _cancelled(pattern: Pattern) -> list[str]:
    only = [name for name, entries in pattern.items() if SLOPE in entries and LEVEL not in entries]
    if not only:
        return []
    return [f"Of {_and(only)} only changes enter: an offset, however large, is seen while it comes and not after."]


def _driven(bank: Bank) -> list[str]:
    if not bank.attitude_from_gyros:
        return []
    return ["The gyros drive the attitude: after the first finding nothing can be trusted, so nothing is watched."]


def _tests(bank: Bank, monitor: CalibratedBank | None) -> list[str]:
    test = bank.statistic
    if not _ignores_offsets(test):
        return [] if test.two_sided else ["Too little energy raises no alarm: a jam of what hardly moves isn't seen."]
    found = [
        "A bias that was there from the start (since turn-on) is no change: tests compare with the mean of up to "
        f"{test.baseline_s:g} s before.",
        f"In the first {test.baseline_s / 6.0:g} s of a record there is no such mean yet, so no alarm.",
    ]
    if monitor is None:
        return [*found, f"A change much slower than these {test.baseline_s:g} s takes their mean along and isn't seen."]
    slowest = {name: slowest_drift(monitor, name) for name in monitor.operators}
    said = [f"{name} {value:.2g} {unit_of(name)} per s" for name, value in slowest.items() if np.isfinite(value)]
    return [*found, f"The mean before follows slower drifts than these, so their size isn't seen: {', '.join(said)}."]


def _ignores_offsets(test: Statistic) -> bool:
    """Tell whether a constant added to a residual changes no series: tried on noise."""
    period_s = test.baseline_s / 60.0
    longest = max(test.rows(period_s))
    noise = np.random.default_rng(1).standard_normal(300 + min(2 * longest, 20_000))
    as_is, shifted = (test.series(one, one, period_s, Tolerance()) for one in (noise, noise + 3.0))
    return all(
        np.allclose(one.values, other.values, rtol=1e-6, atol=1e-6, equal_nan=True)
        for one, other in zip(as_is, shifted, strict=True)
    )


def _unjudged(monitor: CalibratedBank) -> list[str]:
    never: dict[str, list[str]] = {}
    for output, thresholds in monitor.thresholds.items():
        for label, value in thresholds.items():
            if np.isinf(value):
                never.setdefault(label, []).append(output)
    if not never:
        return []
    said = ", ".join(f"{label} of {_and(outputs)}" for label, outputs in never.items())
    return [f"The records of the calibration were too short for some tests, which raise no alarm: {said}."]


def _unused(bank: Bank) -> list[str]:
    unused = [name for name in SENSORS if name not in bank.channels]
    return [f"No residual holds {_or(unused)}: faults there aren't seen."] if unused else []


def _residuals(outputs: Sequence[str]) -> str:
    return f"residual{'s' if len(outputs) > 1 else ''} ({', '.join(outputs)})"


def _and(items: Sequence[str]) -> str:
    return _joined(items, "and")


def _or(items: Sequence[str]) -> str:
    return _joined(items, "or")


def _joined(items: Sequence[str], word: str) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {word} {items[-1]}"
