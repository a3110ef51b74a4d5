"""A chunk of samples at a stream whose scores know each sample: how it is taken, and what is said of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.gate import taken_inside
from gtmbench.detectors.protocol import Monitor, Score, Watch
from gtmbench.method.windowed_alarms import came_down, rising
from gtmbench.values.clock import ChunkClock, advanced
from gtmbench.values.record import BoolArray, FloatArray, Record


class ChunkResult(NamedTuple):
    """Of a chunk: scores and where they are armed, a row a sample, and the alarms that are new or told more of."""

    known_s: FloatArray
    scores: Mapping[str, FloatArray]
    armed: Mapping[str, BoolArray]
    told: tuple[Alarm, ...]

    def watch(self, monitor: Monitor, record: Record, channels: Callable[[str], Sequence[str]]) -> Watch:
        """Return the watch of a record that was the one chunk; `channels` gives whom a score tells of, by its name."""
        scores = {
            name: Score(
                name=name,
                values=values,
                known_s=self.known_s,
                channels=tuple(channels(name)),
                armed=self.armed[name],
            )
            for name, values in self.scores.items()
        }
        return Watch(monitor=monitor, record=record, scores=MappingProxyType(scores), alarms=self.told)


class ScoreArming:
    """Whether a score could alarm, and where it rises above 1, as its values come in; missing ones are passed over."""

    def __init__(self) -> None:
        self.is_armed = False  # whether it has been known at or below 1
        self._last: FloatArray = np.zeros(0)  # the last value that exists, if any

    def push(self, values: FloatArray) -> tuple[BoolArray, list[int]]:
        """Return where the next values could alarm, and which of them rise."""
        armed = ~np.isnan(values) & (self.is_armed | came_down(values, 1.0))
        self.is_armed |= bool(armed.any())
        joined = np.concatenate([self._last, values])
        rises = rising(joined, 1.0) - len(self._last)
        self._last = joined[~np.isnan(joined)][-1:]
        return armed, rises.tolist()


class ChunkStream(ABC):
    """A stream that says of each chunk what its samples' scores and alarms are."""

    def __init__(self) -> None:
        self._alarms: dict[int, Alarm] = {}

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far, as it is known by now."""
        return tuple(self._alarms.values())

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise or tell more of.

        InputError if the chunk doesn't continue the one before, lacks a channel or has another sample period.
        """
        return self.taken(chunk).told

    @abstractmethod
    def taken(self, chunk: Record) -> ChunkResult:
        """Return everything that is said of a chunk; parameters and errors are those of `push`."""

    def _news(self, before: Mapping[int, Alarm]) -> tuple[Alarm, ...]:
        """Return the alarms that are new, or of which more is known than before."""
        return tuple(alarm for number, alarm in self._alarms.items() if alarm is not before.get(number))


def taken(
    clock: ChunkClock | None, chunk: Record, channels: Sequence[str], sample_period_s: float, name: str
) -> tuple[ChunkClock, Record]:
    """Return where a stream stands after a chunk, and the channels of it that a monitor of some name reads.

    InputError if the chunk doesn't continue the one before, lacks a channel or has another sample period.
    """
    new = taken_inside(chunk).select(channels)
    new.check_period(sample_period_s, f"'{name}' was calibrated at")
    here = ChunkClock(
        start_s=new.start_s, sample_period_s=new.sample_period_s, source=", ".join(new.channels), count=len(new)
    )
    return advanced(clock, here), new
