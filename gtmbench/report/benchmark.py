"""The benchmark's table: as data, as a page with its data sheet and citation, and as curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import pandas as pd

from gtmbench.files.plain import attributes
from gtmbench.report.markup import markdown, text_page
from gtmbench.report.style import strokes
from gtmbench.study.benchmark.definition import (
    ALIKE,
    CALIBRATION,
    COMMON,
    EASY,
    HEALTHY,
    LEARN,
    PAIR,
    PRIVATE,
    SINGLE,
    Definition,
    Group,
    secret_digest,
)
from gtmbench.study.benchmark.judge import MISSED, Row, differences, places
from gtmbench.study.benchmark.run import YARDSTICKS, RawReading
from gtmbench.study.scores.intervals import Estimate
from gtmbench.values.channels import GYROS
from gtmbench.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def about(definition: Definition, split: str) -> dict[str, Any]:
    """Return which flights rows were judged on."""
    flights = [flight for flight in definition.flights(split) if not flight.twin]
    return {
        "benchmark": definition.name,
        "digest": definition.digest,
        "split": split,
        "differs": definition.differing,
        "private_seed": secret_digest(definition) if split == PRIVATE else None,
        "gtmbench": __version__,
        **{role: sum(flight.role == role for flight in flights) for role in (SINGLE, EASY, COMMON, PAIR, ALIKE)},
        "faults": len({(flight.group.name, flight.case) for flight in flights if flight.role == SINGLE}),
        "healthy_hours": round(sum(flight.role == HEALTHY for flight in flights) * definition.duration_s / 3600.0, 2),
        **attributes(definition, "false_alarms_per_hour", "deadline_s"),
    }


def _group_line(definition: Definition, group: Group, split: str) -> str:
    counts = {of: sum(each.group == group for each in definition.flights(of)) for of in (LEARN, CALIBRATION)}
    judged = [each for each in definition.flights(split) if each.group == group and not each.twin]
    broken = sum(bool(each.faults) for each in judged)
    return (
        f"- `{group.name}`: {group.aircraft}, {group.rate_hz:g} Hz, {group.sensors} sensors: {counts[LEARN]} flights "
        f"to learn, {counts[CALIBRATION]} to calibrate, {broken} with a fault, {len(judged) - broken} healthy"
    )


def citation(definition: Definition, split: str) -> str:
    """Return the CITATION.cff of the benchmark."""
    secret = secret_digest(definition) if split == PRIVATE else ""
    return text_page("citation.cff.j2", definition=definition, secret=secret, version=__version__)


SCHEMA = "gtmbench-results-2"
_KINDS = ("kind", "flights", "reference (s)")


def benchmark_results(rows: Sequence[Row], definition: Definition, split: str) -> dict[str, Any]:
    """Return a run's figures, as ``benchmarks/results.schema.json`` has them; None: infinite or unknown."""
    told = differences(rows)
    ranks = places(rows, told)
    left_out = ("definition", "bound", "facts", "outcomes", "draws")
    return {
        "schema": SCHEMA,
        **about(definition, split),
        "rows": [
            {
                "place": list(ranks[row.name]),
                **{key: value for key, value in (asdict(row.facts) | asdict(row)).items() if key not in left_out},
            }
            for row in rows
        ],
        "differences": [asdict(each) for each in told],
        "outcomes": {row.name: [asdict(outcome) for outcome in row.outcomes] for row in rows},
    }


def benchmark_page(rows: Sequence[Row], definition: Definition, split: str, command: str) -> str:
    """Return the page of a run: the table, what its rows are, delays at other rates, detection by size, the data."""
    return text_page(
        "benchmark.md.j2",
        definition=definition,
        facts=about(definition, split),
        version=__version__,
        command=command,
        table=markdown(table(rows)),
        rates=markdown(rates_table(rows, definition)),
        kinds=markdown(kinds_table(rows)),
        groups=[_group_line(definition, group, split) for group in definition.groups],
        onset=" to ".join(f"{each:g}" for each in definition.onset_s),
        versions=", ".join(f"{name} {version}" for name, version in definition.versions.items()),
    )


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """Return the table of a run, a row an entry."""
    ranks = places(rows, differences(rows))
    return pd.DataFrame(
        [
            {
                "place": "-".join(map(str, dict.fromkeys(ranks[row.name]))),
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
                "us a sample": _figure(row.facts.microseconds_a_sample),
                "tuned on": row.facts.tuned,
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


def _figure(value: float) -> str:
    if math.isnan(value):
        return ""
    return "-" if math.isinf(value) else f"{value:.3g}"


def _rate(row: Row) -> str:
    rate = row.false_alarms
    return f"{rate.value or 0.0:.2g} ({rate.low:.2g} to {rate.high:.2g})"


_RATES, _SHORTEST_S = (3e-3, 30.0), 0.01  # of the axes: false alarms an hour, seconds
_BINS_S = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # of the reference's mean delay


def benchmark_curves(rows: Sequence[Row], definition: Definition) -> Figure:
    """Draw median delay against the measured rate of false alarms, and the share detected against the reference.

    A marker stands where thresholds are set for the benchmark's own rate: on its curve, at the rate that was measured.
    A rate of zero is drawn at the upper bound that the flights allow. The reference's delay stands for a fault's size,
    which makes kinds comparable: the smaller a fault, the later it can be told.
    """
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.curve]
    styles = strokes(row.name for row in shown)
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    delays, sizes = figure.subplots(1, 2)
    for row in shown:
        _draw_delays(delays, row, definition, styles[row.name])
        _draw_sizes(sizes, row, styles[row.name])
    delays.set(xscale="log", yscale="log", xlabel="false alarms an hour", ylabel="median delay (s)")
    delays.set(xlim=(_RATES[0], _RATES[1]), ylim=(_SHORTEST_S, definition.deadline_s))
    delays.axvline(definition.false_alarms_per_hour, color="0.6", lw=0.8)
    sizes.set(
        xscale="log",
        xlim=(_BINS_S[0] / 3.0, 2.0 * _BINS_S[-1]),
        xlabel="mean delay of the reference (s): large faults left",
        ylabel="share detected",
    )
    sizes.set_ylim(-0.03, 1.03)
    if shown:
        figure.legend(*sizes.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    return figure


def _draw_delays(axis: Axes, row: Row, definition: Definition, style: dict[str, object]) -> None:
    points = [point for point in row.curve if math.isfinite(point.median_delay_s)]
    rates = [point.false_alarms.value or point.false_alarms.high for point in points]
    delays_s = [max(point.median_delay_s, _SHORTEST_S) for point in points]
    axis.plot(rates, delays_s, color=style["color"], ls=style["linestyle"])
    for rate, delay_s, point in zip(rates, delays_s, points, strict=True):
        if point.allowed_per_hour == definition.false_alarms_per_hour:
            axis.plot([rate], [delay_s], color=style["color"], marker=style["marker"], ls="none")


def _draw_sizes(axis: Axes, row: Row, style: dict[str, object]) -> None:
    places, shares = [], []
    for low, high in zip((0.0, *_BINS_S), (*_BINS_S, math.inf), strict=True):
        within = [outcome.told != MISSED for outcome in row.outcomes if low <= outcome.reference_s < high]
        if within:
            places.append(math.sqrt(max(low, 0.03) * min(high, 200.0)))
            shares.append(sum(within) / len(within))
    axis.plot(places, shares, color=style["color"], ls=style["linestyle"], marker=style["marker"], ms=4, label=row.name)
