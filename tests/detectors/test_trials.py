"""Faults put on one record say when they alarm as watching the broken record does; only the price differs."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.tried_faults import WatchedTrials, stretches, trials_on
from tests.helpers.monitors import monitor, record
from tests.helpers.night import by_day

SENSORS = ("p", "q", "r", "phi", "theta", "psi")


def faults(channel, onset_s):
    """Faults that alarm at once, late and never, and last or pass."""
    at = {"channel": channel, "onset_s": onset_s}
    return [
        gb.Drift(**at, slope=0.2),
        gb.Drift(**at, slope=-3.0, duration_s=3.0),
        gb.Jam(**at),
        gb.Bias(**at, size=1e-4),
        gb.Bias(**at, size=4.0, ramp_s=2.0),
        gb.ScaleFactor(**at, factor=0.5, intermittent=gb.Intermittent(period_s=2.0, duty=0.5)),
        gb.Noise(**at, deviation=3.0, seed=5),
        gb.Delay(**at, delay_s=0.3),
    ]


def check(own, watched, fault):
    said, wanted = own.detection(fault), watched.detection(fault)
    assert said.alarm_s == wanted.alarm_s == own.first_alarm_s(fault), fault
    return said, wanted


@pytest.mark.parametrize("sensor", by_day(SENSORS))
def test_a_bank_alarms_when_watching_does(sensor):
    healthy = record(4000, seed=31)
    own, watched = trials_on(monitor(), healthy), WatchedTrials(monitor(), healthy)
    said = [check(own, watched, fault) for fault in faults(sensor, 50.01)]
    alarmed = [each.alarm_s is not None for each, _ in said]
    assert 3 <= sum(alarmed) < len(alarmed)
    lasting, seen = said[0]
    assert lasting.peak_ratio == pytest.approx(seen.peak_ratio, rel=1e-6)


def test_what_is_not_simple_is_watched():
    healthy = record(3000, seed=33)
    own, watched = trials_on(monitor(), healthy), WatchedTrials(monitor(), healthy)
    missing = gb.Dropout(channel="r", onset_s=40.0, duration_s=2.0)
    check(own, watched, missing)
    for onset_s in (healthy.start_s, 0.3, healthy.end_s):  # before it is armed, and at the very end
        check(own, watched, gb.Bias(channel="r", onset_s=onset_s, size=9.0))
    with pytest.raises(gb.InputError, match="outside of the record"):
        own.first_alarm_s(gb.Jam(channel="r", onset_s=-5.0))


@pytest.mark.nightly
def test_a_record_that_alarms_before_the_onset_is_watched():
    healthy = gb.inject(record(3500, seed=34), gb.Bias(channel="q", onset_s=45.0, size=5.0, duration_s=1.0))
    own, watched = trials_on(monitor(), healthy), WatchedTrials(monitor(), healthy)
    said, _ = check(own, watched, gb.Bias(channel="p", onset_s=60.0, size=5.0))
    assert said.alarm_s > 60.0


def test_what_is_known_after_the_onset_and_healthy_counts_as_watching_has_it():
    healthy = gb.inject(record(3500, seed=34), gb.Bias(channel="q", onset_s=60.0, size=5.0, duration_s=1.0))
    own, watched = trials_on(monitor(), healthy), WatchedTrials(monitor(), healthy)
    for fault in (gb.Bias(channel="p", onset_s=59.0, size=1e-3), gb.Bias(channel="q", onset_s=59.99, size=1e-3)):
        said, _ = check(own, watched, fault)
        assert 60.0 < said.alarm_s < 61.0


def test_any_other_detector_is_watched():
    limit = gb.FunctionDetector(lambda record: record.time_s[record["p"] > 40.0][:1], name="limit")
    ready = limit.calibrate([record(500, seed=1)])
    assert trials_on(ready, record(2000, seed=2)).first_alarm_s(gb.Bias(channel="p", onset_s=20.0, size=99.0)) == 20.0


def test_stretches_cover_all_rows_once():
    parts = stretches(7, 100_000)
    assert [row for part in parts for row in (part.start, part.stop)][1:-1:2] == [part.start for part in parts[1:]]
    assert parts[0].start == 7
    assert parts[-1].stop == 100_000


@pytest.mark.parametrize("sensor", by_day(("p", "q", "phi"), 0))
def test_records_that_begin_alike_are_told_of_as_each_by_itself(sensor):
    healthy = record(4000, seed=31)
    begun = monitor().begun(monitor().watch(healthy))
    for onset_s in (50.01, 30.0, 60.0):  # what was taken goes on, or begins anew
        broken = gb.inject(healthy, gb.Bias(channel=sensor, onset_s=onset_s, size=4.0))
        together, alone = monitor().watch(broken, begun=begun), monitor().watch(broken)
        for name, score in alone.scores.items():
            np.testing.assert_allclose(together.scores[name].values, score.values, rtol=1e-9)
            np.testing.assert_array_equal(together.scores[name].armed, score.armed)
        told = [
            [(each.time_s, each.onset_s, each.sensor, each.last and each.last.kind) for each in of.alarms]
            for of in (together, alone)
        ]
        assert told[0] == told[1]
        assert any(each.sensor == sensor for each in alone.alarms)
    other = record(3000, seed=31)
    assert not monitor().watch(other, begun=begun).alarms
