"""What known sources write: columns, units, axes and epochs, read from ``source_columns.toml``."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.resources import files

from gtmbench.intake.formats.raw import ANGLES, Meaning, RawLog, RawSeries, euler_deg
from gtmbench.values.clock import FloatArray

_QUATERNION = "quaternion"
_EAST = "90-"  # before a heading that is counted from east
_QUARTER = {"deg": 90.0, "rad": 1.5707963267948966}  # of a turn
_BRACES = re.compile(r"(?P<before>.*?)\{(?P<words>.*)\}(?P<after>.*)")
_PART = re.compile(r"(?i)[\W_]*[w0][\W_]*$")  # what tells a quaternion's first part
_FACT = re.compile(r"\$(\w+)")
_INDEX = re.compile(r"\.0*(\d+)$")  # as PlotJuggler numbers an array's fields
_TABLE = tomllib.loads((files("gtmbench.intake.formats") / "source_columns.toml").read_text(encoding="utf-8"))
NAMES: Mapping[str, str] = _TABLE["names"]
"""The words by which anybody calls a channel."""
Documented = Mapping[tuple[str, str], Meaning]


@dataclass(frozen=True, kw_only=True)
class DialectLine:
    """Columns, and the channels that they are; of a quaternion four columns and three angles."""

    columns: tuple[str, ...]
    meanings: tuple[Meaning, ...]
    from_east: bool = False

    @classmethod
    def of(cls, text: str) -> DialectLine:
        """Read a line of the table.

        >>> line = DialectLine.of("nx ny -nz = IMU.Acc{X,Y,Z} : g")
        >>> line.columns, line.meanings[2].channel, line.meanings[2].sign
        (('IMU.AccX', 'IMU.AccY', 'IMU.AccZ'), 'nz', -1.0)
        """
        channels, _, rest = text.partition(" = ")
        names, _, unit = rest.rpartition(" : ")
        braces = _BRACES.fullmatch(names)
        words = [f"{braces['before']}{each}{braces['after']}" for each in braces["words"].split(",")] if braces else []
        return cls(
            columns=tuple(words or [names]),
            meanings=tuple(
                Meaning(channel=name.removeprefix(_EAST).lstrip("-"), unit=unit, sign=1.0 - 2.0 * ("-" in name))
                for name in channels.split()
            ),
            from_east=_EAST in channels,
        )

    def scaled_by(self, facts: Mapping[str, str]) -> DialectLine:
        """Return a line with the numbers that its unit refers to by name."""
        named = _FACT.match(self.meanings[0].unit)
        if named is None or named[1] not in facts:
            return self
        units = (each.unit.replace(named[0], facts[named[1]]) for each in self.meanings)
        meanings = tuple(replace(each, unit=unit) for each, unit in zip(self.meanings, units, strict=True))
        return replace(self, meanings=meanings)


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """A known source of tables."""

    name: str
    tells: tuple[str, ...]  # the columns that show that a table is the source's
    lines: tuple[DialectLine, ...]  # what its columns are, the preferred ones first
    cells: int = 0  # columns of a table without a header; 0 of one with a header
    rate_hz: float = 0.0  # samples a second where nothing in the table tells; 0 where that isn't documented

    def found_in(self, raw: RawLog) -> bool:
        """Tell whether a log's columns show that it is of this source."""
        if self.cells:
            return raw.is_nameless and len(raw.series) + len(raw.ignored) == self.cells
        facts = {f"${name}" for name in raw.facts}
        return not raw.is_nameless and all(tell in facts or _find(tell, raw.series) for tell in self.tells)

    def told_of(self, raw: RawLog) -> RawLog:
        """Return a log whose columns are known for what they are."""
        series = meant(raw.series, [line.scaled_by(raw.facts) for line in self.lines])
        rate_hz = raw.rate_hz or self.rate_hz
        return replace(raw, series=series, rate_hz=rate_hz, notes=(*raw.notes, f"columns, units and axes: {self.name}"))


@cache
def lines_of(source: str) -> tuple[DialectLine, ...]:
    """Return what a source's messages mean, line by line, the preferred ones first."""
    return tuple(map(DialectLine.of, _TABLE["topics"][source]))


def topics_of(source: str) -> Documented:
    """Return the same by topic and field."""
    return {
        (topic, field): meaning
        for line in lines_of(source)
        for column, meaning in zip(line.columns, line.meanings, strict=True)
        for topic, _, field in [column.partition(".")]
    }


PX4, ARDUPILOT, MAVLINK = map(topics_of, ("PX4", "ArduPilot", "MAVLink"))
ALL = {**PX4, **ARDUPILOT, **MAVLINK}
"""Of messages that anybody may have in a table; Paparazzi's ATTITUDE has other fields."""


@cache
def dialects() -> tuple[Dialect, ...]:
    """Return the known sources of tables."""
    found = []
    for entry in map(dict, _TABLE["dialect"]):
        lines = tuple(map(DialectLine.of, entry.pop("columns")))
        found.append(Dialect(**({"tells": lines[0].columns} | entry), lines=lines))
    return tuple(found)


def with_dialect(raw: RawLog) -> RawLog:
    """Return a log with what its columns are, where a source is known that writes such; else as it is."""
    known = (dialect for dialect in dialects() if not dialect.cells and dialect.found_in(raw)) if raw.by_name else ()
    return next((dialect.told_of(raw) for dialect in known), raw)


def meant(series: Sequence[RawSeries], lines: Iterable[DialectLine]) -> tuple[RawSeries, ...]:
    """Return columns with what some lines say of them, those first; angles of quaternions are added."""
    known: dict[RawSeries, RawSeries] = {}
    made: list[RawSeries] = []
    for line in lines:
        found = [_find(column, series) for column in line.columns]
        if line.meanings[0].unit.endswith(_QUATERNION):
            parts = [each for one in found for each in one[:1]]
            if len(parts) == len(line.columns):
                stem = _PART.sub("", parts[0].name)
                made += angles_of(parts, stem, line.meanings, line.meanings[0].unit, from_east=line.from_east)
            continue
        for columns, meaning in zip(found, line.meanings, strict=True):
            for each in columns:
                if each in known or each.meaning is not None:
                    continue
                if line.from_east and meaning.channel == "psi":
                    made.append(_from_north(each, meaning))
                else:
                    known[each] = replace(each, meaning=meaning)
    return (*known.values(), *made, *(each for each in series if each not in known))


def _find(column: str, series: Iterable[RawSeries]) -> list[RawSeries]:
    """Return the columns of that name, whichever table or topic they are in."""
    end = column.removeprefix("*")
    return [
        each
        for each in series
        for bare in [each.name.removeprefix(f"{each.clock}.") if each.clock else each.name]
        if bare == column or (end != column and bare.endswith(end)) or each.name == column
    ]


def _from_north(column: RawSeries, meaning: Meaning) -> RawSeries:
    """Return a heading that is counted from east, turning left, as it is from north, turning left."""

    def load() -> FloatArray:
        return column.values() - _QUARTER[meaning.unit]

    return replace(column, name=f"{column.name} from north", load=load, meaning=meaning, made_of=(column.name,))


def angles_of(
    parts: Sequence[RawSeries],
    stem: str,
    meanings: Sequence[Meaning | None],
    unit: str = _QUATERNION,
    *,
    from_east: bool = False,
) -> list[RawSeries]:
    """Return roll, pitch and yaw of a quaternion w, x, y, z, in deg, as columns ``STEM(roll)`` and so on.

    `meanings`: of the three. `unit`: ``quaternion``, from the body to the world, or ``inverse quaternion``.
    `from_east`: whether yaw is counted from east and is wanted from north.
    """
    return [
        RawSeries(
            name=f"{stem}({angle})",
            load=partial(_turned, parts, unit, angle, 90.0 * (from_east and angle == "yaw")),
            clock=parts[0].clock,
            unit="" if meaning else "deg",
            meaning=meaning and replace(meaning, unit="deg"),
            made_of=tuple(part.name for part in parts),
        )
        for angle, meaning in zip(ANGLES, meanings, strict=True)
    ]


def _turned(parts: Sequence[RawSeries], unit: str, angle: str, less_deg: float) -> FloatArray:
    w, *vector = (part.values() for part in parts)
    return euler_deg([w, *(vector if unit == _QUATERNION else [-each for each in vector])], angle) - less_deg


def message_of(name: str) -> tuple[str, str]:
    """Return which message's field a column is named by, as converters number and join them.

    >>> message_of("IMU_0.GyrX"), message_of("/fmu/out/sensor_combined.gyro_rad[0]")
    (('IMU', 'GyrX'), ('sensor_combined', 'gyro_rad[0]'))
    >>> message_of("/vehicle_angular_velocity/xyz.00")
    ('vehicle_angular_velocity', 'xyz[0]')
    """
    path = indexed(name)
    topic, _, field = path.rpartition("." if "." in path else "/")
    return re.sub(r"([_\[#]0\]?|_v\d)$", "", re.split(r"[./]", topic)[-1]), field


def indexed(name: str) -> str:
    """Return a column's name with its number in brackets: ``q[0]`` of ``q.00``."""
    return _INDEX.sub(r"[\1]", name)


def documented(name: str) -> Meaning | None:
    """Return what a column is that is named as an autopilot's message and field; None of others."""
    return ALL.get(message_of(name))
