"""How a table is written: encoding, separator, decimals, what stands above its rows, and whether it has a header."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import LONGEST_LINE_BYTES, check_columns
from gtmbench.intake.units import unit

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
_LONGEST_FACT = 200  # characters of a line that states a fact
_LOOKED_AT = 500  # lines: facts about a recording are fewer
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
        if 1 < len(header) < len(names) and not any(
            map(_NUMBER.match, header)
        ):  # it names fewer columns than rows have
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
    above = [line for line in lines[:skipped] if len(line) < _LONGEST_FACT]
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
    rows = [_cells(line, separator) for line in lines[place + 1 : place + 1 + _LOOKED_AT] if line.strip()]
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
