"""A fleet of logs: each is watched in a process of its own, and is a part of a folder, a row, whatever becomes of it.

One process writes. A log that can't be read, takes too long or kills its process is a row with its error.
"""

from __future__ import annotations

import glob
import os
import pickle
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from gtmbench.checks import number, one_line, shown, whole
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.registry import prepared
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.faults.registry import loaded_faults
from gtmbench.files.plain import Column, Row, table_of
from gtmbench.files.seals import file_digest
from gtmbench.files.shipped import code_facts
from gtmbench.files.writing import is_file, is_pattern
from gtmbench.imports import digests_of, files_of, load_files
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES
from gtmbench.intake.formats.registry import is_log, is_log_name
from gtmbench.intake.mapping import split_mapping
from gtmbench.intake.objects import fetched, is_address, object_digest, objects_in
from gtmbench.intake.read import is_log_folder
from gtmbench.jobs.cluster import check_cluster, completed_on_cluster
from gtmbench.jobs.parts import Parts, holds_parts, parts_in, read_parts
from gtmbench.jobs.processes import Lost, survived, survived_one
from gtmbench.jobs.progress import Progress, silent
from gtmbench.log.opening.driven_attitude import FROM_LOG, check_attitude
from gtmbench.log.watch import watch_log
from gtmbench.log.watched_log import WatchedLog
from gtmbench.values.record import Span
from gtmbench.verdict.scope import Scope

WHAT, SCHEMA = "fleet", 2  # 2: rows hold the verdict on the asked sensors
LIMIT_S = 900.0  # a log: a flight of ten hours takes less than two minutes
MOST_LOGS = 20_000  # a page of ten thousand opens; more are likely a whole disk
_LIBRARIES = ("numpy", "scipy", "pandas")  # whose versions rows hang on
_DIGITS = re.compile(r"(\d+)")
Source: TypeAlias = Path | str  # a file, or an object's address


class Kept(NamedTuple):
    """What is kept of a log: its row, and a page where somebody will want to look at one."""

    row: Row
    page: str = ""


@dataclass(frozen=True, kw_only=True)
class FleetQuestion:
    """How every log of a fleet is watched: what `watch_log` takes beside the log."""

    detector: Any = AUTO
    healthy: tuple[Span | Path, ...] = ()  # spans of each log, or other logs
    mapping: tuple[str, ...] = ()
    rate_hz: float | None = None
    false_alarms_per_hour: float | None = None
    attitude: str = FROM_LOG  # whether the gyros drive it, as `watch_log` takes it
    judge: str | None = None  # the sensors that are asked, such as ``p,q,r``; None for the usual ones
    limits: tuple[str, ...] = ()  # the sizes that have to show, as `watch_log` takes them
    limit_s: float = LIMIT_S  # how long one log may take

    @property
    def how(self) -> dict[str, Any]:
        """All of it but the limit of time, as `watch_log` takes it."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name != "limit_s"}

    def check(self) -> None:
        """Refuse what would be refused of every log."""
        prepared(self.detector)
        split_mapping(self.mapping)
        check_attitude(self.attitude)
        Scope(sensors=()).with_limits(self.limits)
        number("the limit of time, in seconds,", self.limit_s, 1.0, 1e6)
        if self.rate_hz is not None:
            number("rate_hz", self.rate_hz, 1e-3, 1e6)
        for each in self.healthy:
            if isinstance(each, Path) and not is_file(each):
                raise InputError(f"no file {each}, which is to be identified on; give a span in seconds, or a log")

    def logs_of(self, sources: Sequence[Source]) -> tuple[Source, ...]:
        """Return the logs that are meant, as `logs_in` and `objects_in` do, but for those that serve as healthy."""
        files = [each for each in sources if not is_address(each)]
        apart = [each for each in self.healthy if isinstance(each, Path)]
        objects = [log for each in sources if is_address(each) for log in _logs_at(each)]
        return (*(logs_in(files, apart=apart) if files or not objects else ()), *dict.fromkeys(objects))

    def files(self) -> tuple[str, ...]:
        """Return the files of the user's own that the detector, and kinds of faults, stand in."""
        detector = prepared(self.detector)
        return files_of([detector, getattr(detector, "function", None), *loaded_faults().values()])

    def facts(self) -> Mapping[str, Any]:
        """Return what a row hangs on, as plain values; files by what is in them."""
        named = isinstance(self.detector, (str, Path))
        return {
            "detector": str(self.detector) if named else one_line(repr(self.detector)),
            "detector_file": _digest(Path(str(self.detector).rpartition("@")[2])) if named else None,
            "healthy": [_file_fact(each) if isinstance(each, Path) else list(each) for each in self.healthy],
            "mapping": list(self.mapping),
            "rate_hz": self.rate_hz,
            "false_alarms_per_hour": self.false_alarms_per_hour,
            "attitude": self.attitude,
            "judge": self.judge,
            "limits": list(self.limits),
            "python": digests_of(self.files()),
        }


def _logs_at(address: str) -> list[str]:
    """Return the logs that an address means: one, or those of a folder or a pattern, by their names."""
    found = objects_in(address)
    logs = found if found == [address] else sorted(filter(is_log_name, found), key=_in_order)
    if not 0 < len(logs) <= MOST_LOGS:
        raise InputError(f"{address} holds {len(logs)} logs, by their names; give an address of 1 to {MOST_LOGS:,}")
    return logs


def logs_in(sources: Sequence[str | Path], *, apart: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Return the logs that folders, patterns and paths mean, each once; those of a folder in the order of their names.

    `sources`: a folder stands for all logs in it and in its folders: files that are named, or begin, as one, but
    nothing hidden, and no results of a fleet or campaign. ``**`` in a pattern goes through folders. `apart`: logs that
    aren't meant, for they serve as healthy. Raises InputError where there are none, or more than 20,000.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name in ("flight_10.csv", "flight_9.csv", "notes.txt"):
    ...         _ = Path(folder, name).write_text("time_s,p_deg_s")
    ...     [path.name for path in logs_in([folder])]
    ['flight_9.csv', 'flight_10.csv']
    """
    found: dict[str, Path] = {}
    left = {_real(path) for path in apart}
    for source in sources:
        for path in _meant(str(source)):
            if _real(path) not in left:
                found.setdefault(_real(path), path)
            if len(found) > MOST_LOGS:
                raise InputError(f"more than {MOST_LOGS:,} logs are meant; name fewer, a folder at a time")
    if not found:
        raise InputError(f"no log is left of {one_line(' '.join(map(str, sources)))} beside what is identified on")
    return tuple(found.values())


def _meant(source: str) -> list[Path]:
    path = Path(source)
    try:
        if path.is_dir():
            logs = sorted(_within(path), key=_in_order)
            if not logs:
                raise InputError(f"{path} is a folder that holds no log; give one that does, or a log")
            return logs
        if not path.exists() and is_pattern(source):
            matches = map(Path, glob.iglob(source, recursive=True))  # noqa: PTH207  absolute ones, too
            logs = sorted((match for match in matches if is_file(match)), key=_in_order)
            if not logs:
                raise InputError(f"no file is called as {source}; give a folder, a log, or another pattern")
            return logs
    except InputError:
        raise
    except (OSError, ValueError) as error:  # a name that is too long, a zero in it
        raise InputError(f"{one_line(source)[:200]}: {one_line(str(error))}") from error
    return [path]


def _within(folder: Path) -> Iterator[Path]:
    for here, folders, files in os.walk(folder):
        if holds_parts(Path(here)):
            folders.clear()
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        if is_log_folder(Path(here)):
            yield Path(here)
            if not any(name.endswith((".csv", ".txt")) for name in files):
                folders.clear()  # its tables lie in these
            continue
        yield from (path for name in files if not name.startswith(".") and is_log(path := Path(here, name)))


def _in_order(path: Source) -> list[tuple[bool, int, str]]:
    """Return what sorts paths as one reads them, 9 before 10."""
    return [(not part.isdigit(), int(part) if part.isdecimal() else 0, part) for part in _DIGITS.split(str(path))]


def conduct(
    logs: Sequence[Source],
    watching: FleetQuestion,
    out: Path,
    *,
    row: Callable[[WatchedLog], Kept],
    keep: Callable[[Source, str], None],
    columns: Mapping[str, Column],
    jobs: int = 1,
    scheduler: str | None = None,
    tls: Path | None = None,
    resume: bool = False,
    progress: Progress = silent,
) -> Parts:
    """Watch every log that isn't in the folder yet, and return its parts; logs that are new follow those it has.

    `row`: what is kept of a watched log, picklable. `keep`: given a log and its page, here, before its row is a part.
    `columns`: of a row; among them task, log, outcome and error, which a log that couldn't be watched has. `scheduler`:
    of a Dask cluster, which does the work instead: workers read the logs, by paths that they share or addresses.
    """
    watching.check()
    whole("jobs", jobs, 1, 1000)
    if scheduler is not None:
        check_cluster(scheduler, tls, partial(code_facts, _LIBRARIES))
    _check_rows(out)
    facts = {"rows": SCHEMA, "watching": watching.facts(), "versions": code_facts(_LIBRARIES)}
    of = {tuple(_file_fact(log)): log for log in logs}
    with parts_in(out, what=WHAT, tasks=len(logs), facts=facts, items=list(of), resume=resume) as parts:
        todo, logs = parts.todo(), [of[tuple(item)] for item in parts.items]
        progress("logs", 0, len(todo))
        made = _made([logs[task] for task in todo], watching, row, jobs, scheduler, tls)
        for finished, (place, told) in enumerate(made, 1):
            task = todo[place]
            kept = _lost(told) if isinstance(told, Lost) else told
            if kept.page:
                keep(logs[task], kept.page)
            rows = [{**kept.row, "task": task, "log": one_line(str(logs[task]))}]
            parts.write(task, table_of(rows, columns, schema=SCHEMA))
            progress("logs", finished, len(todo))
        return parts


def _made(
    logs: Sequence[Source],
    watching: FleetQuestion,
    row: Callable[[WatchedLog], Kept],
    jobs: int,
    scheduler: str | None,
    tls: Path | None,
) -> Iterator[tuple[int, Kept | Lost]]:
    """Give what is kept of each log, as soon as it is watched."""
    if scheduler is None:
        work, begin = partial(_kept_of, watching=watching, row=row), partial(load_files, watching.files())
        return survived(work, logs, processes=jobs, limit_s=watching.limit_s, begin=begin)
    ready = replace(watching, detector=prepared(watching.detector))  # workers have no file of a monitor
    packed = pickle.dumps(partial(_kept_of, watching=ready, row=row))
    one = partial(_on_worker, files=watching.files(), packed=packed, limit_s=watching.limit_s)
    return completed_on_cluster(one, logs, scheduler=scheduler, tls=tls, killed=lambda _: Lost(0.0, watching.limit_s))


def _on_worker(log: Source, *, files: Sequence[str], packed: bytes, limit_s: float) -> Kept | Lost:
    return survived_one(partial(_unpacked, files=files, packed=packed), log, limit_s=limit_s)


def _unpacked(log: Source, *, files: Sequence[str], packed: bytes) -> Kept:
    load_files(files)
    kept: Kept = pickle.loads(packed)(log)  # noqa: S301  our own, from the process that conducts
    return kept


def _check_rows(out: Path) -> None:
    """Refuse a fleet's folder whose rows hold something else than today's."""
    if not holds_parts(out):
        return
    known = read_parts(out)
    rows = known.facts.get("rows", 1)
    if known.what == WHAT and rows != SCHEMA:
        raise InputError(
            f"{out} holds a fleet by another version of gtmbench, whose rows have other columns (schema {shown(rows)}, "
            f"here {SCHEMA}); watch its logs anew into another --out"
        )


def _kept_of(log: Source, *, watching: FleetQuestion, row: Callable[[WatchedLog], Kept]) -> Kept:
    """Return what is kept of a log, or why it couldn't be watched: whatever goes wrong in one is its own."""
    try:
        with fetched(log) if isinstance(log, str) else nullcontext(log) as path:
            return row(watch_log(path, **watching.how))
    except GtmbenchError as error:
        return _failed(str(error))
    except MemoryError:
        return _failed("there isn't memory enough for it; cut the log")
    except Exception as error:
        return _failed(f"{type(error).__name__}: {error}")


def _lost(told: Lost) -> Kept:
    if told.is_late:
        return _failed(f"it took longer than {told.limit_s:g} s; cut the log, or give it more time")
    return _failed("its process was killed (no memory?); cut the log, or use fewer processes")


def _failed(why: str) -> Kept:
    return Kept({"outcome": "error", "error": one_line(why)})


def _file_fact(log: Source) -> list[Any]:
    return [one_line(str(log)), object_digest(log) if isinstance(log, str) else _digest(log)]


def _digest(path: Path) -> str | None:
    """Return a digest of what is in a file; None where it isn't one, or not to be read."""
    try:
        if not is_file(path) or path.stat().st_size > LARGEST_FILE_BYTES:
            return None
        return file_digest(path)[:16]
    except (OSError, ValueError):
        return None


def _real(path: Path) -> str:
    try:
        return str(path.resolve())
    except (OSError, RuntimeError, ValueError):
        return str(path)
