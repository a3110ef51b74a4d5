"""Cells of anybody's CSV, put anew where they stand: not a byte of the others changes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.formats.csv import SPACES, CsvLayout, layout_of
from gtmbench.intake.formats.limits import reading
from gtmbench.intake.formats.raw import Cells

_EXACT = 15  # decimals: a column with as many is written by programs that leave nothing out
_QUOTED = r'[ \t]*"(?:[^"]|"")*"'
_CELL = re.compile(r'(?P<before>\s*"?\s*)(?P<number>[^"\s]*)(?P<after>\s*"?\s*)')
_DECIMALS = re.compile(r"[-+]?\d*(?:\.(?P<decimals>\d*))?")


@dataclass(frozen=True, kw_only=True)
class Notation:
    """How a column's numbers are written."""

    least: int  # least, most: decimals: of its cells that have the fewest, and the most
    most: int
    decimal: str = "."  # what stands before them
    missing: str = ""  # what stands for no number

    @classmethod
    def of(cls, numbers: Sequence[str], decimal: str = ".", missing: str = "") -> Notation:
        """Find it out from a column's numbers; of numbers with exponents as if they had all decimals.

        >>> Notation.of(["0.50", "-1.25"]).text(2.0), Notation.of(["0.5", "-1.25"]).text(2.0)
        ('2.00', '2.0')
        """
        counts = [
            len(told["decimals"] or "") if (told := _DECIMALS.fullmatch(number.replace(decimal, "."))) else _EXACT
            for number in numbers
        ]
        return cls(least=min(counts, default=0), most=max(counts, default=_EXACT), decimal=decimal, missing=missing)

    def text(self, value: float) -> str:
        """Write a number with as many decimals as its column has, exactly where it has all that there are."""
        if math.isnan(value):
            return self.missing
        if self.most >= _EXACT:
            return repr(float(value)).replace(".", self.decimal)
        whole, _, decimals = f"{value:.{self.most}f}".partition(".")
        kept = decimals[: self.least] + decimals[self.least :].rstrip("0")
        return f"{whole}{self.decimal}{kept}" if kept else whole


def rewrite_csv(path: Path, out: Path, cells: Sequence[Cells]) -> None:
    """Write a table anew with other values in some cells.

    What stays is the same byte by byte: encoding, line ends, separators, quotes, comments, every other cell. A value is
    written with its column's decimals; where it is missing, the cell is left empty.
    """
    with reading(path, "CSV table"):
        layout = layout_of(path)
        missing = "nan" if layout.separator == SPACES else ""  # a cell between spaces can't be empty
        places = {layout.names.index(each.column.name): each for each in cells}
        texts = _texts(path, layout, list(places))
        new: dict[int, dict[int, str]] = {}
        for place, each in places.items():
            found = np.array([_number(text, layout.decimal) for text in texts[place]])
            was = each.column.values()
            if len(was) != len(found) or not np.allclose(was[each.rows], found[each.rows], rtol=1e-12, atol=0.0):
                raise InputError(
                    f"the cells of column '{each.column.name}' aren't distinct in the file; write it plainly"
                )
            written = [text for text, value in zip(texts[place], found.tolist(), strict=True) if math.isfinite(value)]
            notation = Notation.of(written, layout.decimal, missing)
            for row, value in zip(each.rows.tolist(), each.values.tolist(), strict=True):
                new.setdefault(row, {})[place] = notation.text(value)
        _write(path, out, layout, new)


def _write(path: Path, out: Path, layout: CsvLayout, new: Mapping[int, Mapping[int, str]]) -> None:
    row = -1
    encoding, errors = _coding(path, layout)
    with out.open("w", newline="", encoding=encoding, errors=errors) as file:
        for line, is_row in _lines(path, layout):
            row += is_row
            file.write(_with(line, layout, new[row]) if is_row and row in new else line)


def _with(line: str, layout: CsvLayout, new: Mapping[int, str]) -> str:
    """Return a row with other numbers in some of its cells."""
    pieces = _pieces(line, layout)
    for place, number in new.items():
        at = _at(place, layout)
        told = _CELL.fullmatch(pieces[at])
        assert told is not None  # a number was read from it
        pieces[at] = f"{told['before']}{number}{told['after']}"
    return ("" if layout.separator == SPACES else layout.separator).join(pieces)


def _texts(path: Path, layout: CsvLayout, places: Sequence[int]) -> dict[int, list[str]]:
    """Return the numbers of some columns as they are written, "" where there is none."""
    texts: dict[int, list[str]] = {place: [] for place in places}
    for line, is_row in _lines(path, layout):
        if is_row:
            pieces = _pieces(line, layout)
            for place in places:
                at = _at(place, layout)
                texts[place].append(pieces[at].strip(' \t\r\n"') if at < len(pieces) else "")
    return texts


def _lines(path: Path, layout: CsvLayout) -> Iterator[tuple[str, bool]]:
    """Give a table's lines with their ends, and whether each is a row of values; one may hold quoted line ends."""
    encoding, errors = _coding(path, layout)
    with path.open(newline="", encoding=encoding, errors=errors) as file:
        held = ""
        for number, line in enumerate(file):
            if number < layout.skipped:
                yield line, False
                continue
            held += line
            if '"' not in held or not _is_open(held, layout):
                yield held, bool(held.strip(" \t\r\n".replace(layout.separator, "")))
                held = ""
        if held:
            yield held, True


def _coding(path: Path, layout: CsvLayout) -> tuple[str, str]:
    """Return by which codec a file comes back as it is, a byte order mark and what is no text included."""
    if layout.encoding == "utf-16":
        with path.open("rb") as file:
            return ("utf-16-le" if file.read(1) == b"\xff" else "utf-16-be"), "surrogatepass"
    return ("utf-8" if layout.encoding == "utf-8-sig" else layout.encoding), "surrogateescape"


def _pieces(line: str, layout: CsvLayout) -> list[str]:
    """Cut a row into its cells; where spaces separate them, these lie between, and come first.

    >>> layout = CsvLayout(names=(), units=(), encoding="", separator=";", decimal=".", skipped=0)
    >>> _pieces('1; "a;b";3', layout)
    ['1', ' "a;b"', '3']
    """
    if layout.separator == SPACES:
        return re.split(rf"({_QUOTED}\S*|\S+)", line)
    if '"' not in line:
        return line.split(layout.separator)
    between = re.escape(layout.separator)  # a cell, quoted or not, stands at the line's start or behind it
    return [found[0] for found in re.finditer(rf"(?:^|(?<={between}))(?:{_QUOTED})?[^{between}]*", line)]


def _at(place: int, layout: CsvLayout) -> int:
    """Return which of a row's pieces is a column's cell."""
    return 2 * place + 1 if layout.separator == SPACES else place


def _is_open(line: str, layout: CsvLayout) -> bool:
    """Tell whether a quoted cell goes on in the next line."""
    pieces = _pieces(line, layout)
    last = pieces[-2 if layout.separator == SPACES and len(pieces) > 1 else -1]
    return last.lstrip(" \t").startswith('"') and not re.match(_QUOTED, last)


def _number(text: str, decimal: str) -> float:
    try:
        return float(text.replace(decimal, "."))
    except ValueError:
        return math.nan
