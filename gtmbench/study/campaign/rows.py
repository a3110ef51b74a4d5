"""The rows of a campaign: one a trial (or search) and detector, one a healthy record and detector; their columns.

Among them is what a delay would have been at other thresholds, and what of it the test's window took.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.protocol import Monitor, Score, Watch
from gtmbench.files import plain
from gtmbench.files.plain import Column, Row
from gtmbench.method.residual import rising
from gtmbench.study.score import first_after

if TYPE_CHECKING:
    import pyarrow as pa


_TIE_S = 1e-9  # rounding
# factors on the thresholds, and the columns of the delays there
LADDER: dict[float, str] = {
    factor: f"delay_at_{round(100 * factor)}_percent_s"
    for factor in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0)
}
# the columns of `LADDER`
_AT_OTHER_THRESHOLDS: dict[str, Column] = {
    "window_s": Column("double", "how far the test that alarmed looks back; null where it doesn't say"),
    **{
        name: Column("double", f"the delay, had all thresholds been {100 * factor:g} % of what they are; null: none")
        for factor, name in LADDER.items()
    },
}
SCHEMA = 1

COLUMNS: Mapping[str, Column] = {
    "task": Column("int32", "of the campaign; a task is a flight"),
    "aircraft": Column("string", "that was flown"),
    "excitation": Column("string", "of its surfaces and the air"),
    "closed_loop": Column("bool", "whether an autopilot flew, on what its sensors read"),
    "attitude": Column("string", "whose it is: own, or the estimator that made it of the gyros as they were read"),
    "altitude_ft": Column("double", "of another trim than the aircraft's own"),
    "tas_kt": Column("double", "of another trim than the aircraft's own"),
    "duration_s": Column("double", "of the flight"),
    "seed": Column("int64", "of the flight"),
    "noise_seed": Column("int64", "of the sensors: which healthy readings were watched, or broken"),
    "detector": Column("string", "that watched"),
    "scenario": Column("string", "that has the fault; null of a healthy record, as all on the fault"),
    "fault": Column("string", "its kind; of several in one record, the first's"),
    "channel": Column("string", "that broke"),
    "severity_name": Column("string", "the fault's first parameter"),
    "severity_given": Column("string", "as the scenario says it: 25 % of rms"),
    "severity": Column("double", "as a figure, in the parameter's unit"),
    "unit": Column("string", "of the channel"),
    "what": Column("string", "the trial in words, with all of its faults and parameters"),
    "onset_s": Column("double", "of several faults, the earliest"),
    "armed_hours": Column("double", "of a healthy record: how long an alarm was possible"),
    "false_alarms": Column("int32", "of a healthy record all alarms, else those before the onset"),
    "detected": Column("bool", "whether an alarm could be raised at or after the onset"),
    "alarm_time_s": Column("double", "when the first such could be"),
    "detection_delay_s": Column("double", "since the onset, look-ahead and windows counted"),
    "look_ahead_s": Column("double", "the part of every delay that the detector waits for samples"),
    **_AT_OTHER_THRESHOLDS,
    "peak_ratio": Column(
        "double", "largest test statistic over its threshold since the onset; of a trial that only detects at most 5"
    ),
    "altered_share": Column("double", "of the samples of the fault that it changed"),
    "departure_time_s": Column("double", "when the aircraft departed, in the loop; null: it didn't"),
    "isolated": Column("bool", "whether the sensor that it names is one that had failed"),
    "named_wrong": Column("bool", "whether it names a single one that hadn't"),
    "axis_right": Column("bool", "whether all candidates lie on the axis of one that had failed"),
    "isolation_delay_s": Column("double", "since the onset, of a right name"),
    "sensor": Column("string", "that it names"),
    "candidates": Column("string", "that it is left between, with a blank between them"),
    "kind": Column("string", "of fault that it tells"),
    "kind_right": Column("bool", "whether that is, physically, the one injected"),
    "kind_right_20s": Column("bool", "the same, 20 s after the alarm"),
    "verdict": Column("string", "in words"),
    "reason": Column("string", "why it was missed, or no sensor is named"),
    "mildest": Column("double", "of a search alone: the mildest severity that was tried, as it is given"),
    "severest": Column("double", "the severest"),
    "smallest": Column("double", "the mildest that was detected; null where none was"),
    "severity_of": Column("string", "what these three are shares of: rms, peak, slew; null: figures"),
    "error": Column("string", "what went wrong in this trial, which then says nothing else"),
}


def table_of(rows: Sequence[Row]) -> pa.Table:
    """Return rows as a part; what a row doesn't have is null.

    >>> table_of([{"task": 3, "detected": True}]).to_pylist()[0]["task"]
    3
    """
    return plain.table_of(rows, COLUMNS, schema=SCHEMA)


def crossings(watch: Watch, onset_s: float) -> Row:
    """Return the delay at every threshold of `LADDER`, and the window of the test that alarmed at the own one.

    As an alarm, a crossing is a rise: a score that stands above since before the onset says nothing new. Beyond the
    first alarm scores are what they were with the thresholds as they are.

    >>> from gtmbench.detectors.protocol import Score, Watch
    >>> from gtmbench.detectors.base import FunctionDetector
    >>> from gtmbench.values.record import Record
    >>> record = Record(np.zeros(5), channels=["p"], sample_period_s=1.0)
    >>> values = np.array([0.0, 0.2, 0.55, 1.1, 2.4])
    >>> score = Score(name="p", values=values, known_s=record.time_s, armed=values < 9.0)
    >>> monitor = FunctionDetector(lambda record: [], name="none").calibrate([record])
    >>> found = crossings(Watch(monitor=monitor, record=record, scores={"p": score}, alarms=()), onset_s=1.0)
    >>> [found[name] for name in LADDER.values()]
    [1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, None, None]
    """
    told = first_after(watch.alarms, onset_s)
    row: Row = {"window_s": None if told is None else _window_s(watch.monitor, told)}
    for factor, name in LADDER.items():
        first_s = min((_first_rise_s(score, factor, onset_s) for score in watch.scores.values()), default=np.inf)
        row[name] = round(first_s - onset_s, 9) if np.isfinite(first_s) else None
    return row


def _first_rise_s(score: Score, factor: float, onset_s: float) -> float:
    known_s = score.known_s[rising(score.values, factor * score.threshold)]
    return float(known_s[known_s >= onset_s - _TIE_S].min(initial=np.inf))


def _window_s(monitor: Monitor, alarm: Alarm) -> float | None:
    """Return the window of the test: one for all, or since when, by the alarm, there was a change."""
    own: float | None = getattr(monitor, "window_s", None)
    if own is not None or alarm.test == MISSING or alarm.onset_s >= alarm.time_s - _TIE_S:
        return own
    ahead_of = getattr(monitor, "look_ahead_of", None)  # of a bank, whose residuals wait for samples each as long as it
    ahead_s = monitor.look_ahead_s if ahead_of is None else ahead_of(alarm.source)
    return round(max(alarm.time_s - ahead_s - alarm.onset_s, 0.0), 9)
