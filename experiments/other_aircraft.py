"""Other aircraft: every one that comes with JSBSim, from its name to the sensor that broke.

    python experiments/other_aircraft.py [--quick] [--out DIR] [--jobs N]

Trims each, flies it five minutes at a time under multisine and turbulence, scaled to it, reads it with the T2's noise,
calibrates bank C on three of those flights, and breaks each gyro on two others, by a drift and by a jam. One that
leaves its envelope open loop flies all of these in the loop instead, if gains are known. Nothing was chosen with these
verdicts in view; trim points were chosen so that aircraft fly. Writes report.md, with those that fail and why, and
every trial into DIR; prints the tables, and ends with code 1 where a target is missed (never with --quick, whose
figures bound nothing).
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jsbsim
import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.excitation import Excitation
from gtmbench.bench.known_aircraft import jsbsim_aircraft, load_aircraft
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.jobs.processes import spread
from gtmbench.report.markup import markdown
from gtmbench.values.channels import GYROS
from studies.conduct import Campaign, Findings, conducted
from studies.gyro_trials import DRIFT_DEG_S2, Flown, gyro_faults, trial_row
from studies.targets import Target, held, is_missed

USUAL, OTHER = "multisine+turbulence", "doublets+turbulence"
NOISE = "t2"
WATCHED_FROM_S = 20.0
CALM_S = 60.0
Row = dict[str, Any]


class Size(NamedTuple):
    """How much is flown: calibration flights of so many seconds, and where faults begin in others."""

    names: tuple[str, ...]
    calibration: int = 3
    duration_s: float = 300.0
    onset_s: float = 150.0


class Task(NamedTuple):
    """An aircraft, and how much of it."""

    name: str
    size: Size


def tried(task: Task) -> Flown:
    """Trim, fly, calibrate, break and watch; stop where that can't be done, and say why."""
    began, about = time.monotonic(), {"aircraft": task.name, "failed": "", "why": ""}
    trials: list[Row] = []
    stage = "trim"
    try:
        craft = load_aircraft(task.name)
        trim = gb.trim(craft)
        about |= {"title": craft.title, "altitude_ft": trim.altitude_ft, "tas_kt": trim.tas_kt, "alpha": trim.alpha_deg}
        about["growing"] = ", ".join(mode.name for mode in gb.modes(craft) if mode.real_1_s > 0.0)
        stage = "flight"
        calm = gb.fly(craft, Excitation(), CALM_S)
        about["calm"] = float(calm["altitude"][-1] - calm["altitude"][0])
        about["flown"], records, others = flown(task, craft)
        about["climb"] = float(np.mean([record["altitude"][-1] - trim.altitude_ft for record in records]))
        about |= {f"rms {name}": float(np.std(others[USUAL][name])) for name in GYROS}
        stage = "calibration"
        monitor = gb.calibrate(records, bank=gb.load_bank("C"))
        for excitation, healthy in others.items():
            trials += [
                {"aircraft": task.name, "excitation": excitation} | row for row in judged(task, monitor, healthy)
            ]
    except gb.GtmbenchError as error:
        about |= {"failed": stage, "why": str(error).replace(f"{jsbsim_aircraft()[task.name]}/", "")}
    return Flown(about | {"seconds": time.monotonic() - began}, trials)


def flown(task: Task, craft: gb.Aircraft) -> tuple[str, list[gb.Record], dict[str, gb.Record]]:
    """Return how an aircraft was flown, the flights of calibration, and the others by excitation."""
    for how, read in (("open loop", reading), ("in the loop", reading_in_loop)):
        try:
            records = [read(task, USUAL, seed) for seed in range(1, task.size.calibration + 1)]
            return how, records, {excitation: read(task, excitation, 101) for excitation in (USUAL, OTHER)}
        except gb.EnvelopeError as error:
            left = error
            if craft.autopilot is None:
                break
    raise left


def reading(task: Task, excitation: str, seed: int) -> gb.Record:
    """Fly, and read with the T2's noise."""
    return gb.measure(gb.fly(task.name, excitation, task.size.duration_s, seed), noise=NOISE, seed=seed)


def reading_in_loop(task: Task, excitation: str, seed: int) -> gb.Record:
    """Fly in the loop, and return what its sensors read."""
    return gb.fly_in_loop(task.name, excitation, task.size.duration_s, seed, noise=NOISE).sensed


def judged(task: Task, monitor: BankMonitor, record: gb.Record) -> list[Row]:
    """Break each gyro in both ways, and hold what is said against the truth."""
    span_s = WATCHED_FROM_S, task.size.duration_s
    healthy = record.between(*span_s)
    return [
        trial_row(monitor, fault, healthy, gb.inject(record, fault).between(*span_s))
        for fault in gyro_faults(task.size.onset_s)
    ]


# ---- figures of merit ----


def is_named(trials: pd.DataFrame) -> bool:
    """Tell whether an aircraft's gyros are all named, drifting and jammed, on the flight like those of calibration."""
    usual = trials[trials["excitation"] == USUAL]
    return len(usual) == 2 * len(GYROS) and bool(usual["right"].all())


def merits(trials: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return what the targets ask for."""
    usual = trials[trials["excitation"] == USUAL]
    airbus = usual[usual["aircraft"] == "A320"]
    return {
        "all": {
            "flown": trials["aircraft"].nunique(),
            "named": sum(is_named(own) for _, own in trials.groupby("aircraft")),
            "right": float(usual["right"].mean()),
            "wrong": float(usual["wrong"].mean()),
        },
        "A320": {"right": int(airbus["right"].sum()), "kind": int(airbus["kind"].sum())},
    }


TARGETS = (
    Target("aircraft that trim and fly 300 s: at least 40", "all", "flown", ">=", 40),
    Target("aircraft that trim, fly and have all six faults named: at least 24", "all", "named", ">=", 24),
    Target("A320: right gyro 6 of 6", "A320", "right", ">=", 6),
    Target("A320: right kind 6 of 6", "A320", "kind", ">=", 6),
)


# ---- the report ----


def report(abouts: list[Row], trials: pd.DataFrame, figures: Mapping[str, Mapping[str, float]], size: Size) -> str:
    """Return the report as Markdown."""
    flown = [about for about in abouts if not about["failed"]]
    failed = [about for about in abouts if about["failed"]]
    why = pd.DataFrame([{key: about[key] for key in ("aircraft", "failed", "why")} for about in failed])
    quick = "" if len(size.names) > 2 else "**Quick: two aircraft, short flights. It bounds nothing.**\n\n"
    return f"""# Other aircraft

{quick}Written by `python experiments/other_aircraft.py`, with JSBSim {jsbsim.__version__}: {len(abouts)} of its own
aircraft, by name, each at the trim that gtmbench knows of it (or finds). Bank C is calibrated on
{size.calibration} flights of {size.duration_s:g} s ({USUAL}, scaled to the aircraft; T2 noise), and watches two
others: one of the same kind and one of doublets; in the loop where an aircraft leaves its envelope open loop. From
{size.onset_s:g} s on a gyro drifts by {DRIFT_DEG_S2:g} deg/s² or is jammed.

## Targets

{markdown(held(TARGETS, figures))}

## Those that fly

*Growing*: linear modes that do. *Climbs*: in a minute of still air without excitation, and over a calibration flight.
Right: the gyro that broke is named in the end, of its six faults; kind: as injected.

{markdown(pd.DataFrame([line(about, trials) for about in flown]))}

What was missed, or named otherwise:

{misses(trials)}

## Those that don't

{markdown(why) if failed else "None."}
"""


def line(about: Row, trials: pd.DataFrame) -> Row:
    """Return an aircraft's line of the table."""
    own = trials[trials["aircraft"] == about["aircraft"]]
    usual, other = (own[own["excitation"] == excitation] for excitation in (USUAL, OTHER))
    return {
        "aircraft": f"`{about['aircraft']}`",
        "is": about["title"],
        "at (ft, kt)": f"{about['altitude_ft']:.0f}, {about['tas_kt']:.0f}",
        "alpha (deg)": f"{about['alpha']:.1f}",
        "growing": about["growing"] or "none",
        "flown": about["flown"],
        "calm: climbs (ft)": f"{about['calm']:.0f}",
        "excited: climbs (ft)": f"{about['climb']:.0f}",
        "RMS of p, q, r (deg/s)": ", ".join(f"{about[f'rms {name}']:.1f}" for name in GYROS),
        "right": f"{usual['right'].sum()} of {len(usual)}",
        "kind": int(usual["kind"].sum()),
        "doublets: right": f"{other['right'].sum()} of {len(other)}",
        "doublets: kind": int(other["kind"].sum()),
        "median delay (s)": f"{own['delay_s'].median():.1f}",
        "false alarms": int(own["false_alarms"].sum()),
    }


def misses(trials: pd.DataFrame) -> str:
    """List the trials in which the gyro that broke isn't named."""
    return (
        "\n".join(
            f"- {row['aircraft']}, {row['excitation']}: {row['fault']} of {row['channel']}: "
            f"{row['verdict'] or 'not detected'}"
            for row in trials[~trials["right"]].to_dict("records")
        )
        or "None."
    )


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    size = Size(("A320", "c172p"), 2, 70.0, 40.0) if campaign.quick else Size(tuple(jsbsim_aircraft()))
    tasks = [Task(name, size) for name in size.names]
    done = spread(tried, tasks, processes=campaign.jobs, step="aircraft", progress=campaign.tell)
    abouts = sorted((flown.about for flown in done), key=lambda about: about["aircraft"].casefold())
    trials = pd.DataFrame([row for flown in done for row in flown.trials])
    figures = merits(trials)

    def write(out: Path) -> None:
        (out / "figures.json").write_text(json.dumps(figures, indent=2) + "\n")
        trials.to_csv(out / "trials.csv", index=False)

    return Findings(report(abouts, trials, figures, size), is_missed(TARGETS, figures), write)


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="two aircraft, short flights", beside="trials"))
