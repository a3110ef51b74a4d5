"""The figures that ``gtmbench check`` knows: how bad each may become, and each of a study or of recorded flights."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from gtmbench.checks import number, shown, text
from gtmbench.detectors.protocol import Score
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress
from gtmbench.log.fleet import logs_in
from gtmbench.report.words.judgement import kind_text
from gtmbench.study.trial import Baseline, Study, Trial
from gtmbench.values.channels import unit_of
from gtmbench.values.record import FloatArray
from gtmbench.verdict.timeline import State

if TYPE_CHECKING:
    from gtmbench.detectors.protocol import Detector, Monitor
    from gtmbench.log.watched_log import WatchedLog

WINDOW_S = 10.0  # of a healthy flight: every window's greatest value is a figure
_LARGEST = 1e9  # of what a file may state


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """The larger of a share of what was recorded and a number in the figure's unit.

    >>> tolerance = Tolerance(share=0.02, absolute=0.1)
    >>> tolerance.around(100.0), tolerance.around(1.0)
    (2.0, 0.1)
    """

    share: float = 0.0
    absolute: float = 0.0

    def around(self, recorded: float) -> float:
        """Return how far from the recorded value is still well."""
        return max(self.share * abs(recorded), self.absolute)


def parse_tolerance(key: str, given: Any) -> Tolerance:
    """Return a tolerance as a baseline states it: ``0.1``, ``"5 %"``, or both, ``["5 %", 0.1]``."""
    if not isinstance(given, list):
        return _share_or_number(key, given)
    if len(given) != 2 or isinstance(given[0], str) == isinstance(given[1], str):
        raise InputError(f'{key} is {shown(given)}; a list holds a share and a number, such as ["5 %", 0.1]')
    first, second = (_share_or_number(key, part) for part in given)
    return Tolerance(share=max(first.share, second.share), absolute=max(first.absolute, second.absolute))


def _share_or_number(key: str, given: Any) -> Tolerance:
    if not isinstance(given, str):
        return Tolerance(absolute=number(key, given, 0.0, _LARGEST))
    digits, percent, rest = given.partition("%")
    try:
        share = float(digits) if percent and not rest.strip() else None
    except ValueError:
        share = None
    if share is None:
        raise InputError(f'{key} is {shown(given)}; give a share such as "5 %", or a number in the figure\'s unit')
    return Tolerance(share=number(key, share, 0.0, _LARGEST) / 100.0)


@dataclass(frozen=True)
class Rule:
    """One figure."""

    text: str  # what a report calls it
    # ``flag`` (true is better), ``count``, ``real``, or ``list`` of reals
    form: Literal["flag", "count", "real", "list"]
    # which way is worse; ``either``: it isn't the monitor's, and must be as it was for a comparison to mean anything
    worse: Literal["higher", "lower", "either"]
    tolerance: Any = 0  # As a baseline states it, where it states none. A flag has none.
    meaning: str = ""  # the comment beside the tolerance
    unit: str = ""  # its own; ``*`` for that of its residual
    needs: str = ""  # the flag without which there is no such figure: no delay of what is missed


_DELAY = ["2 %", 0.1]  # or 0.1 s, the larger
_EVERY_WINDOW = f"greatest |e(k)| or score in every {WINDOW_S:g} s of the healthy record"
_RATIO = "greatest score after the onset, over its threshold"

# of each figure: which way is worse, and by how much it may be
RULES = {
    "false_alarms": Rule("false alarms", "count", "higher", meaning="on the healthy records: how many more"),
    "hours": Rule("hours watched", "real", "lower", "1 %", "of healthy flight in which an alarm was possible", "h"),
    "samples": Rule("samples", "count", "lower", meaning="of a healthy residual that exist: how many fewer"),
    "peak": Rule("peak", "real", "higher", "5 %", "greatest |e(k)| of the healthy record", "*"),
    "rms": Rule("RMS", "real", "higher", "2 %", "of e(k) on the healthy record", "*"),
    "windows": Rule("max", "list", "higher", "5 %", _EVERY_WINDOW, "*"),
    "threshold": Rule("threshold", "real", "higher", "2 %", "of a score: a higher one sees less", "*"),
    "thresholds": Rule("threshold", "list", "higher", "2 %", "of every test: a higher one sees less"),
    "margin": Rule("margin", "real", "lower", "2 %", "threshold over the healthy record's greatest score"),
    "severity": Rule("severity", "list", "either", "1 %", "of a fault: another one is no comparison"),
    "detected": Rule("detected", "flag", "lower"),
    "delay_s": Rule(
        "delay", "real", "higher", _DELAY, "of detection; the larger of a share and seconds", "s", needs="detected"
    ),
    "peak_ratio": Rule("peak ratio", "real", "lower", "5 %", _RATIO),
    "isolated": Rule("isolated", "flag", "lower"),
    "isolation_delay_s": Rule(
        "isolation delay", "real", "higher", _DELAY, "until the sensor was named", "s", needs="isolated"
    ),
    "kind_right": Rule("kind right", "flag", "lower"),
    "failed": Rule("failed", "flag", "either"),
    "suspected": Rule("suspected", "flag", "either"),
    "onset_s": Rule("onset", "real", "either", 1.0, "of a log's failure: how far it may move", "s", needs="failed"),
    "judged_s": Rule("judged", "real", "lower", "2 %", "of a log's sensor: how much shorter", "s"),
    "error": Rule("smallest error", "real", "higher", "5 %", "that would show in a log's sensor", "*"),
}

OF_LOGS = ("failed", "suspected", "onset_s", "judged_s", "error")  # figures of a log's sensor

KINDS = {  # the tables of a baseline: what a report calls them, and the figures that stand in them
    "healthy": ("healthy {}", ("false_alarms", "hours")),
    "residual": ("healthy residual of {}", ("samples", "peak", "rms", "windows")),
    "score": ("healthy score {}", ("threshold", "margin", "thresholds", "windows")),
    "trials": ("{}", ("severity", "detected", "delay_s", "peak_ratio", "isolated", "isolation_delay_s", "kind_right")),
    "sensors": ("{}", OF_LOGS),
}


Value = bool | int | float | tuple[float, ...]
_DIGITS = 5  # that are kept of a figure
_V = TypeVar("_V", float, tuple[float, ...])


@dataclass(frozen=True, kw_only=True)
class FigureGroup:
    """Figures that belong together: of a residual, of a trial."""

    # kind, name: one of `KINDS` and what it's of: the tables that it stands in, ``[residual.r]``
    kind: str
    name: str
    values: Mapping[str, Value]  # by the names in `RULES`; reals to five significant digits, as they are written
    # what the numbers of a tuple are: ``window 230..240 s``
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    unit: str = ""  # of its residual
    remark: str = ""  # what the study itself says of it, for people
    unexpected: tuple[str, ...] = ()  # where a trial goes otherwise than its scenario expects

    @property
    def title(self) -> str:
        """What a report calls it: ``healthy residual of r``."""
        return KINDS[self.kind][0].format(self.name)


def figures_of(study: Study) -> tuple[FigureGroup, ...]:
    """Return the figures of a study. What of a healthy record lies before `alarm.watch_from_s` isn't watched, nor here.

    Raises InputError where several detectors watched.
    """
    if len(study.baselines) != 1:
        raise InputError(f"{len(study.baselines)} detectors watched; a baseline holds the figures of one")
    base = study.baseline
    flight = {"false_alarms": base.false_alarms, "hours": rounded(base.healthy_hours)}
    names = trial_names((trial.scenario, trial.fault, trial.channel) for trial in study.trials)
    return (
        FigureGroup(kind="healthy", name="flight", values=flight),
        *(_residual(base, name, values) for name, values in base.watch.residuals.items()),
        *(_score(base, score) for score in base.watch.scores.values()),
        *(_trial(name, trial) for name, trial in zip(names, study.trials, strict=True)),
    )


def trial_names(trials: Iterable[tuple[str, str, str]]) -> list[str]:
    """Name trials by scenario, kind of fault and channel; numbered where several have all of them in common."""
    often = Counter[str]()
    names = []
    for scenario, kind, channel in trials:
        name = f"{kind} of {channel}" if scenario == kind else f"{scenario}: {kind} of {channel}"
        often[name] += 1
        names.append(name if often[name] == 1 else f"{name} ({often[name]})")
    return names


def rounded(value: _V) -> _V:
    """Return a number, or each of several, as it is written into a baseline."""
    if isinstance(value, tuple):
        return tuple(map(rounded, value))
    return float(f"{value:.{_DIGITS}g}")


def _score(base: Baseline, score: Score) -> FigureGroup:
    """Return the figures of a score; where each of several tests has a threshold of its own, all of them."""
    time_s, monitor = base.watch.record.time_s, base.monitor
    windows, labels = _windows(score.values, time_s, base.setup.alarm.watch_from_s)
    values: dict[str, Value] = {"windows": windows}
    named = {"windows": labels}
    if score.tests:
        values["thresholds"] = rounded(tuple(score.tests.values()))
        named["thresholds"] = tuple(f"test {test}" for test in score.tests)
    else:
        values["threshold"] = rounded(score.threshold)
    start_s, end_s = base.setup.alarm.threshold_s if isinstance(monitor, NormMonitor) else (-np.inf, np.inf)
    there = score.values[(time_s >= start_s - 1e-9) & (time_s <= end_s + 1e-9)]
    with np.errstate(divide="ignore"):
        margin = np.divide(score.threshold, float(np.fmax.reduce(there)) if len(there) else np.nan)
    values["margin"] = rounded(float(margin))
    ordered = {figure: values[figure] for figure in KINDS["score"][1] if figure in values}
    return FigureGroup(kind="score", name=score.name, values=ordered, labels=named, unit=score.unit)


@np.errstate(over="ignore")
def _residual(base: Baseline, name: str, values: FloatArray) -> FigureGroup:
    time_s, start_s = base.watch.record.time_s, base.setup.alarm.watch_from_s
    windows, labels = _windows(np.abs(values), time_s, start_s)
    there = values[(time_s >= start_s - 1e-9) & ~np.isnan(values)]
    figures: dict[str, Value] = {
        "samples": len(there),
        "peak": rounded(float(np.abs(there).max(initial=0.0))),
        "rms": rounded(float(np.sqrt(np.sum(np.square(there)) / max(len(there), 1)))),
        "windows": windows,
    }
    return FigureGroup(kind="residual", name=name, values=figures, labels={"windows": labels}, unit=unit_of(name))


def _windows(values: FloatArray, time_s: FloatArray, start_s: float) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Return the greatest value of every window from a time on, by the samples' times; NaN where there is none."""
    begins = np.arange(start_s, float(time_s[-1]), WINDOW_S)
    rows = np.searchsorted(time_s, begins - 1e-9)
    greatest = np.fmax.reduceat(values, rows).tolist() if len(rows) else []
    labels = tuple(f"window {begin:g}..{min(begin + WINDOW_S, float(time_s[-1])):g} s" for begin in begins.tolist())
    return rounded(tuple(greatest)), labels


def _trial(name: str, trial: Trial) -> FigureGroup:
    values: dict[str, Value] = {}
    if trial.severity:
        values["severity"] = rounded(tuple(trial.severity.values()))
    values["detected"] = trial.detected
    if trial.detection_delay_s is not None:
        values["delay_s"] = rounded(trial.detection_delay_s)
    values["peak_ratio"] = rounded(trial.peak_ratio)
    if trial.isolated is not None:
        values["isolated"] = trial.isolated
        if trial.isolation_delay_s is not None:
            values["isolation_delay_s"] = rounded(trial.isolation_delay_s)
        values["kind_right"] = bool(trial.kind_right)
    kind = kind_text(trial.kind, {}, {}, "", trial.partner) if trial.kind else ""
    said = ", ".join(part for part in (trial.verdict, kind) if part)
    remark = said if trial.detected else f"missed: {trial.reason}"
    return FigureGroup(
        kind="trials",
        name=name,
        values=values,
        labels={"severity": tuple(trial.severity)},
        remark=remark,
        unexpected=trial.unexpected,
    )


_SEPARATOR = ": "


def texts_of(key: str, given: Any) -> tuple[str, ...]:
    """Return a list of texts, as a baseline states it."""
    if not isinstance(given, list) or not all(isinstance(text, str) for text in given):
        raise InputError(f"{key} is {shown(given)}; it must be a list of texts")
    return tuple(given)


def log_paths(baseline: Path, sources: Sequence[str]) -> dict[str, Path]:
    """Return the logs that folders, patterns and files mean, seen from a baseline's folder, by their names there."""
    folder = baseline.absolute().parent
    found = logs_in([folder / source for source in sources])
    return {Path(os.path.relpath(path, folder)).as_posix(): path for path in found}


def new_logs(recorded: Mapping[str, object], names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the logs without figures, and those of figures that aren't there any more."""
    was = {name.rpartition(_SEPARATOR)[0] for name in recorded}
    return [name for name in names if name not in was], [name for name in was if name not in names]


def history_path(baseline: Path, given: Any) -> Path | None:
    """Return the history that a baseline's flights are judged beside, seen from its folder; None without one."""
    if given is None:
        return None
    path = baseline.absolute().parent / text("history", given)
    if not path.exists():
        raise InputError(f"history is {shown(given)}, and there is no such file; gtmbench monitor --history writes one")
    return path


def log_groups(
    logs: Mapping[str, Path], watcher: Detector | Monitor | str, progress: Progress, **how: Any
) -> list[FigureGroup]:
    """Watch logs as `gtmbench monitor` does, how else is as `watch_log` takes it; return the figures of each sensor."""
    from gtmbench.log.watch import watch_log

    groups = []
    for done, (name, path) in enumerate(logs.items()):
        progress(name, done, len(logs))
        groups += _of_sensors(name, watch_log(path, watcher, **how))
    return groups


def _of_sensors(name: str, watched: WatchedLog) -> list[FigureGroup]:
    from gtmbench.report.words.verdict import verdict_text

    verdict = watched.verdict
    timeline, said, groups = verdict.timeline, verdict_text(watched), []
    for sensor in timeline.sensors:
        failed = timeline.of(sensor, State.FAILED)
        values: dict[str, Value] = {
            "failed": bool(failed),
            "suspected": bool(timeline.of(sensor, State.SUSPECTED)),
            "judged_s": rounded(timeline.motion_total_s * timeline.judged_share(sensor)),
        }
        if failed:
            values["onset_s"] = rounded(failed[0].start_s)
        sizes = verdict.sizes_of(sensor)
        values["error"] = math.inf if sizes is None else rounded(sizes.error)  # infinite: it is clear nowhere
        title = f"{name}{_SEPARATOR}{sensor}"
        groups.append(FigureGroup(kind="sensors", name=title, values=values, unit=unit_of(sensor), remark=said))
    return groups
