"""Bank C's stream at 100 Hz, three gyros: how much faster than the samples come it takes them."""

from __future__ import annotations

import statistics
import time

import gtmbench as gb

PERIOD_S, WARM_S, MEASURED_S = 0.01, 90.0, 20.0  # its windows and their baselines are full after 81 s
CHUNK = 100


def measure(rounds: int) -> dict:
    """Return the sample period over the time that a sample takes, a sample a push and a hundred a push.

    Quiet samples: what a diagnosis takes, at its horizons after an alarm, isn't in it. Making the Records is the
    caller's.
    """
    monitor = gb.calibrate([_sensed(seed) for seed in range(1, 7)], bank=gb.load_bank("C"))
    record = _sensed(99)
    found = {rows: [_seconds_a_sample(monitor, record, rows) for _ in range(rounds)] for rows in (1, CHUNK)}
    return {"ratio": PERIOD_S / statistics.median(found[1]), "chunk_ratio": PERIOD_S / statistics.median(found[CHUNK])}


def _sensed(seed: int) -> gb.Record:
    return gb.measure(gb.fly("gtm", "multisine+turbulence", 200.0, seed), noise="t2", seed=seed)


def _seconds_a_sample(monitor: gb.Monitor, record: gb.Record, rows: int) -> float:
    stream = monitor.stream()
    stream.push(record.between(0.0, WARM_S - PERIOD_S))
    first, last = round(WARM_S / PERIOD_S), round((WARM_S + MEASURED_S) / PERIOD_S)
    chunks = [
        record.between(record.time_s[at], record.time_s[at + rows - 1]) for at in range(first, last - rows + 1, rows)
    ]
    began = time.perf_counter()
    for chunk in chunks:
        stream.push(chunk)
    return (time.perf_counter() - began) / (len(chunks) * rows)
