"""What a live watch says, one value an event, and what it says of that on the link itself: STATUSTEXT, once a state.

`Saying.request` is the one exception, and only where it is asked for: it asks the autopilot how often it sends.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from gtmbench.checks import printable
from gtmbench.detectors.alarm import Alarm
from gtmbench.files.plain import attributes
from gtmbench.link.packets import MOTION, dialect


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
_APART_S = 1.0
_COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
_SAID = {
    LiveKind.WATCHING: 6,
    LiveKind.ALARM: 4,
    LiveKind.NAMED: 2,
    LiveKind.ENDED: 5,
    LiveKind.CANNOT_TELL: 4,
}  # MAV_SEVERITY: info, warning, critical, notice
_SET_MESSAGE_INTERVAL = 511


class Saying:
    """Sends a heartbeat every second, and what is new, on a link.

    `system`: the watched system, whose ground station is to show it.
    """

    def __init__(self, send: Callable[[bytes], None], system: int) -> None:
        self._send, self._mavlink = send, dialect()
        self._sender = self._mavlink.MAVLink(None, srcSystem=system, srcComponent=_COMPONENT)
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
            self._pack(self._mavlink.MAVLink_command_long_message(system, 1, _SET_MESSAGE_INTERVAL, 0, *fields))

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
