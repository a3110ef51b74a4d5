"""How the recording opens: three tabs, whole flight in view, playback at rest."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from gtmbench.channels import unit_of
from gtmbench.report.views import event_log, opened, plot, sensors_tab, whole
from gtmbench.study.trial import Baseline, Study

_SHOWN_THRESHOLDS = 4.0  # the norm's axis ends at this many thresholds: a large fault must not hide a small one


def blueprint(study: Study, trial_paths: Sequence[str]) -> rrb.Blueprint:
    """Return the blueprint of a study's recording."""
    baseline = study.baseline
    return opened(_alarms(baseline, study, trial_paths), sensors_tab(baseline.flight, trial_paths), _operator(baseline))


def _alarms(baseline: Baseline, study: Study, trial_paths: Sequence[str]) -> rrb.Container:
    unit = unit_of(baseline.operator.outputs[0])
    top = _SHOWN_THRESHOLDS * baseline.threshold
    norms, residuals, shown_s = [], [], whole(baseline.flight)
    for scenario in dict.fromkeys(trial.scenario for trial in study.trials):
        own = [path for trial, path in zip(study.trials, trial_paths, strict=True) if trial.scenario == scenario]
        marks = [f"+ {path}/{name}" for path in own for name in ("norm", "onset", "alarm")]
        norms.append(plot(f"E(k), {scenario} ({unit})", ["+ /threshold", "+ /healthy/norm", *marks], shown_s, top=top))
        residuals += [f"+ {path}/residual" for path in own]
    residual = plot(f"residual e(k) ({unit})", [*residuals, "+ /healthy/residual"], shown_s, legend=False)
    plots = rrb.Grid(*norms, residual, grid_columns=2 if len(norms) > 1 else 1)
    return rrb.Horizontal(plots, event_log(["+ /events"]), column_shares=[5, 2], name="Alarms")


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
