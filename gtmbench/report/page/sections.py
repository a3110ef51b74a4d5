"""What a campaign's report says, made of its parts, before it is a page, Markdown or JSON."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from gtmbench.errors import InputError
from gtmbench.files.shipped import shipped_campaigns
from gtmbench.jobs.parts import Parts
from gtmbench.report.figures.delays import delay_figure
from gtmbench.report.figures.scores import delay_curves, price_curves, smallest_figure
from gtmbench.report.style import strokes
from gtmbench.report.tables.scores import ScoreTable, confusions, tables
from gtmbench.report.words.scores import verdict_lines
from gtmbench.report.words.units import counted
from gtmbench.study.campaign.conduct import flights_of
from gtmbench.study.scores.scoring import DEADLINE_S, READ, TARGET_PER_HOUR, Scores, scored

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FEWEST_RECORDS = 10  # that show how often healthy scores rise


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

    @cached_property
    def confusions(self) -> list[ScoreTable]:
        """What was told of what was."""
        return confusions(self.scores)

    def figures(self) -> dict[str, list[tuple[str, Figure]]]:
        """Return figures and what they show, by the title of the table that they belong to."""
        found: dict[str, list[tuple[str, Figure]]] = {}
        scores, first = self.scores, self.tables[0].title if self.tables else ""
        styles = strokes(one.name for one in scores.detectors)
        if scores.delays_s:
            words = "What share of all faults each detector has detected by when; missed ones never"
            found.setdefault(first, []).append(
                (words, delay_figure(scores.delays_s, deadline_s=scores.deadline_s, styles=styles))
            )
        with_curve = [one for one in scores.detectors if one.curve and one.healthy_records >= _FEWEST_RECORDS]
        if with_curve:
            words = (
                "Detection against false alarms (ROC), had all thresholds of a detector been multiplied by a factor; "
                "markers: as they are"
            )
            found.setdefault(first, []).append((words, price_curves(with_curve, scores.target_per_hour, styles)))
        with_price = [one for one in with_curve if one.price]
        if with_price:
            words = (
                "Delay against false alarms, had all thresholds of a detector been multiplied by a factor from 0.4 to "
                "5; what is missed is infinitely late; markers: as they are"
            )
            found.setdefault(first, []).append((words, delay_curves(with_price, scores.target_per_hour, styles)))
        with_smallest = [one for one in scores.detectors if one.smallest]
        if with_smallest:
            words = (
                "Smallest fault detected in 90 % of the searches, with 95 % intervals; open arrows: beyond the severest"
            )
            found.setdefault(self.tables[-1].title, []).append((words, smallest_figure(with_smallest, styles)))
        return found

    def run(self) -> list[tuple[str, str]]:
        """Return what was run, in words by name."""
        campaign = self.campaign
        calibration = campaign["calibration"]
        rate = calibration["false_alarms_per_hour"]
        return [
            ("campaign", str(campaign["name"])),
            ("detectors", ", ".join(campaign["detectors"])),
            ("scenarios", ", ".join(campaign["scenarios"])),
            *[(f"axis {name}", _words(values)) for name, values in campaign["axes"].items()],
            *[(f"healthy {name}", _words(values)) for name, values in (campaign["healthy"] or {}).items()],
            ("noise and seed", "; ".join(dict.fromkeys(map(_setup_words, campaign["scenarios"].values())))),
            ("calibrated on", ", ".join(f"{name} {_words(value)}" for name, value in calibration.items() if value)),
            ("thresholds", _rate_text(rate) if rate else "as each detector sets its own"),
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
    """Score what stands in a campaign's folder.

    `target_per_hour`: False alarms; unless told, what the campaign calibrates for, or one an hour.
    """
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


def _rate_text(rate: float) -> str:
    return f"for {rate:g} false alarms an hour, extrapolated; what healthy records show of it stands in the first table"


def _words(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _setup_words(scenario: Mapping[str, Any]) -> str:
    setup = scenario["setup"]
    noise = setup["noise"] or f"snr {setup['snr']}"
    return f"{setup['aircraft']}, {setup['excitation']}, {setup['duration_s']:g} s, noise {noise}, seed {setup['seed']}"
