"""Streams: what `watch` says of a whole record, said as its samples come in.

For any monitor from a rolling buffer; and where scores know each sample, chunk by chunk.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.gate import taken_inside
from gtmbench.detectors.protocol import Monitor, Score, Watch
from gtmbench.method.residual import came_down, rising
from gtmbench.values.clock import ChunkClock, advanced
from gtmbench.values.record import BoolArray, FloatArray, Record

_SLACK = 1e-3  # of a sample: times of a part are rounded otherwise than those of the whole


class RollingBuffer:
    """The end of a record that comes in chunks: its last `memory_s`, and one sample more.

    `channels`: that are kept; all of them, where there are none. `memory_s`: may be infinite: then all is kept, and
    what a sample costs grows.
    """

    def __init__(self, channels: Sequence[str], memory_s: float) -> None:
        self._channels = tuple(channels)
        self._memory_s = memory_s
        self._clock: ChunkClock | None = None
        self._kept: Record | None = None

    def joined(self, chunk: Record) -> tuple[ChunkClock, Record]:
        """Return where the stream stands after a chunk, and what is kept with the chunk behind it; nothing is changed.

        InputError where the chunk doesn't continue the one before, or lacks a channel.
        """
        inside = taken_inside(chunk)
        new = inside.select(self._channels) if self._channels else inside
        source = ", ".join(new.channels)
        here = ChunkClock(start_s=new.start_s, sample_period_s=new.sample_period_s, source=source, count=len(new))
        clock = advanced(self._clock, here)
        if self._kept is None or not len(self._kept):
            return clock, new
        values = np.concatenate([self._kept.values, new.values])
        start_s = float(clock.times_s(range(clock.count - len(values), clock.count))[0])
        return clock, Record(values, channels=new.channels, sample_period_s=clock.sample_period_s, start_s=start_s)

    def keep(self, clock: ChunkClock, record: Record) -> None:
        """Keep what `joined` returned, as far as it will be needed."""
        most = len(record)
        if math.isfinite(self._memory_s):
            most = min(math.ceil(self._memory_s / clock.sample_period_s - 1e-6) + 1, most)
        first_s = record.time_s[len(record) - most] if most else record.start_s
        values = record.values[len(record) - most :]
        self._kept = Record(
            values, channels=record.channels, sample_period_s=clock.sample_period_s, start_s=float(first_s)
        )
        self._clock = clock

    @property
    def end_s(self) -> float:
        """When its last sample was; -inf before the first."""
        return self._kept.end_s if self._kept is not None and len(self._kept) else -math.inf


class BufferedStream:
    """A monitor's stream where it has none of its own: it watches a rolling buffer with every chunk.

    The buffer holds the last `memory_s` of the monitor. Where that is infinite, everything is kept, and a sample costs
    the more the longer the stream runs: state a memory, or push long chunks. A score of the monitor's has to come down
    within its memory to be armed.

    >>> from gtmbench.detectors.base import FunctionDetector
    >>> def beyond_one(record):
    ...     return record.time_s[record["p"] > 1.0]
    >>> stream = BufferedStream(FunctionDetector(beyond_one, memory_s=0.0).calibrate())
    >>> record = Record([0.0, 2.0, 0.0, 2.0], channels=["p"], sample_period_s=0.5)
    >>> chunks = record.between(0, 1), record.between(1.5, 1.5)
    >>> [[(alarm.number, alarm.time_s) for alarm in stream.push(chunk)] for chunk in chunks]
    [[(0, 0.5)], [(1, 1.5)]]
    """

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor
        self._buffer = RollingBuffer(monitor.channels, monitor.memory_s)
        self._alarms: dict[int, Alarm] = {}
        self._armed: dict[str, bool] = {}

    @property
    def armed(self) -> Mapping[str, bool]:
        """Whether each score has come down, and no judgement disarmed it; a monitor that shows none is armed."""
        return MappingProxyType(self._armed)

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far, as it is known by now."""
        return tuple(self._alarms.values())

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise or tell more of.

        InputError where the chunk doesn't continue the one before, or the monitor refuses it.
        """
        clock, record = self._buffer.joined(chunk)
        if not len(chunk):
            return ()
        watched = self._monitor.watch(record)
        alarms, told = self._numbered(watched.alarms, record)
        self._armed = {
            name: (self._armed.get(name, False) or bool(score.armed.any())) and score.disarmed_s is None
            for name, score in watched.scores.items()
        } or {self._monitor.name: True}
        self._alarms = alarms
        self._buffer.keep(clock, record)
        return told

    def _numbered(self, watched: Sequence[Alarm], record: Record) -> tuple[dict[int, Alarm], tuple[Alarm, ...]]:
        """Return all alarms, numbered as in the stream, and those among them that are new or of which more is known."""
        slack_s = _SLACK * record.sample_period_s
        numbers: dict[int, int] = {}  # in the buffer's watch -> in the stream
        alarms, told = dict(self._alarms), []
        for alarm in watched:
            old = self._known_alarm(alarm, slack_s)
            if old is None and not self._buffer.end_s + slack_s < alarm.time_s <= record.end_s + slack_s:
                continue  # still to come, or seen only because the buffer begins where it does
            number = numbers[alarm.number] = len(alarms) if old is None else old.number
            fault = numbers.get(alarm.fault, number if old is None else old.fault)
            now = replace(alarm, number=number, fault=fault)
            if old is None or _says(now) > _says(old):
                alarms[number] = now
                told.append(now)
        return alarms, tuple(told)

    def _known_alarm(self, alarm: Alarm, slack_s: float) -> Alarm | None:
        for old in reversed(self._alarms.values()):
            same = (old.source, old.test) == (alarm.source, alarm.test)
            if same and abs(old.time_s - alarm.time_s) <= slack_s:
                return old
        return None


def _says(alarm: Alarm) -> tuple[int, bool, bool, bool]:
    """Return what can only grow: judgements, the end, and that it counts to a fault before it."""
    return len(alarm.judgements), alarm.ended_s is not None, alarm.end_known_s is not None, not alarm.is_first


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

    def __init__(self, scores: Iterable[str]) -> None:
        self._alarms: dict[int, Alarm] = {}
        self._arming = {name: ScoreArming() for name in scores}
        self._clock: ChunkClock | None = None

    @property
    def armed(self) -> Mapping[str, bool]:
        """Whether each score has been known at or below its threshold."""
        return MappingProxyType({name: arming.is_armed for name, arming in self._arming.items()})

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
