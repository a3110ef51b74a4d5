"""What each relation of the engine earns: the same logs and faults, judged without it.

    python experiments/relations_earn.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Every log below the folders, or flight of the GTM by its seed, is judged as it is and with one fault at a time: the
gyros' as `engine_on_logs.py` draws them (six a log), every other sensor's as `other_sensors_in_logs.py` does. Each is
then judged again with one relation taken away. Prints a table and writes report.md and cases.csv into DIR. A relation
earns its lines that changes the answer on 2 % of the faults of its sensors and accuses nobody of a healthy log.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd

import engine_on_logs as gyros
import gtmbench as gb
import other_sensors_in_logs as others
from gtmbench.engine.course.relations import registry as of_course
from gtmbench.engine.judged import judged
from gtmbench.engine.relations import registry as of_flight
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.said import course_of
from recorded.groups import studied_groups
from recorded.whole import Whole, watch_whole

FAULTS, SEED = 6, 66
EARNS = 0.02
NONE = "none"
Row = dict[str, Any]
INTRODUCTION = """For who asks whether a comparison is worth its lines. *other*: the answer to so many faults is another
without the relation; *found* and *lost*: of these, the broken sensor is accused only with it, or only without; *wrong*:
so many healthy sensors are accused only with it, or only without. *clear*: seconds that are called clear, with it over
without, on healthy logs. *CPU*: what it adds a minute of log, in seconds."""


@contextmanager
def without(registry: ModuleType, place: int | None) -> Iterator[None]:
    """Take one of a registry's relations away."""
    whole = registry.RELATIONS
    registry.RELATIONS = tuple(each for number, each in enumerate(whole) if number != place)
    try:
        yield
    finally:
        registry.RELATIONS = whole


def relations(registry: ModuleType) -> Iterator[tuple[str, int | None]]:
    """Give the name and place of each relation, and of none."""
    yield NONE, None
    for place, each in enumerate(registry.RELATIONS):
        yield (each.__module__ if registry is of_flight else each.__name__).rpartition(".")[2], place


def cases(path: Path) -> list[Row]:
    """Return the answers to a log, as it is and with each fault, with every relation and without one."""
    try:
        whole = watch_whole(path)
        return [{"log": path.name, **row} for row in (*of_gyros(path), *of_others(path, whole))]
    except gb.GtmbenchError:
        return []


def of_gyros(path: Path) -> Iterator[Row]:
    """Give what the engine says of gyros' faults, without each relation of gyros and attitude."""
    log = gyros.Log(path, gyros.REAL, FAULTS, SEED)
    if gyros.left_out(log):
        return
    own = gyros.opened(path)
    records = gb.open_log(own.read, needs=gyros.CHANNELS).segments
    for name, place in relations(of_flight):
        with without(of_flight, place):
            began = time.process_time()
            before = judged(own.flight(records))
            cost_s = time.process_time() - began
            healthy = gyros.of_healthy(before)
            yield {
                "without": name,
                "of": "gyros",
                "fault": "",
                "who": healthy["named"],
                "right": not healthy["named"],
                "clear_s": healthy["motion_s"] * sum(healthy[f"{gyro} clear"] for gyro in gyros.GYROS),
                "cpu_s": cost_s,
                "minutes": healthy["minutes"],
            }
            for put in gyros.drawn(log, records):
                try:
                    changed = [gyros.broken(each, put) for each in records]
                except gb.InputError:
                    continue
                said = gyros.of_fault(put, judged(own.flight(changed)), before)
                yield {
                    "without": name,
                    "of": "gyros",
                    "fault": f"{put.gyro} {put.kind} {put.attitude} {put.onset_s:.0f}",
                    "who": said["said"],
                    "right": said["said"] in (gyros.RIGHT, gyros.EITHER_OR),
                    "wrong": said["said"] == gyros.WRONG,
                }


def of_others(path: Path, whole: Whole) -> Iterator[Row]:
    """Give what the engine says of other sensors' faults, without each relation of a course."""
    told = whole.said
    if told.course is None:
        return
    start_s, end_s = told.course.course.flight.flown_s
    for name, place in relations(of_course):
        if place is not None and not told.course.course.has(*of_course.RELATIONS[place].NEEDS):
            continue
        with without(of_course, place):
            began = time.process_time()
            course = course_of(told, told.judged)
            cost_s = time.process_time() - began
            assert course is not None
            before = {sensor for sensor, _, _ in others.accused(course)}
            clear = [span.duration_s for sensor in course.compared for span in others.clear_of(course, sensor)]
            yield {
                "without": name,
                "of": "others",
                "fault": "",
                "who": " ".join(sorted(before)),
                "right": not before,
                "clear_s": sum(clear),
                "cpu_s": cost_s,
                "minutes": (end_s - start_s) / 60.0,
            }
            if end_s - start_s < 2.0 * others.LEFT_S:
                continue
            # what is accused with every relation doesn't count without one, and a sensor that none compares is put, too
            for row in others.put_into(path, told, {sensor for sensor, _, _ in others.accused(told.course)}):
                yield {
                    "without": name,
                    "of": "others",
                    "fault": f"{row['sensor']} {row['fault']}",
                    "who": row["said"],
                    "right": row["said"] in (others.NAMED, others.EITHER),
                    "wrong": row["said"] == others.WRONG,
                }


def report(rows: pd.DataFrame) -> list[str]:
    """Return the table of one group of logs."""
    if not len(rows):
        return ["No log could be judged."]
    key = ["log", "of", "fault"]
    whole = rows[rows["without"] == NONE].drop_duplicates(key).set_index(key)
    found = []
    for (of, name), part in rows[rows["without"] != NONE].groupby(["of", "without"], sort=False):
        both = part.drop_duplicates(key).set_index(key).join(whole, lsuffix="_less", how="inner")
        put = both[both.index.get_level_values("fault") != ""]
        healthy = both[both.index.get_level_values("fault") == ""]
        other = put[put["who"] != put["who_less"]]
        accused = int((~healthy["right"].astype(bool) & healthy["right_less"].astype(bool)).sum())
        earns = len(other) >= EARNS * max(len(put), 1) and not accused
        found.append(
            {
                "relation": name,
                "of": of,
                "logs": len(healthy),
                "faults": len(put),
                "other": len(other),
                "found": int((other["right"].astype(bool) & ~other["right_less"].astype(bool)).sum()),
                "lost": int((~other["right"].astype(bool) & other["right_less"].astype(bool)).sum()),
                "wrong with": int((put["wrong"] == True).sum()),  # noqa: E712 - NaN where nothing is put
                "wrong without": int((put["wrong_less"] == True).sum()),  # noqa: E712
                "healthy accused by it": accused,
                "clear": f"{healthy['clear_s'].sum():.0f} / {healthy['clear_s_less'].sum():.0f} s",
                "CPU": f"{(healthy['cpu_s'] - healthy['cpu_s_less']).sum() / healthy['minutes'].sum():.3f}",
                "earns": "yes" if earns else "no",
            }
        )
    return [markdown(pd.DataFrame(found))]


def main() -> int:
    """Judge, sum up, write; it ends with 1 where a relation earns nothing."""
    everything = studied_groups(
        __doc__,
        ["# What each relation earns", INTRODUCTION],
        Path("experiments/reports/relations_earn"),
        cases=cases,
        synthetic=others.synthetic,
        report=report,
    )
    return int(not len(everything))


if __name__ == "__main__":
    sys.exit(main())
