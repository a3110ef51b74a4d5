"""Gyros that are off, by every kind of fault whose class says how it shows in a whole log (`WholeLog`)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gtmbench.engine.explanation import Explanation, of_gyros, seconds
from gtmbench.engine.flight import Flight
from gtmbench.faults.registry import loaded_faults, whole_log_of
from gtmbench.faults.shape import WholeLog
from gtmbench.values.record import FloatArray


def kinds() -> dict[str, WholeLog]:
    """Return how each kind of a gyro's fault shows, by what the engine calls it."""
    known = ((kind, whole_log_of(kind)) for kind in loaded_faults())
    return {whole.name or kind: whole for kind, whole in known if whole is not None}


def explanations(flight: Flight) -> list[Explanation]:
    """Return them for each gyro, of size one in the kind's own unit."""
    return of_kinds(flight, kinds())


def of_kinds(flight: Flight, names: Iterable[str]) -> list[Explanation]:
    """Return those of some kinds."""
    return [each for name, whole in kinds().items() if name in names for each in _of_kind(flight, name, whole)]


def _of_kind(flight: Flight, name: str, whole: WholeLog) -> list[Explanation]:
    def wrong(flight: Flight, axis: int) -> FloatArray:
        return whole.wrong(flight.gyros[:, axis], flight.time_s)

    most = whole.high * float(np.max(flight.spread)) + 1.0 if whole.of_motion else whole.high
    return of_gyros(
        name,
        wrong,
        base=whole.grows_from,
        since=seconds if whole.grows_from else None,
        price=whole.price,
        low=whole.low,
        high=most,
        least=whole.least,
        shortest_s=whole.shortest_s,
        is_gain=whole.is_gain,
        mirror=whole.mirror,
    )
