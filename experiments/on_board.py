"""A monitor on board: the exported C held against Python's stream, and what it costs on a Cortex-M4.

    python experiments/on_board.py [--flights N] [--monitor FILE] [--out DIR] [--check]

Each flight lasts 150 s, half of them with doublets; a fifth is healthy, the others have one of eight kinds of faults on
a random gyro at a random time. Of the last tenth of
the flights Python makes all judgements, to see that its first alarm
is that of the scores.
``--check`` does the part on the M4 alone and needs no flights: ``make export-check``. Writes DIR/report.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import gtmbench as gb
from gtmbench.detectors.bank.calibrated import bank_residuals
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.export.write import statistics_of
from studies.compiled import M4_INSTALL, Compiled, missing_tools, run_on_m4
from studies.conduct import write_report

KINDS = ("jam", "drift", "bias", "deadzone", "noise", "scale_factor", "lag", "oscillation")
VARIANTS = ("full", "compact")
DURATION_S, FIRST_SEED = 150.0, 980_000


def fault_of(kind: str, draw: np.random.Generator) -> gb.Fault:
    """Return a fault of a kind at a random time on a random gyro, of a size from easy to hardly seen."""
    channel, onset_s = str(draw.choice(["p", "q", "r"])), float(draw.uniform(30.0, 110.0))
    at: dict[str, Any] = {"channel": channel, "onset_s": onset_s}
    size = float(np.exp(draw.uniform(np.log(0.5), np.log(2.0))))
    faults: dict[str, gb.Fault] = {
        "jam": gb.Jam(**at),
        "drift": gb.Drift(**at, slope=0.1 * size),
        "bias": gb.Bias(**at, size=0.8 * size),
        "deadzone": gb.Deadzone(**at, half_width=1.0 * size),
        "noise": gb.Noise(**at, deviation=1.0 * size),
        "scale_factor": gb.ScaleFactor(**at, factor=1.0 - 0.25 * size),
        "lag": gb.Lag(**at, lag_s=0.1 * size),
        "oscillation": gb.Oscillation(**at, amplitude=1.0 * size, frequency_hz=1.5),
    }
    return faults[kind]


def flight_of(number: int) -> tuple[str, gb.Record]:
    """Return a flight's kind of fault, or healthy, and its readings."""
    seed = FIRST_SEED + number
    draw = np.random.default_rng(seed)
    excitation = ("multisine+turbulence", "doublets+turbulence")[number % 2]
    record = gb.measure(gb.fly("gtm", excitation, DURATION_S, seed), noise="t2", seed=seed)
    if number % 5 == 0:
        return "healthy", record
    kind = KINDS[(number - number // 5 - 1) % len(KINDS)]
    return kind, gb.inject(record, fault_of(kind, draw))


def first_alarm(monitor: BankMonitor, record: gb.Record) -> tuple[int, str] | None:
    """Return the row and the residual of Python's first alarm."""
    alarm = next(iter(bank_alarms(monitor, record)), None)
    return None if alarm is None else (round((alarm.time_s - record.start_s) / record.sample_period_s), alarm.output)


def compare(monitor: BankMonitor, compiled: dict[str, Compiled], first: int, flights: int) -> list[dict[str, Any]]:
    """Return a row a flight and variant: first alarms, the largest difference of a statistic, time a sample."""
    rows = []
    for number in range(first, first + flights):
        kind, record = flight_of(number)
        python = first_alarm(monitor, record)
        if number >= first + 0.9 * flights:
            told = next((alarm for alarm in monitor.watch(record).alarms if alarm.test != "missing"), None)
            same = (
                None if told is None else (round((told.time_s - record.start_s) / record.sample_period_s), told.source)
            )
            assert same == python, (number, same, python)
        values = record.matrix(monitor.bank.channels)
        raw = bank_residuals(monitor, record).raw
        for variant, library in compiled.items():
            board = library.board
            begin = time.perf_counter()
            library.run(values, statistics=False)
            took_s = time.perf_counter() - begin
            said = library.run(values)
            risen = np.flatnonzero(said.alarms)
            c = None
            if len(risen):
                bits = int(said.alarms[risen[0]])
                c = int(risen[0]), next(each.output for j, each in enumerate(board.residuals) if bits >> j & 1)
            off, sizes = [], []
            for j, each in enumerate(board.residuals):
                expected = statistics_of(monitor, board, each.output, raw[each.output])
                known = said.statistics[each.ahead :, j]
                expected = expected[: len(known)]
                both = np.isfinite(known) & np.isfinite(expected) & (said.backlog[each.ahead :] == 0)[:, None, None]
                off.append(np.abs(known - expected)[both])
                sizes.append(expected[both])
            differences, size = np.concatenate(off), np.concatenate(sizes)
            relative = differences / np.maximum(size, 0.1)
            rows.append(
                {
                    "kind": kind,
                    "variant": variant,
                    "python": python,
                    "c": c,
                    "median": float(np.median(relative)),
                    "high": float(np.quantile(relative, 0.999)),
                    "most": float((differences / np.maximum(size, 1.0)).max()),
                    "us": took_s / len(values) * 1e6,
                }
            )
        if number % 10 == 9:
            print(f"{number + 1} flights", file=sys.stderr, flush=True)
    return rows


def summary(rows: list[dict[str, Any]], variant: str, most: int) -> list[str]:
    """Return lines of the report about a variant."""
    own = [row for row in rows if row["variant"] == variant]
    alarmed = [row for row in own if row["python"] is not None]
    off = [
        None if row["c"] is None or row["c"][1] != row["python"][1] else row["c"][0] - row["python"][0]
        for row in alarmed
    ]
    silent = [row for row in own if row["python"] is None]
    same, near = sum(each == 0 for each in off), sum(each is not None and abs(each) <= most for each in off)
    spread = Counter("other residual or none" if each is None else f"{each:+d}" for each in off if each != 0)
    also = sum(row["c"] is None for row in silent)
    us = np.median([row["us"] for row in own])
    return [
        f"| {variant} | {same} of {len(alarmed)} | {near} of {len(alarmed)} within {most} | {also} of {len(silent)} | "
        f"{np.median([row['median'] for row in own]):.1e} | {np.median([row['high'] for row in own]):.1e} | "
        f"{max(row['most'] for row in own):.3f} | {us:.2f} | "
        f"{', '.join(f'{key}: {count}' for key, count in sorted(spread.items())) or '-'} |"
    ]


def m4_lines(folders: dict[str, Path], board: Any) -> list[str]:
    """Return the lines of the report about the M4."""
    if missing_tools():
        return [f"{', '.join(missing_tools())}: not installed here, so nothing was measured. `{M4_INSTALL}`"]
    lines = [
        "| variant | flash, -Os (bytes) | state (bytes) | compiled by | median once the baseline is full | worst of the healthy part | "  # noqa: E501
        "worst of all, with fault | worst while learning | own test |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for variant, folder in folders.items():
        for optimised in ("-O2", "-O3"):
            with tempfile.TemporaryDirectory() as aside:
                m4 = run_on_m4(folder, board, Path(aside), optimised=optimised)
            counts, rows = m4.instructions, len(m4.instructions)
            learnt = 2000
            lines.append(
                f"| {variant} | {m4.flash_bytes:,} | {m4.state_bytes:,} | {optimised} | "
                f"{np.median(counts[rows * 3 // 5 : rows * 4 // 5]):,.0f} | "
                f"{counts[learnt : rows * 4 // 5].max():,.0f} | {counts[learnt:].max():,.0f} | "
                f"{counts[:learnt].max():,.0f} | {m4.said} |"
            )
    return lines


def main() -> int:
    """Measure, write the report; return 1 where the C says otherwise than Python by more than is allowed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="the number of the first flight")
    parser.add_argument("--monitor", type=Path, help="by default it is calibrated: `gtmbench calibrate`")
    parser.add_argument("--out", type=Path, default=Path("experiments/reports/on_board"))
    parser.add_argument("--check", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as aside:
        if given.monitor is None:
            monitor = gb.BankDetector(bank=gb.load_bank("C")).calibrate(
                [gb.measure(gb.fly("gtm", seed=seed, duration_s=500.0), noise="t2", seed=seed) for seed in range(1, 25)]
            )
        else:
            monitor = gb.load_monitor(given.monitor)  # type: ignore[assignment]
        folders, compiled, took = {}, {}, {}
        for variant in VARIANTS:
            begin = time.perf_counter()
            exported = gb.export_c(monitor, Path(aside, variant), compact=variant == "compact")
            took[variant] = time.perf_counter() - begin
            folders[variant] = exported.folder
            Path(aside, f"{variant}.so").mkdir()
            compiled[variant] = Compiled(exported.folder, exported.board, Path(aside, f"{variant}.so"))
        text = ["# A monitor on board", "", f"Bank {monitor.name}. Export takes {max(took.values()):.1f} s.", ""]
        text += [
            "## On a Cortex-M4 (qemu's mps2-an386; instructions a call)",
            "",
            *m4_lines(folders, exported.board),
        ]
        print("\n".join(text))
        if given.check:
            return 0
        rows = compare(monitor, compiled, given.first, given.flights)
    text += ["", f"## First alarms of {given.flights} flights, and all statistics", ""]
    text += [
        "Differences are of every statistic of every row, relative to it (to 0.1 thresholds where it is smaller), the "
        "medians over flights; and the largest of all, in thresholds or of the statistic where that is above 1. "
        "Time is of this machine, -O2.",
        "",
        "| variant | same residual, same row | near | silent where Python is | median | 99.9 % of a flight | largest | "
        "us a sample | rows off |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for variant, most in (("full", 1), ("compact", 5)):
        text += summary(rows, variant, most)
    kinds = Counter(row["kind"] for row in rows if row["variant"] == "full" and row["python"] is not None)
    text += ["", f"Python alarms on: {', '.join(f'{kind} {count}' for kind, count in sorted(kinds.items()))}.", ""]
    given.out.mkdir(parents=True, exist_ok=True)
    write_report(given.out, "\n".join(text), given)
    print("\n".join(text))
    return 0


if __name__ == "__main__":
    sys.exit(main())
