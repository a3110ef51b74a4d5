"""Mutants of a source change what it does, each in one place, and the tests that execute its line are found."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests.mutation.mutants import mutants

ROOT = Path(__file__).parents[2]
SOURCE = '''
"""A number of 3 in prose."""
LEAST, MOST = 2, 5.0


def held(size, limits=(0.5,), *, far=False):
    """Return 1."""
    if far and size < MOST:
        raise ValueError("more than 7 of " + str(size - 1))
    for each in limits:
        if each is None:
            continue
        size = -max(size, each) + f"{size + 1}".count("é")
    return size if far else not size
'''


def test_each_place_that_decides_is_changed_and_no_word():
    made = mutants("held.py", SOURCE)
    changes = [(each.line, each.before, each.after) for each in made]
    assert changes == [
        (3, "2", "3"),
        (3, "5.0", "6.50000"),
        (6, "0.5", "0.650000"),
        (6, "False", "True"),
        (8, "and", "or"),
        (8, "<", "<="),
        (11, "is", "is not"),
        (12, "continue", "break"),
        (13, "-", ""),
        (13, "max", "min"),
        (13, "+", "-"),
        (14, "far", "(not far)"),
        (14, "not", ""),
    ]
    assert [each.names for each in made[:4]] == [("LEAST",), ("MOST",), ("held",), ("held",)]


def test_every_mutant_can_be_read_and_differs_in_one_place():
    whole = ast.dump(ast.parse(SOURCE))
    for each in mutants("held.py", SOURCE):
        text = each.applied(SOURCE)
        assert ast.dump(ast.parse(text)) != whole
        assert text[: each.begin] == SOURCE[: each.begin]
        assert text[each.begin + len(each.after) :] == SOURCE[each.end :]


@pytest.mark.nightly
def test_the_module_that_a_trial_imports_is_the_changed_one(tmp_path):
    """Although pytest imports packages that ship a plugin by itself."""
    file = Path("gtmbench/method/selection/inputs.py")
    text = (ROOT / file).read_text()
    (tmp_path / "source").write_text(text.replace("np.argmin(bic)", "np.argmax(bic)"))
    (tmp_path / "tests").write_text(f"{file}::gtmbench.method.selection.inputs.select_inputs")
    command = [sys.executable, "-m", "tests.mutation.trial", file, tmp_path / "source", tmp_path / "tests", "0"]
    assert subprocess.run(command, cwd=ROOT, check=False, capture_output=True).returncode == 1
    (tmp_path / "source").write_text(text)
    assert subprocess.run(command, cwd=ROOT, check=False, capture_output=True).returncode == 0
