"""What explains that a flight's constants are others than before: a sensor that failed, or a change of installation.

A failure moves one constant by any amount: Cauchy's law. Others follow it: an IMU beside a gyro that reads more than
before reads less than that. A healthy cause moves many by what installations differ by, a normal law. All others are as
the earlier flights predict. So a failure of q stands where q's constants alone have changed, or further than another
healthy IMU's would; and a replaced IMU where all of its constants have.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.history.entry import AT_REST, FACTOR, LAG, MISALIGNMENT, NOISE, OFFSET, Constant, kind_of
from gtmbench.history.spread import Key, Prediction
from gtmbench.values.channels import ATTITUDE, GYROS

_CAUSES = 1.1  # nats: healthy causes are three times as frequent as a sensor that fails from power-on
_SAME = 3.4  # nats: by which it is rarer that an IMU is replaced on the same autopilot
_TURNED_DEG = 5.0  # by which an IMU is mounted otherwise than before
_ALIKE = 0.5  # of the logarithm of noises: what shakes one axis shakes the others by half to twice as much
_TWO = 2.0**0.5  # installations, each of which is one of the population


@dataclass(frozen=True, kw_only=True)
class FlightCause:
    """What may have changed between flights."""

    suspects: tuple[str, ...]  # the sensors of which one failed; none of a healthy cause
    kind: str  # of the fault, as the faults' registry calls it; of a healthy cause, in words
    lead: Key | None = None  # the constant that is off by what a failure is off by
    # by (sensor, name): those that change with it: by how many times as much, and to within which standard deviation
    follow: Mapping[Key, tuple[float, float]] = field(default_factory=dict)
    is_new: bool = False  # whether earlier flights tell nothing of what comes after it
    price: float = 0.0  # in nats

    def log_odds(self, constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction]) -> float:
        """Return the logarithm of its likelihood over that of a flight whose constants are all as before."""
        off = self._off(constants, predictions)
        total = (0.0 if self.suspects else _CAUSES) - self.price
        if self.lead is not None:
            before = predictions[self.lead]
            width = float(np.hypot(kind_of(self.lead[1]).failure, before.deviation))
            total -= float(np.log(np.pi * width) + np.log1p((off / width) ** 2))  # Cauchy's law
            total -= before.log_density(constants[self.lead].value)
        for key, (share, tolerance) in self.follow.items():
            value, before = constants[key].value, predictions[key]
            total += before.log_density(value - share * off, tolerance) - before.log_density(value)
        return total

    def left(self, key: Key, constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction]) -> float:
        """Return how likely a constant is beside what this accounts for; what has a tolerance is accounted for."""
        share, tolerance = self.follow.get(key, (0.0, 0.0))
        if key == self.lead or tolerance:
            return 1.0
        return predictions[key].chance(constants[key].value - share * self._off(constants, predictions))

    def _off(self, constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction]) -> float:
        return 0.0 if self.lead is None else constants[self.lead].value - predictions[self.lead].value


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """An explanation, and how likely it is beside all others."""

    explanation: FlightCause
    probability: float


def weighed(
    constants: Mapping[Key, Constant], predictions: Mapping[Key, Prediction], *, is_same: bool = False
) -> tuple[Weighed, ...]:
    """Return explanations of a flight's constants, by key, beside what earlier flights predict, the likeliest first."""
    shifts = {key: constants[key].value - each.value for key, each in predictions.items()}
    told = list(explanations_of(shifts, is_same=is_same))
    scores = np.array([each.log_odds(constants, predictions) for each in told])
    chances = np.exp(scores - scores.max())
    chances /= chances.sum()
    order = np.argsort(-chances, kind="stable")
    return tuple(Weighed(explanation=told[at], probability=float(chances[at])) for at in order)


def explanations_of(shifts: Mapping[Key, float], *, is_same: bool = False) -> Iterator[FlightCause]:
    """Give what may explain how far some constants are from what they were."""
    yield from _failures(shifts)
    for imu in dict.fromkeys(gyro_and_imu(sensor)[1] for sensor, _ in shifts):
        own = [key for key in shifts if not imu or gyro_and_imu(key[0])[1] == imu]
        others = {key: (0.0, _TWO * kind_of(key[1]).population) for key in own}
        yield FlightCause(
            suspects=(), kind=f"{imu or 'the IMU'} was replaced", follow=others, is_new=True, price=_SAME * is_same
        )
    turned = {key: (0.0, _TURNED_DEG) for key in shifts if key[1].startswith(MISALIGNMENT)}
    if turned:
        yield FlightCause(suspects=(), kind="the IMU was mounted anew", follow=turned, is_new=True)
    noises = sorted((key for key in shifts if key[1] == NOISE), key=lambda key: -abs(shifts[key]))
    if noises:
        alike = dict.fromkeys(noises[1:], (1.0, _ALIKE))
        lags = {key: (0.0, _TWO * kind_of(LAG).population) for key in shifts if key[1] == LAG}
        yield FlightCause(suspects=(), kind="the air or the motors shake it otherwise", lead=noises[0], follow=alike)
        if lags:
            filtered = "its filters or its logging are others"
            yield FlightCause(suspects=(), kind=filtered, lead=noises[0], follow=alike | lags)


def _failures(shifts: Mapping[Key, float]) -> Iterator[FlightCause]:
    """Give failures of each gyro: those of one that is watched move all IMUs beside it back."""
    for sensor in dict.fromkeys(sensor for sensor, _ in shifts):
        gyro, imu = gyro_and_imu(sensor)
        beside = [] if imu else [each for each, name in shifts if name == OFFSET and each.startswith(f"{gyro} of ")]
        scaled = (sensor,) if imu else (sensor, ATTITUDE[GYROS.index(gyro)])  # an angle's factor looks the same
        for suspects, kind, names in (
            ((sensor,), "bias", (OFFSET, AT_REST)),
            ((sensor,), "noise", (NOISE,)),
            (scaled, "scale_factor", (FACTOR,)),
        ):
            own = [(sensor, name) for name in names if (sensor, name) in shifts]
            if own:
                against = [key for each in beside if (key := (each, own[0][1])) in shifts]
                follow = dict.fromkeys(own[1:], (1.0, 0.0)) | dict.fromkeys(against, (-1.0, 0.0))
                if kind == "noise" and (sensor, FACTOR) in shifts:  # its noise stands in what it is fitted to
                    follow |= {(sensor, FACTOR): (0.0, kind_of(FACTOR).failure)}
                yield FlightCause(suspects=suspects, kind=kind, lead=own[0], follow=follow)
