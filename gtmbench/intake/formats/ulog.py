"""PX4's ULog, read by pyulog under a limit on the work that a file can make."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event
from gtmbench.intake.formats.dialects import PX4
from gtmbench.intake.formats.limits import MOST_COLUMNS, MOST_MESSAGES, check_values, library, quiet, reading
from gtmbench.intake.formats.raw import ANGLES, Format, RawLog, RawSeries, documented_first, euler_deg, in_seconds
from gtmbench.intake.formats.ulog_events import Clocks, Topics, ulog_complaints, ulog_events, ulog_injections


class _TooMuchWork(Exception):  # noqa: N818 - no ValueError: pyulog goes on after those
    """A broken file would be read again and again, or declares more than any log has."""


class _Counted:
    """A file that may be read a few times over, and no more: on garbage pyulog steps back for ever."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file = file
        self._bytes_left = 10 * size + (1 << 22)
        self._reads_left = min(2 * MOST_MESSAGES, self._bytes_left)

    def read(self, count: int) -> bytes:
        self._bytes_left -= count
        self._reads_left -= 1
        if min(self._bytes_left, self._reads_left) < 0:
            raise _TooMuchWork("it is broken, or has more messages than any log")
        return self._file.read(count)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        """Leave the file to who opened it."""


def _bounded(pyulog: ModuleType) -> Any:
    """Return pyulog's reader, but with a limit on the fields that a file can declare."""
    left = 20 * MOST_COLUMNS

    class Subscription(pyulog.ULog._MessageAddLogged):  # type: ignore[name-defined,misc]
        def _parse_nested_type(self, *arguments: Any) -> None:
            nonlocal left
            before = len(self.field_data)
            super()._parse_nested_type(*arguments)
            left -= 1 + len(self.field_data) - before
            if left < 0:
                raise _TooMuchWork("it declares more fields than any log has")

    class Reader(pyulog.ULog):  # type: ignore[name-defined,misc]
        _MessageAddLogged = Subscription

    return Reader


def read_ulog(path: Path) -> RawLog:
    """Read a PX4 log: every topic with its own stamps; a second instance of a topic is ``topic#1``."""
    kind = "PX4 ULog"
    core = library("pyulog.core", path, kind)
    with reading(path, kind), quiet(), path.open("rb") as file:
        log = _bounded(core)(_Counted(file, path.stat().st_size))
    topics = {}
    for topic in log.data_list:
        name = f"{topic.name}#{topic.multi_id}" if topic.multi_id else str(topic.name)
        fields = {field: values for field, values in topic.data.items() if not field.startswith("_padding")}
        if "timestamp" in fields and len(fields["timestamp"]):
            topics[name] = fields
    check_values(sum(len(fields["timestamp"]) for fields in topics.values()), "its stamps")
    clocks, notes = in_seconds({name: _stamps(fields) for name, fields in topics.items()}, 1e6)
    series = [column for name, fields in topics.items() for column in _columns(name, fields)]
    if log.file_corruption:
        notes = (*notes, "parts of the file are broken and were passed over")
    return RawLog(
        kind=kind,
        series=documented_first(series, PX4),
        clocks=clocks,
        notes=("units and axes are those of PX4's message definitions", *notes),
        by_name=False,
        attitude_from_gyros=True,
        hardware=str(log.msg_info_dict.get("sys_uuid", "")),
        events=functools.partial(
            _events, topics, clocks, [(said.timestamp, said.message) for said in log.logged_messages]
        ),
        injections=functools.partial(ulog_injections, topics, clocks),
    )


def _events(topics: Topics, clocks: Clocks, said: Sequence[tuple[int, str]]) -> list[Event]:
    """Return what the autopilot logged of itself; texts' stamps are on the topics' clock, unless that is an epoch's."""
    messages = [(stamp / 1e6, text) for stamp, text in said]
    return [*ulog_events(topics, clocks), *ulog_complaints(topics, clocks, messages)]


def _stamps(fields: dict[str, NDArray[Any]]) -> NDArray[Any]:
    """Return when a topic was sampled, or published where that isn't logged."""
    sampled = fields.get("timestamp_sample")
    chosen = fields["timestamp"] if sampled is None or not np.all(sampled) else sampled
    return chosen.astype(np.int64) if chosen.max() < 2**63 else chosen.astype(np.float64)


def _columns(topic: str, fields: dict[str, NDArray[Any]]) -> list[RawSeries]:
    columns = {
        name: functools.partial(np.asarray, values) for name, values in fields.items() if "timestamp" not in name
    }
    if all(f"q[{part}]" in fields for part in range(4)):
        parts = [fields[f"q[{part}]"] for part in range(4)]
        columns |= {f"q({angle})": functools.partial(euler_deg, parts, angle) for angle in ANGLES}
    return [
        RawSeries(name=f"{topic}.{name}", load=load, clock=topic, meaning=PX4.get((topic, name)))
        for name, load in columns.items()
    ]


FORMAT = Format(name="PX4 ULog", magic=(b"ULog\x01\x12\x35",), suffixes=(".ulg", ".ulog"), read=read_ulog)
