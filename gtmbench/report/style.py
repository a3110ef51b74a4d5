"""What figures, pages and recordings show alike: colours, and scores in their own unit or as levels.

A level is a score over its threshold: another word, since a score itself keeps its unit, and since recordings, figures
and results show it by that name (``levels/p``, ``peak_level``).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmbench.detectors.protocol import Score, Watch
from gtmbench.values.record import FloatArray, Span

if TYPE_CHECKING:
    from gtmbench.study.trial import Trial

COLOURS = {  # apart for the colour-blind; what is measured, expected and allowed also in print
    "p": "#1f77b4",
    "q": "#e08214",
    "r": "#2a9d4a",
    "beta": "#673ab7",
    "healthy": "#a0a0a0",
    "threshold": "#d62728",
    "virtual": "#b5127a",
}
EVENTS = {  # of a log
    "reset": "#b8860b",
    "takeoff": "#2ca25f",
    "touchdown": "#3b3b98",
    "failure": "#d62728",
    "complaint": "#e377c2",
}
VERDICTS = {"healthy": "#1a7f37", "failed": "#b42318", "unknown": "#9a6700"}  # by outcome; beside the word, always
STATES = {  # of a sensor over a span, the weightier first; light and dark, so that they differ in grey, too
    "failed": "#b3261e",
    "suspected": "#f0a030",
    "not judged": "#d3d6da",
    "clear": "#8ccf9f",
}
_OTHERS = ("#8c564b", "#17a2b8", "#bcbd22", "#ff9896", "#4d4d4d", "#9edae5")

# of many lines in one plot of a recording, on black and on white
HUES = (
    *("#4e79a7", "#f28e2b", "#e15759", "#76b7b2", "#59a14f", "#edc948", "#b07aa1", "#ff9da7", "#9c755f", "#8c8c8c"),
    *("#1b9e77", "#d95f02", "#7570b3", "#e7298a", "#66a61e", "#e6ab02", "#a6761d", "#56b4e9", "#0072b2", "#cc79a7"),
)

# of lines that are told apart whoever looks: Okabe and Ito's colours, and strokes that print in black
_HUES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
_DASHES = ("-", "--", "-.", ":")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def strokes(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return a colour, a line style and a marker for each name, no two alike for 28 of them."""
    found: dict[str, dict[str, Any]] = {}
    for i, name in enumerate(dict.fromkeys(names)):
        style = (i % len(_HUES) + i // len(_HUES)) % len(_DASHES)
        marker = _MARKERS[i % len(_MARKERS)]
        found[name] = {"color": _HUES[i % len(_HUES)], "linestyle": _DASHES[style], "marker": marker}
    return found


def colour(name: str, position: int = 0) -> str:
    """Return a channel's colour; channels without one of their own take turns."""
    return COLOURS.get(name, _OTHERS[position % len(_OTHERS)])


def colours(names: Iterable[str]) -> dict[str, str]:
    """Return each name's colour, those that come again left out."""
    return {name: colour(name, i) for i, name in enumerate(dict.fromkeys(names))}


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
    return colours([*watch.scores, *watch.residuals])


def part(time_s: FloatArray, values: FloatArray, span: Span) -> tuple[FloatArray, FloatArray]:
    """Return the times and values within a span."""
    shown = (time_s >= span[0] - 1e-9) & (time_s <= span[1] + 1e-9)
    return (time_s, values) if shown.all() else (time_s[shown], values[shown])


def around(trial: Trial, *, before_s: float, after_s: float, longest_s: float = np.inf) -> Span:
    """Return the span about a trial's onset, alarm and decision, within the flight; a minute where it was missed."""
    told = [time_s for time_s in (trial.alarm_time_s, trial.isolated_s) if time_s is not None]
    last_s = max(told) + after_s if told else trial.onset_s + 60.0
    start_s = max(trial.onset_s - before_s, trial.record.start_s)
    return start_s, min(last_s, start_s + longest_s, trial.record.end_s)
