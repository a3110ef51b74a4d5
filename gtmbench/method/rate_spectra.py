"""What a gyro reads beside the attitude's rate, frequency by frequency: how much of the one stands in the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record

_NEEDS = {"p": ("p", "phi", "theta", "q", "r"), "q": ("q", "phi", "theta", "r"), "r": ("r", *ATTITUDE, "q")}
_STEEP_DEG = 60.0  # beyond, one gyro's noise stands in another's rate
_WINDOW_S, _SHORTEST, _LONGEST = 2.5, 64, 1024  # of a spectrum; in samples
_MOST = 2000  # windows: of a longer log they are taken evenly
_LATE_S = 0.25  # at most, an attitude may be late or early
_OF_NYQUIST = 0.9  # of half the sample rate: beyond, differences tell little
_OF_ATTITUDE = 0.8  # likewise of half the rate at which an interpolated attitude is new
_STRAIGHT, _AROUND, _MANY = 0.05, 41, 0.45  # second differences below such a part of the greatest of so many; too many
_QUANTUM = 1e-6  # of the readings' range: closer readings differ by rounding

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class Gain:
    """How much of what a gyro reads in a band stands in the attitude's rate."""

    value: float  # of the regression of the rate on the gyro: 1 where all of it does, 0 where nothing
    deviation: float  # its standard error
    density: float  # the gyro's power by frequency there, (deg/s)^2/Hz
    of_density: float  # its standard error, as a share of it


@dataclass(frozen=True, kw_only=True, eq=False)
class RateSpectra:
    """Spectra of a gyro and of the attitude's rate about its axis, window by window."""

    frequency_hz: FloatArray
    # gyro, rate: shape (windows, frequencies)
    gyro: ComplexArray
    rate: ComplexArray
    # what the square of the gyro's elements has to be multiplied by to be its power by frequency, by frequency
    scale: FloatArray
    highest_hz: float  # up to which frequency attitude and gyro can tell
    quantum: float  # the step of the gyro's readings, where they stand on a grid, else 0

    @property
    def halves(self) -> tuple[BoolArray, BoolArray]:
        """Which windows are the quieter half by all that the gyro reads, which is motion before all, and the louder."""
        power = np.square(np.abs(self.gyro)).sum(axis=1)
        quiet = np.asarray(power <= np.median(power), dtype=np.bool_)
        return quiet, ~quiet

    def gain(self, low_hz: float, high_hz: float, windows: BoolArray) -> Gain | None:
        """Return how much of the gyro stands in the rate in a band, in some windows; None where too little is there.

        The rate may be late or early by a quarter of a second; the greatest gain of all delays is taken, so that what
        is called missing is missing at any.
        """
        bins = self._bins(low_hz, high_hz)
        if not bins.any() or np.count_nonzero(windows) < 4:
            return None
        y, z = self.gyro[np.ix_(windows, bins)], self.rate[np.ix_(windows, bins)]
        power = float(np.square(np.abs(y)).sum())
        if not power > 0.0:
            return None
        lags_s = np.arange(-_LATE_S, _LATE_S, 1.0 / (8.0 * high_hz))
        value = float(np.abs(self._at(lags_s, bins, windows)).max()) / power
        unexplained = max(float(np.square(np.abs(z)).sum()) / power - value**2, 0.0)
        density = float((np.square(np.abs(y)) * self.scale[bins]).mean())
        return Gain(
            value=value,
            deviation=float(np.sqrt(unexplained / y.size)),
            density=density,
            of_density=float(np.sqrt(2.0 / y.size)),  # windows overlap by half
        )

    def late_s(self, low_hz: float, high_hz: float, windows: BoolArray, step_s: float) -> float:
        """Return how late the rate follows the gyro in a band, in steps."""
        lags_s = np.arange(-_LATE_S, _LATE_S, step_s)
        return float(lags_s[np.argmax(self._at(lags_s, self._bins(low_hz, high_hz), windows).real)])

    def gain_at(self, low_hz: float, high_hz: float, windows: BoolArray, late_s: float) -> float:
        """Return how much of the gyro stands in the rate in a band, that much later."""
        bins = self._bins(low_hz, high_hz)
        power = float(np.square(np.abs(self.gyro[np.ix_(windows, bins)])).sum())
        return float(self._at(np.array([late_s]), bins, windows)[0].real) / power

    def _at(self, lags_s: FloatArray, bins: BoolArray, windows: BoolArray) -> ComplexArray:
        """Return the sum of cross spectra at some delays."""
        cross = (self.rate[np.ix_(windows, bins)] * self.gyro[np.ix_(windows, bins)].conj()).sum(axis=0)
        return np.asarray(np.exp(2j * np.pi * np.outer(lags_s, self.frequency_hz[bins])) @ cross)

    def _bins(self, low_hz: float, high_hz: float) -> BoolArray:
        return np.asarray((self.frequency_hz >= low_hz) & (self.frequency_hz < high_hz), dtype=np.bool_)


def spectra_of(records: Sequence[Record]) -> Mapping[str, RateSpectra]:
    """Return the spectra of every gyro that the records hold beside the angles that tell its rate.

    The attitude's rate is its step from sample to sample, the gyro the mean of both ends. That of phi tells p, with
    what q and r turn it taken off, that of theta q, that of psi r, so that noise of the heading spoils r alone.

    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((3000, 6))
    >>> spectra = spectra_of([gb.Record(noise, channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.02)])
    >>> sorted(spectra), spectra["p"].highest_hz
    (['p', 'q', 'r'], 22.5)
    """
    if not records:
        return {}
    period_s = records[0].sample_period_s
    alike = [each for each in records if np.isclose(each.sample_period_s, period_s, rtol=1e-6)]
    made = {}
    for gyro, needs in _NEEDS.items():
        beside = [pair for each in alike if set(needs) <= set(each.channels) for pair in _pairs(each, gyro)]
        spectra = _spectra(gyro, beside, alike, period_s) if beside else None
        if spectra is not None:
            made[gyro] = spectra
    return made


def _pairs(record: Record, gyro: str) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Give a gyro and the attitude's rate about its axis, halfway between samples, in deg/s."""
    angle = ATTITUDE[GYROS.index(gyro)]
    steps = np.diff(np.asarray(record[angle], dtype=np.float64))
    slope = (steps - 360.0 * np.rint(steps / 360.0)) / record.sample_period_s
    at = {name: _middle(np.asarray(record[name], dtype=np.float64)) for name in _NEEDS[gyro] if name != "psi"}
    with np.errstate(invalid="ignore"):
        steep = ~((np.abs(at["phi"]) < _STEEP_DEG) & (np.abs(at["theta"]) < _STEEP_DEG))
        phi, theta = np.radians(at["phi"]), np.radians(at["theta"])
        if gyro == "p":
            rate = slope - np.tan(theta) * (at["q"] * np.sin(phi) + at["r"] * np.cos(phi))
        elif gyro == "q":
            rate = (slope + at["r"] * np.sin(phi)) / np.cos(phi)
        else:
            rate = (slope * np.cos(theta) - at["q"] * np.sin(phi)) / np.cos(phi)
    yield at[gyro], np.where(steep, np.nan, rate)


def _middle(values: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (values[1:] + values[:-1]))


def _spectra(
    gyro: str, beside: Sequence[tuple[FloatArray, FloatArray]], records: Sequence[Record], period_s: float
) -> RateSpectra | None:
    length = int(np.clip(2 ** round(np.log2(_WINDOW_S / period_s)), _SHORTEST, _LONGEST))
    # windows that overlap by half (Welch), and hold no missing sample of either
    places = [
        (number, first)
        for number, (y, z) in enumerate(beside)
        for whole in [np.concatenate([[0], np.cumsum(np.isfinite(y) & np.isfinite(z))])]
        for first in range(0, len(y) - length + 1, length // 2)
        if whole[first + length] - whole[first] == length
    ]
    if len(places) < 8:
        return None
    taken = [places[k] for k in np.linspace(0, len(places) - 1, min(len(places), _MOST)).astype(int)]
    # periodic, so that halves that overlap add up to one
    window = np.hanning(length + 1)[:-1]
    y, z = (
        np.fft.rfft(_level(np.array([beside[number][of][first : first + length] for number, first in taken])) * window)
        for of in (0, 1)
    )
    angle = ATTITUDE[GYROS.index(gyro)]
    new_hz = min(_new_hz(record, angle) for record in records if angle in record.channels)
    frequency_hz = np.asarray(np.fft.rfftfreq(length, period_s), dtype=np.float64)
    # a gyro was averaged over two samples, to stand where the angle's difference does: its gain there is cos(pi f Ts)
    smoothed = np.maximum(np.cos(np.pi * frequency_hz * period_s), 1e-3)  # by the mean of two samples
    return RateSpectra(
        frequency_hz=frequency_hz,
        gyro=y,
        rate=z,
        scale=2.0 * period_s / float(np.square(window).sum()) / np.square(smoothed),
        highest_hz=0.5 * min(_OF_NYQUIST / period_s, new_hz),
        quantum=max(_quantum(np.asarray(record[gyro])) for record in records if gyro in record.channels),
    )


def _level(windows: FloatArray) -> FloatArray:
    """Return windows less their straight lines."""
    x = np.arange(windows.shape[1], dtype=np.float64)
    x -= x.mean()
    level = windows - windows.mean(axis=1, keepdims=True)
    return np.asarray(level - np.outer(level @ x / (x @ x), x))


def _new_hz(record: Record, angle: str) -> float:
    """Return how often an angle is new, by how many of its samples stand on a straight line with those beside them.

    An interpolated angle's do, and a held one's; of a coarse one some do, too, and it counts as slower than it is.
    """
    bends: Any = np.diff(np.unwrap(np.asarray(record[angle], dtype=np.float64), period=360.0), 2)
    bends = np.abs(bends[np.isfinite(bends)])
    if not len(bends):
        return 0.0
    # scipy.ndimage has such a filter, and takes longer to import than a flight to watch
    around = sliding_window_view(np.pad(bends, _AROUND // 2, mode="symmetric"), _AROUND).max(axis=1)
    straight = float(np.mean(bends <= _STRAIGHT * around))
    rate_hz = 1.0 / record.sample_period_s
    return rate_hz if straight < _MANY else _OF_ATTITUDE * rate_hz * (1.0 - straight) / 2.0


def _quantum(values: Any) -> float:
    """Return the step of the grid that readings stand on, 0 where they stand on none."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 2:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > _QUANTUM * (levels[-1] - levels[0])]
    return float(steps.min()) if len(steps) and len(levels) < 0.5 * np.count_nonzero(np.isfinite(values)) else 0.0
