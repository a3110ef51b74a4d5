"""An attitude that the gyros drive: which gyro is named, how soon, and whether the certificate's faults are seen.

    python experiments/driven_attitude.py [--only PART ...] [--quick] [--out DIR] [--jobs N] [--seed N]

Flights of the GTM (200 s, noise t2), whose attitude an estimator makes of the gyros, broken or not: complementary
filters of 1, 5 and 20 s, a Kalman filter with states for the gyros' biases; references with noise of 0.5 deg at 100 Hz.
At 100 s one gyro breaks, in one of nine ways.

- ``names``: by bank C-filtered, calibrated on 12 flights of the same estimator; delays beside a first-order figure of
  theory of the same signals.
- ``logs``: by ``gb.watch_log(..., "auto")`` on tables (CSV) and on PX4's logs (ULog, attitude at 50 Hz), which learn
  on their own first 80 s; healthy logs too.
- ``certificate``: faults of the certificate's size at onsets of their own, put through the estimator, and watched.
- ``own``: the same faults on attitudes of their own, taken for driven and for own.

Prints tables; writes report.md and cases.csv into DIR. Ends with code 1 where a target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.attitude_filter import REFERENCE_NOISE_DEG, estimated_attitude
from gtmbench.jobs.processes import spread
from gtmbench.log.judging.certificate import certificate_of, kinds
from gtmbench.report.markup import markdown
from gtmbench.values.attitude_estimators import ESTIMATORS
from gtmbench.values.channels import ATTITUDE, GYROS, header_of
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped

SEED = 33_000  # of the report's cases; others were looked at while names were made
ONSET_S, LASTS_S = 100.0, 200.0
RIGHT = {"filter 1 s": 0.85, "filter 5 s": 0.85, "filter 20 s": 0.65, "kalman": 0.65}  # asked, of the faults
WRONG, OVER_LIMIT, SEEN = 0.01, 1.5, (0.8, 0.96)
FLIGHTS = {"names": 2, "logs": 1, "certificate": 2, "own": 1}
FAULTS: dict[str, Callable[[str], gb.Fault]] = {
    "bias 1": lambda ch: gb.Bias(channel=ch, onset_s=ONSET_S, size=1.0),
    "bias 5": lambda ch: gb.Bias(channel=ch, onset_s=ONSET_S, size=5.0),
    "drift 0.05": lambda ch: gb.Drift(channel=ch, onset_s=ONSET_S, slope=0.05),
    "drift 0.5": lambda ch: gb.Drift(channel=ch, onset_s=ONSET_S, slope=0.5),
    "jam": lambda ch: gb.Jam(channel=ch, onset_s=ONSET_S),
    "scale 0.7": lambda ch: gb.ScaleFactor(channel=ch, onset_s=ONSET_S, factor=0.7),
    "sign": lambda ch: gb.SignFlip(channel=ch, onset_s=ONSET_S),
    "noise 2": lambda ch: gb.Noise(channel=ch, onset_s=ONSET_S, deviation=2.0),
    "deadzone 2": lambda ch: gb.Deadzone(channel=ch, onset_s=ONSET_S, half_width=2.0),
}
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence")
SAID_QUICK = "**Quick: a few faults. It bounds nothing.**\n\n"
GYRO_NOISE = {"p": 0.535, "q": 0.474, "r": 0.340}  # deg/s, of t2
PER_HOUR, BETWEEN_H = 0.002, 500.0
Row = dict[str, Any]


class Task(NamedTuple):
    """What is done: a part, an estimator's name, a flight's seed, a gyro, a fault's name."""

    part: str
    estimator: str
    seed: int
    gyro: str = ""
    fault: str = ""


# ---- flights


@cache
def flown(seed: int, duration_s: float = LASTS_S) -> tuple[gb.Record, gb.Record]:
    """Return a flight's measured record with the true attitude in it, and with the measured one."""
    truth = gb.fly("gtm", EXCITATIONS[seed % 2], duration_s, seed)
    sensed = gb.measure(truth, noise="t2", seed=seed).select([*GYROS, *ATTITUDE])
    references = sensed
    for name in ATTITUDE:
        references = references.replace(name, truth[name])
    return references, sensed


def read(task: Task) -> gb.Record:
    """Return what is logged of a task's flight."""
    references, _ = flown(task.seed)
    if task.fault:
        references = gb.inject(references, FAULTS[task.fault](task.gyro))
    while True:
        try:
            return estimated_attitude(references, references, task.estimator, task.seed)
        except gb.InputError:  # bent beyond Euler angles: the log ends before
            references = references.between(references.start_s, references.end_s - 5.0)


# ---- a first-order figure of theory


def quickest_s(task: Task) -> float:
    """Return the seconds that whoever knows all but the onset needs for one false alarm in 500 h.

    Gyros and estimate tell what the references read, z = x + tau (x' - f(y)), so that the estimator hides nothing of
    whoever knows it: a reference's angle, by the noise of that, is carried on by the gyro, by the noise of that.
    """
    healthy, _ = flown(task.seed)
    broken = gb.inject(healthy, FAULTS[task.fault](task.gyro))
    row, period_s = round(ONSET_S / healthy.sample_period_s), healthy.sample_period_s
    carried, told = (GYRO_NOISE[task.gyro] * period_s) ** 2, REFERENCE_NOISE_DEG**2
    ahead = carried / 2.0 + math.sqrt(carried**2 / 4.0 + carried * told)
    gain, off, information = ahead / (ahead + told), 0.0, 0.0
    for count, change in enumerate((broken[task.gyro] - healthy[task.gyro])[row:].tolist(), start=1):
        off += change * period_s
        information += off**2 / (2.0 * (ahead + told))
        off -= gain * off
        if information > math.log(3600.0 * BETWEEN_H / period_s):
            return count * period_s
    return math.inf


# ---- what is said


def said(alarms: Sequence[gb.Alarm], gyro: str) -> Row:
    """Return what alarms since the onset say of a broken gyro."""
    after = [alarm for alarm in alarms if alarm.time_s >= ONSET_S]
    names = {alarm.sensor for alarm in after if alarm.sensor}
    told = "missed" if not after else "wrong" if names - {gyro} else "right" if names else "either-or"
    return {
        "said": told,
        "names": " ".join(sorted(names)),
        "delay_s": after[0].time_s - ONSET_S if after else math.inf,
        "before": sum(alarm.time_s < ONSET_S for alarm in alarms),
    }


@cache
def monitor(estimator: str) -> gb.Monitor:
    """Return C-filtered, calibrated on 12 flights of an estimator."""
    told = {seed: flown(seed, 300.0)[0] for seed in range(300, 312)}
    records = [estimated_attitude(references, references, estimator, seed) for seed, references in told.items()]
    return gb.find_detector("C-filtered").calibrate(records, PER_HOUR)


def names(task: Task) -> Iterator[Row]:
    """Watch a flight by C-filtered."""
    yield {**said(monitor(task.estimator).watch(read(task)).alarms, task.gyro), "limit_s": quickest_s(task)}


def logs(task: Task) -> Iterator[Row]:
    """Watch a log that auto learns on first: a table, and one as autopilots write it."""
    record = read(task)
    limit_s = quickest_s(task) if task.fault else math.inf
    for form, attitude_hz, attitude in (("table", None, "auto"), ("autopilot's", 50.0, "driven")):
        watched = watched_table(record, "auto", attitude, attitude_hz)
        kept = {"form": form, "exit": int(watched.outcome), "driven": watched.attitude.is_driven}
        yield {**said(told(watched), task.gyro), **kept, "limit_s": limit_s}


def watched_table(record: gb.Record, bank: str, attitude: str, attitude_hz: float | None = None) -> gb.WatchedLog:
    """Write a record as a table, its attitude perhaps more slowly, and watch it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "flight.csv")
        if attitude_hz is None:
            gb.write_log(record, path)
        else:
            every = round(1.0 / (attitude_hz * record.sample_period_s))
            columns = {header_of(name): record[name].copy() for name in (*GYROS, *ATTITUDE)}
            for name in ATTITUDE:
                columns[header_of(name)][np.arange(len(record)) % every != 0] = np.nan
            pd.DataFrame({"time_s": record.time_s, **columns}).to_csv(path, index=False)
        watched = gb.watch_log(path, bank, attitude=attitude)
        _ = watched.outcome
        return watched


def told(watched: gb.WatchedLog) -> list[gb.Alarm]:
    """Return the alarms that are left to explain; one that is doubted names nobody."""
    return [
        dataclasses.replace(alarm, judgements=()) if alarm.doubt else alarm
        for alarm in watched.alarms
        if not alarm.has_passed
    ]


def certificate(task: Task) -> Iterator[Row]:
    """Put faults of a certificate's size on a log, at times of their own, through its estimator, and watch it."""
    watch = monitor(task.estimator).watch(read(task))
    draw = np.random.default_rng([task.seed, 7])
    for row in certificate_of(watch.monitor, [watch]).rows:
        if row.size is None:
            continue
        kind = next(kind for kind in kinds() if kind.fault.kind == row.kind)
        last_s = watch.record.end_s - kind.within_s
        able_s = watch.record.time_s[watch.monitor.superposition(watch, row.sensor).armed]
        for onset_s in draw.choice(able_s[able_s < last_s], 3):
            fault = kind.at(row.sensor, float(onset_s), row.size, is_turned=bool(draw.integers(2)))
            broken = gb.inject(watch.record, fault, attitude=ESTIMATORS[task.estimator])
            alarms = watch.monitor.watch(broken).alarms
            is_seen = any(onset_s <= alarm.time_s <= onset_s + row.within_s + 1e-6 for alarm in alarms)
            yield {"gyro": row.sensor, "fault": row.kind, "size": row.size, "seen": is_seen}


def own(task: Task) -> Iterator[Row]:
    """Watch flights whose attitude is of its own: by C, and as a table by auto, told nothing and told so."""
    _, sensed = flown(task.seed)
    if task.fault:
        sensed = gb.inject(sensed, FAULTS[task.fault](task.gyro))
    yield {"form": "C", **said(own_monitor().watch(sensed).alarms, task.gyro), "exit": None}
    for attitude in ("auto", "own"):
        watched = watched_table(sensed, "auto", attitude)
        yield {"form": f"auto, {attitude}", **said(told(watched), task.gyro), "exit": int(watched.outcome)}


@cache
def own_monitor() -> gb.Monitor:
    """Return C, calibrated on 12 flights."""
    return gb.find_detector("C").calibrate([flown(seed, 300.0)[1] for seed in range(300, 312)], PER_HOUR)


PARTS: dict[str, Callable[[Task], Iterator[Row]]] = {
    "names": names,
    "logs": logs,
    "certificate": certificate,
    "own": own,
}


def done(task: Task) -> list[Row]:
    """Do a task."""
    return [{**task._asdict(), **row} for row in PARTS[task.part](task)]


# ---- the report


INTRODUCTION = """Flights of the GTM (200 s, noise t2), with an attitude that an estimator makes of the gyros and of
references with noise of 0.5 deg at 100 Hz; at 100 s one gyro breaks. `names`: bank C-filtered, calibrated on 12
flights of the same estimator; `logs`: `gtmbench monitor LOG`, which learns on the first 80 s of a table at 100 Hz or of
an autopilot's attitude at 50 Hz; `certificate`: faults of a certificate's size; `own`: an attitude of its own. *Right*:
the broken gyro is named, and no other sensor ever; *limit*: a first-order figure of theory and no bound,
log(T/Ts) nats for whoever knows all but the onset, at one false alarm in 500 h.
"""


def tasks(seed: int, only: Sequence[str], quick: bool) -> list[Task]:
    """Return what is done, flights of different parts apart."""
    gyros, faults = ("p",) if quick else GYROS, list(FAULTS)[:2] if quick else list(FAULTS)
    todo = []
    for place, part in enumerate(PARTS):
        for flight in range(seed + 100 * place, seed + 100 * place + (1 if quick else FLIGHTS[part])):
            for estimator in ("own",) if part == "own" else list(ESTIMATORS)[: 1 if quick else None]:
                if part == "certificate":
                    todo.append(Task(part, estimator, flight))
                else:
                    todo += [Task(part, estimator, flight, gyro, fault) for gyro in gyros for fault in faults]
    return [task for task in todo if task.part in (only or PARTS)]


def conduct(campaign: Campaign) -> Findings:
    """Watch, count, report."""
    todo = tasks(campaign.given.seed, campaign.given.only, campaign.quick)
    results = spread(done, todo, processes=campaign.jobs, step="flights", progress=campaign.tell)
    rows = pd.DataFrame([row for each in results for row in each])
    told, missed = [], False
    for part, own in rows.groupby("part", sort=False):
        table, targets = (of_certificates if part == "certificate" else of_names)(part, own)
        missed |= any(each["reached"] == "MISSED" for each in targets)
        told += [f"## {part}", *([markdown(pd.DataFrame(targets))] if targets else []), table]
    head = ["# An attitude that the gyros drive", SAID_QUICK * campaign.quick + INTRODUCTION]
    return Findings("\n\n".join([*head, *told]) + "\n", missed, lambda out: rows.to_csv(out / "cases.csv", index=False))


def of_names(part: str, rows: pd.DataFrame) -> tuple[str, list[Row]]:
    """Return the table of a part with names, and its targets."""
    by = {"estimator": "estimator"} if part == "names" else {"form": "form", "estimator": "estimator"}
    counts = {"faults": len} | {
        word: lambda of, word=word: int((of["said"] == word).sum())
        for word in ("right", "wrong", "either-or", "missed")
    }
    delays = {"median delay (s)": lambda of: f"{of['delay_s'].median():.2f}"}
    if part != "own":
        delays |= {"over the limit": lambda of: f"{(of['delay_s'] / of['limit_s']).median():.2f}"}
    tables = [markdown(grouped(rows, by, {**counts, **delays})), markdown(grouped(rows, {"fault": "fault"}, counts))]
    if part == "own":
        return "\n\n".join(tables), []
    wrong = float((rows["said"] == "wrong").mean())
    targets = [target("wrong", f"{100 * wrong:.1f} %", "at most 1 %", wrong <= WRONG)]
    for keys, of in rows.groupby(list(by.values())):
        right = float((of["said"] == "right").mean())
        asked = RIGHT[str(keys[-1])]
        targets.append(
            target(f"right: {', '.join(keys)}", f"{100 * right:.0f} %", f"{100 * asked:.0f} %", right >= asked)
        )
    over = float((rows["delay_s"] / rows["limit_s"]).median())
    targets.append(target("delay over the limit, median", f"{over:.2f}", f"{OVER_LIMIT:g}", over <= OVER_LIMIT))
    return "\n\n".join(tables), targets


def of_certificates(_: str, rows: pd.DataFrame) -> tuple[str, list[Row]]:
    """Return how many faults of a certificate's size were seen."""
    counts = {"faults": len, "seen": lambda of: int(of["seen"].sum())}
    by = [{"estimator": "estimator"}, {"fault": "fault"}]
    seen = float(rows["seen"].mean())
    is_reached = SEEN[0] <= seen <= SEEN[1]
    tables = "\n\n".join(markdown(grouped(rows, each, counts)) for each in by)
    return tables, [target("seen in time", f"{100 * seen:.0f} %", "90 % (80-96)", is_reached)]


def target(text: str, measured: str, asked: str, is_reached: bool) -> Row:
    """Return a row of targets."""
    return {"target": text, "measured": measured, "asked": asked, "reached": "yes" if is_reached else "MISSED"}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is asked for."""
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=(), help="parts")
    parser.add_argument("--seed", type=int, default=SEED, help="of the first flight")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="a few faults", beside="cases", arguments=arguments))
