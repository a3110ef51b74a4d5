"""A history's file: every flight once, bit for bit, whoever writes meanwhile; damage is told, and nothing is lost."""

import subprocess
import sys

import numpy as np
import pytest

from gtmbench.errors import InputError
from gtmbench.history.entry import Entry, enter, history_file, read_history
from tests.history.flights import flight, flights

ENTERS = """
import sys
from gtmbench.history.entry import Entry
from gtmbench.history.entry import enter
from pathlib import Path
for number in range(6):
    enter(Path(sys.argv[1]), Entry(digest=f"{sys.argv[2]} {number}", log="", airframe="a"))
"""


def test_what_is_entered_is_read_back_bit_for_bit(tmp_path):
    random, means, flown = flights(1, 6, temperature_c=21.5)
    flown.append(flight(random, 7, means, airframe="b"))
    flown.append(Entry(digest="x", log="none.csv", airframe="b", begins=True))
    path = tmp_path / "history.parquet"
    assert all(enter(path, each) for each in flown)
    read = read_history(path)
    assert [each.log for each in read] == [each.log for each in flown]
    assert read[7].begins
    assert not read[0].begins
    for was, now in zip(flown, read, strict=True):
        assert [each.value for each in now.constants] == [each.value for each in was.constants]
        assert np.isnan(now.temperature_c) == np.isnan(was.temperature_c)


def test_a_log_is_entered_once(tmp_path):
    _, _, (first, *_) = flights(2, 2)
    path = tmp_path / "history.parquet"
    assert enter(path, first)
    before = path.read_bytes()
    assert not enter(path, first)
    assert path.read_bytes() == before


def test_a_log_takes_two_kilobytes_at_most(tmp_path):
    _, _, flown = flights(3, 20, imus=("", "IMU2"))
    path = tmp_path / "history.parquet"
    for each in flown:
        enter(path, each)
    assert path.stat().st_size / len(flown) < 2000


@pytest.mark.nightly
def test_processes_that_write_at_once_lose_nothing(tmp_path):
    path = tmp_path / "history.parquet"
    running = [subprocess.Popen([sys.executable, "-c", ENTERS, str(path), name]) for name in ("one", "other")]
    assert [each.wait() for each in running] == [0, 0]
    assert {each.digest for each in read_history(path)} == {
        f"{name} {number}" for name in ("one", "other") for number in range(6)
    }


@pytest.mark.parametrize("damage", ["cut", "bit", "text", "table"])
def test_a_damaged_file_is_told_and_stays_as_it_is(tmp_path, damage):
    _, _, (first, second, *_) = flights(4, 3)
    path = tmp_path / "history.parquet"
    enter(path, first)
    content = path.read_bytes()
    if damage == "table":
        import pandas as pd

        pd.DataFrame({"p": [1.0]}).to_parquet(path)
    else:
        half = len(content) // 2
        flipped = bytes([*content[:half], content[half] ^ 1, *content[half + 1 :]])
        path.write_bytes({"cut": content[:half], "bit": flipped, "text": b"time_s,p"}[damage])
    damaged = path.read_bytes()
    with pytest.raises(InputError, match=r"history\.parquet.*it is left as it is"):
        enter(path, second)
    assert path.read_bytes() == damaged


def test_a_folder_of_logs_keeps_its_history_hidden_in_it(tmp_path):
    assert history_file(tmp_path).parent == tmp_path
    assert history_file(tmp_path).name.startswith(".")
    assert history_file(tmp_path / "a.parquet") == tmp_path / "a.parquet"


def test_a_folder_that_is_missing_is_told(tmp_path):
    with pytest.raises(InputError, match="doesn't exist; create it first"):
        enter(tmp_path / "none" / "a.parquet", Entry(digest="x", log="", airframe="a"))
