"""The leaderboard of gtmbench-2, and how far private sets agree with the public one.

    python experiments/benchmark_leaderboard.py PUBLIC/results.json PRIVATE/results.json ... [--out DIR]

Rows are those that all files have, by their mean over the private ones. Of the first two detectors the paired
difference is shown on each set, and over all private ones: the mean of its ends, as if these were one and the same
draw, which is wider than if they were independent. The rule of entry stands in docs/how_to/benchmark.md.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gtmbench.report.markup import markdown
from gtmbench.study.benchmark.run import YARDSTICKS


def quickness(results: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return the number of every row that has one."""
    return {row["name"]: row["quickness"] for row in results["rows"] if row["quickness"] is not None}


def difference(results: dict[str, Any], first: str, second: str) -> list[float]:
    """Return by how much the first row is quicker, and the ends of its interval."""
    for each in results["differences"]:
        told = [each["quickness"][key] for key in ("value", "low", "high")]
        if (each["first"], each["second"]) == (first, second):
            return told
        if (each["first"], each["second"]) == (second, first):
            return [-told[0], -told[2], -told[1]]
    raise SystemExit(f"{first} and {second} aren't compared")


def shown(told: list[float]) -> str:
    """Return a figure with its interval."""
    return f"{told[0]:.3f} ({told[1]:.3f} to {told[2]:.3f})"


def main() -> None:
    """Write leaderboard.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("out/gtmbench-2"))
    given = parser.parse_args()
    sets = [json.loads(path.read_text(encoding="utf-8")) for path in given.results]
    if len({each["digest"] for each in sets}) > 1:
        raise SystemExit("the results are of more than one definition; give those of one")
    private = [each for each in sets if each["split"] == "private"]
    names = [each["private_seed"][:12] if each["split"] == "private" else "public" for each in sets]
    numbers = [quickness(each) for each in sets]
    shared = set.intersection(*map(set, numbers))
    tuned = {row["name"]: row["tuned"] for row in sets[0]["rows"]}
    means = {name: float(np.mean([quickness(each)[name]["value"] for each in private])) for name in shared}
    order = sorted(shared, key=lambda name: -means[name])
    rows = [
        {
            "entry": f"*{name}*" if name in YARDSTICKS else name,
            "private sets": f"{means[name]:.3f}",
            **{
                of: shown([each[name][key] for key in ("value", "low", "high")])
                for of, each in zip(names, numbers, strict=True)
            },
            "tuned on": tuned[name],
        }
        for name in order
    ]
    first, second = [name for name in order if name not in YARDSTICKS][:2]
    pairs = [difference(each, first, second) for each in sets]
    pooled = np.mean([difference(each, first, second) for each in private], axis=0).tolist()
    apart = [{"set": of, f"{first} less {second}": shown(pair)} for of, pair in zip(names, pairs, strict=True)]
    apart.append({"set": "all private ones", f"{first} less {second}": shown(pooled)})
    page = f"""# Leaderboard of {sets[0]["benchmark"]}

Written by `python experiments/benchmark_leaderboard.py`; the rule of entry stands in `docs/how_to/benchmark.md`.
Quickness with its 95 % interval, a column a set: private ones by the first twelve digits of their secret's SHA-256.

{markdown(pd.DataFrame(rows))}

## The first two

{markdown(pd.DataFrame(apart))}
"""
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "leaderboard.md").write_text(page, encoding="utf-8")
    print(page)


if __name__ == "__main__":
    main()
