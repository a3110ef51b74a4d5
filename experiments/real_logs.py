"""Recorded flights, one row a log: what is said of each, of faults that are put on it, and of wrong readings of it.

    python experiments/real_logs.py [FOLDER ...] [--synthetic] [--gtm N] [--broken N] [--misread N] [--kept DIR]
        [--quick] [--out DIR]

Watches every log below the folders as `gtmbench monitor LOG` does: nobody says what is healthy. Those
that end with 0, every nth of them (`--broken`), are watched with faults of eight kinds, each on one gyro, from a drawn
time on: on the gyro alone, and with an attitude that follows through an estimator of 5 s. Every nth log's flight
(`--misread`, 3) is read in 23 wrong ways (`recorded/mutations.py`),
by bank C, identified on its first half. `--synthetic` adds the healthy logs of `gtmbench.testing.mechanisms`, `--gtm`
so many healthy flights of the GTM. Prints tables; writes report.md, logs.csv, faults.csv and readings.csv into DIR. No
log is kept. Ends with code 1 where a target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.jobs.processes import spread
from gtmbench.report.markup import markdown
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.verdict.verdict import Outcome
from recorded.flights import CHANNELS, LogFile
from recorded.study import OF_LOG, QUICK, UNTIL, Row, Size, Task, studied
from recorded.truths import TRUTHS
from recorded.whole import ALONE, CANT_TELL, EITHER_OR, NAMED, NOTHING, SLOW, THROUGH, USUAL, WRONG
from studies.conduct import DETAILS, Campaign, Findings, conducted
from studies.tables import grouped
from studies.targets import Target, held, is_missed

SYNTHETIC, GTM = "synthetic", "gtm"
SEEDS = 2  # of every mechanism
GTM_S = 240.0
SAID_QUICK = "**Quick: few faults and readings of each log. It shows that the script runs, and bounds nothing.**\n\n"
REPOSITORIES = {  # of public logs, by how their files are called here
    "PX4/pyulog": "`test/`",
    "PX4/flight-review-rs": "`crates/converter/tests/fixtures/`",
    "dronekit/dronekit-la-testdata": "",
    "BeastAyyG/ardupilot-log-diagnosis": "`sample.bin`, a `log_0036`",
    "erlerobot/logs": "a name has its folders",
    "huangwen0907/File": "`hw_`",
    "ArduPilot/UAVLogViewer": "`src/assets/vtol.tlog`",
    "joeydouglas/dataflash_logs": "`jd_`",
    "AscendEngineering/UpgradeEnergy": "`test.ulg`",
    "MarcusUWA/EAICS": "`eaics_`, `flight.tlog`",
    "SuWeipeng/ArduPilotLog": "`suwei_`",
    "Javiercerna/pixhawk-flight-time": "`jc_`, `logs/`",
    "ahmadkhanfar/TLOG": "`ak_`",
    "jschall/magfit_scaling": "`jschall_`",
    "lerlis/RLS-fault-diagnosis-for-RflyMAD": "`rfly_`, `data/`: motors that are made to fail",
    "DependableSystemsLab/DeLorean": "`dl_`, `data/`; simulated, some attacked, and nothing says which",
    "Alexishere01/mavrik-control": "`mavrik_`, `forwardFlight/logs/`; simulated",
    "1202martin/pymavlink_tutorial": "`martin_`, `logs/`; simulated",
    "maikbasso/drone-control": "`maik_`, `logs/`; simulated",
    "aiba4531/DarpaTriage": "`darpa_`, `logs/`; simulated",
    "skapila/Control_Tunning_Project": "`skapila_`, `ArdupilotRcTraining/logs/`; simulated",
    "DaniGitman79/uav-sysid": "`dani_`; simulated",
    "Gehtschon/autonomous-soaring": "`gehtschon_`; simulated",
}
INTRODUCTION = """Logs of public repositories, watched from end to end as `gtmbench monitor LOG` does; nobody says
what is healthy. On those that end with 0 faults of eight kinds are put on a gyro, *alone* and through an estimator of
5 s; *found* is an alarm that isn't there without the fault, *wrong* the name of another sensor. Flights are misread in
23 ways; causes should be right, and none may end with 0. Each log, fault and repository: `results.json`.
"""
COLUMNS = (
    ["group", "log", *OF_LOG],
    [
        "group",
        "log",
        "exit_healthy",
        "sensor",
        "fault",
        "kind",
        "attitude",
        "onset_s",
        "found_s",
        "said",
        "exit",
        "doubt",
    ],
    ["group", "log", "reading", "exit", "is_right", "is_wrong"],
)
Cell = Callable[[pd.DataFrame], object]


class Study(NamedTuple):
    """Rows of a group of logs: a log, a fault, a reading each."""

    logs: pd.DataFrame
    faults: pd.DataFrame
    readings: pd.DataFrame

    def of(self, column: str, value: str) -> Study:
        """Return the rows with a value."""
        return Study(*(frame[frame[column] == value] for frame in self))


# ---- tables ----


def counted(column: str, value: object = True) -> Cell:
    """Return what counts the rows with a value."""
    return lambda of: int((of[column] == value).sum())


OF_FAULTS: dict[str, Cell] = {
    "faults": len,
    "found": lambda of: int((of["said"] != NOTHING).sum()),
    **{name: counted("said", name) for name in (NAMED, EITHER_OR, CANT_TELL, WRONG)},
    "exit 0": counted("exit", Outcome.HEALTHY),
}
OF_READINGS: dict[str, Cell] = {
    "misread": len,
    "can't tell": counted("exit", Outcome.UNKNOWN),
    "exit 0": counted("exit", Outcome.HEALTHY),
    "a sensor accused": counted("exit", Outcome.FAILED),
    "right": counted("is_right"),
    "wrong cause": counted("is_wrong"),
}


def percent(part: float, of: float) -> str:
    """Write a share; a dash where there is nothing to share."""
    return f"{100.0 * part / of:.0f}" if of else "-"


def row_of(log: Row) -> Row:
    """Return a log's row of the table."""
    return {
        "log": log["log"],
        "Hz": f"{log['rate_hz']:.3g}",
        "s": f"{log['logged_s']:.0f}",
        "exit": log["exit"],
        "verdict": log["verdict"],
        "left (s)": f"{log['left_s']:.0f}",
        "watched (%)": percent(log["armed_s"], log["left_s"]),
        "judged (%)": percent(log["watched_s"], log["left_s"]),
        "CPU (s)": f"{log['cpu_s']:.1f}",
    }


def summary(groups: dict[str, Study]) -> pd.DataFrame:
    """Return the first table: a column a group."""
    return (
        pd.DataFrame([{"": name, **figures_text(study)} for name, study in groups.items()])
        .set_index("")
        .T.reset_index(names="")
    )


def figures_text(study: Study) -> dict[str, str]:
    """Return what the first table says of a group."""
    logs, figures = study.logs, figures_of(study)
    unknown = logs[logs["exit"] == Outcome.UNKNOWN]
    able = logs[logs["exit"] != Outcome.FAILED]
    until = int(unknown["verdict"].str.contains(f"No fault found {UNTIL}").sum())
    said = {
        "logs": f"{len(logs)}",
        "healthy accused": f"{figures['accused']:.0f}",
        "end with 0": f"{(logs['exit'] == Outcome.HEALTHY).sum()}",
        "a failure found": f"{(logs['exit'] == Outcome.FAILED).sum()}",
        "can't tell": f"{len(unknown)} ({percent(len(unknown), len(logs))} %)",
        "of these, judged until a crash": f"{until}",
        "of these, with a true failure": f"{(unknown['truth'] != '').sum()}",
        "watched by residuals, of the time left": percent(able["armed_s"].sum(), able["left_s"].sum()) + " %",
        "or by means": percent(able["watched_s"].sum(), able["left_s"].sum()) + " %",
        "CPU": f"{logs['cpu_s'].sum():.0f} s",
    }
    for attitude in (ALONE, THROUGH):
        for kind in (USUAL, SLOW):
            own = of_faults(study, attitude, kind)
            shares = [percent((own["said"] == each).sum(), len(own)) for each in (NAMED, WRONG)]
            found = percent((own["said"] != NOTHING).sum(), len(own))
            said[f"{kind} faults, {attitude}: found / named / wrong"] = (
                f"{found} / {shares[0]} / {shares[1]} % of {len(own)}" if len(own) else "-"
            )
    readings = study.readings
    said["wrong readings with 0; right cause"] = (
        f"{figures['exit 0']:.0f} of {len(readings)}; {percent(readings['is_right'].sum(), len(readings))} %"
        if len(readings)
        else "-"
    )
    return said


def of_faults(study: Study, attitude: str, kind: str, *, healthy: bool = False) -> pd.DataFrame:
    """Return the faults of a kind, put through an attitude; of logs that end with 0 only, where that is asked."""
    faults = study.faults
    own = faults[(faults["attitude"] == attitude) & (faults["kind"] == kind)]
    return own[own["exit_healthy"] == Outcome.HEALTHY] if healthy else own


def section(group: str, study: Study) -> str:
    """Return what is told of a group of logs."""
    if not len(study.logs):
        return f"## {group}\n\nno log"
    parts = [
        f"## {group}",
        markdown(held(targets_of(group, study), {group: figures_of(study)})),
        markdown(pd.DataFrame([row_of(log) for log in study.logs.to_dict("records")])),
    ]
    if len(study.faults):
        by = {"exit without": "exit_healthy", "attitude": "attitude", "kind": "kind"}
        parts.append(markdown(grouped(study.faults.sort_values("exit_healthy"), by, OF_FAULTS)))
        parts.append(markdown(grouped(study.faults, {"fault": "fault", "attitude": "attitude"}, OF_FAULTS)))
        open_faults = study.faults[study.faults["said"] == CANT_TELL]
        if len(open_faults):
            cells = {"can't tell": len, **{name: counted("attitude", name) for name in (ALONE, THROUGH)}}
            parts.append("Why a fault that is found isn't named:")
            parts.append(markdown(grouped(open_faults, {"doubt": "doubt"}, cells).sort_values("can't tell")[::-1]))
        if len(wrong := study.faults[study.faults["said"] == WRONG]):
            parts.append(markdown(wrong[["log", "sensor", "fault", "attitude", "onset_s"]]))
    if len(study.readings):
        parts.append(markdown(grouped(study.readings, {"reading": "reading"}, OF_READINGS)))
    return "\n\n".join(parts)


def failures(logs: pd.DataFrame) -> str:
    """Return the table of true failures: what failed, whence that is known, and what is said."""
    rows = [
        {
            "log": log["log"],
            "what failed": TRUTHS[log["log"]].what,
            "known from": TRUTHS[log["log"]].source,
            "exit": log["exit"],
            "verdict": log["verdict"],
        }
        for log in logs[logs["truth"] != ""].to_dict("records")
    ]
    return f"## True failures\n\n{markdown(pd.DataFrame(rows))}" if rows else ""


# ---- targets ----


def targets_of(group: str, study: Study) -> tuple[Target, ...]:
    """Return what is asked of a group, of faults and wrong readings only where there are some."""
    asked = [
        ("healthy logs accused", "accused", "<=", 0.0),
        ("logs that end with can't tell, share", "can't tell", "<=", 0.25),
        ("the time left that is watched, share (no failure found)", "watched", ">=", 0.85),
    ]
    if len(study.faults):
        asked += [
            ("faults on the gyro alone, logs that end with 0, found, share", "found alone", ">=", 0.92),
            ("of the same, named, share", "named alone", ">=", 0.8),
            ("faults through an estimator, logs that end with 0, found, share", "found through", ">=", 0.8),
            ("of the same, named, share", "named through", ">=", 0.6),
            ("all faults, named wrong, share", "wrong", "<=", 0.005),
            ("biases of 1 deg/s and drifts that reach it, found, share", "slow", ">=", 0.85),
        ]
    if len(study.readings):
        asked += [
            ("wrong readings that end with 0", "exit 0", "<=", 0.0),
            ("wrong readings whose cause is right, share", "causes", ">=", 0.95),
        ]
    if (study.logs["truth"] != "").any():
        asked.append(("true failures that end with 0", "missed", "<=", 0.0))
    return tuple(Target(text, group, which, sense, bound) for text, which, sense, bound in asked)


def figures_of(study: Study) -> dict[str, float]:
    """Return the figures that the targets are of."""
    logs, faults, readings = study
    able = logs[logs["exit"] != Outcome.FAILED]
    alone, through = (of_faults(study, attitude, USUAL, healthy=True) for attitude in (ALONE, THROUGH))
    slow = pd.concat([of_faults(study, attitude, SLOW, healthy=True) for attitude in (ALONE, THROUGH)])
    return {
        "accused": float(((logs["exit"] == Outcome.FAILED) & ~logs["is_right"].astype(bool)).sum()),
        "can't tell": float((logs["exit"] == Outcome.UNKNOWN).mean()),
        "watched": float(able["watched_s"].sum() / max(able["left_s"].sum(), 1.0)),
        "found alone": float((alone["said"] != NOTHING).mean()),
        "named alone": float((alone["said"] == NAMED).mean()),
        "found through": float((through["said"] != NOTHING).mean()),
        "named through": float((through["said"] == NAMED).mean()),
        "wrong": float((faults["said"] == WRONG).mean()),
        "slow": float((slow["said"] != NOTHING).mean()),
        "exit 0": float((readings["exit"] == Outcome.HEALTHY).sum()),
        "causes": float(readings["is_right"].astype(float).mean()),
        "missed": float(((logs["truth"] != "") & (logs["exit"] == Outcome.HEALTHY)).sum()),
    }


# ---- all of it ----


def tasks(folders: Sequence[Path], size: Size, *, broken: int, misread: int, kept: Path | None) -> list[Task]:
    """Return every file of some folders, each a group; of files that are alike, the first.

    Every nth is broken, and misread.
    """

    def of(number: int) -> Size:
        faults = size.faults if broken and number % broken == 0 else ()
        return Size(faults=faults, readings=size.readings if misread and number % misread == 0 else ())

    once: dict[bytes, Task] = {}
    for folder in folders:
        for number, path in enumerate(sorted(path for path in folder.rglob("*") if path.is_file())):
            log = LogFile(path, str(path.relative_to(folder)))
            task = Task(log, folder.resolve().name, of(number), kept)
            once.setdefault(hashlib.sha256(path.read_bytes()).digest(), task)
    return list(once.values())


def made(folder: Path, *, synthetic: bool, flights: int) -> list[Path]:
    """Write the logs that are made, as tables, into folders of their own."""
    written = []
    if synthetic:
        (folder / SYNTHETIC).mkdir()
        written.append(folder / SYNTHETIC)
        for name in MECHANISMS:
            for seed in range(SEEDS):
                gb.write_log(MECHANISMS[name](seed).record, folder / SYNTHETIC / f"{name} {seed}.csv")
    if flights:
        (folder / GTM).mkdir()
        written.append(folder / GTM)
        for seed in range(flights):
            flown = gb.fly(excitation="multisine+turbulence", duration_s=GTM_S, seed=81_000 + seed)
            sensed = gb.measure(flown, noise="t2", seed=seed).select([*CHANNELS, "nx", "ny", "nz"])
            gb.write_log(gb.decimate(sensed, 2), folder / GTM / f"gtm {seed}.csv")
    return written


def conduct(campaign: Campaign) -> Findings:
    """Watch, break, misread, report."""
    given = campaign.given
    wrong = [f"{folder} is no folder" for folder in given.folders if not folder.is_dir()]
    if wrong or not (given.folders or given.synthetic or given.gtm):
        raise InputError(f"{', '.join(wrong) or 'nothing is given'}; give folders of logs, --synthetic, or both")
    size = QUICK if campaign.quick else Size()
    with tempfile.TemporaryDirectory() as folder:
        own = made(Path(folder), synthetic=given.synthetic, flights=given.gtm)
        todo = tasks(given.folders, size, broken=given.broken, misread=given.misread, kept=given.kept)
        todo += tasks(own, size, broken=0, misread=0, kept=given.kept)
        done = spread(studied, todo, processes=campaign.jobs, step="logs", progress=campaign.tell)
    study = Study(
        *(
            pd.DataFrame([row for rows in each for row in rows], columns=columns)
            for each, columns in zip(zip(*done, strict=True), COLUMNS, strict=True)
        )
    )
    groups = {name: study.of("group", name) for name in dict.fromkeys(task.group for task in todo)}
    head = ["# Recorded flights: verdicts, faults, wrong readings", SAID_QUICK * campaign.quick + INTRODUCTION]
    sources = pd.DataFrame({"repository": REPOSITORIES.keys(), "its files": REPOSITORIES.values()})
    first = [markdown(summary(groups)), failures(study.logs), DETAILS, markdown(sources)]
    text = "\n\n".join([*head, *filter(None, first), *(section(name, own) for name, own in groups.items())]) + "\n"
    missed = any(is_missed(targets_of(name, own), {name: figures_of(own)}) for name, own in groups.items())

    def write(out: Path) -> None:
        for name, frame in study._asdict().items():
            frame.to_csv(out / f"{name}.csv", index=False)

    return Findings(text, missed, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is watched."""
    parser.add_argument("folders", nargs="*", type=Path, help="folders of logs")
    parser.add_argument("--synthetic", action="store_true", help="synthetic healthy logs, too")
    parser.add_argument("--gtm", type=int, default=0, help="healthy flights of the GTM, too (default: %(default)s)")
    parser.add_argument("--broken", type=int, default=1, help="put faults on every nth log; 0: none (default: 1)")
    parser.add_argument("--kept", type=Path, help="folder of rows that were made before, and to keep them in")
    parser.add_argument("--misread", type=int, default=3, help="read every nth log wrongly; 0: none (default: 3)")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="two kinds of faults, four readings", arguments=arguments))
