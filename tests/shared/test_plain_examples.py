"""Files, digests and plain values, by example."""

import math
from pathlib import Path

import numpy as np
import pyarrow as pa

from gtmbench.export.source import number
from gtmbench.files.artefacts import file_name
from gtmbench.files.locks import lock_beside
from gtmbench.files.plain import Column, described, dumps, exact, finite_or_none, plain, table_of
from gtmbench.jobs.cluster import difference


def test_described():
    columns = {"task": Column("int32", "of the run")}
    parts = table_of([{"task": 3}], columns, schema=1).to_pandas()
    assert described(pa.table(parts), columns).schema.field("task").metadata == {b"meaning": b"of the run"}


def test_export():
    assert (number(0.1), number(2.0), number(math.inf), number(-1e-12)) == (
        "0.100000001f",
        "2.0f",
        "INFINITY",
        "-9.99999996e-13f",
    )


def test_jobs():
    assert (
        difference({"numpy": "2.1", "scipy": "1.14"}, {"numpy": "2.0", "scipy": "1.14"}) == "numpy 2.0 instead of 2.1"
    )


def test_files():
    assert (file_name("tests/test_gyros.py::test_jam[p-0.5]"), file_name("../../x")) == (
        "tests-test_gyros-test_jam-p-0-5-e1f72825",
        "x-9cdf6a50",
    )
    assert lock_beside(Path("results/study")).as_posix() == "results/.study.gtmbench-lock"


def test_files_plain():
    assert exact({"limits": np.array([1.0, 2.0]), "w": np.int64(3)}) == {"limits": [1.0, 2.0], "w": 3}
    assert (finite_or_none(math.nan), finite_or_none(True), finite_or_none(1j)) == (None, True, "1j")
    assert plain({"sigma": np.array([1.0, np.nan]), 3: ("a", None)}) == {"sigma": [1.0, None], "3": ["a", None]}
    assert dumps({"b": 1, "a": [0.5]}) == '{"b": 1, "a": [0.5]}'
    assert table_of([{"task": 3}], {"task": Column("int32", "of the run"), "error": Column("string", "why")}, schema=1)[
        "error"
    ].to_pylist() == [None]
