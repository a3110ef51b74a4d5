"""The libraries that read containers: an extra, imported when a file needs one, and kept from printing."""

from __future__ import annotations

import contextlib
import importlib
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from gtmbench.errors import InputError


def library(name: str, path: Path, kind: str) -> ModuleType:
    """Import a module of the extra ``logs``, or say in one line how to get it."""
    try:
        with quiet():
            return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise InputError(
            f"{path} is a {kind}: reading it needs the package {package}; pip install 'gtmbench[logs]'"
        ) from error


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
