"""A campaign's report, made of its parts: one page that needs nothing else, Markdown, JSON, or one short table."""

from __future__ import annotations

import shlex
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.files.plain import dumps, plain
from gtmbench.files.shipped import shipped_campaigns
from gtmbench.jobs.parts import Parts
from gtmbench.report.figures.panels import figure_bytes
from gtmbench.report.figures.scores import delay_curves, delay_figure, price_curves, smallest_figure
from gtmbench.report.markup import html_page, in_markdown, picture
from gtmbench.report.style import strokes
from gtmbench.report.tables.scores import (
    Cell,
    ScoreTable,
    confusions,
    ordered,
    place_cell,
    range_cell,
    scores_results,
    tables,
)
from gtmbench.report.words.study import verdict_lines
from gtmbench.report.words.units import counted
from gtmbench.study.campaign.conduct import flights_of
from gtmbench.study.scores.scoring import DEADLINE_S, READ, TARGET_PER_HOUR, DetectorScores, Scores, scored
from gtmbench.values.record import FloatArray
from gtmbench.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OF_CURVES = (
    "Detection against false alarms (ROC), had all thresholds of a detector been multiplied by a factor; markers: as "
    "they are"
)
_OF_PRICES = (
    "Delay against false alarms, had all thresholds of a detector been multiplied by a factor from 0.4 to 5; what is "
    "missed is infinitely late; markers: as they are"
)
_OF_SMALLEST = "Smallest fault detected in 90 % of the searches, with 95 % intervals; open arrows: beyond the severest"
_OF_RATE = "for {:g} false alarms an hour, extrapolated; what healthy records show of it stands in the first table"
_MOST_ROWS = 14  # of the short table
_COLUMNS = (
    *("place", "detector", "detected", "half within (s)", "95 % within (s)", "right / wrong sensor"),
    "false alarms: an hour at most",
)


@dataclass(frozen=True, kw_only=True)
class Contents:
    """A campaign's report."""

    facts: dict[str, Any]  # what was run: of the campaign, versions, monitors
    # tasks, done: flights that there are, and that are finished
    tasks: int
    done: int
    scores: Scores

    @property
    def campaign(self) -> dict[str, Any]:
        """What the campaign is."""
        return dict(self.facts["campaign"])

    @property
    def title(self) -> str:
        """The campaign's."""
        return str(self.campaign["title"])

    @property
    def summary(self) -> str:
        """What it is of, in a line."""
        trials = max((one.merits.trials for one in self.scores.detectors if one.merits), default=0)
        records = max((one.healthy_records for one in self.scores.detectors), default=0)
        return (
            f"Campaign {self.campaign['name']}: {counted(self.done, 'flight')}, {counted(trials, 'fault')}, "
            f"{counted(records, 'healthy record')}, {counted(len(self.scores.detectors), 'detector')}"
        )

    @cached_property
    def verdict(self) -> list[str]:
        """What it comes to."""
        missing = self.tasks - self.done
        unfinished = f"Not finished: {missing} of {counted(self.tasks, 'flight')} are still to be flown (--resume)."
        return [*verdict_lines(self.scores), *[unfinished] * bool(missing)]

    @cached_property
    def tables(self) -> list[ScoreTable]:
        """All that have rows."""
        return tables(self.scores)

    def figures(self) -> dict[str, list[tuple[str, Figure]]]:
        """Return figures and what they show, by the title of the table that they belong to."""
        found: dict[str, list[tuple[str, Figure]]] = defaultdict(list)
        scores, target = self.scores, self.scores.target_per_hour
        first = found[self.tables[0].title if self.tables else ""]
        styles = strokes(one.name for one in scores.detectors)
        if scores.delays_s:
            figure = delay_figure(scores.delays_s, deadline_s=scores.deadline_s, styles=styles)
            first.append(("What share of all faults each detector has detected by when; missed ones never", figure))
        # fewer records don't show how often healthy scores rise
        with_curve = [one for one in scores.detectors if one.curve and one.healthy_records >= 10]
        if with_curve:
            first.append((_OF_CURVES, price_curves(with_curve, target, styles)))
        with_price = [one for one in with_curve if one.price]
        if with_price:
            first.append((_OF_PRICES, delay_curves(with_price, target, styles)))
        with_smallest = [one for one in scores.detectors if one.smallest]
        if with_smallest:
            found[self.tables[-1].title].append((_OF_SMALLEST, smallest_figure(with_smallest, styles)))
        return found

    def run(self) -> list[tuple[str, str]]:
        """Return what was run, in words by name."""
        campaign, calibration = self.campaign, self.campaign["calibration"]
        rate = calibration["false_alarms_per_hour"]
        return [
            ("campaign", str(campaign["name"])),
            ("detectors", ", ".join(campaign["detectors"])),
            ("scenarios", ", ".join(campaign["scenarios"])),
            *[(f"axis {name}", _words(values)) for name, values in campaign["axes"].items()],
            *[(f"healthy {name}", _words(values)) for name, values in (campaign["healthy"] or {}).items()],
            ("noise and seed", "; ".join(dict.fromkeys(map(_setup_words, campaign["scenarios"].values())))),
            ("calibrated on", ", ".join(f"{name} {_words(value)}" for name, value in calibration.items() if value)),
            ("thresholds", _OF_RATE.format(rate) if rate else "as each detector sets its own"),
            ("target, deadline", f"{self.scores.target_per_hour:g} false alarms an hour, {self.scores.deadline_s:g} s"),
            *[(f"{name}", str(value)) for name, value in self.facts["versions"].items()],
            *[(name, str(digest)) for name, digest in self.facts.get("monitors", {}).items()],
        ]

    def commands(self) -> str:
        """Return what repeats it."""
        name = str(self.campaign["name"])
        source = name if name in shipped_campaigns() else f"{name}.toml"
        options = f"--false-alarms-per-hour {self.scores.target_per_hour:g} --deadline {self.scores.deadline_s:g}"
        return (
            f"gtmbench campaign {shlex.quote(source)} --out {shlex.quote(name)}\n"
            f"gtmbench campaign {shlex.quote(name)} --report html {options}"
        )


def contents_of(parts: Parts, *, target_per_hour: float | None = None, deadline_s: float = DEADLINE_S) -> Contents:
    """Score a campaign's folder; false alarms unless told as the campaign calibrates for, or one an hour."""
    if parts.what != "campaign":
        raise InputError(f"{parts.folder} holds parts of a {parts.what}, no campaign's; a report is of a campaign")
    flights, done = flights_of(parts)
    if not done:
        raise InputError(f"nothing of {parts.folder} is finished yet: run gtmbench campaign ... --resume first")
    if target_per_hour is None:
        target_per_hour = parts.facts["campaign"]["calibration"]["false_alarms_per_hour"] or TARGET_PER_HOUR
    rows = parts.read(list(READ)).to_pandas()
    spreads = parts.facts.get("threshold_spreads", {})
    scores = scored(rows, target_per_hour=target_per_hour, deadline_s=deadline_s, spreads=spreads)
    return Contents(facts=parts.facts, tasks=flights, done=done, scores=scores)


def _words(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _setup_words(scenario: Mapping[str, Any]) -> str:
    setup = scenario["setup"]
    noise = setup["noise"] or f"snr {setup['snr']}"
    return f"{setup['aircraft']}, {setup['excitation']}, {setup['duration_s']:g} s, noise {noise}, seed {setup['seed']}"


def who_sees_what(scores: Scores) -> str:
    """Return the table, best first; what is missed is infinitely late, places that no test tells apart are shared.

    In brackets: with thresholds as low, and as high, as other calibrations would have set them. Of more than fourteen
    detectors the last are named below it; so are those without a score, with the reason.
    """
    best_first = [one for one in ordered(scores) if one.merits and one.name in scores.delays_s]
    places = {rank.detector: rank for rank in scores.ranks}
    rows = tuple(
        (place_cell(places.get(one.name)), *map(Cell, (one.name, *_cells(one, scores.delays_s[one.name]))))
        for one in best_first[:_MOST_ROWS]
    )
    left = [one.name for one in best_first[_MOST_ROWS:]]
    notes = [f"Behind these: {listed(left)}."] if left else []
    loud = [f"{one.name} ({_quiet(one)} at least)" for one in scores.detectors if not one.is_quiet]
    target = f"{scores.target_per_hour:g} false alarms an hour are refuted for"
    notes += [f"No score, since {target} {listed(loud)}."] if loud else []
    table = ScoreTable(title="", note="", columns=_COLUMNS, rows=rows)
    return "\n".join([table.markdown(), *["\n" + in_markdown(note) for note in notes]]) + "\n"


def _cells(one: DetectorScores, delays_s: FloatArray) -> tuple[str, ...]:
    found = one.merits
    assert found is not None
    naming = found.naming
    return (
        f"{found.detected.hits} of {found.detected.of}",
        _within(delays_s, 0.5)
        + (f" ({range_cell(one.luck.median_s).text})" if one.luck and found.detected.hits else ""),
        _within(delays_s, 0.95),
        f"{naming.right.hits} / {naming.wrong.hits}" if naming else "-",
        _quiet(one),
    )


def _quiet(one: DetectorScores) -> str:
    """Say how many false alarms there were, and what rate that bounds: from above, where there is a score."""
    found = one.false_alarms
    return f"{found.events} in {found.hours:.2g} h: {found.high if one.is_quiet else found.low:.2g}"


def _within(delays_s: FloatArray, share: float) -> str:
    """Return by when a share of all faults is detected, a delay that was measured."""
    delay_s = float(np.quantile(delays_s, share, method="higher"))
    return f"{delay_s:.2f}" if np.isfinite(delay_s) else "missed"


def page(contents: Contents) -> str:
    """Return the report as one HTML page."""
    return html_page(
        "campaign.html.j2",
        "sort.js",
        title=contents.title,
        summary=contents.summary,
        verdict=contents.verdict,
        tables=contents.tables,
        figures={
            title: [(_drawn(figure), caption) for caption, figure in own] for title, own in contents.figures().items()
        },
        confusions=[(table, _shades(table)) for table in confusions(contents.scores)],
        facts=contents.run(),
        commands=contents.commands(),
        made_by=f"Made by gtmbench {__version__} from the parts of the campaign.",
    )


def _drawn(figure: Figure) -> str:
    """Return a figure as an image that stands in the page; the same figure, the same bytes."""
    import matplotlib as mpl

    with mpl.rc_context({"svg.hashsalt": "gtmbench"}):
        return picture(figure_bytes(figure, format="svg", metadata={"Date": None}), "svg+xml")


def _shades(table: ScoreTable) -> list[list[str]]:
    """Return what a table of counts looks like: the darker, the more of its row."""
    shades = []
    for row in table.rows:
        counts = [cell.key if isinstance(cell.key, float) else None for cell in row]
        whole = sum(filter(None, counts)) or 1.0
        shades.append(
            [
                "" if count is None else f"background: rgba(0, 114, 178, {0.55 * (count / whole):.2f})"
                for count in counts
            ]
        )
    return shades


def markdown(contents: Contents) -> str:
    """Return the report as Markdown; figures are the page's."""
    lines = [f"# {in_markdown(contents.title)}", "", in_markdown(contents.summary), ""]
    lines += [f"- {in_markdown(line)}" for line in contents.verdict]
    for table in [*contents.tables, *confusions(contents.scores)]:
        lines += ["", f"## {in_markdown(table.title)}", in_markdown(table.note), "", table.markdown()]
    lines += ["", "## What was run, and how to repeat it"]
    lines += [f"- {in_markdown(name)}: {in_markdown(value)}" for name, value in contents.run()]
    lines += ["", *[f"    {line}" for line in contents.commands().splitlines()]]
    return "\n".join(lines) + "\n"


def data(contents: Contents) -> str:
    """Return the report as JSON: all figures, as they are."""
    about = {
        "campaign": contents.campaign["name"],
        "title": contents.title,
        "flights": contents.tasks,
        "flights_done": contents.done,
        "facts": contents.facts,
        "repeat": contents.commands().splitlines(),
    }
    return dumps(plain(scores_results(contents.scores, about)), indent=2) + "\n"


FORMATS: Mapping[str, Callable[[Contents], str]] = {
    "html": page,
    "md": markdown,
    "json": data,
    "table": lambda contents: who_sees_what(contents.scores),
}
