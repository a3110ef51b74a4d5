"""A departure beside its rescue: the same flight, the same fault, without accommodation and with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from gtmbench.bench.aircraft import Aircraft
from gtmbench.bench.loop import fly_in_loop
from gtmbench.bench.loop_flight import LoopFlight
from gtmbench.detectors.accommodation.without_sensor import Accommodate
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault


@dataclass(frozen=True, kw_only=True, eq=False)
class Rescue:
    """Two flights that are one until the accommodation acts.

    Attributes
    ----------
    faults : tuple of Fault
    unaided, rescued : LoopFlight
        Without accommodation, and with it.
    watch : Watch
        What the accommodation's monitor said of what the rescued aircraft's sensors read.
    """

    faults: tuple[Fault, ...]
    unaided: LoopFlight = field(repr=False)
    rescued: LoopFlight = field(repr=False)
    watch: Watch = field(repr=False)

    @property
    def onset_s(self) -> float:
        """When the first fault began."""
        return min(fault.onset_s for fault in self.faults)

    @property
    def flights(self) -> dict[str, LoopFlight]:
        """Both, by what they are."""
        return {"unaided": self.unaided, "rescued": self.rescued}


def fly_rescue(
    faults: Sequence[Fault],
    accommodate: Accommodate,
    *,
    aircraft: str | Path | Aircraft = "gtm",
    excitation: str = "turbulence",
    duration_s: float = 60.0,
    seed: int = 1,
    sensors: str | None = None,
    altitude_ft: float | None = None,
    tas_kt: float | None = None,
) -> Rescue:
    """Fly with faults in the loop, without accommodation and with it.

    Raises
    ------
    InputError
        Where there is no fault, and where `fly_in_loop` refuses.
    """
    if not faults:
        raise InputError("nothing breaks, so there is nothing to rescue from; give a fault")
    fly = partial(
        fly_in_loop, aircraft, excitation, duration_s, seed, sensors=sensors, altitude_ft=altitude_ft, tas_kt=tas_kt
    )
    unaided, rescued = fly(faults=faults), fly(faults=faults, accommodate=accommodate)
    watch = accommodate.monitor.watch(rescued.sensed)
    return Rescue(faults=tuple(faults), unaided=unaided, rescued=rescued, watch=watch)
