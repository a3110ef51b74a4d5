"""How the recording of a monitored study opens: the decision on every trial, the residuals, the sensors."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from gtmbench.channels import unit_of
from gtmbench.record import Span
from gtmbench.report.text import trial_label
from gtmbench.report.views import event_log, opened, plot, sensors_tab, whole
from gtmbench.study.monitored import MonitoredBaseline, MonitoredStudy, MonitoredTrial

_SHOWN_LEVELS = 4.0  # the levels' axis ends at this many thresholds: what lies above has alarmed anyway
_BEFORE_S, _AFTER_S, _MISSED_S = 5.0, 15.0, 60.0
_BESIDE = 3  # trials on a page

Placed = tuple[MonitoredTrial, str]  # a trial and its entity


def monitored_blueprint(study: MonitoredStudy, trial_paths: Sequence[str]) -> rrb.Blueprint:
    """Return the blueprint of a monitored study's recording."""
    placed = list(zip(study.trials, trial_paths, strict=True))
    pages: list[list[Placed]] = []
    for one in placed:
        page = pages[-1] if pages else []
        if page and page[0][0].scenario == one[0].scenario and len(page) < _BESIDE:
            page.append(one)
        else:
            pages.append([one])
    flight = study.baseline.flight
    return opened(_decision(pages), _residuals(study.baseline, pages), sensors_tab(flight, trial_paths))


def _decision(pages: Sequence[Sequence[Placed]]) -> rrb.Container:
    return rrb.Tabs(*(_decision_page(page) for page in pages), active_tab=0, name="Decision")


def _decision_page(page: Sequence[Placed]) -> rrb.Container:
    """Return levels above, measured and virtual sensor in the middle, the log of events below; a column a trial."""
    levels, signals = [], []
    for trial, path in page:
        span = _shown_s(trial)
        shared = ["+ /threshold", *(f"+ /healthy/levels/{output}" for output in _untouched(trial))]
        own = [f"+ {path}/{name}" for name in ("levels/**", "onset", "alarm", "named")]
        what = f"{trial.fault.replace('_', ' ')} of {trial_label(trial)}"
        levels.append(plot(f"levels: {what}", [*shared, *own], span, top=_SHOWN_LEVELS))
        signal = f"{trial.channel} ({unit_of(trial.channel)}): measured and virtual"
        signals.append(plot(signal, [f"+ {path}/measured", f"+ {path}/virtual"], span))
    logs = [event_log([f"+ {path}/events"]) for _, path in page]
    plots = rrb.Grid(*levels, *signals, grid_columns=len(page))
    return rrb.Vertical(plots, rrb.Horizontal(*logs), row_shares=[3, 1], name=_page_name(page))


def _residuals(baseline: MonitoredBaseline, pages: Sequence[Sequence[Placed]]) -> rrb.Container:
    """Return every residual of the bank over the whole flight, healthy and in the trials it tells of."""
    outputs, span = tuple(baseline.watched.levels), whole(baseline.flight)
    plots = []
    for output in outputs:
        told = [path for page in pages for trial, path in page if output not in _untouched(trial)]
        for kind, top in (("residuals", None), ("levels", _SHOWN_LEVELS)):
            contents = [f"+ /healthy/{kind}/{output}", *(f"+ {path}/{kind}/{output}" for path in told)]
            threshold = ["+ /threshold"] if top else []
            name = f"level of {output}" if top else f"residual of {output} ({unit_of(output)})"
            plots.append(plot(name, [*contents, *threshold], span, top=top, legend=False))
    if not baseline.watched.findings:
        return rrb.Grid(*plots, grid_columns=2, name="Residuals")
    log = event_log(["+ /events"])
    return rrb.Horizontal(rrb.Grid(*plots, grid_columns=2), log, column_shares=[5, 2], name="Residuals")


def _untouched(trial: MonitoredTrial) -> tuple[str, ...]:
    """Return the residuals that a trial's channel doesn't enter: they are the healthy ones."""
    disturbed = trial.watched.monitor.bank.disturbs(trial.channel)
    return tuple(output for output in trial.watched.levels if output not in disturbed)


def _page_name(page: Sequence[Placed]) -> str:
    return f"{page[0][0].scenario}: {', '.join(path.rsplit('/', 1)[1] for _, path in page)}"


def _shown_s(trial: MonitoredTrial) -> Span:
    told = [time_s for time_s in (trial.alarm_time_s, trial.isolated_s) if time_s is not None]
    last_s = max(told) + _AFTER_S if told else trial.onset_s + _MISSED_S
    return max(trial.onset_s - _BEFORE_S, trial.record.start_s), min(last_s, trial.record.end_s)
