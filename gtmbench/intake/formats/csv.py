"""Anybody's CSV: how it is written is found out (`csv_layout`), its columns are read, and what was odd is said."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.disk import count_lines
from gtmbench.intake.formats.clock_texts import ClockKind, ClockTexts, clock_of_dates, clock_of_parts, clock_texts
from gtmbench.intake.formats.csv_layout import CsvLayout, layout_of, more_cells
from gtmbench.intake.formats.limits import check_columns, check_values, reading
from gtmbench.intake.formats.raw import RawLog, RawSeries

if TYPE_CHECKING:
    import pandas as pd

_MOSTLY = 0.9  # of a column's cells are numbers (or dates), and it is a column of numbers whose others are missing
_ISO = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d")
_ZONE = re.compile(r"(Z|[+-]\d\d:?(\d\d)?)\s*$")  # behind the time of day
_PARTS = {
    **{name: part for part in ("hour", "minute", "second") for name in (part, f"{part}s")},
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), "us"),
}
_INDEX = "index"  # what a column without a name is that tells the time


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
            raise InputError(more_cells(layout.names, layout.separator)) from error
        if frame.empty:
            raise InputError("it names columns, and holds no row of values below them")
    frame, notes = _without_headers(frame, next(filter(None, layout.names)), layout.names)
    if layout.encoding != "utf-8-sig":
        notes.append(f"read as {layout.encoding}")
    if layout.is_nameless:
        notes.append("no header: columns are called by their numbers, as in --map p=2:rad/s")
    clocks, within = _clocks(frame, layout.names)
    series, ignored = [], [layout.names[place] for place in within if layout.names[place] not in _PARTS]
    for place in sorted({*(place for place, name in enumerate(layout.names) if name), *clocks} - {*within}):
        name = layout.names[place] or _INDEX
        if place in clocks:
            series.append(clocks[place].series(name))
            continue
        values, note = _numbers(_without_thousands(frame[place], "." if layout.decimal == "," else ","))
        if note:
            notes.append(f"column '{name}': {note}")
        if values is None:
            ignored.append(name)
            continue
        series.append(RawSeries(name=name, load=partial(np.asarray, values), unit=layout.units[place]))
    return RawLog(
        kind="CSV",
        series=tuple(series),
        ignored=tuple(ignored),
        notes=tuple(notes),
        is_nameless=layout.is_nameless,
        rate_hz=layout.rate_hz,
        facts=layout.facts,
    )


def _clocks(frame: pd.DataFrame, names: Sequence[str]) -> tuple[dict[int, ClockTexts], list[int]]:
    """Return the columns that tell times, and those that are in these: a date beside a time of day, or its minutes."""
    places = [place for place, name in enumerate(names) if name or place == 0 < len(names) - 1]  # pandas' index, too
    clocks = {place: told for place in places if (told := _clock(frame[place])) is not None}
    days, own = (
        [place for place, each in clocks.items() if each.told is told] for told in (ClockKind.DAY, ClockKind.CLOCK)
    )
    if len(days) == len(own) == 1:
        clocks[own[0]] = clocks[own[0]].on(clocks[days[0]])
    parts = {part: place for place in places if (part := _PARTS.get(names[place].lower()))}
    if clocks or not {"hour", "minute", "second"} <= parts.keys():
        return clocks, days
    values = {part: frame[place] for part, place in parts.items() if frame[place].dtype.kind in "iuf"}
    if len(values) < len(parts):
        return clocks, days
    told = clock_of_parts({part: column.to_numpy(np.float64) for part, column in values.items()})
    return {parts["hour"]: told}, [place for part, place in parts.items() if part != "hour"]


def _frame(path: Path, layout: CsvLayout) -> pd.DataFrame:
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
    first = str(filled.iloc[0]) if len(filled) else ""
    if _ISO.match(first):  # by far the quickest
        dates = pd.to_datetime(column, format="ISO8601", errors="coerce", utc=True).dt.tz_localize(None).to_numpy()
        if np.count_nonzero(~np.isnat(dates)) >= _MOSTLY * len(filled):
            return clock_of_dates(dates, is_utc=_ZONE.search(first) is not None)
    return clock_texts(column.tolist())


def _without_thousands(column: pd.Series[Any], between: str) -> pd.Series[Any]:
    """Return a column whose numbers have nothing between their thousands."""
    import pandas as pd

    if pd.api.types.is_numeric_dtype(column.dtype):
        return column
    grouped = rf"[-+]?\d{{1,3}}([{between}' ]\d{{3}})+([.,]\d*)?"
    texts = column.astype(str).str.strip()
    odd = texts[pd.to_numeric(column, errors="coerce").isna() & column.notna()]
    if not len(odd) or not odd.str.fullmatch(grouped).all():
        return column
    plain = texts.str.replace(rf"(?<=\d)[{between}' ](?=\d{{3}})", "", regex=True)
    return plain.str.replace(",", ".") if between == "." else plain


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
