"""An entry: what somebody's detector makes of the benchmark's flights, as files, whatever language wrote them.

A folder of either

- score files, one a flight: ``GROUP/SPLIT/ID.csv`` (or ``.parquet``) with the columns ``time_s``, ``score`` and, where
  it tells sensors apart, ``score_p``, ``score_q``, ...; of the calibration split and of the one that is judged;
- or ``alarms.csv``: ``flight, time_s[, sensor]``, one alarm a row; `flight` is the ID.

Beside score files ``names.csv``, of the same columns, may say from when on which sensor is named: ``p``, ``p|phi``
where it is one or the other, empty where nobody. ``entry.toml`` says for which definition it was made, and may say what
it is (`Facts`).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmbench.checks import keys, meant, naming, number, one_line, shown, text
from gtmbench.errors import InputError
from gtmbench.files.writing import check_size, is_file, no_such, read_toml
from gtmbench.study.benchmark.definition import CALIBRATION, Definition, Flight
from gtmbench.values.channels import SENSORS
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd

ALARMS, NAMES, ENTRY, SUFFIXES = "alarms.csv", "names.csv", "entry.toml", (".csv", ".parquet")
_STAMP = 1e-6  # seconds by which a time may differ
_SAME = 1e-6  # of the largest score, by which a flight that is cut short may differ: single precision

Said = tuple[float, tuple[str, ...]]  # when, and which sensors are named


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What an entry says of itself, all of it optional but the definition."""

    definition: str = ""  # the digest of the benchmark's definition, as exported flights have it
    # name, title, source, machine, tuned: `machine`: what the cost was measured on; `tuned`: on which flights its
    # settings were chosen
    name: str = ""
    title: str = ""
    source: str = ""
    machine: str = ""
    tuned: str = ""
    microseconds_a_sample: float = math.nan  # what a sample costs, of all channels
    # bound: what no score can reach, where there is such a thing (1 for a probability): the tail then ends there
    bound: float = math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Scores:
    """The score file of a flight: shape (samples,), and by channel where it has such columns."""

    score: FloatArray = field(repr=False)
    by_channel: Mapping[str, FloatArray] = field(default_factory=dict, repr=False)

    @property
    def columns(self) -> dict[str, FloatArray]:
        """All of them, by their names in the file."""
        return {"score": self.score, **{f"score_{name}": values for name, values in self.by_channel.items()}}


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """An entry whose folder and tables have been checked; score files are checked as they are read."""

    folder: Path
    facts: Facts
    alarms: Mapping[str, list[Said]] | None = field(repr=False)  # of a table of alarms; None of score files
    names: Mapping[str, list[Said]] = field(repr=False)  # from when on which sensors are named

    def scores(self, flight: Flight) -> Scores:
        """Return the scores of a flight."""
        path = _score_file(self.folder, flight)
        # a row has a dozen columns of 17 digits, and then some
        check_size(path, f"score file of {flight.rows} rows", 400 * (flight.rows + 10))
        frame = _table(path)
        with naming(path):
            return _scores_of(frame, flight)


def read_entry(folder: str | Path, definition: Definition, split: str) -> Entry:
    """Return an entry, after a look at all that is judged of it: every flight is there, none sees the future.

    `split`: which is judged.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(
            f"{folder} is no folder; give one of score files or with an {ALARMS}"
            if folder.exists()
            else no_such(folder)
        )
    flights = {flight.id: flight for flight in definition.flights(split)}
    facts = _facts(folder)
    if facts.definition != definition.digest:
        given = f"its definition is {shown(facts.definition[:16])}" if facts.definition else "it names no definition"
        raise InputError(
            f"{folder}: {given}, and that of {definition.name} is {definition.digest[:16]}; make scores of flights "
            f"that --export writes now, and copy the {ENTRY} beside these"
        )
    if is_file(folder / ALARMS):
        said = _said(folder / ALARMS, flights)
        names = {name: [each for each in rows if each[1]] for name, rows in said.items()}
        entry = Entry(folder=folder, facts=facts, alarms=said, names=names)
    else:
        names = _said(folder / NAMES, flights) if is_file(folder / NAMES) else {}
        _check_there(folder, definition, split)
        entry = Entry(folder=folder, facts=facts, alarms=None, names=names)
    for flight in flights.values():
        if flight.twin:
            _check_twin(entry, flight, flights[flight.twin])
    return entry


def _facts(folder: Path) -> Facts:
    path = folder / ENTRY
    name = folder.resolve().name
    if not is_file(path):
        return Facts(name=name)
    tables = read_toml(path, "description of an entry")
    with naming(path):
        keys(tables, [each.name for each in fields(Facts)])
        numbers = ("microseconds_a_sample", "bound")
        given: dict[str, Any] = {
            key: number(key, value) if key in numbers else text(key, value) for key, value in tables.items()
        }
    return Facts(**{"name": name, **given})


def _check_there(folder: Path, definition: Definition, split: str) -> None:
    """Refuse a folder in which a flight has no file, or a file no flight."""
    wanted = {flight.path: flight for of in (CALIBRATION, split) for flight in definition.flights(of)}
    missing = [flight for flight in wanted.values() if _found(folder, flight) is None]
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of {len(wanted)} flights have no score file, {missing[0].path}.csv the first; "
            f"write one for every flight of {CALIBRATION} and {split} (or an {ALARMS})"
        )
    for group in definition.groups:
        for path in sorted((folder / group.name / split).iterdir()):
            if path.suffix in SUFFIXES and f"{group.name}/{split}/{path.stem}" not in wanted:
                raise InputError(
                    f"{path}: no flight of {definition.name} is called so; score files have the flights' names"
                )


def _found(folder: Path, flight: Flight) -> Path | None:
    paths = [folder / f"{flight.path}{suffix}" for suffix in SUFFIXES]
    return next((path for path in paths if path.is_symlink() or is_file(path)), None)


def _score_file(folder: Path, flight: Flight) -> Path:
    path = _found(folder, flight)
    assert path is not None  # `_check_there` has seen it
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{path} leads out of the folder, to {path.resolve()}; copy the file there")
    if not is_file(path):
        raise InputError(no_such(path))
    return path


def _table(path: Path, **how: Any) -> pd.DataFrame:
    """Return a table as it stands; one that pandas would have to mend isn't one."""
    import pandas as pd

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
            return pd.read_csv(path, index_col=False, **how) if path.suffix == ".csv" else pd.read_parquet(path)
    # ValueError and OSError: pandas' and pyarrow's own errors are among these
    except (ValueError, OSError, MemoryError, pd.errors.ParserWarning) as error:
        reason = one_line(str(error)) or type(error).__name__
        raise InputError(f"{path} isn't a readable {path.suffix[1:]} table: {reason}") from error


def _scores_of(frame: pd.DataFrame, flight: Flight) -> Scores:
    channels = {f"score_{name}": name for name in SENSORS}
    for name in frame.columns:
        if name not in ("time_s", "score", *channels):
            known = ("time_s", "score", *channels)
            raise InputError(f"unknown column {shown(name)}; there are time_s, score, score_p, ...{meant(name, known)}")
    for name in ("time_s", "score"):
        if name not in frame.columns:
            raise InputError(f"it has no column {name}; write time_s and score")
    if len(frame) != flight.rows:
        raise InputError(
            f"it has {len(frame)} rows and the flight {flight.rows}; write one score a sample, at its time"
        )
    columns = {str(name): _numbers(str(name), frame[name]) for name in frame.columns}
    off = np.abs(columns["time_s"] - np.arange(flight.rows) * flight.group.sample_period_s) > _STAMP
    if off.any():
        row = int(np.argmax(off))
        expected = row * flight.group.sample_period_s
        raise InputError(
            f"time_s is {columns['time_s'][row]:g} in row {row + 1} where the flight has {expected:g}; write the "
            "flight's own times, in their order"
        )
    return Scores(
        score=columns["score"],
        by_channel={channel: columns[name] for name, channel in channels.items() if name in columns},
    )


def _numbers(name: str, column: pd.Series) -> FloatArray:
    try:
        values = column.to_numpy(dtype=np.float64, na_value=np.nan)
    except (ValueError, TypeError) as error:
        raise InputError(f"column {name} isn't all numbers: {one_line(str(error))}") from error
    wrong = ~np.isfinite(values)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{name} is {values[row]} in row {row + 1}; where there is no score, write the least one that it can have"
        )
    return np.asarray(values)


def _said(path: Path, flights: Mapping[str, Flight]) -> dict[str, list[Said]]:
    """Return the rows of a table of alarms or names by flight, in order of time."""
    check_size(path, "table of alarms", 200_000_000)
    frame = _table(path, dtype=str, keep_default_na=False)
    with naming(path):
        keys(dict.fromkeys(map(str, frame.columns)), ("flight", "time_s", "sensor"), there="its columns are")
        for name in ("flight", "time_s"):
            if name not in frame.columns:
                raise InputError(f"it has no column {name}; its columns are flight, time_s and sensor")
        said: dict[str, list[Said]] = {name: [] for name in flights}
        sensors = frame["sensor"] if "sensor" in frame.columns else [""] * len(frame)
        for name, stamp, named in zip(frame["flight"], frame["time_s"], sensors, strict=True):
            said[_id(name, flights)].append((_time_s(stamp, flights[_id(name, flights)]), _sensors(named)))
    return {name: sorted(rows) for name, rows in said.items()}


def _id(name: str, flights: Mapping[str, Flight]) -> str:
    if name not in flights:
        raise InputError(f"no flight is called {shown(name)}; give the name of an exported file, without its ending")
    return name


def _time_s(stamp: str, flight: Flight) -> float:
    try:
        given = float(stamp)
    except ValueError as error:
        raise InputError(f"time_s is {shown(stamp)}; it must be seconds") from error
    with naming(f"flight {flight.id}"):
        return number("time_s", given, 0.0, flight.end_s + _STAMP)


def _sensors(named: str) -> tuple[str, ...]:
    sensors = tuple(each.strip() for each in named.split("|")) if named.strip() else ()
    for sensor in sensors:
        if sensor not in SENSORS:
            raise InputError(
                f"no sensor is called {shown(sensor)}; there are {', '.join(SENSORS)}, and p|phi for either"
            )
    return sensors


def _check_twin(entry: Entry, short: Flight, full: Flight) -> None:
    """Refuse an entry that says something else of a flight than of the same flight, cut short."""
    if entry.alarms is not None:
        _check_same(entry.alarms, short, full, "alarms of")
        return
    _check_same(entry.names, short, full, "names in")
    cut, whole = entry.scores(short).columns, entry.scores(full).columns
    for name in cut.keys() & whole.keys():
        known = whole[name][: short.rows]
        off = np.abs(cut[name] - known) > _SAME * max(float(np.abs(known).max()), 1e-12)
        if off.any():
            row = int(np.argmax(off))
            raise _sees_ahead(
                f"{name} of {short.path} at {row * short.group.sample_period_s:g} s is {cut[name][row]:.6g}, and "
                f"{known[row]:.6g} of {full.path}",
                short,
            )


def _check_same(said: Mapping[str, Sequence[Said]], short: Flight, full: Flight, what: str) -> None:
    of_short, of_full = (
        [(round(time_s / _STAMP / 10), sensors) for time_s, sensors in said.get(flight.id, ()) if time_s <= short.end_s]
        for flight in (short, full)
    )
    if of_short != of_full:
        raise _sees_ahead(f"{what} {short.path} aren't those of {full.path}", short)


def _sees_ahead(what: str, short: Flight) -> InputError:
    return InputError(
        f"it sees the future, or draws random numbers: {what}, though both are one flight, the former cut short at "
        f"{short.end_s:g} s; put a score at the time at which it is known, and fix its seed"
    )
