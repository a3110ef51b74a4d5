"""Severities: absolute figures, or shares of what a healthy channel does, resolved once against a flight."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.bench.sensors import rms_about_mean
from gtmbench.checks import shown
from gtmbench.errors import InputError
from gtmbench.record import Record

_SHARE = re.compile(r"\s*([0-9]+(?:\.[0-9]+)?)\s*%\s*of\s+(\w+)\s*")


@dataclass(frozen=True, kw_only=True)
class Severity:
    """A number in the channel's unit (per second for slopes), or a share of ``of``: rms, peak or slew."""

    value: float
    of: str | None = None


def parse_severity(given: Any, *, per_second: bool, key: str) -> Severity:
    """Read a number, or a text such as ``"50 % of rms"``.

    Raises
    ------
    InputError
        Naming the key and what is legal there.

    Examples
    --------
    >>> parse_severity("40 % of peak", per_second=False, key="limit")
    Severity(value=0.4, of='peak')
    """
    legal = ("slew",) if per_second else ("rms", "peak")
    is_number = isinstance(given, (int, float)) and not isinstance(given, bool)
    if is_number and abs(given) < 1e9:  # neither inf nor NaN is
        return Severity(value=float(given))
    match = _SHARE.fullmatch(given) if isinstance(given, str) else None
    if match and match[2] in legal:
        return Severity(value=float(match[1]) / 100.0, of=match[2])
    texts = " or ".join(f"'20 % of {name}'" for name in legal)
    raise InputError(
        f"{key} is {shown(given)}; it must be a number in the channel's unit{' per second' * per_second}, or {texts}"
    )


def resolve(severity: Severity, reference: Record, channel: str) -> float:
    """Return a severity as an absolute figure, in the channel's unit (per second for slew).

    Shares refer to the noise-free channel with its mean removed: its RMS, its greatest magnitude (peak), or its
    greatest change from one sample to the next over the sample period (slew).
    """
    if severity.of is None:
        return severity.value
    values = reference[channel] - reference[channel].mean()
    if len(values) < 2:
        raise InputError(f"the span that severities refer to holds {len(values)} sample; give a longer one")
    measures = {
        "rms": rms_about_mean(values),
        "peak": float(np.max(np.abs(values))),
        "slew": float(np.max(np.abs(np.diff(values)))) / reference.sample_period_s,
    }
    return severity.value * measures[severity.of]
