"""A benchmark of a few short flights, and entries whose scores are made up."""

from pathlib import Path

import numpy as np
import pandas as pd

from gtmbench.study.benchmark.definition import CALIBRATION, load_definition

TINY = """
name = "tiny"
title = "Some seconds"
duration_s = 40.0
onset_s = [15.0, 20.0]
deadline_s = 15.0
false_alarms_per_hour = 6.0
other_rates_per_hour = [2.0, 60.0]
repeats = 3
channels = ["p", "q", "r", "phi", "theta", "psi"]

[quanta]
p = 0.0078125

[versions]

[[groups]]
name = "gtm"
aircraft = "gtm"
learn = 4
calibration = 8
development = 2
test = 4
single = 2
easy = 1
common = 1
pair = 1
alike = 1
twins = 2

[[single]]
kind = "bias"
channels = ["p", "q", "r"]
size = [0.5, 3.0]
signed = true

[[single]]
kind = "noise"
channels = ["p"]
deviation = [3.0, 3.5]

[[easy]]
kind = "jam"
channels = ["q"]

[[common]]
kind = "drift"
channels = ["p", "q", "r"]
slope = [0.1, 1.0]

[quick]
groups = ["gtm"]
learn = 2
"""


def tiny(folder: Path, name="tiny", extra=""):
    path = folder / f"{name}.toml"
    path.write_text(TINY + extra)
    return load_definition(path)


def write_scores(folder, definition, split, score, suffix=".csv", channels=()):
    """Write score files; `score` gives a flight's scores, of as many rows as its whole flight has."""
    for of in (CALIBRATION, split):
        for flight in definition.flights(of):
            path = folder / f"{flight.path}{suffix}"
            path.parent.mkdir(parents=True, exist_ok=True)
            time_s = np.arange(flight.rows) * flight.group.sample_period_s
            frame = pd.DataFrame({"time_s": time_s, "score": score(flight, time_s)})
            for name in channels:
                own = name in [fault.channel for fault in flight.faults]
                frame[f"score_{name}"] = frame["score"] if own else 0.0
            frame.to_csv(path, index=False) if suffix == ".csv" else frame.to_parquet(path, index=False)
    describe(folder, definition)
    return folder


def describe(folder, definition, extra=""):
    """Write an entry's description: for which definition it is."""
    (folder / "entry.toml").write_text(f'definition = "{definition.digest}"\n{extra}')


def noise_of(flight, time_s):
    """Chi-squared noise, the same of a flight and of its twin."""
    return np.random.default_rng(flight.seed).normal(size=len(time_s)) ** 2


def finds(flight, time_s, late_s=1.0):
    """Noise, and far more from a second after the onset on."""
    score = noise_of(flight, time_s)
    for fault in flight.faults:
        score[time_s >= fault.onset_s + late_s - 1e-9] += 1000.0
    return score
