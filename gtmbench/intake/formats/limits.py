"""What every reader is held to: how large a log may be, and what a library may cost, print and raise."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.logs import LARGEST_LOG_BYTES, MOST_LOG_VALUES
from gtmbench.imports import load_extra

LARGEST_FILE_BYTES = LARGEST_LOG_BYTES
LARGEST_CHUNK_BYTES = 1 << 26  # of a container, unpacked
MOST_UNPACKED_BYTES = 1 << 31  # of a whole file
MOST_COLUMNS = 5_000
MOST_MESSAGES = 10_000_000
MOST_VALUES = MOST_LOG_VALUES
LONGEST_LINE_BYTES = 1 << 20  # or message of text


def check_values(count: float, what: str) -> None:
    """Refuse more values than fit into memory."""
    if not count <= MOST_VALUES:
        raise InputError(f"{what} would be {count:.3g} values; at most {MOST_VALUES:.0e} are read: cut the log")


def check_columns(names: Sequence[str]) -> None:
    """Refuse a table whose columns can't be told apart, or that has more than are meant."""
    if len(names) > MOST_COLUMNS:
        raise InputError(f"it has {len(names)} columns; at most {MOST_COLUMNS} are read")
    before: set[str] = set()
    for name in names:
        if name and name in before:
            raise InputError(f"column '{name[:60]}' stands there twice; rename one of them")
        before.add(name)


def library(name: str, path: Path, kind: str) -> ModuleType:
    """Import a module of the extra ``logs``, or say in one line how to get it."""
    with quiet():
        return load_extra(name, "logs", f"{path} is a {kind}: reading it needs")


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep a library's prints and warnings to itself: what a command prints is its own."""
    with (
        Path(os.devnull).open("w") as nowhere,
        contextlib.redirect_stdout(nowhere),
        contextlib.redirect_stderr(nowhere),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        yield


@contextlib.contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a format's library raises on a broken file into one line that names the file.

    Libraries raise nearly anything on garbage, bare Exceptions included; nothing but a library's work on a file belongs
    into this block.
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {one_line(str(error))}") from error
    except Exception as error:
        reason = one_line(str(error))[:160] or type(error).__name__
        raise InputError(f"{path} isn't a readable {kind}: {reason}") from error
