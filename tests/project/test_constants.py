"""Constants are counted by what they are, and their comments are found where they stand."""

from tests.project.constants import BACKED, constants_of

SOURCE = """\
A = 3.5  # metres
# measured by experiments/noise.py
B, _C = 4.0, "words"
D: float = 1e-9
INDEX = 1
TEXT = "0.5"
lower = 0.5


class Kind:
    E = (
        7.0,  # of a kind
    )


def inside():
    F = 9.0
    return F
"""


def test_numbers_under_a_name_in_capitals_are_counted_wherever_a_module_keeps_them():
    found = {each.name: each.comment for each in constants_of(SOURCE)}
    assert found == {
        "A": "metres",
        "B": "measured by experiments/noise.py",
        "_C": found["B"],
        "D": "",
        "E": "of a kind",
    }


def test_a_source_a_script_or_a_range_backs_a_constant():
    backed = ["Pickands 1975", "see experiments/noise.py", "chosen; from 0.5 to 2 nothing changes", "by definition"]
    assert all(BACKED.search(comment) for comment in backed)
    assert not BACKED.search("times the usual step")
