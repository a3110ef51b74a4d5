"""A kind of a user's own: a class with a shape is named by a diagnosis, found with its size, and certified."""

from dataclasses import dataclass

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.isolation.hypotheses import families
from gtmbench.faults import registry
from gtmbench.log.judging.certificate import certificate_of
from tests.helpers import monitors
from tests.helpers.night import by_day

ONSET_S = 60.0


@dataclass(frozen=True, kw_only=True)
class Fading(gb.Fault):
    """The signal dies away."""

    kind = "fading"
    shape = gb.Shape(how="search", parameter="fading_s", low=0.5, high=60.0)
    fading_s: float = gb.severity(unit="s", low=0.0, above=True)

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        return readings[:, 0] * np.exp(-elapsed_s / self.fading_s), carried


@dataclass(frozen=True, kw_only=True)
class Rectified(gb.Fault):
    """A share of what is below zero is read with the wrong sign."""

    kind = "rectified"
    shape = gb.Shape(how="linear", parameter="share")
    typical = gb.Typical(certified_s=10.0)
    share: float = gb.severity(unit="")

    def distort(self, readings, elapsed_s, sample_period_s, carried):
        y = readings[:, 0]
        return y + self.share * (np.abs(y) - y), carried


@pytest.fixture(autouse=True)
def only_these(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})


def told(fault, seed):
    record = monitors.record(6000, seed=seed)
    (alarm,) = monitors.monitor().watch(gb.inject(record, fault)).faults
    return alarm.judgements[-1]


@pytest.mark.parametrize("channel", by_day(["p", "q", "r"]))
def test_a_search_over_one_parameter_names_the_kind_and_holds_its_figure(channel):
    gb.register_fault(Fading)
    judged = told(Fading(channel=channel, onset_s=ONSET_S, fading_s=6.0), seed=91)
    assert (judged.sensor, judged.kind) == (channel, "fading")
    low, high = judged.intervals["fading_s"]
    assert low <= 6.0 <= high
    assert judged.intervals["onset_s"][0] <= ONSET_S <= judged.intervals["onset_s"][1]


def test_without_its_class_the_sensor_is_named_all_the_same():
    judged = told(Fading(channel="q", onset_s=ONSET_S, fading_s=6.0), seed=91)
    assert judged.sensor == "q"
    assert judged.kind != "fading"
    assert "own" not in families()


@pytest.mark.parametrize("share", [0.5, -0.4])
def test_a_shape_that_is_linear_is_found_with_its_size(share):
    gb.register_fault(Rectified)
    judged = told(Rectified(channel="p", onset_s=ONSET_S, share=share), seed=92)
    assert (judged.sensor, judged.kind) == ("p", "rectified")
    low, high = judged.intervals["share"]
    assert low <= share <= high


@pytest.mark.nightly
def test_a_kind_that_says_so_is_certified():
    monitor, watch = monitors.monitor(), monitors.monitor().watch(monitors.record(6000, seed=93))
    assert certificate_of(monitor, [watch]).of("r", "rectified") is None
    gb.register_fault(Rectified)
    row = certificate_of(monitor, [watch]).of("r", "rectified")
    assert 0.0 < row.size < 2.0


def test_a_price_makes_a_kind_less_likely():
    gb.register_fault(Rectified)
    dear = dataclass(frozen=True, kw_only=True)(
        type("Dear", (Rectified,), {"kind": "dear", "shape": gb.Shape(how="linear", parameter="share", price=500.0)})
    )
    gb.register_fault(dear)
    assert told(Rectified(channel="p", onset_s=ONSET_S, share=0.5), seed=92).kind == "rectified"


@pytest.mark.parametrize(("channel", "size"), by_day([("r", 3.0), ("psi", 5.0), ("theta", -4.0)]))
def test_a_bias_that_settles_is_told_with_its_size_and_never_laid_on_the_other_sensor_of_its_axis(channel, size):
    fault = gb.ThermalBias(channel=channel, onset_s=ONSET_S, size=size, warming_s=4.0)
    judged = told(fault, seed=94)
    assert set(judged.candidates[:1]) == {channel}
    if judged.sensor is not None:
        assert (judged.sensor, judged.kind) == (channel, "thermal_bias")
        low, high = judged.intervals["size"]
        assert low <= size <= high
