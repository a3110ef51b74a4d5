"""What every recording opens with: plots of a span, the log of events, the sensors' tab, playback at rest."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from gtmbench.record import Record, Span
from gtmbench.report.recording.lines import GROUPS
from gtmbench.report.recording.timeline import TIMELINE


def opened(*tabs: rrb.Container) -> rrb.Blueprint:
    """Return a blueprint of tabs, the first in front, panels closed, playback at rest."""
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def whole(flight: Record) -> Span:
    """Return the span of a flight."""
    return flight.start_s, flight.end_s


def plot(
    name: str, contents: list[str], shown_s: Span, *, top: float | None = None, legend: bool = True
) -> rrb.TimeSeriesView:
    """Return a plot over a span in seconds; with `top`, its axis runs from 0 to it."""
    span = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=shown_s[0]), end=rr.TimeRangeBoundary.absolute(seconds=shown_s[1])
    )
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=contents,
        axis_x=rrb.TimeAxis(view_range=span),  # without it a plot shows a minute around the cursor
        axis_y=rrb.ScalarAxis(range=(0.0, top)) if top else None,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
    )


def event_log(contents: list[str]) -> rrb.TextLogView:
    """Return the log of events of some entities."""
    columns = [
        rrb.encodings.TextLogColumn(kind, visible=kind != "EntityPath") for kind in ("EntityPath", "LogLevel", "Body")
    ]
    return rrb.TextLogView(
        name="events", origin="/", contents=contents, columns=rrb.TextLogColumns(text_log_columns=columns)
    )


def sensors_tab(flight: Record, trial_paths: Sequence[str]) -> rrb.Container:
    """Return the tab of signals: each group, the surfaces, and every trial's broken channel."""
    shown_s = whole(flight)
    plots = [
        plot(f"{group}: true and measured", [f"+ /sensors/{group}", f"+ /truth/{group}"], shown_s) for group in GROUPS
    ]
    surfaces = plot("surface commands", ["+ /surfaces"], shown_s)
    measured = [f"+ {path}/measured" for path in trial_paths]
    broken = plot("broken channels, one trial each", measured, shown_s, legend=False)
    return rrb.Grid(*plots, surfaces, broken, grid_columns=2, name="Sensors")


def path_tab() -> rrb.Container:
    """Return the tab of the flight in space: the way flown, and the aircraft from near by."""
    path = rrb.Spatial3DView(name="flight path (ft), the aircraft drawn large", origin="/path")
    attitude = rrb.Spatial3DView(name="attitude: north, east, down", origin="/attitude")
    return rrb.Horizontal(path, attitude, column_shares=[3, 2], name="Path")
