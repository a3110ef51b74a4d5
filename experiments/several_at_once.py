"""Several sensors hit at once: whether a healthy one is ever named, and whether all that are hit are told.

    python experiments/several_at_once.py [--quick] [--first-seed N] [--out DIR] [--jobs N]

Common causes of twelve kinds (all gyros warm up, shake, get noisy, freeze; the logger repeats rows; motion harder than
calibrated), two gyros together or one after the other, a gyro and its own angle, a gyro that fails twice, and single
faults, of which none may be told as several. Bank C, on flights and sizes drawn anew for each trial. Ends with code 1
where a target is missed (never with --quick).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from every_fault import QUICK, Size, calibrated
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.protocol import Watch
from gtmbench.jobs.processes import spread
from gtmbench.report.tables.markdown import markdown
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

EXCITATIONS = ("doublets+turbulence", "dissertation+turbulence", "multisine+turbulence")
FIRST_SEED = 620_001  # of the report; seeds from 610,001 on were looked at while building
DURATION_S, ONSET_S, WATCHED_FROM_S = 170.0, 90.0, 10.0
APART_S = (0.0, 0.5, 3.0, 8.0, 30.0)
CAUSE, TWO, WITH_ANGLE, TWICE, SINGLE = "common cause", "two gyros", "gyro and its angle", "fails twice", "single"
SAME_ONSET_S = 1.0  # what began that near to the second fault is that one
Row = dict[str, Any]
Broken = tuple[gb.Record, frozenset[str], tuple[str, ...]]  # the record, whom it hits, what kinds are right


def _larger(draw: np.random.Generator, least: float) -> float:
    """Draw a size from a threshold to ten times it, evenly in its logarithm."""
    return float(least * 10.0 ** draw.uniform(0.0, 1.0))


def _signed(draw: np.random.Generator, least: float) -> float:
    return _larger(draw, least) * float(draw.choice([-1.0, 1.0]))


def _each(record: gb.Record, channels: Sequence[str], fault: Callable[[str], gb.Fault]) -> gb.Record:
    for channel in channels:
        record = gb.inject(record, fault(channel))
    return record


def _warming(record: gb.Record, draw: np.random.Generator) -> Broken:
    slopes = {name: _signed(draw, 0.01) for name in GYROS}
    broken = _each(record, GYROS, lambda name: gb.Drift(channel=name, onset_s=ONSET_S, slope=slopes[name]))
    return broken, frozenset(GYROS), ("drift",)


def _shaking(low_hz: float, high_hz: float) -> Callable[[gb.Record, np.random.Generator], Broken]:
    def shaken(record: gb.Record, draw: np.random.Generator) -> Broken:
        tone, sizes = float(draw.uniform(low_hz, high_hz)), {name: _larger(draw, 0.5) for name in GYROS}
        broken = _each(
            record,
            GYROS,
            lambda name: gb.Oscillation(channel=name, onset_s=ONSET_S, amplitude=sizes[name], frequency_hz=tone),
        )
        return broken, frozenset(GYROS), ("oscillation", "noise")

    return shaken


def _noisy(record: gb.Record, draw: np.random.Generator) -> Broken:
    level, seed = _larger(draw, 1.0), int(draw.integers(1 << 30))
    broken = _each(
        record, GYROS, lambda name: gb.Noise(channel=name, onset_s=ONSET_S, deviation=level, seed=seed + ord(name))
    )
    return broken, frozenset(GYROS), ("noise",)


def _frozen(lasts_s: tuple[float, float] | None) -> Callable[[gb.Record, np.random.Generator], Broken]:
    def frozen(record: gb.Record, draw: np.random.Generator) -> Broken:
        span: Row = {"duration_s": float(draw.uniform(*lasts_s))} if lasts_s else {}
        broken = _each(record, GYROS, lambda name: gb.Jam(channel=name, onset_s=ONSET_S, **span))
        return broken, frozenset(GYROS), ("jam", "stuck", "hardover", "stale")

    return frozen


def _held(record: gb.Record, draw: np.random.Generator) -> Broken:
    hold_s = _larger(draw, 0.04)
    broken = _each(record, GYROS, lambda name: gb.Stale(channel=name, onset_s=ONSET_S, hold_s=hold_s))
    return broken, frozenset(GYROS), ("stale",)


def _repeated(every: bool) -> Callable[[gb.Record, np.random.Generator], Broken]:
    """Repeat all of a record's rows from the onset on: evenly (a lower rate), or some of them (the logger's)."""

    def repeated(record: gb.Record, draw: np.random.Generator) -> Broken:
        rows = np.arange(len(record))
        since = int(np.searchsorted(record.time_s, ONSET_S))
        if every:
            step = int(draw.integers(2, 9))
            source = np.where(rows < since, rows, since + (rows - since) // step * step)
        else:
            is_held = (draw.random(len(rows)) < draw.uniform(0.05, 0.5)) & (rows > since)
            source = np.maximum.accumulate(np.where(is_held, 0, rows))
        for name in SENSORS:
            record = record.replace(name, record[name][source])
        return record, frozenset((*GYROS, *ATTITUDE)), ("stale", "unknown")

    return repeated


def _rounded(record: gb.Record, draw: np.random.Generator) -> Broken:
    for name in SENSORS:
        fault = gb.Quantisation(channel=name, onset_s=ONSET_S, quantum=_larger(draw, 0.3))
        record = gb.inject(record, fault)
    return record, frozenset((*GYROS, *ATTITUDE)), ("quantisation",)


def _taxiing(record: gb.Record, draw: np.random.Generator) -> Broken:
    level, seed = _larger(draw, 0.5), int(draw.integers(1 << 30))
    span: Row = {"onset_s": ONSET_S, "duration_s": float(draw.uniform(5.0, 20.0))}
    broken = _each(record, GYROS, lambda name: gb.Noise(channel=name, deviation=level, seed=seed + ord(name), **span))
    return broken, frozenset(GYROS), ("noise",)


CAUSES: Mapping[str, Callable[[gb.Record, np.random.Generator], Broken]] = {
    "all gyros warm up": _warming,
    "all gyros shake at 25 to 30 Hz": _shaking(25.0, 30.0),
    "all gyros shake at 5 to 20 Hz": _shaking(5.0, 20.0),
    "all gyros get noisy": _noisy,
    "all gyros freeze for 0.3 to 2 s": _frozen((0.3, 2.0)),
    "all gyros stand still": _frozen(None),
    "all gyros hold readings": _held,
    "the logger repeats rows": _repeated(every=False),
    "the rate falls": _repeated(every=True),
    "all is rounded": _rounded,
    "gyros are noisy for 5 to 20 s": _taxiing,
}
HARDER = "motion harder than calibrated"  # the twelfth: nobody is hit


def single(channel: str, onset_s: float, draw: np.random.Generator) -> gb.Fault:
    """Draw a fault of a gyro or an angle."""
    unit = 1.0 if channel in GYROS else 3.0
    at: Row = {"channel": channel, "onset_s": onset_s}
    kinds: list[Callable[[], gb.Fault]] = [
        lambda: gb.Bias(**at, size=_signed(draw, 0.5 * unit)),
        lambda: gb.Drift(**at, slope=_signed(draw, 0.03 * unit)),
        lambda: gb.ScaleFactor(**at, factor=float(draw.choice([0.5, 0.7, 1.4, 2.0]))),
        lambda: gb.Noise(**at, deviation=_larger(draw, 1.5), seed=int(draw.integers(1 << 30))),
        lambda: gb.Lag(**at, lag_s=_larger(draw, 0.05)),
        lambda: gb.Oscillation(**at, amplitude=_larger(draw, 1.0), frequency_hz=float(draw.uniform(1.0, 20.0))),
        lambda: gb.Jam(**at),
    ]
    return kinds[int(draw.integers(len(kinds)))]()


class Trial(NamedTuple):
    """What is tried on a flight: of which group, and the number that draws everything else."""

    group: str
    name: str
    seed: int


def trials(first_seed: int, *, quick: bool) -> Iterator[Trial]:
    """Give every trial, each with a seed of its own."""
    counts = {CAUSE: 10, TWO: 10, WITH_ANGLE: 15, TWICE: 15, SINGLE: 100} if not quick else dict.fromkeys(GROUPS, 1)
    names: list[tuple[str, str]] = [(CAUSE, name) for name in (*CAUSES, HARDER)]
    names += [(TWO, f"{apart_s:g} s apart") for apart_s in APART_S]
    names += [(group, group) for group in (WITH_ANGLE, TWICE, SINGLE)]
    planned = [(group, name) for group, name in names for _ in range(counts[group])]
    for place, (group, name) in enumerate(planned[:: 6 if quick else 1]):
        yield Trial(group, name, first_seed + place)


GROUPS = (CAUSE, TWO, WITH_ANGLE, TWICE, SINGLE)


def flown(trial: Trial) -> gb.Record:
    """Fly and measure what a trial breaks."""
    excitation = EXCITATIONS[trial.seed % len(EXCITATIONS)]
    record = gb.measure(gb.fly("gtm", excitation, DURATION_S, trial.seed), noise="t2", seed=trial.seed)
    if trial.name != HARDER:
        return record
    harder = gb.measure(
        gb.fly("gtm", f"{excitation}*3" if False else excitation, DURATION_S, trial.seed + 7_000),
        noise="t2",
        seed=trial.seed,
    )
    return record if harder is None else harder


@dataclass(frozen=True, kw_only=True)
class Watched:
    """A trial and who watches it."""

    trial: Trial
    monitor: BankMonitor

    def row(self) -> Row:
        """Fly, break and watch; return what came out."""
        trial = self.trial
        draw = np.random.default_rng(trial.seed)
        broken, hit, kinds, second_s = broken_by(trial, flown(trial), draw)
        watch = self.monitor.watch(broken.between(WATCHED_FROM_S, DURATION_S))
        return {"group": trial.group, "name": trial.name, "seed": trial.seed} | told(watch, hit, kinds, second_s)


def broken_by(
    trial: Trial, record: gb.Record, draw: np.random.Generator
) -> tuple[gb.Record, frozenset[str], tuple[str, ...], float]:
    """Return the broken record, whom it hits, what kinds are right, and when a second fault began (nan: none)."""
    if trial.group == CAUSE:
        if trial.name == HARDER:
            return record, frozenset(), (), np.nan
        return *CAUSES[trial.name](record, draw), np.nan
    one = str(draw.choice((*GYROS, *ATTITUDE) if trial.group == SINGLE else GYROS))
    others = {
        TWO: str(draw.choice([name for name in GYROS if name != one])),
        WITH_ANGLE: ATTITUDE[GYROS.index(one)] if one in GYROS else one,
        TWICE: one,
    }
    apart_s = {TWO: float(trial.name.split()[0]) if trial.group == TWO else 0.0, WITH_ANGLE: 0.0, TWICE: 35.0}
    faults = [single(one, ONSET_S, draw)]
    if trial.group == TWICE:  # the first heals, the second stays
        kind = type(faults[0])
        faults[0] = kind(**{**vars(faults[0]), "duration_s": 12.0})
    if trial.group != SINGLE:
        faults.append(single(others[trial.group], ONSET_S + apart_s[trial.group], draw))
    for fault in faults:
        record = gb.inject(record, fault)
    second_s = ONSET_S + apart_s.get(trial.group, np.nan)
    names = tuple(f"{fault.channel} {fault.kind}" for fault in faults)
    return record, frozenset(fault.channel for fault in faults), names, second_s


def told(watch: Watch, hit: frozenset[str], kinds: tuple[str, ...], second_s: float) -> Row:
    """Hold what a monitor said against the truth."""
    alarms = [alarm for alarm in watch.faults if alarm.time_s > ONSET_S - 1e-9]
    named = {name for alarm in alarms for name in failed(alarm)}
    suspected = {name for alarm in alarms if not alarm.has_passed and not alarm.doubt for name in alarm.candidates}
    alone = len(hit) > 1 and len(named) == 1 and named < hit and not (suspected & hit) - named
    later = [alarm for alarm in alarms if alarm.onset_s > second_s - SAME_ONSET_S] if np.isfinite(second_s) else []
    return {
        "detected": bool(alarms),
        "false_alarms": sum(alarm.time_s < ONSET_S for alarm in watch.faults),
        "healthy named": bool(named - hit),
        "ever": any(j.sensor is not None and j.sensor not in hit for alarm in alarms for j in alarm.judgements),
        "alone": alone,
        "all named": bool(hit) and named == hit,
        "several": any(is_together(alarm) for alarm in alarms),
        "kind": any(alarm.last is not None and alarm.last.kind in kinds for alarm in alarms),
        "second": any(hit & set(alarm.candidates) for alarm in later),
        "hit": " ".join(sorted(hit)) if not kinds or " " not in kinds[0] else ", ".join(kinds),
        "said": "; ".join(
            f"{alarm.onset_s:.1f} {alarm.verdict} ({alarm.last.kind if alarm.last else ''})" for alarm in alarms
        ),
    }


def is_together(alarm: Alarm) -> bool:
    """Tell whether several sensors are said to have failed at once."""
    return alarm.last is not None and bool(getattr(alarm.last, "together", False))


def failed(alarm: Alarm) -> tuple[str, ...]:
    """Return the sensors that are said to have failed."""
    if is_together(alarm):
        return alarm.candidates
    return () if alarm.sensor is None else (alarm.sensor,)


if __name__ == "__main__":
    import os, time

    first, jobs = int(sys.argv[1]), int(sys.argv[2])
    only = sys.argv[4].split(",") if len(sys.argv) > 4 else None
    import pickle

    path = Path("/tmp/w/mon.pkl")
    from gtmbench.jobs.progress import Progress

    if not path.exists():
        size = Size(flights=1, calibration=20, calibration_s=300.0)
        mon = calibrated(size, jobs, lambda *a, **k: None)
        gb.save_monitor(mon, "/tmp/w/mon.json")
        path.write_bytes(b"x")
    mon = gb.load_monitor("/tmp/w/mon.json")
    ts = [
        t for t in trials(first, quick=False) if only is None or any(o in f"{t.group}:{t.name}:{t.seed}" for o in only)
    ]
    began = time.time()
    rows = pd.DataFrame(
        spread(
            Watched.row,
            [Watched(trial=t, monitor=mon) for t in ts],
            processes=jobs,
            step="x",
            progress=lambda *a, **k: None,
        )
    )
    rows.to_csv(sys.argv[3], index=False)
    g = rows.groupby(["group", "name"], sort=False)[
        ["detected", "healthy named", "ever", "alone", "all named", "several", "kind", "second", "false_alarms"]
    ].sum()
    g["n"] = rows.groupby(["group", "name"], sort=False).size()
    print(g.to_string())
    print(time.time() - began)
