"""How a recording opens: what was decided, with scores, signals and events beside each other, then the sensors."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle, groupby
from typing import Literal

import rerun as rr
import rerun.blueprint as rrb

from gtmbench.detectors.protocol import Score, Watch, suspects_of
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.faults.fault import Fault
from gtmbench.log.opening.records import whole_s
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.log_findings import (
    about,
    faults_of,
    reported_sensors,
    residuals_of,
    scores_of,
    signals_of,
)
from gtmbench.report.recording.entities import GROUPS, TIMELINE, entity, in_unit, rgb, sensor_entity, whole
from gtmbench.report.style import HUES, SHOWN_LEVELS, around, norm_of, tints
from gtmbench.report.words.judgement import trial_text
from gtmbench.report.words.units import with_unit
from gtmbench.study.trial import Baseline, Trial
from gtmbench.values.channels import ATTITUDE, unit_of
from gtmbench.values.record import Record, Span

_BESIDE = 3  # trials on a page
_LANE = 0.55  # of a sensor's bar, where scores have a height of 2
_MOST_SIGNALS = 6  # of a log on a page

Playing = Literal["paused", "following"]
Page = Sequence[tuple[Trial, str]]  # trials of a scenario, each with its entity


# what every recording opens with


def opened(*tabs: rrb.Container, playing: Playing = "paused") -> rrb.Blueprint:
    """Return a blueprint of tabs, the first in front, panels closed, playback at rest or ``following`` what comes."""
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state=playing),
        auto_views=False,
        auto_layout=False,
    )


def plot(
    name: str,
    entities: Sequence[str],
    shown_s: Span | rrb.TimeAxis,
    *,
    top: float | None = None,
    legend: bool = True,
    told_apart: Sequence[str] = (),
) -> rrb.TimeSeriesView:
    """Return a plot over a span in seconds, or as an axis moves; with `top`, its values run from 0 to it.

    A span's legend has room of its own.

    Entities that are `told_apart` have a colour each in this plot, whatever theirs is elsewhere.
    """
    if isinstance(shown_s, rrb.TimeAxis):
        axis = shown_s
    else:
        # a legend takes 0.3 of a plot's span, before its beginning
        axis = _time_axis((shown_s[0] - legend * 0.3 * (shown_s[1] - shown_s[0]), shown_s[1]))
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=shown(entities),
        overrides={path: rr.SeriesLines(colors=rgb(tint)) for path, tint in zip(told_apart, cycle(HUES), strict=False)},
        axis_x=axis,  # without it a plot shows a minute around the cursor
        axis_y=rrb.ScalarAxis(range=(0.0, top)) if top else None,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
    )


def shown(entities: Sequence[str]) -> list[str]:
    """Return some entities as what a view shows."""
    return [f"+ {entity}" for entity in entities]


def _time_axis(shown_s: Span) -> rrb.TimeAxis:
    start, end = (rr.TimeRangeBoundary.absolute(seconds=time_s) for time_s in shown_s)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def event_log(*entities: str) -> rrb.TextLogView:
    """Return the log of events of some entities."""
    columns = [
        rrb.encodings.TextLogColumn(kind, visible=kind != "EntityPath") for kind in ("EntityPath", "LogLevel", "Body")
    ]
    hidden = rrb.encodings.TimelineColumn(TIMELINE, visible=False)  # it counts from the cursor; the words hold seconds
    return rrb.TextLogView(
        name="events",
        origin="/",
        contents=shown(entities),
        columns=rrb.TextLogColumns(timeline_columns=[hidden], text_log_columns=columns),
    )


def beside(plots: rrb.Container, words: rrb.Container | rrb.View, name: str) -> rrb.Container:
    """Return a tab of plots, with words beside them."""
    return rrb.Horizontal(plots, words, column_shares=[5, 2], name=name)


def in_pairs(plots: Sequence[rrb.View], name: str) -> rrb.Container:
    """Return a tab of plots, two beside each other."""
    return rrb.Grid(*plots, grid_columns=2, name=name)


def signal_plots(signals: Sequence[str], what: str, shown_s: Span | rrb.TimeAxis) -> rrb.Container:
    """Return a plot a signal: its sensor, and what that should have read; `what` names them."""
    plots = [
        plot(in_unit(f"{signal}: {what}", signal), [sensor_entity(signal), entity("/virtual", signal)], shown_s)
        for signal in signals[:_MOST_SIGNALS]
    ]
    return rrb.Grid(*plots, grid_columns=1 if len(plots) < 4 else 2)


def judged_plots(
    roots: Mapping[str, Sequence[str]],
    residuals: Collection[str],
    scores: Collection[str],
    threshold: str,
    shown_s: Span | rrb.TimeAxis,
) -> list[rrb.View]:
    """Return a plot of every residual and one of every score, each below its roots."""
    plots: list[rrb.View] = []
    for name, where in roots.items():
        if name in residuals:
            entities = [entity(f"{root}/residuals", name) for root in where]
            plots.append(plot(in_unit(f"residual of {name}", name), entities, shown_s, legend=False))
        if name in scores:
            entities = [*(entity(f"{root}/levels", name) for root in where), threshold]
            plots.append(plot(f"test statistic of {name}", entities, shown_s, top=SHOWN_LEVELS, legend=False))
    return plots


# a study


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """A detector's part of a study, and where it stands in the recording."""

    baseline: Baseline
    root: str  # its entity; empty where it is the only one
    trials: Sequence[tuple[Trial, str]]  # each with its entity

    def entered(self, trial: Trial) -> tuple[str, ...]:
        """Return the scores and residuals that a trial's faults may enter; the others are the healthy ones."""
        scores, broken = trial.watch.scores, set(trial.channels)
        free = {name for name, score in scores.items() if score.channels and not broken & set(score.channels)}
        return tuple(name for name in tints(trial.watch) if name not in free)


def study_blueprint(placed: Sequence[Placed]) -> rrb.Blueprint:
    """Return how a study opens: what every detector decided, then the sensors and the flight's path."""
    decided = _detector(placed[0])
    if len(placed) > 1:
        decided = [rrb.Tabs(*_detector(part), active_tab=0, name=part.baseline.detector) for part in placed]
    return opened(*decided, _flight_sensors(placed[0]), _path())


def _detector(placed: Placed) -> list[rrb.Container]:
    norm, monitor = norm_of(placed.baseline.watch), placed.baseline.monitor
    if norm is None:
        return [_decision(placed), *_study_residuals(placed)]
    operator = [_operator(placed.root, monitor)] if isinstance(monitor, NormMonitor) else []
    return [_norms(placed, norm), *operator]


def _norms(placed: Placed, norm: Score) -> rrb.Container:
    """Return the one score of all trials, a plot a scenario: a large fault must not hide a small one."""
    baseline, root = placed.baseline, placed.root
    plots, residuals, shown_s = [], [], whole(baseline.flight)
    for scenario in dict.fromkeys(trial.scenario for trial, _ in placed.trials):
        paths = [path for trial, path in placed.trials if trial.scenario == scenario]
        marks = [f"{path}/{name}" for path in paths for name in ("norm", "onset", "alarm")]
        entities = [f"{root}/threshold", f"{root}/healthy/norm", *marks]
        title = f"{norm.name}, {scenario} ({norm.unit})"
        plots.append(plot(title, entities, shown_s, top=SHOWN_LEVELS * norm.threshold))
        residuals += [f"{path}/residual" for path in paths]
    if baseline.watch.residuals:
        entities = [*residuals, f"{root}/healthy/residual"]
        plots.append(plot(f"residual e(k) ({norm.unit})", entities, shown_s, told_apart=residuals))
    grid = rrb.Grid(*plots, grid_columns=2 if len(plots) > 2 else 1)
    return beside(grid, event_log(f"{root}/events"), "Alarms")


def _operator(root: str, monitor: NormMonitor) -> rrb.Container:
    operator = monitor.operator
    charts = [
        rrb.BarChartView(
            name=f"H_i of {name} to {output} over lag i ({unit_of(output)} per {unit_of(name)})",
            origin=f"{root}/operator/{output}/{name}",
        )
        for output in operator.outputs
        for name in operator.inputs
    ]
    return rrb.Vertical(*charts, name="Operator")


def _decision(placed: Placed) -> rrb.Container:
    pages = []
    for _, trials in groupby(placed.trials, key=lambda pair: pair[0].scenario):
        rest = list(trials)
        pages += [_decision_page(placed, rest[at : at + _BESIDE]) for at in range(0, len(rest), _BESIDE)]
    return rrb.Tabs(*pages, active_tab=0, name="Decision")


def _decision_page(placed: Placed, page: Page) -> rrb.Container:
    """Return scores above, measured and virtual sensor in the middle, the log of events below; a column a trial."""
    score_plots, signal_plots = [], []
    for trial, path in page:
        span, names = around(trial, before_s=5.0, after_s=15.0), trial.watch.scores
        healthy = [entity("/healthy/levels", name) for name in names if name not in placed.entered(trial)]
        shared = [f"{placed.root}{of}" for of in (["/threshold", *healthy] if names else [])]
        own = [f"{path}/{name}" for name in ("levels/**", "onset", "alarm", "named")]
        title = f"{'levels' if names else 'alarms'}: {trial_text(trial)}"
        score_plots.append(plot(title, [*shared, *own], span, top=SHOWN_LEVELS))
        title = with_unit(trial.channel, trial.unit) + ": measured" + " and virtual" * bool(names)
        signal_plots.append(plot(title, [f"{path}/measured", f"{path}/virtual", f"{path}/also/**"], span))
    plots = rrb.Grid(*score_plots, *signal_plots, grid_columns=len(page))
    logs = rrb.Horizontal(*(event_log(f"{path}/events") for _, path in page))
    name = f"{page[0][0].scenario}: {', '.join(path.rsplit('/', 1)[1] for _, path in page)}"
    return rrb.Vertical(plots, logs, row_shares=[3, 1], name=name)


def _study_residuals(placed: Placed) -> list[rrb.Container]:
    """Return every residual and score over the whole flight, healthy and in the trials it tells of."""
    watch, root = placed.baseline.watch, placed.root
    roots = {
        name: [f"{root}/healthy", *(path for trial, path in placed.trials if name in placed.entered(trial))]
        for name in dict.fromkeys([*watch.scores, *watch.residuals])
    }
    plots = judged_plots(roots, watch.residuals, watch.scores, f"{root}/threshold", whole(placed.baseline.flight))
    if not plots:
        return []
    grid = in_pairs(plots, "Residuals")
    return [beside(grid, event_log(f"{root}/events"), "Residuals") if watch.alarms else grid]


def _flight_sensors(placed: Placed) -> rrb.Container:
    """Return each group of signals, the surfaces, and every trial's broken channel."""
    shown_s = whole(placed.baseline.flight)
    plots = [plot(f"{group}: true and measured", [f"/sensors/{group}", f"/truth/{group}"], shown_s) for group in GROUPS]
    surfaces = plot("surface commands", ["/surfaces"], shown_s)
    measured = [f"{path}/measured" for _, path in placed.trials]
    broken = plot("broken channels, one trial each", measured, shown_s, told_apart=measured)
    return in_pairs([*plots, surfaces, broken], "Sensors")


def _path() -> rrb.Container:
    """Return the flight in space: the way flown, the aircraft from near by, and its attitude in figures."""
    path = rrb.Spatial3DView(
        name="flight path (ft), the aircraft drawn large", origin="/path", line_grid=rrb.LineGrid3D(visible=True)
    )
    return rrb.Horizontal(path, _attitude(["/truth/attitude"], ["/truth/heading"]), column_shares=[3, 2], name="Path")


def _attitude(angles: Sequence[str], heading: Sequence[str]) -> rrb.Container:
    """Return the aircraft from near by, above what its angles read about the cursor."""
    turned = rrb.Spatial3DView(
        name="attitude",
        origin="/attitude",
        line_grid=rrb.LineGrid3D(visible=False),
        # who looks at the aircraft stands, in its lengths, behind, to the right, above
        eye_controls=rrb.EyeControls3D(
            position=(-1.1, 0.7, -0.6), look_target=(0.0, 0.0, 0.0), eye_up=(0.0, 0.0, -1.0)
        ),
    )
    plots = [
        rrb.TimeSeriesView(name=in_unit(name, "phi"), origin="/", contents=shown(entities), axis_x=about_cursor())
        for name, entities in (("attitude", angles), ("heading", heading))
    ]
    return rrb.Vertical(turned, *plots, row_shares=[4, 1, 1], name="Attitude")


def about_cursor(before_s: float = 10.0, after_s: float = 10.0) -> rrb.TimeAxis:
    """Return an axis that goes along with the time that is shown."""
    start, end = (rr.TimeRangeBoundary.cursor_relative(seconds=time_s) for time_s in (-before_s, after_s))
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


# a watched log


def log_blueprint(watched: WatchedLog) -> rrb.Blueprint:
    """Return how a watched log opens: its first fault, the whole log, residuals, sensors."""
    span, signals = whole_s(watched.log), signals_of(watched)
    pages = []
    for fault in [alarms[0] for alarms in faults_of(watched).values()][:1]:
        suspected = [name for name in signals if name in fault.candidates]
        pages.append(_log_page(watched, fault.verdict, about(fault, span), suspected or signals))
    pages.append(_log_page(watched, "Whole log", span, signals))
    residuals, scores = residuals_of(watched), scores_of(watched)
    roots = {name: [""] for name in [*scores, *residuals]}
    plots = judged_plots(roots, residuals, scores, "/threshold", span)
    turned = []
    if set(ATTITUDE) <= set(watched.log.channels):  # the aircraft as it is turned, with what was said beside it
        angles = _attitude([sensor_entity("phi"), sensor_entity("theta")], [sensor_entity("psi")])
        turned.append(beside(angles, event_log("/events"), "Attitude"))
    return opened(*pages, *([in_pairs(plots, "Residuals")] if plots else []), _log_sensors(watched, span), *turned)


def _log_page(watched: WatchedLog, name: str, span: Span, signals: Sequence[str]) -> rrb.Container:
    """Return scores, or alarms, above; measured and virtual sensors in the middle; timelines and words below."""
    above = ["/threshold", "/levels/**"] if scores_of(watched) or not watched.watches else []
    scores = plot("levels" if above else "alarms", [*above, "/began", "/alarm", "/named"], span, top=SHOWN_LEVELS)
    what = "measured and virtual" if residuals_of(watched) or suspects_of(watched.monitor) else "measured"
    states = rrb.StateTimelineView(
        name="sensors: clear, failed, suspected, not judged",
        origin="/",
        contents=shown(["/state/**"]),
        time_view=_time_axis(span),
    )
    signal_grid = signal_plots(signals, what, span)
    lanes = _LANE * len(reported_sensors(watched.verdict))  # every sensor's is seen without scrolling
    shares = [2.0, 4.0, max(lanes, 1.0)]
    return beside(rrb.Vertical(scores, signal_grid, states, row_shares=shares), event_log("/events"), name)


def _log_sensors(watched: WatchedLog, span: Span) -> rrb.Container:
    """Return a plot a group of a unit, and one each for channels of other names."""
    channels = watched.log.channels
    groups = [group for group, members in GROUPS.items() if set(members) & set(channels)]
    known = {name for members in GROUPS.values() for name in members}
    plots = [plot(group, [f"/sensors/{group}/**"], span) for group in groups]
    plots += [plot(name, [sensor_entity(name)], span) for name in channels if name not in known]
    return in_pairs(plots, "Sensors")


# an assertion that failed


def failed_residual_blueprint(record: Record, outputs: Sequence[str], channels: Sequence[str]) -> rrb.Blueprint:
    """Return how a residual opens that failed its bound: both, then the channels."""
    span, kinds = whole(record), ("residuals", "peaks", "thresholds")
    plots = [
        plot(f"residual of {output} and its bound", [entity(f"/{kind}", output) for kind in kinds], span)
        for output in outputs
    ]
    return opened(_failure(plots, "Residuals"), _channels(record, channels))


def failed_watch_blueprint(watch: Watch, fault: Fault | None, span: Span, channels: Sequence[str]) -> rrb.Blueprint:
    """Return how a watch opens that failed: scores, the broken channel and residuals over a span, then the channels."""
    shown = ["/levels/**", "/threshold", "/onset", "/due", "/alarms"]
    plots = [plot("test statistics: an alarm above 1" if watch.scores else "alarms", shown, span, top=SHOWN_LEVELS)]
    if fault is not None:
        plots.append(_channel(fault.channel, span))
    if watch.residuals:
        plots.append(plot("residuals", ["/residuals/**"], span))
    return opened(_failure(plots, "Alarms"), _channels(watch.record, channels))


def _failure(plots: Sequence[rrb.View], name: str) -> rrb.Container:
    said = rrb.TextDocumentView(name="what failed", origin="/failed")
    return beside(rrb.Vertical(*plots), rrb.Vertical(event_log("/events"), said), name)


def _channels(record: Record, channels: Sequence[str]) -> rrb.Container:
    return in_pairs([_channel(name, whole(record)) for name in channels], "Sensors")


def _channel(name: str, span: Span) -> rrb.TimeSeriesView:
    return plot(in_unit(name, name), [entity(f"/{kind}", name) for kind in ("healthy", "virtual", "sensors")], span)
