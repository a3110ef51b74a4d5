"""Trials: one healthy record, many faults; whether and when a detector alarms, not which sensor it names.

Whoever asks no more than that needn't watch the whole record anew for every fault. A monitor that can do with less has
a method `trials`; every other watches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol, cast

import numpy as np

from gtmbench.detectors.protocol import Monitor
from gtmbench.faults.fault import Fault, inject
from gtmbench.values.record import Record

TIE_S = 1e-9  # times are rounded to so much
FAR = 5.0  # times its threshold: how far a score is followed where nobody asks what failed


@dataclass(frozen=True, kw_only=True)
class Detection:
    """What a detector makes of a fault, before anybody asks which sensor.

    Attributes
    ----------
    alarm_s : float or None
        When the first alarm could be raised at or after the onset.
    peak_ratio : float
        Greatest score known at or after the onset over its threshold, of those that the sensor's fault enters, to the
        record's end; 0 without any. It isn't followed beyond `FAR`, and is that then.
    """

    alarm_s: float | None
    peak_ratio: float


class Trials(Protocol):
    """Faults that are put on one healthy record, one at a time."""

    def first_alarm_s(self, fault: Fault) -> float | None:
        """Return when the first alarm could be raised at or after a fault's onset; None where none is."""

    def detection(self, fault: Fault) -> Detection:
        """Return that, and how far the scores went by the record's end."""


def trials_on(monitor: Monitor, record: Record) -> Trials:
    """Return the trials of a monitor on a healthy record: its own, or those that watch.

    Examples
    --------
    >>> from gtmbench.detectors.base import FunctionDetector
    >>> from gtmbench.faults.kinds.additive import Drift
    >>> record = Record([1.0, 1.0, 1.0, 1.0], channels=["p"], sample_period_s=1.0)
    >>> limit = FunctionDetector(lambda record: record.time_s[record["p"] > 4.0], name="limit").calibrate([record])
    >>> trials_on(limit, record).first_alarm_s(Drift(channel="p", onset_s=1.0, slope=2.0))
    3.0
    """
    own = getattr(monitor, "trials", None)
    return WatchedTrials(monitor, record) if own is None else cast(Trials, own(record))


class WatchedTrials:
    """Trials of any monitor: each record is watched.

    Parameters
    ----------
    monitor : Monitor
    record : Record
        Healthy.
    broken : callable, optional
        What makes the record with a fault; by default the fault is injected, and changes its own channels only.
    """

    def __init__(self, monitor: Monitor, record: Record, *, broken: Callable[[Fault], Record] | None = None) -> None:
        self._monitor = monitor
        self._broken = partial(inject, record) if broken is None else broken

    def first_alarm_s(self, fault: Fault) -> float | None:
        """Return when the first alarm could be raised at or after a fault's onset; None where none is."""
        return self.detection(fault).alarm_s

    def detection(self, fault: Fault) -> Detection:
        """Return that, and how far the scores went by the record's end."""
        watch = self._monitor.watch(self._broken(fault))
        changed = {*fault.changes}
        entered = [score for score in watch.scores.values() if not score.channels or changed & {*score.channels}]
        return Detection(
            alarm_s=next((alarm.time_s for alarm in watch.alarms if alarm.time_s >= fault.onset_s - TIE_S), None),
            peak_ratio=min(max((score.peak(fault.onset_s) for score in entered), default=0.0), FAR),
        )


def is_superposed(fault: Fault, record: Record) -> bool:
    """Whether a fault changes one channel of a record, and begins within it: what it changes can be added up."""
    is_one = fault.changes == (fault.channel,) and all(name in record for name in fault.reads)
    return is_one and 0 < fault.onset_row(record) < len(record)


def stretches(first: int, stop: int, *, shortest: int = 256, growth: int = 4) -> list[range]:
    """Return rows as stretches that grow: what ends at its first alarm looks at little more than it has to.

    >>> stretches(0, 1000, shortest=100)
    [range(0, 100), range(100, 500), range(500, 1000)]
    """
    bounds, length = [first], shortest
    while bounds[-1] < stop:
        bounds.append(min(bounds[-1] + length, stop))
        length *= growth
    return [range(*pair) for pair in np.column_stack([bounds[:-1], bounds[1:]]).tolist()]
