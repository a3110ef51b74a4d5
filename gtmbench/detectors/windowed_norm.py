"""The dissertation's detector: an operator between sensors, the norm E(k) of its residual, and a threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from gtmbench.checks import number, text, whole
from gtmbench.detectors.alarm import Alarm, alarms_at
from gtmbench.detectors.gate import gated, taken_inside
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.detectors.tables import OPERATOR_KEYS, PERIODS_S, keys, names_of, operator_of, operator_table
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.identify import identify
from gtmbench.method.residual import came_down, residual, rising, threshold, windowed_norm
from gtmbench.method.residual_stream import AlarmStream, NormStream, ResidualStream
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.channels import unit_of
from gtmbench.values.notebook import card, figure
from gtmbench.values.record import Record, Span

SCORE = "E(k)"
_GROSS = 1e4  # in the outputs' unit: a residual that no detector may overlook


@dataclass(frozen=True, kw_only=True)
class DissertationOperator:
    """The detector of section 4.4: identify on one healthy record, take the threshold from another, watch E(k).

    Parameters
    ----------
    inputs, outputs : tuple of str
        Pseudo inputs and pseudo outputs.
    causal_order, noncausal_order : int
        r and d.
    window : int
        w: E(k) sums w + 1 squares.
    threshold_factor : float
        The threshold over the greatest E(k) of the healthy record.
    identify_s, threshold_s : (start, end), optional
        The parts of the two records that are used (k Ts of windows, for the threshold), by default all.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u = rng.standard_normal(2000)
    >>> def sensed():
    ...     values = np.column_stack([u, 2.0 * u]) + 0.01 * rng.standard_normal((2000, 2))
    ...     return gb.Record(values, channels=["p", "r"], sample_period_s=0.01)
    >>> recipe = gb.DissertationOperator(inputs=("p",), causal_order=2, noncausal_order=2, window=100)
    >>> monitor = recipe.calibrate([sensed(), sensed()])
    >>> broken = gb.inject(sensed(), gb.Bias(channel="r", onset_s=10.0, size=0.5))
    >>> 10.0 < monitor.watch(broken).alarm_s < 10.1
    True
    """

    inputs: tuple[str, ...] = ("p", "q", "beta")
    outputs: tuple[str, ...] = ("r",)
    causal_order: int = 50
    noncausal_order: int = 50
    window: int = 1000
    threshold_factor: float = 1.5
    identify_s: Span | None = None
    threshold_s: Span | None = None
    name: str = "dissertation"
    tied_to_excitation: bool = True

    @property
    def channels(self) -> tuple[str, ...]:
        """Pseudo outputs and inputs."""
        return (*self.outputs, *self.inputs)

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> NormMonitor:
        """Identify on the first record, take the threshold from the others.

        Parameters
        ----------
        records : sequence of Record
            Two or more healthy records of the excitation to be watched, each with its own noise.
        false_alarms_per_hour : None
            It has a factor and promises no rate.
        progress : callable
            Called with the step, the number done and the total.

        Raises
        ------
        InputError
            If a rate is asked for, or less than two records are given.
        """
        if false_alarms_per_hour is not None:
            raise InputError(
                f"'{self.name}' can't promise {false_alarms_per_hour:g} false alarms an hour: its threshold is "
                f"{self.threshold_factor:g} times the greatest E(k) of a healthy record; leave the rate out, or take a "
                "bank"
            )
        if len(records) < 2:
            raise InputError(
                f"'{self.name}' is identified on one healthy record and takes its threshold from another; "
                f"{len(records)} given"
            )
        first, *others = records
        progress("identify", 0, 2)
        operator = identify(
            first if self.identify_s is None else first.between(*self.identify_s),
            inputs=self.inputs,
            outputs=self.outputs,
            causal_order=self.causal_order,
            noncausal_order=self.noncausal_order,
        )
        progress("threshold", 1, 2)
        span = self.threshold_s or (-np.inf, np.inf)
        norms = [windowed_norm(residual(operator, record), window=self.window) for record in others]
        limit = max(threshold(norm, start_s=span[0], end_s=span[1], factor=self.threshold_factor) for norm in norms)
        return NormMonitor(name=self.name, operator=operator, window=self.window, threshold=limit)

    def restore(self, figures: Mapping[str, Any], provenance: Mapping[str, Any] = MappingProxyType({})) -> NormMonitor:
        """Return the monitor of some figures; they have to be of these sensors, orders and window."""
        monitor = restore_norm(figures, provenance)
        operator = monitor.operator
        given = (operator.inputs, operator.outputs, operator.causal_order, operator.noncausal_order, monitor.window)
        if given != (self.inputs, self.outputs, self.causal_order, self.noncausal_order, self.window):
            raise InputError(
                f"the figures are of {operator.name} with r = {operator.causal_order}, d = {operator.noncausal_order}, "
                f"w = {monitor.window}; the recipe says [{' '.join(self.inputs)}] -> {' '.join(self.outputs)} with "
                f"r = {self.causal_order}, d = {self.noncausal_order}, w = {self.window}; give the monitor's file "
                "alone, or calibrate anew"
            )
        return monitor


@dataclass(frozen=True, kw_only=True, eq=False)
class NormMonitor:
    """An identified operator, the window of its norm and a threshold.

    Attributes
    ----------
    operator : Transmissibility
    window : int
        w of (4.12), in samples.
    threshold : float
        Threshold of E(k), in the outputs' unit.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u = rng.standard_normal(2000)
    >>> def sensed():
    ...     values = np.column_stack([u, 2.0 * u]) + 0.01 * rng.standard_normal((2000, 2))
    ...     return gb.Record(values, channels=["p", "r"], sample_period_s=0.01)
    >>> recipe = gb.DissertationOperator(inputs=("p",), causal_order=2, noncausal_order=2, window=100)
    >>> monitor = recipe.calibrate([sensed(), sensed()])
    >>> monitor.operator.name, monitor.look_ahead_s, monitor.window_s
    ('[p] -> r', 0.02, 1.01)
    >>> monitor.watch(sensed()).alarms
    ()
    """

    name: str
    operator: Transmissibility
    window: int
    threshold: float
    provenance: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        number("threshold", self.threshold, 0.0, above=True)

    def _repr_html_(self) -> str:
        facts = {
            "operator": self.operator.name,
            "threshold": f"{figure(self.threshold)} {unit_of(self.operator.outputs[0])}".rstrip(),
            "window": f"{self.window_s:g} s, look-ahead {self.look_ahead_s:g} s",
        }
        return card(f"Monitor: {self.name}, {SCORE}", facts)

    @property
    def channels(self) -> tuple[str, ...]:
        """Pseudo outputs and inputs."""
        return (*self.operator.outputs, *self.operator.inputs)

    @property
    def suspects(self) -> tuple[str, ...]:
        """Empty, because the residual shows that a sensor broke, not which."""
        return ()

    @property
    def sample_period_s(self) -> float:
        """The operator's."""
        return self.operator.sample_period_s

    @property
    def look_ahead_s(self) -> float:
        """The latency of its residual: d Ts, in seconds."""
        return round(self.operator.look_ahead_s, 9)

    @property
    def window_s(self) -> float:
        """(w + 1) Ts. With the look-ahead it bounds the latency of a window that lies wholly after an onset."""
        return round((self.window + 1) * self.sample_period_s, 9)

    @property
    def memory_s(self) -> float:
        """(r + d + w + 2) Ts: the samples of this window and of the one before."""
        lags = self.operator.causal_order + self.operator.noncausal_order
        return round((lags + self.window + 2) * self.sample_period_s, 9)

    def stream(self) -> NormAlarmStream:
        """Return a fresh stream: residual, E(k) and alarms sample by sample, in bounded memory."""
        return NormAlarmStream(self)

    def figures(self) -> dict[str, object]:
        """Return operator, window and threshold as plain JSON values."""
        return {
            "sample_period_s": self.sample_period_s,
            "name": self.name,
            "window": self.window,
            "threshold": self.threshold,
            "operator": operator_table(self.operator),
        }

    @gated
    def watch(self, record: Record) -> Watch:
        """Return residual, E(k) and alarms. An alarm is E(k) rising above the threshold, dated (k + w + d) Ts.

        Raises
        ------
        InputError
            If the record lacks a channel or has another sample period.
        """
        errors = residual(self.operator, record)
        norm = windowed_norm(errors, window=self.window)
        known_s = np.round(norm.known_s, 9)
        score = Score(
            name=SCORE,
            values=norm.values,
            known_s=known_s,
            threshold=self.threshold,
            unit=unit_of(self.operator.outputs[0]),
            channels=self.channels,
            armed=came_down(norm.values, self.threshold),
        )
        columns = dict(zip(self.operator.outputs, errors.values.T, strict=True))
        return Watch(
            monitor=self,
            record=record,
            scores=MappingProxyType({SCORE: score}),
            alarms=alarms_at((time_s, SCORE) for time_s in known_s[rising(norm.values, self.threshold)].tolist()),
            residuals=MappingProxyType(columns),
            predictions=MappingProxyType({name: record[name] - values for name, values in columns.items()}),
        )


class NormAlarmStream:
    """A `NormMonitor` at work on samples as they come in."""

    def __init__(self, monitor: NormMonitor) -> None:
        self._residual = ResidualStream(monitor.operator)
        self._norm = NormStream(window=monitor.window)
        self._crossings = AlarmStream(monitor.threshold)
        self._is_armed = False
        self._alarms: tuple[Alarm, ...] = ()

    @property
    def armed(self) -> Mapping[str, bool]:
        """Whether E(k) has been known at or below the threshold."""
        return MappingProxyType({SCORE: self._is_armed})

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm so far."""
        return self._alarms

    def push(self, chunk: Record) -> tuple[Alarm, ...]:
        """Return the alarms that a chunk's samples raise.

        InputError if the chunk doesn't continue the one before, lacks a channel or has another sample period.
        """
        crossed = self._crossings.push(self._norm.push(self._residual.push(taken_inside(chunk))))
        times_s = np.round(crossed.time_s, 9).tolist()
        alarms = alarms_at(((time_s, SCORE) for time_s in times_s), first=len(self._alarms))
        self._is_armed = not np.isnan(crossed.armed_s)
        self._alarms += alarms
        return alarms


def restore_norm(figures: Mapping[str, Any], provenance: Mapping[str, Any]) -> NormMonitor:
    """Return the monitor of some figures; every key is checked.

    InputError naming the key, what stands there and what should.
    """
    figures = keys("figures", figures, ("sample_period_s", "name", "window", "threshold", "operator"))
    table = keys("operator", figures["operator"], OPERATOR_KEYS)
    inputs, outputs = (names_of(f"operator.{key}", table[key]) for key in ("inputs", "outputs"))
    period_s = number("sample_period_s", figures["sample_period_s"], *PERIODS_S)
    window = whole("window", figures["window"])
    limit = number("threshold", figures["threshold"], 0.0, above=True)
    reach = _GROSS * np.sqrt(window + 1.0)
    if limit > reach:
        raise InputError(
            f"threshold is {limit:.3g}; a residual of {_GROSS:g} all over the window reaches {reach:.3g}, so nothing "
            "would alarm; calibrate anew"
        )
    return NormMonitor(
        name=text("name", figures["name"]),
        operator=operator_of("operator", table, inputs, outputs, period_s, "the file"),
        window=window,
        threshold=limit,
        provenance=dict(provenance),
    )
