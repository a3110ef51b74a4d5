"""ArduPilot's DataFlash logs, binary or text: messages as their own FMT, FMTU, UNIT and MULT declare them.

pymavlink knows what format characters, multipliers and units mean. Walking through the file is done here: pymavlink's
readers step through garbage byte by byte with a line of print for each, call themselves, and build an object a message.
"""

from __future__ import annotations

import contextlib
import io
import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.formats.dataflash_events import (
    EVENTS_OF,
    INJECTIONS_OF,
    MessageTable,
    Told,
    dataflash_events,
    dataflash_injections,
)
from gtmbench.intake.formats.dialects import ARDUPILOT
from gtmbench.intake.formats.limits import MOST_MESSAGES, library, quiet, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries, documented_first, in_seconds
from gtmbench.intake.units import unit
from gtmbench.values.clock import FloatArray

Found = TypeVar("Found")
_KIND = "ArduPilot DataFlash log"
_HEAD = b"\xa3\x95"
_FMT = 0x80  # ArduPilot's LogStructure.h: the message that declares messages
_FMT_BODY = struct.Struct("<BB4s16s64s")
_OLD_TEXT = rb"[^\0]{0,400}?\n *FMT, *128, *89, *FMT,"  # firmware and board come first in texts of the early 2010s
_NUMBER = re.compile(rb"\b[0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8}\b")  # of an STM32, behind the board's name
_TEXTS = "anNZ"  # format characters whose values are no numbers
_MOST_INSTANCES = 16  # of a message
_TOO_MANY = f"it has more than {MOST_MESSAGES} messages; cut the log"
_CLOCKS = {"TimeUS": 1e6, "TimeMS": 1e3}  # stamps, and how many are a second
_STEADY = ("IMU", "ATT")  # messages that come again and again: what has no stamp came after the last of these


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    """All messages of one type: rows of a binary log as one array, of a text as its lines."""

    layout: Any  # pymavlink's DFFormat
    rows: NDArray[Any] | list[bytes]
    places: NDArray[np.int64]  # of the rows, in the file

    @cached_property
    def _fields(self) -> list[list[bytes]]:
        return [row.split(b",") for row in self.rows]

    def column(self, name: str) -> NDArray[Any]:
        """Return one column: numbers, scaled as the format character says, or bytes."""
        place = self.layout.columns.index(name)
        text = self.layout.format[place] in _TEXTS
        if isinstance(self.rows, list):
            fields = [row[place].strip() if place < len(row) else b"" for row in self._fields]
            return np.array(fields) if text else np.array([_number(field) for field in fields])
        values = np.ascontiguousarray(self.rows[f"f{place}"])
        factor = self.layout.msg_mults[place]
        return values if text or factor is None else values / round(1.0 / factor)


def read_dataflash(path: Path) -> RawLog:
    """Read an ArduPilot log: a second IMU, or whatever has instances, is ``IMU#1``."""
    pymavlink = library("pymavlink.DFReader", path, _KIND)
    with reading(path, _KIND), quiet():
        content = path.read_bytes()
        tables = (_binary if content.startswith(_HEAD) else _text)(content, pymavlink)
        _set_units(tables)
        topics = {topic: columns for table in tables.values() for topic, columns in _topics(table).items()}
        clocks: dict[str, NDArray[np.float64]] = {}
        notes: tuple[str, ...] = ("units: the log's own, else ArduPilot's documentation; axes forward, right, down",)
        for stamp, per_second in _CLOCKS.items():
            stamps = {topic: columns.pop(stamp).load() for topic, columns in topics.items() if stamp in columns}
            seconds, said = in_seconds(stamps, per_second)
            clocks, notes = clocks | seconds, notes + said
    series = [column for topic, columns in topics.items() if topic in clocks for column in columns.values()]
    if not series:
        raise InputError(f"{path}: no message of this {_KIND} has a time (TimeUS or TimeMS) and values")
    return RawLog(
        kind=_KIND,
        series=documented_first(series, ARDUPILOT),
        clocks=clocks,
        notes=notes,
        by_name=False,
        attitude_from_gyros=True,
        hardware=_hardware(tables),
        events=partial(_told, dataflash_events, EVENTS_OF, path, tables, clocks),
        injections=partial(_told, dataflash_injections, INJECTIONS_OF, path, tables, clocks),
    )


def _hardware(tables: dict[str, _Table]) -> str:
    """Return the processor's number, which ArduPilot states among its messages as it starts; "" of older ones."""
    if "MSG" not in tables or "Message" not in tables["MSG"].layout.columns:
        return ""
    for text in tables["MSG"].column("Message").tolist():
        if isinstance(text, bytes) and (found := _NUMBER.search(text)):
            return found[0].decode()
    return ""


def _told(
    find: Callable[[Told], list[Found]],
    names: Sequence[str],
    path: Path,
    tables: dict[str, _Table],
    clocks: dict[str, FloatArray],
) -> list[Found]:
    """Return what is found in the messages of some types, those of the second instance as ``XKF4#1``."""
    with reading(path, _KIND):
        messages = {
            f"{name}#{instance}" if instance else name: _messages(tables, name, instance, clocks)
            for name in names
            if name in tables
            for instance in _instances(tables[name])
        }
        return find(messages)


def _instances(table: _Table) -> list[int]:
    if table.layout.instance_field not in table.layout.columns:
        return [0]
    return [int(number) for number in np.unique(table.column(table.layout.instance_field))[:_MOST_INSTANCES]]


def _messages(tables: dict[str, _Table], name: str, instance: int, clocks: dict[str, FloatArray]) -> MessageTable:
    """Return a type's messages with their times, of one instance; old logs stamp few types, but keep order."""
    table = tables[name]
    rows: NDArray[Any] | slice = slice(None)
    if table.layout.instance_field in table.layout.columns:
        rows = table.column(table.layout.instance_field) == instance
    time_s = clocks.get(f"{name}#{instance}" if instance else name)
    if time_s is None:
        time_s = _times_of(table.places[rows], tables, clocks)
    return MessageTable(
        time_s=time_s,
        names=tuple(table.layout.columns),
        column=lambda column: _part(partial(table.column, column), rows)(),
    )


def _times_of(places: NDArray[np.int64], tables: dict[str, _Table], clocks: dict[str, FloatArray]) -> FloatArray:
    """Return when messages without stamps came, by what stands before them; NaN where nothing steady is there."""
    for name in _STEADY:
        if name in clocks and len(clocks[name]) == len(tables[name].places):
            before = np.searchsorted(tables[name].places, places) - 1
            return clocks[name][np.maximum(before, 0)]
    return np.full(len(places), np.nan)


def _binary(content: bytes, pymavlink: ModuleType) -> dict[str, _Table]:
    layouts: dict[int, Any] = {}
    sizes, places = {_FMT: 3 + _FMT_BODY.size}, {_FMT: list[int]()}
    place, messages = 0, 0
    while 0 <= place <= len(content) - 3:
        kind = content[place + 2]
        size = sizes.get(kind, 0) if content[place : place + 2] == _HEAD else 0
        if not size or place + size > len(content):
            place = content.find(_HEAD, place + 1)
            continue
        messages += 1
        if messages > MOST_MESSAGES:
            raise InputError(_TOO_MANY)
        if kind == _FMT:
            number, length, name, form, columns = _FMT_BODY.unpack_from(content, place + 3)
            if number not in layouts and length > 3:
                layout = _layout(pymavlink, number, length, *map(_word, (name, form, columns)))
                if layout is not None and struct.calcsize(layout.msg_struct) == length - 3:
                    layouts[number], sizes[number] = layout, length
                    places.setdefault(number, [])
        places[kind].append(place)
        place += size
    octets = np.frombuffer(content, dtype=np.uint8)
    return {
        layout.name: _Table(
            layout=layout, rows=_rows(octets, places[number], layout, pymavlink), places=np.array(places[number])
        )
        for number, layout in layouts.items()
        if places[number]
    }


def _rows(octets: NDArray[np.uint8], places: list[int], layout: Any, pymavlink: ModuleType) -> NDArray[Any]:
    codes = [pymavlink.FORMAT_TO_STRUCT[letter][0] for letter in layout.format]
    dtype = np.dtype([(f"f{i}", f"S{code[:-1]}" if code[-1] == "s" else f"<{code}") for i, code in enumerate(codes)])
    bodies = np.lib.stride_tricks.sliding_window_view(octets, dtype.itemsize)[np.array(places) + 3]
    rows: NDArray[Any] = bodies.view(dtype)[:, 0]
    return rows


def _text(content: bytes, pymavlink: ModuleType) -> dict[str, _Table]:
    layouts: dict[str, Any] = {}
    lines: dict[str, list[bytes]] = {}
    places: dict[str, list[int]] = {}
    for number, line in enumerate(io.BytesIO(content)):
        if number > MOST_MESSAGES:
            raise InputError(_TOO_MANY)
        name, _, rest = line.partition(b",")
        word = _word(name)
        if word in layouts:
            lines[word].append(rest)
            places[word].append(number)
        elif word == "FMT" and rest.count(b",") >= 4:
            kind, length, declared, form, columns = (_word(text) for text in rest.split(b",", 4))
            layout = _layout(pymavlink, int(kind), int(length), declared, form, columns.replace(" ", ""))
            if layout is not None and declared != "FMT":
                layouts[declared], lines[declared] = layout, lines.get(declared, [])
                places.setdefault(declared, [])
    return {
        name: _Table(layout=layout, rows=lines[name], places=np.array(places[name]))
        for name, layout in layouts.items()
        if lines[name]
    }


def _layout(pymavlink: ModuleType, number: int, length: int, name: str, form: str, columns: str) -> Any:
    if len(form) != len(columns.split(",")) or set(form) - set(pymavlink.FORMAT_TO_STRUCT):
        return None  # a broken message
    return pymavlink.DFFormat(number, name, length, form, columns)


def _set_units(tables: dict[str, _Table]) -> None:
    """Give the layouts the units, multipliers and instances that the log itself declares."""
    if not {"FMTU", "UNIT", "MULT"} <= set(tables):
        return
    labels = dict(zip(_letters(tables["UNIT"]), map(_word, tables["UNIT"].column("Label")), strict=True))
    factors = [float(f"{factor:.7g}") for factor in tables["MULT"].column("Mult")]
    multipliers = dict(zip(_letters(tables["MULT"]), factors, strict=True))
    by_number = {table.layout.type: table.layout for table in tables.values()}
    declared = tables["FMTU"]
    for number, units, scales in zip(*map(declared.column, ("FmtType", "UnitIds", "MultIds")), strict=True):
        layout = by_number.get(int(number))
        if layout is not None:
            with contextlib.suppress(IndexError, ValueError, KeyError):  # of one broken message
                layout.set_unit_ids(_word(units), labels)
                layout.set_mult_ids(_word(scales).ljust(len(layout.columns)), multipliers)


def _letters(table: _Table) -> list[str]:
    return [chr(int(number) & 0xFF) for number in table.column("Id")]


def _topics(table: _Table) -> dict[str, dict[str, RawSeries]]:
    """Return a table's columns of numbers, apart for every instance of what was measured."""
    layout = table.layout
    instances: dict[str, NDArray[Any] | slice] = {layout.name: slice(None)}
    numbers = [name for letter, name in zip(layout.format, layout.columns, strict=True) if letter not in _TEXTS]
    if layout.instance_field in numbers:
        which = table.column(layout.instance_field)
        numbered = np.unique(which)[:_MOST_INSTANCES]
        instances = {f"{layout.name}#{number:g}" if number else layout.name: which == number for number in numbered}
    return {
        topic: {
            name: RawSeries(
                name=f"{topic}.{name}",
                load=_part(partial(table.column, name), rows),
                clock=topic,
                unit=(stated := layout.get_unit(name)),
                meaning=meaning and (replace(meaning, unit=stated) if unit(stated) else meaning),
            )
            for name in numbers
            for meaning in [ARDUPILOT.get((topic, name))]
        }
        for topic, rows in instances.items()
    }


def _part(load: Callable[[], NDArray[Any]], rows: NDArray[Any] | slice) -> Callable[[], NDArray[Any]]:
    return lambda: load()[rows]


def _word(text: bytes) -> str:
    return bytes(text).split(b"\0")[0].decode("latin-1").strip()


def _number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


FORMAT = Format(
    name="ArduPilot DataFlash (.bin, .log)",
    magic=(_HEAD, b"FMT,"),
    pattern=_OLD_TEXT,
    suffixes=(".bin",),
    read=read_dataflash,
)
