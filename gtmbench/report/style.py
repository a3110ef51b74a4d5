"""Colours that mean the same everywhere: figures, recording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

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
    """Return a colour, a line style and a marker for each name, no two alike for 28 of them.

    >>> strokes(["C", "B"])["B"]
    {'color': '#d55e00', 'linestyle': '--', 'marker': 's'}
    >>> len({(each["color"], each["linestyle"]) for each in strokes(map(str, range(28))).values()})
    28
    """
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
    """Return each name's colour, those that come again left out.

    >>> colours(["p", "flow", "p"])
    {'p': '#1f77b4', 'flow': '#17a2b8'}
    """
    return {name: colour(name, i) for i, name in enumerate(dict.fromkeys(names))}
