"""What is taken in of a recorded flight: segments without gaps, and remarks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from gtmbench.record import Record


@dataclass(frozen=True, kw_only=True)
class Remark:
    """Something about a log that a reader should know.

    Attributes
    ----------
    kind : str
        ``gap``, ``clock jump``, ``out of order``, ``duplicate``, ``missing``, ``constant``, ``saturated``, ``short``,
        ``sign``.
    channel : str or None
        Which one; None where it is about all of them.
    start_s, end_s : float
        When, on the log's clock.
    text : str
        In words, figures included.
    """

    kind: str
    channel: str | None
    start_s: float
    end_s: float
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightLog:
    """A recorded flight, ready to be watched.

    Attributes
    ----------
    path : Path
    segments : tuple of Record
        The stretches between gaps, in time, all of one sample period and with the same channels; times are the log's.
    remarks : tuple of Remark
        In time.
    method : tuple of str
        What was done to it, line by line: which column became which channel, how it was resampled.
    """

    path: Path
    segments: tuple[Record, ...] = field(repr=False)
    remarks: tuple[Remark, ...]
    method: tuple[str, ...]

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that every segment has."""
        return self.segments[0].channels

    @property
    def sample_period_s(self) -> float:
        """Ts, in seconds."""
        return self.segments[0].sample_period_s
