"""Excitations: what moves the surfaces (and the air) while a flight is recorded.

An excitation adds to the trimmed commands. Its name is one of `EXCITATIONS`, or a sum of them:
``multisine+turbulence``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.checks import meant, shown
from gtmbench.errors import InputError
from gtmbench.values.channels import SURFACES
from gtmbench.values.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """Surface deflections about trim in degrees, by channel, whether the air is turbulent, and how much (MIL, 1 to 7).

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> time_s = np.arange(0.0, 5.0, 0.01)
    >>> kick = gb.Excitation(surfaces={"rudder": np.where((time_s >= 1.0) & (time_s < 1.5), 2.0, 0.0)})
    >>> flight = gb.fly("gtm", kick, duration_s=4.99)
    >>> float(np.ptp(flight["rudder"])), bool(np.abs(flight["r"]).max() > 1.0)
    (2.0, True)
    """

    surfaces: dict[str, FloatArray] = field(default_factory=dict)
    turbulence: bool = False
    severity: int = 3

    def scaled(self, factors: Mapping[str, float]) -> Excitation:
        """Return the excitation with every deflection multiplied by a factor; turbulence is unchanged."""
        moved = {surface: values * factors[surface] for surface, values in self.surfaces.items()}
        return replace(self, surfaces=moved)


def excitation(name: str, time_s: FloatArray, seed: int) -> Excitation:
    """Return a named excitation, or a sum of them, sampled at the given times.

    >>> both = excitation("multisine+turbulence", np.arange(0.0, 1.0, 0.01), seed=1)
    >>> sorted(both.surfaces), both.turbulence
    (['aileron', 'elevator', 'rudder'], True)
    """
    parts = [EXCITATIONS[part](time_s, seed) for part in parts_of(name)]
    total = {
        surface: np.sum([part.surfaces[surface] for part in parts if surface in part.surfaces], axis=0)
        for surface in SURFACES
        if any(surface in part.surfaces for part in parts)
    }
    return Excitation(surfaces=total, turbulence=any(part.turbulence for part in parts))


def parts_of(name: str) -> list[str]:
    """Return the terms of an excitation's name, or refuse one that is unknown or stands there twice."""
    parts = [part.strip() for part in name.split("+")]
    for part in parts:
        if part not in EXCITATIONS:
            known = f"{', '.join(EXCITATIONS)}, and sums such as multisine+turbulence{meant(part, EXCITATIONS)}"
            raise InputError(f"no excitation {shown(part)}; there are {known}")
        if parts.count(part) > 1:
            raise InputError(f"excitation '{name}' holds '{part}' twice; name every term once")
    return parts


def dissertation(time_s: FloatArray, seed: int) -> Excitation:
    """One sinusoid of 1 deg and 30 deg/s (a period of 12 s) on every surface (section 4.4).

    Aileron sin(W t), elevator sin(W t + 45 deg), rudder cos(W t), with W = 30 deg/s.
    """
    angle = np.deg2rad(30.0) * time_s
    return Excitation(
        surfaces={
            "elevator": np.sin(angle + np.deg2rad(45.0)),
            "aileron": np.sin(angle),
            "rudder": np.cos(angle),
        }
    )


def multisine(time_s: FloatArray, seed: int) -> Excitation:
    """Many sinusoids with random phases, 0.05-2 Hz, 0.01 Hz apart, dealt out so that no two surfaces share one.

    Every surface moves with an RMS of 0.7 deg, that of a sinusoid of 1 deg.
    """
    lines_hz = np.arange(5, 201) / 100.0
    random = np.random.default_rng([seed, *b"multisine"])
    surfaces = {}
    for i, surface in enumerate(SURFACES):
        own = lines_hz[i :: len(SURFACES)]
        phases = random.uniform(0.0, 2.0 * np.pi, len(own))
        total = np.zeros_like(time_s)
        for frequency, phase in zip(own, phases, strict=True):
            total += np.sin(2.0 * np.pi * frequency * time_s + phase)
        surfaces[surface] = total / np.sqrt(len(own))
    return Excitation(surfaces=surfaces)


def doublets(time_s: FloatArray, seed: int) -> Excitation:
    """One doublet every 5 s, elevator, aileron and rudder in turn: 1 s at +2 deg, 1 s at -2 deg."""
    turn, within = np.divmod(time_s, 5.0)
    pulse = np.where(within < 1.0, 2.0, np.where(within < 2.0, -2.0, 0.0))
    return Excitation(surfaces={name: np.where(turn % 3 == i, pulse, 0.0) for i, name in enumerate(SURFACES)})


def turbulence(time_s: FloatArray, seed: int) -> Excitation:
    """Moderate turbulence (MIL-F-8785C spectra in JSBSim, 25 ft/s wind at 20 ft), from the flight's seed."""
    return Excitation(turbulence=True)


EXCITATIONS: dict[str, Callable[[FloatArray, int], Excitation]] = {
    "dissertation": dissertation,
    "multisine": multisine,
    "doublets": doublets,
    "turbulence": turbulence,
}
