"""Recorded flights and 24 things that can be wrong with them: what the self-check of `gtmbench monitor` makes of each.

    python experiments/real_logs.py FOLDER ... [--out DIR] [--quick]

Opens every log below the folders that holds p, q, r, phi, theta and psi, and takes the flight: from where 3 % of the
rows that move have gone by until 97 % have. It is written as it is and with each of `gtmbench.testing.mutations`,
bank C is identified on its first half, and the second half is watched. Prints a row a log; writes report.md into DIR.
No log is kept. *Refused* is exit code 3, *right* the cause that was put in (or its mirror image), or the dead channel.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.self_check.explained import ENOUGH
from gtmbench.study.log.watch import Outcome, WatchedLog, watch_log
from gtmbench.testing.mutations import MUTATIONS, Mutation, is_cause

CHANNELS = ("p", "q", "r", "phi", "theta", "psi")
FASTEST_HZ = 100.0
AT_REST = 3.0  # deg/s of all gyros together, or a tenth of the usual
SHORTEST_S, PIECE_S = 14.0, 5.5  # of a flight, of a stretch without gaps
WRONG = {name: mutation for name, mutation in MUTATIONS.items() if name != "none"}
WHERE = (
    "The logs are in public repositories: PX4/pyulog (`test/`), PX4/flight-review-rs "
    "(`crates/converter/tests/fixtures/`), dronekit/dronekit-la-testdata, BeastAyyG/ardupilot-log-diagnosis "
    "(`sample.bin`, a `log_0036`) and erlerobot/logs (a name has its folders). *as it is*: exit code of the flight "
    "itself, 1 an alarm, 3 can't tell."
)
QUICK = ("-q", "p, r swapped", "attitude 0.3 s late", "r dead")


def flight(path: Path) -> list[gb.Record]:
    """Return the stretches of a log in which it flies; none where it hardly does."""
    log = gb.open_log(path, needs=CHANNELS)
    if log.sample_period_s < 0.99 / FASTEST_HZ:
        log = gb.open_log(path, needs=CHANNELS, rate_hz=FASTEST_HZ)
    gyros = [record.matrix(CHANNELS[:3]) for record in log.segments]
    middle = np.nanmedian(np.concatenate(gyros), axis=0)
    rates = np.concatenate([np.linalg.norm(values - middle, axis=1) for values in gyros])
    time_s = np.concatenate([record.time_s for record in log.segments])
    moving_s = time_s[rates > max(AT_REST, 0.1 * float(np.nanquantile(rates, 0.9)))]
    if len(moving_s) < 50:
        return []
    first_s, last_s = np.quantile(moving_s, [0.03, 0.97])
    spans = [(record, max(record.start_s, first_s), min(record.end_s, last_s)) for record in log.segments]
    parts = [record.between(start_s, end_s) for record, start_s, end_s in spans if end_s - start_s > PIECE_S]
    return parts if sum(part.end_s - part.start_s for part in parts) > SHORTEST_S else []


def watched(parts: Sequence[gb.Record], mutation: Mutation, folder: Path) -> WatchedLog:
    """Return what is said of a flight with something wrong."""
    path, lines = folder / "log.csv", []
    for part in (mutation.mutate(part) for part in parts):
        gb.write_log(part, path)
        header, *rows = path.read_text().splitlines()
        lines += rows if lines else [header, *rows]
    path.write_text("\n".join(lines) + "\n")
    half_s = 0.5 * (parts[0].start_s + parts[-1].end_s)
    return watch_log(path, "C", healthy=[(-np.inf, half_s)])


def is_right(mutation: Mutation, said: WatchedLog) -> bool:
    """Tell whether the cause was named."""
    if mutation.dead:
        return any(f"{mutation.dead} reads" in stop for stop in said.check.stops)
    return any(is_cause(mutation, cause.changes) for cause in said.check.causes)


def row_of(path: Path, names: Sequence[str]) -> dict[str, object] | None:
    """Return a log's row; None where nothing can be made of it."""
    try:
        parts = flight(path)
        if not parts:
            return None
        with tempfile.TemporaryDirectory() as folder:
            healthy = watched(parts, Mutation(), Path(folder))
            wrong = {name: watched(parts, WRONG[name], Path(folder)) for name in names}
    except InputError:
        return None
    right = [name for name, said in wrong.items() if is_right(WRONG[name], said)]
    claimed = [name for name, said in wrong.items() if said.check.causes and name not in right]
    shares = [f"{100.0 * max(each.share, 0.0):.0f}" for each in healthy.check.explained if each.where == "identified"]
    return {
        "log": path.name,
        "Hz": f"{1.0 / parts[0].sample_period_s:.3g}",
        "s": f"{sum(part.end_s - part.start_s for part in parts):.0f}",
        "explained (%)": "/".join(shares) or "0",
        "as it is": int(healthy.outcome),
        "cause claimed": "yes" if healthy.check.causes else "no",
        "refused": sum(said.outcome is Outcome.UNKNOWN for said in wrong.values()),
        "exit 0": sum(said.outcome is Outcome.HEALTHY for said in wrong.values()),
        "right": len(right),
        "wrong cause": len(claimed),
        "not named": ", ".join(name for name in names if name not in right) if len(right) > len(names) / 2 else "",
    }


def report(rows: Sequence[dict[str, object]], folder: Path, names: Sequence[str]) -> str:
    """Return a folder's table, with the totals over it."""
    frame = pd.DataFrame(rows)
    told = frame[[min(map(int, shares.split("/")), default=0) >= 100.0 * ENOUGH for shares in frame["explained (%)"]]]
    total = [
        f"{len(frame)} flights, {len(names) * len(frame)} wrong readings of them: {frame['refused'].sum()} refused, "
        f"{frame['exit 0'].sum()} end with exit code 0; causes: {frame['right'].sum()} right, "
        f"{frame['wrong cause'].sum()} wrong.",
        f"A cause is claimed of {(frame['cause claimed'] == 'yes').sum()} of the flights as they are. Of the "
        f"{len(told)} flights in whose first half the attitude explains half of every gyro's motion or more, "
        f"{told['right'].sum()} of {len(names) * len(told)} causes are right.",
    ]
    return f"## {folder.name}\n\n{' '.join(total)}\n\n{markdown(frame)}\n"


def main() -> int:
    """Open, break, watch, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="folders of logs")
    parser.add_argument("--quick", action="store_true", help="four things wrong, not 23")
    parser.add_argument("--out", type=Path, help="folder of the report; without it only the tables are printed")
    given = parser.parse_args()
    began, names = time.monotonic(), QUICK if given.quick else tuple(WRONG)
    texts = [f"# Recorded flights, and what can be wrong with them\n\n{WHERE}\n"]
    for folder in given.folders:
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        rows = [row for path in paths if (row := row_of(path, names)) is not None]
        texts.append(report(rows, folder, names) if rows else f"## {folder.name}\n\nno flight\n")
        print("\n".join(texts[-1:]), flush=True)
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "report.md").write_text("\n".join(texts))
    print(f"{time.monotonic() - began:.0f} s" + (f"; report in {given.out}" if given.out else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())
