"""A flight with its further IMUs, by their samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.imu import FlightImu, mounting_of
from gtmbench.engine.samples import Samples, edges_of, gyros_between, held_between, rough_between


def with_imus(flight: Flight, imus: Mapping[str, Sequence[Samples]]) -> Flight:
    """Return a flight with further IMUs. `imus`, by name: what p, q and r of each read, in deg/s."""
    return replace(flight, imus=tuple(_imu(name, samples, flight) for name, samples in imus.items()))


def _imu(name: str, samples: Sequence[Samples], flight: Flight) -> FlightImu:
    edges = edges_of(flight.blocks)
    gyros = gyros_between(samples, edges, flight.angle_stamps_s)
    rough, held_s = (np.column_stack([of(each, edges) for each in samples]) for of in (rough_between, held_between))
    mounting = mounting_of(gyros, flight.blocks.gyros)
    taken = mounting.taken
    return FlightImu(
        name=name, gyros=mounting.turned(gyros), rough=rough[:, taken], held_s=held_s[:, taken], mounting=mounting
    )
