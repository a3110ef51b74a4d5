"""Flight logs written by hand, after the formats' public specifications: ULog, DataFlash and MCAP."""

import json
import struct

import numpy as np

ULOG_CODES = {
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
    "int32_t": "i",
    "uint8_t": "B",
    "uint16_t": "H",
    "uint32_t": "I",
}


def ulog_message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog(topics, *, start_us=0, texts=(), settings=None):
    """Return a ULog file; topics: name -> (field declarations like "float xyz[3]", rows that begin with the stamp).

    Texts are (stamp, text); settings are parameters, integers or floats.
    """
    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start_us) + ulog_message("B", bytes(40))
    for name, value in (settings or {}).items():
        key = f"{'int32_t' if isinstance(value, int) else 'float'} {name}".encode()
        packed = struct.pack("<i" if isinstance(value, int) else "<f", value)
        out += ulog_message("P", struct.pack("<B", len(key)) + key + packed)
    for name, (fields, _) in topics.items():
        out += ulog_message("F", f"{name.partition('#')[0]}:{';'.join(['uint64_t timestamp', *fields])};".encode())
    rows = []
    for number, (name, (fields, table)) in enumerate(topics.items()):
        topic, _, instance = name.partition("#")
        out += ulog_message("A", struct.pack("<BH", int(instance or 0), number) + topic.encode())
        codes = "<Q"
        for field in fields:
            kind, _, declared = field.partition(" ")
            kind, _, count = kind.partition("[")
            codes += ULOG_CODES[kind] * int(count.rstrip("]") or 1)
            assert declared
        packer = struct.Struct(codes)
        head = struct.pack("<H", number)
        rows += [(row[0], ulog_message("D", head + packer.pack(int(row[0]), *row[1:]))) for row in table]
    rows += [(stamp, ulog_message("L", struct.pack("<BQ", 3, stamp) + text.encode())) for stamp, text in texts]
    rows.sort(key=lambda row: row[0])
    return out + b"".join(body for _, body in rows)


FMT = struct.Struct("<BB4s16s64s")
DF_CODES = {"Q": "Q", "f": "f", "B": "B", "b": "b", "c": "h", "d": "d", "N": "16s", "Z": "64s", "n": "4s", "H": "H"}
# as ArduPilot writes them: what a unit's and a multiplier's letter means
UNITS = {"s": "s", "E": "rad/s", "o": "m/s/s", "d": "deg", "#": "instance", "-": "", "m": "m"}
SCALES = {"F": 1e-6, "0": 1.0, "-": 0.0}


def dataflash(tables, *, units=None):
    """Return a DataFlash log; tables: name -> (format letters, column names, rows); units: name -> (ids, scales).

    Rows begin with the stamp; one more value than there are letters is a stamp that isn't written.
    """
    units = units or {}
    declared = {"FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns")}
    extra = {
        "UNIT": ("QbZ", "TimeUS,Id,Label", [(0, ord(key), label.encode()) for key, label in UNITS.items()]),
        "MULT": ("Qbd", "TimeUS,Id,Mult", [(0, ord(key), scale) for key, scale in SCALES.items()]),
    }
    tables = {**(extra if units else {}), **tables}
    numbers = {name: 129 + place for place, name in enumerate([*tables, "FMTU"])}
    if units:
        rows = [(0, numbers[name], ids.encode(), scales.encode()) for name, (ids, scales) in units.items()]
        tables = {**tables, "FMTU": ("QBNN", "TimeUS,FmtType,UnitIds,MultIds", rows)}
    declared |= {name: (numbers[name], letters, columns) for name, (letters, columns, _) in tables.items()}
    out = b""
    for name, (number, letters, columns) in declared.items():
        length = 3 + struct.calcsize("<" + "".join(DF_CODES[letter] for letter in letters))
        out += b"\xa3\x95\x80" + FMT.pack(number, length, name.encode(), letters.encode(), columns.encode())
    body = []
    for name, (letters, _, rows) in tables.items():
        packer = struct.Struct("<" + "".join(DF_CODES[letter] for letter in letters))
        head = bytes([0xA3, 0x95, numbers[name]])
        body += [(row[0], head + packer.pack(*row[len(row) - len(letters) :])) for row in rows]
    body.sort(key=lambda row: row[0])
    return out + b"".join(row for _, row in body)


def dataflash_text(tables):
    """Return the same as text, as `mavlogdump` and old ground stations write it."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    for number, (name, (letters, columns, _)) in enumerate(tables.items()):
        lines.append(f"FMT, {129 + number}, 50, {name}, {letters}, {columns}")
    rows = [
        (row[0], f"{name}, {', '.join(map(_word, row[len(row) - len(letters) :]))}")
        for name, (letters, _, table) in tables.items()
        for row in table
    ]
    return "\n".join([*lines, *(text for _, text in sorted(rows)), ""]).encode()


def _word(value):
    return value.decode() if isinstance(value, bytes) else repr(value)


def mcap(path, topics, *, compression=None, schema="", encoding="json"):
    """Write an MCAP file; topics: name -> list of (log time in ns, message: dict or bytes)."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        writer = Writer(file, compression=compression or CompressionType.ZSTD)
        writer.start()
        schema_id = writer.register_schema(schema or "flight", "jsonschema" if encoding == "json" else "ros2msg", b"{}")
        channels = {name: writer.register_channel(name, encoding, schema_id) for name in topics}
        messages = [(stamp, name, message) for name, sent in topics.items() for stamp, message in sent]
        for stamp, name, message in sorted(messages, key=lambda one: one[0]):
            data = message if isinstance(message, bytes) else json.dumps(message).encode()
            writer.add_message(channels[name], stamp, data, stamp)
        writer.finish()


def cdr_imu(stamp_ns, gyro, accel, orientation, *, frame="base_link", order="<"):
    """Return a sensor_msgs/msg/Imu in CDR."""
    body = struct.pack(f"{order}iI", stamp_ns // 10**9, stamp_ns % 10**9)
    body += struct.pack(f"{order}I", len(frame) + 1) + frame.encode() + b"\0"
    body += b"\0" * (-len(body) % 8)
    numbers = [*orientation, *np.zeros(9), *gyro, *np.zeros(9), *accel, *np.zeros(9)]
    return bytes([0, 1 if order == "<" else 0, 0, 0]) + body + struct.pack(f"{order}{len(numbers)}d", *numbers)
