"""Whether the gyros drive the attitude: what the samples say of it, and whether a driven one is ever taken for own.

    python experiments/attitude_origin.py [FOLDER ...] [--quick] [--out DIR] [--jobs N] [--seed N]

Synthetic flights at 400 Hz, whose attitude is of its own or an estimator's, are logged in many ways. Of every log
below the folders whose format documents an attitude that the gyros drive, `gtmbench.method.driven_attitude` is asked
without being told so: as the log is opened, and as tables of such logs are made, the attitude on the gyros' clock.
Prints tables; writes report.md and cases.csv into DIR. Ends with code 1 where a driven attitude is taken for own, or
fewer than 80 % of the own ones are recognised whose gyros' noise shows (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt, welch

import gtmbench as gb
from gtmbench.bench.attitude_filter import filtered_attitude
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_contents
from gtmbench.jobs.processes import spread
from gtmbench.method.driven_attitude import origin_of
from gtmbench.report.markup import markdown
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.attitude_estimators import carried_on
from gtmbench.values.channels import ATTITUDE, GYROS
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped

SEED = 38_000  # of the report's cases; others were looked at while the rule was made
OWN, DRIVEN = 120, 300  # cases
FASTER_HZ = 90.0  # of the sample rate: in slower logs nothing is said to be own
RATE_HZ, LASTS_S = 400.0, 120.0  # of what is flown, logged more slowly
EXCITATIONS = ("multisine", "doublets", "multisine+turbulence", "doublets+turbulence")
SHOWS_OVER_MOTION, SHOWS_OVER_OWN = 30.0, 4.0  # times its power, a gyro's noise shows in an octave
ENOUGH = 0.8
Row = dict[str, Any]
SAID_QUICK = "**Quick: a few cases. It bounds nothing.**\n\n"
INTRODUCTION = """A gyro's fault bends an attitude that the gyros drive; a monitor has to know. `origin_of` says from
the samples which it is, and says *own* only where it is sure; else an attitude is *taken for driven*.

- Synthetic flights (the GTM, 120 s) are flown at 400 Hz, the gyros with noise of 0.02 to 1 deg/s, white or coloured,
  and logged at 50 to 400 Hz. *Own*: the true attitude with noise of its own, quantised, late. *Driven*: by
  `gb.filtered_attitude` with time constants of 0.2 to 30 s, with and without bias states, and then changed in up to
  three ways; the tables count every change that a case has.
- *Shows*: in an octave below 0.45 of the logged rate, the noise of two gyros has 30 times the motion's power and 4
  times that of the attitude's own noise. That is worked out of what was put in, which the rule doesn't see. Of logs
  slower than 90 Hz, which have a row of their own, the rule never says *own*: what a gyro's samples fold back from
  higher frequencies is missing in a driven attitude, too. The target is of the faster ones.
- Real logs are PX4's and ArduPilot's, whose attitude is documented to be driven; the documentation isn't told.
  *opened*: as `gtmbench monitor` opens them. *linear*, *held*, *spline*: the attitude laid onto the gyros' own clock,
  at their full rate, as tables are made of such logs. *coarse*: linear, and the gyros rounded to 0.1 deg/s.

The rule was made on the logs of `dev` and on synthetic cases of other seeds. `held` was looked at once before, and
`rest` holds those logs of the same repositories in which too little flies for `real_logs.py`. A report of seeds from
32,000 on, before a rate had to follow the gyro equally late at all frequencies, took one of 276 synthetic driven
attitudes for own: it was behind a low-pass, and the gyros were behind a notch.
"""


class Task(NamedTuple):
    """A log and its group, or the seed of a synthetic case."""

    source: Path | int
    group: str


def done(task: Task) -> list[Row]:
    """Ask of a log, or of a case."""
    if isinstance(task.source, int):
        return [own_case(task.source) if task.group == "own" else driven_case(task.source, task.group)]
    return list(of_log(task.source, task.group))


# ---- synthetic cases


@cache
def truth_of(excitation: str, seed: int) -> gb.Record:
    """Return true rates and attitude at 400 Hz."""
    flown = fly_once(excitation=excitation, duration_s=LASTS_S, seed=seed).select([*GYROS, *ATTITUDE])
    fine_s = np.arange(int(LASTS_S * RATE_HZ)) / RATE_HZ
    fine_s = fine_s[fine_s <= flown.time_s[-1] - flown.start_s]
    rates = CubicSpline(flown.time_s - flown.start_s, flown.matrix(GYROS))(fine_s)
    path = [flown.matrix(ATTITUDE)[0].tolist()]  # integrated anew: interpolated, the two wouldn't be one motion
    for before, now in pairwise(rates.tolist()):
        path.append(list(carried_on(path[-1], before, now, 1.0 / RATE_HZ)))
    return gb.Record(np.hstack([rates, path]), channels=[*GYROS, *ATTITUDE], sample_period_s=1.0 / RATE_HZ)


def coloured(draw: np.random.Generator, rows: int, columns: int, cut_hz: float | None) -> np.ndarray:
    """Return noise of deviation 1, white or low-passed."""
    noise = draw.standard_normal((rows, columns))
    if cut_hz is not None:
        noise = sosfilt(butter(2, cut_hz, output="sos", fs=RATE_HZ), noise, axis=0)
        noise /= noise.std()
    return noise


def with_columns(record: gb.Record, names: Sequence[str], values: np.ndarray) -> gb.Record:
    """Return a record with other columns."""
    for i, name in enumerate(names):
        record = record.replace(name, values[:, i])
    return record


def flown_and_noise(draw: np.random.Generator) -> tuple[gb.Record, np.ndarray, str]:
    """Return a true flight, its gyros' noise, and what it is called."""
    truth = truth_of(str(draw.choice(EXCITATIONS)), int(draw.integers(740_000, 740_008)))
    deviation = float(10.0 ** draw.uniform(np.log10(0.02), 0.0))
    cut_hz = [None, None, 80.0, 30.0][draw.integers(4)]
    noise = deviation * coloured(draw, len(truth), 3, cut_hz)
    return truth, noise, f"{deviation:.2g} deg/s" + ("" if cut_hz is None else f" below {cut_hz:g} Hz")


def own_case(seed: int) -> Row:
    """Make a log with an attitude of its own, and ask."""
    draw = np.random.default_rng([seed, 1])
    truth, noise, called = flown_and_noise(draw)
    every = int(draw.choice([1, 2, 4, 8]))
    angle_noise = float(draw.choice([0.0, 0.0003, 0.001, 0.003, 0.01, 0.03])) * draw.standard_normal((len(truth), 3))
    quantum = float(draw.choice([0.0, 0.0, 0.001, 0.01]))
    late = int(draw.choice([0, 0, 8, 20]))
    angles = np.roll(truth.matrix(ATTITUDE), late, axis=0) + angle_noise
    if quantum:
        angles = quantum * np.rint(angles / quantum)
    logged = with_columns(with_columns(truth, GYROS, truth.matrix(GYROS) + noise), ATTITUDE, angles)
    rows = slice(late, None, every)
    record = taken(logged, rows)
    told = origin_of([record])
    own_rate = np.gradient((angles - np.roll(truth.matrix(ATTITUDE), late, axis=0))[rows], every / RATE_HZ, axis=0)
    shows = does_show(noise[rows], truth.matrix(GYROS)[rows], own_rate, RATE_HZ / every)
    slow = "" if RATE_HZ / every >= FASTER_HZ else ", slower than 90 Hz"
    return {
        "group": "own",
        "kind": f"noise shows{slow}" if shows else "noise doesn't show",
        "changes": f"{called}; {RATE_HZ / every:g} Hz; late {1000 * late / RATE_HZ:g} ms; quantum {quantum:g} deg",
        "own": not told.is_driven,
        "why": told.why,
    }


def does_show(noise: np.ndarray, motion: np.ndarray, own_rate: np.ndarray, rate_hz: float) -> bool:
    """Tell whether the noise of two gyros stands above motion and the attitude's own noise in an octave."""
    of_noise, of_motion, of_own = (
        welch(values, rate_hz, nperseg=256, axis=0, detrend="linear")[1] for values in (noise, motion, own_rate)
    )
    f = np.fft.rfftfreq(256, 1.0 / rate_hz)
    high_hz = 0.45 * rate_hz
    while high_hz > 2.0:
        rows = (f >= high_hz / 2.0) & (f < high_hz)
        power, moves, own = (each[rows].sum(axis=0) for each in (of_noise, of_motion, of_own))
        if np.count_nonzero((power > SHOWS_OVER_MOTION * moves) & (power > SHOWS_OVER_OWN * own)) >= 2:
            return True
        high_hz /= 2.0**0.5
    return False


def taken(record: gb.Record, rows: slice) -> gb.Record:
    """Return some rows as a record."""
    values = record.matrix(record.channels)[rows]
    return gb.Record(values, channels=record.channels, sample_period_s=(rows.step or 1) * record.sample_period_s)


def driven_case(seed: int, group: str) -> Row:
    """Make a log with an attitude that the gyros drive, changed, and ask."""
    draw = np.random.default_rng([seed, 2])
    truth, noise, called = flown_and_noise(draw)
    names = list(draw.permutation(list(CHANGES))[: draw.integers(4)])
    if "vibration" in names:
        truth = shaken(truth, draw)
    tau_s = float(10.0 ** draw.uniform(np.log10(0.2), np.log10(30.0)))
    bias_s = None if draw.random() < 0.5 else float(draw.uniform(2.0, 20.0)) * tau_s
    reference = float(draw.choice([0.0, 0.1, 0.5, 2.0]))
    sensed = with_columns(truth, GYROS, truth.matrix(GYROS) + noise + draw.uniform(-1.0, 1.0, 3))
    read = filtered_attitude(
        sensed, time_constant_s=tau_s, reference_noise_deg=reference, seed=seed, bias_time_constant_s=bias_s
    )
    every = int(draw.choice([1, 2, 4, 8]))
    gyros, angles = read.matrix(GYROS), read.matrix(ATTITUDE)
    for name in names:
        gyros, angles = CHANGES[name](gyros, angles, draw)
    late = 60 if "attitude late" in names else 0
    logged = with_columns(with_columns(read, GYROS, gyros), ATTITUDE, angles)
    told = origin_of([taken(logged, slice(late + 40, -40, every))])
    return {
        "group": group,
        "kind": "driven",
        "changes": "; ".join([*names] or ["none"]),
        "setting": f"{called}; tau {tau_s:.2g} s; {RATE_HZ / every:g} Hz; reference {reference:g} deg",
        "own": not told.is_driven,
        "why": told.why,
    }


def shaken(truth: gb.Record, draw: np.random.Generator) -> gb.Record:
    """Return a flight with vibration, which is motion."""
    low = float(draw.uniform(10.0, 60.0))
    band = butter(2, [low, 1.5 * low], "bandpass", output="sos", fs=RATE_HZ)
    shaking = sosfilt(band, draw.standard_normal((len(truth), 3)), axis=0)
    shaking *= draw.uniform(0.05, 1.0) / shaking.std()
    truth = with_columns(truth, GYROS, truth.matrix(GYROS) + shaking)
    return with_columns(truth, ATTITUDE, truth.matrix(ATTITUDE) + np.cumsum(shaking, axis=0) / RATE_HZ)


Changed = tuple[np.ndarray, np.ndarray]


def low_passed_gyros(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Log the gyros behind a low-pass of their own."""
    sos = butter(int(draw.integers(1, 4)), float(draw.choice([10.0, 20.0, 40.0])), output="sos", fs=RATE_HZ)
    return sosfilt(sos, gyros, axis=0), angles


def notched_gyros(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Log the gyros behind a notch."""
    low = float(draw.uniform(10.0, 60.0))
    return sosfilt(butter(2, [low, 1.6 * low], "bandstop", output="sos", fs=RATE_HZ), gyros, axis=0), angles


def low_passed_attitude(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Log the attitude behind a low-pass."""
    sos = butter(int(draw.integers(1, 3)), float(10.0 ** draw.uniform(0.3, 1.6)), output="sos", fs=RATE_HZ)
    return gyros, sosfilt(sos, angles - angles[0], axis=0) + angles[0]


def coarse_gyros(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Round the gyros."""
    step = float(draw.choice([0.01, 0.06, 0.25, 1.0]))
    return step * np.rint(gyros / step), angles


def coarse_attitude(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Round the attitude."""
    step = float(draw.choice([0.001, 0.01, 0.1]))
    return gyros, step * np.rint(angles / step)


def noisy_attitude(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Add noise behind the estimator."""
    return gyros, angles + float(10.0 ** draw.uniform(-3.5, -1.5)) * draw.standard_normal(angles.shape)


def late_attitude(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Stamp the attitude late."""
    return gyros, np.roll(angles, int(draw.integers(4, 60)), axis=0)


def jittered_attitude(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Take the attitude at times that jitter."""
    at = np.arange(len(angles)) + float(draw.uniform(0.2, 4.0)) * draw.standard_normal(len(angles))
    return gyros, between(at, angles)


def decimated_attitude(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Log the attitude slowly, and lay it onto the gyros' clock: by lines, held, or by splines."""
    every = RATE_HZ / float(draw.choice([10.0, 25.0, 30.0, 50.0, 100.0]))
    rows = np.arange(len(angles), dtype=np.float64)
    known = np.arange(0.0, rows[-1], every)
    return gyros, laid(rows, known, between(known, angles), ("linear", "held", "spline")[draw.integers(3)])


def turned_gyros(gyros: np.ndarray, angles: np.ndarray, draw: np.random.Generator) -> Changed:
    """Mount the logged gyros askew, with other scales."""
    return gyros @ (np.eye(3) + 0.1 * draw.standard_normal((3, 3))), angles


def vibration(gyros: np.ndarray, angles: np.ndarray, _: np.random.Generator) -> Changed:
    """Change nothing more: it was put into the flight."""
    return gyros, angles


CHANGES = {
    "gyros low-passed": low_passed_gyros,
    "gyros behind a notch": notched_gyros,
    "gyros quantised": coarse_gyros,
    "gyros askew": turned_gyros,
    "attitude low-passed": low_passed_attitude,
    "attitude quantised": coarse_attitude,
    "attitude with noise": noisy_attitude,
    "attitude late": late_attitude,
    "attitude's stamps jitter": jittered_attitude,
    "attitude slow, laid on the gyros' clock": decimated_attitude,
    "vibration": vibration,
}


def between(at: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return columns between their rows."""
    rows = np.arange(len(values), dtype=np.float64)
    return np.column_stack([np.interp(at, rows, column) for column in values.T])


def laid(wanted: np.ndarray, known: np.ndarray, told: np.ndarray, how: str) -> np.ndarray:
    """Lay angles that are known at some times onto others."""
    if how == "held":
        return told[np.maximum(np.searchsorted(known, wanted, side="right") - 1, 0)]
    if how == "spline":
        return np.asarray(CubicSpline(known, told)(np.clip(wanted, known[0], known[-1])))
    return np.column_stack([np.interp(wanted, known, column) for column in told.T])


# ---- logs


def of_log(path: Path, group: str) -> Iterator[Row]:
    """Ask of a log, opened in several ways; nothing of one that documents nothing, or that lacks a channel."""
    try:
        if not log_contents(path).attitude_from_gyros:
            return
        opened = gb.open_log(path, needs=[*GYROS, *ATTITUDE])
    except InputError:
        return
    ways = {"opened": opened.segments} | tables_of(path)
    for way, records in ways.items():
        told = origin_of(records)
        rate_hz = 1.0 / records[0].sample_period_s
        yield {
            "group": group,
            "kind": way,
            "changes": path.name,
            "setting": f"{rate_hz:.3g} Hz",
            "own": not told.is_driven,
            "seen": bool(told.shares),
            "why": told.why,
        }


def tables_of(path: Path) -> dict[str, tuple[gb.Record, ...]]:
    """Return what tables hold that are made of a log: the attitude laid onto the gyros' clock."""
    try:
        fast = gb.open_log(path, needs=GYROS).segments
        slow = gb.open_log(path, needs=ATTITUDE).segments
    except InputError:
        return {}
    made: dict[str, list[gb.Record]] = {}
    for gyros in fast:
        for angles in slow:
            start_s, end_s = max(gyros.start_s, angles.start_s), min(gyros.end_s, angles.end_s)
            if end_s - start_s < 10.0:
                continue
            part = gyros.between(start_s, end_s)
            known = angles.matrix(ATTITUDE)
            if not np.isfinite(known).all():
                continue
            for how in ("linear", "held", "spline"):
                on_clock = laid(part.time_s, angles.time_s, np.unwrap(known, period=360.0, axis=0), how)
                both = gb.Record(
                    np.hstack([part.matrix(GYROS), on_clock]),
                    channels=[*GYROS, *ATTITUDE],
                    sample_period_s=part.sample_period_s,
                    start_s=part.start_s,
                )
                made.setdefault(how, []).append(both)
                if how == "linear":
                    rounded = with_columns(both, GYROS, 0.1 * np.rint(both.matrix(GYROS) / 0.1))
                    made.setdefault("coarse", []).append(rounded)
    return {way: tuple(records) for way, records in made.items()}


# ---- the report


def conduct(campaign: Campaign) -> Findings:
    """Ask, count, report."""
    wrong = [str(folder) for folder in campaign.given.folders if not folder.is_dir()]
    if wrong:
        raise InputError(f"{', '.join(wrong)} is no folder; give folders of logs, or none")
    seed = campaign.given.seed
    own, driven = (2, 3) if campaign.quick else (OWN, DRIVEN)
    todo = [
        *(Task(seed + k, "own") for k in range(own)),
        *(Task(seed + 1000 + k, "driven") for k in range(driven)),
        *(
            Task(path, folder.resolve().name)
            for folder in campaign.given.folders
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        ),
    ]
    results = spread(done, todo, processes=campaign.jobs, step="cases", progress=campaign.tell)
    rows = pd.DataFrame([row for each in results for row in each])
    is_own = rows["group"] == "own"
    shown = rows[is_own & (rows["kind"] == "noise shows")]
    wrong_own = int(rows[~is_own]["own"].sum())
    recognised = float(shown["own"].mean()) if len(shown) else 1.0
    targets = pd.DataFrame(
        [
            {"target": "driven taken for own", "measured": f"{wrong_own} of {int((~is_own).sum())}", "asked": "0"},
            {
                "target": "own recognised where the noise shows, at 90 Hz and faster",
                "measured": f"{int(shown['own'].sum())} of {len(shown)}",
                "asked": "80 %",
            },
        ]
    )
    counts = {"cases": len, "own": lambda of: int(of["own"].sum())}
    drives = rows[rows["group"] == "driven"]
    by_change = drives.assign(change=drives["changes"].str.split("; ")).explode("change")
    tables = [
        markdown(targets),
        markdown(grouped(rows, {"group": "group", "kind": "kind"}, {"cases": len, "said to be own": counts["own"]})),
        markdown(grouped(by_change, {"change": "change"}, {"cases": len, "said to be own": counts["own"]})),
    ]
    head = ["# Do the gyros drive the attitude?", SAID_QUICK * campaign.quick + INTRODUCTION]
    return Findings(
        "\n\n".join([*head, *tables]) + "\n",
        bool(wrong_own) or recognised < ENOUGH,
        lambda out: rows.to_csv(out / "cases.csv", index=False),
    )


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is asked of."""
    parser.add_argument("folders", nargs="*", type=Path, help="folders of logs")
    parser.add_argument("--seed", type=int, default=SEED, help="of the synthetic cases")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="a few cases", arguments=arguments))
