"""What is written is whole and on the disk, or one line says which file isn't, and why; what stood there stands."""

import errno
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb

import gtmbench as gb
from gtmbench.files import writing
from gtmbench.files.folders import SUMS, atomic_folder, check_folder, read_sums
from gtmbench.files.writing import atomic_write
from gtmbench.report.recording.entities import recorded
from tests.helpers.night import by_day

ROOT = Path(__file__).parents[2]
FULL = r"File too large; make room or choose another place; what stood there before still stands"


@contextmanager
def most_bytes(size):
    """Let no file of this process grow beyond a size: as a full disk does, but for the reason."""
    former = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, former[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, former)


def record(path, samples=20_000):
    with recorded(path, "test", rrb.Blueprint()) as recording:
        values = np.random.default_rng(1).standard_normal((samples, 2))
        recording.log_lines("/sensors/rates", np.arange(samples) / 100.0, values, ["p", "q"], ["#102030"] * 2)


@pytest.mark.parametrize("size", [5_000, 60_000, 300_000])
def test_a_recording_that_the_disk_doesnt_take_is_told_and_the_old_one_stays(tmp_path, size):
    path = tmp_path / "study.rrd"
    path.write_bytes(b"before")
    with most_bytes(size), pytest.raises(gb.GtmbenchError, match=rf"^can't write {path}: {FULL}$"):
        record(path)
    assert path.read_bytes() == b"before"
    assert [each.name for each in tmp_path.iterdir()] == ["study.rrd"]
    record(path)
    assert path.stat().st_size > 300_000


def test_a_write_that_fails_is_one_line_with_the_file_and_the_reason(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("before")
    with (
        most_bytes(5000),
        pytest.raises(gb.GtmbenchError, match=rf"^can't write {path}: {FULL}"),
        atomic_write(path) as aside,
    ):
        aside.write_text("x" * 10_000)
    assert path.read_text() == "before"
    with pytest.raises(FileNotFoundError, match=r"log\.csv"), atomic_write(path) as aside:
        (tmp_path / "log.csv").read_text()  # another file's trouble stays its own


def test_a_folder_that_is_removed_meanwhile_is_told(tmp_path):
    (tmp_path / "results").mkdir()

    def write():
        with atomic_write(tmp_path / "results/result.txt") as aside:
            (tmp_path / "results").rename(tmp_path / "gone")
            aside.write_text("x")

    with pytest.raises(gb.GtmbenchError, match=r"can't write .*result\.txt: No such file or directory"):
        write()


def test_a_folder_lists_the_digest_of_every_file_as_sha256sum_does(tmp_path):
    for texts in ({"a.txt": "a", "b.txt": "b"}, {"b.txt": "B"}):
        with atomic_folder(tmp_path / "out") as aside:
            (aside / "seed-1").mkdir(exist_ok=True)
            for name, text in texts.items():
                (aside / name).write_text(text)
            (aside / "seed-1").rmdir()
    assert set(read_sums(tmp_path / "out" / SUMS)) == {"a.txt", "b.txt"}
    checked = subprocess.run(
        ["sha256sum", "-c", SUMS], cwd=tmp_path / "out", capture_output=True, text=True, check=True
    )
    assert checked.stdout == "a.txt: OK\nb.txt: OK\n"


MOVING = """
import os, signal, sys
from pathlib import Path
from gtmbench.files.folders import atomic_folder
whole, left = Path.replace, [int(sys.argv[2])]
def replace(self, target):
    left[0] -= 1
    if left[0] < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return whole(self, target)
Path.replace = replace
with atomic_folder(Path(sys.argv[1])) as aside:
    (aside / "seed-1").mkdir()
    for name in ("a.txt", "b.txt", "seed-1/c.txt"):
        (aside / name).write_text("new")
"""


@pytest.fixture
def half(tmp_path, request):
    """A folder whose files were being replaced when the process was killed, after so many renames."""
    with atomic_folder(tmp_path / "out") as aside:
        (aside / "seed-1").mkdir()
        for name in ("a.txt", "b.txt", "seed-1/c.txt", "own.txt"):
            (aside / name).write_text("old")
    command = [sys.executable, "-c", MOVING, str(tmp_path / "out"), str(request.param)]
    killed = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    assert killed.returncode == -signal.SIGKILL
    return tmp_path / "out"


def texts_in(folder):
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*.txt")}


NEW = {"a.txt": "new", "b.txt": "new", "seed-1/c.txt": "new", "own.txt": "old"}


@pytest.mark.parametrize("half", range(5), indirect=True)
@pytest.mark.parametrize("by", by_day(["verify", "--force"]))
def test_files_of_a_process_that_was_killed_while_it_moved_them_follow(half, by, cli, request):
    began = request.node.callspec.params["half"]
    meant = dict.fromkeys(NEW, "old") if began == 0 else NEW  # before the first rename: nothing has begun
    if by == "verify":
        assert cli("verify", "out") == (0, "4 files hold what was written.\n", "")
    else:
        check_folder(half, force=True)
    assert texts_in(half) == meant
    writing._clear_once.cache_clear()
    with atomic_folder(half) as aside:
        (aside / "a.txt").write_text("newest")
    assert texts_in(half) == meant | {"a.txt": "newest"}
    assert cli("verify", "out")[0] == 0
    assert [path.name for path in half.parent.iterdir()] == ["out"]


def test_files_that_cant_be_moved_are_told_and_not_lost(tmp_path, cli, monkeypatch):
    replace = Path.replace

    def failing(self, target):
        if self.name == "b.txt":
            raise OSError(errno.EIO, "Input/output error")
        return replace(self, target)

    def write(text):
        with atomic_folder(tmp_path / "out") as aside:
            for name in ("a.txt", "b.txt"):
                (aside / name).write_text(text)

    write("old")
    monkeypatch.setattr(Path, "replace", failing)
    with pytest.raises(
        gb.GtmbenchError, match=r"into .*out: Input/output error; some there are new, others old; .* moves"
    ):
        write("new")
    code, out, _ = cli("verify", "out")
    assert (code, "some there are new, others old" in out) == (1, True)
    monkeypatch.undo()
    assert cli("verify", tmp_path / "out")[0] == 0
    assert texts_in(tmp_path / "out") == {"a.txt": "new", "b.txt": "new"}


@pytest.mark.parametrize(
    ("there", "said"), [("a", "out/a is a folder; a file"), ("seed-1", "seed-1 is a file; a folder")]
)
def test_what_stands_in_a_files_or_a_folders_place_is_told_and_nothing_is_moved(tmp_path, there, said):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / there).mkdir() if there == "a" else (tmp_path / "out" / there).touch()

    def write():
        with atomic_folder(tmp_path / "out") as aside:
            (aside / "seed-1").mkdir()
            for name in ("a", "seed-1/b", "0"):
                (aside / name).touch()

    with pytest.raises(gb.InputError, match=said):
        write()
    assert [path.name for path in (tmp_path / "out").iterdir()] == [there]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_while_files_are_moved_and_is_not_lost(tmp_path, number, monkeypatch):
    class Ended(BaseException):
        pass

    def end(*_):
        raise Ended

    replace, former = Path.replace, signal.signal(number, end)
    (tmp_path / "out").mkdir()

    def replaced(self, target):
        signal.raise_signal(number)
        return replace(self, target)

    def write():
        with atomic_folder(tmp_path / "out") as aside:
            for name in "ab":
                (aside / name).write_text(name)

    monkeypatch.setattr(Path, "replace", replaced)
    try:
        with pytest.raises(Ended):
            write()
    finally:
        signal.signal(number, former)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [SUMS, "a", "b"]


@pytest.mark.parametrize("arguments", [["list"], ["list", "--json"], ["--help"]])
def test_what_cant_be_printed_is_one_line_and_never_exit_code_1(arguments):
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "gtmbench", *arguments]
    with os.fdopen(writing, "wb") as pipe:
        ended = subprocess.run(command, cwd=ROOT, stdout=pipe, stderr=subprocess.PIPE, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (2, "gtmbench: can't print to standard output: Broken pipe\n")


def test_verify_says_what_was_altered(cli, tmp_path):
    with atomic_folder(tmp_path / "out") as aside:
        (aside / "results.json").write_text('{"delay_s": 4.5}')
        (aside / "trials.csv").write_text("delay_s\n4.5\n")
    assert cli("verify", "out") == (0, "2 files hold what was written.\n", "")
    (tmp_path / "out/trials.csv").write_text("delay_s\n0.45\n")
    code, out, _ = cli("verify", "out")
    wrong = "out/trials.csv: it isn't what was written, by SHA256SUMS: altered or damaged\n"
    assert (code, out) == (1, f"1 of 2 files isn't what was written.\n{wrong}")
    assert cli("verify", "out/results.json")[0] == 0
    (tmp_path / "out/results.json").unlink()
    assert "results.json: No such file or directory" in cli("verify", "out", "-q")[1]
    (tmp_path / "note.txt").touch()
    assert cli("verify", "note.txt")[0] == 2


def test_what_was_left_too_lately_to_be_told_goes_when_results_are_written(tmp_path):
    """Killed between making its lock and writing it, a moment before the next writer of the same folder began."""
    out = tmp_path / "results"
    (left := out / ".gtmbench-abcdefgh").mkdir(parents=True)
    (left / "lock").touch()
    with atomic_write(out / "part") as path:
        path.touch()
    assert left.is_dir()  # it may be somebody's who is at work
    for path in (left / "lock", left):
        os.utime(path, (time.time() - 2.0,) * 2)
    with atomic_folder(out) as aside:
        (aside / "results.json").touch()
    assert sorted(path.name for path in out.iterdir()) == [SUMS, "part", "results.json"]
