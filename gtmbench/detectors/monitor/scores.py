"""From residuals to scores: every statistic over its threshold, the greatest of a residual's being its score."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, bank_residuals
from gtmbench.detectors.statistics.statistic import MOST, Carried, Given, RawScore, Spread, over
from gtmbench.method.alarms import rising
from gtmbench.record import FloatArray, Record, sealed

IntArray = NDArray[np.int_]
_REMEMBERED_S = 60.0  # besides what the statistics look back at: how long a fault may last and what was before is known
_BLOCK = 8192  # samples at a time: what is worked out of them stays in the cache


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A residual's score that rises above 1.

    Attributes
    ----------
    output : str
        Whose residual.
    row : int
        Of the record; the residual of this row is known at `time_s`.
    time_s : float
        When the alarm could be raised: look-ahead counted.
    onset_row : int
        Where the change began, as far as the test tells.
    test : str
        Which test crossed, the one furthest above its threshold.
    """

    output: str
    row: int
    time_s: float
    onset_row: int
    test: str


class Origins:
    """Of the rows whose score is above 1: which test is the greatest, and where the change that it tells of began.

    Kept as arrays until a crossing asks: a lasting fault's rows are many, its crossings few.
    """

    def __init__(self) -> None:
        self._parts: list[tuple[str, IntArray, IntArray]] = []  # where two tell of a row, the later one counts

    def put(self, test: str, rows: IntArray, onset_rows: IntArray) -> None:
        """Take what a test says of rows, in their order."""
        self._parts.append((test, rows, onset_rows))

    def of(self, row: int) -> tuple[str, int]:
        """Return the test and the onset's row."""
        for test, rows, onset_rows in reversed(self._parts):
            at = int(np.searchsorted(rows, row))
            if at < len(rows) and rows[at] == row:
                return test, int(onset_rows[at])
        raise KeyError(row)

    def keep_before(self, row: int) -> None:
        """Forget a row and those after it."""
        kept = ((test, int(np.searchsorted(rows, row)), rows, onsets) for test, rows, onsets in self._parts)
        self._parts = [(test, rows[:count], onsets[:count]) for test, count, rows, onsets in kept if count]

    def clear(self) -> None:
        """Forget all."""
        self._parts.clear()


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualScore:
    """A residual's greatest statistic over its threshold, row for row; an alarm above 1.

    Attributes
    ----------
    values : shape (samples,)
        NaN where no statistic exists, or it isn't known by the end.
    known_s : shape (samples,)
        When each value is known, in seconds.
    origins : Origins
    """

    values: FloatArray = field(repr=False)
    known_s: FloatArray = field(repr=False)
    origins: Origins = field(repr=False)


class Track:
    """The score of one residual, as its rows come in; the same row for row, in whatever chunks.

    It remembers the last samples that exist: what its statistics look back at and a minute more, so that the rows of a
    fault that has ended can be taken out (`blot`) and those before it take their place. Of a fault that lasted longer,
    what was before is forgotten, and the residual is judged anew from then on.

    Parameters
    ----------
    monitor : CalibratedBank
    output : str
    """

    def __init__(self, monitor: CalibratedBank, output: str) -> None:
        self._test, self._period_s = monitor.bank.statistic, monitor.sample_period_s
        self._tolerance, self._whitener = monitor.tolerances[output], monitor.whiteners[output]
        self._thresholds = monitor.thresholds[output]
        self.order = self._whitener.order
        self.ahead = round(monitor.look_ahead_of(output) / self._period_s)
        self._history = round(monitor.history_of(output) / self._period_s)
        self._looks_back = self._test.looks_back(self._period_s)
        self._most = self._looks_back + round(_REMEMBERED_S / self._period_s)
        self._rows = np.zeros(0, dtype=int)  # of the samples that exist,
        self._samples: FloatArray | None = None  # and they: values, plain, uncertain share, variances of means
        self._judged = 0  # so many of them
        self._carried: Carried = {}
        self._fresh: list[tuple[int, float]] = []  # taken one by one
        self._missing = range(0)
        self._whole = True  # no rows have been taken out yet
        self._from = 0  # scores of rows before have been told
        self.first = 0  # row of the first of these:
        self.values = np.zeros(0)
        self.origins = Origins()

    @property
    def stop(self) -> int:
        """One past the last row that came in."""
        return self.first + len(self.values)

    def extend(self, raw: FloatArray, spread: Spread | None = None, *, before: int = 0) -> None:
        """Take the next rows of the residual; of those given, the first `before` were taken already.

        As many as the whitening filter is long are looked at.
        """
        begin = self.stop
        white = self._whitener.whiten(raw)[before:]
        raw = raw[before:]
        there, given = self._test.given(raw, white, spread)
        samples = _matrix(given)
        rows = there + begin if begin else there
        if self._missing and len(rows):
            kept = (rows < self._missing.start) | (rows >= self._missing.stop)
            rows, samples = rows[kept], samples[kept]
        self._flush()
        if self._samples is None:
            self._rows, self._samples = rows, samples
        else:
            self._rows = np.concatenate([self._rows, rows])
            self._samples = np.concatenate([self._samples, samples])
        self._open(len(raw))

    def take(self, row: int, white: float) -> bool:
        """Take the next row, whitened; return whether there is a sample."""
        there = math.isfinite(white) and row not in self._missing
        if there:
            self._fresh.append((row, min(max(white, -MOST), MOST)))
            if len(self._fresh) > _BLOCK:
                self._flush()
        return there

    def pass_over(self) -> None:
        """Say nothing of the row that was taken."""
        self.first += 1

    def reopen(self, there: bool) -> None:
        """Work out the score of the row that was taken, after all."""
        self._flush()
        self._judged -= there
        self._open(1)

    def latest(self) -> FloatArray:
        """Return the samples that a next one's statistics look back at."""
        self._flush()
        samples = np.zeros((0, 1)) if self._samples is None else self._samples
        return samples[max(len(samples) - self._looks_back, 0) :, 0]

    def known(self, first: int, stop: int) -> FloatArray:
        """Return the scores that become known with some rows of the record; NaN where there are none."""
        self._judge(stop - self.ahead)
        early = min(max(self.ahead - first, 0), stop - first)
        begin = first + early - self.ahead - self.first
        values = self.values[begin : begin + stop - first - early]
        return np.concatenate([np.full(early, np.nan), values]) if early else values

    def crossing(self, output: str, row: int, time_s: float) -> Crossing:
        """Return what is to be said of a score that rose at a row."""
        test, onset_row = self.origins.of(row)
        return Crossing(output=output, row=row, time_s=time_s, onset_row=onset_row, test=test)

    def blot(self, rows: range, row: int) -> None:
        """Treat rows of the record as missing, and those around that saw them; scores change from `row` on."""
        order = 0 if self._test.name == "energy" else self._whitener.order
        self._missing = range(rows.start - self._history, rows.stop + self._history + order)
        self._flush()
        before = int(np.searchsorted(self._rows, row))
        kept = slice(max(before - self._most, 0), None)
        out = (self._rows[kept] >= self._missing.start) & (self._rows[kept] < self._missing.stop)
        self._rows = self._rows[kept][~out]
        if self._samples is not None:
            self._samples = self._samples[kept][~out]
        self._judged, self._carried, self._whole = 0, {}, False
        self.values[max(row - self.first, 0) :] = np.nan
        self.origins.keep_before(row)
        self._from = row

    def forget(self) -> None:
        """Drop the scores that have been told, and the samples that won't be looked back at."""
        self._trim()
        self.first += len(self.values)
        self.values = np.zeros(0)
        self.origins.clear()

    def _trim(self) -> None:
        surplus = self._judged - self._most
        if surplus > 0 and self._samples is not None:
            self._rows, self._samples = self._rows[surplus:], self._samples[surplus:]
            self._judged -= surplus

    def _open(self, rows: int) -> None:
        longer = np.full(len(self.values) + rows, np.nan)
        longer[: len(self.values)] = self.values
        self.values = longer

    def _flush(self) -> None:
        """Put single rows to the others; they have been judged."""
        if self._fresh:
            rows, samples = (np.array(column) for column in zip(*self._fresh, strict=True))
            self._rows = np.concatenate([self._rows, rows])
            known = samples[:, np.newaxis]
            self._samples = known if self._samples is None else np.concatenate([self._samples, known])
            self._judged += len(rows)
            self._fresh.clear()
            self._trim()

    def _judge(self, stop: int) -> None:
        """Work out the scores of rows before `stop`."""
        if self._samples is None or self._judged == len(self._rows) or self._rows[self._judged] >= stop:
            return
        end = len(self._rows) if self._whole else int(np.searchsorted(self._rows, stop + _BLOCK))
        begin = max(self._judged - self._looks_back, 0)
        scratch = np.empty((5, min(_BLOCK, end - self._judged)))
        given = _given(self._samples[begin:end], self._test.rows(self._period_s), scratch)
        for first in range(self._judged, end, _BLOCK):
            self._judged = min(first + _BLOCK, end)
            at = range(first - begin, self._judged - begin)
            self._put(first, self._test.of(given, self._period_s, self._tolerance, at=at, carried=self._carried))

    def _put(self, first: int, raw_scores: Iterable[RawScore]) -> None:
        """Put the greatest of the scores of samples from the `first` on beside their rows."""
        rows = self._rows[first : self._judged]
        told = int(np.searchsorted(rows, max(self._from, self.first)))
        greatest = np.full(len(rows), -np.inf)
        for raw in raw_scores:
            score = over(raw.values, self._thresholds[raw.label])
            if np.fmax.reduce(score) > 1.0:
                higher = told + np.flatnonzero(score[told:] > np.maximum(greatest[told:], 1.0))
                reach = raw.reach if isinstance(raw.reach, int) else raw.reach[higher]
                onsets = np.maximum(first + higher - np.minimum(reach, self._looks_back), 0)
                self.origins.put(raw.label, rows[higher], self._rows[onsets])
            np.fmax(greatest, score, out=greatest)
        greatest[greatest == -np.inf] = np.nan
        self.values[rows[told:] - self.first] = greatest[told:]


def reach_of(monitor: CalibratedBank) -> int:
    """Return how many rows before a piece its residuals look back at, whitened, and with what uncertainty looks at."""
    most = 0
    for output, operator in monitor.operators.items():
        ahead = round(monitor.look_ahead_of(output) / monitor.sample_period_s)
        rows = ahead + operator.causal_order + monitor.whiteners[output].order + 2
        if output in monitor.uncertainties:
            rows += monitor.bank.statistic.looks_back(monitor.sample_period_s) + operator.noncausal_order
        most = max(most, rows)
    return most


def extend(
    tracks: Mapping[str, Track], residuals: BankResiduals, first: int, rows: range
) -> Iterator[tuple[str, int, FloatArray, Spread | None]]:
    """Let tracks take what some rows of the record make known; give what each took, and from which row on.

    Parameters
    ----------
    tracks : mapping of output to Track
    residuals : BankResiduals
        Of rows from `first` on, `reach_of` before these, up to their last.
    first : int
    rows : range
        They follow those that were taken.
    """
    for output, track in tracks.items():
        own = slice(max(rows.start - track.ahead, 0) - first, max(rows.stop - track.ahead, 0) - first)
        if own.stop > max(own.start, 0):
            spread = residuals.spread[output].between(own) if output in residuals.spread else None
            before = min(track.order, own.start)
            track.extend(residuals.raw[output][own.start - before : own.stop], spread, before=before)
            yield output, own.start + first, residuals.raw[output][own], spread


def residual_scores(monitor: CalibratedBank, record: Record, residuals: BankResiduals) -> dict[str, ResidualScore]:
    """Return every residual's score on a record."""
    scores = {}
    for output, raw in residuals.raw.items():
        track = Track(monitor, output)
        track.extend(raw, residuals.spread.get(output))
        track.known(0, len(record) + track.ahead)
        scores[output] = score_of(track, record)
    return scores


def score_of(track: Track, record: Record) -> ResidualScore:
    """Return what a track says of a whole record; nothing of rows that are known after its end."""
    values, known_s = track.values.copy(), record.time_s
    values[max(len(record) - track.ahead, 0) :] = np.nan
    known_s += track.ahead * record.sample_period_s
    return ResidualScore(
        values=sealed(values), known_s=sealed(np.round(known_s, 9, out=known_s)), origins=track.origins
    )


def crossings(scores: Mapping[str, ResidualScore]) -> list[Crossing]:
    """Return the rises above 1, in the order in which they can be known; missing values are passed over."""
    unsorted = []
    for output, score in scores.items():
        for row in rising(score.values, 1.0).tolist():
            test, onset_row = score.origins.of(row)
            time_s = float(score.known_s[row])
            unsorted.append(Crossing(output=output, row=row, time_s=time_s, onset_row=onset_row, test=test))
    return sorted(unsorted, key=lambda crossing: (crossing.time_s, crossing.output))


def bank_alarms(monitor: CalibratedBank, record: Record) -> list[Crossing]:
    """Return every alarm of a monitor on a record, without asking what it means; `watch` does."""
    return crossings(residual_scores(monitor, record, bank_residuals(monitor, record)))


def _matrix(given: Given) -> FloatArray:
    """Return what a statistic is made of as columns: one where nothing is uncertain."""
    if given.values is given.plain:
        return given.values[:, np.newaxis]
    return np.column_stack([given.values, given.plain, given.uncertain, *given.means.values()])


def _given(samples: FloatArray, windows: list[int], scratch: FloatArray) -> Given:
    values = np.ascontiguousarray(samples[:, 0])
    if samples.shape[1] == 1:
        return Given(values=values, plain=values, means={}, uncertain=values, scratch=scratch)
    means = dict(zip(windows, samples[:, 3:].T, strict=False))
    return Given(values=values, plain=samples[:, 1], means=means, uncertain=samples[:, 2], scratch=scratch)
