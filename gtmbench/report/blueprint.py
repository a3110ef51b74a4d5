"""How the recording opens: three tabs, whole flight in view, playback at rest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import rerun as rr
import rerun.blueprint as rrb

from gtmbench.channels import unit_of
from gtmbench.report.timeline import TIMELINE
from gtmbench.study.trial import Baseline, Study

_SHOWN_THRESHOLDS = 4.0  # the norm's axis ends at this many thresholds: a large fault must not hide a small one


def blueprint(study: Study, trial_paths: Sequence[str], groups: Iterable[str]) -> rrb.Blueprint:
    """Return the blueprint of a study's recording."""
    baseline = study.baseline
    return rrb.Blueprint(
        rrb.Tabs(
            _alarms(baseline, study, trial_paths),
            _signals(baseline, groups, trial_paths),
            _operator(baseline),
            active_tab=0,
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def _plot(
    name: str, contents: list[str], baseline: Baseline, *, top: float | None = None, legend: bool = True
) -> rrb.TimeSeriesView:
    flight = baseline.flight
    whole = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=flight.start_s),
        end=rr.TimeRangeBoundary.absolute(seconds=flight.end_s),
    )
    return rrb.TimeSeriesView(
        name=name,
        origin="/",
        contents=contents,
        axis_x=rrb.TimeAxis(view_range=whole),  # without it a plot shows a minute around the cursor
        axis_y=rrb.ScalarAxis(range=(0.0, top)) if top else None,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=legend),
    )


def _alarms(baseline: Baseline, study: Study, trial_paths: Sequence[str]) -> rrb.Container:
    unit = unit_of(baseline.operator.outputs[0])
    top = _SHOWN_THRESHOLDS * baseline.threshold
    norms, residuals = [], []
    for scenario in dict.fromkeys(trial.scenario for trial in study.trials):
        own = [path for trial, path in zip(study.trials, trial_paths, strict=True) if trial.scenario == scenario]
        marks = [f"+ {path}/{name}" for path in own for name in ("norm", "onset", "alarm")]
        norms.append(
            _plot(f"E(k), {scenario} ({unit})", ["+ /threshold", "+ /healthy/norm", *marks], baseline, top=top)
        )
        residuals += [f"+ {path}/residual" for path in own]
    residual = _plot(f"residual e(k) ({unit})", [*residuals, "+ /healthy/residual"], baseline, legend=False)
    columns = [
        rrb.encodings.TextLogColumn(kind, visible=kind != "EntityPath") for kind in ("EntityPath", "LogLevel", "Body")
    ]
    events = rrb.TextLogView(name="events", origin="/events", columns=rrb.TextLogColumns(text_log_columns=columns))
    plots = rrb.Grid(*norms, residual, grid_columns=2 if len(norms) > 1 else 1)
    return rrb.Horizontal(plots, events, column_shares=[5, 2], name="Alarms")


def _signals(baseline: Baseline, groups: Iterable[str], trial_paths: Sequence[str]) -> rrb.Container:
    plots = [
        _plot(f"{group}: true and measured", [f"+ /sensors/{group}", f"+ /truth/{group}"], baseline) for group in groups
    ]
    surfaces = _plot("surface commands", ["+ /surfaces"], baseline)
    broken = _plot(
        "broken channels, one trial each", [f"+ {path}/measured" for path in trial_paths], baseline, legend=False
    )
    return rrb.Grid(*plots, surfaces, broken, grid_columns=2, name="Sensors")


def _operator(baseline: Baseline) -> rrb.Container:
    operator = baseline.operator
    charts = [
        rrb.BarChartView(
            name=f"H_i of {name} to {output} over lag i ({unit_of(output)} per {unit_of(name)})",
            origin=f"/operator/{output}/{name}",
        )
        for output in operator.outputs
        for name in operator.inputs
    ]
    path = rrb.Spatial3DView(name="flight path (ft), the aircraft drawn large", origin="/path")
    attitude = rrb.Spatial3DView(name="attitude: north, east, down", origin="/attitude")
    space = rrb.Vertical(path, attitude, row_shares=[3, 2])
    return rrb.Horizontal(rrb.Vertical(*charts), space, column_shares=[1, 1], name="Operator and path")
