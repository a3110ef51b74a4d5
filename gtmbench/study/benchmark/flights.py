"""The benchmark's flights: flown, broken, measured, thinned out; their digests, and how soon the reference tells.

No detector is told of a flight's conditions: noise of a law of its own, the air, the motion, rows lost and rows held.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.excitation import excitation
from gtmbench.bench.flight import fly
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.sensors import stream
from gtmbench.errors import EnvelopeError
from gtmbench.faults.fault import inject
from gtmbench.files.shipped import shipped_benchmarks
from gtmbench.files.writing import is_file, make_folder, write_text
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.workers import ALONE, Workers
from gtmbench.study.benchmark.definition import ALIKE, EASY, SINGLE, Definition, Flight
from gtmbench.study.reference import Axis, Cusum, axis_of, changed_readings
from gtmbench.values.channels import ATTITUDE, CHANNELS, GYROS, SENSORS
from gtmbench.values.clock import even_times_s
from gtmbench.values.record import FloatArray, Record

_DIGITS = 16  # of a digest: enough against an accident
_DRAWS = 48  # simulated flights for the reference's mean: with the six of a fault, 300


def make(definition: Definition, flight: Flight) -> Record:
    """Fly a flight of the benchmark, and return what its sensors read.

    A fault changes what the sensor's element makes of the motion, before noise and converter; one that lives in the
    converter (`EASY`) changes the reading. All readings have the converter's steps.

    >>> from gtmbench.study.benchmark.definition import load_definition
    >>> short = replace(load_definition(quick=True), duration_s=8.0, onset_s=(2.0, 4.0), deadline_s=5.0)
    >>> flight = next(each for each in short.flights("test") if each.role == SINGLE)
    >>> record = make(short, flight)
    >>> len(record), record.channels == short.channels, digest_of(make(short, flight)) == digest_of(record)
    (801, True, True)
    """
    group = flight.group
    conditions = Conditions.of(flight.seed, definition.duration_s, alike=flight.role == ALIKE)
    motion = _motion(definition, flight, conditions)
    in_element = flight.faults if flight.role != EASY else ()
    moved = inject(motion, in_element) if in_element else motion
    noise = np.column_stack([conditions.noise(flight.seed, name, len(moved)) for name in moved.channels])
    chain = load_aircraft(group.aircraft).chain_of(group.sensors)
    if chain is None:
        values = moved.values + noise
    else:
        values = chain.readings(moved.values, noise, moved.sample_period_s, moved.channels)
    step = round(group.sample_period_s / SAMPLE_PERIOD_S)
    read = _like(moved, values)
    read = inject(read, flight.faults) if flight.role == EASY else read
    quanta = np.array([definition.quanta.get(name, 0.0) for name in read.channels])
    converted = np.where(quanta > 0.0, np.round(read.values / np.maximum(quanta, 1e-300)) * quanta, read.values)
    thinned = Record(converted[::step], channels=read.channels, sample_period_s=group.sample_period_s)
    return _thinned_out(thinned, flight, conditions).part(range(flight.rows))


def digest_of(record: Record) -> str:
    """Return a digest of every bit of a record."""
    told = f"{','.join(record.channels)} {record.sample_period_s!r} {len(record)} ".encode()
    return hashlib.sha256(told + np.ascontiguousarray(record.values).tobytes()).hexdigest()[:_DIGITS]


def _motion(definition: Definition, flight: Flight, conditions: Conditions) -> Record:
    """Fly, in weaker turbulence where an aircraft would leave its envelope."""
    aircraft, seed = flight.group.aircraft, flight.seed
    times_s = even_times_s(0.0, SAMPLE_PERIOD_S, range(round(definition.duration_s / SAMPLE_PERIOD_S) + 1))
    scale = {name: conditions.amplitude * by for name, by in load_aircraft(aircraft).excitation.items()}
    wanted = excitation(conditions.motion, times_s, seed).scaled(scale)
    for severity in range(conditions.severity, -1, -1):
        given = replace(wanted, turbulence=severity > 0, severity=severity)
        try:
            return fly(aircraft, given, definition.duration_s, seed % 2**31).select(definition.channels)
        except EnvelopeError:
            if not severity:
                raise
    raise AssertionError


def _like(record: Record, values: FloatArray) -> Record:
    return Record(values, channels=record.channels, sample_period_s=record.sample_period_s)


def _thinned_out(record: Record, flight: Flight, conditions: Conditions) -> Record:
    """Return a record with the rows that sensors hold, and without those that are lost; the first is always there."""
    values, sensors = np.array(record.values), [name in SENSORS for name in record.channels]

    def rows(stretch: tuple[float, float]) -> slice:
        first = 1 + round(stretch[0] / record.sample_period_s)
        return slice(first, first + round(stretch[1] / record.sample_period_s))

    held = rows(conditions.held_s)
    values[held] = np.where(sensors, values[held.start - 1], values[held]) if held.start < len(values) else values[held]
    gone = np.random.default_rng([flight.seed, 3]).random(len(values)) < conditions.lost
    gone[rows(conditions.gap_s)] = True
    gone[0] = False
    return _like(record, np.where(gone[:, np.newaxis] & np.array(sensors), np.nan, values))


@dataclass(frozen=True)
class Told:
    """What the reference makes of a flight with a fault."""

    mean_s: float  # mean delay of simulated flights with this fault, at most up to the horizon; NaN where none is known
    delay_s: float  # on the flight's own noise; infinite where it misses
    false_s: tuple[float, ...] = ()  # its alarms before the onset


def horizon_s(definition: Definition, flight: Flight) -> float:
    """Return how long after its onset a fault may be detected: up to the deadline, or the flight's end."""
    return min(definition.deadline_s, flight.end_s - flight.onset_s)


def reference_of(definition: Definition, flight: Flight) -> Told:
    """Fly a flight, and return what the reference makes of its first fault.

    On a chain, where rows are missing and in a converter the reference is that of ideal sensors with the flight's
    noise.
    """
    conditions = Conditions.of(flight.seed, definition.duration_s)
    motion, fault = _motion(definition, flight, conditions), flight.faults[0]
    gyro = axis_of(fault)
    angle = ATTITUDE[GYROS.index(gyro)]
    step = round(flight.group.sample_period_s / SAMPLE_PERIOD_S)
    thinned = Record(motion.values[::step], channels=motion.channels, sample_period_s=flight.group.sample_period_s)
    change = changed_readings(fault, thinned)
    levels = [conditions.level * CHANNELS[name].noise for name in (gyro, angle)]
    axis = Axis(levels[0], levels[1], flight.group.sample_period_s, conditions.pole**step)
    noise = [conditions.noise(flight.seed, name, len(motion))[::step] for name in (gyro, angle)]
    signature = axis.signature(change, of_gyro=fault.channel in GYROS)
    most_s = horizon_s(definition, flight)
    rule = Cusum.of(signature, axis, definition.false_alarms_per_hour, draws=_DRAWS)
    innovations, onset = axis.innovations(*noise), len(thinned) - len(change)
    innovations[onset:] += signature
    early, delay_s = rule.alarms(innovations, onset)
    mean_s = float(np.minimum(rule.simulated(_DRAWS, flight.seed % 2**31), most_s).mean())
    false_s = tuple(((onset + early) * axis.sample_period_s).tolist())
    return Told(mean_s, delay_s if delay_s < most_s else np.inf, false_s)


def references(
    definition: Definition,
    flights: Sequence[Flight],
    folder: Path,
    *,
    workers: Workers = ALONE,
    progress: Progress = silent,
) -> dict[str, Told]:
    """Return what the reference makes of every flight that quickness counts, by its id.

    Each is kept in a folder, so that a run which was stopped goes on there.
    """
    make_folder(folder)
    counted = [flight for flight in flights if flight.role == SINGLE and not flight.twin]
    todo = [flight for flight in counted if not is_file(_kept(folder, flight))]
    progress("reference", 0, len(todo))
    for finished, (place, told) in enumerate(workers.completed(partial(reference_of, definition), todo), 1):
        write_text(_kept(folder, todo[place]), json.dumps(asdict(told)))
        progress("reference", finished, len(todo))
    return {flight.id: _read(_kept(folder, flight)) for flight in counted}


def _kept(folder: Path, flight: Flight) -> Path:
    return folder / f"{flight.id}.json"


def _read(path: Path) -> Told:
    kept = json.loads(path.read_text(encoding="utf-8"))
    return Told(**kept | {"false_s": tuple(kept["false_s"])})


@cache
def shipped_digests(name: str) -> Mapping[str, str]:
    """Return the digests of a benchmark's public flights by id, as they ship; empty where they don't.

    >>> shipped_digests("nobody's")
    {}
    """
    path = next(iter(shipped_benchmarks().values())).with_name(f"{name}.csv")
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {row["id"]: row["digest"] for row in csv.DictReader(file)}


_LEVELS, _POLES, _DEGREES = (0.6, 1.3), (0.2, 0.8), (4.0, 12.0)  # level times the T2's deviation; Student's t
_AMPLITUDES, _SEVERITIES = (0.5, 1.3), (2, 3, 3, 3, 3, 4, 4, 5)  # of surfaces; of turbulence, by MIL-F-8785C
_MOTIONS = ("turbulence", "multisine+turbulence", "doublets+turbulence")
_OFTEN, _SELDOM = 0.5, 0.25  # shares of the flights: chosen, so that most flights have one or two of these conditions
_LOST, _LOST_S, _HELD_S = 0.03, (0.1, 1.0), (0.02, 0.5)  # chosen: at most of rows; seconds
_GUSTY = 5  # severe, by MIL-F-8785C's scale of 1 to 7


@dataclass(frozen=True)
class Conditions:
    """The conditions of one flight, drawn from its seed, of healthy and broken ones alike.

    A look-alike of a fault has severe turbulence, a gap, and a stretch in which all sensors repeat their last row.
    """

    motion: str  # the excitation
    amplitude: float  # times the excitation's
    severity: int  # of turbulence
    # level, pole, degrees: of the noise: times the T2's deviation; of first-order autoregression, v(k) = pole v(k-1) +
    # w(k), 0 is white; of Student's t that w has, infinite is Gaussian
    level: float
    pole: float
    degrees: float
    lost: float  # share of rows that no sensor has
    # gap_s, held_s: beginning and length of a stretch without readings, and of one in which all sensors repeat their
    # last
    gap_s: tuple[float, float]
    held_s: tuple[float, float]

    @classmethod
    def of(cls, seed: int, duration_s: float, *, alike: bool = False) -> Conditions:
        """Return those of a flight, or of a look-alike."""
        draw = np.random.default_rng([seed, 2])

        def some(share: float, low: float, high: float) -> float:
            value = float(np.exp(draw.uniform(math.log(low), math.log(high))))
            return value if draw.random() < share else 0.0

        return cls(
            motion=str(draw.choice(_MOTIONS)),
            amplitude=some(1.0, *_AMPLITUDES),
            severity=_GUSTY if alike else int(draw.choice(_SEVERITIES)),
            level=some(1.0, *_LEVELS),
            pole=some(_SELDOM, *_POLES),
            degrees=some(_SELDOM, *_DEGREES) or math.inf,
            lost=some(_OFTEN, _LOST / 30.0, _LOST),
            gap_s=(float(draw.uniform(0.0, duration_s)), some(1.0 if alike else _SELDOM, *_LOST_S)),
            held_s=(float(draw.uniform(0.0, duration_s)), some(float(alike), *_HELD_S)),
        )

    def noise(self, seed: int, name: str, count: int) -> FloatArray:
        """Return the noise of a channel; every channel draws from a stream of its own.

        >>> values = [Conditions.of(seed, 80.0).noise(seed, "p", 9000).std() / CHANNELS["p"].noise for seed in range(9)]
        >>> bool(0.5 < min(values) < max(values) < 1.5)
        True
        """
        from scipy.signal import lfilter

        if name not in SENSORS:
            return np.zeros(count)
        draw, degrees = stream(seed, name), self.degrees
        if math.isinf(degrees):
            fresh = draw.standard_normal(count)
        else:
            fresh = draw.standard_t(degrees, count) * math.sqrt((degrees - 2.0) / degrees)
        coloured = lfilter([math.sqrt(1.0 - self.pole**2)], [1.0, -self.pole], fresh)
        return np.asarray(self.level * CHANNELS[name].noise * coloured)
