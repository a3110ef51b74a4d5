"""What is written beside a fleet's parts: the table, the figure of its gyros, and a report with both in it."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd

from gtmbench.columns import Row
from gtmbench.parts import Parts
from gtmbench.report.figures.fleet import gyros_figure
from gtmbench.report.tables.fleet import worst_first
from gtmbench.report.tables.markdown import markdown
from gtmbench.report.words.fleet import HEAD, MEANING, counts_text, fleet_lines, full_lines

TABLE, FIGURE, REPORT = "fleet.parquet", "gyros.png", "report.md"
_WIDTH = 140  # of the table, in characters
_MARKS = re.compile(r"[|<`*\[\]\\]")


def write_fleet(parts: Parts, folder: Path) -> None:
    """Write ``fleet.parquet``, a row a log in the order in which they were given, ``gyros.png`` and ``report.md``.

    Where no log tells anything of a gyro there is no figure.
    """
    import pyarrow.parquet as pq

    table = parts.read()
    pq.write_table(table, folder / TABLE)
    figure = gyros_figure(table.to_pandas())
    if figure is not None:
        figure.savefig(folder / FIGURE, dpi=110)
    (folder / REPORT).write_text(_report(table.to_pylist(), has_figure=figure is not None), encoding="utf-8")


def _report(rows: list[Row], *, has_figure: bool) -> str:
    """Return a table that is cut as on a screen, the figure, and every log's verdict in full."""
    worst = worst_first(rows)
    cells = [[_as_text(cell) for cell in line] for line in fleet_lines(worst, _WIDTH)]
    table = markdown(pd.DataFrame(cells, columns=list(HEAD)))
    lines = ["# A fleet of logs", "", counts_text(row["outcome"] for row in rows), "", table, "", MEANING]
    if has_figure:
        lines += ["", f"![Each gyro's residual, bias and noise, flight by flight]({FIGURE})"]
    for row in worst:
        lines += ["", f"**{_as_text(row['log'])}**", *(f"- {_as_text(line)}" for line in full_lines(row))]
    return "\n".join([*lines, ""])


def _as_text(text: str) -> str:
    """Return a text that Markdown takes for nothing else: files and logs may say anything."""
    return _MARKS.sub(r"\\\g<0>", text)
