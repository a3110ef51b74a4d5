"""Recorded flights, one row a log: what bank C says of each, of faults that are put on it, and of wrong readings of it.

    python experiments/real_logs.py [FOLDER ...] [--synthetic] [--faults N] [--only-faults] [--quick] [--out DIR]

Opens every log below the folders that holds p, q, r, phi, theta and psi, and takes the flight: from where 3 % of the
rows that move have gone by until 97 % have. It is written as a table, bank C is identified on its first half and
watches the second: as it is; with faults of every gyro, of its certificate's size, three times that, and an everyday
size, on the gyro alone and with the attitude that follows; misread in 23 ways (`recorded/mutations.py`). With
--synthetic the same of the healthy logs of `gtmbench.testing.mechanisms`, whole. Prints tables; writes report.md,
flights.csv, faults.csv and readings.csv into DIR. No log is kept. Ends with code 1 where a target is missed (never with
--quick).
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from gtmbench.errors import InputError
from gtmbench.jobs.processes import spread
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.watched import Outcome
from gtmbench.testing.mechanisms import MECHANISMS
from recorded.faults import ALONE, CANT_TELL, CERTIFICATE, EITHER_OR, NAMED, NOTHING, TOO_STEEP, USUAL, WRONG
from recorded.flights import LogFile, SyntheticLog
from recorded.study import OF_FLIGHT, QUICK, REFUSED, Row, Size, Task, studied
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

SYNTHETIC = "synthetic"
TIMES = 3  # the certificate's size: of the faults that are to be found, and named
EVERYDAY_SIZES = ", ".join(f"{kind} {size:g}" for kind, size in USUAL.items()) + " (deg/s; scale: off by)"
SAID_QUICK = "**Quick: few faults and readings of each log. It shows that the script runs, and bounds nothing.**\n\n"
INTRODUCTION = f"""Bank C, identified on the first half of a flight, watches the second. No sensor failed in any of
these flights, as far as is known; some of them crash, and in some an estimator fails.

The logs are in public repositories: PX4/pyulog (`test/`), PX4/flight-review-rs (`crates/converter/tests/fixtures/`),
dronekit/dronekit-la-testdata, BeastAyyG/ardupilot-log-diagnosis (`sample.bin`, a `log_0036`) and erlerobot/logs (a name
has its folders). Synthetic logs are those of `docs/explanation/mechanisms.md`; the number is the seed.

- *exit*: 0 healthy, 1 a fault, 3 can't tell, 2 nothing can be identified on.
- *explained*: how much of the slow motion of p, q and r, where identified.
- *can't tell (% of time)*: motion outside of what was identified, and what doubtful alarms cover, of whatever sensor,
  to the stretch's end where they don't end. *outside*: the former alone.
- *all of the log*: the log itself with its events, from before takeoff until after landing, identified on the same
  half. All other columns are of flights that are written as tables, which hold accelerometers where the log has them,
  and no events; so are synthetic logs. What a low-pass takes about a pause of some channels is left out of these
  tables, which would tell it as a dropout; of a log that is there twice, the second.
- *faults*: bias, drift, scale factor, deadzone and noise of each gyro, {TIMES} times the certificate's size, from
  times drawn from equal shares of what was watched. *found*: an alarm within the certificate's time. By the end of the
  stretch (or the next alarm that comes without a fault) it is *{NAMED}*, *{EITHER_OR}* with the right one among them,
  *{CANT_TELL}*, *{WRONG}* (another sensor, or an either-or without the right one), or *{NOTHING}* (no alarm, or it
  passed). *times*, in the table by kinds: faults of the certificate's own size, too, which it promises to be found in
  90 % of what was watched.
- *attitude*: the bank is told that the gyros drive it where the log's format documents that; else `watch_log` finds
  out. Where they do, the attitude follows every fault, as an estimator makes it whose time constant is *1 s*, and one
  of *20 s*; the totals count these. *alone*: the gyro breaks and the attitude stays as it was.
- *of*: whose size a fault has, the certificate's, or an *everyday* one: {EVERYDAY_SIZES}.
- *named wrong*, the target: of all faults that the attitude follows, or of all where it follows none.
- *misread*: in how many wrong ways the flight is read. How many end as *refused* (3) or with *exit 0*; causes named
  that are *right*, and other ones. Of synthetic logs whose attitude is late or held a cause is right, and they aren't
  misread further.
"""


class Study(NamedTuple):
    """Rows of a group of logs: a flight, a fault, a reading each."""

    flights: pd.DataFrame
    faults: pd.DataFrame
    readings: pd.DataFrame

    def of(self, column: str, value: str) -> Study:
        """Return the rows with a value."""
        return Study(*(frame[frame[column] == value] for frame in self))


COLUMNS = (
    ["group", "log", *OF_FLIGHT],
    ["group", "log", "sensor", "kind", "attitude", "of", "times", "size", "onset_s", "found", "said", "names"],
    ["group", "log", "reading", "exit", "is_right", "is_wrong"],
)
WRONGLY = ["log", "sensor", "kind", "attitude", "of", "times", "size", "onset_s", "names"]
Cell = Callable[[pd.DataFrame], int]


# ---- tables ----


def counted(column: str, value: object = True) -> Cell:
    """Return what counts the rows with a value."""
    return lambda of: int((of[column] == value).sum())


OF_FAULTS: dict[str, Cell] = {"faults": len, "found": counted("found")} | {
    name: counted("said", name) for name in (NAMED, EITHER_OR, CANT_TELL, WRONG, NOTHING)
}
OF_READINGS: dict[str, Cell] = {
    "misread": len,
    "refused": counted("exit", Outcome.UNKNOWN),
    "exit 0": counted("exit", Outcome.HEALTHY),
    "right": counted("is_right"),
    "wrong cause": counted("is_wrong"),
}


def counted_faults(faults: pd.DataFrame) -> pd.DataFrame:
    """Return the faults that targets are of: where the gyros drive a log's attitude, those that it follows."""
    driven = faults.loc[faults["attitude"] != ALONE, "log"]
    stays = (faults["attitude"] == ALONE) & faults["log"].isin(driven)
    return faults[(faults["said"] != TOO_STEEP) & ~stays]


def large(faults: pd.DataFrame) -> pd.DataFrame:
    """Return those of them that are to be found."""
    put = counted_faults(faults)
    return put[(put["of"] == CERTIFICATE) & (put["times"] == TIMES)]


def row_of(flight: Row, study: Study) -> Row:
    """Return a log's row of the table."""
    own = study.of("log", flight["log"])
    return {
        "log": flight["log"],
        "Hz": f"{flight['rate_hz']:.3g}",
        "s": f"{flight['duration_s']:.0f}",
        "explained (%)": flight["explained"],
        "exit": flight["exit"],
        "verdict": flight["verdict"],
        "can't tell (% of time)": percent(flight["cant_tell_s"], flight["watched_s"]),
        "outside (%)": percent(flight["outside_s"], flight["watched_s"]),
        "all of the log": flight["whole"],
        **{name: cell(large(own.faults)) for name, cell in OF_FAULTS.items()},
        **{name: cell(own.readings) for name, cell in OF_READINGS.items()},
    }


def percent(part: float, of: float) -> str:
    """Write a share; a dash where there is nothing to share."""
    return f"{100.0 * part / of:.1f}" if of else "-"


def totals(study: Study) -> str:
    """Say what came of a group."""
    flights, faults = study.flights, large(study.faults)
    ends = ", ".join(f"{count} with {code}" for code, count in flights["exit"].value_counts().sort_index().items())
    refused = flights["verdict"].str.startswith(REFUSED).sum()
    said = "; ".join(f"{name} {share_text(cell(faults), len(faults))}" for name, cell in list(OF_FAULTS.items())[1:])
    return (
        f"{len(flights)} flights, {flights['watched_s'].sum() / 3600.0:.2f} h watched, end {ends}; of them "
        f"the self-check refuses {refused}.\n\n{len(faults)} faults, {TIMES} times the certificate's size: {said}. "
        f"None was put of {flights['uncertified'].sum()} gyros and kinds without a size that is seen often enough."
    )


def section(group: str, study: Study) -> str:
    """Return what is told of a group of logs."""
    if not len(study.flights):
        return f"## {group}\n\nno flight"
    rows = pd.DataFrame([row_of(flight, study) for flight in study.flights.to_dict("records")])
    parts = [
        f"## {group}",
        totals(study),
        markdown(held(targets_of(group, study), {group: figures_of(study)})),
        markdown(rows),
    ]
    if len(study.faults):
        put = study.faults[study.faults["said"] != TOO_STEEP]
        size = {"of": "of", "times": "times"}
        parts.append(markdown(grouped(put, {"attitude": "attitude", **size}, OF_FAULTS)))
        parts.append(f"{len(study.faults) - len(put)} faults would have bent the attitude beyond Euler angles.")
        parts.append(markdown(grouped(put, {"kind": "kind", "attitude": "attitude", **size}, OF_FAULTS)))
        if len(wrong := put[put["said"] == WRONG]):
            rounded = wrong.assign(
                size=wrong["size"].map("{:.3g}".format), onset_s=wrong["onset_s"].map("{:.1f}".format)
            )
            parts.append(markdown(rounded[WRONGLY].rename(columns={"onset_s": "onset (s)", "names": WRONG})))
    if len(study.readings):
        parts.append(markdown(grouped(study.readings, {"reading": "reading"}, OF_READINGS)))
    return "\n\n".join(parts)


# ---- targets ----


def targets_of(group: str, study: Study) -> tuple[Target, ...]:
    """Return what is asked of a group, of wrong readings only where there are some."""
    asked = [
        ("healthy flights accused", "accused", "<=", 0.0),
        ("faults named wrong, share", "named wrong", "<=", 0.005),
        (f"faults {TIMES} times the certificate's size that are found, share", "found", ">=", 0.95),
        ("of the same, that are named, share", "named", ">=", 0.85),
        ("can't tell, share of the time watched", "can't tell", "<=", 0.1),
        ("causes claimed of flights as they are", "claimed", "<=", 0.0),
        ("wrong readings that end with 0", "exit 0", "<=", 0.0),
        ("right causes, share, in flights that the attitude explains as they are", "causes", ">=", 0.95),
    ]
    if not len(study.readings):
        asked = asked[:-2]
    if group != SYNTHETIC:
        asked.insert(1, ("healthy logs accused, all of a log watched", "accused whole", "<=", 0.0))
    return tuple(Target(text, group, which, sense, bound) for text, which, sense, bound in asked)


def figures_of(study: Study) -> dict[str, float]:
    """Return the figures that the targets are of."""
    flights, faults, readings = study.flights, large(study.faults), study.readings
    explained = readings["log"].isin(flights.loc[flights["is_explained"].eq(True), "log"])
    return {
        "accused": (flights["exit"] == Outcome.FAILED).sum(),
        "accused whole": flights["whole"].str.startswith("1").sum(),
        "named wrong": (counted_faults(study.faults)["said"] == WRONG).mean(),
        "found": faults["found"].astype(float).mean(),
        "named": (faults["said"] == NAMED).mean(),
        "can't tell": flights["cant_tell_s"].sum() / flights["watched_s"].sum(),
        "claimed": flights["is_cause_claimed"].eq(True).sum(),
        "exit 0": (readings["exit"] == Outcome.HEALTHY).sum(),
        "causes": readings.loc[explained, "is_right"].astype(float).mean(),
    }


# ---- all of it ----


def tasks(folders: Sequence[Path], size: Size, *, synthetic: bool) -> list[Task]:
    """Return every file of some folders, each a group, and synthetic logs; of files that are alike, the first."""
    wrong = [f"{folder} is no folder" for folder in folders if not folder.is_dir()]
    if wrong or not (folders or synthetic):
        raise InputError(f"{', '.join(wrong) or 'nothing is given'}; give folders of logs, --synthetic, or both")
    once: dict[bytes, Task] = {}
    for folder in folders:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            task = Task(LogFile(path, str(path.relative_to(folder))), folder.resolve().name, size)
            once.setdefault(hashlib.sha256(path.read_bytes()).digest(), task)
    made = [Task(SyntheticLog(name, seed), SYNTHETIC, size) for name in MECHANISMS for seed in range(size.seeds)]
    return [*once.values(), *(made if synthetic else [])]


def conduct(campaign: Campaign) -> Findings:
    """Watch, break, misread, report."""
    given = campaign.given
    size = QUICK if campaign.quick else replace(Size(), faults=given.faults)
    if given.only_faults:
        size = replace(size, readings=(), whole=False)
    todo = tasks(given.folders, size, synthetic=given.synthetic)
    done = spread(studied, todo, processes=campaign.jobs, step="logs", progress=campaign.tell)
    study = Study(
        *(
            pd.DataFrame([row for rows in each for row in rows], columns=columns)
            for each, columns in zip(zip(*done, strict=True), COLUMNS, strict=True)
        )
    )
    groups = {name: study.of("group", name) for name in dict.fromkeys(task.group for task in todo)}
    head = ["# Recorded flights: verdicts, faults, wrong readings", SAID_QUICK * campaign.quick + INTRODUCTION]
    text = "\n\n".join([*head, *(section(name, own) for name, own in groups.items())]) + "\n"
    missed = any(is_missed(targets_of(name, own), {name: figures_of(own)}) for name, own in groups.items())

    def write(out: Path) -> None:
        for name, frame in study._asdict().items():
            frame.to_csv(out / f"{name}.csv", index=False)

    return Findings(text, missed, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is watched."""
    parser.add_argument("folders", nargs="*", type=Path, help="folders of logs")
    parser.add_argument("--synthetic", action="store_true", help="synthetic logs, too")
    parser.add_argument("--faults", type=int, default=Size.faults, help="of every gyro and kind (default: %(default)s)")
    parser.add_argument("--only-faults", action="store_true", help="neither misread a flight nor watch all of its log")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="one fault of a kind, four readings, one seed", arguments=arguments))
