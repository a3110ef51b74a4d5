"""Recorded flights: wrong scales and turned signs of a gyro that drives its attitude, which are named and which not.

    python experiments/wrong_scales_in_logs.py [FOLDER ...] [--synthetic FIRST:LAST] [--out DIR] [--processes N]

Watches every log below the folders by `gtmbench monitor`'s detector auto, as it is and with one gyro at a time that
reads 0.5, 0.7 or 1.5 of its turns, or all of them with the wrong sign. A fault begins a quarter of the way from the end
of what was learnt to the end of the flight, and lasts; an estimator of 2, 5 or 20 s, by turns, makes the attitude of
the broken gyro. *Without* is the verdict without what the references take back of turns. Prints tables, writes
report.md and cases.csv into DIR, and ends with code 1 where a healthy sensor is named. No log is kept. With --synthetic
the same of flights of the GTM by their seeds, written as tables at 10 Hz, whose attitude a filter of 20 s makes of the
gyros.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import gtmbench as gb
from gtmbench.report.tables.markdown import markdown
from gtmbench.study.log.corrections import CORRECTED
from gtmbench.values.channels import GYROS
from recorded.groups import studied_groups
from recorded.whole import NAMED, NOTHING, WRONG, Whole, alarms_after, broken_log, said_of, verdict_on, watch_whole
from slow_faults_in_logs import WORDS, Row, in_words, onset_in, synthetic

TIME_CONSTANTS_S = (2.0, 5.0, 20.0)
FACTORS = (0.5, 0.7, 1.5)
INTRODUCTION = """*put*: faults, each alone on one log. *named*: the broken gyro is named. *either-or*: among others.
*can't tell*: an alarm is left that names nobody. *nothing*: none is left. *named wrong*: a healthy sensor is named, or
an either-or doesn't hold the broken one. *without*: the same without what the references take back of turns. Logs that
end with a failed sensor as they are, or fail the self-check, have no faults put on them.
"""


def faults(sensor: str, onset_s: float) -> Iterator[tuple[str, gb.Fault]]:
    """Give the wrong scales of a gyro, and its turned sign."""
    for factor in FACTORS:
        yield f"scale {factor:g}", gb.ScaleFactor(channel=sensor, onset_s=onset_s, factor=factor)
    yield "turned sign", gb.SignFlip(channel=sensor, onset_s=onset_s)


def cases(path: Path) -> list[Row]:
    """Return what is said of a log, as it is and with each fault; an error's row where it can't be watched."""
    try:
        whole = watch_whole(path)
    except gb.GtmbenchError as error:
        return [{"log": path.name, "fault": "", "said": "refused", "told": str(error)[:120]}]
    watched = whole.watched
    told = " | ".join(map(in_words, watched.alarms))
    rows: list[Row] = [
        {"log": path.name, "fault": "", "said": watched.outcome.name, "told": told, "cpu_s": whole.cpu_s}
    ]
    onset_s = onset_in(whole)
    if onset_s is None:
        return rows
    for turn, sensor in enumerate(GYROS):
        for number, (name, fault) in enumerate(faults(sensor, onset_s)):
            tau_s = TIME_CONSTANTS_S[(turn + number + len(path.name)) % len(TIME_CONSTANTS_S)]
            try:
                told_of = _said(whole, fault, tau_s)
            except gb.InputError:  # it would bend the attitude beyond Euler angles
                continue
            rows.append(
                {"log": path.name, "sensor": sensor, "fault": name, "tau_s": tau_s, "onset_s": onset_s, **told_of}
            )
    return rows


def _said(whole: Whole, fault: gb.Fault, tau_s: float) -> Row:
    """Return what is said of a fault, with and without what references take back."""
    broken = broken_log(whole.learnt.opened, fault, gb.AttitudeEstimator(time_constant_s=tau_s))
    told = alarms_after(said_of(replace(whole.learnt, opened=broken)), whole.said, fault.onset_s)
    return {
        "said": verdict_on(told, fault.channel),
        "without": verdict_on([alarm for alarm in told if alarm.test != CORRECTED], fault.channel),
        "found_s": min((alarm.time_s - fault.onset_s for alarm in told), default=np.nan),
        "told": " | ".join(map(in_words, told))[:600],
    }


def _sums(of: pd.DataFrame) -> Row:
    counts = {word: int((of["said"] == word).sum()) for word in WORDS}
    return {"put": len(of), **counts} | {
        f"{word}, without": int((of["without"] == word).sum()) for word in (NAMED, NOTHING, WRONG)
    }


def report(rows: pd.DataFrame) -> list[str]:
    """Return tables of one group of logs."""
    clean, put = rows[rows["fault"] == ""], rows[rows["fault"] != ""]
    outcomes = ", ".join(f"{count} {name}" for name, count in clean["said"].value_counts().items())
    parts = [f"{len(clean)} logs as they are: {outcomes}. {put['log'].nunique()} of them had faults put on them."]
    if not len(put):
        return parts
    by = [
        {"fault": fault, "gyro": sensor, **_sums(of)}
        for (fault, sensor), of in put.groupby(["fault", "sensor"], sort=False)
    ]
    parts.append(markdown(pd.DataFrame([*by, {"fault": "all", "gyro": "", **_sums(put)}])))
    parts.append(
        markdown(pd.DataFrame([{"time constant (s)": tau_s, **_sums(of)} for tau_s, of in put.groupby("tau_s")]))
    )
    parts += [f"- {row.log}, {row.fault} of {row.sensor}: {row.told}" for row in put[put["said"] == WRONG].itertuples()]
    return parts


def main() -> int:
    """Watch, sum up, write."""
    head = ["# Wrong scales and turned signs of gyros in recorded flights", INTRODUCTION]
    out = Path("experiments/reports/wrong_scales_in_logs")
    everything = studied_groups(__doc__, head, out, cases=cases, synthetic=synthetic, report=report)
    return int((everything["said"] == WRONG).any())


if __name__ == "__main__":
    sys.exit(main())
