"""A flight with its further IMUs, by their samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.engine.blocks import Blocks
from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.imu import FlightImu, mounting_of
from gtmbench.engine.samples import Samples, edges_of, held_between, means_between, rough_between


def with_imus(flight: Flight, imus: Mapping[str, Sequence[Samples]]) -> Flight:
    """Return a flight with further IMUs. `imus`, by name: what p, q and r of each read, in deg/s."""
    return replace(flight, imus=tuple(_imu(name, samples, flight.blocks) for name, samples in imus.items()))


def _imu(name: str, samples: Sequence[Samples], blocks: Blocks) -> FlightImu:
    edges = edges_of(blocks)
    gyros, rough, held_s = (
        np.column_stack([of(each, edges) for each in samples]) for of in (means_between, rough_between, held_between)
    )
    mounting = mounting_of(gyros, blocks.gyros)
    taken = mounting.taken
    return FlightImu(
        name=name, gyros=mounting.turned(gyros), rough=rough[:, taken], held_s=held_s[:, taken], mounting=mounting
    )
