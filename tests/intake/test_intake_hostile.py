"""Whatever a file holds, it ends in a record or in one line; memory and time are bounded, and nothing is printed."""

import functools
import json
import os
import random
import struct
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gtmbench as gb
from gtmbench.intake.contents import log_contents
from gtmbench.intake.formats import limits, mcap
from gtmbench.intake.fresh_samples import fresh_rows
from gtmbench.intake.stamps import single
from gtmbench.report.words.listing import listing_lines
from tests.helpers import intake_files as files
from tests.helpers.night import by_day

SAMPLES = 400


@functools.cache
def whole(name):
    """Return a small log of p and q at 100 Hz in a format."""
    if name == ODD:
        return odd_table()
    rng = np.random.default_rng(4)
    time_s, values = np.arange(SAMPLES) * 0.01, rng.standard_normal((SAMPLES, 2))
    us = (time_s * 1e6).round().astype(int).tolist()
    rows = [(t, *row) for t, row in zip(us, values.tolist(), strict=True)]
    headers = ["p_deg_s", "q_deg_s"]
    table = pd.DataFrame(values, columns=headers).assign(time_s=time_s.round(9))
    if name == "log.csv":
        return table.to_csv(index=False).encode()
    if name == "log.ulg":
        return files.ulog({"vehicle_angular_velocity": (["float[2] xyz"], rows)})
    dataflash = {"IMU": ("Qff", "TimeUS,GyrX,GyrY", rows)}
    if name == "log.bin":
        return files.dataflash(dataflash, units={"IMU": ("sEE", "F--")})
    if name == "log.log":
        return files.dataflash_text(dataflash)
    return _through_a_file(name, table, headers)


def _through_a_file(name, table, headers):
    from mcap.writer import CompressionType

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        if name == "log.parquet":
            table.to_parquet(path)
        else:
            sent = [
                (round(t * 1e9), dict(zip(headers, row, strict=True)))
                for t, *row in table[["time_s", *headers]].to_numpy().tolist()
            ]
            files.mcap(path, {"/imu": sent}, compression=CompressionType.NONE if name == "plain.mcap" else None)
        return path.read_bytes()


FORMATS = ["log.csv", "log.parquet", "log.ulg", "log.bin", "log.log", "plain.mcap", "zstd.mcap"]
ODD = "odd.csv"
INPUTS = 250  # a format
SEED = os.environ.get("GTMBENCH_SEED", "")  # other damage, as every night


def damaged(content, seed):
    """Return a log that was cut, flipped, filled with zeros, doubled or mixed up somewhere."""
    rng = random.Random(seed)
    broken = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 8, 40])):
        place = rng.randrange(len(broken)) if rng.random() < 0.6 else rng.randrange(min(len(broken), 600))
        match rng.randrange(6):
            case 0:
                del broken[max(place, 8) :]
            case 1:
                broken[place] ^= 1 << rng.randrange(8)
            case 2:
                broken[place] = rng.choice([0, 0x7F, 0x80, 0xFF, 0x0A, 0x2C, 0xA3])
            case 3:
                broken[place : place + rng.randrange(1, 64)] = bytes(rng.randrange(64))
            case 4:
                broken[place:place] = broken[place : place + rng.randrange(200)]
            case 5:
                broken[place : place + 8] = struct.pack("<Q", rng.getrandbits(64))
        if not broken:
            broken = bytearray(content[:9])
    return bytes(broken)


def odd_table():
    """Two sensors joined, an attitude as quaternions that repeat, rows that slipped, a time in two columns."""
    time_ns = 1_714_564_800_000_000_000 + np.arange(SAMPLES) * 20_000_000
    turn = np.cumsum(np.random.default_rng(8).standard_normal(SAMPLES))[np.arange(SAMPLES) // 5 * 5] * 1e-2
    gyro = pd.DataFrame({"p_deg_s": np.sin(1e-9 * (time_ns - time_ns[0])), "ns": time_ns})
    attitude = pd.DataFrame({"qw": np.cos(turn), "qx": np.sin(turn), "qy": 0.0, "qz": 0.0, "ns": time_ns + 100_000})
    both = pd.concat([gyro, attitude]).sort_values("ns")
    both.insert(0, "stamp.secs", both["ns"] // 10**9)
    both.insert(1, "stamp.nsecs", both.pop("ns") % 10**9)
    both.iloc[100:104, 1] = both.iloc[104, 1]
    return both.to_csv(index=False).encode()


def found_or_said(reader, path):
    """What was read, and ""; or None, and the one line."""
    try:
        return reader(path), ""
    except gb.InputError as error:
        said = str(error)
    assert said.startswith(str(path))
    assert "\n" not in said
    return None, said


@pytest.mark.parametrize("name", by_day([*FORMATS, ODD]))
def test_a_damaged_log_is_a_record_or_one_line(tmp_path, capfd, name):
    path = tmp_path / name
    slowest_s, told = 0.0, {gb.open_log: 0, log_contents: 0}
    for seed in range(INPUTS):
        path.write_bytes(damaged(whole(name), f"{SEED}{name} {seed}"))
        for reader in told if seed % 4 == 0 else [gb.open_log]:
            began_s = time.process_time()
            found, said = found_or_said(reader, path)
            told[reader] += not said
            if reader is log_contents and not said:
                lines = listing_lines(found, 80)
                assert len(lines) < 40
                assert max(map(len, lines)) <= 80
            slowest_s = max(slowest_s, time.process_time() - began_s)
        assert list(tmp_path.iterdir()) == [path]
    assert 0.02 * INPUTS < told[gb.open_log] < 0.98 * INPUTS
    assert told[log_contents] > 2
    assert slowest_s < 5.0
    assert capfd.readouterr() == ("", "")


def test_a_million_rows_of_one_time_after_another_take_no_longer_than_others():
    """Doubles, slips and gaps everywhere: nothing goes row by row."""
    count = 1_000_000
    time_s = np.repeat(np.arange(count // 2) * 0.04, 2)
    values = np.random.default_rng(9).standard_normal((count, 3))
    values[::3, 1] = np.nan
    began = time.perf_counter()
    kept, at_s, merged, _ = single("", time_s, values, ())
    assert len(kept) == len(at_s) == len(merged)
    assert np.all(np.diff(at_s) > 0)
    assert fresh_rows(np.repeat(values[::2, ::2], 2, axis=0)) is not None
    assert time.perf_counter() - began < 5.0


def test_names_without_end_are_cut(tmp_path):
    names = [f"gyro_{'x' * 5000}{number}.sec" for number in range(150)]
    (tmp_path / "log.csv").write_text(",".join(["time_s", *names]) + "\n" + ",".join(["0"] * 151) + "\n")
    lines = listing_lines(log_contents(tmp_path / "log.csv"), 80)
    assert len(lines) < 30


MAGICS = [b"", b"ULog\x01\x12\x35", b"\x89MCAP0\r\n", b"\xa3\x95", b"FMT, ", b"PAR1", b"\xff\xfe", b"\xef\xbb\xbf"]


@pytest.mark.parametrize("magic", MAGICS)
def test_garbage_behind_every_magic_is_refused(tmp_path, capfd, magic):
    rng = np.random.default_rng(7)
    fillings = [b"", b"\0" * 5000, rng.bytes(5000), b"A" * 5000, magic * 500, b"\n" * 5000, b"," * 5000, b"[" * 5000]
    for filling in fillings:
        path = tmp_path / "log.dat"
        path.write_bytes(magic + filling)
        with pytest.raises(gb.InputError) as refused:
            gb.open_log(path)
        assert str(refused.value).startswith(str(path))
        assert "\n" not in str(refused.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("reader", [gb.open_log, gb.log_columns])
def test_what_isnt_a_file_is_refused(tmp_path, reader):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for path, message in (
        (tmp_path, "is a folder; give the logs in it"),
        (tmp_path / "pipe", "isn't a file"),
        (tmp_path / "none.csv", "[Nn]o such file"),
        (tmp_path / "link", "[Nn]o such file"),
        ("a\0b", "null"),
        (tmp_path / ("x" * 300), "too long"),
    ):
        with pytest.raises(gb.InputError, match=message):
            reader(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("log.csv", b"", "is empty"),
        ("log.csv.gz", b"\x1f\x8b\x08", "isn't a readable gzip"),
        ("log.zip", b"PK\x03\x04", "isn't a readable zip"),
        ("log.csv", b"a,b\n1,2\n" * 8 + b"\0" * 50, "zero bytes"),
        ("log.csv", b"time_s,p_deg_s,p_deg_s\n0,1,2\n", "'p_deg_s' stands there twice"),
        ("log.csv", ",".join(f"c{k}" for k in range(6000)).encode() + b"\n", "6000 columns; at most 5000"),
        ("log.csv", b"time_s,p_deg_s\n0,1\n1,2,3,4\n", "isn't a readable CSV table"),
        ("log.csv", b"time_s,p_deg_s\n", "column"),
    ],
)
def test_what_no_log_is_is_said(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(gb.InputError, match=message):
        gb.open_log(tmp_path / name)


def peak_bytes(function):
    tracemalloc.start()
    try:
        with pytest.raises(gb.InputError) as refused:
            function()
        return tracemalloc.get_traced_memory()[1], str(refused.value)
    finally:
        tracemalloc.stop()


def sparse(path, head, size):
    with path.open("wb") as file:
        file.write(head)
        file.truncate(size)


def test_a_file_that_is_too_large_isnt_opened(tmp_path):
    sparse(tmp_path / "log.csv", b"time_s,p_deg_s\n", 10 << 30)
    peak, message = peak_bytes(lambda: gb.open_log(tmp_path / "log.csv"))
    assert f"at most {limits.LARGEST_FILE_BYTES} are read" in message
    assert peak < 1e6


def test_a_table_of_too_many_values_is_refused_before_it_is_read(tmp_path):
    (tmp_path / "log.csv").write_bytes(b",".join(b"c%d" % k for k in range(4000)) + b"\n" * 60_000)
    peak, message = peak_bytes(lambda: gb.open_log(tmp_path / "log.csv"))
    assert "values; at most 2e+08 are read" in message
    assert peak < 2e7


def test_a_parquet_file_that_declares_more_rows_than_fit_is_refused(tmp_path, monkeypatch):
    """Of one value, a million times: kilobytes, until it is read."""
    monkeypatch.setattr(limits, "MOST_VALUES", 100_000)
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(1_000_000, dtype=np.int8)), pa.array([1.0]))
    pq.write_table(pa.table({"time_s": column, "p_deg_s": column}), tmp_path / "log.parquet")
    assert (tmp_path / "log.parquet").stat().st_size < 1e5
    peak, message = peak_bytes(lambda: gb.open_log(tmp_path / "log.parquet"))
    assert "1e+06 values" in message
    assert peak < 1e6


@pytest.mark.parametrize("compression", by_day(["ZSTD", "LZ4"]))
def test_a_chunk_that_unpacks_without_end_is_refused(tmp_path, monkeypatch, compression):
    from mcap.writer import CompressionType

    monkeypatch.setattr(mcap, "LARGEST_CHUNK_BYTES", 1 << 20)
    bomb = b"0" * (200 << 20)
    files.mcap(tmp_path / "log.mcap", {"/x": [(0, bomb)]}, compression=CompressionType[compression])
    assert (tmp_path / "log.mcap").stat().st_size < 2e6
    peak, message = peak_bytes(lambda: gb.open_log(tmp_path / "log.mcap"))
    assert "a chunk unpacks to more than 1048576 bytes" in message or "Frame requires too much memory" in message
    assert peak < 2e7


def test_many_chunks_that_unpack_to_too_much_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap, "MOST_UNPACKED_BYTES", 1 << 22)
    messages = [(k, json.dumps({"p_deg_s": 0.0, "x": "0" * 10_000}).encode()) for k in range(1000)]
    files.mcap(tmp_path / "log.mcap", {"/x": messages})
    with pytest.raises(gb.InputError, match="unpacks to more than 4194304 bytes"):
        gb.open_log(tmp_path / "log.mcap")


def test_hostile_json_is_left_out_and_counted(tmp_path):
    good = [(round(k * 1e7), {"p_deg_s": k % 7}) for k in range(SAMPLES)]
    bad = [
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"9" * 10_000,
        b'{"p_deg_s": 1e999, "t": ' + b"9" * 5000 + b"}",
        b"\xff\xfe",
        b"{",
    ]
    files.mcap(tmp_path / "log.mcap", {"/imu": good, "/bad": [(k, text) for k, text in enumerate(bad)]})
    log = gb.open_log(tmp_path / "log.mcap", needs=["p"])
    assert len(log.segments[0]) == SAMPLES
    assert "left out: 6 messages (broken json)" in log.method


def test_messages_that_arent_read_are_named(tmp_path):
    files.mcap(tmp_path / "log.mcap", {"/imu": [(0, b"\1\2")]}, schema="my_msgs/msg/Imu", encoding="cdr")
    with pytest.raises(gb.InputError, match=r"1 messages \(cdr my_msgs/msg/Imu\); read are json and ROS 2's messages"):
        gb.open_log(tmp_path / "log.mcap")


def nested_ulog(kinds):
    out = b"ULog\x01\x12\x35\x01" + bytes(8) + files.ulog_message("B", bytes(40))
    for declaration in kinds:
        out += files.ulog_message("F", declaration.encode())
    return out + files.ulog_message("A", struct.pack("<BH", 0, 0) + b"a") * 20


@pytest.mark.parametrize(
    "kinds",
    by_day(
        [
            ["a:b[65535] x;", "b:c[65535] x;", "c:uint64_t[65535] x;"],
            ["a:a x;uint64_t timestamp;"],
            [
                f"{letter}:{after}[2] x;{after}[2] y;"
                for letter, after in zip("abcdefghijklmno", "bcdefghijklmnop", strict=True)
            ]
            + ["p:uint8_t[9] x;"],
            ["a:uint64_t[65535] timestamp;"],
        ]
    ),
)
def test_messages_in_messages_dont_grow_without_end(tmp_path, kinds):
    (tmp_path / "log.ulg").write_bytes(nested_ulog(kinds))
    peak, _ = peak_bytes(lambda: gb.open_log(tmp_path / "log.ulg"))
    assert peak < 2e8


def test_a_ulog_that_would_be_read_for_ever_is_refused(tmp_path):
    """A message of an unknown kind that ends behind the file's end: pyulog steps back further than it went."""
    (tmp_path / "log.ulg").write_bytes(whole("log.ulg")[:500] + struct.pack("<HB", 60_000, 0) + b"\1\0Z" * 20)
    began = time.perf_counter()
    with pytest.raises(gb.InputError):
        gb.open_log(tmp_path / "log.ulg")
    assert time.perf_counter() - began < 5.0


@pytest.mark.parametrize("length", [0, 3, 4, 255])
def test_a_dataflash_message_of_a_wrong_length_is_passed_over(tmp_path, length):
    wrong = b"\xa3\x95\x80" + files.FMT.pack(1, length, b"ABC", b"Q", b"TimeUS") + b"\xa3\x95\x01" * 500
    (tmp_path / "log.bin").write_bytes(wrong + whole("log.bin"))
    assert [len(record) for record in gb.open_log(tmp_path / "log.bin").segments] == [SAMPLES]


@pytest.mark.parametrize(("name", "package"), [("log.ulg", "pyulog"), ("log.bin", "pymavlink"), ("zstd.mcap", "mcap")])
def test_a_library_that_is_missing_is_named_with_how_to_get_it(tmp_path, monkeypatch, name, package):
    (tmp_path / name).write_bytes(whole(name))
    for module in [module for module in sys.modules if module.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(gb.InputError, match=rf"needs the package {package}; pip install 'gtmbench\[logs\]'"):
        gb.open_log(tmp_path / name)


def test_more_values_than_fit_are_refused():
    with pytest.raises(gb.InputError, match="would be 1e\\+12 values"):
        limits.check_values(1e12, "it")
    with pytest.raises(gb.InputError, match="would be nan values"):
        limits.check_values(float("nan"), "it")


def test_names_that_a_terminal_would_obey_are_disarmed(tmp_path):
    path = tmp_path / "log.csv"
    rows = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(SAMPLES))
    path.write_text(f'time_s,"gyro\x1b[2J_x","p_deg_s{"y" * 5000}"\n{rows}')
    log = gb.open_log(path)
    assert all(line.isprintable() and len(line) < 10_000 for line in (*log.method, *log.channels))
    with pytest.raises(gb.InputError) as refused:
        gb.open_log(path, needs=["q"])
    assert str(refused.value).isprintable()
    assert len(str(refused.value)) < 5000
