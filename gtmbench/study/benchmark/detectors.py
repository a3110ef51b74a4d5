"""Detectors in Python enter the benchmark by the same files as anybody's: scores a flight, and whom they name when."""

from __future__ import annotations

import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gtmbench.detectors.monitor_file import load_monitor, save_monitor
from gtmbench.detectors.protocol import Detector, Monitor, Score, Watch, is_recipe
from gtmbench.errors import InputError
from gtmbench.files.writing import atomic_write, is_file, make_folder, write_text
from gtmbench.imports import files_of
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.workers import ALONE, Workers
from gtmbench.study.benchmark.definition import CALIBRATION, LEARN, Definition, Flight
from gtmbench.study.benchmark.entry import ENTRY, NAMES
from gtmbench.study.benchmark.flights import digest_of, make
from gtmbench.values.channels import SENSORS
from gtmbench.values.record import FloatArray, Record

_OWN, _SOURCES = "flights of gtmbench-1's kind; not on gtmbench-2", "its source's settings; not on gtmbench-2"
DETECTORS = {  # those that enter unless others are named, and what they were tuned on
    **dict.fromkeys(("C", "C-early"), _OWN),
    **dict.fromkeys(("kinematic-kalman", "kalman", "cusum", "pca", "limits"), _SOURCES),
}
_NO_SCORE = 0.0  # where a statistic doesn't exist: the least that a ratio of statistic and threshold can have
_MONITORS, _NAMES, _COSTS, DIGEST = "monitors", "said", "costs", "digest"


def write_entries(
    detectors: Mapping[str, Detector],
    definition: Definition,
    split: str,
    folder: Path,
    *,
    workers: Workers = ALONE,
    progress: Progress = silent,
) -> list[Path]:
    """Calibrate detectors on the flights to learn on, write their scores, and return the folders of their entries.

    What is there already stays, so a run that was stopped goes on. A flight is flown once for all detectors.

    `split`: which is judged. `folder`: of a folder each, and of the calibrated monitors.
    """
    _check(detectors, definition)
    workers = replace(workers, files=files_of(detectors.values()))
    _learn(detectors, definition, folder, workers, progress)
    for name in detectors:
        for group in definition.groups:
            for of in (CALIBRATION, split):
                make_folder(folder / name / group.name / of)
    flights = [flight for of in (CALIBRATION, split) for flight in definition.flights(of)]
    unwatched = (
        (flight, [name for name in detectors if not is_file(_score(folder, name, flight))]) for flight in flights
    )
    todo = [(flight, names) for flight, names in unwatched if names]
    monitors = {
        (name, group.name): load_monitor(_monitor(folder, name, group.name), detector)
        for name, detector in detectors.items()
        for group in definition.groups
    }
    progress("watch", 0, len(todo))
    for finished, (place, tables) in enumerate(workers.completed(partial(_watched, definition, monitors), todo), 1):
        for name, table in tables.items():
            with atomic_write(_score(folder, name, todo[place][0])) as aside:
                aside.write_bytes(table)
        progress("watch", finished, len(todo))
    for name, detector in detectors.items():
        _write_names(folder / name, [flight for flight in flights if flight.split == split])
        _write_facts(folder / name, name, detector, definition, flights)
    return [folder / name for name in detectors]


def _check(detectors: Mapping[str, Detector], definition: Definition) -> None:
    for name, detector in detectors.items():
        if not is_recipe(detector):
            raise InputError(f"'{name}' is calibrated already; give a detector that learns on the benchmark's flights")
        missing = [channel for channel in detector.channels if channel not in definition.channels]
        if missing:
            raise InputError(f"'{name}' needs {', '.join(missing)}; flights have {', '.join(definition.channels)}")


def _learn(
    detectors: Mapping[str, Detector], definition: Definition, folder: Path, workers: Workers, progress: Progress
) -> None:
    """Calibrate every detector on every group, and keep the monitors."""
    make_folder(folder / _MONITORS)
    for group in definition.groups:
        todo = [name for name in detectors if not is_file(_monitor(folder, name, group.name))]
        if not todo:
            continue
        flights = [flight for flight in definition.flights(LEARN) if flight.group == group]
        records = workers.spread(partial(make, definition), flights, step=f"fly {group.name}", progress=progress)
        for number, name in enumerate(todo):
            progress(f"calibrate {name}", number, len(todo))
            save_monitor(_calibrated(detectors[name], records, definition), _monitor(folder, name, group.name))


def _calibrated(detector: Detector, records: Sequence[Record], definition: Definition) -> Monitor:
    """Return a monitor for the benchmark's rate, or, of a detector that can't promise one, as it calibrates itself."""
    own = [record.select(detector.channels) for record in records]
    try:
        return detector.calibrate(own, definition.false_alarms_per_hour)
    except InputError as error:
        if "can't promise" not in str(error):
            raise
    return detector.calibrate(own)


def _monitor(folder: Path, name: str, group: str) -> Path:
    return folder / _MONITORS / f"{name}-{group}.json"


def _score(folder: Path, name: str, flight: Flight) -> Path:
    return folder / name / f"{flight.path}.parquet"


def _watched(
    definition: Definition, monitors: Mapping[tuple[str, str], Monitor], task: tuple[Flight, Sequence[str]]
) -> dict[str, bytes]:
    """Fly a flight, and return the score files of what detectors make of it."""
    flight, names = task
    record, tables = make(definition, flight), {}
    for name in names:
        monitor = monitors[name, flight.group.name]
        begun_s = time.process_time()
        watch = monitor.watch(record)
        cost_s = time.process_time() - begun_s
        if not watch.scores:
            raise InputError(
                f"'{name}' shows no test statistic, so no threshold can be set; write an alarms.csv instead"
            )
        frame = pd.DataFrame({"time_s": np.arange(flight.rows) * flight.group.sample_period_s, **scores_of(watch)})
        frame.attrs = {_NAMES: _said(watch), _COSTS: cost_s, DIGEST: digest_of(record)}  # Parquet keeps them
        tables[name] = frame.to_parquet(None, index=False, compression="zstd")
    return tables


def scores_of(watch: Watch) -> dict[str, FloatArray]:
    """Return the columns of a score file: the greatest of all statistics over their thresholds, and that by channel.

    Each value stands in the row at which it is known.
    """
    by_channel: dict[str, FloatArray] = {}
    whole = np.full(len(watch.record), _NO_SCORE)
    for score in watch.scores.values():
        known = _known(score, watch.record)
        whole = np.maximum(whole, known)
        channels = score.channels or (score.name,)
        if len(channels) == 1 and channels[0] in SENSORS:
            name = f"score_{channels[0]}"
            by_channel[name] = np.maximum(by_channel.get(name, known), known)
    columns = {"score": whole, **by_channel}
    return {name: values.astype(np.float32) for name, values in columns.items()}


def _known(score: Score, record: Record) -> FloatArray:
    """Return a statistic over its threshold by when it is known, shape (samples,); left out what isn't by the end."""
    there, ratios = score.exists & np.isfinite(score.known_s), np.divide(score.values, score.threshold)
    rows = np.ceil((score.known_s[there] - record.start_s) / record.sample_period_s - 1e-6).astype(int)
    within = rows < len(record)
    known = np.full(len(record), _NO_SCORE)
    np.maximum.at(known, rows[within], ratios[there][within])
    return known


def _said(watch: Watch) -> list[tuple[float, str]]:
    """Return from when on which sensors are named."""
    said = []
    for alarm in watch.faults:
        for judged in alarm.judgements:
            named = (judged.sensor,) if judged.sensor else judged.candidates
            said.append((judged.time_s, "|".join(named)))
    return sorted(said)


def _attributes(path: Path) -> dict[Any, Any]:
    return dict(pd.read_parquet(path, columns=[]).attrs)


def _write_names(folder: Path, flights: Sequence[Flight]) -> None:
    """Write whom a detector names, of all flights that are judged; nothing of one that names nobody."""
    lines = []
    for flight in flights:
        said = _attributes(folder / f"{flight.path}.parquet").get(_NAMES, [])
        lines += [f"{flight.id},{time_s!r},{named}" for time_s, named in said if time_s <= flight.end_s]
    if lines:
        write_text(folder / NAMES, "\n".join(["flight,time_s,sensor", *lines]) + "\n")


def _write_facts(
    folder: Path, name: str, detector: Detector, definition: Definition, flights: Sequence[Flight]
) -> None:
    """Write the description of an entry, with what a sample cost: median over the flights."""
    costs = [_attributes(folder / f"{flight.path}.parquet").get(_COSTS, np.nan) / flight.rows for flight in flights]
    title = str(getattr(detector, "title", "")) or str(getattr(getattr(detector, "bank", None), "title", ""))
    facts: dict[str, object] = {"definition": definition.digest, "name": name, "title": title[:150]}
    facts |= {"machine": machine(), "tuned": str(getattr(detector, "tuned", DETECTORS.get(name, "")))}
    lines = [f'{key} = "{value}"' for key, value in facts.items() if value]
    write_text(folder / ENTRY, "\n".join([*lines, f"microseconds_a_sample = {1e6 * np.median(costs):.3g}"]) + "\n")


def machine() -> str:
    """Return on what costs are measured, without the name of the machine."""
    return f"{platform.machine()}, Python {platform.python_version()}, one core, shared"
