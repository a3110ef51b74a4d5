"""Constants and what is predicted of them, in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gtmbench.history.constant import FACTOR, NOISE, OFFSET, Constant, kind_of
from gtmbench.history.spread import Prediction
from gtmbench.history.trend import Trend

_SHOWS = 1.645  # deviations above what is called another: what would show in 95 of 100 flights


def reads_text(constant: Constant, before: Prediction) -> str:
    """Say by how much a constant is another than before.

    >>> read = Constant(sensor="q", name="offset", value=4.2, deviation=0.05)
    >>> before = Prediction(flights=12, value=0.1, deviation=0.2, degrees=11.0, spread=0.2, low=-0.2, high=0.4)
    >>> reads_text(read, before)
    'q reads 4.1 deg/s too much throughout; in 12 flights before at most 0.3'
    """
    most = max(before.high - before.value, before.value - before.low)
    flights = f"in {before.flights} flights before"
    off = constant.value - before.value
    if constant.name == NOISE:
        return f"{constant.sensor} is {np.exp(off):.2g} times as noisy throughout; {flights} at most {np.exp(most):.2g}"
    if constant.kind.unit == "deg/s":
        than = "too much" if off > 0.0 else "too little"
        return f"{constant.sensor} reads {abs(off):.2g} deg/s {than} throughout; {flights} at most {most:.2g}"
    if constant.name == FACTOR:
        return (
            f"{constant.sensor} reads {constant.value:.3g} of each turn throughout; {flights} {before.low:.3g} to "
            f"{before.high:.3g}"
        )
    return (
        f"the {constant.name} of {constant.sensor} is {constant.value:.3g} {constant.kind.unit}; {flights} it was not"
    )


def trend_text(trend: Trend) -> str:
    """Say how a constant changes, and when it will reach its limit.

    >>> told = dict(sensor="q", name="offset", flights=12, slope=0.1, deviation=0.01, limit=5.0, crossing=43.2)
    >>> trend_text(Trend(between=(38.0, 51.4), **told))
    'changes by 0.1 deg/s a flight; it reaches 5 deg/s at flight 43 (38 to 51)'
    """
    unit = kind_of(trend.name).unit
    behind = f" {unit}" if unit else ""
    low, high = trend.between
    reaches = f"it reaches {trend.limit:.3g}{behind} at flight {trend.crossing:.0f} ({low:.0f} to {high:.0f})"
    return f"changes by {trend.slope:.2g}{behind} a flight; {reaches}"


def would_show_text(predictions: Mapping[tuple[str, str], Prediction], level: float) -> str:
    """Say that nothing is another than before, and what would have shown."""
    flights = max(each.flights for each in predictions.values())
    told = f"as in {flights} flights before"
    sizes = {}
    for name in (OFFSET, FACTOR):
        own = [_would_show(each, level) for key, each in predictions.items() if key[1] == name and " of " not in key[0]]
        if own:
            sizes[name] = max(own)
    parts = [f"an error of {sizes[OFFSET]:.2g} deg/s"] if OFFSET in sizes else []
    parts += [f"a factor of {max(1.0 - sizes[FACTOR], 0.0):.2g}"] if FACTOR in sizes else []
    return f"{told}; {' or '.join(parts)} throughout would show" if parts else told


def _would_show(prediction: Prediction, level: float) -> float:
    return prediction.reach(level) + _SHOWS * prediction.deviation
