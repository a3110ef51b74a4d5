"""Columns that tell one time: any of them will do, and the one whose stamps are finest is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtmbench.intake.formats.raw import Meaning, RawSeries
from gtmbench.intake.units import unit
from gtmbench.values.clock import FloatArray

_MOST = 20_000  # rows that are looked at
_APART_S, _DRIFT = 1.1, 1e-3  # whole seconds; of the time since the first, by which two clocks drift apart
_ORDERLY = 0.98  # of the steps that don't go back
_STANDS = 0.5  # of the steps
Column = tuple[RawSeries, Meaning]


def finest_of_alike(columns: Sequence[Column]) -> Column | None:
    """Return the finest of columns that all tell one time, or the only one; None where they don't.

    >>> steps = np.arange(100)
    >>> columns = [
    ...     (RawSeries(name="epoch", load=lambda: 1.7e9 + steps // 10), Meaning(channel="time", unit="s")),
    ...     (RawSeries(name="t_ms", load=lambda: 100 * steps), Meaning(channel="time", unit="ms")),
    ... ]
    >>> found = finest_of_alike(columns)
    >>> found[0].name, found[1].guessed
    ('t_ms', "agreement with 'epoch'")
    >>> finest_of_alike([columns[1], (RawSeries(name="t", load=lambda: 200 * steps), columns[1][1])]) is None
    True
    """
    by_name: dict[str, Column] = {}
    for series, meaning in columns:
        by_name.setdefault(series.name, (series, meaning))
    alike = list(by_name.values())
    if len(alike) == 1:
        return alike[0]
    if len({series.clock for series, _ in alike}) != 1:
        return None
    seconds = [_seconds(*column) for column in alike]
    if not all(map(_is_orderly, seconds)) or not all(_agree(seconds[0], other) for other in seconds[1:]):
        return None
    place = min(range(len(alike)), key=lambda each: (*_fineness(seconds[each]), each))
    series, meaning = alike[place]
    others = " and ".join(f"'{other.name}'" for other, _ in alike if other is not series)
    agreement = f"agreement with {others}"
    return series, replace(meaning, guessed=f"{meaning.guessed} and {agreement}" if meaning.guessed else agreement)


def stands_mostly(series: RawSeries) -> bool:
    """Tell whether most stamps of a column repeat the one before, as whole seconds of a faster log do."""
    steps = np.diff(series.values()[:_MOST])
    return bool(len(steps)) and float(np.mean(steps == 0.0)) > _STANDS


def _seconds(series: RawSeries, meaning: Meaning) -> FloatArray:
    known = unit(meaning.unit)
    values = series.load()[:_MOST]
    there = values[np.isfinite(values)]
    first = there[0] if len(there) else 0  # whole numbers are subtracted as such
    return np.asarray((values - first).astype(np.float64) / (known.factor if known else 1.0))


def _is_orderly(seconds: FloatArray) -> bool:
    there = seconds[np.isfinite(seconds)]
    return len(there) > 1 and float(np.ptp(there)) > 0.0 and float(np.mean(np.diff(there) >= 0.0)) >= _ORDERLY


def _agree(one: FloatArray, other: FloatArray) -> bool:
    there = np.isfinite(one) & np.isfinite(other)
    if not there.any():
        return False
    since, others = one[there] - one[there][0], other[there] - other[there][0]
    return bool(np.all(np.abs(since - others) <= _APART_S + _DRIFT * np.abs(since)))


def _fineness(seconds: FloatArray) -> tuple[float, float]:
    """Return how many stamps repeat or are missing, and how uneven the others' steps are: less is finer."""
    steps = np.diff(seconds)
    forward = steps[steps > 0.0]
    usual = float(np.median(forward)) if len(forward) else 1.0
    uneven = float(np.median(np.abs(forward - usual))) / usual if len(forward) else 1.0
    return round(1.0 - len(forward) / max(len(steps), 1), 2), round(uneven, 2)
