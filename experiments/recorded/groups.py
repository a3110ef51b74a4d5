"""Studies of groups of logs, a folder each or synthetic flights: watch every log, sum up by group, write."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import silent
from studies.conduct import write_report


def studied_groups(
    description: str | None,
    head: Sequence[str],
    out: Path,
    *,
    cases: Callable[[Path], list[dict[str, Any]]],
    synthetic: Callable[[Path, range], list[Path]],
    report: Callable[[pd.DataFrame], list[str]],
) -> pd.DataFrame:
    """Study what the command line names; print the report, write it with the cases, and return these.

    Parameters
    ----------
    description : str
        Of the command line: ``[FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]``.
    head : sequence of str
        What the report begins with.
    out : Path
        Where it goes if nobody says.
    cases : callable
        Returns the rows of a log.
    synthetic : callable
        Writes flights by their seeds into a folder; returns their paths.
    report : callable
        Returns the paragraphs of a group's rows; empty ones are left out.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--synthetic", default="")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=out)
    given = parser.parse_args()
    groups: dict[str, Sequence[Path]]
    groups = {each.name: sorted(path for path in each.rglob("*") if path.is_file()) for each in given.folders}
    with tempfile.TemporaryDirectory() as folder:
        if given.synthetic:
            first, last = (int(each) for each in given.synthetic.split(":"))
            groups[f"synthetic, seeds {first} to {last - 1}"] = synthetic(Path(folder), range(first, last))
        if not groups:
            parser.error("neither a folder nor --synthetic is given; give folders of logs or --synthetic FIRST:LAST")
        text, found = [*head], []
        for name, paths in groups.items():
            results = spread(cases, paths, processes=given.processes, step="logs", progress=silent)
            rows = pd.DataFrame([row for each in results for row in each])
            found.append(rows.assign(group=name))
            text += [f"## {name}", *filter(None, report(rows))]
    given.out.mkdir(parents=True, exist_ok=True)
    write_report(given.out, "\n\n".join(text) + "\n", given)
    everything = pd.concat(found)
    everything.to_csv(given.out / "cases.csv", index=False)
    print("\n\n".join(text))
    return everything
