"""Bags of ROS 1 and of ROS 2, read by rosbags: messages of ROS's own types, and of those that the bag defines.

Rosbags makes Python of definitions. Nothing in a file is run: of a bag's definitions it gets the names and types of
fields only, and only where all of them are plain words.
"""

from __future__ import annotations

import keyword
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.intake.formats.dialects import lines_of, meant
from gtmbench.intake.formats.limits import MOST_MESSAGES, MOST_UNPACKED_BYTES, Arrays, read_apart, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries, in_seconds

IMU_SCHEMAS = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
NOTE = "sensor_msgs/Imu: units and axes of REP 103 (forward, left, up), turned to forward, right, down"
ORIENTATION = tuple(f"orientation.{axis}" for axis in "xyzw")
Load = Callable[[], NDArray[np.float64]]


def topic_series(topic: str, columns: Mapping[str, Load], *, is_imu: bool) -> list[RawSeries]:
    """Return a topic's columns; of an Imu's with what they mean, and the angles of its orientation."""
    series = [
        RawSeries(name=f"{topic}.{field}", load=load, clock=topic)
        for field, load in columns.items()
        if not field.startswith("header.stamp.")
    ]
    return [*meant(series, lines_of("ROS"))] if is_imu else series


_STAMP = "header.stamp"
_DEPTH = 5  # of messages in messages
_MOST_BESIDE = 4  # numbers of an array that becomes columns: a quaternion's
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_PX4 = "px4_msgs/msg/"
_SQLITE = b"SQLite format 3\0"
_FIELD = "\t"  # between a topic and its field


def read_rosbag(path: Path, part: str = "") -> RawLog:
    """Read a bag: every topic with its own stamps, a field is ``topic.field``; a part is a topic."""
    kind = "ROS bag"
    facts, arrays = read_apart("rosbag", "rosbags", path, kind)
    types, left_out = facts["types"], facts["left_out"]
    with reading(path, kind):
        if part:
            types = {topic: kind for topic, kind in types.items() if topic.strip("/") == part.strip("/")}
        if not types:
            of = f"topic '{part}'" if part else "message of numbers whose type is known"
            others = f"; left out are {listed([f'{topic} ({kind})' for topic, kind in left_out.items()][:8])}"
            raise InputError(f"it has no {of}{others if left_out else ''}")
    topics: dict[str, dict[str, np.ndarray]] = {topic: {} for topic in types}
    for name, values in arrays.items():
        topic, _, field = name.partition(_FIELD)
        if topic in topics:
            topics[topic][field] = values
    is_px4 = all(kind.startswith(_PX4) for kind in types.values())
    if is_px4:  # its stamps are in microseconds
        for columns in topics.values():
            columns[_STAMP] = columns.get("timestamp", np.zeros(1)).astype(np.int64) * 1000
    measured = [topic for topic, columns in topics.items() if _STAMP in columns and columns[_STAMP].all()]
    stamps = {topic: columns[_STAMP if topic in measured else ""] for topic, columns in topics.items()}
    clocks, since = in_seconds(stamps, 1e9)
    imu, notes = _imu(types, topics)
    series: list[RawSeries] = []
    for topic, columns in topics.items():
        loads = {field: partial(np.asarray, values) for field, values in columns.items() if field not in ("", _STAMP)}
        series += topic_series(topic, loads, is_imu=topic in imu)
    recorded = [topic for topic in topics if topic not in measured]
    own = "stamps: the messages' timestamp" if is_px4 else "stamps: header.stamp"
    notes += [*([own] if measured else []), *since]
    if recorded:
        notes.append(f"stamps: when messages were recorded, of {listed(recorded[:12])}")
    if left_out:
        notes.append(f"left out: {listed([f'{topic} ({kind})' for topic, kind in left_out.items()][:12])}")
    return RawLog(
        kind=facts["kind"], series=tuple(series), clocks=clocks, notes=tuple(notes), attitude_from_gyros=is_px4
    )


def _imu(types: dict[str, str], topics: dict[str, dict[str, np.ndarray]]) -> tuple[list[str], list[str]]:
    """Return the Imu topics that are believed, and notes: of several, those whose orientation moves."""
    imus = [topic for topic, kind in types.items() if kind in IMU_SCHEMAS]
    turning = [topic for topic in imus if any(np.ptp(topics[topic][name]) > 0 for name in ORIENTATION)]
    notes = [NOTE] if imus else []
    if turning and len(turning) < len(imus):
        still = [topic for topic in imus if topic not in turning]
        notes.append(f"{listed(still)}: the orientation stands still, so {listed(turning)} is taken")
    return turning or imus, notes


def arrays(path: str) -> tuple[dict[str, Any], Arrays]:
    """Return a bag's numbers by topic and field, stamps among them; in a process of its own."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.typesys import Stores, get_typestore

    is_first = Path(path).suffix.lower() == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    decoded = store.deserialize_ros1 if is_first else store.deserialize_cdr
    columns: dict[str, list[array[Any]]] = {}
    stamps: dict[str, array[int]] = {}
    fields: dict[str, tuple[list[str], Callable[[Any], Any]]] = {}
    counts: Counter[str] = Counter()
    size = 0
    with (Reader1 if is_first else Reader2)(Path(path)) as reader:
        types = {each.topic: each.msgtype for each in reader.connections}
        for connection in reader.connections:
            define(store, connection.msgtype, connection.msgdef.data, connection.msgdef.format.name)
        for topic, kind in types.items():
            told = numbers_of(store, kind)
            if told is not None:
                fields[topic] = told
                columns[topic], stamps[topic] = [array("d") for _ in told[0]], array("q")
        known = [each for each in reader.connections if each.topic in fields]
        for connection, stamp_ns, data in reader.messages(connections=known) if known else ():
            size += len(data)
            counts[connection.topic] += 1
            if size > MOST_UNPACKED_BYTES or counts.total() > MOST_MESSAGES:
                raise InputError("it holds more messages than any log; cut it")
            values = fields[connection.topic][1](decoded(data, connection.msgtype))
            stamps[connection.topic].append(stamp_ns)
            for column, value in zip(columns[connection.topic], values, strict=False):
                column.append(value)
    found: Arrays = {}
    for topic in (topic for topic in fields if stamps[topic]):
        of = dict(zip(fields[topic][0], map(np.asarray, columns[topic]), strict=True))
        found[topic + _FIELD] = np.asarray(stamps[topic])
        seconds = of.pop(f"{_STAMP}.sec", None)
        if seconds is not None:
            nanoseconds = of.pop(f"{_STAMP}.nanosec")
            found[f"{topic}{_FIELD}{_STAMP}"] = seconds.astype(np.int64) * 10**9 + nanoseconds.astype(np.int64)
        found |= {f"{topic}{_FIELD}{field}": values for field, values in of.items()}
    read = {topic: types[topic] for topic in fields if stamps[topic]}
    left_out = {topic: kind for topic, kind in types.items() if topic not in read}
    return {"types": read, "left_out": left_out, "kind": "ROS 1 bag" if is_first else "ROS 2 bag"}, found


def define(store: Any, kind: str, text: str, language: str) -> None:
    """Let a store know a type by its definition in a file, unless it knows it, or the definition isn't plain."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if kind in store.fielddefs or language not in ("MSG", "IDL"):
        return
    with suppress(Exception):  # rosbags raises nearly anything on garbage
        told = get_types_from_msg(text, kind) if language == "MSG" else get_types_from_idl(text)
        words = [word for name, (_, own) in told.items() for word in (*name.split("/"), *(field for field, _ in own))]
        if all(_WORD.fullmatch(word) and not keyword.iskeyword(word) for word in words):
            store.register({name: ([], own) for name, (_, own) in told.items() if name not in store.fielddefs})


def numbers_of(store: Any, kind: str) -> tuple[list[str], Callable[[Any], Sequence[float]]] | None:
    """Return the names of a type's numbers, and what gets them of a message; None where it isn't known, or has none."""
    told = list(_numbers(store, kind, "", 0)) if kind in store.fielddefs else []
    if not told or None in told:
        return None
    places = [each for each in told if each is not None]
    get = attrgetter(*(path for path, _ in places), places[0][0])  # of two it is always a tuple
    if all(count == 0 for _, count in places):
        return [path for path, _ in places], get
    names = [name for path, count in places for name in ([f"{path}[{k}]" for k in range(count)] if count else [path])]
    return names, lambda message: np.hstack(get(message)).tolist()


def _numbers(store: Any, kind: str, before: str, depth: int) -> Iterator[tuple[str, int] | None]:
    """Give where a message's numbers stand, and how many there are of an array, 0 of one; None of lists without end."""
    for name, (node, what) in store.fielddefs[kind][1]:
        if node.name == "BASE":
            if what[0] not in ("string", "wstring"):
                yield before + name, 0
        elif node.name == "NAME" and depth < _DEPTH:
            yield from _numbers(store, what, f"{before}{name}.", depth + 1)
        elif node.name == "ARRAY" and what[0][0].name == "BASE" and what[1] <= _MOST_BESIDE:
            yield before + name, what[1]
        elif node.name == "SEQUENCE":
            yield None


def is_bag_folder(path: Path) -> bool:
    """Tell whether a folder is a ROS 2 bag."""
    return (path / "metadata.yaml").is_file()


FORMAT = Format(
    name="ROS bag (.bag, .db3)",
    magic=(b"#ROSBAG V2", _SQLITE),
    suffixes=(".bag", ".db3"),
    read=read_rosbag,
    has_parts=True,
    is_folder=is_bag_folder,
)
