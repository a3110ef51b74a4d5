"""Logs: which of the sensors that no gyro enters are accused, found and named by the engine when they fail.

    python experiments/other_sensors_in_logs.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Watches every log below the folders by `gtmbench monitor`'s detector auto as it is, and with one fault at a time of one
of its sensors: magnetometer, GPS velocity, accelerometers, airspeed or pressure altitude. A fault begins amid the
flight, and lasts. It is put into the readings; the attitude stays as it was logged, although an estimator would have
followed some of them. Prints tables, writes report.md and cases.csv into DIR, and ends with code 1 where a sensor is
named that is healthy. No log is kept. With --synthetic the same of flights of the GTM by their seeds, written as
tables.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.engine.course.judged import CourseJudged
from gtmbench.engine.samples import Samples
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.report.tables.markdown import markdown
from gtmbench.report.words.other_sensors import kind_of
from gtmbench.study.log.said import Said, course_of
from gtmbench.values.channels import ACCELEROMETERS, names_of
from gtmbench.verdict.timeline import State
from recorded.groups import studied_groups
from recorded.whole import watch_whole

SHARE, LEFT_S = 0.5, 45.0  # of a flight goes by before a fault; what has to be left then
FLOWN_S = 240.0  # of synthetic flights
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence", "dissertation")
INTRODUCTION = """*accused*: sensors that failed, or are suspected, in a log as it is. Each fault is put into one sensor
of one log. *named*: that sensor failed, and no other; *either-or*: it is one of two that are suspected; *wrong*:
another one failed, too or instead; *not accused*: none of these.
"""
Row = dict[str, Any]


def faults(kind: str, onset_s: float, strength: float) -> Iterator[tuple[str, gb.Fault]]:
    """Give the faults of a sensor: on its first channel, of accelerometers and a GPS also on the vertical one."""
    first = {"magnetometer": "mag_x", "gps": "gps_north", "accelerometers": "nx"}.get(kind, kind)
    at: dict[str, Any] = {"channel": first, "onset_s": onset_s}
    if kind == "magnetometer":
        yield "bias 30 % of the field", gb.Bias(**at, size=0.3 * strength)
        yield "drift 2 % a second", gb.Drift(**at, slope=0.02 * strength)
        yield "jam", gb.Jam(**at)
        yield "noise 30 %", gb.Noise(**at, deviation=0.3 * strength)
    elif kind == "gps":
        yield "bias 8 m/s", gb.Bias(**at, size=8.0)
        yield "drift 2 m/s²", gb.Drift(**at, slope=2.0)
        yield "vertical drift 2 m/s²", gb.Drift(channel="gps_down", onset_s=onset_s, slope=-2.0)
        yield "noise 4 m/s", gb.Noise(**at, deviation=4.0)
    elif kind == "accelerometers":
        yield "bias 0.5 g", gb.Bias(**at, size=0.5)
        yield "vertical bias 0.5 g", gb.Bias(channel="nz", onset_s=onset_s, size=-0.5)
        yield "jam at 4 g", gb.Hardover(channel="nz", onset_s=onset_s, limit=4.0)
        yield "vertical scale 0.5", gb.ScaleFactor(channel="nz", onset_s=onset_s, factor=0.5)
    elif kind == "tas":
        yield "bias 20 kt", gb.Bias(**at, size=20.0)
        yield "jam", gb.Jam(**at)
        yield "reads 0", gb.Stuck(**at, value=0.0)
        yield "scale 0.7", gb.ScaleFactor(**at, factor=0.7)
    else:
        yield "bias 150 ft", gb.Bias(**at, size=150.0)
        yield "drift 20 ft/s", gb.Drift(**at, slope=20.0)
        yield "jam", gb.Jam(**at)
        yield "noise 30 ft", gb.Noise(**at, deviation=30.0)


def broken(sensor: SensorReadings, fault: gb.Fault) -> SensorReadings:
    """Return a sensor's readings with a fault."""
    place = sensor.channels.index(fault.channel)
    period_s = float(np.median(np.diff(sensor.time_s)))
    values = sensor.values.copy()  # noqa: PD011
    values[:, place] = fault.broken(values[:, [place]], sensor.time_s, period_s)
    return replace(sensor, values=values)


def cases(path: Path) -> list[Row]:
    """Return what is said of a log, as it is and with each fault; an error's row where it can't be watched."""
    try:
        whole = watch_whole(path)
    except gb.GtmbenchError as error:
        return [{"log": path.name, "kind": "", "fault": "", "said": "refused", "told": str(error)[:120]}]
    told, clean = whole.said, whole.said.course
    if clean is None:
        return [{"log": path.name, "kind": "", "fault": "", "said": "not compared", "told": whole.watched.reasons[:1]}]
    began = time.process_time()
    course_of(told, told.judged)
    costs = {"log_s": whole.cpu_s, "sensors_s": time.process_time() - began}
    failed, suspected = accused(clean)
    rows = [
        {"log": path.name, "kind": kind, "fault": "", "said": "accused" if kind in failed | suspected else "quiet"}
        | costs
        for kind in dict.fromkeys(map(kind_of, told.learnt.opened.sensors))
    ]
    start_s, end_s = clean.course.flight.flown_s
    onset_s = start_s + SHARE * (end_s - start_s)
    return rows if end_s - onset_s < LEFT_S else [*rows, *put_into(path, told, onset_s, failed | suspected)]


def put_into(path: Path, told: Said, onset_s: float, before: set[str]) -> Iterator[Row]:
    """Break each sensor of a log that compares it; what was accused before doesn't count."""
    given, clean = told.learnt.opened.sensors, told.course
    assert clean is not None
    for sensor in {kind_of(each): each for each in reversed(given) if kind_of(each) in clean.compared}.values():
        kind, strength = kind_of(sensor), float(np.median(np.linalg.norm(sensor.values, axis=1)))
        for name, fault in () if kind in before else faults(kind, onset_s, strength):
            failed, suspected = accused(course_of(with_readings(told, broken(sensor, fault)), told.judged))
            said = "not accused"
            if (failed | suspected) - before:
                said = "either-or" if kind in suspected else "named" if kind in failed else "wrong"
            if failed - before - {kind}:
                said = "wrong"
            yield {"log": path.name, "kind": kind, "fault": name, "said": said}


def with_readings(told: Said, sensor: SensorReadings) -> Said:
    """Return what was said of a log, one of whose sensors reads otherwise."""
    opened = told.learnt.opened
    columns = dict(zip(sensor.channels, sensor.values.T, strict=True))  # noqa: PD011
    own = {name: Samples(sensor.time_s, column) for name, column in columns.items()}
    return replace(told, learnt=replace(told.learnt, opened=replace(opened, readings={**opened.readings, **own})))


def accused(course: CourseJudged | None) -> tuple[set[str], set[str]]:
    """Return which sensors failed, and which are suspected."""
    claims = () if course is None else (*course.standing, *course.accused)
    failed, suspected = (
        {names_of(sensor)[-1] for sensor, span in claims if span.state is state}
        for state in (State.FAILED, State.SUSPECTED)
    )
    return failed, suspected


def flight(seed: int, duration_s: float = FLOWN_S) -> gb.Record:
    """Return what is logged of a healthy flight, with a magnetometer and a GPS."""
    drawn = np.random.default_rng([seed, 99])
    truth = gb.fly("gtm", EXCITATIONS[seed % 3], duration_s, seed)
    sensed = gb.measure(truth, noise="t2", seed=seed)
    for name in ACCELEROMETERS:
        sensed = sensed.replace(name, sensed[name] + 0.01 * drawn.standard_normal())
    sensed = sensed.replace("tas", sensed["tas"] * (1.0 + 0.02 * drawn.standard_normal()))
    sensed = gb.imperfect(sensed, gb.Imperfections(bias=0.05, wander=0.002), seed=seed)
    readings = estimated_attitude(sensed, truth, "filter 20 s", seed)
    hard_x, hard_y, hard_z = drawn.normal(0.0, 1.5, 3)
    magnetometer = gb.Magnetometer(
        inclination_deg=drawn.uniform(40.0, 75.0),
        declination_deg=drawn.uniform(-20.0, 20.0),
        hard_iron_ut=(float(hard_x), float(hard_y), float(hard_z)),
    )
    gps = gb.Gps(rate_hz=float(drawn.choice([5.0, 10.0])), delay_s=drawn.uniform(0.1, 0.2))
    return gb.with_gps(gb.with_magnetometer(readings, truth, magnetometer, seed=seed), truth, gps, seed=seed)


def synthetic(folder: Path, seeds: range) -> list[Path]:
    """Write flights of the GTM as tables, with the channels of every sensor."""
    paths = []
    for seed in seeds:
        path = folder / f"gtm_{seed}.csv"
        gb.write_log(flight(seed, FLOWN_S), path)
        paths.append(path)
    return paths


def report(rows: pd.DataFrame) -> list[str]:
    """Return tables of one group of logs."""
    clean, put = rows[rows["fault"] == ""], rows[rows["fault"] != ""]
    known = clean[clean["kind"] != ""]
    words = ("named", "either-or", "wrong", "not accused")
    sums = [
        {"sensor": kind, "logs": of["log"].nunique(), "accused": int((of["said"] == "accused").sum())}
        for kind, of in known.groupby("kind", sort=False)
    ]
    by = [
        {"sensor": kind, "fault": fault, "put": len(of)} | {word: int((of["said"] == word).sum()) for word in words}
        for (kind, fault), of in put.groupby(["kind", "fault"], sort=False)
    ]
    costs = known.drop_duplicates("log")
    total = ", ".join(f"{(put['said'] == word).sum()} {word}" for word in words)
    return [
        f"{rows['log'].nunique()} logs, {(clean['said'] == 'refused').sum()} refused; of {len(put)} faults {total}.",
        f"CPU of whole verdicts {costs['log_s'].sum():.1f} s, of other sensors {costs['sensors_s'].sum():.1f} s.",
        markdown(pd.DataFrame(sums)),
        markdown(pd.DataFrame(by)) if by else "",
    ]


def main() -> int:
    """Watch, sum up, write."""
    head, out = (
        ["# Sensors that no gyro enters, in logs", INTRODUCTION],
        Path("experiments/reports/other_sensors_in_logs"),
    )
    everything = studied_groups(__doc__, head, out, cases=cases, synthetic=synthetic, report=report)
    return int(everything["said"].isin(["accused", "wrong"]).any())


if __name__ == "__main__":
    sys.exit(main())
