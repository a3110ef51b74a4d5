"""A campaign's scores as tables, for a page and for Markdown, and as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.report.tables.envelope import SCHEMA_VERSION
from gtmbench.report.words.scores import (
    rate_words,
    seconds_words,
    severity_unit,
    severity_words,
    share_words,
    verdict_lines,
)
from gtmbench.report.words.units import counted
from gtmbench.study.scores.compare import Rank
from gtmbench.study.scores.intervals import Estimate, Rate, Share
from gtmbench.study.scores.scoring import Confusion, Delays, DetectorScores, Merits, Scores

_MARKS = {mark: f"&#{ord(mark)};" for mark in "|`*\\"} | {"&": "&amp;", "<": "&lt;"}  # of Markdown and HTML


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
    return " ".join("".join(_MARKS.get(letter, letter) for letter in text).replace("](", "]&#40;").split())


def tables(scores: Scores) -> list[Table]:
    """Return the tables of a campaign, those left out that would be empty."""
    of_all = [_detectors(scores), _luck_table(scores), _delay_table(scores), _names_table(scores)]
    made = [*of_all, _split(scores, "fault"), _split(scores, "channel"), _pairs(scores), _smallest(scores)]
    return [table for table in made if table.rows]


def _detectors(scores: Scores) -> Table:
    places = {rank.detector: rank for rank in scores.ranks}
    rows = []
    for one in ordered(scores):
        found, place = one.merits, places.get(one.name)
        row = (
            place_cell(place.best, place.worst) if place else Cell("-"),
            Cell(one.name, one.name),
            _rate(one.false_alarms),
            *_shares([found.detected, found.in_time] if found else [None, None]),
            *_delays(found.delays if found else None)[1:3],
            *_naming(found)[:2],
            Cell("no score: " + one.no_score if one.no_score else _failed(found)),
        )
        rows.append(row)
    return Table(
        title="Detectors",
        note="Figures are of all trials, with 95 % intervals over flights. Detected: an alarm at or after the onset; "
        f"in time: within {scores.deadline_s:g} s. Delays are those of the detected. A place such as 1-2 is shared: no "
        "test tells those apart.",
        columns=(
            "place",
            "detector",
            "false alarms an hour",
            "detected",
            "in time",
            "median (s)",
            "95 % (s)",
            "right sensor",
            "wrong sensor",
            "remark",
        ),
        rows=tuple(rows),
    )


def _luck_table(scores: Scores) -> Table:
    rows = [
        (
            Cell(one.name, one.name),
            Cell(f"{one.luck.within:.2f}", one.luck.within),
            range_cell(one.luck.median_s),
            Cell("{} to {}".format(*one.luck.detected), float(one.luck.detected[0])),
            Cell("{} to {}".format(*one.luck.alarmed), float(one.luck.alarmed[0])),
            place_cell(one.luck.place.best, one.luck.place.worst) if one.luck.place else Cell("-"),
        )
        for one in ordered(scores)
        if one.luck
    ]
    return Table(
        title="Luck of the calibration",
        note="Calibrated on other such flights 95 % of a detector's thresholds stay within so many times (thresholds "
        "drawn anew from its flights, with replacement). The rest is what its figures would be with all thresholds "
        "lower by that much, and higher: by when half of all faults are detected, how many are, in how many healthy "
        "records there is an alarm, and the places that it may have.",
        columns=("detector", "within (times)", "half within (s)", "detected", "healthy records with an alarm", "place"),
        rows=tuple(rows),
    )


def range_cell(ends_s: tuple[float, float]) -> Cell:
    """Return two times, one where they are the same; infinite ones were missed.

    >>> range_cell((0.31, 0.334)).text, range_cell((8.0, float("inf"))).text
    ('0.31 to 0.33', '8.00 to missed')
    """
    low, high = (f"{end_s:.2f}" if end_s < float("inf") else "missed" for end_s in ends_s)
    return Cell(low if low == high else f"{low} to {high}", ends_s[0])


def _delay_table(scores: Scores) -> Table:
    rows = [
        (Cell(one.name, one.name), *_delays(one.merits.delays), *_samples(one.merits.delays))
        for one in ordered(scores)
        if one.merits and one.merits.delays
    ]
    return Table(
        title="Delays",
        note="Of detected faults, from the onset to when the alarm could be raised. Look-ahead is the part that is "
        "waited for samples to come. Windows: the part of the mean in which the window that alarmed fills with broken "
        "samples; the rest has passed before it began.",
        columns=(
            "detector",
            "mean (s)",
            "median (s)",
            "95 % (s)",
            "worst (s)",
            "look-ahead (s)",
            "windows (s)",
            "median (samples)",
            "worst (samples)",
        ),
        rows=tuple(rows),
    )


def _samples(found: Delays) -> list[Cell]:
    samples = [round(value / SAMPLE_PERIOD_S) for value in (found.median.value, found.worst)]
    windows = Cell("-") if found.windows is None else Cell(f"{found.windows:.2f}", found.windows)
    return [windows, *[Cell(f"{value}", float(value)) for value in samples]]


def _names_table(scores: Scores) -> Table:
    rows = [
        (
            Cell(one.name, one.name),
            *_shares([own.right, own.wrong, own.undecided, own.missed, own.axis_right, own.kind_right]),
        )
        for one in ordered(scores)
        if one.merits and (own := one.merits.naming)
    ]
    return Table(
        title="Names",
        note="Of all trials: the right sensor named, a wrong one, none (it can't tell), or missed; beside these, all "
        "that is left possible on the axis that failed (p or phi, q or theta, r or psi), and the kind of fault.",
        columns=("detector", "right sensor", "wrong sensor", "can't tell", "missed", "axis right", "kind right"),
        rows=tuple(rows),
    )


def ordered(scores: Scores) -> list[DetectorScores]:
    """Return the detectors by their places; those without one last."""
    places = {rank.detector: rank for rank in scores.ranks}
    return sorted(scores.detectors, key=lambda one: _order(one, places))


def _order(one: DetectorScores, places: Mapping[str, Rank]) -> tuple[float, float, float]:
    """Return what detectors are ordered by: places, among shared ones what is detected in time; no score comes last."""
    place = places.get(one.name)
    in_time = one.merits.in_time.value if one.merits else None
    return (place.best, place.worst, -(in_time or 0.0)) if place else (float("inf"), 0.0, -(in_time or 0.0))


def place_cell(best: int, worst: int) -> Cell:
    """Return a place, or those that are shared."""
    return Cell(f"{best}" if best == worst else f"{best}-{worst}", best + worst / 1000.0)


def _failed(found: Merits | None) -> str:
    return f"{counted(found.failed, 'trial')} failed: missed" if found and found.failed else ""


def _rate(found: Rate) -> Cell:
    return Cell(rate_words(found), _key(found.value))


def _shares(found: Sequence[Share | None]) -> list[Cell]:
    return [Cell("-") if one is None else Cell(share_words(one), _key(one.value)) for one in found]


def _delays(found: Delays | None) -> list[Cell]:
    """Return mean, median, 95 %, worst and look-ahead."""
    if found is None:
        return [Cell("-")] * 5
    plain = [Cell(f"{value:.2f}", value) for value in (found.worst, found.look_ahead)]
    return [*map(_seconds, (found.mean, found.median, found.most)), *plain]


def _seconds(found: Estimate) -> Cell:
    return Cell(seconds_words(found), found.value)


def _naming(found: Merits | None) -> list[Cell]:
    """Return right, wrong, undecided, and the kind."""
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
            *_delays(found.delays)[1:4],
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


def first_and_rest(lines: Sequence[str]) -> tuple[str, list[dict[str, str]]]:
    """Return what a campaign comes to as a verdict, and what else is said of it as findings."""
    return lines[0], [{"text": line} for line in lines[1:]]


def scores_results(scores: Scores, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return scores as one JSON-ready object; a detector without a score has None for it, and says why."""
    verdict, findings = first_and_rest(verdict_lines(scores))
    return {
        "verdict": verdict,
        "findings": findings,
        "schema_version": SCHEMA_VERSION,
        "target_per_hour": scores.target_per_hour,
        "deadline_s": scores.deadline_s,
        "detectors": scores.detectors,
        "ranks": scores.ranks,
        "comparisons": scores.comparisons,
        **about,
    }
