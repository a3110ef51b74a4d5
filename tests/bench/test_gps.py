"""The GPS receiver of a simulated flight: velocity over ground, late, at its own rate, with noise of a stated size."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.values.channels import GPS_VELOCITY

PERFECT = {"delay_s": 0.0, "noise_m_s": 0.0, "wander_m_s": 0.0}


def flown(speed_m_s=(30.0, -4.0, 2.0), rows=3000, turn=0.0):
    """Return the truth of a way that is straight, or bends sideways by so many m/s2."""
    time_s = 0.01 * np.arange(rows)
    metres = np.outer(time_s, speed_m_s)
    metres[:, 1] += 0.5 * turn * time_s**2
    feet = metres / 0.3048 * [1.0, 1.0, -1.0]
    return gb.Record(feet, channels=["north", "east", "altitude"], sample_period_s=0.01)


def read(truth, **gps):
    return gb.with_gps(truth, truth, gb.Gps(**gps)).matrix(GPS_VELOCITY)


def test_it_reads_the_velocity_over_ground_in_m_s():
    readings = read(flown(), **PERFECT)
    there = np.isfinite(readings).all(axis=1)
    np.testing.assert_allclose(readings[there], np.tile([30.0, -4.0, 2.0], (np.count_nonzero(there), 1)), atol=1e-9)


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 7.0, 100.0])
def test_it_has_a_rate_of_its_own(rate_hz):
    rows = np.flatnonzero(np.isfinite(read(flown(), rate_hz=rate_hz)).all(axis=1))
    assert abs(len(rows) - 30.0 * rate_hz) <= 1.0
    assert np.ptp(np.diff(rows)) <= 1


@pytest.mark.parametrize("delay_s", [0.1, 0.15, 0.2])
def test_it_is_late_by_its_delay(delay_s):
    bent = flown(turn=3.0)
    late, prompt = (read(bent, **{**PERFECT, "delay_s": each})[1000::20, 1] for each in (delay_s, 0.0))
    np.testing.assert_allclose(prompt - late, 3.0 * delay_s, atol=1e-6)


def test_its_noise_is_of_the_stated_size_and_of_its_seed():
    truth = flown(rows=400_000)
    white = read(truth, **{**PERFECT, "noise_m_s": 0.2}, rate_hz=100.0) - [30.0, -4.0, 2.0]
    wandering = read(truth, **{**PERFECT, "wander_m_s": 0.3}, wander_time_s=5.0, rate_hz=100.0) - [30.0, -4.0, 2.0]
    np.testing.assert_allclose(white.std(axis=0), 0.2, rtol=0.02)
    np.testing.assert_allclose(wandering.std(axis=0), 0.3, rtol=0.15)
    after = np.mean(wandering[500:] * wandering[:-500], axis=0) / 0.3**2
    np.testing.assert_allclose(after, np.exp(-1.0), atol=0.15)
    short = flown()
    assert np.array_equal(read(short), read(short), equal_nan=True)
    other = gb.with_gps(short, short, gb.Gps(), seed=2).matrix(GPS_VELOCITY)
    assert not np.array_equal(read(short), other, equal_nan=True)


def test_what_it_cant_be_is_refused():
    truth = flown()
    with pytest.raises(gb.InputError, match="at most that rate_hz"):
        read(truth, rate_hz=200.0)
    with pytest.raises(gb.InputError, match="already"):
        gb.with_gps(gb.with_gps(truth, truth, gb.Gps()), truth, gb.Gps())
    with pytest.raises(gb.InputError, match="the flight that was measured"):
        gb.with_gps(truth.part(range(100)), truth, gb.Gps())
    with pytest.raises(gb.InputError, match="'altitude'"):
        gb.with_gps(truth, truth.select(["north", "east"]), gb.Gps())
    with pytest.raises(gb.InputError, match="delay_s"):
        gb.Gps(delay_s=3.0)


@pytest.mark.parametrize("onset_s", [10.0, 10.03])
def test_a_fault_breaks_its_readings_and_not_the_rows_between_them(onset_s):
    truth = flown(turn=1.0)
    healthy = gb.with_gps(truth, truth, gb.Gps())
    jammed = gb.inject(healthy, gb.Jam(channel="gps_east", onset_s=onset_s))
    there = np.isfinite(healthy["gps_east"])
    assert np.array_equal(there, np.isfinite(jammed["gps_east"]))
    before, after = there & (healthy.time_s < onset_s - 1e-6), there & (healthy.time_s >= onset_s - 1e-6)
    np.testing.assert_array_equal(jammed["gps_east"][before], healthy["gps_east"][before])
    np.testing.assert_array_equal(jammed["gps_east"][after], healthy["gps_east"][before][-1])
