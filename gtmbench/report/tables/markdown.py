"""Tables as Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


def markdown(frame: pd.DataFrame) -> str:
    """Return a frame as a Markdown table, its columns aligned so that a terminal shows it, too.

    >>> import pandas as pd
    >>> print(markdown(pd.DataFrame([{"fault": "jam", "detected": 3}])))
    | fault | detected |
    | ----- | -------- |
    | jam   | 3        |
    """
    head = [str(name) for name in frame.columns]
    rows = [[str(value) for value in row] for row in frame.to_numpy(dtype=object)]
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join(
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |" for line in lines
    )
