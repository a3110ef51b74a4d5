"""A check as text: a line for each regression, what is better, and what a new baseline changes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from itertools import groupby

from gtmbench.check.compare import Compared, Number, Pair
from gtmbench.check.rules import RULES
from gtmbench.check.run import Check


def regression_line(one: Compared) -> str:
    """Write a regression: which figure, what it was, what it is, and what is allowed.

    >>> one = Compared(group="drift of p", figure="delay_s", at="", was=91.55, now=97.2, low=-math.inf, high=93.381,
    ...                unit="s", remark="", better=False, explained=False)
    >>> regression_line(one)
    'drift of p, delay: was 91.55, is 97.2, allowed up to 93.381 s'
    """
    said = f" ({one.remark})" if one.remark and RULES[one.figure].form == "flag" else ""
    return f"{one.text}: was {shown(one.was)}, is {shown(one.now)}, allowed {_allowed(one)}{said}"


def check_lines(found: Check) -> list[str]:
    """Return what a check says, regressions first, the worst of them on top."""
    regressions, better, total = found.regressions, found.better, len(found.compared)
    same = total - len(regressions) - len(better)
    verdict = f"{len(regressions)} of {total} figures worse than allowed" if regressions else "no figure is worse"
    return [
        *(regression_line(one) for one in regressions),
        *_better_lines(better),
        f"{found.reference.path}: {verdict}; {len(better)} better, {same} within their tolerances",
        *_advice(found),
    ]


def changed_rows(pairs: Iterable[Pair]) -> list[list[str]]:
    """Return rows of what differs: figure, was, is, in which unit; of a list, where it differs most, and in how many.

    >>> from gtmbench.check.compare import Pair
    >>> pairs = [Pair(group="healthy E(k) of r", figure="windows", at=f"window {i}", was=1.0, now=now, unit="deg/s",
    ...               remark="", explained=False) for i, now in enumerate([1.0, 1.5, 4.0])]
    >>> changed_rows(pairs)
    [['healthy E(k) of r, window 2, max (2 of 3 changed)', '1', '4', 'deg/s']]
    """
    rows = []
    for _, entries in groupby(pairs, lambda pair: (pair.group, pair.figure)):
        several = list(entries)
        changed = [pair for pair in several if repr(pair.was) != repr(pair.now)]
        if changed:
            most = max(changed, key=_difference)
            count = f" ({len(changed)} of {len(several)} changed)" if len(several) > 1 else ""
            rows.append([f"{most.text}{count}", shown(most.was), shown(most.now), most.unit])
    return rows


def shown(value: Number | None) -> str:
    """Write a figure: yes or no, five digits, or - where there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _allowed(one: Compared) -> str:
    unit = f" {one.unit}" if one.unit else ""
    if RULES[one.figure].form == "flag":
        return shown(one.was)
    if math.isinf(one.low):
        return f"up to {shown(one.high)}{unit}"
    return f"down to {shown(one.low)}{unit}" if math.isinf(one.high) else f"{shown(one.low)} to {shown(one.high)}{unit}"


def _better_lines(better: list[Compared]) -> list[str]:
    """Return a line a group: ``better: drift of p: delay, peak ratio``."""
    lines = []
    for group, entries in groupby(better, lambda one: one.group):
        often = Counter(RULES[one.figure].text for one in entries)
        figures = ", ".join(text if count == 1 else f"{text} ({count} times)" for text, count in often.items())
        lines.append(f"better: {group}: {figures}")
    return lines


def _advice(found: Check) -> list[str]:
    command = f"gtmbench check {found.reference.path} --update"
    if found.regressions:
        return [f"if that is what the change is meant to do: {command}"]
    return [f"to hold what is better from now on: {command}"] if found.better else []


def _difference(pair: Pair) -> float:
    difference = math.inf if pair.was is None or pair.now is None else abs(pair.now - pair.was)
    return math.inf if math.isnan(difference) else difference
