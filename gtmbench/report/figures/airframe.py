"""An airframe's constants over its flights, with intervals, what was expected and limits; the worst first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.errors import InputError
from gtmbench.history.entry import Entry
from gtmbench.history.overview import Overview, overviews_of
from gtmbench.report.figures.panels import as_it_is, panels
from gtmbench.report.style import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS, _WIDTH, _HEIGHT = 3, 3.6, 2.1  # panels beside each other; inches of each
_MOST = 30  # constants of all airframes


def airframe_figure(airframes: Mapping[str, Sequence[Entry]]) -> Figure:
    """Return a figure of constants over flights, one or more airframes.

    Raises InputError where no flight tells a constant.
    """
    shown = [(name, each) for name, flights in airframes.items() for each in overviews_of(flights)][:_MOST]
    if not shown:
        raise InputError("no flight of this history tells a constant: its logs hold no gyros with an attitude")
    rows = -(-len(shown) // _COLUMNS)
    figure, axes = panels(rows, _COLUMNS, (_COLUMNS * _WIDTH, rows * _HEIGHT))
    for place, axis in enumerate(axis for row in axes for axis in row):
        if place >= len(shown):
            axis.set_visible(False)
            continue
        name, each = shown[place]
        _draw(axis, each)
        above = f"{name}, " if len(airframes) > 1 else ""
        axis.set_title(as_it_is(f"{above}{each.title}"), fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("flight")
    return figure


def _draw(axis: Axes, each: Overview) -> None:
    apart, low, high = each.is_apart, *each.intervals.T
    for rows, colour in ((~apart, COLOURS["p"]), (apart, COLOURS["threshold"])):
        off = np.abs(np.vstack([each.values - low, high - each.values]))[:, rows]
        axis.errorbar(each.flights[rows], each.values[rows], yerr=off, fmt="o", ms=3, lw=1.0, color=colour)
    if each.usual is not None:
        axis.fill_between([each.flights[-1] - 0.4, each.flights[-1] + 0.4], *each.usual, color="0.7", alpha=0.5, lw=0)
    if each.began > 1:
        axis.axvline(each.began - 0.5, color="0.4", ls=":", lw=1.0)
    if each.trend is not None:
        trend, first = each.trend, each.began - 1
        start = trend.limit - trend.slope * (trend.crossing - 1.0)
        ends = np.array([1.0, trend.crossing])
        axis.plot(ends + first, start + trend.slope * (ends - 1.0), color=COLOURS["q"], lw=1.0)
        axis.hlines(trend.limit, *(np.array(trend.between) + first), color=COLOURS["threshold"], lw=2.0)
        axis.axhline(trend.limit, color=COLOURS["threshold"], ls="--", lw=0.8)
