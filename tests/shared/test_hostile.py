"""Hostile input: whatever a file or a name holds, it is read, or refused in one line; nothing is run from it."""

import json
import time
import tomllib
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.check.baseline import read_reference
from gtmbench.files import logs
from gtmbench.files.shipped import share
from tests.helpers.hostile import Tried, altered, damaged, refused, unchanged
from tests.helpers.night import by_day

PACKAGE = Path(gb.__file__).parent
EXAMPLES = 25  # a reader; the fuzzer draws the others


READERS = {
    "scenario": (gb.load_scenario, PACKAGE / "cli/template.toml"),
    "bank": (gb.load_bank, PACKAGE / "banks/C.toml"),
    "baseline": (read_reference, PACKAGE / "baselines/dissertation.toml"),
    "aircraft": (lambda path: load_aircraft(path.parent), share() / "aircraft/gtm/aircraft.toml"),
    "monitor": (gb.load_monitor, PACKAGE / "baselines/bank-C.json"),
}


def _parsed(path):
    return json.loads(path.read_text()) if path.suffix == ".json" else tomllib.loads(path.read_text())


def _written(table, suffix):
    """Return a table as its file, or as what TOML can't write: JSON."""
    try:
        return (json.dumps(table) if suffix == ".json" else tomlkit.dumps(table)).encode()
    except (ValueError, TypeError, tomlkit.exceptions.TOMLKitError):
        return json.dumps(table).encode()


@pytest.mark.parametrize("name", by_day(READERS))
def test_a_file_that_was_tampered_with_is_read_or_refused(tmp_path, record_property, capfd, name):
    reader, source = READERS[name]
    content, table = source.read_bytes(), _parsed(source)
    path = tmp_path / ("aircraft.toml" if name == "aircraft" else f"given{source.suffix}")
    tried = Tried()

    @settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
    @given(st.one_of(damaged(content), altered(table).map(lambda one: _written(one, source.suffix))))
    @example(b"")
    @example(content[: len(content) // 2])
    @example(b"\xff" * 300)
    @example(content.decode().encode("utf-16"))
    def try_it(given_bytes):
        path.write_bytes(given_bytes)
        with unchanged(tmp_path):
            tried(reader, path)

    try_it()
    assert capfd.readouterr() == ("", "")
    tried.report(record_property)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    from gtmbench.report.recording.write import write_log_recording
    from tests.helpers import logged

    path = tmp_path_factory.mktemp("recording") / "short.rrd"
    write_log_recording(logged.short(), path)
    return path.read_bytes()


@pytest.mark.nightly
def test_a_recording_that_was_tampered_with_is_read_or_refused(tmp_path, record_property, capfd, recording):
    path, tried = tmp_path / "given.rrd", Tried(longest_s=30.0)  # a process each

    @settings(max_examples=5, suppress_health_check=list(HealthCheck))
    @given(damaged(recording))
    def try_it(given_bytes):
        path.write_bytes(given_bytes)
        tried(gb.read_recording, path)

    try_it()
    assert capfd.readouterr() == ("", "")
    tried.report(record_property)


@pytest.mark.parametrize("command", by_day([["view"], ["verify", "--overlay", "both.rrd", "whole.rrd", "--against"]]))
def test_half_a_recording_is_refused(cli, tmp_path, recording, command, monkeypatch):
    for screen in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(screen, raising=False)
    Path("whole.rrd").write_bytes(recording)
    Path("half.rrd").write_bytes(recording[: len(recording) // 2])
    with unchanged(tmp_path):
        half = cli(*command, "half.rrd")
        refused(half)
    assert "isn't a whole rerun recording" in half[2] or command[0] != "view"
    assert "no screen" in cli("view", "whole.rrd")[2]  # whole, so it goes on to the window


BOMBS = {
    "a key of 40 000 parts": "a" + ".a" * 40_000 + " = 1",
    "a key of parts in quotes": '"1,"' + '."1,"' * 15_000 + " = 1",
    "a key of numbers": "1" + ".1" * 40_000 + " = 1",
    "tables in tables": "[a" + ".a" * 2_000 + "]\n" + "".join(f"k{i} = 1\n" for i in range(9_000)),
    "lists in lists": "a = " + "[" * 90_000,
    "lists in lists, whole": "title = " + "[" * 300 + "]" * 300,
    "tables in a value": "title = " + "{a=" * 300 + "1" + "}" * 300,
    "9 000 keys": "\n".join(f"k{i} = 1" for i in range(9_000)),
    "100 000 keys": "\n".join(f"k{i} = 1" for i in range(100_000)),
    "a number of 90 000 digits": "seed = " + "9" * 90_000,
    "a number of 4 000 digits": "seed = " + "9" * 4_000,
    "1e999": "duration_s = 1e999",
    "a title of 90 kB": 'title = "' + "x" * 90_000 + '"',
    "a million nulls": "\0" * 1_000_000,
}


@pytest.mark.parametrize("reader", [gb.load_scenario, gb.load_bank, read_reference, READERS["aircraft"][0]])
@pytest.mark.parametrize("bomb", by_day(BOMBS, 6))
def test_a_bomb_of_toml_is_refused_in_little_time_and_memory(tmp_path, reader, bomb):
    path = tmp_path / "aircraft.toml"
    path.write_text(BOMBS[bomb])
    assert peak_mb(lambda: reader(path)) < 40.0


def test_a_scenario_of_more_than_memory_holds_is_refused(tmp_path):
    path = tmp_path / "given.toml"
    fault = '[[faults]]\nkind = "drift"\nchannels = ["p"]\nonset_s = 300\nslope = '
    path.write_text(f"duration_s = 86400.0\n{fault}{[0.1 * k for k in range(1, 7)]}\n")
    with pytest.raises(gb.InputError, match="6 trials of 86400 s would be held in memory"):
        gb.load_scenario(path)
    path.write_text(f"duration_s = 86400.0\n{fault}{[0.1 * k for k in range(1, 6)]}\n")
    assert len(gb.load_scenario(path).faults) == 5


@pytest.mark.parametrize("text", ["[" * 10**6, '{"a":' * 10**6, "9" * 10**6, '"' + "\\u0000" * 10**5 + '"', "1e999"])
def test_a_bomb_of_json_is_refused_in_little_time_and_memory(tmp_path, text):
    (tmp_path / "monitor.json").write_text(text)
    assert peak_mb(lambda: gb.load_monitor(tmp_path / "monitor.json")) < 40.0


def test_a_table_of_a_million_times_one_value_is_refused_before_it_is_read(tmp_path, monkeypatch):
    import pyarrow as pa
    import pyarrow.parquet as pq

    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(1_000_000, dtype=np.int8)), pa.array([1.0]))
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table({"time_s": column, "p_deg_s": column}), path)
    assert path.stat().st_size < 1e5
    monkeypatch.setattr(logs, "MOST_LOG_VALUES", 1_000_000)
    assert peak_mb(lambda: gb.read_log(path)) < 1.0


def test_a_line_of_a_hundred_megabytes_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(b"time_s,p_deg_s\n" + b"1," * (50 << 20))
    for reader in (gb.read_log, gb.open_log):
        assert peak_mb(lambda reader=reader: reader(path)) < 40.0


def peak_mb(function):
    began = time.perf_counter()
    tracemalloc.start()
    try:
        with pytest.raises(gb.InputError) as error:
            function()
        assert len(str(error.value)) < 4000
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()
        assert time.perf_counter() - began < 8.0  # tracing takes most of it
