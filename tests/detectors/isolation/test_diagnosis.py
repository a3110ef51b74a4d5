"""Diagnosis: which sensor, what kind, how much; and nothing is said before it could be known.

On made-up records; `test_watched_studies` has a drift, a saturation and a jam in flights of the GTM.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import MISSING
from gtmbench.errors import InputError
from gtmbench.values.record import Record
from tests.helpers import monitors
from tests.helpers.night import by_day

GYROS = ("p", "q", "r")
ONSET_S = 60.0


@pytest.fixture(scope="module")
def monitor():
    return monitors.monitor("C")


@pytest.fixture(scope="module")
def truth():
    return monitors.truth(6000, seed=11)


@pytest.fixture(scope="module")
def healthy():
    return monitors.record(6000, seed=11)


def test_a_family_that_is_left_out_names_no_kind_and_raises_the_same_alarms(monitor, healthy):
    broken = gb.inject(healthy, gb.Jam(channel="q", onset_s=ONSET_S))
    (known,), (unheard_of,) = monitor.watch(broken).alarms, monitor.watch(broken, without=["replacing"]).alarms
    assert (unheard_of.time_s, unheard_of.source) == (known.time_s, known.source)
    assert "q" in unheard_of.candidates
    assert "jam" not in {judged.kind for judged in unheard_of.judgements}
    with pytest.raises(InputError, match=r"no family of hypotheses is called 'jams'; they are additive, "):
        monitor.watch(healthy, without=["jams"])


@pytest.mark.parametrize("fault", by_day([partial(gb.Drift, slope=5.0), gb.Jam]), ids=["drift", "jam"])
@pytest.mark.parametrize("channel", ["phi", "theta", "psi"])
def test_a_fault_of_an_angle_is_one_of_the_reference(monitor, healthy, channel, fault):
    finding = gb.watch(monitor, gb.inject(healthy, fault(channel=channel, onset_s=ONSET_S))).alarms[0]
    assert finding.verdict == f"reference attitude failed ({channel})"


def test_a_healthy_record_gives_no_finding(monitor, healthy):
    watch = gb.watch(monitor, healthy)
    assert watch.alarms == ()
    assert watch.alarm_s is None
    assert all(np.nanmax(score.values) <= 1.0 for score in watch.scores.values())


@pytest.mark.parametrize("channel", by_day(GYROS))
def test_a_fault_that_ends_is_said_to_end_and_the_next_is_found(monitor, healthy, channel):
    once = gb.inject(healthy, gb.Jam(channel=channel, onset_s=51.0, duration_s=15.0))
    again = gb.inject(once, gb.Drift(channel=channel, onset_s=90.0, slope=1.0))
    watch = gb.watch(monitor, again)
    assert [finding.sensor for finding in watch.alarms] == [channel, channel]
    first, second = watch.alarms
    assert first.ended_s == pytest.approx(66.0, abs=1.0)
    assert (first.verdict, first.last.kind) == (f"{channel} failed", "jam")
    assert second.time_s > 90.0 >= first.end_known_s
    assert second.last.kind == "drift"


def test_the_papers_operator_cant_say_who(healthy):
    drift = gb.Drift(channel="r", onset_s=ONSET_S, slope=5.0)
    (alarm, *_) = gb.watch(monitors.monitor("paper"), gb.inject(healthy, drift)).alarms
    assert alarm.time_s > ONSET_S
    assert set(alarm.last.candidates) == {"p", "q", "r", "beta"}
    assert alarm.verdict.startswith("undecided: ")
    assert alarm.isolated_s is None


# virtual sensors, gaps, rates


@pytest.mark.parametrize("channel", GYROS)
def test_the_virtual_sensor_of_a_jammed_gyro_is_close_to_the_truth(monitor, truth, healthy, channel):
    watch = gb.watch(monitor, gb.inject(healthy, gb.Jam(channel=channel, onset_s=ONSET_S)))
    error = watch.virtual(channel)[3000:-6] - truth[channel][3000:-6]
    # better than the gyro itself, its noise being averaged over the operator's 11 samples
    assert np.sqrt(np.mean(np.square(error))) < gb.CHANNELS[channel].noise
    assert np.isnan(watch.virtual(channel)[-6:]).all()
    assert watch.virtual("tas").shape == (len(healthy),)


def test_the_virtual_sensor_of_a_jammed_angle_is_carried_on_by_the_gyros(monitor, truth, healthy):
    watch = gb.watch(monitor, gb.inject(healthy, gb.Jam(channel="psi", onset_s=ONSET_S)))
    # noise n of a gyro at 50 Hz walks by n sqrt(t / 50) deg; q's counts too in a bank: 5 deviations
    walk = 5.0 * np.hypot(gb.CHANNELS["r"].noise, gb.CHANNELS["q"].noise) * np.sqrt(10.0 / 50.0)
    error = (watch.virtual("psi") - truth["psi"])[3000:3500]
    assert np.abs(error).max() < walk + 5.0 * gb.CHANNELS["psi"].noise


def gaps(record):
    rng = np.random.default_rng(1)
    for channel in ("p", "r", "psi", "theta"):
        values = np.array(record[channel])
        values[rng.integers(0, len(values), 20)] = np.nan
        begin = rng.integers(500, 2500)
        values[begin : begin + 125] = np.nan
        record = record.replace(channel, values)
    return record


def others(watch):
    """Return the alarms that tell of something else than missing samples."""
    return [alarm for alarm in watch.alarms if alarm.test != MISSING]


def test_gaps_are_told_raise_no_other_alarm_and_hide_no_fault(monitor, healthy):
    watch = gb.watch(monitor, gaps(healthy))
    # a hole of 2.5 s in one channel while the others live is a dropout that ends; single samples are nothing
    assert others(watch) == []
    assert {alarm.sensor for alarm in watch.alarms} == {"p", "r", "psi", "theta"}
    assert all(2.5 - 1e-9 <= alarm.ended_s - alarm.onset_s < 4.5 for alarm in watch.alarms)  # 2 s before are looked at
    for fault in (gb.Jam(channel="p", onset_s=ONSET_S), gb.Drift(channel="q", onset_s=ONSET_S, slope=0.5)):
        finding = others(gb.watch(monitor, gaps(gb.inject(healthy, fault))))[0]
        assert (finding.sensor, finding.last.kind) == (fault.channel, fault.kind)


@pytest.mark.parametrize("samples", [0, 1, 30, 500])
def test_a_record_too_short_to_judge_is_quiet(monitor, healthy, samples):
    part = Record(healthy.values[:samples], channels=healthy.channels, sample_period_s=0.02)
    watch = gb.watch(monitor, part)
    assert watch.alarms == ()
    assert watch.virtual("p").shape == (samples,)


def test_a_record_that_ends_with_its_alarm_leaves_it_to_the_signatures(monitor, healthy):
    broken = gb.inject(healthy, gb.Jam(channel="p", onset_s=ONSET_S))
    alarm_s = gb.watch(monitor, broken).alarm_s
    finding = gb.watch(monitor, broken.between(0.0, alarm_s)).alarms[0]
    assert finding.sensor is None
    assert finding.last.candidates == ("p", "phi", "theta", "psi")  # whose fault enters the residual of p


def test_another_sample_period_is_refused(monitor, healthy):
    with pytest.raises(InputError, match=r"sampled every 0.2 s, the monitor was calibrated at 0.02 s"):
        gb.watch(monitor, gb.decimate(healthy, 10))


def test_at_a_low_rate_it_judges_as_well():
    # 10 Hz: the first horizon holds 5 samples only
    records = [monitors.record(2400, seed=seed, period_s=0.1) for seed in range(1, 5)]
    bank = gb.load_bank("C")
    bank = replace(
        bank, residuals=tuple(replace(residual, look_back_s=0.3, look_ahead_s=0.3) for residual in bank.residuals)
    )
    monitor = gb.calibrate(records[:3], bank=bank)
    finding = gb.watch(monitor, gb.inject(records[3], gb.Drift(channel="q", onset_s=150.0, slope=1.0))).alarms[0]
    assert (finding.sensor, finding.last.kind) == ("q", "drift")
    assert len(finding.judgements) > 3


@pytest.mark.parametrize("seed", [12, 14])
def test_an_oscillating_gyro_is_never_its_angle(monitor, seed):
    """Where what reads anything, as the angle, is decisively better than the same as the gyro: seeds of 1..14."""
    fault = gb.Oscillation(channel="p", onset_s=60.0, amplitude=1.5, frequency_hz=2.0)
    (finding,) = gb.watch(monitor, gb.inject(monitors.record(6000, seed=seed), fault)).alarms
    assert finding.last.kind == "oscillation"
    assert "p" in finding.candidates
    assert set(finding.candidates) <= {"p", "phi"}
