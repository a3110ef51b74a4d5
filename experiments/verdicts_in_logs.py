"""Logs: what the default verdict says of them, and of a fault in any of their sensors.

    python experiments/verdicts_in_logs.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Watches every log below the folders as `gtmbench monitor LOG` does, and every eighth (by its name's checksum) again with
one fault at a time in what a sensor reads: a further IMU's gyro (0.5 to 60 deg/s), an accelerometer, GPS velocity and
place, airspeed, altitude, magnetometer (of issue 66's sizes), a gyro (alone, or with an attitude that follows through
an estimator of 5 s) or an angle, at times that are drawn. Prints tables; writes report.md and cases.csv into DIR; ends
with code 1 where a healthy sensor is named. No log is kept. With --synthetic the same of flights of the GTM by seeds.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.engine.imus.beside import with_imus
from gtmbench.engine.imus.imu import gyro_of
from gtmbench.engine.samples import Samples
from gtmbench.errors import InputError
from gtmbench.jobs.progress import silent
from gtmbench.log.judging.monitored import Monitored, course_of, doubted, listened
from gtmbench.log.opening.opened_log import Opened
from gtmbench.log.watched_log import concluded
from gtmbench.report.markup import markdown
from gtmbench.report.words.verdict import verdict_text
from gtmbench.values.channels import ATTITUDE, GPS_VELOCITY, GYROS, MAGNETOMETER, names_of
from gtmbench.verdict.timeline import State, Timeline
from gtmbench.verdict.verdict import Outcome
from other_sensors_in_logs import BEGINS, LEFT_S, RAMP_S, SIZES, broken, faults, synthetic
from recorded.groups import studied_groups
from recorded.study import LONGEST
from recorded.whole import ESTIMATOR, Whole, broken_log, watch_whole

SIZES_DEG_S, SLOWER_S, FACTORS = (0.5, 60.0), 30.0, (0.5, 0.7, 1.4, 2.0)  # of IMUs; a drift reaches a size after that
IMU_KINDS = ("bias", "drift", "scale", "sign", "noise", "stuck")
GYRO_FAULTS = {"bias": (1.0, 5.0), "drift": (0.05, 0.5), "scale": (0.7,), "sign": (-1.0,), "noise": (5.0,), "stuck": ()}
GYRO_DRAWS, OTHER_DRAWS, ANGLE_DEG, PLACE_M = 3, 2, 10.0, 30.0  # faults a log, and a channel; of angles, of places
BROKEN = 8  # of so many logs one is
LEAST_S, SHOWS_S = 20.0, 6.0  # of flight, and behind an onset; within which nothing need show
ONE_OF = (("nx", "ny", "nz"), ("gps_north", "gps_east"), ("gps_down",), MAGNETOMETER, ("altitude",), ("tas",))
ACCUSED, REFUSED, NAMED, EITHER, WRONG, NOTHING = "accused", "refused", "named", "either-or", "wrong", "nothing"
INTRODUCTION = """Each log is watched as `gtmbench monitor LOG` does; every eighth then with one fault at a time.
*named*: that sensor failed and no other; *either-or*: it is among those that are suspected; *wrong*: a healthy sensor
failed, or those that are suspected don't hold the broken one; *clear beside it*: the sensor is clear, while it is off,
up to less than it is off by. Accusations that are there without the fault don't count.
"""
Row = dict[str, Any]


class Put(NamedTuple):
    """A fault in a log, and what is said then."""

    part: str
    sensor: str
    kind: str
    size: float
    onset_s: float
    said: Monitored


class Log(NamedTuple):
    """A log that was watched, what its monitor heard, and what is drawn."""

    whole: Whole
    heard: Monitored
    told: Monitored
    draw: np.random.Generator

    @property
    def opened(self) -> Opened:
        """What was read of it."""
        return self.whole.learnt.opened

    def onset_s(self) -> float:
        """Return when a fault begins."""
        start_s, end_s = self.flown_s
        return start_s + float(self.draw.uniform(*BEGINS)) * (end_s - start_s)

    @property
    def flown_s(self) -> tuple[float, float]:
        """From when to when it flies."""
        return (0.0, 0.0) if self.opened.flight is None else self.opened.flight.flown_s

    def judged(self, opened: Opened) -> Monitored:
        """Return what is said where gyros and attitude are judged anew, and its monitor hears the same."""
        return doubted(replace(self.heard, learnt=replace(self.heard.learnt, opened=opened)), silent)

    def compared(self, opened: Opened) -> Monitored:
        """Return what is said where other sensors alone read otherwise."""
        said = replace(self.told, learnt=replace(self.told.learnt, opened=opened))
        return replace(said, course=course_of(said, said.judged))


def gyro_fault(kind: str, channel: str, onset_s: float, size: float) -> gb.Fault:
    """Return a fault of a gyro."""
    at: dict[str, Any] = {"channel": channel, "onset_s": onset_s}
    if kind in ("bias", "drift", "noise", "scale"):
        name = {"bias": "size", "drift": "slope", "noise": "deviation", "scale": "factor"}[kind]
        made = {"bias": gb.Bias, "drift": gb.Drift, "noise": gb.Noise, "scale": gb.ScaleFactor}[kind]
        return made(**at, **{name: abs(size) if kind == "noise" else size})
    return gb.SignFlip(**at) if kind == "sign" else gb.Jam(**at)


def of_imus(log: Log) -> Iterator[Put]:
    """Break gyros of further IMUs: every kind once, in turn."""
    opened, draw = log.opened, log.draw
    names = list(opened.imus)
    for number, kind in enumerate(IMU_KINDS if names else ()):
        name, axis, onset_s = names[number % len(names)], int(draw.integers(len(GYROS))), log.onset_s()
        size = float(np.exp(draw.uniform(*np.log(SIZES_DEG_S)))) * float(draw.choice([-1.0, 1.0]))
        size = float(draw.choice(FACTORS)) if kind == "scale" else size / SLOWER_S if kind == "drift" else size
        own = list(opened.imus[name])
        own[axis] = broken(own[axis], gyro_fault(kind, "p", onset_s, size))
        imus = {**opened.imus, name: own}
        assert opened.flight is not None
        changed = replace(opened, imus=imus, flight=with_imus(opened.flight, imus), judged=None)
        yield Put("IMU", gyro_of(GYROS[axis], name), kind, size, onset_s, log.judged(changed))


def of_others(log: Log) -> Iterator[Put]:
    """Break other sensors: two kinds a channel, of an airspeed all."""
    opened, draw, course = log.opened, log.draw, log.told.course
    readings = opened.readings
    for channels in ONE_OF:
        there = [name for name in channels if name in readings and course and names_of(name)[-1] in course.compared]
        onset_s = min(log.onset_s(), log.flown_s[1] - LEFT_S)
        if course is None or not there or onset_s < log.flown_s[0]:
            continue
        channel = str(draw.choice(there))
        unit = course.course.strength if channel in MAGNETOMETER else 1.0
        size = unit * SIZES.get(channel, SIZES["gps_north"] if channel in GPS_VELOCITY else 0.2)
        size *= float(draw.choice([-1.0, 1.0]))
        put = list(faults(readings[channel], channel, size, onset_s, readings.get("altitude")))
        for number in sorted(draw.permutation(4)[:OTHER_DRAWS] if channel != "tas" else range(len(put))):
            kind, read = put[number]
            changed = replace(opened, readings={**readings, channel: read})
            yield Put("other", channel, kind, size, onset_s, log.compared(with_velocity(changed)))


def with_velocity(opened: Opened) -> Opened:
    """Return a log whose GPS reads what its channels do: a GPS shows some faults by itself."""
    if not {*GPS_VELOCITY} <= opened.readings.keys():
        return opened
    velocity = np.column_stack([opened.readings[name][1] for name in GPS_VELOCITY])
    sensors = (replace(each, values=velocity) if each.channels == GPS_VELOCITY else each for each in opened.sensors)
    return replace(opened, sensors=tuple(sensors))


def of_places(log: Log) -> Iterator[Put]:
    """Break a GPS's place."""
    for gps in log.opened.sensors if log.told.course else ():
        if gps.places is None:
            continue
        for kind in ("bias", "drift to it", "stuck", "noise"):
            size, onset_s = PLACE_M * float(log.draw.choice([-1.0, 1.0])), log.onset_s()
            at: dict[str, Any] = {"channel": "north", "onset_s": onset_s}
            fault: gb.Fault = gb.Jam(**at) if kind == "stuck" else gb.Noise(**at, deviation=PLACE_M)
            if kind in ("bias", "drift to it"):
                fault = gb.Bias(**at, size=size, ramp_s=RAMP_S * (kind == "drift to it"))
            axes = range(2) if kind == "stuck" else range(1)
            places = gps.places.copy()
            for axis in axes:
                places[:, axis] = broken(Samples(gps.time_s, places[:, axis]), fault)[1]
            sensors = tuple(replace(each, places=places) if each is gps else each for each in log.opened.sensors)
            yield Put("place", "gps", kind, size, onset_s, log.compared(replace(log.opened, sensors=sensors)))


def of_gyros(log: Log) -> Iterator[Put]:
    """Break gyros, alone or through an estimator, and one angle."""
    draw = log.draw
    for kind in (*draw.permutation([*GYRO_FAULTS])[:GYRO_DRAWS], "angle"):
        onset_s, follows = log.onset_s(), bool(draw.integers(2)) and kind != "angle"
        channel = str(draw.choice(ATTITUDE if kind == "angle" else GYROS))
        size = ANGLE_DEG if kind == "angle" else float(draw.choice(GYRO_FAULTS[kind] or (0.0,)))
        kind = str(draw.choice(["bias", "stuck"])) if kind == "angle" else str(kind)
        size *= float(draw.choice([-1.0, 1.0])) if kind in ("bias", "drift") else 1.0
        fault = gyro_fault(kind, channel, onset_s, size)
        try:
            opened = broken_log(log.opened, fault, ESTIMATOR if follows else None)
        except InputError:  # bent beyond Euler angles
            continue
        said = doubted(listened(replace(log.whole.learnt, opened=opened), silent), silent)
        part = "angle" if channel in ATTITUDE else "gyro, 5 s" if follows else "gyro, alone"
        yield Put(part, channel, kind, size, onset_s, said)


def accused(timeline: Timeline) -> dict[str, tuple[State, tuple[str, ...]]]:
    """Return which rows failed, or are suspected, and with whom."""
    return {
        sensor: (span.state, span.suspects)
        for sensor in timeline.sensors
        for span in timeline.of(sensor, State.SUSPECTED, State.FAILED)
    }


def said_of(put: Put, row: str, timeline: Timeline, before: Sequence[str]) -> str:
    """Sum up what is said of a fault."""
    new = {sensor: told for sensor, told in accused(timeline).items() if sensor not in before}
    failed = {sensor for sensor, (state, _) in new.items() if state is State.FAILED}
    if failed - {row} or any(not {row, names_of(put.sensor)[-1]} & {*whom} for _, whom in new.values() if whom):
        return WRONG
    return NAMED if failed else EITHER if new else NOTHING


def is_beside_clear(put: Put, row: str, timeline: Timeline) -> bool:
    """Tell whether a sensor is clear while it is off, for a fault that would have shown."""
    for span in timeline.of(row, State.CLEAR):
        start_s, sizes = max(span.start_s, put.onset_s + RAMP_S * (put.kind == "drift to it")), span.sizes
        if sizes is None or span.end_s - start_s < SHOWS_S:
            continue
        factor = {"scale": put.size, "sign": -1.0, "stuck": 0.0}.get(put.kind)
        known = sizes.factors if row.partition(" ")[0] in GYROS else None
        if factor is not None and known is not None and not known[0] < factor < known[1]:
            return True
        off = abs(put.size) * (span.end_s - put.onset_s if put.kind == "drift" else 1.0)
        if put.kind in ("bias", "drift", "drift to it") and put.part != "place" and sizes.error < off:
            return True
        if put.kind == "noise" and put.part != "place" and sizes.noise is not None and sizes.noise < off:
            return True
    return False


def cases(path: Path) -> list[Row]:
    """Return what is said of a log, as it is and with each fault; an error's row where it can't be watched."""
    try:
        whole = watch_whole(path)
    except gb.GtmbenchError as error:
        return [{"log": path.name, "part": "", "said": REFUSED, "told": str(error)[:LONGEST]}]
    timeline = whole.watched.timeline
    before = list(accused(timeline))
    minutes = sum(len(each) for each in whole.watched.log.segments) * whole.watched.log.sample_period_s / 60.0
    about = {"exit": int(whole.watched.outcome), "cpu_s": whole.cpu_s, "minutes": minutes}
    told = verdict_text(whole.watched) if before else ""
    rows: list[Row] = [{"log": path.name, "part": "", "said": ACCUSED if before else "", "told": told, **about}]
    heard = listened(whole.learnt, silent)
    log = Log(whole, heard, doubted(heard, silent), np.random.default_rng(zlib.crc32(path.name.encode())))
    start_s, end_s = log.flown_s
    if end_s - start_s < 2.0 * LEAST_S or zlib.crc32(path.name.encode()) % BROKEN:
        return rows
    for put in (each for parts in (of_imus, of_others, of_places, of_gyros) for each in parts(log)):
        row = put.sensor if put.sensor in timeline.sensors else names_of(put.sensor)[-1]
        if end_s - put.onset_s >= LEAST_S and row not in before:
            watched = concluded(put.said)
            rows.append(
                {
                    "log": path.name,
                    "part": put.part,
                    "sensor": put.sensor,
                    "fault": put.kind,
                    "size": put.size,
                    "onset_s": put.onset_s,
                    "said": said_of(put, row, watched.timeline, before),
                    "clear": is_beside_clear(put, row, watched.timeline),
                    "exit": int(watched.outcome),
                }
            )
    return rows


def report(rows: pd.DataFrame) -> list[str]:
    """Return tables of one group of logs."""
    logs, put = rows[rows["part"] == ""], rows[rows["part"] != ""]
    exits = ", ".join(f"{(logs['exit'] == outcome).sum()} end with {int(outcome)}" for outcome in Outcome)
    blamed = logs[logs["said"] == ACCUSED]
    by = [
        {"in": part, "sensor": sensor, "fault": fault, "put": len(of)}
        | {said: int((of["said"] == said).sum()) for said in (NAMED, EITHER, WRONG, NOTHING)}
        | {"clear beside it": int(of["clear"].sum())}
        for (part, sensor, fault), of in put.assign(
            sensor=put["sensor"].where(put["part"] == "other", "") if len(put) else []
        ).groupby(["part", "sensor", "fault"], sort=True)
    ]
    return [
        f"{len(logs)} logs, {(logs['said'] == REFUSED).sum()} refused; {exits}; {len(blamed)} accuse a sensor. CPU of "
        f"verdicts {logs['cpu_s'].sum():.0f} s in {logs['minutes'].sum():.0f} minutes.",
        markdown(blamed[["log", "told"]].assign(told=blamed["told"].str[:LONGEST])) if len(blamed) else "",
        markdown(pd.DataFrame(by)) if by else "",
    ]


def main() -> int:
    """Watch, sum up, write."""
    head, out = (
        ["# Logs, and faults in any sensor, by the default verdict", INTRODUCTION],
        Path("experiments/reports/verdicts_in_logs"),
    )
    everything = studied_groups(__doc__, head, out, cases=cases, synthetic=synthetic, report=report)
    return int((everything["said"] == WRONG).any())


if __name__ == "__main__":
    sys.exit(main())
