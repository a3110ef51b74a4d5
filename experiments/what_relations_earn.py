"""Logs: what each relation between sensors that no gyro enters earns, by what is said without it.

    python experiments/what_relations_earn.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Every log is judged as it is, with each bias and with each noise of other_sensors_in_logs.py, by all relations and
without each. Prints tables, writes report.md and cases.csv into DIR.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import pandas as pd

import gtmbench as gb
import other_sensors_in_logs as faults
from gtmbench.engine.course import judged
from gtmbench.engine.course.relations.registry import relations_of
from gtmbench.log.judging.monitored import Monitored, course_of
from gtmbench.report.markup import markdown
from recorded.groups import studied_groups
from recorded.whole import watch_whole

ALL = "none"
LEFT_OUT = ("stuck", "blocked tube", "drift to it")  # kinds that need no relation; and one that is as its bias is, late
INTRODUCTION = """Each relation is left out, in every log that has it, and everything is judged once more: without it ->
with it. *differs*: of the faults, for how many the answer is another; *accused*: sensors of the logs as they are;
*clear*: minutes in which a sensor is, all together; *CPU*: of the logs as they are.
"""


def cases(path: Path) -> list[faults.Row]:
    """Return what is said of a log and its faults without each relation; nothing of one that isn't compared."""
    try:
        told = watch_whole(path).said
    except gb.GtmbenchError:
        return []
    if told.course is None or told.course.course.flight.flown_s[1] < 2.0 * faults.LEFT_S:
        return []
    names = (ALL, *(each.name for each in relations_of(told.course.course)))
    return [{"log": path.name, "without": name, **row} for name in names for row in without(name, path, told)]


def without(name: str, path: Path, told: Monitored) -> Iterator[faults.Row]:
    """Give what is said with one relation left out: a row of the log as it is, and one a fault."""
    with patch.object(
        judged, "relations_of", lambda course: [each for each in relations_of(course) if each.name != name]
    ):
        began = time.process_time()
        clean = course_of(told, told.judged)
        cpu_s = time.process_time() - began
        if clean is not None:
            clear_s = sum(span.duration_s for sensor in clean.compared for span in faults.clear_of(clean, sensor))
            accused = {sensor for sensor, _, _ in faults.accused(clean)}
            yield {"sensor": "", "fault": "", "accused": len(accused), "clear_min": clear_s / 60.0, "cpu_s": cpu_s}
            yield from faults.put_into(path, told, accused, LEFT_OUT)


def report(rows: pd.DataFrame) -> list[str]:
    """Return the table of one group of logs, each relation beside all in the logs that have it."""
    if not len(rows):
        return ["No log of it is compared."]
    key = ["log", "sensor", "fault"]
    table = []
    for name in dict.fromkeys(rows["without"]):
        own = rows[rows["without"] == name]
        whole = rows[(rows["without"] == ALL) & rows["log"].isin(own["log"])]
        both = whole.merge(own, on=key, suffixes=("", "_without"))
        put, clean = both[both["fault"] != ""], both[both["fault"] == ""]
        if name != ALL:
            table.append(
                {"relation": name, "logs": own["log"].nunique(), "faults": len(put)}
                | {"differs": int((put["said"] != put["said_without"]).sum())}
                | {word: _beside(put, word) for word in (faults.NAMED, faults.EITHER, faults.WRONG)}
                | {"accused": f"{clean['accused_without'].sum():.0f} -> {clean['accused'].sum():.0f}"}
                | {"clear": f"{clean['clear_min_without'].sum():.0f} -> {clean['clear_min'].sum():.0f} min"}
                | {"CPU": f"{clean['cpu_s_without'].sum():.1f} -> {clean['cpu_s'].sum():.1f} s"}
            )
    return [f"{rows['log'].nunique()} logs.", markdown(pd.DataFrame(table))]


def _beside(put: pd.DataFrame, word: str) -> str:
    return f"{(put['said_without'] == word).sum()} -> {(put['said'] == word).sum()}"


def main() -> int:
    """Judge, sum up, write."""
    studied_groups(
        __doc__,
        ["# What each relation earns", INTRODUCTION],
        Path("experiments/reports/what_relations_earn"),
        cases=cases,
        synthetic=faults.synthetic,
        report=report,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
