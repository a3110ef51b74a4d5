"""Folders of results: all of their files at one instant, or, into a folder that exists, moved so that none is lost."""

from __future__ import annotations

import re
import shutil
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.locks import FOR_EVER_S, alone, lock_beside
from gtmbench.files.seals import file_digest
from gtmbench.files.writing import HIDDEN, READY, clear_left_behind, folder_beside, is_file, resolved, to_disk, told

SUMS = "SHA256SUMS"  # in a folder of results: a digest of every file
_SUM = re.compile(r"([0-9a-f]{64})  (.+)")
_ENDING = (signal.SIGINT, signal.SIGTERM)


def check_folder(target: Path, *, force: bool) -> None:
    """Refuse, before the long work, a folder of results that can't be written, or isn't to be written into."""
    if target.is_dir() and not force:
        raise InputError(f"{target} exists; give another --out, or --force to replace its files of the same names")
    if target.exists() and not target.is_dir():
        raise InputError(f"can't write into {target}: it isn't a folder; give another --out")
    with folder_beside(target / SUMS if target.is_dir() else resolved(target)):
        pass
    settle(target)


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Give a folder to write files to; they are moved into `target` when the block ends well.

    Files of other names that stand in `target` already stay as they are. Beside them stands `SUMS`, with a digest of
    every file, as ``sha256sum -c`` reads it. A process that is killed while it moves files into a folder that exists
    leaves the rest to the next one: `settle`.

    Raises InputError where a folder stands in a file's place, or a file in a folder's.
    """
    meant = target.resolve()
    with folder_beside(meant) as aside, told(target, aside):
        yield aside
        with _moving(meant):
            (aside / SUMS).write_text(_sums(aside, meant / SUMS), encoding="utf-8")
            for path in aside.rglob("*"):
                to_disk(path)
            _check_places(aside, meant)
            clear_left_behind(meant)  # of parts whose writers were killed
            with _uninterrupted():
                _place(aside, meant)
        to_disk(meant.parent)


def settle(target: Path) -> None:
    """Move the rest of the files of a process that was killed while it moved them into a folder."""
    meant = target.resolve()
    if _left_for(meant):
        with _moving(meant):
            pass


@contextmanager
def _moving(target: Path) -> Iterator[None]:
    """Let one process at a time move files into a folder; first what those that are dead have left."""
    with alone(
        lock_beside(target.with_name(f"{target.name}.moves")), f"files are moved into {target}", patience_s=FOR_EVER_S
    ):
        for ready in _left_for(target):
            _move(ready, target)
        yield


def _left_for(target: Path) -> list[Path]:
    """Return folders whose files are on their way into another one."""
    return [each for each in target.parent.glob(f"{HIDDEN}????????/{READY}/*") if each.name == target.name]


def _check_places(aside: Path, target: Path) -> None:
    for path in aside.rglob("*"):
        place = target / path.relative_to(aside)
        if place.exists() and place.is_dir() != path.is_dir():
            is_, meant = ("folder", "file") if place.is_dir() else ("file", "folder")
            raise InputError(f"{place} is a {is_}; a {meant} of that name can't be written there")


def _place(aside: Path, target: Path) -> None:
    """Move a folder's files into another one, which may not exist yet."""
    if not target.exists():
        aside.replace(target)  # all of it at one instant
        return
    ready = aside.parent / READY / target.name
    ready.parent.mkdir()
    aside.replace(ready)  # from here on, whoever comes next moves what is left
    to_disk(aside.parent)
    _move(ready, target)


def _move(ready: Path, target: Path) -> None:
    """Move files one by one, the list of digests last."""
    try:
        for path in sorted(ready.rglob("*"), key=lambda path: (path == ready / SUMS, path)):
            if path.is_file():
                place = target / path.relative_to(ready)
                place.parent.mkdir(parents=True, exist_ok=True)
                path.replace(place)
                to_disk(place.parent)
    except OSError as error:
        raise GtmbenchError(
            f"can't move all new files into {target}: {error.strerror or error}; some there are new, others old; make "
            f"it writable, and `gtmbench verify {target}` moves the rest"
        ) from error
    shutil.rmtree(ready.parent, ignore_errors=True)


def _sums(folder: Path, former: Path) -> str:
    """Return a line with the digest of every file in a folder, and those of a former list that name others."""
    sums = read_sums(former) if is_file(former) else {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            sums[path.relative_to(folder).as_posix()] = file_digest(path)
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))


def read_sums(path: Path) -> dict[str, str]:
    """Return the digests of a folder's files by their names, as `atomic_folder` lists them."""
    lines = (_SUM.fullmatch(line) for line in path.read_text(encoding="utf-8", errors="replace").splitlines())
    return {line[2]: line[1] for line in lines if line}


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM wait for the few milliseconds that must not be cut in two."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    former = {each: signal.signal(each, lambda number, _: came.append(number)) for each in _ENDING}
    try:
        yield
    finally:
        for each, handler in former.items():
            signal.signal(each, handler or signal.SIG_DFL)
        for number in came:
            signal.raise_signal(number)
