"""The rows of a campaign: one a trial (or search) and detector, one a healthy record and detector; their columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from gtmbench.files import plain
from gtmbench.files.plain import Column, Row
from gtmbench.study import crossings

if TYPE_CHECKING:
    import pyarrow as pa

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
    **crossings.COLUMNS,
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
