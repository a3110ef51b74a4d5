"""Figures of a campaign's scores: how soon faults are detected, at what price in false alarms, from which size on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.report.figures.panels import (
    SMALL,
    Styles,
    as_it_is,
    beside_labels,
    in_decades,
    label_ends,
    one_legend,
    panels,
    short_label,
)
from gtmbench.report.style import COLOURS, strokes
from gtmbench.report.words.study import severity_unit
from gtmbench.report.words.units import with_unit
from gtmbench.study.scores.curves import Smallest
from gtmbench.study.scores.scoring import DetectorScores
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def price_curves(detectors: Sequence[DetectorScores], target_per_hour: float, styles: Styles) -> Figure:
    """Draw detection against false alarms, over all factors on each detector's thresholds; a marker at its own.

    Healthy records end the curve on the left: a rate that none of them showed can't be drawn. The marker lies on the
    curve, so its rate is that of records with an alarm; alarms counted one by one stand in the table.
    """
    figure, axes = panels(1, 1, beside_labels(len(detectors)))
    axis = axes[0][0]
    ends = {}
    for one in detectors:
        if one.curve is None:
            continue
        shown = (one.curve.alarmed > 0.0) & np.isfinite(one.curve.per_hour)
        own = styles[one.name]
        rates, shares = one.curve.per_hour[shown], one.curve.detected[shown]
        axis.step(rates, shares, where="post", lw=1.8, color=own["color"], linestyle=own["linestyle"])
        silent = one.curve.detected[one.curve.alarmed == 0.0]
        ends[one.name] = float(shares[-1]) if len(shares) else float(silent[-1])
        rate, share = float(one.curve.per_hour[one.curve.own]), float(one.curve.detected[one.curve.own])
        if np.isfinite(rate):
            _mark(axis, rate, share, _place_of_none(detectors), own)
    _draw_target(axis, target_per_hour)
    axis.set(ylim=(0.0, 1.03), ylabel="share of faults detected")
    label_ends(axis, ends, styles)
    return figure


def delay_curves(detectors: Sequence[DetectorScores], target_per_hour: float, styles: Styles) -> Figure:
    """Draw the delay by which half of all faults are detected against false alarms, at some factors on the thresholds.

    A marker stands at each detector's own thresholds. What no healthy record showed, a rate too small to be seen, is
    drawn at the left edge; a line ends where fewer than half are detected.
    """
    figure, axes = panels(1, 1, beside_labels(len(detectors)))
    axis = axes[0][0]
    ends, left = {}, _place_of_none(detectors)
    axis.set_yscale("log")
    for one in detectors:
        if one.price is None:
            continue
        shown = np.isfinite(one.price.delays_s) & np.isfinite(one.price.per_hour)
        if not shown.any():
            continue
        own = styles[one.name]
        rates, delays_s = np.maximum(one.price.per_hour, left)[shown], one.price.delays_s[shown]
        axis.plot(rates, delays_s, lw=1.8, color=own["color"], linestyle=own["linestyle"])
        ends[one.name] = float(delays_s[0])
        as_is = np.flatnonzero(shown & (one.price.factors == 1.0))
        for point in as_is.tolist():
            _mark(axis, float(one.price.per_hour[point]), float(one.price.delays_s[point]), left, own)
    _draw_target(axis, target_per_hour)
    axis.yaxis.set_major_formatter("{x:g}")
    axis.set_ylabel("delay by which half of all\nfaults are detected (s)")
    label_ends(axis, ends, styles)
    return figure


def _mark(axis: Axes, rate: float, value: float, left: float, style: Mapping[str, Any]) -> None:
    """Draw where a detector is at its own thresholds."""
    marker: dict[str, Any] = {"marker": style["marker"] if rate > 0.0 else "<", "color": style["color"], "ms": 8}
    axis.plot([max(rate, left)], [value], linestyle="none", clip_on=False, zorder=5, **marker)


def _draw_target(axis: Axes, target_per_hour: float) -> None:
    """Draw the rate of false alarms that is wanted, on an axis of such rates."""
    grey = COLOURS["healthy"]
    axis.axvline(target_per_hour, color=grey, lw=1.0)
    place = (target_per_hour, 0.01)
    words = f" target {target_per_hour:g}"
    axis.annotate(words, place, xycoords=("data", "axes fraction"), fontsize="small", color=grey)
    in_decades(axis)
    axis.set_xlabel("false alarms an hour (◁: none was seen)")


def _place_of_none(detectors: Sequence[DetectorScores]) -> float:
    """Return where a rate of none is drawn: left of every other."""
    rates = [one.curve.per_hour[one.curve.per_hour > 0.0].min(initial=np.inf) for one in detectors if one.curve]
    found = min([*rates, 10.0])
    return 0.5 * float(found)


def smallest_figure(detectors: Sequence[DetectorScores], styles: Styles) -> Figure:
    """Draw the smallest detected severity of every kind and channel, a panel a kind, with its interval."""
    kinds = list(dict.fromkeys(_panel(found) for one in detectors for found in one.smallest))
    lines = [len({found.channel for one in detectors for found in one.smallest if _panel(found) == k}) for k in kinds]
    heights = [max(lines_, 1) * max(len(detectors), 2) for lines_ in lines]
    figure, axes = panels(len(kinds), 1, (SMALL[0], 1.2 + 0.22 * sum(heights) + 0.5 * len(kinds)), heights=heights)
    for (axis, *_), kind in zip(axes, kinds, strict=True):
        found = {one.name: [each for each in one.smallest if _panel(each) == kind] for one in detectors}
        _draw_smallest(axis, found, styles)
        axis.set_title(as_it_is(kind), fontsize="medium", loc="left")
    one_legend(figure, [axis for (axis, *_) in axes], columns=4)
    return figure


def _panel(found: Smallest) -> str:
    return f"{found.fault.replace('_', ' ')}: {with_unit(found.parameter, severity_unit(found))}"


def _draw_smallest(axis: Axes, found: Mapping[str, Sequence[Smallest]], styles: Styles) -> None:
    channels = list(dict.fromkeys(each.channel for own in found.values() for each in own))
    apart = 0.7 / max(len(found), 1)
    for i, (name, own) in enumerate(found.items()):
        style: dict[str, Any] = {"color": styles[name]["color"]}
        for j, each in enumerate(own):
            factor = 100.0 if each.share_of else 1.0
            y = channels.index(each.channel) + (i - 0.5 * (len(found) - 1)) * apart
            value, low, high = (
                factor * min(max(bound, min(each.mildest, each.severest)), max(each.mildest, each.severest))
                if bound is not None and np.isfinite(bound)
                else factor * each.severest
                for bound in (each.severity.value, each.severity.low, each.severity.high)
            )
            if each.severity.low is not None:
                axis.plot([low, high], [y, y], lw=1.5, **style)
            marker = ">" if each.is_beyond else styles[name]["marker"]
            fill = "none" if each.is_beyond else "full"
            label = short_label(name) if j == 0 else None
            axis.plot([value], [y], linestyle="none", marker=marker, fillstyle=fill, ms=7, label=label, **style)
    in_decades(axis)
    axis.set_yticks(range(len(channels)), channels)
    axis.set_ylim(len(channels) - 0.45, -0.55)


def delay_figure(
    delays_s: Mapping[str, ArrayLike], *, deadline_s: float | None = None, styles: Styles | None = None
) -> Figure:
    """Draw by when each detector has detected which share of faults; infinite or NaN: missed."""
    styles = strokes(delays_s) if styles is None else styles
    figure, axes = panels(1, 1, beside_labels(len(delays_s)))
    axis = axes[0][0]
    arrays = {name: np.asarray(given, dtype=float) for name, given in delays_s.items()}
    there = np.concatenate([delays[np.isfinite(delays)] for delays in arrays.values()] or [np.ones(1)])
    first, last = max(float(np.min(there, initial=1.0)), 0.01), float(np.max(there, initial=deadline_s or 1.0)) * 1.05
    ends = {}
    for name, delays in arrays.items():
        times, shares = _steps(delays, first, last)
        style = {key: styles[name][key] for key in ("color", "linestyle")}
        axis.step(times, shares, where="post", lw=1.8, **style)
        ends[name] = shares[-1]
    if deadline_s is not None:
        grey = COLOURS["healthy"]
        axis.axvline(deadline_s, color=grey, lw=1.0)
        axis.annotate(f"{deadline_s:g} s", (deadline_s, 0.01), fontsize="small", ha="right", color=grey)
    in_decades(axis)
    axis.set_xlim(first, last)
    axis.set_ylim(0.0, 1.03)
    axis.set_xlabel("delay after the onset (s)")
    axis.set_ylabel("share of all faults detected")
    label_ends(axis, ends, styles)
    return figure


def _steps(delays: FloatArray, first: float, last: float) -> tuple[FloatArray, FloatArray]:
    there = np.sort(np.maximum(delays[np.isfinite(delays)], first))
    shares = np.arange(1, len(there) + 1) / max(len(delays), 1)
    ends = shares[-1:] if len(shares) else np.zeros(1)
    return np.concatenate([[first], there, [last]]), np.concatenate([[0.0], shares, ends])
