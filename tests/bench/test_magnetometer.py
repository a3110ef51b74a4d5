"""A magnetometer: the Earth's field in body axes, what disturbs it, and when it is read."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.other_sensors import Magnetometer, with_magnetometer
from gtmbench.errors import InputError
from gtmbench.values.channels import ATTITUDE, MAGNETOMETER
from gtmbench.values.record import Record

PERFECT = {"soft_iron": 0.0, "noise": 0.0, "rate_hz": 100.0}


def level(*angles, rows=1000):
    return Record([list(angles)] * rows, channels=ATTITUDE, sample_period_s=0.01)


def field(record, **settings):
    return with_magnetometer(record, record, Magnetometer(**settings), seed=3).matrix(MAGNETOMETER)


@pytest.mark.parametrize(
    ("angles", "expected"),
    [
        ((0.0, 0.0, 0.0), (30.0, 0.0, 40.0)),
        ((0.0, 0.0, 90.0), (0.0, -30.0, 40.0)),  # nose east: north is left
        ((90.0, 0.0, 0.0), (30.0, 40.0, 0.0)),  # right wing down: down is right
        ((0.0, 90.0, 0.0), (-40.0, 0.0, 30.0)),  # nose up: down is aft
    ],
)
def test_the_field_is_turned_into_body_axes(angles, expected):
    dip = float(np.rad2deg(np.arctan2(40.0, 30.0)))
    np.testing.assert_allclose(field(level(*angles), inclination_deg=dip, **PERFECT)[0], expected, atol=1e-9)


def test_iron_and_current_add_what_they_should():
    record, perfect = level(10.0, 5.0, 70.0), Magnetometer(**PERFECT)
    iron = Magnetometer(hard_iron_ut=(1.0, -2.0, 3.0), field_per_ampere_ut=(0.1, 0.2, -0.1), **PERFECT)
    current = np.linspace(0.0, 20.0, 1000)
    clean = with_magnetometer(record, record, perfect).matrix(MAGNETOMETER)
    added = with_magnetometer(record, record, iron, current_a=current).matrix(MAGNETOMETER) - clean
    np.testing.assert_allclose(added, np.array([1.0, -2.0, 3.0]) + np.outer(current, [0.1, 0.2, -0.1]), atol=1e-9)


def test_noise_and_soft_iron_have_their_size_and_seed():
    noisy = field(level(0.0, 0.0, 0.0, rows=20000), noise=0.01, soft_iron=0.0, rate_hz=100.0)
    np.testing.assert_allclose(noisy.std(axis=0), 0.5, rtol=0.03)
    bent = field(level(0.0, 0.0, 0.0), soft_iron=0.03, noise=0.0, rate_hz=100.0)[0]
    straight = field(level(0.0, 0.0, 0.0), **PERFECT)[0]
    assert 0.0 < np.abs(bent - straight).max() <= 0.03 * 50.0 * 2.0
    np.testing.assert_array_equal(field(level(0.0, 0.0, 0.0)), field(level(0.0, 0.0, 0.0)))


@pytest.mark.parametrize("rate_hz", [100.0, 50.0, 33.0, 7.0])
def test_it_is_read_at_its_own_rate(rate_hz):
    read = np.isfinite(field(level(0.0, 0.0, 0.0), rate_hz=rate_hz)).all(axis=1)
    assert abs(np.count_nonzero(read) - 10.0 * rate_hz) <= 1.0
    gaps = np.diff(np.flatnonzero(read))
    assert gaps.max() - gaps.min() <= 1


def test_the_other_readings_stay_bit_for_bit():
    truth = gb.fly(duration_s=5.0)
    readings = gb.measure(truth, noise="t2")
    record = with_magnetometer(readings, truth, Magnetometer())
    np.testing.assert_array_equal(record.select(readings.channels).values, readings.values)
    assert record.channels == (*readings.channels, *MAGNETOMETER)


@pytest.mark.parametrize(
    "settings",
    [
        {"strength_ut": 0.0},
        {"strength_ut": np.nan},
        {"inclination_deg": 91.0},
        {"noise": -0.1},
        {"rate_hz": 0.0},
        {"hard_iron_ut": (1.0, 2.0)},
        {"field_per_ampere_ut": (0.0, np.inf, 0.0)},
    ],
)
def test_a_magnetometer_that_cannot_be_is_refused(settings):
    with pytest.raises(InputError):
        Magnetometer(**settings)


def test_records_that_do_not_fit_are_refused():
    record, other = level(0.0, 0.0, 0.0), level(0.0, 0.0, 0.0, rows=999)
    twice = with_magnetometer(record, record, Magnetometer())
    unknown = record.replace("psi", np.full(1000, np.nan))
    for readings, truth, settings, word in [
        (record, other, {}, "rows"),
        (twice, record, {}, "already"),
        (record, unknown, {}, "lacks"),
        (record, record, {"current_a": [1.0]}, "current_a"),
    ]:
        with pytest.raises(InputError, match=word):
            with_magnetometer(readings, truth, Magnetometer(), **settings)
    with pytest.raises(InputError, match="400 Hz"):
        with_magnetometer(record, record, Magnetometer(rate_hz=400.0))
