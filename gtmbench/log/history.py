"""A watched log and its airframe's history: its entry, what it is beside the flights before, and entering it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gtmbench.errors import InputError
from gtmbench.files.seals import file_digest
from gtmbench.files.writing import is_folder
from gtmbench.history.entry import Entry, constants_of, enter, history_file, read_history
from gtmbench.history.standing import stood
from gtmbench.log.watched_log import WatchedLog
from gtmbench.verdict.timeline import State


def entry_of(watched: WatchedLog, aircraft_id: str = "") -> Entry:
    """Return what a history keeps of a watched log.

    `aircraft_id`: whose flight it is; by default what the log says, or its folder.
    """
    judged = None if watched.check.stops else watched.judged
    return Entry(
        digest=digest_of(watched.log.path),
        log=watched.log.path.name,
        airframe=aircraft_id or watched.airframe,
        hardware=watched.hardware,
        temperature_c=watched.temperature_c,
        constants=() if judged is None else constants_of(judged),
    )


def beside_history(watched: WatchedLog, history: Path, aircraft_id: str = "") -> WatchedLog:
    """Return a watched log as it is judged beside the flights of its airframe in a file, or in a folder of logs."""
    standing = stood(read_history(history_file(history)), entry_of(watched, aircraft_id))
    return replace(watched, beside=standing)


def entered(watched: WatchedLog, history: Path) -> bool:
    """Enter a log that was judged beside a history; return whether it is new there.

    Raises InputError where it wasn't judged beside one, or the file can't be written.
    """
    if watched.beside is None:
        raise InputError(f"{watched.log.path} was not judged beside a history; give one to watch_log")
    return enter(history_file(history), watched.beside.entered(_failed(watched)))


def _failed(watched: WatchedLog) -> Sequence[str]:
    timeline = watched.verdict.timeline
    return [name for name in timeline.sensors if timeline.of(name, State.FAILED, State.SUSPECTED)]


def digest_of(path: Path) -> str:
    """Return the digest of a log's file; of a folder of tables, that of its name."""
    if is_folder(path):
        return hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:16]
    return file_digest(path)[:16]
