"""Small UAVs: public JSBSim models, from their folder to the gyro that broke.

    python experiments/small_uavs.py FOLDER [FOLDER ...] [--quick] [--out DIR] [--jobs N]

Every FOLDER holds models as JSBSim has them, ``FOLDER/NAME/NAME.xml`` with ``FOLDER/NAME/Engines``. None is shipped:
the report says of which public repository each was (`SOURCES`, by NAME). Each model is surveyed and trimmed, flown five
minutes open loop, given gains by `gb.find_autopilot`, and flown five minutes at a time in the loop under multisine and
moderate turbulence, on the T2's noise. Bank C is calibrated on three such flights. On two others each gyro drifts and
jams: in the record, and while the autopilot flies on it. Writes report.md, with those that fail and why, and every
trial into DIR; ends with code 1 where a target is missed (never with --quick, whose figures bound nothing).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jsbsim
import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.jobs.processes import spread
from gtmbench.report.markup import markdown
from gtmbench.values.channels import GYROS
from studies.conduct import Campaign, Findings, conducted
from studies.gyro_trials import DRIFT_DEG_S2, Flown, gyro_faults, trial_row
from studies.targets import Target, held, is_missed

EXCITATION = "multisine+turbulence"
WATCHED_FROM_S = 20.0
SOURCES = {  # NAME: what it is, the public repository, its commit, the model's file there
    "X8": ("Skywalker X8, flying wing", "XlokolokiX/X8_FlightGear_JSBSim", "e61139a", "AIRCRAFT/X8_FixedWing/X8.xml"),
    "x8": ("Skywalker X8, another model", "AOS55/Fixedwing-Airsim", "c505448", "x8/x8.xml"),
    "Rascal110-JSBSim": ("Sig Rascal 110", "FGMEMBERS/Rascal", "40e896d", "Rascal110-JSBSim.xml"),
    "YardStik": ("YardStik trainer", "enacuavlab/paparazzi", "2000c84", "conf/simulator/jsbsim/aircraft/YardStik.xml"),
    "Malolo1": ("Malolo 1", "enacuavlab/paparazzi", "2000c84", "conf/simulator/jsbsim/aircraft/Malolo1.xml"),
    "easystar": (
        "Multiplex EasyStar with ailerons",
        "enacuavlab/paparazzi",
        "2000c84",
        "conf/simulator/jsbsim/aircraft/easystar.xml",
    ),
    "easystar_ark": (
        "Multiplex EasyStar, steered by the rudder",
        "arktools/arkhangar",
        "ae5bf01",
        "aircraft/easystar/easystar.xml",
    ),
    "Eternity": ("Eternity", "enacuavlab/paparazzi", "2000c84", "conf/simulator/jsbsim/aircraft/Eternity.xml"),
    "minion": (
        "AggieAir Minion",
        "enacuavlab/paparazzi",
        "2000c84",
        "conf/simulator/jsbsim/aircraft/AGGIEAIR/minion.xml",
    ),
    "EPPFPV": ("EPP FPV", "ocereceda/JSBSim-UAVs", "4d0c4c0", "aircraft/EPPFPV/EPPFPV.xml"),
    "GBS_3": ("Giant Big Stik", "ocereceda/JSBSim-UAVs", "4d0c4c0", "aircraft/GBS_3/GBS_3.xml"),
    "rc_plane": ("RC plane", "prasunjha8/jsbsim_droame", "eff3072", "rc_plane/rc_plane.xml"),
    "cyclone": (
        "Cyclone tail-sitter",
        "enacuavlab/paparazzi",
        "2000c84",
        "conf/simulator/jsbsim/aircraft/cyclone.xml",
    ),
    "falcon": (
        "Falcon, quadplane",
        "enacuavlab/paparazzi",
        "2000c84",
        "conf/simulator/jsbsim/aircraft/falcon.xml",
    ),
    "disco_rotorcraft": (
        "Disco with rotors",
        "enacuavlab/paparazzi",
        "2000c84",
        "conf/simulator/jsbsim/aircraft/disco_rotorcraft.xml",
    ),
}
Row = dict[str, Any]


class Size(NamedTuple):
    """How much is flown: seeds of calibration and test flights, how long, and where faults begin."""

    calibration: tuple[int, ...] = (1, 2, 3)
    tests: tuple[int, ...] = (101, 102)
    duration_s: float = 300.0
    onset_s: float = 150.0


class Task(NamedTuple):
    """A model's folder, and how much of it."""

    folder: Path
    size: Size


def tried(task: Task) -> Flown:
    """Survey, trim, fly, find gains, calibrate, break and watch; stop where that can't be done, and say why."""
    began, name, size = time.monotonic(), task.folder.name, task.size
    about: Row = {"model": name, "failed": "", "why": "", "alone_s": np.nan}
    trials: list[Row] = []
    stage = "load"
    try:
        craft = load_aircraft(task.folder, without_io=True)
        stage = "trim"
        trim = gb.trim(craft)
        about |= {"tas_kt": trim.tas_kt, "alpha": trim.alpha_deg, "throttle": trim.throttle_percent}
        about |= {"spun": craft.spin_up, "steps": craft.steps_a_sample, "rudderless": craft.rudderless}
        about["growing"] = ", ".join(mode.name for mode in gb.modes(craft) if mode.real_1_s > 0.0)
        about["alone_s"] = flown_alone_s(craft, size)
        stage = "gains"
        tuned = gb.find_autopilot(craft)
        craft = replace(craft, autopilot=tuned.autopilot)
        about |= {"off_ft": tuned.altitude_off_ft, "off_kt": tuned.tas_off_kt, "bank": tuned.bank_deg}
        stage = "flight in the loop"
        records = [in_loop(craft, size, seed).sensed for seed in size.calibration]
        healthy = {seed: in_loop(craft, size, seed).sensed for seed in size.tests}
        about |= {f"rms {gyro}": float(np.std(healthy[size.tests[0]][gyro])) for gyro in GYROS}
        stage = "calibration"
        monitor = gb.calibrate(records, bank=gb.load_bank("C"))
        for seed, record in healthy.items():
            trials += [{"model": name, "seed": seed} | row for row in judged(craft, size, monitor, seed, record)]
    except gb.GtmbenchError as error:
        about |= {"failed": stage, "why": said(error, task.folder)}
    return Flown(about | {"seconds": time.monotonic() - began}, trials)


def said(error: gb.GtmbenchError, folder: Path) -> str:
    """Return an error without this machine's paths, and short."""
    text = str(error).replace(f"{folder}/", "").replace(str(folder), folder.name)
    return text if len(text) < 330 else text[:330].rsplit(" ", 1)[0] + " ..."


def flown_alone_s(craft: gb.Aircraft, size: Size) -> float:
    """Return how long it stays in its envelope open loop, up to the flight's length."""
    simulation = gb.Simulation(craft, EXCITATION, size.duration_s, noise=None)
    simulation.reset(size.calibration[0])
    level = list(simulation.trim.commands.values())
    while not simulation.is_over:
        simulation.step(level)
    return simulation.time_s


def in_loop(craft: gb.Aircraft, size: Size, seed: int, faults: gb.Fault | tuple[()] = ()) -> gb.LoopFlight:
    """Fly in the loop, in the air of the seed."""
    flight = gb.fly_in_loop(craft, EXCITATION, size.duration_s, seed, faults=faults)
    if not faults and flight.departed_s is not None:
        raise gb.GtmbenchError(f"'{craft.name}' departs at {flight.departed_s:g} s with nothing broken (seed {seed})")
    return flight


def judged(craft: gb.Aircraft, size: Size, monitor: BankMonitor, seed: int, record: gb.Record) -> list[Row]:
    """Break each gyro in both ways, in the record and in the loop, and hold what is said against the truth."""
    rows = []
    for fault in gyro_faults(size.onset_s):
        flight = in_loop(craft, size, seed, fault)
        for how, broken in (("record", gb.inject(record, fault)), ("loop", flight.sensed)):
            until_s = min(broken.end_s, record.end_s)
            flown, sound = (each.between(WATCHED_FROM_S, until_s) for each in (broken, record))
            departed = {"departed_s": flight.departed_s if how == "loop" else None}
            rows.append({"how": how} | trial_row(monitor, fault, sound, flown) | departed)
    return rows


# ---- figures of merit ----


def merits(abouts: list[Row], trials: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return what the targets ask for."""
    figures: dict[str, dict[str, float]] = {
        "models": {
            "trim": sum(about["failed"] not in ("load", "trim") for about in abouts),
            "fly": sum(not about["failed"] for about in abouts),
        }
    }
    for how in ("record", "loop"):
        own = trials[trials["how"] == how] if len(trials) else trials
        figures[how] = {key: float(own[key].mean()) if len(own) else np.nan for key in ("right", "wrong", "kind")}
    return figures


TARGETS = (
    Target("public small UAVs that trim and fly 300 s: at least 5", "models", "fly", ">=", 5),
    Target("in a record: drift and jam of each gyro named, at least 90 %", "record", "right", ">=", 0.9),
    Target("in a record: another sensor named, none", "record", "wrong", "<=", 0.0),
)


# ---- the report ----


def report(abouts: list[Row], trials: pd.DataFrame, figures: Mapping[str, Mapping[str, float]], size: Size) -> str:
    """Return the report as Markdown."""
    quick = "" if size == Size() else "**Quick: short flights. It bounds nothing.**\n\n"
    flown = [about for about in abouts if not about["failed"]]
    failed = [{key: about[key] for key in ("model", "failed", "why")} for about in abouts if about["failed"]]
    return f"""# Small UAVs

{quick}Written by `python experiments/small_uavs.py FOLDER`, with JSBSim {jsbsim.__version__}, of {len(abouts)} public
models, none of which ships: FOLDER holds them as `NAME/NAME.xml`, with `NAME/Engines`. No model was edited, and none
has an `aircraft.toml`: all is found by the survey. Each is trimmed at 5,000 ft, flown open loop, and given gains by
`gb.find_autopilot`. Bank C is calibrated on {len(size.calibration)} flights of {size.duration_s:g} s in the loop
({EXCITATION}, the same moderate turbulence that shakes airliners; T2 noise), and watches {len(size.tests)} others. From
{size.onset_s:g} s on a gyro drifts by {DRIFT_DEG_S2:g} deg/s² or is jammed: in the flight's record, and, flown again,
in the loop, where the autopilot reads it. The survey and the search for gains were made to work on these models; no
monitor, threshold or verdict was.

## Targets

{markdown(held(TARGETS, figures))}

{figures["models"]["trim"]:g} of {len(abouts)} trim. In the loop {figures["loop"]["right"]:.0%} are named right and
{figures["loop"]["wrong"]:.0%} wrong.

## Sources

{markdown(pd.DataFrame([source(about["model"]) for about in abouts]))}

## Those that fly

*Turned up*: its propeller is spun up before the flight; steps: JSBSim's in a sample of 0.01 s. *Open loop*: how long it
stays in its envelope without an autopilot. *Off*: the greatest deviation of altitude and speed, and the greatest bank,
in ten minutes of turbulence. RMS: of the gyros in the first test flight, noise included. Right: the gyro that broke is
named in the end; wrong: another sensor is.

{markdown(pd.DataFrame([line(about, trials) for about in flown])) if flown else "None."}

What was missed, or named otherwise:

{misses(trials)}

## Those that don't

{markdown(pd.DataFrame(failed)) if failed else "None."}
"""


def source(name: str) -> Row:
    """Return where a model is from."""
    what, repository, commit, path = SOURCES.get(name, ("", "a user's", "", ""))
    return {"model": f"`{name}`", "is": what, "repository": repository, "commit": commit, "file": path}


def line(about: Row, trials: pd.DataFrame) -> Row:
    """Return a model's line of the table."""
    own = trials[trials["model"] == about["model"]]
    record, loop = (own[own["how"] == how] for how in ("record", "loop"))
    alone_s = about["alone_s"]
    return {
        "model": f"`{about['model']}`",
        "at (kt)": f"{about['tas_kt']:.0f}",
        "alpha (deg)": f"{about['alpha']:.1f}",
        "throttle (%)": f"{about['throttle']:.0f}",
        "turned up, steps": f"{'yes' if about['spun'] else 'no'}, {about['steps']}",
        "rudder": "none" if about["rudderless"] else "yes",
        "growing": about["growing"] or "none",
        "open loop (s)": f"{alone_s:.0f}",
        "off (ft, kt, deg)": f"{about['off_ft']:.0f}, {about['off_kt']:.0f}, {about['bank']:.0f}",
        "RMS of p, q, r (deg/s)": ", ".join(f"{about[f'rms {name}']:.1f}" for name in GYROS),
        "record: right": f"{record['right'].sum()} of {len(record)}",
        "kind": int(record["kind"].sum()),
        "wrong": int(record["wrong"].sum()),
        "median delay (s)": f"{record['delay_s'].median():.1f}",
        "loop: right": f"{loop['right'].sum()} of {len(loop)}",
        "wrong in the loop": int(loop["wrong"].sum()),
        "departed": int(loop["departed_s"].notna().sum()),
        "false alarms": int(own["false_alarms"].sum()),
    }


def misses(trials: pd.DataFrame) -> str:
    """List the trials in which the gyro that broke isn't named."""
    if not len(trials):
        return "None."
    return (
        "\n".join(
            f"- {row['model']}, seed {row['seed']}, {row['how']}: {row['fault']} of {row['channel']}: "
            f"{row['verdict'] or 'not detected'}"
            for row in trials[~trials["right"]].to_dict("records")
        )
        or "None."
    )


def models_in(folders: list[Path]) -> list[Path]:
    """Return the models' folders in some folders.

    Raises
    ------
    GtmbenchError
        If there are none.
    """
    found = [there for folder in folders for there in sorted(folder.resolve().glob("*")) if is_model(there)]
    if not found:
        given = ", ".join(map(str, folders))
        raise gb.GtmbenchError(f"no models in {given}; each is a folder NAME with NAME.xml")
    return sorted(found, key=lambda there: there.name.casefold())


def is_model(folder: Path) -> bool:
    """Tell whether a folder NAME holds NAME.xml."""
    return (folder / f"{folder.name}.xml").is_file()


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    size = Size((1, 2), (101,), 70.0, 40.0) if campaign.quick else Size()
    tasks = [Task(folder, size) for folder in models_in(campaign.given.folders)]
    done = spread(tried, tasks, processes=campaign.jobs, step="models", progress=campaign.tell)
    abouts = sorted((flown.about for flown in done), key=lambda about: about["model"].casefold())
    trials = pd.DataFrame([row for flown in done for row in flown.trials])
    figures = merits(abouts, trials)

    def write(out: Path) -> None:
        (out / "figures.json").write_text(json.dumps(figures, indent=2) + "\n")
        trials.to_csv(out / "trials.csv", index=False)

    return Findings(report(abouts, trials, figures, size), is_missed(TARGETS, figures), write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Take the folders of models."""
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="holds models, NAME/NAME.xml each")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="short flights", beside="trials", arguments=arguments))
