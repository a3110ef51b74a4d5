"""What a delay would have been at other thresholds, and what of it the test's window took: from a watched record."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.protocol import Monitor, Score, Watch
from gtmbench.files.plain import Column, Row
from gtmbench.method.windowed_alarms import rising
from gtmbench.study.score import first_after

_TIE_S = 1e-9
LADDER: dict[float, str] = {
    factor: f"delay_at_{round(100 * factor)}_percent_s"
    for factor in (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0)
}
COLUMNS: dict[str, Column] = {
    "window_s": Column("double", "how far the test that alarmed looks back; null where it doesn't say"),
    **{
        name: Column("double", f"the delay, had all thresholds been {100 * factor:g} % of what they are; null: none")
        for factor, name in LADDER.items()
    },
}


def crossings(watch: Watch, onset_s: float) -> Row:
    """Return the delay at every threshold of `LADDER`, and the window of the test that alarmed at the own one.

    As an alarm, a crossing is a rise: a score that stands above since before the onset says nothing new. Beyond the
    first alarm scores are what they were with the thresholds as they are.

    Examples
    --------
    >>> from gtmbench.detectors.protocol import Score, Watch
    >>> from gtmbench.detectors.base import FunctionDetector
    >>> from gtmbench.values.record import Record
    >>> record = Record(np.zeros(5), channels=["p"], sample_period_s=1.0)
    >>> values = np.array([0.0, 0.2, 0.55, 1.1, 2.4])
    >>> score = Score(name="p", values=values, known_s=record.time_s, armed=values < 9.0)
    >>> monitor = FunctionDetector(lambda record: [], name="none").calibrate([record])
    >>> found = crossings(Watch(monitor=monitor, record=record, scores={"p": score}, alarms=()), onset_s=1.0)
    >>> [found[name] for name in LADDER.values()]
    [1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, None, None]
    """
    told = first_after(watch.alarms, onset_s)
    row: Row = {"window_s": None if told is None else _window_s(watch.monitor, told)}
    for factor, name in LADDER.items():
        first_s = min((_first_rise_s(score, factor, onset_s) for score in watch.scores.values()), default=np.inf)
        row[name] = round(first_s - onset_s, 9) if np.isfinite(first_s) else None
    return row


def _first_rise_s(score: Score, factor: float, onset_s: float) -> float:
    known_s = score.known_s[rising(score.values, factor * score.threshold)]
    return float(known_s[known_s >= onset_s - _TIE_S].min(initial=np.inf))


def _window_s(monitor: Monitor, alarm: Alarm) -> float | None:
    """Return the window of the test: one for all, or since when, by the alarm, there was a change."""
    own: float | None = getattr(monitor, "window_s", None)
    if own is not None or alarm.test == MISSING or alarm.onset_s >= alarm.time_s - _TIE_S:
        return own
    ahead_of = getattr(monitor, "look_ahead_of", None)  # of a bank, whose residuals wait for samples each as long as it
    ahead_s = monitor.look_ahead_s if ahead_of is None else ahead_of(alarm.source)
    return round(max(alarm.time_s - ahead_s - alarm.onset_s, 0.0), 9)
