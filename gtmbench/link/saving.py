"""What arrives, kept in order of arrival: a log that `gtmbench monitor` reads, and `live` again where it is MAVLink."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

_FLUSHED_S = 1.0


class SavedLink:
    """A log of what arrives that is being written; what can't be written any more is told once, and the watch goes on.

    `is_table`: whether lines arrive, header first, and not packets.
    """

    def __init__(self, path: Path, *, is_table: bool = False) -> None:
        self.path = path
        self._file = path.open("wb")
        self._written: Callable[[float, bytes], bytes] = _line if is_table else _packet
        self._flushed_s = 0.0
        self.failure = ""

    def put(self, arrived_s: float, part: bytes) -> None:
        """Write a packet, or a line."""
        if self.failure:
            return
        try:
            self._file.write(self._written(arrived_s, part))
            if time.monotonic() - self._flushed_s > _FLUSHED_S:  # what has arrived outlives a crash
                self._flushed_s = time.monotonic()
                self._file.flush()
        except OSError as error:
            self.failure = f"{self.path}: {error.strerror}; what arrives isn't saved any more, only watched"

    def close(self) -> None:
        """Finish the file."""
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or f"{self.path}: {error.strerror}"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.close()


def _packet(arrived_s: float, packet: bytes) -> bytes:
    return round(arrived_s * 1e6).to_bytes(8, "big") + packet


def _line(_arrived_s: float, line: bytes) -> bytes:
    return line + b"\n"
