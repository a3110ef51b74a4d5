"""Engines that settle: the thrust of steady flight, where JSBSim's own search for it fails.

JSBSim looks for an engine's steady state by steps of half a second. The governor of a propeller turns its blades by one
degree a second for every revolution a minute that is missing, a turbine spools up over seconds, and neither follows
such steps: the blades are left at a stop, or the engine dies. Here the aircraft is held while its engines run at the
step that they are flown with, until their thrust doesn't change any more.
"""

from __future__ import annotations

from typing import Any

import jsbsim

from gtmbench.bench.propellers import held

_LOOKED_S, _LONGEST_S = 1.0, 90.0
_STEADY = 1e-9  # of the thrust, over a second


def settle(fdm: jsbsim.FGFDMExec) -> bool:
    """Run all engines until their thrust is steady, the aircraft held; say whether it is within 90 s."""
    steps = max(round(_LOOKED_S / fdm.get_delta_t()), 1)
    with held(fdm):
        before = thrusts_lbs(fdm)
        for _ in range(round(_LONGEST_S / _LOOKED_S)):
            for _ in range(steps):
                fdm.run()
            now = thrusts_lbs(fdm)
            if all(abs(b - a) <= _STEADY * max(abs(b), 1.0) for a, b in zip(before, now, strict=True)):
                return True
            before = now
    return False


def thrusts_lbs(fdm: Any) -> list[float]:
    """Return the thrust of every engine."""
    return [fdm[f"propulsion/engine[{motor}]/thrust-lbs"] for motor in range(fdm.get_propulsion().get_num_engines())]
