"""Logs with several IMUs: of gyros that part, whether the liar is named or suspected, and no healthy one named.

    python experiments/several_imus.py [FOLDER ...] [--quick] [--out DIR] [--jobs N]

Of every log below the folders that has two IMUs or more, and of synthetic flights whose estimator is driven by the
broken IMU or by another: one IMU's gyro is broken at times drawn anew, and the engine judges all IMUs and the attitude.
Prints tables; writes report.md and faults.csv into DIR. Ends with code 1 where any IMU is named wrong (never with
--quick).
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.attitude_filter import filtered_attitude
from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.beside import with_imus
from gtmbench.engine.imus.imu import gyro_of
from gtmbench.engine.judged import judged
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_samples
from gtmbench.intake.read import read_log
from gtmbench.jobs.processes import spread
from gtmbench.log.opening.opened_log import imu_samples
from gtmbench.report.markup import markdown
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped

RIGHT, EITHER, WRONG, MISSED, FALSE = "named", "either-or", "named wrong", "not accused", "accused as it is"
FAULTS: Mapping[str, Callable[..., gb.Fault]] = {
    "bias 0.7 deg/s": lambda **at: gb.Bias(size=0.7, **at),
    "bias 3 deg/s": lambda **at: gb.Bias(size=3.0, **at),
    "bias 10 deg/s": lambda **at: gb.Bias(size=10.0, **at),
    "drift 0.2 deg/s per s": lambda **at: gb.Drift(slope=0.2, **at),
    "scale factor 1.5": lambda **at: gb.ScaleFactor(factor=1.5, **at),
    "sign flip": lambda **at: gb.SignFlip(**at),
    "noise 5 deg/s": lambda **at: gb.Noise(deviation=5.0, **at),
    "jam": lambda **at: gb.Jam(**at),
}
BEGINS, ENDS = 0.25, 0.75  # shares of what is flown, between which faults begin
SEEDS, LASTS_S = range(10, 12), 150.0  # of synthetic flights
TIME_CONSTANTS_S = (3.0, 8.0, 20.0)
SAID_QUICK = "**Quick: one fault of a log or a flight. It bounds nothing.**\n\n"
INTRODUCTION = """One gyro of one IMU is broken. *named*: that gyro of that IMU failed by what all IMUs and the
attitude say, and no other gyro of that axis did; *either-or*: it is one of those that are suspected; *accused as it
is*: the log accuses a gyro without the fault, too.

In the logs the attitude is as it was logged, so it doesn't follow the fault; in synthetic flights it is a complementary
filter's (time constants of 3, 8 and 20 s) that is driven by the broken IMU or by a healthy one.
"""
Row = dict[str, Any]
Gyros = Mapping[str, Samples]


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
        own = {name: Samples(each.time_s, each.values) for name, each in log_samples(read, (*GYROS, *ATTITUDE)).items()}
    except InputError:
        return
    others = {
        gyro_of(gyro, name): each
        for name, axes in imu_samples(read, log, ()).items()
        for gyro, each in zip(GYROS, axes, strict=True)
    }
    if not others:
        return
    base = flight_by({**own, **others})
    start_s, end_s = base.flown_s
    is_accused = bool(judged(base).accused)
    draw = np.random.default_rng(zlib.crc32(path.name.encode()))
    for name in (*GYROS, *others):
        for kind, fault in list(FAULTS.items())[: 1 if task.quick else None]:
            onset_s = start_s + float(draw.uniform(BEGINS, ENDS)) * (end_s - start_s)
            broken = broken_samples({**own, **others}[name], fault, onset_s)
            said = FALSE if is_accused else said_of(flight_by({**own, **others, name: broken}), name)
            yield {
                "group": task.group,
                "log": path.name,
                "IMUs": 1 + len(others) // len(GYROS),
                "fault": kind,
                "said": said,
            }


def broken_samples(samples: Samples, fault: Callable[..., gb.Fault], onset_s: float) -> Samples:
    """Return what a gyro reads from an onset on with a fault."""
    values = np.asarray(samples[1])[:, np.newaxis]
    record = gb.Record(values, channels=["p"], sample_period_s=samples.step_s)
    rows = int(np.searchsorted(samples.time_s, onset_s))
    return Samples(samples.time_s, gb.inject(record, fault(channel="p", onset_s=rows * samples.step_s))["p"])


def flight_by(samples: Gyros) -> Flight:
    """Return a flight of p, q, r and the attitude, with the gyros of other IMUs, `p of IMU2`, beside it."""
    names = dict.fromkeys(name.partition(" of ")[2] for name in samples if " of " in name)
    beside = {name: [samples[gyro_of(gyro, name)] for gyro in GYROS] for name in names}
    return with_imus(flight_of({name: samples[name] for name in (*GYROS, *ATTITUDE)}, is_driven=True), beside)


def synthetic(task: Task) -> Iterator[Row]:
    """Break the gyros of synthetic flights, before the estimator."""
    assert isinstance(task.source, int)
    truth = fly_once(duration_s=LASTS_S, seed=720_000 + task.source).select([*GYROS, *ATTITUDE])
    draw = np.random.default_rng([task.source, 3])
    for count in (2, 3):
        for broken in (0, 1):
            for channel in GYROS:
                for kind, fault in list(FAULTS.items())[: 1 if task.quick else None]:
                    time_constant_s = float(draw.choice(TIME_CONSTANTS_S))
                    onset_s = LASTS_S * float(draw.uniform(BEGINS, ENDS))
                    sensed = [with_noise(truth, draw) for _ in range(count)]
                    sensed[broken] = gb.inject(sensed[broken], fault(channel=channel, onset_s=onset_s))
                    for driver in (0, 1):
                        try:
                            read = filtered_attitude(sensed[driver], time_constant_s=time_constant_s, seed=task.source)
                        except InputError:  # it has lost its attitude altogether
                            continue
                        told = {name: Samples(truth.time_s[::5], read[name][::5]) for name in ATTITUDE}
                        for number, each in enumerate(sensed):
                            for name in GYROS:
                                own = name if number == 0 else gyro_of(name, f"IMU{number + 1}")
                                told[own] = Samples(truth.time_s[::5], each[name][::5])
                        liar = channel if broken == 0 else gyro_of(channel, f"IMU{broken + 1}")
                        drives = "driven by the broken IMU" if driver == broken else "driven by another"
                        said = said_of(flight_by(told), liar)
                        yield {"group": "synthetic", "log": drives, "IMUs": count, "fault": kind, "said": said}


def with_noise(truth: gb.Record, draw: np.random.Generator) -> gb.Record:
    """Return what an IMU reads."""
    for name in GYROS:
        truth = truth.replace(name, truth[name] + 0.2 * draw.standard_normal(len(truth)) + 0.1 * draw.standard_normal())
    return truth


def said_of(flight: Flight, broken: str) -> str:
    """Sum up what is said of a flight in which one gyro is broken."""
    accused = judged(flight).accused
    gyros = [(sensor, span.state) for sensor, span in accused if sensor.partition(" of ")[0] in GYROS]
    failed = {sensor for sensor, state in gyros if state is State.FAILED}
    if failed - {broken}:
        return WRONG
    if failed:
        return RIGHT
    return EITHER if broken in {sensor for sensor, _ in gyros} else MISSED


def conduct(campaign: Campaign) -> Findings:
    """Break, judge, report."""
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
        said: lambda of, said=said: int((of["said"] == said).sum()) for said in (RIGHT, EITHER, WRONG, MISSED, FALSE)
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
    """Add what is judged."""
    parser.add_argument("folders", nargs="*", type=Path, help="folders of logs")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one fault of a kind, one flight", arguments=arguments))
