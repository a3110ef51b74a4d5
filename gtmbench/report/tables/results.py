"""Studies as plain data: ``results.json`` and ``trials.csv``, of one seed or of several; events of a closed loop."""

from __future__ import annotations

import csv
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.bench.loop_flight import LoopEvent
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.faults.registry import loaded_faults
from gtmbench.files.plain import SCHEMA_VERSION, dumps, plain
from gtmbench.report.words.events import loop_text
from gtmbench.report.words.judgement import severity_text
from gtmbench.report.words.monitor import bank_summary, norm_facts
from gtmbench.report.words.study import false_alarm_figures, found_text, found_verdict, further_lines, totals
from gtmbench.report.words.units import counted, or_dash
from gtmbench.study.trial import Baseline, Study, Trial
from gtmbench.values.channels import UNIT_SUFFIX, unit_of
from gtmbench.version import __version__

_PER = {"": "", "s": "_s", "sqrt(s)": "_sqrt_s", "g": "_g"}  # behind a unit that is divided by it
_LIBRARIES = ("jsbsim", "numpy", "scipy", "pandas", "rerun-sdk")


def results(study: Study) -> dict[str, Any]:
    """Return a study as one JSON-ready object; units stand in the names.

    `detectors` has an object a detector, `trials` a row a detector and trial.
    """
    table = {
        "schema_version": SCHEMA_VERSION,
        "trim": study.baseline.trim,
        "detectors": [_detector(baseline, study.trials_of(baseline.detector)) for baseline in study.baselines],
        "trials": [trial.row() for trial in study.trials],
        "setup": _setup(study),
        "versions": versions(),
        "seed": study.baseline.setup.seed,
    }
    return dict(plain(table))


def unexpected(trials: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return of some trials' rows those that went otherwise than their scenarios expect, as findings."""
    named = ("detector", "scenario", "fault", "channel")
    return [
        {
            "text": f"{row['detector']}, {row['fault']} of {row['channel']}: {'; '.join(row['unexpected'])}",
            **{name: row[name] for name in named},
        }
        for row in trials
        if row["unexpected"]
    ]


def _detector(baseline: Baseline, trials: Sequence[Trial]) -> dict[str, Any]:
    """Say what a detector is, and what it found."""
    monitor = baseline.monitor
    armed = [score.armed_s for score in baseline.watch.scores.values() if score.armed_s is not None]
    found = totals(baseline, trials)
    del found["trials"]
    return {
        "name": baseline.detector,
        "channels": list(monitor.channels),
        "look_ahead_s": monitor.look_ahead_s,
        "provenance": dict(monitor.provenance),
        **(norm_facts(monitor) if isinstance(monitor, NormMonitor) else {}),
        **({"monitor": bank_summary(monitor)} if isinstance(monitor, BankMonitor) else {}),
        "armed_s": min(armed, default=None),
        **found,
    }


def _setup(study: Study) -> dict[str, Any]:
    """Return the scenarios' settings; those of their own detector only where it watched."""
    setup = study.baseline.setup.facts
    if not any(isinstance(baseline.monitor, NormMonitor) for baseline in study.baselines):
        del setup["operator"]
        alarm = study.baseline.setup.alarm
        setup["alarm"] = {"watch_from_s": alarm.watch_from_s, "healthy_records": alarm.healthy_records}
    return setup


def versions() -> dict[str, str]:
    """Return the versions of the package, of Python and of the libraries that the figures depend on."""
    return {
        "gtmbench": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
    }


def write_results(study: Study, folder: Path) -> None:
    """Write ``results.json``, and ``trials.csv``: one row a detector and trial, every figure in a column of its own."""
    write_tables(results(study), folder)


def write_tables(table: Mapping[str, Any], folder: Path) -> None:
    """Write an object as ``results.json``, and its ``trials`` as ``trials.csv``."""
    (folder / "results.json").write_text(dumps(table, indent=2) + "\n")
    rows = [_flat(row) for row in table["trials"]]
    with (folder / "trials.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(dict.fromkeys(name for row in rows for name in row)))
        writer.writeheader()
        writer.writerows(rows)


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    told = {name: value for name, value in row.items() if name not in ("severity", "settings", "parameters")}
    return {
        **told,
        "candidates": " ".join(row["candidates"]),
        "also": "; ".join(map(_in_words, row["also"])),
        "expected": "" if row["expected"] is None else _expectation_text(row["expected"]),
        "unexpected": "; ".join(row["unexpected"]),
        **_figures(row),
    }


def _figures(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return what was injected and found, a column a figure of the injected kind, with its unit in the name."""
    injected = _headers(row["fault"], row["channel"])
    figures = {**row["severity"], **row["settings"]}
    columns = {f"injected_{injected.get(name, name)}": value for name, value in figures.items()}
    own = ["onset_s", *(injected.get(name, name) for name in figures)]
    found = _headers(row["kind"], next(iter(row["candidates"]), row["channel"]))
    told = {found.get(estimate["name"], estimate["name"]): estimate for estimate in row["parameters"]}
    for header in own:
        estimate = told.pop(header, {})
        columns |= {f"found_{header}": estimate.get("value"), f"least_{header}": estimate.get("low")}
        columns |= {f"most_{header}": estimate.get("high"), f"true_{header}": estimate.get("true")}
    return columns | {"found_else": named({header: estimate["value"] for header, estimate in told.items()})}


def _headers(kind: str | None, channel: str) -> dict[str, str]:
    """Return the columns of a kind's parameters: names that state no unit get that of the channel behind them."""
    cls = loaded_faults().get(str(kind))
    suffix = UNIT_SUFFIX.get(unit_of(channel), "")
    if cls is None or not suffix:
        return {}
    own = {item.name: f"{suffix}{_PER[item.per]}" for item in cls.parameters() if item.is_in_channels_unit}
    return {name: f"{name}_{unit.replace('_s_s', '_s2')}" for name, unit in own.items()}


def _in_words(also: Mapping[str, Any]) -> str:
    """Write a further fault in a cell: ``jam of r at 320.0``, its severities and settings behind it."""
    figures = named({**also["severity"], **also["settings"]})
    return f"{also['fault']} of {also['channel']} at {also['onset_s']!r} {figures}".rstrip()


def _expectation_text(expected: Mapping[str, Any]) -> str:
    """Write what is expected in a cell: ``detect_within_s=2.0 isolate_as=p``."""
    listed = {**expected, "isolate_as": ",".join(expected["isolate_as"])}
    return " ".join(f"{name}={value}" for name, value in listed.items() if value)


def named(figures: Mapping[str, Any]) -> str:
    """Write figures as ``name=value``, those that are None left out."""
    return " ".join(f"{name}={value!r}" for name, value in figures.items() if value is not None)


def event_rows(events: Iterable[LoopEvent]) -> list[dict[str, Any]]:
    """Return a row an event; `value` is the channel's, in `unit`."""
    return [{"text": loop_text(event), **asdict(event), "unit": unit_of(event.channel)} for event in events]


@dataclass(kw_only=True)
class SeedTable:
    """What is kept of every study: its trials' rows, its false alarms and the hours watched."""

    seeds: list[int] = field(default_factory=list)
    trials: list[dict[str, Any]] = field(default_factory=list)
    healthy: list[dict[str, Any]] = field(default_factory=list)
    # by detector and place among its trials: how a trial is called, and its row of each seed
    _by_fault: dict[tuple[str, int], tuple[list[str], list[dict[str, Any]]]] = field(default_factory=dict)

    def add(self, seed: int, study: Study) -> None:
        """Take what a study has found; the study itself may go."""
        self.seeds.append(seed)
        for base in study.baselines:
            figures = {"false_alarms": base.false_alarms, "healthy_hours": base.healthy_hours}
            self.healthy.append({"seed": seed, "detector": base.detector, **figures})
            for number, trial in enumerate(study.trials_of(base.detector)):
                row = {"seed": seed, **trial.row()}
                self.trials.append(row)
                label = [trial.scenario, trial.fault, trial.channel, severity_text(trial.injected)]
                self._by_fault.setdefault((base.detector, number), (label, []))[1].append(row)

    def figures(self) -> list[dict[str, Any]]:
        """Return a row a detector and fault, over all seeds; fields on isolation are None where none is claimed."""
        names = ("detector", "scenario", "fault", "channel", "severity_of_first_seed")
        return [
            dict(zip(names, (detector, *label), strict=True)) | _merits(rows)
            for (detector, _), (label, rows) in self._by_fault.items()
        ]

    def totals(self) -> list[dict[str, Any]]:
        """Return a row a detector: its trials, false alarms, hours watched and the rate's bound."""
        rows = []
        for name in dict.fromkeys(row["detector"] for row in self.healthy):
            own, healthy = ([row for row in of if row["detector"] == name] for of in (self.trials, self.healthy))
            alarms, hours = (sum(row[key] for row in healthy) for key in ("false_alarms", "healthy_hours"))
            expected = {
                "expected": sum(row["expected"] is not None for row in own),
                "unexpected": sum(bool(row["unexpected"]) for row in own),
            }
            rows.append({"detector": name, **_merits(own), **expected, **false_alarm_figures(alarms, hours)})
        return rows

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
        told = [(row["detector"], found_text(row)) for row in self.totals()]
        return f"{counted(len(self.seeds), 'seed')}: {found_verdict(told)}"

    def summary_lines(self) -> list[str]:
        """Say of every detector what the verdict leaves out."""
        return [f"{row['detector']}: {'; '.join(further_lines(row))}" for row in self.totals() if further_lines(row)]

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


def _merits(rows: list[dict[str, Any]]) -> dict[str, Any]:
    detected = [row for row in rows if row["detected"]]
    delays = [row["detection_delay_s"] for row in detected]
    named = dict.fromkeys(("isolated", "named_wrong", "kind_right"))
    if any(row["isolated"] is not None for row in rows):
        named = {name: sum(bool(row[name]) for row in detected) for name in named}
    return {
        "trials": len(rows),
        "detected": len(detected),
        "median_delay_s": float(np.median(delays)) if delays else None,
        "worst_delay_s": max(delays) if delays else None,
        **named,
    }


def _count(part: int | None, whole: int) -> str:
    return "-" if part is None else f"{part} of {whole}"
