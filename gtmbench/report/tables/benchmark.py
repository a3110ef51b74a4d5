"""The benchmark's table: as data, and as a page with its data sheet and citation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd

from gtmbench.report.tables.markdown import markdown
from gtmbench.report.words.benchmark import DIFFER, QUICKNESS, ROWS, about, data_sheet
from gtmbench.study.benchmark.definition import EASY, SINGLE, Definition
from gtmbench.study.benchmark.judge import MISSED, Row, differences, places
from gtmbench.study.benchmark.yardsticks import YARDSTICKS, RawReading
from gtmbench.study.scores.intervals import Estimate
from gtmbench.values.channels import GYROS
from gtmbench.version import __version__

SCHEMA = "gtmbench-results-2"
_KINDS = ("kind", "flights", "reference (s)")


def benchmark_results(rows: Sequence[Row], definition: Definition, split: str) -> dict[str, Any]:
    """Return every figure of a run as plain values; what is infinite or unknown is None.

    ``benchmarks/results.schema.json`` says what stands where.
    """
    told = differences(rows)
    ranks = places(rows, told)
    left_out = ("outcomes", "draws")
    return {
        "schema": SCHEMA,
        **about(definition, split),
        "rows": [
            {
                "place": list(ranks[row.name]),
                **{key: value for key, value in asdict(row).items() if key not in left_out},
            }
            for row in rows
        ],
        "differences": [asdict(each) for each in told],
        "outcomes": {row.name: [asdict(outcome) for outcome in row.outcomes] for row in rows},
    }


def benchmark_page(rows: Sequence[Row], definition: Definition, split: str, command: str) -> str:
    """Return the page of a run: the table, what its rows are, delays at other rates, detection by size, the data."""
    facts = about(definition, split)
    called = "not " * bool(facts["differs"]) + definition.name
    parts = [
        f"# {called}: {definition.title}",
        f"Split `{split}`, gtmbench {__version__}; definition {definition.digest[:16]}"
        + (f"; differs: {facts['differs']}" if facts["differs"] else "")
        + f". Written by `{command}`.",
        markdown(table(rows)),
        QUICKNESS,
        DIFFER,
        ROWS,
        "## At other allowed rates",
        "Thresholds are set for each rate. The bold one is the benchmark's own, at the rate that was measured for it.",
        markdown(rates_table(rows, definition)),
        "## By kind of fault",
        "Flights on which it is detected, and the reference's median delay; kinds of one column are the easy ones.",
        markdown(kinds_table(rows)),
        data_sheet(definition, split),
    ]
    return "\n\n".join(parts) + "\n"


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return the table of a run, a row an entry."""
    ranks = places(rows, differences(rows))
    return pd.DataFrame(
        [
            {
                "place": _place(ranks[row.name]),
                "entry": f"*{row.name}*" if row.name in (*YARDSTICKS, RawReading.name) else row.name,
                "quickness": "-" if row.quickness is None else f"{row.quickness.value:.3f} {_interval(row.quickness)}",
                "delay (s)": _figure(row.median_delay_s),
                "missed": f"{row.flights - row.detected} of {row.flights}",
                "named right / wrong / either-or": f"{row.right} / {row.wrong} / {row.either}",
                "easy": _count(row.easy),
                "second": _count(row.second),
                "accused": _count(row.accused),
                "look-alikes": _count(row.alike),
                "false alarms an hour": _rate(row),
                "us a sample": _figure(row.microseconds_a_sample),
                "tuned on": row.tuned,
            }
            for row in rows
        ]
    )


def rates_table(rows: Sequence[Row], definition: Definition) -> pd.DataFrame:
    """Return, by allowed rate, the false alarms that were measured and the median delay."""
    lines = []
    for row in rows:
        cells = {
            f"{point.allowed_per_hour:g} an hour": (
                f"{'**' if point.allowed_per_hour == definition.false_alarms_per_hour else ''}"
                f"{point.false_alarms.value or 0.0:.2g}: {_figure(point.median_delay_s)} s"
                f"{'**' if point.allowed_per_hour == definition.false_alarms_per_hour else ''}"
            )
            for point in row.curve
        }
        if cells:
            lines.append({"entry": row.name, **cells})
    return pd.DataFrame(lines)


def kinds_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return, by kind of fault, on how many flights each row detects it; yardsticks that know left out."""
    shown = [row for row in rows if row.name not in ("never", "always", "oracle")]
    if not shown:
        return pd.DataFrame(columns=_KINDS)
    cases: dict[tuple[str, str, str], list[int]] = {}
    for place, outcome in enumerate(shown[0].outcomes):
        if outcome.role in (SINGLE, EASY):
            sensor = "gyro" if outcome.channel in GYROS else "angle"
            cases.setdefault((outcome.role, outcome.kind, sensor), []).append(place)
    lines = []
    for (role, kind, sensor), of in sorted(cases.items(), reverse=True):
        reference_s = sorted(shown[0].outcomes[place].reference_s for place in of)[len(of) // 2]
        found = {row.name: sum(row.outcomes[place].told != MISSED for place in of) for row in shown}
        name = f"{kind}, {sensor}" + " (easy)" * (role == EASY)
        lines.append(dict(zip(_KINDS, (name, len(of), _figure(reference_s)), strict=True)) | found)
    return pd.DataFrame(lines)


def _count(of: tuple[int, int]) -> str:
    return f"{of[0]} of {of[1]}"


def _interval(estimate: Estimate) -> str:
    return f"({estimate.low:.3f} to {estimate.high:.3f})"


def _place(place: tuple[int, int]) -> str:
    best, worst = place
    return f"{best}" if best == worst else f"{best}-{worst}"


def _figure(value: float) -> str:
    if math.isnan(value):
        return ""
    return "-" if math.isinf(value) else f"{value:.3g}"


def _rate(row: Row) -> str:
    rate = row.false_alarms
    return f"{rate.value or 0.0:.2g} ({rate.low:.2g} to {rate.high:.2g})"
