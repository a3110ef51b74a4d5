"""A campaign: what it would fly, what it found, as ``results.json`` and ``trials.csv`` made of its parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gtmbench.files.plain import attributes, dumps, envelope
from gtmbench.jobs.parts import Parts
from gtmbench.report.words.study import false_alarm_figures, found_text, found_verdict, further_lines
from gtmbench.report.words.units import counted, or_dash
from gtmbench.study.campaign.conduct import flights_of
from gtmbench.study.campaign.plan import Campaign

# Seconds on one core of a small machine (2026): a flight a second of it, a record watched a second of it and detector,
# a trial asked what failed, a trial of a search
_FLOWN, _WATCHED, _ASKED, _SOUGHT = 1.5e-3, 0.7e-3, 0.4, 0.01


def plan_facts(campaign: Campaign, detectors: Sequence[str], jobs: int) -> dict[str, Any]:
    """Return what a campaign would fly, as plain values, and about how long that takes."""
    return {
        "campaign": campaign.name,
        "title": campaign.title,
        "detectors": list(detectors),
        **attributes(campaign, "flights", "trials"),
        "healthy_records": campaign.records,
        "searches": campaign.searches_made,
        "search_trials": campaign.search_trials,
        "rows": (campaign.trials + campaign.searches_made + campaign.records) * len(detectors),
        "calibration_flights": campaign.calibration.flights,
        "about_hours": round(_seconds(campaign, len(detectors)) / 3600.0 / jobs, 4),
        "jobs": jobs,
    }


def _seconds(campaign: Campaign, detectors: int) -> float:
    duration_s = max(scenario.setup.duration_s for scenario in campaign.scenarios)
    calibration = campaign.calibration.flights * campaign.calibration.duration_s * _FLOWN
    watched = (campaign.trials + campaign.records) * detectors * duration_s * _WATCHED
    asked = campaign.trials * detectors * _ASKED * campaign.isolate
    sought = campaign.search_trials * detectors * _SOUGHT
    return calibration + campaign.flights * duration_s * _FLOWN + watched + asked + sought


def plan_verdict(plan: Mapping[str, Any]) -> str:
    """Say in a sentence what a campaign would fly, and about how long that takes."""
    flights, rows = counted(plan["flights"], "flight"), counted(plan["rows"], "row")
    how = f"with --jobs {plan['jobs']} on a small machine, calibration included"
    return (
        f"{plan['campaign']} would fly {flights}, a task each, for {rows}, in about {_time(plan['about_hours'])} {how}."
    )


def plan_lines(plan: Mapping[str, Any]) -> list[str]:
    """Say more of what a campaign would fly."""
    trials, records = counted(plan["trials"], "trial"), counted(plan["healthy_records"], "healthy record")
    lines = [
        f"{plan['campaign']}: {plan['title']}",
        f"{trials} and {records}, watched by {', '.join(plan['detectors'])}",
    ]
    if plan["searches"]:
        searches = counted(plan["searches"], "search", "searches")
        lines.append(f"{searches} for the smallest fault, of at most {counted(plan['search_trials'], 'trial')}")
    return lines


def _time(hours: float) -> str:
    """Say a time that isn't known better than that."""
    if hours < 0.03:
        return f"{3600.0 * hours:.0f} s"
    if hours < 2.0:
        return f"{60.0 * hours:.0f} min"
    return f"{hours:.0f} h" if hours < 72.0 else f"{hours / 24.0:.0f} days"


def fault_rows(results: Mapping[str, Any]) -> tuple[list[str], list[list[str]], list[str]]:
    """Return the columns of the table at a campaign's end, its rows, a detector and kind of fault, and the numbers."""
    columns = ["detector", "fault", "detected", "median (s)", "worst (s)", "right sensor", "wrong sensor", "kind right"]
    rows = []
    for row in results["faults"]:
        cells = [
            row["detector"],
            row["fault"].replace("_", " "),
            f"{or_dash(row['detected'], 'd')} of {row['trials']}",
            or_dash(row["median_delay_s"], ".2f"),
            or_dash(row["worst_delay_s"], ".2f"),
        ]
        cells += [or_dash(row[name], "d") for name in ("isolated", "named_wrong", "kind_right")]
        rows.append(cells)
    return columns, rows, columns[2:]


def campaign_verdict(results: Mapping[str, Any]) -> str:
    """Say in a sentence what every detector of a campaign found."""
    told = [(row["name"], found_text(row)) for row in results["detectors"]]
    return f"{results['campaign']}: {found_verdict(told) if told else 'no trial of a detector stands in it.'}"


def summary_lines(results: Mapping[str, Any]) -> list[str]:
    """Say what stands below the table: false alarms, and what failed."""
    lines = [f"{row['name']}: {'; '.join(further_lines(row))}" for row in results["detectors"] if further_lines(row)]
    if results["failed"]:
        lines.append(f"{results['failed']} of {results['rows']} rows failed; the column error says why")
    return lines


_READ = [
    *("detector", "fault", "channel", "error", "false_alarms", "armed_hours"),
    *("detected", "detection_delay_s", "isolated", "named_wrong", "kind_right", "mildest"),
]


def campaign_results(parts: Parts) -> dict[str, Any]:
    """Return what a campaign found as one object, failed rows counted as that; None: not claimed, or not asked."""
    rows = parts.read(_READ).to_pandas()
    rows = rows[rows["mildest"].isna()]  # searches are scored by `gtmbench campaign --report`
    flights, finished = flights_of(parts)
    by_detector = rows.groupby("detector", sort=False)
    failed = int(rows["error"].notna().sum())
    own = {
        "campaign": parts.facts["campaign"]["name"],
        "title": parts.facts["campaign"]["title"],
        "tasks": flights,
        "tasks_done": finished,
        "parts": parts.tasks,
        "rows": len(rows),
        "failed": failed,
        "detectors": [_detector(str(name), own) for name, own in by_detector],
        "faults": [
            {"detector": name, "fault": fault, **_merits(own)}
            for name, of_detector in by_detector
            for fault, own in of_detector.groupby("fault", sort=False)
        ],
        "facts": parts.facts,
    }
    why = [{"text": f"{failed} of {len(rows)} rows failed; the column error says why"}] if failed else []
    code = 3 if failed else 0
    return envelope("campaign", campaign_verdict(own), own, exit_code=code, findings=why)


def _detector(name: str, rows: pd.DataFrame) -> dict[str, Any]:
    healthy = rows[rows["fault"].isna() & rows["error"].isna()]
    alarms, hours = int(healthy["false_alarms"].sum()), float(healthy["armed_hours"].sum())
    return {
        "name": name,
        **_merits(rows[rows["fault"].notna()]),
        "healthy_records": len(healthy),
        **false_alarm_figures(alarms, hours),
    }


def _merits(rows: pd.DataFrame) -> dict[str, Any]:
    told = rows[rows["error"].isna()]
    delays_s = told["detection_delay_s"].dropna().to_numpy()
    return {
        "trials": len(told),
        "failed": len(rows) - len(told),
        "detected": _hits(told["detected"]),
        "median_delay_s": float(np.median(delays_s)) if len(delays_s) else None,
        "worst_delay_s": float(np.max(delays_s)) if len(delays_s) else None,
        **{name: _hits(told[name]) for name in ("isolated", "named_wrong", "kind_right")},
    }


def _hits(cells: pd.Series) -> int | None:
    """Return how many are true; None where none says."""
    said = cells.dropna()
    return int(said.astype(bool).sum()) if len(said) else None


def write_campaign(parts: Parts, folder: Path) -> None:
    """Write ``results.json``, and ``trials.csv`` with every row; part by part, so that any number fits into memory."""
    from pyarrow import csv

    (folder / "results.json").write_text(dumps(campaign_results(parts), indent=2) + "\n", encoding="utf-8")
    writer = None
    for table in parts.each():
        if writer is None:
            writer = csv.CSVWriter(folder / "trials.csv", table.schema)
        writer.write_table(table)
    if writer is not None:
        writer.close()
