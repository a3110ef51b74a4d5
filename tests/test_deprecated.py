"""Public names of before: each says what it is called now, and works."""

import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench import api
from gtmbench.deprecation import renamed
from gtmbench.intake.flight_log import FlightLog
from tests import monitors, watching
from tests.test_check import study

BEFORE = """
CHANNELS PSEUDO_INPUTS AlarmStream Alarms Bank Baseline Channel ConvergenceWarning Deadzone Drift EnvelopeError
ExcitationCount Fault Finding FlightLog GtmbenchError Imperfections InputChoice InputError InstrumentalVariables Jam
Judgement LeastSquares LogColumn Mode Monitor MonitorVerdict MonitoredStudy MonitoredTrial NoiseModel NormStream
OrderChoice Outcome PredictionError PseudoInput RankWarning RateSaturation Record RecursiveIdentification Remark
Residual ResidualStream Saturation Scenario Signatures Study TotalLeastSquares Transmissibility Trial Trim TrimError
Verdict Watch WatchedLog WindowedNorm alarms bank_between calibrate count_excitations decimate derivable derive
filtered_attitude fly identify imperfect inject innovations load_bank load_monitor load_scenario log_columns measure
modes open_log read_log read_recording residual run run_monitored run_study save_monitor score score_watch
select_inputs select_orders signatures threshold trim watch watch_log windowed_norm write_log
"""
NAMES = ("Finding", "MonitorVerdict", "MonitoredStudy", "MonitoredTrial", "run_monitored", "score_watch")


def told(words, get):
    """What something gives, having warned once, of this file's line, in these words."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        value = get()
    (warning,) = caught
    assert (warning.category, warning.filename) == (DeprecationWarning, __file__)
    assert str(warning.message) == f"{words} now; the old name goes with the next release"
    return value


def test_every_public_name_of_before_is_there():
    """Those that went are aliases, none is both."""
    assert set(api.DEPRECATED) == set(NAMES)
    assert set(BEFORE.split()) <= set(gb.__all__) | set(NAMES)
    assert not set(api.DEPRECATED) & set(gb.__all__)
    assert len(set(gb.__all__)) == len(gb.__all__)


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_warns_and_gives_what_stands_for_it(name):
    new, stands_for = api.DEPRECATED[name]
    assert told(f"gtmbench.{name} is called gtmbench.{new}", lambda: getattr(gb, name)) is stands_for
    called = new.partition("(")[0]
    assert called in gb.__all__
    assert stands_for is getattr(gb, called) or callable(stands_for)


def test_a_name_that_never_was_is_none():
    with pytest.raises(AttributeError, match="module 'gtmbench' has no attribute 'find_faults'"):
        _ = gb.find_faults


def test_what_ran_a_monitor_runs_it():
    run_monitored = told(
        "gtmbench.run_monitored is called gtmbench.run_study(scenarios, detectors=[monitor])", lambda: gb.run_monitored
    )
    steps = []
    study = run_monitored([short()], gb.FunctionDetector(late), seed=3, progress=lambda *step: steps.append(step))
    same = gb.run_study([short()], detectors=[late], seed=3)
    assert [trial.row() for trial in study.trials] == [trial.row() for trial in same.trials]
    assert steps[-1][0] == "done"


def late(record):
    return record.time_s[-1:]


def short():
    from tests.test_check import SHORT

    return watching.scenario("short", SHORT)


@cache
def watched_once():
    return monitors.monitor().watch(gb.inject(monitors.record(seed=9), gb.Jam(channel="q", onset_s=80.0)))


def test_what_scored_a_watch_scores_it():
    score_watch = told("gtmbench.score_watch is called gtmbench.score", lambda: gb.score_watch)
    healthy, fault = monitors.record(seed=9), gb.Jam(channel="q", onset_s=80.0)
    verdict = score_watch(watched_once(), fault=fault, healthy=healthy, broken=watched_once().record)
    assert (verdict.detected, verdict.sensor) == (True, "q")


@pytest.mark.parametrize(
    ("old", "new"), [("alarm_s", "time_s"), ("residual", "source"), ("series", "test"), ("resumed_s", "end_known_s")]
)
def test_attributes_of_a_finding(old, new):
    (alarm, *_) = watched_once().alarms
    words = f"Finding.{old} is called {new}"
    assert told(words, lambda: getattr(alarm, old)) == getattr(alarm, new)


@pytest.mark.parametrize(("old", "new"), [("findings", "alarms"), ("levels", "scores"), ("given_up", "disarmed")])
def test_attributes_of_a_watch(old, new):
    attribute = told(f"Watch.{old} is called {new}", lambda: getattr(watched_once(), old))
    assert attribute == getattr(watched_once(), new)
    assert len(attribute) > 0


def test_attributes_of_a_bank_and_its_monitor():
    monitor = monitors.monitor()
    disturbs = told("Bank.disturbs is called affects", lambda: monitor.bank.disturbs)
    assert disturbs("psi") == monitor.bank.affects("psi") == ("p", "q", "r")
    assert told("BankMonitor.doubts is called uncertainties", lambda: monitor.doubts) is monitor.uncertainties


def test_the_findings_of_a_log():
    log = FlightLog(path=Path("x.csv"), segments=(watched_once().record,), remarks=(), method=())
    watched = gb.WatchedLog(log=log, monitor=monitors.monitor(), identified_s=(), watches=(watched_once(),), reasons=())
    assert told("WatchedLog.findings is called alarms", lambda: watched.findings) == watched.alarms != ()


def test_what_a_baseline_held_of_the_operator_is_made_as_it_was():
    base = study().baseline
    monitor, score = base.monitor, base.watch.scores["E(k)"]
    assert told("Baseline.operator is called monitor.operator", lambda: base.operator) is monitor.operator
    assert told("Baseline.threshold is called monitor.threshold", lambda: base.threshold) == monitor.threshold
    assert told("Baseline.armed_s is called watch.scores['E(k)'].armed_s", lambda: base.armed_s) == score.armed_s
    norm = told("Baseline.norm is called watch.scores['E(k)']", lambda: base.norm)
    np.testing.assert_array_equal(norm.values, score.values)
    assert (norm.window, norm.time_s[0]) == (monitor.window, 25.0)
    errors = told("Baseline.residual is called watch.residuals", lambda: base.residual)
    np.testing.assert_array_equal(errors.values[:, 0], base.watch.residuals["r"])
    assert told("MonitoredBaseline.watched is called watch", lambda: base.watched) is base.watch


def test_what_a_trial_held_is_made_as_it_was():
    for trial in study().trials:
        alarms = told("Trial.alarms is called watch.alarms", lambda trial=trial: trial.alarms)
        assert np.round(alarms.time_s, 9).tolist() == [alarm.time_s for alarm in trial.watch.alarms]
        assert alarms.threshold == trial.baseline.monitor.threshold
    trial = study().trials[0]
    norm = told("Trial.norm is called watch.scores['E(k)']", lambda: trial.norm)
    np.testing.assert_array_equal(norm.values, trial.watch.scores["E(k)"].values)
    errors = told("Trial.residual is called watch.residuals", lambda: trial.residual)
    np.testing.assert_array_equal(errors.values[:, 0], trial.watch.residuals["r"])
    assert told("Trial.window_s is called baseline.monitor.window_s", lambda: trial.window_s) == 1.01
    assert told("MonitoredTrial.watched is called watch", lambda: trial.watched) is trial.watch
    assert told("MonitoredTrial.peak_level is called peak_ratio", lambda: trial.peak_level) == trial.peak_ratio


def test_an_alias_of_what_isnt_there_says_so():
    class Old:
        size = renamed("Old.size", "inner.size")

    with pytest.warns(DeprecationWarning, match="Old.size"), pytest.raises(AttributeError, match="inner"):
        _ = Old().size
