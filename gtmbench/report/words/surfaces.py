"""The detector of surfaces in tables: its equations, and what a monitor has identified of them."""

from __future__ import annotations

from collections.abc import Sequence

from gtmbench.detectors.surfaces.equations import OWN_SURFACES, Flow
from gtmbench.detectors.surfaces.surfaces import SurfaceMonitor
from gtmbench.detectors.surfaces.thrust import STEP_PERCENT, THROTTLE
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES, unit_of

EQUATIONS = ("equation", "surfaces in it", "beside them")
_BESIDE = {
    "lateral": "sideslip, roll and yaw rate, inertia",
    "longitudinal": "angle of attack, pitch rate, inertia",
    "forward": "angle of attack, sideslip, pitch rate",
}


def equation_rows(flow: Flow, judged: Sequence[str] | None = None) -> list[list[str]]:
    """Return a row an equation: what it explains, which surfaces are in it, and what else.

    `judged`: the surfaces that are; by default all that could be.

    >>> equation_rows(Flow(forward=True))[1]
    ['change of q', 'elevator throttle', 'angle of attack, pitch rate, inertia']
    >>> equation_rows(Flow())[1]
    ['change of q', 'elevator', 'angle of attack, pitch rate, inertia, thrust']
    """
    judged = judged or (COMMANDS if flow.forward else SURFACES)
    rows = []
    for name, axis in flow.equations(judged).items():
        own = [surface for surface in OWN_SURFACES[axis] if surface in judged]
        thrust = ", thrust" if THROTTLE in OWN_SURFACES[axis] and THROTTLE not in judged else ""
        rows.append([f"change of {name}" if name in GYROS else name, " ".join(own), _BESIDE[axis] + thrust])
    return rows


def effect_rows(monitor: SurfaceMonitor) -> tuple[list[str], list[list[str]]]:
    """Return the columns and rows of what a degree of each surface changes, and what gusts amount to in its degrees.

    Of the throttle it is a step of 20 %, and percent.
    """
    surfaces, steps = list(monitor.suspects), monitor.answer.frame.steps
    rows = [
        [f"{name} ({_unit(name)})", *(f"{value:.3g}" if value else "" for value in effects)]
        for name, effects in zip(monitor.answer.frame.equations, monitor.answer.effects, strict=True)
    ]
    noise = monitor.normal.noise[: len(surfaces)] * steps
    rows.append(["gusts and sensors (deg, %)", *(f"{value:.2g}" for value in noise)])
    headed = [f"{name} ({STEP_PERCENT:g} %)" if name == THROTTLE else name for name in surfaces]
    return ["equation", *headed], rows


def _unit(name: str) -> str:
    return "deg/s²" if name in GYROS else unit_of(name)
