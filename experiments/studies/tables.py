"""Tables of a study: a line a group of its rows, and how a cell says what share of trials came out well."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from gtmbench.study.scores.intervals import exact_interval

if TYPE_CHECKING:
    import pandas as pd


def grouped(
    rows: pd.DataFrame, by: Mapping[str, str], cells: Mapping[str, Callable[[pd.DataFrame], object]]
) -> pd.DataFrame:
    """Return a line a group of rows, in the order in which they come.

    Parameters
    ----------
    rows : DataFrame
    by : mapping
        Columns that say of which group a row is, by the names that they have in the table.
    cells : mapping
        By name, what is said of a group's rows.

    Examples
    --------
    >>> import pandas as pd
    >>> from gtmbench.report.markup import markdown
    >>> rows = pd.DataFrame({"kind": ["jam", "drift", "jam"], "delay_s": [0.2, 6.0, 0.4]})
    >>> print(markdown(grouped(rows, {"fault": "kind"}, {"trials": len, "worst (s)": lambda of: of["delay_s"].max()})))
    | fault | trials | worst (s) |
    | ----- | ------ | --------- |
    | jam   | 2      | 0.4       |
    | drift | 1      | 6.0       |
    """
    import pandas as pd

    return pd.DataFrame(
        [
            dict(zip(by, key, strict=True)) | {name: cell(own) for name, cell in cells.items()}
            for key, own in rows.groupby(list(by.values()), sort=False, observed=True)
        ]
    )


def share_text(hits: int, trials: int) -> str:
    """Write a share with its 95 % interval; a dash where nothing was tried.

    >>> share_text(322, 324)
    '99.4 % [97.8, 99.9] of 324'
    """
    if not trials:
        return "-"
    low, high = exact_interval(hits, trials)
    return f"{100 * hits / trials:.1f} % [{100 * low:.1f}, {100 * high:.1f}] of {trials}"


def tables_in(text: str) -> list[list[dict[str, str]]]:
    r"""Return the tables of a report: a list of lines each, by the names of the columns.

    Examples
    --------
    >>> tables_in("# Report\n\n| fault | share |\n|---|---|\n| jam | 0.9 |\n")
    [[{'fault': 'jam', 'share': '0.9'}]]
    """
    tables: list[list[dict[str, str]]] = []
    names: list[str] = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip())[1:-1]] if line.startswith("|") else []
        if cells and not names:
            names = cells
            tables.append([])
        elif cells and set("".join(cells)) - set(":-"):
            tables[-1].append(dict(zip(names, cells, strict=False)))
        elif not cells:
            names = []
    return tables
