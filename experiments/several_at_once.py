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
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.protocol import Watch
from gtmbench.jobs.processes import spread
from gtmbench.report.markup import markdown
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from studies.conduct import Campaign, Findings, conducted
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

EXCITATIONS = ("doublets+turbulence", "dissertation+turbulence", "multisine+turbulence")
FIRST_SEED = 660_001  # of the report; seeds from 610,001 to 650,000 were looked at while building
CALIBRATION_FLIGHTS, CALIBRATION_S = 20, 300.0
DURATION_S, ONSET_S, WATCHED_FROM_S = 170.0, 90.0, 10.0
APART_S = (0.0, 0.5, 3.0, 8.0, 30.0)
CAUSE, TWO, WITH_ANGLE, TWICE, SINGLE = "common cause", "two gyros", "gyro and its angle", "fails twice", "single"
SAME_ONSET_S = 1.0  # what began that near to the second fault is that one
SAID_QUICK = (
    "**Quick: a few trials and a monitor of little flight. It shows that the script runs, and bounds nothing.**\n\n"
)
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
    counts = dict.fromkeys(GROUPS, 1) if quick else {CAUSE: 10, TWO: 10, WITH_ANGLE: 15, TWICE: 15, SINGLE: 100}
    names: list[tuple[str, str]] = [(CAUSE, name) for name in (*CAUSES, HARDER)]
    names += [(TWO, f"{apart_s:g} s apart") for apart_s in APART_S]
    names += [(group, group) for group in (WITH_ANGLE, TWICE, SINGLE)]
    planned = [(group, name) for group, name in names for _ in range(counts[group])]
    for place, (group, name) in enumerate(planned[:: 6 if quick else 1]):
        yield Trial(group, name, first_seed + place)


GROUPS = (CAUSE, TWO, WITH_ANGLE, TWICE, SINGLE)


def flown(trial: Trial) -> gb.Record:
    """Fly and measure what a trial breaks; for harder motion a servo swings from the onset on, and no sensor fails."""
    draw = np.random.default_rng(trial.seed)
    harder: list[gb.Fault] = []
    if trial.name == HARDER:
        surface, size = str(draw.choice(["aileron", "elevator", "rudder"])), float(draw.uniform(2.0, 10.0))
        swing: Row = {"amplitude": size, "frequency_hz": float(draw.uniform(0.2, 1.0))}
        harder = [gb.Oscillation(channel=surface, onset_s=ONSET_S, **swing)]
    excitation = EXCITATIONS[trial.seed % len(EXCITATIONS)]
    flight = gb.fly("gtm", excitation, DURATION_S, trial.seed, faults=harder)
    return gb.measure(flight, noise="t2", seed=trial.seed)


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
        watch = self.monitor.watch(broken.between(WATCHED_FROM_S, min(DURATION_S, broken.end_s)))
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
    named = {name for alarm in alarms if alarm.last is not None for name in alarm.last.failed}
    suspected = {name for alarm in alarms if not alarm.has_passed and not alarm.doubt for name in alarm.candidates}
    alone = len(hit) > 1 and len(named) == 1 and named < hit and not (suspected & hit) - named
    later = [alarm for alarm in alarms if alarm.onset_s > second_s - SAME_ONSET_S] if np.isfinite(second_s) else []
    return {
        "detected": bool(alarms),
        "false_alarms": sum(alarm.time_s < ONSET_S for alarm in watch.faults),
        "healthy named": bool(named - hit),
        "ever": any({*judged.failed} - hit for alarm in alarms for judged in alarm.judgements),
        "alone": alone,
        "all named": bool(hit) and named == hit,
        "several": any(alarm.is_of_several for alarm in alarms),
        "kind": any(alarm.last is not None and alarm.last.kind in kinds for alarm in alarms),
        "second": any(hit & set(alarm.candidates) for alarm in later),
        "hit": " ".join(sorted(hit)) if not kinds or " " not in kinds[0] else ", ".join(kinds),
        "said": "; ".join(
            f"{alarm.onset_s:.1f} {alarm.verdict} ({alarm.last.kind if alarm.last else ''})" for alarm in alarms
        ),
    }


Cell = Callable[[pd.DataFrame], object]


def count(column: str) -> Cell:
    """Say how often a column is true."""
    return lambda rows: int(rows[column].sum())


CELLS: Mapping[str, Cell] = {
    "trials": len,
    "detected": count("detected"),
    "a healthy sensor named": count("healthy named"),
    "at any time": count("ever"),
    "one of several named, no other suspected": count("alone"),
    "exactly those that are hit": count("all named"),
    "told as several at once": count("several"),
    "kind right": count("kind"),
}


def merits(rows: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return what the targets ask for."""
    of = {group: rows[rows["group"] == group] for group in GROUPS}
    found = {group: own[own["detected"]] for group, own in of.items()}
    two, together = of[TWO], of[TWO]["name"] == f"{APART_S[0]:g} s apart"
    later = two["name"].isin([f"{apart_s:g} s apart" for apart_s in APART_S if apart_s >= 3.0])
    several = found[CAUSE][found[CAUSE]["name"] != HARDER]
    return {
        CAUSE: {
            "wrong": int((of[CAUSE]["healthy named"] | of[CAUSE]["alone"]).sum()),
            "right": float((several["all named"] & several["kind"]).mean()),
        },
        SINGLE: {"several": float(found[SINGLE]["several"].mean())},
        TWO: {
            "wrong": int(two["healthy named"].sum()),
            "together": float(two[together]["all named"].mean()),
            "later": float(two[later]["all named"].mean()),
        },
        WITH_ANGLE: {
            "wrong": int(of[WITH_ANGLE]["healthy named"].sum()),
            "both": float(of[WITH_ANGLE]["all named"].mean()),
        },
        TWICE: {"wrong": int(of[TWICE]["healthy named"].sum()), "both": float(of[TWICE]["second"].mean())},
    }


TARGETS = (
    Target("common causes: a healthy sensor, or one alone, is never named", CAUSE, "wrong", "<=", 0),
    Target("common causes: the kind, and exactly those that are hit, at least 80 %", CAUSE, "right", ">=", 0.8),
    Target("single faults told as several at most 2 %", SINGLE, "several", "<=", 0.02),
    Target("two gyros: a healthy sensor is never named", TWO, "wrong", "<=", 0),
    Target("two gyros together: both named at least 60 %", TWO, "together", ">=", 0.6),
    Target("two gyros 3 s apart and more: both named at least 90 %", TWO, "later", ">=", 0.9),
    Target("a gyro and its angle: a healthy sensor is never named", WITH_ANGLE, "wrong", "<=", 0),
    Target("a gyro and its angle: both named at least 70 %", WITH_ANGLE, "both", ">=", 0.7),
    Target("a sensor fails twice: a healthy one is never named", TWICE, "wrong", "<=", 0),
    Target("a sensor fails twice: the second is told at least 70 %", TWICE, "both", ">=", 0.7),
)


def report(rows: pd.DataFrame, figures: Mapping[str, Mapping[str, float]], size: Size, *, quick: bool) -> str:
    """Return the report as Markdown."""
    lines = [
        f"- {row['name']}, {row['seed']} ({row['hit'] or 'nobody is hit'}): {row['said']}"
        for row in rows[rows["healthy named"] | rows["alone"]].to_dict("records")
    ]
    return f"""# Several sensors hit at once

{SAID_QUICK if quick else ""}Bank C, calibrated on {size.calibration} flights of {size.calibration_s:g} s,
watches {len(rows)} flights of {DURATION_S:g} s (seeds {rows["seed"].min()} to {rows["seed"].max()};
{", ".join(EXCITATIONS)} in turn), each broken in
another way from {ONSET_S:g} s on; sizes are drawn from about what is detected to ten times it. *At any time*: a healthy
sensor is named by some look, and perhaps no longer at the end. *Kind right* is asked of common causes alone. Of a
sensor that fails twice the first fault lasts 12 s, the second begins 35 s after the first.

## Targets

{markdown(held(TARGETS, figures))}

## What is told

{markdown(grouped(rows, {"what happens": "group", "how": "name"}, CELLS))}

Second fault told, of a gyro and its angle and of a sensor that fails twice: {second_text(rows)}.

## Wrong, or one alone

{chr(10).join(lines) or "None."}
"""


def second_text(rows: pd.DataFrame) -> str:
    """Say how often a second fault has an alarm that suspects it."""
    return ", ".join(
        f"{group} {share_text(int(own['second'].sum()), len(own))}"
        for group, own in rows[rows["group"].isin([WITH_ANGLE, TWICE])].groupby("group", sort=False)
    )


def conduct(campaign: Campaign) -> Findings:
    """Fly, judge, report."""
    flights = QUICK.calibration if campaign.quick else CALIBRATION_FLIGHTS
    calibration_s = QUICK.calibration_s if campaign.quick else CALIBRATION_S
    size = Size(calibration=flights, calibration_s=calibration_s)
    monitor = calibrated(size, campaign.jobs, campaign.tell)
    planned = [Watched(trial=each, monitor=monitor) for each in trials(campaign.given.first_seed, quick=campaign.quick)]
    rows = pd.DataFrame(spread(Watched.row, planned, processes=campaign.jobs, step="flights", progress=campaign.tell))
    figures = merits(rows)

    def write(out: Path) -> None:
        rows.to_csv(out / "trials.csv", index=False)

    return Findings(report(rows, figures, size, quick=campaign.quick), is_missed(TARGETS, figures), write)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the study takes."""
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, metavar="N", help="seed of the first flight")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="a trial of every sixth kind", beside="trials", arguments=arguments))
