"""The residuals of a bank on a record: of a long one worked out where they are asked for, a piece at a time.

A day at 100 Hz has 8.64 million rows, and three residuals with their predictions are as large as its record. Who asks
for one gets it whole, and lets it go; the bank's own watch takes it in pieces.

What a diagnosis may look at: the last minutes of a record, and its residuals.

A diagnosis computes residuals anew from the rows that it looks at: the same to the last bit, however the rows came in,
for fits and decisions turn on the last bit now and then.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, bank_residuals, residuals_of, spread_of
from gtmbench.detectors.isolation.case import WITNESSES, LazyMapping
from gtmbench.detectors.monitor.scores import reach_of
from gtmbench.detectors.statistics.statistic import Spread
from gtmbench.values.clock import even_times_s
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

    def part(self, rows: range, new: int) -> BankResiduals:
        """Return the residuals as some rows give them; those that stand on rows beside these are missing.

        `new`: the row from which on it is asked how far they may be off.
        """
        if self._whole is not None and len(rows) == len(self.record):
            return self._whole
        return bank_residuals(self.monitor, self.record.part(rows), new - rows.start)

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


class Memory:
    """Rows of the bank's channels and of witnesses, with residuals and spread beside them.

    `channels`: the bank's. `taken`: the channels, then the other `WITNESSES`: the columns of what is taken, NaN where a
    record has none. `start_s`: time of row 0. `capacity`: how many rows there is room for; the oldest half goes when it
    is used up.
    """

    def __init__(self, monitor: CalibratedBank, start_s: float, capacity: int) -> None:
        self._monitor = monitor
        self.start_s, self.period_s = start_s, monitor.sample_period_s
        self.channels, self.outputs = monitor.bank.channels, tuple(monitor.operators)
        self.taken = self.channels + tuple(name for name in WITNESSES if name not in self.channels)
        self._ahead = {output: round(monitor.look_ahead_of(output) / self.period_s) for output in self.outputs}
        self._history = {output: round(monitor.history_of(output) / self.period_s) for output in self.outputs}
        self._uncertain = tuple(output for output in self.outputs if output in monitor.uncertainties)
        beside = [("raw", output) for output in self.outputs]
        beside += [(kind, output) for output in self._uncertain for kind in ("spread", "white")]
        self._columns = {name: len(self.taken) + i for i, name in enumerate(beside)}
        self._table = np.full((max(capacity, 1), len(self.taken) + len(self._columns)), np.nan)  # taken, then beside it
        self._blots: list[tuple[str, range]] = []
        self._left_out: list[tuple[str, range]] = []
        self.first, self.stop = 0, 0  # rows that are there

    def take(self, values: FloatArray) -> None:
        """Take the next rows, shape (rows, taken)."""
        self._make_room(len(values))
        begin = self.stop - self.first
        self._table[begin : begin + len(values), : len(self.taken)] = values
        self.stop += len(values)

    def put(self, output: str, row: int, raw: FloatArray, spread: Spread | None = None) -> None:
        """Put a residual beside rows that were taken, from `row` on."""
        begin = max(row - self.first, 0)
        for name, values in _beside(output, raw, spread).items():
            late = values[begin - (row - self.first) :]
            self._table[begin : begin + len(late), self._columns[name]] = late

    def take_one(self, row: list[float]) -> None:
        """Take the next row."""
        if self.stop - self.first == len(self._table):
            self._make_room(1)
        self._table[self.stop - self.first, : len(row)] = row
        self.stop += 1

    def reading(self, row: int, channel: int) -> float:
        """Return what a channel, by its number, read at a row."""
        return float(self._table[row - self.first, channel])

    def put_one(self, output: str, row: int, raw: float) -> float:
        """Put a residual beside a row, and return it."""
        self._table[row - self.first, self._columns["raw", output]] = raw
        return raw

    def raw_before(self, output: str, stop: int) -> FloatArray:
        """Return the residuals that are known before a row of the record, at most a thousand."""
        end = stop - self._ahead[output]
        rows = range(max(end - 1000, self.first, 0), end)
        return self._column(("raw", output), rows)

    def blot(self, output: str, rows: range) -> None:
        """Treat rows of a residual as missing, and those around that saw them."""
        self._blots = [blot for blot in self._blots if blot[1].stop > self.first]
        self._blots.append(self._widened(output, rows))

    def leave_out(self, out: Iterable[tuple[str, range]]) -> None:
        """Treat so some rows of residuals, and no longer those that were left out before."""
        self._left_out = [self._widened(output, rows) for output, rows in out]

    def _widened(self, output: str, rows: range) -> tuple[str, range]:
        reach = self._history[output]
        return output, range(rows.start - reach, rows.stop + reach)

    def residuals(self, rows: range, outputs: tuple[str, ...]) -> BankResiduals:
        """Return residuals and predictions as rows and those before them give them; what was blotted out is missing."""
        lead = min(max(self._history.values()) + 2, rows.start - self.first)
        whole = residuals_of(
            self._monitor.bank, self.record(range(rows.start - lead, rows.stop)), self._monitor.operators, outputs
        )
        raw = {output: np.array(whole.raw[output][lead:]) for output in outputs}
        for output, out in (*self._blots, *self._left_out):
            if output in raw:
                raw[output][max(out.start - rows.start, 0) : max(out.stop - rows.start, 0)] = np.nan
        return BankResiduals(raw=raw, predicted={output: whole.predicted[output][lead:] for output in outputs})

    def back_to(self, stop: int) -> FloatArray:
        """Forget the rows from one on, and return what was taken of them."""
        values = self._table[stop - self.first : self.stop - self.first, : len(self.taken)].copy()
        self._blots = [blot for blot in self._blots if blot[1].start < stop]
        self.stop = stop
        return values

    def cut(self, rows: range, outputs: tuple[str, ...]) -> tuple[Record, BankResiduals]:
        """Return rows as they were known at their end, witnesses that are there among them.

        Residuals that stand on samples to come are missing.
        """
        residuals = self.residuals(rows, outputs)
        known = {output: np.arange(len(rows)) < len(rows) - self._ahead[output] for output in outputs}
        return self.witnessed(rows), BankResiduals(
            raw={output: np.where(known[output], residuals.raw[output], np.nan) for output in outputs},
            predicted={output: np.where(known[output], residuals.predicted[output], np.nan) for output in outputs},
            spread={
                output: Spread(raw=self._column(("spread", output), rows), white=self._column(("white", output), rows))
                for output in outputs
                if output in self._uncertain
            },
        )

    def record(self, rows: range) -> Record:
        """Return rows of the channels."""
        return self._record(rows, self.channels)

    def witnessed(self, rows: range) -> Record:
        """Return rows of the channels, and of the witnesses that are there."""
        return self._record(rows, self._there(rows))

    def _there(self, rows: range) -> tuple[str, ...]:
        """Return the channels, and the witnesses that read anything in some rows."""
        first = len(self.channels)
        values = self._table[rows.start - self.first : rows.stop - self.first, first : len(self.taken)]
        beside = zip(self.taken[first:], values.T, strict=True)
        return self.channels + tuple(name for name, readings in beside if np.isfinite(readings).any())

    def _record(self, rows: range, names: tuple[str, ...]) -> Record:
        values = self._table[rows.start - self.first : rows.stop - self.first, : len(self.taken)]
        if names != self.taken[: len(names)]:
            values = values[:, [self.taken.index(name) for name in names]]
        return Record(
            values[:, : len(names)],
            channels=names,
            sample_period_s=self.period_s,
            start_s=self.start_s + round(rows.start * self.period_s, 9),
        )

    def time_s(self, row: int) -> float:
        """Return the time of a row."""
        return float(even_times_s(self.start_s, self.period_s, range(row, row + 1))[0])

    def _column(self, name: tuple[str, str], rows: range) -> FloatArray:
        return self._table[rows.start - self.first : rows.stop - self.first, self._columns[name]]

    def _make_room(self, rows: int) -> None:
        held, capacity = self.stop - self.first, len(self._table)
        if held + rows <= capacity:
            return
        keep = min(held, capacity // 2)
        larger = np.full((max(capacity, keep + rows), self._table.shape[1]), np.nan)
        larger[:keep] = self._table[held - keep : held]
        self._table, self.first = larger, self.stop - keep


def _beside(output: str, raw: FloatArray, spread: Spread | None) -> dict[tuple[str, str], FloatArray]:
    """Return what stands beside the channels, by column."""
    columns = {("raw", output): raw}
    if spread is not None:
        columns |= {("spread", output): spread.raw, ("white", output): spread.white}
    return columns
