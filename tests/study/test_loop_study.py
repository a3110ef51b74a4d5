"""Scenarios with [autopilot]: every fault is flown, healthy records and calibration are flights in the loop, too."""

import json
from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.sensors import rms_about_mean
from tests.helpers.hostile import refused
from tests.helpers.night import by_day
from tests.helpers.watching import monitor, scenario

LOOP = """
duration_s = 40.0
excitation = "turbulence"
severity_reference_s = [5.0, 20.0]
[autopilot]
[operator]
identify_s = [2.0, 10.0]
[alarm]
threshold_s = [10.0, 30.0]
watch_from_s = 2.0
healthy_records = 2
[[faults]]
kind = "sign_flip"
channels = ["q"]
onset_s = 20.0
[[faults]]
kind = "bias"
channels = ["p", "beta"]
onset_s = 20.0
size = "50 % of rms"
"""


def fast(record):
    """A detector that is a plain function, and learns nothing."""
    return record.time_s[np.abs(record["q"]) > 30.0]


@pytest.fixture(scope="module")
def study():
    return gb.run_study([scenario("loop", LOOP)], detectors=[fast])


def test_a_departure_stands_in_row_words_and_log_of_events(study):
    flip, bias, beta = study.trials
    assert 20.0 < flip.departure_time_s < 21.0
    assert flip.row()["departure_time_s"] == flip.departure_time_s
    assert flip.record.end_s == flip.flight.end_s < 40.0
    assert flip.detected == (flip.alarm_time_s is not None)
    assert bias.row()["departure_time_s"] is None
    from gtmbench.report.words.events import trial_events
    from gtmbench.report.words.study import summary_lines, trial_rows

    columns, rows, _ = trial_rows(study)
    assert rows[0][columns.index("departed (s)")] == f"{flip.departure_time_s - 20.0:.2f}"
    assert rows[1][columns.index("departed (s)")] == "-"
    lines = summary_lines(study)
    assert any(line.startswith("departed: 1 of 3") for line in lines)
    assert "not in the loop: the autopilot doesn't read beta" in lines
    assert any(text.startswith("departure: alpha is") for _, _, text in trial_events(flip))
    assert beta.record["p"].tobytes() == study.baseline.healthy["p"].tobytes()


def test_a_share_is_of_the_healthy_flight_in_the_loop(study):
    bias = study.trials[1]
    healthy = gb.fly_in_loop("gtm", "turbulence", 40.0, 1, noise_seed=2001).truth
    assert bias.injected.size == pytest.approx(0.5 * rms_about_mean(healthy.between(5.0, 20.0)["p"]), rel=1e-12)


@pytest.mark.nightly
def test_what_a_fault_alters_is_told_against_its_own_flight(study):
    assert all(trial.altered_share == 1.0 for trial in study.trials)
    harmless = gb.Saturation(channel="q", onset_s=20.0, limit=500.0)
    (trial,) = gb.run(scenario("loop", LOOP), detectors=[fast], faults=[harmless])
    assert trial.altered_share == 0.0


class Learner(gb.SimpleDetector):
    """Keeps what it was calibrated on."""

    name = "learner"
    channels = ("p", "elevator")

    def learn(self, records):
        return {"p": [float(np.std(record["p"])) for record in records]}

    def scores(self, record, learned):
        return {"p": np.abs(record["p"]) / 1e3}


@pytest.mark.nightly
def test_calibration_flies_in_the_loop(monkeypatch):
    monkeypatch.setattr("gtmbench.study.watchers.FLIGHTS", 2)
    closed = gb.run_study([scenario("loop", LOOP)], detectors=[Learner()]).baseline
    damped = closed.monitor.learned["p"]
    text = LOOP.replace("[autopilot]\n", "").replace('"turbulence"', '"turbulence"\nnoise = "t2"')
    flown = gb.run_study([scenario("open", text)], detectors=[Learner()]).baseline.monitor.learned["p"]
    assert len(damped) == 2
    assert max(damped) < 0.6 * min(flown)
    assert "elevator" in closed.healthy.channels


def test_gains_in_a_scenario_overrule_the_aircrafts():
    gtm = gb.load_aircraft("gtm")
    usual = scenario("loop", LOOP).setup
    assert (usual.autopilot, usual.sensors) == (gtm.chain_autopilot, "chain")
    ideal = scenario("ideal", 'sensors = "ideal"\n' + LOOP)
    assert (ideal.setup.autopilot, ideal.setup.sensors) == (gtm.autopilot, "ideal")
    softer = scenario("soft", LOOP.replace("[autopilot]", "[autopilot]\nq_to_elevator_s = 0.3"))
    assert (softer.setup.autopilot, softer.setup.sensors) == (replace(gtm.autopilot, q_to_elevator_s=0.3), "ideal")
    assert (softer.setup.noise, softer.setup.snr) == ("t2", None)
    with pytest.raises(gb.InputError, match="differ in autopilot"):
        gb.run_study([softer, ideal], detectors=[fast])


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        ("[autopilot]", "[autopilot]\nq_gain = 1", r"unknown key 'q_gain' in \[autopilot\]"),
        ("[autopilot]", '[autopilot]\npsi_to_phi = "much"', r"autopilot.psi_to_phi is 'much'"),
        ("[autopilot]", "[autopilot]\nwashout_s = 0", r"autopilot.washout_s is 0"),
        ("duration_s = 40.0", "duration_s = 40.0\nsnr = 50", r"snr is 50, but in the loop"),
        ("duration_s = 40.0", 'duration_s = 40.0\naircraft = "XB-70"', r"\[autopilot\] is empty, and 'XB-70'"),
    ],
)
def test_bad_autopilots_are_refused_before_anything_flies(was, now, said):
    with pytest.raises(gb.InputError, match=said):
        scenario(f"bad-{said}"[:20].replace("/", ""), LOOP.replace(was, now))


def test_gains_that_do_not_hold_it_are_one_line():
    wild = scenario("wild", LOOP.replace("[autopilot]", "[autopilot]\nr_to_rudder_s = -2.0"))
    with pytest.raises(gb.EnvelopeError, match=r"^the loop .*check the autopilot's gains") as refused:
        gb.run_study([wild], detectors=[fast])
    assert "\n" not in str(refused.value)


def test_the_command_line_flies_in_the_loop(cli, tmp_path):
    (tmp_path / "loop.toml").write_text(LOOP.replace("50 % of rms", "2").replace('"2"', "2.0"))
    command = ["fly", "--closed-loop", "--excitation", "turbulence", "--duration", "30", "--noise", "t2", "--commands"]
    fault = ["--fault", str(tmp_path / "loop.toml"), "--trial"]
    code, out, _ = cli(*command, *fault, "1", "--out", str(tmp_path / "flight.csv"))
    assert code == 0
    assert "departure: alpha is" in out
    record = gb.read_log(tmp_path / "flight.csv")
    expected = gb.fly_in_loop(duration_s=30.0, faults=gb.SignFlip(channel="q", onset_s=20.0))
    assert record.values.tobytes() == expected.readings(commands=True).values.tobytes()
    code, out, _ = cli(*command, *fault, "3", "--out", str(tmp_path / "beta.csv"), "--json")
    assert [event["kind"] for event in json.loads(out)["findings"]] == ["out of loop"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--fault", "jam", "--trial", "1"], "--fault of a sensor needs --closed-loop"),
        (["--trial", "1"], "--trial is of --fault"),
        (["--closed-loop", "--fault", "jam"], "--trial is missing"),
        (["--closed-loop", "--noise", "50"], "in the loop sensors have the T2's noise"),
        (
            ["--closed-loop", "--aircraft", "XB-70"],
            "'XB-70' has no autopilot; find its gains by gtmbench aircraft NAME --autopilot",
        ),
    ],
)
def test_the_command_line_refuses_in_one_line(cli, tmp_path, options, said):
    assert said in refused(cli("fly", "--duration", "1", "--out", str(tmp_path / "x.csv"), *options))


@pytest.mark.parametrize("broken", by_day([gb.Jam, gb.SignFlip]))
def test_what_is_broken_from_the_first_sample_on_is_learnt_and_accuses_nobody_else(broken):
    fault = broken(channel="q" if broken is gb.Jam else "p", onset_s=0.0)
    flight = gb.fly_in_loop(duration_s=30.0, faults=fault)
    watch = monitor().watch(flight.sensed)
    assert {alarm.sensor for alarm in watch.alarms} <= {None, fault.channel}
    assert all(alarm.time_s > 20.0 for alarm in watch.alarms)  # if at all, when the motion has grown beyond what it was


def test_a_truth_that_a_broken_sensor_steered_is_told_as_one(cli, tmp_path):
    command = ["fly", "--closed-loop", "--duration", "6", "--fault", "jam:theta", "--onset", "2"]
    _, told, _ = cli(*command, "--out", str(tmp_path / "truth.csv"))
    assert "--noise t2" in told
    assert "--noise t2" not in cli(*command, "--out", str(tmp_path / "read.csv"), "--noise", "t2")[1]
