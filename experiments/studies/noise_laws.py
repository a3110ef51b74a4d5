"""Laws of sensor noise that studies draw: white, coloured, with heavy tails, with a level that wanders."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from gtmbench.values.record import FloatArray


def wandering(draw: np.random.Generator, count: int, pole: float, size: float) -> FloatArray:
    """Return noise whose level's logarithm is an AR(1), of deviation `size`."""
    slow = lfilter([1.0], [1.0, -pole], draw.standard_normal(count)) * math.sqrt(1.0 - pole * pole)
    noise = draw.standard_normal(count) * np.exp(size * slow)
    return np.asarray(noise / noise.std())


def flicker(draw: np.random.Generator, count: int) -> FloatArray:
    """Return noise of deviation 1 whose spectral density falls as 1/f."""
    frequency = np.fft.rfftfreq(count)
    frequency[0] = frequency[1]
    noise = np.fft.irfft(np.fft.rfft(draw.standard_normal(count)) / np.sqrt(frequency), count)
    return np.asarray((noise - noise.mean()) / noise.std())


LAWS: dict[str, Callable[[np.random.Generator, int], FloatArray]] = {  # of deviation 1 but for the levels
    "white": lambda draw, n: draw.standard_normal(n),
    "level x0.6": lambda draw, n: 0.6 * draw.standard_normal(n),
    "level x0.3": lambda draw, n: 0.3 * draw.standard_normal(n),
    "level x1.3": lambda draw, n: 1.3 * draw.standard_normal(n),
    "AR(1) 0.7": lambda draw, n: lfilter([1.0], [1.0, -0.7], draw.standard_normal(n)) * math.sqrt(0.51),
    "Student t4": lambda draw, n: draw.standard_t(4, n) / math.sqrt(2.0),
    "wanders, 10 s": lambda draw, n: wandering(draw, n, 0.999, 0.5),
    "Laplace": lambda draw, n: draw.laplace(size=n) / math.sqrt(2.0),
    "2 % five times": lambda draw, n: np.where(draw.random(n) < 0.02, 5.0, 1.0) * draw.standard_normal(n) / 1.22,
    "bursts, 0.2 s": lambda draw, n: wandering(draw, n, 0.95, 0.5),
    "tone at 23 Hz": lambda draw, n: 0.7 * draw.standard_normal(n) + np.sin(1.445 * np.arange(n) + 6.0 * draw.random()),
    "half AR(1) 0.99": lambda draw, n: (
        0.87 * draw.standard_normal(n) + 0.07 * lfilter([1.0], [1.0, -0.99], draw.standard_normal(n))
    ),
    "a fifth flicker": lambda draw, n: 0.98 * draw.standard_normal(n) + 0.2 * flicker(draw, n),
}
