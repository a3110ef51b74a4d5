"""What a live watch says, one value an event: a fault's story in a few, and STATUSTEXT on the link itself.

`Saying.request` is the one exception, and only where it is asked for: it asks the autopilot how often it sends.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from gtmbench.checks import listed, printable
from gtmbench.detectors.alarm import MISSING, OUTSIDE, Alarm
from gtmbench.engine.named import WHOLE
from gtmbench.files.plain import attributes
from gtmbench.link.packets import MOTION, dialect
from gtmbench.report.words.judgement import judgement_text
from gtmbench.report.words.timeline import sensor_text
from gtmbench.values.channels import ATTITUDE

BENT = "a gyro that drives the attitude may have bent it, and the monitor was calibrated for one of its own"


class LiveKind(StrEnum):
    """The kinds of events of a live watch.

    Examples
    --------
    >>> import gtmbench as gb
    >>> [kind.value for kind in gb.LiveKind][:4], gb.LiveKind.NAMED == "named"
    (['learning', 'watching', 'alarm', 'named'], True)
    """

    LEARNING = "learning"
    WATCHING = "watching"
    ALARM = "alarm"
    NAMED = "named"
    ENDED = "ended"
    CANNOT_TELL = "cannot tell"
    LINK_LOST = "link lost"
    LINK_BACK = "link back"
    NOTE = "note"


@dataclass(frozen=True, kw_only=True)
class LiveEvent:
    """One thing that a live watch says.

    Attributes
    ----------
    kind : LiveKind
        learning, watching, alarm, named, ended, cannot tell, link lost, link back, or note.
    time_s : float or None
        When it could be known, in seconds of the sender's clock; None before its first message.
    text : str
        The event in words, one line.
    arrived_s : float
        When the message arrived that made it known, in seconds since 1970; of a saved link, when it arrived then.
    said_s : float
        When the event was given, in seconds since 1970.
    fault : int or None
        For an alarm, a name and an end: the number of the fault, from 0.
    alarm : Alarm or None
        The alarm as it was known then.

    Examples
    --------
    >>> import gtmbench as gb
    >>> str(gb.LiveEvent(kind=gb.LiveKind.NOTE, time_s=12.5, text="system 2 flies, too; it isn't watched"))
    "   12.50 s  note         system 2 flies, too; it isn't watched"
    """

    kind: LiveKind
    time_s: float | None
    text: str
    arrived_s: float = 0.0
    said_s: float = 0.0
    fault: int | None = None
    alarm: Alarm | None = field(default=None, repr=False)

    def __str__(self) -> str:
        when = "-" if self.time_s is None else f"{self.time_s:.2f} s"
        return f"{when:>10}  {self.kind:<11}  {self.text}"

    @property
    def table(self) -> Mapping[str, object]:
        """The event as plain values; `text` first."""
        judged = None if self.alarm is None else self.alarm.last
        return {
            "text": self.text,
            "kind": self.kind.value,
            **attributes(self, "time_s", "arrived_s", "said_s", "fault"),
            **attributes(self.alarm, "onset_s", "ended_s"),
            "sensor": None if judged is None else judged.sensor,
            "candidates": [] if judged is None else list(judged.candidates),
            "fault_kind": None if judged is None else judged.kind,
            "parameters": {} if judged is None else dict(judged.parameters),
        }


_LONGEST = 50  # characters of a STATUSTEXT
_APART_S = 1.0  # two heartbeats, and two texts
# MAV_SEVERITY: info, warning, critical, notice
_SAID = {
    LiveKind.WATCHING: 6,
    LiveKind.ALARM: 4,
    LiveKind.NAMED: 2,
    LiveKind.ENDED: 5,
    LiveKind.CANNOT_TELL: 4,
}


class Saying:
    """Sends a heartbeat every second, and what is new, on a link.

    `system`: the watched system, whose ground station is to show it.
    """

    def __init__(self, send: Callable[[bytes], None], system: int) -> None:
        self._send, self._mavlink = send, dialect()
        self._sender = self._mavlink.MAVLink(None, srcSystem=system, srcComponent=191)  # MAV_COMP_ID_ONBOARD_COMPUTER
        self._next: tuple[int, str] | None = None
        self._last = ""
        self._sent_s = self._beat_s = -_APART_S

    def say(self, event: LiveEvent) -> None:
        """Say an event; of several within a second the last."""
        severity = _SAID.get(event.kind)
        if severity is not None:
            self._next = severity, status_text(event)
        self.tick()

    def tick(self) -> None:
        """Send what is due."""
        now_s = time.monotonic()
        if now_s - self._beat_s >= _APART_S:
            self._beat_s = now_s
            # an onboard controller, no autopilot, no mode, active
            self._pack(self._mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        if self._next is not None and now_s - self._sent_s >= _APART_S:
            severity, text = self._next
            self._next = None
            if text != self._last:
                self._last, self._sent_s = text, now_s
                self._pack(self._mavlink.MAVLink_statustext_message(severity, text.encode("ascii", "replace")))

    def request(self, rate_hz: float) -> None:
        """Ask the autopilot for the messages that tell of motion, so often a second."""
        kinds = {kind.msgname: kind.id for kind in self._mavlink.mavlink_map.values()}
        for topic in MOTION:
            fields = (kinds[topic], 1e6 / rate_hz, 0.0, 0.0, 0.0, 0.0, 0.0)
            system = self._sender.srcSystem
            # MAV_CMD_SET_MESSAGE_INTERVAL
            self._pack(self._mavlink.MAVLink_command_long_message(system, 1, 511, 0, *fields))

    def _pack(self, message: object) -> None:
        packed = message.pack(self._sender)  # type: ignore[attr-defined]
        self._sender.seq = (self._sender.seq + 1) % 256
        self._send(bytes(packed))


def status_text(event: LiveEvent) -> str:
    """Return an event in 50 characters.

    >>> status_text(LiveEvent(kind=LiveKind.ALARM, time_s=1.0, text="p (mean 0.16 s) rose above its threshold; the"))
    'gtmbench alarm: p (mean 0.16 s) rose above its thr'
    """
    judged = None if event.alarm is None else event.alarm.last
    text = event.text
    if event.kind == LiveKind.NAMED and judged is not None:
        text = f"{judged.verdict}, {judged.kind}" if judged.kind else judged.verdict
    words = f"gtmbench: {text}" if event.kind == LiveKind.NAMED else f"gtmbench {event.kind}: {text}"
    return printable(words)[:_LONGEST]


MOST_LINES = 12  # what is said of one fault, its end included
UNSURE = "can't tell: "
_MOST_FAULTS = 10_000  # that are remembered
Line = tuple[LiveKind, float, str, Alarm]  # kind, when it could be known, text, and the alarm


@dataclass
class _Fault:
    """What has been said of a fault."""

    number: int
    alarm: Alarm
    lines: int = 1
    judged: int = 0  # judgements
    named: object = None
    has_ended: bool = False


class Story:
    """What has been said of every fault so far, and what is new in what a monitor tells.

    >>> alarm = Alarm(number=0, time_s=12.4, onset_s=12.0, source="p")
    >>> story = Story()
    >>> [text for told in ([alarm], [alarm]) for _, _, text, _ in story.lines(told)]
    ['p rose above its threshold; the change began at about 12.00 s']
    """

    def __init__(self, *, bends: bool = False) -> None:
        self._bends = bends
        self._faults: dict[tuple[int, str, int], _Fault] = {}
        self._stretch = self._count = 0

    def begin(self) -> None:
        """Begin anew: the monitor counts its alarms from 0 again."""
        self._stretch += 1

    def number_of(self, alarm: Alarm) -> int:
        """Return the number of an alarm's fault."""
        return self._faults[self._key(alarm)].number

    def _key(self, alarm: Alarm) -> tuple[int, str, int]:
        """Return what tells its fault from all others: the engine counts its alarms by itself."""
        return self._stretch, WHOLE if alarm.test == WHOLE else "", alarm.number

    def lines(self, told: Iterable[Alarm]) -> list[Line]:
        """Return what is new in some alarms, line by line, in time: the same in however many pieces they are told."""
        lines: list[Line] = []
        for alarm in told:
            if alarm.is_first:
                lines += self._of(alarm)
            else:  # it belongs to a fault that has been told
                fault = self._faults.get(self._key(alarm))
                if fault is not None:
                    fault.alarm = alarm
        return sorted(lines, key=lambda line: line[1])

    def _of(self, raw: Alarm) -> Iterator[Line]:
        key = self._key(raw)
        fault = self._faults.get(key)
        alarm = self._believed([*(of.alarm for at, of in self._faults.items() if at != key), raw])[-1]
        if fault is None:
            if len(self._faults) >= _MOST_FAULTS:
                self._faults.pop(next(iter(self._faults)))
            at_once = sum(judged.time_s <= alarm.time_s for judged in alarm.judgements)
            first = _until(alarm, at_once)
            fault = self._faults[key] = _Fault(number=self._count, alarm=raw)
            self._count += 1
            yield _raised(first)
            if _is_at_once(first):  # which sensors it may be, and no more: the next judgement says more
                fault.named, fault.judged = _name(first), at_once
        for count in range(fault.judged + 1, len(alarm.judgements) + 1):
            now = _until(alarm, count)
            named = _name(now)
            if named is not None and named != fault.named and fault.lines < MOST_LINES - 1:
                fault.named = named
                fault.lines += 1
                yield _named(now)
        fault.alarm, fault.judged = raw, max(fault.judged, len(alarm.judgements))
        if alarm.ended_s is not None and alarm.end_known_s is not None and not fault.has_ended:
            fault.has_ended = True
            what = "calm again" if alarm.doubt or alarm.test == OUTSIDE else "the fault has gone"
            yield LiveKind.ENDED, alarm.end_known_s, f"{what}, since {alarm.ended_s:.2f} s", alarm

    @property
    def left(self) -> list[Alarm]:
        """The faults that something is left of to explain, in time."""
        return [alarm for alarm in self.first if not alarm.has_passed]

    @property
    def first(self) -> list[Alarm]:
        """The first alarm of each fault, in time."""
        told = self._believed([fault.alarm for fault in self._faults.values()])
        return [alarm for alarm in told if alarm.is_first]

    def _believed(self, told: list[Alarm]) -> list[Alarm]:
        """Return alarms as they can be believed, those so far together."""
        if not self._bends:
            return told
        first = [alarm for alarm in told if alarm.is_first and alarm.test != WHOLE]  # the engine knows
        bent = {id(alarm) for alarm, is_bent in zip(first, are_bent(first), strict=True) if is_bent}
        return [alarm.disbelieved(BENT) if id(alarm) in bent else alarm for alarm in told]


def are_bent(faults: Sequence[Alarm]) -> list[bool]:
    """Tell of all faults of a flight so far, by their first alarms, which accuse a sensor but may not be believed.

    An estimator turns a gyro's error into all three angles. A monitor that was calibrated for an attitude of its own
    takes that for faults of other sensors: so the first fault is believed only, and of an angle none.

    >>> first, second = (Alarm(number=k, time_s=10.0 + k, onset_s=10.0 + k, source="pq"[k]) for k in (0, 1))
    >>> are_bent([first, second])
    [False, True]
    """
    left = [alarm for alarm in faults if not alarm.has_passed and alarm.test != MISSING]
    first_s = min((alarm.time_s for alarm in left), default=0.0)
    return [
        alarm.accuses and alarm.test != MISSING and (alarm.time_s > first_s or alarm.sensor in ATTITUDE)
        for alarm in faults
    ]


def _until(alarm: Alarm, count: int) -> Alarm:
    """Return an alarm as it was known after so many judgements."""
    return replace(alarm, judgements=alarm.judgements[:count], ended_s=None, ended_between_s=None, end_known_s=None)


def _raised(alarm: Alarm) -> Line:
    if alarm.test == MISSING:
        text = f"samples of the {sensor_text(alarm.source)} are missing since {alarm.onset_s:.2f} s"
        return LiveKind.ALARM, alarm.time_s, text, alarm
    if alarm.test == WHOLE:
        text = f"{alarm.source} parts from its attitude in all that came last, since about {alarm.onset_s:.0f} s"
        return LiveKind.ALARM, alarm.time_s, text, alarm
    if alarm.test == OUTSIDE:
        text = f"motion beyond what the monitor knows; {alarm.source} isn't judged there"
        return LiveKind.CANNOT_TELL, alarm.time_s, text, alarm
    test = f" ({alarm.test})" if alarm.test else ""
    among = f"; it may be {listed(alarm.candidates, 'or')}" if _is_at_once(alarm) else ""
    text = f"{alarm.source}{test} rose above its threshold; the change began at about {alarm.onset_s:.2f} s{among}"
    return LiveKind.ALARM, alarm.time_s, text, alarm


def _is_at_once(alarm: Alarm) -> bool:
    judged = alarm.last
    return judged is not None and judged.sensor is None and judged.time_s <= alarm.time_s and bool(judged.candidates)


def _name(alarm: Alarm) -> object | None:
    """Return what has to change to be said again; None before the first judgement, and of what names itself."""
    judged = alarm.last
    if judged is None or alarm.test in (MISSING, OUTSIDE):
        return None
    if judged.doubt == BENT:
        return BENT  # once, whatever it would say of its own
    among = judged.sensor or tuple(sorted(judged.candidates))
    return among, judged.kind if judged.failed else None, judged.partner, judged.doubt


def _named(alarm: Alarm) -> Line:
    judged = alarm.last
    assert judged is not None  # it has a name
    kind = LiveKind.NAMED if judged.failed else LiveKind.CANNOT_TELL if judged.candidates else LiveKind.ENDED
    text = judgement_text(judged)
    return kind, judged.time_s, text.removeprefix(UNSURE) if kind == LiveKind.CANNOT_TELL else text, alarm
