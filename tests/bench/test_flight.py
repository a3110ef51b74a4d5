"""Flights: bit for bit repeatable, true to kinematics, and refused where the model ends."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.values.channels import CHANNELS


@pytest.fixture(scope="module")
def minute():
    return gb.fly(duration_s=60.0, seed=1)


def test_a_flight_has_every_channel_and_both_ends(minute):
    assert minute.channels == tuple(CHANNELS)
    assert len(minute) == 6001
    assert minute.end_s == 60.0
    assert np.isfinite(minute.values).all()


def test_a_flight_starts_in_trim(minute):
    trim = gb.trim("gtm")
    assert minute["alpha"][0] == pytest.approx(trim.alpha_deg, abs=1e-9)
    assert minute["psi"][0] == pytest.approx(45.0, abs=1e-9)
    assert [minute[rate][0] for rate in "pqr"] == pytest.approx([0, 0, 0], abs=1e-9)
    # level flight reads nz = +1: gravity at 8000 ft and 37 deg north, over standard gravity, times cos(pitch)
    assert minute["nz"][0] == pytest.approx(0.9965, abs=0.001)


@pytest.mark.nightly
def test_the_same_bits_in_threads():
    """`test_same_flight` has them of other processes."""
    with ThreadPoolExecutor(2) as pool:
        flights = pool.map(lambda _: gb.fly(excitation="multisine+turbulence", duration_s=5.0, seed=3), range(4))
        assert len({flight.values.tobytes() for flight in flights}) == 1


@pytest.mark.parametrize("excitation", ["multisine", "turbulence"])
def test_seeds_give_other_flights(excitation):
    first, second = (gb.fly(excitation=excitation, duration_s=5.0, seed=seed) for seed in (1, 2))
    assert np.abs(first["p"] - second["p"]).max() > 0.1


def test_a_longer_flight_begins_like_a_shorter_one(minute):
    short = gb.fly(duration_s=10.0)
    flown = [name for name in CHANNELS if name != "psi"]
    assert (short.matrix(flown) == minute.matrix(flown)[:1001]).all()


def test_body_rates_are_those_of_the_attitude(minute):
    """p = phi' - psi' sin(theta) and so on: truth from the gyros against truth from the attitude."""
    phi, theta, psi = (np.deg2rad(minute[name]) for name in ("phi", "theta", "psi"))
    phi_dot, theta_dot, psi_dot = (np.gradient(angle, 0.01) for angle in (phi, theta, psi))
    expected = {
        "p": phi_dot - psi_dot * np.sin(theta),
        "q": theta_dot * np.cos(phi) + psi_dot * np.cos(theta) * np.sin(phi),
        "r": -theta_dot * np.sin(phi) + psi_dot * np.cos(theta) * np.cos(phi),
    }
    for name, values in expected.items():
        error = minute[name][100:-100] - np.rad2deg(values)[100:-100]
        assert np.abs(error).max() < 0.03, name  # deg/s; a sample of delay would be five times that


def test_load_factors_and_speeds_balance(minute):
    """Specific force = velocity's change in an inertial frame, less gravity: body axes, g at the CG."""
    knots = 1852 / 3600 / 0.3048
    alpha, beta = np.deg2rad(minute["alpha"]), np.deg2rad(minute["beta"])
    speed = minute["tas"] * knots
    u, v, w = speed * np.cos(alpha) * np.cos(beta), speed * np.sin(beta), speed * np.sin(alpha) * np.cos(beta)
    p, q, r, phi, theta = (np.deg2rad(minute[name]) for name in ("p", "q", "r", "phi", "theta"))
    gravity, standard = 32.15, 32.174
    ax = np.gradient(u, 0.01) + q * w - r * v + gravity * np.sin(theta)
    ay = np.gradient(v, 0.01) + r * u - p * w - gravity * np.cos(theta) * np.sin(phi)
    az = np.gradient(w, 0.01) + p * v - q * u - gravity * np.cos(theta) * np.cos(phi)
    for name, values in (("nx", ax), ("ny", ay), ("nz", -az)):
        assert np.abs(minute[name][100:-100] - values[100:-100] / standard).max() < 0.004, name


def test_the_way_flown_is_the_ground_speed_summed(minute):
    way = np.hypot(np.diff(minute["north"]), np.diff(minute["east"])).sum()
    climb = minute["altitude"][-1] - minute["altitude"][0]
    flown = (minute["tas"] * 1852 / 3600 / 0.3048 * 0.01)[:-1].sum()
    assert np.hypot(way, climb) == pytest.approx(flown, rel=0.01)
    assert np.rad2deg(np.arctan2(minute["east"][100], minute["north"][100])) == pytest.approx(45.0, abs=1.0)


def test_the_dissertations_flight_stays_where_the_prototype_stayed():
    flight = gb.fly(duration_s=500.0)
    assert 1.7 < flight["alpha"].min() < flight["alpha"].max() < 3.9
    assert np.abs(flight["beta"][500:]).max() < 1.0
    assert np.abs(flight["phi"]).max() < 36.0
    assert 6700.0 < flight["altitude"].min() < flight["altitude"].max() < 8010.0


def test_rms_of_a_minute_is_that_of_an_independent_model(minute):
    """Figures: RMS about the mean of Runge-Kutta on the same equations in NumPy, written apart."""
    independent = {"p": 8.9817, "q": 2.5079, "r": 2.9478, "beta": 0.5774}
    for name, expected in independent.items():
        assert np.std(minute[name]) == pytest.approx(expected, rel=0.01), name


def test_leaving_the_envelope_is_an_error_that_says_where(copied_gtm):
    folder = copied_gtm("gtm")
    facts = folder / "aircraft.toml"
    facts.write_text(facts.read_text().replace("alpha = [-5.0, 85.0]", "alpha = [2.9, 3.1]"))
    with pytest.raises(gb.EnvelopeError, match=r"'doublets' throws 'gtm'.*alpha is \S+ deg at t = \S+ s.*2.9 to 3.1"):
        gb.fly(str(folder), "doublets", 5.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration_s": 0.0}, "duration_s is 0.0"),
        ({"duration_s": float("nan")}, "duration_s is nan"),
        ({"duration_s": 1e9}, "at most 86400"),
        ({"seed": -1}, "seed is -1"),
        ({"excitation": "loopings"}, "no excitation 'loopings'; there are dissertation, multisine"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(gb.InputError, match=message):
        gb.fly(**arguments)
