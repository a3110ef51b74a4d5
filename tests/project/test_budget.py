"""The house has a budget: no room grows unless somebody raises its figure in `budget.toml` and writes why."""

import tomllib
from pathlib import Path

import pytest

from tests.project.budget import as_toml, code_lines, measured

FIGURES = tomllib.loads((Path(__file__).parent / "budget.toml").read_text(encoding="utf-8"))["rooms"]
SLACK = 0.03  # of a figure: what a room has shrunk by without the figure following it
LEAST_SLACK = 5  # lines, of a small room


def complaints(rooms, figures):
    """Return what is wrong with a budget, a line each."""
    lines = []
    for room in sorted({*rooms, *figures}):
        has, may = rooms.get(room, 0), figures.get(room)
        if may is None:
            lines.append(f'{room}: {has} lines of code, and no figure in budget.toml; add it: "{room}" = {has}')
        elif has > may:
            lines.append(
                f"{room}: {has} lines of code, {has - may} above its {may}; make it smaller, or raise the figure in "
                "budget.toml and write the reason beside it"
            )
        elif not has:
            lines.append(f"{room}: no such room; delete its figure from budget.toml")
        elif may - has > max(SLACK * has, LEAST_SLACK):
            lines.append(f"{room}: only {has} lines of code are left of its {may}; lower the figure in budget.toml")
    return lines


def test_no_room_is_above_its_figure_and_every_figure_is_near():
    assert not (found := complaints(measured(), FIGURES)), "\n".join(found)


def test_every_complaint_says_which_room_and_by_how_much():
    assert complaints({"a": 100, "b/c": 100}, {"a": 100, "b/c": 100}) == []
    (above,) = complaints({"a": 103}, {"a": 100})
    assert "a: 103 lines of code, 3 above its 100" in above
    assert "raise the figure in budget.toml and write the reason beside it" in above
    assert "no figure" in complaints({"a": 1}, {})[0]
    assert "no such room" in complaints({}, {"a": 1})[0]
    assert "lower the figure" in complaints({"a": 1000}, {"a": 1031})[0]
    assert complaints({"a": 1000}, {"a": 1029}) == []


def test_what_is_printed_is_read_back():
    rooms = {".": 3, "a": 1, "b/c": 2}
    assert tomllib.loads(as_toml(rooms))["rooms"] == rooms


SOURCE = '''\
"""A module's docstring.

Over several lines.
"""

from __future__ import annotations

import os
from collections.abc import (
    Mapping,
    Sequence,
)

# a comment
TEXT = """a string

over three lines, one of them blank
"""
"""What stands below a constant is its docstring."""


@decorated(
    with_an=argument,
)
class Thing:
    """A docstring."""

    size: int = 1  # a comment beside

    def method(self):
        """Another."""
        from pathlib import Path

        return (
            self.size

            + 1
        )


import sys; after = sys.argv
def short(): "a docstring"; return 1
'''
COUNTED = [
    'TEXT = """a string',
    "over three lines, one of them blank",
    '"""',
    "@decorated(",
    "with_an=argument,",
    ")",
    "class Thing:",
    "size: int = 1  # a comment beside",
    "def method(self):",
    "return (",
    "self.size",
    "+ 1",
    ")",
    "import sys; after = sys.argv",
    'def short(): "a docstring"; return 1',
]


def test_lines_that_hold_code_are_counted_and_no_others():
    assert code_lines(SOURCE) == len(COUNTED)


@pytest.mark.parametrize("line", ["", "# a comment", '"""A docstring."""', "import os", "from os import path", "\t\n"])
def test_what_is_no_code_costs_nothing_wherever_it_stands(line):
    rows = ["x = 1", "y = f(x)", "z = [\n    x,\n    y,\n]"]
    for place in range(len(rows) + 1):
        assert code_lines("\n".join([*rows[:place], line, *rows[place:]])) == code_lines("\n".join(rows)) == 6


def test_a_room_is_a_folder_and_the_modules_beside_the_folders_are_one(tmp_path):
    for name in ("top.py", "other.py", "room/__init__.py", "room/a.py", "room/within/b.py", "empty/__init__.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text('"""Text."""\n' if "__init__" in name else "x = 1\ny = 2\n")
    assert measured(tmp_path) == {".": 4, "room": 2, "room/within": 2}
