"""`gb.plot`: what a record, an operator, a watch, a trial, a study or a log looks like, as one matplotlib figure."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmbench.bench.loop_flight import LoopFlight
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.watched_log import WatchedLog
from gtmbench.method.residual import Residual, WindowedNorm
from gtmbench.method.selection.inputs import ExcitationCount
from gtmbench.method.selection.orders import OrderChoice
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.report.figures.log import log_figure
from gtmbench.report.figures.panels import as_it_is, draw_threshold, panels, short_label, thinned
from gtmbench.report.figures.study import markov_figure
from gtmbench.report.style import COLOURS, LOWEST, around, level, norm_of, part, strokes
from gtmbench.report.words.events import MOST_ALARMS
from gtmbench.report.words.judgement import trial_text
from gtmbench.report.words.units import counted, with_unit
from gtmbench.study.trial import Study, Trial
from gtmbench.values.channels import CHANNELS, Role, unit_of
from gtmbench.values.record import FloatArray, Record, Span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _HEIGHT = 9.0, 1.8  # inches, of a panel
_POINTS = 2000  # of a line: more than a panel has pixels
_MOST_PANELS = 10  # that one sees at once
_MOST_TRIALS = 45  # rows
_MOST_EVENTS = 4  # that a title says
_BEFORE_S, _AFTER_S = 15.0, 20.0  # of a trial, before the onset and after the decision


def plot(value: Any) -> Figure:
    """Draw a value of this package.

    Parameters
    ----------
    value
        A Record, FlightLog or LoopFlight shows its channels, those of one unit together; a Transmissibility its Markov
        parameters; a Residual and a WindowedNorm themselves; a Watch its test statistics over their thresholds, its
        alarms, and measured beside predicted readings; a Trial the same about the onset; a Study the delay of every
        trial; a WatchedLog the treatment of the log; an OrderChoice and an ExcitationCount their evidence.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it; ``figure.savefig("flight.png")`` writes it.

    Raises
    ------
    InputError
        If it is none of these.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly("gtm", duration_s=2.0)
    >>> figure = gb.plot(flight.select(["p", "q", "phi"]))
    >>> [axis.get_ylabel() for axis in figure.axes]
    ['deg/s', 'deg']
    """
    draw = next((draw for kind, draw in _DRAWN.items() if isinstance(value, kind)), None)
    if draw is None:
        known = ", ".join(kind.__name__ for kind in _DRAWN)
        raise InputError(f"a {type(value).__name__} can't be drawn; give one of {known}")
    return draw(value)


def _records(records: Sequence[Record]) -> Figure:
    """Draw stretches of the same channels, a panel for all of one unit."""
    groups = [list(names) for _, names in groupby(records[0].channels, key=_family)]
    drawn = groups[:_MOST_PANELS]
    figure, axes = panels(len(drawn), 1, (_WIDTH, 0.8 + _HEIGHT * len(drawn)))
    for (axis,), names in zip(axes, drawn, strict=True):
        for record in records:
            _lines(axis, record.time_s, {name: record[name] for name in names})
        axis.set_ylabel(unit_of(names[0]))
    rest = sum(map(len, groups[_MOST_PANELS:]))
    _timed(figure, axes, f"{counted(rest, 'more channel')} not drawn" if rest else "")
    return figure


def _loop(flight: LoopFlight) -> Figure:
    figure = _records([flight.readings(commands=True)])
    for axis in figure.axes:
        for event in flight.events:
            axis.axvline(event.time_s, color=COLOURS["threshold"], lw=1.0)
    told = [f"{event.kind} at {event.time_s:.2f} s" for event in flight.events[:_MOST_EVENTS]]
    figure.suptitle(as_it_is("; ".join(told)), fontsize="medium")
    return figure


def _family(name: str) -> tuple[str, ...]:
    """Return what shares a panel with a channel: those beside it of one unit, and heading none, which runs on."""
    known = CHANNELS.get(name)
    return (name,) if known is None or name == "psi" else (known.unit, "sensor" * (known.role is Role.SENSOR))


def _residuals(residual: Residual) -> Figure:
    figure, axes = panels(1, 1, (_WIDTH, 0.8 + 1.5 * _HEIGHT))
    _lines(axes[0][0], residual.time_s, dict(zip(residual.outputs, residual.values.T, strict=True)))
    axes[0][0].set_ylabel(with_unit("residual", unit_of(residual.outputs[0])))
    _timed(figure, axes, "")
    return figure


def _norm(norm: WindowedNorm) -> Figure:
    """Draw E(k) at the times when it is known."""
    figure, axes = panels(1, 1, (_WIDTH, 0.8 + 1.5 * _HEIGHT))
    _lines(axes[0][0], norm.known_s, {f"E(k), w = {norm.window}": norm.values})
    _timed(figure, axes, "drawn at the time when it is known")
    return figure


def _watch(watch: Watch) -> Figure:
    figure, axes = _watched(watch, (watch.record.start_s, watch.record.end_s))
    _timed(figure, axes, f"watched by {basis_of(watch.monitor).title}: {_alarms_text(watch.faults)}")
    return figure


def _trial(trial: Trial) -> Figure:
    """Draw its watch about the onset and the alarm, with the onsets of all that broke."""
    span = around(trial, before_s=_BEFORE_S, after_s=_AFTER_S)
    figure, axes = _watched(trial.watch, span, first=trial.channel)
    for (axis,) in axes:
        for fault in (trial.injected, *trial.also):
            axis.axvline(fault.onset_s, color="k", lw=1.2, ls=":", label="onset")
        axis.set_xlim(*span)
    _timed(figure, axes, f"{trial_text(trial)}, watched by {basis_of(trial.watch.monitor).title}: {trial.in_short}")
    return figure


def _watched(watch: Watch, span: Span, first: str | None = None) -> tuple[Figure, list[list[Axes]]]:
    """Draw scores and sensors, the `first` of these on top; those that are predicted, else those that are used."""
    used = [name for name in watch.monitor.channels or watch.record.channels if name in watch.record]
    told = [alarm.sensor for alarm in watch.faults]
    named = [name for name in (first, *told, *(watch.predictions or used)) if name in watch.record.channels]
    sensors = list(dict.fromkeys(named))[:4]  # with a panel each, of those that are predicted
    rows = bool(watch.scores) + len(sensors)
    figure, axes = panels(rows, 1, (_WIDTH, 1.0 + _HEIGHT * rows))
    for (axis,), name in zip(axes[len(axes) - len(sensors) :], sensors, strict=True):
        _sensor(axis, watch, name, span)
    if watch.scores:
        _scores(axes[0][0], watch, span)
    for row in axes:
        for alarm in watch.faults[:MOST_ALARMS]:
            row[0].axvline(alarm.time_s, color=COLOURS["threshold"], lw=1.0, label="alarm")
    return figure, axes


def _scores(axis: Axes, watch: Watch, span: Span) -> None:
    """Draw a score in its unit, or scores over their thresholds, at the times when they are known."""
    own = norm_of(watch)
    if own is not None:
        known_s, values = part(own.known_s, own.values, span)
        _lines(axis, known_s, {own.name: values})
        axis.axhline(own.threshold, color=COLOURS["threshold"], lw=1.2, ls="--", label="threshold")
        _logarithmic(axis)
        axis.set_ylabel(as_it_is(with_unit(own.name, own.unit)))
        return
    for name, style in strokes(watch.scores).items():
        score = watch.scores[name]
        known_s, levels = part(score.known_s, level(score), span)
        _line(axis, known_s, np.maximum(levels, LOWEST), f"test statistic of {name}", style)
    draw_threshold(axis, [level(score) for score in watch.scores.values()])
    axis.set_ylabel("test statistic\n(alarm above 1)")


def _sensor(axis: Axes, watch: Watch, name: str, span: Span) -> None:
    """Draw a sensor as measured, and over it what it should have read."""
    time_s = watch.record.time_s
    _line(axis, *part(time_s, watch.record[name], span), "measured", {"color": COLOURS["healthy"], "lw": 2.2})
    virtual = watch.virtual(name)
    if np.isfinite(virtual).any():
        _line(
            axis,
            *part(time_s, virtual, span),
            "virtual sensor",
            {"color": COLOURS["virtual"], "linestyle": "--", "lw": 0.9},
        )
    axis.set_ylabel(as_it_is(with_unit(name, unit_of(name))))


def _study(study: Study) -> Figure:
    """Draw every trial's delay, a row a fault, a mark a detector; what was missed stands in a strip at the right."""
    rows: dict[tuple[str, str], list[Trial]] = {}
    for trial in study.trials:
        rows.setdefault((trial_text(trial), trial.scenario), []).append(trial)
    shown = dict(list(rows.items())[:_MOST_TRIALS])
    texts = [text for text, _ in shown]
    names = [f"{scenario}: {text}" if texts.count(text) > 1 else text for text, scenario in shown]
    styles = strokes(each.detector for each in study.baselines)
    counts = {
        name: f"{short_label(name)}: {sum(trial.detected for trial in trials)} of {len(trials)}"
        for name in styles
        for trials in [study.trials_of(name)]
    }
    beside = dict(zip(styles, np.linspace(-0.25, 0.25, len(styles) + 2)[1:-1], strict=True))  # in one row
    delays_s = [trial.detection_delay_s for trial in study.trials if trial.detection_delay_s is not None]
    least, most = max(min(delays_s, default=1.0), 0.01), max(*delays_s, 1.0)
    missed_s = 3.0 * most
    figure, axes = panels(1, 1, (_WIDTH, 1.4 + (0.2 + 0.07 * len(styles)) * len(shown)))
    axis = axes[0][0]
    for row, trials in enumerate(shown.values()):
        for trial in trials:
            delay_s, style = trial.detection_delay_s, styles[trial.detector]
            at = missed_s if delay_s is None else max(delay_s, least)
            fill = "none" if delay_s is None else style["color"]
            at_row = row + beside[trial.detector]
            axis.plot(at, at_row, style["marker"], color=style["color"], mfc=fill, ms=6, label=counts[trial.detector])
    axis.set(xscale="log", xlim=(0.7 * least, 1.5 * missed_s))
    axis.axvspan(2.0 * most, 1.5 * missed_s, color=COLOURS["healthy"], alpha=0.15, lw=0.0)
    axis.text(missed_s, 1.01, "missed", transform=axis.get_xaxis_transform(), ha="center")
    axis.xaxis.set_major_formatter("{x:g}")
    axis.set_yticks(range(len(shown)), list(map(as_it_is, names)))
    axis.set(ylim=(len(shown) - 0.5, -0.5), xlabel="delay of the alarm after the onset (s)")
    _legend(axis)
    if len(rows) > len(shown):
        figure.suptitle(f"{counted(len(rows) - len(shown), 'more fault')} not drawn", fontsize="medium")
    return figure


def _lines(axis: Axes, time_s: FloatArray, values: Mapping[str, FloatArray]) -> None:
    for name, style in strokes(values).items():
        _line(axis, time_s, values[name], name, style)


def _line(axis: Axes, time_s: FloatArray, values: FloatArray, label: str, style: Mapping[str, Any]) -> None:
    look = {"lw": 1.1, **{key: style[key] for key in style if key != "marker"}}
    axis.plot(*thinned(time_s, values, every=2 * len(values) // _POINTS), label=short_label(label), **look)


def _logarithmic(axis: Axes) -> None:
    """Make an axis logarithmic, its labels plain numbers, those between decades where there are few."""
    from matplotlib.ticker import LogFormatter

    axis.set_yscale("log")
    axis.yaxis.set_major_formatter(LogFormatter())
    axis.yaxis.set_minor_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))


def _timed(figure: Figure, axes: Sequence[Sequence[Axes]], title: str) -> None:
    """Give time axes one scale, what stands in several panels one place in a legend, the figure its title."""
    spans = [row[0].get_xlim() for row in axes]
    named: set[str] = set()
    for (axis,) in axes:
        axis.set_xlim(min(span[0] for span in spans), max(span[1] for span in spans))
        axis.tick_params(labelbottom=axis is axes[-1][0])
        named |= _legend(axis, but=named)
    axes[-1][0].set_xlabel("time (s)")
    if title:
        figure.suptitle(as_it_is(title), wrap=True, fontsize="medium")


def _legend(axis: Axes, but: Container[str] = ()) -> set[str]:
    """Name everything once, beside the axis, where it covers nothing; return what is named."""
    handles, labels = axis.get_legend_handles_labels()
    once = {label: handle for label, handle in zip(labels, handles, strict=True) if label not in but}
    if once:
        axis.legend(
            list(once.values()),
            list(once),
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            fontsize="small",
            frameon=False,
        )
    return set(once)


def _alarms_text(faults: Iterable[Alarm]) -> str:
    told = [f"{alarm.verdict} at {alarm.time_s:.2f} s" for alarm in faults]
    return "; ".join(told[:3]) + (f"; {len(told) - 3} more" if len(told) > 3 else "") or "no alarm"


_LABELS = {"heldout": "held-out residual over the outputs' RMS"}


def order_figure(choice: OrderChoice, *, name: str | None = None) -> Figure:
    """Draw a column (unless told ``heldout``, or ``bic``) of the table over r and d, the recommendation marked."""
    wanted = name or ("heldout" if "heldout" in choice.table else "bic")
    surface = choice.surface(wanted)
    figure, axes = panels(1, 1, (6.4, 5.0))
    axis = axes[0][0]
    # a residual spans decades; of a criterion only differences count, so it is drawn above its least
    residual = wanted.startswith(("heldout", "rms"))
    values = surface if residual else surface - surface.min(axis=None) + 1.0
    drawn = axis.imshow(values, origin="lower", cmap="viridis", aspect="auto", norm="log")
    label = _LABELS.get(wanted, wanted) if residual else f"{wanted} above its least, plus 1"
    figure.colorbar(drawn, ax=axis, label=label)
    axis.grid(visible=False)
    axis.set_xticks(range(surface.shape[1]), [str(d) for d in surface.columns])
    axis.set_yticks(range(surface.shape[0]), [str(r) for r in surface.index])
    at = surface.columns.get_loc(choice.noncausal_order), surface.index.get_loc(choice.causal_order)
    axis.plot(*at, "o", ms=14, mfc="none", mec=COLOURS["threshold"], mew=2.5)
    axis.set_xlabel("d (samples ahead)")
    axis.set_ylabel("r (samples back)")
    axis.set_title(f"recommended: r = {choice.causal_order}, d = {choice.noncausal_order}")
    return figure


def excitation_figure(count: ExcitationCount) -> Figure:
    """Draw the relative residuals of all choices of inputs and all outputs against m, and the curve that is read."""
    figure, axes = panels(1, 1, (6.4, 4.2))
    axis = axes[0][0]
    axis.plot(count.table["m"], count.table["relative_residual"], ".", color=COLOURS["healthy"], ms=5, alpha=0.6)
    curve = count.by_m
    axis.plot([0, *curve.index], [1.0, *curve], "o-", color=COLOURS["p"], label="best choice of inputs, RMS of outputs")
    if count.excitations is not None:
        axis.axvline(count.excitations, color=COLOURS["threshold"], ls="--", label=f"{count.excitations} excitations")
    axis.set_yscale("log")
    axis.set_xticks([0, *curve.index])
    axis.set_xlabel("m, number of pseudo inputs (dots: every choice, every output)")
    axis.set_ylabel("residual RMS over the output's RMS")
    axis.legend(loc="best", fontsize="small")
    return figure


_DRAWN: Mapping[type, Callable[[Any], Figure]] = {
    Record: lambda record: _records([record]),
    FlightLog: lambda log: _records(log.segments),
    LoopFlight: _loop,
    Transmissibility: markov_figure,
    Residual: _residuals,
    WindowedNorm: _norm,
    Watch: _watch,
    Trial: _trial,
    Study: _study,
    WatchedLog: log_figure,
    OrderChoice: order_figure,
    ExcitationCount: excitation_figure,
}
