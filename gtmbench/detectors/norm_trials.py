"""Trials of the dissertation's operator: its residual is linear in every channel, so a fault adds what it changes."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.protocol import Monitor
from gtmbench.detectors.tried_faults import FAR, TIE_S, Detection, WatchedTrials, is_superposed, stretches
from gtmbench.faults.fault import Fault
from gtmbench.method.filters import filtered
from gtmbench.method.residual import moving_sum, residual, rising
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, Record


class NormTrials:
    """Faults put on one healthy record, one at a time, by equations (4.11) and (4.12).

    e'(k) = e(k) + dy_o(k) - sum over i = -d..r of H_i dy_i(k-i), where dy is what the fault changes in a reading: that
    and the windows that hold it are all that is worked out. Where samples are missing, or several channels change, the
    record is watched.

    `monitor`: what watches. `window`: w. `record`: healthy.
    """

    def __init__(
        self, monitor: Monitor, operator: Transmissibility, window: int, threshold: float, record: Record
    ) -> None:
        self._operator, self._window, self._threshold, self._record = operator, window, threshold, record
        self._watched = WatchedTrials(monitor, record)
        self._time_s = record.time_s
        self._errors = residual(operator, record).values
        self._squares = np.square(self._errors).sum(axis=1)
        self._norms = np.sqrt(moving_sum(self._squares, window + 1))
        self._late = window + operator.noncausal_order  # rows from a window's first to when it is known

    def first_alarm_s(self, fault: Fault) -> float | None:
        """Return when the first alarm could be raised at or after a fault's onset; None where none is."""
        if not is_superposed(fault, self._record):
            return self._watched.first_alarm_s(fault)
        for known in stretches(fault.onset_row(self._record), len(self._record)):
            norms = self._changed(fault, known.stop)
            if norms is None:
                return self._watched.first_alarm_s(fault)
            alarm_s = self._alarm_s(fault, norms)
            if alarm_s is not None:
                return alarm_s
        return None

    def detection(self, fault: Fault) -> Detection:
        """Return that, and how far E(k) went by the record's end."""
        norms = self._changed(fault, len(self._record)) if is_superposed(fault, self._record) else None
        if norms is None:
            return self._watched.detection(fault)
        known = norms[max(fault.onset_row(self._record) - self._late, 0) :]
        is_entered = fault.channel in (*self._operator.outputs, *self._operator.inputs)
        peak = float(np.fmax.reduce(known, initial=0.0)) / self._threshold if is_entered else 0.0
        return Detection(alarm_s=self._alarm_s(fault, norms), peak_ratio=min(peak, FAR))

    def _alarm_s(self, fault: Fault, norms: FloatArray) -> float | None:
        risen = rising(norms, self._threshold) + self._late
        times_s = np.round(self._time_s[risen], 9)
        later = times_s[times_s >= fault.onset_s - TIE_S]
        return float(later[0]) if len(later) else None

    def _changed(self, fault: Fault, stop: int) -> FloatArray | None:
        """Return E(k) with the fault, as far as it is known with rows before `stop`; None where samples miss."""
        row = fault.onset_row(self._record)
        was, reads = fault.onwards(self._record, stop)
        if not np.isfinite(reads).all():
            return None
        change = reads - was
        begin = max(row - self._operator.noncausal_order, 0)
        end = max(stop - self._operator.noncausal_order, begin)
        errors = self._errors[begin:end] + self._effect(fault.channel, change, row, begin)[: end - begin]
        first = max(begin - self._window, 0)
        squares = np.concatenate([self._squares[first:begin], np.square(errors).sum(axis=1)])
        known = max(end - self._window - first, 0)
        return np.concatenate([self._norms[:first], np.sqrt(moving_sum(squares, self._window + 1))[:known]])

    def _effect(self, channel: str, change: FloatArray, row: int, begin: int) -> FloatArray:
        """Return what a change of a channel from a row on adds to the residual, from `begin` on, an output a column."""
        operator = self._operator
        effect = np.zeros((row - begin + len(change), len(operator.outputs)))
        if channel in operator.outputs:
            effect[row - begin :, operator.outputs.index(channel)] = change
        if channel in operator.inputs:
            place = operator.inputs.index(channel)
            before = np.zeros(row - begin + operator.causal_order)
            ahead = np.zeros(operator.noncausal_order)  # not known yet, nor asked for
            added = filtered([np.concatenate([before, change, ahead])], operator.markov[:, :, [place]], np.zeros(1))
            effect -= added
        return effect
