"""How a study's recording opens: what every detector decided, then the sensors and the flight's path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import rerun.blueprint as rrb

from gtmbench.channels import unit_of
from gtmbench.detectors.protocol import Score
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.report.recording.lines import entity
from gtmbench.report.recording.views import event_log, opened, path_tab, plot, sensors_tab, whole
from gtmbench.report.scores import SHOWN_LEVELS, around, norm_of, tints
from gtmbench.report.words.judgement import trial_label
from gtmbench.report.words.units import with_unit
from gtmbench.study.trial import Baseline, Trial

_BESIDE = 3  # trials on a page

Page = Sequence[tuple[Trial, str]]  # trials of a scenario, each with its entity


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """A detector's part of a study, and where it stands in the recording.

    Attributes
    ----------
    baseline : Baseline
    root : str
        Its entity; empty where it is the only one.
    trials : sequence of Trial
    paths : sequence of str
        Their entities.
    """

    baseline: Baseline
    root: str
    trials: Sequence[Trial]
    paths: Sequence[str]

    def entered(self, trial: Trial) -> tuple[str, ...]:
        """Return the scores and residuals that a trial's channel may enter; the others are the healthy ones."""
        scores = trial.watch.scores
        free = {name for name, score in scores.items() if score.channels and trial.channel not in score.channels}
        return tuple(name for name in tints(trial.watch) if name not in free)


def blueprint(placed: Sequence[Placed]) -> rrb.Blueprint:
    """Return the blueprint of a study's recording; with several detectors, a tab for each."""
    flight = placed[0].baseline.flight
    shared = [sensors_tab(flight, placed[0].paths), path_tab()]
    if len(placed) == 1:
        return opened(*_tabs(placed[0]), *shared)
    own = [rrb.Tabs(*_tabs(one), active_tab=0, name=one.baseline.detector) for one in placed]
    return opened(*own, *shared)


def _tabs(placed: Placed) -> list[rrb.Container]:
    norm, monitor = norm_of(placed.baseline.watch), placed.baseline.monitor
    if norm is None:
        return [_decision(placed), *_residuals(placed)]
    operator = [_operator(placed.root, monitor)] if isinstance(monitor, NormMonitor) else []
    return [_norms(placed, norm), *operator]


def _norms(placed: Placed, norm: Score) -> rrb.Container:
    """Return the one score of all trials, a plot a scenario: a large fault must not hide a small one."""
    baseline, root = placed.baseline, placed.root
    top = SHOWN_LEVELS * norm.threshold
    norms, residuals, shown_s = [], [], whole(baseline.flight)
    for scenario in dict.fromkeys(trial.scenario for trial in placed.trials):
        own = [path for trial, path in zip(placed.trials, placed.paths, strict=True) if trial.scenario == scenario]
        marks = [f"+ {path}/{name}" for path in own for name in ("norm", "onset", "alarm")]
        contents = [f"+ {root}/threshold", f"+ {root}/healthy/norm", *marks]
        norms.append(plot(f"{norm.name}, {scenario} ({norm.unit})", contents, shown_s, top=top))
        residuals += [f"+ {path}/residual" for path in own]
    if baseline.watch.residuals:
        contents = [*residuals, f"+ {root}/healthy/residual"]
        norms.append(plot(f"residual e(k) ({norm.unit})", contents, shown_s, legend=False))
    plots = rrb.Grid(*norms, grid_columns=2 if len(norms) > 2 else 1)
    return rrb.Horizontal(plots, event_log([f"+ {root}/events"]), column_shares=[5, 2], name="Alarms")


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
    """Return the trials of every scenario, a few on a page."""
    pages: list[list[tuple[Trial, str]]] = []
    for trial, path in zip(placed.trials, placed.paths, strict=True):
        page = pages[-1] if pages else []
        if page and page[0][0].scenario == trial.scenario and len(page) < _BESIDE:
            page.append((trial, path))
        else:
            pages.append([(trial, path)])
    return rrb.Tabs(*(_decision_page(placed, page) for page in pages), active_tab=0, name="Decision")


def _decision_page(placed: Placed, page: Page) -> rrb.Container:
    """Return levels above, measured and virtual sensor in the middle, the log of events below; a column a trial."""
    levels, signals = [], []
    for trial, path in page:
        span, names = around(trial, before_s=5.0, after_s=15.0), trial.watch.scores
        healthy = [entity("/healthy/levels", name) for name in names if name not in placed.entered(trial)]
        shared = [f"+ {placed.root}{of}" for of in (["/threshold", *healthy] if names else [])]
        own = [f"+ {path}/{name}" for name in ("levels/**", "onset", "alarm", "named")]
        what = f"{trial.fault.replace('_', ' ')} of {trial_label(trial)}"
        levels.append(plot(f"{'levels' if names else 'alarms'}: {what}", [*shared, *own], span, top=SHOWN_LEVELS))
        signal = with_unit(trial.channel, trial.unit) + ": measured" + " and virtual" * bool(names)
        signals.append(plot(signal, [f"+ {path}/measured", f"+ {path}/virtual"], span))
    logs = [event_log([f"+ {path}/events"]) for _, path in page]
    plots = rrb.Grid(*levels, *signals, grid_columns=len(page))
    name = f"{page[0][0].scenario}: {', '.join(path.rsplit('/', 1)[1] for _, path in page)}"
    return rrb.Vertical(plots, rrb.Horizontal(*logs), row_shares=[3, 1], name=name)


def _residuals(placed: Placed) -> list[rrb.Container]:
    """Return every residual and score over the whole flight, healthy and in the trials it tells of."""
    watch, root = placed.baseline.watch, placed.root
    span, plots = whole(placed.baseline.flight), []
    for name in dict.fromkeys([*watch.scores, *watch.residuals]):
        told = [path for trial, path in zip(placed.trials, placed.paths, strict=True) if name in placed.entered(trial)]
        for kind, there in (("residuals", watch.residuals), ("levels", watch.scores)):
            if name in there:
                contents = [f"+ {entity(f'{path}/{kind}', name)}" for path in (f"{root}/healthy", *told)]
                is_level = kind == "levels"
                title = f"level of {name}" if is_level else with_unit(f"residual of {name}", unit_of(name))
                contents += [f"+ {root}/threshold"] * is_level
                plots.append(plot(title, contents, span, top=SHOWN_LEVELS if is_level else None, legend=False))
    if not plots:
        return []
    grid = rrb.Grid(*plots, grid_columns=2, name="Residuals")
    if not watch.alarms:
        return [grid]
    return [rrb.Horizontal(grid, event_log([f"+ {root}/events"]), column_shares=[5, 2], name="Residuals")]
