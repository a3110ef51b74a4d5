"""A fleet of logs in words: a line a log, and how many came out how."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gtmbench.intake.events import Event
from gtmbench.report.words.units import counted
from gtmbench.study.log.self_check.motion import GYROS

_OUTCOMES = {"failed": "failed", "unknown": "can't tell", "error": "couldn't be watched", "healthy": "nothing found"}
HEAD = ("log", "outcome", "verdict", "bias seen (deg/s)", "false/h below", "autopilot")
RIGHT = ("false/h below",)
_WIDTHS = {"log": 28, "outcome": 10, "bias seen (deg/s)": 14, "false/h below": 6, "autopilot": 24}  # characters
_GAPS = 14  # between columns
_LEAST = 24
_LINES = 3  # of a verdict


def words_text(words: Sequence[Event]) -> str:
    """Write the autopilot's first word of its sensors, and how many more there are.

    >>> words_text([Event(kind="complaint", time_s=12.5, text="gyro 1 isn't healthy", about="gyro", number=1)])
    "gyro 1 isn't healthy, 12.5 s"
    """
    if not words:
        return "nothing"
    more = f", {len(words) - 1} more" if len(words) > 1 else ""
    return f"{words[0].text}, {words[0].time_s:.1f} s{more}"


def counts_text(outcomes: Iterable[str]) -> str:
    """Say how many logs came out how.

    >>> counts_text(["healthy", "failed", "error", "healthy"])
    "4 logs: 1 failed, 1 couldn't be watched, 2 nothing found"
    """
    counts = Counter(outcomes)
    parts = [f"{counts[outcome]} {text}" for outcome, text in _OUTCOMES.items() if counts[outcome]]
    return f"{counted(counts.total(), 'log')}: {', '.join(parts)}"


def head_of(row: Mapping[str, Any]) -> dict[str, str]:
    """Return what a table shows of a row."""
    told = row["error"] if row["outcome"] == "error" else row["verdict"]
    seen = [_size(row[f"{gyro}_bias_seen_deg_s"]) for gyro in GYROS]
    cells = (
        str(row["log"]),
        _OUTCOMES[str(row["outcome"])],
        str(told),
        " ".join(seen) if {*seen} != {"-"} else "-",
        _size(row["false_alarms_per_hour_at_most"]),
        str(row["autopilot"] or "-"),
    )
    return dict(zip(HEAD, cells, strict=True))


def fleet_lines(rows: Iterable[Mapping[str, Any]], width: int) -> list[list[str]]:
    """Return the cells of a table that fits a screen; what is too long ends in "...", and stands whole in the report.

    Parameters
    ----------
    rows : iterable of mapping
        As `fleet_frame` has them.
    width : int
        Of the screen, in characters.
    """
    verdict = _LINES * max(width - _GAPS - sum(_WIDTHS.values()), _LEAST)
    limits = {name: 2 * size for name, size in _WIDTHS.items()} | {"verdict": verdict, "log": _WIDTHS["log"]}
    lines = []
    for row in rows:
        cells = head_of(row) | {"log": Path(str(row["log"])).name}
        lines.append([_short(cells[name], limits[name]) for name in HEAD])
    return lines


def _short(text: str, limit: int) -> str:
    return text if len(text) <= limit else f"{text[: limit - 3].rstrip()}..."


def _size(value: Any) -> str:
    """Write a size; a dash where there is none."""
    return "-" if value is None or not math.isfinite(value) else f"{float(f'{value:.2g}'):g}"
