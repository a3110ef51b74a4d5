"""The flight loop against JSBSim's bare ``run()`` loop: both fly the GTM from trim, each time in a fresh engine."""

from __future__ import annotations

import statistics
from collections.abc import Callable

import numpy as np

from gtmbench.bench import flight
from gtmbench.bench.equilibrium import trimmed_engine
from gtmbench.bench.excitation import excitation
from gtmbench.bench.fleet import load_aircraft

from .timing import seconds

STEPS = 20_000


def measure(rounds: int) -> dict:
    """Return the time of the loop over that of the bare one."""
    craft = load_aircraft("gtm")
    moved = excitation("dissertation", np.arange(STEPS + 1) * flight.SAMPLE_PERIOD_S, seed=1)
    ratios = []
    for _ in range(rounds):
        fdm, trimmed = trimmed_engine(craft)
        commands = flight._commands(craft, trimmed, moved, STEPS + 1)
        ours = seconds(lambda fdm=fdm, commands=commands: flight._fly(fdm, craft, commands))
        fdm, _ = trimmed_engine(craft)
        ratios.append(ours / seconds(lambda run=fdm.run: _bare(run)))
    return {"ratio": statistics.median(ratios)}


def _bare(run: Callable[[], bool]) -> None:
    for _ in range(STEPS):
        run()
