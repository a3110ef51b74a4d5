"""Figures of a study, as PNG: the counterparts of Figs. 4.1-4.4, and every detector's scores around the onsets."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.faults.registry import loaded_faults
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.report.figures.panels import as_it_is, draw_alarm, draw_threshold, one_legend, panels
from gtmbench.report.style import COLOURS, LOWEST, around, colour, level, norm_of, part, tints
from gtmbench.report.words.events import MOST_ALARMS, counting_alarm
from gtmbench.report.words.judgement import alarm_text, repetitions, trial_label, trial_text
from gtmbench.report.words.units import counted, with_unit
from gtmbench.study.trial import Baseline, Study, Trial
from gtmbench.values.channels import COMMANDS, unit_of
from gtmbench.values.record import Span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN_S = (280.0, 285.0)  # Fig. 4.2
_DPI = 130  # of a PNG
_STYLES = ("-", "--", "-.", ":")  # a channel's first severity, its second, ...
_MOST_TRIALS = 15  # of a figure with a place for each
_MOST_NAMED = 20  # in a legend, one by one
_COLUMNS = 3  # of trials
_TITLE = 62  # letters in a line
_PAPER = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8}  # behind a note that lies on lines


def write_figures(study: Study, folder: Path) -> list[Path]:
    """Draw what the detectors show, and return the paths; with several, files end in the detector's name.

    ``markov.png`` and ``prediction.png`` of the dissertation's operator; for every scenario ``norm_SCENARIO.png`` of a
    detector with one score in a unit, ``levels_SCENARIO.png`` of one with other scores, ``virtual_SCENARIO.png`` of one
    that names sensors, and ``alarms_SCENARIO.png`` of one that shows no scores.
    """
    paths = []
    for number, baseline in enumerate(study.baselines):
        twins = [_safe(other.detector) for other in study.baselines[:number]].count(_safe(baseline.detector))
        suffix = f"_{_safe(baseline.detector)}{f'_{twins + 1}' * bool(twins)}" if len(study.baselines) > 1 else ""
        for name, draw in _figures(baseline, study.trials_of(baseline.detector)).items():
            paths.append(folder / f"{name}{suffix}.png")
            draw().savefig(paths[-1], dpi=_DPI)
    return paths


def _safe(name: str) -> str:
    """Return a name as part of a file's: letters, digits, dots and dashes stay."""
    return re.sub(r"[^\w.-]+", "_", name).strip("_.") or "detector"


def _figures(baseline: Baseline, trials: Sequence[Trial]) -> dict[str, Callable[[], Figure]]:
    """Return a detector's figures by name, each still to be drawn: a study holds many."""
    figures: dict[str, Callable[[], Figure]] = {}
    monitor, watch = baseline.monitor, baseline.watch
    if isinstance(monitor, NormMonitor):
        figures |= {
            "markov": partial(markov_figure, monitor.operator),
            "prediction": partial(_prediction, monitor, baseline),
        }
    kinds = ["levels"] if watch.scores and not norm_of(watch) else []
    if monitor.suspects:
        kinds.append("virtual")
    elif not watch.scores:
        kinds.append("alarms")
    for scenario, group in groupby(trials, key=lambda trial: trial.scenario):
        own = list(group)
        if norm_of(watch):
            figures[f"norm_{scenario}"] = partial(_norm, scenario, own)
        for kind in kinds:
            figures[f"{kind}_{scenario}"] = partial(_trials_figure, kind, scenario, own)
    return figures


def markov_figure(operator: Transmissibility) -> Figure:
    """Draw the Markov parameters of an operator over their lags, a panel for each input and output (Fig. 4.1)."""
    rows, columns = len(operator.outputs), len(operator.inputs)
    figure, axes = panels(rows, columns, (3.6 * columns, 1.0 + 2.4 * rows))
    for o, output in enumerate(operator.outputs):
        for i, name in enumerate(operator.inputs):
            axis = axes[o][i]
            parameters, error = operator.markov[:, o, i], operator.standard_error[:, o, i]
            band = parameters - 2.0 * error, parameters + 2.0 * error
            axis.fill_between(operator.lags, *band, color=colour(name, i), alpha=0.25, linewidth=0)
            axis.stem(operator.lags, parameters, linefmt=colour(name, i), markerfmt=".", basefmt="k-")
            axis.set_title(as_it_is(f"{name} to {output}"))
            axis.set_xlabel("lag i (samples)")
            axis.set_ylabel(f"$H_i$ ({unit_of(output)} per {unit_of(name)})")
    title = f"Markov parameters of {operator.name} ± 2 standard errors, residual taken as white (Fig. 4.1)"
    figure.suptitle(as_it_is(title))
    return figure


def _prediction(monitor: NormMonitor, baseline: Baseline) -> Figure:
    record, operator = baseline.healthy, monitor.operator
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


def _norm(scenario: str, trials: list[Trial]) -> Figure:
    """Draw a score in its unit, at the times when it is known: of the healthy record, and of every trial."""
    baseline = trials[0].baseline
    monitor, healthy = baseline.monitor, norm_of(baseline.watch)
    assert healthy is not None
    figure, axes = panels(1, 1, (9.5, 4.5))
    axis = axes[0][0]
    axis.plot(healthy.known_s, healthy.values, color=COLOURS["healthy"], lw=2.2, label="healthy")
    channels = list(dict.fromkeys(trial.channel for trial in trials))
    counts = Counter(trial.channel for trial in trials)
    for i, (trial, repetition) in enumerate(zip(trials, repetitions(trials), strict=True)):
        score = norm_of(trial.watch)
        assert score is not None
        tint = colour(trial.channel, i)
        style = _STYLES[(channels.index(trial.channel) + repetition) % len(_STYLES)]
        every = f"{trial.channel}: {counted(counts[trial.channel], 'trial')}"
        label = trial_label(trial) if len(trials) <= _MOST_NAMED else every
        axis.plot(score.known_s, score.values, style, color=tint, lw=1.2, label=as_it_is(label))
        if trial.alarm_time_s is not None:
            axis.plot(trial.alarm_time_s, healthy.threshold, "v", color=tint, mec="k", ms=8, zorder=4)
    axis.axhline(healthy.threshold, color=COLOURS["threshold"], lw=1.2, ls="--", label="threshold")
    axis.plot([], [], "v", color="w", mec="k", ms=8, label="alarm")
    for onset in sorted({trial.onset_s for trial in trials}):
        axis.axvline(onset, color="k", lw=0.8, ls=":", label=f"onset, {onset:g} s")
    axis.set_yscale("log")
    own = isinstance(monitor, NormMonitor)
    window = f", w = {monitor.window}" if isinstance(monitor, NormMonitor) else ""
    axis.set_xlabel(f"time at which {as_it_is(healthy.name)} is known (s)")
    axis.set_ylabel(as_it_is(f"{healthy.name}{window} ({healthy.unit})"))
    one_legend(figure, [axis], columns=1, where="outside right upper")
    kinds = sorted({trial.fault for trial in trials})
    printed = loaded_faults()[kinds[0]].printed if own and len(kinds) == 1 and kinds[0] in loaded_faults() else ""
    source = f" ({printed}, there at the start of the window)" if printed else ""
    under = ", ".join(kind.replace("_", " ") for kind in kinds)
    of = "" if under == scenario.replace("_", " ") else f"{scenario}: "
    figure.suptitle(as_it_is(f"{of}{healthy.name} under {under}{source}"))
    return figure


def _trials_figure(kind: str, scenario: str, trials: Sequence[Trial]) -> Figure:
    heights, draw, what = _KINDS[kind]
    figure, rows = _grid(trials, heights)
    for trial, *axes in zip(trials, *rows, strict=False):
        draw(axes, trial, _shown_s(trial))
        axes[-1].set_xlabel("time (s)")
    return _finished(figure, rows[0], scenario, trials, what)


def _grid(trials: Sequence[Trial], heights: list[float]) -> tuple[Figure, list[list[Axes]]]:
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


def _finished(figure: Figure, places: list[Axes], scenario: str, trials: Sequence[Trial], what: str) -> Figure:
    """Give the upper axes their titles, the figure its own and one legend."""
    for axis, trial in zip(places, trials, strict=False):
        lines = [*textwrap.wrap(trial_text(trial), _TITLE), *textwrap.wrap(_trial_text(trial), _TITLE)]
        axis.set_title(as_it_is("\n".join(lines)), fontsize="small")
    one_legend(figure, places, columns=8)
    rest = len(trials) - _MOST_TRIALS
    more = f" ({rest} more trials not drawn)" if rest > 0 else ""
    figure.suptitle(as_it_is(f"{scenario}, {basis_of(trials[0].baseline.monitor).title}: {what}{more}"))
    return figure


def _shown_s(trial: Trial) -> Span:
    return around(trial, before_s=4.0, after_s=8.0, longest_s=120.0)


def _levels(axes: Sequence[Axes], trial: Trial, span: Span) -> None:
    axis, colours, levels = axes[0], tints(trial.watch), []
    for i, (name, score) in enumerate(trial.watch.scores.items()):
        time_s, values = part(score.known_s, level(score), span)
        style, label = _STYLES[i % len(_STYLES)], as_it_is(f"test statistic of {name}")
        axis.plot(time_s, np.maximum(values, LOWEST), style, color=colours[name], lw=1.1, label=label)
        levels.append(values)
    draw_threshold(axis, levels)
    axis.set_ylabel("test statistic (alarm above 1)")


def _signal(axes: Sequence[Axes], trial: Trial, span: Span) -> None:
    axis, name, flight = axes[0], trial.channel, trial.flight
    measured = part(trial.record.time_s, trial.broken(name), span)
    told = ("driven", "commanded") if name in COMMANDS else ("measured", "true")
    axis.plot(*measured, ".", color=COLOURS["healthy"], ms=3.5, label=told[0])
    axis.plot(*part(flight.time_s, flight[name], span), color="k", lw=0.8, zorder=3, label=told[1])
    axis.set_ylabel(with_unit(name, unit_of(name)))


def _virtual(axes: Sequence[Axes], trial: Trial, span: Span) -> None:
    """Draw the broken channel with its virtual sensor, and below it, what both are off the truth."""
    _signal(axes, trial, span)
    upper, lower = axes
    name, watch = trial.channel, trial.watch
    begun_s, virtual = part(watch.record.time_s, watch.virtual(name), span)
    if np.isfinite(watch.virtual(name)).any():
        upper.plot(begun_s, virtual, color=COLOURS["virtual"], lw=2.0, label="virtual sensor")
    else:
        note = as_it_is(f"{basis_of(watch.monitor).title} has no virtual sensor for {name}")
        upper.text(0.5, 0.04, note, transform=upper.transAxes, ha="center", fontsize="small", bbox=_PAPER)
    time_s, true = part(trial.flight.time_s, trial.flight[name], span)
    _, measured = part(trial.record.time_s, trial.broken(name), span)
    lower.plot(time_s, measured - true, ".", color=COLOURS["healthy"], ms=2.5)
    lower.plot(begun_s, virtual - true[len(true) - len(virtual) :], color=COLOURS["virtual"], lw=1.2)
    lower.set_ylabel("error")


# heights of a place's axes, what draws them, what is said of all
_KINDS: dict[str, tuple[list[float], Callable[[Sequence[Axes], Trial, Span], None], str]] = {
    "levels": ([2.9], _levels, "test statistics over their thresholds, at the time when they are known"),
    "virtual": ([2.6, 1.5], _virtual, "the failed sensor as measured, its virtual sensor, the truth"),
    "alarms": ([2.6], _signal, "the failed sensor as measured, the truth, alarms"),
}


def _mark(axis: Axes, trial: Trial) -> None:
    for onset_s in sorted({fault.onset_s for fault in (trial.injected, *trial.also)}):
        axis.axvline(onset_s, color="k", lw=1.2, ls=":", label="onset" if onset_s == trial.onset_s else None)
    if trial.departure_time_s is not None:
        axis.axvline(trial.departure_time_s, color="k", lw=1.2, ls="--", label="departure")
    for alarm in () if trial.watch.scores else trial.watch.alarms[:MOST_ALARMS]:  # scores show the others themselves
        axis.axvline(alarm.time_s, color=COLOURS["threshold"], lw=0.5, alpha=0.5)
    draw_alarm(axis, trial.alarm_time_s, trial.isolated_s)


def _trial_text(trial: Trial) -> str:
    counting = counting_alarm(trial)
    if counting is None:
        return f"missed: {trial.reason}"
    late = f"alarm after {trial.detection_delay_s:.2f} s"
    return late if counting.last is None else f"{alarm_text(counting)}; {late}"
