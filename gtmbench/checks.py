"""Checks of single arguments, with one way of saying what was given and what is legal."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from numbers import Integral, Real
from typing import Any, TypeVar

from gtmbench.errors import InputError

Table = TypeVar("Table", bound=Mapping[str, Any])
_LONGEST_TEXT = 200  # bytes; a file system takes 255 of a name
_LONGEST_LINE = 2_000  # letters of a message


def number(name: str, value: Any, low: float = -math.inf, high: float = math.inf, *, above: bool = False) -> float:
    """Return a finite number in low..high (with `above`: greater than low) as a float.

    >>> number("snr", 50, 0.0, above=True)
    50.0
    """
    real = isinstance(value, Real) and not isinstance(value, bool)
    if real and low <= value <= high and abs(value) <= sys.float_info.max and not (above and value == low):
        return float(value)
    raise InputError(f"{name} is {shown(value)}; it must be a finite number{_span(low, high, above)}")


def whole(name: str, value: Any, low: int = 0, high: int = 2**31 - 1) -> int:
    """Return a whole number in low..high as an int.

    >>> whole("window", 1000)
    1000
    """
    if isinstance(value, Integral) and not isinstance(value, bool) and low <= int(value) <= high:
        return int(value)
    raise InputError(f"{name} is {shown(value)}; it must be a whole number{_span(low, high, above=False)}")


def boolean(name: str, value: Any) -> bool:
    """Return true or false, as a file has them.

    >>> boolean("isolate", True)
    True
    """
    if isinstance(value, bool):
        return value
    raise InputError(f"{name} is {shown(value)}; it must be true or false")


def names(what: str, given: Any) -> tuple[str, ...]:
    """Return a tuple of names, each given once; one name may come as a string.

    >>> names("inputs", "p")
    ('p',)
    """
    listed = tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else (given,)
    for name in listed:
        if not isinstance(name, str):
            raise InputError(f"{what} holds {shown(name)}; give names of channels")
        if listed.count(name) > 1:
            raise InputError(f"'{name}' is given twice in {what}; name every channel once")
    return listed


def text(name: str, value: Any) -> str:
    """Return a short text that a line, a figure and a terminal can show.

    >>> text("title", "Drifts")
    'Drifts'
    """
    if isinstance(value, str) and value.strip() and value.isprintable() and len(value.encode()) <= _LONGEST_TEXT:
        return value
    raise InputError(f"{name} is {shown(value)}; it must be a short text, at most {_LONGEST_TEXT} bytes in one line")


def table_of(name: str, value: Any, written: str = "") -> dict[str, Any]:
    """Return a table of a file; `written`: how one is written there, where not as ``[name]``.

    >>> table_of("alarm", {"window": 10})
    {'window': 10}
    """
    if isinstance(value, dict):
        return value
    raise InputError(f"{name} is {shown(value)}; it must be a table, {written or f'[{name}]'}")


def keys(table: Table, legal: Iterable[str], *, where: str = "", section: str = "", there: str = "there are") -> Table:
    """Return a table of a file, all of whose keys are legal; a message names a place before, or a section within.

    >>> keys({"widow": 10}, ["window"], section="alarm")
    Traceback (most recent call last):
        ...
    gtmbench.errors.InputError: unknown key 'widow' in [alarm]; there are window; did you mean 'window'?
    """
    known = tuple(legal)
    for key in table:
        if key not in known:
            before, within = f"{where}: " if where else "", f" in [{section}]" if section else ""
            legal = f"{there} {', '.join(known) or 'none'}{meant(key, known)}"
            raise InputError(f"{before}unknown key {shown(key)}{within}; {legal}")
    return table


@contextmanager
def naming(where: object) -> Iterator[None]:
    """Begin the message of an error of input by where it is: a file, a table, a key.

    >>> with naming("mine.toml"):
    ...     whole("seed", -1)
    Traceback (most recent call last):
        ...
    gtmbench.errors.InputError: mine.toml: seed is -1; it must be a whole number, 0 or more, at most 2147483647
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def listed(items: Iterable[str], word: str = "and") -> str:
    """Write names as a sentence lists them.

    >>> listed(["p"]), listed(["p", "q", "r"]), listed(["p", "q"], "or")
    ('p', 'p, q and r', 'p or q')
    """
    *most, last = items
    return f"{', '.join(most)} {word} {last}" if most else last


def meant(given: Any, known: Iterable[str]) -> str:
    """Return how a message ends that lists what there is, where one of it is likely meant, in whatever case.

    >>> meant("sed", ["seed", "aircraft"]), meant("c", ["B", "C"]), meant("x", ["seed"])
    ("; did you mean 'seed'?", "; did you mean 'C'?", '')
    """
    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(str(given)[:_LONGEST_TEXT].lower(), by_lower, n=1)
    return f"; did you mean '{by_lower[close[0]]}'?" if close else ""


def shown(value: Any) -> str:
    """Return a value as a message shows it: as written, and not too much of it."""
    try:
        written = str(value) if isinstance(value, Real) and not isinstance(value, bool) else repr(value)
    except ValueError:  # an integer of thousands of digits
        return "a number of thousands of digits"
    except RecursionError:
        return "lists or tables in hundreds of others"
    return written if len(written) <= 60 else f"{written[:57]}..."


def printable(line: str) -> str:
    r"""Return a line without what a terminal would take for commands: files may be called, and hold, anything.

    >>> printable("gyro\x1b[2J")
    'gyro?[2J'
    """
    return line if line.isprintable() else "".join(letter if letter.isprintable() else "?" for letter in line)


def one_line(message: str) -> str:
    r"""Return a message in one printable line, and not without end.

    >>> one_line("gyro\x1b[2J\nx")
    'gyro?[2J x'
    """
    plain = printable(" ".join(message[: 2 * _LONGEST_LINE].split()))
    return plain if len(plain) <= _LONGEST_LINE else f"{plain[:_LONGEST_LINE]} ..."


def _span(low: float, high: float, above: bool) -> str:
    bottom = "" if low == -math.inf else f" greater than {low:.10g}" if above else f", {low:.10g} or more"
    return bottom if high == math.inf else f"{bottom}, at most {high:.10g}"
