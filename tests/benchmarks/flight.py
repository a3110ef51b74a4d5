"""The flight loop, open and closed, against JSBSim's bare ``run()``: from the same trim, each in a fresh engine."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from functools import partial

from gtmbench.bench import flight
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.breaking import Surfaces
from gtmbench.bench.simulation import Simulation
from gtmbench.bench.stepping import Airborne, take_off
from gtmbench.faults.fault import Fault
from gtmbench.faults.kinds.additive import Drift

from .timing import seconds

STEPS = 20_000


def measure(rounds: int) -> dict:
    """Return the time of the open loop over that of the bare one, and of the closed loop over that of the open."""
    ratios: dict[str, list[float]] = {"ratio": [], "closed_ratio": [], "broken_ratio": []}
    drift = Drift(channel="p", onset_s=0.0, slope=1e-6)
    for _ in range(rounds):
        ready = _ready()
        commands, healthy = flight._commands(ready), Surfaces((), ready.aircraft.limits)
        ours = seconds(partial(flight._fly, ready, commands, healthy))
        ready = _ready()
        bare = seconds(lambda run=ready.fdm.run: _bare(run))
        ratios["ratio"].append(ours / bare)
        broken: tuple[tuple[str, list[Fault]], ...] = (("closed_ratio", []), ("broken_ratio", [drift]))
        for name, faults in broken:
            ratios[name].append(seconds(_closed(faults)) / ours)
    return {name: statistics.median(values) for name, values in ratios.items()}


def _ready() -> Airborne:
    return take_off("gtm", "dissertation", STEPS * SAMPLE_PERIOD_S, 1)


def _closed(faults: list[Fault]) -> Callable[[], object]:
    """Return what flies a flight, in trim already, on what ideal sensors read."""
    simulation = Simulation("gtm", "dissertation", STEPS * SAMPLE_PERIOD_S, faults=faults, noise="t2", noise_seed=1)
    simulation.reset(1)
    autopilot, limits = simulation.aircraft.autopilot, simulation.aircraft.limits
    assert autopilot is not None
    command = autopilot.engage(simulation.trim, limits, SAMPLE_PERIOD_S)
    return lambda: simulation.fly_by(command)


def _bare(run: Callable[[], bool]) -> None:
    for _ in range(STEPS):
        run()
