"""What surfaces and engines do of what is commanded: the same, unless a fault keeps them from it.

A fault acts on the command on its way to the servo, and the model's own servo then follows what is left of it. So a
surface that jams stays where its last command put it, and a loss of effectiveness or a bent linkage, which act behind a
servo, are the same before it, for a servo is a linear lag. A surface doesn't pass its stops, whatever drives it, and
stays where it is if nothing does (NaN).
"""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from gtmbench.bench.airborne import FLOWN
from gtmbench.bench.breaking import SEEN, Breakers
from gtmbench.faults.fault import Fault
from gtmbench.values.channels import COMMANDS
from gtmbench.values.record import FloatArray, Span

_MOTION = [channel.name for channel in FLOWN]
_SCALES = [channel.scale for channel in FLOWN]
_Sample = tuple[float, Sequence[float], Sequence[float]]


class Surfaces:
    """The surfaces and engines of one flight."""

    def __init__(self, faults: Sequence[Fault], limits: Mapping[str, Span]) -> None:
        self._breakers = Breakers(faults, COMMANDS, beside=_MOTION)
        self._stops = [limits[name] for name in COMMANDS]
        self._seen: deque[_Sample] = deque(maxlen=SEEN)  # until something breaks
        self._row = 0
        self._broken_row = 0 if any(fault.channel in COMMANDS for fault in faults) else None
        self._actual = array("d")  # from that row on

    def driven(self, time_s: float, commanded: Sequence[float], now: Sequence[float]) -> Sequence[float]:
        """Return where the servos are driven at a sample."""
        self._row += 1
        if self._broken_row is None:
            self._seen.append((time_s, commanded, now))
            return commanded
        sample = self._distorted(time_s, commanded, now)
        told = zip(sample[: len(COMMANDS)], self._actual[-len(COMMANDS) :] or commanded, self._stops, strict=True)
        actual = [
            (low if value < low else high if value > high else value) if value == value else last
            for value, last, (low, high) in told
        ]
        self._actual.extend(actual)
        return actual

    def begin(self, index: int, fault: Fault) -> None:
        """Let a fault act from now on, under an index of its own."""
        if fault.channel not in COMMANDS:
            return
        if self._broken_row is None:
            self._broken_row = self._row
            for seen in self._seen:
                self._distorted(*seen)
        self._breakers.begin(index, fault)

    def end(self, index: int) -> None:
        """Take a fault away."""
        self._breakers.end(index)

    def actual(self, commanded: FloatArray) -> FloatArray | None:
        """Return where the servos were driven, a row a sample of what was commanded; None if nothing ever broke."""
        if self._broken_row is None:
            return None
        actual, first = commanded.copy(), self._broken_row
        driven = np.array(self._actual).reshape(-1, len(COMMANDS))[: max(len(commanded) - first, 0)]
        actual[first : first + len(driven)] = driven
        if len(driven):
            actual[first + len(driven) :] = driven[-1]
        return actual

    def _distorted(self, time_s: float, commanded: Sequence[float], now: Sequence[float]) -> list[float]:
        sample = [*commanded, *(value * scale for value, scale in zip(now, _SCALES, strict=True))]
        self._breakers.distort(time_s, sample)
        return sample
