"""Panels of a page: lines over time as SVG, in the units of their data, so that a page's script only moves the window.

A panel is as wide as the log. A line keeps every sample about the faults, and elsewhere the least and the greatest of
as many as a screen can't tell apart, so that a page of an hour stays small.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.report.figures.panels import thinned
from gtmbench.report.words.units import round_times, round_values
from gtmbench.values.record import FloatArray, Span

_POINTS, _CLOSE_POINTS = 2400, 3000  # of a line: over the whole log, and about one fault
_DIGITS = 4  # of a value, of the panel's height
_EDGE = 0.04  # of an axis


@dataclass(frozen=True, kw_only=True)
class TraceLine:
    """A line: what it is, how it looks (a class of the page's style) and its path."""

    name: str
    look: str
    path: str


@dataclass(frozen=True, kw_only=True)
class Mark:
    """An instant, or a span of time, of every panel."""

    start_s: float
    end_s: float
    look: str
    name: str


@dataclass(frozen=True, kw_only=True)
class Tick:
    """A place on an axis, as a share of its length, and what it is called."""

    share: float
    name: str


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Lines over one axis."""

    title: str
    unit: str
    lines: tuple[TraceLine, ...]
    # low, high: the axis, in the lines' units; of a logarithmic one the exponents of 10
    low: float
    high: float
    is_logarithmic: bool = False
    description: str = ""  # what a screen reader says
    limits: Sequence[float] = ()  # values that are drawn across, such as a threshold
    bands: Sequence[Mark] = ()  # spans of time behind the lines, such as a sensor's timeline

    @property
    def ticks(self) -> list[Tick]:
        """Round values on the axis, but those whose words would stand in the panels above or below."""
        powers = range(math.ceil(self.low), math.floor(self.high) + 1)
        values = [*map(float, powers)] if self.is_logarithmic else round_values((self.low, self.high))
        names = [f"{10.0**value if self.is_logarithmic else value:g}" for value in values]
        shares = [(value - self.low) / (self.high - self.low) for value in values]
        made = [Tick(share=share, name=name) for share, name in zip(shares, names, strict=True)]
        return [tick for tick in made if _EDGE <= tick.share <= 1.0 - _EDGE] or made


Series = Sequence[tuple[FloatArray, FloatArray]]  # times in s, and values: a part after the other


def panel(
    title: str,
    unit: str,
    lines: Sequence[tuple[str, str, Series]],
    *,
    span: Span,
    close: Sequence[Span],
    limits: Sequence[float] = (),
    **how: Any,
) -> Panel:
    """Return a panel of lines, each a name, a look and its parts; times are counted from the span's start.

    `close`: spans that are drawn more finely. **how: else is as `Panel` takes it.
    """
    drawn = [values[np.isfinite(values)] for _, _, parts in lines for _, values in parts]
    there = np.concatenate([*drawn, np.asarray(limits, dtype=np.float64)])
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 1.0)
    room = 0.06 * (high - low) or 0.5 * abs(high) or 1.0
    low, high = low - room, high + room
    made = [
        TraceLine(name=name, look=look, path=_path([_shown(part, span, close) for part in parts], span[0], high - low))
        for name, look, parts in lines
    ]
    return Panel(title=title, unit=unit, lines=tuple(made), low=low, high=high, limits=limits, **how)


def time_ticks(span: Span) -> list[Tick]:
    """Return round instants of a log's clock, as shares of a span."""
    return [Tick(share=(time_s - span[0]) / (span[1] - span[0]), name=name) for time_s, name in round_times(span)]


def _shown(part: tuple[FloatArray, FloatArray], span: Span, close: Sequence[Span]) -> tuple[FloatArray, FloatArray]:
    """Return a part of a line as it is drawn: thinned, but about the faults."""
    time_s, values = part
    if not len(time_s):
        return part
    share = (time_s[-1] - time_s[0]) / max(span[1] - span[0], 1e-9)
    coarse_s, coarse = _thinned(time_s, values, max(_POINTS * share, 2.0))
    for start_s, end_s in close:
        inside = (time_s >= start_s) & (time_s <= end_s)
        if inside.any():
            outside = (coarse_s < start_s) | (coarse_s > end_s)
            fine_s, fine = _thinned(time_s[inside], values[inside], _CLOSE_POINTS)
            coarse_s, coarse = np.append(coarse_s[outside], fine_s), np.append(coarse[outside], fine)
            order = np.argsort(coarse_s, kind="stable")
            coarse_s, coarse = coarse_s[order], coarse[order]
    return coarse_s, coarse


def _thinned(time_s: FloatArray, values: FloatArray, points: float) -> tuple[FloatArray, FloatArray]:
    return thinned(time_s, values, every=max(1, math.ceil(2 * len(values) / points)))


def _path(parts: Series, start_s: float, height: float) -> str:
    """Return an SVG path; what is missing, and the parts' ends, break it."""
    digits = max(0, _DIGITS - 1 - math.floor(math.log10(height)))
    return " ".join(text for time_s, values in parts for text in _strokes(time_s - start_s, values, digits))


def _strokes(time_s: FloatArray, values: FloatArray, digits: int) -> Iterator[str]:
    known = np.isfinite(values)
    edges = np.flatnonzero(np.diff(known, prepend=False, append=False))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        points = zip(time_s[first:last].tolist(), values[first:last].tolist(), strict=True)
        yield "M" + " ".join(f"{_short(time, 3)},{_short(value, digits)}" for time, value in points)


def _short(value: float, digits: int) -> str:
    text = f"{value:z.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
