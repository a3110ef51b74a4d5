"""What a monitored study leaves behind, from the table to the recording; and the command line that makes it."""

import csv
import json
import math
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.cli.app import main
from gtmbench.report.lines import trial_paths
from gtmbench.report.monitor_figures import write_monitored_figures
from gtmbench.report.monitor_recording import write_monitored_recording
from gtmbench.report.monitor_results import monitored_results, write_monitored_results
from gtmbench.report.monitor_text import judgement_text, monitored_rows, summary_lines
from tests.test_report import read_back
from tests.watching import MIXED, monitor, scenario, study

SHORT = MIXED[: MIXED.index("[[faults]]")] + '[[faults]]\nkind = "jam"\nchannels = ["p"]\nonset_s = 60.0\n'


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "study.rrd"
    write_monitored_recording(study(), path)
    return path


@pytest.fixture
def cli(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("short.toml").write_text(SHORT)

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        return ended.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def stored(tmp_path, monkeypatch):
    """A monitor's file, and a reader in place of the package's."""
    files = ModuleType("gtmbench.detectors.bank.files")
    files.load_monitor = lambda path: monitor() if path.read_text() == "C" else None
    monkeypatch.setitem(sys.modules, files.__name__, files)
    (tmp_path / "mine.json").write_text("C")
    return "mine.json"


def test_results_say_what_watched_and_what_came_of_it():
    found = monitored_results(study())
    assert (found["schema"], found["study"], found["seed"]) == (1, "monitored", 1)
    assert (found["detected"], found["isolated"], found["kind_right"], found["kind_right_20s"]) == (3, 3, 3, 3)
    assert (found["false_alarms"], len(found["trials"])) == (0, 6)
    assert found["false_alarms_per_hour_at_most"] == pytest.approx(3.0 / found["healthy_hours"], rel=0.01)
    watched = found["monitor"]
    assert (watched["bank"], watched["thresholds"], watched["sample_period_s"]) == ("C", 54, 0.01)
    assert [(one["output"], one["look_ahead_s"]) for one in watched["residuals"]] == [
        ("p", 0.11),
        ("q", 0.11),
        ("r", 0.11),
    ]
    assert watched["provenance"]["records"] == 6
    assert set(found["setup"]["alarm"]) == {"watch_from_s", "healthy_records"}
    assert "operator" not in found["setup"]
    slope = found["trials"][0]["parameters"][0]
    assert (slope["name"], slope["true"], found["trials"][0]["severity"]) == ("slope", 0.3, {"slope": 0.3})


def test_files_say_what_the_study_says(tmp_path):
    write_monitored_results(study(), tmp_path)
    assert json.loads((tmp_path / "results.json").read_text()) == json.loads(json.dumps(monitored_results(study())))
    with (tmp_path / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["alarm_time_s"] for row in rows] == [str(trial.alarm_time_s or "") for trial in study().trials]
    assert rows[0]["severity"] == "slope=0.3"
    assert rows[0]["parameters_true"] == "slope=0.3 onset_s=60.0"
    slope = study().trials[0].parameters[0]
    assert rows[0]["parameters"].startswith(f"slope={slope.value!r} ")
    assert rows[0]["parameter_errors"].startswith(f"slope={slope.error!r} ")


def test_what_isnt_a_finite_number_is_null_in_json(monkeypatch):
    row = {**study().trials[0].row(), "peak_level": math.inf, "parameters": [{"error": np.float64("nan")}]}
    monkeypatch.setattr(gb.MonitoredTrial, "row", lambda _: row)
    trial = monitored_results(study())["trials"][0]
    assert (trial["peak_level"], trial["parameters"]) == (None, [{"error": None}])


def test_the_table_names_sensor_kind_and_parameters_with_their_errors():
    columns, rows, right = monitored_rows(study())
    assert columns[:4] == ["scenario", "fault", "channel", "severity"]
    assert right == ["severity", "delay (s)", "isolated after (s)"]
    drift, _, ended, jam, unwatched, harmless = (dict(zip(columns, row, strict=True)) for row in rows)
    assert (drift["verdict"], drift["kind"][:10]) == ("p failed", "drift 0.30")
    assert " ± 0.000" in drift["kind"]
    assert drift["kind"].endswith(" deg/s²")
    assert ended["verdict"].startswith("q failed, ended at ")
    assert jam["kind"].endswith(" deg/s")
    assert unwatched["verdict"] == "missed: bank C doesn't use this channel"
    assert (harmless["delay (s)"], harmless["isolated after (s)"], harmless["kind"]) == ("-", "-", "-")
    text = "\n".join(summary_lines(study()))
    assert "detected: 3 of 6; the right sensor named: 3; the right kind of fault 20 s after the alarm: 3" in text
    assert "false alarms: 0; healthy flight watched: 0.06 h (at most" in text
    assert "bank C; 54 thresholds, set on 0.13 h of healthy flight; delays count look-ahead (p/q/r 0.11 s)" in text


def test_judgements_are_said_in_words():
    judged = gb.Judgement(
        time_s=1.0,
        sensor=None,
        candidates=("p", "phi"),
        kind="drift",
        parameters={"slope": 0.5},
        errors={},
        kind_margin=0.0,
    )
    assert judgement_text(judged) == "undecided: p or phi; drift 0.5 deg/s²"


def test_figures_are_pictures_with_something_on_them(tmp_path):
    from matplotlib.image import imread

    paths = write_monitored_figures(study(), tmp_path)
    assert [path.name for path in paths] == ["levels_mixed.png", "virtual_mixed.png"]
    for path in paths:
        picture = imread(path)[:, :, :3]
        assert min(picture.shape[:2]) > 600
        assert np.std(picture) > 0.05  # a blank page has none


def test_the_recording_is_small_and_whole(recording):
    program = Path(sys.executable).parent / "rerun"
    assert recording.stat().st_size < 20e6
    subprocess.run([program, "rrd", "verify", recording], check=True, capture_output=True)


def test_a_trials_signals_come_back_bit_for_bit(recording):
    for number, output in ((0, "p"), (3, "r")):
        trial, root = study().trials[number], trial_paths(study().trials)[number]
        seen, level = trial.watched, trial.watched.levels[output]
        for entity, time_s, values in (
            ("measured", trial.record.time_s, trial.record[output]),
            ("virtual", seen.record.time_s, seen.virtual(output)),
            (f"residuals/{output}", seen.record.time_s, seen.residuals.raw[output]),
            (f"levels/{output}", level.known_s, level.values),
        ):
            logged = np.isfinite(values) & (time_s >= 30.0 - 1e-9)  # from 30 s before the onset on
            times, found = read_back(recording, f"{root}/{entity}")
            assert (found[:, 0] == values[logged]).all(), entity
            np.testing.assert_allclose(times, time_s[logged], atol=1e-9)


def test_what_a_fault_doesnt_enter_stands_there_once(recording):
    root = trial_paths(study().trials)[0]
    assert len(read_back(recording, f"{root}/levels/q")[0]) == 0
    level = study().baseline.watched.levels["q"]
    _, found = read_back(recording, "/healthy/levels/q")
    assert (found[:, 0] == level.values[np.isfinite(level.values)]).all()
    trial = study().trials[0].watched.levels["q"]
    np.testing.assert_array_equal(trial.values, level.values)


def test_marks_and_events_tell_the_decision_in_time(recording):
    from rerun.chunk import RrdReader

    trial, root = study().trials[0], trial_paths(study().trials)[0]
    for name, time_s in (("onset", 60.0), ("alarm", trial.alarm_time_s), ("named", trial.isolated_s)):
        assert read_back(recording, f"{root}/{name}")[0] == pytest.approx([time_s])
    told = []
    for chunk in RrdReader(recording).stream().filter(content=[f"{root}/events"]):
        batch = chunk.to_record_batch()
        (column,) = [name for name in batch.schema.names if name.endswith("TextLog:text")]
        told += [text[0] for text in batch.column(column).to_pylist()]
    assert told[0] == "60.00 s  onset: drift of p, 0.3 deg/s²"
    assert told[1].startswith(f"{trial.alarm_time_s:.2f} s  alarm, {trial.detection_delay_s:.2f} s after the onset: ")
    assert any("p failed; drift" in text for text in told[2:])
    assert "p failed; drift 0.30" in told[-1]


def test_run_with_a_monitor_of_a_file_writes_and_prints_its_study(cli, stored, tmp_path):
    code, out, _ = cli("run", "short.toml", "--monitor", stored, "--out", "here")
    assert code == 0
    assert "bank C: 1 trials" in out
    assert "p failed" in out
    assert "detected: 1 of 1; the right sensor named: 1" in out
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert names == {"results.json", "trials.csv", "study.rrd", "levels_short.png", "virtual_short.png"}
    code, out, err = cli("run", "short.toml", "--monitor", stored, "--json")
    printed = json.loads(out)
    assert (code, err, printed.pop("out")) == (0, "", "study")
    assert printed == json.loads((tmp_path / "study/results.json").read_text())
    assert cli("run", "short.toml", "--monitor", stored, "--out", "still", "-q") == (0, "", "")


def test_run_with_a_bank_calibrates_it_first(cli, monkeypatch):
    given = {}

    def calibrated(bank, flown, _tell):
        given.update(bank=bank, setup=flown.setup)
        return monitor()

    monkeypatch.setattr("gtmbench.study.monitored.calibrated", calibrated)
    assert cli("run", "short.toml", "--monitor", "C", "-q") == (0, "", "")
    assert given["bank"] == gb.load_bank("C")
    assert given["setup"].noise == "t2"


BAD = {
    "no such file": ("nowhere.json", "nowhere.json: no such monitor"),
    "unknown bank": ("Z", "no bank of that name; there are B, C"),
    "no bank": ("short.toml", "unknown key 'duration_s'"),
    "other rate": ("slow.json", "the monitor was calibrated at 0.02 s"),
    "other channels": ("strange.json", "bank strange needs"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_monitor_is_one_line_exit_code_2_and_nothing_written(cli, name, tmp_path, monkeypatch):
    from dataclasses import replace

    files = ModuleType("gtmbench.detectors.bank.files")
    odd = replace(monitor().bank, name="strange", residuals=(replace(monitor().bank.residuals[0], output="strain"),))
    made = {"slow": replace(monitor(), sample_period_s=0.02), "strange": replace(monitor(), bank=odd)}
    files.load_monitor = lambda path: made[path.stem]
    monkeypatch.setitem(sys.modules, files.__name__, files)
    for stem in made:
        (tmp_path / f"{stem}.json").write_text("")
    before = set(tmp_path.iterdir())
    source, message = BAD[name]
    code, out, err = cli("run", "short.toml", "--monitor", source)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert set(tmp_path.iterdir()) - before == {tmp_path / "short.toml"} - before
    code, out, err = cli("run", "short.toml", "--monitor", source, "--json")
    assert (code, err) == (2, "")
    assert message in json.loads(out)["error"]


def test_a_disk_that_fills_up_leaves_nothing(cli, stored, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("gtmbench.report.monitor_recording.write_monitored_recording", full)
    code, _, err = cli("run", "short.toml", "--monitor", stored)
    assert code == 2
    assert "No space left on device" in err
    assert {path.name for path in tmp_path.iterdir()} == {"short.toml", "mine.json"}


def test_scenarios_by_any_name_are_drawn_and_recorded(tmp_path, capfd):
    odd = gb.run_monitored([scenario("my scénario (2) #1+x", SHORT)], monitor())
    write_monitored_recording(odd, tmp_path / "study.rrd")
    write_monitored_figures(odd, tmp_path)
    assert capfd.readouterr().err == ""  # rerun warns of entity paths that aren't escaped
    root = trial_paths(odd.trials)[0]
    assert len(read_back(tmp_path / "study.rrd", f"{root}/measured")[0]) == 9001
