"""An airframe's history, each constant over its flights, the worst first: words, data, figure, page, recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmbench.errors import InputError
from gtmbench.files.plain import attributes, envelope
from gtmbench.history.entry import Entry
from gtmbench.history.overview import Overview, overviews_of, trend_text
from gtmbench.history.spread import FEWEST
from gtmbench.report.figures.panels import as_it_is, figure_bytes, panels
from gtmbench.report.fleet import counts_text
from gtmbench.report.markup import html_page, picture
from gtmbench.report.style import COLOURS
from gtmbench.report.words.timeline import wrapped
from gtmbench.report.words.units import counted
from gtmbench.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEAD = ("constant", "flights", "last", "95 %", "expected", "over flights")
_COLUMNS, _WIDTH, _HEIGHT = 3, 3.6, 2.1  # panels beside each other; inches of each


def airframe_lines(name: str, flights: Sequence[Entry], width: int) -> list[str]:
    """Return what is told of an airframe: how many flights, and which constants are others or change."""
    told = [each for each in overviews_of(flights) if each.is_worth_a_look]
    lines = [_text(name, flights, len(told)), *(f"{each.title}: {_remark(each)}" for each in told[:5])]
    return [line for text in lines for line in wrapped(text, width)]


def _text(name: str, flights: Sequence[Entry], told: int) -> str:
    """Say of how many flights an airframe's history is, and whether anything changes."""
    few = f"; it takes {FEWEST} before one to tell more" if len(flights) <= FEWEST else ""
    changes = f"{counted(told, 'constant')} worth a look" if told else "no constant is another than before"
    return f"{name}: {counted(len(flights), 'flight')}, {changes}{few}."


def _row(each: Overview) -> tuple[str, ...]:
    last, (low, high) = each.values[-1], each.intervals[-1]
    usual = "-" if each.usual is None else f"{each.usual[0]:.3g} to {each.usual[1]:.3g}"
    return each.title, str(len(each.flights)), f"{last:.3g}", f"{low:.3g} to {high:.3g}", usual, _remark(each)


def _remark(each: Overview) -> str:
    apart = "the last flight is another than before" if each.is_apart_now else ""
    return "; ".join(filter(None, [apart, "" if each.trend is None else trend_text(each.trend)])) or "as before"


def airframe_results(
    rows: Sequence[Mapping[str, Any]], airframes: Mapping[str, Sequence[Entry]], code: int
) -> dict[str, Any]:
    """Return judged flights, and the constants of each airframe over all of its flights."""
    flown = counted(sum(map(len, airframes.values())), "flight")
    verdict = f"{counts_text(row['outcome'] for row in rows)}." if rows else f"{flown} in the history."
    open_ = [row for row in rows if row["outcome"] != "healthy"]
    findings = [{"text": row["verdict"], "log": row["log"], "outcome": row["outcome"]} for row in open_]
    own = {
        "logs": rows,
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


def _constant(each: Overview) -> Mapping[str, Any]:
    return {
        "sensor": each.sensor,
        "constant": each.name,
        **attributes(each, "unit", "flights", "values", "intervals"),
        "apart": each.is_apart,
        "expected": each.usual,
        "trend": None if each.trend is None else asdict(each.trend),
    }


def airframe_figure(airframes: Mapping[str, Sequence[Entry]]) -> Figure:
    """Return a figure of constants over flights, one or more airframes; InputError where no flight tells a constant."""
    shown = [(name, each) for name, flights in airframes.items() for each in overviews_of(flights)][:30]
    if not shown:
        raise InputError("no flight of this history tells a constant: its logs hold no gyros with an attitude")
    rows = -(-len(shown) // _COLUMNS)
    figure, axes = panels(rows, _COLUMNS, (_COLUMNS * _WIDTH, rows * _HEIGHT))
    for place, axis in enumerate(axis for row in axes for axis in row):
        if place >= len(shown):
            axis.set_visible(False)
            continue
        name, each = shown[place]
        _draw(axis, each)
        above = f"{name}, " if len(airframes) > 1 else ""
        axis.set_title(as_it_is(f"{above}{each.title}"), fontsize=9)
    for axis in axes[-1]:
        axis.set_xlabel("flight")
    return figure


def _draw(axis: Axes, each: Overview) -> None:
    apart, low, high = each.is_apart, *each.intervals.T
    for rows, colour in ((~apart, COLOURS["p"]), (apart, COLOURS["threshold"])):
        off = np.abs(np.vstack([each.values - low, high - each.values]))[:, rows]
        axis.errorbar(each.flights[rows], each.values[rows], yerr=off, fmt="o", ms=3, lw=1.0, color=colour)
    if each.usual is not None:
        axis.fill_between([each.flights[-1] - 0.4, each.flights[-1] + 0.4], *each.usual, color="0.7", alpha=0.5, lw=0)
    if each.began > 1:
        axis.axvline(each.began - 0.5, color="0.4", ls=":", lw=1.0)
    if each.trend is not None:
        trend, first = each.trend, each.began - 1
        start = trend.limit - trend.slope * (trend.crossing - 1.0)
        ends = np.array([1.0, trend.crossing])
        axis.plot(ends + first, start + trend.slope * (ends - 1.0), color=COLOURS["q"], lw=1.0)
        axis.hlines(trend.limit, *(np.array(trend.between) + first), color=COLOURS["threshold"], lw=2.0)
        axis.axhline(trend.limit, color=COLOURS["threshold"], ls="--", lw=0.8)


def airframe_page(airframes: Mapping[str, Sequence[Entry]]) -> str:
    """Return one HTML page of one or more airframes that needs no network."""
    frames = []
    for name, flights in airframes.items():
        shown = overviews_of(flights)
        figure = picture(figure_bytes(airframe_figure({name: flights}), format="png", dpi=110)) if shown else ""
        text = _text(name, flights, sum(each.is_worth_a_look for each in shown))
        logs = ", ".join(each.log for each in flights)
        frames.append({"name": name, "text": text, "figure": figure, "rows": [*map(_row, shown)], "logs": logs})
    title = f"Constants of {next(iter(airframes)) if len(airframes) == 1 else counted(len(airframes), 'airframe')}"
    made_by = f"gtmbench {__version__}"
    return html_page("airframe.html.j2", "sort.js", title=title, frames=frames, head=_HEAD, made_by=made_by)


def write_airframe_recording(airframes: Mapping[str, Sequence[Entry]], path: Path) -> None:
    """Write constants over flights as a recording, a flight a second, with a blueprint, the worst first.

    =============================================  ================================================
    entity                                         holds
    =============================================  ================================================
    ``/AIRFRAME/SENSOR/CONSTANT/value``            what each flight tells
    ``/AIRFRAME/SENSOR/CONSTANT/low``, ``high``    between which it lies with 95 %
    ``/AIRFRAME/SENSOR/CONSTANT/limit``            which a slow change will reach
    =============================================  ================================================
    """
    import rerun.blueprint as rrb

    from gtmbench.report.recording.blueprint import opened, plot
    from gtmbench.report.recording.entities import entity, lighter, recorded

    shown = {
        entity(entity(entity("", name), each.sensor), each.name): each
        for name, flights in airframes.items()
        for each in overviews_of(flights)
    }
    last = float(max((int(each.flights[-1]) for each in shown.values()), default=1))
    plots = [plot(each.title, [f"{root}/**"], (1.0, last)) for root, each in [*shown.items()][:12]]
    blueprint = opened(rrb.Grid(*plots, name="Constants over flights: a flight a second"))
    with recorded(path, f"gtmbench history: {', '.join(airframes)}", blueprint) as recording:
        for root, each in shown.items():
            time_s, colour = each.flights.astype(np.float64), COLOURS["p"]
            recording.log_line(f"{root}/value", (time_s, each.values), each.title, colour)
            for place, name in enumerate(("low", "high")):
                line = (time_s, each.intervals[:, place])
                recording.log_line(f"{root}/{name}", line, f"{name} of 95 %", lighter(colour))
            if each.trend is not None:
                limit = (time_s[[0, -1]], np.full(2, each.trend.limit))
                recording.log_line(f"{root}/limit", limit, "limit", COLOURS["threshold"])
