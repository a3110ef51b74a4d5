"""Where shipped data stand, and how results are written: aside first, then renamed, so that nothing is half-written."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
import threading
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gtmbench.errors import InputError

_PACKAGE = Path(__file__).parent
LARGEST_TOML_BYTES = 100_000


def share() -> Path:
    """Return the folder that holds ``aircraft/`` and ``faults/``: the wheel's copy, else the checkout's."""
    return _PACKAGE / "_share" if is_installed() else _PACKAGE.parent


def shipped_aircraft() -> list[str]:
    """Return the names of the aircraft that come with the package."""
    return sorted(path.parent.name for path in (share() / "aircraft").glob("*/aircraft.toml"))


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package, by name."""
    return {path.stem: path for path in sorted((share() / "faults").glob("*.toml"))}


def shipped_banks() -> dict[str, Path]:
    """Return the banks of operators that come with the package, by name."""
    return {path.stem: path for path in sorted((_PACKAGE / "banks").glob("*.toml"))}


def shipped_baselines() -> dict[str, Path]:
    """Return the baselines of `gtmbench check` that come with the package, by name."""
    return {path.stem: path for path in sorted((_PACKAGE / "baselines").glob("*.toml"))}


def is_installed() -> bool:
    """Whether this is an installed package, not a checkout: what it ships isn't the user's to write."""
    return (_PACKAGE / "_share").is_dir()


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of a small TOML file; `what` says what it should be: a scenario, a bank.

    Raises
    ------
    InputError
        Where it is too large to be meant, can't be read or isn't TOML.
    """
    try:
        if path.stat().st_size > LARGEST_TOML_BYTES:
            raise InputError(f"{path} has {path.stat().st_size} bytes; a {what} has at most {LARGEST_TOML_BYTES}")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except InputError:
        raise
    except (ValueError, RecursionError, OSError) as error:  # tomllib's and Unicode's errors are ValueErrors
        raise InputError(f"{path} isn't a readable TOML file: {error}") from error


def check_folder(target: Path, *, force: bool) -> None:
    """Refuse a folder of results that can't be written, or that exists and isn't to be written into.

    Raises
    ------
    InputError
        Before the long work, not after it.
    """
    if target.is_dir() and force and os.access(target, os.W_OK | os.X_OK):
        return
    if target.is_dir() and not force:
        raise InputError(f"{target} exists; give another --out, or --force to replace its files of the same names")
    if target.exists():
        raise InputError(f"can't write into {target}: it isn't a folder of yours to write; give another --out")
    with _folder_beside(target):
        pass


def check_file(target: Path, *, force: bool, option: str = "--out") -> None:
    """Refuse a result's file that can't be written, or that exists and isn't to be replaced; `option` named it.

    Raises
    ------
    InputError
        Before the long work, not after it.
    """
    if target.is_dir():
        raise InputError(f"{target} is a folder; give a file's name")
    if target.exists() and not force:
        raise InputError(f"{target} exists; give another {option}, or --force to write over it")
    with _folder_beside(target.resolve()):
        pass


@contextmanager
def written_aside(target: Path) -> Iterator[Path]:
    """Give a path to write a file to; it becomes `target` when the block ends well and vanishes when it doesn't.

    Raises
    ------
    InputError
        Where the folder doesn't exist or can't be written.
    """
    target = target.resolve()  # through a link, to the file it means
    with _folder_beside(target) as aside:
        yield aside / target.name
        (aside / target.name).replace(target)


@contextmanager
def folder_aside(target: Path) -> Iterator[Path]:
    """Give a folder to write files to; they are moved into `target` when the block ends well.

    Files of other names that stand in `target` already stay as they are.

    Raises
    ------
    InputError
        Where a folder stands in a file's place.
    """
    target = target.resolve()
    with _folder_beside(target) as aside:
        yield aside
        results = sorted(aside.iterdir())
        for path in results:
            if (target / path.name).is_dir():
                raise InputError(f"{target / path.name} is a folder; a file of that name can't be written there")
        with _uninterrupted():
            target.mkdir(exist_ok=True)
            for path in results:
                path.replace(target / path.name)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let Ctrl-C wait for the few milliseconds that must not be cut in two."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)


@contextmanager
def _folder_beside(target: Path) -> Iterator[Path]:
    parent = target.absolute().parent
    if not parent.is_dir():
        raise InputError(f"can't write {target}: folder {parent} doesn't exist; create it first")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"can't write {target}: no permission in {parent}; choose another place")
    try:
        aside = Path(tempfile.mkdtemp(prefix=".gtmbench-", dir=parent))
    except OSError as error:
        raise InputError(f"can't write {target}: {error.strerror}; choose another place") from error
    try:
        yield aside
    finally:
        shutil.rmtree(aside, ignore_errors=True)
