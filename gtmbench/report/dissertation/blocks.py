"""Block diagrams: boxes, sums and wires on a matplotlib axis, as Figs. 3.6 and 6.1 to 6.4."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Place = tuple[float, float]
_WIDTH, _HEIGHT, _RADIUS = 1.3, 0.7, 0.16
_LINE = "#444444"


def block(axis: Axes, at: Place, text: str, *, width: float = _WIDTH) -> None:
    """Draw a box about a place."""
    from matplotlib.patches import Rectangle

    corner = at[0] - width / 2.0, at[1] - _HEIGHT / 2.0
    axis.add_patch(Rectangle(corner, width, _HEIGHT, fc="white", ec=_LINE, lw=1.5, zorder=2))
    axis.text(*at, text, ha="center", va="center", zorder=3)


def junction(axis: Axes, at: Place) -> None:
    """Draw a sum, a circle with a plus."""
    from matplotlib.patches import Circle

    axis.add_patch(Circle(at, _RADIUS, fc="white", ec=_LINE, lw=1.5, zorder=2))
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
