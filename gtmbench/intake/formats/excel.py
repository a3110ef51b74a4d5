"""Excel's workbooks (.xlsx), read by openpyxl: a sheet is a table with a header."""

from __future__ import annotations

from datetime import datetime
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.intake.formats.clock_texts import ClockTexts, clock_of_dates, clock_texts
from gtmbench.intake.formats.limits import MOST_COLUMNS, Arrays, check_columns, check_values, read_apart, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries

_KIND = "Excel workbook"
_LEAST_NUMBERS = 0.5  # of the cells below one, in a column of numbers
_FEWEST = 20  # rows of a table


def read_excel(path: Path, part: str = "") -> RawLog:
    """Read the only sheet that holds a table, or the one that is named."""
    facts, arrays = read_apart("excel", "openpyxl", path, _KIND)
    sheets: dict[str, dict[str, np.ndarray]] = {}
    for name, values in arrays.items():
        sheet, _, column = name.partition("\t")
        sheets.setdefault(sheet, {})[column] = values
    with reading(path, _KIND):
        if part and part not in sheets:
            raise InputError(f"it has no sheet '{part}' that holds a table; there is {', '.join(sheets) or 'none'}")
        if len(sheets) > 1 and not part:
            raise InputError(f"its sheets {listed(sheets)} hold tables; say which: {path}:{next(iter(sheets))}")
        if not sheets:
            raise InputError("no sheet of it holds a header and rows of numbers below it")
        sheet = part or next(iter(sheets))
        check_columns(facts["headers"][sheet])
        clocks = {name: told for name, values in sheets[sheet].items() if (told := _clock(values)) is not None}
        series = [
            clocks[name].series(name) if name in clocks else RawSeries(name=name, load=partial(np.asarray, values))
            for name, values in sheets[sheet].items()
        ]
    return RawLog(kind=_KIND, series=tuple(series), notes=(f"sheet '{sheet}'",))


def _clock(values: NDArray[Any]) -> ClockTexts | None:
    """Return what a column of dates, times of day or durations tells; None of numbers."""
    if values.dtype.kind == "M":
        return clock_of_dates(values, is_utc=False)
    return clock_texts(values.tolist()) if values.dtype.kind == "U" else None


def arrays(path: str) -> tuple[dict[str, Any], Arrays]:
    """Return the columns of numbers of every sheet; in a process of its own."""
    from openpyxl import load_workbook

    found: Arrays = {}
    headers: dict[str, list[str]] = {}
    content = Path(path).open("rb")  # noqa: SIM115  read until this process ends; by its name it may be no workbook
    book = load_workbook(content, read_only=True, data_only=True, keep_links=False)
    for sheet in book.worksheets:
        rows = [row[:MOST_COLUMNS] for row in sheet.iter_rows(values_only=True)]
        check_values(float(sum(map(len, rows))), "its sheets")
        place = _header(rows)
        if place is None:
            continue
        names = ["" if cell is None else str(cell).strip() for cell in rows[place]]
        headers[sheet.title] = names
        for column, name in enumerate(names):
            cells = [row[column] if column < len(row) else None for row in rows[place + 1 :]]
            values = _values(cells)
            if name and values is not None:
                found[f"{sheet.title}\t{name}"] = values
    return {"headers": headers}, found


def _values(cells: list[Any]) -> NDArray[Any] | None:
    """Return a column of numbers, dates, or texts that tell a time; None of others."""
    numbers = np.array([float(cell) if isinstance(cell, (int, float)) else np.nan for cell in cells])
    if np.count_nonzero(np.isfinite(numbers)) > _LEAST_NUMBERS * len(numbers):
        return numbers
    dates = [cell.isoformat() if isinstance(cell, datetime) else "NaT" for cell in cells]
    stamps = np.array(dates, dtype="datetime64[us]")
    if np.count_nonzero(~np.isnat(stamps)) > _LEAST_NUMBERS * len(stamps):
        return stamps
    texts = [cell if isinstance(cell, str) else "" if cell is None else str(cell) for cell in cells]
    return np.array(texts) if clock_texts(texts) is not None else None


def _header(rows: list[tuple[Any, ...]]) -> int | None:
    """Return the row that names columns: the first of words only, with numbers in the one below."""
    for place, (row, below) in enumerate(pairwise(rows[:40])):  # a header stands among the first rows
        named = [isinstance(cell, str) for cell in row if cell is not None]
        numbers = [isinstance(cell, (int, float)) for cell in below if cell is not None]
        if named and all(named) and any(numbers) and len(rows) - place > _FEWEST:
            return place
    return None


FORMAT = Format(
    name="Excel (.xlsx)",
    magic=(),
    pattern=rb"PK\x03\x04.{26}(\[Content_Types|_rels|docProps|xl/)",
    suffixes=(".xlsx", ".xlsm"),
    read=read_excel,
    has_parts=True,
)
