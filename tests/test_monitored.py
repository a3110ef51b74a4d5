"""Scenarios watched by a monitor: what was found is held against the truth, and against the public functions."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.study.calibrated import calibrated
from gtmbench.study.flown import Flown
from gtmbench.study.monitored import find_monitor
from tests.watching import EXCITATION, MIXED, monitor, scenario, study


def trials():
    names = ("drift", "tiny", "saturation", "jam", "unwatched", "harmless")
    return dict(zip(names, study().trials, strict=True))


def estimates(trial):
    return {one.name: one for one in trial.parameters}


def test_faults_are_found_named_and_told_in_kind():
    for name in ("drift", "saturation", "jam"):
        trial = trials()[name]
        assert trial.detected, name
        assert trial.isolated, name
        assert (trial.sensor, trial.candidates) == (trial.channel, (trial.channel,))
        assert (trial.kind, trial.kind_right, trial.kind_right_20s) == (trial.fault, True, True)
        assert trial.verdict == f"{trial.channel} failed"
        assert trial.detection_delay_s == pytest.approx(trial.alarm_time_s - 60.0, abs=1e-9)
        assert trial.isolation_delay_s == pytest.approx(trial.isolated_s - 60.0, abs=1e-9)
        assert 0.0 < trial.detection_delay_s < trial.isolation_delay_s < 15.0
        assert (trial.reason, trial.false_alarms) == ("", 0)
        assert trial.peak_level > 1.0


def test_parameters_stand_beside_the_true_ones():
    slope, onset = estimates(trials()["drift"])["slope"], estimates(trials()["drift"])["onset_s"]
    assert (slope.true, onset.true) == (0.3, 60.0)
    assert abs(slope.value - 0.3) < 5.0 * slope.error < 0.05
    assert abs(onset.value - 60.0) < 5.0 * onset.error
    limit = estimates(trials()["saturation"])["limit"]
    assert limit.true == trials()["saturation"].severity["limit"]
    assert limit.value == pytest.approx(limit.true, rel=0.05)
    stuck = estimates(trials()["jam"])["value"]
    assert stuck.value == stuck.true == study().baseline.healthy["r"][5_999]


def test_a_fault_that_ends_is_seen_to_end():
    trial = trials()["saturation"]
    assert trial.ended_s == pytest.approx(80.0, abs=1.0)
    assert trial.end_error_s == pytest.approx(trial.ended_s - 80.0, abs=1e-9)
    assert trials()["drift"].ended_s is None
    assert trials()["drift"].end_error_s is None


def test_misses_say_why():
    found = trials()
    assert found["unwatched"].reason == "bank C doesn't use this channel"
    assert found["harmless"].reason == "the fault changed no sample"
    assert found["tiny"].reason == f"the level reached {100 * found['tiny'].peak_level:.0f} % of the threshold"
    for name in ("unwatched", "harmless", "tiny"):
        trial = found[name]
        assert not trial.detected
        assert (trial.alarm_time_s, trial.sensor, trial.kind, trial.parameters) == (None, None, None, ())
        assert [trial.isolated, trial.kind_right, trial.kind_right_20s] == [False, False, False]


def test_every_figure_follows_from_the_public_functions():
    flight = gb.fly(excitation=EXCITATION, duration_s=120, seed=1)
    healthy = gb.measure(flight, noise="t2", seed=2001)
    assert (study().baseline.healthy.values == healthy.values).all()
    broken = gb.inject(healthy, gb.Drift(channel="p", onset_s=60, slope=0.3))
    first = gb.watch(monitor(), broken.between(5, 120)).findings[0]
    trial = trials()["drift"]
    assert (trial.alarm_time_s, trial.isolated_s) == (first.alarm_s, first.isolated_s)
    assert estimates(trial)["slope"].value == first.last.parameters["slope"]
    for number in (2, 3):
        record = gb.measure(flight, noise="t2", seed=1 + 1000 * number).between(5, 120)
        assert gb.watch(monitor(), record).findings == ()
    assert study().baseline.false_alarms == 0
    assert 2 * 100 / 3600 < study().baseline.healthy_hours < 2 * 115 / 3600


def broken_twice():
    """A jam of p at 40 s that nobody declared, then the fault that counts: a drift of p at 80 s."""
    healthy = study().baseline.healthy
    first = gb.inject(healthy, gb.Jam(channel="p", onset_s=40))
    fault = gb.Drift(channel="p", onset_s=80, slope=1.0)
    return healthy, fault, gb.inject(first, fault)


def test_alarms_before_the_onset_are_false_and_what_they_took_out_of_the_watch_is_said():
    healthy, fault, broken = broken_twice()
    seen = gb.watch(monitor(), broken)
    verdict = gb.score_watch(seen, fault=fault, healthy=healthy, broken=broken)
    assert not verdict.detected
    assert verdict.false_alarms == 1
    alarm_s = seen.findings[0].alarm_s
    assert seen.given_up == {"p": alarm_s}
    assert verdict.reason == f"no longer watched since an alarm at {alarm_s:.2f} s, before the onset"


def test_a_fault_of_another_sensor_is_found_all_the_same():
    healthy, _, broken = broken_twice()
    fault = gb.Jam(channel="r", onset_s=80)
    both = gb.inject(broken, fault)
    verdict = gb.score_watch(gb.watch(monitor(), both), fault=fault, healthy=healthy, broken=both)
    assert (verdict.false_alarms, verdict.sensor, verdict.isolated) == (1, "r", True)


def test_a_wrong_name_is_no_isolation_and_gives_no_truth():
    healthy = study().baseline.healthy
    broken = gb.inject(healthy, gb.Jam(channel="p", onset_s=40))
    claimed = gb.Jam(channel="q", onset_s=40)
    verdict = gb.score_watch(gb.watch(monitor(), broken), fault=claimed, healthy=healthy, broken=broken)
    assert verdict.detected
    assert (verdict.sensor, verdict.isolated, verdict.isolated_s, verdict.kind_right) == ("p", False, None, False)
    assert all(one.true is None for one in verdict.parameters)


def test_what_a_monitor_doesnt_use_keeps_no_scenarios_apart_but_flights_do():
    text = MIXED[: MIXED.index("[[faults]]")] + '[[faults]]\nkind = "jam"\nchannels = ["p"]\nonset_s = 60.0\n'
    other = scenario("other", text.replace("identify_s = [5.0, 50.0]", "identify_s = [9.0, 40.0]"))
    jam = scenario("jam", text)
    both = gb.run_monitored([jam, other], monitor())
    one, two = (trial.row() for trial in both.trials)
    assert {**one, "scenario": ""} == {**two, "scenario": ""}
    again = gb.run_monitored([jam], monitor(), seed=1).trials[0].row()
    assert again == one
    assert gb.run_monitored([jam], monitor(), seed=2).trials[0].row() != one
    calm = scenario("calm", text.replace("+turbulence", ""))
    with pytest.raises(gb.InputError, match="'jam' and 'calm' differ in excitation"):
        gb.run_monitored([jam, calm], monitor())


def test_progress_is_told_step_by_step():
    text = MIXED[: MIXED.index("[[faults]]")] + '[[faults]]\nkind = "jam"\nchannels = ["p"]\nonset_s = 60.0\n'
    told = []
    gb.run_monitored([scenario("jam", text)], monitor(), progress=lambda *step: told.append(step))
    assert [step for step, _, _ in told] == ["trim", "fly", "healthy record 1", "healthy record 2", "jam of p", "done"]
    assert [done for _, done, _ in told] == [0, 1, 2, 3, 4, 5]
    assert {total for _, _, total in told} == {5}


def test_a_monitor_of_another_sample_rate_is_refused_in_its_own_words():
    slow = replace(monitor(), sample_period_s=0.02)
    with pytest.raises(gb.InputError, match=r"every 0\.01 s, the monitor was calibrated at 0\.02 s"):
        gb.run_monitored([scenario()], slow)


@pytest.mark.parametrize(("snr", "noise"), [(50.0, None), (None, "t2")])
def test_a_bank_is_calibrated_with_the_noise_that_the_studys_sensors_have(snr, noise, monkeypatch):
    seen = []
    monkeypatch.setattr("gtmbench.study.calibrated.calibrate", lambda records, **given: (records, given))
    setup = replace(scenario().setup, excitation="dissertation", duration_s=20.0, snr=snr, noise=noise)
    flight = gb.fly(duration_s=20.0, seed=1)
    flown = Flown(setup=setup, trim=gb.trim("gtm"), flight=flight)
    records, given = calibrated(gb.load_bank("C"), flown, seen.append, flights=2)
    assert seen == ["calibration flight 1", "calibration flight 2", "calibrate"]
    assert given["provenance"]["flights"] == 2
    for number, record in enumerate(records):
        truth = gb.fly(excitation=EXCITATION, duration_s=20.0, seed=1_000_000_001 + number)
        for channel in ("p", "beta", "phi"):
            own = np.std(flown.sensed(2)[channel] - flight[channel])
            assert np.std(record[channel] - truth[channel]) == pytest.approx(own, rel=0.1)
    assert not (records[0]["p"] == records[1]["p"]).any()


def test_a_monitor_is_a_file_or_a_bank():
    assert find_monitor("B").name == "B"
    with pytest.raises(gb.InputError, match="no bank of that name; there are B, C"):
        find_monitor("Z")
    with pytest.raises(gb.InputError, match=r"mine\.json: no such monitor; .* or give a bank: B, C"):
        find_monitor("mine.json")
