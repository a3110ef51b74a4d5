"""Measured ratios, one process, one thread: run by ``make bench``.

Each figure is the median over interleaved repetitions, so that a machine that slows down slows down both sides.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from gtmbench.bench import flight
from gtmbench.bench.aircraft import load_aircraft
from gtmbench.bench.excitation import excitation
from gtmbench.bench.trim import trimmed_engine

REPETITIONS = 7
STEPS = 20_000


def seconds(work: Callable[[], object]) -> float:
    """Time one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def flight_loop() -> float:
    """Return the time of the flight loop over JSBSim's bare ``run()`` loop; both fly the GTM from trim."""
    craft = load_aircraft("gtm")
    time_s = np.arange(STEPS + 1) * flight.SAMPLE_PERIOD_S
    moved = excitation("dissertation", time_s, seed=1)
    ratios = []
    for _ in range(REPETITIONS):
        fdm, trimmed = trimmed_engine(craft)
        commands = flight._commands(craft, trimmed, moved, STEPS + 1)
        ours = seconds(lambda fdm=fdm, commands=commands: flight._fly(fdm, commands))
        fdm, _ = trimmed_engine(craft)

        def bare(run: Callable[[], bool] = fdm.run) -> None:
            for _ in range(STEPS):
                run()

        ratios.append(ours / seconds(bare))
    return statistics.median(ratios)


def main() -> None:
    """Print every ratio with its target."""
    print(f"flight loop / JSBSim's bare run() loop: {flight_loop():.2f}   (target: at most 1.35)")


if __name__ == "__main__":
    main()
