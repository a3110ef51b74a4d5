"""Half a minute of flight: what `gtmbench monitor` makes of short records of other aircraft than the GTM, at 25 Hz.

    python experiments/short_records.py [--quick] [--out DIR] [--jobs N]

Flies the airliners that come with JSBSim, 30 s each, one manoeuvre a record, in calm air and in turbulence; reads them
with imperfect sensors; identifies a bank on one manoeuvre, or on three, and watches the others: how many healthy
records alarm, how many faults that begin after 15 s are found, and what is said of them. Prints the tables; writes
report.md and a figure into DIR. No figure is held against a target.

The method was made on the 737 and the A320; B747 and global5000 were first flown when it was frozen, and stand apart.
They aren't held out any more: details of the calibration have changed since, with records of theirs in view.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from functools import cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import jsbsim
import numpy as np
import pandas as pd
from scipy.signal import butter, sosfilt

import gtmbench as gb
from gtmbench.bench.excitation import Excitation
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.faults.distortions import lagged
from gtmbench.files.folders import atomic_folder, check_folder
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import progress_bar
from gtmbench.report.figures.panels import panels
from gtmbench.report.markup import markdown
from gtmbench.report.style import COLOURS
from gtmbench.study.score import false_alarms
from studies.conduct import write_report

SENSORS = {  # bias, vibration and noise (RMS) and quantum in deg/s, deg or g
    #       lag (s)  gain    bias  vibration  noise  quantum
    "p":     (0.02,  1.010,  0.150,  0.060,   0.060,  0.0200),
    "q":     (0.02,  0.990, -0.100,  0.040,   0.040,  0.0200),
    "r":     (0.02,  1.008,  0.080,  0.030,   0.030,  0.0200),
    "beta":  (0.06,  1.120, -0.600,  0.000,   0.060,  0.0200),
    "phi":   (0.04,  1.000,  0.300,  0.000,   0.010,  0.0200),
    "theta": (0.04,  1.000,  0.200,  0.000,   0.010,  0.0200),
    "psi":   (0.04,  1.000,  1.000,  0.000,   0.020,  0.0200),
    "ny":    (0.02,  1.000, -0.004,  0.002,   0.002,  0.0005),
}  # fmt: skip
VIBRATION_HZ = (4.0, 8.0)
SAMPLE_S, STEPS = 0.04, 4  # flights take so many steps a sample
DURATION_S, ONSET_S = 30.0, 15.0
ALTITUDE_FT, TAS_KT = 15_000.0, 345.0
TIME_S = np.arange(round(DURATION_S / SAMPLE_S) * STEPS + 1) * SAMPLE_S / STEPS
DRIFT = 0.3  # deg/s²

PULSES = {"3-2-1-1": (3, -2, 1, -1), "doublet": (2, -2), "bang-bang": (2, -4, 2)}  # to either side, in units of time
MANOEUVRES = {  # control, pulses, when they begin (s), unit of time (s), share of full deflection
    "elevator 3-2-1-1": [("elevator", "3-2-1-1", 3.0, 1.0, 0.15)],
    "elevator doublet": [("elevator", "doublet", 4.0, 1.5, 0.12)],
    "aileron bang-bang": [("aileron", "bang-bang", 3.0, 1.0, 0.3)],
    "aileron 3-2-1-1": [("aileron", "3-2-1-1", 3.0, 0.8, 0.25)],
    "rudder doublet": [("rudder", "doublet", 3.0, 1.5, 0.35)],
    "rudder 3-2-1-1": [("rudder", "3-2-1-1", 2.0, 1.0, 0.25)],
    "all three": [
        ("elevator", "3-2-1-1", 2.0, 0.6, 0.12),
        ("aileron", "bang-bang", 9.0, 0.8, 0.3),
        ("rudder", "doublet", 18.0, 1.2, 0.3),
    ],
    "none": [],
}
BROKEN = ("rudder 3-2-1-1", "aileron 3-2-1-1", "all three", "elevator doublet")  # the first three not identified on

FIRST, LATER = ("737", "A320"), ("B747", "global5000")
WEATHERS = ("calm", "turbulent")
LATERAL = ("aileron bang-bang", "rudder doublet")
IDENTIFIED = {  # banks; two are operators from these channels to r
    "C": [("all three",), ("elevator 3-2-1-1",), LATERAL[:1], LATERAL[1:], ("elevator 3-2-1-1", *LATERAL)],
    "p q beta": [("all three",), LATERAL, ("elevator 3-2-1-1", *LATERAL)],
    "p beta ny phi": [("all three",), LATERAL, ("elevator 3-2-1-1", *LATERAL)],
}
Row = dict[str, object]


# ---- records ----


@cache
def sensed(aircraft: str, weather: str, manoeuvre: str, seed: int) -> gb.Record:
    """Fly a manoeuvre and read it with imperfect sensors; the seed is that of turbulence and noise."""
    truth, channels = flown(aircraft, weather, manoeuvre, seed), []
    for number, (name, (lag_s, gain, bias, vibration, noise, quantum)) in enumerate(SENSORS.items()):
        random = np.random.default_rng([seed, number])
        read = gain * lagged(truth[name], lag_s, SAMPLE_S / STEPS)[0][::STEPS] + bias
        read += vibration * shaken(random, len(read)) + noise * random.standard_normal(len(read))
        channels.append(np.rint(read / quantum) * quantum)
    return gb.Record(np.column_stack(channels), channels=list(SENSORS), sample_period_s=SAMPLE_S)


def shaken(random: np.random.Generator, samples: int) -> np.ndarray:
    """Return structural vibration of RMS 1."""
    band = butter(2, VIBRATION_HZ, "bandpass", fs=1.0 / SAMPLE_S, output="sos")
    values = sosfilt(band, random.standard_normal(samples + 250))[250:]
    return values / np.std(values)


def flown(aircraft: str, weather: str, manoeuvre: str, seed: int) -> gb.Record:
    """Fly a manoeuvre from trim."""
    limits = load_aircraft(aircraft).limits
    surfaces = {name: limits[name][1] * share for name, share in commands(manoeuvre).items()}
    moved = Excitation(surfaces=surfaces, turbulence=weather == "turbulent")
    return gb.fly(aircraft, moved, DURATION_S, seed, altitude_ft=ALTITUDE_FT, tas_kt=TAS_KT)


def commands(manoeuvre: str) -> dict[str, np.ndarray]:
    """Return what a manoeuvre adds to the trimmed controls, as shares of full deflection, step by step."""
    added = {name: np.zeros(len(TIME_S)) for name in ("elevator", "aileron", "rudder")}
    for control, pulses, begin_s, unit_s, share in MANOEUVRES[manoeuvre]:
        edges_s = begin_s + unit_s * np.cumsum([0, *map(abs, PULSES[pulses])])
        for pulse, first_s, end_s in zip(PULSES[pulses], edges_s[:-1], edges_s[1:], strict=True):
            added[control][(first_s <= TIME_S) & (end_s > TIME_S)] += np.sign(pulse) * share
    return added


# ---- cases ----


class Case(NamedTuple):
    """A bank, the manoeuvres it is identified on, others that it watches, those in which gyros break, which and how."""

    aircraft: str
    weather: str
    bank: str
    identified: tuple[str, ...]
    watched: tuple[str, ...]
    broken: tuple[str, ...]
    gyros: str
    kinds: tuple[str, ...] = ("jam", "drift", "deadzone", "saturation")


def cases() -> list[Case]:
    """Return all cases."""
    every = []
    for aircraft, weather, (bank, choices) in product(FIRST + LATER, WEATHERS, IDENTIFIED.items()):
        for on in choices:
            others = tuple(name for name in MANOEUVRES if name not in on)
            broken = tuple(name for name in BROKEN if name not in on)[:3]
            every.append(Case(aircraft, weather, bank, on, others, broken, "pqr" if bank == "C" else "r"))
    return every


def example() -> list[Case]:
    """Return a few cases: an aircraft in turbulence, identified on one manoeuvre, watching two others; jams of r."""
    chosen = (LATER[0], "turbulent", ("all three",))
    few = [case for case in cases() if (case.aircraft, case.weather, case.identified) == chosen]
    return [case._replace(watched=("none", *case.broken[:1]), gyros="r", kinds=("jam",)) for case in few]


def monitor_of(case: Case) -> gb.Monitor:
    """Identify the bank for the false alarms an hour that `gtmbench monitor` asks for."""
    bank = gb.load_bank("C") if case.bank == "C" else gb.bank_between(case.bank.split(), ["r"])
    records = [sensed(case.aircraft, case.weather, name, 1 + i) for i, name in enumerate(case.identified)]
    rate = 0.002 if case.bank == "C" else 1.0
    return gb.calibrate(records, bank=bank, false_alarms_per_hour=rate, estimator=gb.Bayesian())


def rows_of(case: Case) -> list[Row]:
    """Watch records that nothing was identified on, healthy and broken; one row each."""
    monitor, rows = monitor_of(case), []
    for name in case.watched:
        healthy = watched(case, name)
        said = [alarm.verdict for alarm in false_alarms(gb.watch(monitor, healthy))]
        rows.append({"manoeuvre": name, "fault": "", "found": bool(said), "said": "; ".join(said)})
        if name in case.broken:
            broken = [fault for gyro in case.gyros for fault in faults(healthy, gyro, case.kinds)]
            rows += [{"manoeuvre": name} | judged(monitor, healthy, fault) for fault in broken]
    about: Row = {"aircraft": case.aircraft, "weather": case.weather, "bank": case.bank}
    about |= {"airliners": ", ".join(LATER if case.aircraft in LATER else FIRST)}
    about |= {"identified on": ", ".join(case.identified)}
    return [about | row for row in rows]


def watched(case: Case, manoeuvre: str) -> gb.Record:
    """Return a record to watch: its seed is none of those that are identified on."""
    return sensed(case.aircraft, case.weather, manoeuvre, 11 + list(MANOEUVRES).index(manoeuvre))


def faults(record: gb.Record, channel: str, kinds: tuple[str, ...]) -> list[gb.Fault]:
    """Return a gyro's faults; deadzone and saturation are sized by what it reads in the record."""
    rms, where = float(np.std(record[channel])), {"channel": channel, "onset_s": ONSET_S}
    every = [
        gb.Jam(**where),
        gb.Drift(**where, slope=DRIFT),
        gb.Deadzone(**where, half_width=max(rms, 0.5)),
        gb.Saturation(**where, limit=max(0.5 * rms, 0.3)),
    ]
    return [fault for fault in every if fault.kind in kinds]


def judged(monitor: gb.Monitor, healthy: gb.Record, fault: gb.Fault) -> Row:
    """Break a gyro and hold what is said against the truth; an alarm before the onset spoils a detection."""
    broken, (*_, vibration, noise, quantum) = gb.inject(healthy, fault), SENSORS[fault.channel]
    verdict = gb.score(gb.watch(monitor, broken), fault=fault, healthy=healthy, broken=broken)
    is_clean = verdict.detected and not verdict.false_alarms
    change = (broken[fault.channel] - healthy[fault.channel])[healthy.time_s >= ONSET_S]
    own = vibration**2 + noise**2 + quantum**2 / 12.0  # what the gyro reads that isn't motion
    return {
        "fault": fault.kind,
        "change": float(np.sqrt(np.mean(change**2) / own)),
        "found": is_clean,
        "spoiled": verdict.false_alarms > 0,
        "right gyro": is_clean and bool(verdict.isolated),
        "wrong gyro": is_clean and verdict.sensor not in (None, fault.channel),
        "right kind": is_clean and bool(verdict.kind_right),
        "delay": verdict.detection_delay_s if is_clean else np.nan,
    }


# ---- the report ----


def report(rows: pd.DataFrame, *, quick: bool) -> str:
    """Return the report as Markdown."""
    c = rows[(rows["bank"] == "C") & rows["aircraft"].isin(LATER)]
    broken = c[c["fault"] != ""]
    edges, names = [-1.0, 0.0, 1.0, 2.0, 5.0, np.inf], ["none at all", "below 1", "1 to 2", "2 to 5", "above 5"]
    sized = broken.assign(size=pd.cut(broken["change"], edges, labels=names)).sort_values("size")
    alarms = [
        f"- {row['aircraft']}, {row['weather']}; bank {row['bank']}, identified on {row['identified on']}, watching "
        f"{row['manoeuvre']}: {row['said']}"
        for row in rows[(rows["fault"] == "") & rows["found"]].to_dict("records")
    ]
    said = "**Quick: one aircraft, one manoeuvre, one jammed gyro. It tells little.**\n\n" if quick else ""
    return f"""# Half a minute of flight of another aircraft, at {1.0 / SAMPLE_S:g} Hz

{said}Written by `python experiments/short_records.py`, with JSBSim {jsbsim.__version__} and its own airliners.
A record is {DURATION_S:g} s long and holds one manoeuvre, calm or in moderate turbulence (Milspec), as imperfect
sensors read it (the script's table says how imperfect). A bank is identified on one manoeuvre, or on
three, and watches the others. Faults begin after {ONSET_S:g} s: jam, drift of {DRIFT:g} deg/s², deadzone of the
record's RMS (0.5 deg/s or more), saturation at half of it (0.3 deg/s or more).

The method was made on the {" and the ".join(FIRST)}; {" and ".join(LATER)} were first flown when it was frozen, and
stand apart. They aren't held out any more: details of the calibration, of operators and of bank C, have changed since,
with records of theirs in view.

{markdown(summary(rows, "bank", "airliners"))}

Bank C: every gyro from the attitude. The others are operators between these channels and r, and it is r that breaks:
they say that one of their sensors broke, not which. Found: an alarm after the onset, and none before. Right gyro,
wrong gyro (the rest is undecided) and right kind (of the sensor that failed, named or the likeliest): of those found,
at the record's end. Of those missed, spoiled: an alarm came before the onset; small: none came, and after the onset the
fault changed what the gyro reads by less (RMS) than what it reads that isn't motion: vibration, noise, rounding.

## Bank C on {" and ".join(LATER)}

{markdown(summary(broken, "fault", "weather"))}

By the change of the gyro's reading, over what it reads that isn't motion (both RMS):

{markdown(summary(sized, "size"))}

By what was identified on:

{markdown(summary(c, "identified on"))}

## Healthy records that alarmed

{chr(10).join(alarms) or "None."}
"""


def summary(rows: pd.DataFrame, *by: str) -> pd.DataFrame:
    """Return what was said of healthy records, if there are any, and of faults."""
    lines = []
    for group, own in rows.groupby(list(by), sort=False, observed=True):
        healthy, broken = own[own["fault"] == ""], own[own["fault"] != ""]
        missed = broken[~broken["found"]]
        line = dict(zip(by, group, strict=True))
        if len(healthy):
            line["healthy records that alarm"] = f"{healthy['found'].sum()} of {len(healthy)}"
        line["faults found"] = f"{broken['found'].sum()} of {len(broken)}"
        line |= {name: int(broken[name].sum()) for name in ("right gyro", "wrong gyro", "right kind")}
        line["median delay (s)"] = f"{broken['delay'].median():.1f}" if broken["found"].any() else ""
        line |= {"missed": len(missed), "spoiled": int(missed["spoiled"].sum())}
        lines.append(line | {"small": int((~missed["spoiled"].astype(bool) & (missed["change"] < 1.0)).sum())})
    return pd.DataFrame(lines)


def draw(path: Path) -> None:
    """Draw r, predicted and measured: where identified, in another manoeuvre, and there with a drift."""
    case = example()[0]
    monitor, other = monitor_of(case), watched(case, case.broken[0])
    shown = {
        f"identified: {case.identified[0]}": sensed(case.aircraft, case.weather, case.identified[0], 1),
        f"watched: {case.broken[0]}": other,
        f"the same, with a drift of r by {DRIFT:g} deg/s²": gb.inject(
            other, gb.Drift(channel="r", onset_s=ONSET_S, slope=DRIFT)
        ),
    }
    figure, axes = panels(2, 3, (14.0, 6.5))
    for column, (title, record) in enumerate(shown.items()):
        watch, (top, bottom) = gb.watch(monitor, record), (axes[0][column], axes[1][column])
        band = 3.0 * float(monitor.operators["r"].rms_residual[0]) * watch.widening["r"]
        top.plot(record.time_s, watch.predictions["r"], color=COLOURS["virtual"], lw=0.8, label="predicted")
        top.plot(record.time_s, record["r"], color="k", lw=1.2, label="measured")
        bottom.fill_between(record.time_s, -band, band, color="0.85", label="3 spreads")
        bottom.plot(record.time_s, watch.residuals["r"], color=COLOURS["r"], lw=0.9, label="residual")
        for alarm in watch.faults:
            top.axvline(alarm.time_s, color=COLOURS["threshold"], label=f"alarm: {alarm.verdict}")
            bottom.axvline(alarm.time_s, color=COLOURS["threshold"])
        top.set(title=title, ylabel="r (deg/s)")
        bottom.set(xlabel="time (s)", ylabel="residual of r (deg/s)")
    handles, labels = (a + b for a, b in zip(*(row[2].get_legend_handles_labels() for row in axes), strict=True))
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    figure.suptitle(f"{case.aircraft}, {case.weather}, bank {case.bank}", fontweight="bold")
    figure.savefig(path, dpi=90)


def main() -> int:
    """Fly, watch, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few cases: shows that it runs, tells little")
    parser.add_argument("--out", type=Path, help="folder of the report; without it only the tables are printed")
    parser.add_argument("--jobs", type=int, help="processes (default: 2; one with --quick)")
    given = parser.parse_args()
    jobs = given.jobs or (1 if given.quick else 2)
    if given.out:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        check_folder(given.out, force=True)
    began, todo = time.monotonic(), example() if given.quick else cases()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of the processes to come
    with progress_bar() as tell:
        done = spread(rows_of, todo, processes=jobs, step="short records", progress=tell)
    text = report(pd.DataFrame([row for rows in done for row in rows]), quick=given.quick)
    print(text)
    if given.out:
        with atomic_folder(given.out) as folder:
            write_report(folder, f"{text}\n![r, predicted and measured](example.png)\n", given)
            draw(folder / "example.png")
    print(f"{time.monotonic() - began:.0f} s" + (f"; report and figure in {given.out}" if given.out else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())
