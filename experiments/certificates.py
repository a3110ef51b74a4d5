"""Certificates of recorded flights, held against faults that are put on them: what should be seen, and what is.

    python experiments/certificates.py FOLDER ... [--faults N] [--out DIR]

Takes the flights of `real_logs.py`, and as there bank C is identified on the first half and watches the second. On
those without an alarm, N faults of every gyro and kind are put, at times drawn from what was watched, of the size that
the certificate says and of three times that, and each is watched. Prints a row a log; writes report.md into DIR. No
log is kept.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.certificate import KINDS, Smallest
from gtmbench.study.log.watch import Outcome, WatchedLog
from gtmbench.testing.mutations import Mutation
from real_logs import WHERE, flight, watched

TIMES = (1, 3)  # the certificate's size
FIGURES = ("faults", "alarm", "named", "another named")


def healthy(path: Path) -> WatchedLog | None:
    """Return what is said of a log's flight; None where there is none, or it isn't healthy."""
    try:
        parts = flight(path)
        if not parts:
            return None
        with tempfile.TemporaryDirectory() as folder:
            said = watched(parts, Mutation(), Path(folder))
    except InputError:
        return None
    return said if said.outcome is Outcome.HEALTHY else None


def tried(said: WatchedLog, row: Smallest, size: float, random: np.random.Generator) -> list[bool]:
    """Return of one fault, at a time that is drawn: that it was put, alarmed in time, was named, another was."""
    places = [
        (watch, onset_s)
        for watch in said.watches
        for onset_s in watch.record.time_s[watch.armed].tolist()
        if onset_s <= watch.record.end_s - row.within_s
    ]
    watch, onset_s = places[random.integers(len(places))]
    kind = next(kind for kind in KINDS if kind.fault.kind == row.kind)
    fault = kind.at(row.sensor, onset_s, size, is_turned=bool(random.integers(2)))
    again = gb.watch(watch.monitor, gb.inject(watch.record, fault))
    alarms = [alarm.time_s for alarm in again.alarms if alarm.time_s >= onset_s]
    names = {alarm.sensor for alarm in again.faults if alarm.time_s >= onset_s} - {None}
    return [True, bool(alarms) and alarms[0] <= onset_s + row.within_s, row.sensor in names, bool(names - {row.sensor})]


def rows_of(said: WatchedLog, name: str, faults: int, random: np.random.Generator) -> Iterator[dict[str, object]]:
    """Yield a log's rows, one a size in terms of the certificate's, and kind."""
    for row in said.certificate.rows:
        for times in TIMES if row.size is not None else ():
            counts = np.sum([tried(said, row, times * (row.size or 0.0), random) for _ in range(faults)], axis=0)
            yield {"log": name, "kind": row.kind, "times": times, **dict(zip(FIGURES, counts.tolist(), strict=True))}


def table(frame: pd.DataFrame, by: str) -> str:
    """Return the sums by some column and size."""
    return markdown(frame.groupby([by, "times"], sort=False)[list(FIGURES)].sum().reset_index())


def main() -> int:
    """Certify, break, watch, report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="folders of logs")
    parser.add_argument("--faults", type=int, default=4, help="of every gyro, kind and size")
    parser.add_argument("--out", type=Path, help="folder of the report; without it only the tables are printed")
    given = parser.parse_args()
    began = time.monotonic()
    texts = [f"# What should be seen, and what is\n\n{WHERE.partition(' *as it is*')[0]}\n"]
    for folder in given.folders:
        rows, missing, logs = [], 0, 0
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            said = healthy(path)
            if said is not None:
                logs += 1
                missing += sum(row.size is None for row in said.certificate.rows)
                rows += rows_of(said, path.name, given.faults, np.random.default_rng(logs))
        frame = pd.DataFrame(rows, columns=["log", "kind", "times", *FIGURES])
        total = f"{logs} flights without an alarm; of {missing} of their gyros and kinds no size would have been seen."
        texts.append("\n\n".join([f"## {folder.name}", total, table(frame, "kind"), table(frame, "log")]) + "\n")
        print(texts[-1], flush=True)
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "report.md").write_text("\n".join(texts))
    print(f"{time.monotonic() - began:.0f} s" + (f"; report in {given.out}" if given.out else ""))
    return 0


if __name__ == "__main__":
    sys.exit(main())
