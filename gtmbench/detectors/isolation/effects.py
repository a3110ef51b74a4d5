"""How a change of one sensor's readings shows in whitened residuals: linear, so that hypotheses needn't filter anew.

A residual e_o = y_o - (T u)_o is linear in its own output, and in a pseudo input's channel x to first order:
du = (df/dx) dx + (df/dx') dx', at the mean of what was read and what should have been, which leaves an error of third
order. Where an operator's input is the channel itself, it is exact.

How an attitude that the gyros drive bends with one of them: linear, about what was read.

The estimator integrates the broken gyro, so a fault is in the attitude's rate at once, and what the two leave of it is
how the references pull the attitude back: of a change u of a gyro near wings level, u / (tau s + 1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, reduce
from typing import Any

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, raw_needs, sensitivities
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.attitude_estimators import AttitudeEstimator, filtered
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record

# what an estimator may be that nobody tells of: each a factor of two or so from the next, which few faults tell apart
CANDIDATES = (
    *(AttitudeEstimator(time_constant_s=tau) for tau in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)),
    *(AttitudeEstimator(time_constant_s=tau, bias_time_constant_s=4.0 * tau) for tau in (2.0, 5.0, 15.0)),
)
_TURNS = 3  # how often one angle's bend is passed on to the others


class Bend:
    """What changes of a gyro's readings do to the attitude.

    With B(k) how the gyro enters the angles' rates and A(k) what an error of the angles adds to them, d' = A d + B u
    through the estimator's response; A d is passed on three times, which is exact to third order in the turn.

    `record`: about what it is linear. `start`: the record's row from which on there are changes. `channel`: p, q or r.
    `sharpness`: how the gyros' samples are to be sharpened before they are integrated, as `sharpness_of` finds it.
    """

    def __init__(
        self, estimator: AttitudeEstimator, record: Record, start: int, channel: str, sharpness: float = 0.0
    ) -> None:
        self.estimator, self.record, self._start, self._channel = estimator, record, start, channel
        self._sharpness = sharpness
        self._period_s = record.sample_period_s
        phi, theta, q, r = (_radians(record, name)[start:] for name in ("phi", "theta", "q", "r"))
        sin, cos, tan, secant = np.sin(phi), np.cos(phi), np.tan(theta), 1.0 / np.cos(theta)
        turn, pitch = q * sin + r * cos, q * cos - r * sin
        none, all_of_it = np.zeros_like(phi), np.ones_like(phi)
        by_gyro = {
            "p": (all_of_it, none, none),
            "q": (sin * tan, cos, sin * secant),
            "r": (cos * tan, -sin, cos * secant),
        }
        self._enters = dict(zip(ATTITUDE, by_gyro[channel], strict=True))
        self._carries = {
            "phi": {"phi": tan * pitch, "theta": turn * secant * secant},
            "theta": {"phi": -turn},
            "psi": {"phi": pitch * secant, "theta": turn * tan * secant},
        }

    def of(self, changes: FloatArray) -> Mapping[str, FloatArray]:
        """Return what changes of the gyro, shape (changes, rows), add to each angle, in deg."""
        sharp = sharpened(changes, self._sharpness)
        rates = np.array([by * sharp for by in self._enters.values()])
        bends = dict(zip(ATTITUDE, self._passed(rates), strict=True))
        for _ in range(_TURNS):
            carried = [sum(by * bends[other] for other, by in carries.items()) for carries in self._carries.values()]
            bends = dict(zip(ATTITUDE, self._passed(rates + np.array(carried)), strict=True))
        return bends

    def about(self, record: Record) -> Bend:
        """Return it about another record."""
        return Bend(self.estimator, record, self._start, self._channel, self._sharpness)

    def straightened(self, change: FloatArray) -> Bend:
        """Return it about the record without a change of the gyro, shape (rows of the record,): by the whole equations.

        InputError where Euler angles end.
        """
        record, healthy = self.record, self.record[self._channel] - change
        read = record
        for name in GYROS:
            if name in record.channels:
                read = read.replace(name, sharpened(record[name], self._sharpness))
        straight = self.estimator.bent(read, read.replace(self._channel, sharpened(healthy, self._sharpness)))
        for name in ATTITUDE:
            record = record.replace(name, straight[name]) if name in record.channels else record
        return self.about(record.replace(self._channel, healthy))

    def _passed(self, rates: FloatArray) -> FloatArray:
        return np.moveaxis(filtered(*self.estimator.response(self._period_s), np.moveaxis(rates, -1, 0)), 0, -1)

    def response(self, frequency: FloatArray, angle: str, by: FloatArray) -> FloatArray:
        """Return what of a change of the gyro is in an angle, weighed row by row, at frequencies in rad a row."""
        over, under = self.estimator.response(self._period_s)
        turned = np.exp(-1j * frequency)
        return (
            float(np.mean(self._enters[angle] * by)) * np.polyval(over[::-1], turned) / np.polyval(under[::-1], turned)
        )


def sharpened(values: FloatArray, sharpness: float) -> FloatArray:
    """Return rates, shape (..., rows), of which means over neighbours are what an attitude's steps are: u - c u''."""
    if not sharpness:
        return values
    sharp = values.copy()
    sharp[..., 1:-1] -= sharpness * (values[..., 2:] - 2.0 * values[..., 1:-1] + values[..., :-2])
    return sharp


def sharpness_of(operator: Transmissibility) -> float:
    """Return how a gyro's samples are to be sharpened, so that their integral is what the attitude made of them.

    An operator from an attitude's rate to the gyro that drives it is one over how the gyro enters that rate, by its
    trapezoids and the central difference: P = (1 - s)(1 + 4 c s), s = sin^2(w/2), w in rad a row. Samples taken at the
    estimator's own steps have T = 1 / (1 - s), c = 0; means over two steps, as of gyros that are integrated over a slow
    attitude's interval, T = 1, c = 1/4. So c = (1 - k) / 4 of T = 1 + k s, by least squares up to a sixth of the sample
    rate, within these two.
    """
    frequency = np.linspace(0.0, np.pi / 3.0, 30)[1:]
    rows = np.arange(operator.markov.shape[0]) - operator.noncausal_order
    response = np.abs(np.exp(-1j * np.outer(frequency, rows)) @ operator.markov[:, 0, 0])
    s = np.square(np.sin(0.5 * frequency))
    slope = float(s @ (response - 1.0)) / float(s @ s)
    return float(np.clip(0.25 * (1.0 - slope), 0.0, 0.25))


def undriven(estimator: AttitudeEstimator, residual: FloatArray, period_s: float) -> FloatArray:
    """Return what of a gyro's readings an estimator's references contradict: the change that leaves a residual so.

    u = e + tau e'' / (s + 1/tau_b), the inverse of what references leave of a change near wings level; the residual is
    to be smooth.
    """
    steep = np.gradient(residual, period_s)
    bias_s = estimator.bias_time_constant_s
    if np.isfinite(bias_s):  # what was learnt of it has passed from the slope
        kept = bias_s / (bias_s + period_s)
        steep = filtered([kept, -kept], [1.0, -kept], steep)
    return np.asarray(residual + estimator.time_constant_s * steep)


def _radians(record: Record, name: str) -> FloatArray:
    return np.deg2rad(np.nan_to_num(record[name])) if name in record.channels else np.zeros(len(record))


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
