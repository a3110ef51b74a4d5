"""A campaign's scores as tables, for a page and for Markdown, and as plain data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.report.words.scores import (
    rate_words,
    seconds_words,
    severity_unit,
    severity_words,
    share_words,
    verdict_lines,
)
from gtmbench.report.words.units import counted, or_dash
from gtmbench.study.scores.intervals import Estimate, Rate, Share
from gtmbench.study.scores.scoring import Confusion, Delays, Merits, Scores

SCHEMA = 1
_MARKS = {mark: f"&#{ord(mark)};" for mark in "|`*_\\()!#"} | {"&": "&amp;", "<": "&lt;"}  # of Markdown and HTML


class Cell(NamedTuple):
    """What stands in a cell, and what it is sorted by."""

    text: str
    key: float | str | None = None

    @property
    def kind(self) -> str:
        """What it holds: a number, which is sorted as one, a name, or words."""
        is_figure = isinstance(self.key, float) or self.text == "-"
        return "number" if is_figure else "name" if self.key is not None else "words"


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table.

    Attributes
    ----------
    title, note : str
        The note says what its figures are.
    columns : tuple of str
    rows : tuple of tuple of Cell
    """

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def markdown(self) -> str:
        """Return it as Markdown."""
        lines = [self.columns, ["---"] * len(self.columns), *[[cell.text for cell in row] for row in self.rows]]
        return "\n".join("| " + " | ".join(map(in_markdown, line)) + " |" for line in lines)


def in_markdown(text: str) -> str:
    """Return a text that Markdown shows as it is, in one line.

    >>> in_markdown("a|b <script>")
    'a&#124;b &lt;script>'
    """
    return " ".join("".join(_MARKS.get(letter, letter) for letter in text).split())


def tables(scores: Scores) -> list[Table]:
    """Return the tables of a campaign, those left out that would be empty."""
    made = [_detectors(scores), _pairs(scores), _split(scores, "fault"), _split(scores, "channel"), _smallest(scores)]
    return [table for table in made if table.rows]


def _detectors(scores: Scores) -> Table:
    places = {rank.detector: rank for rank in scores.ranks}
    rows = []
    for one in scores.detectors:
        place = places.get(one.name)
        found = one.merits
        delays = found.delays if found else None
        rows.append(
            (
                _place(place.best, place.worst) if place else Cell("-", float("inf")),
                Cell(one.name, one.name),
                _rate(one.false_alarms),
                *_shares([found.detected, found.in_time] if found else [None, None]),
                *_delays(delays),
                *_naming(found),
                Cell("no score: " + one.no_score if one.no_score else _failed(found)),
            )
        )
    rows.sort(key=lambda row: (str(row[0].key == float("inf")), row[0].key or 0.0))
    return Table(
        title="Detectors",
        note=f"Shares and delays with 95 % intervals, over flights. Detected: an alarm at or after the onset; in time: "
        f"within {scores.deadline_s:g} s. Delays are of detected faults, since the onset; in samples they are "
        f"{1 / SAMPLE_PERIOD_S:g} times as many; look-ahead is the part that is waited for samples to come, and what "
        "windows take is in the rest. A place such as 1-2 is shared: no test tells them apart.",
        columns=(
            "place",
            "detector",
            "false alarms an hour",
            "detected",
            "in time",
            "mean (s)",
            "median (s)",
            "95 % (s)",
            "worst (s)",
            "look-ahead (s)",
            "right sensor",
            "wrong sensor",
            "can't tell",
            "kind right",
            "remark",
        ),
        rows=tuple(rows),
    )


def _place(best: int, worst: int) -> Cell:
    return Cell(f"{best}" if best == worst else f"{best}-{worst}", best + worst / 1000.0)


def _failed(found: Merits | None) -> str:
    return f"{counted(found.failed, 'trial')} failed: missed" if found and found.failed else ""


def _rate(found: Rate) -> Cell:
    return Cell(rate_words(found), _key(found.value))


def _shares(found: Sequence[Share | None]) -> Iterator[Cell]:
    for one in found:
        yield Cell("-") if one is None else Cell(share_words(one), _key(one.value))


def _delays(found: Delays | None) -> Iterator[Cell]:
    for one in (None, None, None) if found is None else (found.mean, found.median, found.most):
        yield _seconds(one)
    for value in (None, None) if found is None else (found.worst, found.look_ahead):
        yield Cell(or_dash(value, ".2f"), value)


def _seconds(found: Estimate | None) -> Cell:
    return Cell(seconds_words(found), None if found is None else found.value)


def _naming(found: Merits | None) -> Iterator[Cell]:
    own = found.naming if found else None
    return _shares([own.right, own.wrong, own.undecided, own.kind_right] if own else [None] * 4)


def _key(value: float | None) -> float | None:
    return None if value is None else float(value)


def _pairs(scores: Scores) -> Table:
    rows = [
        (
            Cell(pair.first, pair.first),
            Cell(pair.second, pair.second),
            Cell(f"{pair.sooner}", float(pair.sooner)),
            Cell(f"{pair.later}", float(pair.later)),
            Cell(f"{pair.tied}", float(pair.tied)),
            Cell(_advantage(pair.advantage), pair.advantage.value),
            Cell(f"{pair.p:.2g}", pair.p),
            Cell(pair.better or "can't be told apart", pair.better or ""),
        )
        for pair in scores.comparisons
    ]
    return Table(
        title="Which is sooner",
        note="On the very same trials, in how many the first of two alarmed sooner, in how many later; one that misses "
        "is later. Flights are what a permutation test draws; p is corrected for all pairs (Holm).",
        columns=("first", "second", "first sooner", "second sooner", "tie", "advantage", "p", "sooner"),
        rows=tuple(rows),
    )


def _advantage(found: Estimate) -> str:
    if found.low is None or found.high is None:
        return f"{found.value:+.2f}"
    return f"{found.value:+.2f} [{found.low:+.2f}, {found.high:+.2f}]"


def _split(scores: Scores, by: str) -> Table:
    """Return a line a detector and kind of fault, or channel."""
    rows = [
        (
            Cell(one.name, one.name),
            Cell(name.replace("_", " "), name),
            Cell(f"{found.trials}", float(found.trials)),
            *_shares([found.detected, found.in_time]),
            *list(_delays(found.delays))[1:4],
            *_naming(found),
        )
        for one in scores.detectors
        for name, found in (one.faults if by == "fault" else one.channels).items()
    ]
    return Table(
        title={"fault": "Kinds of faults", "channel": "Channels that break"}[by],
        note="As above, of each alone; of several faults in one record it is the first.",
        columns=(
            "detector",
            by,
            "trials",
            "detected",
            "in time",
            "median (s)",
            "95 % (s)",
            "worst (s)",
            "right sensor",
            "wrong sensor",
            "can't tell",
            "kind right",
        ),
        rows=tuple(rows),
    )


def _smallest(scores: Scores) -> Table:
    rows = [
        (
            Cell(one.name, one.name),
            Cell(found.fault.replace("_", " "), found.fault),
            Cell(found.channel, found.channel),
            Cell(found.parameter, found.parameter),
            Cell(severity_words(found), found.severity.value),
            Cell(severity_unit(found)),
            Cell(f"{found.found.hits} of {found.found.of}", _key(found.found.value)),
        )
        for one in scores.detectors
        for found in one.smallest
    ]
    return Table(
        title="Smallest faults that are detected",
        note="From which severity on a fault is detected in 90 % of the searches, one a flight and onset, at the "
        "thresholds that the detectors have; 'found' counts the searches in which any severity was detected.",
        columns=("detector", "fault", "channel", "parameter", "smallest", "unit", "found"),
        rows=tuple(rows),
    )


def confusion_table(name: str, what: str, found: Confusion) -> Table:
    """Return how often what was told of what was, by a detector."""
    return Table(
        title=f"{name}: {what}",
        note="A row is what broke, a column what was said of it.",
        columns=("broken", *found.told),
        rows=tuple(
            (Cell(row, row), *(Cell(f"{count}", float(count)) for count in counts))
            for row, counts in zip(found.injected, found.counts, strict=True)
        ),
    )


def confusions(scores: Scores) -> list[Table]:
    """Return every detector's, of sensors and of kinds."""
    return [
        confusion_table(one.name, what, found)
        for one in scores.detectors
        for what, found in (("which sensor", one.sensors), ("which kind", one.kinds))
        if found is not None
    ]


def scores_results(scores: Scores, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return scores as one JSON-ready object, schema 1; a detector without a score has None for it, and says why."""
    return {
        "schema": SCHEMA,
        "verdict": verdict_lines(scores),
        "target_per_hour": scores.target_per_hour,
        "deadline_s": scores.deadline_s,
        "detectors": scores.detectors,
        "ranks": scores.ranks,
        "comparisons": scores.comparisons,
        **about,
    }
