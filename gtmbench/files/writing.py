"""Files: what is refused before it is read, and results written aside first, then renamed: nothing is half-written."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtmbench.checks import meant, one_line
from gtmbench.errors import GtmbenchError, InputError

if TYPE_CHECKING:
    from filelock import SoftFileLock

LARGEST_TOML_BYTES = 100_000  # more is no file that somebody wrote
_FRACTION = re.compile(r"\d\.\d")
_MOST_DOTS = 100  # in a line: no table is so deep
_LONGEST_NAME = 255  # that a file system takes
LOGS = (".csv", ".parquet", ".ulg", ".bin", ".mcap", ".xlsx")  # how logs are called, for messages
_LONGEST_LINE_BYTES = 1 << 20  # nobody writes longer lines
# a folder beside the target; in it its lock, what is written, and what is on its way into a folder of its own name
HIDDEN, _LOCK, _NEW, READY = ".gtmbench-", "lock", "new", "ready"


def is_pattern(source: str) -> bool:
    """Tell whether a text is a pattern of names."""
    return any(letter in source for letter in "*?[")


def is_file(path: Path) -> bool:
    """Whether a file stands there; not a folder, and no pipe or device, which could be read for ever."""
    try:
        return path.is_file()
    except OSError:  # a name that is too long, a folder that isn't ours to look into
        return False


def is_folder(path: Path | str) -> bool:
    """Whether a folder stands there; of a name that can't be one, no."""
    try:
        return Path(path).is_dir()
    except (OSError, ValueError):
        return False


def no_such(path: Path, otherwise: str = "") -> str:
    """Return what to say of a file that isn't there: where one of its name is, or what is called alike."""
    folder, near = path.parent if is_folder(path.parent) else Path(), []
    with suppress(OSError, ValueError):
        near = [str(each) for pattern in ("*", "*/*") for each in islice(folder.glob(pattern), 1000) if is_file(each)]
    alike = {Path(name).stem.lower(): name for name in near if Path(name).suffix.lower() == path.suffix.lower()}
    here = [name for name in near if Path(name).name == path.name]
    here += [alike[stem] for stem in get_close_matches(path.stem[:_LONGEST_NAME].lower(), alike, n=1)]
    here += [name for name in near if Path(name).stem == path.stem]  # its ending is mistyped
    likely = f"did you mean '{here[0]}'?" if here else otherwise
    return f"{path}: no such file{likely and f'; {likely}'}"


def no_file(source: object, what: str, shipped: Iterable[str]) -> str:
    """Return what to say where a text is neither a file nor the name of a scenario, a campaign, a bank that ships."""
    named, known = str(source)[:200], tuple(shipped)
    likely = meant(Path(named).stem if named.endswith(".toml") else named, known)
    if is_folder(named):
        within = [path.name for path in sorted(Path(named).glob("*.toml"))[:5]]
        holds = f"that holds {', '.join(within)}" if within else "without a .toml"
        return f"no {what} '{named}': a folder {holds}; give a TOML file or one of {', '.join(known)}{likely}"
    return f"no {what} '{named}'; give a TOML file or one of {', '.join(known)}{likely}"


def check_size(path: Path, what: str, largest_bytes: int) -> None:
    """Refuse a file that is too large to be meant, before it is read; `what` it should be: a scenario, a bank."""
    size = path.stat().st_size
    if size > largest_bytes:
        raise InputError(f"{path} has {size} bytes; a {what} has at most {largest_bytes}")


def count_lines(path: Path) -> int:
    """Return how many lines a text has at most, however they end; refuse one that nobody writes."""
    count = 1
    with path.open("rb") as file:
        while block := file.read(_LONGEST_LINE_BYTES):
            ends = max(block.count(b"\n"), block.count(b"\r"))
            if not ends and len(block) == _LONGEST_LINE_BYTES:
                raise InputError(f"it has a line of more than {_LONGEST_LINE_BYTES} bytes; nobody writes such a table")
            count += ends
    return count


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Return the tables of a small TOML file; `what` says what it should be: a scenario, a bank."""
    if path.suffix.lower() in LOGS:
        raise InputError(f"{path} is no {what} but, by its name, a log; watch it: gtmbench monitor {path}")
    try:
        check_size(path, what, LARGEST_TOML_BYTES)
        text = path.read_text(encoding="utf-8")
        # a.a.a.a: tomllib's memory and time grow with the square of a key's depth
        if max(_FRACTION.sub("", line).count(".") for line in text.split("\n")) > _MOST_DOTS:
            raise InputError(f"{path} has more than {_MOST_DOTS} dots in a line; no table of a {what} is so deep")
        return tomllib.loads(text)
    except InputError:
        raise
    except (ValueError, RecursionError, OSError) as error:  # tomllib's and Unicode's errors are ValueErrors
        if path.suffix.lower() != ".toml":
            raise InputError(f"{path} is no {what}: that is a TOML file, and its name ends in .toml") from error
        raise InputError(f"{path} isn't a readable TOML file: {one_line(str(error))}") from error


def check_file(target: Path, *, force: bool, option: str = "--out") -> None:
    """Refuse, before the work, a result's file that can't be written or isn't to be replaced; `option` named it."""
    meant = resolved(target)
    if meant.exists() and not force:
        raise InputError(f"{target} exists; give another {option}, or --force to write over it")
    with folder_beside(meant):
        pass


@contextmanager
def atomic_write(target: Path) -> Iterator[Path]:
    """Give a path to write a file to; it becomes `target` when the block ends well and vanishes when it doesn't.

    It is on the disk before it gets its name, and whatever fails, what stood there before still stands.

    Raises GtmbenchError where writing fails: no permission, the disk is full, a quota is used up, the folder is removed
    meanwhile.
    """
    meant = resolved(target)
    with folder_beside(meant) as aside, told(target, aside):
        yield aside / meant.name
        to_disk(aside / meant.name)
        (aside / meant.name).replace(meant)
        to_disk(meant.parent)


def write_text(target: Path, text: str) -> None:
    """Write a text, whole or not at all."""
    with atomic_write(target) as aside:
        aside.write_text(text, encoding="utf-8")


def make_folder(folder: Path) -> None:
    """Make a folder of results, and those above it, where there is none."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritten(folder, error) from error


@contextmanager
def told(target: Path, aside: Path) -> Iterator[None]:
    """Say in one line which file couldn't be written and why; what concerns another file stays what it is."""
    try:
        yield
    except BrokenPipeError:  # of what is printed meanwhile
        raise
    except OSError as error:
        if isinstance(error.filename, str | bytes) and not Path(os.fsdecode(error.filename)).is_relative_to(aside):
            raise
        raise unwritten(target, error) from error


class UnwrittenError(GtmbenchError):
    """An output couldn't be written: no fault of what was read."""


def unwritten(target: Path, error: OSError) -> UnwrittenError:
    """Return the error that says which file couldn't be written, and why."""
    why = os.strerror(error.errno) if error.errno else one_line(str(error))
    return UnwrittenError(
        f"can't write {target}: {why}; make room or choose another place; what stood there before still stands"
    )


def to_disk(path: Path) -> None:
    """Wait until a file, or a folder's list of names, is on the disk: a new name must not get there before its file."""
    if path.is_dir():
        with suppress(OSError):  # not every system can flush a folder
            folder = os.open(path, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        return
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def resolved(target: Path) -> Path:
    """Return the file that is meant, through a link; nothing else is written over."""
    try:
        meant = target.resolve()
        str(meant).encode()  # Parquet's and rerun's libraries want UTF-8
        is_folder, is_other = meant.is_dir(), meant.exists() and not meant.is_file()
    except (OSError, RuntimeError, ValueError) as error:  # too long a name, links in a circle, a zero in the name
        raise InputError(f"can't write {target}: {error}") from error
    if is_folder or is_other:
        kind = "folder" if is_folder else "device or a pipe"
        raise InputError(f"{target} is a {kind}; give a file's name")
    return meant


@contextmanager
def folder_beside(target: Path) -> Iterator[Path]:
    """Give a folder beside a file or a folder to write it in; what is in it is removed, unless it is `READY`."""
    parent = target.absolute().parent
    if not parent.is_dir():
        raise InputError(f"can't write {target}: folder {parent} doesn't exist; create it first")
    _clear_once(parent)
    try:
        own, lock = _own_folder(parent)
    except OSError as error:
        raise UnwrittenError(f"can't write {target}: {error.strerror}; choose another place") from error
    try:
        yield own / _NEW
    finally:
        lock.release()
        if not any(own.glob(f"{READY}/*")):
            shutil.rmtree(own, ignore_errors=True)


def _own_folder(parent: Path) -> tuple[Path, SoftFileLock]:
    """Make a hidden folder to write into; while this process lives, its lock tells others that it is in use."""
    from filelock import SoftFileLock, Timeout

    while True:
        own = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=parent))
        lock = SoftFileLock(own / _LOCK)
        try:
            lock.acquire(timeout=0)
            (own / _NEW).mkdir()
            (own / _LOCK).stat()
        except (Timeout, FileNotFoundError):  # somebody took it for one that was left behind
            lock.release()
            shutil.rmtree(own, ignore_errors=True)
            continue
        except BaseException:
            shutil.rmtree(own, ignore_errors=True)
            raise
        return own, lock


@cache
def _clear_once(parent: Path) -> None:
    clear_left_behind(parent)


def clear_left_behind(parent: Path) -> None:
    """Remove what killed processes left in a folder: of this machine at once, of others after a week."""
    from filelock import SoftFileLock, Timeout

    for left in parent.glob(f"{HIDDEN}????????"):
        if _is_being_made(left):
            continue
        with suppress(OSError):
            if not (left / _LOCK).stat().st_size:  # killed while it made its lock
                (left / _LOCK).unlink()
                left.rmdir()
        if any(left.glob(f"{READY}/*")):  # files that the next one to write into their folder needs
            continue
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > 7 * 86400.0:
                shutil.rmtree(left, ignore_errors=True)
        with suppress(OSError, Timeout), SoftFileLock(left / _LOCK).acquire(timeout=0):
            shutil.rmtree(left, ignore_errors=True)


def _is_being_made(folder: Path) -> bool:
    """Whether a process may have made this folder a moment ago and not said yet, by its lock, that it is in use."""
    try:
        lock = folder / _LOCK
        if lock.exists() and lock.stat().st_size:
            return False
        return time.time() - max(path.stat().st_mtime for path in (folder, lock) if path.exists()) < 1.0
    except (OSError, ValueError):  # it went meanwhile
        return True
