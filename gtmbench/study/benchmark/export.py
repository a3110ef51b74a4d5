"""The benchmark's flights as files without labels, for detectors in any language."""

from __future__ import annotations

import zipfile
from functools import partial
from pathlib import Path

from gtmbench.errors import InputError
from gtmbench.files.logs import write_log
from gtmbench.files.shipped import shipped_benchmarks
from gtmbench.files.writing import atomic_write, is_file, make_folder, write_text
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress, silent
from gtmbench.study.benchmark.definition import (
    CALIBRATION,
    GTMBENCH_2,
    LEARN,
    PRIVATE,
    Definition,
    Flight,
    secret_digest,
)
from gtmbench.study.benchmark.entry import ALARMS, ENTRY, NAMES
from gtmbench.study.benchmark.flights import make

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
    _claim(folder, about, f'definition = "{definition.digest}"\n')
    for group in definition.groups:
        for of in (LEARN, CALIBRATION, split):
            make_folder(folder / group.name / of)
    todo = [flight for flight in flights if not is_file(_path(folder, flight, suffix))]
    work = partial(_write, definition, folder, suffix)
    spread(work, todo, processes=processes, step="flights", progress=progress)
    rows = [f"{each.id},{each.group.name},{each.split},{each.rows},{each.group.sample_period_s:g}" for each in flights]
    write_text(folder / FLIGHTS, "\n".join(["flight,group,split,samples,sample_period_s", *rows]) + "\n")
    return flights


def _claim(folder: Path, about: str, entry: str) -> None:
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
