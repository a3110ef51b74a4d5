"""What a sample costs in a fault's stream, and in its array form: the faults that ship."""

from __future__ import annotations

import statistics
import time
import tomllib

import numpy as np

from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import FAULTS
from gtmbench.files.shipped import shipped_scenarios

PERIOD_S, SAMPLES = 0.01, 20_000


def measure(rounds: int) -> dict:
    """Return microseconds a sample by kind: of the stream, given plain floats, and of the array form."""
    time_s = np.arange(SAMPLES) * PERIOD_S
    noise = 0.1 * np.random.default_rng(1).standard_normal((SAMPLES, 2))
    readings = 2.0 * np.sin(3.0 * time_s[:, np.newaxis] + [0.0, 1.0]) + noise
    figures = {}
    for kind in (kind for kind in FAULTS if kind in shipped_scenarios()):
        fault = _shipped(kind)
        given = readings[:, : len(fault.reads)]
        streams = statistics.median(_stream_s(fault, time_s, given) for _ in range(rounds))
        arrays = statistics.median(_array_s(fault, time_s, given) for _ in range(rounds))
        figures[kind] = {"stream_us": 1e6 * streams / SAMPLES, "array_us": 1e6 * arrays / SAMPLES}
    return figures


def _shipped(kind: str) -> Fault:
    """Return the first fault of the kind's scenario, broken from the beginning; shares of a flight as 1."""
    table = tomllib.loads(shipped_scenarios()[kind].read_text())["faults"][0]
    parameters = {item: table[item.name] for item in FAULTS[kind].parameters() if item.name in table}
    absolute = {
        item.name: 1.0 if item.is_severity and isinstance(value, str) else value for item, value in parameters.items()
    }
    return FAULTS[kind](channel=table["channels"][0], onset_s=0.0, **absolute)


def _stream_s(fault: Fault, time_s: np.ndarray, readings: np.ndarray) -> float:
    step, times, samples = fault.stream(PERIOD_S), time_s.tolist(), readings.tolist()
    began = time.perf_counter()
    for at_s, sample in zip(times, samples, strict=True):
        step(at_s, sample)
    return time.perf_counter() - began


def _array_s(fault: Fault, time_s: np.ndarray, readings: np.ndarray) -> float:
    began = time.perf_counter()
    fault.broken(readings, time_s, PERIOD_S)
    return time.perf_counter() - began
