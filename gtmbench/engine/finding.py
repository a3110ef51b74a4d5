"""A finding: a span in which something is off, the explanations that are left, its size, its onset and its end."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.relation import BETWEEN
from gtmbench.values.record import Span

FROZEN, NOISE, REFERENCES = "stuck", "noise", "references"
DECISIVE = 4.6  # nats: odds of 100 to 1


class Side(StrEnum):
    """Which side of a change is the broken one.

    >>> [side.value for side in Side]
    ['after', 'before', 'open']
    """

    AFTER = "after"
    BEFORE = "before"
    OPEN = "open"


@dataclass(frozen=True, kw_only=True, eq=False)
class Finding:
    """Something that no healthy constant explains."""

    # first, last: cells: it begins at `first` and ends before `last`
    first: int
    last: int
    # onset_s, end_s: on the log's clock
    onset_s: float
    end_s: float
    onset_range_s: Span  # between which onset lies, at odds of 100 to 1
    # those within the odds, by how much less likely each is than the first
    ranked: tuple[tuple[Explanation, float], ...] = field(repr=False)
    size: float  # of the first, in its unit
    interval: Span  # about twice its deviation, over all onsets that are left
    evidence: float  # nats, tempered
    # own_axis, shown: what the suspect's own axis of gyro and attitude shows, and what all equations but witnesses
    # show, in nats
    own_axis: float = 0.0
    shown: float = 0.0
    side: Side = Side.AFTER
    doubt: str = ""  # why it names nobody all the same; "" for none
    others: tuple[str, ...] = ()  # further suspects that other findings bring in
    shows_s: float = -np.inf  # by when as much of it was seen as names anybody, with constants of the whole log
    lasts: bool = False  # whether it goes on to the log's end
    chances: tuple[tuple[str, str, float], ...] = ()  # of the likeliest explanations, of all that the flight allows
    shown_by: tuple[tuple[str, int, float], ...] = ()  # the equations that show it most

    @property
    def best(self) -> Explanation:
        """The most likely explanation."""
        return self.ranked[0][0]

    @property
    def suspects(self) -> tuple[str, ...]:
        """Whoever may be behind it, the most likely first."""
        return tuple(dict.fromkeys([*(each.suspect for each, _ in self.ranked), *self.others]))

    @property
    def is_healthy(self) -> bool:
        """Whether a cause that is no failure is among those that are left."""
        return any(each.is_healthy for each, _ in self.ranked) or REFERENCES in self.others

    @property
    def named(self) -> str | None:
        """The sensor that failed, where nobody else is left."""
        return self.suspects[0] if len(self.suspects) == 1 and self.accuses else None

    @property
    def accuses(self) -> bool:
        """Whether somebody failed, one sensor or one of a few."""
        return not (self.doubt or self.is_healthy)

    @property
    def reached_deg_s(self) -> float:
        """The largest error that it would be of a gyro; 0 of a gain, or noise."""
        lasts_s = {"bias": 1.0, "drift": self.end_s - self.onset_s}.get(self.best.kind, 0.0)
        return abs(self.size) * lasts_s

    @property
    def turned_deg(self) -> float:
        """How far its error would turn an attitude from onset to end; 0 of a gain, or noise."""
        lasts_s = self.end_s - self.onset_s
        return {"bias": self.size * lasts_s, "drift": 0.5 * self.size * lasts_s**2}.get(self.best.kind, 0.0)

    @property
    def is_frozen(self) -> bool:
        """Whether a gyro stands still: that needs no model of its noise."""
        return self.best.kind == FROZEN

    @property
    def parts_imus(self) -> bool:
        """Whether IMUs part by it."""
        return any(name.startswith(BETWEEN) for name, _, _ in self.shown_by)

    def meets(self, first: int, last: int) -> bool:
        """Tell whether it shares cells with [first, last)."""
        return min(self.last, last) > max(self.first, first)
