"""An airframe's history as a JSON-ready object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from gtmbench.history.entry import Entry
from gtmbench.history.overview import Overview, overviews_of
from gtmbench.history.standing import Standing
from gtmbench.report.tables.envelope import envelope
from gtmbench.report.words.fleet import counts_text
from gtmbench.report.words.units import counted

_MOST = 6  # explanations: the others are hardly likely


def airframe_results(
    rows: Sequence[Mapping[str, Any]], airframes: Mapping[str, Sequence[Entry]], code: int
) -> dict[str, Any]:
    """Return judged flights, and the constants of each airframe over all of its flights."""
    flown = counted(sum(map(len, airframes.values())), "flight")
    verdict = f"{counts_text(row['outcome'] for row in rows)}." if rows else f"{flown} in the history."
    findings = [
        {"text": row["verdict"], "log": row["log"], "outcome": row["outcome"]}
        for row in rows
        if row["outcome"] != "healthy"
    ]
    own = {
        "logs": [dict(row) for row in rows],
        "airframes": [
            {
                "airframe": name,
                "flights": [each.log for each in flights],
                "constants": [_constant(each) for each in overviews_of(flights)],
            }
            for name, flights in airframes.items()
        ],
    }
    return envelope("monitor-history", verdict, own, exit_code=code, findings=findings)


def standing_table(standing: Standing) -> dict[str, Any]:
    """Return what a flight is beside those before it."""
    return {
        "airframe": standing.entry.airframe,
        "flights_before": standing.flights,
        "temperature_c": standing.entry.temperature_c,
        "text": standing.lines,
        "constants": [
            {
                "sensor": each.sensor,
                "constant": each.name,
                "value": each.value,
                "deviation": each.deviation,
                "expected": None if (told := standing.predictions.get(each.key)) is None else told.value,
                "chance": None if told is None else told.chance(each.value),
                "apart": each.key in standing.apart,
            }
            for each in standing.entry.constants
        ],
        "explanations": [
            {"suspects": each.explanation.suspects, "kind": each.explanation.kind, "probability": each.probability}
            for each in standing.explained[:_MOST]
        ],
    }


def _constant(each: Overview) -> Mapping[str, Any]:
    return {
        "sensor": each.sensor,
        "constant": each.name,
        "unit": each.unit,
        "flights": each.flights.tolist(),
        "values": each.values.tolist(),
        "intervals": each.intervals.tolist(),
        "apart": each.is_apart.tolist(),
        "expected": each.usual,
        "trend": None if each.trend is None else asdict(each.trend),
    }
