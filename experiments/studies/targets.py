"""Targets of a study, and whether its figures reach them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import pandas as pd


class Target(NamedTuple):
    """What is asked of a figure: to be at least, or at most, a bound.

    >>> Target("C: detected at least 99 %", "C", "detected", ">=", 0.99).is_reached(0.98)
    False
    """

    text: str
    whose: str
    which: str
    sense: str  # ">=" or "<="
    bound: float

    def is_reached(self, value: float) -> bool:
        """Tell whether a figure is good enough; NaN, which nothing was measured for, isn't."""
        return value >= self.bound if self.sense == ">=" else value <= self.bound


def held(targets: Sequence[Target], figures: Mapping[str, Mapping[str, float]]) -> pd.DataFrame:
    """Hold figures against targets.

    Parameters
    ----------
    targets : sequence of Target
    figures : mapping
        By whose they are and by their names.

    Examples
    --------
    >>> from gtmbench.report.markup import markdown
    >>> target = Target("C: no false alarm", "C", "false_alarms", "<=", 0)
    >>> print(markdown(held([target], {"C": {"false_alarms": 2}})))
    | target            | measured | reached |
    | ----------------- | -------- | ------- |
    | C: no false alarm | 2        | MISSED  |
    """
    import pandas as pd

    rows = []
    for target in targets:
        value = figures[target.whose][target.which]
        reached = "yes" if target.is_reached(value) else "MISSED"
        rows.append({"target": target.text, "measured": f"{value:.4g}", "reached": reached})
    return pd.DataFrame(rows)


def is_missed(targets: Sequence[Target], figures: Mapping[str, Mapping[str, float]]) -> bool:
    """Tell whether figures miss one of some targets.

    >>> is_missed([Target("C: no false alarm", "C", "false_alarms", "<=", 0)], {"C": {"false_alarms": 2}})
    True
    """
    return not all(target.is_reached(figures[target.whose][target.which]) for target in targets)
