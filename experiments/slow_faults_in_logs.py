"""Recorded flights: which slow faults of a gyro are named with the log's other sensors, and which without.

    python experiments/slow_faults_in_logs.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Watches every log below the folders by `gtmbench monitor`'s detector auto, as it is and with one slow fault of a gyro at
a time: each of p, q and r reads 1, 2 or 5 deg/s too much or too little, or drifts until it reads 1 or 3 deg/s wrong. A
fault begins a quarter of the way from the end of what was learnt to the end of the flight, and lasts; an estimator of 5
or of 20 s makes the attitude of the broken gyro. The other sensors read what they read in the log. *Without* is the
verdict before any witness was asked. Prints tables, writes report.md and cases.csv into DIR, and ends with code 1 where
a healthy sensor is named. No log is kept. With --synthetic the same of flights of the GTM by their seeds, written as
tables at 10 Hz, whose attitude a filter of 20 s makes of the gyros.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.crosscheck.relations import GPS, MAG
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.other_sensors import kind_of
from gtmbench.values.channels import ATTITUDE, GYROS, MAGNETOMETER
from recorded.groups import studied_groups
from recorded.whole import NAMED, NOTHING, WRONG, Whole, alarms_after, broken_log, said_of, verdict_on, watch_whole

SHARE, LEFT_S, REACHED_S = 0.25, 30.0, 60.0  # before an onset; what has to be left; when a drift is reached, at most
TIME_CONSTANTS_S = (5.0, 20.0)
FLOWN_S, RATE_HZ = 240.0, 10.0  # of synthetic flights
WORDS = (NAMED, "either-or", "can't tell", NOTHING, WRONG)
INTRODUCTION = """*put*: faults, each alone on one log. *named*: the broken gyro is named. *either-or*: among others.
*can't tell*: an alarm is left that names nobody. *nothing*: none is left. *named wrong*: a healthy sensor is named, or
an either-or doesn't hold the broken one. *without*: the same before any witness was asked. Logs *with GPS* have a
velocity over ground, *with a magnetometer* a raw field; accelerometers are in all of them. Logs that end with a failed
sensor as they are, or fail the self-check, have no faults put on them.
"""
Row = dict[str, Any]


def faults(sensor: str, onset_s: float, left_s: float, sign: float) -> Iterator[tuple[str, gb.Fault]]:
    """Give the slow faults of a gyro; drifts reach their size within what is left, or within a minute."""
    at: dict[str, Any] = {"channel": sensor, "onset_s": onset_s}
    for size in (1.0, 2.0, 5.0):
        yield f"bias {size:g} deg/s", gb.Bias(**at, size=sign * size)
    for size in (1.0, 3.0):
        yield f"drift to {size:g} deg/s", gb.Drift(**at, slope=sign * size / min(left_s, REACHED_S))


def cases(path: Path) -> list[Row]:
    """Return what is said of a log, as it is and with each fault; an error's row where it can't be watched."""
    try:
        whole = watch_whole(path)
    except gb.GtmbenchError as error:
        return [{"log": path.name, "fault": "", "said": "refused", "told": str(error)[:120]}]
    watched = whole.watched
    beside = {kind_of(each) for each in whole.learnt.opened.sensors}
    told = " | ".join(in_words(alarm) for alarm in watched.alarms)
    whose: Row = {"log": path.name, "gps": GPS in beside, "mag": MAG in beside}
    rows: list[Row] = [{**whose, "fault": "", "said": watched.outcome.name, "told": told, "cpu_s": whole.cpu_s}]
    onset_s = onset_in(whole)
    if onset_s is None:
        return rows
    left_s = watched.log.segments[-1].end_s - onset_s
    for turn, sensor in enumerate(GYROS):
        for number, (name, fault) in enumerate(faults(sensor, onset_s, left_s, (-1.0) ** (turn + len(path.name)))):
            tau_s = TIME_CONSTANTS_S[(turn + number) % 2]
            result = _result(whole, fault, tau_s)
            if result is not None:
                rows.append({**whose, "sensor": sensor, "fault": name, "tau_s": tau_s, "onset_s": onset_s, **result})
    return rows


def onset_in(whole: Whole) -> float | None:
    """Return when a fault begins; None where nothing can be put on the log."""
    watched = whole.watched
    if watched.check.stops or not watched.identified_s or set(GYROS) & {sensor for sensor, _ in watched.verdict.failed}:
        return None
    start_s, end_s = watched.identified_s[-1][1], watched.log.segments[-1].end_s
    onset_s = start_s + SHARE * (end_s - start_s)
    return onset_s if end_s - onset_s >= LEFT_S else None


def _result(whole: Whole, fault: gb.Fault, tau_s: float) -> Row | None:
    """Return what is said of a fault; None where it would bend the attitude beyond Euler angles."""
    try:
        broken = broken_log(whole.learnt.opened, fault, gb.AttitudeEstimator(time_constant_s=tau_s))
    except gb.InputError:
        return None
    told = alarms_after(said_of(replace(whole.learnt, opened=broken)), whole.said, fault.onset_s)
    own = [replace(each, judgements=tuple(j for j in each.judgements if not j.witness)) for each in told]
    without = [each for each in own if each.judgements and not each.has_passed]
    found_s = min((alarm.time_s - fault.onset_s for alarm in told), default=np.nan)
    return {
        "said": verdict_on(told, fault.channel),
        "without": verdict_on(without, fault.channel),
        "found_s": found_s,
        "told": " | ".join(map(in_words, told))[:600],
    }


def in_words(alarm: Alarm) -> str:
    """Return when an alarm came, by what, whom it names, and why."""
    last = alarm.last
    reason = "" if last is None else last.witness or last.reason
    return f"{alarm.time_s:.0f} s {alarm.source} {alarm.test}: {alarm.verdict} {alarm.candidates} [{reason}]"


def synthetic(folder: Path, seeds: range) -> list[Path]:
    """Write healthy flights as tables at 10 Hz: T2's noise, a driven attitude, every sensor that no gyro enters."""
    paths = []
    for seed in seeds:
        dip_deg = np.random.default_rng(seed).uniform(40.0, 75.0)
        truth = gb.fly("gtm", "multisine+turbulence", FLOWN_S, seed=seed)
        sensed = gb.measure(truth, noise="t2", seed=seed)
        magnetometer = gb.Magnetometer(inclination_deg=dip_deg, rate_hz=RATE_HZ)
        sensed = gb.with_magnetometer(sensed, truth, magnetometer, seed=seed)
        sensed = gb.with_gps(sensed, truth, gb.Gps(rate_hz=5.0, delay_s=0.15), seed=seed)
        for name in ATTITUDE:
            sensed = sensed.replace(name, truth[name])
        driven = gb.filtered_attitude(sensed, time_constant_s=20.0, seed=seed)
        every = round(1.0 / (RATE_HZ * driven.sample_period_s))
        channels = (*GYROS, *ATTITUDE, *MAGNETOMETER, "nx", "ny", "nz", "gps_north", "gps_east", "gps_down")
        rows = driven.matrix(channels)[::every]
        paths.append(folder / f"gtm_{seed}.csv")
        gb.write_log(gb.Record(rows, channels=channels, sample_period_s=1.0 / RATE_HZ), paths[-1])
    return paths


def _sums(of: pd.DataFrame) -> Row:
    counts = {word: int((of["said"] == word).sum()) for word in WORDS}
    before = {f"{word}, without": int((of["without"] == word).sum()) for word in (NAMED, WRONG)}
    return {"put": len(of), **counts, **before}


def report(rows: pd.DataFrame) -> list[str]:
    """Return tables of one group of logs."""
    clean, put = rows[rows["fault"] == ""], rows[rows["fault"] != ""]
    outcomes = ", ".join(f"{count} {name}" for name, count in clean["said"].value_counts().items())
    parts = [f"{len(clean)} logs as they are: {outcomes}. {put['log'].nunique()} of them had faults put on them."]
    if not len(put):
        return parts
    kinds = {"all": put, "logs with GPS": put[put["gps"]], "logs with a magnetometer": put[put["mag"]]}
    parts.append(markdown(pd.DataFrame([{"faults": name, **_sums(of)} for name, of in kinds.items()])))
    by = [
        {"gyro": sensor, "fault": fault, **_sums(of)}
        for (sensor, fault), of in put.groupby(["sensor", "fault"], sort=False)
    ]
    parts.append(markdown(pd.DataFrame(by)))
    parts += [f"- {row.log}, {row.fault} of {row.sensor}: {row.told}" for row in put[put["said"] == WRONG].itertuples()]
    return parts


def main() -> int:
    """Watch, sum up, write."""
    head, out = (
        ["# Slow faults of gyros in recorded flights", INTRODUCTION],
        Path("experiments/reports/slow_faults_in_logs"),
    )
    everything = studied_groups(__doc__, head, out, cases=cases, synthetic=synthetic, report=report)
    return int((everything["said"] == WRONG).any())


if __name__ == "__main__":
    sys.exit(main())
