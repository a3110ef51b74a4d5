"""The attitude filter: true to kinematics with healthy gyros, off by tau b with biased ones, and causal."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmbench as gb
from gtmbench.bench.attitude_filter import filtered_attitude
from gtmbench.errors import InputError
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record

PERIOD_S = 0.01
NAMES = [*GYROS, *ATTITUDE]
FIVE = 5.0  # standard errors


@pytest.fixture(scope="module")
def flight():
    return gb.fly("gtm", "multisine+turbulence", 60, seed=3)


def motion(samples, period_s=PERIOD_S, **values):
    """Return a record of gyros and attitude; what isn't given is zero."""
    columns = [np.broadcast_to(values.get(name, 0.0), samples) for name in NAMES]
    return Record(np.column_stack(columns), channels=NAMES, sample_period_s=period_s)


def filtered(record, tau, noise=0.0, **settings):
    return filtered_attitude(record, time_constant_s=tau, reference_noise_deg=noise, **settings)


def unaided(record):
    """Return the record whose reference tells the first sample only: what the filter makes of the gyros alone."""
    for name in ATTITUDE:
        record = record.replace(name, np.where(np.arange(len(record)) == 0, record[name], np.nan))
    return record


# kinematics


def test_a_steady_turn_is_followed_exactly():
    phi, theta, turn = np.deg2rad(30.0), np.deg2rad(5.0), 12.0
    record = motion(
        6000,
        p=-turn * np.sin(theta),
        q=turn * np.cos(theta) * np.sin(phi),
        r=turn * np.cos(theta) * np.cos(phi),
        phi=30.0,
        theta=5.0,
        psi=350.0 + turn * PERIOD_S * np.arange(6000),
    )
    for given in (record, unaided(record)):
        np.testing.assert_allclose(filtered(given, 2.0).values[:, 3:], record.values[:, 3:], rtol=0, atol=1e-9)


def coning(period_s):
    """Return a motion of constant body rates, its attitude by rotation matrices."""
    time_s = np.arange(round(4.0 / period_s) + 1) * period_s
    rates = {"p": 40.0, "q": -12.0, "r": 20.0}
    turned = Rotation.from_rotvec(np.deg2rad(np.outer(time_s, list(rates.values()))))
    start = Rotation.from_euler("ZYX", [45.0, 10.0, -20.0], degrees=True)
    psi, theta, phi = (np.unwrap(angle, period=360.0) for angle in (start * turned).as_euler("ZYX", degrees=True).T)
    return motion(len(time_s), period_s, **rates, phi=phi, theta=theta, psi=psi)


def test_the_integration_is_of_second_order():
    errors = []
    for period_s in (0.02, 0.01, 0.005):
        truth = coning(period_s)
        assert 20.0 < np.abs(truth["theta"]).max() < 80.0
        errors.append(np.abs(filtered(unaided(truth), 1.0).values - truth.values)[:, 3:].max(axis=0))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_array_equal(np.round(orders), 2.0)


# faults of gyros


@pytest.mark.parametrize(("gyro", "angle"), [("p", "phi"), ("q", "theta"), ("r", "psi")])
@pytest.mark.parametrize("tau", [0.5, 2.0])
def test_a_bias_shifts_the_attitude_by_tau_times_itself_in_level_flight(gyro, angle, tau):
    attitude = filtered(motion(4000, **{gyro: 0.7}), tau)
    forgotten = (tau / (tau + PERIOD_S)) ** np.arange(4000)
    np.testing.assert_allclose(attitude[angle], tau * 0.7 * (1.0 - forgotten), rtol=1e-9)
    for other in set(ATTITUDE) - {angle}:
        assert (attitude[other] == 0.0).all()


@pytest.mark.parametrize("gyro", GYROS)
def test_a_fault_changes_its_sample_and_later_ones_only(flight, gyro):
    broken = flight.replace(gyro, flight[gyro] + np.where(np.arange(len(flight)) >= 2000, 5.0, 0.0))
    healthy, faulty = (filtered(record, 2.0, 0.5) for record in (flight, broken))
    changed = (healthy.select(ATTITUDE).values != faulty.select(ATTITUDE).values).any(axis=1)
    assert not changed[:2000].any()
    assert changed[2000:].all()


# the reference


def test_without_a_time_constant_the_attitude_is_the_reference(flight):
    np.testing.assert_array_equal(filtered(flight, 0.0).values, flight.values)
    noisy, short = filtered(flight, 0.0, 0.5), filtered(flight, 1e-9, 0.5)
    # of the way to the prediction, a = 1e-7 is left: some degrees of noise and of a sample's motion
    np.testing.assert_allclose(short.values, noisy.values, rtol=0, atol=1e-7 * 10.0)


def test_the_reference_has_white_noise_of_the_size_given_from_the_second_sample_on(flight):
    added = (filtered(flight, 0.0, 0.5).values - flight.values)[:, [flight.channels.index(name) for name in ATTITUDE]]
    assert (added[0] == 0.0).all()
    unit, count = added[1:].T / 0.5, len(flight) - 1
    np.testing.assert_allclose(np.std(unit, axis=1), 1.0, rtol=FIVE / np.sqrt(2 * count))
    assert np.abs(np.mean(unit, axis=1)).max() < FIVE / np.sqrt(count)
    assert np.abs(np.mean(unit[:, 1:] * unit[:, :-1], axis=1)).max() < FIVE / np.sqrt(count)
    measured = gb.measure(flight, noise="t2", seed=1)
    others = [measured[name][1:] - flight[name][1:] for name in ATTITUDE]
    correlation = np.corrcoef([*unit, *others])
    assert np.abs(correlation - np.eye(6)).max() < FIVE / np.sqrt(count)


def test_the_filter_weakens_the_noise_of_the_reference_as_documented():
    tau, samples = 0.1, 50_001
    a = tau / (tau + PERIOD_S)
    settled = filtered(motion(samples), tau, 0.5).values[200:, 3:]  # a^200 is 5e-9
    # the standard error of an autoregression's variance
    error = np.sqrt(2.0 / samples * (1.0 + a**2) / (1.0 - a**2))
    np.testing.assert_allclose(np.var(settled, axis=0), 0.25 * PERIOD_S / (2.0 * tau + PERIOD_S), rtol=FIVE * error)


def test_every_seed_gives_its_own_bits(flight):
    first, again, other = (filtered(flight, 2.0, 0.5, seed=seed).select(ATTITUDE).values for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first[1:] != other[1:]).all()
    np.testing.assert_array_equal(first[0], other[0])


# missing samples


def test_a_missing_rate_is_held():
    rates = np.random.default_rng(1).normal(0.0, 10.0, 500)
    missing = rates.copy()
    missing[[0, 1, 100, 101, 102, 499]] = np.nan
    rates[[0, 1]] = 0.0
    rates[[100, 101, 102, 499]] = rates[[99, 99, 99, 498]]
    for gyro in GYROS:
        held, known = (filtered(motion(500, **{gyro: values}, theta=3.0), 2.0) for values in (missing, rates))
        for name in ATTITUDE:
            np.testing.assert_array_equal(held[name], known[name])
        np.testing.assert_array_equal(held[gyro], missing)


def test_a_missing_reference_leaves_its_angle_to_the_gyros():
    phi = np.full(500, 7.0)
    phi[1:] = np.nan
    attitude = filtered(motion(500, p=2.0, phi=phi, psi=45.0), 0.5, 0.5)
    np.testing.assert_allclose(attitude["phi"], 7.0 + 2.0 * PERIOD_S * np.arange(500), rtol=1e-12)
    assert np.std(attitude["psi"]) > 0.0


# what is refused


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (motion(10).select(["p", "q", "phi", "theta", "psi"]), "no channel 'r' in this record"),
        (motion(10).select(["p", "q", "r", "phi"]), "no channel 'theta', 'psi' in this record"),
        (motion(10, psi=np.nan), "'psi' has no first sample"),
        (motion(0), "'phi' has no first sample"),
        (motion(10, phi=[179.0] * 4 + [-179.0] * 6), r"'phi' jumps by more than 180 deg at 0.04 s; unwrap it"),
        (motion(10, psi=[359.0] * 4 + [1.0] * 6), "'psi' jumps by more than 180 deg"),
        (motion(10, q=np.inf), r"'q' exceeds 1e\+06 deg/s"),
        (motion(10, r=-1e300), r"'r' exceeds 1e\+06 deg/s"),
        (motion(10, theta=89.0), r"theta reaches 89 deg at 0.01 s; .* end near \+-90 deg"),
        (motion(2000, q=30.0), r"theta reaches 85.\d+ deg at \d+.\d+ s; .*time constant or a milder fault"),
        (motion(2000, q=-30.0), r"theta reaches -85.\d+ deg"),
        (motion(10, q=9e3), "theta reaches 90 deg"),
        ([1.0], "a list was given for a Record"),
    ],
)
def test_records_it_cant_filter_are_refused(record, message):
    with pytest.raises(InputError, match=message) as refusal:
        filtered(record, 20.0)
    assert "\n" not in str(refusal.value)
