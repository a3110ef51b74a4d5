"""How scores are shown: in their own unit, or as levels.

A level is a score over its threshold: another word, since a score itself keeps its unit, and since recordings, figures
and results show it by that name (``levels/p``, ``peak_level``).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.protocol import Score, Watch
from gtmbench.report.style import colours
from gtmbench.values.record import FloatArray, Span

if TYPE_CHECKING:
    from gtmbench.study.trial import Trial

LOWEST, HIGHEST = 0.03, 1e6  # of levels on a logarithmic axis
_MISSED_S = 60.0
SHOWN_LEVELS = 4.0  # a plain axis ends at this many thresholds: what lies above has alarmed anyway


def norm_of(watch: Watch) -> Score | None:
    """Return the score of a detector that has one, in a unit, and so is shown in it: E(k); None for levels."""
    scores = tuple(watch.scores.values())
    return scores[0] if len(scores) == 1 and scores[0].unit else None


def level(score: Score) -> FloatArray:
    """Return a score over its threshold, shape (samples,): an alarm above 1."""
    return score.values / score.threshold


def tints(watch: Watch) -> dict[str, str]:
    """Return a colour for every score and every residual, by name."""
    return colours([*watch.scores, *watch.residuals])


def part(time_s: FloatArray, values: FloatArray, span: Span) -> tuple[FloatArray, FloatArray]:
    """Return the times and values within a span."""
    shown = (time_s >= span[0] - 1e-9) & (time_s <= span[1] + 1e-9)
    return (time_s, values) if shown.all() else (time_s[shown], values[shown])


def around(trial: Trial, *, before_s: float, after_s: float, longest_s: float = np.inf) -> Span:
    """Return the span about a trial's onset, alarm and decision, within the flight; a minute where it was missed."""
    told = [time_s for time_s in (trial.alarm_time_s, trial.isolated_s) if time_s is not None]
    last_s = max(told) + after_s if told else trial.onset_s + _MISSED_S
    start_s = max(trial.onset_s - before_s, trial.record.start_s)
    return start_s, min(last_s, start_s + longest_s, trial.record.end_s)
