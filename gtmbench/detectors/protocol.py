"""One way for every detector: a recipe is calibrated into a monitor, and a monitor watches records or streams.

A `Detector` is a frozen recipe. `calibrate` makes a frozen `Monitor` of healthy records. `watch` gives everything that
a monitor says of a whole record, a `Watch`; `stream` says it as the samples come in. What is said at a time stands on
nothing after it: cut a record, and the alarms up to the cut stay as they were.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Protocol, TypeGuard, runtime_checkable

import numpy as np

from gtmbench.detectors.alarm import ALARM_COLUMNS, Alarm, rows_of_alarms
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.gate import watch_inside
from gtmbench.jobs.progress import Progress, silent
from gtmbench.values.notebook import card
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import BoolArray, FloatArray, Record

Signals = Mapping[str, FloatArray]  # by sensor, shape (samples,)
_NONE: Mapping[str, Any] = MappingProxyType({})


@runtime_checkable
class Stream(Protocol):
    """A monitor that watches samples as they arrive; memory and time per sample don't grow.

    Examples
    --------
    >>> import gtmbench as gb
    >>> def limit(record):
    ...     return record.time_s[record["p"] > 4.0][:1]  # when p is first above 4 deg/s
    >>> stream = gb.FunctionDetector(limit, channels=("p",)).calibrate().stream()
    >>> flight = gb.Record([1.0, 2.0, 5.0, 6.0], channels=["p"], sample_period_s=1.0)
    >>> [alarm.time_s for half in (flight.between(0, 1), flight.between(2, 3)) for alarm in stream.push(half)]
    [2.0]
    """

    @property
    def armed(self) -> Mapping[str, bool]:
        """Whether each test statistic could alarm with the next sample; a missing one has been disarmed."""

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far, with its judgements up to now."""

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk raises, and again those with new judgements, under the same number.

        Raises
        ------
        InputError
            If the chunk doesn't continue the one before, lacks a channel or has another sample period.
        """


@runtime_checkable
class Monitor(Protocol):
    """A calibrated detector: frozen, picklable, with the same judgements in any process.

    Attributes
    ----------
    name : str
        The detector's.
    channels : tuple of str
        The channels that a record must hold.
    suspects : tuple of str
        The sensors that it may name; empty for a monitor without isolation. For missing samples it may name any
        channel.
    sample_period_s : float or None
        The sample period of the calibration; None if any is allowed.
    look_ahead_s : float
        The latency of its last test statistic: an alarm concerns samples that are at least so much older.
    memory_s : float
        How far an alarm looks back before its time, in seconds; infinite if that isn't bounded.
    provenance : mapping
        Its origin, as plain values.

    Notes
    -----
    Optional members: a method `trials(record)`, if it is faster than watching (`gtmbench.detectors.tried_faults`), and
    a `basis`, if it assumes more than its channels (`gtmbench.detectors.assumptions`).

    Examples
    --------
    >>> import gtmbench as gb
    >>> monitor = gb.FunctionDetector(lambda record: [], name="never").calibrate()
    >>> isinstance(monitor, gb.Monitor), monitor.name, monitor.suspects
    (True, 'never', ())
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def channels(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def suspects(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def sample_period_s(self) -> float | None: ...  # noqa: D102
    @property
    def look_ahead_s(self) -> float: ...  # noqa: D102
    @property
    def memory_s(self) -> float: ...  # noqa: D102
    @property
    def provenance(self) -> Mapping[str, object]: ...  # noqa: D102

    def watch(self, record: Record) -> Watch:
        """Return the result on a record."""

    def stream(self) -> Stream:
        """Return a fresh stream."""

    def figures(self) -> dict[str, object]:
        """Return the calibration's results as plain JSON values, for `Detector.restore`."""


@runtime_checkable
class Detector(Protocol):
    """A frozen recipe.

    Attributes
    ----------
    name : str
    channels : tuple of str
        The channels that a record must hold; surface commands are included only if they are named here.
    tied_to_excitation : bool
        Whether it learns the excitation of its records, as an operator from gyros to gyros does. A study then
        calibrates it on two healthy records of its own flight (other noise), not on flights with rich excitation.
        Optional.
    basis : Basis
        Its assumptions beyond its channels (`gtmbench.detectors.assumptions`). Optional.

    Examples
    --------
    >>> import gtmbench as gb
    >>> isinstance(gb.DissertationOperator(), gb.Detector), isinstance(gb.FunctionDetector(len), gb.Detector)
    (True, True)
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def channels(self) -> tuple[str, ...]: ...  # noqa: D102

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> Monitor:
        """Return a monitor.

        Parameters
        ----------
        records : sequence of Record
            Healthy records of one sample period.
        false_alarms_per_hour : float, optional
            The false alarm rate to calibrate for; None: the recipe's own factor or rate.
        progress : callable
            Called with the step, the number done and the total.

        Raises
        ------
        InputError
            If the recipe can't promise a rate, or the records don't allow it.
        """

    def restore(self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = _NONE) -> Monitor:
        """Return the monitor of these `figures`, bit for bit. Every key is checked, because they come from a file."""


def is_recipe(given: Detector | Monitor) -> TypeGuard[Detector]:
    """Whether something is yet to calibrate."""
    return hasattr(given, "calibrate")


def is_ready(given: Detector | Monitor) -> TypeGuard[Monitor]:
    """Whether something watches as it is."""
    return not hasattr(given, "calibrate")


def suspects_of(given: Detector | Monitor) -> tuple[str, ...]:
    """Return the sensors that it may name; none before it is calibrated."""
    return given.suspects if is_ready(given) else ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Score:
    """A test statistic over time, and its threshold.

    Attributes
    ----------
    name : str
        The name in `Alarm.source`.
    values : shape (samples,)
        One value per row of the record; NaN where it doesn't exist.
    known_s : shape (samples,)
        When each value is known, in seconds.
    threshold : float
        An alarm is raised above it.
    unit : str
    channels : tuple of str
        The sensors whose faults enter it.
    armed : shape (samples,)
        Where an alarm was possible: the value exists, an earlier or this value was known at or below the threshold
        since watching began (or began anew), and no judgement had disarmed it. A statistic above its threshold from the
        start gives no alarm but "can't tell".
    disarmed_s : float or None
        The time from which a judgement keeps it disarmed to the record's end.
    tests : mapping of test to float
        The thresholds of the tests whose greatest ratio it is; empty if it is a single test.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> level = gb.Score(
    ...     name="p", values=np.array([0.5, 0.8, 2.0]), known_s=np.array([0.0, 1.0, 2.0]), armed=np.ones(3, dtype=bool)
    ... )
    >>> level.threshold, level.armed_s, level.peak(), level.peak(from_s=5.0)
    (1.0, 0.0, 2.0, 0.0)
    """

    name: str
    values: FloatArray = field(repr=False)
    known_s: FloatArray = field(repr=False)
    threshold: float = 1.0
    unit: str = ""
    channels: tuple[str, ...] = ()
    armed: BoolArray = field(repr=False)
    disarmed_s: float | None = None
    tests: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}), repr=False)

    @property
    def exists(self) -> BoolArray:
        """Where it has a value, shape (samples,)."""
        return np.isfinite(self.values)

    @property
    def armed_s(self) -> float | None:
        """When it could first alarm; None if never."""
        return float(self.known_s[np.argmax(self.armed)]) if self.armed.any() else None

    @property
    def is_stuck_above(self) -> bool:
        """Whether it exists and never came down to its threshold, so it is no evidence."""
        return bool(self.exists.any()) and not self.armed.any() and self.disarmed_s is None

    def peak(self, from_s: float = -np.inf) -> float:
        """Return the greatest value known at or after a time, over the threshold; 0 where there is none."""
        known = self.exists & (self.known_s >= from_s - 1e-9)
        return float(self.values[known].max() / self.threshold) if known.any() else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Watch:
    """The result of a monitor on a record.

    Attributes
    ----------
    monitor : Monitor
    record : Record
    scores : mapping of name to Score
        The test statistics; empty for a detector that shows none.
    alarms : tuple of Alarm
        In order of time, with all judgements up to the record's end.
    residuals, predictions : mapping of sensor to array of shape (samples,)
        One-step residuals and predicted readings, in the sensor's unit. Empty without any.
    widening : mapping of sensor to array of shape (samples,)
        Factor on the normal size of a residual for motion beyond that of identification; 1 means none. Empty if the
        monitor has no such factor.
    noise_levels : mapping of score to float
        For statistics whose noise is learnt on the record: its deviation at the beginning over that of the calibration.
    outside : tuple of Excursion
        The stretches in which residuals are no evidence.
    out_of_range : tuple of OutOfRange
        The readings that no sensor reads, which were taken as missing.

    Examples
    --------
    >>> import gtmbench as gb
    >>> def limit(record):
    ...     return record.time_s[record["p"] > 4.0][:1]  # when p is first above 4 deg/s
    >>> record = gb.Record([1.0, 2.0, 5.0, 6.0], channels=["p"], sample_period_s=1.0)
    >>> said = gb.FunctionDetector(limit).calibrate().watch(record)
    >>> said.alarm_s, [alarm.source for alarm in said.faults]
    (2.0, ['limit'])
    """

    monitor: Monitor
    record: Record = field(repr=False)
    scores: Mapping[str, Score] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    alarms: tuple[Alarm, ...]
    residuals: Signals = field(default_factory=lambda: MappingProxyType({}), repr=False)
    predictions: Signals = field(default_factory=lambda: MappingProxyType({}), repr=False)
    widening: Signals = field(default_factory=lambda: MappingProxyType({}), repr=False)
    noise_levels: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    outside: tuple[Excursion, ...] = field(default=(), repr=False)
    out_of_range: tuple[OutOfRange, ...] = ()

    def _repr_html_(self) -> str:
        record, faults = self.record, self.faults
        facts = {
            "record": f"{record.start_s:g} to {record.end_s:g} s, {len(record)} samples",
            "watched": f"{3600.0 * self.armed_hours:.1f} s",
            "alarms": f"{len(self.alarms)}" + (f", of {len(faults)} faults" if len(faults) < len(self.alarms) else ""),
        }
        return card(f"Watch by {self.monitor.name}", facts, columns=ALARM_COLUMNS, rows=rows_of_alarms(faults))

    @property
    def faults(self) -> tuple[Alarm, ...]:
        """The first alarm of each fault, in order of time."""
        return tuple(alarm for alarm in self.alarms if alarm.is_first)

    @property
    def alarm_s(self) -> float | None:
        """When the first alarm could be raised."""
        return self.alarms[0].time_s if self.alarms else None

    @property
    def armed(self) -> BoolArray:
        """Where any test statistic could alarm, shape (samples,); everywhere for a detector that shows none."""
        if not self.scores:
            return np.ones(len(self.record), dtype=bool)
        return np.asarray(np.logical_or.reduce([score.armed for score in self.scores.values()]))

    @property
    def armed_hours(self) -> float:
        """Hours in which any test statistic could alarm."""
        return float(np.count_nonzero(self.armed)) * self.record.sample_period_s / 3600.0

    @property
    def disarmed(self) -> dict[str, float]:
        """Test statistics that a judgement disarms to the record's end, with the time in seconds from which it does."""
        return {name: score.disarmed_s for name, score in self.scores.items() if score.disarmed_s is not None}

    def virtual(self, sensor: str) -> FloatArray:
        """Return a sensor's predicted reading (virtual sensor), shape (samples,), NaN where it isn't known.

        For a sensor with a residual it is the prediction. For an attitude angle it is integrated from the gyros from
        the onset of its fault (or the first row), and drifts with them.
        """
        from gtmbench.detectors.virtual import integrable, integrated_angle

        if sensor in self.predictions:
            return self.predictions[sensor]
        if not integrable(sensor, self.monitor.channels):
            return np.full(len(self.record), np.nan)
        onset_s = min((alarm.onset_s for alarm in self.alarms if alarm.sensor == sensor), default=self.record.start_s)
        row = round((onset_s - self.record.start_s) / self.record.sample_period_s)
        return integrated_angle(self.record, sensor, row)


def watch(monitor: Monitor, record: Record) -> Watch:
    """Watch a record with a monitor, as its own `watch` does.

    Parameters
    ----------
    monitor : Monitor
    record : Record
        With the monitor's channels.

    Raises
    ------
    InputError
        If the record lacks a channel of the monitor or has another sample period.

    Examples
    --------
    >>> import gtmbench as gb
    >>> def limit(record):
    ...     return record.time_s[record["p"] > 4.0][:1]  # when p is first above 4 deg/s
    >>> record = gb.Record([1.0, 2.0, 5.0, 6.0], channels=["p"], sample_period_s=1.0)
    >>> gb.watch(gb.FunctionDetector(limit).calibrate(), record).alarm_s
    2.0
    """
    return watch_inside(monitor.watch, record)


def with_provenance(monitor: Monitor, origin: Mapping[str, Any]) -> Monitor:
    """Say with a monitor on what it was calibrated, where it keeps such a thing."""
    try:
        return replace(monitor, provenance=dict(origin) | dict(monitor.provenance))  # type: ignore[type-var]
    except (TypeError, ValueError):  # somebody's own class, without such a field, or one that it fills itself
        return monitor
