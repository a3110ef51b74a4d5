"""Gains on the sensor chain beside those on ideal sensors: healthy flights of the GTM in turbulence.

    python experiments/chained_gains.py [--seeds FIRST:LAST] [--duration S] [--out DIR]

Three loops fly the same air: ideal sensors with their gains, the chain with the gains that were found on it, and the
chain with the gains for ideal sensors. Prints and writes into DIR/report.md the RMS of the true rates, the same over
that on ideal sensors, departures, and by how much later gyros and angles may come. The seeds are used for nothing else.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import gtmbench as gb
from gtmbench.bench.tuning import delay_margin_s
from gtmbench.values.channels import GYROS
from studies.conduct import write_report

TARGET = 1.2  # RMS q on the chain over that on ideal sensors


def rows(seeds: range, duration_s: float) -> list[list[str]]:
    """Fly, and return a row a loop."""
    craft = gb.load_aircraft("gtm")
    assert craft.autopilot
    assert craft.chain_autopilot
    loops = (
        ("ideal, its gains", None, craft.autopilot),
        ("chain, its gains", craft.chain, craft.chain_autopilot),
        ("chain, gains for ideal sensors", craft.chain, craft.autopilot),
    )
    table, ideal = [], np.ones(3)
    for name, chain, pilot in loops:
        sensors: str | gb.SensorChain = chain or "ideal"
        flights = [gb.fly_in_loop(duration_s=duration_s, seed=seed, sensors=sensors, autopilot=pilot) for seed in seeds]
        squares = [[np.var(flight.truth[gyro]) for gyro in GYROS] for flight in flights]
        rms = np.sqrt(np.mean(squares, axis=0))
        if chain is None:
            ideal = rms
        departed = sum(flight.departed_s is not None for flight in flights)
        margin_ms = 1000.0 * delay_margin_s(craft, pilot, chain)
        ratios = [f"{value:.2f}" for value in rms / ideal]
        table.append([name, *(f"{value:.2f}" for value in rms), *ratios, str(departed), f"{margin_ms:.0f}"])
    return table


def main() -> None:
    """Fly, print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="5430001:5430020", help="the first and the last flight's")
    parser.add_argument("--duration", type=float, default=60.0, help="of a flight, in seconds")
    parser.add_argument("--out", type=Path, default=Path("experiments/reports/chained_gains"))
    given = parser.parse_args()
    first, last = map(int, given.seeds.split(":"))
    seeds = range(first, last + 1)
    table = rows(seeds, given.duration)
    names = ["loop", *(f"RMS {gyro} (deg/s)" for gyro in GYROS), *(f"{gyro} over ideal" for gyro in GYROS)]
    names += ["departed", "later by at most (ms)"]
    lines = ["| " + " | ".join(row) + " |" for row in (names, ["---", *["---:"] * 8], *table)]
    reached = "reached" if float(table[1][5]) <= TARGET else "missed"
    text = (
        "# Gains on the sensor chain\n"
        f"`python experiments/chained_gains.py --seeds {given.seeds} --duration {given.duration:g}`: {len(seeds)} "
        f"healthy flights of {given.duration:g} s a loop, moderate turbulence. RMS q on the chain is {table[1][5]} "
        f"times that on ideal sensors; the target of {TARGET:g} is {reached}.\n\n" + "\n".join(lines) + "\n"
    )
    given.out.mkdir(parents=True, exist_ok=True)
    write_report(given.out, text, given)
    print(text)


if __name__ == "__main__":
    main()
