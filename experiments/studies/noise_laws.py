"""Laws of sensor noise that studies draw: the T2's deviations, white, coloured or with heavy tails."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from gtmbench.bench.sensors import stream
from gtmbench.values.channels import CHANNELS, SENSORS
from gtmbench.values.record import FloatArray, Record

_POLE = 0.7  # v(k) = 0.7 v(k-1) + w(k)


def _white(draw: np.random.Generator, count: int) -> FloatArray:
    return draw.standard_normal(count)


def _ar1(draw: np.random.Generator, count: int) -> FloatArray:
    return np.asarray(lfilter([math.sqrt(1.0 - _POLE**2)], [1.0, -_POLE], draw.standard_normal(count)))


def _t4(draw: np.random.Generator, count: int) -> FloatArray:
    return draw.standard_t(4, count) / math.sqrt(2.0)  # its variance is 2


LAWS: dict[str, tuple[Callable[[np.random.Generator, int], FloatArray], float]] = {  # and times the T2's deviation
    "white": (_white, 1.0),
    "white x0.6": (_white, 0.6),
    "white x1.3": (_white, 1.3),
    "ar1": (_ar1, 1.0),
    "t4": (_t4, 1.0),
}


def with_noise(truth: Record, law: str, seed: int) -> Record:
    """Return a record whose sensors have noise of a law; every channel draws from a stream of its own.

    >>> import gtmbench as gb
    >>> truth = gb.Record(np.zeros(20001), channels=["p"], sample_period_s=0.01)
    >>> [round(float(np.std(with_noise(truth, law, 1)["p"])) / gb.CHANNELS["p"].noise, 1) for law in LAWS]
    [1.0, 0.6, 1.3, 1.0, 1.0]
    """
    draw, level = LAWS[law]
    values = np.array(truth.values)
    for column, name in enumerate(truth.channels):
        if name in SENSORS:
            values[:, column] += level * CHANNELS[name].noise * draw(stream(seed, f"{name}\0{law}"), len(truth))
    return Record(values, channels=truth.channels, sample_period_s=truth.sample_period_s, start_s=truth.start_s)
