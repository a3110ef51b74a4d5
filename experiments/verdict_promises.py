"""What a verdict's timeline promises, held against faults of the promised size; and what of a log it judges.

    python experiments/verdict_promises.py [--seed N] [--draws N] [--healthy N] [--faults N] [--only PART ...]
        [--kept DIR] [--quick] [--out DIR] [--jobs N]

Watches healthy simulated logs, takes the sizes that a span calls clear at a drawn onset, puts a fault of that size, and
one of 1.5 times that size, on the same log, and asks the timeline of the broken log what it says of the sensor. Three
parts: ``promises``; ``healthy``, the exit codes and sizes of healthy logs; ``catalogue``, the strong faults of
`every_fault.py` that lie above the certificate. Prints tables; writes report.md and all rows into DIR; ends with code 1
where a target is missed (never with --quick). A log's rows are kept in the folder --kept, and a run that was stopped
goes on. About a minute of CPU a log.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import gtmbench as gb
from every_fault import KINDS, fault_of
from gtmbench.bench.sensors import stream
from gtmbench.jobs.processes import spread
from gtmbench.report.markup import markdown
from gtmbench.values.attitude_estimators import ESTIMATORS, OWN
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, Timeline
from studies.conduct import Campaign, Findings, conducted
from studies.noise_laws import LAWS as OF_STUDIES
from studies.tables import grouped, share_text
from studies.targets import Target, held, is_missed

PROMISES, HEALTHY, CATALOGUE = "promises", "healthy", "catalogue"
AUTO, IDENTIFY, C = "auto", "--healthy", "C"
IDENTIFIED = 0.3  # of a log, where its healthy part is named
CHANNELS = (*GYROS, *ATTITUDE)
READ = ("nz",)  # by a gyro that is sensitive to it; it isn't logged
PERIOD_S = 0.01
DURATIONS_S, RATES_HZ = (90.0, 120.0, 150.0, 200.0), (20, 25, 50, 100)
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence", "dissertation+turbulence", "turbulence", "doublets")
TURNING = "multisine+turbulence"  # about all axes
FAULTS_A_LOG = 6  # one of each kind, by each detector

BIAS, DRIFT, FACTOR, SIGN, STUCK, NOISE = PUT = ("bias", "drift", "factor", "sign", "stuck", "noise")
ANGLES, ONSET = 4, (0.55, 0.7)  # of the catalogue: every fourth fault is an angle's; of a log
UNSIZED = (SIGN, STUCK)  # -1 and 0 are factors, which a promise covers or doesn't
TIMES = (1.0, 1.5)  # the stated size
LATE_S, EARLY = 10.0, 8  # after a log's start; every eighth onset comes earlier
LOOKED, ONSETS = (0.5, 30.0), 30  # after the onset; onsets that are drawn until one lies in a promise
REACHED_S = 15.0  # a drift is off by the stated size from then on

Row = dict[str, Any]
Cell = Callable[[pd.DataFrame], object]

INTRODUCTION = """A fault begins where its sensor is called clear in the healthy log, at the size that is stated there
(*1*) or 1.5 times that (*1.5*; of a factor, 1.5 times as far from 1 in its logarithm). A drift is off by that size 15 s
after its onset. A sign that is turned and a gyro that stands still are factors of -1 and 0: a promise that states
factors covers them. Angles get biases only.

- *n*: faults. *clear*: from 0.5 to 30 s after the onset the broken log calls the sensor clear at some time. *breach*:
  it does, and states a size there at or below what the fault has reached. *lasts*: how long, the median of breaches.
- *failed*: the sensor failed, in a span that the healthy log hasn't. *suspected*: it is suspected, and didn't fail.
  *not judged*: neither, and never clear. *wrong*: another sensor failed, which is healthy. *refused*: the broken log
  can't be watched, or no estimator can make its attitude.
"""
SAID_QUICK = "**Quick: a log and a few faults. It shows that the script runs, and bounds nothing.**\n"


class Size(NamedTuple):
    """How much is done, and from which seed on."""

    seed: int
    draws: int
    healthy: int
    faults: int
    parts: Sequence[str]


class Log(NamedTuple):
    """How a log is made: what moves the aircraft, what the sensors add, what is logged."""

    seed: int
    duration_s: float
    rate_hz: int
    excitation: str
    law: str
    attitude: str

    @property
    def every(self) -> int:
        """Every which sample is logged."""
        return round(1.0 / (PERIOD_S * self.rate_hz))


class Task(NamedTuple):
    """A log, and what is done with it: which part, by which detectors, which faults; and where its rows are kept."""

    part: str
    log: Log
    detectors: tuple[str, ...]
    faults: tuple[int, ...] = ()
    kept: Path | None = None


class Put(NamedTuple):
    """A fault of a promise."""

    kind: str
    sensor: str
    onset_s: float
    times: float
    size: float
    fault: gb.Fault


# ---- logs ----

# what logs are called by, and the law; streams of noise are drawn by the former
LAWS = {
    "white": "white",
    "white x0.6": "level x0.6",
    "white x1.3": "level x1.3",
    "ar1": "AR(1) 0.7",
    "t4": "Student t4",
}


def with_noise(truth: gb.Record, law: str, seed: int) -> gb.Record:
    """Return a record whose sensors have noise of a law, times the T2's, each channel from a stream of its own."""
    for name in truth.channels:
        if name in SENSORS:
            drawn = OF_STUDIES[LAWS[law]](stream(seed, f"{name}\0{law}"), len(truth))
            truth = truth.replace(name, truth[name] + gb.CHANNELS[name].noise * drawn)
    return truth


def any_log(number: int, seed: int) -> Log:
    """Draw a log: each of its properties runs through all values, in an order of its own."""
    draw = np.random.default_rng([seed, number])
    return Log(
        seed=seed * 1000 + number,
        duration_s=DURATIONS_S[number % len(DURATIONS_S)],
        rate_hz=RATES_HZ[int(draw.integers(len(RATES_HZ)))],
        excitation=EXCITATIONS[number % len(EXCITATIONS)],
        law=str(draw.choice(list(LAWS))),
        attitude=OWN if number % 2 == 0 else str(draw.choice(list(ESTIMATORS))),
    )


def usual_log(number: int, seed: int) -> Log:
    """Draw a log of 120 s and more, of 50 or 100 Hz, turning about all axes, with an attitude of its own."""
    long_s, fast_hz = DURATIONS_S[1:], RATES_HZ[2:]
    return Log(
        seed=seed * 1000 + 500 + number,
        duration_s=long_s[number % len(long_s)],
        rate_hz=fast_hz[number % len(fast_hz)],
        excitation=TURNING,
        law=list(LAWS)[number % len(LAWS)],
        attitude=OWN,
    )


def logged(log: Log, truth: gb.Record, fault: gb.Fault | None = None) -> gb.Record:
    """Return what is logged of a flight: a broken gyro enters the estimator, a broken angle comes behind it."""
    is_gyro = fault is not None and fault.channel in GYROS
    sensed = with_noise(truth.select((*CHANNELS, *READ)), log.law, log.seed)
    if fault is not None and is_gyro:
        sensed = gb.inject(sensed, fault)
    if log.attitude != OWN:
        for name in ATTITUDE:
            sensed = sensed.replace(name, truth[name])
        estimator = ESTIMATORS[log.attitude]
        learnt_s = estimator.bias_time_constant_s
        sensed = gb.filtered_attitude(
            sensed,
            time_constant_s=estimator.time_constant_s,
            seed=log.seed,
            bias_time_constant_s=learnt_s if math.isfinite(learnt_s) else None,
        )
    if fault is not None and not is_gyro:
        sensed = gb.inject(sensed, fault)
    return gb.Record(sensed.matrix(CHANNELS)[:: log.every], channels=CHANNELS, sample_period_s=PERIOD_S * log.every)


def watched_by(detector: str, log: Log, record: gb.Record) -> gb.WatchedLog:
    """Watch a record as a log."""
    healthy: list[Span] = [(0.0, IDENTIFIED * log.duration_s)] if detector == IDENTIFY else []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.csv")
        gb.write_log(record, path)
        return gb.watch_log(path, AUTO if detector == IDENTIFY else detector, healthy=healthy)


# ---- promises ----


def fault_at(kind: str, sensor: str, onset_s: float, times: float, sizes: Sizes, draw: int) -> Put | None:
    """Return the fault of a kind of so many times the stated size; None where the promise doesn't cover it.

    Parameters
    ----------
    kind, sensor : str
    onset_s, times : float
    sizes : Sizes
    draw : int
        Even for the smaller sign, and a factor below 1.
    """
    at: dict[str, Any] = {"channel": sensor, "onset_s": onset_s}
    sign = 1.0 if draw % 2 else -1.0
    size = times * sizes.error
    fault: gb.Fault | None = None
    if kind == BIAS:
        fault = gb.Bias(**at, size=sign * size)
    elif kind == DRIFT:
        fault = gb.Drift(**at, slope=sign * size / REACHED_S)
    elif kind == NOISE and sizes.noise is not None:
        size = times * sizes.noise
        fault = gb.Noise(**at, deviation=size, seed=draw)
    elif sizes.factors is not None:
        size, fault = _wrong_factor(kind, at, times, sizes.factors[draw % 2], sizes.factors[0])
    return None if fault is None else Put(kind, sensor, onset_s, times, size, fault)


def _wrong_factor(
    kind: str, at: dict[str, Any], times: float, stated: float, lowest: float
) -> tuple[float, gb.Fault | None]:
    if kind == FACTOR:
        size = stated**times if stated > 0.0 else 1.0 + times * (stated - 1.0)
        return size, gb.ScaleFactor(**at, factor=size)
    if kind == SIGN and lowest >= -1.0:
        return -1.0, gb.SignFlip(**at)
    if kind == STUCK and lowest >= 0.0:
        return 0.0, gb.Jam(**at)
    return 0.0, None


def promised_s(put: Put, span: SensorSpan, within_s: Span) -> float:
    """Return for how long of some time a clear span states a size at or below what the fault has reached."""
    start_s, end_s = max(span.start_s, within_s[0]), min(span.end_s, within_s[1])
    sizes = span.sizes
    if sizes is None or end_s <= start_s:
        return 0.0
    slack = 1.0 + 1e-9
    if put.kind == DRIFT:
        reached_s = put.onset_s + REACHED_S * sizes.error / (put.size * slack)
        return max(0.0, end_s - max(start_s, reached_s))
    if put.kind == BIAS:
        is_promised = sizes.error <= put.size * slack
    elif put.kind == NOISE:
        is_promised = sizes.noise is not None and sizes.noise <= put.size * slack
    else:
        is_promised = sizes.factors is not None and not (
            sizes.factors[0] < put.size - 1e-9 and put.size + 1e-9 < sizes.factors[1]
        )
    return end_s - start_s if is_promised else 0.0


def told_of(put: Put, timeline: Timeline, healthy: Timeline) -> Row:
    """Return what the timeline of a broken log says of its broken sensor, and of the others."""
    within_s = (put.onset_s + LOOKED[0], min(put.onset_s + LOOKED[1], timeline.span_s[1]))
    clear = timeline.of(put.sensor, State.CLEAR)
    clear_s = sum(max(0.0, min(each.end_s, within_s[1]) - max(each.start_s, within_s[0])) for each in clear)
    breach_s = sum(promised_s(put, each, within_s) for each in clear)
    accused = {
        state: {
            sensor
            for sensor in timeline.sensors
            for each in timeline.of(sensor, state)
            if each.end_s > put.onset_s and not _was_there(each, healthy.of(sensor, state))
        }
        for state in (State.FAILED, State.SUSPECTED)
    }
    failed = put.sensor in accused[State.FAILED]
    suspected = not failed and put.sensor in accused[State.SUSPECTED]
    return {
        "clear": clear_s > 0.0,
        "breach": breach_s > 0.0,
        "breach_s": breach_s,
        "failed": failed,
        "suspected": suspected,
        "not judged": not (failed or suspected or clear_s > 0.0),
        "wrong": " ".join(sorted(accused[State.FAILED] - {put.sensor})),
    }


def _was_there(span: SensorSpan, before: Sequence[SensorSpan]) -> bool:
    return any(each.start_s < span.end_s and span.start_s < each.end_s for each in before)


def drawn(kind: str, timeline: Timeline, rng: np.random.Generator, *, is_early: bool) -> tuple[list[Put], Row]:
    """Draw a sensor and an onset that a promise covers; return the faults there, none where none was found."""
    there = [name for name in (CHANNELS if kind == BIAS else GYROS) if name in timeline.sensors]
    start_s, end_s = timeline.span_s
    between = (start_s + LOOKED[0], start_s + LATE_S) if is_early else (start_s + LATE_S, end_s)
    row: Row = {"kind": kind, "early": is_early, "at first": False}
    for number in range(ONSETS if there else 0):
        sensor, onset_s, draw = str(rng.choice(there)), float(rng.uniform(*between)), int(rng.integers(1000))
        span = timeline.at(sensor, onset_s)
        if span.state is State.CLEAR and span.sizes is not None:
            times = TIMES[:1] if kind in UNSIZED else TIMES
            puts = [fault_at(kind, sensor, onset_s, each, span.sizes, draw) for each in times]
            if all(put is not None for put in puts):
                return [put for put in puts if put is not None], row | {"at first": number == 0}
    return [], row


def promises(task: Task) -> Iterator[Row]:
    """Watch a healthy log, and faults of the sizes that it promises."""
    log = task.log
    truth = gb.fly("gtm", log.excitation, log.duration_s, log.seed)
    for detector in task.detectors:
        about: Row = {"part": PROMISES, "detector": detector, **log._asdict()}
        healthy = _watched(detector, log, partial(logged, log, truth))
        yield about | {"kind": "none", **healthy.row}
        if healthy.log is None:
            continue
        before = healthy.log.timeline
        for number in task.faults:
            rng = np.random.default_rng([log.seed, number, *detector.encode()])
            puts, row = drawn(PUT[number % len(PUT)], before, rng, is_early=number % EARLY == EARLY - 1)
            if not puts:
                yield about | row | {"promised": False}
            for put in puts:
                broken = _watched(detector, log, partial(logged, log, truth, put.fault))
                told = {} if broken.log is None else told_of(put, broken.log.timeline, before)
                yield about | row | put._asdict() | {"fault": "", "promised": True} | broken.row | told


class Watched(NamedTuple):
    """A log that was watched, and what is written of it; no log where it can't be."""

    log: gb.WatchedLog | None
    row: Row


def _watched(detector: str, log: Log, make: Callable[[], gb.Record]) -> Watched:
    try:
        record = make()
        began = time.process_time()
        watched = watched_by(detector, log, record)
    except gb.GtmbenchError as error:  # such as a fault that bends the attitude beyond Euler angles
        return Watched(None, {"exit": 2, "told": str(error)[:200]})
    verdict = watched.verdict
    accused = [f"{sensor} {span.state.value}" for sensor, span in (*verdict.failed, *verdict.suspected)]
    return Watched(
        watched, {"exit": verdict.exit_code, "told": ", ".join(accused), "cpu_s": time.process_time() - began}
    )


# ---- healthy logs, and faults of the catalogue ----


def stated(timeline: Timeline, sensor: str) -> float:
    """Return the error that a sensor's clear spans state, the median over their time; NaN where there is none."""
    spans = [(span.sizes.error, span.duration_s) for span in timeline.of(sensor, State.CLEAR) if span.sizes is not None]
    if not spans:
        return math.nan
    sizes, lasts = (np.array(each) for each in zip(*sorted(spans), strict=True))
    return float(sizes[np.searchsorted(np.cumsum(lasts), 0.5 * lasts.sum())])


def usual(task: Task) -> Iterator[Row]:
    """Watch a healthy log, then the same with faults of the catalogue that lie above its certificate."""
    log = task.log
    truth = gb.fly("gtm", log.excitation, log.duration_s, log.seed)
    for detector in task.detectors:
        about: Row = {"detector": detector, **log._asdict()}
        healthy = _watched(detector, log, partial(logged, log, truth))
        ratios = {} if healthy.log is None else {f"over {name}": over_certificate(healthy.log, name) for name in GYROS}
        yield about | {"part": HEALTHY, **healthy.row, **ratios}
        if healthy.log is None:
            continue
        for number in task.faults:
            yield about | {"part": CATALOGUE, **_of_catalogue(detector, log, truth, healthy.log, number)}


def over_certificate(watched: gb.WatchedLog, gyro: str) -> float:
    """Return what is stated of a gyro, over the bias of its certificate; NaN where one of them is none."""
    row = watched.certificate.of(gyro, "bias")
    return math.nan if row is None or row.size is None else stated(watched.timeline, gyro) / row.size


def _of_catalogue(detector: str, log: Log, truth: gb.Record, healthy: gb.WatchedLog, number: int) -> Row:
    rng = np.random.default_rng([log.seed, number])
    name = list(KINDS)[number % len(KINDS)]
    group = ATTITUDE if number % ANGLES == ANGLES - 1 else GYROS
    sensor = str(rng.choice(group))
    span_s = (round(float(rng.uniform(*ONSET)) * log.duration_s, 2), log.duration_s)
    kind = KINDS[name]
    strong = (kind.gyro if group == GYROS else kind.angle)[-1]
    fault = fault_of(name, sensor, strong, truth, span_s, seed=log.seed)
    size = float(getattr(fault, kind.name)) if kind.name else math.nan
    above = is_above(healthy, sensor, name, size)
    row: Row = {"kind": name, "sensor": sensor, "onset_s": span_s[0], "size": size, "above": above}
    if not above:
        return row
    broken = _watched(detector, log, partial(logged, log, truth, fault))
    if broken.log is None:
        return row | broken.row
    failed = {each for each, _ in broken.log.verdict.failed}
    suspected = {each for each, _ in broken.log.verdict.suspected}
    told = {
        "failed": sensor in failed,
        "suspected": sensor not in failed and sensor in suspected,
        "wrong": " ".join(sorted(failed - {sensor})),
    }
    return row | broken.row | told


def is_above(healthy: gb.WatchedLog, sensor: str, kind: str, size: float) -> bool:
    """Tell whether a fault is larger than the smallest that the certificate of the healthy log states, if it does."""
    row = healthy.certificate.of(sensor, kind)
    if row is None:
        return True
    return row.size is not None and (abs(size - 1.0) if kind == "scale_factor" else abs(size)) >= row.size


# ---- the report ----


def hits(column: str) -> Cell:
    """Count where a column is true."""
    return lambda of: int(of[column].eq(True).sum())


def exits(code: int) -> Cell:
    """Count an exit code."""
    return lambda of: int(of["exit"].eq(code).sum())


def named_wrong(of: pd.DataFrame) -> int:
    """Count the rows in which a healthy sensor failed."""
    return int(of["wrong"].fillna("").ne("").sum())


def lasting(of: pd.DataFrame) -> str:
    """Write how long breaches last, their median."""
    breaches = of[of["breach"].eq(True)]
    return f"{breaches['breach_s'].median():.1f} s" if len(breaches) else "-"


OF_FAULTS: dict[str, Cell] = {
    "n": len,
    "clear": hits("clear"),
    "breach": hits("breach"),
    "lasts": lasting,
    "failed": hits("failed"),
    "suspected": hits("suspected"),
    "not judged": hits("not judged"),
    "wrong": named_wrong,
    "refused": exits(2),
}
OF_LOGS: dict[str, Cell] = {
    "logs": len,
    **{f"exit {code}": exits(code) for code in (0, 1, 3, 2)},
    "CPU (s)": lambda of: f"{of['cpu_s'].mean():.1f}",
}
OF_CATALOGUE: dict[str, Cell] = {
    "faults": len,
    "exit 1": exits(1),
    "named": lambda of: int((of["failed"].eq(True) & of["exit"].eq(1)).sum()),
    "suspected": hits("suspected"),
    "wrong": named_wrong,
    "exit 0": exits(0),
}


def put_in(rows: pd.DataFrame, *, early: bool = False) -> pd.DataFrame:
    """Return the faults that were put in promises: those from 10 s on, or the earlier ones."""
    own = rows[rows["part"].eq(PROMISES) & rows["kind"].ne("none")]
    return own[own["promised"].eq(True) & own["early"].eq(early)]


def of_promises(rows: pd.DataFrame) -> list[str]:
    """Return the paragraphs of the promises."""
    own = rows[rows["part"].eq(PROMISES)]
    clean, draws = own[own["kind"].eq("none")], own[own["kind"].ne("none") & own["times"].ne(TIMES[1])]
    put, early = put_in(rows), put_in(rows, early=True)
    parts = ["## Promises", "Healthy logs:", markdown(grouped(clean, {"detector": "detector"}, OF_LOGS))]
    share = {"draws": len, "in a promise": lambda of: share_text(int(of["at first"].eq(True).sum()), len(of))}
    if len(draws):
        parts += ["The first onset that was drawn:", markdown(grouped(draws, {"detector": "detector"}, share))]
    if not len(put):
        return [*parts, "No fault lay in a promise."]
    put = put.sort_values(["detector", "times"], kind="stable")
    both = {"detector": "detector", "times": "times"}
    parts += [markdown(grouped(put, both, OF_FAULTS)), markdown(grouped(put, both | {"kind": "kind"}, OF_FAULTS))]
    for name in ("rate_hz", "attitude", "law", "excitation"):
        parts.append(markdown(grouped(put.sort_values([name, "times"]), {name: name, "times": "times"}, OF_FAULTS)))
    if len(early):
        parts += ["Onsets in the first 10 s of a log:", markdown(grouped(early, both, OF_FAULTS))]
    breaches = put[put["breach"].eq(True)]
    columns = [
        "seed",
        "detector",
        "kind",
        "sensor",
        "times",
        "size",
        "onset_s",
        "breach_s",
        "rate_hz",
        "attitude",
        "exit",
    ]
    return [*parts, "Breaches:", markdown(breaches[columns].round(3))] if len(breaches) else parts


def of_usual(rows: pd.DataFrame) -> list[str]:
    """Return the paragraphs of healthy logs and of the catalogue."""
    clean, put = rows[rows["part"].eq(HEALTHY)], rows[rows["part"].eq(CATALOGUE)]
    parts = []
    if len(clean):
        sizes = {f"{name} over certificate": _median(f"over {name}") for name in GYROS}
        parts += ["## Healthy logs", markdown(grouped(clean, {"detector": "detector"}, OF_LOGS | sizes))]
        parts += [
            f"- seed {row.seed}, {row.detector}: exit {row.exit} {row.told}"
            for row in clean[clean["exit"].ne(0)].itertuples()
        ]
    if len(put):
        above = put[put["above"].eq(True)].assign(
            group=lambda of: of["sensor"].isin(GYROS).map({True: "gyro", False: "angle"})
        )
        parts += [f"## Catalogue\n\n{len(put) - len(above)} of {len(put)} faults lie below the certificate."]
        by = {"detector": "detector", "sensors": "group"}
        parts += [markdown(grouped(above, each, OF_CATALOGUE)) for each in (by, by | {"fault": "kind"})]
    return parts


def _median(column: str) -> Cell:
    return lambda of: f"{of[column].median():.2f}"


TARGETS = {
    PROMISES: (
        Target("faults of the stated size in a span called clear, share", PROMISES, "breach 1", "<=", 0.05),
        Target("faults of 1.5 times that size, in number", PROMISES, "breach 1.5", "<=", 0.0),
    ),
    HEALTHY: (
        Target("healthy logs with exit 0, auto, share", HEALTHY, "auto", ">=", 0.95),
        Target("healthy logs with exit 0, C, share", HEALTHY, "C", ">=", 0.95),
        Target("stated size over certificate, median", HEALTHY, "over", "<=", 1.3),
    ),
}


def figures_of(rows: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Return what the targets ask for."""
    put = put_in(rows)
    breach, clean = put["breach"].eq(True), rows[rows["part"].eq(HEALTHY)]
    over = clean[[f"over {name}" for name in GYROS]].to_numpy(dtype=float) if len(clean) else np.full((1, 3), np.nan)
    return {
        PROMISES: {
            "breach 1": float(breach[put["times"].eq(TIMES[0])].mean()) if len(put) else math.nan,
            "breach 1.5": float(breach[put["times"].eq(TIMES[1])].sum()),
        },
        HEALTHY: {
            **{name: float(clean[clean["detector"].eq(name)]["exit"].eq(0).mean()) for name in (AUTO, C)},
            "over": float(np.nanmedian(over)) if np.isfinite(over).any() else math.nan,
        },
    }


# ---- all of it ----


def tasks(size: Size, kept: Path | None = None) -> list[Task]:
    """Return what is flown: logs of any kind with their promises, usual ones with faults of the catalogue."""
    detectors = (AUTO, IDENTIFY, C)
    planned: list[Task] = []
    if PROMISES in size.parts:
        for number in range(math.ceil(size.draws / (FAULTS_A_LOG * len(detectors)))):
            first = number * FAULTS_A_LOG
            own = tuple(range(first, first + FAULTS_A_LOG))
            planned.append(Task(PROMISES, any_log(number, size.seed), detectors, own, kept))
    if {HEALTHY, CATALOGUE} & set(size.parts):
        faults = size.faults if CATALOGUE in size.parts else 0
        for number in range(size.healthy):
            own = tuple(range(number, faults, size.healthy))
            planned.append(Task(HEALTHY, usual_log(number, size.seed), (AUTO, C), own, kept))
    return planned


def worked(task: Task) -> list[Row]:
    """Do a task, or return what was kept of it."""
    path = None if task.kept is None else task.kept / f"{task.part} {task.log.seed} {len(task.faults)}.json"
    if path is not None and path.exists():
        return list(json.loads(path.read_text()))
    rows = list(promises(task) if task.part == PROMISES else usual(task))
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(rows, default=float))
    return rows


COLUMNS = (
    *("part", "detector", *Log._fields, "kind", "sensor", "onset_s", "early", "times", "size", "promised", "exit"),
    *("told", "cpu_s", "clear", "breach", "breach_s", "failed", "suspected", "wrong", "above"),
)


def report(rows: pd.DataFrame, parts: Sequence[str], *, quick: bool) -> str:
    """Return the report as Markdown."""
    figures = figures_of(rows)
    aims = [target for part in parts for target in TARGETS.get(part, ())]
    text = ["# What a verdict promises", *([SAID_QUICK] if quick else []), INTRODUCTION]
    text += [markdown(held(aims, figures))] if aims else []
    text += of_promises(rows) if PROMISES in parts else []
    return "\n\n".join([*text, *of_usual(rows)]) + "\n"


def conduct(campaign: Campaign) -> Findings:
    """Fly, break, watch, report."""
    given = campaign.given
    size = Size(given.seed, given.draws, given.healthy, given.faults, given.only or (PROMISES, HEALTHY, CATALOGUE))
    if campaign.quick:
        size = size._replace(draws=1, healthy=1, faults=1)
    done = spread(worked, tasks(size, given.kept), processes=campaign.jobs, step="logs", progress=campaign.tell)
    rows = pd.DataFrame([row for each in done for row in each])
    rows = rows.reindex(columns=[*COLUMNS, *(name for name in rows.columns if name not in COLUMNS)])
    aims = [target for part in size.parts for target in TARGETS.get(part, ())]
    missed = is_missed(aims, figures_of(rows))
    text = report(rows, size.parts, quick=campaign.quick)
    return Findings(text, missed, lambda out: rows.to_csv(out / "rows.csv", index=False))


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add how much is done."""
    parser.add_argument("--seed", type=int, default=641, help="of all draws (default: %(default)s)")
    parser.add_argument("--draws", type=int, default=500, help="faults of the promised size (default: %(default)s)")
    parser.add_argument("--healthy", type=int, default=40, help="healthy logs (default: %(default)s)")
    parser.add_argument("--faults", type=int, default=120, help="faults of the catalogue (default: %(default)s)")
    parser.add_argument("--kept", type=Path, help="folder of rows that were made before, and to keep them in")
    parser.add_argument("--only", nargs="*", choices=(PROMISES, HEALTHY, CATALOGUE), help="these parts alone")


if __name__ == "__main__":
    sys.exit(conducted(conduct, __doc__, quick="a log, a fault of each kind", arguments=arguments))
