"""A fleet of logs as a figure: each gyro's residual, bias and noise, flight by flight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.report.figures.panels import as_it_is, one_legend, panels
from gtmbench.report.style import COLOURS
from gtmbench.values.channels import GYROS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_PANELS = {
    "residual_rms_deg_s": "residual RMS\n(deg/s)",
    "bias_deg_s": "bias (deg/s)",
    "noise_deg_s": "noise (deg/s)",
}
_MOST_NAMES, _MOST_TICKS = 60, 200  # under an axis
_SIGNED = "bias_deg_s"


def gyros_figure(rows: pd.DataFrame) -> Figure | None:
    """Draw each gyro's residual, bias and noise over the flights, in their order; None where no log tells any.

    Flights of one folder are joined by lines. Where the monitor found a failure, the flight is marked.
    """
    names = [f"{gyro}_{name}" for gyro in GYROS for name in _PANELS]
    if not np.isfinite(rows[names].to_numpy(dtype=float)).any():
        return None
    width = float(np.clip(3.0 + 0.22 * len(rows), 7.0, 18.0))
    figure, grid = panels(len(_PANELS), 1, (width, 7.5))
    axes = [row[0] for row in grid]
    at = np.arange(1, len(rows) + 1)
    _, folders = np.unique([str(Path(log).parent) for log in rows["log"]], return_inverse=True)
    order = np.argsort(folders, kind="stable")
    parts = np.flatnonzero(np.diff(folders[order])) + 1
    for axis, (name, label) in zip(axes, _PANELS.items(), strict=True):
        for gyro in GYROS:
            values = rows[f"{gyro}_{name}"].to_numpy(dtype=float)
            line = np.insert(values[order], parts, np.nan)  # a gap between folders
            axis.plot(np.insert(at[order], parts, 0), line, "o-", ms=3.5, lw=0.8, color=COLOURS[gyro], label=gyro)
        failed = [(place - 0.4, 0.8) for place in at[(rows["outcome"] == "failed").to_numpy()]]
        if failed:
            across = axis.get_xaxis_transform()
            axis.broken_barh(
                failed, (0.0, 1.0), transform=across, label="failed", color=COLOURS["threshold"], alpha=0.15, lw=0.0
            )
        if name == _SIGNED:
            axis.axhline(0.0, color=COLOURS["healthy"], lw=0.8)
            axis.set_yscale("symlog", linthresh=0.1)
            axis.margins(y=0.1)
        elif np.nanmax(rows[[f"{gyro}_{name}" for gyro in GYROS]].to_numpy(dtype=float), initial=0.0) > 0.0:
            axis.set_yscale("log")
        axis.set_ylabel(label)
        axis.set_xlim(0.5, len(rows) + 0.5)
        axis.set_xticks(at[:: -(-len(rows) // _MOST_TICKS)], [])
    if len(rows) <= _MOST_NAMES:
        stems = [as_it_is(Path(log).name) for log in rows["log"]]
        axes[-1].set_xticks(at, stems, rotation=60, ha="right", rotation_mode="anchor", fontsize="x-small")
    else:
        every = at[9 :: 10 * -(-len(rows) // 200)]
        axes[-1].set_xticks(every, [str(place) for place in every])
        axes[-1].set_xlabel("flight, in the order in which they were given")
    one_legend(figure, axes, columns=len(GYROS) + 1)
    return figure
