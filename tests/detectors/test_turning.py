"""Motion beyond what a monitor was calibrated on: gyros and attitude must both tell it, and nobody is named for it."""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.excursion import MOTION, Excursion, Turning
from gtmbench.detectors.monitor.open_faults import OpenFault
from gtmbench.detectors.monitor.scores import Crossing
from tests.helpers import monitors
from tests.helpers.night import by_day

PERIOD_S = 0.02
SENSORS = ("p", "q", "r", "phi", "theta", "psi")


@cache
def known():
    return Turning.of([monitors.record(5000, seed=seed) for seed in (1, 2, 3)])


@cache
def rolled(rate_deg_s=120.0, seed=21):
    """A healthy record that rolls twice round from 60 s on, begun and ended within 0.1 s."""
    truth = monitors.truth(5000, seed=seed)
    time_s = np.arange(5002) * PERIOD_S
    rate = rate_deg_s * np.clip((time_s - 60.0) / 0.1, 0.0, 1.0) * (time_s < 60.0 + 720.0 / rate_deg_s)
    phi = np.append(truth["phi"], truth["phi"][-2:]) + np.cumsum(rate) * PERIOD_S
    angles = np.column_stack(
        [(phi + 180.0) % 360.0 - 180.0, *(np.append(truth[n], truth[n][-2:]) for n in ("theta", "psi"))]
    )
    attitude = gb.Record(angles, channels=["phi", "theta", "psi"], sample_period_s=PERIOD_S)
    rates = gb.derive(attitude, ["p_att", "q_att", "r_att"]).matrix(["p_att", "q_att", "r_att"])[1:-1]
    values = truth.values.copy()
    values[1:, :3], values[:, 3] = rates[:-1], angles[:5000, 0]
    noise = np.random.default_rng(seed).standard_normal(values.shape) * monitors.NOISE
    return gb.Record(values + noise, channels=truth.channels, sample_period_s=PERIOD_S)


def faults(channel):
    yield gb.Bias(channel=channel, onset_s=60.0, size=300.0)
    yield gb.Drift(channel=channel, onset_s=60.0, slope=1.5)
    yield gb.Noise(channel=channel, onset_s=60.0, deviation=40.0)
    yield gb.Jam(channel=channel, onset_s=60.0)
    yield gb.ScaleFactor(channel=channel, onset_s=60.0, factor=-8.0)
    yield gb.Oscillation(channel=channel, onset_s=60.0, amplitude=90.0, frequency_hz=5.0)
    yield gb.Spikes(channel=channel, onset_s=60.0, size=90.0, rate_hz=5.0)


@pytest.mark.parametrize("channel", SENSORS)
def test_what_one_sensor_reads_is_never_motion(channel):
    healthy = monitors.record(5000, seed=21)
    assert known().excursion(healthy) is None
    for fault in faults(channel):
        assert known().excursion(gb.inject(healthy, fault)) is None, fault


def test_a_roll_is_motion_for_as_long_as_it_lasts():
    excursion = known().excursion(rolled())
    assert excursion.reason == MOTION
    assert excursion.start_s == pytest.approx(60.0, abs=0.2)
    assert excursion.end_s == pytest.approx(66.0, abs=0.2)


@cache
def looped(seed=21):
    """A healthy record whose nose goes slowly through the vertical from 60 s on; and when that is near."""
    healthy, rate = monitors.record(5000, seed=seed), 12.0 * np.clip(np.arange(5000) * PERIOD_S - 60.0, 0.0, 8.0) / 8.0
    pitched = np.cumsum(rate) * PERIOD_S
    is_over = pitched > 90.0
    over = {angle: healthy[angle] + 180.0 * is_over for angle in ("phi", "psi")}
    own = {"theta": healthy["theta"] + np.where(is_over, 180.0 - pitched, pitched), "q": healthy["q"] + rate}
    return replaced(healthy, own | over), np.flatnonzero(pitched > 80.0)[0] * PERIOD_S


def replaced(record, columns):
    for channel, values in columns.items():
        record = record.replace(channel, values)
    return record


def test_near_the_vertical_nothing_is_identified_however_slowly_it_turns():
    record, steep_s = looped()
    assert known().excursion(record).start_s == pytest.approx(steep_s, abs=0.5)


@pytest.mark.parametrize("louder", [2.0, 4.0])
def test_noise_is_no_motion(louder):
    quiet, loud = monitors.truth(5000, seed=21), monitors.record(5000, seed=21)
    noisier = gb.Record(
        quiet.values + louder * (loud.values - quiet.values), channels=loud.channels, sample_period_s=PERIOD_S
    )
    gyros_alone = loud.replace("p", noisier["p"]).replace("q", noisier["q"]).replace("r", noisier["r"])
    assert known().excursion(gyros_alone) is None


def test_it_is_kept_in_a_monitors_file(tmp_path):
    monitor = monitors.monitor("C")
    gb.save_monitor(monitor, tmp_path / "monitor.json")
    kept = Turning.from_provenance(gb.load_monitor(tmp_path / "monitor.json").provenance)
    assert kept.limits
    assert kept == Turning.from_provenance(monitor.provenance)
    assert (
        Turning.from_provenance(monitors.monitor("B").provenance)
        == Turning.from_provenance({})
        == Turning.from_provenance({"turning": "fast"})
        == Turning()
    )
    assert Turning.from_provenance({"turning": {"gyros_deg_s": 1.0}}).excursion(rolled()) is None


@pytest.mark.parametrize("samples", [0, 1, 2, 5, 7, 11, 12])
def test_short_records_tell_of_none(samples):
    assert known().excursion(monitors.record(5000, seed=21).part(range(samples))) is None


def test_nobody_is_named_for_an_error_of_the_operators_in_a_roll():
    """Gyros that are off by 4 % show it only where they turn that fast."""
    record = rolled()
    off = record.replace("p", 1.04 * record["p"])
    told = [alarm for alarm in monitors.monitor("C").watch(off).alarms if 59.0 < alarm.time_s < 67.0]
    assert told
    assert {alarm.sensor for alarm in told} == {None}
    assert all(alarm.doubt or not alarm.last.candidates for alarm in told)


@pytest.mark.parametrize("channel", by_day(["p", "q", "r"]))
def test_what_broke_before_a_roll_and_what_breaks_after_it_are_named(channel):
    for onset_s in (50.0, 85.0):
        broken = gb.inject(rolled(), gb.Bias(channel=channel, onset_s=onset_s, size=6.0))
        named = [alarm.sensor for alarm in monitors.monitor("C").watch(broken).alarms if alarm.time_s > onset_s]
        assert named[0] == channel


def test_what_is_dated_later_than_motion_may_be_its_effect_whenever_its_alarm_began():
    alarm = gb.Alarm(number=0, time_s=25.2, onset_s=20.0, source="phi")
    crossing = Crossing(output="phi", row=1260, time_s=25.2, onset_row=1000, test="")
    turned = Excursion(start_s=20.4, end_s=28.0, reason=MOTION)
    monitor = monitors.monitor("C")
    fault = OpenFault(
        alarm=alarm, crossing=crossing, row=1260, looks=(1300,), start=1000, shift={}, monitor=monitor, turned=turned,
        is_diagnosed=True,
    )  # fmt: skip
    assert fault.turned_before() is fault.turned_before(20.45) is None
    assert fault.turned_before(25.1) is turned


@pytest.mark.nightly
def test_a_stream_says_the_same_of_a_roll():
    monitor, record = monitors.monitor("C"), rolled().replace("p", 1.04 * rolled()["p"])
    record = record.part(range(4500))
    for size in (1, 37):
        assert repr(monitors.streamed(monitor, record, size).alarms) == repr(monitor.watch(record).alarms)


@pytest.mark.parametrize("row", [0, 1000, 2990, 3000])
def test_rows_that_were_looked_at_before_need_no_second_look(row):
    """Nothing is beyond before 60 s, row 3000: whoever knows that finds the same."""
    whole = known().excursion(rolled())
    assert known().excursion(rolled(), row) == whole
    assert known().excursion(rolled().part(range(row)), 0) is None


def test_a_pitch_that_jumps_to_the_vertical_is_no_motion_however_late_it_is_looked_at():
    record = monitors.record(5000, seed=21)
    theta = np.where(record.time_s < 60.0, record["theta"], 85.0)
    assert known().excursion(record.replace("theta", theta), 4000) is None
