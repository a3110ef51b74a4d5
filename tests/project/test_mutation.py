"""Mutants of a source change what it does, each in one place, and the tests that execute its line are found."""

import ast

from tests.mutation.mutants import mutants

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
