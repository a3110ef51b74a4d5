"""Propellers and engines: how fast they turn in steady flight, where JSBSim's own search for that fails.

JSBSim looks for the steady speed of a propeller by steps of half a second, from standstill on, where its torque is the
engine's power over 0.01 rad/s. A small propeller's inertia is so little that the first step throws it to millions of
revolutions, and the next one back to none: it stands, and its torque turns the aircraft by 1e5 rad/s2.

Here the aircraft is held while the propeller turns, w' = f(w), by steps h that are found as it goes: w + h f(w) with
h = -1/f'(w) is Newton's method, and JSBSim itself takes the step.

The governor of a propeller turns its blades by one degree a second for every revolution a minute that is missing, a
turbine spools up over seconds, and neither follows steps of half a second: the blades are left at a stop, or the engine
dies. `settle` runs them at the step that they are flown with, the aircraft held, until their thrust doesn't change.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import jsbsim

_INTEGRATORS = tuple(
    f"simulation/integrator/{what}/{motion}"
    for what in ("rate", "position")
    for motion in ("rotational", "translational")
)
_HELD = 0  # JSBSim's integrator that integrates nothing
_SHORTEST_S, _LONGEST_S, _FIRST_S = 1e-12, 2.0, 1e-9
_GROWTH = 2.0  # of a step at most
_MOST_CHANGE = 0.3  # of the speed in a step
_TURNS_RPM = 1.0  # below this it stands
_SETTLED = 1e-12  # of the speed, what a Newton step still changes
_NOISE = 1e-9  # of the speed: of smaller changes no slope is taken
_TRUSTED_S = 1e-4  # a shorter step changes little anyway
_MOST_STEPS = 2000
_FASTEST_MACH = 2.0  # of a blade's tip: no propeller turns so
_LOOKED_S, _STEADY_WITHIN_S = 1.0, 90.0
_STEADY = 1e-9  # of the thrust, over a second


def propellers(fdm: jsbsim.FGFDMExec) -> list[str]:
    """Return the properties of every propeller's speed, in revolutions a minute."""
    properties = fdm.get_property_manager()
    motors = range(fdm.get_propulsion().get_num_engines())
    names = [
        f"propulsion/engine[{motor}]/propeller-rpm" if motor else "propulsion/engine/propeller-rpm" for motor in motors
    ]
    return [name for name in names if properties.get_node(name) is not None]


def wrong_speeds(fdm: jsbsim.FGFDMExec) -> list[str]:
    """Say of every propeller that can't turn as it does: it stands under power, or its tips are far beyond sound."""
    said, properties = [], fdm.get_property_manager()
    for number, name in enumerate(propellers(fdm)):
        engine, rpm = name.rpartition("/")[0], fdm[name]
        nodes = [properties.get_node(f"{engine}/{what}") for what in ("power-hp", "helical-tip-Mach")]
        power, mach = (0.0 if node is None else node.get_double_value() for node in nodes)  # not every kind has both
        which = f"propeller {number}"
        if power > 0.0 and abs(rpm) < _TURNS_RPM:
            said.append(f"{which} stands still under {power:.3g} hp")
        elif not (math.isfinite(rpm) and mach < _FASTEST_MACH):
            said.append(f"{which} turns at {rpm:.3g} rpm, its tips at Mach {mach:.2g}")
    return said


def spin_up(fdm: jsbsim.FGFDMExec) -> float:
    """Turn all propellers until they are steady, the aircraft held; return their stiffness -f'(w) in 1/s."""
    names = propellers(fdm)
    if not names:
        return 0.0
    with held(fdm):
        return _turn(fdm, names)


@contextmanager
def held(fdm: jsbsim.FGFDMExec) -> Iterator[None]:
    """Keep the aircraft where it is while its engines, servos and filters run on."""
    period_s, before = fdm.get_delta_t(), [fdm[name] for name in _INTEGRATORS]
    for name in _INTEGRATORS:
        fdm[name] = _HELD
    try:
        yield
    finally:
        fdm.set_dt(period_s)
        for name, integrator in zip(_INTEGRATORS, before, strict=True):
            fdm[name] = integrator


def _turn(fdm: jsbsim.FGFDMExec, names: list[str]) -> float:
    step_s, stiffness = _FIRST_S, 0.0
    last: tuple[float, float] | None = None  # the last speed and its rate, of the propeller that changes most
    for _ in range(_MOST_STEPS):
        speeds = [fdm[name] for name in names]
        fdm.set_dt(step_s)
        fdm.run()
        changes = [fdm[name] - speed for name, speed in zip(names, speeds, strict=True)]
        most = max(range(len(names)), key=lambda i: abs(changes[i]))
        speed, change = speeds[most], changes[most]
        if abs(change) <= _SETTLED * max(abs(speed), _TURNS_RPM) and step_s > _TRUSTED_S:
            return stiffness
        rate, longest_s = change / step_s, step_s * _GROWTH
        if abs(change) > _MOST_CHANGE * max(abs(speed), 100.0):
            longest_s = step_s / _GROWTH
        if last is not None and speed != last[0] and (slope := (rate - last[1]) / (speed - last[0])) < 0.0:
            stiffness = -slope if abs(change) > _NOISE * max(abs(speed), 1.0) else stiffness
            longest_s = min(longest_s, 1.0 / stiffness) if stiffness else longest_s
        last = speed, rate
        step_s = min(max(longest_s, _SHORTEST_S), _LONGEST_S)
    return stiffness


def settle(fdm: jsbsim.FGFDMExec) -> bool:
    """Run all engines until their thrust is steady, the aircraft held; say whether it is within 90 s."""
    steps = max(round(_LOOKED_S / fdm.get_delta_t()), 1)
    with held(fdm):
        before = thrusts_lbs(fdm)
        for _ in range(round(_STEADY_WITHIN_S / _LOOKED_S)):
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
