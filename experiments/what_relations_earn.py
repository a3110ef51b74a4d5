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
INTRODUCTION = """A relation is left out, and everything is judged once more. *differs*: of the faults, for how many
another thing is said than with all relations; *named*, *either-or*, *wrong*: what is said without it; *accused*:
sensors of logs as they are; *clear*: minutes in which a sensor is, all together; *CPU*: of the logs as they are.
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
    """Return the table of one group of logs."""
    if not len(rows):
        return ["No log of it is compared."]
    put = rows[rows["fault"] != ""]
    key = ["log", "sensor", "fault"]
    whole = put[put["without"] == ALL].set_index(key)["said"]
    table = []
    for name in dict.fromkeys(rows["without"]):
        said = put[put["without"] == name].set_index(key)["said"]
        clean = rows[(rows["fault"] == "") & (rows["without"] == name)]
        table.append(
            {"without": name, "faults": len(said), "differs": int((said != whole.reindex(said.index)).sum())}
            | {word: int((said == word).sum()) for word in (faults.NAMED, faults.EITHER, faults.WRONG)}
            | {"accused": int(clean["accused"].sum()), "clear": f"{clean['clear_min'].sum():.0f} min"}
            | {"CPU": f"{clean['cpu_s'].sum():.1f} s"}
        )
    return [f"{rows['log'].nunique()} logs.", markdown(pd.DataFrame(table))]


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
