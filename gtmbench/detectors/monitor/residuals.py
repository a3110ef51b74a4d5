"""The residuals of a bank on a record: of a long one worked out where they are asked for, a piece at a time.

A day at 100 Hz has 8.64 million rows, and three residuals with their predictions are as large as its record. Who asks
for one gets it whole, and lets it go; the bank's own watch takes it in pieces.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, bank_residuals, residuals_of, spread_of
from gtmbench.detectors.isolation.case import LazyMapping
from gtmbench.detectors.monitor.scores import reach_of
from gtmbench.detectors.statistics.statistic import Spread
from gtmbench.values.pieces import pieces, rows_of_piece
from gtmbench.values.record import FloatArray, Record, check_record, sealed


class RecordResiduals:
    """A bank's residuals on a record with its channels."""

    def __init__(self, monitor: CalibratedBank, record: Record) -> None:
        check_record(record)
        record.check_period(monitor.sample_period_s, "the monitor was calibrated at")
        monitor.bank.check_channels(record.channels)
        self.monitor, self.record = monitor, record
        self._whole = bank_residuals(monitor, record) if len(record) <= rows_of_piece() else None
        self._reach = reach_of(monitor)

    def pieces(self) -> Iterator[range]:
        """Give the rows of the record, so many at a time as are worked out at once."""
        return (range(piece.start, piece.stop) for piece in pieces(len(self.record)))

    def part(self, rows: range) -> BankResiduals:
        """Return the residuals as some rows give them; those that stand on rows beside these are missing."""
        if self._whole is not None and len(rows) == len(self.record):
            return self._whole
        return bank_residuals(self.monitor, self.record.part(rows))

    @property
    def spread(self) -> Mapping[str, Spread]:
        """How far they may be off; of those that are uncertain."""
        if self._whole is not None:
            return self._whole.spread
        return LazyMapping(self.monitor.uncertainties, partial(spread_of, self.monitor, self.record), keeps=False)

    @property
    def raw(self) -> Mapping[str, FloatArray]:
        """e(k), by output."""
        if self._whole is not None:
            return self._whole.raw
        return LazyMapping(self.monitor.operators, partial(self._column, predicted=False), keeps=False)

    @property
    def predicted(self) -> Mapping[str, FloatArray]:
        """The virtual sensors, by the sensors that are watched with one."""
        outputs = tuple(spec.output for spec in self.monitor.bank.diagnostic)
        if self._whole is None:
            return LazyMapping(outputs, partial(self._column, predicted=True), keeps=False)
        return MappingProxyType({output: self._whole.predicted[output] for output in outputs})

    def _column(self, output: str, *, predicted: bool) -> FloatArray:
        """Return one of them for all of the record, worked out piece by piece."""
        column = np.full(len(self.record), np.nan)
        for piece in self.pieces():
            first, stop = max(piece.start - self._reach, 0), min(piece.stop + self._reach, len(self.record))
            record = self.record.part(range(first, stop))
            told = residuals_of(self.monitor.bank, record, self.monitor.operators, [output])
            values = told.predicted[output] if predicted else told.raw[output]
            column[piece.start : piece.stop] = values[piece.start - first : piece.stop - first]
        return sealed(column)
