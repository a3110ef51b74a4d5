"""A monitor warmed up before it watches: what has to be imported is, and what a row costs is known."""

from __future__ import annotations

import gc
import time
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from gtmbench.detectors.protocol import Monitor
from gtmbench.errors import GtmbenchError
from gtmbench.values.channels import GYROS
from gtmbench.values.record import Record

_WARM_S = 40.0
_TRIED = 20  # rows, one by one
_SHARE, _SOON_S = 0.15, 0.5  # of the time that taking rows may cost; how long they may wait for others


def warm(monitor: Monitor) -> int:
    """Let a monitor judge a made-up fault, so that the first real one waits for nothing; return its rows at once.

    A monitor that takes long for a single row, as one that was learnt on a flight does, is given several together.
    """
    period_s = float(monitor.sample_period_s or 1.0)
    count, onset = round(_WARM_S / period_s), round(0.8 * _WARM_S / period_s)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((count, len(monitor.channels)))
    record = Record(noise, channels=monitor.channels, sample_period_s=period_s)
    sensor = next((name for name in GYROS if name in monitor.channels), monitor.channels[0])
    broken = record.replace(sensor, record[sensor] + 5.0 * (np.arange(count) >= onset))
    costs_s: list[float] = []
    with suppress(GtmbenchError):
        stream, stop = monitor.stream(), onset - _TRIED
        stream.push(broken.part(range(stop)))
        while stop < count:
            few = 1 if len(costs_s) < _TRIED else rows_at_once(costs_s, period_s)
            begun_s = time.perf_counter()
            stream.push(broken.part(range(stop, min(stop + few, count))))
            costs_s += [time.perf_counter() - begun_s] * (len(costs_s) < _TRIED)
            stop += few
    gc.collect()
    gc.freeze()  # what is there by now stays; looking at it again and again would cost milliseconds
    return rows_at_once(costs_s, period_s)


def rows_at_once(costs_s: Sequence[float], period_s: float) -> int:
    """Return how many rows are taken together, by what taking one costs: a small part of the time, soon enough.

    >>> rows_at_once([2e-4], 0.01), rows_at_once([2e-2], 0.01)
    (1, 14)
    """
    cost_s = float(np.median(costs_s)) if len(costs_s) else 0.0
    return int(np.clip(np.ceil(cost_s / (_SHARE * period_s)), 1, max(round(_SOON_S / period_s), 1)))
