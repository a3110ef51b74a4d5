"""Published flights whose failures are known, one row a flight: what had failed, and what bank C says of the sensors.

    python experiments/published_flights.py FOLDER [--out DIR]

Watches every log below a folder that tells of a failure (`docs/how_to/truth_in_logs.md`): RflyMAD's, UAV-SEAD's,
ALFA's, and autopilots' own injections. Bank C is identified on what lies before the first failure, up to 2 s before it.
Prints a table, and writes report.md into DIR. No flight is kept: where these come from stands in the report.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

import gtmbench as gb
from gtmbench.intake.formats.registry import is_log, is_log_folder
from gtmbench.report.markup import markdown
from studies.conduct import write_report

NEEDS = ["p", "q", "r", "phi", "theta", "psi"]
MARGIN_S = 2.0
SAID = {0: "nothing failed", 1: "a fault", 3: "can't tell"}
INTRODUCTION = """# Published flights whose failures are known

Written by `python experiments/published_flights.py FOLDER`. Bank C, identified on what lies before the first failure,
says whether a gyro or an attitude sensor lies. Where a motor or an engine fails none does, so to accuse one is wrong.

- *samples a second*: of the slowest of gyros and attitude. *before*: seconds until the first failure.
- *verdict*: on the sensors. *suspected*: those between which alarms after the failure leave it open, or that they name.

"""
SOURCES = """
## Where flights come from, and which couldn't be had

- **RflyMAD** (Le and others 2024), multicopters. Here are 14 of 5,629, motors that stop in simulations (names with
  `_1`: software, `_2`: hardware in the loop), from the public repository lerlis/RLS-fault-diagnosis-for-RflyMAD; its
  other 26 logs are larger than what a copy of it holds. None has a gyro's fault, and the data set itself can't be had
  here.
- **ALFA** (Keipour and others 2021), a fixed wing. Here is 1 of 47, from the history of castacks/alfa-dataset-tools.
  The published tables have 2.5 samples of the IMU a second, fewer than anything here watches; along this one gyros
  and the attitude's rates agree (correlation 0.93 to 0.98), so axes and units are read right.
- **ALFA resampled** (FabioCarosi/FaultDetection_ALFA-Dataset) isn't read: 50 tables at 20 Hz with samples held, which
  lack a part of the orientation's quaternion, at the same 2.5 fresh samples a second.
- **UAV-SEAD** (Kabaoglu and Sariel 2026), multicopters. None is here, for its 30 GB can't be had; its reader is tried
  on files that tests write, by the layout that its authors' own tool reads.
- **PADRE** (AeroLabPUT), damaged propellers, isn't read: four IMUs, and no attitude to hold gyros against.

The benchmark's own table can't be made of these: quickness needs faults of gyros or attitude sensors, and thresholds
for one false alarm in ten hours need more healthy flight than the half minute before each of these failures.
"""


def main() -> None:
    """Watch all flights of a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/published_flights"))
    given = parser.parse_args()
    rows = [row for path in logs(given.folder) if (row := watched(path)) is not None]
    if not rows:
        raise SystemExit(f"{given.folder} holds no flight that tells of a failure")
    table = markdown(pd.DataFrame(rows))
    print(table)
    given.out.mkdir(parents=True, exist_ok=True)
    write_report(given.out, f"{INTRODUCTION}{table}\n{SOURCES}", given)


def logs(folder: Path) -> list[Path]:
    """Return all logs below a folder; of those that are folders, not their tables."""
    wholes = [path for path in sorted(folder.rglob("*")) if path.is_dir() and is_log_folder(path)]
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and is_log(path)]
    return [*wholes, *(path for path in files if not set(path.parents) & set(wholes))]


def watched(path: Path) -> dict[str, str] | None:
    """Return a flight's row; None where it tells of no failure, or has no gyros and attitude."""
    try:
        log = gb.open_log(path, needs=NEEDS)
    except gb.InputError:
        return None
    if not log.injections:
        return None
    first = log.segments[0]
    onset_s = min(each.onset_s for each in log.injections)
    row = {
        "flight": path.stem,
        "samples a second": f"{1.0 / first.sample_period_s:.3g}",
        "before (s)": f"{onset_s - first.start_s:.3g}",
        "failed": "; ".join(each.text for each in log.injections),
    }
    try:
        told = gb.watch_log(path, "C", healthy=[(first.start_s, onset_s - MARGIN_S)])
    except gb.InputError as error:
        return row | {"verdict": f"not watched: {str(error).removeprefix(str(path))[:80].strip(': ')}", "suspected": ""}
    alarms = [alarm for watch in told.watches for alarm in watch.faults if alarm.time_s >= onset_s]
    suspected = {name for alarm in alarms for each in alarm.judgements[-1:] for name in (each.sensor, *each.candidates)}
    return row | {
        "verdict": SAID[int(told.outcome)],
        "suspected": ", ".join(sorted(filter(None, suspected))) or "nobody",
    }


if __name__ == "__main__":
    main()
