"""A link watched from its first message to its last: what arrives goes in, events come out, nothing is read here.

It depends on what arrived in which order, and of when it arrived only whether the link was silent; so a link, and the
file that was saved of it, give the same alarms.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.protocol import Monitor
from gtmbench.link.closing import FLYING, Recent, verdict_so_far
from gtmbench.link.events import LiveEvent, LiveKind, Story
from gtmbench.link.rows import LONGEST_S, SenderClock
from gtmbench.link.telemetry import Message, TableRows, Telemetry
from gtmbench.link.watcher import Watcher
from gtmbench.log.self_check.refusal import rests_on_motion
from gtmbench.values.channels import limit_of
from gtmbench.values.record import Record, Span
from gtmbench.verdict.verdict import LogVerdict, Outcome

SILENT_S = 3.0  # without a message for so long, the link is lost
_HELD_S = 0.2  # without a message, until rows that wait for others are taken
_QUIET_S = 5.0  # without a sign of a second sender, until messages are believed again
_LOOKED_S = 5.0  # over which it is looked at how much of the link is missing
_ARMING_S = 90.0  # in which every test statistic should come down to its threshold
_MUCH = 0.5  # of the rows: so few aren't watching


@dataclass(frozen=True, kw_only=True)
class LinkCounts:
    """How many of a link's messages were read, and how many weren't, by reason.

    Attributes
    ----------
    read : int
        Messages, or rows, of the watched system.
    lost, doubled, late : int
        By their stamps: those that never came, came again, or came too late to be put in order.
    broken, refused : int
        With a wrong checksum, or no row; without the right signature.
    dropped : int
        Pieces of the link that came faster than they could be watched.
    out_of_range : int
        Readings that no sensor reads, such as an infinite angle; they are missing.

    Examples
    --------
    >>> import gtmbench as gb
    >>> print(gb.LinkCounts(read=1200, lost=24, doubled=3))
    1200 messages read, 24 lost, 3 doubled
    """

    read: int = 0
    lost: int = 0
    doubled: int = 0
    late: int = 0
    broken: int = 0
    refused: int = 0
    dropped: int = 0
    out_of_range: int = 0

    def __str__(self) -> str:
        words = {"read": "messages read", "late": "too late", "refused": "not signed", "out_of_range": "out of range"}
        told = [f"{count} {words.get(name, name)}" for name, count in vars(self).items() if count or name == "read"]
        return ", ".join(told)


class Session:
    """A monitor on a link."""

    def __init__(
        self,
        monitor: Monitor,
        reader: Telemetry | TableRows,
        shows: Callable[[Record], object] | None = None,
        *,
        is_own: bool = False,
    ) -> None:
        self._monitor, self._reader, self._shows = monitor, reader, shows
        self._clock, self._guard = SenderClock(), SenderClock()
        self._is_own = is_own
        self._watcher = Watcher(monitor, reader, shows=shows, recent=self._recent())
        self._bends = basis_of(monitor).attitude_from_gyros is False and not is_own
        self._story = Story(bends=self._bends)
        self._strays: list[Message] = []
        self._arrived_s = 0.0
        self._lost_since_s: float | None = None
        self._mixed_until_s: float | None = None
        self._said: set[str] = set()
        self._state = ""  # of watching, as it was said last
        self._ever: set[str] = set()  # test statistics that were armed
        self._sparse, self._excused = False, 0  # looks after a silence, which has been told
        self._looked = (0.0, 0, 0)  # when it was looked at how much is missing, rows and those left out then
        self._past = LinkCounts()
        self._watched = 0
        self._span_s: Span | None = None
        self.read = 0
        self.dropped = 0
        self.at_once = 1
        """How many rows are taken together; alarms are the same."""

    @property
    def counts(self) -> LinkCounts:
        """What became of the messages so far."""
        past, own = self._past, self._watcher.counts
        return LinkCounts(
            read=self.read,
            lost=past.lost + sum(each.lost for each in own),
            doubled=past.doubled + sum(each.doubled for each in own),
            late=past.late + sum(each.late for each in own),
            broken=self._reader.broken,
            refused=self._reader.refused,
            dropped=self.dropped,
            out_of_range=past.out_of_range + self._watcher.out_of_range.total(),
        )

    @property
    def watched_s(self) -> float:
        """For how long an alarm was possible, in the sender's time."""
        return (self._watched + self._watcher.watched) * float(self._monitor.sample_period_s or 0.0)

    @property
    def time_s(self) -> float | None:
        """The newest stamp of the sender's clock."""
        return self._clock.newest_s

    @property
    def alarms(self) -> list[Alarm]:
        """The faults so far that something is left of to explain."""
        return self._story.left

    def verdict(self, why: str = FLYING) -> LogVerdict:
        """Return the verdict so far, which is what alarms say, and why nothing else is judged."""
        if self._reader.is_open or self._mixed_until_s is not None:
            why = self._reader.is_open or "two senders are mixed on this link"
        sensors = self._monitor.suspects or self._monitor.channels
        return verdict_so_far(sensors, self._span_s or (0.0, 0.0), self.first_alarms, why)

    @property
    def first_alarms(self) -> list[Alarm]:
        """The first alarm of each fault so far."""
        return self._story.first

    @property
    def outcome(self) -> Outcome:
        """The verdict's outcome so far."""
        return self.verdict().outcome

    def take(self, messages: list[Message], arrived_s: float) -> Iterator[LiveEvent]:
        """Give the events that some messages make known, which arrived together."""
        yield from self.tick(arrived_s)
        self._arrived_s = max(arrived_s, self._arrived_s)
        if self._lost_since_s is not None and messages:
            silent_s = arrived_s - self._lost_since_s
            self._lost_since_s, self._excused = None, 4
            yield self._event(LiveKind.LINK_BACK, f"messages come again, after {silent_s:.1f} s")
        self.read += len(messages)
        if self._is_mixed(messages):
            yield from self._not_believed()
            return
        if self._mixed_until_s is not None:
            self._mixed_until_s = None
            yield from self._anew("one sender is left; watching begins anew", keep=False)
        batch: list[Message] = []
        for message in messages:
            if self._clock.push(message.time_s):
                self._strays = []
                batch.append(message)
                continue
            self._strays.append(message)
            if self._clock.has_jumped:
                yield from self._fed(batch)
                yield from self._jumped()
                batch = []
        yield from self._fed(batch)

    def tick(self, now_s: float) -> Iterator[LiveEvent]:
        """Give what silence makes known."""
        if self._watcher.pending and now_s - self._arrived_s > _HELD_S:
            yield from self._alarm_events(self._watcher.push([], 1))
        if self._arrived_s and self._lost_since_s is None and now_s - self._arrived_s > SILENT_S:
            self._lost_since_s = self._arrived_s
            yield self._event(LiveKind.LINK_LOST, f"no message for {SILENT_S:g} s; nothing is watched until one comes")

    def end(self) -> Iterator[LiveEvent]:
        """Give what is left to be told."""
        if not self._watcher.problem and not self._reader.is_open:
            yield from self._alarm_events(self._watcher.end())

    def note(self, text: str) -> LiveEvent:
        """Return a note."""
        return self._event(LiveKind.NOTE, text)

    def _fed(self, messages: list[Message]) -> Iterator[LiveEvent]:
        if messages:
            at_s = [message.time_s for message in messages]
            first_s, last_s = self._span_s or (at_s[0], at_s[0])
            self._span_s = min(first_s, *at_s), max(last_s, *at_s)
            told = self._watcher.push(messages, self.at_once)
            yield from self._states(has_alarmed=bool(told))
            yield from self._alarm_events(told)

    def _alarm_events(self, alarms: tuple[Alarm, ...]) -> Iterator[LiveEvent]:
        for kind, time_s, text, alarm in self._story.lines(alarms):
            yield self._event(kind, text, alarm, time_s)

    def _event(self, kind: LiveKind, text: str, alarm: Alarm | None = None, time_s: float | None = None) -> LiveEvent:
        fault = None if alarm is None else self._story.number_of(alarm)
        known_s = self._clock.newest_s if time_s is None else time_s
        return LiveEvent(
            kind=kind,
            time_s=known_s,
            text=text,
            arrived_s=self._arrived_s,
            said_s=time.time(),
            fault=fault,
            alarm=alarm,
        )

    def _once(self, kind: LiveKind, text: str) -> Iterator[LiveEvent]:
        if text not in self._said:
            self._said.add(text)
            yield self._event(kind, text)

    def _states(self, *, has_alarmed: bool) -> Iterator[LiveEvent]:
        """Give what is new in whether anything is watched."""
        watcher = self._watcher
        if watcher.problem:
            yield from self._state_is(LiveKind.CANNOT_TELL, watcher.problem)
            return
        if self._reader.others:
            others = ", ".join(map(str, self._reader.others))
            yield from self._once(LiveKind.NOTE, f"system {others} flies on this link, too; it isn't watched")
        for name in watcher.out_of_range:
            text = f"a reading of {name} is beyond {limit_of(name):g}: it is missing, as all such will be"
            yield from self._once(LiveKind.NOTE, text)
        if self._is_sparse():
            text = "the link brings less than half of the messages that the monitor reads; no verdict until it does"
            yield from self._state_is(LiveKind.CANNOT_TELL, text)
        elif (stuck := self._stuck()) and not has_alarmed:
            names = ", ".join(stuck)
            text = (
                f"the test statistic of {names} has been above its threshold from the beginning, for {_ARMING_S:g} s: "
                "a fault from the start, or sensors or units that the monitor wasn't calibrated for"
            )
            yield from self._state_is(LiveKind.CANNOT_TELL, text)
        elif self._state != LiveKind.WATCHING and (has_alarmed or any(watcher.armed.values())):
            self._state = LiveKind.WATCHING.value
            yield self._event(LiveKind.WATCHING, self._watching())

    def _stuck(self) -> list[str]:
        """Return the test statistics that never came down to their thresholds, where there was time enough."""
        armed = self._watcher.armed
        self._ever |= {name for name, is_armed in armed.items() if is_armed}
        period_s = float(self._monitor.sample_period_s or 0.0)
        if (self._watcher.heard - self._watcher.left_out) * period_s < _ARMING_S:
            return []
        return [name for name in armed if name not in self._ever]

    def _state_is(self, kind: LiveKind, text: str) -> Iterator[LiveEvent]:
        if text != self._state:
            self._state = text
            yield self._event(kind, text)

    def _watching(self) -> str:
        watcher, rate_hz = self._watcher, 1.0 / float(self._monitor.sample_period_s or 1.0)
        read = "; ".join(f"{', '.join(own)} of {topic}" for topic, own in watcher.routes.items() if topic)
        said = () if watcher.learner is None else watcher.learner.installation.said
        installed = f"; taken for how the sensors are installed: {', '.join(said)}" if said else ""
        bends = "; believes a first fault only, for a gyro's fault may bend the attitude" if self._bends else ""
        what = f"{basis_of(self._monitor).title} watches at {rate_hz:.4g} Hz"
        return f"{what}{f': {read}' if read else ''}{installed}{bends}"

    def _is_sparse(self) -> bool:
        """Tell whether too much is missing, by the last few seconds; as before until these are over."""
        newest_s, watcher = self._clock.newest_s or 0.0, self._watcher
        at_s, heard, left_out = self._looked
        if not 0.0 <= newest_s - at_s < _LOOKED_S:
            rows = watcher.heard - heard
            self._looked = (newest_s, watcher.heard, watcher.left_out)
            self._excused = max(self._excused - 1, 0)
            least = _MUCH * (0.5 if self._sparse else 1.0)  # so that what is said doesn't go to and fro
            self._sparse = rows > 0 and watcher.left_out - left_out > least * rows and not self._excused
        return self._sparse

    def _is_mixed(self, messages: list[Message]) -> bool:
        """Tell whether nobody knows whose messages these are: of two senders, now or a moment ago."""
        for message in messages:
            if not self._guard.push(message.time_s) and self._guard.has_jumped:
                self._guard = SenderClock()
        if self._reader.is_mixed or self._guard.is_mixed:
            self._mixed_until_s = self._arrived_s + _QUIET_S
            self._clock = SenderClock()
        is_mixed = self._mixed_until_s is not None and self._arrived_s < self._mixed_until_s
        return is_mixed or bool(self._reader.is_open)

    def _not_believed(self) -> Iterator[LiveEvent]:
        text = self._reader.is_open or (
            "two senders use this system's number; neither is believed until one is left: end one, give it another "
            "number, or say which is meant: --from ADDRESS"
        )
        yield from self._state_is(LiveKind.CANNOT_TELL, text)

    def _recent(self) -> Recent | None:
        """Return what judges the last minutes; None where nothing rests on gyros and attitude."""
        if not rests_on_motion(self._monitor):
            return None
        is_assumed = isinstance(self._reader, TableRows) and not self._is_own  # MAVLink's attitude is an estimator's
        return Recent(is_driven=not self._is_own, is_assumed=is_assumed)

    def _jumped(self) -> Iterator[LiveEvent]:
        """Begin anew on another clock, or behind a silence."""
        strays, self._strays = self._strays, []
        newest_s, first_s = self._clock.newest_s or 0.0, strays[0].time_s
        is_on = first_s > newest_s
        self._clock = SenderClock()
        strays = [message for message in strays if self._clock.push(message.time_s)]  # of one clock
        text = (
            f"the sender's clock jumps on by {first_s - newest_s:.1f} s; watching begins anew"
            if is_on
            else f"the sender's clock jumps back by {newest_s - first_s:.1f} s, as after a reboot; watching begins anew"
        )
        yield from self._anew(text, keep=is_on and first_s - newest_s > LONGEST_S)
        yield from self._fed(strays)

    def _anew(self, text: str, *, keep: bool) -> Iterator[LiveEvent]:
        yield from self._alarm_events(self._watcher.end())
        self._past = self.counts
        self._watched += self._watcher.watched
        learner = self._watcher.learner if keep else None
        self._watcher = Watcher(self._monitor, self._reader, learner, self._shows, self._recent())
        self._story.begin()
        self._looked, self._sparse, self._state, self._ever = (0.0, 0, 0), False, "", set()
        yield self._event(LiveKind.NOTE, text)
