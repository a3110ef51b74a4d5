"""When two kinds of faults read the same: by what a sensor read before, and since the fault."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gtmbench.values.record import FloatArray

_OF_NOISE = 3.0  # deviations


class Same(NamedTuple):
    """When a fault reads what another kind would: by the readings before it, and those since; and why."""

    reads: Callable[[FloatArray, FloatArray], bool]
    why: str


def is_always(*_: FloatArray) -> bool:
    """Whatever it reads."""
    return True


def is_beyond(before: FloatArray, since: FloatArray) -> bool:
    """Whether it reads more than it ever read before."""
    return len(before) > 0 and bool(abs(since[-1]) > np.abs(before).max())


def is_last(before: FloatArray, since: FloatArray) -> bool:
    """Whether it reads what it read last, within the noise: what changes from one reading to the next."""
    if len(before) < 2:
        return False
    noise = float(np.sqrt(0.5 * np.mean(np.square(np.diff(before)))))
    return bool(abs(since[-1] - before[-1]) <= _OF_NOISE * noise)


def is_constant(_: FloatArray, since: FloatArray) -> bool:
    """Whether it has read one value ever since."""
    return bool(np.ptp(since) == 0.0)


def is_one_sided(_: FloatArray, since: FloatArray) -> bool:
    """Whether its readings have never reached zero since."""
    return bool(np.all(since > 0.0) or np.all(since < 0.0))
