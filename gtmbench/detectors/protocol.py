"""One way for every detector: a recipe is calibrated into a monitor, and a monitor watches records or streams.

A `Detector` is a frozen recipe. `calibrate` makes a frozen `Monitor` of healthy records. `watch` gives everything that
a monitor says of a whole record, a `Watch`; `stream` says it as the samples come in. What is said at a time stands on
nothing after it: cut a record, and the alarms up to the cut stay as they were.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol, TypeGuard, runtime_checkable

import numpy as np

from gtmbench.detectors.alarm import SAID, Alarm, said_of
from gtmbench.detectors.excursion import Excursion
from gtmbench.notebook import card
from gtmbench.progress import Progress, silent
from gtmbench.record import BoolArray, FloatArray, Record

Signals = Mapping[str, FloatArray]  # by sensor, shape (samples,)
_NONE: Mapping[str, Any] = MappingProxyType({})


@runtime_checkable
class Stream(Protocol):
    """A monitor at work on samples as they come in; memory and time a sample don't grow.

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
        """Whether each score could raise an alarm with the next sample; one that is missing has been disarmed."""

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far, as it is known by now."""

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise or tell more of: the same alarm, by its number, again.

        Raises
        ------
        InputError
            If the chunk doesn't continue the one before, lacks a channel or has another sample period.
        """


@runtime_checkable
class Monitor(Protocol):
    """A detector, calibrated: frozen, picklable, the same judgements in any process.

    Attributes
    ----------
    name : str
        The detector's.
    channels : tuple of str
        What a record must hold.
    suspects : tuple of str
        The sensors that it may name; empty where it names none. Of samples that are missing it may name any channel's.
    sample_period_s : float or None
        That it was calibrated at; None where any is well.
    look_ahead_s : float
        How long after a sample its last score is known: an alarm at a time tells of samples that much older, or more.
    memory_s : float
        How far before its time an alarm looks back; infinite where that isn't bounded.
    provenance : mapping
        Where it comes from, as plain values.

    Notes
    -----
    A method `trials(record)` may be there, too, where it is quicker than watching (`gtmbench.detectors.trials`); and a
    `basis`, where it rests on more than its channels (`gtmbench.detectors.basis`).

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
    def provenance(self) -> Mapping[str, Any]: ...  # noqa: D102

    def watch(self, record: Record) -> Watch:
        """Return everything that it says of a record."""

    def stream(self) -> Stream:
        """Return a fresh stream."""

    def figures(self) -> dict[str, Any]:
        """Return what calibration found as plain JSON values, for `Detector.restore`."""


@runtime_checkable
class Detector(Protocol):
    """A frozen recipe.

    Attributes
    ----------
    name : str
    channels : tuple of str
        What a record must hold; surface commands are there only if they are named here.
    tied_to_excitation : bool
        Whether it learns what excites its records, as an operator from gyros to gyros does: a study then calibrates it
        on two healthy records of its own flight (other noise), not on flights that shake everything. May be left out.
    basis : Basis
        What else it rests on (`gtmbench.detectors.basis`). May be left out.

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
            Healthy, of one sample period.
        false_alarms_per_hour : float, optional
            Wanted of the monitor; None: the recipe's own factor or rate.
        progress : callable
            Called with the step, the number done and the total.

        Raises
        ------
        InputError
            If a rate is asked for that the recipe can't promise, or the records don't allow it.
        """

    def restore(self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = _NONE) -> Monitor:
        """Return the monitor whose `figures` these are, bit for bit; every key checked, for they come from a file."""


def is_recipe(given: Detector | Monitor) -> TypeGuard[Detector]:
    """Whether something is yet to calibrate."""
    return hasattr(given, "calibrate")


def is_ready(given: Detector | Monitor) -> TypeGuard[Monitor]:
    """Whether something watches as it is."""
    return not hasattr(given, "calibrate")


@dataclass(frozen=True, kw_only=True, eq=False)
class Score:
    """A statistic over time that is held against a threshold.

    Attributes
    ----------
    name : str
        As in `Alarm.source`.
    values : shape (samples,)
        Row for row beside the record; NaN where it doesn't exist.
    known_s : shape (samples,)
        When each value is known, in seconds.
    threshold : float
        An alarm above it.
    unit : str
    channels : tuple of str
        The sensors whose fault enters it.
    armed : shape (samples,)
        Where an alarm was possible: the value exists, it or one before had been known at or below the threshold since
        watching began (anew), and no judgement had disarmed it. A score above its threshold from the start is no
        alarm: there it can't tell.
    disarmed_s : float or None
        Since when a judgement keeps it from alarming, to the record's end.
    tests : mapping of test to float
        The thresholds of the test statistics of which it is the greatest; empty where it is one.

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
        """Whether it exists and never came down to its threshold: it can't tell anything."""
        return bool(self.exists.any()) and not self.armed.any() and self.disarmed_s is None

    def peak(self, from_s: float = -np.inf) -> float:
        """Return the greatest value known at or after a time, over the threshold; 0 where there is none."""
        known = self.exists & (self.known_s >= from_s - 1e-9)
        return float(self.values[known].max() / self.threshold) if known.any() else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Watch:
    """Everything that a monitor said of a record.

    Attributes
    ----------
    monitor : Monitor
    record : Record
    scores : mapping of name to Score
        Empty for a detector that shows none.
    alarms : tuple of Alarm
        In time, each as it is known at the record's end.
    residuals, predictions : mapping of sensor to array of shape (samples,)
        In the sensor's unit; predictions are what it should have read. Empty where there are none.
    widening : mapping of sensor to array of shape (samples,)
        By which what is normal of a residual is widened, where the motion is beyond what identification held; 1 where
        nothing is. Empty where that doesn't arise.
    noise_levels : mapping of score to float
        Of those whose noise is learnt on the record: its deviation at the beginning over that of the calibration.
    outside : tuple of Excursion
        The stretches in which residuals say nothing.

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

    def _repr_html_(self) -> str:
        record, faults = self.record, self.faults
        facts = {
            "record": f"{record.start_s:g} to {record.end_s:g} s, {len(record)} samples",
            "watched": f"{3600.0 * self.armed_hours:.1f} s",
            "alarms": f"{len(self.alarms)}" + (f", of {len(faults)} faults" if len(faults) < len(self.alarms) else ""),
        }
        return card(f"Watch by {self.monitor.name}", facts, columns=SAID, rows=said_of(faults))

    @property
    def faults(self) -> tuple[Alarm, ...]:
        """The alarms that first told of a fault, in time; those that count to the fault of another are left out."""
        return tuple(alarm for alarm in self.alarms if alarm.is_first)

    @property
    def alarm_s(self) -> float | None:
        """When the first alarm could be raised."""
        return self.alarms[0].time_s if self.alarms else None

    @property
    def armed(self) -> BoolArray:
        """Where an alarm was possible, of any score, shape (samples,); everywhere for a detector that shows none."""
        if not self.scores:
            return np.ones(len(self.record), dtype=bool)
        return np.asarray(np.logical_or.reduce([score.armed for score in self.scores.values()]))

    @property
    def armed_hours(self) -> float:
        """Hours watched: how long an alarm was possible, of any score."""
        return float(np.count_nonzero(self.armed)) * self.record.sample_period_s / 3600.0

    @property
    def disarmed(self) -> dict[str, float]:
        """Scores that a judgement keeps from alarming to the record's end, and since when, in seconds."""
        return {name: score.disarmed_s for name, score in self.scores.items() if score.disarmed_s is not None}

    def virtual(self, sensor: str) -> FloatArray:
        """Return what a sensor should have read, shape (samples,), NaN where that isn't known.

        A predicted sensor's is its prediction. An attitude angle's is carried on by the gyros from the onset of its
        fault (the first row, without one), and drifts with them.
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
    return monitor.watch(record)
