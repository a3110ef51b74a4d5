"""Scores in words: the verdict of a campaign, and figures with their intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.faults.registry import find_fault
from gtmbench.report.words.judgement import parameter_unit
from gtmbench.report.words.units import counted
from gtmbench.study.scores.curves import Smallest
from gtmbench.study.scores.intervals import Estimate, Rate, Share
from gtmbench.study.scores.scoring import DetectorScores, Scores
from gtmbench.values.channels import unit_of

_MOST_NAMES = 6
_MOST_LINES = 3


def share_words(found: Share) -> str:
    """Write a share with its interval.

    >>> share_words(Share(hits=9, of=10, low=0.55, high=0.998))
    '90 % [55, 99.8]'
    """
    if found.value is None:
        return "-"
    return f"{_percent(found.value)} % [{_percent(found.low)}, {_percent(found.high)}]"


def _percent(value: float) -> str:
    """Write a share in percent, as finely as it is near 0 or 1."""
    percent = 100.0 * value
    fine = 0.0 < percent < 9.95 or 90.05 < percent < 100.0
    return f"{percent:.1f}".removesuffix(".0") if fine else f"{percent:.0f}"


def rate_words(found: Rate) -> str:
    """Write a rate an hour with its interval."""
    if found.value is None:
        return "-"
    value, low, high = (f"{float(f'{each:.2g}'):g}" for each in (found.value, found.low, found.high))
    return f"{value} [{low}, {high}]"


def seconds_words(found: Estimate | None) -> str:
    """Write a delay with its interval, where it has one.

    >>> seconds_words(Estimate(value=0.274, low=0.21, high=1.5)), seconds_words(Estimate(value=61.2))
    ('0.27 [0.21, 1.50]', '61.2')
    """
    if found is None:
        return "-"
    if found.low is None or found.high is None:
        return _seconds(found.value)
    return f"{_seconds(found.value)} [{_seconds(found.low)}, {_seconds(found.high)}]"


def _seconds(value: float) -> str:
    return f"{value:.2f}" if value < 9.995 else f"{value:.1f}"


def severity_words(found: Smallest) -> str:
    """Write the smallest fault that is detected in nine of ten searches, with its interval."""
    value = found.severity
    if value.low is None or value.high is None or value.low == value.high:
        return _severity(found, value.value)
    low, high = sorted((value.low, value.high), key=lambda bound: (not math.isfinite(bound), bound))
    return f"{_severity(found, value.value)} [{_severity(found, low)}, {_severity(found, high)}]"


def _severity(found: Smallest, value: float) -> str:
    factor = 100.0 if found.share_of else 1.0
    beyond = "over " if found.severest > found.mildest else "under "
    below = "at most " if found.severest > found.mildest else "at least "
    if not math.isfinite(value):
        return f"{beyond}{factor * found.severest:.3g}"
    return f"{below if value == found.mildest else ''}{factor * value:.3g}"


def severity_unit(found: Smallest) -> str:
    """Return what a search's severities are in: the parameter's unit, or what they are a share of."""
    if found.share_of:
        return f"% of {found.share_of}"
    try:
        parameters = find_fault(found.fault).parameters()
    except InputError:  # of somebody's own, which isn't imported here
        return ""
    own = (parameter_unit(item, unit_of(found.channel)) for item in parameters if item.name == found.parameter)
    return next(own, "")


# ---- the verdict ----


def verdict_lines(scores: Scores) -> list[str]:
    """Say what a campaign comes to: who is soonest, at what price, who gets no score, what isn't known."""
    without = [f"{one.name} gets no score: {one.no_score}." for one in scores.detectors if not one.is_quiet]
    return [*_best_lines(scores), *without, *_price_lines(scores), *_thin_lines(scores)]


def _best_lines(scores: Scores) -> list[str]:
    by_name = {one.name: one for one in scores.detectors}
    if not scores.ranks:
        quiet = [one for one in scores.detectors if one.is_quiet]
        return [_merits_line(one) for one in quiet if one.merits] or ["No detector has a score of trials."]
    best = [rank.detector for rank in scores.ranks if rank.best == 1]
    if len(best) == len(scores.ranks) > 1:
        shared = f"No detector is significantly sooner than another: {_names(best)} share the first place."
        return [shared, *[_merits_line(by_name[name]) for name in best[:_MOST_LINES]]]
    if len(best) == 1:
        others = len(scores.ranks) - 1
        beats = "significantly sooner than every other" if scores.ranks[0].worst == 1 else "and none is sooner"
        first = [f"{best[0]} is the first of {others + 1} detectors, {beats}."] if others else []
        return [*first, _merits_line(by_name[best[0]])]
    shared = f"{_names(best)} share the first place: no test tells them apart."
    return [shared, *[_merits_line(by_name[name]) for name in best[:_MOST_LINES]]]


def _merits_line(one: DetectorScores) -> str:
    found = one.merits
    assert found is not None
    line = f"{one.name} detected {share_words(found.detected)} of {counted(found.trials, 'fault')}"
    if found.delays is not None:
        line += f", half of those within {seconds_words(found.delays.median)} s"
    if found.naming is not None:
        line += f"; it named the right sensor of {share_words(found.naming.right)}, a wrong one of "
        line += share_words(found.naming.wrong)
    return line + "."


def _price_lines(scores: Scores) -> list[str]:
    """Say who isn't shown to keep the target: that isn't shown by few hours."""
    open_ = [one for one in scores.detectors if one.is_quiet and one.false_alarms.high > scores.target_per_hour]
    if not open_:
        quiet = [one.name for one in scores.detectors if one.is_quiet]
        keep = "keeps" if len(quiet) == 1 else "keep"
        return [f"{_names(quiet)} {keep} to the target of {_target(scores)}, by the upper bound."] if quiet else []
    hours = max(one.false_alarms.hours for one in open_)
    keep = "keeps" if len(open_) == 1 else "keep"
    return [
        f"Whether {_names([one.name for one in open_])} {keep} to the target of {_target(scores)} is neither shown nor "
        f"refuted by {hours:.2g} h of healthy flight."
    ]


def _target(scores: Scores) -> str:
    return f"{scores.target_per_hour:g} false alarm{'s' * (scores.target_per_hour != 1.0)} an hour"


def _thin_lines(scores: Scores) -> list[str]:
    flights = max((one.merits.flights for one in scores.detectors if one.merits), default=0)
    if 0 < flights < 6:
        return [f"These figures rest on {counted(flights, 'flight')}, too few to say how delays would be on others."]
    return []


def _names(names: Sequence[str]) -> str:
    shown = list(names[:_MOST_NAMES])
    return listed(shown if len(names) <= _MOST_NAMES else [*shown, f"{len(names) - _MOST_NAMES} others"])
