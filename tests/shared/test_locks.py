"""One folder, one writer: the second is told who is there; a dead one's lock is taken over, wherever it died."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gtmbench as gb
from gtmbench.files import locks

ROOT = Path(__file__).parents[2]
HOLDING = """
import sys, time
from pathlib import Path
from gtmbench.files.locks import alone
with alone(Path(sys.argv[1]), "a run is at work"):
    print("held", flush=True)
    time.sleep(60)
"""
ELSEWHERE = "filelock/2\npid=7\nhost=another\nmode=lease\ntoken=abc\nduration={duration!r}\nuser=ann\nmachine=another\n"


@pytest.fixture
def holder(tmp_path):
    """A process that holds a lock."""
    command = [sys.executable, "-c", HOLDING, str(tmp_path / "lock")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert process.stdout.readline() == b"held\n"
    yield process
    process.kill()
    process.communicate()


def test_the_second_is_told_who_holds_it_since_when(holder, tmp_path):
    with pytest.raises(gb.InputError) as told, locks.alone(tmp_path / "lock", "a run is at work"):
        pass
    said = str(told.value)
    assert said.startswith("a run is at work: ")
    assert f"process {holder.pid}, since 2" in said
    assert "wait for it, or end it" in said
    assert "\n" not in said


def test_of_a_process_that_was_killed_it_is_taken_over_at_once(holder, tmp_path):
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert (tmp_path / "lock").exists()
    began = time.monotonic()
    with locks.alone(tmp_path / "lock", "a run is at work"):
        pass
    assert time.monotonic() - began < 1.0
    assert not (tmp_path / "lock").exists()


def test_of_a_process_that_was_killed_as_it_made_it_it_is_taken_over_in_seconds(tmp_path):
    (tmp_path / "lock").touch()
    began = time.monotonic()
    with locks.alone(tmp_path / "lock", "a run is at work"):
        pass
    assert time.monotonic() - began < 5.0


def elsewhere(lock, age_s):
    """Leave the lock of another machine's process, whose last sign of life is so old."""
    lock.write_text(ELSEWHERE.format(duration=locks.LEASE_S))
    os.utime(lock, (time.time() - age_s,) * 2)


def test_of_another_machine_it_is_respected_while_it_shows_signs_of_life(tmp_path):
    elsewhere(tmp_path / "lock", age_s=5.0)
    with (
        pytest.raises(gb.InputError, match=r"at work: ann on another, process 7, seen 5 s ago; wait for it"),
        locks.alone(tmp_path / "lock", "a run is at work"),
    ):
        pass
    assert (tmp_path / "lock").exists()


def test_of_another_machine_it_is_taken_over_once_no_sign_has_come(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "LEASE_S", 1.0)
    elsewhere(tmp_path / "lock", age_s=500.0)
    with (
        pytest.warns(gb.NoteWarning, match="ann on another, process 7, seen 500 s ago; it seems dead, and is if it"),
        locks.alone(tmp_path / "lock", "a run is at work"),
    ):
        assert f"pid={os.getpid()}" in (tmp_path / "lock").read_text()
    assert not (tmp_path / "lock").exists()


def test_who_was_taken_for_dead_is_told_afterwards(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "LEASE_S", 0.3)

    def work():
        with locks.alone(tmp_path / "lock", "a run is at work"):
            (tmp_path / "lock").unlink()
            elsewhere(tmp_path / "lock", age_s=0.0)
            time.sleep(0.6)

    with pytest.raises(gb.GtmbenchError, match=r"stood still for 0\.3 s, and was taken for dead"):
        work()
    assert "host=another" in (tmp_path / "lock").read_text()  # and leaves the other one's lock alone


def test_a_lock_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(gb.InputError, match="can't write"), locks.alone(tmp_path / "file/lock", "a run"):
        pass


def test_a_name_may_be_as_long_as_the_system_takes_it(cli, tmp_path):
    name = "x" * 250 + ".toml"
    assert cli("run", "--new", name) == (0, f"Wrote {name}; edit it, then run: gtmbench run {name}\n", "")
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.nightly
def test_two_commands_at_one_file_one_wins_and_one_is_told(tmp_path):
    """Both are begun at once; whoever comes second is told, by the lock or by what the first has written."""
    command = [
        sys.executable,
        "-m",
        "gtmbench",
        "fly",
        "--duration",
        "5",
        "--out",
        str(tmp_path / "mine.csv"),
        "--quiet",
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    both = [subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    said = [process.communicate()[1] for process in both]
    assert sorted(process.returncode for process in both) == [0, 2]
    (told,) = filter(None, said)
    assert "mine.csv" in told
    assert told.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["mine.csv"]
