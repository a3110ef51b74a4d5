"""Recorded flights: which of the sensors that no gyro enters are watched, accused, found and named when they fail.

    python experiments/other_sensors_in_logs.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Watches every log below the folders by `gtmbench monitor`'s detector auto as it is, and with one fault at a time of a
sensor that is watched in it: magnetometer, GPS velocity, accelerometers, airspeed or pressure altitude. A fault begins
a third of the way from the end of what was learnt to the end of the flight, and lasts. It is put into the readings;
the attitude stays as it was logged, although an estimator would have followed some of them. Prints tables, writes
report.md and cases.csv into DIR, and ends with code 1 where a sensor is named that is healthy. No log is kept. With
--synthetic the same of flights of the GTM by their seeds, written as tables.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import cross_check
import gtmbench as gb
from gtmbench.detectors.crosscheck.relations import ACCEL, ALTITUDE, GPS, MAG, TAS
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.other_sensors import WatchedSensor, kind_of
from gtmbench.study.log.watched import sensors_of
from recorded.groups import studied_groups
from recorded.whole import watch_whole

SHARE, LEFT_S = 0.33, 15.0  # of what is left goes by before a fault; what has to be left then
FLOWN_S = 300.0  # of synthetic flights
INTRODUCTION = """*as it is*: logs without a fault put into them; *accused*: sensors that fail by the verdict there. Each fault is
put into one sensor of one log. *right*: that sensor fails by the verdict, and no other. *open*: an alarm since the
onset that may be about it. *missed*: none. *wrong*: another sensor fails by the verdict, too or instead. Only sensors
that are watched in a log are broken there; the first magnetometer. What fails in a log as it is, doesn't count as
*wrong*. *log seconds* is the CPU time of a whole
verdict, *sensors seconds* what comparing the sensors takes of it.
"""  # noqa: E501
Row = dict[str, Any]


def faults(kind: str, onset_s: float, strength: float) -> Iterator[tuple[str, gb.Fault]]:
    """Give the faults of a sensor: on its first channel, of accelerometers also on the vertical one."""
    channel = {MAG: "mag_x", GPS: "gps_north", ACCEL: "nx", TAS: "tas", ALTITUDE: "altitude"}[kind]
    at: dict[str, Any] = {"channel": channel, "onset_s": onset_s}
    if kind == MAG:
        yield "bias 30 % of the field", gb.Bias(**at, size=0.3 * strength)
        yield "drift 2 % a second", gb.Drift(**at, slope=0.02 * strength)
        yield "jam", gb.Jam(**at)
        yield "noise 30 %", gb.Noise(**at, deviation=0.3 * strength)
    elif kind == GPS:
        yield "bias 8 m/s", gb.Bias(**at, size=8.0)
        yield "drift 2 m/s²", gb.Drift(**at, slope=2.0)
        yield "vertical drift 2 m/s²", gb.Drift(channel="gps_down", onset_s=onset_s, slope=-2.0)
        yield "noise 4 m/s", gb.Noise(**at, deviation=4.0)
    elif kind == ACCEL:
        yield "bias 0.5 g", gb.Bias(**at, size=0.5)
        yield "vertical bias 0.5 g", gb.Bias(channel="nz", onset_s=onset_s, size=-0.5)
        yield "jam at 4 g", gb.Hardover(channel="nz", onset_s=onset_s, limit=4.0)
        yield "vertical scale 0.5", gb.ScaleFactor(channel="nz", onset_s=onset_s, factor=0.5)
    elif kind == TAS:
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
    told = whole.said
    began = time.process_time()
    clean = sensors_of(told)
    sensors_s = time.process_time() - began
    rows = [
        {
            "log": path.name,
            "kind": each.kind,
            "fault": "",
            "said": "not watched" if each.why_not else "accused" if each.failed else "open" if each.alarms else "quiet",
            "told": each.why_not or _told(each),
            "log_s": whole.cpu_s,
            "sensors_s": sensors_s,
            "outcome": whole.watched.outcome.name,
        }
        for each in clean
    ]
    if not any(not each.why_not for each in clean):
        return rows
    motion, given = told.learnt.opened.own.motion, told.learnt.opened.sensors
    assert motion is not None  # or nothing were watched
    end_s, start_s = motion.segments[-1].end_s, told.learnt.identified_s[-1][1]
    onset_s = start_s + SHARE * (end_s - start_s)
    inside = [each for each in motion.segments if each.start_s < onset_s < each.end_s - LEFT_S]
    if not inside:
        return rows
    done: set[str] = set()
    failing = {place for place, each in enumerate(clean) if each.failed is not None}
    for place, (sensor, of) in enumerate(zip(given, clean, strict=True)):
        kind = kind_of(sensor)
        is_read = np.any((sensor.time_s > onset_s) & (sensor.time_s < onset_s + LEFT_S))
        if of.why_not or kind in done or not is_read or place in failing:
            continue
        done.add(kind)
        strength = float(np.median(np.linalg.norm(sensor.values, axis=1)))
        for name, fault in faults(kind, onset_s, strength):
            put = [*given[:place], broken(sensor, fault), *given[place + 1 :]]
            put_in = replace(told, learnt=replace(told.learnt, opened=replace(told.learnt.opened, sensors=tuple(put))))
            rows.append(
                {"log": path.name, "kind": kind, "fault": name, **_result(sensors_of(put_in), place, failing, onset_s)}
            )
    return rows


def _result(sensors: Sequence[WatchedSensor], place: int, failing: set[int], onset_s: float) -> Row:
    failed = [number for number, each in enumerate(sensors) if each.failed is not None and number not in failing]
    own = sensors[place]
    after = [alarm for alarm in own.alarms if alarm.time_s >= onset_s]
    said = "wrong" if set(failed) - {place} else "right" if failed else "open" if after else "missed"
    told = "; ".join(f"{each.name}: {_told(each)}" for each in sensors if each.alarms)
    why = "" if said in ("right", "wrong") else _why(own, after)
    return {"said": said, "why": why, "told": told[:300], "delay_s": after[0].time_s - onset_s if after else np.inf}


def _why(sensor: WatchedSensor, alarms: Sequence[gb.Alarm]) -> str:
    """Return why a broken sensor isn't named for good."""
    if not alarms:
        return "no comparison goes beyond its bound"
    named = next((alarm for alarm in alarms if alarm.sensor == sensor.kind), None)
    if named is not None:
        return f"named, and doubted: {re.sub(r'[0-9.]+ s', '... s', named.doubt)}"
    return f"left between {' and '.join(alarms[0].candidates)}"


def _told(sensor: WatchedSensor) -> str:
    return ", ".join(f"{a.time_s:.1f} s {a.source} {a.verdict} {a.candidates} {a.doubt}" for a in sensor.alarms[:3])


def synthetic(folder: Path, seeds: range) -> list[Path]:
    """Write flights of the GTM as tables, with the channels of every sensor."""
    paths = []
    for seed in seeds:
        path = folder / f"gtm_{seed}.csv"
        gb.write_log(cross_check.flight(seed, FLOWN_S), path)
        paths.append(path)
    return paths


def report(rows: pd.DataFrame) -> list[str]:
    """Return tables of one group of logs."""
    clean = rows[rows["fault"] == ""]
    known = clean[clean["kind"] != ""]
    sums = [
        {"sensor": kind, "logs": of["log"].nunique(), "sensors": len(of)}
        | {word: int((of["said"] == word).sum()) for word in ("not watched", "quiet", "open", "accused")}
        for kind, of in known.groupby("kind", sort=False)
    ]
    put = rows[rows["fault"] != ""]
    by = [
        {"sensor": kind, "fault": fault, "put": len(of)}
        | {word: int((of["said"] == word).sum()) for word in ("right", "wrong", "open", "missed")}
        for (kind, fault), of in put.groupby(["kind", "fault"], sort=False)
    ]
    total = {word: int((put["said"] == word).sum()) for word in ("right", "wrong", "open", "missed")}
    accused = [f"- {row.log}, {row.kind}: {row.told}" for row in known[known["said"] == "accused"].itertuples()]
    wrong = [f"- {row.log}, {row.fault} of {row.kind}: {row.told}" for row in put[put["said"] == "wrong"].itertuples()]
    whys = [
        {"sensor": kind, "why": why, "faults": len(of)}
        for (kind, why), of in put[put["said"].isin(["open", "missed"])].groupby(["kind", "why"], sort=False)
    ]
    unwatched = [
        {"sensor": kind, "why": f"not compared: {told}", "faults": "-"}
        for (kind, told), _ in known[known["said"] == "not watched"].groupby(["kind", "told"], sort=False)
    ]
    costs = known.drop_duplicates("log")
    return [
        f"{rows['log'].nunique()} logs, {(clean['said'] == 'refused').sum()} refused; of {len(put)} faults {total}.",
        f"Log seconds {costs['log_s'].sum():.1f}, sensors seconds {costs['sensors_s'].sum():.1f}.",
        markdown(pd.DataFrame(sums)),
        "\n".join(accused),
        markdown(pd.DataFrame(by)) if by else "",
        "\n".join(wrong),
        markdown(pd.DataFrame([*whys, *unwatched])) if whys or unwatched else "",
    ]


def main() -> int:
    """Watch, sum up, write."""
    head, out = (
        ["# Sensors that no gyro enters, in recorded flights", INTRODUCTION],
        Path("experiments/reports/other_sensors_in_logs"),
    )
    everything = studied_groups(__doc__, head, out, cases=cases, synthetic=synthetic, report=report)
    return int(everything["said"].isin(["accused", "wrong"]).any())


if __name__ == "__main__":
    sys.exit(main())
