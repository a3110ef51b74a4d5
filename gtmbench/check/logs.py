"""Logs in a baseline: a folder of recorded flights, each sensor of which keeps its verdict."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtmbench.check.figures import FigureGroup, Value, rounded
from gtmbench.checks import shown, text
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress
from gtmbench.log.fleet import logs_in
from gtmbench.values.channels import unit_of
from gtmbench.verdict.timeline import State

if TYPE_CHECKING:
    from gtmbench.detectors.protocol import Detector, Monitor
    from gtmbench.log.watched_log import WatchedLog

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
    for number, (name, path) in enumerate(logs.items()):
        progress(name, number, len(logs))
        groups += _groups(name, watch_log(path, watcher, **how))
    return groups


def _groups(name: str, watched: WatchedLog) -> list[FigureGroup]:
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
