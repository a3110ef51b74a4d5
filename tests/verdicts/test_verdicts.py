"""The corpus of verdicts: every log is made, watched, and judged as its entry requires and as its faults do.

`make test` runs the quick entries, `make verdicts` all of them, with whole certificates.
"""

import pytest

from tests.verdicts.entries import entries
from tests.verdicts.recipes import made
from tests.verdicts.requirements import breaches, watched

QUICK, QUICK_S = 26, 3200.0  # entries, and seconds of flight, of `make test`: about 60 s of CPU, and 25 of oracles


def _marks(entry):
    if not entry.quick:
        yield pytest.mark.nightly
    if entry.xfail:
        yield pytest.mark.xfail(reason=f"issue {entry.xfail}", strict=True, raises=AssertionError)


@pytest.mark.parametrize("entry", [pytest.param(each, id=each.name, marks=[*_marks(each)]) for each in entries()])
def test_verdict(entry, request, tmp_path):
    if not entry.quick:
        request.getfixturevalue("whole_certificates")
    log = made(entry, tmp_path)
    found = breaches(entry, log, watched(entry, log))
    if entry.xfail and (others := [each for each in found if each.what not in entry.xfails]):
        pytest.fail("\n".join(map(str, others)))  # no AssertionError: not the failure that is expected
    assert "\n".join(map(str, found)) == ""


def test_few_entries_run_every_time():
    quick = [entry for entry in entries() if entry.quick]
    assert 20 <= len(quick) <= QUICK
    assert sum(entry.duration_s for entry in quick) <= QUICK_S


def test_expected_failures_name_the_issue_that_mends_them():
    reasons = [entry.xfail for entry in entries() if entry.xfail]
    assert [each for each in reasons if not each.startswith(("65: ", "66: ", "67: ", "68: "))] == []


def test_every_entry_requires_something():
    """By its faults, or in words; and no key of a table is lost."""
    empty = [
        entry.name
        for entry in entries()
        if not (entry.faults or entry.require or entry.exit or entry.never_clear or entry.never_failed)
    ]
    assert empty == []
