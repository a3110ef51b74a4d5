"""Flights as the engine reads them, of records with and without accelerometers."""

import numpy as np

from gtmbench.engine.blocks import blocks_of
from gtmbench.engine.flight import Flight
from gtmbench.engine.samples import FORCES
from gtmbench.values.attitude_estimators import to_earth
from gtmbench.values.channels import ATTITUDE


def felt_at_rest(angles_deg):
    """Return nx, ny, nz of an aircraft that doesn't accelerate, in g, shape (rows, 3)."""
    down = to_earth(np.radians(angles_deg).T)[2].T  # the vertical in body axes
    return down * np.array([-1.0, -1.0, 1.0])


def forces_beside(record, count, noise=0.0, seed=1):
    """Return the means of each block's specific force, and the deviation of nz in it: of the record's own, if any."""
    if set(FORCES) <= set(record.channels):
        felt = record.matrix(FORCES)
    else:
        felt = felt_at_rest(record.matrix(ATTITUDE))
        felt = felt + noise * np.random.default_rng(seed).standard_normal(felt.shape)
    rows = max(1, round(0.2 / record.sample_period_s))
    parts = felt[: count * rows].reshape(count, rows, 3)
    return parts.mean(axis=1), parts[:, :, 2].std(axis=1)


def flight_from(record, *, is_driven=True, has_forces=True, noise=0.0, healthy=None):
    """Return the flight of one whole record; the forces are those of a healthy one, where that is given."""
    blocks = blocks_of([record])
    if not has_forces:
        return Flight(blocks=blocks, is_driven=is_driven, is_assumed=True, gyro_step_s=record.sample_period_s)
    forces, shaking = forces_beside(record if healthy is None else healthy, len(blocks), noise)
    return Flight(
        blocks=blocks,
        forces=forces,
        shaking=shaking,
        is_driven=is_driven,
        is_assumed=True,
        gyro_step_s=record.sample_period_s,
    )
