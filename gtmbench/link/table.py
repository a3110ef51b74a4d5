"""Lines of a table as they arrive: a header first, then a row a line, with the names and units of logs.

A line that is no row is passed over and counted, and one that never ends is dropped, so memory stays bounded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.mapping import ChosenColumn, choose, choose_of, split_mapping
from gtmbench.intake.times import time_column
from gtmbench.link.readings import LinkSample
from gtmbench.link.telemetry import Message

_LONGEST = 1 << 16  # bytes of a line
_SINCE_S = 1e8  # stamps beyond count from 1970
_NONE = np.zeros(0)


class TableRows:
    """The rows of a table's lines.

    >>> table = TableRows(["p"])
    >>> end = bytes([10])
    >>> [message.time_s for message in table.read(b"time_s,p_deg_s" + end + b"0.0,1.5" + end + b"0.1,")], table.broken
    ([0.0], 0)
    >>> [message.content for message in table.read(b"2.5" + end + b"no row" + end)], table.broken
    ([(2.5,)], 1)
    """

    unit = "row"
    is_open, is_mixed, refused, others = "", False, 0, ()

    def __init__(self, needs: Sequence[str], wants: Sequence[str] = (), mapping: Sequence[str] = ()) -> None:
        self._needs, self._wants, self._mapping = needs, wants, mapping
        self._rest = b""
        self._skips = False  # the rest of a line that is too long
        self._separator: bytes | None = b","
        self._width = self._time = 0
        self._per_second, self._origin_s = 1.0, math.nan
        self._columns: list[tuple[int, float]] = []  # of each channel: its place, and what its values are multiplied by
        self.channels: tuple[str, ...] = ()
        self.broken = 0
        """Lines that were passed over because they are no rows."""
        self.taken: list[bytes] = []
        """The lines of the last bytes."""

    def read(self, data: bytes, _peer: object = None, *, is_whole: bool = False) -> list[Message]:
        """Return the rows that some bytes complete; with the last of them where they are whole."""
        *lines, self._rest = (self._rest + data + (b"\n" if is_whole else b"")).split(b"\n")
        if self._skips and lines:
            self._skips = False
            lines.pop(0)
        if len(self._rest) > _LONGEST:
            self.broken += not self._skips
            self._rest, self._skips = b"", True
        self.taken = [line.rstrip(b"\r") for line in lines if line.strip()]
        rows = list(self.taken)
        if not self.channels and rows:
            self._open(rows.pop(0))
        return [message for line in rows if (message := self._row(line)) is not None]

    def _open(self, line: bytes) -> None:
        header = line.decode("utf-8-sig", errors="replace").strip().lstrip("#% ")
        separator = max(";\t|,", key=header.count)
        self._separator = separator.encode() if separator in header else None
        names = [name.strip().strip('"') for name in header.split(separator if separator in header else None)]
        if not any(name[:1].isalpha() for name in names):
            raise InputError(
                "the first line that came holds no names; send a header first, such as "
                "time_s,p_deg_s,q_deg_s,r_deg_s,phi_deg,theta_deg,psi_deg"
            )
        raw = RawLog(kind="table", series=tuple(RawSeries(name=name, load=lambda: _NONE) for name in names if name))
        columns = split_mapping(self._mapping)
        series, _, self._per_second = time_column(raw, columns.pop("time", None))
        chosen = choose(raw, columns, self._needs)
        chosen += choose_of([name for name in self._wants if name not in self._needs], raw, columns)
        self._time, self._width = names.index(series.name), len(names)
        self.channels = tuple(choice.channel for choice in chosen)
        self._columns = [(names.index(choice.series.name), _factor(choice)) for choice in chosen]

    def _row(self, line: bytes) -> Message | None:
        cells = line.split(self._separator)
        try:
            if len(cells) < self._width:
                raise ValueError
            time_s = float(cells[self._time]) / self._per_second
            values = tuple(_number(cells[place]) * factor for place, factor in self._columns)
        except ValueError:
            self.broken += 1
            return None
        if not abs(time_s) < 1e11:
            self.broken += 1
            return None
        if math.isnan(self._origin_s):
            self._origin_s = time_s if time_s > _SINCE_S else 0.0
        return Message(topic="", time_s=time_s - self._origin_s, content=values)

    def routes(self, _rates_hz: dict[str, float], needs: Sequence[str], _least_hz: float) -> dict[str, str]:
        """Return the "message" that each channel is read from: the only one."""
        return {name: "" for name in needs if name in self.channels}

    def sample(self, message: Message, channels: Sequence[str]) -> LinkSample | None:
        """Return what a row reads of some channels."""
        values = message.content
        if tuple(channels) != self.channels:
            values = tuple(values[self.channels.index(name)] for name in channels)
        return LinkSample(topic="", time_s=message.time_s, values=values)

    def told(self) -> str:
        """Say what the table holds."""
        return f"it holds {', '.join(self.channels)}"


def _factor(choice: ChosenColumn) -> float:
    """Return what a column's values are multiplied by to be the channel's."""
    if choice.late_s:
        raise InputError(f"--map {choice.channel}: a column that is stamped late (@) isn't read row by row")
    return choice.factor


def _number(cell: bytes) -> float:
    """Return a cell's number; NaN where it is empty."""
    try:
        value = float(cell)
    except ValueError:
        if cell.strip():
            raise
        return math.nan
    return value if abs(value) < 1e100 else math.nan
