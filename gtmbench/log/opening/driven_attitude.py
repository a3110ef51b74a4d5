"""Whether the gyros drive a log's attitude: as it is told, as its format documents, or as its samples show."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from gtmbench.checks import meant
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_contents
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.open import open_log
from gtmbench.intake.read import ReadLog, read_log
from gtmbench.log.opening.records import first_part, healthy_spans, whole_s, within
from gtmbench.method.driven_attitude import Origin, origin_of
from gtmbench.values.attitude_estimators import DRIVEN, OWN
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record, Span

FROM_LOG = "auto"
ATTITUDES = (FROM_LOG, OWN, DRIVEN)


def check_attitude(attitude: str) -> str:
    """Return which attitude is meant.

    >>> check_attitude("own")
    'own'
    """
    if attitude not in ATTITUDES:
        raise InputError(f"no attitude '{attitude}'; there is {', '.join(ATTITUDES)}{meant(attitude, ATTITUDES)}")
    return attitude


def origin_in_logs(
    logs: Sequence[Path | ReadLog],
    mapping: Sequence[str] = (),
    *,
    attitude: str = FROM_LOG,
    spans: Sequence[Span] | None = None,
) -> Origin:
    """Return whether the gyros drive the attitude of logs that are watched, or learnt from, together.

    It is what is told; else driven where any log's format documents that; else what the samples show that are healthy,
    for a broken gyro says nothing of its attitude. They are taken at the slowest channel's rate, the highest at which
    gyros and attitude can be compared.

    `logs`: the first is the one that is watched; the others are healthy. `attitude`: "auto", or "own" or "driven" where
    somebody knows. `spans`: what of the first log is healthy; without it, its first part.
    """
    if check_attitude(attitude) != FROM_LOG:
        return _as_given(attitude)
    reads = [read_log(log) for log in logs]
    contents = [log_contents(read, mapping=mapping) for read in reads]
    if any(each.attitude_from_gyros for each in contents):
        return origin_of([], documented=True)
    records: list[Record] = []
    for place, (read, each) in enumerate(zip(reads, contents, strict=True)):
        needs = [name for name in (*GYROS, *ATTITUDE) if name in each.usable]
        with contextlib.suppress(InputError):  # whoever opens it to watch it says why
            log = open_log(read, mapping=mapping, needs=needs)
            of_first = (first_part(log),) if spans is None else healthy_spans(log, spans)
            records += within(log, (whole_s(log),) if place else of_first)
    return origin_of(records)


def origin_in_log(log: FlightLog, attitude: str = FROM_LOG) -> Origin:
    """Return the same of a log as it is opened, by all of it."""
    if attitude != FROM_LOG:
        return _as_given(attitude)
    return origin_of(log.segments, documented=log.attitude_from_gyros or None)


def _as_given(attitude: str) -> Origin:
    return Origin(is_driven=attitude == DRIVEN, why="as it was told")


def rests_on_attitude(watcher: Detector | Monitor) -> bool:
    """Tell whether a bank predicts gyros from the attitude, so that it has to know who drives that.

    >>> from gtmbench.detectors.registry import find_detector
    >>> rests_on_attitude(find_detector("C"))
    True
    """
    return basis_of(watcher).attitude_from_gyros is not None


def with_origin(watcher: Detector, origin: Origin) -> Detector:
    """Return a detector that knows whether the gyros drive the attitude, where it rests on that."""
    return watcher.for_attitude(is_driven=origin.is_driven) if isinstance(watcher, _KnowsAttitude) else watcher


@runtime_checkable
class _KnowsAttitude(Protocol):
    def for_attitude(self, *, is_driven: bool) -> Detector: ...
