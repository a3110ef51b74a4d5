"""Logs: which of the sensors that no gyro enters are accused, found, named and cleared by the engine.

    python experiments/other_sensors_in_logs.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Watches every log below the folders by `gtmbench monitor`'s detector auto as it is, and with one fault at a time of one
channel of GPS velocity, accelerometers, airspeed, vanes, pressure altitude or magnetometer: of issue 66's sizes, at a
time that is drawn. It is put into the readings; the attitude stays as it was logged, although an estimator would have
followed some of them. Prints tables, writes report.md and cases.csv into DIR, and ends with code 1 where a sensor is
named that is healthy, or a broken one is clear up to less than it is off. No log is kept. With --synthetic the same of
flights of the GTM by their seeds, written as tables.
"""

from __future__ import annotations

import sys
import time
import zlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.engine.course.judged import CourseJudged
from gtmbench.engine.samples import Samples
from gtmbench.log.judging.monitored import Monitored, course_of
from gtmbench.report.markup import markdown
from gtmbench.values.channels import ACCELEROMETERS, FT_S_PER_KT, G_M_S2, M_PER_FT, MAGNETOMETER, names_of
from gtmbench.verdict.timeline import SensorSpan, State, laid_out
from recorded.groups import studied_groups
from recorded.whole import watch_whole

BEGINS, LEFT_S = (0.3, 0.75), 45.0  # shares of a flight between which faults begin; what has to be left then
WITHIN_S, RAMP_S = 30.0, 20.0  # behind an onset; over which an error grows
FLOWN_S = 240.0  # of synthetic flights
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence", "dissertation")
INTRODUCTION = """*accused*: sensors that failed, or are suspected, in a log as it is; *clear*: for which share of what
is flown, of those that anything compares. Each fault is put into one channel of one log. *named*: that sensor failed
within 30 s, and no other; *either-or*: it is one of two that are suspected by then; *late*: later; *wrong*: another one
failed, too or instead; *beside a clear row*: the sensor is clear while it is off by more than is stated.
"""
# the least error that our users ask for, in the channel's unit, of a magnetometer as a share of the field
SIZES: Mapping[str, float] = (
    {"tas": 10.0, "alpha": 3.0, "beta": 3.0, "altitude": 100.0}
    | dict.fromkeys(ACCELEROMETERS, 0.2)
    | dict.fromkeys(("gps_north", "gps_down"), 3.0)
    | dict.fromkeys(("mag_x", "mag_z"), 0.2)
)
ACCUSED, QUIET, NAMED, EITHER, LATE, WRONG, MISSED = (
    "accused",
    "quiet",
    "named",
    "either-or",
    "late",
    "wrong",
    "not accused",
)
Row = dict[str, Any]


def faults(
    samples: Samples, channel: str, size: float, onset_s: float, heights: Samples | None
) -> Iterator[tuple[str, Samples]]:
    """Give what a channel reads with each fault; `heights` is the altitude, in ft."""
    at: dict[str, Any] = {"channel": channel, "onset_s": onset_s}
    yield "bias", broken(samples, gb.Bias(**at, size=size))
    yield "drift to it", broken(samples, gb.Bias(**at, size=size, ramp_s=RAMP_S))
    yield "stuck", broken(samples, gb.Jam(**at))
    yield "noise", broken(samples, gb.Noise(**at, deviation=abs(size)))
    if channel == "tas" and heights is not None:
        yield "blocked tube", blocked(samples, onset_s, heights)


def broken(samples: Samples, fault: gb.Fault) -> Samples:
    """Return a channel's readings with a fault."""
    time_s, read = samples
    return Samples(time_s, fault.broken(read[:, np.newaxis], time_s, samples.step_s))


def blocked(samples: Samples, onset_s: float, heights: Samples) -> Samples:
    """Return what an airspeed reads by a tube that is blocked, v^2 = v0^2 + 2 g (h - h0): it follows the altitude."""
    time_s, read = samples
    knot, first = FT_S_PER_KT * M_PER_FT, int(np.searchsorted(time_s, onset_s))
    height = M_PER_FT * np.interp(time_s, *heights)
    square = (knot * read[first]) ** 2 + 2.0 * G_M_S2 * (height - height[first])
    return Samples(time_s, np.where(time_s >= onset_s, np.sqrt(np.maximum(square, 0.0)) / knot, read))


def cases(path: Path) -> list[Row]:
    """Return what is said of a log, as it is and with each fault; an error's row where it can't be watched."""
    try:
        whole = watch_whole(path)
    except gb.GtmbenchError as error:
        return [{"log": path.name, "sensor": "", "fault": "", "said": "refused", "told": str(error)[:120]}]
    told, clean = whole.said, whole.said.course
    if clean is None:
        return [
            {"log": path.name, "sensor": "", "fault": "", "said": "not compared", "told": whole.watched.reasons[:1]}
        ]
    began = time.process_time()
    course_of(told, told.judged)
    costs = {"log_s": whole.cpu_s, "sensors_s": time.process_time() - began}
    start_s, end_s = clean.course.flight.flown_s
    costs["flown_s"] = end_s - start_s
    before = {sensor for sensor, _, _ in accused(clean)}
    rows: list[Row] = [
        {
            "log": path.name,
            "sensor": sensor,
            "fault": "",
            "said": ACCUSED if sensor in before else QUIET,
            "clear_s": sum(span.duration_s for span in clear_of(clean, sensor)),
            **costs,
        }
        for sensor in clean.compared
    ]
    return rows if end_s - start_s < 2.0 * LEFT_S else [*rows, *put_into(path, told, before)]


def put_into(path: Path, told: Monitored, before: set[str], left_out: Collection[str] = ()) -> Iterator[Row]:
    """Break each channel of a log that compares it, but for some kinds; what was accused before doesn't count."""
    clean, readings = told.course, told.learnt.opened.readings
    assert clean is not None
    draw = np.random.default_rng(zlib.crc32(path.name.encode()))
    start_s, end_s = clean.course.flight.flown_s
    for channel, size in SIZES.items():
        sensor = names_of(channel)[-1]
        if channel not in readings or sensor not in clean.compared or sensor in before:
            continue
        unit = clean.course.strength if channel in MAGNETOMETER else 1.0
        onset_s = start_s + float(draw.uniform(*BEGINS)) * (end_s - start_s)
        onset_s = min(onset_s, end_s - LEFT_S)
        off = unit * size * float(draw.choice([-1.0, 1.0]))
        for name, read in faults(readings[channel], channel, off, onset_s, readings.get("altitude")):
            if name in left_out:
                continue
            found = course_of(with_readings(told, channel, read), told.judged)
            assert found is not None
            said = said_of(found, sensor, onset_s, before)
            off_s = onset_s + RAMP_S * (name == "drift to it")
            is_clear = name in ("bias", "drift to it") and any(
                span.end_s > off_s + 1.0 and span.sizes is not None and span.sizes.error < abs(off)
                for span in clear_of(found, sensor)
            )
            yield {"log": path.name, "sensor": channel, "fault": name, "said": said, "beside_clear": is_clear}


def said_of(found: CourseJudged, sensor: str, onset_s: float, before: set[str]) -> str:
    """Sum up what is said of a log in which one sensor is broken."""
    claims = [each for each in accused(found) if each[0] not in before]
    who = {name for name, _, _ in claims}
    if any(state is State.FAILED and name != sensor for name, state, _ in claims) or (who and sensor not in who):
        return WRONG
    if sensor not in who or len(who) > 2:
        return MISSED
    if min(time_s for name, _, time_s in claims if name == sensor) > onset_s + WITHIN_S:
        return LATE
    return NAMED if {state for _, state, _ in claims} == {State.FAILED} else EITHER


def with_readings(told: Monitored, channel: str, samples: Samples) -> Monitored:
    """Return what was said of a log, one of whose channels reads otherwise."""
    opened = told.learnt.opened
    readings = {**opened.readings, channel: samples}
    return replace(told, learnt=replace(told.learnt, opened=replace(opened, readings=readings)))


def clear_of(course: CourseJudged, sensor: str) -> tuple[SensorSpan, ...]:
    """Return where a sensor is clear."""
    span_s = course.course.flight.flown_s
    claims = [span for name, span in course.claims if names_of(name)[-1] == sensor]
    return laid_out(span_s, {sensor: claims}).of(sensor, State.CLEAR)


def accused(course: CourseJudged) -> list[tuple[str, State, float]]:
    """Return which sensors failed or are suspected, and when that is known."""
    return [
        (names_of(sensor)[-1], span.state, span.judgement.time_s)
        for sensor, span in (*course.standing, *course.accused)
        if span.judgement is not None
    ]


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
    known = clean[clean["sensor"] != ""]
    words = (NAMED, EITHER, LATE, WRONG, MISSED)
    sums = [
        {
            "sensor": sensor,
            "logs": of["log"].nunique(),
            "accused": int((of["said"] == ACCUSED).sum()),
            "clear": f"{of['clear_s'].sum() / max(of['flown_s'].sum(), 1.0):.0%}",
        }
        for sensor, of in known.groupby("sensor", sort=False)
    ]
    by = [
        {"channel": channel, "fault": fault, "put": len(of)}
        | {word: int((of["said"] == word).sum()) for word in words}
        | {"beside a clear row": int(of["beside_clear"].sum())}
        for (channel, fault), of in put.groupby(["sensor", "fault"], sort=False)
    ]
    costs = known.drop_duplicates("log")
    total = ", ".join(f"{(put['said'] == word).sum()} {word}" for word in words)
    minutes = costs["flown_s"].sum() / 60.0
    return [
        f"{rows['log'].nunique()} logs, {(clean['said'] == 'refused').sum()} refused; of {len(put)} faults {total}.",
        f"CPU of whole verdicts {costs['log_s'].sum():.1f} s, of other sensors {costs['sensors_s'].sum():.1f} s, in "
        f"{minutes:.1f} minutes of flight.",
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
    is_clear = "beside_clear" in everything and bool(everything["beside_clear"].fillna(False).any())
    return int(is_clear or everything["said"].isin([ACCUSED, WRONG]).any())


if __name__ == "__main__":
    sys.exit(main())
