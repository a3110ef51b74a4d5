"""What a history keeps of a flight: the constants that its judging learnt, by kinds, and whose they are; and its file.

The file has a row a constant, of all flights of all airframes that were entered; it is Parquet, sealed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from gtmbench.checks import one_line
from gtmbench.engine.course.course import OF_WHITE
from gtmbench.engine.equation import Equation, rows_per_chunk
from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.engine.judged import Judged
from gtmbench.engine.relation import BETWEEN
from gtmbench.engine.sums import WindowSums
from gtmbench.errors import InputError
from gtmbench.files.locks import alone, lock_beside
from gtmbench.files.plain import Column, Row, table_of
from gtmbench.files.seals import SLOT, fill_slot, is_intact
from gtmbench.files.writing import atomic_write, is_file, is_folder
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

OFFSET, AT_REST, FACTOR, NOISE, LAG = "offset", "offset at rest", "factor", "noise", "lag"
MISALIGNMENT = "misalignment"  # towards another axis, whose name stands behind it


@dataclass(frozen=True, kw_only=True)
class ConstantKind:
    """What holds for the constants of one kind."""

    unit: str
    # by how much a healthy sensor's differs from flight to flight at least: no smaller spread is believed
    spread: float
    population: float  # by how much those of two installations differ
    failure: float  # by how much it is off of a sensor that failed
    per_k: float = 0.0  # by how much it changes with each kelvin: a standard deviation over sensors
    tells: bool = False  # whether a change of it alone is a sensor's failure; others only tell of an installation


# Spreads are the floors of the engine's relations: what a constant may change by from one part of a log to another; of
# a factor what sheets say that it changes by over a sensor's life. Failures are the relations' priors. Populations, and
# what a kelvin changes, are by the sheets of the IMUs that autopilots have (BMI055, BMI088, ICM-20602, ICM-20689,
# MPU-6000): biases of 1 deg/s, 0.01 to 0.2 deg/s a kelvin; scales of 1 to 3 %, 0.01 to 0.05 % a kelvin; axes 1 to 2 %
# askew; noises that differ by a third.
KINDS: Mapping[str, ConstantKind] = MappingProxyType(
    {
        OFFSET: ConstantKind(unit="deg/s", spread=0.1, population=1.0, failure=3.0, per_k=0.05, tells=True),
        AT_REST: ConstantKind(unit="deg/s", spread=0.1, population=1.0, failure=3.0, per_k=0.05, tells=True),
        FACTOR: ConstantKind(unit="", spread=0.005, population=0.02, failure=0.1, per_k=5e-4, tells=True),
        NOISE: ConstantKind(unit="", spread=0.1, population=0.3, failure=1.0, tells=True),
        MISALIGNMENT: ConstantKind(unit="deg", spread=0.5, population=1.0, failure=5.0),
        LAG: ConstantKind(unit="s", spread=0.01, population=0.02, failure=0.1),
    }
)


@dataclass(frozen=True, kw_only=True)
class Constant:
    """A constant of a sensor, as a flight tells it.

    >>> read = Constant(sensor="q", name="misalignment p", value=0.4, deviation=0.1)
    >>> read.kind.unit
    'deg'
    """

    sensor: str  # ``q``, ``q of IMU2``
    name: str  # ``offset``, ``factor``, ``misalignment p``, ``noise``, ..
    value: float  # in its kind's unit; of a noise the natural logarithm of its standard deviation in the sensor's unit
    deviation: float  # the standard deviation of what the flight tells it by

    @property
    def key(self) -> tuple[str, str]:
        """Which constant it is, in every flight."""
        return self.sensor, self.name

    @property
    def kind(self) -> ConstantKind:
        """What holds for all of its kind."""
        return kind_of(self.name)


def kind_of(name: str) -> ConstantKind:
    """Return what holds for a constant's kind: ``misalignment p`` is a misalignment."""
    return KINDS[MISALIGNMENT if name.startswith(MISALIGNMENT) else name]


_FEWEST = 5  # chunks whose means tell how well a noise is known
_MEDIAN = np.sqrt(0.5 * np.pi)  # the deviation of a median over that of a mean, of normal values


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A flight in a history."""

    digest: str  # of the log's file: a log is entered once
    log: str  # the file's name
    airframe: str
    hardware: str = ""  # the autopilot's identifier; "" where the log states none
    temperature_c: float = float("nan")  # the IMU's over the flight; NaN where it isn't logged
    constants: tuple[Constant, ...] = field(default=(), repr=False)
    # those that weren't as in the flights before: they are no part of what later ones are held against
    apart: frozenset[tuple[str, str]] = frozenset()
    begins: bool = False  # whether an installation begins with it: no earlier flight tells of later ones

    def is_on(self, other: Entry) -> bool | None:
        """Tell whether another flight was flown with the same autopilot; None where one of them doesn't say."""
        return self.hardware == other.hardware if self.hardware and other.hardware else None

    @cached_property
    def by_key(self) -> Mapping[tuple[str, str], Constant]:
        """Its constants, by which they are."""
        return {each.key: each for each in self.constants}


def constants_of(judged: Judged) -> tuple[Constant, ...]:
    """Return the constants that a judged flight tells of its gyros, without what was found to have failed."""
    found: dict[tuple[str, str], Constant] = {}
    turned = {imu.name for imu in judged.flight.imus if imu.mounting.turned_deg}  # whose gyros a log calls otherwise
    for sums in judged.model.sums:
        for each in _of_equation(judged, sums):
            if gyro_and_imu(each.sensor)[1] not in turned:
                found.setdefault(each.key, each)
    return tuple(found.values())


def _of_equation(judged: Judged, sums: WindowSums) -> Iterator[Constant]:
    equation = sums.products.equation
    name, sensor = equation.relation.name, equation.relation.channels[equation.channel]
    if name == "roughness":
        yield from _noise(judged, equation, sensor)
    elif name == "rest":
        value, deviation = equation.constants, _deviations(sums)
        yield Constant(sensor=sensor, name=AT_REST, value=float(value[0]), deviation=float(deviation[0]))
    elif name == "attitude" or (name.startswith(BETWEEN) and "roughness" not in name):
        own = _of_gyro(equation, sensor, _deviations(sums))
        follows = name == "attitude" and judged.flight.is_driven and not judged.flight.is_assumed
        yield from (each for each in own if each.name == OFFSET or not follows)  # it turns as its gyros say


def _of_gyro(equation: Equation, sensor: str, deviations: FloatArray) -> Iterator[Constant]:
    """Give what y = offset + gains * gyros + lag * slope tells; one that reads k of a turn has a gain of 1 - 1 / k."""
    axis = GYROS.index(gyro_and_imu(sensor)[0])
    is_between = equation.relation.name.startswith(BETWEEN)
    theta = equation.constants
    yield Constant(sensor=sensor, name=OFFSET, value=float(theta[0]), deviation=float(deviations[0]))
    for place, gyro in enumerate(GYROS, 1):
        gain, deviation = float(theta[place]), float(deviations[place])
        if place == 1 + axis:
            factor = 1.0 + gain if is_between else 1.0 / max(1.0 - gain, 1e-3)
            slope = 1.0 if is_between else factor**2
            yield Constant(sensor=sensor, name=FACTOR, value=factor, deviation=slope * deviation)
        else:
            askew = f"{MISALIGNMENT} {gyro}"
            yield Constant(
                sensor=sensor, name=askew, value=np.degrees(gain).item(), deviation=np.degrees(deviation).item()
            )
    yield Constant(sensor=sensor, name=LAG, value=float(theta[4]), deviation=float(deviations[4]))


def _deviations(sums: WindowSums) -> FloatArray:
    """Return the standard deviations of an equation's constants: the whole log's information, and their priors."""
    equation = sums.products.equation
    first, last = np.array([0], dtype=np.int64), np.array([sums.cells], dtype=np.int64)
    known = 1 + len(equation.constants)
    squares = sums.known(first, last)[0, 1:known, 1:known]
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(squares + np.diag(equation.relation.prior**-2.0)))))


def _noise(judged: Judged, equation: Equation, sensor: str) -> Iterator[Constant]:
    """Give how noisy a gyro is in motion, by its roughness; by how much means of chunks scatter, it is known."""
    values = equation.relation.values[:, equation.channel]
    values = np.where(equation.relation.asked & np.isfinite(values), values, np.nan)
    rows = rows_per_chunk(judged.flight)
    chunks = values[: len(values) // rows * rows].reshape(-1, rows)
    means = chunks[np.isfinite(chunks).mean(axis=1) > 0.5]
    if len(means) < _FEWEST:
        return
    logs = 0.5 * (np.nanmean(means, axis=1) - np.log(OF_WHITE))
    middle = float(np.median(logs))
    scatter = 1.4826 * float(np.median(np.abs(logs - middle)))
    yield Constant(sensor=sensor, name=NOISE, value=middle, deviation=_MEDIAN * scatter / float(np.sqrt(len(logs))))


SCHEMA = 1
IN_FOLDER = ".gtmbench-history.parquet"  # of a folder of logs: hidden, so that it is none of them
_PATIENCE_S = 60.0  # for another process that writes it
_COLUMNS = {
    "digest": Column("string", "of the log's file, SHA-256"),
    "log": Column("string", "the file's name"),
    "airframe": Column("string", "by the hardware's identifier, else as it was given or by its folder"),
    "hardware": Column("string", "the autopilot's identifier; empty where the log states none"),
    "temperature_c": Column("float", "the IMU's, the median of the flight; null where it isn't logged"),
    "begins": Column("bool", "whether an installation begins with this flight"),
    "sensor": Column("string", "whose constant; null of a flight that tells none"),
    "constant": Column("string", "which; of a noise the natural logarithm of its standard deviation"),
    "value": Column("double", "in deg/s, deg, s or as a factor"),
    "deviation": Column("float", "the standard deviation of what the flight tells it by"),
    "apart": Column("bool", "whether it was another than before, and counts in no prediction"),
}


def history_file(given: Path) -> Path:
    """Return the file that is meant: of a folder of logs, the one in it."""
    return given / IN_FOLDER if is_folder(given) else given


def read_history(path: Path) -> tuple[Entry, ...]:
    """Return the flights of a history as they were entered; none without a file. InputError: damaged, or none."""
    if not is_file(path):
        if path.exists():
            raise InputError(f"--history is {path}, which is no file; give a file's name, such as airframe.parquet")
        return ()
    import pyarrow as pa
    import pyarrow.parquet as pq

    remedy = "it is left as it is: give another --history, or bring back a copy of it"
    try:
        if path.stat().st_size > 500_000_000:  # more is no history
            raise InputError(f"{path} has {path.stat().st_size} bytes, which no history has; {remedy}")
        content = path.read_bytes()
        table = pq.read_table(pa.BufferReader(content))
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path} is no history that can be read ({one_line(str(error))[:120]}); {remedy}") from error
    told = (table.schema.metadata or {}).get(b"gtmbench.schema")
    if told is None or not set(_COLUMNS) <= set(table.column_names):
        raise InputError(f"{path} is no history but another table; {remedy}")
    if told != str(SCHEMA).encode():
        raise InputError(f"{path} is a history by another version of gtmbench; {remedy}")
    if not is_intact(content):
        raise InputError(f"{path} isn't what was written, by its digest: altered or damaged; {remedy}")
    by_digest: dict[str, list[Row]] = {}
    for row in table.to_pylist():
        by_digest.setdefault(row["digest"], []).append(row)
    return tuple(_entry(own) for own in by_digest.values())


def enter(path: Path, entry: Entry) -> bool:
    """Enter a flight beside what others enter meanwhile; return whether it is new: each log is entered once."""
    if not path.parent.is_dir():
        raise InputError(f"can't write {path}: folder {path.parent} doesn't exist; create it first")
    with alone(lock_beside(path), f"another process writes {path}", patience_s=_PATIENCE_S):
        entries = read_history(path)
        if any(each.digest == entry.digest for each in entries):
            return False
        _write(path, [*entries, entry])
    return True


def _write(path: Path, entries: Sequence[Entry]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = table_of([row for entry in entries for row in _rows(entry)], _COLUMNS, schema=SCHEMA)
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), b"digest": SLOT})
    content = pa.BufferOutputStream()
    pq.write_table(table, content, compression="zstd")
    with atomic_write(path) as aside:
        aside.write_bytes(fill_slot(content.getvalue().to_pybytes()))


def _rows(entry: Entry) -> list[Row]:
    own: Row = {
        "digest": entry.digest,
        "log": one_line(entry.log),
        "airframe": entry.airframe,
        "hardware": entry.hardware,
        "temperature_c": entry.temperature_c if math.isfinite(entry.temperature_c) else None,
        "begins": entry.begins,
    }
    told: list[Row] = [
        {
            "sensor": each.sensor,
            "constant": each.name,
            "value": each.value,
            "deviation": each.deviation,
            "apart": each.key in entry.apart,
        }
        for each in entry.constants
    ]
    return [own | row for row in told or [{"apart": False}]]


def _entry(rows: Sequence[Row]) -> Entry:
    first, told = rows[0], [row for row in rows if row["sensor"] is not None]
    return Entry(
        digest=first["digest"],
        log=first["log"],
        airframe=first["airframe"],
        hardware=first["hardware"],
        temperature_c=math.nan if first["temperature_c"] is None else first["temperature_c"],
        constants=tuple(
            Constant(sensor=row["sensor"], name=row["constant"], value=row["value"], deviation=row["deviation"])
            for row in told
        ),
        apart=frozenset((row["sensor"], row["constant"]) for row in told if row["apart"]),
        begins=first["begins"],
    )
