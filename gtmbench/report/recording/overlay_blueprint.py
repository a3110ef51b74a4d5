"""How an overlay opens: what differs most in front, then a tab of plots for every part of the recording."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

import rerun as rr
import rerun.blueprint as rrb

from gtmbench.record import Span
from gtmbench.report.recording.diff import Comparison, Line, Name
from gtmbench.report.recording.views import event_log, opened, plot

_WORST = 4  # pairs of plots in front, each of another tab
_ROOTS = ("trials", "healthy", "threshold", "sensors", "truth", "surfaces")  # what comes first
_MARKS = ("onset", "alarm", "named")

Parts = Mapping[str, Mapping[Name, Line]]


def standing(which: str, name: Name) -> str:
    """Return the entity of a series of ``A``, ``B``, ``both`` or ``difference``."""
    return f"/{which}{name[0]}/{rr.escape_entity_path_part(name[1])}"


def overlay_blueprint(parts: Parts, found: Comparison) -> rrb.Blueprint:
    """Return the blueprint of an overlay."""
    names = sorted({name for part in parts.values() for name in part})
    plotted = [name for name in names if _is_line(name, parts)]
    ends = [time_s for part in parts.values() for name, (time_s, _) in part.items() if name in plotted]
    shown_s = (float(min(one[0] for one in ends)), float(max(one[-1] for one in ends))) if ends else (0.0, 1.0)
    tabs: dict[str, list[Name]] = defaultdict(list)
    for name in sorted(plotted, key=_importance):
        tabs[_tab(name)].append(name)
    grids = [_grid(tab, held, parts, shown_s) for tab, held in tabs.items()]
    charts = [chart for name in names if _is_chart(name, parts) for chart in _charts(name, parts)]
    operator = [rrb.Grid(*charts, grid_columns=2, name="operator")] if charts else []
    return opened(_front(parts, found, plotted, shown_s), *grids, *operator)


def _grid(tab: str, names: list[Name], parts: Parts, shown_s: Span) -> rrb.Container:
    """Return a tab: every series and, behind a tab of their own, the differences of those that differ."""
    differing = [_difference(name, shown_s) for name in names if name in parts["difference"]]
    plots = [_plot(name, parts, shown_s) for name in names]
    if not differing:
        return rrb.Grid(*plots, name=tab)
    return rrb.Tabs(rrb.Grid(*plots, name="A and B"), rrb.Grid(*differing, name="B - A"), active_tab=0, name=tab)


def _front(parts: Parts, found: Comparison, plotted: list[Name], shown_s: Span) -> rrb.Container:
    worst: dict[str, Name] = {}
    for line in found.lines:
        if (line.entity, line.series) in plotted:
            worst.setdefault(_tab((line.entity, line.series)), (line.entity, line.series))
    pairs = [(_plot(name, parts, shown_s), _difference(name, shown_s)) for name in list(worst.values())[:_WORST]]
    rows = [rrb.Horizontal(*pair) for pair in pairs]
    words = rrb.Vertical(rrb.TextDocumentView(origin="/summary", name="what differs"), event_log(["+ /events"]))
    if not rows:
        return rrb.Horizontal(words, name="Differences")
    return rrb.Horizontal(rrb.Vertical(*rows), words, column_shares=[5, 2], name="Differences")


def _plot(name: Name, parts: Parts, shown_s: Span) -> rrb.TimeSeriesView:
    held = [name, *_beside(name, parts)]
    contents = [f"+ {standing(which, one)}" for one in held for which in ("both", "A", "B") if one in parts[which]]
    return plot(_title(name), contents, shown_s)


def _difference(name: Name, shown_s: Span) -> rrb.TimeSeriesView:
    return plot(f"B - A: {_title(name)}", [f"+ {standing('difference', name)}"], shown_s, legend=False)


def _beside(name: Name, parts: Parts) -> list[Name]:
    """Return what belongs into the plot of a norm or a level: the threshold, and the marks of its trial."""
    detector, _ = _parted(name[0])
    root, _, last = name[0].rpartition("/")
    if last != "norm":
        root, _, last = root.rpartition("/")
    if last not in ("norm", "levels"):
        return []
    wanted = [(f"{detector}/threshold", "threshold"), *((f"{root}/{mark}", mark) for mark in _MARKS)]
    return [one for one in wanted if any(one in part for part in parts.values())]


def _charts(name: Name, parts: Parts) -> list[rrb.BarChartView]:
    held = [f"+ {standing(which, name)}" for which in ("both", "A", "B") if name in parts[which]]
    charts = [rrb.BarChartView(name=_title(name), origin="/", contents=held)]
    if name in parts["difference"]:
        charts.append(rrb.BarChartView(name=f"B - A: {_title(name)}", origin=standing("difference", name)))
    return charts


def _is_line(name: Name, parts: Parts) -> bool:
    held = [part[name][0] for part in parts.values() if name in part]
    return any(len(time_s) > 1 for time_s in held) and not _is_chart(name, parts)


def _is_chart(name: Name, parts: Parts) -> bool:
    return any(name in part and len(part[name][0]) and isinstance(part[name][0][0], str) for part in parts.values())


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
