"""Anybody's CSV: encodings, separators, decimal commas, comment lines and a row of units are found out, and said."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.disk import count_lines
from gtmbench.intake.formats.clock_texts import ClockTexts, Told, clock_of_dates, clock_texts
from gtmbench.intake.formats.limits import LONGEST_LINE_BYTES, check_columns, check_values, reading
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.units import unit

if TYPE_CHECKING:
    import pandas as pd

_MOSTLY = 0.9  # of a column's cells are numbers (or dates), and it is a column of numbers whose others are missing
_ISO = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d")
_INDEX = "index"  # what a column without a name is that tells the time
_ONLY_NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?|nan", re.IGNORECASE)
_NUMBER = re.compile(r"\s*[-+]?(\d|[.,]\d|nan\s*$|inf)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a table is written."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    encoding: str
    separator: str
    decimal: str
    skipped: int  # lines before the first row of values


def read_csv(path: Path) -> RawLog:
    """Read a table with a header."""
    from pandas.errors import ParserWarning

    with reading(path, "CSV table"):
        layout = layout_of(path)
        check_columns(layout.names)
        check_values(len(layout.names) * count_lines(path), "its table")
        try:
            frame = _frame(path, layout)
        except ParserWarning as error:
            raise InputError(_more_cells(layout.names, layout.separator)) from error
        if frame.empty:
            raise InputError("it names columns, and holds no row of values below them")
    frame, notes = _without_headers(frame, next(filter(None, layout.names)), layout.names)
    if layout.encoding != "utf-8-sig":
        notes.append(f"read as {layout.encoding}")
    places = [place for place, name in enumerate(layout.names) if name]
    clocks = {place: told for place in places if (told := _clock(frame[place])) is not None}
    if layout.names[:1] == ("",) and len(layout.names) > 1 and (told := _clock(frame[0])) is not None:
        clocks[0] = told  # the index that pandas saves
    days, own = ([place for place, each in clocks.items() if each.told is told] for told in (Told.DAY, Told.CLOCK))
    if len(days) == len(own) == 1:
        clocks[own[0]] = clocks[own[0]].on(clocks[days[0]])
    series, ignored = [], [layout.names[place] for place in days]
    for place in sorted({*places, *clocks} - {*days}):
        name = layout.names[place] or _INDEX
        if place in clocks:
            told = clocks[place]
            notes.append(f"column '{name}': {told.note}")
            series.append(
                RawSeries(
                    name=name, load=partial(np.asarray, told.seconds), unit="s", since_s=told.since_s, was_clock=True
                )
            )
            continue
        values, note = _numbers(frame[place])
        if note:
            notes.append(f"column '{name}': {note}")
        if values is None:
            ignored.append(name)
            continue
        series.append(RawSeries(name=name, load=partial(np.asarray, values), unit=layout.units[place]))
    return RawLog(kind="CSV", series=tuple(series), ignored=tuple(ignored), notes=tuple(notes))


def layout_of(path: Path) -> Layout:
    """Find out how a table is written, from its first lines."""
    with path.open("rb") as file:
        head = file.read(LONGEST_LINE_BYTES)
    encoding = _encoding(head)
    lines = head.decode(encoding, errors="replace").splitlines()
    if len(head) == LONGEST_LINE_BYTES:
        lines = lines[:-1]  # cut in two
        if not lines:
            raise InputError(f"its first line has more than {LONGEST_LINE_BYTES} bytes; a header names the columns")
    place = next((number for number, line in enumerate(lines) if line.strip() and not _is_comment(line)), len(lines))
    if place and (place == len(lines) or _NUMBER.match(lines[place])) and _is_comment(lines[place - 1]):
        place -= 1  # the header itself is written as a comment
    if place == len(lines):
        raise InputError("it is empty")
    header = lines[place].lstrip("#%/ \t")
    separator, fields = _separated(header, lines[place + 1 : place + 3])
    names = [name.strip() for name in _fields(header, separator)]
    if all(map(_ONLY_NUMBER.fullmatch, filter(None, names))):
        raise InputError(
            "its first line holds numbers, no names; put a line above that names the columns and units, "
            "such as time_s,p_deg_s,q_deg_s,r_deg_s,phi_deg,theta_deg,psi_deg"
        )
    units = [""] * len(names)
    skipped = place + 1
    if fields and not any(map(_NUMBER.match, fields[0])) and any(unit(text.strip(" ()[]")) for text in fields[0]):
        units = [text.strip(" ()[]") for text in fields.pop(0)]
        skipped += 1
    if fields and len(fields[0]) == len(names) + 1 and not fields[0][-1].strip():
        names.append("")  # rows that end in a separator
    if fields and len(fields[0]) > len(names):
        raise InputError(_more_cells(names, separator))
    units = (units + [""] * len(names))[: len(names)]
    comma = separator != "," and bool(fields) and any(re.fullmatch(r"\s*[-+]?\d*,\d+\s*", text) for text in fields[0])
    return Layout(
        names=tuple(names),
        units=tuple(units),
        encoding=encoding,
        separator=separator,
        decimal="," if comma else ".",
        skipped=skipped,
    )


def _separated(header: str, lines: Sequence[str]) -> tuple[str, list[list[str]]]:
    """Return what separates a table's cells, and the cells of its first lines."""
    separator = max(";\t|,", key=header.count)  # of as many, the one that no unit holds
    if separator not in header:
        separator = r"\s+"
    fields = [_fields(line, separator) for line in lines]
    if separator == r"\s+" and fields and max(map(len, fields)) == 1:  # one column, whose name has spaces
        separator = ","
    return separator, fields


def _more_cells(names: Sequence[str], separator: str) -> str:
    commas = " If decimals have commas, cells need semicolons between them." if separator == "," else ""
    return f"rows have more cells than the {len(names)} that its first line names; is that the header?{commas}"


def _encoding(head: bytes) -> str:
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    if b"\0" in head:
        raise InputError("it holds zero bytes, so it is no table in text; export the log as CSV")
    try:
        head[: head.rfind(b"\n") + 1 or None].decode("utf-8-sig")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%", "//"))


def _fields(line: str, separator: str) -> list[str]:
    return line.split() if separator == r"\s+" else next(csv.reader([line], delimiter=separator), [])


def _frame(path: Path, layout: Layout) -> pd.DataFrame:
    import pandas as pd

    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
        return pd.read_csv(
            path,
            sep=layout.separator,
            decimal=layout.decimal,
            header=None,
            names=range(len(layout.names)),
            index_col=False,
            skiprows=layout.skipped,
            encoding=layout.encoding,
            encoding_errors="replace",
            skipinitialspace=True,
            low_memory=False,
        )


def _without_headers(frame: pd.DataFrame, first: str, names: Sequence[str]) -> tuple[pd.DataFrame, list[str]]:
    """Return a table without the headers that stand between its rows, as of files put together, and a note on them."""
    place = names.index(first)
    if frame[place].dtype.kind in "iuf":
        return frame, []
    again = frame[place].astype(str).str.strip() == first
    if not again.any():
        return frame, []
    return frame.mask(again), [f"rows that repeat the header: {again.sum()}; were files put together?"]


def _clock(column: pd.Series[Any]) -> ClockTexts | None:
    """Return what a column of dates, times of day or durations tells; None of others."""
    import pandas as pd

    if pd.api.types.is_numeric_dtype(column.dtype):
        return None
    filled = column.dropna()
    if len(filled) and _ISO.match(str(filled.iloc[0])):  # by far the quickest
        dates = pd.to_datetime(column, format="ISO8601", errors="coerce", utc=True).dt.tz_localize(None).to_numpy()
        if np.count_nonzero(~np.isnat(dates)) >= _MOSTLY * len(filled):
            return clock_of_dates(dates)
    return clock_texts(column.tolist())


def _numbers(column: pd.Series[Any]) -> tuple[NDArray[Any] | None, str]:
    """Return a column's numbers, None where it holds others, and a note on them."""
    import pandas as pd

    if pd.api.types.is_numeric_dtype(column.dtype):
        return column.to_numpy(dtype=np.int64 if column.dtype.kind in "iub" else np.float64), ""
    filled = column.dropna()
    numbers = pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64)
    words = len(filled) - np.count_nonzero(np.isfinite(numbers))
    if len(filled) and words <= (1.0 - _MOSTLY) * len(filled):
        return numbers, f"{words} cells hold no number and count as missing" if words else ""
    if words == len(filled):
        return None, ""
    odd = filled[pd.to_numeric(filled, errors="coerce").isna()]
    return None, f"{words} of {len(filled)} cells hold no number, such as '{one_line(str(odd.iloc[0]))[:20]}'"
