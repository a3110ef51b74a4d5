"""The page of an airframe: each constant over its flights, with intervals and limits, the worst first."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence

from gtmbench.history.entry import Entry
from gtmbench.history.overview import overviews_of
from gtmbench.report.figures.airframe import airframe_figure
from gtmbench.report.page.html import html_page
from gtmbench.report.words.airframe import HEAD, airframe_rows, airframe_text
from gtmbench.report.words.units import counted
from gtmbench.version import __version__


def airframe_page(airframes: Mapping[str, Sequence[Entry]]) -> str:
    """Return one HTML page of one or more airframes that needs no network."""
    frames = [_frame(name, flights) for name, flights in airframes.items()]
    title = f"Constants of {next(iter(airframes)) if len(airframes) == 1 else counted(len(airframes), 'airframe')}"
    return html_page("airframe.html.j2", "sort.js", title=title, frames=frames, head=HEAD, made_by=_made_by())


def _frame(name: str, flights: Sequence[Entry]) -> dict[str, object]:
    told = [each for each in overviews_of(flights) if each.trend is not None or each.is_apart[-1]]
    return {
        "name": name,
        "text": airframe_text(name, flights, len(told)),
        "figure": _figure(name, flights),
        "rows": airframe_rows(flights),
        "logs": ", ".join(each.log for each in flights),
    }


def _figure(name: str, flights: Sequence[Entry]) -> str:
    if not overviews_of(flights):
        return ""
    drawn = io.BytesIO()
    airframe_figure({name: flights}).savefig(drawn, format="png", dpi=110)
    return base64.b64encode(drawn.getvalue()).decode()


def _made_by() -> str:
    return f"gtmbench {__version__}"
