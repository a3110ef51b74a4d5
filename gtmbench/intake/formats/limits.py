"""What every reader is held to: how large a log may be, and what a library may cost, print and raise.

The libraries of some formats are C that a damaged file can bring down, and some files unpack without end. Those are
read in a process of its own, under limits on memory and time: a broken file ends that, not us. What is read comes back
as arrays and words, never as objects.
"""

from __future__ import annotations

import contextlib
import errno
import importlib.util
import json
import os
import stat
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.logs import LARGEST_LOG_BYTES, MOST_LOG_VALUES
from gtmbench.imports import load_extra

LARGEST_FILE_BYTES = LARGEST_LOG_BYTES
LARGEST_CHUNK_BYTES = 1 << 26  # of a container, unpacked
MOST_UNPACKED_BYTES = 1 << 31  # of a whole file
_UNWRITTEN = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
MOST_COLUMNS = 5_000  # more is no log
_SMALL_BYTES, _PACKED_AT_MOST = 1 << 26, 200  # of what is unpacked; how many times its size a larger one may be
MOST_MESSAGES = 10_000_000  # more is no flight
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


Arrays = dict[str, NDArray[Any]]
_LONGEST_S = 600.0  # by the clock: a busy machine may be slow
_PACKAGES = Path(__file__).resolve().parents[3]  # the folder above the package


def read_apart(reader: str, package: str, path: Path, kind: str) -> tuple[dict[str, Any], Arrays]:
    """Return the facts and arrays that the function ``arrays(path)`` of a module beside this one reads of a file."""
    if (package in sys.modules and sys.modules[package] is None) or importlib.util.find_spec(package) is None:
        raise InputError(f"{path} is a {kind}: reading it needs the package {package}; pip install 'gtmbench[logs]'")
    with reading(path, kind):
        bytes_of(path)
    environment = os.environ | {"PYTHONPATH": str(_PACKAGES), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-P", "-m", __name__, reader, str(path.absolute())]
    with tempfile.TemporaryFile() as answer:
        try:
            ended = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=answer,
                stderr=subprocess.DEVNULL,
                env=environment,
                timeout=_LONGEST_S,
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            ended = -1
        answer.seek(0)
        facts = json.loads(answer.readline() or b"{}") if ended == 0 else {}
        if "names" not in facts:
            why = facts.get("error", "it is broken, or unpacks to far more than its size")
            raise InputError(f"{path} isn't a readable {kind}: {why}")
        return facts, {name: np.load(answer, allow_pickle=False) for name in facts["names"]}


def main(reader: str, path: str) -> None:
    """Write what a reader returns to stdout, under limits that suit the file's size."""
    _limit(bytes_of(Path(path)))
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as out:
        answer(reader, path, out)


def answer(reader: str, path: str, out: IO[bytes]) -> None:
    """Write what a reader returns: a line of JSON, and array after array."""
    try:
        with quiet():
            facts, arrays = import_module(f"{__package__}.{reader}").arrays(path)
        if len(arrays) > MOST_COLUMNS:
            raise InputError(f"it holds {len(arrays)} arrays; at most {MOST_COLUMNS} are read")
        check_values(sum(array.size for array in arrays.values()), "all that it holds")
    except MemoryError:
        facts, arrays = {"error": "it unpacks to far more than its size"}, {}
    except Exception as error:  # libraries raise nearly anything on garbage
        facts, arrays = {"error": one_line(str(error))[:160] or type(error).__name__}, {}
    out.write(json.dumps(facts if "error" in facts else facts | {"names": list(arrays)}).encode() + b"\n")
    for array in arrays.values():
        np.save(out, np.ascontiguousarray(array), allow_pickle=False)


def _limit(size: int) -> None:
    """Hold this process to a memory and a time that suit a file's size, where the system can."""
    try:
        import resource
    except ImportError:  # not on this system
        return
    for which, most in (
        (resource.RLIMIT_DATA, (300 << 20) + 20 * size),  # memory beside the file, and for each of its bytes
        (resource.RLIMIT_CPU, round(4 + size / 2e6)),  # seconds of a processor
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(which, (most, most))


if __name__ == "__main__":
    main(*sys.argv[1:])
