"""The assertions for tests of detectors: what passes, what fails, what the message says and the recording holds."""

import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.files.artefacts import Artefacts, artefacts, artefacts_in, file_name
from gtmbench.testing import assert_detects, assert_quiet, assert_residual, fly_once, shared_flights, standard_record
from tests.helpers import monitors
from tests.report.test_report import read_back


@pytest.fixture(autouse=True)
def shelf(tmp_path):
    """Where these tests' recordings go, whatever runs them."""
    with artefacts_in(Artefacts(folder=tmp_path / "recordings", name="test")) as _:
        yield tmp_path / "recordings"


@cache
def operator():
    """From p and q to r and beta: no such relation holds, so the residuals are large, and known."""
    names = {"inputs": ["p", "q"], "outputs": ["r", "beta"]}
    return gb.identify(monitors.record(seed=1), **names, causal_order=3, noncausal_order=3)


def failure(assertion, *args, **kwargs):
    """Return the message of an assertion that fails, and the recording that it names."""
    before = len(artefacts().recordings)
    with pytest.raises(AssertionError) as failed:
        assertion(*args, **kwargs)
    text = str(failed.value)
    path = artefacts().recordings[before]
    assert text.endswith(f"; recording: {path}")
    assert path.is_file()
    return text.removesuffix(f"; recording: {path}"), path


def verified(path):
    tool = Path(sys.executable).parent / "rerun"
    return subprocess.run([tool, "rrd", "verify", path], capture_output=True, check=False).returncode == 0


def test_a_residual_is_held_by_its_largest_value():
    record = monitors.record(seed=2)
    e = np.abs(gb.residual(operator(), record).values)
    peaks = dict(zip(["r", "beta"], np.nanmax(e, axis=0), strict=True))
    assert_residual(record, operator(), below={name: 1.001 * peak for name, peak in peaks.items()})
    said, _ = failure(assert_residual, record, operator(), below={"r": peaks["r"], "beta": 100.0})
    at_s = record.time_s[np.nanargmax(e[:, 0])]
    figure = f"{peaks['r']:.4g} deg/s"
    assert said == f"residual of r reached {figure} at {at_s:.2f} s (allowed: below {figure})"


def test_one_spike_fails_it_and_the_rms_stays():
    record = monitors.record(seed=2)
    raised = record["r"].copy()
    raised[4000] += 500.0
    rms = {name: 2.0 * value for name, value in zip(["r", "beta"], operator().rms_residual, strict=True)}
    assert_residual(record, operator(), below=100.0, rms_below=10.0)
    said, _ = failure(assert_residual, record.replace("r", raised), operator(), below=100.0, rms_below=10.0)
    assert said.startswith("residual of r reached 5")
    assert said.endswith("deg/s at 80.00 s (allowed: below 100 deg/s)")
    said, _ = failure(assert_residual, record, operator(), below=100.0, rms_below={**rms, "beta": 1e-3})
    assert said.startswith("residual of beta has an RMS of 0.")
    assert said.endswith(" deg (allowed: below 0.001 deg)")


def test_a_residual_that_doesnt_exist_fails_and_one_that_mostly_exists_doesnt():
    record = monitors.record(seed=2)
    lost = record["p"].copy()
    lost[100:200] = np.nan
    assert_residual(record.replace("p", lost), operator(), below=100.0)
    lost[:] = np.nan
    said, _ = failure(assert_residual, record.replace("p", lost), operator(), below=100.0, rms_below=100.0)
    nowhere = "exists at no sample: samples are missing, or the record is too short"
    assert said == f"residual of r {nowhere}; residual of beta {nowhere}"


def test_a_residuals_recording_holds_it_bit_for_bit():
    record = monitors.record(seed=2)
    _, path = failure(assert_residual, record, operator(), below=0.5)
    assert verified(path)
    errors = gb.residual(operator(), record)
    for o, name in enumerate(errors.outputs):
        there = ~np.isnan(errors.values[:, o])
        times, values = read_back(path, f"/residuals/{name}")
        assert (times == errors.time_s[there]).all()
        assert (values[:, 0] == errors.values[there, o]).all()
        assert (read_back(path, f"/thresholds/{name}")[1] == [[-0.5, 0.5]] * 2).all()
        peak = read_back(path, f"/peaks/{name}")[1].ravel()
        assert np.abs(peak) == np.nanmax(np.abs(errors.values[:, o]))
    for name in ("r", "beta", "p", "q"):
        assert (read_back(path, f"/sensors/{name}")[1][:, 0] == record[name]).all()


def test_any_function_from_a_record_to_a_residual_will_do():
    record = monitors.record(seed=2)
    slow = gb.identify(gb.decimate(record, 5), inputs=["p"], outputs=["r"], causal_order=3, noncausal_order=3)
    said, path = failure(assert_residual, record, lambda given: gb.residual(slow, gb.decimate(given, 5)), below=0.1)
    assert said.startswith("residual of r reached ")
    assert len(read_back(path, "/residuals/r")[0]) == len(gb.decimate(record, 5)) - 6
    assert len(read_back(path, "/virtual/r")[0]) == 0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"record": 3}, "a int was given for a Record"),
        ({"operator": 3}, "a int is no operator"),
        ({"operator": lambda _: 3}, "the function returned a int; it has to return a Residual"),
        ({"below": 0.0}, "below of r is 0.0; it must be a finite number greater than 0"),
        ({"below": {"r": 1.0}}, "below is for 'r'; give a number, or one for each of r, beta"),
        ({"rms_below": "1"}, "rms_below of r is '1'"),
    ],
)
def test_what_cant_be_meant_of_a_residual_is_one_line(change, said, shelf):
    arguments = {"record": monitors.record(seed=2), "operator": operator(), "below": 9.0, **change}
    with pytest.raises(gb.InputError, match=said):
        assert_residual(**arguments)
    assert not shelf.exists()


def jam(channel="q"):
    return gb.Jam(channel=channel, onset_s=80.0)


def test_a_fault_that_is_found_and_named_in_time_passes(shelf, tmp_path):
    gb.save_monitor(monitors.monitor(), tmp_path / "mine.json")
    for monitor in (monitors.monitor(), tmp_path / "mine.json", str(tmp_path / "mine.json")):
        assert_detects(monitor, jam(), within_s=1.0, record=monitors.record(seed=9), named=True)
    assert not shelf.exists()


def test_a_late_alarm_fails_with_its_delay_and_the_bound():
    fault, healthy = gb.Drift(channel="p", onset_s=110.0, slope=0.5), monitors.record(seed=9)
    alarm_s = gb.watch(monitors.monitor(), gb.inject(healthy, fault)).alarm_s
    delay_s = alarm_s - 110.0
    assert_detects(monitors.monitor(), fault, within_s=delay_s, record=healthy)
    said, path = failure(assert_detects, monitors.monitor(), fault, within_s=0.9 * delay_s, record=healthy)
    assert said == (
        f"drift of p, 0.5 deg/s² from 110.00 s: alarm at {alarm_s:.2f} s, {delay_s:.2f} s after the onset "
        f"(allowed: within {0.9 * delay_s:g} s)"
    )
    for entity, time_s in {"onset": 110.0, "due": 110.0 + 0.9 * delay_s, "alarms": alarm_s}.items():
        assert read_back(path, f"/{entity}")[0] == pytest.approx([time_s], abs=1e-9)


def test_a_watchs_recording_holds_sensors_levels_and_what_was_healthy():
    healthy = monitors.record(seed=9)
    _, path = failure(assert_detects, monitors.monitor(), jam(), within_s=0.001, record=healthy)
    assert verified(path)
    watch = gb.watch(monitors.monitor(), gb.inject(healthy, jam()))
    assert (read_back(path, "/sensors/q")[1][:, 0] == watch.record["q"]).all()
    assert (read_back(path, "/healthy/q")[1][:, 0] == healthy["q"]).all()
    for kind, of in (("residuals", watch.residuals["q"]), ("levels", watch.scores["q"].values)):
        values = read_back(path, f"/{kind}/q")[1][:, 0]
        assert (values == of[np.isfinite(of)][: len(values)]).all()
        assert len(values) > 0.9 * len(healthy)


@pytest.mark.parametrize(
    ("before", "fault", "said"),
    [
        (
            None,
            jam("alpha"),
            r"no alarm until the record's end at 119\.98 s \(allowed: within 5 s\); C doesn't use this",
        ),
        (gb.Jam(channel="p", onset_s=70.0), jam(), r"false alarm at 70\..* s before the onset \(allowed: none\)"),
        (gb.Jam(channel="q", onset_s=80.5), jam("alpha"), r"verdict: q failed \(allowed: alpha failed\)"),
    ],
    ids=["missed", "false alarm", "wrong name"],
)
def test_what_a_monitor_says_wrongly_is_told(before, fault, said):
    """Bank C doesn't use alpha; of what was broken before the test doesn't know."""
    healthy = monitors.record(seed=9)
    told, _ = failure(
        assert_detects, monitors.monitor(), fault, within_s=5, record=gb.inject(healthy, before) if before else healthy
    )
    assert re.match(rf"jam of {fault.channel} from 80\.00 s: .*{said}", told)


def test_no_name_fails_where_one_is_wanted():
    fault, healthy = gb.Drift(channel="p", onset_s=80.0, slope=0.05), monitors.record(seed=9)
    alarm_s = gb.watch(monitors.monitor(), gb.inject(healthy, fault)).alarm_s
    short = healthy.between(0.0, alarm_s + 0.2)
    assert_detects(monitors.monitor(), fault, within_s=alarm_s - 80.0, record=short)
    said, _ = failure(assert_detects, monitors.monitor(), fault, within_s=alarm_s - 80.0, record=short, named=True)
    assert "verdict: undecided: " in said
    assert said.endswith(" (allowed: p failed)")


def test_a_function_of_ones_own_is_a_monitor():
    record = monitors.record(seed=9)

    def alarming(*times):
        return lambda _: times

    assert_detects(alarming(81.0), jam(), within_s=1.0, record=record)
    assert_detects(lambda _: np.float64(80.0), jam(), within_s=0, record=record)
    said, path = failure(assert_detects, alarming(90.0, 30.0), jam(), within_s=1.0, record=record)
    assert said == (
        "jam of q from 80.00 s: false alarm at 30.00 s, 50.00 s before the onset (allowed: none); "
        "alarm at 90.00 s, 10.00 s after the onset (allowed: within 1 s)"
    )
    assert read_back(path, "/alarms")[0].tolist() == [30.0, 90.0]
    said, _ = failure(assert_detects, alarming(), jam(), within_s=1.0, record=record)
    assert said.endswith("no alarm until the record's end at 119.98 s (allowed: within 1 s)")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"detector": 3}, "3 is a int, no detector"),
        ({"detector": "jim"}, "no detector is called 'jim'; there are dissertation, auto, B"),
        ({"detector": "mine.json"}, "mine.json: no such file; `gtmbench calibrate` writes one"),
        ({"detector": lambda _: "soon"}, "returned 'soon'; return the times of its alarms in seconds"),
        ({"detector": lambda _: [[1.0]]}, "'<lambda>' returned"),
        ({"detector": lambda _: [], "named": True}, "'<lambda>' names no sensor; leave named=True out"),
        ({"fault": [jam()]}, "is no fault"),
        ({"fault": gb.Saturation(channel="q", onset_s=80.0, limit=1e3)}, "saturation of q, .* changes no sample"),
        ({"within_s": 100}, "an alarm is due at 180 s and the record ends at 119.98 s"),
        ({"within_s": -1}, "within_s is -1"),
        ({"record": 3}, "a int was given for a Record"),
    ],
)
def test_what_cant_be_meant_of_a_watch_is_one_line(change, said, shelf):
    arguments = {"detector": monitors.monitor(), "fault": jam(), "within_s": 1, "record": monitors.record(), **change}
    with pytest.raises(gb.InputError, match=said):
        assert_detects(**arguments)
    assert not shelf.exists()


def test_a_detector_that_isnt_calibrated_is_so_once_a_session(monkeypatch):
    """Whatever names it: an object, a class, a text; what was found for one isn't used for another."""
    made = []

    class Limit(gb.SimpleDetector):
        name, channels, memory_s = "limit", ("q",), 0.0
        factor = 1.5

        def learn(self, records):
            made.append(len(records))
            return {"q": self.factor * max(np.nanmax(np.abs(record["q"])) for record in records)}

        def scores(self, record, learned):
            return {"q": np.abs(record["q"]) / learned["q"]}

    class Tight(Limit):
        factor = 0.01

    healthy = monitors.record(seed=9)
    few = (monitors.record(seed=1), monitors.record(seed=2))
    monkeypatch.setattr("gtmbench.testing.assertions.calibration_records", lambda: few)
    mine = Limit()
    for _ in range(2):
        assert_quiet(mine, healthy)
        assert_detects(mine, gb.Drift(channel="q", onset_s=60.0, slope=10.0), within_s=5.0, record=healthy)
    assert made == [2]
    assert_quiet(Limit, healthy)
    assert made == [2, 2]
    said, _ = failure(assert_quiet, Tight(), healthy)
    assert said.startswith("healthy record: alarm at ")
    said, _ = failure(assert_detects, mine, gb.Drift(channel="q", onset_s=60.0, slope=0.01), within_s=5, record=healthy)
    assert "no alarm until the record's end at 119.98 s (allowed: within 5 s); the score reached " in said


def test_the_standard_flights_calibrate_and_are_none_of_those_that_are_watched(monkeypatch):
    flown = []
    short = gb.fly(duration_s=1.0)
    monkeypatch.setattr(shared_flights, "_flown", lambda *arguments: flown.append(arguments) or short)
    records = shared_flights.calibration_records.__wrapped__()
    assert [arguments[:3] for arguments in flown] == [("gtm", "multisine+turbulence", 200.0)] * 6
    seeds = [arguments[3] for arguments in flown]
    assert len({shared_flights.STANDARD_SEED, *seeds}) == 7
    assert all(
        (record["p"] == gb.measure(short, noise="t2", seed=s)["p"]).all()
        for record, s in zip(records, seeds, strict=True)
    )


def test_a_score_that_stands_above_from_the_start_is_no_quiet():
    """It isn't an alarm either: it can't tell.

    Noise that is another one from the start is learnt, so that thresholds have to be far too low for it.
    """
    usual = monitors.monitor()
    low = {label: 1e-4 * threshold for label, threshold in usual.thresholds["q"].items()}
    said, _ = failure(assert_quiet, replace(usual, thresholds={**usual.thresholds, "q": low}), monitors.record(seed=9))
    assert said == "healthy record: can't tell, for the score of q stood above its threshold all the time"


def test_quiet_means_no_alarm_where_one_was_possible(shelf):
    assert_quiet(monitors.monitor(), monitors.record(seed=9))
    assert_quiet(lambda _: [], monitors.record(seed=9))
    assert not shelf.exists()
    broken = gb.inject(monitors.record(seed=9), jam())
    said, _ = failure(assert_quiet, monitors.monitor(), broken)
    assert said.startswith("healthy record: alarm at 80.")
    assert said.endswith(" s (q failed) (allowed: none)")
    said, _ = failure(assert_quiet, monitors.monitor(), monitors.record(seed=9).between(0.0, 0.1))
    assert said.startswith("healthy record: no alarm was possible")


def test_many_alarms_of_a_function_make_a_small_recording():
    said, path = failure(assert_quiet, lambda record: record.time_s, monitors.record(seed=9))
    assert said == "healthy record: alarm at 0.00 s, and 5999 more (allowed: none)"
    assert len(read_back(path, "/alarms")[0]) == 100


def test_what_failed_is_told_where_no_recording_can_be_written(shelf):
    shelf.write_text("in the way")
    with pytest.raises(AssertionError, match=r"^healthy record: alarm at 1.00 s \(allowed: none\); no recording: "):
        assert_quiet(lambda _: [1.0], monitors.record())
    assert shelf.read_text() == "in the way"


def test_recordings_of_a_test_are_numbered(shelf):
    for _ in range(2):
        failure(assert_quiet, lambda _: [1.0], monitors.record())
    assert sorted(path.name for path in shelf.iterdir()) == ["test-2.rrd", "test.rrd"]


@given(st.lists(st.text(max_size=8), min_size=2, max_size=2, unique=True), st.integers(0, 190))
def test_a_tests_file_name_is_legal_and_its_own(ends, length):
    tests = [length * "x" + end for end in ends]
    names = [file_name(test) for test in tests]
    assert names[0].lower() != names[1].lower()
    for name in names:
        assert set(name) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_")
        assert len(name) < 120


def test_a_test_may_run_tests():
    outer = artefacts()
    with artefacts_in(Artefacts(name="inner")):
        assert artefacts().name == "inner"
    assert artefacts() is outer


def test_flights_are_flown_once_and_read_back_bit_for_bit(tmp_path, monkeypatch):
    arguments = {"excitation": "doublets", "duration_s": 3.0, "seed": 12345}
    flown = fly_once(**arguments)
    assert fly_once(**arguments) is flown
    expected = gb.fly(**arguments)
    for shared in range(2):  # the first writes, the second, another process it may be, reads
        shared_flights._flown.cache_clear()
        if shared:
            monkeypatch.setattr(shared_flights, "fly", None)
        with artefacts_in(Artefacts(flights=tmp_path / "flights")):
            again = fly_once(**arguments)
        assert (again.values == expected.values).all()
        assert (again.channels, again.sample_period_s) == (expected.channels, expected.sample_period_s)
    shared_flights._flown.cache_clear()


def test_the_standard_record_is_none_that_a_monitor_is_calibrated_on():
    from gtmbench.study.healthy_records import _MOST_FLIGHTS, CalibrationFlights

    first = CalibrationFlights().seed
    assert not first <= shared_flights.STANDARD_SEED < first + _MOST_FLIGHTS
    assert (len(standard_record()), standard_record().end_s) == (20_001, 200.0)
