"""Pseudo inputs: exact kinematics to the error of the central difference, and nothing but neighbours spoilt."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, _slope, derivable, derive, raw_needs, reproduces, sensitivities
from gtmbench.values.channels import GYROS
from gtmbench.values.record import Record

G = 9.80665
KT = 1852.0 / 3600.0
ANGLES = ("phi", "theta", "psi")
EPS = np.finfo(float).eps


class Wave:
    """offset + slope t + amplitude sin(omega t + phase), in degrees, and its derivatives."""

    def __init__(self, offset, slope, amplitude, omega, phase):
        self.offset, self.slope, self.amplitude, self.omega, self.phase = offset, slope, amplitude, omega, phase

    def __call__(self, t):
        return self.offset + self.slope * t + self.amplitude * np.sin(self.omega * t + self.phase)

    def rate(self, t):
        return self.slope + self.amplitude * self.omega * np.cos(self.omega * t + self.phase)

    @property
    def third(self):
        """The greatest |x'''|."""
        return abs(self.amplitude) * self.omega**3


def waves(offset, slope, amplitude):
    return st.builds(
        Wave,
        st.floats(-offset, offset),
        st.floats(-slope, slope),
        st.floats(0.0, amplitude),
        st.floats(0.1, 6.0),
        st.floats(0.0, 6.3),
    )


ATTITUDES = st.tuples(waves(100.0, 0.0, 90.0), waves(10.0, 0.0, 70.0), waves(2000.0, 60.0, 100.0))


def exact(attitude, period_s, samples=300):
    """Return a record of an attitude and the body rates that belong to it, by the rotations one after another."""
    t = period_s * np.arange(samples)
    phi, theta, psi = (np.deg2rad(wave(t)) for wave in attitude)
    roll, pitch, yaw = (wave.rate(t) for wave in attitude)
    # heading turns about down, pitch about the level right wing, bank about the nose: seen from the body
    zero = np.zeros(samples)
    one = zero + 1
    to_pitched = np.array(
        [[np.cos(theta), zero, -np.sin(theta)], [zero, one, zero], [np.sin(theta), zero, np.cos(theta)]]
    )
    to_banked = np.array([[zero + 1, zero, zero], [zero, np.cos(phi), np.sin(phi)], [zero, -np.sin(phi), np.cos(phi)]])
    pitched = np.einsum("ijk,jk->ik", to_pitched, np.array([zero, zero, yaw]))
    rates = np.einsum("ijk,jk->ik", to_banked, pitched + np.array([zero, pitch, zero])) + np.array([roll, zero, zero])
    values = [*rates, *np.rad2deg([phi, theta, psi])]
    return Record(np.column_stack(values), channels=["p", "q", "r", *ANGLES], sample_period_s=period_s)


def rounding(record):
    """Return what the last digits of the greatest angle may make of a central difference."""
    return 16.0 * EPS * np.abs(record.values).max() / record.sample_period_s


@given(attitude=ATTITUDES, period_s=st.sampled_from([0.01, 0.04]))
def test_rates_from_the_attitude_are_exact_to_the_error_of_the_central_difference(attitude, period_s):
    record = exact(attitude, period_s)
    derived = derive(record, ["p_att", "q_att", "r_att"])
    phi, theta, psi = (period_s**2 / 6.0 * wave.third for wave in attitude)
    bounds = {"p": phi + psi, "q": theta + psi, "r": theta + psi}
    for gyro, bound in bounds.items():
        error = np.abs(derived[f"{gyro}_att"] - record[gyro])
        assert np.isnan(error[[0, -1]]).all()
        assert error[1:-1].max() <= bound + rounding(record)


@given(
    attitude=st.tuples(waves(20.0, 0.0, 50.0), waves(10.0, 0.0, 60.0), waves(2000.0, 60.0, 100.0)),
    period_s=st.sampled_from([0.01, 0.04]),
)
def test_without_heading_the_yaw_gyro_stands_in_for_it(attitude, period_s):
    record = exact(attitude, period_s)
    derived = derive(record, ["p_turn", "q_turn"])
    roll, pitch, _ = (period_s**2 / 6.0 * wave.third + rounding(record) for wave in attitude)
    phi, theta = (np.deg2rad(record[name]) for name in ("phi", "theta"))
    q_bound = pitch / np.cos(phi)
    p_bound = roll + np.abs(np.tan(theta) * np.sin(phi)) * q_bound
    for gyro, bound in (("q", q_bound), ("p", p_bound)):
        error = np.abs(derived[f"{gyro}_turn"] - record[gyro])
        assert (error[1:-1] <= bound[1:-1] + rounding(record)).all()


@given(attitude=ATTITUDES, turns=st.integers(-50, 50))
def test_where_north_is_doesnt_matter(attitude, turns):
    record = exact(attitude, 0.01)
    turned = record.replace("psi", record["psi"] + 360.0 * turns + 12.5)
    for name in ("p_att", "q_att", "r_att"):
        there, here = derive(turned, [name])[name], derive(record, [name])[name]
        np.testing.assert_allclose(there, here, rtol=0, atol=2.0 * rounding(turned))


@pytest.fixture(scope="module")
def flight():
    return gb.fly("gtm", "multisine+turbulence", 30, seed=4)


def test_on_a_real_flight_the_attitude_gives_the_true_rates(flight):
    # a central difference is the mean of the slope over two periods: between the slope's least and greatest value
    # there, where the flight's integrator (second order) takes in the sample before
    derived = derive(flight, ["p_att", "q_att", "r_att"])
    phi, theta = (np.deg2rad(flight[name]) for name in ("phi", "theta"))
    p, q, r = (flight[name] for name in "pqr")
    psi_rate = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
    slopes = {
        "phi": p + psi_rate * np.sin(theta),
        "theta": q * np.cos(phi) - r * np.sin(phi),
        "psi": psi_rate,
    }

    def spread(values):
        around = np.lib.stride_tricks.sliding_window_view(values, 4)  # k-2..k+1
        bound = np.full(len(values), np.nan)
        bound[2:-1] = np.abs(around - values[2:-1, np.newaxis]).max(axis=1)
        return bound

    free = {name: spread(values) for name, values in slopes.items()}
    bounds = {"p": free["phi"] + free["psi"], "q": free["theta"] + free["psi"], "r": free["psi"] + free["theta"]}
    for gyro, bound in bounds.items():
        error = np.abs(derived[f"{gyro}_att"] - flight[gyro])
        assert (error[2:-1] <= bound[2:-1] + 1e-6).all()
        assert np.nanmean(np.square(error)) < 0.1 * gb.CHANNELS[gyro].noise ** 2  # 5 % more noise to a real gyro


# lateral acceleration


def steady(turn, phi, theta, alpha, beta, tas):
    """Return the record of a steady turn at `turn` deg/s; ny from the balance across: r u - p w = g (sin.. + ny)."""
    bank, pitch = np.deg2rad(phi), np.deg2rad(theta)
    p, r = -turn * np.sin(pitch), turn * np.cos(pitch) * np.cos(bank)
    u = tas * KT * np.cos(np.deg2rad(alpha)) * np.cos(np.deg2rad(beta))
    w = tas * KT * np.sin(np.deg2rad(alpha)) * np.cos(np.deg2rad(beta))
    ny = (np.deg2rad(r) * u - np.deg2rad(p) * w) / G - np.sin(bank) * np.cos(pitch)
    row = [p, turn * np.cos(pitch) * np.sin(bank), r, phi, theta, alpha, beta, ny, tas]
    names = ["p", "q", "r", "phi", "theta", "alpha", "beta", "ny", "tas"]
    return Record(np.tile(row, (5, 1)), channels=names, sample_period_s=0.01)


@given(
    turn=st.floats(-40.0, 40.0),
    phi=st.floats(-80.0, 80.0),
    theta=st.floats(-60.0, 60.0),
    alpha=st.floats(-20.0, 20.0),
    beta=st.floats(-20.0, 20.0),
    tas=st.floats(20.0, 200.0),
)
def test_the_yaw_rate_of_a_steady_turn_follows_from_lateral_acceleration(turn, phi, theta, alpha, beta, tas):
    record = steady(turn, phi, theta, alpha, beta, tas)
    rates = derive(record, ["r_lat", "q_lat", "p_lat"]).values[2, -3:]
    # bank stands still, so what is left out is the roll rate of a turn with the nose up: p tan alpha
    left_out = record["p"][0] * np.tan(np.deg2rad(alpha))
    assert rates[0] == pytest.approx(record["r"][0] - left_out, rel=1e-9, abs=1e-9)
    bank, pitch = np.deg2rad(phi), np.deg2rad(theta)
    q, p = record["q"][0] - left_out * np.tan(bank), record["p"][0] + left_out * np.tan(pitch) / np.cos(bank)
    np.testing.assert_allclose(rates[1:], [q, p], rtol=1e-9, atol=1e-9)


def test_on_a_real_flight_lateral_acceleration_balances():
    # in still air: r_lat = r + v'/u + (phi' - p) tan alpha, but for gravity (0.3 % over the earth) and the derivative
    flight = gb.fly("gtm", "multisine", 30, seed=4)
    derived = derive(flight, ["r_lat", "phi_rate"])
    angle = {name: np.deg2rad(flight[name]) for name in ("alpha", "beta", "phi", "theta")}
    u = flight["tas"] * KT * np.cos(angle["alpha"]) * np.cos(angle["beta"])
    slip = np.gradient(flight["tas"] * KT * np.sin(angle["beta"]), 0.01)
    expected = flight["r"] + np.rad2deg(slip / u) + (derived["phi_rate"] - flight["p"]) * np.tan(angle["alpha"])
    error = (derived["r_lat"] - expected)[2:-2]
    gravity = 0.005 * np.rad2deg(G / u.min()) * np.abs(np.sin(angle["phi"])).max()
    derivative = np.abs(np.diff(np.rad2deg(slip / u))).max()
    assert np.abs(error).max() < gravity + derivative
    assert np.std(error) < 0.1 * np.std(flight["r"])


@pytest.mark.parametrize("name", ["q_air", "r_air"])
def test_on_a_real_flight_in_still_air_the_velocity_turns_as_the_gyros_say(name):
    # but for gravity and turning over a round earth, and the derivative
    flight = gb.fly("gtm", "multisine", 30, seed=4)
    gyro = flight[name[0]]
    error = (derive(flight, [name])[name] - gyro)[2:-2]
    assert np.abs(error).max() < 0.05 * np.abs(gyro).max()
    assert np.std(error) < 0.04 * np.std(gyro)


@pytest.mark.parametrize("beta", [0.0, 8.0, -5.0])
@pytest.mark.parametrize("name", ["q_air", "r_air"])
def test_a_steady_turn_is_what_forces_and_gravity_make_of_the_velocity(name, beta):
    record = steady(turn=12.0, phi=35.0, theta=4.0, alpha=3.0, beta=beta, tas=100.0)
    bank, pitch, attack, slip = np.deg2rad([35.0, 4.0, 3.0, beta])
    p, q, r = (np.deg2rad(record[each][0]) for each in "pqr")
    along = np.array([np.cos(attack) * np.cos(slip), np.sin(slip), np.sin(attack) * np.cos(slip)])
    force = np.cross([p, q, r], 100.0 * KT * along) / G  # of a velocity that stands still in the body
    gravity = np.array([-np.sin(pitch), np.cos(pitch) * np.sin(bank), np.cos(pitch) * np.cos(bank)])
    nx, ny, nz = (force - gravity) * [1.0, 1.0, -1.0]
    values = np.column_stack([record.values, np.full(5, nx), np.full(5, nz)])
    felt = Record(values, channels=[*record.channels, "nx", "nz"], sample_period_s=0.01)
    assert felt["ny"][0] == pytest.approx(ny)
    assert derive(felt, [name])[name][2] == pytest.approx(record[name[0]][0], rel=1e-9)


def test_standing_still_lateral_acceleration_says_nothing():
    record = steady(0.0, 0.0, 0.0, 0.0, 0.0, tas=1.0)
    assert np.isnan(derive(record, ["r_lat"])["r_lat"]).all()


# names, missing samples, other channels


RAW = sorted({raw for name in PSEUDO_INPUTS for raw in raw_needs(name)})


def sensors(samples=40):
    values = np.random.default_rng(2).uniform(-20.0, 20.0, (samples, len(RAW)))
    values[:, RAW.index("tas")] += 100.0
    return Record(values, channels=RAW, sample_period_s=0.02, start_s=7.0)


@pytest.mark.parametrize("name", PSEUDO_INPUTS)
def test_a_missing_sample_spoils_its_neighbours_only(name):
    record = sensors()
    whole = derive(record, [name])[name]
    assert np.isfinite(whole[1:-1]).all()
    for raw in raw_needs(name):
        gap = np.array(record[raw])
        gap[17] = np.nan
        gappy = derive(record.replace(raw, gap), [name])[name]
        spoilt = np.flatnonzero(np.isnan(gappy[1:-1])) + 1
        assert 0 < len(spoilt) <= 3
        assert set(spoilt) <= {16, 17, 18}
        kept = ~np.isnan(gappy)
        np.testing.assert_array_equal(gappy[kept], whole[kept])


@pytest.mark.parametrize("name", PSEUDO_INPUTS)
def test_only_what_it_needs_is_asked_for(name):
    record = sensors()
    needed = record.select(sorted(raw_needs(name)))
    np.testing.assert_array_equal(derive(needed, [name])[name], derive(record, [name])[name])
    for raw in raw_needs(name):
        fewer = [other for other in record.channels if other != raw]
        assert name not in derivable(fewer)
        with pytest.raises(InputError, match=rf"'{name}' needs .*, and {raw} isn't there; .*can be built: "):
            derive(record.select(fewer), [name])


def test_what_can_be_built_instead_can_be_built():
    record = sensors().select(["phi", "theta", "r"])
    with pytest.raises(InputError, match=r"psi isn't there; .* built: q_turn, p_turn, phi_rate, theta_rate$"):
        derive(record, ["p_att"])
    assert derivable(record.channels) == ("q_turn", "p_turn", "phi_rate", "theta_rate")
    assert derive(record, derivable(record.channels)).channels == (*record.channels, *derivable(record.channels))
    with pytest.raises(InputError, match="can be built: none"):
        derive(sensors().select(["r"]), ["p_att"])
    with pytest.raises(InputError, match="no channel and no pseudo input 'p_atti'; there are p_att, "):
        derive(record, ["p_atti"])


def test_other_channels_and_times_stay_bit_for_bit():
    record = sensors()
    given = Record(
        np.column_stack([record.values, np.arange(40.0)]),
        channels=[*RAW, "p_att"],
        sample_period_s=0.02,
        start_s=7.0,
    )
    derived = derive(given, ["q_lat", "p_att", "phi"])  # somebody's own p_att, and a channel, are left as they are
    assert derived.channels == (*given.channels, "q_lat")
    np.testing.assert_array_equal(derived.values[:, :-1], given.values)
    np.testing.assert_array_equal(derived.time_s, given.time_s)
    assert derive(given, ["p_att"]) is given


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_a_record_without_three_samples_has_no_derivative(samples):
    derived = derive(sensors(samples), list(PSEUDO_INPUTS))
    assert len(derived) == samples
    assert np.isnan(derived.matrix(list(PSEUDO_INPUTS))).all()


def test_an_operator_takes_a_pseudo_input_like_a_channel(flight):
    # a gyro behind a moving mean of three samples: FIR coefficients of a third each, from the kinematics alone
    sensed = derive(gb.measure(flight, noise="t2", seed=1), ["p_att"])  # noise tells the lags apart
    record = sensed.replace("p", np.convolve(sensed["p_att"], np.ones(3) / 3.0, mode="same"))
    there = np.isfinite(record.values).all(axis=1)
    setup = {"inputs": ["p_att"], "outputs": ["p"], "causal_order": 2, "noncausal_order": 2}
    weighted = gb.identify(record, weights=there.astype(float), **setup)
    cut = gb.identify(record.between(0.02, 29.98), **setup)
    for operator in (weighted, cut):
        np.testing.assert_allclose(operator.markov.ravel(), [0.0, 1 / 3, 1 / 3, 1 / 3, 0.0], atol=1e-6)


@pytest.mark.parametrize("samples", [0, 1, 2, 3, 4095, 4096, 4097, 4098, 8193, 10_000])
def test_a_long_record_gives_what_its_parts_give(samples):
    random = np.random.default_rng(1)
    values = np.cumsum(random.standard_normal((samples, 3)), axis=0)
    record = Record(values, channels=ANGLES, sample_period_s=0.01)
    whole = derive(record, ["q_att", "psi_rate"]).values[:, 3:]
    expected = np.full((samples, 2), np.nan)
    for row in range(1, samples - 1):
        if row % 97 in (0, 1) or not 10 < row % 4096 < 4086:
            near = Record(values[row - 1 : row + 2], channels=ANGLES, sample_period_s=0.01)
            expected[row] = derive(near, ["q_att", "psi_rate"]).values[1, 3:]
    there = np.isfinite(expected[:, 0])
    np.testing.assert_array_equal(whole[there], expected[there])
    assert np.isnan(whole[:1]).all()
    assert np.isnan(whole[samples - 1 :]).all()
    assert np.isfinite(whole[1:-1]).all()


def test_a_rate_of_the_attitude_reproduces_the_gyro_that_it_is_named_after():
    of = {name: item.reproduces for name, item in PSEUDO_INPUTS.items() if item.reproduces}
    assert {of[f"{gyro}_att"] for gyro in GYROS} == set(of.values()) == set(GYROS)
    assert all(name.startswith(f"{gyro}_") and reproduces(name, gyro) for name, gyro in of.items())


def test_a_pseudo_input_is_as_sensitive_to_an_angle_and_its_slope_as_its_formula_says():
    """q = theta' cos phi + psi' cos theta sin phi, and so on: by theta, and by its slope."""
    rows = np.arange(3.0)
    phi, theta, psi = np.full(3, 20.0), 10.0 + 2.0 * (rows - 1.0), 5.0 * rows
    record = Record(np.column_stack([phi, theta, psi]), channels=["phi", "theta", "psi"], sample_period_s=1.0)
    sin, cos = np.sin(np.radians(20.0)), np.cos(np.radians(20.0))
    turn, tilt = np.radians(5.0), np.radians(10.0)  # psi' and theta
    expected = {
        "p_att": (-turn * np.cos(tilt), 0.0),
        "q_att": (-turn * np.sin(tilt) * sin, cos),
        "r_att": (-turn * np.sin(tilt) * cos, -sin),
    }
    found = sensitivities(record, list(expected), "theta")[:, :, 1]
    np.testing.assert_allclose(found, list(expected.values()), atol=1e-5)


def test_a_slope_is_a_central_difference_and_whole_turns_are_none():
    turning = np.array([340.0, 350.0, 0.0, 10.0, 20.0 + 3600.0, 30.0 - 3600.0])
    np.testing.assert_allclose(_slope(np.radians(turning), 0.5)[1:-1], np.radians(20.0))
    np.testing.assert_allclose(_slope(np.array([0.0, 1.0, 3.0]), 0.5), [np.nan, 3.0, np.nan])  # under half a turn
