"""A log's gyros, attitude and accelerometers as the engine reads them, each on its own stamps."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.samples import FORCES, Samples, flight_of
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_samples
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.mapping import NONE
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.intake.read import ReadLog
from gtmbench.method.driven_attitude import Origin
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Record

_SIX, _VANES = (*GYROS, *ATTITUDE), ("alpha", "beta")


def flight_of_log(
    read: ReadLog, mapping: Sequence[str], moving: FlightLog, readings: Mapping[str, Samples], origin: Origin
) -> Flight:
    """Return the flight of a log: sample by sample; as it was opened where a channel has no samples of its own.

    `readings`: of its other sensors: the accelerometers are taken from them.
    """
    own = None
    if f"psi={NONE}" not in mapping:
        with contextlib.suppress(InputError):
            own = {name: Samples(each.time_s, each.values) for name, each in log_samples(read, _SIX, mapping).items()}
    has_forces = {*FORCES} <= readings.keys()
    forces = {name: readings[name] for name in FORCES} if has_forces else _felt(moving.segments)
    found = (own or _of_records(moving.segments, _SIX)) | forces
    return flight_of(found, is_driven=origin.is_driven, is_assumed=origin.is_assumed)


def flight_of_records(records: Sequence[Record], *, is_driven: bool, is_assumed: bool) -> Flight:
    """Return the flight of records with gyros and attitude, such as those whose installation was undone."""
    return flight_of(_of_records(records, _SIX) | _felt(records), is_driven=is_driven, is_assumed=is_assumed)


def _of_records(records: Sequence[Record], names: Sequence[str]) -> dict[str, Samples]:
    time_s = np.concatenate([record.time_s for record in records])
    return {name: Samples(time_s, np.concatenate([each[name] for each in records])) for name in names}


def _felt(records: Sequence[Record]) -> dict[str, Samples]:
    """Return what the accelerometers of records read; nothing where one hasn't them all."""
    return _of_records(records, FORCES) if all({*FORCES} <= set(each.channels) for each in records) else {}


def others_of_log(
    read: ReadLog, mapping: Sequence[str], sensors: Sequence[SensorReadings], *, commands: bool = False
) -> tuple[dict[str, Samples], list[OutOfRange]]:
    """Return what the other sensors of a log read, channel by channel; of several of a kind, the first; and vanes.

    Where surfaces are asked, commands and the gyros that answer them are among it. What no sensor reads stands apart.
    """
    found: dict[str, Samples] = {}
    beyond = [out for each in sensors for out in each.out_of_range]
    for name in _VANES:
        with contextlib.suppress(InputError):
            own = log_samples(read, [name], mapping)[name]
            found[name] = Samples(own.time_s, own.values)
            beyond += [] if own.out_of_range is None else [own.out_of_range]
    if commands:
        with contextlib.suppress(InputError):
            answered = log_samples(read, (*GYROS, *COMMANDS), mapping)
            found |= {name: Samples(each.time_s, each.values) for name, each in answered.items()}
    for each in (each for each in sensors if each.is_read):
        for name, values in zip(each.channels, each.values.T, strict=True):
            found.setdefault(name, Samples(each.time_s, values))
    return found, beyond
