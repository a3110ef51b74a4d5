"""Sight: thresholds that nothing passes, or everything, are refused; whatever calibration makes isn't."""

import json
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.rivals.catalogue import RIVALS
from gtmbench.detectors.rivals.judging import Level
from gtmbench.detectors.rivals.limit_checks import LimitChecks
from gtmbench.detectors.rivals.signals import Lookback
from gtmbench.detectors.statistics.sight import _noise, check_sight
from gtmbench.detectors.statistics.statistic import Allowance, Statistic, tolerance_of
from gtmbench.detectors.statistics.thresholds import healthy_maxima
from gtmbench.detectors.statistics.whitening import White
from tests.helpers.monitors import record
from tests.helpers.sealed import resealed

PERIOD_S = 0.02
STATISTICS = [
    Statistic(),
    Statistic(two_sided=False, windows_s=(0.5,)),
    Statistic(name="cusum"),
    Statistic(name="whitened_energy"),
    Statistic(name="energy"),
    Level(),
]


def healthy_thresholds(test, seconds, deviation=1.0, seed=1):
    """Return thresholds and tolerance on white noise."""
    noise = deviation * np.random.default_rng(seed).standard_normal(round(seconds / PERIOD_S))
    white = noise if isinstance(test, Level) else noise / deviation
    tolerance = tolerance_of([white], test, PERIOD_S)
    healthy = {"p": [(noise, White.steady(white), None)]}
    return healthy_maxima(test, healthy, {"p": tolerance}, PERIOD_S).thresholds(0.01)["p"], tolerance


@pytest.mark.parametrize("seconds", [120.0, 2000.0])
@pytest.mark.parametrize("test", STATISTICS, ids=lambda test: f"{test.name} {len(test.windows_s)}")
def test_what_calibration_sets_sees(test, seconds):
    for deviation in (1e-3, 1e3):
        thresholds, tolerance = healthy_thresholds(test, seconds, deviation)
        check_sight("p", thresholds, test, tolerance, PERIOD_S, deviation=deviation)


@pytest.mark.parametrize("test", STATISTICS, ids=lambda test: f"{test.name} {len(test.windows_s)}")
def test_without_any_finite_threshold_a_residual_is_blind(test):
    thresholds, tolerance = healthy_thresholds(test, 300.0)
    with pytest.raises(gb.InputError, match="p are blind: a step of 20 deviations for 5 s passes none"):
        check_sight("p", dict.fromkeys(thresholds, math.inf), test, tolerance, PERIOD_S)


@pytest.mark.parametrize("test", STATISTICS[:-1], ids=lambda test: f"{test.name} {len(test.windows_s)}")
def test_every_test_has_a_greatest_value_in_the_residuals_unit(test):
    deviation = 1e-3
    thresholds, tolerance = healthy_thresholds(test, 300.0, deviation)
    for label in thresholds:
        with pytest.raises(gb.InputError, match=f"'{label}' is 1e\\+308; nothing passes that") as refused:
            check_sight("p", thresholds | {label: 1e308}, test, tolerance, PERIOD_S, deviation=deviation)
        greatest = float(str(refused.value).rpartition(" ")[2])
        if label.endswith(" low"):  # which are negative
            continue
        check_sight("p", thresholds | {label: 0.98 * greatest}, test, tolerance, PERIOD_S, deviation=deviation)
        with pytest.raises(gb.InputError, match="nothing passes that"):
            check_sight("p", thresholds | {label: 1.02 * greatest}, test, tolerance, PERIOD_S, deviation=deviation)


def test_a_cusum_goes_as_far_down_as_up():
    test, reached = Statistic(name="cusum"), []
    for label in ("cusum mean up", "cusum mean down"):
        with pytest.raises(gb.InputError, match="nothing passes that") as refused:
            check_sight("p", healthy_thresholds(test, 300.0)[0] | {label: 1e308}, test, Allowance(), PERIOD_S)
        reached.append(float(str(refused.value).rpartition(" ")[2]))
    assert reached[0] == pytest.approx(reached[1], rel=0.01)


@pytest.mark.parametrize("test", STATISTICS, ids=lambda test: f"{test.name} {len(test.windows_s)}")
def test_only_tests_of_too_little_may_have_a_negative_threshold(test):
    thresholds, tolerance = healthy_thresholds(test, 2000.0)
    for label, threshold in thresholds.items():
        if label.endswith(" low"):
            assert threshold < 0.0
        else:
            check_sight("p", thresholds | {label: 0.0}, test, tolerance, PERIOD_S)
            with pytest.raises(gb.InputError, match=f"'{label}' is -1; the test is never below 0"):
                check_sight("p", thresholds | {label: -1.0}, test, tolerance, PERIOD_S)


def test_thresholds_that_pass_only_what_is_beyond_the_handful_are_blind():
    test = Statistic(windows_s=(1.0,))
    for label in ("mean 1 s", "energy 1 s"):
        thresholds = {"mean 1 s": math.inf, "energy 1 s": math.inf, label: 1e5}
        with pytest.raises(gb.InputError, match="a step of 20"):
            check_sight("p", thresholds, test, Allowance(), PERIOD_S)
    with pytest.raises(gb.InputError, match="10 times the noise for 5 s passes none"):
        check_sight("p", {"mean 1 s": 2000.0, "energy 1 s": math.inf}, test, Allowance(), PERIOD_S)


def test_five_million_samples_are_the_most_that_are_tried():
    """A ninth of a baseline, the longest window, and as many rows and one after."""
    assert len(_noise(Statistic(windows_s=(2_499_996.0,), baseline_s=63.0), 1.0)[0]) == 5_000_000
    with pytest.raises(gb.InputError, match="5000001 samples would have to pass"):
        _noise(Statistic(windows_s=(2_499_997.0,), baseline_s=54.0), 1.0)


def test_a_fault_lasts_a_sample_longer_than_the_shortest_window_and_a_deviation_is_one_unless_told():
    slow = Statistic(windows_s=(10.0,))
    with pytest.raises(gb.InputError, match=r"20 deviations for 10\.02 s passes none"):
        check_sight("p", {"mean 10 s": math.inf, "energy 10 s": math.inf}, slow, Allowance(), PERIOD_S)
    energy, said = Statistic(name="energy", two_sided=False, windows_s=(1.0,)), []
    for told in ({}, {"deviation": 1.0}):
        with pytest.raises(gb.InputError, match="the grossest fault reaches") as refused:
            check_sight("p", {"energy 1 s high": 1e308}, energy, Allowance(), PERIOD_S, **told)
        said.append(str(refused.value))
    assert said[0] == said[1]


def test_what_is_tolerated_isnt_held_against_a_residual():
    test = Statistic()
    tolerance = Allowance(mean=30.0, low=0.1, high=50.0)
    check_sight("p", dict.fromkeys(healthy_thresholds(test, 300.0)[0], 25.0), test, tolerance, PERIOD_S)


# rivals


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("limits", "'limits' is blind: a gyro that is 10000 deg/s off"),
        ("kinematic-kalman-no-fir", r"judgings\.p\.thresholds, 'mean 0\.08 s' is 1e\+308; nothing passes that"),
    ],
)
def test_a_rival_whose_thresholds_nothing_passes_isnt_loaded(name, said, tmp_path):
    path = tmp_path / "m.json"
    gb.save_monitor(RIVALS[name].calibrate([record(3000, seed=seed) for seed in (1, 2, 3)]), path)
    document = json.loads(path.read_text())
    for judging in document["figures"]["judgings"].values():
        judging["thresholds"] = dict.fromkeys(judging["thresholds"], 1e308)
    path.write_text(json.dumps(resealed(document)))
    with pytest.raises(gb.InputError, match=said):
        gb.load_monitor(path)


@dataclass(frozen=True, kw_only=True)
class Bounded(LimitChecks):
    """A score of 0 to 0.5, which healthy flights come close to."""

    name: str = "bounded"
    judge: str = "sample"
    outputs: ClassVar[tuple[str, ...]] = ("odd",)

    def generator(self, model, sample_period_s):
        return Lookback(0, 3, lambda values: 0.5 - 0.5 / (1.0 + np.abs(values).sum(axis=1, keepdims=True)))


def test_a_bounded_score_that_cant_keep_the_rate_is_refused():
    draw = np.random.default_rng(1)
    records = [
        gb.Record(draw.standard_normal((3000, 3)), channels=["p", "q", "r"], sample_period_s=PERIOD_S) for _ in range(3)
    ]
    with pytest.raises(gb.InputError, match=r"can't promise 1e-09 false alarms an hour: it would be blind") as refused:
        Bounded().calibrate(records, 1e-9)
    assert "\n" not in str(refused.value)
