"""What arrives, kept in order of arrival: a telemetry log that `gtmbench live`, `monitor` and ground stations read."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType
from typing import Self

_FLUSHED_S = 1.0


class SavedLink:
    """A telemetry log that is being written; what can't be written any more is told once, and the watch goes on.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._flushed_s = 0.0
        self.failure = ""

    def put(self, arrived_s: float, packet: bytes) -> None:
        """Write a packet."""
        if self.failure:
            return
        try:
            self._file.write(round(arrived_s * 1e6).to_bytes(8, "big") + packet)
            if time.monotonic() - self._flushed_s > _FLUSHED_S:  # what has arrived outlives a crash
                self._flushed_s = time.monotonic()
                self._file.flush()
        except OSError as error:
            self.failure = f"{self._file.name}: {error.strerror}; what arrives isn't saved any more, only watched"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or f"{self._file.name}: {error.strerror}"
