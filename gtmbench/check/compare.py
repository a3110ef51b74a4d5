"""Holding figures against those of a baseline, one by one: as recorded, better, or worse than allowed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

from gtmbench.check.figures import RULES, FigureGroup, Rule, Tolerance, Value
from gtmbench.errors import InputError

Recorded = Mapping[str, Mapping[str, Mapping[str, Value]]]  # by kind, name and figure, as the tables of the file
Number = bool | int | float


@dataclass(frozen=True, kw_only=True)
class Pair:
    """One number of a baseline and what it is now; None where there is none."""

    group: str  # the title of its group: ``healthy residual of r``
    figure: str  # a name of `RULES`
    at: str  # which of several: ``window 230..240 s``; empty for a figure alone
    was: Number | None
    now: Number | None
    unit: str
    remark: str  # the group's
    explained: bool

    @property
    def rule(self) -> Rule:
        """The figure's rule."""
        return RULES[self.figure]

    @property
    def text(self) -> str:
        """Which figure this is: ``healthy residual of r, window 230..240 s, max``."""
        return ", ".join(part for part in (self.group, self.at, self.rule.text) if part)

    @property
    def changed(self) -> bool:
        """Whether it is another number now; one that isn't a number stays that."""
        return repr(self.was) != repr(self.now)


@dataclass(frozen=True, kw_only=True)
class Compared(Pair):
    """A pair that was held against its tolerance."""

    was: Number
    now: Number
    # low, high: what is allowed: low <= now <= high; infinite where any value is
    low: float
    high: float
    better: bool  # whether it is better by more than the tolerance

    @property
    def regressed(self) -> bool:
        """Whether it is worse than allowed. What isn't a number any more is; what never was one can't be."""
        return not (self.low <= self.now <= self.high or math.isnan(self.was))

    @property
    def excess(self) -> float:
        """How far it went, in tolerances; infinite where none was allowed."""
        limit = self.high if self.now > self.high else self.low
        allowed, gone = abs(limit - self.was), abs(self.now - self.was)
        return gone / allowed if allowed > 0.0 and math.isfinite(gone) else math.inf


def compare(
    recorded: Recorded, groups: Sequence[FigureGroup], tolerances: Mapping[str, Tolerance]
) -> tuple[Compared, ...]:
    """Hold every figure against the recorded one.

    Raises InputError where a figure has none, or a recorded one is no longer there: that's no regression, but a
    baseline of something else.
    """
    held: list[Compared] = []
    new: list[str] = []
    gone: list[str] = []
    for pair in pairs(recorded, groups):
        if pair.was is not None and pair.now is not None:
            held.append(_compared(pair, pair.was, pair.now, tolerances.get(pair.figure, Tolerance())))
        elif not pair.explained:
            (new if pair.was is None else gone).append(pair.text)
    if new or gone:
        what = f"it holds no figure of {_some(new)}" if new else f"it holds {_some(gone)}, which this run doesn't give"
        raise InputError(f"{what}; --update records what is there now")
    return tuple(held)


def pairs(recorded: Recorded, groups: Sequence[FigureGroup]) -> Iterator[Pair]:
    """Return what was and what is, number by number: the groups of now first, then what is no longer there."""
    for group in groups:
        yield from _of_group(group, recorded.get(group.kind, {}).get(group.name, {}))
    now = {(group.kind, group.name) for group in groups}
    for kind, names in recorded.items():
        for name, figures in names.items():
            if (kind, name) not in now:
                yield from _of_group(FigureGroup(kind=kind, name=name, values={}), figures)


def _of_group(group: FigureGroup, was: Mapping[str, Value]) -> Iterator[Pair]:
    for figure in dict.fromkeys([*group.values, *was]):
        rule, labels = RULES[figure], group.labels.get(figure, ())
        explained = bool(rule.needs) and False in (was.get(rule.needs), group.values.get(rule.needs))
        for i, (before, after) in enumerate(zip_longest(_numbers(was.get(figure)), _numbers(group.values.get(figure)))):
            yield Pair(
                group=group.title,
                figure=figure,
                at="" if rule.form != "list" else labels[i] if i < len(labels) else f"number {i + 1}",
                was=before,
                now=after,
                unit=group.unit if rule.unit == "*" else rule.unit,
                remark=group.remark,
                explained=explained,
            )


def _numbers(value: Value | None) -> tuple[Number, ...]:
    return value if isinstance(value, tuple) else () if value is None else (value,)


def _compared(pair: Pair, was: Number, now: Number, tolerance: Tolerance) -> Compared:
    worse = pair.rule.worse
    around = tolerance.around(was) if math.isfinite(was) else 0.0
    low, high = was - around, was + around
    better = (worse == "higher" and now < low) or (worse == "lower" and now > high)
    return Compared(
        **vars(pair),
        low=-math.inf if worse == "higher" else low,
        high=math.inf if worse == "lower" else high,
        better=better or (math.isnan(was) and not math.isnan(now)),
    )


def _some(texts: list[str]) -> str:
    more = f" and {len(texts) - 1} more" if len(texts) > 1 else ""
    return f"'{texts[0]}'{more}"
