"""What an aircraft was commanded and how it answered, in the longest stretch of a flight in which its wings carry it.

Gyros, flow and commands are brought to steps of a twentieth of a second, for an aircraft answers within a block of the
engine. On the ground a surface does nothing, so the beginning and the end of what is fast are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gtmbench.detectors.surfaces.commanded import Commanded
from gtmbench.detectors.surfaces.equations import Flow
from gtmbench.detectors.surfaces.identification import STEP_S, frame_of
from gtmbench.engine.flight import Flight
from gtmbench.engine.samples import Samples, edges_of, means_between
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES
from gtmbench.values.record import runs

_NEEDS = (*GYROS, *COMMANDS, "ny", "nz", "tas", "altitude")  # without an airspeed nobody knows what a surface can do
_FLIES, _FAST = 0.65, 0.75  # of the airspeed that is exceeded in a quarter of the flight: more than when wheels roll
_GROUND_S = 5.0  # beside what is slower
_LEAST_S = 60.0  # of flight: in less nothing is judged
_ENOUGH = round(300.0 / STEP_S)  # steps that tell how late servos and engines are: trying each lag is most of the work
_SLOWEST_S = 0.125  # between samples: an aircraft has answered by then


def commanded_of(flight: Flight, sensors: Mapping[str, Samples]) -> Commanded | None:
    """Return what a flight was commanded; None where a command or an airspeed isn't read, or too little is flown.

    `sensors`, by channel: gyros, commands and what else is read, in the units of channels, on the flight's clock.
    """
    if not {*_NEEDS} <= sensors.keys() or max(sensors[name].step_s for name in (*GYROS, *SURFACES)) > _SLOWEST_S:
        return None
    flow = Flow(vanes={"alpha", "beta"} <= sensors.keys(), forward={"alpha", "beta", "nx"} <= sensors.keys())
    edges = edges_of(flight.blocks)
    fine = np.arange(edges[0], edges[-1] + 0.5 * STEP_S, STEP_S)
    at_s = fine[:-1] + 0.5 * STEP_S
    channels = (*GYROS, *flow.channels, *COMMANDS)
    angles = {
        name: Samples(flight.blocks.time_s, own) for name, own in zip(("phi", "theta"), flight.angles.T, strict=False)
    }
    values = np.column_stack([means_between((angles | dict(sensors))[name], fine) for name in channels])
    flown = np.interp(at_s, flight.blocks.time_s, flight.flown.astype(float)) > 0.5
    there = flown & np.isfinite(values).all(axis=1)
    if not there.any():
        return None
    speed = values[:, channels.index("tas")]
    there &= speed > _FLIES * float(np.quantile(speed[there], _FAST))
    first, last = max(zip(*runs(there), strict=True), key=lambda span: span[1] - span[0])
    beside = round(_GROUND_S / STEP_S)
    part = slice(int(first) + beside, int(last) - beside)
    own = values[part]
    if len(own) * STEP_S < _LEAST_S:
        return None
    try:
        frame = frame_of(flow, [own[:_ENOUGH]], STEP_S)
    except InputError:  # no surface moved
        return None
    return Commanded(start_s=float(fine[part.start]), period_s=STEP_S, channels=channels, values=own, frame=frame)


def framed(commanded: Commanded, until_s: float) -> Commanded:
    """Return the same with the equations as what is there until a time has them."""
    healthy = commanded.until(until_s).values[-_ENOUGH:]
    return replace(commanded, frame=frame_of(commanded.frame.flow, [healthy], commanded.period_s))
