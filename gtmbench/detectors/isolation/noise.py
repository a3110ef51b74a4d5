"""Faults that are noise: white or a random walk on a suspect's readings, by its spectrum; or a few samples off."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from gtmbench.detectors.isolation.case import own
from gtmbench.detectors.isolation.columns import spaced, vertex
from gtmbench.detectors.isolation.effects import powers
from gtmbench.detectors.isolation.suspect import Left, Suspect
from gtmbench.values.record import FloatArray

_VARIANCES = np.geomspace(1e-3, 1e5, 27)  # of noise that a fault adds, over the noise that is there
_BINS = 72  # of a periodogram
_FINE = 24  # of them that hold one frequency
_LEAST = 0.5  # of its own noise, that a sensor's new noise is at least: gusts make as much
_CHANCE, _KNOWN = 1.0, 0.02  # of a bin, by chance half; of a spectrum
_TURNS = 4  # of the search, each between the best one's neighbours
_BAND, _BAND_HZ = 0.1, 0.2  # a band's half width: of its frequency, and beside that
_SPIKE = 20.0  # of -2 log likelihood, that a spike explains

Indices = np.ndarray[Any, np.dtype[np.int_]]


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseFit:
    """Noise fitted to what is left of a suspect's residuals."""

    left: Left = field(repr=False)
    variance: float  # of the noise, of a walk's steps
    spread: float  # the standard error of its logarithm; NaN where the record doesn't tell
    # how far the periodogram is from its spectrum, over what chance makes: up to 1 it is noise of that kind
    misfit: float

    def denser(self, volume: float) -> NoiseFit:
        """Return the fit of a density that is so much denser, in -2 log likelihood."""
        return replace(self, left=self.left.denser(volume))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Spectra:
    """What residuals' spectra S are with noise of all variances that are tried: of no residual, so worked out once."""

    variances: FloatArray  # shape (variances,)
    logs: FloatArray  # shape (variances,): sums of log S
    inverse: FloatArray  # shape (variances, outputs * bins): 1/S

    @classmethod
    def of(cls, power: FloatArray, counts: FloatArray, least: float = 0.0) -> _Spectra:
        variances = _VARIANCES / max(float(np.median(power, axis=1).max()), 1e-12)  # where it shows most
        if least > 0.0:
            variances = spaced(least, max(variances[-1], 4.0 * least), len(variances))
        spectra = 1.0 + np.outer(variances, power)
        return cls(variances=variances, logs=np.log(spectra) @ counts.ravel(), inverse=1.0 / spectra)

    def deviances(self, binned: FloatArray) -> FloatArray:
        """Return -2 log likelihood of periodograms, shape (any, outputs * bins), of each variance."""
        return np.asarray(self.logs + binned @ self.inverse.T)

    def misfits(self, binned: FloatArray, counts: FloatArray, places: Indices) -> FloatArray:
        """Return Itakura's and Saito's distances of periodograms from a spectrum each, over the most that is chance.

        It is the sum over bins of n (r - 1 - log r) for n lines whose mean is r times the spectrum, half by chance
        of every bin. Spectra of healthy residuals are themselves known to a few percent. Without a line nothing fits.
        """
        lines = 0.5 * counts.ravel()
        there = lines > 0.0
        if not there.any():
            return np.full(len(binned), math.inf)
        lines = lines[there]
        ratio = np.maximum(0.5 * binned[:, there] * self.inverse[places][:, there] / lines, 1e-9)
        distance = np.sum(lines * (ratio - 1.0 - np.log(ratio)), axis=1)
        return np.asarray(distance / (_CHANCE * float(len(lines)) + _KNOWN * float(lines.sum())))


class FittedNoise:
    """Whittle's likelihood of a suspect's residuals: the sum over frequencies of log S + I/S.

    I is the periodogram, S = 1 + variance power(frequency) what healthy noise and the fault's have together, power what
    the ways from the readings make of white noise; that of a random walk is 1/(4 sin(w/2)^2) times it. Frequencies are
    taken together in bins, for S is smooth.
    """

    def __init__(self, suspect: Suspect) -> None:
        self._suspect, self._there = suspect, suspect.there

    def fits(self, lefts: Sequence[Left]) -> list[tuple[NoiseFit, NoiseFit]]:
        """Return the best white noise and the best random walk on the readings, of each of what is left otherwise."""
        if not lefts:
            return []
        binned = self._binned(np.array([left.work_out() for left in lefts]))
        return list(zip(self._best(lefts, binned, self._white), self._best(lefts, binned, self._walk), strict=True))

    def band(self, left: Left, frequency_hz: float) -> NoiseFit:
        """Return the best noise around a frequency: a tone that comes and goes, or whose phase wanders."""
        rad_hz = 2.0 * np.pi * self._suspect.case.period_s
        width = rad_hz * (_BAND * frequency_hz + _BAND_HZ)
        band = 1.0 / (1.0 + np.square((self._frequency - rad_hz * frequency_hz) / width))
        spectra = _Spectra.of(self._power * band, self._counts)
        (fit,) = self._best([left], self._binned(left.work_out()[np.newaxis]), spectra)
        return replace(fit, variance=fit.variance * width)  # of all that is in the band

    def _binned(self, lefts: FloatArray) -> FloatArray:
        """Return periodograms of what is left, shape (any, outputs, rows), in bins: shape (any, outputs * bins)."""
        weights, _, edges = self._bins
        counts = np.maximum(self._there.sum(axis=1, keepdims=True), 1)
        lines = np.fft.rfft(lefts if self._suspect.is_whole else np.where(self._there, lefts, 0.0), self._size)
        power = (np.square(lines.real) + np.square(lines.imag)) * (weights / counts)
        return np.asarray(np.add.reduceat(power, edges, axis=-1).reshape(len(lefts), -1))

    def _best(self, lefts: Sequence[Left], binned: FloatArray, spectra: _Spectra) -> Iterator[NoiseFit]:
        logs, totals = np.log(spectra.variances), spectra.deviances(binned)
        places = totals.argmin(axis=1)
        misfits = spectra.misfits(binned, self._residual_counts, places).tolist()
        for left, total, place, misfit in zip(lefts, totals, places.tolist(), misfits, strict=True):
            at, spread = _bottom(logs, total, place)
            noisy = Left(deviance=float(total[place]), outputs=left.outputs, work_out=left.work_out)
            yield NoiseFit(left=noisy, variance=math.exp(at), spread=spread, misfit=misfit)

    @cached_property
    def _white(self) -> _Spectra:
        habit = self._suspect.case.habits.get(self._suspect.channel)
        return _Spectra.of(self._power, self._counts, 0.0 if habit is None else _LEAST * habit.variance)

    @cached_property
    def _walk(self) -> _Spectra:
        """Of a walk: where it ends isn't where it began, and a periodogram takes that step for as much power again."""
        suspect = self._suspect
        step = powers(suspect.paths, suspect.outputs, np.zeros(1), suspect.case.period_s, suspect.bend)
        slopes = np.maximum(4.0 * np.square(np.sin(self._frequency / 2.0)), 1e-4)
        return _Spectra.of((self._power + step) / slopes, self._counts)

    @cached_property
    def _counts(self) -> FloatArray:
        """How many samples each bin of each residual tells as much as, shape (outputs, bins)."""
        weights, _, edges = self._bins
        return np.asarray(np.add.reduceat(weights, edges) * self._there.mean(axis=1, keepdims=True))

    @cached_property
    def _residual_counts(self) -> FloatArray:
        """The same of residuals alone: a sensor's own innovations aren't white where it is healthy."""
        suspect = self._suspect
        residuals = [[output != own(suspect.channel)] for output in suspect.outputs]
        return np.asarray(self._counts * np.array(residuals, dtype=float))

    @cached_property
    def _bins(self) -> tuple[FloatArray, FloatArray, Indices]:
        """Return weights and angular frequencies of a periodogram's lines, and where bins of them begin."""
        return _bins(self._suspect.white.shape[1], self._size)

    @cached_property
    def _size(self) -> int:
        """Of a periodogram: at least the rows, and fast."""
        from scipy.fft import next_fast_len

        return int(next_fast_len(self._suspect.white.shape[1], real=True))

    @cached_property
    def _frequency(self) -> FloatArray:
        weights, frequency, edges = self._bins
        return np.asarray(np.add.reduceat(weights * frequency, edges) / np.add.reduceat(weights, edges))

    @cached_property
    def _power(self) -> FloatArray:
        """What white noise of unit variance on the readings makes of the residuals, shape (outputs, bins)."""
        suspect = self._suspect
        return powers(suspect.paths, suspect.outputs, self._frequency, suspect.case.period_s, suspect.bend)


@lru_cache(maxsize=64)  # the same for all suspects of a case, and for all cases as long
def _bins(rows: int, size: int) -> tuple[FloatArray, FloatArray, Indices]:
    lines = size // 2 + 1
    weights = np.full(lines, 2.0 * rows / size)  # they count as many as there are samples
    weights[0] = rows / size
    if size % 2 == 0:
        weights[-1] = rows / size
    edges: Indices = np.concatenate([np.arange(_FINE), np.geomspace(_FINE, max(lines, _FINE + 1), _BINS).astype(int)])
    edges = np.unique(edges[edges < lines])
    return weights, np.asarray(np.arange(lines) * (2.0 * np.pi / size)), edges


def spikes_of(suspect: Suspect) -> tuple[Left, tuple[float, float], tuple[float, float]] | None:
    """Find single samples that are off in a suspect's innovations; None where none is.

    Return what is left without them, how large they are and how many a second, and the standard errors of both.
    A spike shows there as the filter's own shape; each costs its place and its size.
    """
    habit = suspect.case.habits.get(suspect.channel)
    if habit is None:
        return None
    taps = habit.taps
    sizes = spikes_in(suspect.filled[suspect.outputs.index(own(suspect.channel))], taps)
    rows = np.flatnonzero(sizes)
    if not len(rows):
        return None
    changes = np.zeros((1, len(suspect.measured)))
    changes[0, rows + suspect.judged.start] = sizes[rows]
    left = suspect.plain(suspect.white - suspect.shown(changes)[0])
    cost = 2.0 * len(rows) * float(np.log(len(sizes)))
    rate_hz = len(rows) / (len(sizes) * suspect.case.period_s)
    size = float(np.median(np.abs(sizes[rows])))
    errors = float(1.0 / np.sqrt(len(rows) * (taps @ taps))), rate_hz / float(np.sqrt(len(rows)))
    return replace(left, deviance=left.deviance + cost), (size, rate_hz), errors


def spikes_in(innovations: FloatArray, taps: FloatArray) -> FloatArray:
    """Return the sizes of single samples that are off, row by row, the largest found and taken away first.

    One shows in as many innovations as the filter has taps, and its neighbours' best sizes are echoes of it.
    """
    left, power = innovations.copy(), float(taps @ taps)
    sizes = np.zeros_like(left)

    def take(row: int) -> None:
        after = slice(row, row + len(taps))
        size = float(left[after] @ taps[: len(left) - row]) / power
        sizes[row] += size
        left[after] -= size * taps[: len(left) - row]

    for _ in range(len(left) // 10):
        gains = np.square(np.correlate(left, taps, "full")[len(taps) - 1 :]) / power
        if gains.max() < _SPIKE:
            break
        take(int(np.argmax(gains)))
    for row in _TURNS * np.flatnonzero(sizes).tolist():  # neighbours' echoes were in the first ones' sizes
        take(row)
    return sizes


def _bottom(logs: FloatArray, deviances: FloatArray, best: int) -> tuple[float, float]:
    """Return the logarithm of the likeliest variance, by the parabola there, and the standard error of that."""
    if not 0 < best < len(logs) - 1:
        return float(logs[best]), float("nan")
    at, bend = vertex(logs[best - 1 : best + 2], deviances[best - 1 : best + 2])
    return (at, float(1.0 / np.sqrt(bend))) if bend > 0.0 else (float(logs[best]), float("nan"))
