"""The yardstick: monitors calibrated once, on noise, rates, motion and luck that nobody calibrated for.

    python experiments/yardstick.py [--flights N] [--out DIR] [--only PART ...] [--hours H] [--processes N]

Parts, each a table of the report:

- ``laws``: healthy flights of 200 s, three excitations, noise of thirteen laws; none may have a sensor named.
- ``limit``: delays of faults over log(T/Ts) nats (first order; no bound) of whoever knows kinematics, noise, the
  fault's shape and which sensor; with the default calibration, one of 6 flights of 200 s, one of the log itself.
- ``learnt``: delays by a monitor that 120 s of the log itself were learnt on, over those of the default calibration.
- ``rates``: healthy logs of 50 to 1000 Hz, even, jittered, 2 % lost, by monitors calibrated at 100 Hz, which refuse
  logs of less than 45 Hz.
- ``motion``: smooth healthy flights faster than any that was calibrated on.
- ``installed``: healthy logs whose attitude is late, clocks apart, gyros' scales and axes off.
- ``rate``: ``--hours`` of healthy flight, 60 of them flown, beyond with noise redrawn: the rate that was promised.

What was done is kept in DIR/rows.csv, and isn't done again: a run that was stopped goes on. Writes report.md beside it.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

import gtmbench as gb
from gtmbench.values.channels import header_of
from studies.conduct import DETAILS, write_report
from studies.noise_laws import LAWS

CHANNELS = ("p", "q", "r", "phi", "theta", "psi")
DETECTORS = ("C", "C-early", "kinematic-kalman-no-fir")
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence", "turbulence")
PERIOD_S, ONSET_S = 0.01, 100.0
FLOWN = 432  # flights of 500 s, 60 h: of what part `rate` watches beyond, the noise is redrawn
PER_HOUR, OVER_H = 0.002, 500.0  # false alarms wanted, and so the time between two
Row = dict[str, Any]


@cache
def calibration_flights() -> list[gb.Record]:
    """Return what `gtmbench calibrate` flies by default."""
    from gtmbench.study.healthy_records import CalibrationFlights

    return CalibrationFlights(flights=60, duration_s=500.0).sensed(CHANNELS)


@cache
def monitor(folder: str, name: str, which: str = "default") -> gb.Monitor:
    """Return a monitor of 60 flights of 500 s, or of 6 of 200 s; it is calibrated once."""
    path = Path(folder, f"monitor-{which}-{name}.json")
    if not path.is_file():
        records = calibration_flights()
        if which == "few":
            records = [record.between(0.0, 200.0) for record in records[10:16]]
        gb.save_monitor(gb.find_detector(name).calibrate(records, PER_HOUR), path)
    return gb.load_monitor(path)


@lru_cache(maxsize=40)
def flown(excitation: str, duration_s: float, seed: int) -> gb.Record:
    """Return a flight's truth."""
    return gb.fly("gtm", excitation, duration_s, seed).select(CHANNELS)


def sensed(truth: gb.Record, law: str, seed: int) -> gb.Record:
    """Return what sensors read with noise of a law, each channel its own."""
    for i, name in enumerate(CHANNELS):
        draw = np.random.default_rng([seed, i, *law.encode()])
        truth = truth.replace(name, truth[name] + gb.CHANNELS[name].noise * LAWS[law](draw, len(truth)))
    return truth


def said(watch: gb.Watch) -> Row:
    """Return how much of a healthy record was watched, and what was said of it."""
    first = watch.faults
    named = [alarm.sensor for alarm in first if alarm.sensor]
    watched_s = 3600.0 * watch.armed_hours
    share = watched_s / (len(watch.record) * watch.record.sample_period_s)
    return {"alarms": len(first), "named": " ".join(named), "hours": watch.armed_hours, "watched": share}


def laws(folder: str, law: str, excitation: str, seed: int) -> Iterator[Row]:
    """Healthy flights of 200 s with noise of some laws; the default calibration is white."""
    record = sensed(flown(excitation, 200.0, seed), law, seed + 1000 * EXCITATIONS.index(excitation))
    for name in DETECTORS:
        yield {"detector": name, **said(monitor(folder, name).watch(record))}


FAULTS: dict[str, Callable[[str], gb.Fault]] = {
    **{
        f"bias {size:g}": lambda ch, size=size: gb.Bias(channel=ch, onset_s=ONSET_S, size=size)
        for size in (0.3, 1.0, 2.0)
    },
    **{
        f"drift {slope:g}": lambda ch, slope=slope: gb.Drift(channel=ch, onset_s=ONSET_S, slope=slope)
        for slope in (0.02, 0.05, 0.5)
    },
    "jam": lambda ch: gb.Jam(channel=ch, onset_s=ONSET_S),
    "deadzone 1": lambda ch: gb.Deadzone(channel=ch, onset_s=ONSET_S, half_width=1.0),
    "saturation 3": lambda ch: gb.Saturation(channel=ch, onset_s=ONSET_S, limit=3.0),
    "scale 0.8": lambda ch: gb.ScaleFactor(channel=ch, onset_s=ONSET_S, factor=0.8),
    "sign": lambda ch: gb.SignFlip(channel=ch, onset_s=ONSET_S),
    "oscillation 1": lambda ch: gb.Oscillation(channel=ch, onset_s=ONSET_S, amplitude=1.0, frequency_hz=2.0),
}
LIMIT_LAWS = {
    "white": 1.0,
    "level x0.6": 0.6,
    "level x1.3": 1.3,
    "AR(1) 0.7": 1.0,
    "Student t4": 1.0,
    "wanders, 10 s": 1.0,
}
T4_INFORMATION = 10.0 / 7.0  # Fisher's of a shift, over that of a normal distribution of the same variance


def quickest(change: np.ndarray, channel: str, law: str) -> float:
    """Return when sum m(k)^2 / 2S reaches the logarithm of the samples between two false alarms, in seconds.

    By axis the attitude's error is carried on by the gyro's noise and seen by the angle's; m(k) is what the change adds
    to the innovations of the filter for that. Noise of an AR(1) is whitened on both, which leaves the kinematics alone.
    """
    level, angle = LIMIT_LAWS[law], {"p": "phi", "q": "theta", "r": "psi"}[channel]
    if law == "AR(1) 0.7":
        change, level = lfilter([1.0, -0.7], [1.0], change), level * math.sqrt(0.51)
    q, r = (level * gb.CHANNELS[channel].noise * PERIOD_S) ** 2, (level * gb.CHANNELS[angle].noise) ** 2
    p = q / 2.0 + math.sqrt(q * q / 4.0 + q * r)
    gain = p / (p + r)
    carried = lfilter([1.0], [1.0, gain - 1.0], change * PERIOD_S)
    information = np.cumsum(np.square(carried)) / (2.0 * (p + r)) * (T4_INFORMATION if law == "Student t4" else 1.0)
    reached = int(np.searchsorted(information, math.log(OVER_H * 3600.0 / PERIOD_S)))
    return (reached + 1) * PERIOD_S if reached < len(information) else math.inf


def limit(folder: str, law: str, channel: str, seed: int) -> Iterator[Row]:
    """Delays over a first-order figure, log(T/Ts) nats, which is no bound; of C, its look-ahead taken off beside it."""
    record = sensed(flown("doublets+turbulence", 150.0, seed), law, seed)
    watchers = {(name, "default"): monitor(folder, name) for name in DETECTORS}
    if law == "white":
        watchers |= {(name, "few"): monitor(folder, name, "few") for name in DETECTORS}
        own = sensed(flown("doublets+turbulence", 120.0, seed + 500), law, seed + 500)
        watchers["C", "the log itself"] = gb.calibrate(own, bank="C", false_alarms_per_hour=PER_HOUR)
    for fault, make in FAULTS.items():
        broken = gb.inject(record, make(channel))
        begin = round(ONSET_S / PERIOD_S)
        least = quickest(np.array(broken[channel] - record[channel])[begin:], channel, law)
        for (name, which), watcher in watchers.items():
            watch = watcher.watch(broken)
            late = [alarm.time_s - ONSET_S for alarm in watch.alarms if alarm.time_s >= ONSET_S]
            names = [alarm.sensor for alarm in watch.faults if alarm.time_s >= ONSET_S and alarm.sensor]
            wrong = any(sensor != channel for sensor in names)
            delay_s = late[0] if late else math.inf
            yield {
                "detector": name,
                "which": which,
                "fault": fault,
                "limit_s": least,
                "delay_s": delay_s,
                "wrong": wrong,
            }


COMMON: dict[str, Callable[[str], gb.Fault]] = {
    "bias 1": lambda ch: gb.Bias(channel=ch, onset_s=160.0, size=1.0),
    "drift 0.5": lambda ch: gb.Drift(channel=ch, onset_s=160.0, slope=0.5),
    "jam": lambda ch: gb.Jam(channel=ch, onset_s=160.0),
    "oscillation 1": lambda ch: gb.Oscillation(channel=ch, onset_s=160.0, amplitude=1.0, frequency_hz=2.0),
    "noise 1": lambda ch: gb.Noise(channel=ch, onset_s=160.0, deviation=1.0),
}


def learnt(folder: str, fault: str, channel: str, seed: int) -> Iterator[Row]:
    """Delays by a monitor that 120 s of the log itself were learnt on, over those of the default calibration."""
    record = sensed(flown("doublets+turbulence", 200.0, seed), "white", seed)
    broken = gb.inject(record, COMMON[fault](channel))
    with tempfile.TemporaryDirectory() as there:
        path = Path(there, "log.csv")
        gb.write_log(broken, path)
        own = gb.watch_log(path, "C", healthy=[(0.0, 120.0)], false_alarms_per_hour=PER_HOUR)
        for which, watched in (("default", gb.watch_log(path, monitor(folder, "C"))), ("the log itself", own)):
            late = [alarm.time_s - 160.0 for alarm in watched.alarms if alarm.time_s >= 160.0]
            early = sum(alarm.time_s < 160.0 for alarm in watched.alarms)
            wrong = any(alarm.sensor not in (None, channel) for alarm in watched.alarms)
            delay_s = late[0] if late else math.inf
            yield {"detector": "C", "which": which, "alarms": early, "delay_s": delay_s, "wrong": wrong}


KINDS = {"even": (0.0, 0.0), "jitter": (0.1, 0.0), "2 % lost": (0.0, 0.02), "jitter, 2 % lost": (0.1, 0.02)}
RATES_HZ = (50, 100, 125, 200, 250, 400, 1000)


def rates(folder: str, rate_hz: int, kind: str, seed: int) -> Iterator[Row]:
    """Healthy logs of other rates than the monitors' 100 Hz."""
    truth = flown("multisine+turbulence", 130.0, seed)
    draw, (jitter, loss) = np.random.default_rng([seed, rate_hz, *kind.encode()]), KINDS[kind]
    values = truth.matrix(CHANNELS).copy()
    values[:, CHANNELS.index("psi")] = np.degrees(np.unwrap(np.radians(values[:, CHANNELS.index("psi")])))
    count = int((truth.end_s - 0.1) * rate_hz)
    off = np.clip(jitter * draw.standard_normal(count), -0.5, 0.5)
    time_s = np.sort(0.0037 + (np.arange(count) + off) / rate_hz)[draw.random(count) >= loss]
    noise = np.array([gb.CHANNELS[name].noise for name in CHANNELS]) * draw.standard_normal(
        (len(time_s), len(CHANNELS))
    )
    table = pd.DataFrame(
        CubicSpline(truth.time_s, values)(time_s) + noise, columns=[header_of(name) for name in CHANNELS]
    )
    with tempfile.TemporaryDirectory() as there:
        path = Path(there, "log.parquet")
        table.assign(time_s=time_s).to_parquet(path)
        for name in DETECTORS:
            yield {"detector": name, **logged(path, monitor(folder, name), truth.end_s)}


def logged(path: Path, watcher: gb.Monitor, duration_s: float) -> Row:
    """Return what is said of a log."""
    watched = gb.watch_log(path, watcher)
    named = " ".join(alarm.sensor for alarm in watched.alarms if alarm.sensor)
    share = 3600.0 * watched.armed_hours / duration_s
    return {"outcome": int(watched.outcome), "alarms": len(watched.alarms), "named": named, "watched": share}


def motion(folder: str, yaw_deg_s: int, seed: int) -> Iterator[Row]:
    """Watch a smooth motion of exact kinematics: rolls, pitches and yaws that come and go within seconds."""
    draw, time_s = np.random.default_rng([seed, yaw_deg_s]), np.arange(0.0, 160.0, PERIOD_S)

    def wave(rate: float, *periods_s: float) -> np.ndarray:
        parts = [
            rate
            / len(periods_s)
            * period_s
            / (2.0 * np.pi)
            * np.sin(2.0 * np.pi * time_s / period_s + draw.uniform(0, 6))
            for period_s in periods_s
        ]
        return np.asarray(sum(parts))

    fast = np.clip((time_s - 30.0) / 20.0, 0.0, 1.0) ** 2  # the first half minute is calm
    phi, theta, psi = wave(150.0, 4.1, 2.9) * fast, wave(60.0, 7.3) * fast, 90.0 + wave(yaw_deg_s, 9.7, 6.1) * fast
    angles = gb.Record(np.column_stack([phi, theta, psi]), channels=["phi", "theta", "psi"], sample_period_s=PERIOD_S)
    names = ["p_att", "q_att", "r_att"]
    turned = gb.derive(angles, names).matrix(names)[1:-1]
    truth = gb.Record(
        np.column_stack([turned, angles.matrix(CHANNELS[3:])[1:-1]]), channels=CHANNELS, sample_period_s=PERIOD_S
    )
    record = sensed(truth, "white", seed)
    for name in DETECTORS:
        yield {"detector": name, **said(monitor(folder, name).watch(record))}


def installed(folder: str, number: int, seed: int) -> Iterator[Row]:
    """Watch a log of an aircraft whose attitude is late, by a clock of its own, and whose gyros sit and read askew."""
    draw = np.random.default_rng([seed, number])
    truth = flown("doublets+turbulence", 240.0, seed)
    late_s, apart = draw.uniform(0.0, 0.04), draw.uniform(-5e-4, 5e-4)
    turned = (
        np.eye(3)
        + np.diag(draw.uniform(-0.03, 0.03, 3))
        + np.radians(draw.uniform(-2.0, 2.0, (3, 3))) * (1 - np.eye(3))
    )
    spline = CubicSpline(truth.time_s, truth.matrix(CHANNELS[3:]))
    time_s = truth.time_s[10:-30]
    angles = spline(np.clip(time_s - late_s - apart * time_s, 0.0, None))
    gyros = truth.matrix(CHANNELS[:3])[10:-30] @ turned.T + draw.uniform(-1.0, 1.0, 3)
    record = gb.Record(np.column_stack([gyros, angles]), channels=CHANNELS, sample_period_s=PERIOD_S)
    with tempfile.TemporaryDirectory() as there:
        path = Path(there, "log.csv")
        gb.write_log(sensed(record, "white", seed + number), path)
        for name in DETECTORS:
            yield {"detector": name, **logged(path, monitor(folder, name), record.end_s)}


def rate(folder: str, number: int, seed: int) -> Iterator[Row]:
    """Healthy flights of 500 s, and the rate that their alarms allow."""
    excitation = EXCITATIONS[number % 3]
    record = sensed(flown(excitation, 500.0, seed), "white", 10_000 + number)
    for name in DETECTORS:
        yield {"detector": name, **said(monitor(folder, name).watch(record))}


PARTS: dict[str, Callable[..., Iterator[Row]]] = {
    "laws": laws,
    "limit": limit,
    "learnt": learnt,
    "rates": rates,
    "motion": motion,
    "installed": installed,
    "rate": rate,
}
SHOWN = ("laws", "limit", "rate")  # in the report; the others' tables stand in results.json


def tasks(flights: int, hours: float) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Give each part's cases."""
    fewer = max(flights // 6, 1)
    for law in LAWS:
        yield from (("laws", (law, how, 98001 + i)) for how in EXCITATIONS for i in range(flights))
    for law in LIMIT_LAWS:
        yield from (("limit", (law, ch, 97001 + i)) for ch in "pqr" for i in range(fewer if law == "white" else 1))
    yield from (("learnt", (fault, ch, 92001 + i)) for fault in COMMON for ch in "pqr" for i in range(2 * fewer))
    for rate_hz in RATES_HZ:
        yield from (("rates", (rate_hz, kind, 96001 + i)) for kind in KINDS for i in range(max(fewer // 2, 1)))
    yield from (("motion", (yaw, 95001 + i)) for yaw in (40, 100, 150) for i in range(fewer))
    yield from (("installed", (i, 94001 + i % 12)) for i in range(2 * flights))
    yield from (("rate", (i, 93001 + (i if i < FLOWN else i % 30))) for i in range(round(hours * 3600.0 / 500.0)))


def done(task: tuple[str, str, tuple[Any, ...]]) -> list[Row]:
    """Return the rows of one case, a detector (and a fault) each."""
    folder, part, case = task
    return [{"part": part, "case": repr(case), "kind": case[0], **row} for row in PARTS[part](folder, *case)]


def report(rows: pd.DataFrame) -> str:
    """Return the tables, in the order of the parts."""
    titles = {part: f"## {part}\n\n{(make.__doc__ or '').splitlines()[0]}" for part, make in PARTS.items()}
    texts = [
        "# The yardstick\n\nMonitors calibrated by default: 60 flights of 500 s, for 0.002 false alarms an hour. "
        "What a table doesn't list wasn't run.\n"
    ]
    for part in (*SHOWN, *(part for part in PARTS if part not in SHOWN)):
        if part not in SHOWN and DETAILS not in texts:
            texts.append(DETAILS)
        own = rows[rows["part"] == part]
        if len(own):
            texts.append(f"{titles[part]}\n\n{_table(part, own).reset_index().to_markdown(index=False)}\n")
    return "\n".join(texts)


def _table(part: str, own: pd.DataFrame) -> pd.DataFrame:
    if part == "limit":
        own = own.assign(ratio=own["delay_s"] / own["limit_s"], missed=np.isinf(own["delay_s"]))
        ahead = np.where(own["detector"] == "C", 0.11, 0.0)
        own = own.assign(ratio_less_look_ahead=(own["delay_s"] - ahead) / own["limit_s"])
        columns = {
            "ratio": "median",
            "ratio_less_look_ahead": "median",
            "missed": "sum",
            "wrong": "sum",
            "fault": "count",
        }
        return own.groupby(["kind", "which", "detector"], sort=False).agg(columns).round(2)
    if part == "learnt":
        own = own.assign(missed=np.isinf(own["delay_s"]), flights=1)
        columns = {"delay_s": "median", "missed": "sum", "wrong": "sum", "alarms": "sum", "flights": "sum"}
        return own.groupby(["kind", "which"], sort=False).agg(columns).round(2)
    own = own.assign(flights=1, named=own["named"].fillna("").astype(str).ne(""))
    columns = {"flights": "sum", "alarms": "sum", "named": "sum", "watched": "mean"}
    if part in ("rates", "installed"):
        own = own.assign(accused=own["outcome"] == 1, cannot_tell=own["outcome"] == 3)
        columns |= {"accused": "sum", "cannot_tell": "sum"}
    if part == "rate":
        from gtmbench.detectors.statistics.thresholds import rate_bound

        told = own.groupby("detector", sort=False).agg({"hours": "sum", "alarms": "sum", "named": "sum"})
        return told.assign(
            an_hour_at_most=[rate_bound(int(n), h) for n, h in zip(told["alarms"], told["hours"], strict=True)]
        )
    by = ["detector"] if part == "installed" else ["kind", "detector"]
    return own.groupby(by, sort=False).agg(columns).round(3)


def main() -> int:
    """Run what isn't done yet, and write the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=12, help="an excitation and law; the other parts go with it")
    parser.add_argument("--out", type=Path, default=Path("out/experiments/yardstick"))
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--hours", type=float, default=60.0, help="of part rate")
    parser.add_argument("--processes", type=int, default=1)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in DETECTORS:
        monitor(str(given.out), name)
        monitor(str(given.out), name, "few")
    path = given.out / "rows.csv"
    known = set()
    if path.is_file():
        before = pd.read_csv(path)
        known = set(zip(before["part"], before["case"], strict=True))
    todo = [
        (str(given.out), part, case)
        for part, case in tasks(given.flights, given.hours)
        if part in given.only and (part, repr(case)) not in known
    ]
    columns = ["part", "case", "kind", "detector", "which", "fault", "limit_s", "delay_s", "wrong"]
    columns += ["outcome", "alarms", "named", "hours", "watched"]
    with ProcessPoolExecutor(given.processes) as pool:
        for number, rows in enumerate(pool.map(done, todo), 1):
            table = pd.DataFrame(rows).reindex(columns=columns)
            table.to_csv(path, mode="a", header=not path.is_file(), index=False)
            print(f"\r{number} of {len(todo)}: {rows[0]['part']}", end="", flush=True)
    text = report(pd.read_csv(path))
    write_report(given.out, text, given)
    print("\n" + text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
