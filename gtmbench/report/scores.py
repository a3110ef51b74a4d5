"""How scores are shown: in their own unit, or as levels, over their thresholds."""

from __future__ import annotations

import re

from gtmbench.detectors.protocol import Score, Watch
from gtmbench.record import FloatArray, Span
from gtmbench.report.style import colour

LOWEST, HIGHEST = 0.03, 1e6  # of levels on a logarithmic axis
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
    names = dict.fromkeys([*watch.scores, *watch.residuals])
    return {name: colour(name, i) for i, name in enumerate(names)}


def part(time_s: FloatArray, values: FloatArray, span: Span) -> tuple[FloatArray, FloatArray]:
    """Return the times and values within a span."""
    shown = (time_s >= span[0] - 1e-9) & (time_s <= span[1] + 1e-9)
    return time_s[shown], values[shown]


def safe(name: str) -> str:
    """Return a name as part of a file's: letters, digits, dots and dashes stay.

    >>> safe("C (2)"), safe("../odd")
    ('C_2', 'odd')
    """
    return re.sub(r"[^\w.-]+", "_", name).strip("_.") or "detector"
