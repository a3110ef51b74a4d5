"""What a live watch says: one value an event, with the time at which it could be known and when it was said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from gtmbench.detectors.alarm import Alarm


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
            "time_s": self.time_s,
            "arrived_s": self.arrived_s,
            "said_s": self.said_s,
            "fault": self.fault,
            "onset_s": None if self.alarm is None else self.alarm.onset_s,
            "ended_s": None if self.alarm is None else self.alarm.ended_s,
            "sensor": None if judged is None else judged.sensor,
            "candidates": [] if judged is None else list(judged.candidates),
            "fault_kind": None if judged is None else judged.kind,
            "parameters": {} if judged is None else dict(judged.parameters),
        }
