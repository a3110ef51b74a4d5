"""Where a bank's alarms are raised: what is armed, which faults are open, and when each is looked at again.

It goes through the rows of a record in time, whether they are all there or just came in. Nothing that it says at a row
stands on a later one:

- The arming rule is that of `method.alarms` (`came_down`, `rising`), row by row: a residual is armed once its score has
  been known at or below 1 since watching it began. A rise above 1 of an armed residual is an alarm, whatever comes
  after it; nothing takes an alarm back.
- With its alarm a residual is disarmed, so that the chatter of one fault isn't ten alarms. Judgements follow at fixed
  horizons. From a judgement on, the residuals that a candidate's fault enters are disarmed, for they can't tell of
  another fault, and no others: who has been cleared of suspicion is armed again. If such a residual rose while it was
  disarmed, having come down first, that is an alarm as soon as it is armed again: a second fault isn't lost for having
  come while the first was undecided.
- An alarm of a residual that an open fault's candidates enter counts to that fault, and gets no judgements. At each of
  its own horizons that is asked again: once they don't enter it any more, it is a fault of its own, judged by the
  residuals that no earlier fault's candidates enter. Once it has been judged, only a decided fault takes it back.
- Where nothing is left to explain, or a fault has ended, the rows from its onset to then are treated as missing in
  the residuals that it entered, and these are watched anew.
- A channel that goes missing is an alarm of its own (`missing`), in time among the others; it disarms nothing, for
  without its samples the residuals that it enters don't exist. It isn't suspected of what rises elsewhere meanwhile.

What a diagnosis costs is bounded: no case is longer than about two minutes; after the last horizon the end of a fault
is looked for every 20 s on its last minute. A record full of alarms (another sensor's noise than the monitor was
calibrated with) would be diagnosed over and over. So no more than 8 alarms in 10 minutes are; of further ones the
signatures tell whom they leave under suspicion, and their residuals are disarmed for as long as a diagnosis takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import NOISE_CHANGED, Alarm, Judgement
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.isolation.case import Case, shift_of
from gtmbench.detectors.isolation.diagnosis import (
    DECISIVE,
    by_signature,
    ended_s,
    entered,
    fault_of,
    is_bent_far,
    judge,
    only_doubts,
    suspects_of,
)
from gtmbench.detectors.isolation.fits import FittedHypothesis, hopeless, ranked_hypotheses
from gtmbench.detectors.isolation.health import greatest
from gtmbench.detectors.isolation.hypotheses import FAMILIES
from gtmbench.detectors.isolation.readings import ROWS_BEFORE, Habit, habit_of
from gtmbench.detectors.isolation.referee import Referee, referees_of
from gtmbench.detectors.monitor.excursions import Excursion, Excursions
from gtmbench.detectors.monitor.memory import Memory
from gtmbench.detectors.monitor.missing import NEVER, MissingSamples
from gtmbench.detectors.monitor.scores import Crossing, IntArray, Track
from gtmbench.errors import InputError
from gtmbench.record import FloatArray, Record

HORIZONS_S = (0.75, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)  # after the alarm: when the case is looked at anew
_LOOK_S = 20.0  # then, for a fault's end,
_WINDOW_S = 60.0  # on so much
_APART_S = 3.0  # what shakes the aircraft shakes all of it within that
_SURE_S = 5.0  # after an alarm: whether the noise has changed
_CALM_S = 4.0  # of healthy residuals, until an alarm that can't be told has passed
_FARTHEST_S = 60.0  # before its alarm: where the onset may be, for a diagnosis
_MARGIN_S = 0.5  # before the onset as estimated, from where on the suspect isn't believed
_MOST, _WITHIN_S = 8, 600.0  # alarms that are diagnosed, in so long
_ROWS = 8192  # looked through at a time


@dataclass(kw_only=True)
class Arming:
    """Whether a residual can raise an alarm.

    Attributes
    ----------
    source : str
        Whose residual its alarms are put down to: its own, or, of an early one, that of the sensor it is about.
    came_down : bool
        Whether it has been known at or below 1 since watching it began, or what was before is known to be healthy.
    low : bool
        Whether it was when last known, or since it was disarmed: a rise is news.
    disarmed_row : int or None
        Since when it is disarmed.
    changes : list of (row, bool)
        From which row on an alarm was possible, or wasn't; kept where somebody will ask.
    """

    output: str
    source: str
    track: Track
    came_down: bool = False
    low: bool = False
    disarmed_row: int | None = None
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


@dataclass(kw_only=True, eq=False)
class OpenFault:
    """An alarm, and where its diagnosis stands."""

    alarm: Alarm
    crossing: Crossing
    row: int  # when it was raised
    due: int  # when it is looked at next
    horizons: list[int]  # and after that
    start: int  # from where on the suspect isn't believed
    shift: dict[str, float]
    habits: dict[str, Habit]
    referees: dict[str, Referee] = field(default_factory=dict)
    monitor: CalibratedBank  # with the noise as it was known at the alarm
    is_diagnosed: bool
    is_judged: bool = False
    ruled_out: set[str] = field(default_factory=set)
    held: FittedHypothesis | None = None  # the last that was decisive
    settling: Excursion | None = None  # just before


class AlarmLogic:
    """A bank's alarms on rows as they come; see the module's text.

    Parameters
    ----------
    monitor : CalibratedBank
    memory : Memory
        Holds the rows that came in last, `span_rows` at least.
    tracks : mapping of output to Track
    keeps_changes : bool
        Whether it is remembered when each residual was armed.
    without : iterable of str
        Families of hypotheses that diagnoses don't try.
    excursions : Excursions, optional
        What else is told.

    Raises
    ------
    InputError
        Where there is no such family.
    """

    def __init__(
        self,
        monitor: CalibratedBank,
        memory: Memory,
        tracks: Mapping[str, Track],
        *,
        keeps_changes: bool = False,
        without: Iterable[str] = (),
        excursions: Excursions | None = None,
    ) -> None:
        self._monitor, self._memory, self._bank = monitor, memory, monitor.bank
        self._without = tuple(without)
        for family in self._without:
            if family not in FAMILIES:
                raise InputError(f"no family of hypotheses is called '{family}'; they are {', '.join(FAMILIES)}")
        sources = {spec.output: spec.source for spec in self._bank.residuals}
        self.arming = [
            Arming(
                output=output,
                source=sources[output],
                track=track,
                came_down=track.knows_before,
                low=track.knows_before,
                changes=([(0, True)] if track.knows_before else []) if keeps_changes else None,
            )
            for output, track in sorted(tracks.items())
        ]
        self._outputs = tuple(spec.output for spec in self._bank.diagnostic)
        self._history = max(map(self._rows_of, map(monitor.history_of, tracks))) + self._rows_of(_MARGIN_S) + 2
        self.missing = MissingSamples(self._bank.channels, monitor.sample_period_s)  # is given the rows to go to
        self.excursions = excursions
        self._of_excursions: list[int] = []  # numbers of their alarms
        self.alarms: list[Alarm] = []
        self.due = NEVER  # when a judgement is
        self.row = 0  # the next
        self._open: list[OpenFault] = []
        self._raised: list[OpenFault] = []  # lately
        self._diagnosed: list[int] = []  # rows
        self._told: dict[int, Alarm] = {}

    def run(self, stop: int) -> tuple[Alarm, ...]:
        """Go on to a row; return the alarms that were raised or told more of, as they are then, by their numbers."""
        while self.row < stop:
            if self.row >= self.due:
                self._look_at_all()
            for alarm in self.missing.tell(self.row, self._memory.time_s, len(self.alarms)):
                self._put(alarm)
            self._tell_excursions()
            self._watch(min(stop, self.due, self._news_due, self.row + _ROWS))
        told, self._told = self._told, {}
        return tuple(told[number] for number in sorted(told))

    def _tell_excursions(self) -> None:
        """Tell the alarms of excursions that are known by now; of those that have been told, what they became."""
        for place, (row, alarm) in enumerate(self.excursions.alarms if self.excursions else ()):
            if place == len(self._of_excursions) and row <= self.row:
                self._of_excursions.append(len(self.alarms))
            if place < len(self._of_excursions):
                number = self._of_excursions[place]
                told = replace(alarm, number=number, fault=number)
                if self.alarms[number : number + 1] != [told]:
                    self._put(told)

    @property
    def _news_due(self) -> int:
        """The row with which the next alarm is known that no armed score raises."""
        return (
            self.missing.due
            if self.excursions is None
            else min(self.missing.due, self.excursions.due(len(self._of_excursions)))
        )

    def is_quiet(self, scores: Iterable[float]) -> bool:
        """Tell whether scores that the next row makes known raise no alarm, and no judgement is due with it."""
        return self.row < min(self.due, self.missing.due) and not any(
            score > 1.0 and arming.low and arming.disarmed_row is None
            for arming, score in zip(self.arming, scores, strict=True)
        )

    def take(self, scores: Iterable[float]) -> bool:
        """Take the scores that the next row makes known, where no judgement is due; return whether one is an alarm."""
        row = self.row
        risen = [arming for arming, score in zip(self.arming, scores, strict=True) if arming.take(score, row)]
        self.row += 1
        for source in dict.fromkeys(arming.source for arming in risen):
            self._raise(next(arming for arming in risen if arming.source == source), row)
        return bool(risen)

    def _watch(self, stop: int) -> None:
        """Go on to a row, or to the first alarm, if that comes before: it may bring a judgement that is due sooner."""
        first, scores = self.row, [arming.track.known(self.row, stop) for arming in self.arming]
        news = [arming.news(values) for arming, values in zip(self.arming, scores, strict=True)]
        for at in sorted({at for places in news for at in places.tolist()}):
            self.row = first + at
            if self.take([float(values[at]) for values in scores]):
                return
        self.row = stop

    # ---- alarms ----

    def _raise(self, arming: Arming, row: int) -> None:
        """Raise an alarm with a row."""
        output, track = arming.source, arming.track
        scored_row = row - track.ahead
        time_s = float(np.round(self._memory.time_s(scored_row) + track.ahead * self._memory.period_s, 9))
        crossing = track.crossing(output, scored_row, time_s)
        start = max(crossing.onset_row - self._rows_of(_MARGIN_S), row - self._rows_of(_FARTHEST_S), 0)
        record, before = self._before(start)
        monitor = self._known_at(row)
        fault = OpenFault(
            alarm=Alarm(
                number=len(self.alarms),
                time_s=time_s,
                onset_s=self._memory.time_s(crossing.onset_row),
                source=arming.output,
                test=crossing.test,
            ),
            crossing=crossing,
            row=row,
            due=NEVER,
            horizons=[row + self._rows_of(horizon_s) for horizon_s in HORIZONS_S],
            start=start,
            # biases
            shift={output: shift_of(monitor, output, raw) for output, raw in before.raw.items()},
            habits={},
            monitor=monitor,
            is_diagnosed=self._may_diagnose(row),
            ruled_out={name for name in self.missing.out if output not in self._bank.affects(name)},
            settling=self.excursions.just_before(time_s, self._memory.time_s(crossing.onset_row))
            if self.excursions
            else None,
        )
        if fault.is_diagnosed:
            self._diagnosed.append(row)
        else:
            fault.horizons = fault.horizons[-1:]
        fault.due = fault.horizons.pop(0)
        self.alarms.append(fault.alarm)
        leader = self._leader(fault)
        if leader is None:
            signature = by_signature(self._monitor, self._trusted(fault), output, time_s)
            if fault.settling is not None:
                signature = replace(signature, sensor=None, doubt=fault.settling.reason)
            self._tell(fault, judgements=(signature,))
            fault.habits = self._habits(start)
            fault.referees = referees_of(self._bank, record, before.predicted)
        else:
            self._tell(fault, fault=leader.alarm.number)
        self._open.append(fault)
        self._raised = [*self._raised[-_MOST:], fault]
        for each in self.arming:
            if each.source == output:
                each.disarm(row + 1, row)
        self.due = min(self.due, fault.due)

    def _known_at(self, row: int) -> CalibratedBank:
        """Return the monitor with the noise of its residuals as it was known at a row of the record."""
        whiteners = {each.output: each.track.whitener_at(row - each.track.ahead) for each in self.arming}
        return replace(self._monitor, whiteners=whiteners)

    def _may_diagnose(self, row: int) -> bool:
        since = row - self._rows_of(_WITHIN_S)
        self._diagnosed = [each for each in self._diagnosed if each > since]
        return len(self._diagnosed) < _MOST

    def _before(self, start: int) -> tuple[Record, BankResiduals]:
        """Return the baseline before a fault, witnesses that are there among its channels."""
        rows = range(max(start - self._rows_of(self._bank.statistic.baseline_s), self._memory.first, 0), start)
        return self._memory.witnessed(rows), self._memory.residuals(rows, self._outputs)

    def _habits(self, start: int) -> dict[str, Habit]:
        """Return how the suspects read before a fault."""
        before = self._memory.record(range(max(start - ROWS_BEFORE, self._memory.first, 0), start))
        habits = {name: habit_of(before[name]) for name in self._bank.suspects if name in before.channels}
        return {name: habit for name, habit in habits.items() if habit is not None}

    def _tell(self, open_fault: OpenFault, /, **changes: Any) -> None:
        """Add to what is known of an alarm."""
        open_fault.alarm = replace(open_fault.alarm, **changes)
        self._put(open_fault.alarm)

    def _put(self, alarm: Alarm) -> None:
        """Put an alarm, a new one or what is known of it now, where its number says."""
        self.alarms[alarm.number : alarm.number + 1] = [alarm]
        self._told[alarm.number] = alarm

    # ---- who counts to whom ----

    def _earlier(self, fault: OpenFault) -> list[OpenFault]:
        """Return the open faults that were told of before one."""
        return [each for each in self._open if each.alarm.is_first and each.alarm.number < fault.alarm.number]

    def _leader(self, fault: OpenFault) -> OpenFault | None:
        """Return the earlier fault that an alarm counts to: by its last judgement it enters the residual that rose."""
        for each in self._earlier(fault):
            last = each.alarm.last
            if last is None or (fault.is_judged and last.sensor is None):
                continue
            if fault.crossing.output in entered(self._bank, last.candidates):
                return each
        return None

    def _trusted(self, fault: OpenFault) -> tuple[str, ...]:
        """Return the residuals that tell of a fault: its own, and those that no earlier one enters."""
        others = {
            output
            for each in self._earlier(fault)
            if each.alarm.last is not None
            for output in entered(self._bank, each.alarm.last.candidates)
        }
        return tuple(output for output in self._outputs if output == fault.crossing.output or output not in others)

    def _unspoilt(self, fault: OpenFault, outputs: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of some residuals that no other fault enters which has been decided since."""
        decided = [each.alarm.last for each in self._open if each.alarm.is_first and each is not fault]
        spoilt = {
            output
            for last in decided
            if last is not None and last.sensor is not None
            for output in entered(self._bank, [last.sensor])
        }
        return tuple(output for output in outputs if output == fault.crossing.output or output not in spoilt)

    # ---- judgements ----

    def _look_at_all(self) -> None:
        """Look at every fault that is due, then settle which residuals are armed."""
        for fault in list(self._open):
            if fault in self._open and fault.due <= self.row:
                self._look_at(fault)
        for arming in self.arming:
            if any(arming.source in self._disarmed_by(fault) for fault in self._open):
                arming.disarm(self.row, self.row)
            else:
                arming.rearm(self.row)
        self.due = min((fault.due for fault in self._open), default=NEVER)

    def _disarmed_by(self, fault: OpenFault) -> set[str]:
        if fault.is_judged and fault.alarm.is_first and fault.alarm.last is not None:
            return entered(self._bank, fault.alarm.last.candidates)
        return {fault.crossing.output}

    def _look_at(self, fault: OpenFault) -> None:
        """Look at a fault anew."""
        is_late = not fault.horizons and fault.due > fault.row + self._rows_of(HORIZONS_S[-1])
        fault.due = fault.horizons.pop(0) if fault.horizons else fault.due + self._rows_of(_LOOK_S)
        if not fault.is_diagnosed:
            self._open.remove(fault)
            return
        leader = self._leader(fault)
        counts_to = fault.alarm.number if leader is None else leader.alarm.number
        if counts_to != fault.alarm.fault:
            self._tell(fault, fault=counts_to)
        if leader is None and not (is_late and fault.held is None):
            self._judge(fault, is_late=is_late)

    def _judge(self, fault: OpenFault, *, is_late: bool) -> None:
        trusted = self._trusted(fault)
        suspects = tuple(name for name in suspects_of(self._bank, trusted) if name not in fault.ruled_out)
        case = self._case(fault, self._unspoilt(fault, trusted), suspects, is_late=is_late)
        if not case.is_ripe:
            return
        ranking = [] if is_late else ranked_hypotheses(case, suspects, self._without)
        if fault.held is not None:
            lasting = min((fit.bic for fit in ranking if fit.lasts), default=float("inf"))
            ended = ended_s(case, fault.held, lasting)
            if ended is not None:
                self._close(fault, ended_s=ended, end_known_s=case.end_s)
                return
        if is_late:
            return
        first = by_signature(self._monitor, trusted, fault.crossing.output, fault.alarm.time_s)
        judged = judge(case, ranking, first)
        last = fault.alarm.last
        is_less = last is not None and not _is_narrower(judged, last)
        if is_less and (only_doubts(case, judged, last) or is_bent_far(case)):
            return
        fault.ruled_out |= hopeless(case, ranking, suspects)
        settling = fault.settling
        if settling is not None and judged.candidates and case.end_s < settling.end_s + settling.settles_s:
            judged = replace(judged, sensor=None, partner=None, doubt=settling.reason)
        fault.is_judged = True
        self._tell(fault, judgements=(*fault.alarm.judgements, judged))
        if judged.sensor is not None and judged.kind_margin > DECISIVE:
            named = next(fit for fit in ranking if (fit.channel, fit.kind) == (judged.sensor, judged.kind))
            fault.held = fault.held if fault_of(named) is None else named
        self._settle(fault, judged, case)

    def _settle(self, fault: OpenFault, judged: Judgement, case: Case) -> None:
        """End an alarm that leaves nothing to explain, or that can't be told any better."""
        since = self.row - fault.row
        if judged.doubt == NOISE_CHANGED:
            if since >= self._rows_of(_SURE_S):
                self._close(fault, anew=True)
        elif not judged.candidates:
            self._close(fault)
        elif judged.doubt and self._has_calmed(case):
            self._close(fault, ended_s=case.end_s, end_known_s=case.end_s)
        elif judged.doubt and since >= self._rows_of(HORIZONS_S[-1]):
            self._close(fault)  # should it calm later, watching goes on

    def _case(self, fault: OpenFault, trusted: tuple[str, ...], suspects: tuple[str, ...], *, is_late: bool) -> Case:
        """Cut out what a judgement with this row needs."""
        stop = self.row + 1
        start, sure = fault.start, fault.row + 2
        if is_late:
            sure = max(sure, stop - self._rows_of(_WINDOW_S))
            start = max(start, sure - self._history)
        first = max(start - self._history, self._memory.first, 0)
        record, residuals = self._memory.cut(range(first, stop), trusted)
        return Case(
            monitor=fault.monitor,
            record=record,
            residuals=residuals,
            start=start - first,
            onset=max(fault.crossing.onset_row, start) - first,
            sure=max(sure, start + 1) - first,
            shift=fault.shift,
            suspects=suspects,
            habits=fault.habits,
            referees=fault.referees,
            others=frozenset(each.crossing.output for each in self._open if not self._are_together(each, fault)),
            together=frozenset(each.crossing.output for each in self._raised if self._are_together(each, fault)),
        )

    def _are_together(self, one: OpenFault, other: OpenFault) -> bool:
        """Tell whether two alarms began at about the same time."""
        return abs(one.crossing.onset_row - other.crossing.onset_row) <= self._rows_of(_APART_S)

    def _has_calmed(self, case: Case) -> bool:
        """Tell whether nothing is wrong any more: what raised a doubtful alarm has gone, so watching goes on."""
        rows = self._rows_of(_CALM_S)
        if case.judged.stop - case.judged.start < rows:
            return False
        late = slice(case.judged.stop - rows, case.judged.stop)
        return all(greatest(case.monitor, output, case.white[output][late]) <= 1.0 for output in case.residuals.raw)

    def _close(self, fault: OpenFault, *, anew: bool = False, **end: float) -> None:
        """End a fault, with all that counted to it: take its rows out and watch anew.

        By noise that is learnt `anew` from now on, where it has changed: that of all residuals, for one shows it first.
        """
        outputs = {fault.crossing.output} | entered(self._bank, fault.alarm.candidates)
        if end:
            self._tell(fault, **end)
        for each in [each for each in self._open if each.alarm.fault == fault.alarm.number]:
            outputs.add(each.crossing.output)
            if end and each is not fault:
                self._tell(each, **end)
            self._open.remove(each)
        rows = range(fault.crossing.onset_row, self.row + 1)
        for arming in self.arming:
            if anew or arming.source in outputs:
                arming.track.blot(rows, self.row - arming.track.ahead, anew=anew)
                self._memory.blot(arming.output, rows)
                arming.begin_anew(self.row)

    def _rows_of(self, span_s: float) -> int:
        return round(span_s / self._monitor.sample_period_s)


def _is_narrower(judged: Judgement, last: Judgement) -> bool:
    """Tell whether a judgement says at least what the last one said, and nothing else."""
    is_named = judged.sensor is not None or last.sensor is None
    return is_named and set(judged.candidates) <= set(last.candidates)


def span_rows(monitor: CalibratedBank) -> int:
    """Return how many rows back the alarm logic looks: the baseline before the farthest onset, or the longest case."""
    spans_s = (monitor.bank.statistic.baseline_s, HORIZONS_S[-1], _WINDOW_S)
    history_s = max(map(monitor.history_of, monitor.operators))
    return round((_FARTHEST_S + max(spans_s) + 3.0 * (history_s + _MARGIN_S)) / monitor.sample_period_s) + 10
