"""The dissertation's detector: an operator between sensors, the norm E(k) of its residual, and a threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from gtmbench.channels import unit_of
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Progress, Score, Watch, came_down, rising, silent
from gtmbench.errors import InputError
from gtmbench.method.alarms import threshold
from gtmbench.method.identify import identify
from gtmbench.method.residual import residual, windowed_norm
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import Record, Span, is_record

SCORE = "E(k)"


@dataclass(frozen=True, kw_only=True)
class DissertationOperator:
    """Section 4.4 as a recipe: identify on one healthy record, take the threshold from another, watch E(k).

    Parameters
    ----------
    inputs, outputs : tuple of str
        Pseudo inputs and pseudo outputs.
    causal_order, noncausal_order : int
        r and d.
    window : int
        w: E(k) sums w + 1 squares.
    threshold_factor : float
        Times the greatest E(k) of the healthy record.
    identify_s, threshold_s : (start, end), optional
        The parts of the two records that are used (k Ts of windows, for the threshold); all of them unless told.
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
            Two or more, healthy, of the excitation that is to be watched, each with noise of its own.
        false_alarms_per_hour : None
            It has a factor, and promises no rate.
        progress : callable
            Told the step, how many are done, and of how many.

        Raises
        ------
        InputError
            Where a rate is asked for, or less than two records are given.
        """
        if false_alarms_per_hour is not None:
            raise InputError(
                f"'{self.name}' can't promise {false_alarms_per_hour:g} false alarms an hour: its threshold is "
                f"{self.threshold_factor:g} times the greatest E(k) of a healthy record; leave the rate out, or take a bank"
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


@dataclass(frozen=True, kw_only=True, eq=False)
class NormMonitor:
    """An identified operator, the window of its norm and a threshold.

    Attributes
    ----------
    operator : Transmissibility
    window : int
        w.
    threshold : float
        Of E(k), in the outputs' unit.
    """

    name: str
    operator: Transmissibility
    window: int
    threshold: float
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Pseudo outputs and inputs."""
        return (*self.operator.outputs, *self.operator.inputs)

    @property
    def suspects(self) -> tuple[str, ...]:
        """None: the residual says that a sensor broke, not which."""
        return ()

    @property
    def sample_period_s(self) -> float:
        """The operator's."""
        return self.operator.sample_period_s

    @property
    def look_ahead_s(self) -> float:
        """D Ts."""
        return round(self.operator.look_ahead_s, 9)

    @property
    def window_s(self) -> float:
        """(w + 1) Ts: with the look-ahead it bounds when a window that lies wholly after an onset is known."""
        return round((self.window + 1) * self.sample_period_s, 9)

    @property
    def memory_s(self) -> float:
        """(r + d + w + 2) Ts: the samples of this window and of the one before."""
        lags = self.operator.causal_order + self.operator.noncausal_order
        return round((lags + self.window + 2) * self.sample_period_s, 9)

    def watch(self, record: Record) -> Watch:
        """Return residual, E(k) and alarms: E(k) that rises above the threshold, at (k + w + d) Ts.

        Raises
        ------
        InputError
            Where the record lacks a channel or has another sample period.
        """
        is_record(record)
        found = residual(self.operator, record)
        norm = windowed_norm(found, window=self.window)
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
        alarms = [
            Alarm(number=i, time_s=float(known_s[row]), onset_s=float(known_s[row]), source=SCORE)
            for i, row in enumerate(rising(norm.values, self.threshold).tolist())
        ]
        columns = dict(zip(self.operator.outputs, found.values.T, strict=True))
        return Watch(
            monitor=self,
            record=record,
            scores=MappingProxyType({SCORE: score}),
            alarms=tuple(alarms),
            residuals=MappingProxyType(columns),
            predictions=MappingProxyType({name: record[name] - values for name, values in columns.items()}),
        )
