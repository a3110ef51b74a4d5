"""What is said of a log: only what must be a fault; the regime, excursions, and beginnings."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import OUTSIDE
from gtmbench.detectors.monitor.excursions import Excursion
from gtmbench.detectors.monitor.regime import FAILURE, MOTION, PUSHED, RESET, TOUCHDOWN, Regime
from gtmbench.errors import InputError
from gtmbench.intake.events import Event, EventKind
from gtmbench.log.watch import watch_log
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.verdict.verdict import Outcome
from tests.helpers.night import by_day
from tests.helpers.watching import cautious, sensed

CUT_S = 60.0


def rest():
    return sensed().between(CUT_S + 0.01, sensed().end_s)


def shaken(record, start_s, end_s, size):
    """Return a record whose gyros all ring, which its attitude doesn't follow."""
    for number, name in enumerate("pqr"):
        during = (record.time_s >= start_s) & (record.time_s < end_s)
        ringing = size * np.sin(2.0 * np.pi * (7.0 + number) * (record.time_s - start_s))
        record = record.replace(name, record[name] + np.where(during, ringing, 0.0))
    return record


# ---- what must be a fault ----


@pytest.mark.parametrize("bank", by_day(["C", "C-filtered"]))
@pytest.mark.parametrize(
    "fault",
    by_day(
        [
            gb.Bias(channel="q", onset_s=100.0, size=3.0),
            gb.Drift(channel="p", onset_s=100.0, slope=1.0),
            gb.ScaleFactor(channel="p", onset_s=100.0, factor=0.6),
            gb.Deadzone(channel="p", onset_s=100.0, half_width=4.0),
            gb.Noise(channel="r", onset_s=100.0, deviation=3.0),
            gb.Jam(channel="q", onset_s=100.0),
        ]
    ),
    ids=lambda fault: fault.kind,
)
def test_a_gyros_fault_is_named_by_a_cautious_monitor(fault, bank):
    assert cautious(bank).is_cautious
    (alarm,) = cautious(bank).watch(gb.inject(rest(), fault)).faults
    assert (alarm.sensor, alarm.doubt) == (fault.channel, "")
    assert alarm.time_s > 100.0


def test_what_shakes_every_gyro_is_no_gyros_fault():
    told = [alarm for alarm in cautious().watch(shaken(rest(), 100.0, 108.0, 15.0)).faults if not alarm.has_passed]
    assert told
    assert all(alarm.doubt == "motion or model" and alarm.sensor is None for alarm in told)


def test_an_angle_that_steps_is_no_sensors_fault_for_it_may_have_been_set_anew():
    stepped = gb.inject(rest(), gb.Bias(channel="phi", onset_s=100.0, size=4.0))
    told = [alarm for alarm in cautious().watch(stepped).faults if not alarm.has_passed]
    assert all(alarm.doubt for alarm in told)


@pytest.mark.nightly
def test_two_gyros_that_fail_one_after_the_other_are_both_named():
    broken = gb.inject(rest(), gb.Bias(channel="q", onset_s=90.0, size=3.0))
    broken = gb.inject(broken, gb.Bias(channel="p", onset_s=110.0, size=5.0))
    assert [alarm.sensor for alarm in cautious().watch(broken).faults] == ["q", "p"]


def test_a_second_finding_is_not_named_by_exclusion():
    """After p has failed the attitude is under suspicion still, by what the residuals of q and r tell."""
    broken = gb.inject(rest(), gb.Bias(channel="p", onset_s=90.0, size=5.0))
    broken = gb.inject(broken, gb.Oscillation(channel="theta", onset_s=110.0, amplitude=1.0, frequency_hz=0.7))
    first, *others = cautious().watch(broken).faults
    assert first.sensor == "p"
    assert all(alarm.sensor not in ("q", "r") for alarm in others)
    assert any("theta" in alarm.candidates or alarm.doubt for alarm in others)


@pytest.mark.nightly
def test_many_healthy_hours_know_better():
    """A monitor that stands on much flight says of the same alarm that something failed."""
    much = replace(cautious(), uncertainties={})
    assert not much.is_cautious
    told = [alarm for alarm in much.watch(shaken(rest(), 100.0, 108.0, 15.0)).faults if not alarm.has_passed]
    assert told
    assert not any(alarm.doubt for alarm in told)


@pytest.mark.parametrize("name", by_day(MECHANISMS))
def test_no_sensor_is_accused_of_what_autopilots_logs_do(name, tmp_path):
    path = tmp_path / "log.csv"
    for seed in (42, 43) if name == "hardly fresh" else (40, 41):  # a minute at 2.5 Hz is refused as too short
        gb.write_log(MECHANISMS[name](seed).record, path)
        try:
            assert watch_log(path, "C").outcome is not Outcome.FAILED
        finally:
            path.unlink()


# ---- the regime ----


def test_the_regime_is_what_was_identified_and_no_one_sensor_widens_it():
    healthy = sensed().between(0.0, CUT_S)
    regime = Regime.of([healthy])
    assert len(regime.limits) == 5
    assert Regime.from_provenance({"regime": regime.table}) == regime
    usual = regime.excursions(rest())
    for channel, size in (("p", 300.0), ("phi", 60.0)):  # a gyro's fault, an angle's
        broken = gb.inject(rest(), gb.Oscillation(channel=channel, onset_s=100.0, amplitude=size, frequency_hz=3.0))
        assert regime.excursions(broken) == usual


def test_motion_that_gyros_and_attitude_tell_of_is_outside_and_so_is_a_blow():
    regime = Regime.of([sensed().between(0.0, CUT_S)])
    record, time_s = rest(), rest().time_s
    turning = 40.0 * np.sin(2.0 * np.pi * (time_s - 100.0)) * ((time_s >= 100.0) & (time_s < 103.0))
    rolled = record.replace("phi", record["phi"] + turning)
    rolled = rolled.replace("p", record["p"] + np.gradient(turning, time_s))
    (beyond,) = [each for each in regime.excursions(rolled) if each.start_s < 103.0 and each.end_s > 100.0]
    assert beyond.reason == MOTION
    assert beyond.start_s <= 100.0
    assert beyond.end_s == pytest.approx(104.0, abs=0.3)
    blow = record.replace("nz", record["nz"] + 6.0 * (np.abs(time_s - 120.0) < 0.05))
    assert PUSHED in [each.reason for each in regime.excursions(blow) if each.start_s < 120.0 < each.end_s]


@pytest.mark.parametrize(
    ("kind", "reason", "is_judged"),
    [(EventKind.RESET, RESET, False), (EventKind.TOUCHDOWN, TOUCHDOWN, True), (EventKind.FAILURE, FAILURE, True)],
)
def test_what_the_log_tells_of_is_an_excursion(kind, reason, is_judged):
    event = Event(kind=kind, time_s=100.0, text="told")
    (about,) = Regime(limits={}).excursions(rest(), [event])
    assert (about.reason, about.is_judged) == (reason, is_judged)
    assert about.start_s < 100.0 < about.end_s
    assert Regime(limits={}).excursions(rest(), [Event(kind=EventKind.ARM, time_s=100.0, text="armed")]) == ()


# ---- excursions ----


def test_an_alarm_in_an_excursion_cant_be_told_and_leaves_no_trace():
    outside = [Excursion(start_s=99.5, end_s=109.0, reason="a bump")]
    bumped = shaken(rest(), 100.0, 108.0, 15.0)
    (alarm,) = cautious().watch(bumped, outside=outside).faults
    assert (alarm.test, alarm.doubt, alarm.sensor) == (OUTSIDE, "a bump", None)
    assert 99.5 <= alarm.time_s <= 109.2
    assert cautious().watch(rest(), outside=outside).alarms == ()  # where nothing would have risen


def test_a_fault_that_began_in_an_excursion_and_lasts_is_found_after_it():
    outside = [Excursion(start_s=99.5, end_s=103.0, reason="a turn")]
    broken = gb.inject(rest(), gb.Bias(channel="q", onset_s=100.0, size=3.0))
    *_, alarm = cautious().watch(broken, outside=outside).faults
    assert alarm.sensor == "q"
    assert 103.0 < alarm.time_s < 106.0


def test_an_alarm_that_an_impact_may_have_left_is_doubted_for_good():
    outside = [Excursion(start_s=99.5, end_s=103.0, reason="an impact", settles_s=np.inf)]
    broken = gb.inject(rest(), gb.Bias(channel="q", onset_s=100.0, size=3.0))
    told = cautious().watch(broken, outside=outside).faults
    assert {alarm.doubt for alarm in told} == {"an impact"}


@pytest.mark.nightly
def test_a_ready_monitor_knows_its_regime(tmp_path):
    path = tmp_path / "log.csv"
    gb.write_log(sensed(), path)
    first = watch_log(path, "C", healthy=[(0.0, CUT_S)])
    again = gb.load_monitor(gb.save_monitor(first.monitor, tmp_path / "monitor.json") or tmp_path / "monitor.json")
    assert Regime.from_provenance(again.provenance) == Regime.from_provenance(first.monitor.provenance)
    assert Regime.from_provenance(again.provenance).limits
    with pytest.raises(InputError):
        gb.load_monitor(path)
