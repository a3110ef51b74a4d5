"""Recorded flights read in odd ways: lags of a part of a sample, scales, counts, copies, filters, clocks, mirrors.

    python experiments/odd_readings.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Beside the 23 wrong readings of `real_logs.py`: every log below the folders whose flight ends with 0 by bank C,
identified on its first half, is read in the ways below, as it is logged and with samples left out to 4 or 5 Hz. A way
that is *wrong* should never end with 0; one that is *slight* may be learnt as it is: nothing that a gyro's fault shows
by is lost. Prints tables, writes report.md and cases.csv into DIR, and ends with code 1 where a sensor is accused,
but for one that is a copy. No log is kept. With --synthetic the same of flights of the GTM by their seeds, written as
tables at 10 Hz.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.report.markup import markdown
from gtmbench.report.words.verdict import verdict_text
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.verdict import Outcome
from recorded.flights import CHANNELS, LogFile, Parts, watched
from recorded.groups import studied_groups
from recorded.mutations import Mutation

SLOW_HZ, FEWEST = 4.5, 20  # samples are left out to about that; of a stretch
FLOWN_S, RATE_HZ = 120.0, 10.0  # of synthetic flights
WRONG, SLIGHT = "wrong", "slight"
INTRODUCTION = """*wrong* readings should never end with 0. *slight* ones may: what all angles or all gyros are late
by is read in time; smaller lags, samples that repeat or jitter, a clock that errs by 0.1 %, axes 20 deg apart and
mirrored axes are learnt as they are, and hide no fault of a gyro. Of each: how many logs end with 0 (no fault found), 1
(a sensor accused), 2 (refused), 3 (can't tell).
"""
Change = Callable[[gb.Record], gb.Record]
Row = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Odd(Mutation):
    """A way to read a flight that a function makes.

    Attributes
    ----------
    change : callable
    kind : str
        `WRONG` or `SLIGHT`.
    """

    change: Change
    kind: str = WRONG

    def mutate(self, record: gb.Record) -> gb.Record:
        """Return a record read so."""
        return self.change(record)


def each(names: Sequence[str], made: Callable[[gb.Record, np.ndarray], np.ndarray]) -> Change:
    """Return what makes some channels anew; angles run on without jumps."""

    def change(record: gb.Record) -> gb.Record:
        for name in names:
            values = np.unwrap(record[name], period=360.0) if name in ("phi", "psi") else record[name]
            record = record.replace(name, made(record, values))
        return record

    return change


def at(names: Sequence[str], when: Callable[[gb.Record], np.ndarray]) -> Change:
    """Return what reads some channels at other times."""
    return each(names, lambda record, values: np.interp(when(record), record.time_s, values))


def late(names: Sequence[str], late_s: float) -> Change:
    """Return what reads some channels late."""
    return at(names, lambda record: record.time_s - late_s)


def scaled(names: Sequence[str], factor: float, *, counts: bool = False) -> Change:
    """Return what scales some channels, and rounds them to counts."""
    return each(names, lambda _, values: np.round(factor * values) if counts else factor * values)


def copied(to: str, name: str) -> Change:
    """Return what writes a channel into another one, too."""
    return lambda record: record.replace(to, record[name])


def filtered(names: Sequence[str], tau_s: float) -> Change:
    """Return what passes some channels through a filter of first order."""
    from scipy.signal import lfilter

    def low(record: gb.Record, values: np.ndarray) -> np.ndarray:
        kept = float(np.exp(-record.sample_period_s / tau_s))
        return np.asarray(lfilter([1.0 - kept], [1.0, -kept], values - values[0]) + values[0])

    return each(names, low)


def repeated(names: Sequence[str], times: int) -> Change:
    """Return what repeats each reading of some channels."""
    return each(names, lambda record, values: values[np.arange(len(record)) // times * times])


def jittered(names: Sequence[str], samples: float) -> Change:
    """Return what reads some channels up to so many samples early or late."""

    def when(record: gb.Record) -> np.ndarray:
        off = np.random.default_rng(1).uniform(-samples, samples, len(record))
        return np.asarray(record.time_s + off * record.sample_period_s)

    return at(names, when)


def mounted(one: str, other: str, by_deg: float) -> Change:
    """Return what turns two gyros' axes."""
    sine, cosine = np.sin(np.radians(by_deg)), np.cos(np.radians(by_deg))

    def turned(record: gb.Record) -> gb.Record:
        first, second = record[one], record[other]
        turned = record.replace(one, cosine * first + sine * second)
        return turned.replace(other, cosine * second - sine * first)

    return turned


def fast(names: Sequence[str], factor: float) -> Change:
    """Return what reads some channels by a clock that is too fast."""
    return at(names, lambda record: record.start_s + factor * (record.time_s - record.start_s))


READINGS: dict[str, Odd] = {
    "attitude 0.1 s late": Odd(change=late(ATTITUDE, 0.1), kind=SLIGHT),
    "attitude 0.2 s late": Odd(change=late(ATTITUDE, 0.2), kind=SLIGHT),
    "gyros 0.1 s late": Odd(change=late(GYROS, 0.1), kind=SLIGHT),
    "p 0.1 s late": Odd(change=late(("p",), 0.1)),
    "r 0.2 s late": Odd(change=late(("r",), 0.2)),
    "psi 0.25 s late": Odd(change=late(("psi",), 0.25)),
    "psi through 1 s": Odd(change=filtered(("psi",), 1.0)),
    "q through 0.5 s": Odd(change=filtered(("q",), 0.5)),
    "gyros through 0.5 s": Odd(change=filtered(GYROS, 0.5)),
    "q a copy of p": Odd(change=copied("q", "p")),
    "theta a copy of phi": Odd(change=copied("theta", "phi")),
    "q in counts of 1/16.4": Odd(change=scaled(("q",), 16.4, counts=True)),
    "gyros in counts of 1/131": Odd(change=scaled(GYROS, 131.0, counts=True)),
    "r a tenth": Odd(change=scaled(("r",), 0.1)),
    "p 0.7": Odd(change=scaled(("p",), 0.7)),
    "r 1.4": Odd(change=scaled(("r",), 1.4)),
    "gyros 0.75": Odd(change=scaled(GYROS, 0.75)),
    "attitude 0.7": Odd(change=scaled(ATTITUDE, 0.7)),
    "p, r 30 deg apart": Odd(change=mounted("p", "r", 30.0)),
    "attitude 0.05 s late": Odd(change=late(ATTITUDE, 0.05), kind=SLIGHT),
    "q through 0.2 s": Odd(change=filtered(("q",), 0.2), kind=SLIGHT),
    "gyros twice": Odd(change=repeated(GYROS, 2), kind=SLIGHT),
    "gyros jitter by 0.4 samples": Odd(change=jittered(GYROS, 0.4), kind=SLIGHT),
    "p, q 20 deg apart": Odd(change=mounted("p", "q", 20.0), kind=SLIGHT),
    "attitude's clock 0.1 % fast": Odd(change=fast(ATTITUDE, 1.001), kind=SLIGHT),
    "phi, theta, p, q mirrored": Odd(change=scaled(("phi", "theta", "p", "q"), -1.0), kind=SLIGHT),
}


def cases(path: Path) -> list[Row]:
    """Return what is said of a log's flight in every way, at its own rate and slowed, where it ends with 0 as it is."""
    log = LogFile(path, path.name)
    try:
        parts, attitude = log.parts(), log.attitude
    except gb.GtmbenchError:
        return []
    return [
        row for name, of in (("as logged", parts), ("slowed", slowed(parts))) for row in _read(log, of, attitude, name)
    ]


def slowed(parts: Parts) -> Parts:
    """Return a flight with samples left out to 4 or 5 Hz; none of one that comes as seldom."""
    every = round(1.0 / (SLOW_HZ * parts[0].sample_period_s)) if parts else 1
    if every < 2:
        return []
    return [
        gb.Record(
            part.matrix(part.channels)[::every],
            channels=part.channels,
            sample_period_s=every * part.sample_period_s,
            start_s=part.start_s,
        )
        for part in parts
        if len(part) >= FEWEST * every
    ]


def _read(log: LogFile, parts: Parts, attitude: str, rate: str) -> list[Row]:
    if not parts or _said(parts, attitude, Mutation())["exit"] != Outcome.HEALTHY:
        return []
    whose = {"log": log.name, "rate": rate, "rate_hz": 1.0 / parts[0].sample_period_s}
    return [
        {**whose, "reading": name, "kind": odd.kind, **_said(parts, attitude, odd)} for name, odd in READINGS.items()
    ]


def _said(parts: Parts, attitude: str, mutation: Mutation) -> Row:
    try:
        said = watched(parts, attitude, mutation)
    except gb.GtmbenchError as error:
        return {"exit": 2, "told": str(error)[:120]}
    return {"exit": int(said.outcome), "told": verdict_text(said)[:120]}


def synthetic(folder: Path, seeds: range) -> list[Path]:
    """Write healthy flights of the GTM as tables at 10 Hz."""
    paths = []
    for seed in seeds:
        flown = gb.measure(gb.fly("gtm", "multisine+turbulence", FLOWN_S, seed=seed), noise="t2", seed=seed)
        every = round(1.0 / (RATE_HZ * flown.sample_period_s))
        paths.append(folder / f"gtm_{seed}.csv")
        rows = flown.matrix(CHANNELS)[::every]
        gb.write_log(gb.Record(rows, channels=CHANNELS, sample_period_s=1.0 / RATE_HZ), paths[-1])
    return paths


def report(rows: pd.DataFrame) -> list[str]:
    """Return the tables of a group: how many logs end with which code."""
    if rows.empty:
        return ["No log of this group ends with 0."]
    told = []
    for rate, of in rows.groupby("rate", sort=False):
        counts = [
            {"reading": name, "kind": odd.kind, **{f"{code}": int((own["exit"] == code).sum()) for code in range(4)}}
            for name, odd in READINGS.items()
            for own in [of[of["reading"] == name]]
        ]
        left = int(((of["kind"] == WRONG) & (of["exit"] == Outcome.HEALTHY)).sum())
        told += [
            f"{of['log'].nunique()} flights {rate}; {left} of {(of['kind'] == WRONG).sum()} wrong readings end with 0:",
            markdown(pd.DataFrame(counts)),
        ]
    return told


def main() -> int:
    """Watch, sum up, write."""
    everything = studied_groups(
        __doc__,
        ["# Recorded flights, read in odd ways", INTRODUCTION],
        Path("experiments/reports/odd_readings"),
        cases=cases,
        synthetic=synthetic,
        report=report,
    )
    if everything.empty:
        return 0
    is_copy = everything["reading"].str.contains("copy")
    return int(((everything["exit"] == Outcome.FAILED) & ~is_copy).any())


if __name__ == "__main__":
    sys.exit(main())
