"""Campaigns: every combination once, rows that are those of a study, errors in the rows they spoil, one line each."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.detectors.base import FunctionDetector
from gtmbench.files.shipped import shipped_campaigns
from gtmbench.jobs.parts import Shard, read_parts
from gtmbench.jobs.progress import counted, silent
from gtmbench.study.campaign.axes import AXES
from gtmbench.study.campaign.conduct import conduct, named
from gtmbench.study.campaign.plan import load_campaign
from gtmbench.study.campaign.rows import COLUMNS, table_of
from gtmbench.study.campaign.task import rows_of
from gtmbench.study.flights import fly_setup
from gtmbench.study.watchers import own_detector
from tests.helpers.campaigns import TINY, loaded, results, table, written
from tests.helpers.hostile import refused
from tests.helpers.sealed import resealed
from tests.helpers.watching import EXAMPLE, dissertation, monitor, spike

AXES_OF_TWO = TINY.replace(
    'seed = "1:8"', 'seed = [3, 1]\nexcitation = ["doublets", "multisine"]\nturbulence = [true, false]'
)


# ---- the plan ----


def test_every_combination_of_the_axes_is_flown_once_the_first_named_slowest(tmp_path):
    tasks = list(loaded(tmp_path, AXES_OF_TWO).tasks())
    assert [(task.setup.seed, task.setup.excitation) for task in tasks] == [
        (seed, excitation + air)
        for seed in (3, 1)
        for excitation in ("doublets", "multisine")
        for air in ("+turbulence", "")
    ]
    assert [task.number for task in tasks] == list(range(8))
    assert {len(task.faults) for task in tasks} == {4}


def test_what_is_counted_is_what_is_flown(tmp_path):
    text = AXES_OF_TWO.replace("healthy_records = 1", "healthy_records = 3") + '[healthy]\nseed = "50:69"\n'
    text = text.replace("turbulence = [", "noise_seed = [2, 9]\nturbulence = [")
    campaign = loaded(tmp_path, text)
    tasks = list(campaign.tasks())
    assert campaign.flights == len(tasks) == 8 + 20 * 4
    assert campaign.trials == sum(len(task.faults) * len(task.noise_seeds) for task in tasks) == 8 * 4 * 2
    rows = rows_of(replace(tasks[0], faults=tasks[0].faults[:1]), {"spike": FunctionDetector(spike).calibrate()})
    assert [(row["noise_seed"], row.get("fault")) for row in rows] == [
        (2, None),
        (2, "jam"),
        (3, None),
        (4, None),
        (9, None),
        (9, "jam"),
    ]
    assert campaign.records == len(tasks) * 4


def test_scenarios_of_one_setup_share_their_flights(tmp_path):
    text = 'scenarios = ["drift", "jam", "bias"]\n[axes]\nseed = "1:3"\n'
    campaign = loaded(tmp_path, text)
    assert campaign.flights == 3
    names = {name for task in campaign.tasks() for name, _ in task.faults}
    assert names == {"drift", "jam", "bias"}


@pytest.mark.parametrize("name", shipped_campaigns())
def test_those_that_ship_are_of_detectors_that_there_are_and_are_kept_apart_from_calibration(name):
    campaign = load_campaign(name)
    assert named(campaign).names == tuple(sorted(campaign.detectors, key=lambda one: one != "dissertation"))
    assert campaign.flights == len(list(campaign.tasks()))
    assert len({task.setup for task in campaign.tasks()}) == campaign.flights
    json.dumps(campaign.facts())


# ---- the rows ----


def test_the_dissertations_campaign_is_its_study():
    (task,) = load_campaign("dissertation").tasks()
    rows = table_of(rows_of(task, {"dissertation": own_detector(task.setup)})).to_pandas()
    study = dissertation()
    trials = rows[rows["fault"].notna()].reset_index()
    for i, trial in enumerate(study.trials):
        own = trials.loc[trials.index[(trials["fault"] == trial.fault) & (trials["channel"] == trial.channel)][0]]
        assert own["error"] is None or pd.isna(own["error"])
        for name in ("detected", "alarm_time_s", "detection_delay_s", "peak_ratio", "altered_share", "false_alarms"):
            assert own[name] == getattr(trial, name), (i, name)
        assert [own["severity"]] == list(trial.severity.values()) or (pd.isna(own["severity"]) and not trial.severity)
        assert own["scenario"] == trial.scenario
    healthy = rows[rows["fault"].isna()]
    assert healthy["noise_seed"].tolist() == [1, 2, 3, 4, 5]
    assert healthy["false_alarms"].sum() == study.baseline.false_alarms
    assert healthy["armed_hours"].sum() == pytest.approx(study.baseline.healthy_hours, rel=1e-12)


BROKEN = """
title = "Of a bank"
detectors = ["C"]
duration_s = 120
excitation = "doublets+turbulence"
severity_reference_s = [20, 60]
seed = 77
[operator]
identify_s = [5, 50]
[alarm]
threshold_s = [50, 100]
watch_from_s = 5
healthy_records = 1
[[faults]]
kind = "drift"
channels = ["p", "phi"]
onset_s = 60
slope = [0.5, 1e-6]
[[faults]]
kind = "jam"
channels = ["r"]
onset_s = 60
[[faults]]
kind = "dropout"
channels = ["q"]
onset_s = 60
duration_s = 4
"""


@pytest.mark.nightly
def test_whether_and_when_is_the_same_whether_or_not_it_is_asked_what(tmp_path):
    (task,) = loaded(tmp_path, BROKEN).tasks()
    assert task.setup.noise == "t2"
    asked, unasked = (
        table_of(rows_of(replace(task, isolate=isolate), {"C": monitor()})).to_pandas() for isolate in (True, False)
    )
    detection = ["detected", "alarm_time_s", "detection_delay_s", "look_ahead_s", "altered_share", "false_alarms"]
    assert asked["error"].isna().all()
    pd.testing.assert_frame_equal(asked[detection], unasked[detection])
    assert asked["detected"].dropna().sum() == 4
    assert asked["isolated"].sum() == asked["kind_right"].sum() == 4
    assert unasked["isolated"].isna().all()
    assert unasked["sensor"].isna().all()


def test_a_fault_from_before_anybody_watches_is_a_trial_whether_or_not_it_is_asked_what(tmp_path):
    text = TINY.replace('seed = "1:8"', "seed = 3").replace("onset_s = 12", "onset_s = 1")
    asked = table(tmp_path, text)
    (tmp_path / "only").mkdir()
    only = table(tmp_path / "only", "isolate = false\n" + text)
    assert only.error.isna().all()
    for name in ("detected", "alarm_time_s", "altered_share"):
        pd.testing.assert_series_equal(only[name], asked[name])


def test_rows_have_the_columns_of_the_schema_and_no_others(tmp_path):
    search = (
        '[[smallest]]\nkind = "deadzone"\nchannels = ["p"]\nonset_s = 12\nhalf_width = ["1 % of rms", "300 % of rms"]\n'
    )
    (task, *_) = loaded(tmp_path, TINY + search).tasks()
    rows = rows_of(task, {"dissertation": own_detector(task.setup), "spike": FunctionDetector(spike).calibrate()})
    assert set().union(*rows) <= set(COLUMNS)
    assert {name for row in rows for name in row} >= set(COLUMNS) - {
        "error",
        "isolation_delay_s",
        "smallest",
    } - _OF_ISOLATION
    assert table_of(rows).schema.metadata[b"gtmbench.schema"] == b"1"


def test_the_delay_at_the_own_threshold_is_the_delay(tmp_path):
    (task, *_) = loaded(tmp_path, TINY.replace('"1:8"', "1")).tasks()
    rows = [row for row in rows_of(task, {"dissertation": own_detector(task.setup)}) if "fault" in row]
    told = {row["window_s"] for row in rows if row["detected"]}
    assert told == {0.21}, "w + 1 samples"
    assert [row["delay_at_100_percent_s"] for row in rows] == [row["detection_delay_s"] for row in rows]


_OF_ISOLATION = {"isolated", "named_wrong", "axis_right", "sensor", "kind", "kind_right", "kind_right_20s"}


def test_a_severity_stands_as_given_and_as_it_came_to_be(tmp_path):
    rows = table(tmp_path, TINY.replace('seed = "1:8"', "seed = [1, 2]"))
    own = rows[(rows["fault"] == "deadzone")]
    assert own["severity_given"].tolist() == ["50 % of rms", "100 % of rms"] * 2
    halves, wholes = own["severity"][::2].to_numpy(), own["severity"][1::2].to_numpy()
    np.testing.assert_allclose(2.0 * halves, wholes)
    assert halves[0] != halves[1]


# ---- what goes wrong ----


def test_what_goes_wrong_is_told_in_the_rows_that_it_spoils(tmp_path):
    def fails(record):
        if record["r"][-1] == record["r"][-2]:  # a jam of r
            raise ZeroDivisionError("by the yaw rate")
        return []

    (task, *_) = loaded(tmp_path).tasks()
    watchers = {"fails": FunctionDetector(fails).calibrate(), "spike": FunctionDetector(spike).calibrate()}
    rows = table_of(rows_of(task, watchers)).to_pandas()
    spoilt = rows[rows["error"].notna()]
    assert spoilt[["detector", "fault", "channel"]].to_numpy().tolist() == [["fails", "jam", "r"]]
    assert spoilt["error"].item() == "ZeroDivisionError: by the yaw rate"
    assert spoilt["detected"].isna().all()


def test_a_flight_that_cant_be_flown_is_rows_that_say_so_and_an_exit_code(cli, tmp_path):
    path = written(tmp_path, TINY.replace('seed = "1:8"', "tas_kt = [100, 20]"))
    code, out, err = cli("campaign", path, "--jobs", 1, "--out", "out")
    assert (code, err) == (3, "")
    assert "5 of 10 rows failed" in out
    rows = pd.read_parquet(sorted(Path("out").glob("part-*.parquet")))
    assert rows["error"].notna().tolist() == [False] * 5 + [True] * 5
    assert rows["error"].str.contains("trim").sum() == 5
    found = json.loads(Path("out/results.json").read_text())
    assert (found["failed"], found["detectors"][0]["failed"], found["detectors"][0]["trials"]) == (5, 4, 4)
    assert len(pd.read_csv("out/trials.csv")) == 10


def test_memory_that_runs_out_is_no_verdict(tmp_path):
    def hungry(_record):
        raise MemoryError

    (task, *_) = loaded(tmp_path).tasks()
    with pytest.raises(MemoryError):
        rows_of(task, {"hungry": FunctionDetector(hungry).calibrate()})


HEAD = TINY.split("[axes]")[0]
FAULTS = TINY[TINY.index("[[faults]]") :]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TINY.replace("seed = ", "sed = "), "unknown key 'sed' in [axes]; there are aircraft,"),
        ('detectors = ["D"]\n' + TINY, "no detector is called 'D'"),
        ('detectors = ["dissertatoin"]\n' + TINY, "did you mean 'dissertation'?"),
        ('detectors = ["x.py:Limit"]\n' + TINY, "a data file doesn't import Python"),
        ("detectors = []\n" + TINY, "detectors is []; it must be a list of names"),
        (TINY.replace('seed = "1:8"', "seed = []"), "axes.seed is an empty list: nothing would be flown"),
        (TINY.replace('"1:8"', '"8:1"'), "axes.seed is '8:1': no seed"),
        (TINY.replace('"1:8"', '"1:2000000000"'), "axes.seed is '1:2000000000': no seed"),
        (TINY.replace('"1:8"', "[1, 1]"), "axes.seed holds 1 twice"),
        (TINY.replace('"1:8"', "1.5"), "a seed is 1.5; it must be a whole number"),
        (TINY.replace('"1:8"', "1\nturbulence = 1"), "it holds 1; it must be true or false"),
        (TINY.replace('"1:8"', "1\nnoise_seed = 0"), "a seed is 0"),
        (TINY.replace('"1:8"', '1\naircraft = "gtn"'), "gtn"),
        (TINY.replace('"1:8"', '1\nexcitation = "multisin"'), "no excitation 'multisin'"),
        (TINY.replace('"1:8"', '1\nattitude = "filter 1s"'), "no attitude 'filter 1s'; there is own, filter 1 s,"),
        (HEAD, "nothing would break"),
        ('isolate = "no"\n' + TINY, "isolate is 'no'; it must be true or false"),
        ('scenarios = ["drft"]\n' + FAULTS, "no scenario 'drft'"),
        ('scenarios = ["drift", "drift"]', "scenarios names 'drift' twice"),
        ('scenarios = ["drift"]\nduration_s = 60\n', "duration_s stands beside scenarios, which have their own"),
        (TINY + "[calibration]\nflights = 0", "calibration: flights is 0"),
        (TINY + '[calibration]\nnoise = "t2"', "unknown key 'noise' in [calibration]"),
        (TINY + "[calibration]\nseed = 5", "seed 5 is one of calibration's, 5 to 16"),
        (
            TINY + "[calibration]\nseed = 2004\nflights = 1",
            "seed 4 is one of calibration's, 2004 to 2004 (or its noise",
        ),
        ('detectors = ["C"]\nsnr = 50\n' + TINY, "'C' is calibrated for one; state noise"),
        ("axes = 3\n" + HEAD + FAULTS, "axes is 3; it must be a table"),
        ("titel = 3\n" + TINY, "did you mean 'title'?"),
    ],
)
def test_what_cant_be_meant_is_one_line_and_flies_nothing(cli, tmp_path, text, said):
    path = written(tmp_path, text)
    before = {own.name for own in tmp_path.iterdir()}
    for how in ([], ["--dry-run"]):
        assert said in refused(cli("campaign", path, "--out", "out", *how))
    assert {own.name for own in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "no campaign 'nothing'; give a TOML file or one of ci, dissertation"),
        (["ci", "--shard", "0/3"], "numbered from 1 to 3"),
        (["ci", "--shard", "three"], "is no shard"),
        (["ci", "--jobs", "0"], "--jobs is 0"),
        (["ci", "--tls", "."], "--tls is for a --scheduler"),
        (["ci", "--detector", "x.py:Limit"], "no file x.py"),
        (["ci", "--detector", "D"], "no detector is called 'D'"),
        (["ci", "--out", "nowhere/x"], "folder nowhere doesn't exist"),
    ],
)
def test_options_that_cant_be_meant_are_one_line(cli, tmp_path, arguments, said):
    assert said in refused(cli("campaign", *arguments))
    assert list(tmp_path.iterdir()) == []


def test_a_million_fold_typo_is_asked_about_at_once(cli, tmp_path):
    path = written(tmp_path, TINY.replace('"1:8"', '"1:8000000"'))
    assert "8,000,000 flights with 40,000,000 trials in all; that is more than 10,000,000: say --yes" in refused(
        cli("campaign", path)
    )
    code, out, _ = cli("campaign", path, "--dry-run")
    assert (code, "8,000,000 flights" in out) == (0, True)
    assert [own.name for own in tmp_path.iterdir()] == ["tiny.toml"]


# ---- runs that go on ----


@pytest.mark.nightly
def test_shards_and_processes_come_to_the_same_bytes_as_one_run(cli, tmp_path):
    path = written(tmp_path)
    assert cli("campaign", path, "--out", "whole", "--jobs", 1)[0] == 0
    code, out, _ = cli("campaign", path, "--out", "out", "--jobs", 1, "--shard", "3/3")
    assert (code, "2 of 8 flights stand in out/, --resume collects" in out) == (0, True)
    assert not Path("out/results.json").exists()
    told = json.loads(cli("campaign", path, "--out", "out", "--jobs", 1, "--shard", "1/3", "--json")[1])
    assert (told["shard"], told["tasks"], told["tasks_done"]) == ("1/3", 8, 5)
    code, out, _ = cli("campaign", path, "--out", "out", "--jobs", 2, "--resume")
    assert code == 0
    assert results(Path("out")) == results(Path("whole"))
    again = cli("campaign", path, "--out", "out", "--resume", "--json")
    assert json.loads(again[1])["tasks_done"] == 8


def test_another_campaign_another_monitor_and_another_version_dont_mix(tmp_path, monkeypatch):
    text = 'detectors = ["C.json"]\n' + TINY
    monkeypatch.chdir(tmp_path)
    gb.save_monitor(monitor(), "C.json")
    out, whole, part = tmp_path / "out", loaded(tmp_path, text), Shard(1, 8)
    conduct(whole, out, shard=part)
    assert read_parts(out).done() == (0,)
    with pytest.raises(gb.InputError, match=r"campaign.scenarios.tiny.setup.duration_s was 20.0 and is 21.0"):
        conduct(loaded(tmp_path, text.replace("duration_s = 20", "duration_s = 21")), out, resume=True)
    with pytest.raises(gb.InputError, match=r"campaign.scenarios.tiny.faults"):
        conduct(loaded(tmp_path, text.replace("onset_s = 12", "onset_s = 13")), out, resume=True)
    kept = out / "monitor-C.json"
    content = kept.read_text()
    other = content.replace('"gtmbench": "', '"gtmbench": "1')
    kept.write_text(other)
    with pytest.raises(gb.InputError, match=r"monitor-C.json: what it holds isn't what was written"):
        conduct(whole, out, resume=True)
    kept.write_text(json.dumps(resealed(json.loads(other))))
    with pytest.raises(gb.InputError, match=r"monitors.monitor-C.json was '\w+' and is"):
        conduct(whole, out, resume=True)
    kept.write_text(content)
    with monkeypatch.context() as patch:
        patch.setattr("gtmbench.files.shipped.__version__", "9.9")
        with pytest.raises(gb.InputError, match=r"versions.gtmbench was .* and is '9.9'"):
            conduct(whole, out, resume=True)
    assert conduct(whole, out, shard=part).done() == (0,)


@pytest.mark.nightly
def test_parts_of_several_flights_hold_the_same_rows(tmp_path, monkeypatch):
    alone = conduct(loaded(tmp_path), tmp_path / "alone").read()
    monkeypatch.setattr("gtmbench.study.campaign.conduct._MOST_PARTS", 3)
    whole = loaded(tmp_path)
    first = conduct(whole, tmp_path / "several", shard=Shard(2, 3))
    assert (first.tasks, first.done()) == (3, (1,))
    several = conduct(whole, tmp_path / "several", jobs=2, resume=True)
    assert several.done() == (0, 1, 2)
    assert several.read().equals(alone)


@pytest.mark.nightly
def test_a_detector_of_ones_own_watches_in_every_process(cli, tmp_path):
    path = written(tmp_path, TINY.replace('"1:8"', '"1:3"') + "[calibration]\nflights = 2\nduration_s = 20\n")
    code, _, err = cli("campaign", path, "--detector", f"{EXAMPLE}:LimitCheck", "--jobs", 2, "--out", "out")
    assert (code, err) == (0, "")
    rows = read_parts(Path("out")).read().to_pandas()
    assert sorted(rows["detector"].unique()) == ["dissertation", "limit check"]
    assert rows["error"].isna().all()
    facts = read_parts(Path("out")).facts
    assert "limit_check.py" in facts["python"]
    assert list(facts["monitors"]) == [path.name for path in Path("out").glob("monitor-*")]


def test_a_loop_is_closed_by_the_gains_of_the_aircraft_that_flies(tmp_path):
    text = TINY.replace('seed = "1:8"', 'aircraft = ["gtm", "A320"]\nclosed_loop = true').replace(
        'excitation = "multisine"', 'excitation = "turbulence"\nnoise = "t2"'
    )
    flown = {task.setup.aircraft: task.setup.autopilot for task in loaded(tmp_path, text).tasks()}
    assert flown == {name: gb.load_aircraft(name).autopilot for name in ("gtm", "A320")}
    with pytest.raises(gb.InputError, match="no gains of its own"):
        list(loaded(tmp_path, text.replace("A320", "XB-70")).tasks())
    with pytest.raises(gb.InputError, match="snr is"):
        list(loaded(tmp_path, text.replace('noise = "t2"', "snr = 50")).tasks())


def test_every_axis_is_checked_and_changes_its_setting(tmp_path):
    of = {
        "aircraft": "gtm",
        "excitation": "doublets",
        "turbulence": True,
        "closed_loop": True,
        "attitude": "filter 5 s",
        "altitude_ft": 9000.0,
        "tas_kt": 95.0,
        "seed": 5,
        "noise_seed": 3,
    }
    assert set(of) == set(AXES)
    text = "\n".join(f"{name} = {json.dumps(value)}" for name, value in of.items())
    (task,) = loaded(tmp_path, 'noise = "t2"\n' + TINY.replace('seed = "1:8"', text)).tasks()
    setup = task.setup
    assert (setup.aircraft, setup.excitation, setup.seed) == ("gtm", "doublets+turbulence", 5)
    assert setup.attitude == "filter 5 s"
    assert setup.autopilot == gb.load_aircraft("gtm").autopilot
    assert (setup.trim_point, task.noise_seeds) == ({"altitude_ft": 9000.0, "tas_kt": 95.0}, (3,))


def test_duckdb_reads_the_parts_as_the_page_says(tmp_path, monkeypatch):
    duckdb = pytest.importorskip("duckdb", reason="no duckdb")
    rows = table(tmp_path)
    page = (Path(__file__).parents[3] / "docs/how_to/campaigns.md").read_text()
    query = page.partition("```sql\n")[2].partition("```")[0].replace("fifteen/", "out/")
    monkeypatch.chdir(tmp_path)
    found = {fault: median for fault, median in duckdb.sql(query).fetchall() if median is not None}
    assert found == pytest.approx(rows.groupby("fault")["detection_delay_s"].median().dropna().to_dict())


def test_the_attitude_is_as_late_in_calibration_as_on_every_flight(tmp_path):
    text = TINY.replace('excitation = "multisine"', 'excitation = "multisine"\nnoise = "t2"\nattitude_late_s = 0.02')
    campaign = loaded(tmp_path, text)
    assert campaign.calibration.attitude_late_s == 0.02
    (setup, *_) = (task.setup for task in campaign.tasks())
    late, on_time = (
        fly_setup(each, False, counted(silent, 2)) for each in (setup, replace(setup, attitude_late_s=0.0))
    )
    assert late.sensed(2)["phi"][2:].tolist() == on_time.sensed(2)["phi"][:-2].tolist()
    assert late.sensed(2)["p"].tolist() == on_time.sensed(2)["p"].tolist()
    one, other = (written(tmp_path, text.replace("0.02", late_s), f"late_{late_s}") for late_s in ("0.02", "0.04"))
    for path in (one, other):
        path.write_text(path.read_text().partition("[axes]")[0] + "[[faults]]" + text.partition("[[faults]]")[2])
    with pytest.raises(gb.InputError, match=r"attitude_late_s is 0.02 and 0.04 in its scenarios"):
        loaded(tmp_path, f'scenarios = ["{one}", "{other}"]', "both")
    with pytest.raises(gb.InputError, match="in the loop the autopilot flies on the attitude"):
        loaded(tmp_path, text.replace("[operator]", "[autopilot]\n[operator]"), "looped")
