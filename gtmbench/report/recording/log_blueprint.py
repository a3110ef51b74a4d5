"""How the recording of a watched log opens: the first fault, the whole log, residuals, sensors."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from gtmbench.channels import unit_of
from gtmbench.record import Span
from gtmbench.report.recording.lines import GROUPS, entity
from gtmbench.report.recording.views import event_log, opened, plot
from gtmbench.report.scores import SHOWN_LEVELS
from gtmbench.report.words.units import with_unit
from gtmbench.report.words.watched import about, faults_of, residuals_of, scores_of, signals_of, whole_of
from gtmbench.study.log.watched import WatchedLog

_MOST_SIGNALS = 6


def log_blueprint(watched: WatchedLog) -> rrb.Blueprint:
    """Return the blueprint of a watched log's recording."""
    whole, signals = whole_of(watched), signals_of(watched)
    faults = [same[0] for same in faults_of(watched).values()][:1]
    pages = [
        _decision(watched, fault.verdict, about(fault, whole), [name for name in signals if name in fault.candidates])
        for fault in faults
    ]
    pages += [_decision(watched, "Whole log", whole, []), *_residuals(watched, whole), _sensors(watched, whole)]
    return opened(*pages)


def sensor_entity(channel: str) -> str:
    """Return the entity of a channel as measured: ``/sensors/rates/p``, ``/sensors/other/...``."""
    group = next((group for group, members in GROUPS.items() if channel in members), "other")
    return entity(f"/sensors/{group}", channel)


def _decision(watched: WatchedLog, name: str, span: Span, suspected: Sequence[str]) -> rrb.Container:
    """Return levels above, measured and virtual sensors in the middle, what was watched and what was said below.

    All that is worth looking at, where nothing is suspected. Without scores there are alarms instead of levels.
    """
    above = ["+ /threshold", "+ /levels/**"] if scores_of(watched) or not watched.watches else []
    marks = ["+ /began", "+ /alarm", "+ /named"]
    levels = plot("levels" if above else "alarms", [*above, *marks], span, top=SHOWN_LEVELS)
    has_virtual = bool(watched.monitor.suspects or residuals_of(watched))
    signals = suspected or signals_of(watched)
    plots = [_signal(signal, span, has_virtual=has_virtual) for signal in signals[:_MOST_SIGNALS]]
    axis = rrb.TimeAxis(
        view_range=rr.TimeRange(
            start=rr.TimeRangeBoundary.absolute(seconds=span[0]), end=rr.TimeRangeBoundary.absolute(seconds=span[1])
        )
    )
    states = rrb.StateTimelineView(name="what was watched", origin="/", contents=["+ /state"], time_view=axis)
    signal_plots = rrb.Grid(*plots, grid_columns=1 if len(plots) < 4 else 2)
    return rrb.Horizontal(
        rrb.Vertical(levels, signal_plots, states, row_shares=[3, 5, 1]),
        event_log(["+ /events"]),
        column_shares=[5, 2],
        name=name,
    )


def _signal(name: str, span: Span, *, has_virtual: bool) -> rrb.TimeSeriesView:
    title = with_unit(f"{name}: measured and virtual" if has_virtual else f"{name}: measured", unit_of(name))
    return plot(title, [f"+ {sensor_entity(name)}", f"+ {entity('/virtual', name)}"], span)


def _residuals(watched: WatchedLog, span: Span) -> list[rrb.Container]:
    outputs, scores, plots = residuals_of(watched), scores_of(watched), []
    for name in dict.fromkeys([*scores, *outputs]):
        if name in outputs:
            residual = with_unit(f"residual of {name}", unit_of(name))
            plots.append(plot(residual, [f"+ {entity('/residuals', name)}"], span, legend=False))
        if name in scores:
            level = [f"+ {entity('/levels', name)}", "+ /threshold"]
            plots.append(plot(f"level of {name}", level, span, top=SHOWN_LEVELS, legend=False))
    return [rrb.Grid(*plots, grid_columns=2, name="Residuals")] if plots else []


def _sensors(watched: WatchedLog, span: Span) -> rrb.Container:
    """Return a plot a group of a unit, and one each for channels of other names."""
    channels = watched.log.channels
    groups = [group for group, members in GROUPS.items() if set(members) & set(channels)]
    known = {name for members in GROUPS.values() for name in members}
    plots = [plot(group, [f"+ /sensors/{group}/**"], span) for group in groups]
    plots += [plot(name, [f"+ {sensor_entity(name)}"], span) for name in channels if name not in known]
    return rrb.Grid(*plots, grid_columns=2, name="Sensors")
