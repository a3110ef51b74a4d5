"""Recorded flights with a magnetometer: r is named where it is broken, or isn't, and who is named beside.

    python experiments/magnetometer_in_logs.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR]

Watches every log below the folders that holds p, q, r, phi, theta, psi and a magnetometer by `gtmbench monitor`'s
detector auto, as it is and broken: the yaw gyro, with an attitude that an estimator of 5 s or of 20 s makes of it;
the heading alone; the magnetometer with a heading that follows it. A fault begins a quarter of the way
from the end of what was identified on to the end of the flight, and lasts. *Without* is the verdict before any
magnetometer was asked. Prints tables, writes report.md and cases.csv into DIR, and ends with code 1 where a sensor is
named that is healthy. No log is kept. With --synthetic the same of flights of the GTM, by their seeds, written as
tables at 10 Hz, whose attitude a filter of 20 s makes of the gyros.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.intake.magnetometers import magnetometers_of
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.intake.samples import Samples, log_samples
from gtmbench.intake.times import with_time
from gtmbench.jobs.progress import silent
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.asked import asked as ask
from gtmbench.study.log.bending import bent_samples
from gtmbench.study.log.choices import agreed
from gtmbench.study.log.healthy import chosen
from gtmbench.study.log.learnt import learnt
from gtmbench.study.log.opened import opened
from gtmbench.study.log.origin import FROM_LOG
from gtmbench.study.log.said import doubted, listened
from gtmbench.study.log.watched import WatchedLog, concluded
from gtmbench.values.attitude import AttitudeEstimator, SteepError
from gtmbench.values.channels import ATTITUDE, GYROS, MAGNETOMETER

LEFT_S = 25.0  # at least, from a fault's onset to the flight's end
FLOWN_S, RATE_HZ = 240.0, 10.0  # of synthetic flights
SHARE = 0.25  # of what is left after identification goes by before a fault
COMPASS_SHARE = 1.0  # of the field, by which a magnetometer is disturbed at last
AS_IT_IS, HEADING, COMPASS = "nothing", "psi alone", "magnetometer"
INTRODUCTION = """Each log is watched as it is and with one fault at a time. *put*: cases. *right*: the broken sensor is
named, or "r or psi" has become the right one. *can't tell*: no sensor is named, whatever is doubted. *nothing*: no alarm
is left. *wrong*: a healthy sensor is named. *without*: the same before any magnetometer was asked. For a disturbed
magnetometer every name is wrong. Of logs as they are, everything but *nothing* and *can't tell* is wrong.
"""  # noqa: E501
Values = Mapping[str, np.ndarray]


def broken(read: ReadLog, values: Values, samples: Mapping[str, Samples]) -> ReadLog:
    """Return a log with other values in some channels, otherwise as it was read."""
    changed = {}
    for name, new in values.items():
        cells = samples[name].cells(new)
        column = cells.column.values()
        column[cells.rows] = cells.values  # noqa: PD011
        changed[cells.column.name] = column
    return _with_columns(read, changed)


def _with_columns(read: ReadLog, changed: Values) -> ReadLog:
    series = [
        replace(each, load=lambda column=changed[each.name]: column) if each.name in changed else each
        for each in read.raw.series
    ]
    return ReadLog(path=read.path, raw=replace(read.raw, series=tuple(series)))


def synthetic(folder: Path, seeds: range) -> None:
    """Write healthy flights as tables: T2's noise, a driven attitude, a magnetometer with soft iron of 3 %."""
    for seed in seeds:
        dip_deg = np.random.default_rng(seed).uniform(40.0, 75.0)
        truth = gb.fly("gtm", "multisine+turbulence", FLOWN_S, seed=seed)
        magnetometer = gb.Magnetometer(inclination_deg=dip_deg, rate_hz=RATE_HZ)
        sensed = gb.with_magnetometer(gb.measure(truth, noise="t2", seed=seed), truth, magnetometer, seed=seed)
        for name in ATTITUDE:
            sensed = sensed.replace(name, truth[name])
        driven = gb.filtered_attitude(sensed, time_constant_s=20.0, seed=seed)
        every = round(1.0 / (RATE_HZ * driven.sample_period_s))
        channels = (*GYROS, *ATTITUDE, *MAGNETOMETER)
        rows = driven.matrix(channels)[::every]
        gb.write_log(gb.Record(rows, channels=channels, sample_period_s=1.0 / RATE_HZ), folder / f"gtm_{seed}.csv")


def watched_log(read: ReadLog) -> WatchedLog:
    """Return what detector auto says of a log, as `gb.watch_log` does of a file."""
    given = {"healthy": (), "mapping": (), "rate_hz": None, "false_alarms_per_hour": None, "attitude": FROM_LOG}
    question = replace(ask(read.path, "auto", **given), path=read)
    said = doubted(listened(learnt(chosen(opened(question)), silent), silent), silent)
    return concluded(agreed(said, silent))


def faults() -> Iterator[tuple[str, str, gb.Fault, float]]:
    """Give what is broken, how, the fault at 0 s, and the time constant of the estimator that follows it."""
    for size, tau_s in ((2.0, 5.0), (-5.0, 20.0)):
        yield "r", f"bias {abs(size):g} deg/s", gb.Bias(channel="r", onset_s=0.0, size=size), tau_s
    for slope, tau_s in ((-0.1, 5.0), (0.3, 20.0)):
        yield "r", f"drift {abs(slope):g} deg/s²", gb.Drift(channel="r", onset_s=0.0, slope=slope), tau_s


def cases(read: ReadLog, onset_s: float) -> Iterator[tuple[str, str, str, ReadLog]]:
    """Give what is wrong, how, through which estimator, and the log."""
    samples = log_samples(read, [*GYROS, *ATTITUDE])
    healthy = {name: each.values for name, each in samples.items()}  # noqa: PD011
    for sensor, what, fault, tau_s in faults():
        own = samples[sensor]
        put = replace(fault, onset_s=onset_s).broken(own.values[:, np.newaxis], own.time_s, own.sample_period_s)  # noqa: PD011
        gyros = {name: healthy[name] for name in GYROS} | {sensor: put}
        with contextlib.suppress(SteepError):
            bent = bent_samples(AttitudeEstimator(time_constant_s=tau_s), samples, gyros)
            values = {sensor: put} | {name: bent[name] for name in ATTITUDE}
            yield sensor, what, f"{tau_s:g} s", broken(read, values, samples)
    elapsed = np.maximum(samples["psi"].time_s - onset_s, 0.0)
    yield HEADING, "2 deg/s", "", broken(read, {"psi": healthy["psi"] + 2.0 * elapsed}, samples)
    yield COMPASS, f"grows to {COMPASS_SHARE:g} of the field", "", _disturbed(read, samples, onset_s, COMPASS_SHARE)


def _disturbed(read: ReadLog, samples: Mapping[str, Samples], onset_s: float, share: float) -> ReadLog:
    """Return a log whose first magnetometer is beside a growing current, and whose heading follows it."""
    first = magnetometers_of(read)[0]
    by_name = {series.name: series.values() for series in read.raw.series if series.name in first.columns}
    topic = next(series.clock for series in read.raw.series if series.name == first.columns[0])
    time_s = with_time(read.raw, None).clocks[topic]  # of a table, too
    strength = float(np.nanmedian(np.linalg.norm(first.field, axis=1)))
    grown = np.clip((time_s - onset_s) / (time_s[-1] - onset_s), 0.0, 1.0) * share * strength
    direction = (0.6, -0.64, 0.48)
    field = {name: by_name[name] + part * grown for name, part in zip(first.columns, direction, strict=True)}
    at_s = samples["psi"].time_s
    both = [np.column_stack([np.interp(at_s, time_s, own[name]) for name in first.columns]) for own in (by_name, field)]
    tilt = [np.deg2rad(np.interp(at_s, samples[name].time_s, samples[name].values)) for name in ("phi", "theta")]
    turned = np.unwrap(_azimuth(both[1], *tilt) - _azimuth(both[0], *tilt))
    heading = samples["psi"].values - np.rad2deg(turned)  # noqa: PD011
    return broken(_with_columns(read, field), {"psi": heading}, samples)


def _azimuth(field: np.ndarray, phi: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return the direction of the levelled field, in radians."""
    x, y, z = field.T
    forward = x * np.cos(theta) + (y * np.sin(phi) + z * np.cos(phi)) * np.sin(theta)
    return np.asarray(np.arctan2(y * np.cos(phi) - z * np.sin(phi), forward))


def _said(watched: WatchedLog, *, by_witness: bool) -> tuple[set[str], bool]:
    """Return who is named, and whether any alarm is left; also before any magnetometer was asked."""
    names, is_left = set(), False
    for alarm in watched.alarms:
        told = alarm
        if not by_witness:
            told = replace(alarm, judgements=tuple(each for each in alarm.judgements if not each.witness))
        if told.has_passed:
            continue
        is_left = True
        if told.sensor is not None and not told.doubt:
            names.add(told.sensor)
    return names, is_left


def _result(wrong: str, watched: WatchedLog, *, by_witness: bool) -> str:
    names, is_left = _said(watched, by_witness=by_witness)
    right = {"psi"} if wrong == HEADING else {wrong} & {*GYROS}
    if names - right:
        return "wrong"
    if names:
        return "right"
    return "can't tell" if is_left else "nothing"


def asked(path: Path) -> Iterator[dict[str, object]]:
    """Give what is said of a log, as it is and broken; nothing of one that can't be asked."""
    try:
        read = read_log(path)
        if not magnetometers_of(read):
            return
        clean = watched_log(read)
    except InputError:
        return
    bounds = [round(each.bound_deg_s, 2) for each in clean.witnesses]
    yield _row(path, AS_IT_IS, "", "", clean) | {"bounds_deg_s": bounds}
    if clean.check.stops or not clean.witnesses:
        return
    end_s, start_s = clean.log.segments[-1].end_s, clean.identified_s[-1][1]
    onset_s = start_s + SHARE * (end_s - start_s)
    if end_s - onset_s < LEFT_S:
        return
    for sensor, what, tau, log in cases(read, onset_s):
        yield _row(path, sensor, what, tau, watched_log(log))


def _row(path: Path, sensor: str, what: str, tau: str, watched: WatchedLog) -> dict[str, object]:
    told = [f"{alarm.verdict} [{alarm.last.witness or alarm.last.reason}]" for alarm in watched.alarms if alarm.last]
    return {
        "log": path.name,
        "broken": sensor,
        "how": what,
        "through": tau,
        "with": _result(sensor, watched, by_witness=True),
        "without": _result(sensor, watched, by_witness=False),
        "outcome": watched.outcome.name,
        "said": " | ".join(told)[:400],
    }


def summed(rows: pd.DataFrame) -> pd.DataFrame:
    """Return how often each verdict came, a row a fault."""
    lines = []
    for (sensor, how, through), part in rows.groupby(["broken", "how", "through"], sort=False):
        line = {"broken": sensor, "how": how, "through": through, "put": len(part)}
        for result in ("right", "can't tell", "nothing", "wrong"):
            line[result] = int((part["with"] == result).sum())
        for result in ("right", "wrong"):
            line[f"{result} without"] = int((part["without"] == result).sum())
        lines.append(line)
    return pd.DataFrame(lines)


def studied(folder: Path, out: Path) -> pd.DataFrame:
    """Return what is said of all logs of a folder; kept log by log."""
    found: list[dict[str, object]] = []
    for path in sorted(each for each in folder.rglob("*") if each.is_file()):
        found += asked(path)
        print(path.name, len(found), flush=True)
        pd.DataFrame(found).to_csv(out / f"{folder.name}.csv", index=False)
    if not found:
        raise SystemExit(f"{folder}: no log of it has gyros, an attitude and a magnetometer")
    return pd.DataFrame(found)


def main() -> int:
    """Watch, sum up, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--synthetic", default="")
    parser.add_argument("--out", type=Path, default=Path("experiments/reports/magnetometer_in_logs"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    groups = {folder.name: studied(folder, given.out) for folder in given.folders}
    if given.synthetic:
        first, last = (int(each) for each in given.synthetic.split(":"))
        with tempfile.TemporaryDirectory() as above:
            folder = Path(above, "synthetic")
            folder.mkdir()
            synthetic(folder, range(first, last))
            groups[f"synthetic, seeds {first} to {last - 1}"] = studied(folder, given.out)
    if not groups:
        parser.error("neither a folder nor --synthetic is given; give folders of logs, --synthetic FIRST:LAST, or both")
    lines = ["# Recorded flights with a magnetometer", INTRODUCTION]
    for name, rows in groups.items():
        lines += [f"## {name}: {rows['log'].nunique()} logs", markdown(summed(rows))]
    text = "\n\n".join(lines)
    (given.out / "report.md").write_text(text + "\n", encoding="utf-8")
    print(text)
    return int(any((rows["with"] == "wrong").any() for rows in groups.values()))


if __name__ == "__main__":
    sys.exit(main())
