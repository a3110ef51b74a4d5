"""What studies of banks, and of several detectors at once, leave behind, from the table to the recording."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.faults.registry import FAULTS
from gtmbench.files.plain import plain
from gtmbench.report.figures.study import write_figures
from gtmbench.report.recording.entities import trial_paths
from gtmbench.report.tables.results import results, write_results
from gtmbench.report.words.judgement import estimate_text, fault_text, judgement_text
from gtmbench.report.words.study import study_verdict, summary_lines, trial_rows
from tests.helpers.night import by_day
from tests.helpers.watching import several, study
from tests.report.test_report import read_back


@pytest.fixture
def recording(recording_of):
    return recording_of(study)


def test_results_say_what_watched_and_what_came_of_it():
    told = results(study())
    assert (told["schema_version"], told["seed"], len(told["detectors"])) == (5, 1, 1)
    told = {**told, **told["detectors"][0]}
    assert (told["detected"], told["isolated"], told["kind_right"], told["kind_right_20s"]) == (3, 3, 3, 3)
    assert (told["false_alarms"], len(told["trials"])) == (0, 6)
    assert told["false_alarms_per_hour_at_most"] == pytest.approx(3.0 / told["healthy_hours"], rel=0.01)
    watched = told["monitor"]
    assert (watched["bank"], watched["thresholds"], watched["sample_period_s"]) == ("C", 54, 0.01)
    assert [(residual["output"], residual["look_ahead_s"]) for residual in watched["residuals"]] == [
        ("p", 0.11),
        ("q", 0.11),
        ("r", 0.11),
    ]
    assert watched["provenance"]["records"] == 6
    assert set(told["setup"]["alarm"]) == {"watch_from_s", "healthy_records"}
    assert "operator" not in told["setup"]
    slope = told["trials"][0]["parameters"][0]
    assert (slope["name"], slope["true"], told["trials"][0]["severity"]) == ("slope", 0.3, {"slope": 0.3})


def test_files_say_what_the_study_says(tmp_path):
    write_results(study(), tmp_path)
    assert json.loads((tmp_path / "results.json").read_text()) == json.loads(json.dumps(results(study())))
    with (tmp_path / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["alarm_time_s"] for row in rows] == [str(trial.alarm_time_s or "") for trial in study().trials]
    slope = study().trials[0].parameters[0]
    columns = (
        "injected_slope_deg_s2",
        "true_slope_deg_s2",
        "true_onset_s",
        "found_slope_deg_s2",
        "least_slope_deg_s2",
        "most_slope_deg_s2",
    )
    assert [float(rows[0][name]) for name in columns] == [0.3, 0.3, 60.0, slope.value, slope.low, slope.high]


def test_what_isnt_a_finite_number_is_null_in_json(monkeypatch):
    row = {**study().trials[0].row(), "peak_ratio": math.inf, "parameters": [{"error": np.float64("nan")}]}
    monkeypatch.setattr(gb.Trial, "row", lambda _: row)
    trial = results(study())["trials"][0]
    assert (trial["peak_ratio"], trial["parameters"]) == (None, [{"error": None}])
    assert plain({"a": np.arange(2), "b": Path("c"), 3: (np.bool_(True), None)}) == {
        "a": [0, 1],
        "b": "c",
        "3": [True, None],
    }


def test_the_table_names_sensor_kind_and_parameters_with_their_errors():
    drift, slow, limited, *rest = study().trials
    trials = (drift, slow, replace(limited, ended_s=80.0), *rest)
    columns, rows, right = trial_rows(replace(study(), trials=trials))
    assert columns[:5] == ["detector", "scenario", "fault", "channel", "severity"]
    assert right == ["severity", "delay (s)", "named (s)", "peak"]
    drift, _, ended, jam, unwatched, harmless = (dict(zip(columns, row, strict=True)) for row in rows)
    assert (drift["verdict"], drift["kind"][:10]) == ("p failed", "drift 0.30")
    assert " ± 0.00" in drift["kind"]
    assert " deg/s², from 60." in drift["kind"]
    assert ended["verdict"] == "q failed, ended at 80.00 s"
    assert " deg/s, from 60.0" in jam["kind"]
    assert unwatched["verdict"] == "missed: C doesn't use this channel"
    assert (harmless["delay (s)"], harmless["named (s)"], harmless["kind"]) == ("-", "-", "-")
    text = "\n".join(summary_lines(study()))
    said = study_verdict(study())
    assert said.startswith("3 of 6 faults detected, 3 sensors named rightly, none wrongly; no false alarm in 0.06 h ")
    assert "the right kind of fault: 3 at the end, 3 at 20 s after the alarm\nfalse alarms: at most" in text
    assert "bank C; 54 thresholds, set on 0.13 h of healthy flight; delays count look-ahead (p/q/r 0.11 s)" in text


def judged(*candidates, **more):
    """A judgement; of one candidate, it has decided."""
    sensor = candidates[0] if len(candidates) == 1 else None
    return gb.Judgement(time_s=1.0, sensor=sensor, candidates=candidates, **more)


def test_judgements_are_said_in_words():
    drift = {"kind": "drift", "parameters": {"slope": 0.5}}
    assert judgement_text(judged("p", "phi", **drift)) == "undecided: p or phi; if p, drift 0.5 deg/s²"
    why = "a fault of phi explains it nearly as well as one of p"
    told = judgement_text(judged("p", "phi", reason=why, kind="unknown"))
    assert told == f"undecided: p or phi - {why}; if p, unknown kind"
    assert judgement_text(judged()) == "nothing is left to explain"


def test_the_other_sensor_of_a_fault_that_mixes_two_is_told():
    swap = judged("p", kind="swap", partner="q")
    assert judgement_text(swap) == swap.verdict == "p and q have changed places"
    alarm = gb.Alarm(number=0, time_s=1.0, onset_s=1.0, source="p", judgements=(swap,))
    assert (alarm.verdict, alarm.sensor) == ("p and q have changed places", "p")
    assert judgement_text(judged("p", "phi", kind="swap", partner="q")) == "undecided: p or phi; if p, swap with q"
    angle = {"parameters": {"angle_deg": -5.0}, "intervals": {"angle_deg": (-5.1, -4.9)}}
    bent = judged("p", kind="misalignment", partner="q", **angle)
    assert judgement_text(bent) == "p failed; misalignment -5.0 ± 0.1 deg towards q"


# what a diagnosis may say, by the names of the fault's own class
TOLD = {
    "bias": ({"size": 2.0}, "bias 2 deg"),
    "drift": ({"slope": 2.0, "onset_s": 3000.5}, "drift 2 deg/s, from 3000.50 s"),
    "random_walk": ({"gain": 2.0}, "random walk 2 deg/sqrt(s)"),
    "oscillation": ({"amplitude": 2.0, "frequency_hz": 0.5}, "oscillation 2 deg, 0.5 Hz"),
    "scale_factor": ({"factor": 2.0}, "scale factor 2"),
    "sign_flip": ({}, "sign flip"),
    "noise": ({"deviation": 2.0}, "noise 2 deg"),
    "spikes": ({"size": 2.0, "rate_hz": 0.5}, "spikes 2 deg, 0.5 Hz"),
    "dropout": ({}, "dropout"),
    "stuck": ({"value": 2.0}, "stuck at 2 deg"),
    "jam": ({"value": 2.0}, "jam at 2 deg"),
    "hardover": ({"value": 2.0}, "hardover at 2 deg"),
    "hysteresis": ({"width": 2.0}, "hysteresis 2 deg"),
    "quantisation": ({"quantum": 2.0}, "quantisation 2 deg"),
    "lag": ({"lag_s": 2.0}, "lag 2 s"),
    "delay": ({"delay_s": 2.0}, "delay 2 s"),
    "stale": ({"hold_s": 2.0}, "stale 2 s"),
    "misalignment": ({"angle_deg": 2.0}, "misalignment 2 deg"),
    "swap": ({}, "swap"),
    "g_sensitivity": ({"coefficient": 2.0}, "g sensitivity 2 deg/g"),
    "deadzone": ({"half_width": 2.0}, "deadzone 2 deg"),
    "saturation": ({"limit": 2.0}, "saturation 2 deg"),
    "rate_saturation": ({"rate_limit": 2.0}, "rate saturation 2 deg/s"),
}


@pytest.mark.parametrize("kind", TOLD)
def test_parameters_of_a_kind_are_told_with_their_units(kind):
    parameters, words = TOLD[kind]
    assert judgement_text(judged("phi", kind=kind, parameters=parameters)) == f"phi failed; {words}"
    declared = {item.name for item in FAULTS[kind].parameters()}
    assert set(parameters) <= declared | {"onset_s", "value"}


def test_what_a_fault_doesnt_enter_stands_there_once(recording):
    root = trial_paths(study().trials)[0]
    assert len(read_back(recording, f"{root}/levels/q")[0]) == 0
    level = study().baseline.watch.scores["q"]
    _, values = read_back(recording, "/healthy/levels/q")
    assert (values[:, 0] == level.values[np.isfinite(level.values)]).all()
    trial = study().trials[0].watch.scores["q"]
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


DETECTORS = ["dissertation", "C", "spike", "swing"]


def test_several_detectors_share_a_table_a_file_and_a_summary(tmp_path):
    columns, rows, _ = trial_rows(several())
    assert columns == trial_rows(study())[0]  # whatever the detector
    assert [row[0] for row in rows] == [name for name in DETECTORS for _ in range(6)]
    lines = summary_lines(several())
    assert [line for line in lines if not line.startswith(" ")] == [f"{name}:" for name in DETECTORS]
    assert sum("the right kind of fault" in line for line in lines) == 1
    told = results(several())
    assert [detector["name"] for detector in told["detectors"]] == DETECTORS
    assert [detector["isolated"] for detector in told["detectors"]] == [None, 3, None, None]
    assert "threshold" not in told
    assert told["detectors"][3]["provenance"] == {"limit": 100.0, "unknown": None}
    write_results(several(), tmp_path)
    with (tmp_path / "trials.csv").open(newline="") as file:
        assert [row["detector"] for row in csv.DictReader(file)] == [row[0] for row in rows]


ONE = ["levels_mixed.png", "virtual_mixed.png"]
EACH = ["markov_dissertation.png", "prediction_dissertation.png", "norm_mixed_dissertation.png", "levels_mixed_C.png"]
EACH += ["virtual_mixed_C.png", "alarms_mixed_spike.png", "norm_mixed_swing.png"]


@pytest.mark.parametrize(("watched", "names"), by_day([(study, ONE), (several, EACH)], 0))
def test_every_detector_is_drawn_in_its_way_with_its_name_in_the_files(watched, names, tmp_path):
    from matplotlib.image import imread

    paths = write_figures(watched(), tmp_path)
    assert [path.name for path in paths] == names
    assert set(tmp_path.iterdir()) == set(paths)
    for path in paths:
        picture = imread(path)[:, :, :3]
        assert min(picture.shape[:2]) > 300
        assert np.std(picture) > 0.05  # a blank page has none


@pytest.mark.nightly
def test_a_recording_of_several_holds_each_below_its_name(frame_of, capfd):
    frame = frame_of(several)
    assert capfd.readouterr().err == ""
    entities = set(frame.entity.cat.categories)
    assert "/truth/rates" in entities
    for name in DETECTORS:
        trials = several().trials_of(name)
        for trial, path in zip(trials, trial_paths(trials), strict=True):
            root = f"/detectors/{name}{path}"
            verdict = frame[frame.entity == f"{root}/verdict"].set_index("series")
            assert bool(verdict.value["detected"]) == trial.detected
            assert len(frame[frame.entity == f"{root}/measured"]) > 5000
    swing = several().trials_of("swing")[3].watch.scores["swing"]
    rows = frame[frame.entity == "/detectors/swing/trials/mixed/r_1/norm"]
    np.testing.assert_array_equal(rows.value, swing.values)
    alone = {entity for entity in entities if not entity.startswith("/detectors/")}
    assert {entity.split("/")[1] for entity in alone} <= {"truth", "sensors", "surfaces", "path", "attitude"}


class Wobble(gb.Fault):
    """A kind of one's own, without a word in any table."""

    kind = "wobble_and_drift"
    depth: float = 2.0


def test_a_kind_of_ones_own_is_told_without_a_table():
    fault = Wobble(channel="p", onset_s=1.0)
    assert fault_text(fault) == "wobble and drift of p"
    assert (
        estimate_text("unheard of", {"depth": 2.0, "onset_s": 1.0}, {"depth": (1.9, 2.1)}, "deg/s")
        == "2.0 ± 0.1, from 1.00 s"
    )
    assert estimate_text(fault.kind, {"depth": 2.0}, {}, "deg/s", fault) == "2 deg/s"


def test_a_score_that_stood_above_from_the_start_is_said_to_tell_nothing():
    base = several().baselines[3]
    score = base.watch.scores["swing"]
    none = np.zeros(len(score.values), dtype=bool)
    stuck = replace(score, values=np.full_like(score.values, 200.0), armed=none)
    base = replace(base, watch=replace(base.watch, scores={"swing": stuck}))
    lines = summary_lines(replace(study(), baselines=(base,), trials=()))
    assert "can't tell: on the healthy record swing stood above the threshold from 5 s on" in "\n".join(lines)
    assert any("never armed" in line for line in lines)
