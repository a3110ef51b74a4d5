"""The benchmark's curves: delay against false alarms, size of a fault against detection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gtmbench.report.style import strokes
from gtmbench.study.benchmark.definition import Definition
from gtmbench.study.benchmark.judge import MISSED, Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_RATES, _SHORTEST_S = (3e-3, 30.0), 0.01
_BINS_S = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)


def benchmark_curves(rows: Sequence[Row], definition: Definition) -> Figure:
    """Draw median delay against the measured rate of false alarms, and the share detected against the reference.

    A marker stands where thresholds are set for the benchmark's own rate: on its curve, at the rate that was measured.
    A rate of zero is drawn at the upper bound that the flights allow. The reference's delay stands for a fault's size,
    which makes kinds comparable: the smaller a fault, the later it can be told.
    """
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.curve]
    styles = strokes(row.name for row in shown)
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    delays, sizes = figure.subplots(1, 2)
    for row in shown:
        _draw_delays(delays, row, definition, styles[row.name])
        _draw_sizes(sizes, row, styles[row.name])
    delays.set(xscale="log", yscale="log", xlabel="false alarms an hour", ylabel="median delay (s)")
    delays.set(xlim=(_RATES[0], _RATES[1]), ylim=(_SHORTEST_S, definition.deadline_s))
    delays.axvline(definition.false_alarms_per_hour, color="0.6", lw=0.8)
    sizes.set(
        xscale="log",
        xlim=(_BINS_S[0] / 3.0, 2.0 * _BINS_S[-1]),
        xlabel="mean delay of the reference (s): large faults left",
        ylabel="share detected",
    )
    sizes.set_ylim(-0.03, 1.03)
    if shown:
        figure.legend(*sizes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    return figure


def _draw_delays(axis: Axes, row: Row, definition: Definition, style: dict[str, object]) -> None:
    points = [point for point in row.curve if math.isfinite(point.median_delay_s)]
    rates = [point.false_alarms.value or point.false_alarms.high for point in points]
    delays_s = [max(point.median_delay_s, _SHORTEST_S) for point in points]
    axis.plot(rates, delays_s, color=style["color"], ls=style["linestyle"])
    for rate, delay_s, point in zip(rates, delays_s, points, strict=True):
        if point.allowed_per_hour == definition.false_alarms_per_hour:
            axis.plot([rate], [delay_s], color=style["color"], marker=style["marker"], ls="none")


def _draw_sizes(axis: Axes, row: Row, style: dict[str, object]) -> None:
    places, shares = [], []
    for low, high in zip((0.0, *_BINS_S), (*_BINS_S, math.inf), strict=True):
        within = [outcome.told != MISSED for outcome in row.outcomes if low <= outcome.reference_s < high]
        if within:
            places.append(math.sqrt(max(low, 0.03) * min(high, 200.0)))
            shares.append(sum(within) / len(within))
    axis.plot(places, shares, color=style["color"], ls=style["linestyle"], marker=style["marker"], ms=4, label=row.name)
