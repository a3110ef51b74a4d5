"""The monitor of surfaces at work: blocks as samples come in, alarms of their tests, and which surface is named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.chunk import ChunkResult, ChunkStream, taken
from gtmbench.detectors.protocol import Monitor
from gtmbench.detectors.surfaces.answer import Answer, Deviations
from gtmbench.detectors.surfaces.blocks import blocks_of, rows_of
from gtmbench.detectors.surfaces.deviation import LABELS, WINDOWS_S, Comparing
from gtmbench.detectors.surfaces.flow_sensors import margins, ratios, throttle_ratios
from gtmbench.detectors.surfaces.identification import SETTLES_S
from gtmbench.detectors.surfaces.naming import KIND_TESTS, Seen, judged, kind_of
from gtmbench.detectors.surfaces.throttle_sensors import ThrottleHistory
from gtmbench.detectors.surfaces.thrust import THROTTLE
from gtmbench.detectors.surfaces.usual import Normal
from gtmbench.values.channels import COMMANDS, GYROS
from gtmbench.values.clock import ChunkClock
from gtmbench.values.record import BoolArray, FloatArray, Record

_LOOKS_S = (1.0, 4.0, 15.0, 30.0)  # after an alarm
_LAST_LOOK_S = 60.0  # of a throttle that no airspeed has told from nx by then
_KIND_S = 14.0  # after an alarm: by then a window of 16 s holds hardly anything from before
_AT_ONCE_S = 5.0  # after an alarm: kinematics that are broken later are a consequence
_SAME_S = 120.0  # who alarms again so soon tells of the same fault: what lasts enters the minute before


class SurfaceWatching(Protocol):
    """What a stream needs of its monitor. `thresholds`, by series."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def channels(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def suspects(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def answer(self) -> Answer: ...  # noqa: D102
    @property
    def normal(self) -> Normal: ...  # noqa: D102
    @property
    def thresholds(self) -> Mapping[str, Mapping[str, float]]: ...  # noqa: D102
    @property
    def kinematics(self) -> Monitor: ...  # noqa: D102
    @property
    def sample_period_s(self) -> float: ...  # noqa: D102


class _Tested(NamedTuple):
    """The tests of blocks, or of one."""

    ratios: FloatArray  # shape (blocks, tests, series): over their thresholds
    margins: FloatArray  # shape (blocks, tests, surfaces): as `flow_sensors.margins` makes them
    # fit, spread: what has changed, and its covariance
    fit: FloatArray
    spread: FloatArray
    error: FloatArray  # shape (blocks, tests, any): what one deviation amounts to
    pushed: FloatArray  # shape (blocks, any): as `ThrottleHistory` takes them

    def at(self, block: int) -> _Tested:
        """Return those of a block."""
        return _Tested(*(each[block] for each in self))

    @property
    def best_margins(self) -> FloatArray:
        """Each surface's greatest margin in the tests that are above their thresholds; of one block."""
        with np.errstate(invalid="ignore"):
            above = self.ratios[:, : self.margins.shape[1]] > 1.0
        return np.asarray(np.max(np.where(above, self.margins, -np.inf), axis=0))

    def kind(self, surface: int) -> str | None:
        """Return the kind of a surface's fault, as far as it shows; of one block."""
        offset, answer = KIND_TESTS
        return kind_of(
            self.ratios[[offset, answer], surface],
            self.fit[answer, surface],
            self.spread[answer, surface],
            float(self.error[answer, surface]),
        )


@dataclass(kw_only=True)
class _Open:
    """An alarm that is still looked at."""

    number: int
    block: int  # where it was raised
    looks: list[int]  # blocks in which it is looked at again
    peaks: FloatArray  # of each series, since its onset
    margins: FloatArray  # of each surface, the greatest


class SurfaceStream(ChunkStream):
    """A monitor of surfaces at work on samples as they come in."""

    def __init__(self, monitor: SurfaceWatching) -> None:
        super().__init__()
        self._monitor, self._period_s = monitor, monitor.sample_period_s
        self._rows = rows_of(self._period_s)
        self._block_s = self._rows * self._period_s
        self._settled = round(SETTLES_S / self._block_s)
        self._answering = monitor.answer.start(self._period_s)
        self._kinematics = monitor.kinematics.stream()
        self._limits = limits_of(monitor)
        self._rho = ratios(monitor.answer)
        self._clock: ChunkClock | None = None
        self._waiting = np.zeros((0, len(_read(monitor))))  # samples of a block that isn't whole
        self._comparing = Comparing(monitor.normal.white, len(monitor.suspects), self._block_s)
        self._throttle = _history(monitor.answer, self._block_s)
        self._count = 0  # of whole blocks
        surfaces = len(monitor.suspects)
        self._last = np.full(surfaces, np.nan)  # what holds until the next block is whole
        self._is_armed = np.zeros(surfaces, dtype=bool)
        self._held = (
            np.full((1, surfaces), np.nan),
            np.zeros((1, surfaces), dtype=bool),
        )  # scores and armed, as told last
        self._above_block = -np.inf  # where a score was last above its threshold
        self._open: _Open | None = None

    @property
    def armed(self) -> Mapping[str, bool]:
        """Whether each surface's score has been known at or below its threshold."""
        return MappingProxyType(dict(zip(self._monitor.suspects, self._is_armed.tolist(), strict=True)))

    def taken(self, chunk: Record) -> ChunkResult:
        """Return everything that is said of a chunk; parameters and errors are those of `push`."""
        monitor = self._monitor
        clock, new = taken(self._clock, chunk, monitor.channels, self._period_s, monitor.name)
        if len(new):
            self._kinematics.push(chunk.select(self._monitor.kinematics.channels))
        before = dict(self._alarms)
        joined = np.concatenate([self._waiting, new.matrix(_read(self._monitor))])
        whole = len(joined) // self._rows * self._rows
        self._waiting = joined[whole:]
        found = self._tested(joined[:whole])
        first = self._count
        self._count += len(found.ratios)
        surfaces = len(self._monitor.suspects)
        of_surfaces = found.ratios[:, :, :surfaces]
        scores = np.fmax.reduce(of_surfaces, axis=1) if len(of_surfaces) else np.zeros((0, surfaces))
        armed = self._armed_by(scores)
        ends = range((first + 1) * self._rows - 1, (self._count + 1) * self._rows - 1)
        times_s = np.round(clock.times_s(ends), 9)[:: self._rows]
        self._clock = clock
        for i in range(len(scores)):
            self._block(first + i, float(times_s[i]), found.at(i), armed[i])
        rows = range(clock.count - len(new), clock.count)
        told = self._news(before)
        return self._chunk_result(scores, armed, first, rows, np.round(clock.times_s(rows), 9), told)

    def _tested(self, values: FloatArray) -> _Tested:
        """Return the tests of new blocks."""
        surfaces, tests = len(self._monitor.suspects), len(LABELS)
        if not len(values):
            nothing = np.zeros((0, tests, surfaces))
            return _Tested(
                np.zeros((0, tests, self._limits.shape[1])), nothing, nothing, nothing, nothing, np.zeros((0, 2))
            )
        there = np.asarray(np.isfinite(values).all(axis=1))
        made = self._answering.push(values)
        new = blocks_of(made, there, self._period_s)
        unsettled = self._count + np.arange(len(new.there)) < self._settled
        found = self._comparing.push(new._replace(there=new.there & ~unsettled))
        normal = self._monitor.normal
        return _Tested(
            normal.nats(found, surfaces) / self._limits,
            margins(found, normal, self._rho),
            found.fit,
            found.spread,
            found.error,
            self._pushed(made),
        )

    def _pushed(self, made: Deviations) -> FloatArray:
        """Return of every block by how much wind grew, by how much the throttle seems off, and what is left."""
        if self._throttle is None:
            return np.zeros((len(made.off) // self._rows, 0))
        place = self._monitor.suspects.index(THROTTLE)
        wind = made.wind.reshape(-1, self._rows).sum(axis=1)
        rest = np.column_stack([made.off[:, place], made.left])
        return np.column_stack([wind, rest.reshape(-1, self._rows, rest.shape[1]).mean(axis=1)])

    def _armed_by(self, scores: FloatArray) -> BoolArray:
        """Return where each surface could alarm: it has been known at or below its threshold."""
        with np.errstate(invalid="ignore"):
            below = np.concatenate([self._is_armed[np.newaxis], np.asarray(scores <= 1.0)])
            came_down = np.logical_or.accumulate(below, axis=0)
        self._is_armed = came_down[-1]
        return np.asarray(came_down[1:] & np.isfinite(scores))

    def _block(self, block: int, time_s: float, tested: _Tested, armed: BoolArray) -> None:
        """Raise the alarms of a block, and judge those that are due."""
        if self._throttle is not None:
            self._throttle.push(tested.pushed.tolist())
        surfaces = len(self._monitor.suspects)
        series = np.fmax.reduce(tested.ratios, axis=0)
        scores = series[:surfaces]
        with np.errstate(invalid="ignore"):
            rises = np.flatnonzero(armed & (scores > 1.0) & ~(self._last > 1.0))
        self._last = np.where(np.isnan(scores), self._last, scores)
        best = tested.best_margins
        if self._open is not None:
            self._open.margins = np.fmax(self._open.margins, best)
            self._open.peaks = np.fmax(self._open.peaks, series)
        for surface in rises[np.argsort(-scores[rises], kind="stable")].tolist():
            test = int(np.nanargmax(tested.ratios[:, surface]))
            self._raise(block, time_s, surface, test, series, best)
        with np.errstate(invalid="ignore"):
            if np.any(armed & (scores > 1.0)):
                self._above_block = float(block)
        self._look(block, time_s, tested)

    def _raise(
        self, block: int, time_s: float, surface: int, test: int, series: FloatArray, margins: FloatArray
    ) -> None:
        number = len(self._alarms)
        is_same = number > 0 and block - self._above_block <= _SAME_S / self._block_s
        onset_s = max(time_s - WINDOWS_S[test], time_s - block * self._block_s)
        self._alarms[number] = Alarm(
            number=number,
            time_s=time_s,
            onset_s=round(onset_s, 9),
            source=self._monitor.suspects[surface],
            test=LABELS[test],
            fault=self._alarms[number - 1].fault if is_same else number,
        )
        if not is_same:
            looks = [block + round(look_s / self._block_s) for look_s in _LOOKS_S]
            self._open = _Open(number=number, block=block, looks=looks, peaks=series.copy(), margins=margins)
        self._above_block = float(block)

    def _look(self, block: int, time_s: float, tested: _Tested) -> None:
        """Judge the alarm that is open, if a look is due."""
        looking = self._open
        if looking is None or block < looking.looks[0]:
            return
        looking.looks.pop(0)
        alarm = self._alarms[looking.number]
        seen = Seen(
            surfaces=self._monitor.suspects,
            peaks=looking.peaks,
            sensors=self._sensors(alarm, time_s),
            margins=self._margins(looking, alarm),
            named=alarm.sensor,
            kind=tested.kind(int(np.nanargmax(np.nan_to_num(looking.peaks[: len(self._monitor.suspects)]))))
            if time_s - alarm.time_s >= _KIND_S
            else None,
        )
        judgement = judged(seen, time_s)
        if judgement.sensor is not None and time_s - alarm.time_s >= _KIND_S:
            looking.looks.clear()  # where it has thrown the aircraft about for long, nothing is linear any more
        elif not looking.looks and judgement.candidates == (THROTTLE,) and time_s - alarm.time_s < 0.9 * _LAST_LOOK_S:
            looking.looks.append(looking.block + round(_LAST_LOOK_S / self._block_s))
        again_s = None
        if looking.looks:
            again_s = round(time_s + (looking.looks[0] - block) * self._block_s, 9)
        self._alarms[looking.number] = replace(alarm, judgements=(*alarm.judgements, judgement), looks_again_s=again_s)
        if not looking.looks:
            self._open = None

    def _margins(self, looking: _Open, alarm: Alarm) -> FloatArray:
        """Return the margins over all sensors; of the throttle by what happened since its fault began."""
        margins = looking.margins.copy()
        if self._throttle is not None:
            onset = looking.block - round((alarm.time_s - alarm.onset_s) / self._block_s)
            margins[self._monitor.suspects.index(THROTTLE)] = self._throttle.margin(onset)
        return margins

    def _sensors(self, raised: Alarm, time_s: float) -> tuple[str, ...]:
        """Return the sensors that kinematics speak of by a time, as far as nothing healthy explains it.

        A sensor that fails shows there at once. Where the aircraft has been thrown about for long they break, too.
        """
        found: list[str] = []
        begin_s, end_s = raised.onset_s - _SAME_S, min(time_s, raised.time_s + _AT_ONCE_S)
        for alarm in self._kinematics.alarms:
            if not alarm.is_first or alarm.test == MISSING or not begin_s <= alarm.time_s <= end_s:
                continue
            said = [each for each in alarm.judgements if each.time_s <= time_s]
            if not said:
                found.append(alarm.source)
            elif not said[-1].doubt:
                found += said[-1].candidates
        return tuple(dict.fromkeys(found))

    def _chunk_result(
        self,
        scores: FloatArray,
        armed: BoolArray,
        first: int,
        rows: range,
        known_s: FloatArray,
        told: tuple[Alarm, ...],
    ) -> ChunkResult:
        """Return a chunk's scores, a row a sample: each holds the value of the last whole block."""
        surfaces = self._monitor.suspects
        held, could = (np.concatenate(both) for both in zip(self._held, (scores, armed), strict=True))
        at = (np.arange(rows.start, rows.stop) + 1) // self._rows - first  # 0: of an earlier chunk
        self._held = held[-1:], could[-1:]
        return ChunkResult(
            known_s,
            {name: held[at, i] for i, name in enumerate(surfaces)},
            {name: could[at, i] for i, name in enumerate(surfaces)},
            told,
        )


def _history(answer: Answer, block_s: float) -> ThrottleHistory | None:
    """Return what a throttle is told from sensors by; None where it isn't judged."""
    if THROTTLE not in answer.surfaces:
        return None
    per_step = float(answer.theta["nx"][answer.surfaces.index(THROTTLE)])
    return ThrottleHistory(block_s, per_step, throttle_ratios(answer))


def _read(monitor: SurfaceWatching) -> tuple[str, ...]:
    return (*GYROS, *monitor.answer.flow.channels, *COMMANDS)


def limits_of(monitor: SurfaceWatching) -> FloatArray:
    """Return the thresholds, shape (tests, series); infinite where there is none."""
    of = [monitor.thresholds[name] for name in monitor.answer.series]
    return np.array([[each.get(label, np.inf) for each in of] for label in LABELS])
