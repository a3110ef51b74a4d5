"""What every figure is made of: panels, levels with their threshold, alarms, lines of many samples, one legend."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gtmbench.report.style import COLOURS, HIGHEST, LOWEST
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Styles = Mapping[str, Mapping[str, Any]]  # of lines, by name: `gtmbench.report.style.strokes`
_DPI = 100  # of what a notebook shows
SMALL = (5.8, 3.6)  # inches of a figure whose letters are to be large on a phone
_LABEL = 0.235  # inches that a label needs
_LONGEST_LABEL = 24  # letters
_LEAST_TOP = 10.0  # of an axis of levels


def panels(
    rows: int,
    columns: int,
    size: tuple[float, float],
    heights: Sequence[float] | None = None,
    widths: Sequence[float] | None = None,
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure of rows x columns panels, in inches; `heights` and `widths` are relative to each other."""
    figure = _shown_figure()(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, height_ratios=heights, width_ratios=widths)
    for axis in np.ravel(grid):
        axis.grid(alpha=0.3)
    return figure, [list(row) for row in grid]


@cache
def _shown_figure() -> type[Figure]:
    """Return figures that a notebook shows: pyplot would teach the notebook to, and isn't needed for anything else."""
    from matplotlib.figure import Figure  # a second to import; and no window system

    class ShownFigure(Figure):
        def _repr_png_(self) -> bytes:
            return figure_bytes(self, format="png", dpi=_DPI)

    return ShownFigure


def figure_bytes(figure: Figure, **how: Any) -> bytes:
    """Return a figure as a file holds it; how is as matplotlib's `savefig` takes it."""
    file = io.BytesIO()
    figure.savefig(file, **how)
    return file.getvalue()


def beside_labels(count: int) -> tuple[float, float]:
    """Return the size of a small figure, taller where so many lines are named beside it."""
    width, height = SMALL
    return width, height * max(count / 14, 1.0)  # so many find room beside it


def one_legend(
    figure: Figure,
    axes: Sequence[Axes],
    *,
    columns: int,
    where: Literal["outside lower center", "outside right upper"] = "outside lower center",
) -> None:
    """Give a figure one legend, outside of its axes: what stands on several axes is named once."""
    shown: dict[str, Artist] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    figure.legend(handles=list(shown.values()), labels=list(shown), loc=where, ncols=columns)


def as_it_is(text: str) -> str:
    """Return a text that matplotlib takes for no formula: files may be called anything."""
    return text.replace("$", r"\$")


def draw_threshold(axis: Axes, levels: Sequence[FloatArray]) -> None:
    """Draw the threshold of levels, 1, on a logarithmic axis on which they find room."""
    top = max([_LEAST_TOP, *(float(np.nanmax(values, initial=_LEAST_TOP)) for values in levels)])
    axis.axhline(1.0, color=COLOURS["threshold"], lw=1.2, ls="--", label="threshold")
    axis.set(yscale="log", ylim=(LOWEST, 2.0 * min(top, HIGHEST)))


def draw_alarm(axis: Axes, alarm_s: float | None, named_s: float | None) -> None:
    """Draw when an alarm was raised, and when it named a sensor, as far as it did."""
    if alarm_s is not None:
        axis.axvline(alarm_s, color=COLOURS["threshold"], lw=1.0, label="alarm")
    if named_s is not None:
        axis.axvline(named_s, color=COLOURS["beta"], lw=1.2, ls="-.", label="sensor named")


def thinned(time_s: FloatArray, values: FloatArray, *, every: int) -> tuple[FloatArray, FloatArray]:
    """Return the least and the greatest value of every so many samples: a spike of one sample stays.

    NaN where there are none; samples as they are, where every second or each is wanted.

    >>> thinned(np.arange(6.0), np.array([0.0, 9.0, 1.0, 2.0, 2.0, 2.0]), every=3)
    (array([0. , 1.5, 3. , 4.5]), array([0., 9., 2., 2.]))
    """
    if every <= 2:
        return time_s, values
    starts = np.arange(0, len(values), every)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    begun_s = time_s[starts]
    half_s = 0.5 * every * (time_s[-1] - time_s[0]) / max(len(time_s) - 1, 1)
    times = np.column_stack([begun_s, np.minimum(begun_s + half_s, time_s[-1])])
    return times.ravel(), np.column_stack([low, high]).ravel()


def label_ends(axis: Axes, ends: Mapping[str, float], styles: Styles) -> None:
    """Write each line's name beside its end, one above the other where they end together."""
    on_axis = np.log10 if axis.get_yscale() == "log" else float
    low, high = map(on_axis, axis.get_ylim())
    figure = axis.get_figure(root=True)
    assert figure is not None
    apart = _LABEL / figure.get_size_inches()[1]
    names = sorted(ends, key=lambda name: ends[name])
    places = [(on_axis(ends[name]) - low) / (high - low) for name in names]
    for i in range(1, len(places)):
        places[i] = max(places[i], places[i - 1] + apart)
    over = max([0.0, *[place - 1.0 for place in places]])
    for i in reversed(range(len(places))):  # back below the top, those beneath make room
        ceiling = 1.0 if i == len(places) - 1 else places[i + 1] - apart
        places[i] = min(places[i], ceiling) if over else places[i]
    for name, place in zip(names, places, strict=True):
        axis.annotate(
            short_label(name),
            (1.01, place),
            xycoords="axes fraction",
            va="center",
            color=styles[name]["color"],
            fontsize="small",
            annotation_clip=False,
        )


def in_decades(axis: Axes) -> None:
    """Make an axis logarithmic, its ticks plain numbers."""
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter("{x:g}")


def short_label(name: str) -> str:
    """Return a name that finds room beside an axis."""
    return as_it_is(name if len(name) <= _LONGEST_LABEL else name[: _LONGEST_LABEL - 1] + "…")
