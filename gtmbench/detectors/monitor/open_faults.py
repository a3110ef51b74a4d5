"""Which residuals can raise an alarm, and which faults are open: alarms that are still looked at, and count to which.

An open fault is a value: what becomes of it is another one. Whom it is beside the others stands on what has been told
of their alarms. A residual is armed by the rule of `method.alarms`, row by row; see `monitor.alarms`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.isolation.diagnosis import entered
from gtmbench.detectors.isolation.fits import FittedHypothesis
from gtmbench.detectors.isolation.own_noise import Habit
from gtmbench.detectors.isolation.referee import Referee
from gtmbench.detectors.monitor.scores import Crossing, IntArray, ScoreTrack
from gtmbench.values.record import FloatArray


@dataclass(kw_only=True)
class Arming:
    """Whether a residual can raise an alarm."""

    output: str
    # whose residual its alarms are put down to: its own, or, of an early one, that of the sensor it is about
    source: str
    track: ScoreTrack
    # whether it has been known at or below 1 since watching it began, or what was before is known to be healthy
    came_down: bool = False
    low: bool = False  # whether it was when last known, or since it was disarmed: a rise is news
    disarmed_row: int | None = None  # since when it is disarmed
    # from which row on an alarm was possible, or wasn't; kept where somebody will ask
    changes: list[tuple[int, bool]] | None = None

    @property
    def armed(self) -> bool:
        """Whether its next row could raise an alarm."""
        return self.came_down and self.disarmed_row is None

    def take(self, score: float, row: int) -> bool:
        """Take the score that is known with a row; return whether it is an alarm. A missing one is passed over."""
        if score <= 1.0:
            self.low = True
            if not self.came_down:
                self.came_down = True
                self._note(row)
        elif score > 1.0 and self.disarmed_row is None:
            rose, self.low = self.low, False
            return rose
        return False

    def news(self, scores: FloatArray) -> IntArray:
        """Return at which of the next scores one is above 1 that wasn't when last known, or the other way round.

        Those between change nothing, but for what a judgement makes of them.
        """
        if self.low and not (scores > 1.0).any():  # so it is nearly always
            return np.zeros(0, dtype=int)
        known = np.flatnonzero(~np.isnan(scores))
        high = scores[known] > 1.0
        return known[np.diff(high, prepend=not self.low)]

    def disarm(self, row: int, since: int) -> None:
        """Raise no alarm with a row and after; what disarms it came `since`."""
        if self.disarmed_row is None:
            self.disarmed_row = since
            self._note(row)

    def rearm(self, row: int) -> None:
        """Alarms are possible again with a row."""
        if self.disarmed_row is not None:
            self.disarmed_row = None
            self._note(row)

    def begin_anew(self, row: int) -> None:
        """Forget that it came down."""
        self.came_down = self.low = False
        self._note(row)

    def _note(self, row: int) -> None:
        if self.changes is not None:
            self.changes.append((row, self.armed))


HORIZONS_S = (0.75, 2.0, 5.0, 10.0, 20.0, 60.0)  # after the alarm: when the case is looked at anew
_LOOK_S = 20.0  # then, for a fault's end
_SURE_S = 0.1  # by which an onset may be estimated late
_APART_S = 3.0  # what shakes the aircraft shakes all of it within that


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenFault:
    """An alarm, and where its diagnosis stands."""

    alarm: Alarm
    crossing: Crossing
    row: int  # when it was raised
    looks: tuple[int, ...]  # when it is looked at, as far as is settled
    start: int  # from where on the suspect isn't believed
    shift: Mapping[str, float]  # biases
    habits: Mapping[str, Habit] = field(default_factory=dict)
    referees: Mapping[str, Referee] = field(default_factory=dict)
    monitor: CalibratedBank  # with the noise as it was known at the alarm
    is_diagnosed: bool
    is_judged: bool = False
    ruled_out: frozenset[str] = frozenset()
    held: FittedHypothesis | None = None  # the last that was decisive
    settling: Excursion | None = None  # just before
    turned: Excursion | None = None  # motion beyond what the monitor knows, from shortly before the onset on
    turned_row: int = 0  # up to which that is known
    is_decided: bool = False  # so that only its end is still looked for

    @property
    def number(self) -> int:
        """Its alarm's."""
        return self.alarm.number

    @property
    def due(self) -> int:
        """When it is looked at next."""
        return self.looks[0]

    @property
    def later_looks(self) -> tuple[int, ...]:
        """When it is looked at once the next look is over."""
        return self.looks[1:] or (self.due + rows_of(_LOOK_S, self.monitor),)

    @property
    def is_late(self) -> bool:
        """Whether its horizons are over, so that the next look is for its end alone."""
        return self.due > self.row + rows_of(HORIZONS_S[-1], self.monitor)

    @property
    def is_undecided(self) -> bool:
        """Whether the next look may change its verdict, not only its end."""
        return self.is_diagnosed and self.alarm.is_first and not (self.is_decided or self.is_late)

    @property
    def may_end(self) -> bool:
        """Whether its end may be found: it is known what it reads, or which sensor it is of."""
        return self.held is not None or (self.alarm.last is not None and bool(self.alarm.last.failed))

    @property
    def enters(self) -> set[str]:
        """The residuals that a fault of any of its candidates enters."""
        return entered(self.monitor.bank, self.alarm.candidates)

    @property
    def disarms(self) -> set[str]:
        """The residuals that can't tell of another fault."""
        return self.enters if self.is_judged and self.alarm.is_first else {self.crossing.output}

    def turned_before(self, onset_s: float = -math.inf) -> Excursion | None:
        """Return that motion, where it began before the onset, or a later one that is told, so that it is no effect."""
        is_before = self.turned is not None and self.turned.start_s < max(self.alarm.onset_s, onset_s) - _SURE_S
        return self.turned if is_before else None

    def began_with(self, crossing: Crossing) -> bool:
        """Tell whether another alarm began at about the same time."""
        return abs(self.crossing.onset_row - crossing.onset_row) <= rows_of(_APART_S, self.monitor)


def rows_of(span_s: float, monitor: CalibratedBank) -> int:
    """Return how many of a monitor's samples a span of time has."""
    return round(span_s / monitor.sample_period_s)


def earlier(fault: OpenFault, others: Iterable[OpenFault]) -> list[OpenFault]:
    """Return the faults that were told of before one."""
    return [each for each in others if each.alarm.is_first and each.number < fault.number]


def leader_of(fault: OpenFault, others: Iterable[OpenFault]) -> OpenFault | None:
    """Return the earlier fault that an alarm counts to: by its last judgement it enters the residual that rose.

    One that has been judged is taken back only by a fault that is decided.
    """
    able = (each for each in earlier(fault, others) if not fault.is_judged or each.alarm.sensor is not None)
    return next((each for each in able if fault.crossing.output in each.enters), None)


def trusted(fault: OpenFault, others: Iterable[OpenFault]) -> tuple[str, ...]:
    """Return the residuals that tell of a fault: its own, and those that no earlier one enters."""
    entered_before = {output for each in earlier(fault, others) for output in each.enters}
    outputs = (spec.output for spec in fault.monitor.bank.diagnostic)
    return tuple(output for output in outputs if output == fault.crossing.output or output not in entered_before)


def unspoilt(fault: OpenFault, others: Iterable[OpenFault]) -> tuple[str, ...]:
    """Return those of the trusted residuals that no other fault enters which has been decided since."""
    firsts = [each.alarm for each in others if each.alarm.is_first and each.number != fault.number]
    named = [alarm.sensor for alarm in firsts if alarm.sensor is not None]
    spoilt = {output for sensor in named for output in entered(fault.monitor.bank, [sensor])}
    outputs = trusted(fault, others)
    return tuple(output for output in outputs if output == fault.crossing.output or output not in spoilt)
