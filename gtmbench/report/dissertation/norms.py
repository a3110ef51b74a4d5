"""E(k) of several operators over time on one logarithmic axis, as in Figs. 4.6 to 4.13."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gtmbench.method.residual import WindowedNorm
from gtmbench.report.style import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TINTS = tuple(COLOURS[name] for name in ("p", "q", "r", "beta"))


def level_panel(axis: Axes, norms: Sequence[WindowedNorm], *, unit: str, changes_s: Sequence[float] = ()) -> None:
    """Draw E(k) of T_1, T_2, ... at k Ts; dotted lines stand where the system changed."""
    for i, norm in enumerate(norms):
        axis.plot(norm.time_s, norm.values, color=_TINTS[i % len(_TINTS)], lw=1.2, label=f"$T_{i + 1}$")
    for at in changes_s:
        axis.axvline(at, color="k", lw=0.9, ls=":")
    axis.set_yscale("log")
    axis.set_xlabel("k Ts (s): start of the window")
    axis.set_ylabel(f"E(k), w = {norms[0].window} ({unit})")
    axis.legend(loc="best", fontsize="small", ncols=len(norms))
