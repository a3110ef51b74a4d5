"""Whatever is unlike any log ends within seconds and little memory, in one line; a pipe is never waited for."""

import json
import os
import resource
import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gtmbench as gb
from gtmbench.intake.formats.limits import bytes_of
from gtmbench.values.channels import header_of
from tests.helpers import monitors


def refused(cli, *arguments):
    """Run a command that ends with exit code 2; return its one line."""
    code, _, err = cli(*arguments, "-q")
    lines = [line for line in err.splitlines() if not line.startswith("note: ")]
    assert (code, len(lines)) == (2, 1), lines
    return lines[0]


def test_a_bag_whose_database_is_a_pipe_is_refused_at_once(tmp_path):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    os.mkfifo(tmp_path / "bag.db3")
    with pytest.raises(gb.InputError, match=r"bag\.db3 is neither a file nor a folder, but a pipe or a device"):
        gb.open_log(tmp_path)


def test_a_folder_is_as_large_as_what_lies_in_it(tmp_path):
    (tmp_path / "within").mkdir()
    for name in ("a.db3", "within/b.db3"):
        (tmp_path / name).write_bytes(bytes(5000))
    assert bytes_of(tmp_path) == 10_000


def test_a_pipe_among_other_inputs_isnt_waited_for(tmp_path, cli):
    gb.save_monitor(monitors.monitor(), tmp_path / "m.json")
    os.mkfifo(tmp_path / "monitor.json")
    assert cli("verify", tmp_path)[0] == 0  # of what it holds, all is unchanged
    watch = ("live", "udp:127.0.0.1:0", "--detector", "m.json", "--key-file", "monitor.json")
    assert "not a file" in refused(cli, *watch)


def test_messages_of_ever_other_fields_are_refused_within_seconds(tmp_path):
    writer_of = pytest.importorskip("mcap.writer")
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = writer_of.Writer(file)
        writer.start()
        schema = writer.register_schema(name="state", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(topic="/state", message_encoding="json", schema_id=schema)
        for k in range(4):
            data = json.dumps({f"v{k}_{j}": 0.5 for j in range(2000)}).encode()
            writer.add_message(channel_id=channel, log_time=k, publish_time=k, data=data)
        writer.finish()
    with pytest.raises(gb.InputError, match="more than 5000 fields"):
        gb.open_log(tmp_path / "log.mcap")


def test_a_table_of_nothing_but_zeros_takes_no_memory(tmp_path):
    """Of 60 million rows, 450 kB on disk."""
    zeros = pa.array(np.zeros(1_000_000, dtype=np.float32))
    with pq.ParquetWriter(tmp_path / "log.parquet", pa.schema([("time_s", pa.float32())])) as writer:
        for _ in range(60):
            writer.write_table(pa.table({"time_s": zeros}))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(gb.InputError, match=r"it unpacks to 4\.8e\+08 bytes, far more than its size"):
        gb.open_log(tmp_path / "log.parquet")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        (np.arange(2001) * 5e-324, "time stands still"),
        (np.arange(2001) * 1e-12, "time stands still"),
        (np.where(np.arange(2001) == 1000, 1e11, 0.0), "time stands still"),
        (np.arange(2001) * 0.01 + np.where(np.arange(2001) < 900, 0.0, 2.0**53 / 1e3), "the clock jumps on by 9.007e"),
    ],
    ids=["denormal", "tiny", "one astray", "two to the 53rd"],
)
def test_stamps_that_are_no_time_are_refused(stamps, said, tmp_path):
    np.savez(tmp_path / "log.npz", time_s=stamps, p_deg_s=np.sin(np.arange(2001) * 0.1))
    with pytest.raises(gb.InputError, match=said):
        gb.open_log(tmp_path / "log.npz")


def test_a_log_with_a_pause_of_days_is_refused_before_it_takes_all_memory(tmp_path):
    record = monitors.record(4500, seed=5).select(("p", "q", "r", "phi", "theta", "psi"))
    columns = dict(zip(map(header_of, record.channels), record.values.T, strict=True))
    np.savez(tmp_path / "log.npz", time_s=record.time_s + np.where(record.time_s < 45.0, 0.0, 1e6), **columns)
    with pytest.raises(gb.InputError, match=r"gyros and attitude span 277\.8 h, pauses among it; at most 24 h"):
        gb.watch_log(tmp_path / "log.npz", "auto")


def test_a_log_that_takes_too_long_is_ended_and_leaves_nothing(tmp_path, cli, monkeypatch):
    record = monitors.record(2000, seed=5).select(("p", "q", "r", "phi", "theta", "psi"))
    gb.write_log(record, tmp_path / "log.csv")

    def hangs(*_, **__):
        (made,) = tmp_path.glob(".gtmbench-*/new")
        (made / "page.html").write_text("half")
        time.sleep(60.0)

    monkeypatch.setattr("gtmbench.report.page.flight.flight_page", hangs)
    options = ("--detector", "auto", "--report", "page.html", "--time-limit", "4")
    began = time.monotonic()
    said = refused(cli, "monitor", "log.csv", *options)
    assert "not done within 4 s; cut the log, or allow more with --time-limit" in said
    assert time.monotonic() - began < 10.0
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.nightly
def test_a_link_on_which_nothing_comes_ends_on_time_and_says_so():
    began = time.monotonic()
    with gb.live("udp:127.0.0.1:0", monitors.monitor(), end_after_s=0.5) as link:
        assert list(link) == []
    assert time.monotonic() - began < 5.0
    assert link.verdict == "Cannot tell: nothing came."
