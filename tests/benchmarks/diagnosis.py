"""What watching a record takes where a fault is to be diagnosed, or only detected: bank C, 300 s at 100 Hz."""

from __future__ import annotations

import statistics
from functools import partial

import gtmbench as gb

from .timing import interleaved, ratio

DURATION_S, ONSET_S = 300.0, 100.0
FAULTS: tuple[gb.Fault, ...] = tuple(
    fault
    for gyro in ("p", "q", "r")
    for fault in (gb.Drift(channel=gyro, onset_s=ONSET_S, slope=0.05), gb.Jam(channel=gyro, onset_s=ONSET_S))
)


def measure(rounds: int) -> dict:
    """Return ratios to a healthy record's watch: of a watch with a lasting fault, and of trials of that fault.

    Of a trial with names, which takes what is before the onset once, and of one without.

    Means over a drift and a jam of each gyro; and how many records of each are watched a second.
    """
    monitor = gb.calibrate([_sensed(seed, "multisine+turbulence") for seed in range(1, 7)], bank=gb.load_bank("C"))
    record = _sensed(99, "doublets+turbulence")
    trials, begun = monitor.trials(record), monitor.begun(monitor.watch(record))
    works = {"healthy": partial(monitor.watch, record)}
    for i, fault in enumerate(FAULTS):
        works[f"watch {i}"] = partial(monitor.watch, gb.inject(record, fault))
        works[f"named {i}"] = partial(monitor.watch, gb.inject(record, fault), begun=begun)
        works[f"trial {i}"] = partial(trials.first_alarm_s, fault)
    times = interleaved(works, rounds)
    whats = ("watch", "named", "trial")
    each = {what: [ratio(times, f"{what} {i}", "healthy") for i in range(len(FAULTS))] for what in whats}
    watch_s, named_s = (
        statistics.mean(statistics.median(times[f"{what} {i}"]) for i in range(len(FAULTS))) for what in whats[:2]
    )
    return {
        "ratio": statistics.mean(each["watch"]),
        "named_ratio": statistics.mean(each["named"]),
        "trial_ratio": statistics.mean(each["trial"]),
        "records_per_s": 1.0 / watch_s,
        "named_per_s": 1.0 / named_s,
        "healthy_per_s": 1.0 / statistics.median(times["healthy"]),
    }


def _sensed(seed: int, excitation: str) -> gb.Record:
    return gb.measure(gb.fly("gtm", excitation, DURATION_S, seed), noise="t2", seed=seed)
