"""How much of a sensor's slow motion its virtual sensor explains: a residual that explains nothing sees nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank, residuals_of
from gtmbench.detectors.protocol import Watch
from gtmbench.method.pseudo_inputs import reproduces
from gtmbench.record import FloatArray, Record
from gtmbench.study.log.self_check.motion import slow_motion

ENOUGH = 0.5  # of the motion: with the right wiring 0.66 and more, with a wrong one 0.37 and less
_NOISE = 0.7  # of all of a residual: what is slow in it, at most, where it is noise
_AGAINST = -0.3  # correlation of a sensor with its virtual sensor: where it is less, motion is there
_LOUDER = 1.5  # times what a residual was where it was identified: less is a calm flight


@dataclass(frozen=True, kw_only=True)
class Explained:
    """What is left of a sensor's motion.

    Attributes
    ----------
    output : str
    where : str
        ``identified`` or ``watched``.
    share : float
        1 - RMS of the residual / RMS of the signal, of slow motion about its mean; NaN where nothing moves.
    residual, signal : float
        These RMS values, in the sensor's unit.
    is_asked : bool
        Whether it must explain: where a pseudo input reads as the sensor. Other operators are tied to how the aircraft
        is excited, and nothing says how much they have to explain.
    is_calm : bool
        Whether the residual is noise, more fast than slow and not against the virtual sensor, or no more than where it
        was identified: too little motion to tell anything from.
    """

    output: str
    where: str
    share: float
    residual: float
    signal: float
    is_asked: bool
    is_calm: bool

    @property
    def is_shown(self) -> bool:
        """Whether it explains enough, or needn't."""
        return not self.is_asked or self.share >= ENOUGH

    @property
    def is_blind(self) -> bool:
        """Whether there is motion that it had to explain, and doesn't."""
        return not self.is_shown and not self.is_calm


def explained_where_identified(bank: CalibratedBank, records: Sequence[Record]) -> list[Explained]:
    """Return what every residual of a sensor explains of the records that a bank stands on."""
    found = []
    for spec in bank.bank.diagnostic:
        residuals = [
            residuals_of(bank.bank, record, bank.operators, [spec.output]).raw[spec.output] for record in records
        ]
        signals = [record[spec.output] for record in records]
        found.append(_explained(bank, spec.output, "identified", residuals, signals))
    return found


def explained_where_watched(bank: CalibratedBank, watches: Sequence[Watch]) -> list[Explained]:
    """Return what every residual of a sensor explains of what a bank watched."""
    found = []
    for spec in bank.bank.diagnostic if watches else ():
        residuals = [watch.residuals[spec.output] for watch in watches]
        signals = [watch.record[spec.output] for watch in watches]
        found.append(_explained(bank, spec.output, "watched", residuals, signals))
    return found


def _explained(
    bank: CalibratedBank, output: str, where: str, residuals: Sequence[FloatArray], signals: Sequence[FloatArray]
) -> Explained:
    squares, against, rows = np.zeros(4), 0.0, 1
    for values, readings in zip(residuals, signals, strict=True):
        (slowed, there), raw = slow_motion(np.column_stack([values, readings])), values[np.isfinite(values)]
        if not len(raw):
            continue
        left, signal = slowed.T
        virtual = signal - left
        squares += [*(float(of @ of) for of in (left, signal, virtual)), float(np.square(raw - raw.mean()).sum())]
        against += float(signal @ virtual)
        rows += int(np.count_nonzero(there))
    alike = against / max(float(np.sqrt(squares[1] * squares[2])), 1e-300)
    residual, signal, _, whole = np.sqrt(squares / rows).tolist()
    usual = float(np.asarray(bank.operators[output].rms_residual).ravel()[0])
    return Explained(
        output=output,
        where=where,
        share=1.0 - residual / signal if signal > 0.0 else float("nan"),
        residual=residual,
        signal=signal,
        is_asked=any(reproduces(name, output) for name in bank.operators[output].inputs),
        is_calm=(alike > _AGAINST and residual <= _NOISE * whole) or (where == "watched" and whole <= _LOUDER * usual),
    )
