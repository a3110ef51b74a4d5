"""A run of the benchmark: yardsticks, detectors and anybody's entries, judged alike."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gtmbench.detectors.protocol import Detector
from gtmbench.errors import InputError
from gtmbench.files.shipped import code_facts
from gtmbench.files.writing import atomic_write, is_file, make_folder
from gtmbench.imports import digests_of, files_of
from gtmbench.jobs.processes import spread
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.workers import ALONE, Workers
from gtmbench.study.benchmark.definition import PRIVATE, Definition, secret_digest
from gtmbench.study.benchmark.detectors import write_entries
from gtmbench.study.benchmark.entry import Entry, read_entry
from gtmbench.study.benchmark.flights import Told, references
from gtmbench.study.benchmark.judge import Row, judge, ranked
from gtmbench.study.benchmark.yardsticks import YARDSTICKS, RawReading, write_yardsticks

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

    Parameters
    ----------
    definition : Definition
    split : str
        Which is judged.
    folder : Path
    detectors : mapping of name to Detector
    entries : sequence of Path
        Folders of score files, or with a table of alarms.
    workers : Workers
        Who flies and watches; what comes of it is judged here.
    progress : callable

    Raises
    ------
    InputError
        If an entry isn't one, two rows have one name, or the folder holds another run.
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
    entry: Entry = read_entry(folder, definition, split)
    return judge(entry, definition, split, told)


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
    with atomic_write(path) as aside:
        aside.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")


def _read(path: Path) -> dict[str, Any]:
    """Return what a folder's run is of."""
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path} isn't what a run writes; give another --out") from error
    if not isinstance(before, dict):
        raise InputError(f"{path} isn't what a run writes; give another --out")
    return before
