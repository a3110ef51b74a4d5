"""A sensor that gets noisy, of those whose noise is told: the logarithm of its noise rises."""

from __future__ import annotations

from functools import partial

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.roughness import QUIET, noise_channels, rough_of
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.explanations import noise
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect

_LEAST = float(np.log1p(QUIET**-2.0))  # from a quiet sensor's noise to the least that is a failure


def explanations(course: Course) -> list[Explanation]:
    """Return one for each channel, of size one in the logarithm of its power."""
    return [
        Explanation(
            suspect=name,
            kind="noise",
            effect=partial(_rougher, channel=rough_of(name)),
            price=noise.PRICE,
            low=0.0,
            least=_LEAST,
        )
        for name in noise_channels(course)
    ]


def _rougher(flight: Flight, *, channel: str) -> Effect:
    return Effect(channels={channel: np.ones(len(flight))})
