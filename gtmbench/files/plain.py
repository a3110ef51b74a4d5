"""Plain values, and how they are written: JSON without NaN, how every ``--json`` begins, tables with what they hold."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pyarrow as pa


def exact(value: Any) -> Any:
    """Return a value for a file that is read back bit for bit: arrays and tuples as lists, numpy's numbers as Python's.

    Anything else stays what it is: `dumps` refuses what JSON can't hold, so that nothing is lost in silence.
    """
    if hasattr(value, "tolist"):  # numpy's arrays and numbers
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: exact(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [exact(entry) for entry in value]
    return value


def finite_or_none(value: Any) -> Any:
    """Return what is no table or list as a report has it: NaN and infinities as None, a path or a name as words."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | None) else str(value)


def plain(value: Any, leaf: Callable[[Any], Any] = finite_or_none) -> Any:
    """Return a value for a report: tables of words, lists, and leaves as `leaf` writes them; dataclasses are tables."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry, leaf) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry, leaf) for entry in value]
    if hasattr(value, "tolist"):  # of numpy and of pandas
        return plain(value.tolist(), leaf)
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name), leaf) for field in fields(value)}
    return leaf(value)


def attributes(value: object, *names: str) -> dict[str, Any]:
    """Return attributes by their names as a table, in the order of these; None each where there is no value."""
    return {name: None if value is None else getattr(value, name) for name in names}


def dumps(value: Any, indent: int | None = None) -> str:
    """Write a plain value as JSON, keys in the order given; a ValueError where it holds NaN or infinities."""
    return json.dumps(value, indent=indent, allow_nan=False)


Row = dict[str, Any]


class Column(NamedTuple):
    """A column: its type, as Arrow calls it, and what it holds."""

    type: str
    meaning: str


def table_of(rows: Sequence[Row], columns: Mapping[str, Column], *, schema: int) -> pa.Table:
    """Return rows as a table with the columns' meanings and the schema's number in it; what a row lacks is null."""
    import pyarrow as pa

    named = pa.schema(_fields(columns), metadata={"gtmbench.schema": str(schema)})
    return pa.Table.from_pylist(list(rows), schema=named)


def described(table: pa.Table, columns: Mapping[str, Column]) -> pa.Table:
    """Return a table with the meanings of its columns, which parts don't repeat."""
    import pyarrow as pa

    return table.cast(pa.schema(_fields({name: columns[name] for name in table.column_names})))


def _fields(columns: Mapping[str, Column]) -> list[pa.Field]:
    import pyarrow as pa

    return [
        pa.field(name, pa.type_for_alias(column.type), metadata={"meaning": column.meaning})
        for name, column in columns.items()
    ]


SCHEMA_VERSION = 5  # the next where a key is renamed or goes; a new key needs none


def envelope(
    command: str,
    verdict: str,
    own: Mapping[str, Any],
    *,
    exit_code: int = 0,
    findings: Iterable[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return what a command prints as one JSON-ready object: the same five keys first, then its own.

    `command`: names the schema, too: a file of ``gtmbench/schemas/``. `verdict`: the sentence that the command prints
    first without ``--json``. `own`: the command's own keys; NaN and infinities become None. `findings`: what was found,
    a row each; `text` says it in words.

    >>> list(envelope("fly", "Wrote flight.csv.", {"out": "flight.csv"}))
    ['verdict', 'exit_code', 'findings', 'schema_version', 'command', 'out']
    """
    first = {
        "verdict": verdict,
        "exit_code": exit_code,
        "findings": list(findings),
        "schema_version": SCHEMA_VERSION,
        "command": command,
    }
    return dict(plain({**first, **own}))
