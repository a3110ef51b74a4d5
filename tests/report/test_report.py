"""What a study leaves behind: results and figures; `test_read_recording` looks at recordings."""

import json

import numpy as np
import pytest

from gtmbench.report.figures.study import write_figures
from gtmbench.report.recording.entities import trial_paths
from gtmbench.report.recording.write import write_recording
from gtmbench.report.tables.results import results
from gtmbench.study.run import run_study
from gtmbench.study.scenario import load_scenario
from tests.helpers.watching import dissertation


@pytest.fixture(scope="module")
def study():
    return dissertation()


def read_back(path, entity):
    """Return times in seconds and values of an entity's scalars, as another program would read them."""
    from rerun.chunk import RrdReader

    times, values = [], []
    for chunk in RrdReader(path).stream().filter(content=[entity]):
        batch = chunk.to_record_batch()
        names = batch.schema.names
        scalars = [name for name in names if name.endswith("Scalars:scalars")]
        if scalars and "time" in names:
            times += [value.value for value in batch.column("time")]  # nanoseconds
            values += batch.column(scalars[0]).to_pylist()
    return np.array(times) / 1e9, np.array(values)


def test_results_have_the_promised_keys(study):
    plain = results(study)
    assert plain["schema_version"] == 5
    assert set(plain) == {"schema_version", "trim", "detectors", "trials", "setup", "versions", "seed"}
    (detector,) = plain["detectors"]
    own = {"operator", "threshold", "threshold_unit", "armed_s", "false_alarms", "false_alarms_per_hour_at_most"}
    assert {*own, "healthy_hours"} <= set(detector)
    assert (detector["name"], detector["detected"], detector["isolated"]) == ("dissertation", 15, None)
    assert (detector["window_s"], detector["threshold_unit"], detector["look_ahead_s"]) == (10.01, "deg/s", 0.5)
    promised = {"detector", "scenario", "fault", "channel", "onset_s", "detected", "alarm_time_s", "detection_delay_s"}
    assert all(promised | {"peak_ratio", "altered_share", "reason", "severity"} <= set(row) for row in plain["trials"])
    assert plain["versions"]["jsbsim"] == "1.3.3"
    assert json.loads(json.dumps(plain, allow_nan=False)) == json.loads(json.dumps(plain))


def test_scenarios_by_any_name_and_several_severities_are_recorded(tmp_path, capfd):
    path = tmp_path / "my scénario (2) #1+x.toml"
    path.write_text(
        "duration_s = 60.0\nseverity_reference_s = [5.0, 40.0]\n[operator]\ncausal_order = 5\nnoncausal_order = 5\n"
        "identify_s = [5.0, 30.0]\n[alarm]\nwindow = 100\nthreshold_s = [30.0, 50.0]\nhealthy_records = 1\n"
        '[[faults]]\nkind = "drift"\nchannels = ["r", "p"]\nonset_s = 40.0\nslope = [0.5, 1.0]\n'
    )
    study = run_study([load_scenario(path)])
    write_recording(study, tmp_path / "study.rrd")
    write_figures(study, tmp_path)
    assert capfd.readouterr().err == ""  # rerun warns of entity paths that aren't escaped
    roots = trial_paths(study.trials)
    assert [root.rsplit("/", 1)[1] for root in roots] == ["r_1", "r_2", "p_1", "p_2"]
    for trial, root in zip(study.trials, roots, strict=True):
        _, values = read_back(tmp_path / "study.rrd", f"{root}/measured")
        assert (values[:, 0] == trial.record[trial.channel]).all()
