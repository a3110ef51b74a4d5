"""Faults at work while an aircraft flies: on what its sensors read, and on what its surfaces are driven to.

A surface's fault acts on the command on its way to the servo, and the model's own servo then follows what is left of
it. So a surface that jams stays where its last command put it, and a loss of effectiveness or a bent linkage, which act
behind a servo, are the same before it, for a servo is a linear lag. A surface doesn't pass its stops, whatever drives
it, and stays where it is if nothing does (NaN).
"""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Mapping, Sequence
from math import inf

import numpy as np

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.stepping import FLOWN
from gtmbench.checks import meant, shown
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, check_onset
from gtmbench.values.channels import COMMANDS, SENSORS
from gtmbench.values.record import FloatArray, Span

SEEN = 2  # healthy samples that a fault's stream sees before the onset: it has to know the last of them


def is_of_surface(fault: Fault) -> bool:
    """Tell whether a fault breaks a surface or the throttle, and not a sensor.

    >>> from gtmbench.faults.kinds.replacing import Jam
    >>> [is_of_surface(Jam(channel=channel, onset_s=0.0)) for channel in ("elevator", "q")]
    [True, False]
    """
    return fault.channel in COMMANDS


def check_faults(faults: Sequence[Fault], end_s: float, beside: Sequence[str] = ()) -> None:
    """Refuse what is no fault, one that begins outside of a flight, and one of what no aircraft has."""
    for fault in faults:
        check_onset(fault, 0.0, end_s)
        known = (*SENSORS, *COMMANDS, *beside)
        for channel in fault.reads:
            if channel not in known:
                there = f"there are {', '.join(known)}{meant(channel, known)}"
                raise InputError(f"{fault.kind}: no channel {shown(channel)} can break; {there}")
        if is_of_surface(fault):
            _check_surface(fault)
        elif commanded := [channel for channel in fault.reads if channel in COMMANDS]:
            raise InputError(
                f"{fault.kind} of {fault.channel}: a sensor doesn't read a command, and '{commanded[0]}' is one; name "
                "another sensor"
            )


def _check_surface(fault: Fault) -> None:
    if sensors := [channel for channel in fault.changes if channel not in COMMANDS]:
        raise InputError(
            f"{fault.kind} of {fault.channel}: it would change '{sensors[0]}' as well, which is a sensor; name another "
            f"surface: {', '.join(COMMANDS)}"
        )


class Breaking:
    """A fault at work, sample by sample: the columns it reads and changes, and its stream, which rests when over."""

    def __init__(self, fault: Fault, channels: Sequence[str]) -> None:
        self.begins_s = fault.onset_s - (SEEN + 0.5) * SAMPLE_PERIOD_S
        self.ends_s = inf if fault.duration_s is None else fault.onset_s + fault.duration_s + SAMPLE_PERIOD_S
        self._parts = [
            (channels.index(part.channel), [channels.index(name) for name in part.reads], part.stream(SAMPLE_PERIOD_S))
            for part in fault.parts
        ]

    def distort(self, time_s: float, sample: list[float]) -> None:
        """Break a sample in place; the parts of a fault act at the same time."""
        broken = [(column, step(time_s, [sample[i] for i in reads])) for column, reads, step in self._parts]
        for column, value in broken:
            sample[column] = value


class Breakers:
    """Faults at work one after the other. One that begins in flight sees what came last, as if it had been there."""

    def __init__(self, faults: Sequence[Fault], acts_on: Sequence[str], beside: Sequence[str] = ()) -> None:
        self._acts_on, self._channels = acts_on, (*acts_on, *beside)
        own = [(index, fault) for index, fault in enumerate(faults) if fault.channel in acts_on]
        self._at_work = {index: Breaking(fault, self._channels) for index, fault in own}
        self._last: deque[tuple[float, list[float]]] = deque(maxlen=SEEN)

    def distort(self, time_s: float, sample: list[float]) -> None:
        """Break a sample in place."""
        for breaking in self._at_work.values():
            if breaking.begins_s <= time_s < breaking.ends_s:
                breaking.distort(time_s, sample)
        self._last.append((time_s, sample))

    def begin(self, index: int, fault: Fault) -> None:
        """Let a fault act from now on, under an index of its own."""
        if fault.channel not in self._acts_on:
            return
        breaking = Breaking(fault, self._channels)
        for time_s, sample in self._last:
            if breaking.begins_s <= time_s:
                breaking.distort(time_s, list(sample))
        self._at_work[index] = breaking

    def end(self, index: int) -> None:
        """Take a fault away, if it is at work here."""
        self._at_work.pop(index, None)


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
