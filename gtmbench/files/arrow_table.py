"""Tables of plain rows with columns that are known beforehand: what each one's type is, and what it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]


class Column(NamedTuple):
    """A column: its type, as Arrow calls it, and what it holds."""

    type: str
    meaning: str


def table_of(rows: Sequence[Row], columns: Mapping[str, Column], *, schema: int) -> pa.Table:
    """Return rows as a table with the columns' meanings and the schema's number in it; what a row lacks is null.

    >>> table_of([{"task": 3}], {"task": Column("int32", "of the run"), "error": Column("string", "why")}, schema=1)[
    ...     "error"
    ... ].to_pylist()
    [None]
    """
    import pyarrow as pa

    named = pa.schema(_fields(columns), metadata={"gtmbench.schema": str(schema)})
    return pa.Table.from_pylist(list(rows), schema=named)


def described(table: pa.Table, columns: Mapping[str, Column]) -> pa.Table:
    """Return a table with the meanings of its columns, which parts don't repeat.

    >>> columns = {"task": Column("int32", "of the run")}
    >>> parts = table_of([{"task": 3}], columns, schema=1).to_pandas()
    >>> import pyarrow as pa
    >>> described(pa.table(parts), columns).schema.field("task").metadata
    {b'meaning': b'of the run'}
    """
    import pyarrow as pa

    return table.cast(pa.schema(_fields({name: columns[name] for name in table.column_names})))


def _fields(columns: Mapping[str, Column]) -> list[pa.Field]:
    import pyarrow as pa

    return [
        pa.field(name, pa.type_for_alias(column.type), metadata={"meaning": column.meaning})
        for name, column in columns.items()
    ]
