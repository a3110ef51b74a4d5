"""A campaign's report as a page, Markdown or JSON."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from gtmbench.files.plain import dumps, plain
from gtmbench.report.page.html import html_page
from gtmbench.report.page.sections import Contents
from gtmbench.report.tables.scores import ScoreTable, in_markdown, scores_results
from gtmbench.report.tables.who_sees_what import who_sees_what
from gtmbench.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PageFigure(NamedTuple):
    """A figure as a page has it."""

    source: str
    caption: str


def page(contents: Contents) -> str:
    """Return the report as one HTML page."""
    return html_page(
        "campaign.html.j2",
        "sort.js",
        title=contents.title,
        summary=contents.summary,
        verdict=contents.verdict,
        tables=contents.tables,
        figures={title: [_drawn(*each) for each in own] for title, own in contents.figures().items()},
        confusions=[(table, _shades(table)) for table in contents.confusions],
        facts=contents.run(),
        commands=contents.commands(),
        made_by=f"Made by gtmbench {__version__} from the parts of the campaign.",
    )


def _drawn(caption: str, figure: Figure) -> PageFigure:
    """Return a figure as an image that stands in the page; the same figure, the same bytes."""
    import matplotlib as mpl

    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "gtmbench"}):
        figure.savefig(file, format="svg", metadata={"Date": None})
    return PageFigure(f"data:image/svg+xml;base64,{base64.b64encode(file.getvalue()).decode()}", caption)


def _shades(table: ScoreTable) -> list[list[str]]:
    """Return what a table of counts looks like: the darker, the more of its row."""
    shades = []
    for row in table.rows:
        whole = sum(cell.key for cell in row if isinstance(cell.key, float)) or 1.0
        shades.append([_shade(cell.key / whole) if isinstance(cell.key, float) else "" for cell in row])
    return shades


def _shade(part: float) -> str:
    return f"background: rgba(0, 114, 178, {0.55 * part:.2f})"


def markdown(contents: Contents) -> str:
    """Return the report as Markdown; figures are the page's."""
    lines = [f"# {in_markdown(contents.title)}", "", in_markdown(contents.summary), ""]
    lines += [f"- {in_markdown(line)}" for line in contents.verdict]
    for table in [*contents.tables, *contents.confusions]:
        lines += ["", f"## {in_markdown(table.title)}", in_markdown(table.note), "", table.markdown()]
    lines += ["", "## What was run, and how to repeat it"]
    lines += [f"- {in_markdown(name)}: {in_markdown(value)}" for name, value in contents.run()]
    lines += ["", *[f"    {line}" for line in contents.commands().splitlines()]]
    return "\n".join(lines) + "\n"


def data(contents: Contents) -> str:
    """Return the report as JSON: all figures, as they are."""
    about = {
        "campaign": contents.campaign["name"],
        "title": contents.title,
        "flights": contents.tasks,
        "flights_done": contents.done,
        "facts": contents.facts,
        "repeat": contents.commands().splitlines(),
    }
    return dumps(plain(scores_results(contents.scores, about)), indent=2) + "\n"


def table(contents: Contents) -> str:
    """Return one table, as Markdown, for a page of somebody's own."""
    return who_sees_what(contents.scores)


FORMATS: Mapping[str, Callable[[Contents], str]] = {"html": page, "md": markdown, "json": data, "table": table}
