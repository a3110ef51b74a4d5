"""Anybody's CSV: how it is written is found out, its columns are read, and what was odd is said.

How it is written: encoding, separator, decimals, what stands above its rows, and whether it has a header.
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.files.writing import count_lines
from gtmbench.intake.formats.clock_texts import ClockKind, ClockTexts, clock_of_dates, clock_of_parts, clock_texts
from gtmbench.intake.formats.limits import LONGEST_LINE_BYTES, check_columns, check_values, reading
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.units import unit

if TYPE_CHECKING:
    import pandas as pd


SPACES = r"\s+"
"""The separator of cells between any spaces."""
_SEPARATORS = (";", "\t", "|", ",", SPACES)
_SEP = re.compile(r'"?sep=(?P<separator>.|\\t)"?\s*', re.IGNORECASE)  # as Excel takes it
_ONLY_NUMBER = re.compile(r"\s*[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?\s*|\s*nan\s*", re.IGNORECASE)
_NUMBER = re.compile(r"\s*[-+]?(\d|[.,]\d|nan\s*$|inf)", re.IGNORECASE)
_RATE = re.compile(
    r"(?i)\b(?:sampl\w*|update|output|data|log\w*)[ _]*(?:rate|freq\w*)\W{0,6}(?P<rate>\d+(?:\.\d+)?)"
    r"\s*(?P<kilo>k?)(?:hz)?\b"
)
_COMMA = re.compile(r"[-+]?(\d*,(\d{1,2}|\d{4,})|0*,\d+|\d{1,3}(\.\d{3})+,\d+)(e[-+]?\d+)?", re.IGNORECASE)
_THOUSANDS, _POINT = re.compile(r"[-+]?\d{1,3}(,\d{3})+"), re.compile(r"[-+]?[\d,]*\.\d+")
_FACT = re.compile(
    r"""[#%/ \t]*["']?(\w{1,40})["']?\s*[,;:=\t]\s*["']?([-+]?\d*\.?\d+(?:e[-+]?\d+)?)["']?\s*""", re.IGNORECASE
)
_STAMP = re.compile(r"\d{4}([-/])\d\d\1\d\d \d\d:\d\d:\d\d")
_ROWS = 3  # alike, that show a table
_ABOVE = 3  # lines between a header and its rows, that aren't empty: units, descriptions


@dataclass(frozen=True, kw_only=True)
class CsvLayout:
    """How a table is written."""

    names: tuple[str, ...]  # names, units: of its columns; without a header their numbers
    units: tuple[str, ...]
    encoding: str
    separator: str
    decimal: str
    skipped: int  # lines before the first row of values
    is_nameless: bool = False  # whether it has no header
    rate_hz: float = 0.0  # samples a second, as a line above the table states it; 0 where none does
    facts: Mapping[str, str] = field(default_factory=dict)  # what other lines there say: a name and a number


def layout_of(path: Path) -> CsvLayout:
    """Find out how a table is written, from its first lines."""
    with path.open("rb") as file:
        head = file.read(LONGEST_LINE_BYTES)
    encoding = _encoding(head)
    lines = head.decode(encoding, errors="replace").splitlines()
    if len(head) == LONGEST_LINE_BYTES:
        lines = lines[:-1]  # cut in two
        _check_beginning(lines)
    place, separator = _header(lines)
    names = _cells(lines[place].lstrip("#%/ \t"), separator)
    check_columns([f"{number}" for number, _ in enumerate(names)])
    rows = [_cells(line, separator) for line in lines[place + 1 : place + 2 + _ABOVE] if line.strip()]
    is_nameless = _is_row(names, rows)
    if is_nameless and place and all(map(_NUMBER.match, lines[1:place])):
        header = _cells(lines[0], separator)
        if 1 < len(header) < len(names) and not any(map(_NUMBER.match, header)):  # for fewer columns than rows have
            raise InputError(more_cells(header, separator))
    skipped = place + (0 if is_nameless else 1)
    units = [""] * len(names)
    if is_nameless:
        rows, names = [names, *rows], [str(number) for number in range(1, len(names) + 1)]
    elif rows and not any(map(_NUMBER.match, rows[0])) and any(unit(text.strip(" ()[]")) for text in rows[0]):
        units = [text.strip(" ()[]") for text in rows.pop(0)]
        skipped = next(number for number in range(skipped, len(lines)) if lines[number].strip()) + 1
    if rows and len(rows[0]) == len(names) + 1 and not rows[0][-1]:
        names.append("")  # rows that end in a separator
    if rows and separator == SPACES and len(rows[0]) == len(names) + 1 and _STAMP.match(" ".join(rows[0])):
        names.insert(0, "date")  # one name stands above a date and a time of day
        units.insert(0, "")
    if rows and len(rows[0]) > len(names):
        raise InputError(more_cells(names, separator))
    above = [line for line in lines[:skipped] if len(line) < 200]  # a line that states a fact is shorter
    rate = _RATE.search("\n".join(above))
    return CsvLayout(
        names=tuple(names),
        units=tuple((units + [""] * len(names))[: len(names)]),
        encoding=encoding,
        separator=separator,
        decimal="," if rows and separator != "," and _has_decimal_commas(rows[0]) else ".",
        skipped=skipped,
        is_nameless=is_nameless,
        facts={pair[1]: pair[2] for line in above if (pair := _FACT.fullmatch(line))},
        rate_hz=float(rate["rate"]) * (1e3 if rate["kilo"] else 1.0) if rate else 0.0,
    )


def _check_beginning(lines: Sequence[str]) -> None:
    """Refuse a large file whose beginning holds no row: a million lines above a table aren't looked through."""
    if not lines:
        raise InputError(f"its first line has more than {LONGEST_LINE_BYTES} bytes; a header names the columns")
    said = (line for line in lines if not _is_comment(line))
    if not any(_ONLY_NUMBER.fullmatch(cell) for line in said for cell in re.split(r"[\s,;|]+", line)):
        raise InputError(f"its first {len(lines)} lines hold no row of numbers; cut what stands above the table")


def _header(lines: Sequence[str]) -> tuple[int, str]:
    """Return which line is the header, or the first row without one, and what separates cells."""
    told = _SEP.fullmatch(lines[0]) if lines else None
    start = 1 if told else 0
    said = (number for number in range(start, len(lines)) if lines[number].strip() and not _is_comment(lines[number]))
    place = next(said, len(lines))
    if place and (place == len(lines) or _NUMBER.match(lines[place])) and _is_comment(lines[place - 1]):
        place -= 1  # the header itself is written as a comment
    if place == len(lines):
        raise InputError("it is empty")
    if told:
        return place, told["separator"].replace("\\t", "\t")
    separator = _separator(lines, place)
    return (None if _heads_rows(lines, place, separator) else _below_a_preamble(lines)) or (place, separator)


def more_cells(names: Sequence[str], separator: str) -> str:
    """Say that rows have more cells than columns have names."""
    commas = " If decimals have commas, cells need semicolons between them." if separator == "," else ""
    return f"rows have more cells than the {len(names)} that its first line names; is that the header?{commas}"


def _separator(lines: Sequence[str], place: int) -> str:
    """Return what separates a header's cells."""
    header = lines[place].lstrip("#%/ \t")
    separator = max(_SEPARATORS[:-1], key=header.count)  # of as many, the one that no unit holds
    if separator in header:
        return separator
    below = [len(line.split()) for line in lines[place + 1 : place + 3]]
    return "," if below and max(below) == 1 else SPACES  # one column, whose name has spaces


def _heads_rows(lines: Sequence[str], place: int, separator: str) -> bool:
    """Tell whether rows with as many cells as a line has follow it, numbers among them; groups of columns head none."""
    cells = _cells(lines[place].lstrip("#%/ \t"), separator)
    names, width = list(filter(None, cells)), len(cells)
    if len(set(names)) < len(names) and not any(map(_NUMBER.match, names)):
        return False
    # facts about a recording are fewer lines
    rows = [_cells(line, separator) for line in lines[place + 1 : place + 1 + 500] if line.strip()]
    rows = [row[:-1] if len(row) == width + 1 and not row[-1] else row for row in rows]
    return width > 1 and (
        not rows
        or (all(len(row) == width for row in rows) and any(_NUMBER.match(cell) for row in rows for cell in row))
    )


def _below_a_preamble(lines: Sequence[str]) -> tuple[int, str] | None:
    """Return where the header stands of the first rows of numbers that have one width, and what separates them."""
    found: list[tuple[int, int, str]] = []
    said = [number for number, line in enumerate(lines) if line.strip()]
    for separator in _SEPARATORS:
        widths = [len(lines[k].split()) if separator == SPACES else lines[k].count(separator) + 1 for k in said]
        for i in range(len(said) - _ROWS + 1):
            width = widths[i]
            if width < 2 or widths[i : i + _ROWS] != [width] * _ROWS:
                continue
            if all(_is_of_numbers(_cells(lines[k], separator)) for k in said[i : i + _ROWS]):
                above = [j for j in range(max(0, i - _ABOVE), i) if widths[j] in (width - 1, width)]
                named = [j for j in above if not any(map(_ONLY_NUMBER.fullmatch, _cells(lines[said[j]], separator)))]
                found.append((width, said[_header_of(named, lines, said, separator) if named else i], separator))
                break
    if not found:
        return None
    _, place, separator = max(found, key=lambda one: one[0])
    return place, separator


def _header_of(named: Sequence[int], lines: Sequence[str], said: Sequence[int], separator: str) -> int:
    """Return which of the lines above some rows is their header: the last one that isn't of units."""
    for j in reversed(named):
        cells = [cell.strip(" ()[]") for cell in _cells(lines[said[j]], separator)]
        if not all(unit(cell) for cell in cells if cell and cell.lower() not in ("na", "-")):
            return j
    return named[-1]


def _is_of_numbers(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell]
    return 2 * sum(_ONLY_NUMBER.fullmatch(cell) is not None for cell in filled) > len(filled) > 0


def _is_row(names: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Tell whether what should be a header holds values as the rows below it do."""
    numbers = [_ONLY_NUMBER.fullmatch(name) is not None for name in names]
    if all(number for number, name in zip(numbers, names, strict=True) if name):
        return True
    alike = rows and [_ONLY_NUMBER.fullmatch(cell) is not None for cell in rows[0]] == numbers
    return bool(alike) and sum(numbers) > 1


def _has_decimal_commas(cells: Sequence[str]) -> bool:
    """Tell whether commas stand before decimals; where points do, three figures behind a comma are thousands."""
    if any(map(_COMMA.fullmatch, cells)):
        return True
    return any(map(_THOUSANDS.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells))


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


def _cells(line: str, separator: str) -> list[str]:
    """Cut a line into its cells; those that stand between bars at both ends are one less."""
    if separator == SPACES:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])]


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
