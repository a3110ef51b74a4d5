"""Spans of time as plain pairs of seconds: which meet, what they share, what others leave of them."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from operator import itemgetter

import numpy as np

from gtmbench.values.record import Span

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
