"""A run of the benchmark: yardsticks, detectors and anybody's entries, judged alike; and its flights, without labels.

Yardsticks keep everybody honest: rows of what knows nothing, and of what knows all.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.detectors.base import SimpleDetector
from gtmbench.detectors.protocol import Detector
from gtmbench.errors import InputError
from gtmbench.files.logs import write_log
from gtmbench.files.shipped import code_facts, shipped_benchmarks
from gtmbench.files.writing import atomic_write, is_file, make_folder, write_text
from gtmbench.imports import digests_of, files_of
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.workers import ALONE, Workers
from gtmbench.study.benchmark.definition import (
    CALIBRATION,
    GTMBENCH_2,
    LEARN,
    PRIVATE,
    Definition,
    Flight,
    secret_digest,
)
from gtmbench.study.benchmark.detectors import write_entries
from gtmbench.study.benchmark.entry import ALARMS, ENTRY, NAMES, read_entry
from gtmbench.study.benchmark.flights import Told, make, references
from gtmbench.study.benchmark.judge import Row, judge, ranked
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, Record

RUN = "run.json"


def run_benchmark(
    definition: Definition,
    split: str,
    folder: Path,
    *,
    detectors: Mapping[str, Detector],
    entries: Sequence[Path] = (),
    workers: Workers = ALONE,
    progress: Progress = silent,
) -> list[Row]:
    """Return the rows of the table, best first: of the yardsticks, of detectors, and of entries.

    What detectors make of flights is kept in the folder; a run that was stopped goes on there.

    `split`: which is judged. `entries`: folders of score files, or with a table of alarms. `workers`: who flies and
    watches; what comes of it is judged here.
    """
    workers.check()
    given = [read_entry(entry, definition, split) for entry in entries]  # before the long work
    own = {**detectors, **({RawReading.name: RawReading()} if detectors else {})}
    _check_names([*YARDSTICKS, *own, *(entry.facts.name for entry in given)])
    _claim(folder, definition, split, digests_of(files_of(own.values())))
    flights = list(definition.flights(split))
    told = references(definition, flights, folder / "references", workers=workers, progress=progress)
    folders = write_yardsticks(folder / "entries", definition, split, told)
    if own:
        folders += write_entries(own, definition, split, folder / "entries", workers=workers, progress=progress)
    work = partial(_judged, definition, split, told)
    rows = spread(work, [*folders, *map(Path, entries)], processes=workers.processes, step="judge", progress=progress)
    return ranked(rows)


def _judged(definition: Definition, split: str, told: Mapping[str, Told], folder: Path) -> Row:
    return judge(read_entry(folder, definition, split), definition, split, told)


def _check_names(names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two rows would be called '{name}'; give one another name in its entry.toml")


def _claim(folder: Path, definition: Definition, split: str, files: Mapping[str, str]) -> None:
    """Begin a folder, or go on with one of the same run: the same flights, code and versions."""
    own_files = {f"file {name}": digest for name, digest in files.items()}  # of detectors that may come later, too
    about: dict[str, Any] = {
        "benchmark": definition.name,
        "digest": definition.digest,
        "split": split,
        **({"private_seed": secret_digest(definition)} if split == PRIVATE else {}),
        **code_facts(definition.versions),
        **own_files,
    }
    path = folder / RUN
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; give another --out")
    if is_file(path):
        before = _read(path)
        changed = [key for key in about if before.get(key, about[key] if key in own_files else None) != about[key]]
        if changed:
            raise InputError(f"{folder} holds another run: {', '.join(changed)} differ; give another --out")
        about = before | about
    elif folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder} holds other files; give another --out, or an empty folder")
    make_folder(folder)
    write_text(path, json.dumps(about, indent=1) + "\n")


def _read(path: Path) -> dict[str, Any]:
    """Return what a folder's run is of."""
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path} isn't what a run writes; give another --out") from error
    if not isinstance(before, dict):
        raise InputError(f"{path} isn't what a run writes; give another --out")
    return before


Times = list[tuple[float, str]]  # seconds, and the sensor that is named
_EVERY_S = 10.0  # of the yardstick that always alarms


def _always(flight: Flight, _definition: Definition, _told: Told | None) -> Times:
    return [(float(time_s), "") for time_s in np.arange(0.0, flight.end_s, _EVERY_S)]


def _random(flight: Flight, definition: Definition, _told: Told | None) -> Times:
    """Alarms of a Poisson process, which a flight that is cut short has up to its end."""
    draw = np.random.default_rng([flight.seed, 4])
    count = draw.poisson(definition.false_alarms_per_hour * definition.duration_s / 3600.0)
    times_s = sorted(draw.uniform(0.0, definition.duration_s, count).tolist())
    return [(time_s, str(draw.choice(GYROS))) for time_s in times_s if time_s <= flight.end_s]


def _oracle(flight: Flight, _definition: Definition, _told: Told | None) -> Times:
    return [(each.onset_s, each.channel) for each in flight.faults if each.onset_s <= flight.end_s]


def _reference(flight: Flight, _definition: Definition, told: Told | None) -> Times:
    if told is None:
        return []
    times_s = [*told.false_s, *([flight.onset_s + told.delay_s] if np.isfinite(told.delay_s) else [])]
    return [(time_s, flight.faults[0].channel) for time_s in times_s if time_s <= flight.end_s]


# rows that are no detectors: their titles, and the alarms that they raise on a flight
YARDSTICKS: Mapping[str, tuple[str, Callable[[Flight, Definition, Told | None], Times]]] = {
    "reference": ("CUSUM that knows the fault, its shape and the noise", _reference),
    "oracle": ("knows the onset", _oracle),
    "random": ("alarms at the allowed rate, at random", _random),
    "never": ("never an alarm", lambda *_: []),
    "always": ("an alarm in ten seconds", _always),
}


def write_yardsticks(folder: Path, definition: Definition, split: str, reference: Mapping[str, Told]) -> list[Path]:
    """Write the entries of all yardsticks, a folder each, and return these."""
    flights = list(definition.flights(split))
    written = []
    for name, (title, alarms_of) in YARDSTICKS.items():
        own = folder / name
        make_folder(own)
        lines = ["flight,time_s,sensor"]
        for flight in flights:
            alarms = alarms_of(flight, definition, reference.get(flight.twin or flight.id))
            lines += [f"{flight.id},{time_s!r},{sensor}" for time_s, sensor in alarms]
        write_text(own / ALARMS, "\n".join(lines) + "\n")
        write_text(own / ENTRY, f'name = "{name}"\ntitle = "{title}"\ndefinition = "{definition.digest}"\n')
        written.append(own)
    return written


@dataclass(frozen=True)
class RawReading(SimpleDetector):
    """A limit on the readings themselves: each gyro and angle over its deviation on healthy flights.

    >>> import gtmbench as gb
    >>> channels = RawReading().channels
    >>> healthy = gb.Record(np.tile([[-1.0], [1.0]], (50, 5)), channels=channels, sample_period_s=0.01)
    >>> monitor = RawReading().calibrate([healthy])
    >>> monitor.watch(healthy).scores["p"].values.max().round(6)
    np.float64(1.0)
    """

    name: str = "raw-reading"
    channels: tuple[str, ...] = (*GYROS, "phi", "theta")
    memory_s: float = 0.0

    def learn(self, records: Sequence[Record]) -> dict[str, list[float]]:
        """Return mean and deviation of every channel."""
        values = np.concatenate([record.matrix(self.channels) for record in records])
        return {"mean": np.nanmean(values, axis=0).tolist(), "deviation": np.nanstd(values, axis=0).tolist()}

    def scores(self, record: Record, learned: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return every channel's distance from its mean, over its deviation."""
        means, deviations = learned["mean"], learned["deviation"]
        return {
            name: np.abs(record[name] - means[column]) / deviations[column] for column, name in enumerate(self.channels)
        }


RESULTS, SCHEMA = "results.json", "results.schema.json"
FLIGHTS, README, LICENCE = "flights.csv", "README.txt", "LICENCE.txt"
_LICENCE = """\
These flights were simulated by gtmbench with JSBSim. To the extent possible under law, the gtmbench authors have
dedicated them to the public domain: Creative Commons CC0 1.0 Universal
(https://creativecommons.org/publicdomain/zero/1.0/). Cite gtmbench (CITATION.cff) where you publish results.
"""
_README = """\
{name}: flights without labels. The definition's digest: {digest}{private}

{flights} lists them: flight (its name), group, split, samples, sample_period_s. Each is GROUP/SPLIT/NAME{suffix} with
time_s and one column a channel, the unit in its name (deg_s: degrees a second). An empty cell is a lost sample.

learn: healthy flights, yours to train on. calibration: healthy flights; train on none of them, thresholds are set on
them by `gtmbench benchmark --score`. {split}: flights that are judged; some have a fault. By group a detector may be
another one.

Return a folder of files of the same names with time_s and score, of calibration and {split}, with a copy of entry.toml.
Put a score at the time at which it is known. `docs/how_to/benchmark.md` says the rest.
"""


def export(
    definition: Definition,
    split: str,
    folder: Path,
    *,
    suffix: str = ".parquet",
    processes: int = 1,
    progress: Progress = silent,
) -> list[Flight]:
    """Write the flights to learn, to calibrate and to be judged on; those that are there already stay.

    `split`: which is judged.
    """
    flights = [flight for of in (LEARN, CALIBRATION, split) for flight in definition.flights(of)]
    private = f"\nThe private seed's digest: {secret_digest(definition)}" if split == PRIVATE else ""
    about = _README.format(
        name=definition.name, digest=definition.digest, private=private, flights=FLIGHTS, suffix=suffix, split=split
    )
    _begin(folder, about, f'definition = "{definition.digest}"\n')
    for group in definition.groups:
        for of in (LEARN, CALIBRATION, split):
            make_folder(folder / group.name / of)
    todo = [flight for flight in flights if not is_file(_path(folder, flight, suffix))]
    work = partial(_write, definition, folder, suffix)
    spread(work, todo, processes=processes, step="flights", progress=progress)
    rows = [f"{each.id},{each.group.name},{each.split},{each.rows},{each.group.sample_period_s:g}" for each in flights]
    write_text(folder / FLIGHTS, "\n".join(["flight,group,split,samples,sample_period_s", *rows]) + "\n")
    return flights


def _begin(folder: Path, about: str, entry: str) -> None:
    """Begin a folder, or go on with one of the same flights."""
    readme = folder / README
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; give a folder")
    if is_file(readme) and readme.read_text(encoding="utf-8") != about:
        raise InputError(f"{folder} holds other flights, by its {README}; give another folder")
    if folder.is_dir() and not is_file(readme) and any(folder.iterdir()):
        raise InputError(f"{folder} holds other files; give another folder, or an empty one")
    make_folder(folder)
    for path, content in ((readme, about), (folder / LICENCE, _LICENCE), (folder / ENTRY, entry)):
        write_text(path, content)


def _path(folder: Path, flight: Flight, suffix: str) -> Path:
    return folder / f"{flight.path}{suffix}"


def _write(definition: Definition, folder: Path, suffix: str, flight: Flight) -> None:
    write_log(make(definition, flight), _path(folder, flight, suffix))


def archive(definition: Definition, folder: Path, path: Path) -> int:
    """Write a run's folder as one ZIP file, to be deposited, and return how many files it holds.

    In it are the page, the results with their schema, the citation, the definition with its flights' digests, and what
    every entry says of itself. Score files aren't: whoever has the detector makes them again.
    """
    if not is_file(folder / RESULTS):
        raise InputError(f"{folder} holds no {RESULTS}; give the folder that a run wrote")
    shipped = next(iter(shipped_benchmarks().values())).parent
    own = [path for path in folder.iterdir() if path.is_file()]
    told = [each for of in (ENTRY, NAMES, ALARMS) for each in folder.glob(f"entries/*/{of}")]
    frozen = [shipped / f"{GTMBENCH_2}.toml", shipped / f"{definition.name}.csv", shipped / SCHEMA]
    files = {each.relative_to(folder).as_posix(): each for each in (*own, *told)}
    files |= {f"definition/{each.name}": each for each in frozen if is_file(each)}
    with atomic_write(path) as aside, zipfile.ZipFile(aside, "w", zipfile.ZIP_DEFLATED) as into:
        for name, each in sorted(files.items()):
            into.writestr(zipfile.ZipInfo(f"{definition.name}/{name}"), each.read_bytes(), zipfile.ZIP_DEFLATED)
    return len(files)
