"""Trials that studies of other aircraft share: a drift and a jam of each gyro, held against the truth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

import gtmbench as gb
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.study.score import score
from gtmbench.values.channels import GYROS

DRIFT_DEG_S2 = 0.05  # that of faults/drift.toml


class Flown(NamedTuple):
    """What came of an aircraft: a line about it, and a row a trial."""

    about: dict[str, Any]
    trials: list[dict[str, Any]]


def gyro_faults(onset_s: float) -> Iterator[gb.Fault]:
    """Give each gyro's drift and jam."""
    for channel in GYROS:
        yield gb.Drift(channel=channel, onset_s=onset_s, slope=DRIFT_DEG_S2)
        yield gb.Jam(channel=channel, onset_s=onset_s)


def trial_row(monitor: BankMonitor, fault: gb.Fault, healthy: gb.Record, broken: gb.Record) -> dict[str, Any]:
    """Hold what a monitor says of a broken record against the truth."""
    verdict = score(monitor.watch(broken), fault=fault, healthy=healthy, broken=broken)
    return {
        "fault": fault.kind,
        "channel": fault.channel,
        "detected": verdict.detected,
        "delay_s": verdict.detection_delay_s if verdict.detected else np.nan,
        "right": bool(verdict.isolated),
        "wrong": bool(verdict.named_wrong),
        "kind": bool(verdict.kind_right),
        "false_alarms": verdict.false_alarms,
        "verdict": verdict.verdict,
    }
