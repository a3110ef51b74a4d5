"""How much of a sensor's slow motion its virtual sensor explains: a residual that explains nothing sees nothing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.predicting import PredictingMonitor
from gtmbench.detectors.protocol import Watch
from gtmbench.log.self_check.motion import slow_pieces
from gtmbench.values.pieces import deviation
from gtmbench.values.record import FloatArray, Record, Span

ENOUGH = 0.5  # of the motion: with the right wiring 0.66 and more, with a wrong one 0.37 and less
_NOISE = 0.7  # of all of a residual: what is slow in it, at most, where it is noise
_AGAINST = -0.3  # correlation of a sensor with its virtual sensor: where it is less, motion is there
_LOUDER = 1.5  # times what a residual was where it was identified: less is a calm flight


@dataclass(frozen=True, kw_only=True)
class ExplainedMotion:
    """What is left of a sensor's motion."""

    output: str
    where: str  # ``identified`` or ``watched``
    share: float  # 1 - RMS of the residual / RMS of the signal, of slow motion about its mean; NaN where nothing moves
    # residual, signal: these RMS values, in the sensor's unit
    residual: float
    signal: float
    # Whether it must explain: where a pseudo input reads as the sensor. Other operators are tied to how the aircraft is
    # excited, and nothing says how much they have to explain.
    is_asked: bool
    # whether the residual is noise, more fast than slow and not against the virtual sensor, or no more than where it
    # was identified: too little motion to tell anything from
    is_calm: bool

    @property
    def is_shown(self) -> bool:
        """Whether it explains enough, or needn't."""
        return not self.is_asked or self.share >= ENOUGH

    @property
    def is_blind(self) -> bool:
        """Whether there is motion that it had to explain, and doesn't."""
        return not self.is_shown and not self.is_calm


def explained_where_identified(monitor: PredictingMonitor, records: Sequence[Record]) -> list[ExplainedMotion]:
    """Return what every residual of a sensor explains of the records that a monitor stands on."""
    found = []
    for sensor in monitor.basis.predicts:
        residuals = [monitor.residual(record, sensor) for record in records]
        found.append(_explained(monitor, sensor, "identified", residuals, [record[sensor] for record in records]))
    return found


def explained_where_watched(
    monitor: PredictingMonitor, watches: Sequence[Watch], left_out: Sequence[Span]
) -> list[ExplainedMotion]:
    """Return what every residual of a sensor explains of what a monitor watched, but for some spans."""
    found = []
    for sensor in monitor.basis.predicts if watches else ():
        residuals = (_outside(watch, sensor, left_out) for watch in watches)  # one by one: they are let go
        signals = [watch.record[sensor] for watch in watches]
        found.append(_explained(monitor, sensor, "watched", residuals, signals))
    return found


def _outside(watch: Watch, sensor: str, left_out: Sequence[Span]) -> FloatArray:
    """Return a residual without some spans."""
    residual, time_s = watch.residuals[sensor], watch.record.time_s
    for start_s, end_s in left_out:
        within = (time_s >= start_s) & (time_s <= end_s)
        residual = np.where(within, np.nan, residual) if within.any() else residual
    return residual


def _moments(values: FloatArray, readings: FloatArray) -> tuple[float, float, float, int]:
    """Return the sums of squares and of products of two columns' slow motion about its mean, and of how many rows."""
    sums, products, count = np.zeros(2), np.zeros((2, 2)), 0
    about: FloatArray | None = None
    for motion, there in slow_pieces([values, readings]):
        known = motion[there]
        if len(known):
            about = known.mean(axis=0) if about is None else about
            known = known - about
            sums, products, count = sums + known.sum(axis=0), products + known.T @ known, count + len(known)
    if count:
        products = products - np.outer(sums, sums) / count
    return float(products[0, 0]), float(products[1, 1]), float(products[0, 1]), count


def _explained(
    monitor: PredictingMonitor, output: str, where: str, residuals: Iterable[FloatArray], signals: Iterable[FloatArray]
) -> ExplainedMotion:
    squares, against, rows = np.zeros(4), 0.0, 1
    for values, readings in zip(residuals, signals, strict=True):
        whole = deviation([values])
        if np.isnan(whole):
            continue
        left, signal, both, count = _moments(values, readings)
        # of the residual, the signal, and the virtual sensor between them
        squares += [left, signal, signal - 2.0 * both + left, whole**2 * np.count_nonzero(np.isfinite(values))]
        against += signal - both
        rows += count
    alike = against / max(float(np.sqrt(squares[1] * squares[2])), 1e-300)
    residual, signal, _, whole = np.sqrt(squares / rows).tolist()
    usual = float(np.asarray(monitor.operators[output].rms_residual).ravel()[0])
    return ExplainedMotion(
        output=output,
        where=where,
        share=1.0 - residual / signal if signal > 0.0 else float("nan"),
        residual=residual,
        signal=signal,
        is_asked=output in monitor.basis.kinematic,
        is_calm=(alike > _AGAINST and residual <= _NOISE * whole) or (where == "watched" and whole <= _LOUDER * usual),
    )
