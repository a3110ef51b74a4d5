"""Logs in an object store: listed, told apart, and fetched one at a time, by addresses as fsspec has them."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

from gtmbench.checks import one_line
from gtmbench.errors import GtmbenchError, InputError
from gtmbench.files.logs import LARGEST_LOG_BYTES
from gtmbench.files.writing import is_pattern
from gtmbench.imports import load_extra

_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+)://.+")  # a letter alone is a disk
Found = TypeVar("Found")


def is_address(source: object) -> TypeGuard[str]:
    """Tell whether a source is an object's, or many's, and not a file's.

    >>> is_address("s3://flights/monday.ulg"), is_address("flights/monday.ulg"), is_address("C:/monday.ulg")
    (True, False, False)
    """
    return isinstance(source, str) and _ADDRESS.fullmatch(source) is not None


def objects_in(address: str) -> list[str]:
    """Return the addresses of the objects that one means: of a folder or a pattern all that it holds."""
    system, path = _opened(address)

    def found() -> list[str]:
        if is_pattern(path):
            return [each for each in system.glob(path) if not system.isdir(each)]
        return system.find(path) if system.isdir(path) else [path] if system.exists(path) else []

    objects = [str(system.unstrip_protocol(each)) for each in _answer(address, found)]
    if not objects:
        raise InputError(f"{address}: there is no such object; give one, a folder of some, or a pattern")
    return objects


def object_digest(address: str) -> str:
    """Return what changes when an object does: a digest of what its store says of it, its size and tag."""
    system, path = _opened(address)
    return str(_answer(address, lambda: system.ukey(path)))[:16]


@contextmanager
def fetched(address: str) -> Iterator[Path]:
    """Give an object as a file of its name, which vanishes with the block."""
    system, path = _opened(address)
    size = _answer(address, lambda: system.size(path))
    if size is not None and size > LARGEST_LOG_BYTES:
        raise InputError(f"{address} has {size:.3g} bytes; a log of at most {LARGEST_LOG_BYTES:.3g} is read")
    with tempfile.TemporaryDirectory(prefix="gtmbench-") as folder:
        file = Path(folder, Path(path).name)
        _answer(address, lambda: system.get_file(path, str(file)))
        yield file


def _opened(address: str) -> tuple[Any, str]:
    """Return an address's file system, and the path in it."""
    core = load_extra("fsspec.core", "s3", f"{address} needs")
    try:
        system, path = core.url_to_fs(address)
    except ImportError as error:  # of the store's own package
        raise InputError(f"{address}: {one_line(str(error))}; of s3:// pip install 'gtmbench[s3]'") from error
    except ValueError as error:
        raise InputError(f"{address}: {one_line(str(error))}") from error
    return system, str(path)


def _answer(address: str, ask: Callable[[], Found]) -> Found:
    """Return what a store answers; whatever its library raises is one line."""
    try:
        return ask()
    except GtmbenchError:
        raise
    except FileNotFoundError as error:
        raise InputError(f"{address}: there is no such object") from error
    except Exception as error:  # each store has errors of its own
        why = one_line(f"{type(error).__name__}: {error}")
        raise InputError(f"{address}: its store doesn't give it ({why})") from error
