"""What a watch says on the link itself: STATUSTEXT, which every ground station shows, once a state; nothing else.

`request` is the one exception, and only where it is asked for: it asks the autopilot how often it sends.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from gtmbench.checks import printable
from gtmbench.link.events import LiveEvent, LiveKind
from gtmbench.link.packets import dialect
from gtmbench.link.readings import MOTION

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
