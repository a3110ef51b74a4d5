"""A campaign's scores as tables, for a page and for Markdown, and as plain data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.files.plain import SCHEMA_VERSION, attributes
from gtmbench.report.markup import markdown_table
from gtmbench.report.words.study import (
    rate_words,
    seconds_words,
    severity_unit,
    severity_words,
    share_words,
    verdict_lines,
)
from gtmbench.report.words.units import counted
from gtmbench.study.scores.intervals import Estimate, Share
from gtmbench.study.scores.ranking import Rank
from gtmbench.study.scores.scoring import DetectorScores, Merits, Scores


class Cell(NamedTuple):
    """What stands in a cell, and what it is sorted by."""

    text: str
    key: float | str | None = None

    @property
    def kind(self) -> str:
        """What it holds: a number, which is sorted as one, a name, or words."""
        is_figure = isinstance(self.key, float) or self.text == "-"
        return "number" if is_figure else "name" if self.key is not None else "words"


Line = dict[str, Cell]  # by column


@dataclass(frozen=True, kw_only=True)
class ScoreTable:
    """A table."""

    # title, note: the note says what its figures are
    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    @classmethod
    def of(cls, title: str, note: str, lines: Iterable[Line]) -> ScoreTable:
        """Return the table of lines that have the same columns."""
        rows = list(lines)
        columns = tuple(rows[0]) if rows else ()
        return cls(title=title, note=note, columns=columns, rows=tuple(tuple(row.values()) for row in rows))

    def markdown(self) -> str:
        """Return it as Markdown."""
        return markdown_table(self.columns, [[cell.text for cell in row] for row in self.rows])


def tables(scores: Scores) -> list[ScoreTable]:
    """Return the tables of a campaign, those left out that would be empty."""
    of_all = [_detectors(scores), _luck_table(scores), _delay_table(scores), _names_table(scores)]
    made = [*of_all, _split(scores, "fault"), _split(scores, "channel"), _pairs(scores), _smallest(scores)]
    return [table for table in made if table.rows]


_SENSORS = {"right sensor": "right", "wrong sensor": "wrong"}


def _detectors(scores: Scores) -> ScoreTable:
    places = {rank.detector: rank for rank in scores.ranks}

    def line(one: DetectorScores) -> Line:
        lost = one.merits.failed if one.merits else 0
        failed = f"{counted(lost, 'trial')} failed: missed" if lost else ""
        return {
            "place": place_cell(places.get(one.name)),
            "detector": Cell(one.name, one.name),
            "false alarms an hour": Cell(rate_words(one.false_alarms), _key(one.false_alarms.value)),
            **_detection(one.merits),
            **_each(_share, getattr(one.merits, "naming", None), _SENSORS),
            "remark": Cell("no score: " + one.no_score if one.no_score else failed),
        }

    return ScoreTable.of(
        "Detectors",
        "Figures are of all trials, with 95 % intervals over flights. Detected: an alarm at or after the onset; "
        f"in time: within {scores.deadline_s:g} s. Delays are those of the detected. A place such as 1-2 is shared: no "
        "test tells those apart.",
        map(line, ordered(scores)),
    )


def _luck_table(scores: Scores) -> ScoreTable:
    return ScoreTable.of(
        "Luck of the calibration",
        "Calibrated on other such flights 95 % of a detector's thresholds stay within so many times (thresholds "
        "drawn anew from its flights, with replacement). The rest is what its figures would be with all thresholds "
        "lower by that much, and higher: by when half of all faults are detected, how many are, in how many healthy "
        "records there is an alarm, and the places that it may have.",
        (
            {
                "detector": Cell(one.name, one.name),
                "within (times)": _seconds(one.luck.within),
                "half within (s)": range_cell(one.luck.median_s),
                "detected": Cell("{} to {}".format(*one.luck.detected), float(one.luck.detected[0])),
                "healthy records with an alarm": Cell("{} to {}".format(*one.luck.alarmed), float(one.luck.alarmed[0])),
                "place": place_cell(one.luck.place),
            }
            for one in ordered(scores)
            if one.luck
        ),
    )


def range_cell(ends_s: tuple[float, float]) -> Cell:
    """Return two times, one where they are the same; infinite ones were missed."""
    low, high = (f"{end_s:.2f}" if end_s < float("inf") else "missed" for end_s in ends_s)
    return Cell(low if low == high else f"{low} to {high}", ends_s[0])


def _delay_table(scores: Scores) -> ScoreTable:
    return ScoreTable.of(
        "Delays",
        "Of detected faults, from the onset to when the alarm could be raised. Look-ahead is the part that is "
        "waited for samples to come. Windows: the part of the mean in which the window that alarmed fills with broken "
        "samples; the rest has passed before it began.",
        (
            {
                "detector": Cell(one.name, one.name),
                **_each(_estimate, found, {"mean (s)": "mean", "median (s)": "median", "95 % (s)": "most"}),
                **_each(
                    _seconds, found, {"worst (s)": "worst", "look-ahead (s)": "look_ahead", "windows (s)": "windows"}
                ),
                "median (samples)": _count(round(found.median.value / SAMPLE_PERIOD_S)),
                "worst (samples)": _count(round(found.worst / SAMPLE_PERIOD_S)),
            }
            for one in ordered(scores)
            if one.merits and (found := one.merits.delays)
        ),
    )


def _names_table(scores: Scores) -> ScoreTable:
    others = {"can't tell": "undecided", "missed": "missed", "axis right": "axis_right", "kind right": "kind_right"}
    return ScoreTable.of(
        "Names",
        "Of all trials: the right sensor named, a wrong one, none (it can't tell), or missed; beside these, all "
        "that is left possible on the axis that failed (p or phi, q or theta, r or psi), and the kind of fault.",
        (
            {"detector": Cell(one.name, one.name), **_each(_share, one.merits.naming, _SENSORS | others)}
            for one in ordered(scores)
            if one.merits and one.merits.naming
        ),
    )


def ordered(scores: Scores) -> list[DetectorScores]:
    """Return detectors by their places, among shared ones by what is detected in time; those without one last."""
    places = {rank.detector: (rank.best, rank.worst) for rank in scores.ranks}

    def order(one: DetectorScores) -> tuple[float, float, float]:
        in_time = one.merits.in_time.value if one.merits else None
        return *places.get(one.name, (float("inf"), 0.0)), -(in_time or 0.0)

    return sorted(scores.detectors, key=order)


def place_cell(place: Rank | None) -> Cell:
    """Return a place, or those that are shared."""
    if place is None:
        return Cell("-")
    best, worst = place.best, place.worst
    return Cell(f"{best}" if best == worst else f"{best}-{worst}", best + worst / 1000.0)


def _each(write: Callable[[Any], Cell], of: object, columns: Mapping[str, str]) -> Line:
    """Return a cell a column: a figure of something, by its name; dashes where there is nothing."""
    return {column: write(getattr(of, name, None)) for column, name in columns.items()}


def _detection(found: Merits | None) -> Line:
    delays = getattr(found, "delays", None)
    return {
        **_each(_share, found, {"detected": "detected", "in time": "in_time"}),
        **_each(_estimate, delays, {"median (s)": "median", "95 % (s)": "most"}),
    }


def _name(name: str) -> Cell:
    return Cell(name.replace("_", " "), name)


def _count(count: int) -> Cell:
    return Cell(f"{count}", float(count))


def _share(found: Share | None) -> Cell:
    return Cell("-") if found is None else Cell(share_words(found), _key(found.value))


def _estimate(found: Estimate | None) -> Cell:
    return Cell("-") if found is None else Cell(seconds_words(found), found.value)


def _seconds(value: float | None) -> Cell:
    return Cell("-") if value is None else Cell(f"{value:.2f}", value)


def _key(value: float | None) -> float | None:
    return None if value is None else float(value)


def _pairs(scores: Scores) -> ScoreTable:
    return ScoreTable.of(
        "Which is sooner",
        "On the very same trials, in how many the first of two alarmed sooner, in how many later; one that misses "
        "is later. Flights are what a permutation test draws; p is corrected for all pairs (Holm).",
        (
            {
                "first": Cell(pair.first, pair.first),
                "second": Cell(pair.second, pair.second),
                **_each(_count, pair, {"first sooner": "sooner", "second sooner": "later", "tie": "tied"}),
                "advantage": Cell(_advantage(pair.advantage), pair.advantage.value),
                "p": Cell(f"{pair.p:.2g}", pair.p),
                "sooner": Cell(pair.better or "not significant", pair.better or ""),
            }
            for pair in scores.comparisons
        ),
    )


def _advantage(found: Estimate) -> str:
    if found.low is None or found.high is None:
        return f"{found.value:+.2f}"
    return f"{found.value:+.2f} [{found.low:+.2f}, {found.high:+.2f}]"


def _split(scores: Scores, by: str) -> ScoreTable:
    """Return a line a detector and kind of fault, or channel."""
    return ScoreTable.of(
        {"fault": "Kinds of faults", "channel": "Channels that break"}[by],
        "As above, of each alone; of several faults in one record it is the first.",
        (
            {
                "detector": Cell(one.name, one.name),
                by: _name(name),
                "trials": _count(found.trials),
                **_detection(found),
                **_each(_seconds, found.delays, {"worst (s)": "worst"}),
                **_each(_share, found.naming, {**_SENSORS, "can't tell": "undecided", "kind right": "kind_right"}),
            }
            for one in scores.detectors
            for name, found in (one.faults if by == "fault" else one.channels).items()
        ),
    )


def _smallest(scores: Scores) -> ScoreTable:
    return ScoreTable.of(
        "Smallest faults that are detected",
        "From which severity on a fault is detected in 90 % of the searches, one a flight and onset, at the "
        "thresholds that the detectors have; 'found' counts the searches in which any severity was detected.",
        (
            {
                "detector": Cell(one.name, one.name),
                "fault": _name(found.fault),
                "channel": Cell(found.channel, found.channel),
                "parameter": Cell(found.parameter, found.parameter),
                "smallest": Cell(severity_words(found), found.severity.value),
                "unit": Cell(severity_unit(found)),
                "found": Cell(f"{found.found.hits} of {found.found.of}", _key(found.found.value)),
            }
            for one in scores.detectors
            for found in one.smallest
        ),
    )


def confusions(scores: Scores) -> list[ScoreTable]:
    """Return every detector's, of sensors and of kinds: how often what was told of what was."""
    return [
        ScoreTable(
            title=f"{one.name}: {what}",
            note="A row is the sensor that broke, a column the verdict.",
            columns=("broken", *found.told),
            rows=tuple(
                (Cell(row, row), *map(_count, counts)) for row, counts in zip(found.injected, found.counts, strict=True)
            ),
        )
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
        **attributes(scores, "target_per_hour", "deadline_s", "detectors", "ranks", "comparisons"),
        **about,
    }
