"""What a test leaves behind: recordings of what failed, and flights that the processes of its session share.

The pytest plugin imports this in every run of pytest, so it imports next to nothing itself.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(kw_only=True)
class Artefacts:
    """Where the test that runs leaves what."""

    folder: Path = Path("gtmbench-artefacts")  # of recordings
    name: str = "failed"  # of this test's recordings, as `file_name` makes it
    # the folder where the processes of a session share flights; None where there is one process
    flights: Path | None = None
    recordings: list[Path] = field(default_factory=list)  # those that were written so far

    def record(self, write: Callable[[Path], None]) -> str:
        """Write a recording; say where it is, or why there is none: what failed must be told in any case."""
        several = f"-{len(self.recordings) + 1}" if self.recordings else ""
        path = self.folder.absolute() / f"{self.name}{several}.rrd"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path)
        except Exception as error:  # whatever it is
            return f"no recording: {' '.join(str(error).split()) or type(error).__name__}"
        self.recordings.append(path)
        here = Path.cwd()
        return f"recording: {path.relative_to(here) if path.is_relative_to(here) else path}"


def file_name(test: str) -> str:
    """Return a file's name for a test: legal everywhere, another one for every test."""
    words = re.sub(r"[^A-Za-z0-9_]+", "-", test.replace(".py::", "-")).strip("-")[:100]  # letters of a test's name
    return f"{words}-{hashlib.sha256(test.encode()).hexdigest()[:8]}"


_running = [Artefacts()]  # the last counts: a test may run tests


def artefacts() -> Artefacts:
    """Return those of the test that runs; outside of pytest, of this process."""
    return _running[-1]


@contextmanager
def artefacts_in(test: Artefacts) -> Iterator[None]:
    """Let a test run that leaves its artefacts there."""
    _running.append(test)
    try:
        yield
    finally:
        _running.pop()
