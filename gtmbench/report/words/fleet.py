"""A fleet of logs in words: a line a log, and how many came out how."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gtmbench.intake.events import Event
from gtmbench.report.words.units import counted, duration_text
from gtmbench.values.channels import GYROS

_OUTCOMES = {"failed": "failed", "unknown": "cannot tell", "error": "not read", "healthy": "no fault found"}
HEAD = ("log", "outcome", "verdict", "bias seen", "false/h", "autopilot")
RIGHT = ("false/h",)
_WIDTHS = {"log": 26, "outcome": 13, "bias seen": 14, "false/h": 7, "autopilot": 28}  # characters
_GAP = 3  # between columns
_WIDE, _OF_WIDE = 120, ("false/h", "autopilot")  # a screen, and what only such a one shows
_LEAST = 24
_LINES = 3  # of a verdict
MEANING = {
    "bias seen": "bias seen: the smallest bias of p, q and r that would have been detected, in deg/s",
    "false/h": "false/h: at most so many false alarms an hour, at 95 %",
}


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
    '4 logs: 1 failed, 1 not read, 2 no fault found'
    """
    counts = Counter(outcomes)
    parts = [f"{counts[outcome]} {text}" for outcome, text in _OUTCOMES.items() if counts[outcome]]
    return f"{counted(counts.total(), 'log')}: {', '.join(parts)}"


def whole_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what a page shows of a row, under `HEAD`: nothing is cut."""
    cells = _cells(row)
    if row["outcome"] == "error":
        return tuple({**cells, "log": row["log"]}.values())
    watched = f"{duration_text(row['watched_hours'])} watched of {row['start_s']:.2f} to {row['end_s']:.2f} s"
    told = f"{row['verdict']} {row['certificate']} {watched}, by {row['monitor']}, at {row['rate_hz']:.4g} Hz"
    return tuple({**cells, "log": row["log"], "verdict": told}.values())


def _cells(row: Mapping[str, Any]) -> dict[str, str]:
    """Return what a table shows of a row; what another column says is left out of the verdict."""
    told = _error(row) if row["outcome"] == "error" else row["verdict"].removeprefix("Cannot tell: ")
    seen = [_size(row[f"{gyro}_bias_seen_deg_s"]) for gyro in GYROS]
    bias = " ".join(seen) if {*seen} != {"-"} else "-"
    bound = _size(row["false_alarms_per_hour_at_most"])
    name = Path(row["log"]).name
    return dict(zip(HEAD, (name, _OUTCOMES[row["outcome"]], told, bias, bound, row["autopilot"] or "-"), strict=True))


def _error(row: Mapping[str, Any]) -> str:
    return str(row["error"]).removeprefix(f"{row['log']}: ")


def fleet_table(rows: Iterable[Mapping[str, Any]], width: int) -> tuple[list[str], list[list[str]]]:
    """Return the columns and the cells of a table that fits a screen, each log by its file's name.

    What is too long is cut, a name in front, and a narrow screen has fewer columns; all of it stands in the report.
    """
    names = [name for name in HEAD if width >= _WIDE or name not in _OF_WIDE]
    others = sum(_WIDTHS.get(name, 0) + _GAP for name in names)
    limits = {**_WIDTHS, "verdict": _LINES * max(width - others, _LEAST)}
    return names, [[_short(_cells(row)[name], limits[name], in_front=name == "log") for name in names] for row in rows]


def _short(text: str, limit: int, *, in_front: bool) -> str:
    if len(text) <= limit:
        return text
    return f"...{text[3 - limit :]}" if in_front else f"{text[: limit - 3].rstrip()}..."


def _size(value: float | None) -> str:
    """Write a size; a dash where there is none."""
    return "-" if value is None else f"{float(f'{value:.2g}'):g}"
