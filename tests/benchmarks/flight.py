"""The flight loop, open and closed, against JSBSim's bare ``run()``: from the same trim, each in a fresh engine."""

from __future__ import annotations

import statistics
from collections.abc import Callable

from gtmbench.bench import flight, loop
from gtmbench.bench.airborne import Airborne, take_off
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.sensors import noise_blocks
from gtmbench.faults.additive import Drift

from .timing import seconds

STEPS = 20_000


def measure(rounds: int) -> dict:
    """Return the time of the open loop over that of the bare one, and of the closed loop over that of the open."""
    ratios: dict[str, list[float]] = {"ratio": [], "closed_ratio": [], "broken_ratio": []}
    drift = Drift(channel="p", onset_s=0.0, slope=1e-6)
    for _ in range(rounds):
        ready = _ready()
        commands = flight._commands(ready)
        ours = seconds(lambda ready=ready, commands=commands: flight._fly(ready, commands))
        ready = _ready()
        bare = seconds(lambda run=ready.fdm.run: _bare(run))
        ratios["ratio"].append(ours / bare)
        for name, faults in (("closed_ratio", []), ("broken_ratio", [loop._Breaking(drift)])):
            ready = _ready()
            ratios[name].append(seconds(lambda ready=ready, faults=faults: _closed(ready, faults)) / ours)
    return {name: statistics.median(values) for name, values in ratios.items()}


def _ready() -> Airborne:
    return take_off("gtm", "dissertation", STEPS * SAMPLE_PERIOD_S, 1)


def _closed(ready: Airborne, faults: list[loop._Breaking]) -> None:
    assert ready.aircraft.autopilot is not None
    loop._fly(ready, ready.aircraft.autopilot, faults, noise_blocks("t2", 1, STEPS + 1, 4096), None)


def _bare(run: Callable[[], bool]) -> None:
    for _ in range(STEPS):
        run()
