"""`gtmbench monitor`: outcomes and exit codes, what it writes, what it refuses, and what it lists."""

import json
import re
import shutil
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from tests.helpers.airliner import airliner
from tests.helpers.hostile import refused

OWN = """title = "r from p, beta and ny"
suspects = ["r", "p", "beta", "ny"]
residuals = [{ output = "r", inputs = ["p", "beta", "ny"], look_back_s = 0.5, look_ahead_s = 0.5 }]
alarm = { statistic = "energy", windows_s = [0.5, 2.0], two_sided = false }
"""
GYROS = ("--detector", "own.toml")
HALF = ("--healthy", "0:30")
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
    (folder / "own.toml").write_text(OWN)
    return folder


@pytest.fixture
def logs(written, tmp_path):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)


def names(folder):
    return sorted(path.name for path in folder.iterdir() if path.name not in ("healthy.csv", "broken.csv", "own.toml"))


def test_a_broken_gyro_is_named_and_the_exit_code_says_so(cli):
    code, out, err = cli("monitor", "broken.csv", "--detector", "C", *HALF)
    assert (code, err) == (1, "")
    verdict, *lines = out.splitlines()
    assert verdict.startswith("The pitch gyro (q) failed from 4")
    assert ": drift 0.5" in verdict
    assert any(line.startswith("q       failed 4") for line in lines)
    assert len(lines) < 12


@pytest.mark.nightly
def test_details_begin_with_what_is_said_without_them(cli):
    out = cli("monitor", "broken.csv", "--detector", "C", *HALF)[1]
    code, details, err = cli("monitor", "broken.csv", "--detector", "C", *HALF, "--details")
    said = " ".join(details.split())
    assert (code, err, said.startswith(" ".join(out.partition("sensor  state")[0].split()))) == (1, "", True)
    assert "Learnt from  0.0 to 30.0 s of this log (bank C)." in details.splitlines()
    assert "learnt from this log: 0.00 to 30.00 s" in details
    assert "q failed; drift 0.5" in details


@pytest.mark.nightly
def test_a_healthy_flight_is_0_and_says_how_little_that_shows(cli):
    code, out, err = cli("monitor", "healthy.csv", "--detector", "C", *HALF)
    assert (code, err) == (0, "")
    assert out.startswith("No fault found in p, q, r, ")
    assert "\np       clear" in out
    assert "; an error of 0." in out
    assert "would show; a wrong factor would not show." in out.replace("\n", " ")
    details = cli("monitor", "healthy.csv", "--detector", "C", *HALF, "--details")[1]
    assert "How sure     No false alarm in 2" in details


@pytest.mark.nightly
def test_a_gyro_that_nobody_watches_is_told_and_never_clear(cli, tmp_path):
    log = gb.read_log(tmp_path / "healthy.csv")
    gb.write_log(log.replace("p", np.full(len(log), np.nan)), tmp_path / "deaf.csv")
    code, out, err = cli("monitor", "deaf.csv", "--healthy", "0:30")
    verdict, *lines = out.splitlines()
    assert (code, err) == (3, "")  # q and r rest on a certificate, which leaves out the ends of what it was armed in
    assert verdict == "Cannot tell: too little is known before or behind it (31 of 60 s judged)."
    assert "Not watched  p isn't watched: 'p_deg_s' holds 0 samples; at least 20 are needed." in lines
    judged = json.loads(cli("monitor", "deaf.csv", "--healthy", "0:30", "--json")[1])["timeline"]["sensors"]
    assert {span["state"] for span in judged["p"]} == {"not judged"}
    assert any(span["state"] == "clear" for span in judged["q"])


@pytest.mark.parametrize(
    ("identify", "reason"),
    [(":", "nothing of the log is left to watch"), (":59.5", "what is left to watch is too short")],
)
def test_what_cant_be_told_is_3(cli, identify, reason):
    code, out, err = cli("monitor", "healthy.csv", *GYROS, "--healthy", identify)
    assert (code, err) == (3, "")
    assert out.startswith(f"Cannot tell: {reason}.\n")
    assert cli("monitor", "healthy.csv", *GYROS, "--healthy", identify, "-q") == (3, "", "")


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


@pytest.mark.nightly
def test_recording_page_and_figure_are_written_and_kept_unless_forced(cli, tmp_path, watched_anew):
    wanted = ("--record", "l.rrd", "--report", "l.png", "--report", "l.html")
    code, out, err = cli("monitor", "broken.csv", "--detector", "C", *HALF, *wanted)
    assert (code, err) == (1, "")
    assert names(tmp_path) == ["l.html", "l.png", "l.rrd"]
    assert all(line in out for line in ("figure: l.png", "report: l.html", "gtmbench view l.rrd"))
    before = [(tmp_path / name).read_bytes() for name in names(tmp_path)]
    for option, name in zip(wanted[::2], wanted[1::2], strict=True):
        assert f"{name} exists; give another {option}, or --force to write over it" in refused(
            cli("monitor", "broken.csv", "--detector", "C", *HALF, option, name)
        )
    assert [(tmp_path / name).read_bytes() for name in names(tmp_path)] == before
    watched_anew()
    assert cli("monitor", "broken.csv", "--detector", "C", *HALF, "--report", "l.html", "--force", "-q")[0] == 1
    assert (tmp_path / "l.html").read_bytes() == before[0]


def test_what_goes_wrong_leaves_nothing_behind(cli, tmp_path):
    (tmp_path / "bad.csv").write_text("time_s,p_deg_s\n0.0,1.0\n0.04,x\n")
    for log in ("bad.csv", "nowhere.csv"):
        refused(cli("monitor", log, *GYROS, "--report", "m.html", "--report", "m.png"))
    assert names(tmp_path) == ["bad.csv"]


@pytest.mark.nightly
def test_a_monitor_that_was_learnt_on_a_part_watches_other_logs(cli):
    assert cli("calibrate", "healthy.csv", "--detector", "C", *HALF, "--out", "C.json", "-q")[0] == 0
    code, out, _ = cli("monitor", "broken.csv", "--detector", "C.json", "--json")
    printed = json.loads(out)
    assert code == 1
    assert printed["identified_s"] == []
    assert [finding["text"] for finding in printed["findings"]] == ["q failed"]
    assert cli("monitor", "healthy.csv", "--detector", "C.json", "-q")[0] == 0
    assert "a rate of 50 Hz is given, and the monitor has its own, 25 Hz" in refused(
        cli("monitor", "broken.csv", "--detector", "C.json", "--rate", 50)
    )


def test_a_log_alone_gets_a_verdict_and_list_says_what_there_is(cli):
    code, out, err = cli("monitor", "broken.csv")
    assert (code, err) == (1, "")
    assert out.startswith("The pitch gyro (q) failed from 4")
    assert cli("monitor", "broken.csv", "--detector", "auto") == (code, out, err)
    code, out, err = cli("monitor", "healthy.csv", "--list")
    assert (code, err) == (0, "")
    assert "watch it: gtmbench monitor healthy.csv\n" in out
    assert "bank auto: possible (p, q and r from phi, psi and theta, as bank C)" in out
    assert "with --detector: bank C-early, C-filtered, C, leave-one-out, paper" in out
    assert "bank B: no, alpha, nz, tas missing" in out
    assert "pseudo inputs: p_att, q_att, r_att" in out
    assert "p_deg_s, q_deg_s, r_deg_s" in next(line for line in out.splitlines() if line.startswith("gyros"))
    code, out, _ = cli("monitor", "healthy.csv", "--list", "--details")
    assert code == 0
    assert all(header in out for header in ("p_deg_s", "samples", "rate (Hz)", "channel"))
    assert cli("monitor", "healthy.csv", "--list", "-q") == (0, "", "")


def test_sixteen_options_and_those_that_few_need_apart(cli):
    told, apart = cli("monitor", "--help")[1].split("Options:")[1].split("Long runs:")
    assert re.findall(r"^  (?:-\w, )?--([\w-]+)", told, flags=re.MULTILINE) == [
        *("map", "units", "rate", "system", "detector", "healthy", "judge", "limit", "details", "list"),
        *("record", "report", "out", "jobs", "quiet", "json"),
    ]
    assert re.findall(r"^  (?:-\w, )?--([\w-]+)", apart, flags=re.MULTILINE) == [
        *("resume", "scheduler", "tls", "time-limit", "history", "aircraft-id", "import", "force", "help")
    ]


MOVED = {
    "--inputs": "gtmbench calibrate LOG --inputs p,q,beta --outputs r ...",
    "--false-alarms-per-hour": "gtmbench calibrate LOG --healthy T0:T1 --false-alarms-per-hour RATE ...",
    "--attitude": "gtmbench calibrate LOG --attitude own|driven ...",
    "--save": "gtmbench calibrate LOG --healthy T0:T1 --out monitor.json",
    "--named": "--details",
    "--all": "--list --details",
    "--figure": "--report FIGURE.png",
    "--map-file": "--map FILE.toml",
    "--calibrated": "--detector FILE.py:OBJECT@FILE.json",
}


@pytest.mark.parametrize("option", MOVED)
def test_an_option_that_moved_says_where_it_went(cli, option):
    assert refused(cli("monitor", "healthy.csv", option, "x")).startswith(
        f"gtmbench: {option} has moved: {MOVED[option].removesuffix(' ...')}"
    )


def test_identify_is_healthy(cli):
    for identified in (("--identify", ":59.5"), ("--identify=:59.5",)):
        healthy = [each.replace("identify", "healthy") for each in identified]
        assert cli("monitor", "broken.csv", *GYROS, *identified) == cli("monitor", "broken.csv", *GYROS, *healthy)
    assert "--identify" not in cli("monitor", "--help")[1]


NONSENSE = ["a:b", "5:1", "5:5", "1e400:2", "nan:3", "3:nan", "0:1:2", "x:", "::", "0x1:5"]


@pytest.mark.parametrize("text", NONSENSE)
def test_a_span_that_is_none_is_refused_in_one_line(cli, text):
    assert f"--healthy is '{text}'" in refused(cli("monitor", "healthy.csv", *GYROS, "--healthy", text))


@pytest.mark.parametrize("text", ["0:30", " 0 : 30 ", ":30", "0:3e1", "-5:30", "-inf:30", "+0:30.01"])
def test_a_span_may_be_written_in_many_ways(cli, text):
    code, out, _ = cli("monitor", "healthy.csv", *GYROS, "--healthy", text, "--json")
    assert (code, json.loads(out)["identified_s"][0][0]) == (3, 0.0)  # its certificate clears too little
    assert json.loads(out)["identified_s"][0][1] == pytest.approx(30.0, abs=0.011)
