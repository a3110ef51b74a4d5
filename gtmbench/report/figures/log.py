"""The figure of a watched log: the sensors' timelines, test statistics, signals, virtual sensors, residuals."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.checks import printable
from gtmbench.detectors.assumptions import basis_of
from gtmbench.engine.curves import ErrorCurve
from gtmbench.intake.events import EventKind, of_kind
from gtmbench.log.judging.claims import began_s
from gtmbench.log.opening.records import whole_s
from gtmbench.log.opening.seconds import trailing_means
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.figures.panels import draw_alarm, draw_threshold, one_legend, panels, thinned
from gtmbench.report.log_findings import (
    about,
    faults_of,
    reported_sensors,
    residuals_of,
    scores_of,
    signals_of,
    tints_of,
)
from gtmbench.report.style import COLOURS, EVENTS, LOWEST, STATES, VERDICTS, level, part
from gtmbench.report.words.events import MOST_ALARMS
from gtmbench.report.words.found import certificate_lines, made_text
from gtmbench.report.words.judgement import alarm_text
from gtmbench.report.words.monitor import rms_identified
from gtmbench.report.words.timeline import cut
from gtmbench.report.words.units import is_long, round_times, time_title, with_unit
from gtmbench.report.words.verdict import verdict_text
from gtmbench.values.channels import unit_of
from gtmbench.values.record import FloatArray, Span
from gtmbench.verdict.timeline import State

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DPI = 130  # of a PNG
_POINTS = 2500  # of a line: more than a panel has pixels
_MOST_FAULTS = 2
_MOST_EVENTS = 60  # that are drawn
_MEAN_S = 4.0  # of a gyro less the attitude's rate
_TITLE = 105  # letters in a line
_LINE = 0.15  # inches, of the certificate
_LANE = 0.28  # inches, of a sensor's timeline
_LONGEST_NAME = 14  # letters before a lane
_ACCUSED = (State.FAILED, State.SUSPECTED)
_EDGE = 1.5  # points about a span in which a sensor is accused


def write_log_figure(watched: WatchedLog, path: Path) -> None:
    """Draw one PNG, as `log_figure` does."""
    log_figure(watched).savefig(path, dpi=_DPI)


def log_figure(watched: WatchedLog) -> Figure:
    """Draw the whole log, and beside it the time about each of the first faults."""
    import matplotlib as mpl

    with mpl.rc_context({"text.parse_math": False}):  # channels may be called anything
        return _figure(watched)


def _figure(watched: WatchedLog) -> Figure:
    faults = [same[0] for same in faults_of(watched).values()][:_MOST_FAULTS]
    whole = whole_s(watched.log)
    spans = [whole, *(about(fault, whole) for fault in faults)]
    lanes = len(reported_sensors(watched.verdict)) + bool(watched.log.remarks)
    heights = [_LANE * max(lanes, 1), *([2.4] if scores_of(watched) else [])]
    heights += [1.7] * len(_curves(watched))
    for name in signals_of(watched):
        heights += [1.7, 1.2] if name in residuals_of(watched) else [1.7]
    seen = certificate_lines(watched.certificate)
    heights += [_LINE * (len(seen) + 1)] if seen else []
    widths = [12.0 - 3.0 * bool(faults), *(5.0 for _ in faults)]
    figure, axes = panels(len(heights), len(spans), (sum(widths), 2.0 + sum(heights)), heights, widths)
    if seen:
        _draw_certificate(axes.pop(), seen)
    for column, span in enumerate(spans):
        _column([row[column] for row in axes], watched, span)
    for axis, fault in zip(axes[0][1:], faults, strict=True):
        axis.set_title(textwrap.fill(alarm_text(fault), 45), fontsize="medium")
    _finished(figure, [axis for row in axes for axis in row], watched)
    return figure


def _draw_certificate(axes: Sequence[Axes], lines: Sequence[str]) -> None:
    for axis in axes:
        axis.set_axis_off()
    written = axes[0].text(
        0.0, 1.0, "\n".join(lines), transform=axes[0].transAxes, va="top", family="monospace", fontsize="small"
    )
    written.set_in_layout(False)  # it runs on under the next column, which needn't make room for it


def _column(axes: Sequence[Axes], watched: WatchedLog, span: Span) -> None:
    """Draw a span: the sensors' timelines, levels, then every signal with its residual."""
    rest = iter(axes)
    _timelines(next(rest), watched)
    if scores_of(watched):
        _levels(next(rest), watched, span)
    for curve in _curves(watched):
        _evidence(next(rest), watched, curve, span)
    for name in signals_of(watched):
        _signal(next(rest), watched, name, span)
        if name in residuals_of(watched):
            _residual(next(rest), watched, name, span)
    for axis in axes:
        axis.set_xlim(*span)
        axis.tick_params(labelbottom=axis is axes[-1])
    for axis in axes[1:]:
        _marked(axis, watched)
    if is_long(span):
        axes[-1].set_xticks(*zip(*round_times(span), strict=True))
    axes[-1].set_xlabel(time_title(span))


def _timelines(axis: Axes, watched: WatchedLog) -> None:
    """Draw a bar a sensor in its states' colours, where faults began, and the remarks on the log below."""
    timeline, sensors = watched.verdict.timeline, reported_sensors(watched.verdict)
    for lane, sensor in enumerate(sensors):
        for state, tint in STATES.items():
            spans = [(each.start_s, each.duration_s) for each in timeline.sensors[sensor] if each.state == state]
            if spans:
                edge = _EDGE if state in _ACCUSED else 0.0  # in ten hours a second is narrower than a pixel
                axis.broken_barh(
                    spans, (lane - 0.36, 0.72), facecolor=tint, edgecolor=tint, lw=edge, zorder=1.0 + edge, label=state
                )
        accused = timeline.of(sensor, *_ACCUSED)[:MOST_ALARMS]
        if accused:
            begun_s = [each.start_s for each in accused]
            axis.plot(begun_s, [lane] * len(begun_s), "|", color="k", ms=13, mew=1.6, label="fault began, estimated")
    ends = [time_s for remark in watched.log.remarks for time_s in (remark.start_s, remark.end_s, np.nan)]
    lanes = [cut(sensor, _LONGEST_NAME) for sensor in sensors]
    if ends:
        axis.plot(ends, np.full(len(ends), len(lanes)), "d-", color="k", ms=4, lw=1.0, label="remark")
        lanes.append("remarks")
    axis.set_ylim(max(len(lanes), 1) - 0.5, -0.5)
    axis.set_yticks(range(len(lanes)), lanes)
    axis.tick_params(axis="y", length=0)
    axis.grid(visible=False)
    axis.spines[["top", "right", "left"]].set_visible(False)


def _bands(axis: Axes, watched: WatchedLog, sensor: str) -> None:
    """Tint a sensor's panel where it failed, is suspected or isn't judged."""
    for span in watched.verdict.timeline.of(sensor, *_ACCUSED, State.NOT_JUDGED):
        axis.axvspan(span.start_s, span.end_s, facecolor=STATES[span.state], alpha=0.25, lw=0.0, zorder=0)


def _marked(axis: Axes, watched: WatchedLog) -> None:
    for event in of_kind(watched.log.events, *map(EventKind, EVENTS))[:_MOST_EVENTS]:
        axis.axvline(event.time_s, color=EVENTS[event.kind], lw=0.9, ls=(0, (2, 2)), label=f"{event.kind}, as logged")
    for alarm in watched.alarms[:MOST_ALARMS]:
        if began_s(alarm) < alarm.time_s:
            axis.axvline(began_s(alarm), color="k", lw=1.2, ls=":", label="fault began, estimated")
        draw_alarm(axis, alarm.time_s, alarm.isolated_s)


def _levels(axis: Axes, watched: WatchedLog, span: Span) -> None:
    tints, tops = tints_of(watched), [np.zeros(0)]
    for watch in watched.watches:
        for name, score in watch.scores.items():
            levels = level(score)
            np.maximum(levels, LOWEST, out=levels)
            tops.append(np.nanmax(levels, initial=LOWEST, keepdims=True))
            of = f"residual of {name}" if name in watch.residuals else name
            _line(axis, score.known_s, levels, span, tints[name], f"test statistic, {of}")
    draw_threshold(axis, tops)
    axis.yaxis.set_major_formatter("{x:g}")
    axis.set_ylabel("test statistic\n(alarm above 1)")


def _curves(watched: WatchedLog) -> Sequence[ErrorCurve]:
    return watched.curves[:_MOST_FAULTS]


def _evidence(axis: Axes, watched: WatchedLog, curve: ErrorCurve, span: Span) -> None:
    """Draw what a relation is off by, its mean, and what a fault makes of it."""
    tint = tints_of(watched).get(curve.sensor, COLOURS["virtual"])
    mean = trailing_means(curve.measured, max(round(_MEAN_S / float(np.diff(curve.time_s[:2])[0])), 1), 0.5)
    _line(axis, curve.time_s, curve.measured, span, COLOURS["healthy"], curve.said)
    _line(axis, curve.time_s, mean, span, tint, f"its mean over {_MEAN_S:g} s", width=1.8)
    _line(axis, curve.time_s, curve.predicted, span, "k", f"predicted for {made_text(curve)}")
    shown = np.concatenate([part(curve.time_s, values, span)[1] for values in (mean, curve.predicted)])
    most = float(np.nanmax(np.abs(shown), initial=LOWEST))
    axis.set(ylim=(-1.5 * most, 1.5 * most), ylabel=textwrap.fill(with_unit(curve.said, curve.unit), 22))


def _signal(axis: Axes, watched: WatchedLog, name: str, span: Span) -> None:
    _bands(axis, watched, name)
    for segment in watched.log.segments:
        _line(axis, segment.time_s, segment[name], span, COLOURS["healthy"], "measured", width=2.4)
    for watch in watched.watches:
        virtual = watch.virtual(name) if name in watch.record else np.array([np.nan])
        if np.isfinite(virtual).any():
            _line(axis, watch.record.time_s, virtual, span, COLOURS["virtual"], "virtual sensor", width=0.8)
    axis.set_ylabel(textwrap.fill(with_unit(name, unit_of(name)), 18))


def _residual(axis: Axes, watched: WatchedLog, output: str, span: Span) -> None:
    tint = tints_of(watched)[output]
    _bands(axis, watched, output)
    for watch in watched.watches:
        _line(axis, watch.record.time_s, watch.residuals[output], span, tint)
    usual = 3.0 * rms_identified(watched.monitor).get(output, np.nan)
    for bound in (-usual, usual) if usual > 0.0 else ():
        axis.axhline(bound, color="k", lw=0.8, ls="--", label="±3 RMS of the training part")
    axis.set_ylabel(textwrap.fill(f"residual of {output}", 18))


def _line(
    axis: Axes,
    time_s: FloatArray,
    values: FloatArray,
    span: Span,
    tint: str,
    label: str | None = None,
    *,
    width: float = 1.0,
) -> None:
    shown_s, shown = part(time_s, values, span)
    if len(shown):
        rows = int((span[1] - span[0]) / (time_s[-1] - time_s[0] + 1e-9) * len(time_s))  # of a line from end to end
        axis.plot(*thinned(shown_s, shown, every=2 * rows // _POINTS), lw=width, color=tint, label=label)


def _finished(figure: Figure, axes: Sequence[Axes], watched: WatchedLog) -> None:
    one_legend(figure, axes, columns=5)
    title = basis_of(watched.monitor).title
    said = textwrap.wrap(f"{verdict_text(watched)} ({printable(watched.log.path.name)}, {title})", _TITLE)
    figure.suptitle("\n".join(said), fontweight="bold", color=VERDICTS[watched.verdict.outcome.name.lower()])
