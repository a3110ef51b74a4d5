"""Channels that share their stamps, before they are brought to one clock; and spans of time, as pairs of seconds."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter

import numpy as np

from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import Span

SHORTEST_S, FEWEST = 2.0, 20  # of a segment


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Channels that share their stamps."""

    channels: tuple[str, ...]
    time_s: FloatArray  # increasing, shape (samples,)
    values: FloatArray  # shape (samples, channels)
    logged_s: float = 0.0  # where repeats were left out, the period that it was logged at with them; else 0

    @cached_property
    def period_s(self) -> float:
        """The median step."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def slowness_s(self) -> float:
        """The period that it asks of a record: of what says how it turns the true one, of others that of the log."""
        turns = {*GYROS, *ATTITUDE} & {*self.channels}
        return self.period_s if turns or not self.logged_s else self.logged_s

    @property
    def label(self) -> str:
        """Its channels, as a message names them."""
        more = f" and {len(self.channels) - 4} more" if len(self.channels) > 4 else ""
        return ", ".join(self.channels[:4]) + more

    def only(self, channels: Sequence[str]) -> Track:
        """Return some of its channels."""
        columns = [self.channels.index(name) for name in channels]
        together = slice(columns[0], columns[-1] + 1) if columns else slice(0)
        are_together = columns == list(range(together.start or 0, together.stop))
        return replace(self, channels=tuple(channels), values=self.values[:, together if are_together else columns])

    def split(self, channels: Sequence[str]) -> list[Track]:
        """Return it with some channels apart from the others; itself where it has only one or the other."""
        own = [name for name in self.channels if name in channels]
        rest = [name for name in self.channels if name not in channels]
        return [self.only(own), self.only(rest)] if own and rest else [self]

    def part(self, first: int, last: int) -> Track:
        """Return the samples from first to before last."""
        return replace(self, time_s=self.time_s[first:last], values=self.values[first:last])


start_of, end_of = itemgetter(0), itemgetter(1)


def union(spans: Sequence[Span], join_s: float = 0.0) -> list[Span]:
    """Return spans in time; those that overlap, or are no further apart than that, are one.

    >>> union([(3.0, 4.0), (0.0, 1.0), (1.5, 2.0)], join_s=0.5)
    [(0.0, 2.0), (3.0, 4.0)]
    """
    joined: list[Span] = []
    for start_s, end_s in sorted(spans):
        if joined and start_s - joined[-1][1] <= join_s:
            joined[-1] = joined[-1][0], max(joined[-1][1], end_s)
        else:
            joined.append((start_s, end_s))
    return joined


def without(spans: Sequence[Span], others: Sequence[Span]) -> list[Span]:
    """Return what the others leave of spans; both are in time and apart.

    >>> without([(0.0, 9.0)], [(2.0, 3.0), (8.0, 12.0)])
    [(0.0, 2.0), (3.0, 8.0)]
    """
    edges = [-np.inf, *(edge for other in others for edge in other), np.inf]
    between = list(zip(edges[::2], edges[1::2], strict=True))
    return [part for span in spans for part in overlaps(between, span)]


def overlaps(spans: Sequence[Span], span: Span) -> list[Span]:
    """Return the parts of spans that lie in another one; they are in time and apart."""
    return [(max(span[0], start_s), min(span[1], end_s)) for start_s, end_s in spans[met(spans, span)]]


def met(spans: Sequence[Span], span: Span) -> slice:
    """Return which spans, in time and apart, meet another one."""
    return slice(bisect_left(spans, span[0], key=end_of), bisect_right(spans, span[1], key=start_of))


def holds(spans: Sequence[Span], at_s: float) -> int | None:
    """Return which of some spans, in time and apart, holds a moment; None where none does.

    >>> holds([(0.0, 1.0), (2.0, 3.0)], 2.5), holds([(0.0, 1.0)], 1.5)
    (1, None)
    """
    place = bisect_left(spans, at_s, key=end_of)
    return place if place < len(spans) and spans[place][0] <= at_s else None
