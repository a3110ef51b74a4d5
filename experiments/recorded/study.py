"""What is done with a log: its flight is watched as it is, broken, and misread."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from gtmbench.detectors.bank_detector import BankWatch
from gtmbench.errors import InputError
from gtmbench.study.log.self_check.explained import ENOUGH
from gtmbench.study.log.watched import Outcome, WatchedLog
from recorded.faults import Tried, tried
from recorded.flights import Log, Parts, watched
from recorded.mutations import MUTATIONS, Mutation, is_cause

READINGS = {name: mutation for name, mutation in MUTATIONS.items() if name != "none"}
REFUSED = "refused"
LONGEST = 70  # letters of a reason

Row = dict[str, Any]
UNKNOWN: Row = {  # of a flight
    "exit": 2,
    "verdict": "",
    "explained": "",
    "is_explained": False,
    "is_cause_claimed": False,
    "uncertified": 0,
    "watched_s": 0.0,
    "outside_s": 0.0,
    "cant_tell_s": 0.0,
}
OF_FLIGHT = (*UNKNOWN, "whole", "rate_hz", "duration_s")


@dataclass(frozen=True, kw_only=True)
class Size:
    """How much is tried of each log."""

    faults: int = 4  # of every gyro and kind
    readings: Sequence[str] = tuple(READINGS)
    seeds: int = 8  # of every mechanism
    whole: bool = True  # whether all of a log is watched, too


QUICK = Size(faults=1, readings=("-q", "p, r swapped", "attitude 0.3 s late", "r dead"), seeds=1)


class Task(NamedTuple):
    """A log, the group that it is in, and how much is tried of it."""

    log: Log
    group: str
    size: Size


class Rows(NamedTuple):
    """What came of a log: a row of its flight, and one a fault and a reading; none where it holds no flight."""

    flights: list[Row]
    faults: list[Row]
    readings: list[Row]


def studied(task: Task) -> Rows:
    """Watch a log's flight: as it is, broken, misread."""
    try:
        parts = task.log.parts()
    except InputError:
        parts = ()
    if not parts:
        return Rows([], [], [])
    flight, faults = as_it_is(task, parts)
    flight |= {
        "whole": whole(task.log, parts) if task.size.whole else "-",
        "rate_hz": 1.0 / parts[0].sample_period_s,
        "duration_s": sum(part.end_s - part.start_s for part in parts),
    }
    whose = {"group": task.group, "log": task.log.name}
    readings = [{**whose, **misread(task.log, parts, name)} for name in task.size.readings if not task.log.has_cause]
    return Rows([{**whose, **flight}], [{**whose, **asdict(each)} for each in faults], readings)


def as_it_is(task: Task, parts: Parts) -> tuple[Row, list[Tried]]:
    """Return what is said of a flight as it is, and of the faults that are put on it."""
    try:
        said = watched(parts, task.log.attitude)
    except InputError as error:
        return {**UNKNOWN, "verdict": shortened(str(error))}, []
    shares = [max(each.share, 0.0) for each in said.check.explained if each.where == "identified"]
    flight = {
        "exit": int(said.outcome),
        "verdict": verdict(said),
        "explained": "/".join(f"{100.0 * share:.0f}" for share in shares),
        "is_explained": min(shares, default=0.0) >= ENOUGH,
        "is_cause_claimed": bool(said.check.causes) and not task.log.has_cause,
        "uncertified": sum(row.size is None for row in said.certificate.rows),
        **times_s(said),
    }
    return flight, list(tried(said, task.size.faults, seed=zlib.crc32(task.log.name.encode())))


def whole(log: Log, parts: Parts) -> str:
    """Say what becomes of all of a log: exit code, verdict; a dash where no file holds it."""
    try:
        said = log.whole(parts)
    except InputError as error:
        return f"2: {shortened(str(error))}"
    return "-" if said is None else f"{int(said.outcome)}: {verdict(said)}"


def verdict(said: WatchedLog) -> str:
    """Say in a few words what became of a flight."""
    left = [alarm for alarm in said.alarms if not alarm.has_passed]
    accused = [alarm for alarm in left if not alarm.doubt]
    if accused:
        return shortened("; ".join(dict.fromkeys(f"{alarm.verdict} ({alarm.time_s:.1f} s)" for alarm in accused)))
    if said.outcome is Outcome.HEALTHY:
        return "no fault found"
    if said.check.causes:
        return f"{REFUSED}: " + shortened(" or ".join(cause.text for cause in said.check.causes))
    if said.check.stops:
        return f"{REFUSED}: " + shortened(str(said.check.stops[0]))
    told = [f"{alarm.doubt} ({alarm.time_s:.1f} s)" for alarm in left]
    hardly = [f"{name} is hardly watched" for name in said.hardly_watched]
    return "can't tell: " + shortened("; ".join(dict.fromkeys(told or said.check.doubts or hardly or said.reasons)))


def shortened(text: str) -> str:
    """Return the beginning of a text."""
    return text if len(text) <= LONGEST else text[: LONGEST - 4].rpartition(" ")[0] + " ..."


def times_s(said: WatchedLog) -> Row:
    """Return how long was watched, how much of that nothing can be told of, how much lies outside of the regime.

    Nothing can be told in an excursion, and of an alarm that may be no fault's until it has ended; where it doesn't
    end, for the rest of its stretch, of whatever sensor.
    """
    watched_s = outside_s = cant_tell_s = 0.0
    for watch in said.watches:
        assert isinstance(watch, BankWatch)
        time_s, period_s = watch.record.time_s, watch.record.sample_period_s
        excursions = [(each.start_s, each.end_s) for each in watch.outside]
        doubtful = [
            (min(alarm.onset_s, alarm.time_s), math.inf if alarm.ended_s is None else alarm.ended_s)
            for alarm in watch.faults
            if alarm.doubt and not alarm.has_passed
        ]
        watched_s += len(time_s) * period_s
        outside_s += np.count_nonzero(within(time_s, excursions)) * period_s
        cant_tell_s += np.count_nonzero(within(time_s, excursions + doubtful)) * period_s
    return {"watched_s": watched_s, "outside_s": outside_s, "cant_tell_s": cant_tell_s}


def within(time_s: np.ndarray, spans: Sequence[tuple[float, float]]) -> np.ndarray:
    """Tell which times lie in any of some spans."""
    inside = np.zeros(len(time_s), dtype=bool)
    for start_s, end_s in spans:
        inside |= (time_s >= start_s) & (time_s <= end_s)
    return inside


def misread(log: Log, parts: Parts, name: str) -> Row:
    """Return what is said of a flight that is misread."""
    mutation = READINGS[name]
    try:
        said = watched(parts, log.attitude, mutation)
    except InputError:
        return {"reading": name, "exit": 2, "is_right": False, "is_wrong": False}
    right = is_right(mutation, said)
    return {
        "reading": name,
        "exit": int(said.outcome),
        "is_right": right,
        "is_wrong": bool(said.check.causes) and not right,
    }


def is_right(mutation: Mutation, said: WatchedLog) -> bool:
    """Tell whether the cause was named."""
    if mutation.dead:
        return any(f"{mutation.dead} reads" in stop.text for stop in said.check.stops)
    return any(is_cause(mutation, cause.changes) for cause in said.check.causes)
