"""Fault signatures of a bank: which channel's fault enters which residual, how strongly, and what stays unseen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.bank.bank import Bank, ResidualSpec
from gtmbench.detectors.bank.blind_spots import LEVEL, NOTHING, SLOPE, blind_spots
from gtmbench.detectors.bank.calibrated import CalibratedBank, bank_residuals
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import derive, raw_needs
from gtmbench.record import FloatArray, Record, check_record, frozen

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False)
class Signatures:
    """The fault-signature matrix of a bank.

    Attributes
    ----------
    bank : Bank
    channels, outputs : tuple of str
        Rows: the measured channels that the bank uses. Columns: its residuals.
    pattern : mapping of channel to tuple of str
        One entry a residual: ``level`` (an error of the channel enters it), ``slope`` (only changes of the error do: a
        constant one cancels in a derivative) or empty.
    strength : shape (channels, outputs), optional
        What a jam does: RMS of the whitened residual with the channel jammed from the middle of a healthy record on,
        over its RMS on the same rows without; 1 where it changes nothing.
    blind_spots : tuple of str
        What the bank can't tell or can't see, a sentence each.
    """

    bank: Bank
    channels: tuple[str, ...]
    outputs: tuple[str, ...]
    pattern: Mapping[str, tuple[str, ...]]
    strength: FloatArray | None = field(default=None, repr=False)
    blind_spots: tuple[str, ...] = field(repr=False)

    def table(self) -> pd.DataFrame:
        """Return the matrix, channels as rows: the pattern, then the strengths as ``jam in p``, where there are any."""
        import pandas as pd

        rows = [self.pattern[channel] for channel in self.channels]
        frame = pd.DataFrame(rows, index=list(self.channels), columns=list(self.outputs))
        if self.strength is not None:
            for i, output in enumerate(self.outputs):
                frame[f"jam in {output}"] = self.strength[:, i]
        return frame


def signatures(source: Bank | CalibratedBank, record: Record | None = None) -> Signatures:
    """Work out the signatures of a bank or a monitor.

    Parameters
    ----------
    source : Bank or CalibratedBank
        A bank tells the pattern; a monitor also what its tolerances and thresholds let pass.
    record : Record, optional
        Healthy, with the bank's channels: strengths are measured on it. Needs a monitor.

    Raises
    ------
    InputError
        Where a record is given without a monitor, lacks channels, or is too short for residuals in its second half.

    Examples
    --------
    >>> from gtmbench.detectors.bank.bank import load_bank
    >>> found = signatures(load_bank("C"))
    >>> found.pattern["p"], found.pattern["phi"]
    (('level', '', ''), ('slope', 'level', 'level'))
    >>> found.table().loc["psi"].tolist()
    ['slope', 'slope', 'slope']
    """
    monitor = source if isinstance(source, CalibratedBank) else None
    bank = monitor.bank if monitor is not None else source
    if not isinstance(bank, Bank):
        raise InputError(f"a {type(source).__name__} has no signatures; give a Bank or a CalibratedBank")
    if record is not None and monitor is None:
        raise InputError("strengths are measured with a monitor; give one of `calibrate` or `load_monitor`")
    pattern = {channel: tuple(_entry(bank, spec, channel) for spec in bank.residuals) for channel in bank.channels}
    return Signatures(
        bank=bank,
        channels=bank.channels,
        outputs=tuple(spec.output for spec in bank.residuals),
        pattern=pattern,
        strength=None if record is None or monitor is None else _strength(monitor, record),
        blind_spots=tuple(blind_spots(bank, pattern, monitor)),
    )


def _entry(bank: Bank, spec: ResidualSpec, channel: str) -> str:
    if spec.output not in bank.affects(channel):
        return NOTHING
    return LEVEL if channel == spec.output or _offset_enters(spec, channel) else SLOPE


def _offset_enters(spec: ResidualSpec, channel: str) -> bool:
    """Tell whether a constant error of a channel changes any input: tried on a made-up record, whatever the formula."""
    raw = sorted({need for name in spec.inputs for need in raw_needs(name)})
    row = np.arange(60.0)
    values = [10.0 + i + 3.0 * np.sin((0.11 + 0.07 * i) * row + i) for i in range(len(raw))]
    record = Record(np.column_stack(values), channels=raw, sample_period_s=0.1)
    before, after = (
        derive(one, spec.inputs).matrix(spec.inputs) for one in (record, record.replace(channel, record[channel] + 1.0))
    )
    return not np.allclose(before, after, rtol=1e-9, atol=1e-9, equal_nan=True)


def _strength(monitor: CalibratedBank, record: Record) -> FloatArray:
    check_record(record)
    outputs = [spec.output for spec in monitor.bank.residuals]
    healthy = _rms(monitor, record, outputs)
    short = [output for output, rms in healthy.items() if not rms > 0.0]
    if short:
        raise InputError(
            f"the record's second half leaves no residual of '{short[0]}' to compare with; give a longer one without "
            "gaps"
        )
    found = np.ones((len(monitor.bank.channels), len(outputs)))
    for i, channel in enumerate(monitor.bank.channels):
        jammed = _rms(monitor, _jammed(record, channel), monitor.bank.affects(channel))
        for output, rms in jammed.items():
            found[i, outputs.index(output)] = rms / healthy[output]
    return frozen(found)


def _jammed(record: Record, channel: str) -> Record:
    values = np.array(record[channel])
    half = len(values) // 2
    there = np.flatnonzero(np.isfinite(values[: half + 1]))
    values[half:] = np.where(np.isfinite(values[half:]), values[there[-1]] if len(there) else 0.0, np.nan)
    return record.replace(channel, values)


def _rms(monitor: CalibratedBank, record: Record, outputs: list[str] | tuple[str, ...]) -> dict[str, float]:
    """Return the RMS of whitened residuals over the second half of a record; NaN where there is nothing."""
    raw = bank_residuals(monitor, record, outputs).raw
    found = {}
    for output, values in raw.items():
        white = monitor.whiteners[output].whiten(values)[len(record) // 2 :]
        there = white[np.isfinite(white)]
        found[output] = float(np.sqrt(np.mean(np.square(there)))) if len(there) else float("nan")
    return found
