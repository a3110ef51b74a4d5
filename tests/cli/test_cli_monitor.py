"""`gtmbench monitor`: outcomes and exit codes, what it writes, what it refuses, and what it lists."""

import json
import shutil
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from tests.helpers.airliner import airliner

GYROS = ("--inputs", "p,beta,ny", "--outputs", "r")
HALF = ("--identify", "0:30")
pytestmark = pytest.mark.usefixtures("logs")


@cache
def flight(broken=False):
    """Return a minute, all axes moved in either half."""
    record = airliner("minute", 1, duration_s=60)
    return gb.inject(record, gb.Drift(channel="q", onset_s=43.0, slope=0.5)) if broken else record


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    gb.write_log(flight(), folder / "healthy.csv")
    gb.write_log(flight(broken=True), folder / "broken.csv")
    return folder


@pytest.fixture
def logs(written, tmp_path):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)


def names(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != "healthy.csv" and path.name != "broken.csv")


def test_a_broken_gyro_is_named_and_the_exit_code_says_so(cli):
    code, out, err = cli("monitor", "broken.csv", "--detector", "C", *HALF)
    assert (code, err) == (1, "")
    verdict, *lines = out.splitlines()
    assert verdict.startswith("The pitch gyro (q) failed from 4")
    assert ": drift 0.5" in verdict
    assert any(line.startswith("q       failed 4") for line in lines)
    assert len(lines) < 12
    code, details, err = cli("monitor", "broken.csv", "--detector", "C", *HALF, "--details")
    said = " ".join(details.split())
    assert (code, err, said.startswith(" ".join(out.partition("sensor  state")[0].split()))) == (1, "", True)
    assert "Learnt from  0.0 to 30.0 s of this log (bank C)." in details.splitlines()
    assert "learnt from this log: 0.00 to 30.00 s" in details
    assert "q failed; drift 0.5" in details


def test_a_healthy_flight_is_0_and_says_how_little_that_shows(cli):
    code, out, err = cli("monitor", "healthy.csv", "--detector", "C", *HALF)
    assert (code, err) == (0, "")
    assert out.startswith("No fault found in p, q, r, ")
    assert "\np       clear" in out
    assert "; an error of 0." in out
    assert "would show; a wrong factor would not show." in out.replace("\n", " ")
    details = cli("monitor", "healthy.csv", "--detector", "C", *HALF, "--details")[1]
    assert "How sure     No false alarm in 2" in details


def test_a_gyro_that_nobody_watches_is_told_and_never_clear(cli, tmp_path):
    log = gb.read_log(tmp_path / "healthy.csv")
    gb.write_log(log.replace("p", np.full(len(log), np.nan)), tmp_path / "deaf.csv")
    code, out, err = cli("monitor", "deaf.csv", "--identify", "0:30")
    verdict, *lines = out.splitlines()
    assert (code, err) == (3, "")  # q and r rest on a certificate, which leaves out the ends of what it was armed in
    assert verdict == "Cannot tell: too little is known before or behind it (31 of 60 s judged)."
    assert "Not watched  p isn't watched: 'p_deg_s' holds 0 samples; at least 20 are needed." in lines
    judged = json.loads(cli("monitor", "deaf.csv", "--identify", "0:30", "--json")[1])["timeline"]["sensors"]
    assert {span["state"] for span in judged["p"]} == {"not judged"}
    assert any(span["state"] == "clear" for span in judged["q"])


@pytest.mark.parametrize(
    ("identify", "reason"),
    [(":", "nothing of the log is left to watch"), (":59.5", "what is left to watch is too short")],
)
def test_what_cant_be_told_is_3(cli, identify, reason):
    code, out, err = cli("monitor", "healthy.csv", *GYROS, "--identify", identify)
    assert (code, err) == (3, "")
    assert out.startswith(f"Cannot tell: {reason}.\n")
    assert cli("monitor", "healthy.csv", *GYROS, "--identify", identify, "-q") == (3, "", "")


def test_quiet_prints_nothing_and_json_one_whole_object(cli):
    assert cli("monitor", "healthy.csv", *GYROS, "-q") == (3, "", "")  # its certificate clears too little
    code, out, err = cli("monitor", "broken.csv", "--detector", "C", *HALF, "--json")
    printed = json.loads(out)
    assert (code, err, printed["exit_code"], printed["outcome"]) == (1, "", 1, "failed")
    assert printed["identified_s"] == [[0.0, 30.0]]
    assert [finding["text"] for finding in printed["findings"]] == ["q failed"]
    assert printed["timeline"]["span_s"] == pytest.approx([0.0, 60.0], abs=0.05)
    assert any(span["state"] == "failed" for span in printed["timeline"]["sensors"]["q"])
    assert {row["residual"] for row in printed["residuals"]} == {"p", "q", "r"}
    assert printed["log"]["sample_period_s"] == 0.04
    assert printed["monitor"]["suspects"] == ["p", "q", "r", "phi", "theta", "psi"]
    error = cli("monitor", "healthy.csv", "--detector", "Z", "--json")
    assert (error[0], json.loads(error[1])["exit_code"], error[2]) == (2, 2, "")


def test_recording_figure_and_monitor_are_written_and_kept_unless_forced(cli, tmp_path, watched_anew):
    wanted = ("--record", "l.rrd", "--figure", "l.png", "--save", "l.json")
    code, out, err = cli("monitor", "broken.csv", "--detector", "C", *HALF, *wanted)
    assert (code, err) == (1, "")
    assert names(tmp_path) == ["l.json", "l.png", "l.rrd"]
    assert all(line in out for line in ("figure: l.png", "monitor: l.json", "gtmbench view l.rrd"))
    before = [(tmp_path / name).read_bytes() for name in names(tmp_path)]
    for option, name in zip(wanted[::2], wanted[1::2], strict=True):
        code, out, err = cli("monitor", "broken.csv", "--detector", "C", *HALF, option, name)
        assert (code, out) == (2, "")
        assert f"{name} exists; give another {option}, or --force to write over it" in err
    assert [(tmp_path / name).read_bytes() for name in names(tmp_path)] == before
    watched_anew()
    assert cli("monitor", "broken.csv", "--detector", "C", *HALF, "--save", "l.json", "--force", "-q")[0] == 1
    assert (tmp_path / "l.json").read_bytes() == before[0]


def test_what_goes_wrong_leaves_nothing_behind(cli, tmp_path):
    (tmp_path / "bad.csv").write_text("time_s,p_deg_s\n0.0,1.0\n0.04,x\n")
    for log in ("bad.csv", "nowhere.csv"):
        code, out, err = cli("monitor", log, *GYROS, "--save", "m.json", "--figure", "m.png")
        assert (code, out, err.count("\n")) == (2, "", 1)
    assert names(tmp_path) == ["bad.csv"]


def test_a_monitor_that_was_saved_watches_other_logs(cli):
    assert cli("monitor", "healthy.csv", "--detector", "C", *HALF, "--save", "C.json", "-q")[0] == 0
    code, out, _ = cli("monitor", "broken.csv", "--detector", "C.json", "--json")
    printed = json.loads(out)
    assert code == 1
    assert printed["identified_s"] == []
    assert [finding["text"] for finding in printed["findings"]] == ["q failed"]
    assert cli("monitor", "healthy.csv", "--detector", "C.json", "-q")[0] == 0
    code, _, err = cli("monitor", "broken.csv", "--detector", "C.json", "--rate", 50)
    assert code == 2
    assert "a rate of 50 Hz is given, and the monitor has its own, 25 Hz" in err


def test_another_log_teaches(cli):
    code, out, _ = cli("monitor", "broken.csv", "--detector", "C", "--identify", "healthy.csv")
    assert code == 1
    assert out.startswith("The pitch gyro (q) failed from 4")
    details = cli("monitor", "broken.csv", "--detector", "C", "--identify", "healthy.csv", "--details")[1]
    assert "Learnt from  healthy.csv (bank C)." in details


def test_without_a_word_on_how_it_lists_what_the_log_allows(cli):
    code, out, err = cli("monitor", "healthy.csv")
    assert code == 2
    assert err.count("\n") == 1
    assert "healthy.csv can be watched; say how: --identify T0:T1, a healthy part in s (bank auto" in err
    assert "--detector C-early or C-filtered or C or leave-one-out or paper, or --inputs" in err
    assert "bank auto: possible (p, q and r from phi, psi and theta, as bank C)" in out
    assert "with --detector: bank C-early, C-filtered, C, leave-one-out, paper" in out
    assert "bank B: no, alpha, nz, tas missing" in out
    assert "pseudo inputs: p_att, q_att, r_att" in out
    assert "p_deg_s, q_deg_s, r_deg_s" in next(line for line in out.splitlines() if line.startswith("gyros"))
    listed = cli("monitor", "healthy.csv", "--list")
    assert listed == (0, out, "")
    code, out, _ = cli("monitor", "healthy.csv", "--all")
    assert code == 0
    assert all(header in out for header in ("p_deg_s", "samples", "rate (Hz)", "channel"))
    silent = cli("monitor", "healthy.csv", "-q")
    assert silent == (2, "", err)
    assert json.loads(cli("monitor", "healthy.csv", "--json")[1])["exit_code"] == 2


NONSENSE = ["a:b", "5:1", "5:5", "1e400:2", "nan:3", "3:nan", "0:1:2", "x:", "::", "0x1:5"]


@pytest.mark.parametrize("text", NONSENSE)
def test_a_span_that_is_none_is_refused_in_one_line(cli, text):
    code, out, err = cli("monitor", "healthy.csv", *GYROS, "--identify", text)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"--identify is '{text}'" in err


@pytest.mark.parametrize("text", ["0:30", " 0 : 30 ", ":30", "0:3e1", "-5:30", "-inf:30", "+0:30.01"])
def test_a_span_may_be_written_in_many_ways(cli, text):
    code, out, _ = cli("monitor", "healthy.csv", *GYROS, "--identify", text, "--json")
    assert (code, json.loads(out)["identified_s"][0][0]) == (3, 0.0)  # its certificate clears too little
    assert json.loads(out)["identified_s"][0][1] == pytest.approx(30.0, abs=0.011)


BAD = {
    "both ways": (["--detector", "C", *GYROS], "both --detector and --inputs/--outputs are given"),
    "no outputs": (["--inputs", "p,beta"], "--outputs is missing"),
    "no inputs": (["--outputs", "r"], "--inputs is missing"),
    "itself": (["--inputs", "r,p", "--outputs", "r"], "'r' is both pseudo input and pseudo output"),
    "nothing named": (["--inputs", ",", "--outputs", "r"], "at least one pseudo input"),
    "no such channel": (["--inputs", "p,rpm", "--outputs", "r"], "rpm"),
    "no such bank": (["--detector", "Z"], "no detector is called 'Z'; there are dissertation, auto, B, C"),
    "no such monitor": (["--detector", "z.json"], "z.json: no such file; `gtmbench calibrate` writes one"),
    "a bank that lacks channels": (["--detector", "B"], "bank B needs"),
    "no such other log": ([*GYROS, "--identify", "nowhere.csv"], "nowhere.csv"),
    "the log itself": ([*GYROS, "--identify", "healthy.csv"], "healthy.csv is the log that is watched"),
    "outside": ([*GYROS, "--identify", "70:90"], "70..90 s hold nothing of healthy.csv, which runs from 0 to 60 s"),
    "too short": ([*GYROS, "--identify", "0:2"], "too short to calibrate on"),
    "look": ([*GYROS, "--look", "-1"], "--look is -1"),
    "a look longer than the record": ([*GYROS, "--look", "20"], "too few for the residual of r, which looks over 40 s"),
    "rate": ([*GYROS, "--rate", "0"], "--rate is 0"),
    "false alarms": ([*GYROS, "--false-alarms-per-hour", "0"], "--false-alarms-per-hour is 0"),
    "the log as its figure": ([*GYROS, "--save", "healthy.csv"], "its name ends in .json"),
    "no folder": ([*GYROS, "--save", "nowhere/m.json"], "doesn't exist; create it first"),
    "no png": ([*GYROS, "--figure", "f.pdf"], "--figure is 'f.pdf'; its name ends in .png"),
    "no rrd": ([*GYROS, "--record", "f.mcap"], "--record is 'f.mcap'; its name ends in .rrd"),
    "mapping": ([*GYROS, "--map", "p"], "p"),
}


@pytest.mark.parametrize(("given", "words"), BAD.values(), ids=BAD)
def test_bad_input_is_2_and_one_line(cli, tmp_path, given, words):
    code, out, err = cli("monitor", "healthy.csv", *given)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err
    assert names(tmp_path) == []


def test_columns_that_dont_say_what_they_are_are_mapped(cli, tmp_path):
    frame = flight(broken=True).frame()
    odd = frame[["phi", "theta", "psi"]].copy()
    for name, column in zip("pqr", ("gx", "gy", "gz"), strict=True):
        odd[column] = np.deg2rad(frame[name])
    odd.index.name = "stamp"
    odd.to_csv(tmp_path / "odd.csv")
    code, _, err = cli("monitor", "odd.csv", "--detector", "C", *HALF)
    assert code == 2
    assert err.count("\n") == 1
    angles = [f"--map={name}={name}:deg" for name in ("phi", "theta", "psi")]
    gyros = [f"--map={name}={column}:rad/s" for name, column in zip("pqr", ("gx", "gy", "gz"), strict=True)]
    code, out, err = cli("monitor", "odd.csv", "--map", "time=stamp:s", *angles, *gyros, "--detector", "C", *HALF)
    assert (code, err) == (1, "")
    assert out.startswith("The pitch gyro (q) failed from 4")
    assert "Read as      p, q, r, phi, psi, theta; 25 Hz." in out
