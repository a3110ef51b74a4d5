"""The reference of detection: the CUSUM that knows the fault, its shape and the noise, at an allowed rate of alarms.

One gyro and the angle that it turns are one axis. Its model is a random walk that is seen through noise, with the
gyro's noise s_g (deg/s), the angle's noise s_a (deg) and the sample period Ts:

    x(k+1) = x(k) + Ts s_g w(k)        the error of the angle that the gyro's readings are summed to
    y(k)   = x(k) + s_a v(k)           how far the angle that is read differs from it

The steady Kalman filter of this model has white innovations of variance S = P + s_a^2, with
P = q/2 + sqrt(q^2/4 + q s_a^2), q = (Ts s_g)^2 and the gain K = P/S. A fault that changes the readings by f(k) moves
the mean of the innovations by m(k):

    gyro    m(k) = (1 - K) m(k-1) - Ts f(k)           the error is carried on, and the angle pulls it back
    angle   m(k) = (1 - K) m(k-1) + f(k) - f(k-1)     the filter learns a constant error of the angle

With z the innovations over their deviation and u = m / sqrt(S), the log-likelihood ratio of an onset at i is

    L(i, n) = sum over k = i..n of u(k-i) z(k) - u(k-i)^2 / 2

and Page's CUSUM alarms when the largest L over all onsets i reaches h. Time goes in blocks, of 1/100 of the delay or a
sample, whichever is longer. The threshold h follows from the average run length: with R(n) = sum over i of exp L(i, n),
a change of measure over all onsets gives one alarm in 1 / E[1 / R] blocks, where E is over flights with the fault and R
is taken at their alarms (Siegmund 1985, "Sequential Analysis"; for scans Naiman and Priebe 2001, Journal of
Computational and Graphical Statistics 10). So few simulated flights tell what healthy ones would only in years.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, inject
from gtmbench.values.channels import ATTITUDE, CHANNELS, GYROS
from gtmbench.values.record import FloatArray, Record, check_record

_ANGLE_OF = dict(zip(GYROS, ATTITUDE, strict=True))
_GYRO_OF = dict(zip(ATTITUDE, GYROS, strict=True))
_OPTIMAL = ("bias",)
_DRAWS = 400  # flights: of delays as scattered as their mean, that is then known to 5 %
_BLOCKS = 100  # that log(T / Ts) nats take; an alarm comes after about half of them
_HORIZON, _MOST = 3.5, 800  # times those nats, which one in 30,000 flights passes without an alarm; blocks at most
_THRESHOLDS = np.arange(0.5, 20.0, 0.05)  # nats


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What the reference detector makes of a fault."""

    mean_s: float  # mean delay from the onset; where the record ends before the alarm, up to its end
    quantiles_s: Mapping[float, float]  # the delay of 10, 50 and 90 % of the flights; infinite where fewer are detected
    missed: float  # the share that isn't detected before the record ends
    threshold: float  # in nats
    optimal: bool  # whether theory calls it the best; else it is a reference only


def detection_reference(
    fault: Fault,
    record: Record,
    *,
    false_alarms_per_hour: float,
    noise: Mapping[str, float] | None = None,
    seed: int = 1,
) -> Reference:
    """Return the detection delay of a CUSUM that knows a fault, its shape and the noise, but not its onset.

    For a constant change in white noise, no detector with as few false alarms is sooner in the worst case (Lorden 1971,
    "Procedures for reacting to a change in distribution", Annals of Mathematical Statistics 42; Moustakides 1986,
    "Optimal stopping times for detecting changes in distributions", Annals of Statistics 14); on average over onsets
    another rule may be by about 1 %. For drifts, transients, sensors with a chain and kinds that draw random numbers
    it is a reference only: `Reference.optimal` tells.

    It starts in its stationary state, without headstart. The gyro and the angle of its axis are all that it uses, and
    the angle is measured by itself, not made of the gyro. How a fault changes readings is taken from the record.

    Parameters
    ----------
    fault : Fault
        Of a gyro (p, q, r) or of an attitude angle (phi, theta, psi).
    record : Record
        Readings or motion without the fault, with the fault's channel and what the fault needs.
    false_alarms_per_hour : float
        The allowed rate.
    noise : mapping of channel to float, optional
        Standard deviations of a sample, in the channel's unit; those left out are the T2's.
    seed : int
        Of the 400 flights that are simulated.

    Raises
    ------
    InputError
        If the fault is of another sensor, its onset lies outside the record, or a figure is invalid.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly(duration_s=30.0)
    >>> sizes = (0.1, 0.3, 10.0)
    >>> faults = [gb.Bias(channel="p", onset_s=5.0, size=size) for size in sizes]
    >>> found = [gb.detection_reference(fault, flight, false_alarms_per_hour=0.1) for fault in faults]
    >>> [float(f"{each.mean_s:.1g}") for each in found], found[0].optimal
    ([5.0, 0.8, 0.007], True)
    """
    check_record(record)
    gyro = axis_of(fault)
    rate = number("false_alarms_per_hour", false_alarms_per_hour, 0.0, 1e6, above=True)
    noises = {name: _noise(name, noise) for name in (gyro, _ANGLE_OF[gyro])}
    axis = Axis(noises[gyro], noises[_ANGLE_OF[gyro]], record.sample_period_s)
    rule = Cusum.of(axis.signature(changed_readings(fault, record), of_gyro=fault.channel in GYROS), axis, rate)
    delays_s = rule.simulated(_DRAWS, seed)
    left_s = rule.samples * record.sample_period_s
    return Reference(
        mean_s=float(np.minimum(delays_s, left_s).mean()),
        quantiles_s={q: float(np.quantile(delays_s, q, method="higher")) for q in (0.1, 0.5, 0.9)},
        missed=float(np.isinf(delays_s).mean()),
        threshold=rule.threshold,
        optimal=fault.kind in _OPTIMAL and fault.channel in GYROS and fault.duration_s is None and not fault.ramp_s,
    )


def changed_readings(fault: Fault, record: Record) -> FloatArray:
    """Return by how much a fault changes its channel from its onset on; infinite where it takes a sample away."""
    readings, first = record[fault.channel], _onset_row(fault, record)
    broken = inject(record, fault)[fault.channel]
    change = np.where(np.isnan(broken) & ~np.isnan(readings), np.inf, np.nan_to_num(broken - readings))
    return np.asarray(change[first:])


def axis_of(fault: Fault) -> str:
    """Return the gyro of a fault's axis."""
    gyro = fault.channel if fault.channel in GYROS else _GYRO_OF.get(fault.channel)
    if gyro is None or len(fault.changes) > 1:
        raise InputError(
            f"the reference is known of one gyro or one attitude angle, and the fault changes "
            f"{', '.join(fault.changes)}; give a fault of {', '.join((*GYROS, *ATTITUDE))}"
        )
    return gyro


def _noise(channel: str, given: Mapping[str, float] | None) -> float:
    return number(f"noise of {channel}", (given or {}).get(channel, CHANNELS[channel].noise), 0.0, 1e6, above=True)


def _onset_row(fault: Fault, record: Record) -> int:
    if not record.start_s <= fault.onset_s <= record.end_s:
        raise InputError(
            f"the fault begins at {fault.onset_s:g} s, outside of the record ({record.start_s:g} to {record.end_s:g} "
            "s); give an onset within it"
        )
    return math.ceil((fault.onset_s - record.start_s) / record.sample_period_s - 1e-6)


@dataclass(frozen=True)
class Axis:
    """A gyro and its angle: deviations of their noise, sample period, and the pole of noise that isn't white.

    Noise of first-order autoregression is whitened on gyro and angle alike, which leaves the kinematics as they are.
    """

    gyro_noise: float
    angle_noise: float
    sample_period_s: float
    pole: float = 0.0

    def innovations(self, gyro: FloatArray, angle: FloatArray) -> FloatArray:
        """Return the filter's innovations over their deviation, of what gyro and angle read beside the motion."""
        from scipy.signal import lfilter

        white = math.sqrt(1.0 - self.pole**2)
        q, r = (white * self.gyro_noise * self.sample_period_s) ** 2, (white * self.angle_noise) ** 2
        ahead = q / 2.0 + math.sqrt(q * q / 4.0 + q * r)
        gain = ahead / (ahead + r)
        driven = np.diff(angle, prepend=0.0) - self.sample_period_s * gyro
        fresh = lfilter([1.0, -self.pole], [1.0, gain - 1.0], driven)
        return np.asarray(fresh) / math.sqrt(ahead + r)

    def signature(self, change: FloatArray, *, of_gyro: bool) -> FloatArray:
        """Return by how many deviations a change of the gyro, or else of the angle, moves the innovations' mean."""
        gone = np.isinf(change)
        kept, still = np.where(gone, 0.0, change), np.zeros(len(change))
        # a sample that is taken away is seen at once, at 50 deviations
        return np.where(gone, 50.0, self.innovations(kept, still) if of_gyro else self.innovations(still, kept))


@dataclass(frozen=True, kw_only=True, eq=False)
class Cusum:
    """The CUSUM of a known signature, in blocks of samples, with its threshold."""

    signature: FloatArray = field(repr=False)  # shape (blocks, samples a block)
    samples: int  # from the onset to the record's end
    history: int  # blocks before the onset that it looks back at
    sample_period_s: float
    threshold: float = math.nan

    @classmethod
    def of(cls, signature: FloatArray, axis: Axis, false_alarms_per_hour: float, *, draws: int = _DRAWS) -> Cusum:
        """Return the CUSUM of a signature whose average run length is that of the rate."""
        period_s = axis.sample_period_s
        asked = math.log(max(3600.0 / (false_alarms_per_hour * period_s), 2.0))
        nats = np.cumsum(np.square(signature)) / 2.0
        needs, lasts = (
            int(np.searchsorted(nats, times * asked)) + 1 if nats[-1] >= times * asked else len(nats)
            for times in (1.0, _HORIZON)
        )
        block = max(needs // _BLOCKS, 1)
        blocks = min(-(-lasts // block), _MOST)
        kept = np.zeros(blocks * block)
        kept[: len(signature)] = signature[: len(kept)]
        history = max(-(-needs // block), 10)
        rule = cls(
            signature=kept.reshape(blocks, block), samples=len(signature), history=history, sample_period_s=period_s
        )
        rarely = false_alarms_per_hour * period_s * block / 3600.0  # alarms a block
        return replace(rule, threshold=rule._threshold(rarely, draws))

    def simulated(self, draws: int, seed: int) -> FloatArray:
        """Return delays of simulated flights in seconds; infinite where the record ends before the alarm."""
        largest, _ = self._statistics(self._drawn(draws, seed))
        return self.delays_s(largest[:, self.history :])

    def delays_s(self, largest: FloatArray) -> FloatArray:
        """Return when statistics from the onset on, shape (flights, blocks), reach the threshold."""
        reached = largest >= self.threshold
        last = (np.argmax(reached, axis=1) + 1) * self.signature.shape[1] - 1
        return np.where(reached.any(axis=1) & (last < self.samples), last * self.sample_period_s, math.inf)

    def alarms(self, innovations: FloatArray, onset: int) -> tuple[FloatArray, float]:
        """Return what a flight's innovations have before the onset, in samples from it, and the delay in seconds.

        Parameters
        ----------
        innovations : shape (samples,)
            Over their deviation, with the fault's signature in them.
        onset : int
        """
        blocks, block = self.signature.shape
        before = min(onset // block, self.history)
        first = onset - before * block
        rows = np.zeros((before + blocks) * block)
        given = innovations[first : first + len(rows)]
        rows[: len(given)] = given
        largest, _ = self._statistics(rows.reshape(1, -1, block))
        early = np.flatnonzero(largest[0, :before] >= self.threshold)
        return (early[:1] - before + 1) * block - 1.0, float(self.delays_s(largest[:, before:])[0])

    def _drawn(self, draws: int, seed: int) -> FloatArray:
        """Return innovations of flights with the fault, shape (flights, blocks, samples a block)."""
        blocks, block = self.signature.shape
        rows = np.random.default_rng([seed, blocks]).standard_normal((draws, self.history + blocks, block))
        rows[:, self.history :] += self.signature
        return rows

    def _statistics(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return, at the end of each block, the largest log-likelihood ratio and the log of all ratios' sum.

        A flight's statistic is of shape (blocks,): the row `ratios` has one entry an onset, the newest first.
        """
        flights, count, _ = rows.shape
        lags = min(len(self.signature), count)
        # shape (flights, blocks, lags): what a block tells of an onset before it
        gains = rows @ self.signature[:lags].T
        gains -= np.square(self.signature[:lags]).sum(axis=1) / 2.0
        ratios = np.zeros((flights, lags))
        largest, total = np.empty((flights, count)), np.empty((flights, count))
        for at in range(count):
            seen = min(at + 1, lags)
            ratios[:, 1:seen] = ratios[:, : seen - 1]  # every onset is a block older
            ratios[:, 0] = 0.0
            ratios[:, :seen] += gains[:, at, :seen]
            now = ratios[:, :seen]
            largest[:, at] = now.max(axis=1)
            total[:, at] = np.log(np.exp(now - largest[:, at, np.newaxis]).sum(axis=1)) + largest[:, at]
        return largest, total

    def _threshold(self, rarely: float, draws: int) -> float:
        """Return the least threshold at which healthy flights have so few alarms a block."""
        largest, total = self._statistics(self._drawn(draws, 0))
        highest = np.maximum.accumulate(largest, axis=1)
        told = []
        for threshold in _THRESHOLDS.tolist():
            reached = highest >= threshold
            at = np.argmax(reached, axis=1)
            odds = np.where(reached.any(axis=1), np.exp(-total[np.arange(draws), at]), 0.0)
            told.append(max(float(odds.mean()), 1e-300))
        rates = np.minimum.accumulate(np.log(told))
        return float(np.interp(-math.log(rarely), -rates, _THRESHOLDS))
