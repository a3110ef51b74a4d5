"""A campaign in words: what it would fly, and what it found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gtmbench.report.words.units import counted, or_dash
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
        "flights": campaign.flights,
        "trials": campaign.trials,
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
    return f"{plan['campaign']} would fly {flights} for {rows}, in about {_time(plan['about_hours'])}."


def plan_lines(plan: Mapping[str, Any]) -> list[str]:
    """Say what a campaign would fly."""
    return [
        plan_verdict(plan),
        f"{plan['campaign']}: {plan['title']}",
        f"{counted(plan['flights'], 'flight')}, a task each; {counted(plan['trials'], 'trial')} and "
        f"{counted(plan['healthy_records'], 'healthy record')}, watched by {', '.join(plan['detectors'])}: "
        f"{counted(plan['rows'], 'row')}",
        *[
            f"{counted(plan['searches'], 'search', 'searches')} for the smallest fault, of at most "
            f"{counted(plan['search_trials'], 'trial')}"
        ]
        * bool(plan["searches"]),
        f"about {_time(plan['about_hours'])} with --jobs {plan['jobs']} on a small machine, calibration included",
    ]


def _time(hours: float) -> str:
    """Say a time that isn't known better than that.

    >>> _time(0.004), _time(0.3), _time(30.0), _time(400.0)
    ('14 s', '18 min', '30 h', '17 days')
    """
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
    told = [
        f"{row['name']} detected {or_dash(row['detected'], 'd')} of {row['trials']} with "
        f"{counted(row['false_alarms'], 'false alarm')}"
        for row in results["detectors"]
    ]
    return f"{results['campaign']}: {'; '.join(told) or 'no trial of a detector stands in it'}."


def summary_lines(results: Mapping[str, Any]) -> list[str]:
    """Say what stands below the table: false alarms, and what failed."""
    lines = []
    for row in results["detectors"]:
        bound = row["false_alarms_per_hour_at_most"]
        at_most = "" if bound is None else f" (at most {bound:.2g} an hour at 95 % confidence)"
        lines.append(
            f"{row['name']}: detected {or_dash(row['detected'], 'd')} of {row['trials']}; false alarms: "
            f"{row['false_alarms']} in {row['healthy_hours']:.2f} h of {row['healthy_records']} healthy records"
            f"{at_most}"
        )
    if results["failed"]:
        lines.append(f"{results['failed']} of {results['rows']} rows failed; the column error says why")
    return lines
