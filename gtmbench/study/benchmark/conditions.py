"""What no detector is told of a flight: noise of a law of its own, the air, the motion, rows lost and rows held."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gtmbench.bench.sensors import stream
from gtmbench.values.channels import CHANNELS, SENSORS
from gtmbench.values.record import FloatArray

_LEVELS, _POLES, _DEGREES = (0.6, 1.3), (0.2, 0.8), (4.0, 12.0)  # level times the T2's deviation; Student's t
_AMPLITUDES, _SEVERITIES = (0.5, 1.3), (2, 3, 3, 3, 3, 4, 4, 5)  # of surfaces; of turbulence, by MIL-F-8785C
_MOTIONS = ("turbulence", "multisine+turbulence", "doublets+turbulence")
_OFTEN, _SELDOM = 0.5, 0.25  # shares of the flights: chosen, so that most flights have one or two of these conditions
_LOST, _LOST_S, _HELD_S = 0.03, (0.1, 1.0), (0.02, 0.5)  # chosen: at most of rows; seconds
_GUSTY = 5  # severe, by MIL-F-8785C's scale of 1 to 7


@dataclass(frozen=True)
class Conditions:
    """The conditions of one flight, drawn from its seed, of healthy and broken ones alike.

    A look-alike of a fault has severe turbulence, a gap, and a stretch in which all sensors repeat their last row.

    Attributes
    ----------
    motion : str
        The excitation.
    amplitude : float
        Times the excitation's.
    severity : int
        Of turbulence.
    level, pole, degrees : float
        Of the noise: times the T2's deviation; of first-order autoregression, v(k) = pole v(k-1) + w(k), 0 is white;
        of Student's t that w has, infinite is Gaussian.
    lost : float
        Share of rows that no sensor has.
    gap_s, held_s : (float, float)
        Beginning and length of a stretch without readings, and of one in which all sensors repeat their last.
    """

    motion: str
    amplitude: float
    severity: int
    level: float
    pole: float
    degrees: float
    lost: float
    gap_s: tuple[float, float]
    held_s: tuple[float, float]

    @classmethod
    def of(cls, seed: int, duration_s: float, *, alike: bool = False) -> Conditions:
        """Return those of a flight, or of a look-alike."""
        draw = np.random.default_rng([seed, 2])

        def some(share: float, low: float, high: float) -> float:
            value = float(np.exp(draw.uniform(math.log(low), math.log(high))))
            return value if draw.random() < share else 0.0

        return cls(
            motion=str(draw.choice(_MOTIONS)),
            amplitude=some(1.0, *_AMPLITUDES),
            severity=_GUSTY if alike else int(draw.choice(_SEVERITIES)),
            level=some(1.0, *_LEVELS),
            pole=some(_SELDOM, *_POLES),
            degrees=some(_SELDOM, *_DEGREES) or math.inf,
            lost=some(_OFTEN, _LOST / 30.0, _LOST),
            gap_s=(float(draw.uniform(0.0, duration_s)), some(1.0 if alike else _SELDOM, *_LOST_S)),
            held_s=(float(draw.uniform(0.0, duration_s)), some(float(alike), *_HELD_S)),
        )

    def noise(self, seed: int, name: str, count: int) -> FloatArray:
        """Return the noise of a channel; every channel draws from a stream of its own.

        >>> values = [Conditions.of(seed, 80.0).noise(seed, "p", 9000).std() / CHANNELS["p"].noise for seed in range(9)]
        >>> bool(0.5 < min(values) < max(values) < 1.5)
        True
        """
        from scipy.signal import lfilter

        if name not in SENSORS:
            return np.zeros(count)
        draw, degrees = stream(seed, name), self.degrees
        if math.isinf(degrees):
            fresh = draw.standard_normal(count)
        else:
            fresh = draw.standard_t(degrees, count) * math.sqrt((degrees - 2.0) / degrees)
        coloured = lfilter([math.sqrt(1.0 - self.pole**2)], [1.0, -self.pole], fresh)
        return np.asarray(self.level * CHANNELS[name].noise * coloured)
