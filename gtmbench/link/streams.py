"""Standard input and files that a link comes from: lines as they are written, and links that were saved."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from gtmbench.errors import InputError
from gtmbench.files.disk import no_such
from gtmbench.link.packets import in_tlog
from gtmbench.link.source import MOST_BYTES, TICK_S, Delivery, HeldUp, LinkSource

_LOOKED_S = 0.02  # how often a file is looked at that grows


class InputSource(HeldUp):
    """Lines on standard input."""

    is_table = True

    def __init__(self, descriptor: int | None = None) -> None:
        super().__init__()
        self._input = sys.stdin.fileno() if descriptor is None else descriptor

    def _descriptor(self) -> int:
        return self._input

    def _received(self) -> Delivery | None:
        data = os.read(self._input, MOST_BYTES)
        return Delivery(time.time(), data) if data else None


class GrowingSource(HeldUp):
    """Lines of a file that another program is writing: those that are there, then those to come."""

    is_table = True

    def __init__(self, path: Path) -> None:
        super().__init__()
        if not path.is_file():
            raise InputError(no_such(path))
        self._file = path.open("rb", buffering=0)

    def close(self) -> None:
        """Close the file."""
        super().close()
        self._file.close()

    def _comes(self) -> bool:
        """Look for more until the tick is over: a file tells nobody that it grows."""
        until_s = time.monotonic() + TICK_S
        while time.monotonic() < until_s and not self._is_closed:
            if os.fstat(self._file.fileno()).st_size != self._file.tell():
                return True
            time.sleep(_LOOKED_S)
        return False

    def _received(self) -> Delivery | None:
        if os.fstat(self._file.fileno()).st_size < self._file.tell():
            self.ended = f"{self._file.name} has become shorter: it was begun anew; the watch ends here"
            return None
        return Delivery(time.time(), self._file.read(MOST_BYTES))


class SavedSource(LinkSource):
    """A link that was saved as a telemetry log: as fast as it is read, or at so many times its own speed."""

    is_live, is_whole = False, True

    def __init__(self, path: Path, speed: float | None = None) -> None:
        super().__init__()
        if not path.is_file():
            raise InputError(no_such(path))
        self._content, self._speed = path.read_bytes(), speed
        if next(in_tlog(self._content[: 1 << 20]), None) is None:
            raise InputError(f"{path} holds no MAVLink packets; a telemetry log (.tlog) is read, or - for lines of CSV")

    @property
    def waiting(self) -> int:
        """How many deliveries wait: all, where nobody says how fast they come."""
        return len(self._content) if self._speed is None else 0

    def deliveries(self) -> Iterator[Delivery | None]:
        """Give what arrived."""
        begun_s, first_s = time.monotonic(), None
        for arrived_s, data in in_tlog(self._content):
            first_s = arrived_s if first_s is None else first_s
            if self._speed is not None:
                wait_s = (arrived_s - first_s) / self._speed - (time.monotonic() - begun_s)
                if wait_s > 0.0:
                    time.sleep(wait_s)
            yield Delivery(arrived_s, data)
