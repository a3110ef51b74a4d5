"""What every reader is held to: how large a log may be, and what a library may cost, print and raise."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
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
_UNWRITTEN = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
MOST_COLUMNS = 5_000
_SMALL_BYTES, _PACKED_AT_MOST = 1 << 26, 200  # of what is unpacked; how many times its size a larger one may be
MOST_MESSAGES = 10_000_000
MOST_VALUES = MOST_LOG_VALUES
LONGEST_LINE_BYTES = 1 << 20  # or message of text


def check_values(count: float, what: str) -> None:
    """Refuse more values than fit into memory."""
    if not count <= MOST_VALUES:
        raise InputError(f"{what} would be {count:.3g} values; at most {MOST_VALUES:.0e} are read: cut the log")


def check_unpacked(count: float, path: Path) -> None:
    """Refuse bytes in a file that are far more than its size: repeated without end, they are no sensor's."""
    if count > min(LARGEST_FILE_BYTES, _SMALL_BYTES + _PACKED_AT_MOST * path.stat().st_size):
        raise InputError(f"it unpacks to {count:.3g} bytes, far more than its size")


def bytes_of(log: Path) -> int:
    """Return how large a log is that is really read: a file, or all that lies in a folder, which has to be files."""
    total = 0
    for path in [log, *(log.rglob("*") if log.is_dir() else ())]:
        about = path.stat()
        if not (stat.S_ISREG(about.st_mode) or stat.S_ISDIR(about.st_mode)):
            raise InputError(f"{path.name} is neither a file nor a folder, but a pipe or a device")
        total += about.st_size if stat.S_ISREG(about.st_mode) else 0
        if total > LARGEST_FILE_BYTES:
            raise InputError(f"it has more than {LARGEST_FILE_BYTES} bytes; at most so many are read: cut the log")
    return total


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
        if isinstance(error, OSError) and error.errno in _UNWRITTEN:
            raise  # what is written anew of it: no fault of the file that is read
        reason = one_line(str(error))[:160] or type(error).__name__
        raise InputError(f"{path} isn't a readable {kind}: {reason}") from error
