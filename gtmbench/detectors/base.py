"""Bases for detectors of one's own: what a Monitor may leave out, a detector of two functions, a plain function."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import number, shown
from gtmbench.detectors.alarm import Alarm, alarms_at
from gtmbench.detectors.buffered_stream import BufferedStream, RollingBuffer, ScoreArming
from gtmbench.detectors.gate import gated
from gtmbench.detectors.protocol import Score, Stream, Watch
from gtmbench.detectors.tables import PERIODS_S, keys, table_of
from gtmbench.errors import InputError
from gtmbench.files.plain import exact
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.problem import taught_records
from gtmbench.method.residual import came_down, rising
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import Record


class BaseMonitor:
    """Defaults for a Monitor of your own; a subclass must define `name`, `channels` and `watch`.

    Attributes
    ----------
    suspects, sample_period_s, look_ahead_s, memory_s, provenance
        As in `Monitor`. The defaults are no suspects, any period, no look-ahead, unlimited memory, no provenance.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import gtmbench as gb
    >>> @dataclass(frozen=True)
    ... class Silent(gb.BaseMonitor):
    ...     name: str = "silent"
    ...     channels: tuple = ("p",)
    ...
    ...     def watch(self, record):
    ...         return gb.Watch(monitor=self, record=record, alarms=())
    >>> record = gb.Record([0.0, 1.0], channels=["p"], sample_period_s=0.01)
    >>> Silent().watch(record).alarms, Silent().stream().push(record)
    ((), ())
    """

    name: str
    channels: tuple[str, ...]
    suspects: tuple[str, ...] = ()
    sample_period_s: float | None = None
    look_ahead_s: float = 0.0
    memory_s: float = math.inf
    provenance: Mapping[str, object] = MappingProxyType({})

    def watch(self, record: Record) -> Watch:
        """Return the result on a record."""
        raise NotImplementedError

    def stream(self) -> Stream:
        """Return a stream that watches a rolling buffer of `memory_s`."""
        return BufferedStream(self)

    def figures(self) -> dict[str, object]:
        """Refuse to be saved. A monitor that can be saved returns its figures for its detector's `restore`."""
        raise InputError(f"'{self.name}' gives no figures, so it can't be saved; write figures(), and restore() beside")


class SimpleDetector:
    """A detector of two functions: one learns from healthy records, one returns test statistics with threshold 1.

    A subclass defines `name`, `channels`, `learn` and `scores`. Alarms by the common arming rule, streams and files
    follow. Its parameters may be fields of a frozen dataclass; a monitor's file keeps them.

    Attributes
    ----------
    name : str
    channels : tuple of str
        The only channels that it gets.
    look_ahead_s : float
        The latency of its test statistics, in seconds after a sample.
    memory_s : float
        How far a statistic looks back before its time, that is the sample's time plus `look_ahead_s`. By default a
        stream keeps everything.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> class Limit(gb.SimpleDetector):
    ...     name, channels, memory_s = "limit", ("p",), 0.0
    ...     def learn(self, records):
    ...         return {"p": max(np.abs(record["p"]).max() for record in records)}
    ...     def scores(self, record, learned):
    ...         return {"p": np.abs(record["p"]) / learned["p"]}
    >>> healthy = gb.Record([1.0, -2.0, 0.5], channels=["p"], sample_period_s=0.1)
    >>> monitor = Limit().calibrate([healthy])
    >>> monitor.watch(gb.Record([0.0, -2.0, 2.5], channels=["p"], sample_period_s=0.1)).alarm_s
    0.2
    """

    name: str
    channels: tuple[str, ...]
    look_ahead_s: float = 0.0
    memory_s: float = math.inf

    def learn(self, records: Sequence[Record]) -> Mapping[str, Any]:
        """Return what is learnt from healthy records, as numbers, texts, lists, arrays and tables of these."""
        raise NotImplementedError

    def scores(self, record: Record, learned: Mapping[str, Any]) -> Mapping[str, ArrayLike]:
        """Return test statistics by name, one value a sample, NaN where there is none. Above 1 is an alarm.

        Arrays of `learned` are passed as lists. A value may use samples up to `look_ahead_s` later, and none after
        that.
        """
        raise NotImplementedError

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> SimpleMonitor:
        """Return a monitor from the result of `learn`; it promises no false alarm rate."""
        if false_alarms_per_hour is not None:
            raise InputError(
                f"'{self.name}' can't promise {false_alarms_per_hour:g} false alarms an hour; leave the rate out"
            )
        healthy = [record.select(self.channels) for record in taught_records(records)]
        progress("learn", 0, 1)
        learned = exact(dict(self.learn(healthy)))
        return SimpleMonitor(detector=self, learned=learned, sample_period_s=healthy[0].sample_period_s)

    def restore(
        self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})
    ) -> SimpleMonitor:
        """Return the monitor of some figures, with the parameters of its calibration."""
        figures = keys("figures", figures, ("sample_period_s", "recipe", "learned"))
        recipe = keys("recipe", figures["recipe"], tuple(self._recipe()))
        return SimpleMonitor(
            detector=self._with({key: _tuples(value) for key, value in recipe.items()}),
            learned=table_of("learned", figures["learned"]),
            sample_period_s=number("sample_period_s", figures["sample_period_s"], *PERIODS_S),
            provenance=dict(provenance),
        )

    def _ratios(self, record: Record, learned: Mapping[str, Any]) -> Mapping[str, ArrayLike]:
        """Return the test statistics with threshold 1; a subclass whose `scores` have others divides by them here."""
        return self.scores(record, learned)

    def _recipe(self) -> dict[str, Any]:
        return {each.name: exact(getattr(self, each.name)) for each in fields(self)} if is_dataclass(self) else {}

    def _with(self, recipe: Mapping[str, Any]) -> Self:
        return replace(self, **recipe) if is_dataclass(self) else self


@dataclass(frozen=True, kw_only=True, eq=False)
class SimpleMonitor:
    """A `SimpleDetector` and what it learned."""

    detector: SimpleDetector
    learned: dict[str, Any] = field(repr=False)  # as plain values
    sample_period_s: float
    provenance: Mapping[str, object] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The detector's."""
        return self.detector.name

    @property
    def channels(self) -> tuple[str, ...]:
        """The detector's."""
        return self.detector.channels

    @property
    def suspects(self) -> tuple[str, ...]:
        """None: it names no sensor."""
        return ()

    @property
    def look_ahead_s(self) -> float:
        """The detector's."""
        return self.detector.look_ahead_s

    @property
    def memory_s(self) -> float:
        """The detector's."""
        return self.detector.memory_s

    @property
    def behind(self) -> int:
        """How many samples after its own a score is known."""
        return math.ceil(self.look_ahead_s / self.sample_period_s - 1e-6)

    @gated
    def watch(self, record: Record) -> Watch:
        """Return scores and alarms: a score that rises above 1, having been known at or below it.

        InputError if the record lacks a channel or has another sample period.
        """
        known_s = np.round(record.time_s + self.look_ahead_s, 9)
        scores = {
            name: Score(name=name, values=values, known_s=known_s, armed=came_down(values, 1.0))
            for name, values in self.scores(record.select(self.channels)).items()
        }
        rows = sorted((row, name) for name, score in scores.items() for row in rising(score.values, 1.0).tolist())
        alarms = alarms_at((float(known_s[row]), name) for row, name in rows)
        return Watch(monitor=self, record=record, scores=MappingProxyType(scores), alarms=alarms)

    def scores(self, record: Record) -> dict[str, FloatArray]:
        """Return the scores of a record, NaN where they aren't known by its end."""
        record.check_period(self.sample_period_s, f"'{self.name}' was calibrated at")
        scores = {}
        for name, given in self.detector._ratios(record, self.learned).items():
            values = np.array(given, dtype=np.float64)
            if values.shape != (len(record),):
                raise InputError(
                    f"'{self.name}' scored '{name}' in shape {values.shape}, and the record has {len(record)} samples; "
                    "return one value a sample"
                )
            values[max(len(record) - self.behind, 0) :] = np.nan
            values.setflags(write=False)
            scores[name] = values
        return scores

    def stream(self) -> SimpleStream:
        """Return a fresh stream."""
        return SimpleStream(self)

    def figures(self) -> dict[str, object]:
        """Return sample period, the recipe's parameters and what was learned."""
        recipe = self.detector._recipe()
        return {"sample_period_s": self.sample_period_s, "recipe": recipe, "learned": self.learned}


class SimpleStream:
    """A `SimpleMonitor` at work: scores of a rolling buffer, held against 1; whether they are armed is carried on."""

    def __init__(self, monitor: SimpleMonitor) -> None:
        self._monitor = monitor
        self._buffer = RollingBuffer(monitor.channels, max(monitor.memory_s, monitor.look_ahead_s))
        self._arming: dict[str, ScoreArming] = {}
        self._alarms: tuple[Alarm, ...] = ()

    @property
    def armed(self) -> Mapping[str, bool]:
        """Whether each score has been known at or below 1."""
        return MappingProxyType({name: arming.is_armed for name, arming in self._arming.items()})

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far."""
        return self._alarms

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise.

        InputError if the chunk doesn't continue the one before, lacks a channel or has another sample period.
        """
        clock, record = self._buffer.joined(chunk)
        if not len(chunk):
            return ()
        known = clock.known(len(chunk), self._monitor.behind)
        row_0 = clock.count - len(record)  # which sample of the stream that is
        known_s = np.round(clock.times_s(known) + self._monitor.look_ahead_s, 9)
        rows = []
        for name, values in self._monitor.scores(record).items():
            arming = self._arming.setdefault(name, ScoreArming())
            rows += [(row, name) for row in arming.push(values[known.start - row_0 : known.stop - row_0])[1]]
        alarms = alarms_at(((float(known_s[row]), name) for row, name in sorted(rows)), first=len(self._alarms))
        self._alarms += alarms
        self._buffer.keep(clock, record)
        return alarms


def _tuples(value: Any) -> Any:
    """Return lists as tuples: JSON has no other sequence, and a frozen recipe holds none but tuples."""
    return tuple(_tuples(entry) for entry in value) if isinstance(value, list) else value


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
