"""Two recordings laid over each other in one.

==========================  ================================================================================
entity                      holds
==========================  ================================================================================
``/A/...``, ``/B/...``      every series that differs, of either recording, under its entity and its name
``/both/...``               series that are equal
``/difference/...``         B - A, at the times that both know
``/events``                 what both tell, and what only one does
``/summary``                what differs, in words
==========================  ================================================================================

On the timeline ``time``, under one blueprint: first what differs most, with the differences beside it, then everything.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gtmbench.report.markup import in_markdown, markdown_table
from gtmbench.report.recording.blueprint import beside, event_log, opened, plot, shown
from gtmbench.report.recording.diff import Line, Name, RecordingDiff, difference_tables, events, lines
from gtmbench.report.recording.entities import SHAPES, Recording, entity, recorded, rgb
from gtmbench.values.channels import CHANNELS
from gtmbench.values.record import FloatArray, Span

if TYPE_CHECKING:
    import pandas as pd

TINTS = {"A": "#1f77b4", "B": "#ff7f0e", "both": "#7f7f7f", "difference": "#d62728"}
_WIDTHS = {"A": 4.0, "B": 1.0}  # B on A: where they are equal, A shows on both sides of B
_MOST_WORDS = 30  # rows of a table of the summary
_WORST = 4  # pairs of plots in front, each of another tab
_ROOTS = ("trials", "healthy", "threshold", "sensors", "truth", "surfaces")  # what comes first
_MARKS = ("onset", "alarm", "named")

Parts = Mapping[str, Mapping[Name, Line]]  # of A, B, both and difference


def write_overlay(
    a: pd.DataFrame, b: pd.DataFrame, comparison: RecordingDiff, path: Path, *, names: tuple[str, str] = ("A", "B")
) -> None:
    """Write two recordings, as `read_recording` gives them, over each other; `comparison` is how they compare."""
    parts = _parts(lines(a), lines(b), comparison)
    with recorded(path, f"gtmbench overlay: A {names[0]}, B {names[1]}", _blueprint(parts, comparison)) as recording:
        for which, series in parts.items():
            for name, line in series.items():
                _log(recording, which, name, *line)
        _log_events(recording, a, b)
        summary = rr.TextDocument(_summary(comparison, names), media_type="text/markdown")
        recording.stream.log("/summary", summary, static=True)


def _parts(a: dict[Name, Line], b: dict[Name, Line], comparison: RecordingDiff) -> Parts:
    """Sort the series: those of A and B that differ, their differences, and those that are equal."""
    differing = [line.name for line in comparison.lines]
    own = {*differing, *comparison.only_a, *comparison.only_b}
    return {
        "both": {name: line for name, line in a.items() if name not in own},
        "A": {name: line for name, line in a.items() if name in own},
        "B": {name: line for name, line in b.items() if name in own},
        "difference": {name: _difference(a[name], b[name]) for name in differing},
    }


def _difference(a: Line, b: Line) -> Line:
    at, in_a, in_b = np.intersect1d(a[0], b[0], return_indices=True)
    with np.errstate(invalid="ignore", over="ignore"):
        return at, b[1][in_b] - a[1][in_a]


def _entity(which: str, name: Name) -> str:
    """Return the entity of a series of ``A``, ``B``, ``both`` or ``difference``."""
    return entity(f"/{which}{name[0]}", name[1])


def _log(recording: Recording, which: str, name: Name, time_s: FloatArray, values: FloatArray) -> None:
    where, tint = _entity(which, name), TINTS[which]
    has_unit = name[1] in CHANNELS and "/levels/" not in name[0]  # levels are shares of their thresholds
    unit = f" ({CHANNELS[name[1]].unit})" if has_unit else ""
    label = {"both": "A = B", "difference": "B - A"}.get(which, which) + f": {name[1]}{unit}"
    if len(time_s) and isinstance(time_s[0], str):  # lags
        lags = np.array([float(lag.removeprefix("lag ")) for lag in time_s])
        recording.stream.log(where, rr.BarChart(values, abscissa=lags, color=rgb(tint)), static=True)
    elif len(time_s) == 1:
        marker = SHAPES.Up if name[1] == "onset" else SHAPES.Down
        recording.log_mark(where, float(time_s[0]), float(values[0]), label, tint, marker)
    elif len(time_s):
        recording.log_lines(where, time_s, values, [label], [tint], width=_WIDTHS.get(which, 1.5))


def _log_events(recording: Recording, a: pd.DataFrame, b: pd.DataFrame) -> None:
    of_a, of_b = events(a), events(b)
    told = {"both": of_a & of_b, "only A": of_a - of_b, "only B": of_b - of_a}
    rows = [(event[1], which, event) for which, of in told.items() for event in of.elements()]
    for time_s, which, (path, _, severity, text) in sorted(rows):
        trial = "/".join(word for word in path.split("/") if word not in ("", "detectors", "trials", "events"))
        recording.log_text("/events", time_s, severity, f"{which}: {trial} {text}" if trial else f"{which}: {text}")


def _summary(comparison: RecordingDiff, names: tuple[str, str]) -> str:
    page = [f"**A** {in_markdown(names[0])}", f"**B** {in_markdown(names[1])}", comparison.text]
    for title, columns, rows in difference_tables(comparison):
        page += [f"{title}:", markdown_table(columns, rows[:_MOST_WORDS])]
    return "\n\n".join(page)


def _blueprint(parts: Parts, comparison: RecordingDiff) -> rrb.Blueprint:
    names = sorted({name for part in parts.values() for name in part})
    held = {name: [part[name][0] for part in parts.values() if name in part] for name in names}
    charted = [name for name in names if any(len(at) and isinstance(at[0], str) for at in held[name])]
    plotted = [name for name in names if any(len(at) > 1 for at in held[name]) and name not in charted]
    drawn = [time_s for part in parts.values() for name, (time_s, _) in part.items() if name in plotted]
    times_s = [time_s for time_s in drawn if len(time_s)]  # a difference has none where the two share no time
    shown_s = (float(min(of[0] for of in times_s)), float(max(of[-1] for of in times_s))) if times_s else (0.0, 1.0)
    tabs: dict[str, list[Name]] = defaultdict(list)
    for name in sorted(plotted, key=_importance):
        tabs[_tab(name)].append(name)
    grids = [_grid(tab, members, parts, shown_s) for tab, members in tabs.items()]
    charts = [chart for name in charted for chart in _charts(name, parts)]
    operator = [rrb.Grid(*charts, grid_columns=2, name="operator")] if charts else []
    return opened(_front(parts, comparison, plotted, shown_s), *grids, *operator)


def _grid(tab: str, names: list[Name], parts: Parts, shown_s: Span) -> rrb.Container:
    """Return a tab: every series and, behind a tab of their own, the differences of those that differ."""
    differing = [_difference_plot(name, shown_s) for name in names if name in parts["difference"]]
    plots = [_plot(name, parts, shown_s) for name in names]
    if not differing:
        return rrb.Grid(*plots, name=tab)
    return rrb.Tabs(rrb.Grid(*plots, name="A and B"), rrb.Grid(*differing, name="B - A"), active_tab=0, name=tab)


def _front(parts: Parts, comparison: RecordingDiff, plotted: list[Name], shown_s: Span) -> rrb.Container:
    worst: dict[str, Name] = {}
    for line in comparison.lines:
        if line.name in plotted:
            worst.setdefault(_tab(line.name), line.name)
    names = list(worst.values())[:_WORST]
    pairs = [rrb.Horizontal(_plot(name, parts, shown_s), _difference_plot(name, shown_s)) for name in names]
    words = rrb.Vertical(rrb.TextDocumentView(origin="/summary", name="what differs"), event_log("/events"))
    if not pairs:
        return rrb.Horizontal(words, name="Differences")
    return beside(rrb.Vertical(*pairs), words, "Differences")


def _plot(name: Name, parts: Parts, shown_s: Span) -> rrb.TimeSeriesView:
    entities = [path for member in (name, *_companions(name, parts)) for path in _entities(member, parts)]
    return plot(_title(name), entities, shown_s)


def _difference_plot(name: Name, shown_s: Span) -> rrb.TimeSeriesView:
    return plot(f"B - A: {_title(name)}", [_entity("difference", name)], shown_s, legend=False)


def _entities(name: Name, parts: Parts) -> list[str]:
    return [_entity(which, name) for which in ("both", "A", "B") if name in parts[which]]


def _companions(name: Name, parts: Parts) -> list[Name]:
    """Return what belongs into the plot of a score: the threshold, and the marks of its trial."""
    detector, _ = _parted(name[0])
    root, _, last = name[0].rpartition("/")
    if last != "norm":
        root, _, last = root.rpartition("/")
    if last not in ("norm", "levels"):
        return []
    wanted = [(f"{detector}/threshold", "threshold"), *((f"{root}/{mark}", mark) for mark in _MARKS)]
    return [name for name in wanted if any(name in part for part in parts.values())]


def _charts(name: Name, parts: Parts) -> list[rrb.BarChartView]:
    charts = [rrb.BarChartView(name=_title(name), origin="/", contents=shown(_entities(name, parts)))]
    if name in parts["difference"]:
        charts.append(rrb.BarChartView(name=f"B - A: {_title(name)}", origin=_entity("difference", name)))
    return charts


def _importance(name: Name) -> tuple[int, Name]:
    root = _parted(name[0])[1][0]
    return (_ROOTS.index(root) if root in _ROOTS else len(_ROOTS)), name


def _tab(name: Name) -> str:
    """Return the tab of a series: a scenario of trials, or the entity's first word; with whose it is, of several."""
    detector, (root, *more) = _parted(name[0])
    tab = more[0] if root == "trials" and more else "healthy" if root == "threshold" else root
    return f"{detector.rpartition('/')[2]}: {tab}" if detector else tab


def _parted(entity: str) -> tuple[str, list[str]]:
    """Return the entity of the detector that one belongs to, empty where there is one only, and the words below it."""
    words = entity.split("/")[1:]
    return (f"/{'/'.join(words[:2])}", words[2:]) if words[0] == "detectors" and len(words) > 2 else ("", words)


def _title(name: Name) -> str:
    return name[0] if name[0].endswith(f"/{name[1]}") else f"{name[0]} {name[1]}"
