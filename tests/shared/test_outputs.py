"""What is written is whole and on the disk, or one line says which file isn't, and why; what stood there stands."""

import os
import resource
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb

import gtmbench as gb
from gtmbench.files.disk import SUMS, atomic_folder, atomic_write, read_sums
from gtmbench.report.recording.entities import log_lines, recorded

ROOT = Path(__file__).parents[2]
FULL = r"File too large; what stood there before still stands"


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
        log_lines(recording, "/sensors/rates", np.arange(samples) / 100.0, values, ["p", "q"], ["#102030"] * 2)


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


def test_a_recording_misses_nothing_when_only_its_footer_doesnt_fit(tmp_path):
    record(tmp_path / "whole.rrd", samples=2_000)
    size = (tmp_path / "whole.rrd").stat().st_size
    for less in (1, 20, 200):
        with most_bytes(size - less - 300), pytest.raises(gb.GtmbenchError, match=FULL):
            record(tmp_path / "study.rrd", samples=2_000)


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
