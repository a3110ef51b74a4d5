"""Residuals and scores of single samples, at the price of a few small arrays."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.monitor.residuals import Memory
from gtmbench.detectors.monitor.scores import IntArray, ScoreTrack
from gtmbench.detectors.statistics.learnt_noise import lasting, lasting_rows, second_order
from gtmbench.detectors.statistics.statistic import Steadiness, glr, least_baseline, ordinary_powers
from gtmbench.detectors.statistics.whitening import LOUD
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, Motion, derive, factor_of
from gtmbench.values.record import FloatArray


class RowByRow:
    """Everything from a sample to the scores that it makes known, for banks with likelihood ratios.

    `memory`: what is read and worked out is put there. `tracks`, by output: they get the whitened residuals, and stay
    able to go on.
    """

    def __init__(self, monitor: CalibratedBank, memory: Memory, tracks: Mapping[str, ScoreTrack]) -> None:
        self._memory, self._names = memory, sorted(tracks)
        self._channels = {name: i for i, name in enumerate(monitor.bank.channels)}
        self._lines = [_Residual(monitor, memory, tracks[output], output, i) for i, output in enumerate(self._names)]
        self._ratios = _Ratios(monitor, self._names)
        names = {name for line in self._lines for name in (line.output, *line.inputs)}
        self._pseudo = tuple(name for name in names if name in PSEUDO_INPUTS)
        self._factors = {name: factor_of(name) for name in monitor.bank.channels}
        self._reach = max(line.taps for line in self._lines) + 2
        self._period_s = monitor.sample_period_s
        self._before: list[float] = []  # the last three samples
        self._middle: list[float] = []
        self._latest: list[float] = []
        self.is_stale = True

    @staticmethod
    def can(monitor: CalibratedBank) -> bool:
        """Tell whether there is a path for single samples: likelihood ratios, nothing uncertain."""
        above_0 = all(value > 0.0 for own in monitor.thresholds.values() for value in own.values())
        return monitor.bank.statistic.name == "glr" and not monitor.uncertainties and above_0

    def take(self, row: list[float]) -> list[float] | None:
        """Take a sample, the bank's channels first; return the scores, sorted by name; None where arrays have to."""
        at = self._memory.stop
        if at < 2 * self._reach or math.inf in map(abs, row):
            return None
        if self.is_stale:
            self._load(at)
        self._memory.take_one(row)
        self._before, self._middle = self._middle, self._latest
        self._latest = row
        derived = self._derived() if self._pseudo else {}
        for line in self._lines:
            x = self._middle if line.is_late else row
            if line.is_early:
                line.read(derived[line.output])
            line.take([derived[name] if name in derived else x[self._channels[name]] for name in line.inputs], at)
        return self._ratios.scores([line.white for line in self._lines], [line.is_there for line in self._lines])

    @property
    def may_be_spike(self) -> bool:
        """Whether the sample taken is loud, so that the test of spikes has to be asked."""
        return any(line.is_loud for line in self._lines)

    def pass_over(self) -> None:
        """Nothing comes of the sample taken."""
        for line in self._lines:
            before = line.is_learnt, line.track.outliers
            line.track.pass_over()
            if line.is_stale:
                line.load_whitening()
                self._ratios.steadiness(line.place, line.unsteady, line.slow)
                self.is_stale |= (line.is_learnt, line.track.outliers) != before  # samples aren't what was told of them

    def reopen(self) -> None:
        """Something may come of the sample taken: its scores are worked out as those of chunks are."""
        for line in self._lines:
            line.track.reopen()

    def _derived(self) -> dict[str, float]:
        """Return the pseudo inputs at the middle one of three samples, in the units of the table."""
        middle, ends = self._middle, (self._before, self._latest)

        def channel(name: str) -> float:
            return middle[self._channels[name]] * self._factors[name]

        def slope(name: str) -> float:
            at, factor = self._channels[name], self._factors[name]
            step = ends[1][at] * factor - ends[0][at] * factor
            if abs(step) > math.pi:  # a heading that runs from 360 deg to 0
                step -= 2.0 * math.pi * round(step / (2.0 * math.pi))
            return step / (2.0 * self._period_s)

        motion = Motion(self._channels, channel, slope)
        return {name: float(motion(name)) * (180.0 / math.pi) for name in self._pseudo}

    def _load(self, at: int) -> None:
        """Take over from chunks."""
        record = self._memory.record(range(at - self._reach, at))
        wanted = derive(record, self._pseudo) if self._pseudo else record
        self._middle, self._latest = record.values[-2:].tolist()
        for line in self._lines:
            inputs = wanted.matrix(line.inputs)
            line.load(inputs[: len(inputs) - line.is_late], self._memory.raw_before(line.output, at))
            if line.is_early:
                line.load_read(wanted[line.output][:-1])
            line.load_whitening()
            self._ratios.steadiness(line.place, line.unsteady, line.slow)
        self._ratios.load([line.track.latest() for line in self._lines])
        self.is_stale = False


class _Residual:
    """One residual's way from its inputs to white noise."""

    def __init__(self, monitor: CalibratedBank, memory: Memory, track: ScoreTrack, output: str, place: int) -> None:
        operator = monitor.operators[output]
        self.output, self.track, self.inputs, self.place = output, track, operator.inputs, place
        self.is_early = output in PSEUDO_INPUTS
        self.is_late = track.ahead > operator.noncausal_order  # a derivative needs the next sample
        self.taps = len(operator.markov)
        self.white, self.is_there, self.is_loud = math.nan, False, False
        self._memory, self._column = memory, -1 if self.is_early else monitor.bank.channels.index(output)
        self._y = _Window(max(track.ahead, 1), 1)  # of an early one, its output from the row that is judged on
        self._markov = np.ascontiguousarray(operator.markov[::-1, 0, :]).ravel()  # oldest row first
        self._offset = float(operator.output_means[0] - (operator.markov[:, 0, :] @ operator.input_means).sum())
        self.is_learnt = False
        self._order = monitor.whiteners[output].order + second_order(monitor.sample_period_s)
        self._x = _Window(self.taps, len(operator.inputs))
        self._e = _Window(self._order + 1, 1)
        self._alike = 0  # rows that are whitened by what was loaded
        self._whitening, self._mean = np.zeros(self._order + 1), 0.0
        self.unsteady = self.slow = 0.0
        self._most = self._loudest = 0.0
        self._sizes = deque([0.0], lasting_rows(monitor.sample_period_s))  # of the last ones, before they are clipped

    def take(self, x: list[float], at: int) -> None:
        """Take the inputs that sample `at` of the record makes known."""
        row = at - self.track.ahead
        hat = float(self._markov.dot(self._x.push(x))) + self._offset
        read = float(self._y.latest()[0]) if self.is_early else self._memory.reading(row, self._column)
        e = self._memory.put_one(self.output, row, read - hat if math.isfinite(hat) else math.nan)
        self._alike -= 1
        latest = self._e.push(e)
        self.is_there = self.is_loud = False
        if self.is_learnt:
            white = float(self._whitening.dot(latest)) - self._mean
            self.is_there = math.isfinite(white) and self.track.is_heard(row)
            self.white = white
            self._sizes.append(abs(white))
            self.is_loud = self.is_there and self._sizes[-1] > LOUD  # or so it seems, without its neighbours
            if self._sizes[-1] > self._most:
                most = max(self._loudest if abs(white) > 2.0 * self._most else self._most, lasting(self._sizes))
                self.white = min(max(white, -most), most)
        self.track.take(e)

    @property
    def is_stale(self) -> bool:
        """Whether the next row is whitened otherwise."""
        return self._alike <= 0

    def load_whitening(self) -> None:
        """Take what the next rows are whitened by."""
        whitener = self.track.whitener
        self._alike, self.is_learnt = max(self.track.rows_alike, 1), self.track.rows_alike > 0
        if self.is_learnt:
            self._whitening = whitener.coefficients[::-1] / whitener.deviation
            self._mean = float(whitener.mean * self._whitening.sum())
            self._most, self._loudest = whitener.most, whitener.loudest
            self.unsteady, self.slow = whitener.unsteady, whitener.slow

    def read(self, output: float) -> None:
        """Take an early one's output at the sample before the last."""
        self._y.push(output)

    def load_read(self, outputs: FloatArray) -> None:
        """Begin with an early one's outputs before."""
        self._y.load(outputs[:, np.newaxis])

    def load(self, inputs: FloatArray, raw: FloatArray) -> None:
        """Begin with the inputs and the residuals before."""
        self._x.load(inputs)
        self._e.load(raw[:, np.newaxis])
        self._sizes.extend(self.track.sizes.tolist())


class _Window:
    """The last rows of a few columns, as one vector, oldest first."""

    def __init__(self, rows: int, columns: int) -> None:
        self._rows, self._at = rows, 0
        self._table = np.full((rows + 4096, columns), np.nan)
        self._flat, self._columns = self._table.ravel(), columns

    def push(self, row: list[float] | float) -> FloatArray:
        """Add a row; return the window that it ends."""
        if self._at == len(self._table):
            self.load(self._table)
        self._table[self._at] = row
        self._at += 1
        return self.latest()

    def latest(self) -> FloatArray:
        """Return the window that the last row ended."""
        return self._flat[(self._at - self._rows) * self._columns : self._at * self._columns]

    def load(self, table: FloatArray) -> None:
        """Begin with the end of a table."""
        last = table[max(len(table) - self._rows, 0) :].copy()
        self._table[: self._rows - len(last)] = np.nan
        self._table[self._rows - len(last) : self._rows] = last
        self._at = self._rows


class _Ratios:
    """The scores of all residuals at once, from running sums of their whitened samples and of their squares."""

    def __init__(self, monitor: CalibratedBank, outputs: list[str]) -> None:
        test, period_s = monitor.bank.statistic, monitor.sample_period_s
        self._most = test.looks_back(period_s)
        self._capacity = self._most + 8192
        self._rows = np.array(test.rows(period_s))
        self._windows = self._rows.astype(float)
        self._longest = max(round(test.baseline_s / period_s), 6)
        tolerances = [monitor.tolerances[output] for output in outputs]
        self._mean, self._low, self._high = (
            np.array([[getattr(tolerance, name)] for tolerance in tolerances]) for name in ("mean", "low", "high")
        )
        self._low = self._low if test.two_sided else np.zeros_like(self._low)
        labels = [f"{rows * period_s:g} s" for rows in self._rows.tolist()]
        thresholds = [monitor.thresholds[output] for output in outputs]
        self._of_mean = np.array([[own[f"mean {label}"] for label in labels] for own in thresholds])
        self._of_energy = np.array([[own[f"energy {label}"] for label in labels] for own in thresholds])
        self._sums = np.zeros((2, len(outputs), self._capacity))
        self._flat = self._sums.ravel()
        self._counts = [0] * len(outputs)
        self._totals = [[0.0, 0.0] for _ in outputs]
        line = np.arange(len(outputs))[:, np.newaxis] * self._capacity
        end = line - self._rows
        self._places: IntArray = np.array([end, end - self._longest, end + len(outputs) * self._capacity])
        self._first: IntArray = np.array([line, line, line + len(outputs) * self._capacity])
        self._full = np.full(len(self._rows), float(self._longest))
        self._chance = 1.0 / self._windows + 1.0 / self._full
        self._unsteady, self._slow = np.zeros((2, len(outputs), 1))
        self._steadiness = Steadiness.of(self._unsteady)
        # between these, ratios are below their thresholds, however steady the noise is
        self._near = self._mean + np.sqrt(2.0 * self._of_mean * self._chance)
        powers = [
            [ordinary_powers(rows, nats) for rows, nats in zip(self._rows.tolist(), own, strict=True)]
            for own in self._of_energy.tolist()
        ]
        self._least, self._loudest = np.moveaxis(np.array(powers), 2, 0) * np.array([self._low, self._high])

    def steadiness(self, i: int, unsteady: float, slow: float) -> None:
        """Take how steady and how slow the noise of a residual is."""
        self._unsteady[i], self._slow[i] = unsteady, slow
        self._steadiness = Steadiness.of(self._unsteady)

    def load(self, samples: list[FloatArray]) -> None:
        """Begin with the samples before."""
        for i, values in enumerate(samples):
            self._counts[i] = len(values)
            for which, summands in enumerate((values, values * values)):
                self._sums[which, i, 0] = 0.0
                np.cumsum(summands, out=self._sums[which, i, 1 : len(values) + 1])
                self._totals[i][which] = float(self._sums[which, i, len(values)])

    def scores(self, white: list[float], there: list[bool]) -> list[float]:
        """Take a sample of every residual; return the scores, NaN where there is none.

        Where all are below 1 by what they can be at most, which costs less, they are 0.
        """
        sums, counts = self._sums, self._counts
        # running sums S(k) of samples and of their squares: any window's are a difference of two
        for i, (value, is_there) in enumerate(zip(white, there, strict=True)):
            if is_there:
                if counts[i] + 1 == self._capacity:
                    self._make_room(i)
                counts[i] += 1
                total = self._totals[i]
                total[0] += value
                total[1] += value * value
                sums[0, i, counts[i]], sums[1, i, counts[i]] = total
        # where the windows' ends stand in these sums, for all residuals and windows in one `take`
        least = min(counts)
        steps: int | IntArray = least if least == max(counts) else np.array(counts)[:, np.newaxis]
        places: IntArray = self._places + steps
        length, chance = self._full, self._chance
        # the baseline isn't full yet: as long as it is, or none where a ninth isn't there
        if least < self._most:
            short = np.maximum(np.minimum(np.array(counts)[:, np.newaxis] - self._rows, self._longest), 0)
            length = np.where(short >= least_baseline(self._longest), short, np.nan)
            chance = 1.0 / self._windows + 1.0 / np.maximum(length, 1.0)
            np.maximum(places, self._first, out=places)
        ends, begins, squares = self._flat.take(places)
        # mean m1 of a window, m0 of the baseline before it, and E (w - m0)^2 = E w^2 - (m1 + (m1 - m0)) m0
        totals = np.array(self._totals)
        mean = (totals[:, :1] - ends) / self._windows
        base = (ends - begins) / length
        shift = mean - base
        power = (totals[:, 1:] - squares) / self._windows - (mean + shift) * base
        # here most samples end: no ratio can reach its threshold
        if least >= self._most and self._is_ordinary(shift, power):
            return [0.0 if is_there else math.nan for is_there in there]
        of_mean, of_energy = glr(
            shift,
            np.maximum(power, 1e-12),
            self._windows,
            chance + 2.0 * self._slow,
            self._mean,
            self._low,
            self._high,
            self._steadiness,
        )
        over = np.maximum(of_mean / self._of_mean, of_energy / self._of_energy)
        greatest: list[float] = np.fmax.reduce(over, axis=1).tolist()
        return [value if is_there else math.nan for value, is_there in zip(greatest, there, strict=True)]

    def _is_ordinary(self, shift: FloatArray, power: FloatArray) -> bool:
        near = (np.abs(shift) < self._near) & (power > self._least) & (power < self._loudest)
        return bool(near.all())

    def _make_room(self, i: int) -> None:
        """Move what is looked back at to the front, and let the sums begin there."""
        begin = self._counts[i] - self._most
        kept = self._sums[:, i, begin : self._counts[i] + 1]
        self._sums[:, i, : self._most + 1] = kept - kept[:, :1]
        self._counts[i] = self._most
        self._totals[i] = self._sums[:, i, self._most].tolist()
