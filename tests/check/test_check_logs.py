"""Recorded flights in CI: a baseline of their verdicts, the assertions on a log, and the workflow of the how-to."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import gtmbench as gb
from gtmbench.testing import assert_detects, assert_quiet, fly_once
from tests.helpers.hostile import refused
from tests.helpers.pages import ROOT, blocks, commands

PAGE = ROOT / "docs/how_to/my_logs_in_ci.md"
HEALTHY = gb.decimate(gb.measure(fly_once(duration_s=90, seed=1), noise="t2", seed=1), 4)
BROKEN = gb.inject(HEALTHY, gb.Bias(channel="q", onset_s=60.0, size=3.0))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a folder with two flights and the baseline of their verdicts."""
    folder = tmp_path_factory.mktemp("ci")
    (folder / "logs").mkdir()
    gb.write_log(HEALTHY, folder / "logs/flight.csv")
    gb.write_log(BROKEN, folder / "logs/broken.csv")
    return folder


@pytest.fixture
def folder(recorded, tmp_path, monkeypatch, cli):
    """Return a copy of it that one may spoil."""
    monkeypatch.chdir(recorded)
    if not (recorded / "logs.toml").exists():
        code, out, err = cli("check", "logs.toml", "--update", "--logs", "logs")
        assert (code, err) == (0, "")
        assert out.endswith("commit it, and run: gtmbench check logs.toml\n")
    for path in recorded.rglob("*.*"):
        (tmp_path / path.relative_to(recorded)).parent.mkdir(exist_ok=True)
        (tmp_path / path.relative_to(recorded)).write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.nightly
@pytest.mark.usefixtures("folder")
def test_the_same_logs_pass_and_every_sensor_is_held(cli):
    code, out, err = cli("check", "logs.toml", "--json")
    told = json.loads(out)
    assert (code, err, told["passed"], told["logs"]) == (0, "", True, ["logs/broken.csv", "logs/flight.csv"])
    held = {figure["group"]: figure for figure in told["figures"] if figure["figure"] == "failed"}
    assert held["logs/broken.csv: q"]["was"] is held["logs/broken.csv: q"]["is"] is True
    assert [name for name, figure in held.items() if figure["was"]] == ["logs/broken.csv: q"]


def test_a_failure_that_is_missed_is_a_regression(folder, cli):
    (folder / "logs/broken.csv").write_bytes((folder / "logs/flight.csv").read_bytes())
    code, out, _ = cli("check", "logs.toml")
    assert code == 1
    assert re.search(r"^logs/broken\.csv: q, failed: was yes, is no, allowed yes \(No fault found", out, re.MULTILINE)


@pytest.mark.nightly
def test_an_accusation_and_less_that_is_judged_are_regressions(folder, cli):
    gb.write_log(BROKEN, folder / "logs/flight.csv")
    assert "logs/flight.csv: q, failed: was no, is yes, allowed no" in cli("check", "logs.toml")[1]
    gb.write_log(HEALTHY.between(HEALTHY.start_s, 60.0), folder / "logs/flight.csv")
    assert re.search(r"logs/flight\.csv: p, judged: was \d+, is \d", cli("check", "logs.toml")[1])


def test_another_log_and_one_that_is_gone_are_no_regression(folder, cli):
    gb.write_log(HEALTHY, folder / "logs/new.csv")
    assert (
        refused(cli("check", "logs.toml"))
        == "gtmbench: logs.toml: it holds no figures of log 'logs/new.csv' yet; --update records them\n"
    )
    (folder / "logs/new.csv").unlink()
    (folder / "logs/flight.csv").unlink()
    assert "it holds figures of log 'logs/flight.csv', which isn't there any more" in cli("check", "logs.toml")[2]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["logs.toml", "--logs", "logs"], "--logs is for a new baseline, with --update"),
        (["logs.toml", "--update", "--logs", "logs"], "exists and names its own logs"),
        (["new.toml", "--update", "--logs", "nowhere"], "nowhere"),
        (["new.toml", "--update", "--logs", "logs", "--scenario", "jam"], "--scenario and --logs are both given"),
    ],
)
def test_what_cannot_be_meant_is_one_line(cli, given, said):
    assert said in refused(cli("check", *given))
    assert not Path("new.toml").exists()


@pytest.mark.nightly
@pytest.mark.usefixtures("folder")
def test_a_log_is_held_by_its_path_and_as_a_flight_log():
    for log in ("logs/flight.csv", Path("logs/flight.csv"), gb.open_log("logs/flight.csv")):
        assert_quiet(log)
    assert_quiet("C", gb.open_log("logs/flight.csv"), healthy=[(0.0, 40.0)])
    for log in ("logs/broken.csv", gb.open_log("logs/broken.csv")):
        assert_detects(log, sensor="q", from_s=60, within_s=2)


@pytest.mark.nightly
@pytest.mark.usefixtures("folder")
def test_a_failure_names_log_verdict_and_recording():
    with pytest.raises(AssertionError, match=r"broken\.csv: The pitch gyro \(q\) failed from .*recording: .*\.rrd"):
        assert_quiet("logs/broken.csv")
    for how, said in (
        ({"sensor": "p", "from_s": 60}, "no failure was found; q failed, too"),
        ({"sensor": "q", "from_s": 30}, r"the failure begins at (59|60)\.\d\d s"),
    ):
        with pytest.raises(AssertionError, match=said):
            assert_detects("logs/broken.csv", **how, within_s=2)
    with pytest.raises(AssertionError, match="no failure was found"):
        assert_detects("logs/flight.csv", sensor="q", from_s=60, within_s=2)


def test_what_an_assertion_lacks_is_told(recorded, monkeypatch):
    monkeypatch.chdir(recorded)
    with pytest.raises(gb.InputError, match="give sensor='q' and from_s=100, and no fault"):
        assert_detects("logs/broken.csv", gb.Jam(channel="p", onset_s=10), within_s=2)
    with pytest.raises(gb.InputError, match=r"nothing judges 'rpm'; there are p, q, r"):
        assert_detects("logs/broken.csv", sensor="rpm", from_s=60, within_s=2)
    with pytest.raises(gb.InputError, match=r"brken\.csv: no such file; did you mean 'logs/broken\.csv'"):
        assert_quiet("logs/brken.csv")
    with pytest.raises(gb.InputError, match="judge is about a recorded flight, and none is given"):
        assert_quiet(lambda _: [], judge="gyros")


@pytest.mark.nightly
def test_the_workflow_of_the_page_runs_and_fails_where_a_flight_is_judged_worse(folder):
    assert len(PAGE.read_text().splitlines()) <= 30
    assert [line.split()[:3] for line in commands(PAGE)] == [["gtmbench", "check", "logs.toml"]] * 2
    (folder / "test_logs.py").write_text(blocks(PAGE, "python")[0])
    (text,) = blocks(PAGE, "yaml")
    _, check, pytests = yaml.safe_load(text)["jobs"]["logs"]["steps"]
    assert check["uses"].startswith("OWNER/gtmbench@")
    action = yaml.safe_load((ROOT / "action.yml").read_text())
    assert set(check["with"]) <= set(action["inputs"])
    python = shlex.quote(sys.executable)
    gate = action["runs"]["steps"][-1]["run"].replace("gtmbench check", f"{python} -m gtmbench check")
    environment = {"BASELINE": check["with"]["baseline"], "JUNIT": "", "GITHUB_OUTPUT": str(folder / "out")}
    tests = pytests["run"].partition("&& ")[2].replace("pytest", f"{python} -m pytest -q")
    for spoilt, expected in ((False, (0, 0)), (True, (1, 1))):
        if spoilt:
            (folder / "logs/broken.csv").write_bytes((folder / "logs/flight.csv").read_bytes())
        ended = [_typed(line, environment).returncode for line in (gate, tests)]
        assert tuple(ended) == expected


def _typed(line, environment):
    return subprocess.run(
        ["bash", "-c", line], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
