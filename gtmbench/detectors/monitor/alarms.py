"""Where a bank's alarms are raised: what is armed, which faults are open, and when each is looked at again.

It goes through the rows of a record in time, whether they are all there or just came in, and is the one place where
anything changes: what is armed (`arming`), which faults are open (`open_faults`), and what is known of them by what a
`review` says. Nothing that it says at a row stands on a later one:

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
from dataclasses import replace
from functools import partial

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.excursion import Excursion, Turning
from gtmbench.detectors.isolation.case import Case, shift_of
from gtmbench.detectors.isolation.diagnosis import by_signature, suspects_of
from gtmbench.detectors.isolation.hypotheses import families
from gtmbench.detectors.isolation.onset import EARLIER_S, LATER_S
from gtmbench.detectors.isolation.own_noise import ROWS_BEFORE, Habit, habit_of
from gtmbench.detectors.isolation.referee import referees_of
from gtmbench.detectors.monitor.excursions import Excursions
from gtmbench.detectors.monitor.missing import NEVER, MissingSamples
from gtmbench.detectors.monitor.open_fault_review import FaultClosing, review
from gtmbench.detectors.monitor.open_faults import HORIZONS_S, Arming, OpenFault, leader_of, rows_of, trusted, unspoilt
from gtmbench.detectors.monitor.residuals import Memory
from gtmbench.detectors.monitor.scores import Crossing, ScoreTrack
from gtmbench.errors import InputError
from gtmbench.values.record import Record

_WINDOW_S = 60.0  # on so much a fault's end is looked for
_FARTHEST_S = 60.0  # before its alarm: where the onset may be, for a diagnosis
_TURNED_S = 1.0  # before the onset: from where on it is looked at how fast the aircraft turned
_MARGIN_S = 0.5  # before the onset as estimated, from where on the suspect isn't believed
_MOST, _WITHIN_S = 8, 600.0  # alarms that are diagnosed, in so long
_ROWS = 8192  # looked through at a time


class AlarmLogic:
    """A bank's alarms on rows as they come; see the module's text.

    `memory`: holds the rows that came in last, `span_rows` at least. `tracks`, by output. `keeps_changes`: whether it
    is remembered when each residual was armed. `without`: families of hypotheses that diagnoses don't try.
    `excursions`: what else is told. InputError where there is no such family.
    """

    def __init__(
        self,
        monitor: CalibratedBank,
        memory: Memory,
        tracks: Mapping[str, ScoreTrack],
        *,
        keeps_changes: bool = False,
        without: Iterable[str] = (),
        excursions: Excursions | None = None,
    ) -> None:
        self._monitor, self._memory, self._bank = monitor, memory, monitor.bank
        self._without = tuple(without)
        for family in self._without:
            if family not in families():
                raise InputError(f"no family of hypotheses is called '{family}'; they are {', '.join(families())}")
        # a score that is above 1 from the start shows what was there before: it has to come down once to be armed
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
        self._margin = rows_of(_MARGIN_S, monitor)
        self._turning = Turning.from_provenance(monitor.provenance)
        self._outputs = tuple(spec.output for spec in self._bank.diagnostic)
        self._history = max(rows_of(monitor.history_of(output), monitor) for output in tracks) + self._margin + 2
        self.missing = MissingSamples(self._bank.channels, monitor.sample_period_s)  # is given the rows to go to
        self.excursions = excursions or Excursions(monitor, 0.0, (), (), np.inf)
        self._of_excursions: list[int] = []  # numbers of their alarms
        self.alarms: list[Alarm] = []
        self.due = NEVER  # when a judgement is
        self.row = 0  # the next
        self._open: dict[int, OpenFault] = {}  # by their numbers
        self._raised: list[Crossing] = []  # lately
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

    @property
    def values(self) -> tuple[object, ...]:
        """What never changes of its state, so that copies may share it."""
        return (self.excursions, *self.alarms, *self._open.values())

    def _tell_excursions(self) -> None:
        """Tell the alarms of excursions that are known by now; of those that have been told, what they became."""
        for place, (row, alarm) in enumerate(self.excursions.alarms):
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
        return min(self.missing.due, self.excursions.due(len(self._of_excursions)))

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
        """Raise an alarm with a row, and disarm the residual that it is put down to."""
        fault = self._telling(self._opened(arming, row))
        self._put(fault.alarm)
        self._open[fault.number] = fault
        self._raised = [*self._raised[-_MOST:], fault.crossing]
        for each in self.arming:
            if each.source == arming.source:
                each.disarm(row + 1, row)
        self.due = min(self.due, fault.due)

    def _opened(self, arming: Arming, row: int) -> OpenFault:
        """Return the fault that a residual's rise opens, with what was usual before it."""
        crossing = arming.track.crossing(arming.source, row - arming.track.ahead, self._memory.start_s)
        # the case begins a margin before the onset as estimated, for that may be late
        onset_s = self._memory.time_s(crossing.onset_row)
        start = max(crossing.onset_row - self._margin, row - rows_of(_FARTHEST_S, self._monitor), 0)
        record, before = self._before(start)
        monitor, is_diagnosed = self._known_at(row), self._may_diagnose(row)
        horizons = tuple(row + rows_of(horizon_s, monitor) for horizon_s in HORIZONS_S)
        fault = OpenFault(
            alarm=Alarm(
                number=len(self.alarms),
                time_s=crossing.time_s,
                onset_s=onset_s,
                source=arming.output,
                test=crossing.test,
            ),
            crossing=crossing,
            monitor=monitor,
            row=row,
            looks=horizons if is_diagnosed else horizons[-1:],
            start=start,
            shift={output: shift_of(monitor, output, raw) for output, raw in before.raw.items()},
            is_diagnosed=is_diagnosed,
            ruled_out=frozenset(name for name in self.missing.out if crossing.output not in self._bank.affects(name)),
            settling=self.excursions.just_before(crossing.time_s, onset_s),
            turned=self._turned(crossing.onset_row),
            turned_row=self.row,
        )
        # one fault raises several residuals: those that follow count to the first, and nobody judges them twice
        leader = leader_of(fault, self._open.values())
        if leader is not None:
            return replace(fault, alarm=replace(fault.alarm, fault=leader.number))
        return replace(
            fault,
            alarm=replace(fault.alarm, judgements=(self._signature(fault),)),
            habits=self._habits(start),
            referees=referees_of(self._bank, record, before.predicted),
        )

    def _turned(self, onset_row: int, known_row: int = 0) -> Excursion | None:
        """Return the motion beyond what the monitor knows since shortly before an onset, as known by now.

        `known_row`: up to which there is none.
        """
        if not self._turning.limits:
            return None
        first = max(onset_row - rows_of(_TURNED_S, self._monitor), self._memory.first, 0)
        record = self._memory.record(range(first, min(self.row + 1, self._memory.stop)))
        return self._turning.excursion(record, max(known_row - first, 0))

    def _signature(self, fault: OpenFault) -> Judgement:
        """Return what is told of a fault with its alarm."""
        among = trusted(fault, self._open.values())
        signature = by_signature(self._monitor, among, fault.crossing.output, fault.alarm.time_s)
        about = fault.settling or fault.turned_before()
        return signature if about is None else replace(signature, sensor=None, doubt=about.reason)

    def _known_at(self, row: int) -> CalibratedBank:
        """Return the monitor with the noise of its residuals as it was known at a row of the record."""
        whiteners = {each.output: each.track.whitener_at(row - each.track.ahead) for each in self.arming}
        return replace(self._monitor, whiteners=whiteners)

    def _may_diagnose(self, row: int) -> bool:
        """Tell whether an alarm is diagnosed, and count it if so."""
        since = row - rows_of(_WITHIN_S, self._monitor)
        lately = [each for each in self._diagnosed if each > since]
        is_able = len(lately) < _MOST
        self._diagnosed = [*lately, row] if is_able else lately
        return is_able

    def _before(self, start: int) -> tuple[Record, BankResiduals]:
        """Return the baseline before a fault, witnesses that are there among its channels."""
        first = start - rows_of(self._bank.statistic.baseline_s, self._monitor)
        rows = range(max(first, self._memory.first, 0), start)
        return self._memory.witnessed(rows), self._memory.residuals(rows, self._outputs)

    def _habits(self, start: int) -> dict[str, Habit]:
        """Return how the suspects read before a fault."""
        before = self._memory.record(range(max(start - ROWS_BEFORE, self._memory.first, 0), start))
        habits = {name: habit_of(before[name]) for name in self._bank.suspects if name in before.channels}
        return {name: habit for name, habit in habits.items() if habit is not None}

    def _put(self, alarm: Alarm) -> None:
        """Put an alarm, a new one or what is known of it now, where its number says."""
        self.alarms[alarm.number : alarm.number + 1] = [alarm]
        self._told[alarm.number] = alarm

    # ---- looks at open faults ----

    def _look_at_all(self) -> None:
        """Look at every fault that is due, then settle which residuals are armed."""
        for number in tuple(self._open):
            fault = self._open.get(number)  # one that was looked at before may have closed it
            if fault is not None and fault.due <= self.row:
                self._look_at(fault)
        disarmed = {output for fault in self._open.values() for output in fault.disarms}
        for arming in self.arming:
            if arming.source in disarmed:
                arming.disarm(self.row, self.row)
            else:
                arming.rearm(self.row)
        self.due = min((fault.due for fault in self._open.values()), default=NEVER)

    def _look_at(self, fault: OpenFault) -> None:
        """Look at a fault anew."""
        if not fault.is_diagnosed:
            del self._open[fault.number]
            return
        others = self._open.values()
        leader, closing, alarm = leader_of(fault, others), None, fault.alarm
        if leader is None and (fault.is_undecided or fault.may_end):
            turned = fault.turned or self._turned(fault.crossing.onset_row, fault.turned_row)
            fault = replace(fault, turned=turned, turned_row=self.row)
            begin = partial(self._beginning, fault)
            fault, closing = review(fault, self._case(fault), begin, others, self.row, self._without)
        number = fault.number if leader is None else leader.number
        if number != fault.alarm.fault:
            fault = replace(fault, alarm=replace(fault.alarm, fault=number))
        fault = self._telling(replace(fault, looks=fault.later_looks))
        if fault.alarm is not alarm:
            self._put(fault.alarm)
        self._open[fault.number] = fault
        if closing is not None:
            self._close(fault, closing)

    def _telling(self, fault: OpenFault) -> OpenFault:
        """Return a fault whose alarm tells when it is looked at next, where that may change its verdict."""
        again_s = self._memory.time_s(fault.due) if fault.is_undecided else None
        alarm = fault.alarm
        return fault if alarm.looks_again_s == again_s else replace(fault, alarm=replace(alarm, looks_again_s=again_s))

    def _beginning(self, fault: OpenFault) -> Case:
        """Cut out what tells of a fault's onset."""
        stop = fault.row + rows_of(LATER_S, self._monitor) + self._history
        return self._case(fault, rows_of(EARLIER_S, self._monitor), min(stop, self.row + 1))

    def _case(self, fault: OpenFault, earlier: int = 0, stop: int | None = None) -> Case:
        """Cut out what a review with this row needs: from so many rows `earlier` on, up to a row, by default this."""
        others = self._open.values()
        suspects = suspects_of(self._bank, trusted(fault, others))
        stop = self.row + 1 if stop is None else stop
        start, sure = max(fault.start - earlier, self._memory.first), fault.row + 2
        if fault.is_late:
            sure = max(sure, stop - rows_of(_WINDOW_S, self._monitor))
            start = max(start, sure - self._history)
        first = max(start - self._history, self._memory.first, 0)
        record, residuals = self._memory.cut(range(first, stop), unspoilt(fault, others))
        return Case(
            monitor=fault.monitor,
            record=record,
            residuals=residuals,
            start=start - first,
            onset=max(fault.crossing.onset_row, start) - first,
            sure=max(sure, start + 1) - first,
            shift=fault.shift,
            suspects=tuple(name for name in suspects if name not in fault.ruled_out),
            habits=fault.habits,
            referees=fault.referees,
            source=fault.crossing.output,
            others=frozenset(each.crossing.output for each in others if not fault.began_with(each.crossing)),
            together=frozenset(each.output for each in self._raised if fault.began_with(each)),
        )

    def _close(self, fault: OpenFault, closing: FaultClosing) -> None:
        """End a fault, with all that counted to it: take its rows out and watch anew.

        By noise that is learnt anew from now on, where it has changed: that of all residuals, for one shows it first.
        """
        closed = [each for each in self._open.values() if each.alarm.fault == fault.number]
        outputs = fault.enters | {each.crossing.output for each in closed}
        for each in closed:
            del self._open[each.number]
            alarm = each.alarm if each.alarm.looks_again_s is None else replace(each.alarm, looks_again_s=None)
            if closing.end is not None:
                ended_s, between_s = closing.end
                alarm = replace(alarm, ended_s=ended_s, ended_between_s=between_s, end_known_s=closing.known_s)
            if alarm is not each.alarm:
                self._put(alarm)
        rows = range(fault.crossing.onset_row, self.row + 1)
        for arming in self.arming:
            if closing.anew or arming.source in outputs:
                arming.track.blot(rows, self.row - arming.track.ahead, anew=closing.anew)
                self._memory.blot(arming.output, rows)
                arming.begin_anew(self.row)


def span_rows(monitor: CalibratedBank) -> int:
    """Return how many rows back the alarm logic looks: the baseline before the farthest onset, or the longest case."""
    spans_s = (monitor.bank.statistic.baseline_s, HORIZONS_S[-1], _WINDOW_S)
    history_s = max(map(monitor.history_of, monitor.operators))
    return round((_FARTHEST_S + max(spans_s) + 3.0 * (history_s + _MARGIN_S)) / monitor.sample_period_s) + 10
