"""Sensing: what the sensors read of a motion, sample by sample: noise, chain, estimator and faults, in that order."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.attitude_filter import REFERENCE_NOISE_DEG, filtering, reference_noise
from gtmbench.bench.breaking import Breakers
from gtmbench.bench.sensor_chain import SensorChain
from gtmbench.bench.sensors import noise_blocks
from gtmbench.bench.stepping import FLOWN
from gtmbench.faults.fault import Fault
from gtmbench.values.attitude_estimators import AttitudeEstimator, SteepError
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS

_BLOCK = 4096  # samples whose noise is drawn at a time
_SCALES = [channel.scale for channel in FLOWN[: len(SENSORS)]]
_PHI, _THETA, _PSI = (SENSORS.index(name) for name in ATTITUDE)
_GYROS = [SENSORS.index(name) for name in GYROS]
_ATTITUDE = [SENSORS.index(name) for name in ATTITUDE]


class Readings(NamedTuple):
    """One sample of every sensor, faults included; NaN where a reading is missing.

    Attributes
    ----------
    p, q, r : float
        Roll, pitch and yaw rate in deg/s, by the gyros.
    alpha, beta : float
        Angle of attack and sideslip in deg.
    phi, theta, psi : float
        Bank, pitch and heading in deg; the heading runs through 360 deg and on.
    nx, ny, nz : float
        Specific force in g: forward, right, up. Level flight reads nz = +1.
    tas : float
        True airspeed in kt.
    altitude : float
        Above sea level, in ft.

    Examples
    --------
    >>> import gtmbench as gb
    >>> readings = gb.Simulation(noise=None).reset(seed=1)
    >>> round(readings.tas, 2), round(readings.nz, 1), len(readings)
    (100.58, 1.0, 13)
    """

    p: float
    q: float
    r: float
    alpha: float
    beta: float
    phi: float
    theta: float
    psi: float
    nx: float
    ny: float
    nz: float
    tas: float
    altitude: float


class _Estimate:
    """An estimator at work in a loop: the attitude that it makes of what the gyros are about to read.

    Faults act on that attitude as they act on a gyro, in their order. So they are at work twice, as in `inject`: here
    on a copy, for what the gyros read, and then on all that is read.
    """

    def __init__(self, estimator: AttitudeEstimator, faults: Sequence[Fault], seed: int, samples: int) -> None:
        self.breakers = Breakers(faults, SENSORS)
        self._step = filtering(estimator, SAMPLE_PERIOD_S)
        blocks = reference_noise(REFERENCE_NOISE_DEG, seed, samples, _BLOCK)
        self._noise = chain.from_iterable(block.tolist() for block in blocks)
        self._phi = 0.0

    def enters(self, time_s: float, sample: list[float], attitude: Sequence[float]) -> None:
        """Put the estimated attitude into a healthy sample, given the true one, psi unwrapped."""
        read = sample.copy()
        self.breakers.distort(time_s, read)
        phi, theta, psi = attitude
        self._phi = phi - 360.0 * round((phi - self._phi) / 360.0)
        told = [angle + error for angle, error in zip((self._phi, theta, psi), next(self._noise), strict=True)]
        for column, angle in zip(_ATTITUDE, self._step(time_s, [read[i] for i in _GYROS], told), strict=True):
            sample[column] = angle


class Sensing:
    """The sensors of one flight.

    `faults`: those of sensors act; each has its place in the sequence as its index.
    `estimator`: what makes the attitude of the gyros; None: a vertical gyro.
    `sensors`: the way from motion to readings; None: ideal sensors.
    `yaw_deg`: the trim's heading, near which the first reading lies.
    `steep_deg`: the estimator's theta, once that is too steep to go on.
    `psi_deg`: the true heading, unwrapped.
    """

    def __init__(
        self,
        noise: str | None,
        seed: int,
        samples: int,
        faults: Sequence[Fault],
        estimator: AttitudeEstimator | None,
        sensors: SensorChain | None,
        yaw_deg: float,
    ) -> None:
        blocks = noise_blocks(noise, seed, samples, _BLOCK)
        self._noise = chain.from_iterable(block.tolist() for block in blocks)
        self._chained = None if sensors is None else sensors.start(SAMPLE_PERIOD_S)
        self._estimate = None if estimator is None else _Estimate(estimator, faults, seed, samples)
        self._breakers = Breakers(faults, SENSORS)
        self._turned: float | None = None  # what unwraps the heading; None: nothing has been read
        self._before = yaw_deg
        self.steep_deg: float | None = None
        self.psi_deg = yaw_deg

    def read(self, time_s: float, now: Sequence[float]) -> list[float] | None:
        """Return what is read of the properties of `FLOWN`; None where the attitude can't be estimated any more."""
        noises = next(self._noise)
        psi = now[_PSI] * _SCALES[_PSI]  # JSBSim's lies in 0..360; sensors read it unwrapped
        before, self._before = self._before, psi
        if self._turned is None:
            self._turned = 360.0 * round((before - psi) / 360.0)
        elif not -180.0 <= psi - before <= 180.0:
            self._turned += 360.0 if psi < before else -360.0
        self.psi_deg = psi = psi + self._turned
        if self._chained is None:
            sample = [value * scale + error for value, scale, error in zip(now, _SCALES, noises, strict=False)]
            sample[_PSI] = psi + noises[_PSI]
        else:
            motion = [value * scale for value, scale in zip(now, _SCALES, strict=False)]
            motion[_PSI] = psi
            sample = self._chained(motion, noises)
        if self._estimate is not None:
            try:
                self._estimate.enters(time_s, sample, (now[_PHI] * _SCALES[_PHI], now[_THETA] * _SCALES[_THETA], psi))
            except SteepError as error:
                self.steep_deg = error.theta_deg
                return None
        self._breakers.distort(time_s, sample)
        return sample

    def begin(self, index: int, fault: Fault) -> None:
        """Let a fault act from now on, under an index of its own."""
        for breakers in self._all_breakers():
            breakers.begin(index, fault)

    def end(self, index: int) -> None:
        """Take a fault away."""
        for breakers in self._all_breakers():
            breakers.end(index)

    def _all_breakers(self) -> list[Breakers]:
        return [self._breakers] if self._estimate is None else [self._estimate.breakers, self._breakers]
