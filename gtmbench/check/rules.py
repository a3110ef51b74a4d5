"""The figures that ``gtmbench check`` knows: what each is, which way is worse, and by how much it may be worse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from gtmbench.checks import number, shown
from gtmbench.errors import InputError

WINDOW_S = 10.0  # of a healthy flight: every window's greatest value is a figure
_LARGEST = 1e9


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """The larger of a share of what was recorded and a number in the figure's unit.

    >>> tolerance = Tolerance(share=0.02, absolute=0.1)
    >>> tolerance.around(100.0), tolerance.around(1.0)
    (2.0, 0.1)
    """

    share: float = 0.0
    absolute: float = 0.0

    def around(self, recorded: float) -> float:
        """Return how far from the recorded value is still well."""
        return max(self.share * abs(recorded), self.absolute)


def parse_tolerance(key: str, given: Any) -> Tolerance:
    """Return a tolerance as a baseline states it: ``0.1``, ``"5 %"``, or both, ``["5 %", 0.1]``."""
    if not isinstance(given, list):
        return _share_or_number(key, given)
    if len(given) != 2 or isinstance(given[0], str) == isinstance(given[1], str):
        raise InputError(f'{key} is {shown(given)}; a list holds a share and a number, such as ["5 %", 0.1]')
    first, second = (_share_or_number(key, part) for part in given)
    return Tolerance(share=max(first.share, second.share), absolute=max(first.absolute, second.absolute))


def _share_or_number(key: str, given: Any) -> Tolerance:
    if not isinstance(given, str):
        return Tolerance(absolute=number(key, given, 0.0, _LARGEST))
    digits, percent, rest = given.partition("%")
    try:
        share = float(digits) if percent and not rest.strip() else None
    except ValueError:
        share = None
    if share is None:
        raise InputError(f'{key} is {shown(given)}; give a share such as "5 %", or a number in the figure\'s unit')
    return Tolerance(share=number(key, share, 0.0, _LARGEST) / 100.0)


@dataclass(frozen=True)
class Rule:
    """One figure."""

    text: str  # what a report calls it
    # ``flag`` (true is better), ``count``, ``real``, or ``list`` of reals
    form: Literal["flag", "count", "real", "list"]
    # which way is worse; ``either``: it isn't the monitor's, and must be as it was for a comparison to mean anything
    worse: Literal["higher", "lower", "either"]
    tolerance: Any = 0  # As a baseline states it, where it states none. A flag has none.
    meaning: str = ""  # the comment beside the tolerance
    unit: str = ""  # its own; ``*`` for that of its residual
    needs: str = ""  # the flag without which there is no such figure: no delay of what is missed


_DELAY = ["2 %", 0.1]
_EVERY_WINDOW = f"greatest |e(k)| or score in every {WINDOW_S:g} s of the healthy record"
_RATIO = "greatest score after the onset, over its threshold"

RULES = {
    "false_alarms": Rule("false alarms", "count", "higher", meaning="on the healthy records: how many more"),
    "hours": Rule("hours watched", "real", "lower", "1 %", "of healthy flight in which an alarm was possible", "h"),
    "samples": Rule("samples", "count", "lower", meaning="of a healthy residual that exist: how many fewer"),
    "peak": Rule("peak", "real", "higher", "5 %", "greatest |e(k)| of the healthy record", "*"),
    "rms": Rule("RMS", "real", "higher", "2 %", "of e(k) on the healthy record", "*"),
    "windows": Rule("max", "list", "higher", "5 %", _EVERY_WINDOW, "*"),
    "threshold": Rule("threshold", "real", "higher", "2 %", "of a score: a higher one sees less", "*"),
    "thresholds": Rule("threshold", "list", "higher", "2 %", "of every test: a higher one sees less"),
    "margin": Rule("margin", "real", "lower", "2 %", "threshold over the healthy record's greatest score"),
    "severity": Rule("severity", "list", "either", "1 %", "of a fault: another one is no comparison"),
    "detected": Rule("detected", "flag", "lower"),
    "delay_s": Rule(
        "delay", "real", "higher", _DELAY, "of detection; the larger of a share and seconds", "s", needs="detected"
    ),
    "peak_ratio": Rule("peak ratio", "real", "lower", "5 %", _RATIO),
    "isolated": Rule("isolated", "flag", "lower"),
    "isolation_delay_s": Rule(
        "isolation delay", "real", "higher", _DELAY, "until the sensor was named", "s", needs="isolated"
    ),
    "kind_right": Rule("kind right", "flag", "lower"),
    "failed": Rule("failed", "flag", "either"),
    "suspected": Rule("suspected", "flag", "either"),
    "onset_s": Rule("onset", "real", "either", 1.0, "of a log's failure: how far it may move", "s", needs="failed"),
    "judged_s": Rule("judged", "real", "lower", "2 %", "of a log's sensor: how much shorter", "s"),
    "error": Rule("smallest error", "real", "higher", "5 %", "that would show in a log's sensor", "*"),
}

OF_LOGS = ("failed", "suspected", "onset_s", "judged_s", "error")  # figures of a log's sensor

KINDS = {  # the tables of a baseline: what a report calls them, and the figures that stand in them
    "healthy": ("healthy {}", ("false_alarms", "hours")),
    "residual": ("healthy residual of {}", ("samples", "peak", "rms", "windows")),
    "score": ("healthy score {}", ("threshold", "margin", "thresholds", "windows")),
    "trials": ("{}", ("severity", "detected", "delay_s", "peak_ratio", "isolated", "isolation_delay_s", "kind_right")),
    "sensors": ("{}", OF_LOGS),
}
