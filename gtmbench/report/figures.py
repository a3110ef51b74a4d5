"""Figures of a study: the counterparts of Figs. 4.1-4.4, as PNG."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.channels import unit_of
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.text import repetitions, trial_label
from gtmbench.study.trial import Baseline, Study, Trial

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN_S = (280.0, 285.0)  # Fig. 4.2
_DPI = 130
_STYLES = ("-", "--", "-.", ":")  # a channel's first severity, its second, ...


def write_figures(study: Study, folder: Path) -> list[Path]:
    """Draw ``markov.png``, ``prediction.png`` and one ``norm_SCENARIO.png`` a scenario; return their paths."""
    figures = {"markov.png": _markov(study.baseline), "prediction.png": _prediction(study.baseline)}
    for scenario, trials in groupby(study.trials, key=lambda trial: trial.scenario):
        figures[f"norm_{scenario}.png"] = _norm(scenario, list(trials))
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=_DPI)
    return [folder / name for name in figures]


def _markov(baseline: Baseline) -> Figure:
    operator = baseline.operator
    rows, columns = len(operator.outputs), len(operator.inputs)
    figure, axes = panels(rows, columns, (3.6 * columns, 1.0 + 2.4 * rows))
    for o, output in enumerate(operator.outputs):
        for i, name in enumerate(operator.inputs):
            axis = axes[o][i]
            parameters, error = operator.markov[:, o, i], operator.standard_error[:, o, i]
            band = parameters - 2.0 * error, parameters + 2.0 * error
            axis.fill_between(operator.lags, *band, color=colour(name, i), alpha=0.25, linewidth=0)
            axis.stem(operator.lags, parameters, linefmt=colour(name, i), markerfmt=".", basefmt="k-")
            axis.set_title(f"{name} to {output}")
            axis.set_xlabel("lag i (samples)")
            axis.set_ylabel(f"$H_i$ ({unit_of(output)} per {unit_of(name)})")
    figure.suptitle(f"Markov parameters of {operator.name} ± 2 standard errors, residual taken as white (Fig. 4.1)")
    return figure


def _prediction(baseline: Baseline) -> Figure:
    record, operator = baseline.healthy, baseline.operator
    start_s = min(_SHOWN_S[0], max(record.end_s - 5.0, record.start_s))
    span = record.sample_range(start_s, min(start_s + 5.0, record.end_s))
    shown = slice(span.start, span.stop)
    predicted = operator.predict(record)
    figure, axes = panels(len(operator.outputs), 1, (9.0, 1.0 + 3.0 * len(operator.outputs)))
    for o, output in enumerate(operator.outputs):
        axis = axes[o][0]
        axis.plot(record.time_s[shown], record[output][shown], ".", color=COLOURS["healthy"], ms=3, label="measured")
        axis.plot(record.time_s[shown], predicted[shown, o], color=colour(output), lw=1.5, label="predicted")
        axis.set_ylabel(f"{output} ({unit_of(output)})")
        axis.legend(loc="best")
    axes[-1][0].set_xlabel("time (s)")
    figure.suptitle(f"Healthy sensors: measured and predicted by {operator.name} (Fig. 4.2)")
    return figure


_SOURCES = {"drift": " (Fig. 4.3)", "deadzone": " (Fig. 4.4)"}


def _norm(scenario: str, trials: list[Trial]) -> Figure:
    baseline = trials[0].baseline
    unit = unit_of(baseline.operator.outputs[0])
    figure, axes = panels(1, 1, (9.0, 4.5))
    axis = axes[0][0]
    watched = baseline.norm.time_s >= baseline.setup.alarm.watch_from_s
    axis.plot(
        baseline.norm.time_s[watched],
        baseline.norm.values[watched],
        color=COLOURS["healthy"],
        lw=1.0,
        label="healthy",
        zorder=3,
    )
    for i, (trial, repetition) in enumerate(zip(trials, repetitions(trials), strict=True)):
        tint = colour(trial.channel, i)
        style = _STYLES[repetition % len(_STYLES)]
        axis.plot(
            trial.norm.time_s[watched], trial.norm.values[watched], style, color=tint, lw=1.2, label=trial_label(trial)
        )
        if trial.alarm_time_s is not None:
            axis.plot(trial.alarm_time_s, baseline.threshold, "v", color=tint, mec="k", ms=8, zorder=4)
    axis.axhline(baseline.threshold, color=COLOURS["threshold"], lw=1.2, ls="--", label="threshold")
    for onset in sorted({trial.onset_s for trial in trials}):
        axis.axvline(onset, color="k", lw=0.8, ls=":", label=f"onset, {onset:g} s")
    axis.set_yscale("log")
    axis.set_xlabel("k Ts (s): start of the window; triangles: when the alarm could be raised")
    axis.set_ylabel(f"E(k), w = {baseline.norm.window} ({unit})")
    axis.legend(loc="upper left", fontsize="small")
    kinds = sorted({trial.fault for trial in trials})
    source = _SOURCES.get(kinds[0], "") if len(kinds) == 1 else ""
    under = ", ".join(kind.replace("_", " ") for kind in kinds)
    figure.suptitle(as_it_is(f"{scenario}: E(k) under {under}{source}"))
    return figure


def as_it_is(text: str) -> str:
    """Return a text that matplotlib takes for no formula: files may be called anything."""
    return text.replace("$", r"\$")


def panels(
    rows: int,
    columns: int,
    size: tuple[float, float],
    heights: Sequence[float] | None = None,
    widths: Sequence[float] | None = None,
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure of rows x columns panels, in inches; `heights` and `widths` are relative to each other."""
    from matplotlib.figure import Figure  # a second to import; and no window system: figures are files

    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, height_ratios=heights, width_ratios=widths)
    for axis in np.ravel(grid):
        axis.grid(alpha=0.3)
    return figure, [list(row) for row in grid]
