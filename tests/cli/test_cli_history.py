"""`gtmbench monitor --history`: flights one after the other, an error from power-on, pages, and what is refused."""

import json
import shutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.flight import fly
from gtmbench.history.entry import enter, read_history
from gtmbench.report.recording.read import read_recording
from gtmbench.testing import assert_quiet
from tests.helpers.hostile import refused

KEPT = ("--history", "a.parquet", "--aircraft-id", "T2")
OFF_DEG_S = 4.0  # less than the engine calls a failure by itself


@cache
def flight(number):
    return gb.measure(fly("gtm", "multisine+turbulence", 40.0, seed=7), noise="t2", seed=number)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flights")
    (folder / "T2").mkdir()
    for number in range(2):
        gb.write_log(flight(number), folder / "T2" / f"{number}.csv")
    gb.write_log(flight(2), folder / "healthy.csv")
    gb.write_log(flight(2).replace("q", flight(2)["q"] + OFF_DEG_S), folder / "broken.csv")
    return folder


@pytest.fixture
def flights(written, tmp_path):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    return tmp_path


def flown_on(path, count=6):
    """Enter flights that are as the first one, each a little off."""
    random, first = np.random.default_rng(1), read_history(path)[0]
    for number in range(count):
        off = random.standard_normal(len(first.constants))
        own = [
            replace(each, value=each.value + 0.5 * step * each.kind.spread)
            for each, step in zip(first.constants, off, strict=True)
        ]
        enter(path, replace(first, digest=str(number), log=f"{number}.bin", constants=tuple(own)))


@pytest.mark.nightly
def test_an_error_from_power_on_is_named_beside_the_flights_before(cli, flights):
    code, out, err = cli("monitor", "T2", *KEPT)
    assert (code, err) == (0, "")
    assert out.startswith("2 logs: 2 no fault found.\n0.csv: No fault found")
    assert "T2: 2 flights, no constant is another than before; it takes 5 before one to tell more." in out
    flown_on(flights / "a.parquet")
    code, out, err = cli("monitor", "broken.csv", *KEPT, "--json")
    told = json.loads(out)
    assert (code, err, told["history"]["flights_before"]) == (1, "", 8)
    assert "(q) failed" in told["verdict"]
    assert "deg/s too much throughout; in 8 flights before at most" in told["verdict"]
    code, out, _ = cli("monitor", "healthy.csv", *KEPT)
    assert code == 0
    assert "History      T2: as in 9 flights before; an error of" in out
    assert [each.log for each in read_history(flights / "a.parquet")][-2:] == ["broken.csv", "healthy.csv"]
    assert_quiet("healthy.csv", history="a.parquet", aircraft_id="T2")
    with pytest.raises(AssertionError, match="too much throughout"):
        assert_quiet("broken.csv", history="a.parquet", aircraft_id="T2")


@pytest.mark.nightly
def test_without_a_log_the_history_is_shown(cli, flights):
    cli("monitor", "T2", *KEPT, "--quiet")
    flown_on(flights / "a.parquet")
    code, out, err = cli(
        "monitor", "--history", "a.parquet", "--report", "a.html", "--report", "a.png", "--record", "a.rrd"
    )
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == "T2: 8 flights, no constant is another than before."
    page = (flights / "a.html").read_text()
    assert "q: offset (deg/s)" in page
    assert "http" not in page.replace("http-equiv", "")
    assert (flights / "a.png").read_bytes().startswith(b"\x89PNG")
    assert any(read_recording(flights / "a.rrd")["entity"].str.contains("offset"))
    code, out, _ = cli("monitor", "--history", "a.parquet", "--json")
    told = json.loads(out)
    assert (code, told["command"], told["airframes"][0]["airframe"]) == (0, "monitor-history", "T2")


@pytest.mark.nightly
def test_a_folder_of_logs_is_a_history(cli, flights):
    code, out, err = cli("monitor", "healthy.csv", "--history", "T2", "--aircraft-id", "T2")
    assert (code, err) == (0, "")
    assert "2 of its flights were judged before, and it takes 5" in out
    assert [each.log for each in read_history(flights / "T2" / ".gtmbench-history.parquet")][:2] == ["0.csv", "1.csv"]


def test_a_baseline_holds_a_history(cli, flights):
    (flights / "logs.toml").write_text('logs = ["healthy.csv"]\nhistory = "none.parquet"\n')
    assert "history is 'none.parquet', and there is no such file" in refused(cli("check", "logs.toml", "--update"))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["healthy.csv", "--aircraft-id", "T2"], "--aircraft-id is of a history; give --history, too"),
        (["--history", "none.parquet"], "none.parquet holds no flight; enter some"),
        (["healthy.csv", "--history", "no/a.parquet"], "folder no doesn't exist; create it first"),
        (["healthy.csv", "--history", "healthy.csv"], "healthy.csv is no history that can be read"),
        (["T2", *KEPT, "--out", "o"], "a history's flights follow each other"),
    ],
)
@pytest.mark.usefixtures("flights")
def test_what_makes_no_sense_is_refused_in_one_line(cli, arguments, told):
    assert told in refused(cli("monitor", *arguments))
