"""Logs with several IMUs: of two that part, whether the liar is named, and never the other.

    python experiments/several_imus.py [FOLDER ...] [--quick] [--out DIR] [--jobs N]

Of every log below the folders that has two IMUs or more, and of synthetic flights whose estimator is driven by the
broken IMU or by another: one IMU's gyro is broken after what is healthy (a log's first 40 %), at times drawn anew, and
`gtmbench.study.log.imu_comparison` compares. Prints tables; writes report.md and faults.csv into DIR. Ends with
code 1 where any IMU is named wrong (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.attitude_filter import filtered_attitude
from gtmbench.detectors.monitor.excursions import Excursion
from gtmbench.errors import InputError
from gtmbench.intake.imus import Imu
from gtmbench.intake.read import read_log
from gtmbench.jobs.processes import spread
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.imu_comparison import channels_of, compared, opened_with
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Span
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped

RIGHT, WRONG, UNDECIDED, MISSED, FALSE = "right", "named wrong", "can't tell", "missed", "false alarm"
FAULTS = {
    "bias 1 deg/s": lambda **at: gb.Bias(size=1.0, **at),
    "bias 3 deg/s": lambda **at: gb.Bias(size=3.0, **at),
    "bias 10 deg/s": lambda **at: gb.Bias(size=10.0, **at),
    "drift 0.2 deg/s per s": lambda **at: gb.Drift(slope=0.2, **at),
    "scale factor 1.5": lambda **at: gb.ScaleFactor(factor=1.5, **at),
    "noise 5 deg/s": lambda **at: gb.Noise(deviation=5.0, **at),
    "jam": lambda **at: gb.Jam(**at),
}
TIMES = 3  # of every fault
SEEDS, LASTS_S, HEALTHY_S = range(10, 14), 150.0, 60.0  # of synthetic flights; others taught
ONSETS_S = (70.0, 100.0)
TIME_CONSTANTS_S = (3.0, 8.0, 20.0)
SAID_QUICK = "**Quick: one log's fault of a kind, one synthetic flight. It bounds nothing.**\n\n"
INTRODUCTION = """One gyro of one IMU is broken; *right*: that IMU and that gyro are named, and nothing else is. *can't
tell*: they are told to part, and none is named. *false alarm*: what the log told without the fault, too.

In the logs the attitude is as it was logged, so it doesn't follow the fault; in synthetic flights it is a complementary
filter's (time constants of 3, 8 and 20 s) that is driven by the broken IMU or by a healthy one. The constants of the
comparison were set on the logs of `dev` (`sample.bin`, `log_0036`, `log171.bin` of the repositories that
`reports/real_logs/report.md` names) and on synthetic flights of other seeds; `held` are other logs (erlerobot/logs).
"""
Row = dict[str, Any]


class Task(NamedTuple):
    """A log, or (with a seed for a path) a synthetic flight; the group that it is in."""

    source: Path | int
    group: str
    quick: bool


def done(task: Task) -> list[Row]:
    """Break every gyro in every way, and sum up what is said; nothing of a log with one IMU."""
    return list(synthetic(task) if isinstance(task.source, int) else of_log(task, task.source))


def of_log(task: Task, path: Path) -> Iterator[Row]:
    """Break the gyros of a log."""
    try:
        read = read_log(path)
        log = gb.open_log(read, needs=[*GYROS, *ATTITUDE])
        opened = opened_with(read, log.imus, ()) if len(log.imus) > 1 else None
        watched = None if opened is None else gb.watch_log(path, "C")
    except InputError:
        return
    if opened is None or watched is None or watched.check.stops:
        return
    imus = [replace(imu, unit="deg/s") for imu in log.imus[:3]]
    names = [name for imu in imus for name in channels_of(imu)]
    records = list(opened.segments)
    for name in names:
        records = [record.replace(name, np.degrees(record[name])) for record in records]
    (healthy,), beyond = watched.identified_s, watched.excursions
    end_s, draw = records[-1].end_s, np.random.default_rng(zlib.crc32(path.name.encode()))
    base = said_of(records, imus, healthy, ("", ""), beyond)
    for name in names:
        for kind, fault in FAULTS.items():
            for _ in range(1 if task.quick else TIMES):
                onset_s = float(draw.uniform(healthy[1] + 3.0, max(end_s - 15.0, healthy[1] + 4.0)))
                broken = [
                    gb.inject(each, fault(channel=name, onset_s=max(onset_s, each.start_s)))
                    if each.end_s > onset_s
                    else each
                    for each in records
                ]
                said = FALSE if base != MISSED else said_of(broken, imus, healthy, name.split(" of "), beyond)
                yield {"group": task.group, "log": path.name, "IMUs": len(imus), "fault": kind, "said": said}


def synthetic(task: Task) -> Iterator[Row]:
    """Break the gyros of synthetic flights, before the estimator."""
    assert isinstance(task.source, int)
    truth = fly_once(duration_s=LASTS_S, seed=720_000 + task.source).select([*GYROS, *ATTITUDE])
    draw = np.random.default_rng([task.source, 3])
    faults = {"jam": FAULTS["jam"]} if task.quick else FAULTS
    for count in (2, 3):
        imus = [
            Imu(name=f"IMU{number}", number=number, columns=("x", "y", "z"), unit="deg/s", rate_hz=20.0)
            for number in range(1, count + 1)
        ]
        for driver in (0, 1):
            for channel in GYROS:
                for kind, fault in faults.items():
                    time_constant_s = float(draw.choice(TIME_CONSTANTS_S))
                    sensed = [with_noise(truth, draw) for _ in imus]
                    sensed[0] = gb.inject(sensed[0], fault(channel=channel, onset_s=float(draw.uniform(*ONSETS_S))))
                    try:
                        read = filtered_attitude(sensed[driver], time_constant_s=time_constant_s, seed=task.source)
                    except InputError:  # it has lost its attitude altogether
                        continue
                    columns = [*(each.matrix(GYROS) for each in sensed), read.matrix(ATTITUDE)]
                    names = [*(name for imu in imus for name in channels_of(imu)), *ATTITUDE]
                    record = gb.Record(np.hstack(columns)[::5], channels=names, sample_period_s=0.05)
                    said = said_of([record], imus, (0.0, HEALTHY_S), (channel, imus[0].name))
                    drives = "driven by the broken IMU" if driver == 0 else "driven by another"
                    yield {"group": "synthetic", "log": drives, "IMUs": count, "fault": kind, "said": said}


def with_noise(truth: gb.Record, draw: np.random.Generator) -> gb.Record:
    """Return what an IMU reads."""
    for name in GYROS:
        truth = truth.replace(name, truth[name] + 0.2 * draw.standard_normal(len(truth)) + 0.1 * draw.standard_normal())
    return truth


def said_of(
    records: Sequence[gb.Record],
    imus: Sequence[Imu],
    healthy: Span,
    broken: Sequence[str],
    beyond: Sequence[Excursion] = (),
) -> str:
    """Sum up what a comparison says of a broken gyro, a channel of an IMU."""
    comparison = compared(records, imus, healthy=[healthy], excursions=beyond)
    alarms = () if comparison is None else comparison.alarms
    named = {(alarm.sensor, alarm.last.imu) for alarm in alarms if alarm.sensor is not None and alarm.last is not None}
    if named:
        return RIGHT if named == {tuple(broken)} else WRONG
    return UNDECIDED if alarms else MISSED


def conduct(campaign: Campaign) -> Findings:
    """Break, compare, report."""
    wrong = [str(folder) for folder in campaign.given.folders if not folder.is_dir()]
    if wrong:
        raise InputError(f"{', '.join(wrong)} is no folder; give folders of logs, or none")
    seeds = SEEDS[:1] if campaign.quick else SEEDS
    files = [
        Task(path, folder.resolve().name, campaign.quick)
        for folder in campaign.given.folders
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    ]
    todo = [*files, *(Task(seed, "synthetic", campaign.quick) for seed in seeds)]
    results = spread(done, todo, processes=campaign.jobs, step="logs", progress=campaign.tell)
    rows = pd.DataFrame([row for each in results for row in each])
    cells = {"faults": len} | {
        said: lambda of, said=said: int((of["said"] == said).sum()) for said in (RIGHT, WRONG, UNDECIDED, MISSED, FALSE)
    }
    tables = [
        markdown(grouped(rows, {"group": "group", "log": "log", "IMUs": "IMUs"}, cells)),
        markdown(grouped(rows, {"group": "group", "fault": "fault"}, cells)),
    ]
    head = ["# Several IMUs: which one lies?", SAID_QUICK * campaign.quick + INTRODUCTION]
    return Findings(
        "\n\n".join([*head, *tables]) + "\n",
        bool((rows["said"] == WRONG).any()),
        lambda out: rows.to_csv(out / "faults.csv", index=False),
    )


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is compared."""
    parser.add_argument("folders", nargs="*", type=Path, help="folders of logs")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one fault of a kind, one flight", arguments=arguments))
