"""Figures of the experiments: structures of masses and springs, block diagrams, operators and E(k) on an axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.method.residual import WindowedNorm
from gtmbench.report.style import COLOURS
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Place = tuple[float, float]
_WIDTH, _HEIGHT, _JUNCTION = 1.3, 0.7, 0.16  # of a diagram
_MASS = 0.2  # a radius
_LINE = "#444444"
_TINTS = tuple(COLOURS[name] for name in ("p", "q", "r", "beta"))


def draw_structure(
    axis: Axes,
    places: Mapping[int, Place],
    springs: Mapping[tuple[int, int], str],
    *,
    driven: Sequence[int],
) -> None:
    """Draw the wall, 0, masses 1..n at their places about one apart, springs by name, and arrows on driven masses."""
    from matplotlib.patches import Circle, Rectangle

    for (i, j), name in springs.items():
        start, end = np.array(places[i], dtype=float), np.array(places[j], dtype=float)
        axis.plot(*_spring(start, end).T, color=COLOURS["healthy"], lw=1.4, zorder=1)
        along = (end - start) / np.linalg.norm(end - start)
        x, y = (start + end) / 2 + 0.22 * np.array([-along[1], along[0]])
        axis.text(
            x,
            y,
            name,
            ha="center",
            va="center",
            color=_LINE,
            size="small",
        )
    for k, (x, y) in places.items():
        if k == 0:
            axis.add_patch(Rectangle((x - 0.08, y - 0.45), 0.16, 0.9, color=_LINE, zorder=2))
            continue
        tint = COLOURS["q"] if k in driven else COLOURS["p"]
        axis.add_patch(Circle((x, y), _MASS, fc="white", ec=tint, lw=2.2, zorder=2))
        axis.text(x, y, f"$m_{k}$", ha="center", va="center", zorder=3)
        if k in driven:
            axis.annotate(
                "",
                (x, y + _MASS),
                (x, y + _MASS + 0.45),
                arrowprops={"arrowstyle": "-|>", "color": COLOURS["q"], "lw": 2.2},
            )
            axis.plot(x, y + _MASS + 0.55, alpha=0.0)  # room for the arrow
    axis.set_aspect("equal")
    axis.margins(0.12)
    axis.axis("off")


def _spring(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return a zigzag between two points, straight at both ends."""
    along = end - start
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    teeth = np.linspace(0.3, 0.7, 12)
    heights = np.zeros(14)
    heights[2:12] = 0.07 * (-1.0) ** np.arange(10)
    return np.asarray(start + np.outer([0.0, *teeth, 1.0], along) + np.outer(heights, across))


def block(axis: Axes, at: Place, text: str, *, width: float = _WIDTH) -> None:
    """Draw a box about a place."""
    from matplotlib.patches import Rectangle

    corner = at[0] - width / 2.0, at[1] - _HEIGHT / 2.0
    axis.add_patch(Rectangle(corner, width, _HEIGHT, fc="white", ec=_LINE, lw=1.5, zorder=2))
    axis.text(*at, text, ha="center", va="center", zorder=3)


def junction(axis: Axes, at: Place) -> None:
    """Draw a sum, a circle with a plus."""
    from matplotlib.patches import Circle

    axis.add_patch(Circle(at, _JUNCTION, fc="white", ec=_LINE, lw=1.5, zorder=2))
    axis.text(*at, "+", ha="center", va="center", zorder=3)


def wire(axis: Axes, corners: Sequence[Place], label: str = "", *, tint: str = _LINE, style: str = "-") -> None:
    """Draw a wire through its corners, an arrow at its end, the label at its beginning.

    Boxes and sums lie above wires, so one may begin in the middle of a box; it has to end at an edge.
    """
    x, y = zip(*corners, strict=True)
    axis.plot(x, y, style, color=tint, lw=1.3, zorder=1)
    arrow = {"arrowstyle": "-|>", "color": tint, "lw": 1.3, "shrinkA": 0.0, "shrinkB": 0.0}
    axis.annotate("", corners[-1], corners[-2], arrowprops=arrow, zorder=1)
    if label:
        axis.text(x[0], y[0] + 0.09, label, ha="left", va="bottom", color=tint)


def blank(axis: Axes) -> None:
    """Take the frame, ticks and grid away; units are the same both ways."""
    axis.set_aspect("equal")
    axis.margins(0.05)
    axis.axis("off")


def draw_both_ways(axis: Axes, x: FloatArray, forced: FloatArray, moved: FloatArray) -> None:
    """Draw the magnitudes of T^F and T^D on each other; the x axis is labelled by who knows its unit."""
    axis.semilogy(x, forced, color=COLOURS["p"], lw=3.5, alpha=0.5, label="$T^F$, force-driven")
    axis.semilogy(x, moved, "--", color=COLOURS["threshold"], lw=1.2, label="$T^D$, displacement-driven")
    axis.set_ylabel("$|T(j\\omega)|$")
    axis.legend(loc="best", fontsize="small")


def norm_panel(axis: Axes, norms: Sequence[WindowedNorm], *, unit: str, changes_s: Sequence[float] = ()) -> None:
    """Draw E(k) of T_1, T_2, ... at k Ts; dotted lines stand where the system changed."""
    for i, norm in enumerate(norms):
        axis.plot(norm.time_s, norm.values, color=_TINTS[i % len(_TINTS)], lw=1.2, label=f"$T_{i + 1}$")
    for at in changes_s:
        axis.axvline(at, color="k", lw=0.9, ls=":")
    axis.set_yscale("log")
    axis.set_xlabel("k Ts (s): start of the window")
    axis.set_ylabel(f"E(k), w = {norms[0].window} ({unit})")
    axis.legend(loc="best", fontsize="small", ncols=len(norms))
