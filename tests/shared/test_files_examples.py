"""Tables of plain values, by example."""

import pyarrow as pa

from gtmbench.files.plain import Column, described, table_of


def test_table_of():
    assert table_of([{"task": 3}], {"task": Column("int32", "of the run"), "error": Column("string", "why")}, schema=1)[
        "error"
    ].to_pylist() == [None]


def test_described():
    columns = {"task": Column("int32", "of the run")}
    parts = table_of([{"task": 3}], columns, schema=1).to_pandas()
    assert described(pa.table(parts), columns).schema.field("task").metadata == {b"meaning": b"of the run"}
