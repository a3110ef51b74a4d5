"""Files that once got through a door, or brought its library down (`tests/damaged/`): read, or refused in one line."""

import resource

import pytest

from tests.helpers.doors import DamagedFile, Door, damaged_files, described, tried
from tests.helpers.night import by_day
from tests.intake.test_intake_hostile import damaged


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.parametrize("each", damaged_files(), ids=lambda each: each.name)
def test_what_was_found_once_is_found_no_more(each, tmp_path):
    door, before_mb = Door(each.door, tmp_path), peak_mb()
    content = each.content(door)
    assert content != door.whole
    assert tried(door, content) == ""
    assert peak_mb() - before_mb < 300.0


@pytest.mark.parametrize("name", by_day(["log.csv", "log.parquet", "monitor.json"]))
def test_a_find_is_described_so_that_it_can_be_made_again(name, tmp_path):
    import tomllib

    door = Door(name, tmp_path)
    assert tried(door, door.whole) == ""
    for seed in range(3):
        data = damaged(door.whole, f"described {name} {seed}")
        of, text = described(door, data, 'a "find"')
        told = DamagedFile(name=of, **tomllib.loads(text))
        assert (told.content(door), told.found, told.door) == (data, 'a "find"', name)
        assert len(text) < 150_000


def test_every_way_of_being_tried_is_told_apart(tmp_path):
    class Odd(Door):
        def take(self, data):
            raise {b"a": ValueError("x"), b"b": MemoryError()}[data]

    door = Odd("log.csv", tmp_path)
    assert tried(door, b"a").startswith("ValueError in test_damaged_files.py:")
    assert tried(door, b"b").startswith("MemoryError in ")
