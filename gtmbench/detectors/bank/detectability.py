"""Detectability: which channel's fault enters which residual, how strongly, and what a bank can't tell or can't see.

All of it is worked out from the bank itself, sizes from a monitor's tolerances and thresholds. Which suspects a bank
tells apart, by which residuals rise or by how they rise, is its isolability.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.checks import listed
from gtmbench.detectors.bank.bank import Bank, ResidualSpec
from gtmbench.detectors.bank.calibrated import CalibratedBank, without_spread
from gtmbench.detectors.virtual import integrable
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import derive, raw_needs
from gtmbench.values.channels import SENSORS, unit_of
from gtmbench.values.record import FloatArray, Record, check_record, frozen

if TYPE_CHECKING:
    import pandas as pd


BY_SHAPE, NOT_TOLD = "by shape", "no"


@dataclass(frozen=True, kw_only=True)
class Isolability:
    """What a bank's residuals tell of its suspects."""

    enters: Mapping[str, tuple[str, ...]]  # by suspect: the residuals that its fault enters
    # the suspects of which something says what they should have read: a residual of their own, or, of an angle, the
    # gyros. Others are never named: an alarm that one of them may explain stays undecided
    predicted: frozenset[str]

    @property
    def suspects(self) -> tuple[str, ...]:
        """Those of the bank."""
        return tuple(self.enters)

    def residuals_between(self, one: str, other: str) -> tuple[str, ...]:
        """Return the residuals that a fault of one enters and a fault of the other doesn't."""
        return tuple(output for output in self.enters[one] if output not in self.enters[other])

    def told(self, one: str, other: str) -> str:
        """Say what tells a fault of one from a fault of the other.

        The residuals that rise for it alone, ``by shape`` where only how residuals rise does, or ``no``.
        """
        return " ".join(self.residuals_between(one, other)) or (
            BY_SHAPE if {one, other} <= self.predicted else NOT_TOLD
        )

    def table(self) -> dict[str, dict[str, str]]:
        """Return `told` of every two suspects: a fault of the first, from a fault of the second."""
        names = self.suspects
        return {one: {other: self.told(one, other) for other in names if other != one} for one in names}


def isolability(bank: Bank) -> Isolability:
    """Work out what a bank tells apart.

    >>> from gtmbench.detectors.bank.bank import load_bank
    >>> table = isolability(load_bank("C"))
    >>> table.told("p", "q"), table.told("phi", "p"), table.told("p", "phi")
    ('p', 'q r', 'by shape')
    >>> isolability(load_bank("paper")).told("p", "q")
    'no'
    """
    outputs = [spec.output for spec in bank.diagnostic]
    return Isolability(
        enters={name: bank.affects(name) for name in bank.suspects},
        predicted=frozenset(name for name in bank.suspects if name in outputs or integrable(name, bank.channels)),
    )


LEVEL, SLOPE, NOTHING = "level", "slope", ""
Pattern = Mapping[str, tuple[str, ...]]  # of a channel: one entry a residual


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
        The effect of a jam: RMS of the whitened residual with the channel jammed from the middle of a healthy record
        on, over its RMS on the same rows without the jam; 1 means no change.
    blind_spots : tuple of str
        What the bank can't isolate or detect, a sentence each.

    Examples
    --------
    >>> import gtmbench as gb
    >>> matrix = gb.signatures(gb.load_bank("C"))
    >>> matrix.outputs, matrix.pattern["psi"]
    (('p', 'q', 'r'), ('slope', 'slope', 'slope'))
    """

    bank: Bank
    channels: tuple[str, ...]
    outputs: tuple[str, ...]
    pattern: Mapping[str, tuple[str, ...]]
    strength: FloatArray | None = field(default=None, repr=False)
    blind_spots: tuple[str, ...] = field(repr=False)

    def table(self) -> pd.DataFrame:
        """Return the matrix, channels as rows: the pattern, then any strengths as ``jam in p``."""
        import pandas as pd

        rows = [self.pattern[channel] for channel in self.channels]
        frame = pd.DataFrame(rows, index=list(self.channels), columns=list(self.outputs))
        if self.strength is not None:
            for i, output in enumerate(self.outputs):
                frame[f"jam in {output}"] = self.strength[:, i]
        return frame


def signatures(source: Bank | CalibratedBank, record: Record | None = None) -> Signatures:
    """Return the signatures of a bank or a monitor.

    Parameters
    ----------
    source : Bank or CalibratedBank
        A bank gives the pattern; a monitor also the faults below its tolerances and thresholds.
    record : Record, optional
        A healthy record with the bank's channels, on which strengths are measured. Needs a monitor.

    Raises
    ------
    InputError
        If a record is given without a monitor, lacks channels, or is too short for residuals in its second half.

    Examples
    --------
    >>> import gtmbench as gb
    >>> matrix = gb.signatures(gb.load_bank("C"))
    >>> matrix.pattern["p"], matrix.pattern["phi"]
    (('level', '', ''), ('slope', 'level', 'level'))
    >>> matrix.table().loc["psi"].tolist()
    ['slope', 'slope', 'slope']
    """
    monitor = source if isinstance(source, CalibratedBank) else None
    bank = monitor.bank if monitor is not None else source
    if not isinstance(bank, Bank):
        raise InputError(f"a {type(source).__name__} has no signatures; give a Bank or a CalibratedBank")
    if record is not None and monitor is None:
        raise InputError("strengths are measured with a monitor; give one of `calibrate` or `load_monitor`")
    pattern = {channel: tuple(_entry(bank, spec, channel) for spec in bank.diagnostic) for channel in bank.channels}
    return Signatures(
        bank=bank,
        channels=bank.channels,
        outputs=tuple(spec.output for spec in bank.diagnostic),
        pattern=pattern,
        strength=None if record is None or monitor is None else _strength(monitor, record),
        blind_spots=tuple(_blind_spots(bank, pattern, monitor)),
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
    offset = record.replace(channel, record[channel] + 1.0)
    before, after = (derive(each, spec.inputs).matrix(spec.inputs) for each in (record, offset))
    return not np.allclose(before, after, rtol=1e-9, atol=1e-9, equal_nan=True)


def _strength(monitor: CalibratedBank, record: Record) -> FloatArray:
    check_record(record)
    outputs = [spec.output for spec in monitor.bank.diagnostic]
    healthy = _rms(monitor, record, outputs)
    short = [output for output, rms in healthy.items() if not rms > 0.0]
    if short:
        raise InputError(
            f"the record's second half leaves no residual of '{short[0]}' to compare with; give a longer one without "
            "gaps"
        )
    strength = np.ones((len(monitor.bank.channels), len(outputs)))
    for i, channel in enumerate(monitor.bank.channels):
        jammed = _rms(monitor, _jammed(record, channel), monitor.bank.affects(channel))
        for output, rms in jammed.items():
            strength[i, outputs.index(output)] = rms / healthy[output]
    return frozen(strength)


def _jammed(record: Record, channel: str) -> Record:
    values = np.array(record[channel])
    half = len(values) // 2
    there = np.flatnonzero(np.isfinite(values[: half + 1]))
    values[half:] = np.where(np.isfinite(values[half:]), values[there[-1]] if len(there) else 0.0, np.nan)
    return record.replace(channel, values)


def _rms(monitor: CalibratedBank, record: Record, outputs: list[str] | tuple[str, ...]) -> dict[str, float]:
    """Return the RMS of whitened residuals over the second half of a record; NaN where there is nothing."""
    rms = {}
    for output, values in without_spread(monitor, record, outputs).raw.items():
        white = monitor.whiteners[output].whiten(values)[len(record) // 2 :]
        there = white[np.isfinite(white)]
        rms[output] = float(np.sqrt(np.mean(np.square(there)))) if len(there) else float("nan")
    return rms


def _blind_spots(bank: Bank, pattern: Pattern, monitor: CalibratedBank | None = None) -> list[str]:
    """Return what a bank can't tell or can't see, a sentence each.

    A monitor adds figures: the slowest drift that its thresholds see, and windows that it can't judge.

    >>> from gtmbench.detectors.bank.bank import load_bank
    >>> for line in _blind_spots(load_bank("paper"), {name: ("level",) for name in ("r", "beta", "p", "q")})[:2]:
    ...     print(line)
    r, beta, p and q enter the same residual (r): which of them failed can't be told from which residuals rise.
    Nothing predicts p, q or beta: an alarm that one of them may explain stays undecided.
    """
    return [
        *_same(bank, pattern),
        *_contained(bank, pattern),
        *_unpredicted(bank),
        *_cancelled(pattern),
        *_driven(bank),
        *_tests(bank, monitor),
        *([] if monitor is None else _unjudged(monitor)),
        "A fault that changes no reading isn't one yet: a saturation that isn't reached, a jam of what stands still.",
        *_unused(bank),
    ]


def _groups(bank: Bank, channels: Iterable[str]) -> dict[tuple[str, ...], list[str]]:
    groups: dict[tuple[str, ...], list[str]] = {}
    for channel in channels:
        groups.setdefault(bank.affects(channel), []).append(channel)
    return groups


def _same(bank: Bank, pattern: Pattern) -> list[str]:
    return [
        f"{listed(group)} enter the same {_residuals(outputs)}: which of them failed can't be told from which "
        "residuals rise" + (", only from whose fault explains how they rise." if len(outputs) > 1 else ".")
        for outputs, group in _groups(bank, pattern).items()
        if len(group) > 1
    ]


def _contained(bank: Bank, pattern: Pattern) -> list[str]:
    groups = _groups(bank, pattern)
    sentences = []
    for outputs, group in groups.items():
        inside = [name for others, names in groups.items() if set(others) < set(outputs) for name in names]
        if inside:
            where = f"{listed(group, 'or')} has risen in all of {listed(outputs)}"
            sentences.append(f"Until a fault of {where}, it looks like one of {listed(inside, 'or')}.")
    return sentences


def _unpredicted(bank: Bank) -> list[str]:
    outputs = [spec.output for spec in bank.diagnostic]
    lacking = [name for name in bank.channels if name not in outputs and not integrable(name, bank.channels)]
    suspects = [name for name in bank.suspects if name in lacking]
    others = [name for name in bank.channels if name not in bank.suspects]
    sentences = []
    if suspects:
        which = "it" if len(suspects) == 1 else "one of them"
        sentences.append(
            f"Nothing predicts {listed(suspects, 'or')}: an alarm that {which} may explain stays undecided."
        )
    if others:
        raised = {output: None for name in others for output in bank.affects(name)}
        what = "is no suspect" if len(others) == 1 else "are no suspects"
        where = listed(list(raised))
        sentences.append(
            f"{listed(others)} {what}: a fault there rises in {where} and is put down to a suspect, or to none."
        )
    return sentences


def _cancelled(pattern: Pattern) -> list[str]:
    only = [name for name, entries in pattern.items() if SLOPE in entries and LEVEL not in entries]
    if not only:
        return []
    return [f"Of {listed(only)} only changes enter: an offset, however large, is seen while it comes and not after."]


def _driven(bank: Bank) -> list[str]:
    if not bank.attitude_from_gyros:
        return []
    return ["The gyros drive the attitude: after the first finding it shows no other fault, so nothing is watched."]


def _tests(bank: Bank, monitor: CalibratedBank | None) -> list[str]:
    test = bank.statistic
    if test.name not in ("glr", "cusum"):  # which compare with the mean before
        return [] if test.two_sided else ["Too little energy raises no alarm: a jam of what hardly moves isn't seen."]
    sentences = [
        "A bias that was there from the start (since turn-on) is no change: tests compare with the mean of up to "
        f"{test.baseline_s:g} s before.",
        f"In the first {test.baseline_s / 6.0:g} s of a record there is no such mean yet, so no alarm.",
    ]
    if monitor is None:
        return [
            *sentences,
            f"A change much slower than these {test.baseline_s:g} s takes their mean along and isn't seen.",
        ]
    slowest = {spec.output: slowest_drift(monitor, spec.output) for spec in bank.diagnostic}
    told = [f"{name} {value:.2g} {unit_of(name)} per s" for name, value in slowest.items() if np.isfinite(value)]
    return [
        *sentences,
        f"The mean before follows slower drifts than these, so their size isn't seen: {', '.join(told)}.",
    ]


def _unjudged(monitor: CalibratedBank) -> list[str]:
    never: dict[str, list[str]] = {}
    for output, thresholds in monitor.thresholds.items():
        for label, value in thresholds.items():
            if np.isinf(value):
                never.setdefault(label, []).append(output)
    if not never:
        return []
    said = ", ".join(f"{label} of {listed(outputs)}" for label, outputs in never.items())
    return [f"The records of the calibration were too short for some tests, which raise no alarm: {said}."]


def _unused(bank: Bank) -> list[str]:
    unused = [name for name in SENSORS if name not in bank.channels]
    return [f"No residual holds {listed(unused, 'or')}: faults there aren't seen."] if unused else []


def _residuals(outputs: Sequence[str]) -> str:
    return f"residual{'s' if len(outputs) > 1 else ''} ({', '.join(outputs)})"


def tolerated_shift(monitor: CalibratedBank, output: str) -> float:
    """Return the tolerated change of a residual's mean in the output's unit; inf where whitening removes means."""
    gain = _gain(monitor, output)
    return monitor.tolerances[output].mean / gain if gain else float("inf")


def slowest_drift(monitor: CalibratedBank, output: str) -> float:
    """Return the slope, in the output's unit per second, below which the tests of the mean never see a drift of it.

    A drift of slope b that has lasted shifts a window of L samples against the M of the baseline before it by
    b (L + M)/2 Ts; whitening takes that times sum(a)/deviation. Held against tolerance and threshold (noise left
    out); NaN for statistics without a mean.
    """
    test, period_s = monitor.bank.statistic, monitor.sample_period_s
    tolerance, thresholds = monitor.tolerances[output].mean, monitor.thresholds[output]
    gain = _gain(monitor, output)
    baseline = max(round(test.baseline_s / period_s), 6)
    least = []
    if not gain:
        return float("inf")
    if test.name == "glr":
        for rows in test.rows(period_s):
            threshold = max(thresholds[f"mean {rows * period_s:g} s"], 0.0)
            beyond = np.sqrt(2.0 * threshold * (1.0 / rows + 1.0 / baseline))
            least.append((tolerance + beyond) / ((rows + baseline) / 2.0 * period_s * gain))
    elif test.name == "cusum":
        least.append((tolerance + test.shift / 2.0) / (baseline / 2.0 * period_s * gain))
    return float(min(least, default=np.nan))


def _gain(monitor: CalibratedBank, output: str) -> float:
    """Return what a constant residual of 1 becomes, whitened: deviations over unit."""
    whitener = monitor.whiteners[output]
    return abs(float(np.sum(whitener.coefficients))) / whitener.deviation
