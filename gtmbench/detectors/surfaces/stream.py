"""The monitor of surfaces at work: blocks as samples come in, alarms of their tests, and which surface is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.buffered_stream import ChunkResult, ChunkStream, taken
from gtmbench.detectors.protocol import Monitor
from gtmbench.detectors.surfaces.answer import Answer, rows_of
from gtmbench.detectors.surfaces.commanded import Commanded
from gtmbench.detectors.surfaces.deviation import BASE_S, LABELS, LEAST_BASE_S, WINDOWS_S, Comparing, Normal
from gtmbench.detectors.surfaces.equations import THROTTLE
from gtmbench.detectors.surfaces.evidence import AnswerChange, change_of, judged, suspects_of
from gtmbench.detectors.surfaces.identification import SETTLES_S, causes_of
from gtmbench.values.attitude_estimators import held
from gtmbench.values.channels import COMMANDS, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record

_LOOKS_S = (1.0, 4.0, 15.0, 30.0)  # after an alarm
_LAST_LOOK_S = 60.0  # of a throttle that no airspeed has told from nx by then
_KIND_S = 14.0  # after an alarm: by then the answer shows
_AT_ONCE_S = 5.0  # after an alarm: kinematics that are broken later are a consequence
_SAME_S = 120.0  # who alarms again so soon tells of the same fault: what lasts enters the minute before
_GAP_S = 4.0  # before the window that alarmed: an engine is slow
_ONSETS_S = np.concatenate(  # before an alarm: that are tried, the latest first; a step of a shock has to be met
    [np.arange(0.3, 2.6, 0.1), np.arange(2.6, 5.0, 0.2), np.arange(5.0, 10.0, 0.5), np.arange(10.0, 50.0, 1.0)]
)
# all that a last look takes, and a second more
_LOOKED_BACK_S = BASE_S + SETTLES_S + max(WINDOWS_S) + _GAP_S + _LAST_LOOK_S + 1.0
_HIDES_DEG_S = dict.fromkeys(GYROS, 1.0)  # of a gyro: more is seen by kinematics, which hold where a surface is named
_STANDS_S = 3.0  # a vane that reads one value for so long is stuck


@dataclass(kw_only=True)
class _Open:
    """An alarm that is still looked at."""

    number: int
    block: int  # where it was raised
    looks: list[int]  # blocks in which it is looked at again


class SurfaceStream(ChunkStream):
    """A monitor of surfaces at work on samples as they come in.

    `kinematics`: the monitor of the sensors. `limits`, shape (tests, surfaces): thresholds in nats.
    """

    def __init__(
        self,
        monitor: Monitor,
        answer: Answer,
        normal: Normal,
        limits: FloatArray,
        kinematics: Monitor,
        sample_period_s: float,
    ) -> None:
        super().__init__(monitor.suspects)
        self._monitor, self._answer, self._normal, self._limits = monitor, answer, normal, limits
        self._period_s, self._read = sample_period_s, (*GYROS, *answer.frame.flow.channels, *COMMANDS)
        self._rows = rows_of(self._period_s)
        self._block_s = self._rows * self._period_s
        self._settled = round(SETTLES_S / self._block_s)
        self._answering = answer.start(self._period_s)
        self._kinematics, self._of_kinematics = kinematics.stream(), kinematics.channels
        self._kept, self._first = np.zeros((0, len(self._read))), 0  # samples, and how many there were before
        self._comparing = Comparing(normal.white, self._block_s)
        self._count = 0  # of whole blocks
        surfaces = len(monitor.suspects)
        # scores and armed, as told last: what holds until the next block is whole
        self._held = np.full((1, surfaces), np.nan), np.zeros((1, surfaces), dtype=bool)
        self._above_block = -np.inf  # where a score was last above its threshold
        self._open: _Open | None = None

    def taken(self, chunk: Record) -> ChunkResult:
        """Return everything that is said of a chunk; parameters and errors are those of `push`."""
        monitor = self._monitor
        clock, new = taken(self._clock, chunk, monitor.channels, self._period_s, monitor.name)
        if len(new):
            self._kinematics.push(chunk.select(self._of_kinematics))
        before = dict(self._alarms)
        self._kept = np.concatenate([self._kept, new.matrix(self._read)])
        self._clock = clock
        first = self._count
        ratios = self._tested()
        self._count += len(ratios)
        scores = np.fmax.reduce(ratios, axis=1)
        pushed = [arming.push(values) for arming, values in zip(self._arming.values(), scores.T, strict=True)]
        armed = np.column_stack([could for could, _ in pushed])
        for i in range(len(ratios)):
            rises = [surface for surface, (_, rows) in enumerate(pushed) if i in rows]
            self._block(first + i, ratios[i], armed[i], rises)
        self._forget()
        # a row a sample: each holds the value of the last whole block
        rows = range(clock.count - len(new), clock.count)
        held, could = (np.concatenate(both) for both in zip(self._held, (scores, armed), strict=True))
        at = (np.arange(rows.start, rows.stop) + 1) // self._rows - first  # 0: of an earlier chunk
        self._held = held[-1:], could[-1:]
        return ChunkResult(
            np.round(clock.times_s(rows), 9),
            {name: held[at, i] for i, name in enumerate(monitor.suspects)},
            {name: could[at, i] for i, name in enumerate(monitor.suspects)},
            self._news(before),
        )

    def _tested(self) -> FloatArray:
        """Return the tests of new blocks over their thresholds, shape (blocks, tests, surfaces)."""
        values = self._kept[self._count * self._rows - self._first :]
        if len(values) < self._rows:
            return np.zeros((0, *self._limits.shape))
        new = self._answering.push(values)
        unsettled = self._count + np.arange(len(new.there)) < self._settled
        found = self._comparing.push(new._replace(there=new.there & ~unsettled))
        return np.asarray(self._normal.nats(found) / self._limits)

    def _forget(self) -> None:
        """Forget samples that no look needs any more."""
        past = max(self._count * self._rows - self._first - round(_LOOKED_BACK_S / self._period_s), 0)
        self._kept, self._first = self._kept[past:], self._first + past

    def _time_s(self, block: int) -> float:
        """Return when a block was whole."""
        assert self._clock is not None
        row = (block + 1) * self._rows - 1
        return float(np.round(self._clock.times_s(range(row, row + 1)), 9)[0])

    def _block(self, block: int, ratios: FloatArray, armed: BoolArray, rises: Sequence[int]) -> None:
        """Raise the alarms of a block, and judge those that are due."""
        scores = np.fmax.reduce(ratios, axis=0)
        for surface in sorted(rises, key=lambda surface: -scores[surface]):
            self._raise(block, surface, int(np.nanargmax(ratios[:, surface])))
        with np.errstate(invalid="ignore"):
            if np.any(armed & (scores > 1.0)):
                self._above_block = float(block)
        if self._open is not None and block >= self._open.looks[0]:
            self._look(self._open, block)

    def _raise(self, block: int, surface: int, test: int) -> None:
        number, time_s = len(self._alarms), self._time_s(block)
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
            self._open = _Open(number=number, block=block, looks=looks)
        self._above_block = float(block)

    def _look(self, looking: _Open, block: int) -> None:
        """Judge the alarm that is open."""
        looking.looks.pop(0)
        alarm, time_s = self._alarms[looking.number], self._time_s(block)
        commanded, since_s = self._commanded(block), time_s - alarm.time_s
        judgement = judged(
            self._change(alarm, commanded),
            time_s,
            source=alarm.source,
            sensor=self._sensor(alarm, commanded, time_s),
            named=alarm.sensor,
        )
        if since_s < _KIND_S:
            judgement = replace(judgement, kind=None)
        elif judgement.sensor is not None:
            looking.looks.clear()  # where it has thrown the aircraft about for long, nothing is linear any more
        if (
            not looking.looks
            and judgement.doubt
            and judgement.candidates == (THROTTLE,)
            and since_s < _LAST_LOOK_S - 1.0
        ):
            looking.looks.append(looking.block + round(_LAST_LOOK_S / self._block_s))
        again_s = None
        if looking.looks:
            again_s = round(time_s + (looking.looks[0] - block) * self._block_s, 9)
        self._alarms[looking.number] = replace(alarm, judgements=(*alarm.judgements, judgement), looks_again_s=again_s)
        if not looking.looks:
            self._open = None

    def _commanded(self, block: int) -> Commanded:
        """Return what was commanded, as far back as is kept, until a block is whole."""
        values = self._kept[: (block + 1) * self._rows - self._first]
        return Commanded(
            start_s=self._time_s(block) - (len(values) - 1) * self._period_s,
            period_s=self._period_s,
            channels=self._read,
            values=held(values),
            frame=self._answer.frame,
        )

    def _change(self, alarm: Alarm, commanded: Commanded) -> AnswerChange:
        """Return what an alarm tells, and who explains it."""
        until_s = max(alarm.onset_s - _GAP_S, commanded.start_s + SETTLES_S + LEAST_BASE_S)
        looked_at = commanded.since(until_s - BASE_S - SETTLES_S)
        suspects = [*suspects_of(looked_at, until_s, _HIDES_DEG_S)]
        onsets_s = [each for each in alarm.time_s - _ONSETS_S if each >= until_s] or [until_s]
        answer = self._answer
        known = {name: answer.theta[name][causes_of(answer.frame, name)] for name in answer.frame.equations}
        return change_of(looked_at, suspects, until_s, onsets_s, known)

    def _sensor(self, alarm: Alarm, commanded: Commanded, time_s: float) -> str:
        """Return why a sensor must have failed by the end of what was commanded, or may look like a surface."""
        sensors = self._sensors(alarm, time_s)
        if sensors:
            return f"a sensor, for kinematics don't hold ({' or '.join(sensors)})"
        if not commanded.frame.flow.vanes:
            return f"surface, wind, or a sensor of the flow: {alarm.source}"
        lately = commanded.since(commanded.end_s - _STANDS_S)
        still = [name for name in ("alpha", "beta") if np.ptp(lately.column(name)) == 0.0]
        return f"a vane that stands still ({' or '.join(still)})" if still else ""

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
