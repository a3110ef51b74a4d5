"""MCAP: messages of JSON and of ROS 2 (CDR, decoded by rosbags), an Imu's in aircraft axes, unpacked under limits."""

from __future__ import annotations

import importlib.util
import json
import mmap
import struct
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import (
    LARGEST_CHUNK_BYTES,
    LONGEST_LINE_BYTES,
    MOST_COLUMNS,
    MOST_MESSAGES,
    MOST_UNPACKED_BYTES,
    check_values,
    library,
    quiet,
    reading,
)
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries, in_seconds
from gtmbench.intake.formats.rosbag import IMU_SCHEMAS, NOTE, define, numbers_of, topic_series

_DEPTH = 8  # of objects in objects
_NO_MESSAGE = (ValueError, struct.error, RecursionError)  # json's and Unicode's errors are ValueErrors

Decode = Callable[[bytes], dict[str, float]]

_SEC, _NANOSEC = "header.stamp.sec", "header.stamp.nanosec"


@dataclass(kw_only=True, eq=False)
class _Topic:
    """What was collected of a topic, column by column."""

    imu: bool
    stamps: array[int] = field(default_factory=lambda: array("q"))
    columns: dict[str, array[float]] = field(default_factory=dict)

    def add(self, stamp_ns: int, values: Mapping[str, float]) -> int:
        """Add a message; return by how many values the columns grew."""
        before, grown = len(self.stamps), 0
        for name, value in values.items():
            column = self.columns.setdefault(name, array("d"))
            grown += before + 1 - len(column)
            column.extend([np.nan] * (before - len(column)))
            column.append(value)
        self.stamps.append(stamp_ns)
        return grown

    def column(self, name: str) -> NDArray[np.float64]:
        values = np.full(len(self.stamps), np.nan)
        values[: len(self.columns[name])] = self.columns[name]
        return values


def read_mcap(path: Path) -> RawLog:
    """Read an MCAP file: every topic with its own stamps, a field is ``topic.field``."""
    kind = "MCAP file"
    mcap = library("mcap.stream_reader", path, kind)
    library("mcap.records", path, kind)
    topics: dict[str, _Topic] = {}
    left_out: dict[str, int] = {}
    notes: list[str] = []
    with reading(path, kind), quiet(), path.open("rb") as file:
        records = _records(mcap, file, notes)
        _collect(records, topics, left_out)
    if left_out:
        notes.append("left out: " + ", ".join(f"{count} messages ({what})" for what, count in left_out.items()))
    if not topics:
        why = notes[-1] if notes else "it has no messages"
        raise InputError(f"{path}: nothing to read; {why}; read are json and ROS 2's messages (cdr)")
    stamps, said = _stamps(topics)
    clocks, since = in_seconds(stamps, 1e9)
    series: list[RawSeries] = []
    for name, topic in topics.items():
        loads = {field: partial(topic.column, field) for field in topic.columns}
        series += topic_series(name, loads, is_imu=topic.imu)
    if any(topic.imu for topic in topics.values()):
        notes.append(NOTE)
    return RawLog(kind="MCAP", series=tuple(series), clocks=clocks, notes=(*notes, *said, *since))


def _records(mcap: Any, file: IO[bytes], notes: list[str]) -> Iterator[Any]:
    """Give the records of a file; where it is cut short or broken, those that stand before."""
    unpacked, given = 0, 0
    # a mapped file's read() never asks for more than is there
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        reader = mcap.StreamReader(content, emit_chunks=True, record_size_limit=len(content))
        try:
            for record in reader.records:
                parts = [record]
                if isinstance(record, mcap.Chunk):
                    plain = _unpacked(record)
                    unpacked += len(plain)
                    if unpacked > MOST_UNPACKED_BYTES:
                        raise InputError(f"it unpacks to more than {MOST_UNPACKED_BYTES} bytes; cut the log")
                    parts = mcap.breakup_chunk(replace(record, compression="", data=plain))
                for part in parts:
                    yield part
                    given += isinstance(part, mcap.Message)
        except InputError:
            raise
        except Exception as error:
            if not given:
                raise
            notes.append(f"the file is broken or cut short after {given} messages ({type(error).__name__})")


def _unpacked(chunk: Any) -> bytes:
    """Unpack a chunk, but not without end."""
    limit = LARGEST_CHUNK_BYTES
    if chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=limit).stream_reader(chunk.data) as stream:
            plain: bytes = stream.read(limit + 1)
    elif chunk.compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped,unused-ignore]

        plain = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=limit + 1)
    elif chunk.compression:
        raise InputError(f"a chunk is compressed as '{chunk.compression[:20]}'; read are zstd and lz4")
    else:
        plain = chunk.data
    if len(plain) > limit:
        raise InputError(f"a chunk unpacks to more than {limit} bytes; nobody logs like that")
    return plain


def _collect(records: Iterator[Any], topics: dict[str, _Topic], left_out: dict[str, int]) -> None:
    schemas: dict[int, Any] = {}
    decoders: dict[int, Decode | None] = {}
    channels: dict[int, Any] = {}
    messages, grown, columns = 0, 0, 0
    for record in records:
        kind = type(record).__name__
        if kind == "Schema":
            schemas[record.id] = record
        elif kind == "Channel":
            channels[record.id] = record
        elif kind == "Message":
            messages += 1
            if messages > MOST_MESSAGES:
                raise InputError(f"it has more than {MOST_MESSAGES} messages; cut the log")
            channel = channels.get(record.channel_id)
            if channel is None:
                left_out["of no channel"] = left_out.get("of no channel", 0) + 1
                continue
            told = schemas.get(channel.schema_id)
            schema = told.name if told else ""
            if channel.message_encoding == "cdr" and told is not None and channel.schema_id not in decoders:
                decoders[channel.schema_id] = _decoder(told)
            decode = decoders.get(channel.schema_id)
            values, why_not = _decoded(record.data, channel.message_encoding, schema, decode)
            if values is None:
                left_out[why_not] = left_out.get(why_not, 0) + 1
                continue
            topic = topics.setdefault(channel.topic, _Topic(imu=schema in IMU_SCHEMAS))
            columns -= len(topic.columns)
            grown += topic.add(min(record.log_time, 2**63 - 1), values)
            columns += len(topic.columns)
            check_values(grown, "its messages")
            if columns > MOST_COLUMNS:
                raise InputError(f"its messages have more than {MOST_COLUMNS} fields; no log has so many")


def _decoder(schema: Any) -> Decode | None:
    """Return what decodes messages of a type of ROS, or of one that the file defines; None where nothing can."""
    if importlib.util.find_spec("rosbags") is None:
        return None
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    language = {"ros2msg": "MSG", "ros2idl": "IDL"}.get(schema.encoding, "")
    define(store, schema.name, schema.data.decode("utf-8", errors="replace"), language)
    told = numbers_of(store, schema.name)
    if told is None:
        return None
    names, get = told

    def decode(data: bytes) -> dict[str, float]:
        return dict(zip(names, get(store.deserialize_cdr(data, schema.name)), strict=False))

    return decode


def _decoded(data: bytes, encoding: str, schema: str, decode: Decode | None) -> tuple[dict[str, float] | None, str]:
    if len(data) > LONGEST_LINE_BYTES:
        return None, f"{encoding[:30]} of more than {LONGEST_LINE_BYTES} bytes"
    try:
        if encoding == "json":
            columns: dict[str, float] = {}
            _flatten("", json.loads(data), columns, 0)
            return columns, ""
        if encoding == "cdr" and decode is not None:
            return decode(data), ""
    except _NO_MESSAGE:
        return None, f"broken {encoding}"
    except Exception as error:
        if type(error).__module__.startswith("rosbags"):
            return None, f"broken {encoding}"
        raise
    return None, f"{encoding[:30]} {schema[:60]}".strip()


def _flatten(name: str, value: Any, columns: dict[str, float], depth: int) -> None:
    if isinstance(value, (int, float)):
        if len(columns) < MOST_COLUMNS:
            columns[name or "value"] = float(value) if abs(value) < 1e300 else np.nan
    elif depth < _DEPTH and isinstance(value, dict):
        for key, part in value.items():
            _flatten(f"{name}.{key}" if name else str(key), part, columns, depth + 1)
    elif depth < _DEPTH and isinstance(value, list):
        for place, part in enumerate(value[:64]):  # items of a list become columns
            _flatten(f"{name}[{place}]", part, columns, depth + 1)


def _stamps(topics: Mapping[str, _Topic]) -> tuple[dict[str, NDArray[np.int64]], tuple[str, ...]]:
    """Return when messages were measured, if all topics tell, else when they were logged."""
    if all({_SEC, _NANOSEC} <= set(topic.columns) for topic in topics.values()):
        measured = {}
        for name, topic in topics.items():
            sec, nanosec = topic.column(_SEC), topic.column(_NANOSEC)
            whole = np.isfinite(sec) & np.isfinite(nanosec) & (np.abs(sec) < 1e9 * 9)
            measured[name] = np.where(whole, sec, 0).astype(np.int64) * 10**9 + np.where(whole, nanosec, 0).astype(
                np.int64
            )
        return measured, ("stamps: header.stamp",)
    return {name: np.array(topic.stamps, dtype=np.int64) for name, topic in topics.items()}, (
        "stamps: when messages were logged",
    )


FORMAT = Format(name="MCAP", magic=(b"\x89MCAP0\r\n",), suffixes=(".mcap",), read=read_mcap)
