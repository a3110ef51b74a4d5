"""What share of all faults a detector has detected by when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.report.figures.panels import panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def delay_figure(delays_s: Mapping[str, ArrayLike]) -> Figure:
    """Draw, detector by detector, the share of all faults detected over the delay.

    Parameters
    ----------
    delays_s : mapping of name to array
        One a fault, in seconds; infinite (or NaN) where it was missed.
    """
    figure, axes = panels(1, 1, (8.0, 4.5))
    axis = axes[0][0]
    for name, given in delays_s.items():
        delays = np.asarray(given, dtype=float)
        detected = np.sort(delays[np.isfinite(delays)])
        axis.step(detected, np.arange(1, len(detected) + 1) / len(delays), where="post", label=name)
    axis.set_xscale("log")
    axis.set_ylim(0.0, 1.02)
    axis.set_xlabel("delay after the onset (s), look-ahead and windows counted")
    axis.set_ylabel("share of all faults detected by then")
    axis.legend(loc="center right", fontsize="small")
    return figure
