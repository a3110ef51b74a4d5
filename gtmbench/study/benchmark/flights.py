"""The benchmark's flights: flown, measured, broken, thinned out; their digests, and how soon anybody could tell."""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path

import numpy as np

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.flight import fly
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.sensor_chain import IDEAL
from gtmbench.bench.sensors import measure
from gtmbench.faults.fault import inject
from gtmbench.files.shipped import shipped_benchmarks
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress, silent
from gtmbench.study.benchmark.definition import Definition, Flight
from gtmbench.study.benchmark.noise_laws import LAWS, with_noise
from gtmbench.study.limit import changed_readings, limit_of
from gtmbench.values.channels import CHANNELS, SENSORS
from gtmbench.values.record import Record

_DIGITS = 16  # of a digest: enough against an accident


@dataclass(frozen=True, kw_only=True, eq=False)
class Made:
    """A flight that has been flown.

    Attributes
    ----------
    record : Record
        What the sensors read, with the fault and without the rows that were lost.
    limit_s : float
        The delay of quickest detection of its fault; NaN without one, infinite where nobody can tell within the flight.
    """

    record: Record = field(repr=False)
    limit_s: float

    @property
    def digest(self) -> str:
        """Of every bit of the record."""
        record = self.record
        told = f"{','.join(record.channels)} {record.sample_period_s!r} {len(record)} ".encode()
        return hashlib.sha256(told + np.ascontiguousarray(record.values).tobytes()).hexdigest()[:_DIGITS]


def make(definition: Definition, flight: Flight) -> Made:
    """Fly a flight of the benchmark, and return what its sensors read.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from gtmbench.study.benchmark.definition import load_definition
    >>> short = replace(load_definition(quick=True), duration_s=8.0, onset_s=(2.0, 4.0))
    >>> flight = next(each for each in short.flights("test") if each.fault)
    >>> made = make(short, flight)
    >>> len(made.record), made.record.channels == short.channels, make(short, flight).digest == made.digest
    (801, True, True)
    """
    group = flight.group
    truth = fly(group.aircraft, flight.excitation, definition.duration_s, flight.seed).select(definition.channels)
    chain = load_aircraft(group.aircraft).chain_of(group.sensors)
    if chain is None:
        read = with_noise(truth, flight.noise, flight.seed)
    else:
        read = measure(truth, noise="t2", seed=flight.seed, commands=True, sensors=chain).select(definition.channels)
    healthy = _thinned(read, round(group.sample_period_s / SAMPLE_PERIOD_S))
    broken = healthy if flight.fault is None else inject(healthy, flight.fault)
    return Made(record=_lost(broken, flight).part(range(flight.rows)), limit_s=_limit_s(definition, flight, healthy))


def _thinned(record: Record, step: int) -> Record:
    """Return every so many samples: sensors that sample more slowly, with all aliases."""
    values = record.values[::step]
    return Record(values, channels=record.channels, sample_period_s=step * record.sample_period_s)


def _lost(record: Record, flight: Flight) -> Record:
    """Return a record some of whose rows no sensor has; the first is always there."""
    if not flight.lost:
        return record
    gone = np.random.default_rng([flight.seed, 2]).random(len(record)) < flight.lost
    gone[0] = False
    columns = [name in SENSORS for name in record.channels]
    values = np.where(gone[:, np.newaxis] & np.array(columns), np.nan, record.values)
    return Record(values, channels=record.channels, sample_period_s=record.sample_period_s)


def _limit_s(definition: Definition, flight: Flight, healthy: Record) -> float:
    """Return the limit of a flight's fault, for its law of noise; on a chain it is that of ideal sensors, a bound."""
    if flight.fault is None:
        return math.nan
    law = LAWS[flight.noise if flight.group.sensors == IDEAL else "white"]
    return limit_of(
        changed_readings(flight.fault, healthy),
        flight.fault.channel,
        {name: law.level * CHANNELS[name].noise for name in CHANNELS},
        flight.group.sample_period_s,
        definition.false_alarms_per_hour,
        pole=law.pole,
        information=law.information,
    )


Facts = Mapping[str, tuple[str, float]]  # by id: digest, and limit in seconds


@cache
def shipped_facts(name: str) -> Facts:
    """Return digest and limit of a benchmark's public flights, as they ship; empty where they don't.

    >>> shipped_facts("nobody's")
    {}
    """
    path = next(iter(shipped_benchmarks().values())).with_name(f"{name}.csv")
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {row["id"]: (row["digest"], _number(row["limit_s"])) for row in csv.DictReader(file)}


def _number(text: str) -> float:
    return float(text) if text else math.nan


def facts_of(definition: Definition, flight: Flight) -> tuple[str, str, float]:
    """Fly a flight, and return its id, digest and limit."""
    made = make(definition, flight)
    return flight.id, made.digest, made.limit_s


def limits_s(
    definition: Definition, flights: Sequence[Flight], *, processes: int = 1, progress: Progress = silent
) -> dict[str, float]:
    """Return the limit of every flight with a fault by its id: those that ship, and others by flying."""
    shipped = shipped_facts(definition.name)
    broken = [flight for flight in flights if flight.fault is not None and not flight.twin]
    unknown = [flight for flight in broken if flight.id not in shipped]
    flown = spread(partial(facts_of, definition), unknown, processes=processes, step="limits", progress=progress)
    return {flight.id: shipped[flight.id][1] for flight in broken if flight.id in shipped} | {
        name: limit_s for name, _, limit_s in flown
    }


def write_facts(path: Path, facts: Sequence[tuple[str, str, float]]) -> None:
    """Write digests and limits of flights, a line each, as they ship."""
    lines = [f"{name},{digest},{'' if math.isnan(limit_s) else f'{limit_s:.2f}'}" for name, digest, limit_s in facts]
    path.write_text("\n".join(["id,digest,limit_s", *lines]) + "\n", encoding="utf-8")
