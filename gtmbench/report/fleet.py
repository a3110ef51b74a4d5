"""A fleet of logs: what is kept of each, which is worst; in words, as data, as a figure of its gyros, as a page."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmbench.faults.kinds.additive import Bias
from gtmbench.files.plain import Column, Row, envelope, plain
from gtmbench.intake.events import Event
from gtmbench.jobs.parts import Parts
from gtmbench.log.gyro_figures import gyro_figures
from gtmbench.log.truth.autopilot_messages import of_sensors, words_of
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.figures.panels import as_it_is, one_legend, panels
from gtmbench.report.log_findings import alarm_bound, passed_alarms
from gtmbench.report.markup import html_page, picture
from gtmbench.report.style import COLOURS
from gtmbench.report.words.found import certificate_text
from gtmbench.report.words.units import counted, duration_text, two_digits
from gtmbench.report.words.verdict import verdict_text
from gtmbench.values.channels import GYROS
from gtmbench.verdict.verdict import Outcome
from gtmbench.version import __version__

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

# by outcome, worst first
_OUTCOMES = {"failed": "failed", "unknown": "cannot tell", "error": "not read", "healthy": "no fault found"}
HEAD = ("log", "outcome", "verdict", "bias seen", "false/h", "autopilot")
RIGHT = ("false/h",)
_WIDTHS = {"log": 26, "outcome": 13, "bias seen": 14, "false/h": 7, "autopilot": 28}  # characters
_GAP = 3  # between columns
_WIDE, _OF_WIDE = 120, ("false/h", "autopilot")  # a screen, and what only such a one shows
_LEAST = 24  # characters of a verdict's column
_LINES = 3  # of a verdict
NONE_WATCHED = 2  # an exit code
_PIECE = 200  # lines that a page shows at first, and more at a time: a screen is full with 30
_MOST_NAMES = 60  # under a figure's axis
MEANING = {
    "bias seen": "bias seen: the smallest bias of p, q and r that would have been detected, in deg/s",
    "false/h": "false/h: at most so many false alarms an hour, at 95 %",
}


def words_text(words: Sequence[Event]) -> str:
    """Write the autopilot's first word of its sensors, and how many more there are."""
    if not words:
        return "nothing"
    more = f", {len(words) - 1} more" if len(words) > 1 else ""
    return f"{words[0].text}, {words[0].time_s:.1f} s{more}"


def counts_text(outcomes: Iterable[str]) -> str:
    """Say how many logs came out how."""
    counts = Counter(outcomes)
    parts = [f"{counts[outcome]} {text}" for outcome, text in _OUTCOMES.items() if counts[outcome]]
    return f"{counted(counts.total(), 'log')}: {', '.join(parts)}"


def _whole_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what a page shows of a row, under `HEAD`: nothing is cut."""
    cells = _cells(row)
    if row["outcome"] == "error":
        return tuple({**cells, "log": row["log"]}.values())
    watched = f"{duration_text(row['watched_hours'])} watched of {row['start_s']:.2f} to {row['end_s']:.2f} s"
    told = f"{row['verdict']} {row['certificate']} {watched}, by {row['monitor']}, at {row['rate_hz']:.4g} Hz"
    return tuple({**cells, "log": row["log"], "verdict": told}.values())


def _cells(row: Mapping[str, Any]) -> dict[str, str]:
    """Return what a table shows of a row; what another column says is left out of the verdict."""
    is_error = row["outcome"] == "error"
    told = str(row["error"]).removeprefix(f"{row['log']}: ") if is_error else row["verdict"]
    seen = [two_digits(row[f"{gyro}_bias_seen_deg_s"]) for gyro in GYROS]
    bias = " ".join(seen) if {*seen} != {"-"} else "-"
    bound = two_digits(row["false_alarms_per_hour_at_most"])
    name = Path(row["log"]).name
    cells = (name, _OUTCOMES[row["outcome"]], told.removeprefix("Cannot tell: "), bias, bound, row["autopilot"] or "-")
    return dict(zip(HEAD, cells, strict=True))


def fleet_table(rows: Iterable[Mapping[str, Any]], width: int) -> tuple[list[str], list[list[str]]]:
    """Return the columns and the cells of a table that fits a screen, each log by its file's name.

    What is too long is cut, a name in front, and a narrow screen has fewer columns; all of it stands in the report.
    """
    names = [name for name in HEAD if width >= _WIDE or name not in _OF_WIDE]
    others = sum(_WIDTHS.get(name, 0) + _GAP for name in names)
    limits = {**_WIDTHS, "verdict": _LINES * max(width - others, _LEAST)}
    return names, [[_short(_cells(row)[name], limits[name], in_front=name == "log") for name in names] for row in rows]


def _short(text: str, limit: int, *, in_front: bool) -> str:
    if len(text) <= limit:
        return text
    return f"...{text[3 - limit :]}" if in_front else f"{text[: limit - 3].rstrip()}..."


_OF_GYROS: Mapping[str, str] = {
    "residual_rms_deg_s": "the gyro's residual, root mean square, where an alarm was possible",
    "bias_deg_s": "by how much the gyro reads more than the attitude turns",
    "noise_deg_s": "of the gyro from sample to sample, vibration included",
    "bias_seen_deg_s": "from which bias of the gyro on one would have been detected; null: none would",
}
COLUMNS: Mapping[str, Column] = {
    "task": Column("int32", "of the fleet; a task is a log, in the order in which they were given"),
    "log": Column("string", "its file"),
    "outcome": Column("string", "failed, unknown (can't tell), error (couldn't be watched), healthy"),
    "verdict": Column("string", "in words: the first line that `gtmbench monitor` prints"),
    "judged_share": Column("double", "of the time in motion in which the asked sensor is judged that is judged least"),
    "failed_sensors": Column("string", "that failed, with commas between; empty where none did"),
    "suspected_sensors": Column("string", "of which one failed, or that may have, with commas between"),
    "certificate": Column("string", "what would have been detected, in words"),
    "start_s": Column("double", "of the log, on its own clock"),
    "end_s": Column("double", "of the log"),
    "rate_hz": Column("double", "of its samples as they were watched"),
    "monitor": Column("string", "that watched"),
    "watched_hours": Column("double", "how long an alarm was possible"),
    "alarms": Column("int32", "that something is left to explain"),
    "doubtful_alarms": Column("int32", "of these, that may be motion or model"),
    "first_alarm_s": Column("double", "when the first of these was raised"),
    "alarms_unexplained": Column("int32", "that nothing explains: false ones"),
    "false_alarms_per_hour_at_most": Column("double", "that this length shows, at 95 %"),
    "autopilot": Column("string", "its first word of a gyro or accelerometer; null of logs that tell no events"),
    "autopilot_words": Column("int32", "how many words on gyros and accelerometers"),
    **{f"{gyro}_{name}": Column("double", meaning) for gyro in GYROS for name, meaning in _OF_GYROS.items()},
    "error": Column("string", "why the log couldn't be watched; the row says nothing else then"),
}


def fleet_row(watched: WatchedLog) -> Row:
    """Return what is kept of a watched log."""
    verdict = watched.verdict
    left = [alarm for alarm in watched.alarms if not alarm.has_passed]
    words = of_sensors(words_of(watched.log.events))
    segments = watched.log.segments
    row = {
        "outcome": verdict.outcome.name.lower(),
        "verdict": verdict_text(watched),
        "judged_share": verdict.judged_share(*verdict.scope.sensors),
        "failed_sensors": ", ".join(dict.fromkeys(sensor for sensor, _ in verdict.failed)),
        "suspected_sensors": ", ".join(dict.fromkeys(sensor for sensor, _ in verdict.suspected)),
        "certificate": certificate_text(watched.certificate),
        "start_s": segments[0].start_s,
        "end_s": segments[-1].end_s,
        "rate_hz": 1.0 / watched.log.sample_period_s,
        "monitor": watched.monitor.name,
        "watched_hours": watched.armed_hours,
        "alarms": len(left),
        "doubtful_alarms": sum(bool(alarm.doubt) for alarm in left),
        "first_alarm_s": left[0].time_s if left else None,
        "alarms_unexplained": passed_alarms(watched),
        "false_alarms_per_hour_at_most": alarm_bound(watched),
        "autopilot": words_text(words) if watched.log.events else None,
        "autopilot_words": len(words) if watched.log.events else None,
    }
    for gyro in gyro_figures(watched):
        seen = watched.certificate.of(gyro.name, Bias.kind)
        row |= {
            f"{gyro.name}_residual_rms_deg_s": gyro.residual_rms,
            f"{gyro.name}_bias_deg_s": gyro.bias,
            f"{gyro.name}_noise_deg_s": gyro.noise,
            f"{gyro.name}_bias_seen_deg_s": None if seen is None else seen.size,
        }
    return dict(plain(row))


def worst_first(rows: Iterable[Row]) -> list[Row]:
    """Return rows in the order in which one looks at them.

    What failed, by how many alarms none doubts; what can't be told, with alarms before without; what couldn't be
    watched; and of the healthy ones first those of which silence says least.

    >>> rows = [{"outcome": "healthy", "alarms": 0}, {"outcome": "error"}, {"outcome": "failed", "alarms": 2}]
    >>> [row["outcome"] for row in worst_first(rows)]
    ['failed', 'error', 'healthy']
    """

    def key(row: Row) -> tuple[float, ...]:
        alarms, doubtful = (row.get(name) or 0 for name in ("alarms", "doubtful_alarms"))
        seen = [row.get(f"{gyro}_bias_seen_deg_s") for gyro in GYROS]
        blind = max(math.inf if size is None else size for size in seen)
        return [*_OUTCOMES].index(row["outcome"]), doubtful - alarms, -alarms, -blind

    return sorted(rows, key=key)


def exit_code(rows: Iterable[Row]) -> int:
    """Return 1 where any log failed, 2 where none could be watched, 3 where some can't be told, else 0.

    A log that couldn't be watched is one that can't be told.
    """
    outcomes = {row["outcome"] for row in rows}
    if "failed" in outcomes:
        return int(Outcome.FAILED)
    if outcomes == {"error"}:
        return NONE_WATCHED
    return int(Outcome.HEALTHY if outcomes == {"healthy"} else Outcome.UNKNOWN)


def fleet_results(parts: Parts) -> dict[str, Any]:
    """Return a fleet as one JSON-ready object; `logs` has a row a log, worst first, None for what isn't."""
    rows = worst_first(parts.read().to_pylist())
    own = {
        "counts": {outcome: sum(row["outcome"] == outcome for row in rows) for outcome in _OUTCOMES},
        "logs": rows,
        "versions": parts.facts["versions"],
    }
    told = [
        {"text": f"{row['log']}: {row['verdict'] or row['error']}", "log": row["log"], "outcome": row["outcome"]}
        for row in rows
        if row["outcome"] != "healthy"
    ]
    verdict = f"{counts_text(row['outcome'] for row in rows)}."
    return envelope("monitor-fleet", verdict, own, exit_code=exit_code(rows), findings=told)


_SIGNED = "bias_deg_s"
_PANELS = {"residual_rms_deg_s": "residual RMS\n(deg/s)", _SIGNED: "bias (deg/s)", "noise_deg_s": "noise (deg/s)"}


def gyros_figure(rows: pd.DataFrame) -> Figure | None:
    """Draw each gyro's residual, bias and noise over the flights, in their order; None where no log tells any.

    Flights of one folder are joined by lines. Where the monitor found a failure, the flight is marked.
    """
    names = [f"{gyro}_{name}" for gyro in GYROS for name in _PANELS]
    if not np.isfinite(rows[names].to_numpy(dtype=float)).any():
        return None
    width = float(np.clip(3.0 + 0.22 * len(rows), 7.0, 18.0))
    figure, grid = panels(len(_PANELS), 1, (width, 7.5))
    axes = [row[0] for row in grid]
    at = np.arange(1, len(rows) + 1)
    _, folders = np.unique([str(Path(log).parent) for log in rows["log"]], return_inverse=True)
    order = np.argsort(folders, kind="stable")
    parts = np.flatnonzero(np.diff(folders[order])) + 1
    for axis, (name, label) in zip(axes, _PANELS.items(), strict=True):
        for gyro in GYROS:
            values = rows[f"{gyro}_{name}"].to_numpy(dtype=float)
            line = np.insert(values[order], parts, np.nan)  # a gap between folders
            axis.plot(np.insert(at[order], parts, 0), line, "o-", ms=3.5, lw=0.8, color=COLOURS[gyro], label=gyro)
        failed = [(place - 0.4, 0.8) for place in at[(rows["outcome"] == "failed").to_numpy()]]
        if failed:
            across = axis.get_xaxis_transform()
            axis.broken_barh(
                failed, (0.0, 1.0), transform=across, label="failed", color=COLOURS["threshold"], alpha=0.15, lw=0.0
            )
        if name == _SIGNED:
            axis.axhline(0.0, color=COLOURS["healthy"], lw=0.8)
            axis.set_yscale("symlog", linthresh=0.1)
            axis.margins(y=0.1)
        elif np.nanmax(rows[[f"{gyro}_{name}" for gyro in GYROS]].to_numpy(dtype=float), initial=0.0) > 0.0:
            axis.set_yscale("log")
        axis.set(ylabel=label, xlim=(0.5, len(rows) + 0.5))
        axis.set_xticks(at[:: -(-len(rows) // 200)], [])
    if len(rows) <= _MOST_NAMES:
        stems = [as_it_is(Path(log).name) for log in rows["log"]]
        axes[-1].set_xticks(at, stems, rotation=60, ha="right", rotation_mode="anchor", fontsize="x-small")
    else:
        every = at[9 :: 10 * -(-len(rows) // 200)]
        axes[-1].set_xticks(every, [str(place) for place in every])
        axes[-1].set_xlabel("flight, in the order in which they were given")
    one_legend(figure, axes, columns=len(GYROS) + 1)
    return figure


def fleet_page(rows: Sequence[Row], pages: Mapping[str, str], figure: bytes) -> str:
    """Return the page.

    `pages`: where the page of a log stands, of those that have one. `figure`: a PNG of each gyro's figures; empty where
    there is none.
    """
    from markupsafe import Markup

    lines = [(pages.get(row["log"], ""), *_whole_cells(row)) for row in worst_first(rows)]
    data = json.dumps(lines, separators=(",", ":"))
    return html_page(
        "fleet.html.j2",
        "fleet.js",
        title="A fleet of logs",
        verdict=counts_text(row["outcome"] for row in rows),
        meaning=f"Worst first. {'; '.join(MEANING.values())}.",
        columns=HEAD,
        rows=lines,
        piece=_PIECE,
        data=Markup(data.replace("<", "\\u003c")),  # noqa: S704  nothing in it ends the script
        figure=picture(figure) if figure else "",
        made_by=f"Made by gtmbench {__version__}; every figure of a log stands in fleet.parquet.",
    )
