"""Recorded flights, one row a log: how often gyros and attitude are new, what the intake makes of them, what is left.

    python experiments/log_samples.py FOLDER ... [--against samples.csv] [--quick] [--out DIR] [--jobs N]

Opens every log below the folders that holds p, q, r, phi, theta and psi, and takes the flight as `real_logs.py` does;
bank C is identified on its first half, and the RMS of its residuals on the second is told, in deg/s, beside the rates,
the remarks, and the time and memory that opening takes. With --against, which is what another version of the package
wrote, both stand beside each other. Writes report.md and samples.csv into DIR. No log is kept.
"""

from __future__ import annotations

import argparse
import sys
import time
import tracemalloc
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.jobs.processes import spread
from gtmbench.report.markup import markdown
from gtmbench.values.channels import ACCELEROMETERS, GYROS
from recorded.flights import CHANNELS, LogFile, watched
from studies.conduct import DETAILS, Campaign, Findings, conducted

COLUMNS = ("log", "rate_hz", "gyros", "residual_p", "residual_q", "residual_r", "remarks", "open_s", "peak_mb")
RESIDUALS = COLUMNS[3:6]
QUICK = 2  # logs of a folder
INTRODUCTION = """Bank C, identified on the first half of a flight, watches the second: RMS of its residuals there, in
deg/s. *Gyros*: integrated over the attitude's intervals, low-passed to its rate, or as they are.
"""


class Task(NamedTuple):
    """A log."""

    path: Path
    name: str


def studied(task: Task) -> dict[str, Any] | None:
    """Return a log's row; None where it holds no flight."""
    began = time.perf_counter()
    try:
        log = gb.open_log(task.path, needs=CHANNELS, witnesses=ACCELEROMETERS)
        took_s = time.perf_counter() - began
        whole = LogFile(task.path, task.name)
        said = watched(whole.parts(), whole.attitude)
    except (InputError, IndexError):  # can't be read, hardly flies, or holds too little to identify on
        return None
    tracemalloc.start()
    gb.open_log(task.path, needs=CHANNELS, witnesses=ACCELEROMETERS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    left = {
        name: np.concatenate([watch.residuals[name] for watch in said.watches]) if said.watches else np.full(1, np.nan)
        for name in GYROS
    }
    counts = Counter(remark.kind for remark in log.remarks)
    return {
        "log": task.name,
        "rate_hz": 1.0 / log.sample_period_s,
        "gyros": how(log.method),
        **{f"residual_{name}": float(np.sqrt(np.nanmean(np.square(values)))) for name, values in left.items()},
        "remarks": ", ".join(f"{kind} {count}" for kind, count in counts.items()),
        "open_s": took_s,
        "peak_mb": peak / 1e6,
    }


def how(method: tuple[str, ...]) -> str:
    """Say what became of the gyros."""
    text = "; ".join(method)
    if "integrated over" in text:
        return "integrated"
    return "low-passed" if "one low-pass" in text else "as they are"


def table(rows: pd.DataFrame, before: pd.DataFrame | None) -> str:
    """Return the rows, beside those of another version."""
    shown = pd.DataFrame({"log": rows["log"], "Hz": rows["rate_hz"].map("{:.3g}".format), "gyros": rows["gyros"]})
    versions = {"": rows} if before is None else {" before": before.set_index("log").reindex(rows["log"]), " now": rows}
    for said, of in versions.items():
        three = of[list(RESIDUALS)].apply(lambda row: "/".join(f"{each:.2f}" for each in row), axis=1)
        shown[f"residual p/q/r{said}"] = three.to_numpy()
    for said, of in versions.items():
        shown[f"remarks{said}"] = of["remarks"].fillna("").to_numpy()
        shown[f"open{said} (s, MB)"] = [f"{s:.2f}, {mb:.0f}" for s, mb in zip(of["open_s"], of["peak_mb"], strict=True)]
    return markdown(shown)


def ratios(rows: pd.DataFrame, before: pd.DataFrame) -> str:
    """Say by how much residuals fell, of every way that the gyros are taken."""
    both = rows.merge(before, on="log", suffixes=("", "_before"))
    lines = []
    for name, own in both.groupby("gyros"):
        of = np.concatenate([(own[f"{column}_before"] / own[column]).to_numpy() for column in RESIDUALS])
        of = of[np.isfinite(of)]
        if len(of):
            low, middle, high = np.quantile(of, [0.1, 0.5, 0.9])
            lines.append(
                f"- *{name}*, {len(own)} logs: residuals were {middle:.2f} times as large before (median of logs and "
                f"gyros; {low:.2f} to {high:.2f} at a tenth and nine tenths), larger now in {np.mean(of < 0.98):.0%}"
            )
    return "\n".join(lines)


def conduct(campaign: Campaign) -> Findings:
    """Open, identify, watch, report."""
    given = campaign.given
    wrong = [f"{folder} is no folder" for folder in given.folders if not folder.is_dir()]
    if wrong or not given.folders:
        raise InputError(f"{', '.join(wrong) or 'nothing is given'}; give folders of logs")
    parts = ["# Recorded flights: samples as they are", INTRODUCTION]
    every, tables = [], []
    against = None if given.against is None else pd.read_csv(given.against)
    for folder in given.folders:
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        todo = [Task(path, str(path.relative_to(folder))) for path in paths][: QUICK if campaign.quick else None]
        done = spread(studied, todo, processes=campaign.jobs, step="logs", progress=campaign.tell)
        rows = pd.DataFrame([row for row in done if row is not None], columns=list(COLUMNS))
        every.append(rows)
        parts.append(f"## {folder.resolve().name}")
        if len(rows) and against is not None:
            parts.append(ratios(rows, against))
        tables.append(table(rows, against) if len(rows) else "no flight")
    parts += [DETAILS, *tables]

    def write(out: Path) -> None:
        pd.concat(every).to_csv(out / "samples.csv", index=False)

    return Findings("\n\n".join(parts) + "\n", False, write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is opened."""
    parser.add_argument("folders", nargs="*", type=Path, help="folders of logs")
    parser.add_argument("--against", type=Path, help="samples.csv of another version")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick=f"{QUICK} logs of a folder", arguments=arguments))
