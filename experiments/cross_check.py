"""Sensors that no gyro enters, against each other: which one is named when it fails, and who is accused when none does.

    python experiments/cross_check.py [--only PART ...] [--healthy N] [--quick] [--out DIR] [--jobs N] [--seed N]

Flights of the GTM with an attitude that the gyros drive, a magnetometer (50 Hz, noise 0.5 % of the field, soft iron
3 %, some hard iron), a GPS (5 or 10 Hz, 0.1 to 0.2 s late, noise that wanders), and imperfect gyros, accelerometers and
airspeed, all drawn by the seed. `gb.CrossCheck` learns on the flight's own beginning.

- ``gyros``: 54 faults of gyros beside each of two estimators: named by bank C-filtered, and whom the cross-check names.
- ``sensors``: faults of the other sensors, six kinds each, after 130 s of 240 s.
- ``healthy``: hours without a fault, learnt on 200 s of each flight.
- ``cost``: seconds to watch a flight, beside bank C-filtered's.

Prints tables; writes report.md and cases.csv into DIR. Ends with code 1 where a target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import driven_attitude as driven
import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.jobs.processes import spread
from gtmbench.report.tables.markdown import markdown
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY, GYROS, MAGNETOMETER
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped, share_text

SEED = 42_000  # of the report's flights; others were looked at while the cross-check was made
ESTIMATORS = ("filter 20 s", "kalman")
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence", "dissertation")
ONSET_S, LEARNT_S, LASTS_S = 130.0, 120.0, 240.0
HEALTHY_S, HEALTHY_LEARNT_S = 1280.0, 200.0
FLIGHTS = {"gyros": 2, "sensors": 10, "healthy": 100, "cost": 1}
SENSORS = {
    "magnetometer": MAGNETOMETER,
    "gps": GPS_VELOCITY,
    "tas": ("tas",),
    "accelerometers": ACCELEROMETERS,
    "altitude": ("altitude",),
}
Row = dict[str, Any]


class Task(NamedTuple):
    """What is done: a part, a flight's seed, and of gyros the estimator, the gyro and the fault's name."""

    part: str
    seed: int
    estimator: str = ""
    gyro: str = ""
    fault: str = ""


# ---- flights


def flight(seed: int, duration_s: float = LASTS_S, estimator: str = "filter 20 s") -> gb.Record:
    """Return what is logged of a healthy flight."""
    drawn = np.random.default_rng([seed, 99])
    truth = gb.fly("gtm", EXCITATIONS[seed % 3], duration_s, seed)
    sensed = gb.measure(truth, noise="t2", seed=seed)
    for name in ACCELEROMETERS:
        sensed = sensed.replace(name, sensed[name] + 0.01 * drawn.standard_normal())
    sensed = sensed.replace("tas", sensed["tas"] * (1.0 + 0.02 * drawn.standard_normal()))
    sensed = gb.imperfect(sensed, gb.Imperfections(bias=0.05, wander=0.002), seed=seed)
    return beside(estimated_attitude(sensed, truth, estimator, seed), truth, seed, drawn)


def beside(readings: gb.Record, truth: gb.Record, seed: int, drawn: np.random.Generator) -> gb.Record:
    """Return readings with a magnetometer and a GPS."""
    hard_x, hard_y, hard_z = drawn.normal(0.0, 1.5, 3)
    magnetometer = gb.Magnetometer(
        inclination_deg=drawn.uniform(40.0, 75.0),
        declination_deg=drawn.uniform(-20.0, 20.0),
        hard_iron_ut=(float(hard_x), float(hard_y), float(hard_z)),
    )
    gps = gb.Gps(rate_hz=float(drawn.choice([5.0, 10.0])), delay_s=drawn.uniform(0.1, 0.2))
    return gb.with_gps(gb.with_magnetometer(readings, truth, magnetometer, seed=seed), truth, gps, seed=seed)


def broken(task: Task) -> gb.Record:
    """Return what is logged where a gyro breaks at 100 s, or nothing does."""
    truth = gb.fly("gtm", driven.EXCITATIONS[task.seed % 2], driven.LASTS_S, task.seed)
    sensed = gb.measure(truth, noise="t2", seed=task.seed)
    if task.fault:
        sensed = gb.inject(sensed, driven.FAULTS[task.fault](task.gyro))
    while True:
        try:
            estimated = estimated_attitude(sensed, truth, task.estimator, task.seed)
        except gb.InputError:  # bent beyond Euler angles: the log ends before
            sensed, truth = (each.between(each.start_s, each.end_s - 5.0) for each in (sensed, truth))
        else:
            return beside(estimated, truth, task.seed, np.random.default_rng([task.seed, 5]))


def faults(channel: str, sensor: str, sign: float) -> dict[str, gb.Fault]:
    """Return the six faults of a sensor, on one of its channels."""
    at: dict[str, Any] = {"channel": channel, "onset_s": ONSET_S}
    size, slope, factor, noise = {
        "magnetometer": (10.0, 0.5, 0.7, 3.0),  # microtesla
        "gps": (5.0, 1.0, 0.7, 2.0),  # m/s
        "tas": (20.0, 1.0, 0.7, 3.0),  # kt
        "accelerometers": (0.2, 0.02, 0.7, 0.1),  # g
        "altitude": (100.0, 20.0, 0.9, 20.0),  # ft
    }[sensor]
    scaled = "nz" if sensor == "accelerometers" else channel  # the others are near zero, and so is what scales them
    last: dict[str, gb.Fault] = {
        "magnetometer": {"sign flip": gb.SignFlip(**at)},
        "gps": {"sign flip": gb.SignFlip(**at)},
        "tas": {"reads 0": gb.Stuck(**at, value=0.0)},
        "accelerometers": {"hardover": gb.Hardover(**at, limit=4.0 * sign)},
        "altitude": {"reads 0": gb.Stuck(**at, value=0.0)},
    }[sensor]
    return {
        "bias": gb.Bias(**at, size=size * sign),
        "drift": gb.Drift(**at, slope=slope * sign),
        "jam": gb.Jam(**at),
        "scale": gb.ScaleFactor(channel=scaled, onset_s=ONSET_S, factor=factor),
        "noise": gb.Noise(**at, deviation=noise),
        **last,
    }


# ---- what is said


def said(alarms: Sequence[gb.Alarm], sensor: str, onset_s: float) -> Row:
    """Return what alarms since the onset say of a broken sensor."""
    after = [alarm for alarm in alarms if alarm.time_s >= onset_s]
    names = {alarm.sensor for alarm in after if alarm.sensor}
    told = "missed" if not after else "wrong" if names - {sensor} else "right" if names else "open"
    first = after[0] if after else None
    return {
        "said": told,
        "names": " ".join(sorted(names)),
        "candidates": " ".join(first.candidates) if first else "",
        "delay_s": first.time_s - onset_s if first else np.inf,
        "before": sum(alarm.time_s < onset_s for alarm in alarms),
    }


@cache
def learnt_on(seed: int, estimator: str) -> gb.CrossCheckMonitor:
    """Return the cross-check of a flight's first 90 s."""
    return gb.CrossCheck().calibrate([broken(Task("gyros", seed, estimator)).between(0.0, 90.0)])


def gyros(task: Task) -> Iterator[Row]:
    """Watch a broken gyro by bank C-filtered and by the cross-check."""
    record = broken(task)
    by_bank = said(driven.monitor(task.estimator).watch(record).alarms, task.gyro, driven.ONSET_S)
    crossed = said(learnt_on(task.seed, task.estimator).watch(record).alarms, task.gyro, driven.ONSET_S)
    told = "wrong" if crossed["names"] else by_bank["said"]
    kept = {"crossed": crossed["said"], "accused": crossed["names"], "crossed_delay_s": crossed["delay_s"]}
    yield {**by_bank, **kept, "said": told}


def sensors(task: Task) -> Iterator[Row]:
    """Break each sensor of a flight in six ways, and watch each."""
    record = flight(task.seed)
    monitor = gb.CrossCheck().calibrate([record.between(0.0, LEARNT_S)])
    drawn = np.random.default_rng(task.seed)
    for sensor, channels in SENSORS.items():
        channel, sign = channels[int(drawn.integers(len(channels)))], float(drawn.choice([-1.0, 1.0]))
        for name, fault in faults(channel, sensor, sign).items():
            row = said(monitor.watch(gb.inject(record, fault)).alarms, sensor, ONSET_S)
            yield {"sensor": sensor, "channel": fault.channel, "kind": name, **row}


def healthy(task: Task) -> Iterator[Row]:
    """Watch a flight without a fault."""
    try:
        record = flight(task.seed, HEALTHY_S, ESTIMATORS[task.seed % 2])
    except gb.GtmbenchError as error:  # it left its envelope
        yield {"hours": 0.0, "alarms": 0, "refused": str(error)[:80]}
        return
    monitor = gb.CrossCheck().calibrate([record.between(0.0, HEALTHY_LEARNT_S)])
    alarms = monitor.watch(record).alarms
    texts = "; ".join(f"{alarm.time_s:.1f} s {alarm.source}: {alarm.verdict}" for alarm in alarms)
    yield {"hours": (HEALTHY_S - HEALTHY_LEARNT_S) / 3600.0, "alarms": len(alarms), "refused": "", "told": texts}


def cost(task: Task) -> Iterator[Row]:
    """Time the watching of a healthy flight."""
    record = flight(task.seed, 500.0)
    bank = driven.monitor("filter 20 s")
    crossed = gb.CrossCheck().calibrate([record.between(0.0, LEARNT_S)])
    for name, monitor in (("C-filtered", bank), ("cross-check", crossed)):
        seconds = []
        for _ in range(3):
            began = time.process_time()
            monitor.watch(record)
            seconds.append(time.process_time() - began)
        yield {"monitor": name, "cpu_s": min(seconds)}


PARTS: dict[str, Callable[[Task], Iterator[Row]]] = {
    "gyros": gyros,
    "sensors": sensors,
    "healthy": healthy,
    "cost": cost,
}


def done(task: Task) -> list[Row]:
    """Do a task."""
    return [{**task._asdict(), **row} for row in PARTS[task.part](task)]


# ---- the report


INTRODUCTION = """Flights of the GTM, attitudes that the gyros drive (filter of 20 s, Kalman filter with bias states),
magnetometer (50 Hz, noise 0.5 %, soft iron 3 %), GPS (5 or 10 Hz, 0.1 to 0.2 s late). The flights' seeds were not
looked at while the cross-check was made. The cross-check learns on the beginning of the flight that it watches.

- *right*: the broken sensor is named, and no other one ever. *wrong*: another one is. *open*: an alarm that names
  nobody, because several sensors, the attitude or the wind explain it. *missed*: no alarm.
- `gyros`: nine faults of each gyro on two flights, beside each estimator; *right* by bank C-filtered, calibrated on 12
  flights. The cross-check names no gyro: *accused* are the sensors that it names although a gyro is broken.
- `sensors`: biases, drifts, jams, scale factors, noise and one more kind of each sensor; axis and sign by the seed.
"""


def tasks(seed: int, only: Sequence[str], quick: bool, flights: Mapping[str, int] = FLIGHTS) -> list[Task]:
    """Return what is done, flights of different parts apart."""
    todo = []
    for place, part in enumerate(PARTS):
        first = seed + 1000 * place
        for flown in range(first, first + (1 if quick else flights[part])):
            if part != "gyros":
                todo.append(Task(part, flown))
                continue
            names = list(driven.FAULTS)[:2] if quick else list(driven.FAULTS)
            todo += [
                Task(part, flown, estimator, gyro, fault)
                for estimator in ESTIMATORS[: 1 if quick else None]
                for gyro in (GYROS[:1] if quick else GYROS)
                for fault in names
            ]
    return [task for task in todo if task.part in (only or PARTS)]


def conduct(campaign: Campaign) -> Findings:
    """Watch, count, report."""
    flights = {**FLIGHTS, "healthy": campaign.given.healthy}
    todo = tasks(campaign.given.seed, campaign.given.only, campaign.quick, flights)
    results = spread(done, todo, processes=campaign.jobs, step="flights", progress=campaign.tell)
    rows = pd.DataFrame([row for each in results for row in each])
    text = ["# Sensors that no gyro enters, against each other", INTRODUCTION]
    missed = False
    for part, own in rows.groupby("part", sort=False):
        targets, tables = OF[str(part)](own)
        missed |= any(each["reached"] == "MISSED" for each in targets)
        text += [f"## {part}", markdown(pd.DataFrame(targets)), *tables]
    return Findings("\n\n".join(text) + "\n", missed, lambda out: rows.to_csv(out / "cases.csv", index=False))


_SAID = ("right", "wrong", "open", "missed")


def counts(words: Sequence[str]) -> dict[str, Callable[[pd.DataFrame], object]]:
    """Return cells that count what was said."""
    return {"faults": len} | {word: lambda of, word=word: int((of["said"] == word).sum()) for word in words}


def of_gyros(rows: pd.DataFrame) -> tuple[list[Row], list[str]]:
    """Return targets and tables of gyros' faults."""
    targets = []
    for estimator, of in rows.groupby("estimator"):
        right, wrong = (int((of["said"] == word).sum()) for word in ("right", "wrong"))
        targets.append(target(f"right: {estimator}", share_text(right, len(of)), "85 %", right >= 0.85 * len(of)))
        targets.append(target(f"wrong: {estimator}", share_text(wrong, len(of)), "1 %", wrong <= 0.01 * len(of)))
    accused = int((rows["accused"] != "").sum())
    targets.append(target("other sensors accused by the cross-check", str(accused), "0", accused == 0))
    words = ("right", "wrong", "either-or", "open", "missed")
    crossed = {
        f"cross-check: {word}": lambda of, word=word: int((of["crossed"] == word).sum()) for word in ("open", "missed")
    }
    by = [{"estimator": "estimator"}, {"fault": "fault"}]
    return targets, [markdown(grouped(rows, each, {**counts(words), **crossed})) for each in by]


def of_sensors(rows: pd.DataFrame) -> tuple[list[Row], list[str]]:
    """Return targets and tables of other sensors' faults."""
    total = len(rows)
    found, right, wrong = (
        int(which.sum()) for which in (rows["said"] != "missed", rows["said"] == "right", rows["said"] == "wrong")
    )
    gyro = int(rows["names"].isin(GYROS).sum())
    targets = [
        target("found", share_text(found, total), "90 %", found >= 0.9 * total),
        target("right", share_text(right, total), "85 %", right >= 0.85 * total),
        target("wrong", share_text(wrong, total), "0", not wrong),
        target("a gyro accused", str(gyro), "0", not gyro),
        target("alarms before the onset", str(int(rows["before"].sum())), "0", not rows["before"].any()),
    ]
    delays = {"median delay (s)": lambda of: f"{of['delay_s'].median():.1f}"}
    by = [{"sensor": "sensor"}, {"sensor": "sensor", "kind": "kind"}]
    open_ones = grouped(rows[rows["said"] == "open"], {"sensor": "sensor", "candidates": "candidates"}, {"open": len})
    return targets, [*(markdown(grouped(rows, each, {**counts(_SAID), **delays})) for each in by), markdown(open_ones)]


def of_healthy(rows: pd.DataFrame) -> tuple[list[Row], list[str]]:
    """Return targets of healthy flights, and what was said nevertheless."""
    hours, alarms = float(rows["hours"].sum()), int(rows["alarms"].sum())
    told = [f"- seed {row.seed}: {row.told}" for row in rows[rows["alarms"] > 0].itertuples()]
    left_out = int((rows["refused"] != "").sum())
    notes = [f"{left_out} flights left the range of the model, and don't count."] if left_out else []
    named = sum("failed" in line for line in told)
    return [
        target(f"alarms in {hours:.1f} h", str(alarms), "0", not alarms),
        target("flights with a healthy sensor named", str(named), "0", not named),
    ], [*notes, "\n".join(told)]


def of_cost(rows: pd.DataFrame) -> tuple[list[Row], list[str]]:
    """Return what watching costs beside a bank."""
    by = rows.set_index("monitor")["cpu_s"]
    share = (by["C-filtered"] + by["cross-check"]) / by["C-filtered"]
    text = f"{share:.2f} times ({by['C-filtered']:.2f} s and {by['cross-check']:.2f} s more, of 500 s)"
    return [target("watching, beside bank C-filtered alone", text, "1.5 times", share <= 1.5)], []


OF = {"gyros": of_gyros, "sensors": of_sensors, "healthy": of_healthy, "cost": of_cost}


def target(text: str, measured: str, asked: str, is_reached: bool) -> Row:
    """Return a row of targets."""
    return {"target": text, "measured": measured, "asked": asked, "reached": "yes" if is_reached else "MISSED"}


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is asked for."""
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=(), help="parts")
    parser.add_argument(
        "--healthy",
        type=int,
        default=FLIGHTS["healthy"],
        help="healthy flights, of which 18 minutes each are watched (the report: 30)",
    )
    parser.add_argument("--seed", type=int, default=SEED, help="of the first flight")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one flight a part", beside="cases", arguments=arguments))
