"""How ``gb.identify`` grows: over samples at 101 taps, over taps at 20,000 samples; one input, white noise."""

from __future__ import annotations

import statistics
from collections.abc import Mapping

import numpy as np

import gtmbench as gb

from . import data
from .timing import Work, interleaved, peak_memory

SAMPLES, TAPS = (10**3, 10**4, 10**5, 10**6, 10**7), (1, 3, 10, 30, 100, 200, 400)
FIXED_SAMPLES, FIXED_TAPS = 20_000, 101
FITTED = 3  # the exponent is that of the largest sizes: overhead rules the small ones


def measure(rounds: int, largest: int = SAMPLES[-1]) -> dict:
    """Return times over the first size's, peak memory, and the exponent of growth, over samples and over taps."""
    samples = {size: _identify(data.noise(size), FIXED_TAPS) for size in SAMPLES if size <= largest}
    record = data.noise(FIXED_SAMPLES)
    return {
        "samples": _grown(samples, rounds),
        "taps": _grown({taps: _identify(record, taps) for taps in TAPS}, rounds),
    }


def _identify(record: gb.Record, taps: int) -> Work:
    ahead = taps // 2
    return lambda: gb.identify(
        record, inputs=["u"], outputs=["y"], causal_order=taps - 1 - ahead, noncausal_order=ahead
    )


def _grown(works: Mapping[int, Work], rounds: int) -> dict:
    works[min(works)]()  # warm up
    memory = [peak_memory(work) / 1e6 for work in works.values()]
    times = interleaved({str(size): work for size, work in works.items()}, rounds)
    medians = np.array([statistics.median(values) for values in times.values()])
    slope, _ = np.polyfit(np.log(list(works)[-FITTED:]), np.log(medians[-FITTED:]), 1)
    return {
        "sizes": list(works),
        "time_ratios": (medians / medians[0]).tolist(),
        "memory_mb": memory,
        "exponent": float(slope),
    }
