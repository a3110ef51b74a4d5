"""Figures of a monitored study: levels around every onset, and what failed beside its virtual sensor, as PNG."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.channels import unit_of
from gtmbench.record import FloatArray, Span
from gtmbench.report.figures import as_it_is, panels
from gtmbench.report.monitor_text import judgement_text
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.text import trial_label
from gtmbench.study.monitored import MonitoredStudy, MonitoredTrial

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DPI = 130
_MOST_TRIALS = 15  # of a figure
_COLUMNS = 3
_BEFORE_S, _AFTER_S, _MISSED_S, _LONGEST_S = 4.0, 8.0, 60.0, 120.0
_LOWEST = 0.03  # of levels on their logarithmic axis
_TITLE = 62  # letters in a line


def write_monitored_figures(study: MonitoredStudy, folder: Path) -> list[Path]:
    """Draw ``levels_SCENARIO.png`` and ``virtual_SCENARIO.png`` for every scenario; return their paths."""
    figures = {}
    for scenario, group in groupby(study.trials, key=lambda trial: trial.scenario):
        trials = list(group)
        figures[f"levels_{scenario}.png"] = _levels_figure(scenario, trials)
        figures[f"virtual_{scenario}.png"] = _virtual_figure(scenario, trials)
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=_DPI)
    return [folder / name for name in figures]


def _levels_figure(scenario: str, trials: Sequence[MonitoredTrial]) -> Figure:
    figure, (places,) = _grid(trials, heights=[2.9])
    for axis, trial in zip(places, trials, strict=False):
        _levels(axis, trial, _shown_s(trial))
        axis.set_xlabel("time (s)")
    return _finished(figure, places, scenario, trials, "every residual's level, at the time when it is known")


def _virtual_figure(scenario: str, trials: Sequence[MonitoredTrial]) -> Figure:
    figure, (signals, errors) = _grid(trials, heights=[2.6, 1.5])
    for upper, lower, trial in zip(signals, errors, trials, strict=False):
        span = _shown_s(trial)
        _virtual(upper, trial, span)
        _virtual_error(lower, trial, span)
        lower.set_xlabel("time (s)")
    return _finished(figure, signals, scenario, trials, "the failed sensor as measured, its virtual sensor, the truth")


def _grid(trials: Sequence[MonitoredTrial], heights: list[float]) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure with a place for every trial, and its axes: all first, all second of a place."""
    drawn = min(len(trials), _MOST_TRIALS)
    columns = min(drawn, _COLUMNS)
    rows = -(-drawn // columns)
    size = (max(4.8 * columns, 6.5), 1.2 + (sum(heights) + 0.3) * rows)
    figure, axes = panels(rows * len(heights), columns, size, heights * rows)
    kinds = [[axis for row in axes[first :: len(heights)] for axis in row] for first in range(len(heights))]
    for places in kinds:
        for axis in places[drawn:]:
            axis.set_visible(False)
        for axis, trial in zip(places, trials, strict=False):
            axis.set_xlim(*_shown_s(trial))
            _mark(axis, trial)
    return figure, kinds


def _finished(figure: Figure, places: list[Axes], scenario: str, trials: Sequence[MonitoredTrial], what: str) -> Figure:
    """Give the upper axes their titles, the figure its own and one legend."""
    shown: dict[str, Artist] = {}
    for axis, trial in zip(places, trials, strict=False):
        lines = [f"{trial.fault.replace('_', ' ')} of {trial_label(trial)}", *textwrap.wrap(_said(trial), _TITLE)]
        axis.set_title("\n".join(lines), fontsize="small")
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    figure.legend(handles=list(shown.values()), labels=list(shown), loc="outside lower center", ncols=8)
    rest = len(trials) - _MOST_TRIALS
    bank = trials[0].baseline.monitor.bank.name
    more = f" ({rest} more trials not drawn)" if rest > 0 else ""
    figure.suptitle(as_it_is(f"{scenario}, bank {bank}: {what}{more}"))
    return figure


def _shown_s(trial: MonitoredTrial) -> Span:
    """Return the span around a trial's onset, alarm and decision, within the flight; longer where it was missed."""
    told = [time_s for time_s in (trial.alarm_time_s, trial.isolated_s) if time_s is not None]
    last_s = max(told) + _AFTER_S if told else trial.onset_s + _MISSED_S
    start_s = max(trial.onset_s - _BEFORE_S, trial.record.start_s)
    return start_s, min(last_s, start_s + _LONGEST_S, trial.record.end_s)


def _levels(axis: Axes, trial: MonitoredTrial, span: Span) -> None:
    """Draw levels on a logarithmic axis."""
    top = 10.0
    for i, (output, level) in enumerate(trial.watched.levels.items()):
        time_s, values = _part(level.known_s, level.values, span)
        axis.plot(time_s, np.maximum(values, _LOWEST), color=colour(output, i), lw=1.1, label=f"level of {output}")
        top = max(top, float(np.nanmax(values, initial=top)))
    axis.axhline(1.0, color=COLOURS["threshold"], lw=1.2, ls="--", label="threshold")
    axis.set_yscale("log")
    axis.set_ylim(_LOWEST, 2.0 * min(top, 1e6))
    axis.set_ylabel("level (alarm above 1)")


def _virtual(axis: Axes, trial: MonitoredTrial, span: Span) -> None:
    name, flight, seen = trial.channel, trial.baseline.flight, trial.watched
    measured = _part(trial.record.time_s, trial.record[name], span)
    axis.plot(*measured, ".", color=COLOURS["healthy"], ms=2.5, label="measured")
    axis.plot(*_part(flight.time_s, flight[name], span), color="k", alpha=0.35, lw=2.4, label="true")
    virtual = seen.virtual(name)
    if np.isfinite(virtual).any():
        axis.plot(*_part(seen.record.time_s, virtual, span), color=COLOURS["virtual"], lw=1.2, label="virtual sensor")
    else:
        note = f"bank {seen.monitor.bank.name} has no virtual sensor for {name}"
        axis.text(0.5, 0.04, note, transform=axis.transAxes, ha="center", fontsize="small")
    axis.set_ylabel(f"{name} ({unit_of(name)})")


def _virtual_error(axis: Axes, trial: MonitoredTrial, span: Span) -> None:
    name, seen = trial.channel, trial.watched
    time_s, true = _part(trial.baseline.flight.time_s, trial.baseline.flight[name], span)
    _, measured = _part(trial.record.time_s, trial.record[name], span)
    axis.plot(time_s, measured - true, ".", color=COLOURS["healthy"], ms=2.5)
    begun_s, virtual = _part(seen.record.time_s, seen.virtual(name), span)
    axis.plot(begun_s, virtual - true[len(true) - len(virtual) :], color=COLOURS["virtual"], lw=1.2)
    axis.set_ylabel("minus true")


def _mark(axis: Axes, trial: MonitoredTrial) -> None:
    axis.axvline(trial.onset_s, color="k", lw=1.2, ls=":", label="onset")
    if trial.alarm_time_s is not None:
        axis.axvline(trial.alarm_time_s, color=COLOURS["threshold"], lw=1.0, label="alarm")
    if trial.isolated_s is not None:
        axis.axvline(trial.isolated_s, color=COLOURS["beta"], lw=1.2, ls="-.", label="sensor named")


def _said(trial: MonitoredTrial) -> str:
    if not trial.detected:
        return f"missed: {trial.reason}"
    finding = next(one for one in trial.watched.findings if one.alarm_s == trial.alarm_time_s)
    return f"{judgement_text(finding.last)}; alarm after {trial.detection_delay_s:.2f} s"


def _part(time_s: FloatArray, values: FloatArray, span: Span) -> tuple[FloatArray, FloatArray]:
    shown = (time_s >= span[0]) & (time_s <= span[1])
    return time_s[shown], values[shown]
