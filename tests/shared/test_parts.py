"""Parts: whole or not there, of one run or refused, one run at a time; and what killed runs leave is cleared away."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gtmbench as gb
from gtmbench.files import writing
from gtmbench.files.writing import UnwrittenError
from gtmbench.jobs.parts import Shard, hold, parts_in, read_parts
from gtmbench.study.campaign.rows import table_of

FACTS = {"campaign": {"axes": {"seed": [1, 2]}}, "versions": {"numpy": "2"}}
ROOT = Path(__file__).parents[2]


def begun(folder, *, tasks=5, facts=FACTS, **how):
    return parts_in(folder, what="campaign", tasks=tasks, facts=facts, **how)


def rows(task, count=3):
    return pa.table({"task": [task] * count, "value": [0.1 * i for i in range(count)]})


@pytest.fixture
def half(tmp_path):
    """A folder with tasks 0, 3 and 1 of five, in that order."""
    with begun(tmp_path / "half") as parts:
        for task in (0, 3, 1):
            parts.write(task, rows(task))
    return tmp_path / "half"


def test_what_is_finished_is_there_in_the_order_of_tasks_whoever_asks(half):
    parts = read_parts(half)
    assert (parts.done(), parts.todo()) == ((0, 1, 3), (2, 4))
    assert parts.read()["task"].to_pylist() == [0] * 3 + [1] * 3 + [3] * 3
    assert parts.read(["value"]).column_names == ["value"]


def test_a_part_is_a_parquet_file_of_one_row_group_that_says_whose_it_is(half):
    part = pq.ParquetFile(half / "part-000003.parquet")
    assert part.num_row_groups == 1
    assert part.schema_arrow.metadata[b"gtmbench.task"] == b"3"
    assert part.schema_arrow.metadata[b"gtmbench.run"].decode() == read_parts(half).digest(0)
    assert {path.name for path in half.iterdir() if path.name[0] != "."} == {
        "manifest.json",
        *(f"part-00000{task}.parquet" for task in (0, 1, 3)),
    }


def test_a_campaigns_part_of_few_rows_costs_little_beside_them_and_is_read_as_it_was_written(tmp_path):
    written = table_of([{"task": 0, "detector": "C", "detected": True, "detection_delay_s": 0.1 * i} for i in range(8)])
    with begun(tmp_path / "lean") as parts:
        parts.write(0, written)
        assert parts.path(0).stat().st_size < 8_000  # 58 columns
        assert parts.read().equals(written)


def test_going_on_ends_with_the_bytes_of_an_uninterrupted_run(half, tmp_path):
    with begun(half, resume=True) as parts:
        for task in parts.todo():
            parts.write(task, rows(task))
    with begun(tmp_path / "whole") as parts:
        for task in range(5):
            parts.write(task, rows(task))
    for task in range(5):
        assert read_parts(half).path(task).read_bytes() == parts.path(task).read_bytes()


def test_shards_share_a_folder_and_leave_nothing_out(tmp_path):
    shards = [Shard(number, 3) for number in (1, 2, 3)]
    assert sorted(task for shard in shards for task in range(20) if shard.holds(task)) == list(range(20))
    for shard in shards:
        with begun(tmp_path / "a", tasks=20, shard=shard) as parts:
            for task in parts.todo(shard):
                parts.write(task, rows(task))
    assert parts.todo() == ()


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({**FACTS, "versions": {"numpy": "3"}}, "versions.numpy was '2' and is '3'"),
        ({**FACTS, "campaign": {"axes": {"seed": [1, 3]}}}, r"campaign.axes.seed\[1\] was 2 and is 3"),
        ({**FACTS, "campaign": {"axes": {"seed": [1, 2], "tas_kt": [90]}}}, "campaign.axes.tas_kt was None"),
    ],
)
def test_other_facts_dont_mix_and_it_is_said_which(half, facts, said):
    with pytest.raises(gb.InputError, match=said), begun(half, facts=facts, resume=True):
        pass
    assert read_parts(half).facts == FACTS


def test_facts_that_come_later_are_held_as_well(half):
    with pytest.raises(gb.InputError, match="is of another campaign"), begun(half, resume=True) as parts:
        hold(parts, monitors={"C": "1"}).done()


def test_facts_that_were_held_are_compared(tmp_path):
    with begun(tmp_path / "a") as parts:
        held = hold(parts, monitors={"C": "1"})
        held.write(0, rows(0))
        assert hold(held, monitors={"C": "1"}) == held
        with pytest.raises(gb.InputError, match=r"monitors.C was '1' and is '2'"):
            hold(held, monitors={"C": "2"})
    with begun(tmp_path / "a", resume=True) as again:
        assert hold(again, monitors={"C": "1"}).done() == (0,)


def test_a_part_of_another_run_is_refused(half, tmp_path):
    with begun(tmp_path / "other", facts={"campaign": 1}) as other:
        other.write(2, rows(2))
    other.path(2).rename(half / "part-000002.parquet")
    with pytest.raises(gb.InputError, match=r"part-000002.parquet is of another campaign"), begun(half, resume=True):
        pass


def test_a_part_that_isnt_whole_is_told_by_name(half):
    part = half / "part-000001.parquet"
    part.write_bytes(part.read_bytes()[:-20])
    with pytest.raises(gb.InputError, match=r"part-000001.parquet: it isn't what was written, .*; --resume does its"):
        read_parts(half).done()
    with (
        pytest.warns(gb.NoteWarning, match=r"part-000001.parquet: .*; its task is done anew"),
        begun(half, resume=True) as parts,
    ):
        assert parts.todo() == (1, 2, 4)


def test_of_300_flipped_bits_of_a_part_none_is_read(half):
    part = half / "part-000001.parquet"
    whole = part.read_bytes()
    for bit in np.random.default_rng(5).integers(0, 8 * len(whole), 300):
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        part.write_bytes(bytes(flipped))
        assert list(read_parts(half).damaged()) == [1]


def test_what_arrows_threads_read_is_arrows_own(half):
    """Were it Python's, a thread that let go of it while Python ends would end the process with code -6."""
    size, before = (half / "part-000001.parquet").stat().st_size, pa.total_allocated_bytes()
    part = read_parts(half)._open(1)
    assert pa.total_allocated_bytes() - before >= size
    assert part.read().num_rows == 3


def test_an_altered_manifest_is_told(half):
    manifest = half / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"tasks": 5', '"tasks": 4'))
    with pytest.raises(gb.InputError, match=r"manifest.json: what it holds isn't what was written"):
        read_parts(half)


def test_a_folder_from_before_digests_is_read_with_a_note(tmp_path):
    with begun(tmp_path / "a") as parts:
        old = replace(parts, version=1)
        old._write_manifest()
        table = rows(0).replace_schema_metadata({"gtmbench.run": old.digest(0), "gtmbench.task": "0"})
        pq.write_table(table, old.path(0))
        manifest = json.loads((tmp_path / "a/manifest.json").read_text())
        del manifest["digest"]
        (tmp_path / "a/manifest.json").write_text(json.dumps(manifest))
    with pytest.warns(gb.NoteWarning, match="is of a gtmbench before digests, so whether its rows were altered can't"):
        assert read_parts(tmp_path / "a").read().equals(rows(0))


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"format": "gtmbench parts", "version": 9}', "\x00", "[" * 5000])
def test_a_manifest_that_is_none_is_refused(half, content):
    (half / "manifest.json").write_text(content)
    with pytest.raises(gb.InputError, match="manifest"), begun(half, resume=True):
        pass


def test_parts_that_are_there_are_gone_on_with_only_where_that_is_said(half):
    with pytest.raises(gb.InputError, match="holds 3 of 5 tasks of a campaign; --resume goes on"), begun(half):
        pass


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(gb.InputError, match=r"holds no campaign, but thesis.tex"), begun(tmp_path, resume=True):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("place", ["file", "nowhere/x", "x" * 300, "nul\0"])
def test_what_is_no_place_for_a_folder_is_refused(tmp_path, place):
    (tmp_path / "file").touch()
    with pytest.raises(gb.InputError, match=r"\S"), begun(tmp_path / place):
        pass


def test_a_folder_that_isnt_ones_own_to_write_is_refused(tmp_path, monkeypatch):
    """Root may write anywhere, so the system is asked in words: it says why, as of a disk that is read-only."""

    def refused(**_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    (tmp_path / "a").mkdir()
    monkeypatch.setattr("tempfile.mkdtemp", refused)
    with pytest.raises(UnwrittenError, match=r"can't write .*: Read-only file system"), begun(tmp_path / "a"):
        pass


def test_a_full_disk_loses_nothing(half, monkeypatch):
    def full(*_arguments, **_options):
        raise OSError(errno.ENOSPC, "No space left on device")

    with begun(half, resume=True) as parts:
        monkeypatch.setattr(Path, "write_bytes", full)
        with pytest.raises(
            gb.GtmbenchError, match=r"part-000002.parquet: No space left on device; .* --resume goes on"
        ):
            parts.write(2, rows(2))
    assert read_parts(half).done() == (0, 1, 3)
    assert not list(half.glob(".gtmbench-*"))


@pytest.mark.parametrize(
    ("there", "comes", "refused"),
    [
        (None, None, True),
        (None, Shard(1, 2), True),
        (Shard(1, 2), None, True),
        (Shard(1, 2), Shard(1, 2), True),
        (Shard(1, 2), Shard(2, 2), False),
    ],
)
def test_one_run_at_a_time_but_shards_beside_each_other(tmp_path, monkeypatch, there, comes, refused):
    monkeypatch.setattr("gtmbench.jobs.parts._PATIENCE_S", 0.2)
    with begun(tmp_path / "a", shard=there):
        if refused:
            with pytest.raises(gb.InputError, match="is at work in"), begun(tmp_path / "a", resume=True, shard=comes):
                pass
        else:
            with begun(tmp_path / "a", shard=comes):
                pass
    with begun(tmp_path / "a", resume=True, shard=comes):  # it is free afterwards
        pass


WRITING = """
import sys, time
from pathlib import Path
from gtmbench.files.writing import atomic_write
with atomic_write(Path(sys.argv[1])) as aside:
    aside.write_text("half")
    print("writing", flush=True)
    time.sleep(60)
"""


def test_what_a_killed_process_leaves_is_cleared_and_what_a_living_one_writes_is_not(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", WRITING, str(tmp_path / "result.txt")]
    writers = [subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) for _ in range(2)]
    try:
        for writer in writers:
            assert writer.stdout.readline() == b"writing\n"
        killed, living = writers
        killed.send_signal(signal.SIGKILL)
        killed.wait()
        assert len(list(tmp_path.glob(".gtmbench-*"))) == 2
        writing._clear_once.cache_clear()
        with writing.atomic_write(tmp_path / "other.txt") as aside:
            aside.write_text("whole")
            (left,) = [path for path in tmp_path.glob(".gtmbench-*") if not aside.is_relative_to(path)]
        assert (left / "new/result.txt").read_text() == "half"
        living.send_signal(signal.SIGKILL)
        living.wait()
    finally:
        for writer in writers:
            writer.kill()
            writer.communicate()
    writing._clear_once.cache_clear()
    with writing.atomic_write(tmp_path / "other.txt") as aside:
        aside.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["other.txt"]


def test_a_folder_that_was_left_behind_without_a_lock_is_cleared_too(tmp_path):
    (tmp_path / ".gtmbench-abcdefgh").mkdir()
    (tmp_path / ".gtmbench-abcdefgh/study.rrd").touch()
    (tmp_path / ".gtmbench-ijklmnop").mkdir()
    (tmp_path / ".gtmbench-ijklmnop/lock").touch()  # killed before it could say whose it is
    for left in ("abcdefgh", "ijklmnop/lock", "ijklmnop"):
        os.utime(tmp_path / f".gtmbench-{left}", (time.time() - 20,) * 2)
    (tmp_path / ".gtmbench-notes").mkdir()  # nobody's of ours: another length
    began = time.monotonic()
    with writing.atomic_write(tmp_path / "other.txt") as aside:
        aside.touch()
    assert {path.name for path in tmp_path.iterdir()} == {"other.txt", ".gtmbench-notes"}
    assert time.monotonic() - began < 1.0


def test_a_run_of_items_grows_and_keeps_what_it_has(tmp_path):
    with begun(tmp_path / "out", tasks=2, items=["b", "c"]) as parts:
        for task in (0, 1):
            parts.write(task, rows(task))
    with begun(tmp_path / "out", tasks=3, items=["a", "b", "c"], resume=True) as parts:
        assert (parts.items, parts.todo()) == (("b", "c", "a"), (2,))
        parts.write(2, rows(2))
    with begun(tmp_path / "out", tasks=3, items=["c", "a", "b"], resume=True) as parts:
        assert parts.todo() == ()
    with (
        pytest.raises(gb.InputError, match=r"b was there, and isn't \(so\) any more"),
        begun(tmp_path / "out", tasks=2, items=["a", "c"], resume=True),
    ):
        pass


@pytest.mark.parametrize("made", ["new", "lock", "."])
def test_a_folder_that_is_being_made_is_left_alone(made, tmp_path):
    """Its process has not yet said, by its lock, that it is in use; it must not go under that process's hands."""
    own = tmp_path / ".gtmbench-abcdefgh"
    own.mkdir()
    (own / made).touch()
    with writing.atomic_write(tmp_path / "other.txt") as aside:
        aside.touch()
    assert (own / made).exists()
