"""A plain function as a detector: from a record to the times at which its alarms could be raised."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import shown
from gtmbench.detectors.alarm import alarms_at
from gtmbench.detectors.base import BaseMonitor
from gtmbench.detectors.gate import gated
from gtmbench.detectors.protocol import Watch
from gtmbench.detectors.tables import keys
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.values.record import Record

Function = Callable[[Record], ArrayLike]


@dataclass(frozen=True)
class FunctionDetector:
    """A function of a record as a detector; it needs no calibration.

    Parameters
    ----------
    function : callable
        From a `Record` to the times of its alarms in seconds; an alarm may use nothing later than its time.
    name : str, optional
        By default the function's own.
    channels : tuple of str
        The channels that it needs; empty: the function checks them itself.
    memory_s : float
        How far an alarm looks back before its time, in seconds.

    Examples
    --------
    >>> import gtmbench as gb
    >>> def limit(record):
    ...     return record.time_s[record["p"] > 4.0][:1]  # when p is first above 4 deg/s
    >>> monitor = gb.FunctionDetector(limit, channels=("p",)).calibrate()
    >>> record = gb.Record([1.0, 2.0, 5.0, 6.0], channels=["p"], sample_period_s=1.0)
    >>> monitor.name, monitor.watch(record).alarm_s
    ('limit', 2.0)
    """

    function: Function
    name: str = ""
    channels: tuple[str, ...] = ()
    memory_s: float = float("inf")

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", getattr(self.function, "__name__", type(self.function).__name__))

    def calibrate(
        self,
        records: Sequence[Record] = (),  # noqa: ARG002
        false_alarms_per_hour: float | None = None,
        *,
        progress: Progress = silent,  # noqa: ARG002
    ) -> FunctionMonitor:
        """Return the function as a monitor; the records aren't needed."""
        if false_alarms_per_hour is not None:
            raise InputError(
                f"'{self.name}' is a plain function, which can't promise {false_alarms_per_hour:g} false alarms an "
                "hour; leave the rate out"
            )
        return self.restore({})

    def restore(
        self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})
    ) -> FunctionMonitor:
        """Return the function as a monitor; there are no figures."""
        keys("figures", figures, ())
        return FunctionMonitor(
            function=self.function,
            name=self.name,
            channels=self.channels,
            memory_s=self.memory_s,
            provenance=dict(provenance),
        )


@dataclass(frozen=True, kw_only=True)
class FunctionMonitor(BaseMonitor):
    """A function of a record at work; it shows no score and names no sensor."""

    function: Function
    name: str
    channels: tuple[str, ...] = ()
    memory_s: float = float("inf")
    provenance: Mapping[str, object] = field(default_factory=dict)

    def figures(self) -> dict[str, object]:
        """Return nothing: a function has no figures."""
        return {}

    @gated
    def watch(self, record: Record) -> Watch:
        """Return the alarms that the function gives, in time."""
        record.columns(self.channels)
        times_s = _times(self.name, self.function(record))
        return Watch(monitor=self, record=record, alarms=alarms_at((time_s, self.name) for time_s in times_s))


def _times(name: str, given: ArrayLike) -> list[float]:
    try:
        times = np.atleast_1d(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError):
        times = np.array([np.nan])
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError(f"'{name}' returned {shown(given)}; return the times of its alarms in seconds, or none")
    return sorted(times.tolist())
