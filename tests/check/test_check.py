"""Figures against a baseline: whatever gets worse is told, once, in the right words; whatever doesn't, isn't."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.check.check import regression_line
from gtmbench.check.compare import compare
from gtmbench.check.figures import KINDS, RULES, Tolerance, figures_of, parse_tolerance, rounded, trial_names
from gtmbench.method.residual import residual, windowed_norm
from gtmbench.study.flights import Flown
from gtmbench.study.run import run_study
from tests.helpers import watching

TOLERANCES = {name: parse_tolerance(name, rule.tolerance) for name, rule in RULES.items() if rule.form != "flag"}
SHORT = """
duration_s = 120.0
severity_reference_s = [5.0, 40.0]
[operator]
causal_order = 5
noncausal_order = 5
identify_s = [5.0, 50.0]
[alarm]
window = 100
threshold_s = [50.0, 110.0]
healthy_records = 2
[[faults]]
kind = "drift"
channels = ["q", "r"]
onset_s = 60.0
slope = 0.5
[[faults]]
kind = "jam"
channels = ["p", "altitude"]
onset_s = 60.0
"""


@cache
def study():
    return run_study([watching.scenario("short", SHORT)])


def recorded(groups):
    """The figures as a baseline holds them."""
    return {kind: {group.name: dict(group.values) for group in groups if group.kind == kind} for kind in KINDS}


def worse(was, now):
    """The lines of what got worse, the tables of the file in between."""
    compared = compare(recorded(figures_of(was)), figures_of(now), TOLERANCES)
    return [regression_line(figure) for figure in compared if figure.regressed]


def with_baseline(of, **changes):
    return replace(of, baselines=(replace(of.baseline, **changes),))


def with_residual(of, values):
    watch = of.baseline.watch
    return with_baseline(of, watch=replace(watch, residuals={"r": values}))


def with_score(of, **changes):
    watch = of.baseline.watch
    return with_baseline(of, watch=replace(watch, scores={"E(k)": replace(watch.scores["E(k)"], **changes)}))


def row_at(time_s):
    """Which row of what is watched that is: watching begins at 25 s."""
    return round(100.0 * (time_s - 25.0))


def with_trial(of, number, **changes):
    trials = list(of.trials)
    trials[number] = replace(trials[number], **changes)
    return replace(of, trials=tuple(trials))


def spiked(of, row, size):
    """The study with a healthy residual that is `size` at one sample, and the norm that follows."""
    monitor, watch = of.baseline.monitor, of.baseline.watch
    values = watch.residuals["r"].copy()
    values[row] = size
    errors = replace(residual(monitor.operator, watch.record), values=values[:, np.newaxis])
    return with_score(with_residual(of, values), values=windowed_norm(errors, window=monitor.window).values)


@pytest.mark.nightly
def test_nothing_is_worse_than_itself():
    for watched in (study(), watching.study()):
        compared = compare(recorded(figures_of(watched)), figures_of(watched), {})
        assert not any(each.regressed or each.better for each in compared)
        assert len(compared) >= 40


def test_windows_are_maxima_from_the_time_on_that_is_watched():
    watch = study().baseline.watch
    time_s, errors = watch.record.time_s, watch.residuals["r"]
    windows = figures_of(study())[1].values["windows"]
    edges = [25, 35, 45, 55, 65, 75, 85, 95, 105, 115, 121]
    assert len(windows) == len(edges) - 1
    for (start_s, end_s), greatest in zip(pairwise(edges), windows, strict=True):
        inside = [abs(e) for t, e in zip(time_s, errors, strict=True) if start_s <= t < end_s]
        assert greatest == pytest.approx(np.nanmax(inside), rel=1e-4)
    peak, rms = (figures_of(study())[1].values[name] for name in ("peak", "rms"))
    assert peak == max(windows)
    assert rms == pytest.approx(np.sqrt(np.mean(errors[5:-5] ** 2)), rel=1e-4)


@pytest.mark.parametrize("at_s", [25.0, 34.99, 35.0, 57.3, 99.0, 119.9])
def test_one_spike_in_one_sample_fails_the_window_that_holds_it(at_s):
    """Also where another window's maximum, so the peak, is greater."""
    values = figures_of(study())[1].values
    number = int((at_s - 25.0) / 10.0 + 1e-9)
    size = 1.06 * values["windows"][number]
    lines = worse(study(), spiked(study(), row_at(at_s), -size))
    (line,) = [line for line in lines if line.startswith("healthy residual of r, window")]
    where = f"window {25 + 10 * number}..{min(35 + 10 * number, 120)} s, max"
    assert line.startswith(f"healthy residual of r, {where}: was {values['windows'][number]:g}, is {rounded(size):g}, ")
    assert worse(study(), spiked(study(), row_at(at_s), 0.98 * size)) == []  # within its 5 %


def test_a_spike_that_e_of_k_sees_fails_its_windows_too():
    lines = worse(study(), spiked(study(), row_at(77.3), 40.0))
    assert {line.split(":")[0] for line in lines} == {
        "healthy residual of r, peak",
        "healthy residual of r, RMS",
        "healthy residual of r, window 75..85 s, max",
        "healthy score E(k), margin",
        "healthy score E(k), window 75..85 s, max",
    }
    assert all(line.endswith(" deg/s") or "margin" in line for line in lines)


def test_noise_of_the_last_digits_passes(monkeypatch):
    """Another machine adds and multiplies in another order: 1e-9 of every sample is far more than that."""
    sensed, random = Flown.sensed, np.random.default_rng(3)

    def shaken(self, number):
        record = sensed(self, number)
        values = record.values * (1.0 + 1e-9 * random.standard_normal(record.values.shape))
        return gb.Record(values, channels=record.channels, sample_period_s=record.sample_period_s)

    before = study()
    monkeypatch.setattr(Flown, "sensed", shaken)
    after = run_study([watching.scenario("short", SHORT)])
    assert after.baseline.watch.residuals["r"][100] != before.baseline.watch.residuals["r"][100]
    assert worse(before, after) == []


def test_missing_residuals_dont_hide():
    values = study().baseline.watch.residuals["r"].copy()
    values[row_at(75.0) : row_at(85.0)] = np.nan
    lines = worse(study(), with_residual(study(), values))
    assert lines[0] == "healthy residual of r, samples: was 9491, is 8491, allowed down to 9491"
    assert lines[1].startswith("healthy residual of r, window 75..85 s, max: was ")
    assert ", is nan, allowed" in lines[1]


def test_a_higher_threshold_sees_less_and_a_lower_one_costs_margin():
    limit = study().baseline.monitor.threshold
    (line,) = worse(study(), with_score(study(), threshold=1.1 * limit))
    assert line == (
        f"healthy score E(k), threshold: was {limit:.5g}, is {1.1 * limit:.5g}, "
        f"allowed up to {1.02 * rounded(limit):.5g} deg/s"
    )
    (line,) = worse(study(), with_score(study(), threshold=0.9 * limit))
    assert line.startswith("healthy score E(k), margin: was 1.")
    assert " allowed down to 1." in line


def test_a_false_alarm_and_a_monitor_that_arms_late():
    (line,) = worse(study(), with_baseline(study(), false_alarms=1))
    assert line == "healthy flight, false alarms: was 0, is 1, allowed up to 0"
    (line,) = worse(study(), with_baseline(study(), healthy_hours=0.9 * study().baseline.healthy_hours))
    assert line.startswith("healthy flight, hours watched: was ")


def test_a_slower_detection_and_a_miss():
    assert study().trials[0].detected
    was = study().trials[0].detection_delay_s
    (line,) = worse(study(), with_trial(study(), 0, detection_delay_s=was + 1.0))
    assert line.startswith(f"short: drift of q, delay: was {was:g}, is {was + 1:g}, allowed up to ")
    missed = {"detected": False, "detection_delay_s": None, "reason": "the score reached 93 % of its threshold"}
    lines = worse(study(), with_trial(study(), 0, **missed, peak_ratio=0.93))
    assert lines[0] == (
        "short: drift of q, detected: was yes, is no, allowed yes (missed: the score reached 93 % of its threshold)"
    )
    assert lines[1].startswith("short: drift of q, peak ratio: was ")
    assert len(lines) == 2  # and no word of a delay that isn't there


def test_a_miss_may_stay_one_and_its_detection_is_better():
    assert not study().trials[3].detected
    better = with_trial(study(), 3, detected=True, detection_delay_s=2.0)
    compared = compare(recorded(figures_of(study())), figures_of(better), TOLERANCES)
    assert [(figure.text, figure.regressed) for figure in compared if figure.better] == [
        ("short: jam of altitude, detected", False)
    ]


def test_an_isolation_that_goes_wrong():
    was = watching.study()
    wrong = {"isolated": False, "isolated_s": None, "isolation_delay_s": None, "verdict": "q failed", "kind": "jam"}
    assert worse(was, with_trial(was, 0, **wrong)) == [
        "mixed: drift of p, isolated: was yes, is no, allowed yes (q failed, jam)"
    ]
    lines = worse(was, with_trial(was, 0, kind="deadzone", kind_right=False))
    assert lines == ["mixed: drift of p, kind right: was yes, is no, allowed yes (p failed, deadzone)"]
    later = was.trials[0].isolation_delay_s + 5.0
    (line,) = worse(was, with_trial(was, 0, isolation_delay_s=later))
    assert line.startswith("mixed: drift of p, isolation delay: was ")


def test_a_bank_has_residuals_scores_and_thresholds_of_every_output():
    baseline = watching.study().baseline
    groups = {group.title: group for group in figures_of(watching.study())}
    for name in "pqr":
        assert groups[f"healthy residual of {name}"].unit == "deg/s"
        score = groups[f"healthy score {name}"]
        assert score.values["margin"] == pytest.approx(1.0 / np.nanmax(baseline.watch.scores[name].values), rel=1e-4)
        assert score.values["thresholds"] == rounded(tuple(baseline.monitor.thresholds[name].values()))
    scores = baseline.watch.scores
    one = replace(baseline.watch, scores={**scores, "q": replace(scores["q"], tests={"mean 0.08 s": 99.0})})
    assert figures_of(with_baseline(watching.study(), watch=one))[5].values["thresholds"] == (99.0,)


def test_a_function_has_alarms_and_hours_and_nothing_else_to_compare():
    watched = run_study([watching.scenario("short", SHORT)], detectors=[lambda record: record.time_s[[5, 8000]]])
    flight, *trials = figures_of(watched)
    assert flight.values == {"false_alarms": 4, "hours": rounded(2 * 95.01 / 3600)}
    assert {key for trial in trials for key in trial.values} == {"severity", "detected", "delay_s", "peak_ratio"}
    compared = compare(recorded(figures_of(watched)), figures_of(watched), {})
    assert not any(each.regressed or each.better for each in compared)


def test_figures_are_of_one_detector():
    several = replace(study(), baselines=(study().baseline, replace(study().baseline, detector="other")))
    with pytest.raises(gb.InputError, match="2 detectors watched; a baseline holds the figures of one"):
        figures_of(several)


def test_another_fault_is_no_comparison():
    stronger = with_trial(study(), 1, severity={"slope": 0.6})
    assert worse(study(), stronger) == ["short: drift of r, slope, severity: was 0.5, is 0.6, allowed 0.495 to 0.505"]
    assert worse(stronger, study()) == ["short: drift of r, slope, severity: was 0.6, is 0.5, allowed 0.594 to 0.606"]


def test_what_is_better_by_more_than_its_tolerance_is_said_to_be():
    trial = study().trials[1]
    for share, better in ((0.94, True), (0.96, False)):
        slower = with_trial(study(), 1, peak_ratio=share * trial.peak_ratio)
        compared = compare(recorded(figures_of(slower)), figures_of(study()), TOLERANCES)
        assert [figure.text for figure in compared if figure.better] == ["short: drift of r, peak ratio"] * better
        assert not any(figure.regressed for figure in compared)


def test_a_figure_that_the_baseline_lacks_or_has_too_many_is_an_error_not_a_regression():
    groups = figures_of(study())
    lacks = recorded(groups)
    del lacks["residual"]["r"]["rms"]
    with pytest.raises(gb.InputError, match="holds no figure of 'healthy residual of r, RMS'; --update records"):
        compare(lacks, groups, TOLERANCES)
    shorter = recorded(groups)
    shorter["score"]["E(k)"]["windows"] = shorter["score"]["E(k)"]["windows"][:4]
    with pytest.raises(gb.InputError, match=r"no figure of 'healthy score E\(k\), window 65..75 s, max' and 5 more"):
        compare(shorter, groups, TOLERANCES)
    with pytest.raises(gb.InputError, match=r"holds 'short: jam of p, detected' and .* more, which this run doesn't"):
        compare(recorded(groups), [group for group in groups if group.name != "short: jam of p"], TOLERANCES)
    delayless = recorded(groups)
    del delayless["trials"]["short: drift of q"]["delay_s"]
    with pytest.raises(gb.InputError, match="no figure of 'short: drift of q, delay'"):
        compare(delayless, groups, TOLERANCES)


VALUES = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)


@given(was=VALUES, now=VALUES, share=st.floats(0.0, 2.0), absolute=st.floats(0.0, 1e6))
def test_tolerances_are_one_sided_and_the_larger_of_both(was, now, share, absolute):
    group = figures_of(study())[2]
    tolerance = Tolerance(share=share, absolute=absolute)
    for figure, sign in (("threshold", 1.0), ("margin", -1.0)):
        (comparison,) = compare(
            {"score": {"E(k)": {figure: was}}}, [replace(group, values={figure: now})], {figure: tolerance}
        )
        beyond = sign * (now - was)
        room = max(share * abs(was), absolute)
        slack = 1e-9 * (abs(was) + abs(now) + room)  # of rounding
        assert not (comparison.regressed and comparison.better)
        if beyond > room + slack:
            assert comparison.regressed
            assert comparison.excess == math.inf if room == 0 else comparison.excess > 0.99
        elif beyond < room - slack:
            assert not comparison.regressed


def test_trials_of_one_name_are_numbered():
    several = [("mine", "drift", channel) for channel in "ppq"]
    assert trial_names(several) == ["mine: drift of p", "mine: drift of p (2)", "mine: drift of q"]


@pytest.mark.parametrize(("given", "share", "absolute"), [(0, 0, 0), ("5 %", 0.05, 0), (["2.5%", 0.1], 0.025, 0.1)])
def test_tolerances_as_they_are_written(given, share, absolute):
    assert parse_tolerance("x", given) == Tolerance(share=share, absolute=absolute)
    assert not isinstance(given, list) or parse_tolerance("x", given[::-1]) == parse_tolerance("x", given)


@pytest.mark.parametrize(
    "given", ["5", "%", "a %", "5 % of it", "nan %", "-1 %", -1, True, 10**400, float("nan"), None]
)
def test_tolerances_that_arent(given):
    for tolerance in (given, ["5 %", given], [given, 1], [given], {}):
        with pytest.raises(gb.InputError, match=r"^tolerances.rms"):
            parse_tolerance("tolerances.rms", tolerance)
