"""Sketches of masses and springs, and operators of structures driven by forces and by prescribed motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.record import FloatArray
from gtmbench.report.style import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_RADIUS = 0.2


def draw_structure(
    axis: Axes,
    places: Mapping[int, tuple[float, float]],
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
            color="#444444",
            size="small",
        )
    for k, (x, y) in places.items():
        if k == 0:
            axis.add_patch(Rectangle((x - 0.08, y - 0.45), 0.16, 0.9, color="#444444", zorder=2))
            continue
        tint = COLOURS["q"] if k in driven else COLOURS["p"]
        axis.add_patch(Circle((x, y), _RADIUS, fc="white", ec=tint, lw=2.2, zorder=2))
        axis.text(x, y, f"$m_{k}$", ha="center", va="center", zorder=3)
        if k in driven:
            axis.annotate(
                "",
                (x, y + _RADIUS),
                (x, y + _RADIUS + 0.45),
                arrowprops={"arrowstyle": "-|>", "color": COLOURS["q"], "lw": 2.2},
            )
            axis.plot(x, y + _RADIUS + 0.55, alpha=0.0)  # room for the arrow
    axis.set_aspect("equal")
    axis.margins(0.12)
    axis.axis("off")


def draw_both_ways(axis: Axes, x: FloatArray, forced: FloatArray, moved: FloatArray) -> None:
    """Draw the magnitudes of T^F and T^D on each other; the x axis is labelled by who knows its unit."""
    axis.semilogy(x, forced, color=COLOURS["p"], lw=3.5, alpha=0.5, label="$T^F$, force-driven")
    axis.semilogy(x, moved, "--", color=COLOURS["threshold"], lw=1.2, label="$T^D$, displacement-driven")
    axis.set_ylabel("$|T(j\\omega)|$")
    axis.legend(loc="best", fontsize="small")


def _spring(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return a zigzag between two points, straight at both ends."""
    along = end - start
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    teeth = np.linspace(0.3, 0.7, 12)
    heights = np.zeros(14)
    heights[2:12] = 0.07 * (-1.0) ** np.arange(10)
    return np.asarray(start + np.outer([0.0, *teeth, 1.0], along) + np.outer(heights, across))
