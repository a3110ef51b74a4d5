"""What share of all faults a detector has detected by when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.report.figures.panels import Styles, beside_labels, in_decades, label_ends, panels
from gtmbench.report.style import COLOURS, strokes
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def delay_figure(
    delays_s: Mapping[str, ArrayLike], *, deadline_s: float | None = None, styles: Styles | None = None
) -> Figure:
    """Draw, detector by detector, the share of all faults that it has detected by when.

    `delays_s`: one a fault, in seconds; infinite (or NaN) where it was missed. `deadline_s`: drawn as a line. `styles`:
    of every detector, the same in all figures.
    """
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
