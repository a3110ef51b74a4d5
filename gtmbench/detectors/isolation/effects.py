"""How a change of one sensor's readings shows in whitened residuals: linear, so that hypotheses needn't filter anew.

A residual e_o = y_o - (T u)_o is linear in its own output, and in a pseudo input's channel x to first order:
du = (df/dx) dx + (df/dx') dx', at the mean of what was read and what should have been, which leaves an error of third
order. Where an operator's input is the channel itself, it is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from typing import Any

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.isolation.bend import Bend
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, raw_needs, sensitivities
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import FloatArray, Record

ComplexArray = np.ndarray[Any, np.dtype[np.complex128]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """A way from a channel into a whitened residual: w(k) += sum over j of kernel_j u(k + ahead - j).

    u = of_value x + of_slope x', x' the central difference per second; x is a change of the channel, or what that
    bends of the angle that it goes through.
    """

    output: str
    kernel: FloatArray = field(repr=False)
    ahead: int
    of_value: float | FloatArray = field(repr=False)
    of_slope: FloatArray | None = field(repr=False)
    through: str = ""

    @property
    def is_alone(self) -> bool:
        """Whether it is the channel itself that enters: u = x."""
        is_direct = self.of_slope is None and not self.through
        return is_direct and np.ndim(self.of_value) == 0 and self.of_value == 1.0

    def later(self, start: int) -> Path:
        """Return the path for rows from `start` on."""
        of_value = self.of_value if isinstance(self.of_value, float) else self.of_value[start:]
        return replace(self, of_value=of_value, of_slope=None if self.of_slope is None else self.of_slope[start:])

    def drive(self, changes: FloatArray, sample_period_s: float) -> FloatArray:
        """Return u of changes, shape (changes, rows)."""
        driven = np.asarray(self.of_value * changes)
        if self.of_slope is not None:
            driven[:, 1:-1] += self.of_slope[1:-1] * (changes[:, 2:] - changes[:, :-2]) / (2.0 * sample_period_s)
        return driven

    def power(self, frequency: FloatArray, turned: ComplexArray, sample_period_s: float) -> FloatArray:
        """Return how much white noise on the channel shows in the whitened residual, at frequencies in rad a row."""
        gain = np.square(np.abs(turned[:, : len(self.kernel)] @ self.kernel))
        by = np.full(len(frequency), float(np.mean(np.square(self.of_value))))
        if self.of_slope is not None:
            by += float(np.mean(np.square(self.of_slope))) * np.square(np.sin(frequency) / sample_period_s)
        return np.asarray(gain * by)


def bent_paths(monitor: CalibratedBank, record: Record, channel: str, virtual: FloatArray) -> list[Path]:
    """Return all ways of a gyro that drives the attitude: its own, and by the angles that bend with it."""
    return [*paths_of(monitor, record, channel, virtual), *_by_angles(monitor, record)]


@lru_cache(maxsize=8)  # the same for every gyro, and for each of the estimators that are tried on a record
def _by_angles(monitor: CalibratedBank, record: Record) -> tuple[Path, ...]:
    angles = [angle for angle in ATTITUDE if angle in monitor.bank.channels]
    return tuple(
        replace(path, through=angle) for angle in angles for path in paths_of(monitor, record, angle, record[angle])
    )


def powers(
    paths: Sequence[Path], outputs: Sequence[str], frequency: FloatArray, period_s: float, bend: Bend | None
) -> FloatArray:
    """Return what white noise of unit variance on a channel makes of residuals, shape (outputs, frequencies).

    Ways of their own add up as powers; what goes through an angle is the same noise once more, so that these add up
    before.
    """
    found = np.zeros((len(outputs), len(frequency)))
    turned = _turned(frequency.tobytes(), max((len(path.kernel) for path in paths), default=0))
    if bend is None:
        for path in paths:
            found[outputs.index(path.output)] += path.power(frequency, turned, period_s)
        return found
    together = np.zeros(found.shape, dtype=complex)
    for path in paths:
        gain = turned[:, : len(path.kernel)] @ path.kernel * np.exp(1j * path.ahead * frequency)
        if path.through and path.of_slope is not None:
            gain = gain * bend.response(frequency, path.through, path.of_slope) * 1j * np.sin(frequency) / period_s
        together[outputs.index(path.output)] += 0.0 if path.through and path.of_slope is None else gain
    return np.asarray(np.square(np.abs(together)))


@lru_cache(maxsize=16)  # the same for all suspects of a case, and for all cases as long
def _turned(frequency: bytes, taps: int) -> ComplexArray:
    """Return what delays of 0, 1, ... rows make of frequencies, shape (frequencies, taps)."""
    return np.asarray(np.exp(-1j * np.outer(np.frombuffer(frequency), np.arange(taps))))


def outputs_of(monitor: CalibratedBank, channel: str) -> list[str]:
    """Return the residuals of a bank that a channel enters, as `paths_of` finds them."""
    return [
        spec.output
        for spec in monitor.bank.diagnostic
        if channel == spec.output or any(channel in raw_needs(name) for name in monitor.operators[spec.output].inputs)
    ]


def paths_of(monitor: CalibratedBank, record: Record, channel: str, virtual: FloatArray) -> list[Path]:
    """Return all ways of a channel into the residuals of a bank, about the mean of reading and virtual sensor."""
    middle = 0.5 * (record[channel] + np.where(np.isfinite(virtual), virtual, record[channel]))
    about = record.replace(channel, middle)
    paths = []
    names = {name for spec in monitor.bank.diagnostic for name in monitor.operators[spec.output].inputs}
    entered = [name for name in names if name in PSEUDO_INPUTS and channel in raw_needs(name)]
    found = np.nan_to_num(sensitivities(about, entered, channel)) if entered else np.zeros((0, 2, 0))
    slopes = dict(zip(entered, found, strict=True))
    for spec in monitor.bank.diagnostic:
        whitener, operator = monitor.whiteners[spec.output], monitor.operators[spec.output]
        taps = whitener.coefficients / whitener.deviation
        if channel == spec.output:
            paths.append(Path(output=spec.output, kernel=taps, ahead=0, of_value=1.0, of_slope=None))
        for i, name in enumerate(operator.inputs):
            if channel not in raw_needs(name):
                continue
            of_value: float | FloatArray = 1.0
            of_slope: FloatArray | None = None
            if name in slopes:
                of_value, of_slope = slopes[name]
            kernel = -np.convolve(operator.markov[:, 0, i], taps)
            ahead = operator.noncausal_order
            paths.append(Path(output=spec.output, kernel=kernel, ahead=ahead, of_value=of_value, of_slope=of_slope))
    return paths


class Effects:
    """What changes of a channel add to whitened residuals, by all of its paths.

    A residual's ways are added up as spectra: a change is transformed back once, however many ways it has.

    `rows`: how many rows a change has. `bend`: of the paths that go through an angle.
    """

    def __init__(
        self, paths: Sequence[Path], outputs: Sequence[str], rows: int, sample_period_s: float, bend: Bend | None = None
    ) -> None:
        from scipy.fft import next_fast_len

        self._period_s, self._bend, self._outputs = sample_period_s, bend, len(outputs)
        self._size = next_fast_len(rows + max((len(path.kernel) for path in paths), default=1), real=True)
        groups: dict[tuple[str, int, bool, bytes], list[Path]] = {}
        for path in paths:
            groups.setdefault((path.output, path.ahead, path.is_alone, path.kernel.tobytes()), []).append(path)
        kernels = np.zeros((len(groups), self._size))
        for kernel, (path, *_) in zip(kernels, groups.values(), strict=True):
            kernel[: len(path.kernel)] = path.kernel
            kernel[:] = np.roll(kernel, -path.ahead)
        places = (outputs.index(group[0].output) for group in groups.values())
        self._groups = list(zip(places, groups.values(), np.fft.rfft(kernels), strict=True))

    def of(self, changes: FloatArray, rows: slice) -> FloatArray:
        """Return what changes, shape (changes, rows), add in some of the rows: shape (changes, outputs, rows).

        Ways that a residual's operator takes together are added up before they are filtered.
        """
        bends = {} if self._bend is None else self._bend.of(changes)
        alone = np.fft.rfft(changes, self._size)
        shown = np.zeros((len(changes), self._outputs, alone.shape[1]), dtype=complex)
        for place, group, kernel in self._groups:
            driven = (each.drive(bends.get(each.through, changes), self._period_s) for each in group)
            spectrum = alone if group[0].is_alone else np.fft.rfft(reduce(np.add, driven), self._size)
            shown[:, place] += spectrum * kernel
        return np.fft.irfft(shown, self._size)[..., rows]
