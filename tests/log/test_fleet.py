"""`gtmbench monitor DIR`: a row a log, whatever becomes of it, worst first; gone on with; gyros over the flights."""

import errno
import json
import os
import shutil
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import gtmbench as gb
from gtmbench.cli.app import main
from gtmbench.files.writing import unwritten
from gtmbench.jobs.parts import parts_in
from gtmbench.log.fleet import FleetQuestion, Kept, conduct, logs_in
from gtmbench.log.gyro_figures import gyro_figures
from gtmbench.log.self_check.motion import rates_from, terms_of
from gtmbench.log.watch import bank_between
from gtmbench.report.fleet import COLUMNS, exit_code, fleet_row, fleet_table, gyros_figure, worst_first
from gtmbench.verdict.scope import Scope
from tests.helpers.airliner import airliner
from tests.helpers.clusters import forget, row_alone, row_or_worse, small_logs
from tests.helpers.logged import short, watched_log
from tests.helpers.monitors import monitor
from tests.helpers.timelines import Judged, clear, failed, suspected, unjudged, verdict

HOW = ("--detector", "C", "--healthy", "0:30")
SMALL = FleetQuestion(detector=bank_between(["p"], ["q"]), healthy=((0.0, 30.0),))


def ended(*arguments):
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments])
    return end.value.code


@contextmanager
def in_this_process():
    """As on a machine without semaphores: others would certify at as many onsets as for users, which takes seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gtmbench.jobs.processes._pool", lambda *_: nullcontext())
        yield


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Three logs, one of a gyro that drifts and one of nothing, and what a run left."""
    folder = tmp_path_factory.mktemp("fleet")
    healthy = airliner("minute", 1, duration_s=60)
    logs = folder / "logs"
    logs.mkdir()
    gb.write_log(healthy, logs / "flight_9.csv")
    gb.write_log(gb.inject(healthy, gb.Drift(channel="q", onset_s=43.0, slope=0.5)), logs / "flight_10.csv")
    (logs / "flight_11.csv").write_text("no table\n")
    (logs / "notes.txt").write_text("nothing")
    with in_this_process():
        assert ended("monitor", logs, *HOW, "--out", folder / "out", "--jobs", 2, "-q") == 1
    return folder


@pytest.fixture
def fleet(flown, tmp_path, monkeypatch):
    """The same, to change; paths are as they were."""
    shutil.copytree(flown, tmp_path / "fleet", copy_function=shutil.copy2)
    kept = tmp_path / "kept"
    flown.rename(kept)
    (tmp_path / "fleet").rename(flown)
    monkeypatch.chdir(flown)
    yield flown
    monkeypatch.undo()
    shutil.rmtree(flown)
    kept.rename(flown)


def rows_of(folder):
    return {Path(row["log"]).name: row for row in pq.read_table(folder / "out/fleet.parquet").to_pylist()}


@pytest.mark.nightly
def test_every_log_is_a_row_and_a_bad_one_says_why(flown):
    rows = rows_of(flown)
    assert list(rows) == ["flight_9.csv", "flight_10.csv", "flight_11.csv"]
    assert [row["outcome"] for row in rows.values()] == ["healthy", "failed", "error"]
    assert rows["flight_10.csv"]["verdict"].startswith("The pitch gyro (q) failed from 4")
    assert 43.0 < rows["flight_10.csv"]["first_alarm_s"] < 50.0
    assert "it names columns, and holds no row of values" in rows["flight_11.csv"]["error"]
    assert rows["flight_11.csv"]["verdict"] is None
    healthy = rows["flight_9.csv"]
    assert "would have been detected" in healthy["certificate"]
    assert healthy["p_bias_seen_deg_s"] > 0.0
    assert healthy["false_alarms_per_hour_at_most"] > 0.0
    assert healthy["autopilot"] is None


@pytest.mark.nightly
def test_a_row_is_what_the_log_alone_comes_to(flown):
    path = flown / "logs/flight_9.csv"
    alone = fleet_row(gb.watch_log(path, "C", healthy=[(0.0, 30.0)]))
    row = rows_of(flown)["flight_9.csv"]
    assert alone == {name: row[name] for name in alone}


def test_the_page_and_the_figure_stand_beside(flown):
    text = (flown / "out/fleet.html").read_text()
    lines = [line for line in text.splitlines() if line.startswith("<tr><td")]
    assert ["flight_10" in lines[0], "flight_11" in lines[1], "flight_9" in lines[2]] == [True] * 3
    assert all(escape(row["verdict"]) in text for row in rows_of(flown).values() if row["verdict"])
    assert 'href="pages/flight_10.csv-' in lines[0]
    assert "it names columns, and holds no row of values" in text
    assert (flown / "out/gyros.png").read_bytes().startswith(b"\x89PNG")
    assert "data:image/png;base64,iVBOR" in text


@pytest.mark.nightly
def test_what_is_lost_is_done_anew_to_the_same_bytes(fleet, capsys):
    table = (fleet / "out/fleet.parquet").read_bytes()
    (fleet / "out/part-000001.parquet").unlink()
    (fleet / "out/fleet.parquet").unlink()
    with in_this_process():
        assert ended("monitor", fleet / "logs", *HOW, "--out", fleet / "out", "--resume", "--json") == 1
    assert (fleet / "out/fleet.parquet").read_bytes() == table
    told = json.loads(capsys.readouterr().out)
    assert told["counts"] == {"failed": 1, "unknown": 0, "error": 1, "healthy": 1}
    assert [row["outcome"] for row in told["logs"]] == ["failed", "error", "healthy"]
    assert set(told["logs"][0]) == set(COLUMNS)


def test_the_table_fits_a_terminal(fleet, capsys):
    assert ended("monitor", fleet / "logs", *HOW, "--out", fleet / "out", "--resume") == 1
    out, err = capsys.readouterr()
    assert err == ""
    assert max(map(len, out.splitlines())) <= 140
    assert out.index("flight_10.csv") < out.index("flight_11.csv") < out.index("flight_9.csv")
    assert "3 logs: 1 failed, 1 not read, 1 no fault found." in out


def test_another_fleet_does_not_mix_with_it(fleet, capsys):
    out = ("--out", fleet / "out")
    for arguments, why in (
        ([fleet / "logs", *HOW, *out], "3 of 3 tasks"),
        ([fleet / "logs", "--detector", "C", "--healthy", "0:29", *out, "--resume"], "holds another fleet"),
        ([fleet / "logs/flight_9.csv", *HOW, *out, "--resume"], "holds another fleet"),
    ):
        assert ended("monitor", *arguments) == 2
        assert why in capsys.readouterr().err
    with (fleet / "logs/flight_9.csv").open("a") as file:
        file.write("\n")
    assert ended("monitor", fleet / "logs", *HOW, *out, "--resume") == 2
    assert "flight_9.csv" in (said := capsys.readouterr().err)
    assert "isn't (so) any more" in said


@pytest.mark.nightly
def test_a_fleet_grows_by_the_logs_that_are_new(fleet, capsys):
    before = {path.name: path.stat().st_mtime_ns for path in (fleet / "out").glob("part-*.parquet")}
    (fleet / "logs/flight_1.csv").write_text("no log at all\n")  # the first by name
    assert ended("monitor", fleet / "logs", *HOW, "--out", fleet / "out", "--resume", "--json") == 1
    assert json.loads(capsys.readouterr().out)["counts"]["error"] == 2
    after = {path.name: path.stat().st_mtime_ns for path in (fleet / "out").glob("part-*.parquet")}
    assert after.items() > before.items(), "what was watched isn't watched anew"
    assert rows_of(fleet)["flight_1.csv"]["outcome"] == "error"


@pytest.mark.parametrize(
    ("outcomes", "code"),
    [
        (["healthy", "healthy"], 0),
        (["healthy", "error", "failed", "unknown"], 1),
        (["error", "error"], 2),
        (["healthy", "unknown"], 3),
        (["healthy", "error"], 3),
        (["unknown", "error"], 3),
    ],
)
def test_the_exit_code_is_never_a_false_all_clear(outcomes, code):
    assert exit_code([{"outcome": outcome} for outcome in outcomes]) == code


def test_worst_comes_first():
    def row(outcome, alarms=0, doubtful=0, seen=1.0):
        gyros = {f"{gyro}_bias_seen_deg_s": seen for gyro in "pqr"}
        return {"outcome": outcome, "alarms": alarms, "doubtful_alarms": doubtful, **gyros}

    wanted = [
        row("failed", 3, 0),
        row("failed", 4, 3),
        row("failed", 1, 0),
        row("unknown", 2, 2),
        row("unknown"),
        {"outcome": "error"},
        row("healthy", seen=None),
        row("healthy", seen=4.0),
        row("healthy", seen=0.5),
    ]
    shuffled = [wanted[place] for place in np.random.default_rng(1).permutation(len(wanted))]
    assert worst_first(shuffled) == wanted


def row_with_page(watched):
    return Kept(fleet_row(watched), "page")


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_a_log_that_kills_its_process_does_not_stop_the_others(tmp_path):
    logs = small_logs(tmp_path, ["a.csv", "dies.csv", "raises.csv", "z.csv"])
    told = []
    parts = conduct(
        logs,
        SMALL,
        tmp_path / "out",
        row=row_or_worse,
        keep=forget,
        columns=COLUMNS,
        progress=lambda *step: told.append(step),
    )
    rows = parts.read().to_pylist()
    assert [row["outcome"] for row in rows] == ["healthy", "error", "error", "healthy"]
    assert "killed" in rows[1]["error"]
    assert rows[2]["error"] == "RecursionError: deep in it"
    assert told == [("logs", done, 4) for done in range(5)]


def no_page(_log, _page):
    raise unwritten(Path("page.html"), OSError(errno.ENOSPC, "full"))


@pytest.mark.nightly
def test_a_full_disk_is_no_logs_fault_and_ends_the_fleet(tmp_path):
    logs, out = small_logs(tmp_path, ["log.csv"]), tmp_path / "out"
    with pytest.raises(gb.GtmbenchError, match=r"can't write page.html: No space left on device"):
        conduct(logs, SMALL, out, row=row_with_page, keep=no_page, columns=COLUMNS)
    parts = conduct(logs, SMALL, out, row=row_alone, keep=forget, columns=COLUMNS, resume=True)
    assert [row["outcome"] for row in parts.read().to_pylist()] == ["healthy"]


def test_what_is_wrong_with_every_log_is_said_before_any_is_watched(tmp_path, cli):
    small_logs(tmp_path, ["a.csv", "b.csv"])
    for arguments in (
        ["--detector", "nobody"],
        ["--detector", "C", "--healthy", "5:1"],
        ["--detector", "C", "--healthy", "nowhere.csv"],
        ["--detector", "C", "--map", "p"],
        ["--detector", "C", "--time-limit", "0"],
        ["--detector", "C", "--jobs", "0"],
        ["--detector", "C", "--report", "x.png"],
        ["--detector", "C", "--rate", "-1"],
    ):
        code, out, err = cli("monitor", ".", "--out", "out", *arguments)
        assert (code, out, err.count("\n")) == (2, "", 1), arguments
        assert not (tmp_path / "out").exists()
    assert cli("monitor", "a.csv", "b.csv", "--detector", "C")[2].endswith("give --out DIR\n")
    assert "is of several logs" in cli("monitor", "a.csv", "--jobs", "2")[2]


def test_a_folder_means_its_logs_in_the_order_of_their_names(tmp_path):
    for name in ("f10.csv", "f9.ulg", "sub/f1.bin", ".hidden.csv", ".git/f2.csv", "notes.txt", "results.json"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    (tmp_path / "old.log").write_text("FMT, 128, 89\n")
    (tmp_path / "out").mkdir()
    (tmp_path / "out/manifest.json").write_text("{}")
    (tmp_path / "out/part-000000.parquet").write_text("x")
    names = ["f9.ulg", "f10.csv", "old.log", "sub/f1.bin"]
    found = logs_in([tmp_path])
    assert [str(path.relative_to(tmp_path)) for path in found] == names
    assert logs_in([tmp_path, tmp_path / "f9.ulg", tmp_path / "sub/../f10.csv"]) == found
    assert [path.name for path in logs_in([tmp_path / "*.csv", tmp_path / "f9.ulg"])] == ["f10.csv", "f9.ulg"]
    assert [path.name for path in logs_in([tmp_path / "**/*.bin"])] == ["f1.bin"]
    assert [path.name for path in logs_in([tmp_path], apart=[tmp_path / "f9.ulg"])] == ["f10.csv", "old.log", "f1.bin"]


@pytest.mark.parametrize("given", ["empty", "*.csv", "x" * 3000 + "*"])
def test_no_logs_are_one_line(given, tmp_path, cli):
    (tmp_path / "empty").mkdir()
    code, out, err = cli("monitor", given, "--detector", "C", "--out", "out")
    assert (code, out, err.count("\n")) == (2, "", 1)


def test_gyro_figures_are_the_bias_and_the_noise_that_were_put_in():
    period_s, rng = 0.02, np.random.default_rng(5)
    time_s = period_s * np.arange(6000)
    angles = 5.0 * np.sin(2.0 * np.pi * np.outer(time_s, [0.11, 0.07, 0.05]))
    biases, noises = np.array([0.4, -1.2, 0.0]), np.array([0.05, 0.2, 0.5])
    gyros = terms_of(angles, period_s) @ rates_from((1.0, 1.0, 1.0)) + biases + noises * rng.standard_normal((6000, 3))
    record = gb.Record(
        np.hstack([gyros, angles]), channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.02
    )
    record = record.between(0.02, 119.9)
    silent = gb.FunctionDetector(lambda _: [], name="nothing").calibrate([])
    told = gyro_figures(watched_log([record], [record], silent))
    assert [figures.bias for figures in told] == pytest.approx(biases, abs=0.03)
    assert [figures.noise for figures in told] == pytest.approx(noises, rel=0.1)
    assert [figures.residual_rms for figures in told] == [None] * 3
    spoilt = record.replace("psi", np.where(record.time_s > 100.0, record["psi"] + 60.0, record["psi"]))
    assert gyro_figures(watched_log([spoilt], [spoilt], silent))[2].bias == pytest.approx(0.0, abs=0.05)
    short = record.between(0.02, 15.0)
    assert [figures.noise for figures in gyro_figures(watched_log([short], [short], silent))] == [None] * 3


def test_the_figure_joins_flights_of_one_folder(flown):
    frame = pq.read_table(flown / "out/fleet.parquet").to_pandas()
    assert gyros_figure(frame[frame["outcome"] == "error"]) is None
    frame["log"] = ["one/a.csv", "two/$x$.csv", "one/c.csv"]
    axes = gyros_figure(frame).axes
    line, values = axes[0].get_lines()[0], frame["p_residual_rms_deg_s"].to_numpy()
    np.testing.assert_array_equal(line.get_ydata(), [values[0], values[2], np.nan, values[1]])
    np.testing.assert_array_equal(line.get_xdata()[[0, 1, 3]], [1, 3, 2])


def test_long_words_are_cut(flown):
    row = rows_of(flown)["flight_10.csv"] | {"log": "x" * 100 + "/" + "y" * 80 + ".csv", "verdict": "why " * 500}
    for width in (80, 140, 220):
        columns, (cells,) = fleet_table([row], width)
        assert len(cells) == len(columns)
        assert ("autopilot" in columns) == (width > 100)
        rest = sum(len(cell) + 3 for name, cell in zip(columns, cells, strict=True) if name != "verdict")
        assert rest + 24 <= width
        assert len(cells[columns.index("verdict")]) <= 3 * (width - 53)
        assert cells[0].startswith("...y")
        assert cells[0].endswith("y.csv")


def test_a_watched_log_that_is_unknown_has_no_gaps_in_its_row():
    flight = gb.Record(np.zeros((50, 1)), channels=["p"], sample_period_s=0.02)
    asked = Scope(sensors=("p",))
    row = fleet_row(replace(watched_log([flight], [], monitor(), reasons=["too short"]), scope=asked))
    assert (row["outcome"], row["first_alarm_s"], row["p_bias_deg_s"]) == ("unknown", None, None)
    assert "too short" in row["verdict"]


def test_a_name_that_no_system_knows_is_one_line():
    with pytest.raises(gb.InputError, match="no file is called"):
        logs_in(["a.csv\0*"])


def test_a_folder_with_other_columns_says_in_one_line_what_to_do(tmp_path, cli):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/flight.csv").write_text("time_s,p_deg_s\n0,1\n")
    with parts_in(tmp_path / "out", what="fleet", tasks=1, facts={"watching": {}, "versions": {}}):
        pass
    for more in (["--resume"], []):
        code, out, err = cli("monitor", "logs", "--out", "out", *more)
        assert (code, out) == (2, "")
        assert err.splitlines()[-1].endswith("(schema 1, here 2); watch its logs anew into another --out")


def test_what_is_asked_is_a_fact_of_the_fleet():
    usual, gyros = FleetQuestion(), FleetQuestion(judge="gyros", limits=("2deg/s",))
    gyros.check()
    assert usual.facts() | {"judge": "gyros", "limits": ["2deg/s"]} == gyros.facts()
    with pytest.raises(gb.InputError, match="--limit is 0"):
        FleetQuestion(limits=("0deg",)).check()


def test_a_row_has_the_verdict_on_the_asked_sensors():
    made = clear() | {"r": [unjudged("gap", 0.0, 45.0), *clear(45.0)["r"]]}
    made["q"].append(failed("q", 60.0, 90.0))
    made["p"] = made["phi"] = [suspected(["p", "phi"], 60.0, 90.0), *clear()["p"]]
    row = fleet_row(Judged(short(), verdict(made)))
    assert set(row) <= set(COLUMNS)
    assert (row["outcome"], row["failed_sensors"], row["suspected_sensors"]) == ("failed", "q", "p, phi")
    assert row["judged_share"] == pytest.approx(0.75)
    assert row["verdict"].startswith("The pitch gyro (q) failed from 60.0 to 90.0 s: bias 3 deg/s; one of the roll")
