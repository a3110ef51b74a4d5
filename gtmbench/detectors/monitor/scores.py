"""From residuals to scores: every statistic over its threshold, the greatest of a residual's being its score."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, bank_residuals
from gtmbench.detectors.statistics.learnt_noise import NoiseFollower, follower
from gtmbench.detectors.statistics.spikes import THRESHOLD, spike_scores
from gtmbench.detectors.statistics.statistic import Allowance, Carried, Given, RawScore, Spread, Statistic, over
from gtmbench.detectors.statistics.whitening import White, Whitener
from gtmbench.method.residual import rising
from gtmbench.values.clock import even_times_s
from gtmbench.values.record import FloatArray, Record

IntArray = NDArray[np.int_]
_REMEMBERED_S = 60.0  # besides what the statistics look back at: how long a fault may last and what was before is known
_KEPT = 100  # rows more than whatever is whitened anew looks at
_BLOCK = 8192  # samples at a time: what is worked out of them stays in the cache


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A residual's score that rises above 1."""

    output: str  # whose residual
    row: int  # of the record; the residual of this row is known at `time_s`
    time_s: float  # when the alarm could be raised: look-ahead counted
    onset_row: int  # where the change began, as far as the test tells
    test: str  # which test crossed, the one furthest above its threshold


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


class ScoreTrack:
    """The score of one residual, as its rows come in; the same row for row, in whatever chunks.

    It remembers the last samples that exist: what its statistics look back at and a minute more, so that the rows of a
    fault that has ended can be taken out (`blot`) and those before it take their place. Of a fault that lasted longer,
    what was before is forgotten, and the residual is judged anew from then on.

    `whitener`: of the calibration. `noise`: follows the residual's; None where that is judged as it is. `ahead`: after
    how many rows a row's score is known. `history`: how many rows before one it looks at. `tells_spikes`: whether they
    have a test of their own.
    """

    def __init__(
        self,
        test: Statistic,
        sample_period_s: float,
        whitener: Whitener,
        tolerance: Allowance,
        thresholds: Mapping[str, float],
        noise: NoiseFollower | None,
        *,
        ahead: int = 0,
        history: int = 0,
        tells_spikes: bool = False,
    ) -> None:
        self._test, self._period_s, self._tells_spikes = test, sample_period_s, tells_spikes
        self._calibrated, self._tolerance, self._thresholds = whitener, tolerance, thresholds
        self.noise = noise
        self.knows_before = noise is not None and noise.is_learnt  # so that the first score may be an alarm
        self.ahead, self._history = ahead, history
        self._looks_back = self._test.looks_back(self._period_s)
        self._most = self._looks_back + round(_REMEMBERED_S / self._period_s)
        self._raw: FloatArray = np.zeros(0)  # the rows that came in last: they may have to be whitened anew
        self._spread: Spread | None = None  # theirs
        self._taken = 0  # rows that came in
        self._rows = np.zeros(0, dtype=int)  # of the samples that exist,
        self._samples: FloatArray | None = None  # and they: as `_matrix` has them
        self._judged = 0  # so many of them
        self._carried: Carried = {}
        self._fresh: list[float] = []  # rows taken one by one, raw
        self._missing = range(0)
        self._whole = True  # no rows have been taken out yet
        self._from = 0  # scores of rows before have been told
        self.first = 0  # row of the first of these:
        self.values = np.zeros(0)
        self._last = np.zeros(0)  # the score before these that exists, if any
        self.origins = Origins()

    @classmethod
    def of(
        cls, monitor: CalibratedBank, output: str, before: FloatArray | None = None, *, tells_spikes: bool = True
    ) -> ScoreTrack:
        """Return the track of a bank's residual.

        `before`, shape (rows,): of the same sensors' healthy residual, on which their noise is learnt before watching
        begins.
        """
        test, period_s, whitener = monitor.bank.statistic, monitor.sample_period_s, monitor.whiteners[output]
        return cls(
            test,
            period_s,
            whitener,
            monitor.tolerances[output],
            monitor.thresholds[output],
            None if monitor.knows_noise else follower(whitener, period_s, before),
            ahead=round(monitor.look_ahead_of(output) / period_s),
            history=round(monitor.history_of(output) / period_s),
            tells_spikes=tells_spikes and test.name == "glr",
        )

    @property
    def stop(self) -> int:
        """One past the last row that came in."""
        return self.first + len(self.values)

    @property
    def whitener(self) -> Whitener:
        """What the next row is whitened by, as far as it has been learnt."""
        self._flush()
        return self._calibrated if self.noise is None else self.noise.whitener

    def whitener_at(self, row: int) -> Whitener:
        """Return what a row was whitened by, one of the last."""
        self._flush()
        return self._calibrated if self.noise is None else self.noise.whitener_at(row)

    @property
    def sizes(self) -> FloatArray:
        """Of the last rows, whitened, before they were clipped; none while the noise isn't learnt."""
        self._flush()
        return np.zeros(0) if self.noise is None or not self.noise.is_learnt else self.noise.sizes

    @property
    def level(self) -> float:
        """The noise's deviation over that of the calibration, as it was first learnt; NaN where it wasn't."""
        return math.nan if self.noise is None else self.noise.first_level

    @property
    def outliers(self) -> int:
        """How many gross outliers have left an echo."""
        return 0 if self.noise is None else self.noise.outliers

    @property
    def rows_alike(self) -> int:
        """How many rows, the next first, are whitened alike; 0 while that isn't known."""
        return 0 if self.noise is None else max(self.noise.rows_alike - len(self._fresh), 0)

    def extend(self, raw: FloatArray, spread: Spread | None = None) -> None:
        """Take the next rows of the residual."""
        self._flush()
        self._take(raw, spread)
        self._open(len(raw))

    def push(self, raw: FloatArray, spread: Spread | None = None) -> FloatArray:
        """Take the next rows of the residual and return their scores, whenever these are known; NaN without one."""
        self.forget()
        self.extend(raw, spread)
        return self.known(self.first + self.ahead, self.stop + self.ahead)

    def until(self, row: int, noise: NoiseFollower | None, held: FloatArray, spread: Spread | None) -> ScoreTrack:
        """Return a track that has taken the rows before one as this has, which has forgotten none.

        `noise`: as it was then. `held`, with their spread: rows that it hasn't told of yet.
        """
        other, count = copy.copy(self), int(np.searchsorted(self._rows, row))
        kept = slice(max(count - self._looks_back, 0), count)
        other.noise, other._raw, other._spread, other._taken = noise, held, spread, row
        other._rows, other._samples = self._rows[kept], None if self._samples is None else self._samples[kept]
        other._judged, other._carried = len(other._rows), {}
        other.first, other.values, other.origins = row, np.zeros(0), Origins()
        return other

    def take(self, raw: float) -> None:
        """Take the next row alone; nothing is worked out of it yet."""
        self._fresh.append(raw)

    def is_heard(self, row: int) -> bool:
        """Tell whether a row may be a sample: it hasn't been taken out."""
        return row not in self._missing

    def pass_over(self) -> None:
        """Say nothing of the row that was taken."""
        self.first += 1
        if not self.rows_alike:
            self._flush()

    def reopen(self) -> None:
        """Work out the score of the row that was taken, after all."""
        self._flush()
        if len(self._rows) and self._rows[-1] == self.first:
            self._judged = len(self._rows) - 1
        self._open(1)

    def latest(self) -> FloatArray:
        """Return the samples that a next one's statistics look back at."""
        self._flush()
        samples = np.zeros((0, 1)) if self._samples is None else self._samples
        return samples[max(len(samples) - self._looks_back, 0) :, 0]

    def samples(self, rows: range, before: int) -> tuple[FloatArray, FloatArray]:
        """Return the samples of some of the last rows, and at most so many before these."""
        first, stop = np.searchsorted(self._rows, [rows.start, rows.stop]).tolist()
        values = np.zeros(0) if self._samples is None else self._samples[:, 0]
        return values[first:stop], values[max(first - before, 0) : first]

    def _take(self, raw: FloatArray, spread: Spread | None) -> None:
        """Whiten rows: samples, with those before that had been waiting for the noise to be learnt."""
        self._raw = np.concatenate([self._raw, raw])
        if spread is not None:
            self._spread = spread if self._spread is None else Spread.joined([self._spread, spread])
        self._taken += len(raw)
        if self.noise is None:
            self._put_samples(White.steady(raw), self._taken)
            return
        white = self.noise.push(raw, None if spread is None else spread.white)
        self._put_samples(white, self.noise.row)

    def _put_samples(self, white: White, stop: int) -> None:
        """Add the samples of rows before `stop`."""
        first = stop - len(white)
        own = slice(first - self._taken + len(self._raw), stop - self._taken + len(self._raw))
        spread = None if self._spread is None else self._spread.between(own)
        there, given = self._test.given(self._raw[own], white, spread)
        samples, rows = _matrix(given), there + first
        if self._missing and len(rows):
            kept = (rows < self._missing.start) | (rows >= self._missing.stop)
            rows, samples = rows[kept], samples[kept]
        self._rows = np.concatenate([self._rows, rows])
        self._samples = samples if self._samples is None else np.concatenate([self._samples, samples])

    def known(self, first: int, stop: int) -> FloatArray:
        """Return the scores that become known with some rows of the record; NaN where there are none."""
        self._judge(stop - self.ahead)
        early = min(max(self.ahead - first, 0), stop - first)
        begin = first + early - self.ahead - self.first
        values = self.values[begin : begin + stop - first - early]
        return np.concatenate([np.full(early, np.nan), values]) if early else values

    def crossing(self, output: str, row: int, start_s: float) -> Crossing:
        """Return what is to be said of a score that rose at a row; row 0 is at `start_s`."""
        test, onset_row = self.origins.of(row)
        known_s = even_times_s(start_s, self._period_s, range(row, row + 1)) + self.ahead * self._period_s
        time_s = float(np.round(known_s, 9)[0])
        return Crossing(output=output, row=row, time_s=time_s, onset_row=onset_row, test=test)

    def rises(self, output: str, start_s: float) -> list[Crossing]:
        """Return where scores rise above 1 that haven't been forgotten; missing ones are passed over."""
        rows = rising(np.concatenate([self._last, self.values]), 1.0) - len(self._last) + self.first
        return [self.crossing(output, row, start_s) for row in rows.tolist()]

    def blot(self, rows: range, row: int, *, anew: bool = False) -> None:
        """Treat rows of the record as missing, and those around that saw them; scores change from `row` on.

        From there on the noise is learnt `anew`, where what was there has become the noise.
        """
        self._flush()
        order = 0 if self.noise is None else self.noise.order
        self._missing = range(rows.start - self._history, rows.stop + self._history + order)
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
        if anew and self.noise is not None:
            self._learn_anew(row)

    def _learn_anew(self, row: int) -> None:
        """Whiten the rows from one on by the noise that is learnt from there."""
        self._rows = self._rows[:0]
        self._samples = None if self._samples is None else self._samples[:0]
        begin = max(len(self._raw) - (self._taken - row), 0)
        raw, spread = self._raw, self._spread
        self.noise = NoiseFollower(
            self._calibrated, self._period_s, row=self._taken - len(raw) + begin, before=raw[:begin]
        )
        self._taken -= len(raw) - begin
        self._raw, self._spread = raw[:begin], None if spread is None else spread.between(slice(begin))
        self._take(raw[begin:], None if spread is None else spread.between(slice(begin, None)))

    def forget(self) -> None:
        """Drop the scores that have been told, and the samples that won't be looked back at."""
        self._trim()
        self.first += len(self.values)
        there = self.values[~np.isnan(self.values)]
        self._last, self.values = there[-1:] if len(there) else self._last, np.zeros(0)
        self.origins.clear()

    def _trim(self) -> None:
        surplus = self._judged - self._most
        if surplus > 0 and self._samples is not None:
            self._rows, self._samples = self._rows[surplus:], self._samples[surplus:]
            self._judged -= surplus
        noise = self.noise
        keep = 0 if noise is None else self._taken - noise.row + noise.order + self.ahead + _KEPT
        old = len(self._raw) - keep
        if old > 0:
            self._raw = self._raw[old:]
            self._spread = None if self._spread is None else self._spread.between(slice(old, None))
            if noise is not None:
                noise.drop_before(self._taken - len(self._raw))

    def _open(self, rows: int) -> None:
        longer = np.full(len(self.values) + rows, np.nan)
        longer[: len(self.values)] = self.values
        self.values = longer

    def _flush(self) -> None:
        """Put single rows to the others; they have been judged."""
        if self._fresh:
            fresh, self._fresh = np.array(self._fresh), []
            self._take(fresh, None)
            self._judged = len(self._rows)
            self._trim()

    def _judge(self, stop: int) -> None:
        """Work out the scores of rows before `stop`."""
        if self._samples is None or self._judged == len(self._rows) or self._rows[self._judged] >= stop:
            return
        end = len(self._rows) if self._whole else int(np.searchsorted(self._rows, stop + _BLOCK))
        begin = max(self._judged - self._looks_back, 0)
        given = _given_of(self._samples[begin:end], self._test.rows(self._period_s))
        for first in range(self._judged, end, _BLOCK):
            self._judged = min(first + _BLOCK, end)
            at = range(first - begin, self._judged - begin)
            self._put(first, self._scores(given, at))

    def _scores(self, given: Given, at: range) -> Iterator[RawScore]:
        """Give the scores of some samples: the bank's own test, and behind whitening that of spikes."""
        yield from self._test.of(given, self._period_s, self._tolerance, at=at, carried=self._carried)
        if self._tells_spikes:
            yield from spike_scores(given.loud, self._period_s, self._looks_back, at)

    def _put(self, first: int, raw_scores: Iterable[RawScore]) -> None:
        """Put the greatest of the scores of samples from the `first` on beside their rows."""
        rows = self._rows[first : self._judged]
        told = int(np.searchsorted(rows, max(self._from, self.first)))
        greatest = np.full(len(rows), -np.inf)
        for raw in raw_scores:
            score = over(raw.values, self._thresholds.get(raw.label, THRESHOLD))
            if np.fmax.reduce(score) > 1.0:
                higher = told + np.flatnonzero(score[told:] > np.maximum(greatest[told:], 1.0))
                reach = raw.reach if isinstance(raw.reach, int) else raw.reach[higher]
                onsets = np.maximum(first + higher - np.minimum(reach, self._looks_back), 0)
                self.origins.put(raw.label, rows[higher], self._rows[onsets])
            np.fmax(greatest, score, out=greatest)
        greatest[greatest == -np.inf] = np.nan
        for late in () if self.noise is None else self.noise.first_rows:
            greatest[slice(*np.searchsorted(rows, [late.start, late.stop]))] = np.nan
        self.values[rows[told:] - self.first] = greatest[told:]


def reach_of(monitor: CalibratedBank) -> int:
    """Return how many rows before a piece its residuals look back at, and with what uncertainty looks at."""
    most = 0
    for output, operator in monitor.operators.items():
        ahead = round(monitor.look_ahead_of(output) / monitor.sample_period_s)
        rows = ahead + operator.causal_order + 2
        if output in monitor.uncertainties:
            rows += monitor.bank.statistic.looks_back(monitor.sample_period_s) + operator.noncausal_order
            rows += monitor.whiteners[output].order
        most = max(most, rows)
    return most


def extend(
    tracks: Mapping[str, ScoreTrack], residuals: BankResiduals, first: int, rows: range
) -> Iterator[tuple[str, int, FloatArray, Spread | None]]:
    """Let tracks take what some rows of the record make known; give what each took, and from which row on.

    `tracks`, by output. `residuals`: of rows from `first` on, `reach_of` before these, up to their last. `rows`: they
    follow those that were taken.
    """
    for output, track in tracks.items():
        own = slice(max(rows.start - track.ahead, 0) - first, max(rows.stop - track.ahead, 0) - first)
        if own.stop > max(own.start, 0):
            spread = residuals.spread[output].between(own) if output in residuals.spread else None
            track.extend(residuals.raw[output][own], spread)
            yield output, own.start + first, residuals.raw[output][own], spread


def rises_in(
    tracks: Mapping[str, ScoreTrack], residuals: BankResiduals, first: int, rows: range, start_s: float
) -> list[Crossing]:
    """Let tracks take what some rows make known, as `extend` does; return where scores rise, and forget them."""
    _ = list(extend(tracks, residuals, first, rows))
    found: list[Crossing] = []
    for output, track in tracks.items():
        track.known(rows.start, rows.stop)
        found += track.rises(output, start_s)
        track.forget()
    return found


def residual_scores(monitor: CalibratedBank, record: Record, residuals: BankResiduals) -> dict[str, ScoreTrack]:
    """Return every residual's track of a record, with the scores that are known by its end."""
    tracks = {output: ScoreTrack.of(monitor, output) for output in residuals.raw}
    rows = range(len(record))
    _ = list(extend(tracks, residuals, 0, rows))
    for track in tracks.values():
        track.known(0, len(rows))
    return tracks


def crossings(tracks: Mapping[str, ScoreTrack], start_s: float) -> list[Crossing]:
    """Return the rises above 1, in the order in which they can be known."""
    found = [crossing for output, track in tracks.items() for crossing in track.rises(output, start_s)]
    return sorted(found, key=lambda crossing: (crossing.time_s, crossing.output))


def bank_alarms(monitor: CalibratedBank, record: Record) -> list[Crossing]:
    """Return every alarm of a monitor on a record, without asking what it means; `watch` does."""
    return crossings(residual_scores(monitor, record, bank_residuals(monitor, record)), record.start_s)


def _matrix(given: Given) -> FloatArray:
    """Return samples as rows: values, how steady and how slow their noise is; of uncertain operators all else, too."""
    noise = (given.values, given.unsteady, given.slow, given.loud)
    if given.values is given.plain:
        return np.column_stack(noise)
    return np.column_stack([*noise, given.plain, given.uncertain, *given.means.values()])


def _given_of(samples: FloatArray, windows: list[int]) -> Given:
    values, unsteady, slow, loud = (np.ascontiguousarray(samples[:, i]) for i in range(4))
    plain, uncertain, means = (values, values, {})
    if samples.shape[1] > 4:
        plain, uncertain = samples[:, 4], samples[:, 5]
        means = dict(zip(windows, samples[:, 6:].T, strict=False))
    return Given(values=values, plain=plain, means=means, uncertain=uncertain, unsteady=unsteady, slow=slow, loud=loud)
