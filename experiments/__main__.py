"""Run every script that reproduces a part of the dissertation; its table goes into `docs/reference/dissertation.md`.

Run ``python experiments [NAME ...] [--quick] [--jobs N]``, or ``make experiments``. Figures and results go into
``experiments/reports/NAME``, where the table has those of parts that aren't run; with ``--quick`` nothing is kept. Ends
with code 1 where a row isn't as its script expects: it differs from the print for no reason given, say.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from dissertation.reproduction import tally

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs/reference/dissertation.md"
BEGIN, END = "<!-- make experiments writes this -->\n", "<!-- up to here -->"
PARTS = {  # in the order of the dissertation
    "why_time_domain": "1, why time domain",
    "exact_operators": "2, exact operators",
    "appendices": "2, A, B, Theorem 1 and what it stands on",
    "orders_of_models": "3.2, why FIR models",
    "laurent_series": "3.3-3.5, Laurent series, and Fig. 3.12",
    "closed_loop": "3.6, 3.7, identification in closed loop",
    "order_and_realisation": "3.8, order and realisation, and Figs. 3.3, 3.4, 3.8",
    "choices": "4.3, the number of excitations",
    "aircraft_gyros": "4.4, gyros of an aircraft",
    "plate": "4.5, a vibrating plate",
    "drum": "4.6, an acoustic drum",
    "structures": "5, structures driven by forces and by displacements",
    "beam": "5, the beam of example 5.8.2",
    "hammerstein": "6, Hammerstein systems",
}
AGREES, DIFFERS, NOT_PRINTED = "agrees", "differs", "not printed"
WIDEST = 100  # letters of a cell
Results = dict[str, Any]


def run(name: str, *, out: Path, quick: bool) -> Results:
    """Run one script and return its results.json, with what it said where it failed."""
    began = time.monotonic()
    command = [sys.executable, str(HERE / f"{name}.py"), "--json", "--out", str(out / name)]
    command += ["--quick"] if quick else []
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(HERE.parent)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=alone)
    if done.returncode not in (0, 1) or not done.stdout:
        raise SystemExit(f"{name}.py ended with code {done.returncode}:\n{done.stderr}")
    results: Results = json.loads(done.stdout)
    said = tally(row["agreement"] for row in results["rows"])
    print(f"{name:<24} {said:<40} {len(results['figures'])} figures {time.monotonic() - began:>5.0f} s", flush=True)
    print(done.stderr, end="", file=sys.stderr, flush=True)  # which rows aren't as expected
    return results


def section(name: str, title: str, results: Results) -> str:
    """Return a script's part of the table, its figures linked."""
    lines = [f"### {title}: `{name}.py`"]
    if differing := [row for row in results["rows"] if row["agreement"] == DIFFERS]:
        lines += ["", "| result | printed | ours | because |", "|---|---|---|---|"]
    for row in differing:
        cells = (row["result"], short(row["printed"]), short(row["ours"]), row["note"])
        lines.append(f"| {' | '.join(map(plain, cells))} |")
    agreeing, unprinted = (
        [row["result"] for row in results["rows"] if row["agreement"] == each] for each in (AGREES, NOT_PRINTED)
    )
    lines += ["", f"**Agrees**: {plain(counted(agreeing))}."] if agreeing else []
    lines += ["", f"**Not printed**: {len(unprinted)}."] if unprinted else []
    figures = [
        f"[{figure.removesuffix('.png')}](../../experiments/reports/{name}/{figure})" for figure in results["figures"]
    ]
    return "\n".join([*lines, "", f"Figures: {', '.join(figures)}.", ""])


def counted(names: list[str]) -> str:
    """Return the results' places in the dissertation, with how many results each has where it has several."""
    places = Counter(place(name) for name in names)
    return ", ".join(f"{each} ({times})" if times > 1 else each for each, times in places.items())


def place(name: str) -> str:
    """Return where a result stands: "Fig. 4.3, drift of p" stands in Fig. 4.3."""
    return name.partition(", ")[0].partition(": ")[0]


def overview(parts: dict[str, Results]) -> str:
    """Return how many rows agree, differ, and have nothing printed."""
    said = tally(row["agreement"] for results in parts.values() for row in results["rows"])
    figures = sum(len(results["figures"]) for results in parts.values())
    return (
        f"**Of the rows, {said}**; {figures} figures. All digits, what isn't printed, and the notes, such as a choice "
        "that was made after trying, stand in `reports/NAME/results.json`.\n\n"
    )


def short(cell: str) -> str:
    """Return a cell without the middle of what no page is wide enough for."""
    return cell if len(cell) <= WIDEST else f"{cell[: WIDEST - 40]} ... {cell[-35:]}"


def plain(cell: str) -> str:
    """Return a cell as Markdown that shows it."""
    return cell.replace("|", "\\|").replace("*", "\\*")


def kept(name: str) -> Results:
    """Return what a part gave when it was run last."""
    results: Results = json.loads((HERE / "reports" / name / "results.json").read_text(encoding="utf-8"))
    return results


def write_table(parts: dict[str, Results]) -> None:
    """Write the table into `docs/reference/dissertation.md`."""
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    table = overview(parts) + "\n".join(section(name, title, parts[name]) for name, title in PARTS.items())
    PAGE.write_text(f"{head}{BEGIN}{table}{END}{rest.partition(END)[2]}", encoding="utf-8")


def main() -> int:
    """Run the parts, tell how each went, rewrite the table."""
    parser = argparse.ArgumentParser(
        prog="experiments", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"parts to run (default: all): {', '.join(PARTS)}")
    parser.add_argument("--quick", action="store_true", help="seconds each; the table stays as it is")
    parser.add_argument("--jobs", type=int, default=2, help="scripts at a time (default: 2)")
    given = parser.parse_args()
    if unknown := set(given.names) - set(PARTS):
        parser.error(f"{', '.join(sorted(unknown))}: no part of the dissertation; give some of {', '.join(PARTS)}")
    began, chosen = time.monotonic(), given.names or list(PARTS)
    with tempfile.TemporaryDirectory() as aside, ThreadPoolExecutor(max(given.jobs, 1)) as pool:
        out = Path(aside) if given.quick else HERE / "reports"
        ran = dict(zip(chosen, pool.map(partial(run, out=out, quick=given.quick), chosen), strict=True))
    if not given.quick:
        write_table({name: ran.get(name) or kept(name) for name in PARTS})
    wrong = not all(row["expected"] for results in ran.values() for row in results["rows"])
    print(
        f"{time.monotonic() - began:.0f} s"
        + ("" if given.quick else "; the table stands in docs/reference/dissertation.md")
    )
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
