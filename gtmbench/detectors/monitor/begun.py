"""Records that begin alike: what one bank makes of the rows that they share is worked out once.

The trials of a flight break one healthy record, each from its onset on. Up to there they are the same rows, whose
scores and noise a stream has taken already.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gtmbench.detectors.monitor.bank_stream import RecordStream
from gtmbench.detectors.monitor.residuals import RecordResiduals
from gtmbench.values.record import Record


class BegunWatch:
    """The beginning of a record that is taken once, for others that begin so.

    `begin`: gives a stream of the record that has taken nothing of it yet.
    """

    def __init__(self, record: Record, begin: Callable[[], RecordStream]) -> None:
        self._record, self._begin = record, begin
        self._taken, self._stop = begin(), 0

    def stream(self, residuals: RecordResiduals) -> RecordStream | None:
        """Return a stream of another record that has taken the rows that it shares with this one; None without any."""
        stop = self._shared(residuals.record)
        if not stop:
            return None
        if stop < self._stop:
            self._taken, self._stop = self._begin(), 0
        if stop > self._stop:
            self._taken.take_until(stop)
            self._stop = stop
        return self._taken.with_record(residuals)

    def _shared(self, record: Record) -> int:
        """Return how many rows two records share; none, where they differ otherwise."""
        mine = self._record
        if (mine.channels, mine.start_s, len(mine)) != (record.channels, record.start_s, len(record)):
            return 0
        is_same = ((mine.values == record.values) | (np.isnan(mine.values) & np.isnan(record.values))).all(axis=1)
        return len(record) if is_same.all() else int(np.argmin(is_same))
