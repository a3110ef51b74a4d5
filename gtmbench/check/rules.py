"""The figures that ``gtmbench check`` knows: what each is, which way is worse, and by how much it may be worse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

WINDOW_S = 10.0  # of a healthy flight: every window's greatest value is a figure


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One figure.

    Attributes
    ----------
    text : str
        What a report calls it.
    form : str
        ``flag`` (true is better), ``count``, ``real``, or ``list`` of reals.
    worse : str
        Which way is worse; ``either``: it isn't the monitor's, and must be as it was for a comparison to mean anything.
    tolerance : str, float or list
        As a baseline states it, where it states none. A flag has none.
    meaning : str
        The comment beside the tolerance.
    unit : str
        Its own; ``*`` for that of its residual.
    needs : str
        The flag without which there is no such figure: no delay of what is missed.
    """

    text: str
    form: Literal["flag", "count", "real", "list"]
    worse: Literal["higher", "lower", "either"]
    tolerance: Any = 0
    meaning: str = ""
    unit: str = ""
    needs: str = ""


_DELAY = ["2 %", 0.1]

RULES = {
    "false_alarms": Rule(
        text="false alarms", form="count", worse="higher", meaning="on the healthy records: how many more"
    ),
    "hours": Rule(
        text="hours watched",
        form="real",
        worse="lower",
        tolerance="1 %",
        meaning="of healthy flight in which an alarm was possible",
        unit="h",
    ),
    "samples": Rule(
        text="samples", form="count", worse="lower", meaning="of a healthy residual that exist: how many fewer"
    ),
    "peak": Rule(
        text="peak",
        form="real",
        worse="higher",
        tolerance="5 %",
        meaning="greatest |e(k)| of the healthy record",
        unit="*",
    ),
    "rms": Rule(
        text="RMS", form="real", worse="higher", tolerance="2 %", meaning="of e(k) on the healthy record", unit="*"
    ),
    "windows": Rule(
        text="max",
        form="list",
        worse="higher",
        tolerance="5 %",
        meaning=f"greatest |e(k)| or score in every {WINDOW_S:g} s of the healthy record",
        unit="*",
    ),
    "threshold": Rule(
        text="threshold",
        form="real",
        worse="higher",
        tolerance="2 %",
        meaning="of a score: a higher one sees less",
        unit="*",
    ),
    "thresholds": Rule(
        text="threshold", form="list", worse="higher", tolerance="2 %", meaning="of every test: a higher one sees less"
    ),
    "margin": Rule(
        text="margin",
        form="real",
        worse="lower",
        tolerance="2 %",
        meaning="threshold over the healthy record's greatest score",
    ),
    "severity": Rule(
        text="severity",
        form="list",
        worse="either",
        tolerance="1 %",
        meaning="of a fault: another one is no comparison",
    ),
    "detected": Rule(text="detected", form="flag", worse="lower"),
    "delay_s": Rule(
        text="delay",
        form="real",
        worse="higher",
        tolerance=_DELAY,
        meaning="of detection; the larger of a share and seconds",
        unit="s",
        needs="detected",
    ),
    "peak_ratio": Rule(
        text="peak ratio",
        form="real",
        worse="lower",
        tolerance="5 %",
        meaning="greatest score after the onset, over its threshold",
    ),
    "isolated": Rule(text="isolated", form="flag", worse="lower"),
    "isolation_delay_s": Rule(
        text="isolation delay",
        form="real",
        worse="higher",
        tolerance=_DELAY,
        meaning="until the sensor was named",
        unit="s",
        needs="isolated",
    ),
    "kind_right": Rule(text="kind right", form="flag", worse="lower"),
}

KINDS = {  # the tables of a baseline: what a report calls them, and the figures that stand in them
    "healthy": ("healthy {}", ("false_alarms", "hours")),
    "residual": ("healthy residual of {}", ("samples", "peak", "rms", "windows")),
    "score": ("healthy score {}", ("threshold", "margin", "thresholds", "windows")),
    "trials": (
        "{}",
        ("severity", "detected", "delay_s", "peak_ratio", "isolated", "isolation_delay_s", "kind_right"),
    ),
}

FORMER = ("norm", "level")  # tables of before, scores now: E(k), and levels of a bank
