"""The detector of surfaces in tables: its equations, and what a monitor has identified of them."""

from __future__ import annotations

from gtmbench.detectors.surfaces.answer import OWN_SURFACES, Flow
from gtmbench.detectors.surfaces.surfaces import SurfaceMonitor
from gtmbench.values.channels import GYROS, unit_of

EQUATIONS = ("equation", "surfaces in it", "beside them")
_BESIDE = {
    "lateral": "sideslip, roll and yaw rate, inertia",
    "longitudinal": "angle of attack, pitch rate, thrust, inertia",
}


def equation_rows(flow: Flow) -> list[list[str]]:
    """Return a row an equation: what it explains, which surfaces are in it, and what else.

    >>> equation_rows(Flow())[1]
    ['change of q', 'elevator', 'angle of attack, pitch rate, thrust, inertia']
    """
    return [
        [f"change of {name}" if name in GYROS else name, " ".join(OWN_SURFACES[axis]), _BESIDE[axis]]
        for name, axis in flow.equations.items()
    ]


def effect_rows(monitor: SurfaceMonitor) -> tuple[list[str], list[list[str]]]:
    """Return the columns and rows of what a degree of each surface changes, and what gusts amount to in its degrees."""
    surfaces = list(monitor.suspects)
    rows = [
        [f"{name} ({_unit(name)})", *(f"{value:.3g}" if value else "" for value in effects)]
        for name, effects in zip(monitor.answer.flow.equations, monitor.answer.effects, strict=True)
    ]
    rows.append(["gusts and sensors (deg)", *(f"{value:.2g}" for value in monitor.normal.noise[: len(surfaces)])])
    return ["equation", *surfaces], rows


def _unit(name: str) -> str:
    return "deg/s²" if name in GYROS else unit_of(name)
