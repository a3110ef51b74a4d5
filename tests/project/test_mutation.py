"""Mutants of a source change what it does, each in one place, and the tests that execute its line are found."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.mutation.__main__ import equivalents, lists
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


def test_what_is_listed_as_changing_nothing_still_stands_there(monkeypatch):
    """The change itself lies in the piece that an entry names."""
    monkeypatch.chdir(ROOT)
    there = {file: list(mutants(file, (ROOT / file).read_text())) for file in {each["file"] for each in equivalents()}}
    gone = [each for each in equivalents() if not any(lists(each, mutant) for mutant in there[each["file"]])]
    assert not gone, f"take these out of equivalent.toml, or say what they have become: {gone}"


TRIALS = """
import json
from pathlib import Path
from tests.mutation.mutants import Mutant
from tests.mutation.trial import tried

def mutant(file, before, after, *names):
    begin = Path(file).read_text().index(before)
    return Mutant(file, 1, begin, begin + len(before), before, after, names, "")

inputs, verdict = "gtmbench/method/selection/inputs.py", "gtmbench/verdict/verdict.py"
chosen = f"{inputs}::gtmbench.method.selection.inputs.select_inputs"
outcome = f"{verdict}::gtmbench.verdict.verdict.Outcome"
trials = [
    (mutant(inputs, "np.argmin(bic)", "np.argmax(bic)"), [chosen], 1.0),
    (mutant(inputs, "np.argmin(bic)", "np.argmin( bic)"), [chosen], 1.0),
    (mutant(verdict, "= 3", "= 4", "Outcome"), [outcome], 1.0),
    (mutant(verdict, "= 3", "=  3", "Outcome"), [outcome], 1.0),
]
print(json.dumps([[*failed, ""][0] for _, failed in tried(trials)]))
"""


@pytest.mark.nightly
def test_what_is_put_in_place_and_what_is_imported_anew_is_what_tests_run():
    """Although pytest imports packages that ship a plugin by itself; and what changes nothing fails nothing."""
    told = subprocess.run([sys.executable, "-c", TRIALS], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    inputs, unchanged, verdict, as_before = json.loads(told)
    assert (inputs.endswith("select_inputs"), unchanged, verdict.endswith("Outcome"), as_before) == (True, "", True, "")
