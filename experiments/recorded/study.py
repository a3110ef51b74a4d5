"""What is done with a log: it is watched as it is, broken, and its flight misread."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from gtmbench.engine.hindsight.cleared_sensors import JUDGED
from gtmbench.errors import InputError
from gtmbench.log.learning.learnt_monitor import IN_TIME
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.words.verdict import verdict_text
from gtmbench.values.channels import names_of
from gtmbench.verdict.verdict import Outcome
from recorded.flights import LogFile, Parts, watched
from recorded.mutations import MUTATIONS, Mutation, is_cause
from recorded.truths import TRUTHS
from recorded.whole import FAULTS, coverage, tried, watch_whole

READINGS = {name: mutation for name, mutation in MUTATIONS.items() if name != "none"}
LONGEST = 90  # letters of a verdict
UNTIL = "until"  # in the verdict of a log that is judged up to a crash

Row = dict[str, Any]
OF_LOG = ("rate_hz", "logged_s", "exit", "verdict", "left_s", "armed_s", "watched_s", "cpu_s", "truth", "is_right")


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much is tried of each log."""

    faults: Sequence[str] = tuple(FAULTS)
    readings: Sequence[str] = tuple(READINGS)


QUICK = Size(faults=("jam", "bias 5 deg/s"), readings=("-q", "p, r swapped", "attitude 0.3 s late", "r dead"))


class Task(NamedTuple):
    """A log, the group that it is in, how much is tried of it, and where its rows are kept, if anywhere."""

    log: LogFile
    group: str
    size: Size
    kept: Path | None = None


class Rows(NamedTuple):
    """What came of a log: a row of it, and one a fault and a reading; none where it can't be opened."""

    logs: list[Row]
    faults: list[Row]
    readings: list[Row]


def studied(task: Task) -> Rows:
    """Watch a log: as it is, broken, misread; or return what was kept of that."""
    kept = None if task.kept is None else task.kept / f"{task.group} {Path(task.log.name).name}.json"
    if kept is not None and kept.exists():
        return Rows(*json.loads(kept.read_text()))
    rows = _studied(task)
    if kept is not None:
        kept.write_text(json.dumps(rows))
    return rows


def _studied(task: Task) -> Rows:
    whose = {"group": task.group, "log": task.log.name}
    try:
        whole = watch_whole(task.log.path)
    except InputError:
        return Rows([], [], [])
    said = whole.watched
    log = {**whose, **of_log(task.log.name, said), "cpu_s": whole.cpu_s}
    faults = tried(whole, task.size.faults) if said.outcome is Outcome.HEALTHY else ()
    broken = [{**whose, "exit_healthy": log["exit"], **asdict(each)} for each in faults]
    readings = [] if said.check.stops else [{**whose, **row} for row in misread(task.log, task.size.readings)]
    return Rows([log], broken, readings)


def of_log(name: str, said: WatchedLog) -> Row:
    """Return what is said of a log as it is, and whether that is right where it is known to hold a failure."""
    left_s, armed_s, watched_s = coverage(said)
    truth = TRUTHS.get(name)
    accused = {alarm.sensor for alarm in said.alarms if alarm.accuses}
    accused |= {names_of(sensor)[-1] for sensor, _ in said.verdict.failed if sensor not in JUDGED}
    return {
        "rate_hz": 1.0 / said.log.sample_period_s,
        "logged_s": sum(len(record) * said.log.sample_period_s for record in said.log.segments),
        "exit": int(said.outcome),
        "verdict": shortened(verdict_text(said)),
        "left_s": left_s,
        "armed_s": armed_s,
        "watched_s": watched_s,
        "truth": "" if truth is None else truth.what,
        "is_right": truth is not None and bool(accused) and accused <= {*truth.sensors},
    }


def shortened(text: str) -> str:
    """Return the beginning of a text."""
    return text if len(text) <= LONGEST else text[: LONGEST - 4].rpartition(" ")[0] + " ..."


def misread(log: LogFile, names: Sequence[str]) -> list[Row]:
    """Return what is said of a log's flight in some wrong readings, by bank C, identified on the first half.

    Nothing of a flight whose gyros and attitude tell of no one motion there as they are: no cause is right of it.
    """
    parts: Parts = ()
    if names:
        with contextlib.suppress(InputError):
            parts = log.parts()
    if not parts or not _fits(parts, log.attitude):
        return []
    rows = []
    for name in names:
        mutation = READINGS[name]
        try:
            said = watched(parts, log.attitude, mutation)
        except InputError:
            rows.append({"reading": name, "exit": 2, "is_right": False, "is_wrong": False})
            continue
        right = is_right(mutation, said)
        rows.append(
            {
                "reading": name,
                "exit": int(said.outcome),
                "is_right": right,
                "is_wrong": bool(said.check.causes) and not right,
            }
        )
    return rows


def _fits(parts: Parts, attitude: str) -> bool:
    """Tell whether a flight passes the self-check as it is."""
    try:
        return not watched(parts, attitude).check.stops
    except InputError:
        return False


def is_right(mutation: Mutation, said: WatchedLog) -> bool:
    """Tell whether the cause was named, or undone."""
    if mutation.dead:
        return any(f"{mutation.dead} reads" in stop.text for stop in said.check.stops)
    undone = any(reason.endswith(IN_TIME) for reason in said.reasons)
    return undone or any(is_cause(mutation, cause.changes) for cause in said.check.causes)
