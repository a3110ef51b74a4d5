"""Whether the quick table of gtmbench-1 has the order of the full one, wherever two rows differ.

    python experiments/benchmark_order.py gtmbench-1-quick/results.json gtmbench-1/results.json [--out DIR]

Of every two rows that both tables have: they differ where their spreads don't overlap, as the tables say; a row
without quickness comes after all that have one. Prints the comparison and writes it as order.md into DIR. Ends with
code 1 where two rows differ in both tables and stand the other way round.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from gtmbench.report.tables.markdown import markdown

Ends = tuple[float, float]
SAME, REVERSED, OPEN = "same", "reversed", "open"


def ends(row: Mapping[str, Any]) -> Ends:
    """Return the lowest and highest quickness of a row; below all others where it has none."""
    if row["quickness"] is None:
        return (-1.0, -1.0)
    low, high = row["spread"] or (row["quickness"], row["quickness"])
    return min(low, row["quickness"]), max(high, row["quickness"])


def order(one: Ends, other: Ends) -> int:
    """Return 1 where the first is better, -1 where the second is, 0 where they overlap.

    >>> order((0.5, 0.6), (0.1, 0.5)), order((0.5, 0.6), (0.1, 0.4)), order((-1.0, -1.0), (0.0, 0.0))
    (0, 1, -1)
    """
    return int(one[0] > other[1]) - int(other[0] > one[1])


def compared(quick: Mapping[str, Ends], full: Mapping[str, Ends]) -> dict[tuple[str, str], str]:
    """Return of every two rows that both tables have whether they stand in the same order.

    >>> quick = {"a": (0.5, 0.6), "b": (0.1, 0.2), "c": (0.1, 0.3)}
    >>> compared(quick, {"a": (0.1, 0.2), "b": (0.3, 0.4), "c": (0.0, 0.0)})
    {('a', 'b'): 'reversed', ('a', 'c'): 'same', ('b', 'c'): 'open'}
    """
    told = {}
    for one, other in itertools.combinations([name for name in quick if name in full], 2):
        orders = order(quick[one], quick[other]), order(full[one], full[other])
        told[one, other] = OPEN if 0 in orders else SAME if orders[0] == orders[1] else REVERSED
    return told


def main() -> None:
    """Compare two tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("quick", type=Path)
    parser.add_argument("full", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/gtmbench-1"))
    given = parser.parse_args()
    rows = [json.loads(path.read_text(encoding="utf-8"))["rows"] for path in (given.quick, given.full)]
    quick, full = ({row["name"]: ends(row) for row in of} for of in rows)
    pairs = compared(quick, full)
    counts = {kind: sum(told == kind for told in pairs.values()) for kind in (SAME, REVERSED, OPEN)}
    table = pd.DataFrame(
        [
            {"entry": name, "quick": shown(quick[name]), "full": shown(full[name])}
            for name in sorted((name for name in quick if name in full), key=lambda name: full[name], reverse=True)
        ]
    )
    reversed_pairs = [pair for pair, told in pairs.items() if told == REVERSED]
    without = sorted({name for pair in reversed_pairs for name in pair if min(quick[name][1], full[name][1]) < 0.0})
    unnumbered = sum(not set(pair).isdisjoint(without) for pair in reversed_pairs)
    against = [f"- {one} and {other}" for one, other in reversed_pairs]
    differ = counts[SAME] + counts[REVERSED]
    text = f"""# The order of the quick table and of the full one

Written by `python experiments/benchmark_order.py`. Quickness, lowest and highest over calibrations; two rows differ
where these don't overlap. Of {len(pairs)} pairs of rows {differ} differ in both tables: {counts[SAME]} in the same
order, {counts[REVERSED]} reversed; {counts[OPEN]} overlap in one of the tables at least.

{markdown(table)}
"""
    if against:
        text += (
            f"\nReversed, {unnumbered} of {len(against)} with a row without a number in one of the tables, because it "
            f"certainly raised\nmore false alarms than are allowed ({', '.join(without)}):\n\n"
            + "\n".join(against)
            + "\n"
        )
    print(text)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "order.md").write_text(text, encoding="utf-8")
    sys.exit(int(bool(against)))


def shown(of: Ends) -> str:
    """Return a range as text; a dash where there is no number."""
    return "-" if of[1] < 0.0 else f"{of[0]:.3f} to {of[1]:.3f}"


if __name__ == "__main__":
    main()
