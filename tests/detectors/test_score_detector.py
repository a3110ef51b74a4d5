"""Scores without thresholds: calibration keeps the rate, whatever scale a score has, and learns on other records."""

from dataclasses import dataclass

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.testing import check_detector


@dataclass(frozen=True)
class Squared(gb.ScoreDetector):
    name: str = "squared"
    channels: tuple[str, ...] = ("p", "q")
    memory_s: float = 0.0
    scale: float = 1.0

    def learn(self, records):
        return {name: float(np.nanstd(np.concatenate([one[name] for one in records]))) for name in self.channels}

    def scores(self, record, deviations):
        return {name: self.scale * (record[name] / deviations[name]) ** 2 for name in self.channels}


def records(count, seed, samples=6000):
    draw = np.random.default_rng(seed)
    return [gb.Record(draw.normal(size=(samples, 2)), channels=["p", "q"], sample_period_s=0.01) for _ in range(count)]


HEALTHY, OTHERS = records(80, 1), records(600, 2)


def test_it_keeps_the_contract_of_every_detector():
    check_detector(Squared())


@pytest.mark.parametrize("rate", [6.0, 1.0])
def test_it_raises_about_as_many_false_alarms_as_asked(rate):
    monitor = Squared().calibrate(HEALTHY, false_alarms_per_hour=rate)
    alarms = sum(len(monitor.watch(record).alarms) for record in OTHERS)
    assert alarms / 10.0 < 2.5 * rate  # of ten hours
    assert alarms / 10.0 > 0.1 * rate


@pytest.mark.parametrize("scale", [1e-9, -1e-3, 1e12])
def test_the_scale_of_a_score_does_not_matter(scale):
    alarms = {}
    for each in (Squared(), Squared(scale=abs(scale))):
        monitor = each.calibrate(HEALTHY[:20], false_alarms_per_hour=60.0)
        alarms[each.scale] = [[alarm.time_s for alarm in monitor.watch(record).alarms] for record in OTHERS[:40]]
    first, second = alarms.values()
    assert first == second
    assert any(first)


def test_what_it_learns_on_is_not_what_sets_its_thresholds():
    seen = []

    class Seen(Squared):
        def learn(self, given):
            seen.append(len(given))
            return super().learn(given)

    Seen().calibrate(HEALTHY[:5])
    assert seen == [3]


def test_a_score_that_has_an_end_never_gets_a_threshold_behind_it():
    class Share(Squared):
        bound = 1.0

        def scores(self, record, deviations):
            return {name: 1.0 - np.exp(-np.square(record[name]) / 10.0) for name in self.channels}

    monitor = Share().calibrate(HEALTHY, false_alarms_per_hour=0.01)
    broken = gb.inject(OTHERS[0], gb.Bias(channel="p", onset_s=30.0, size=1e4))
    assert monitor.watch(broken).alarm_s == 30.0


def test_one_record_is_too_few():
    with pytest.raises(gb.InputError, match="sets thresholds on others; give two at least"):
        Squared().calibrate(HEALTHY[:1])
