"""Work that is kept part by part: what is finished stands in a folder however a run ends, and the next one goes on.

The folder is flat: ``manifest.json`` says what the run is (its *facts*), and every finished task is a Parquet file,
written aside and renamed, so that a part is there whole or not at all. It carries a digest of every byte, and one of
the facts that it was made from, and is read only if both fit. The parts are the truth: what is made of them can be made
anew. Facts that differ in anything don't mix, and a lock keeps two runs out of one folder.
"""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from gtmbench.checks import listed, naming, one_line, shown
from gtmbench.errors import GtmbenchError, InputError, NoteWarning
from gtmbench.files.locks import FOR_EVER_S, alone
from gtmbench.files.plain import dumps, plain
from gtmbench.files.seals import SLOT, check_seal, fill_slot, is_intact, seal
from gtmbench.files.writing import atomic_write, check_size, folder_beside, is_file, write_text

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

FORMAT, VERSION = "gtmbench parts", 2  # of version 1, neither manifest nor parts carry a digest
_MANIFEST = "manifest.json"
_RUN, _TASK = b"gtmbench.run", b"gtmbench.task"  # in a part's metadata: of which run it is, and which task's
_DIGEST = b"gtmbench.digest"  # there, too
_PART = re.compile(r"part-(\d{6,})\.parquet")
_LOCK = ".lock"
# most parts hold few rows: Arrow's copy of the schema, dictionaries and statistics would be two thirds of the file
_LEAN = {"store_schema": False, "use_dictionary": False, "write_statistics": False}
_PATIENCE_S = 1.0  # a lock that is only looked at is held for a millisecond
_REMEDY = "delete it, and --resume does its task anew"


class Shard(NamedTuple):
    """One of `of` runs that share a run's tasks and its folder; the first has `number` 1."""

    number: int
    of: int

    def holds(self, task: int) -> bool:
        """Whether a task is this one's."""
        return task % self.of == self.number - 1

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


@dataclass(frozen=True, kw_only=True)
class Parts:
    """A folder of parts."""

    folder: Path
    what: str  # what kind of run it is: "campaign"
    tasks: int  # of how many tasks it consists; their numbers are 0, 1, ...
    # what the run is, as plain values: whatever changes a row has to change a fact
    facts: dict[str, Any] = field(default_factory=dict, repr=False)
    # of a run that may grow, what each task is of, as plain values; the tasks of others are told by their number
    items: tuple[Any, ...] = field(default=(), repr=False)
    version: int = VERSION  # of the folder's format

    def digest(self, task: int) -> str:
        """Return a digest of all that a task's rows hang on, which its part holds: of items, its own."""
        told = {**self._manifest(), "tasks": 1, "items": [self.items[task]]} if self.items else self._manifest()
        return hashlib.sha256(dumps(told).encode()).hexdigest()

    def path(self, task: int) -> Path:
        """Return a task's part."""
        return self.folder / f"part-{task:06d}.parquet"

    def done(self) -> tuple[int, ...]:
        """Return the tasks that are finished, in order; InputError where a part is altered, or of another run."""
        return tuple(number for number, _ in self._opened())

    def damaged(self) -> dict[int, str]:
        """Return the tasks whose parts aren't what was written, and what is wrong with each."""
        found = {}
        for number in self._numbers():
            try:
                self._open(number)
            except _DamagedError as damage:
                found[number] = damage.why
        return found

    def drop_damaged(self) -> None:
        """Remove parts that aren't what was written, saying which: their tasks are done anew."""
        for number, why in self.damaged().items():
            self.path(number).unlink(missing_ok=True)
            warnings.warn(NoteWarning(f"{self.path(number)}: {why}; its task is done anew"), stacklevel=3)

    def todo(self, shard: Shard | None = None) -> tuple[int, ...]:
        """Return the tasks that aren't, in order; of a shard those that are its own."""
        done = frozenset(self.done())
        return tuple(task for task in range(self.tasks) if task not in done and (shard is None or shard.holds(task)))

    def read(self, columns: list[str] | None = None) -> pa.Table:
        """Return the rows of all parts, in the order of the tasks, however they came to be."""
        import pyarrow as pa

        return pa.concat_tables(self.each(columns))

    def each(self, columns: list[str] | None = None) -> Iterator[pa.Table]:
        """Give the rows of every part, in the order of the tasks."""
        for _, part in self._opened():
            yield part.read(columns=columns).replace_schema_metadata(None)

    def write(self, task: int, rows: pa.Table) -> None:
        """Keep what a task gave: on the disk, and there whole, when this returns."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        marks = {_RUN: self.digest(task).encode(), _TASK: str(task).encode(), _DIGEST: SLOT}
        content = pa.BufferOutputStream()
        with pq.ParquetWriter(content, rows.schema, compression="zstd", **_LEAN) as writer:
            writer.write_table(rows, row_group_size=max(len(rows), 1))
            writer.add_key_value_metadata({**(rows.schema.metadata or {}), **marks})
        try:
            with atomic_write(self.path(task)) as aside:
                aside.write_bytes(fill_slot(content.getvalue().to_pybytes()))
        except GtmbenchError as error:
            raise GtmbenchError(f"{error}; what is finished stays, --resume goes on") from error

    def _numbers(self) -> list[int]:
        found = (_PART.fullmatch(path.name) for path in self.folder.iterdir())
        return sorted(int(match[1]) for match in found if match)

    def _opened(self) -> Iterator[tuple[int, pq.ParquetFile]]:
        for number in self._numbers():
            yield number, self._open(number)

    def _open(self, task: int) -> pq.ParquetFile:
        """Open a part, if it is what was written, and of this run."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        path = self.path(task)
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path} can't be read: {error.strerror or error}") from error
        if self.version > 1 and not is_intact(content):
            raise _DamagedError(path, "it isn't what was written, by its digest: altered, damaged or not whole")
        try:
            part = pq.ParquetFile(pa.BufferReader(_arrows_own(content)))
        except (OSError, pa.ArrowException) as error:
            raise _DamagedError(path, f"it isn't whole ({one_line(str(error))})") from error
        metadata = part.metadata.metadata or {}
        known = task < self.tasks and metadata.get(_RUN) == self.digest(task).encode()
        if not known or metadata.get(_TASK) != str(task).encode():
            raise InputError(
                f"{path} is of another {self.what}, or of this one before something of it changed; rows that aren't "
                f"alike don't mix: {_REMEDY}, or give another --out"
            )
        return part

    def _manifest(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "version": self.version,
            "what": self.what,
            "tasks": self.tasks,
            "facts": self.facts,
            **({"items": list(self.items)} if self.items else {}),
        }

    def _write_manifest(self) -> None:
        write_text(self.folder / _MANIFEST, dumps(seal(self._manifest()), indent=2) + "\n")


def _arrows_own(content: bytes) -> pa.Buffer:
    """Return bytes as a copy that is Arrow's, not Python's.

    Arrow's threads read it, and one of them may be the last to let go of it, after `read` has returned. To free what is
    Python's it would ask for Python's lock; if Python is ending by then, that thread is ended within a destructor, and
    the process with it (exit code -6, "terminate called without an active exception").
    """
    import pyarrow as pa

    own = pa.BufferOutputStream()
    own.write(content)
    return own.getvalue()


class _DamagedError(InputError):
    """A part isn't what was written: its task can be done anew."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: {why}; --resume does its task anew")
        self.why = why


def read_parts(folder: Path) -> Parts:
    """Return the parts that stand in a folder, to be read."""
    path = folder / _MANIFEST
    if not is_file(path):
        if not folder.is_dir():
            raise InputError(f"{folder} is no folder; give the one that `gtmbench campaign` has written")
        raise InputError(
            f"{folder} holds no parts of a run, as `gtmbench campaign` writes them: there is no {_MANIFEST}"
        )
    check_size(path, "manifest", 10_000_000)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        version = found["version"]
        if found["format"] != FORMAT or version not in (1, VERSION):
            raise InputError(f"{path} is {shown(found['format'])}, version {shown(version)}, no {FORMAT} {VERSION}")
        if version == VERSION:
            with naming(path):
                check_seal(found, "put a copy of it back, or run it anew into another --out")
        else:
            old = f"{folder} is of a gtmbench before digests, so whether its rows were altered can't be told"
            warnings.warn(NoteWarning(old), stacklevel=2)
        return Parts(
            folder=folder,
            what=str(found["what"]),
            tasks=int(found["tasks"]),
            facts=dict(found["facts"]),
            items=tuple(found.get("items", ())),
            version=int(version),
        )
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{path} isn't the manifest of a run: {one_line(str(error))}") from error


def holds_parts(folder: Path) -> bool:
    """Whether a folder is one of parts: what lies there are results."""
    return is_file(folder / _MANIFEST)


@contextmanager
def parts_in(
    folder: Path,
    *,
    what: str,
    tasks: int,
    facts: Mapping[str, Any],
    items: Sequence[Any] = (),
    resume: bool = False,
    shard: Shard | None = None,
) -> Iterator[Parts]:
    """Give a folder's parts to go on with, for this run alone; the folder is made where there is none.

    `facts`: as far as they are known; `hold` adds others.
    `items`: of a run that may grow, what each task is of: those that aren't in the folder yet follow those that are, so
    the tasks are in the order of the parts' own `items`.
    `resume`: whether parts may be there already.
    `shard`: this run is one of several, which go on with each other's folder at the same time.
    Raises InputError where another run is at work there, the folder holds another one's parts, or some and it wasn't to
    be resumed, or can't be written.
    """
    _check_folder(folder, what)
    _make(folder)
    with _locked(folder, shard):
        with waiting_alone(folder):
            meant = Parts(folder=folder, what=what, tasks=tasks, facts=dict(plain(facts)), items=tuple(plain(items)))
            parts = _begun(meant, resume=resume or shard is not None)
        yield parts


def hold(parts: Parts, **facts: Any) -> Parts:
    """Return the parts of a run that is this, too: facts that are written down, or held against those that are."""
    with waiting_alone(parts.folder):
        known = read_parts(parts.folder)
        new = dict(plain(facts))
        _compare(known, {key: value for key, value in new.items() if key in known.facts})
        held = replace(known, facts={**known.facts, **new})
        if held.facts != known.facts:
            held._write_manifest()
    return held


@contextmanager
def waiting_alone(folder: Path) -> Iterator[None]:
    """Wait until no other run is in such a block about the folder: shards begin at the same time."""
    with alone(folder / f"{_LOCK}-begin", f"another run begins in {folder}", patience_s=FOR_EVER_S):
        yield


def _begun(meant: Parts, *, resume: bool) -> Parts:
    folder, what, tasks = meant.folder, meant.what, meant.tasks
    if not is_file(folder / _MANIFEST):
        meant._write_manifest()
        return meant
    known = read_parts(folder)
    if known.what != what:
        raise InputError(f"{folder} holds a {known.what}, not a {what}; give another --out")
    if not resume:
        done = len(known.done())
        raise InputError(
            f"{folder} holds {done} of {known.tasks} tasks of a {what}; --resume goes on with it, or give another --out"
        )
    _compare(known, meant.facts)
    known = _grown(known, meant.items)
    if known.tasks != tasks:
        raise InputError(f"{folder} holds another {what}: of {known.tasks} tasks, not {tasks}; give another --out")
    known.drop_damaged()
    known.done()  # parts of another run are refused before the work, not after it
    return known


def _grown(known: Parts, items: Sequence[Any]) -> Parts:
    """Return the parts with the items that are new, behind those that there are; none of these may be missing."""
    given, there = ({dumps(item): item for item in each} for each in (items, known.items))
    missing = next((item for key, item in there.items() if key not in given), None)
    if missing is not None:
        name = missing[0] if isinstance(missing, list) else missing  # of a list, the first says which it is
        raise InputError(
            f"{known.folder} holds another {known.what}: {name} was there, and isn't (so) any more; put it "
            "back, or give another --out"
        )
    new = [item for key, item in given.items() if key not in there]
    if not known.items or not new:
        return known
    grown = replace(known, tasks=known.tasks + len(new), items=(*known.items, *new))
    grown._write_manifest()
    return grown


def _compare(known: Parts, facts: Mapping[str, Any]) -> None:
    differs = next(_differences({key: known.facts.get(key) for key in facts}, facts), None)
    if differs is not None:
        where, was, now = differs
        raise InputError(
            f"{known.folder} holds another {known.what}, and rows that aren't alike don't mix: {where} was "
            f"{shown(was)} and is {shown(now)}; put it back, or give another --out"
        )


def _differences(was: Any, now: Any, where: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Give what differs between plain values, and where."""
    if isinstance(was, dict) and isinstance(now, dict):
        for key in (*was, *(key for key in now if key not in was)):
            yield from _differences(was.get(key), now.get(key), f"{where}.{key}" if where else str(key))
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for i, (before, after) in enumerate(zip(was, now, strict=True)):
            yield from _differences(before, after, f"{where}[{i}]")
    elif was != now:
        yield where, was, now


def _check_folder(folder: Path, what: str) -> None:
    """Refuse a folder that holds something else: nothing of somebody's is to be mixed with parts."""
    try:
        is_folder, exists = folder.is_dir(), folder.exists() or folder.is_symlink()
        others = [] if not is_folder else [path.name for path in folder.iterdir() if not path.name.startswith(".")]
    except (OSError, ValueError) as error:
        raise InputError(f"can't write into {folder}: {error}") from error
    if exists and not is_folder:
        raise InputError(f"{folder} isn't a folder; give another --out")
    if others and not is_file(folder / _MANIFEST):
        raise InputError(
            f"{folder} exists and holds no {what}, but {listed(sorted(others)[:3])}; give another --out, a new folder"
        )


def _make(folder: Path) -> None:
    try:
        if not folder.parent.is_dir():
            raise InputError(f"can't write {folder}: folder {folder.parent} doesn't exist; create it first")
        folder.mkdir(exist_ok=True)
    except (OSError, ValueError) as error:
        raise InputError(f"can't write {folder}: {error}; give another --out") from error
    with folder_beside(folder / _MANIFEST):
        pass


@contextmanager
def _locked(folder: Path, shard: Shard | None) -> Iterator[None]:
    """Keep others out while a run is at work: every other one, or of a shard's the same shard and whole runs."""
    whole = folder / f"{_LOCK}-run"
    own = whole if shard is None else folder / f"{_LOCK}-{shard.number}-of-{shard.of}"
    at_work = f"is at work in {folder}"
    with alone(own, f"another run {at_work}" if shard is None else f"shard {shard} {at_work}", patience_s=_PATIENCE_S):
        if shard is not None:
            with alone(whole, f"a whole run {at_work}", patience_s=_PATIENCE_S):
                pass
        else:
            for other in sorted(folder.glob(f"{_LOCK}-*-of-*")):
                number, _, of = other.name.removeprefix(f"{_LOCK}-").partition("-of-")
                with alone(other, f"shard {number}/{of} {at_work}", patience_s=_PATIENCE_S):
                    pass
        yield
