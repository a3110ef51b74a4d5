"""A study flown with several seeds, in one table: a row a detector and fault, how often it was detected, how soon."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtmbench.files.plain import plain
from gtmbench.report.tables.envelope import SCHEMA_VERSION
from gtmbench.report.tables.results import false_alarm_figures, versions
from gtmbench.report.words.judgement import severity_text
from gtmbench.report.words.units import counted, or_dash
from gtmbench.study.trial import Study, Trial


@dataclass(kw_only=True)
class SeedTable:
    """What is kept of every study: its trials' rows, its false alarms and the hours watched."""

    seeds: list[int] = field(default_factory=list)
    trials: list[dict[str, Any]] = field(default_factory=list)
    healthy: list[dict[str, Any]] = field(default_factory=list)
    _labels: dict[tuple[str, int], list[str]] = field(default_factory=dict)
    _by_fault: dict[tuple[str, int], list[dict[str, Any]]] = field(default_factory=dict)

    def add(self, seed: int, study: Study) -> None:
        """Take what a study has found; the study itself may go."""
        self.seeds.append(seed)
        for base in study.baselines:
            figures = {"false_alarms": base.false_alarms, "healthy_hours": base.healthy_hours}
            self.healthy.append({"seed": seed, "detector": base.detector, **figures})
            for number, trial in enumerate(study.trials_of(base.detector)):
                row = {"seed": seed, **trial.row()}
                self.trials.append(row)
                self._by_fault.setdefault((base.detector, number), []).append(row)
                self._labels.setdefault((base.detector, number), _label(trial))

    def figures(self) -> list[dict[str, Any]]:
        """Return a row a detector and fault, over all seeds; fields on isolation are None where none is claimed."""
        return [
            {
                "detector": key[0],
                **dict(zip(("scenario", "fault", "channel", "severity_of_first_seed"), self._labels[key], strict=True)),
                **_merits(rows),
            }
            for key, rows in self._by_fault.items()
        ]

    def totals(self) -> list[dict[str, Any]]:
        """Return a row a detector: its trials, false alarms, hours watched and the rate's bound."""
        totals = []
        for name in dict.fromkeys(row["detector"] for row in self.healthy):
            own = [row for row in self.trials if row["detector"] == name]
            alarms = sum(row["false_alarms"] for row in self.healthy if row["detector"] == name)
            hours = sum(row["healthy_hours"] for row in self.healthy if row["detector"] == name)
            expected = {
                "expected": sum(row["expected"] is not None for row in own),
                "unexpected": sum(bool(row["unexpected"]) for row in own),
            }
            totals.append({"detector": name, **_merits(own), **expected, **false_alarm_figures(alarms, hours)})
        return totals

    def rows(self) -> tuple[list[str], list[list[str]], list[str]]:
        """Return the columns of the table, its rows as text, and which columns are numbers."""
        right = ["detected", "median delay (s)", "worst delay (s)", "isolated", "kind right"]
        rows = []
        for row in self.figures():
            named = [_count(row[name], row["detected"]) for name in ("isolated", "kind_right")]
            delays = [or_dash(row[name], ".2f") for name in ("median_delay_s", "worst_delay_s")]
            what = row["fault"] if row["fault"] == row["scenario"] else f"{row['scenario']}: {row['fault']}"
            cells = [what, row["channel"], row["severity_of_first_seed"], _count(row["detected"], row["trials"])]
            rows.append([row["detector"], *cells, *delays, *named])
        return ["detector", "fault", "channel", "severity", *right], rows, right

    def verdict(self) -> str:
        """Say in a sentence what every detector found over all seeds."""
        told = [
            f"{row['detector']}: {_count(row['detected'], row['trials'])} faults detected, "
            f"{counted(row['false_alarms'], 'false alarm')} in {row['healthy_hours']:.2f} h of healthy flight"
            for row in self.totals()
        ]
        return f"{counted(len(self.seeds), 'seed')}: {'; '.join(told)}."

    def summary_lines(self) -> list[str]:
        """Return a line a detector: what was detected, false alarms, hours watched."""
        lines = []
        for row in self.totals():
            bound = row["false_alarms_per_hour_at_most"]
            limit = "" if bound is None else f" (at most {bound:.2g} an hour at 95 %)"
            named = (
                "" if row["isolated"] is None else f", isolated {row['isolated']}, wrongly named {row['named_wrong']}"
            )
            if row["expected"]:
                named += f", as expected {row['expected'] - row['unexpected']} of {row['expected']}"
            alarms, hours = counted(row["false_alarms"], "false alarm"), f"{row['healthy_hours']:.2f} h"
            lines.append(
                f"{row['detector']}: detected {row['detected']} of {row['trials']}{named}; {alarms} in {hours} of "
                f"healthy flight{limit}"
            )
        return lines

    def results(self) -> dict[str, Any]:
        """Return all of it as one JSON-ready object."""
        table = {
            "schema_version": SCHEMA_VERSION,
            "seeds": self.seeds,
            "detectors": self.totals(),
            "faults": self.figures(),
            "trials": self.trials,
            "versions": versions(),
        }
        return dict(plain(table))


def _label(trial: Trial) -> list[str]:
    return [trial.scenario, trial.fault, trial.channel, severity_text(trial)]


def _merits(rows: list[dict[str, Any]]) -> dict[str, Any]:
    detected = [row for row in rows if row["detected"]]
    delays = [row["detection_delay_s"] for row in detected]
    claims = any(row["isolated"] is not None for row in rows)
    return {
        "trials": len(rows),
        "detected": len(detected),
        "median_delay_s": float(np.median(delays)) if delays else None,
        "worst_delay_s": max(delays) if delays else None,
        "isolated": sum(bool(row["isolated"]) for row in detected) if claims else None,
        "named_wrong": sum(bool(row["named_wrong"]) for row in detected) if claims else None,
        "kind_right": sum(bool(row["kind_right"]) for row in detected) if claims else None,
    }


def _count(part: int | None, whole: int) -> str:
    return "-" if part is None else f"{part} of {whole}"
