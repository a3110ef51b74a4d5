"""The benchmark's table: as data, and as a page with its data sheet and citation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd

from gtmbench.report.tables.markdown import markdown
from gtmbench.report.words.benchmark import DIFFER, QUICKNESS, ROWS, about, data_sheet
from gtmbench.study.benchmark.definition import Definition
from gtmbench.study.benchmark.judge import MISSED, Outcome, Row, places
from gtmbench.study.benchmark.yardsticks import YARDSTICKS, RawReading
from gtmbench.version import __version__

_SIZES = ("kind", "size", "faults", "limit (s)")


def benchmark_results(rows: Sequence[Row], definition: Definition, split: str) -> dict[str, Any]:
    """Return every figure of a run as plain values; what is infinite or unknown is None."""
    ranks = places(rows)
    return {
        **about(definition, split),
        "rows": [
            {"place": list(ranks[row.name]), **{key: value for key, value in asdict(row).items() if key != "outcomes"}}
            for row in rows
        ],
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
        "## By size of fault",
        "Share of faults detected before the deadline; the limit is the median's, a dash where nobody can tell.",
        markdown(sizes_table(rows)),
        data_sheet(definition, split),
    ]
    return "\n\n".join(parts) + "\n"


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return the table of a run, a row an entry."""
    ranks = places(rows)
    return pd.DataFrame(
        [
            {
                "place": _place(ranks[row.name]),
                "entry": f"*{row.name}*" if row.name in (*YARDSTICKS, RawReading.name) else row.name,
                "quickness": "-" if row.quickness is None else f"{row.quickness:.3f}",
                "spread": "" if row.spread is None else f"{row.spread[0]:.3f} to {row.spread[1]:.3f}",
                "delay (s)": _figure(row.median_delay_s),
                "limit (s)": _figure(row.median_limit_s),
                "times the limit": _figure(row.times_limit),
                "missed": f"{row.findable - row.detected} of {row.findable}",
                "named right / wrong / either-or": f"{row.right} / {row.wrong} / {row.either}",
                "false alarms an hour": _rate(row),
                "us a sample": _figure(row.microseconds_a_sample),
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


def sizes_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return, by kind and size of fault, how many faults each row detects; yardsticks that know nothing left out."""
    shown = [row for row in rows if row.name not in ("never", "always", "oracle", "limit")]
    if not shown:
        return pd.DataFrame(columns=_SIZES)
    cases: dict[tuple[str, str], list[int]] = {}
    for place, outcome in enumerate(rows[0].outcomes):
        cases.setdefault((outcome.kind, _size(outcome)), []).append(place)
    lines = []
    for (kind, size), of in sorted(cases.items()):
        limits = sorted(rows[0].outcomes[place].limit_s for place in of)
        found = {row.name: sum(row.outcomes[place].told != MISSED for place in of) for row in shown}
        lines.append(dict(zip(_SIZES, (kind, size, len(of), _figure(limits[len(limits) // 2])), strict=True)) | found)
    return pd.DataFrame(lines)


def _size(outcome: Outcome) -> str:
    unit = "deg" if outcome.channel in ("phi", "theta", "psi") else "deg/s"
    return ", ".join(f"{name} {value:g}" for name, value in outcome.sizes.items()) + f" ({unit})"


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
