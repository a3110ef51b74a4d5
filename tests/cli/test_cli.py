"""The command line: what each command prints and writes, and one clear line and exit code 2 for bad input."""

import json
import os
import signal
import subprocess
import sys

import pytest

import gtmbench as gb
from gtmbench.cli import study
from gtmbench.faults.registry import FAULTS
from tests.helpers.hostile import refused
from tests.helpers.night import by_day

SHORT = """
duration_s = 60.0
severity_reference_s = [5.0, 40.0]
[operator]
causal_order = 5
noncausal_order = 5
identify_s = [5.0, 30.0]
[alarm]
window = 100
threshold_s = [30.0, 50.0]
healthy_records = 1
[[faults]]
kind = "jam"
channels = ["r"]
onset_s = 40.0
"""


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


def test_trim_is_printed_as_the_dissertation_does(cli):
    code, out, _ = cli("aircraft")
    assert code == 0
    assert "altitude = 8000.00 ft, equivalent airspeed = 89.18 kt, true airspeed = 100.58 kt" in out
    assert "yaw = 45.00 deg, ground track = 45.00 deg" in out


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_fly_writes_what_python_flies(cli, ending):
    code, out, _ = cli("fly", "--out", f"flight.{ending}", "--duration", 2, "--excitation", "multisine", "--seed", 3)
    assert code == 0
    assert "201 samples" in out
    record = gb.read_log(f"flight.{ending}")
    assert (record.values == gb.fly(excitation="multisine", duration_s=2, seed=3).values).all()


@pytest.mark.parametrize(("noise", "as_python"), [("t2", {"noise": "t2"}), ("50", {"snr": 50.0})])
def test_fly_with_noise_writes_what_sensors_read(cli, noise, as_python):
    assert cli("fly", "--out", "log.csv", "--duration", 2, "--noise", noise)[0] == 0
    expected = gb.measure(gb.fly(duration_s=2), seed=1, **as_python)
    assert (gb.read_log("log.csv").values == expected.values).all()


def test_run_writes_results_figures_and_a_recording(cli, scenario, tmp_path):
    code, out, _ = cli("run", scenario, "--out", "here")
    assert code == 0
    assert "1 of 1 fault detected" in out
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert names == {
        "results.json",
        "trials.csv",
        "study.rrd",
        "markov.png",
        "prediction.png",
        "norm_short.png",
        "SHA256SUMS",
    }
    assert json.loads((tmp_path / "here/results.json").read_text())["trials"][0]["detected"] is True


def test_a_miss_is_reported_with_its_reason_and_brackets_stay_what_they_are(cli, tmp_path):
    path = tmp_path / "x[red]y.toml"
    path.write_text(SHORT.replace('"r"', '"altitude"'))
    code, out, _ = cli("run", path, "--no-figures", "--no-recording")
    assert code == 0
    assert "[p q beta] -> r: 1 trial" in out
    assert "x[red]y" in out
    assert "missed: dissertation doesn't use" in out
    assert "0 of 1 fault detected" in out


def test_an_existing_folder_is_kept_unless_forced(cli, scenario, tmp_path):
    (tmp_path / "study").mkdir()
    (tmp_path / "study/mine.txt").write_text("keep me")
    err = refused(cli("run", scenario))
    assert "study exists" in err
    assert "--force" in err
    assert cli("run", scenario, "--force", "--no-figures", "--no-recording")[0] == 0
    assert (tmp_path / "study/mine.txt").read_text() == "keep me"
    assert (tmp_path / "study/results.json").exists()


def test_new_writes_a_scenario_that_runs_unedited_but_for_its_length(cli, tmp_path):
    code, out, _ = cli("run", "--new", "mine.toml")
    assert code == 0
    assert "gtmbench run mine.toml" in out
    loaded = gb.load_scenario(tmp_path / "mine.toml")
    assert len(loaded.faults) == 7
    assert cli("run", "--new", "mine.toml")[0] == 2


def test_list_names_everything_there_is(cli):
    _, out, _ = cli("list", "--json")
    listed = json.loads(out)
    assert set(listed) - {"verdict", "exit_code", "findings", "schema_version", "command"} == {
        "aircraft",
        "channels",
        "excitations",
        "faults",
        "scenarios",
        "detectors",
        "banks",
        "campaigns",
        "pseudo_inputs",
    }
    assert set(listed["detectors"]) >= {"dissertation", "C", "B", "leave-one-out", "paper"}
    assert set(listed["scenarios"]) == {*FAULTS, "in_the_loop", "surfaces"} - {"float"}  # one for every kind of sensors
    _, text, _ = cli("list")
    assert all(name in text for section in listed.values() if isinstance(section, dict) for name in section)


def test_version(cli):
    assert cli("--version")[1] == f"gtmbench, version {gb.__version__}\n"


@pytest.mark.parametrize(("line", "said"), [("run --speed", "No such option"), ("aircraft --tas 400", "at its limit")])
def test_errors_are_json_where_json_was_asked_for(cli, line, said):
    code, out, err = cli(*line.split(), "--json")
    assert (code, err) == (2, "")
    assert said in json.loads(out)["error"]


def test_a_disk_that_fills_up_leaves_nothing(cli, scenario, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("gtmbench.report.recording.write.write_recording", full)
    assert "No space left on device" in refused(cli("run", scenario, "--no-figures"))
    assert {path.name for path in tmp_path.iterdir()} == {"short.toml"}


@pytest.mark.parametrize(
    "step", by_day(["results", "fly", "trim", "calibrate dissertation", "jam of r", "figures", "recording"])
)
def test_ctrl_c_ends_with_130_and_leaves_nothing(cli, scenario, tmp_path, monkeypatch, step):
    """Whoever started pytest may have told it to ignore Ctrl-C."""
    run, write = gb.run_study, study._write

    def strike(begun):
        if begun == step:
            signal.raise_signal(signal.SIGINT)

    def run_study(*given, progress, **more):
        return run(*given, progress=lambda begun, done, of: (strike(begun), progress(begun, done, of)), **more)

    monkeypatch.setattr("gtmbench.study.run.run_study", run_study)
    monkeypatch.setattr(
        study,
        "_write",
        lambda written, folder, parts, tell: write(written, folder, parts, lambda begun: (strike(begun), tell(begun))),
    )
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        code, out, err = cli("run", scenario)
    finally:
        signal.signal(signal.SIGINT, before)
    assert (code, out, err.strip()) == (130, "", "gtmbench: interrupted; nothing is half-written")
    assert list(tmp_path.iterdir()) == [scenario]


ASCII = """
import sys
from gtmbench.cli.app import main
for arguments in (["aircraft", "--modes"], ["list"]):
    try:
        main(arguments)
    except SystemExit as ended:
        assert ended.code == 0
"""


def test_an_ascii_terminal_gets_its_table(tmp_path):
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    command = [sys.executable, "-c", ASCII]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
    assert run.returncode == 0, run.stderr
    for words in (b"dutch roll", b"rate_saturation"):
        assert words in run.stdout
