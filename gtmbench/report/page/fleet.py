"""The page of a fleet: a line a log, worst first, of any number of logs; one file that asks nothing of any network."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from gtmbench.files.plain import Row
from gtmbench.report.page.html import html_page
from gtmbench.report.tables.fleet import worst_first
from gtmbench.report.words.fleet import HEAD, MEANING, counts_text, whole_cells
from gtmbench.version import __version__

_PIECE = 200  # lines that are shown at first, and more at a time: a screen is full with 30


class _Line(NamedTuple):
    page: str
    cells: tuple[str, ...]


def fleet_page(rows: Sequence[Row], pages: Mapping[str, str], figure: bytes) -> str:
    """Return the page.

    `pages`: where the page of a log stands, of those that have one. `figure`: a PNG of each gyro's figures; empty where
    there is none.
    """
    from markupsafe import Markup

    lines = [_Line(pages.get(row["log"], ""), whole_cells(row)) for row in worst_first(rows)]
    data = json.dumps([[line.page, *line.cells] for line in lines], separators=(",", ":"))
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
        figure=f"data:image/png;base64,{base64.b64encode(figure).decode()}" if figure else "",
        made_by=f"Made by gtmbench {__version__}; every figure of a log stands in fleet.parquet.",
    )
