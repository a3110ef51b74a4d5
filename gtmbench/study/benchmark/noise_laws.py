"""Laws of sensor noise: the T2's deviations, drawn white, coloured or with heavy tails."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gtmbench.bench.sensors import stream
from gtmbench.values.channels import CHANNELS, SENSORS
from gtmbench.values.record import FloatArray, Record

Draw = Callable[[np.random.Generator, int], FloatArray]
_POLE = 0.7


@dataclass(frozen=True, kw_only=True)
class NoiseLaw:
    """How a sample's noise is drawn.

    Attributes
    ----------
    draw : callable
        Of a random generator and a count: noise of deviation 1.
    level : float
        Times the T2's deviation.
    pole : float
        Of first-order autoregression, v(k) = pole v(k-1) + w(k); 0 is white.
    information : float
        Fisher's information of a shift over that of a Gaussian of the same variance.
    """

    draw: Draw
    level: float = 1.0
    pole: float = 0.0
    information: float = 1.0


def _white(draw: np.random.Generator, count: int) -> FloatArray:
    return draw.standard_normal(count)


def _ar1(draw: np.random.Generator, count: int) -> FloatArray:
    from scipy.signal import lfilter

    return np.asarray(lfilter([math.sqrt(1.0 - _POLE**2)], [1.0, -_POLE], draw.standard_normal(count)))


def _t4(draw: np.random.Generator, count: int) -> FloatArray:
    return draw.standard_t(4, count) / math.sqrt(2.0)  # its variance is 2


LAWS = {
    "white": NoiseLaw(draw=_white),
    "white x0.6": NoiseLaw(draw=_white, level=0.6),
    "white x1.3": NoiseLaw(draw=_white, level=1.3),
    "ar1": NoiseLaw(draw=_ar1, pole=_POLE),
    "t4": NoiseLaw(draw=_t4, information=10.0 / 7.0),  # of Student's t with n degrees, (n + 1) n / ((n + 3) (n - 2))
}


def with_noise(truth: Record, law: str, seed: int) -> Record:
    """Return a record whose sensors have noise of a law; every channel draws from a stream of its own.

    >>> import gtmbench as gb
    >>> truth = gb.Record(np.zeros(20001), channels=["p"], sample_period_s=0.01)
    >>> [round(float(np.std(with_noise(truth, law, 1)["p"])) / gb.CHANNELS["p"].noise, 1) for law in LAWS]
    [1.0, 0.6, 1.3, 1.0, 1.0]
    """
    chosen = LAWS[law]
    values = np.array(truth.values)
    for column, name in enumerate(truth.channels):
        if name in SENSORS:
            noise = chosen.draw(stream(seed, f"{name}\0{law}"), len(truth))
            values[:, column] += chosen.level * CHANNELS[name].noise * noise
    return Record(values, channels=truth.channels, sample_period_s=truth.sample_period_s, start_s=truth.start_s)
