"""Texts and tables as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from gtmbench.report.words.units import padded

if TYPE_CHECKING:
    import pandas as pd

_MARKS = {mark: f"&#{ord(mark)};" for mark in "|`*\\"} | {"&": "&amp;", "<": "&lt;"}  # of Markdown and HTML


def in_markdown(text: str) -> str:
    """Return a text that Markdown shows as it is, in one line."""
    return " ".join("".join(_MARKS.get(letter, letter) for letter in text).replace("](", "]&#40;").split())


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table whose cells may hold anything."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(map(in_markdown, line))} |" for line in lines)


def markdown(frame: pd.DataFrame) -> str:
    """Return a frame as a Markdown table, its columns aligned so that a terminal shows it, too."""
    head = [str(name) for name in frame.columns]
    rows = [[str(value) for value in row] for row in frame.to_numpy(dtype=object)]
    head, *rows = padded([head, *rows])
    lines = [head, ["-" * len(cell) for cell in head], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
