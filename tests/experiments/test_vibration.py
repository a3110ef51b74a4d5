"""Plate and drum: modes, exact sampling, and a fit in rational numbers, each held against another way to it."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from theory.exact_fit import exact_weights, left_over
from theory.nested import count, nested_operators, norms
from theory.plate import Plate
from theory.state_space import StateSpace
from theory.vibration import Held, Modes, Sinusoids, measured, simulate, unforced

FORCES = [(0.3, 0.3), (1.0, 1.0), (4.0, 0.25)]
SENSORS = [(0.5, 0.1), (1.0, 0.5), (3.0, 0.75)]
PLATE = Plate().modes(forces=FORCES, sensors=SENSORS, damping=0.05)
WAVES = Sinusoids(amplitude=np.array([600.0, 500.0, 300.0]), omega=np.array([5.0, 10.0, 20.0]), samples=1500)
NOTED_HZ = "0.340561 2.12627 3.38377 10.5836 11.1094 29.6881 66.9614 70.316 91.1428"


def test_the_plates_frequencies_are_the_noted_ones_to_six_digits():
    assert " ".join(f"{frequency:.6g}" for frequency in PLATE.frequency_hz) == NOTED_HZ


def test_the_energies_are_those_of_gauss_quadrature_on_numerical_polynomials():
    plate = Plate(a=2.0, b=0.7)
    nodes, weights = np.polynomial.legendre.leggauss(8)  # exact to degree 15
    x, y = plate.a * (nodes + 1) / 2, plate.b * (nodes + 1) / 2
    area = np.outer(weights, weights) * plate.a * plate.b / 4
    poly = np.polynomial.polynomial

    def field(dx, dy):
        along = [poly.polyval(x, poly.polyder(np.eye(5)[i], dx)) for i in (2, 3, 4)]
        across = [poly.polyval(y, poly.polyder(np.eye(3)[j], dy)) for j in (0, 1, 2)]
        return np.array([np.outer(u, v) for u in along for v in across])

    def energy(left, right):
        return np.einsum("mxy,nxy,xy->mn", left, right, area)

    xx, yy, xy, nu = field(2, 0), field(0, 2), field(1, 1), plate.poisson
    bending = energy(xx + yy, xx + yy) - (1 - nu) * (energy(xx, yy) + energy(yy, xx) - 2 * energy(xy, xy))
    np.testing.assert_allclose(plate.stiffness(), plate.rigidity * bending, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(plate.mass(), plate.density * plate.h * energy(field(0, 0), field(0, 0)), rtol=1e-12)


def integrated(modes, force, stiffness, times):
    """Return the sensors by Runge and Kutta's way."""
    n = len(modes.omega)

    def slope(t, x):
        push = modes.driven @ force(t) - 2 * modes.rate * x[n:] - stiffness(t) * modes.omega**2 * x[:n]
        return np.concatenate([x[n:], push])

    solution = scipy.integrate.solve_ivp(
        slope, (0, times[-1]), np.zeros(2 * n), t_eval=times, rtol=1e-10, atol=1e-14, method="DOP853", max_step=0.01
    )
    return solution.y[:n].T @ modes.heard.T


SLOW = Modes(omega=PLATE.omega[:4], damping=0.05, driven=PLATE.driven[:4], heard=PLATE.heard[:, :4])


def test_held_forces_and_a_stiffness_that_steps_carry_the_state_over():
    values = np.random.default_rng(1).standard_normal((40, 3)) * WAVES.amplitude
    factor = np.where(np.arange(40) < 20, 1.0, 0.7)
    record = simulate(SLOW, Held(values=values), sample_period_s=0.05, stiffness=factor[:, np.newaxis])
    x = np.zeros(8)
    for k in range(40):  # the matrix exponential of one mode matrix, force and all
        np.testing.assert_allclose(record.values[k], SLOW.heard @ x[:4], atol=1e-12)
        a = np.block([[np.zeros((4, 4)), np.eye(4)], [-np.diag(factor[k] * SLOW.omega**2), -np.diag(2 * SLOW.rate)]])
        push = np.concatenate([np.zeros(4), SLOW.driven @ values[k]])
        whole = scipy.linalg.expm(0.05 * np.block([[a, push[:, np.newaxis]], [np.zeros((1, 9))]]))
        x = (whole @ np.append(x, 1.0))[:8]


def test_sinusoids_under_a_changing_stiffness_are_those_of_an_integration():
    factor = 1.0 - 0.2 * (np.arange(1500) >= 700)
    expected = integrated(
        SLOW,
        lambda t: WAVES.amplitude * np.sin(WAVES.omega * t),
        lambda t: 1.0 - 0.2 * (t >= 0.7),
        0.001 * np.arange(1500),
    )
    simulated = simulate(SLOW, WAVES, sample_period_s=0.001, stiffness=factor[:, np.newaxis]).values
    np.testing.assert_allclose(simulated, expected, atol=1e-6)


@pytest.mark.nightly
def test_one_sensor_of_the_plate_gives_another_exactly_whatever_the_state():
    system, start = unforced(PLATE, WAVES, sample_period_s=0.001)
    expected = simulate(PLATE, WAVES, sample_period_s=0.001).values
    np.testing.assert_allclose(system.simulate(np.zeros((1500, 0)), start), expected, atol=1e-11)
    weights = exact_weights(system, given=0, wanted=2)
    assert (system.order, len(weights)) == (24, 24)
    assert left_over(system, weights, given=0, wanted=2) == 0
    weights[5] *= 1 + Fraction(1, 10**30)  # what no double would see
    assert left_over(system, weights, given=0, wanted=2) > 0


def test_nested_operators_fall_to_the_noise_with_as_many_inputs_as_excitations():
    u = np.random.default_rng(1).standard_normal((3000, 2))
    mixed = u @ np.random.default_rng(2).standard_normal((2, 4))
    record = StateSpace(np.zeros((0, 0)), np.zeros((0, 4)), np.zeros((4, 0)), np.eye(4)).simulate(mixed)
    noisy = measured(simulate(PLATE, Held(values=u[:, [0, 1, 1]]), sample_period_s=1.0), snr=1e3, seed=1)
    assert len(nested_operators(noisy, 2)) == len(SENSORS) - 1
    sensors = type(noisy)(record, channels=["a", "b", "c", "d"], sample_period_s=1.0)
    sensors = measured(sensors, snr=100, seed=2)
    levels = [np.nanmedian(norm.values) for norm in norms(nested_operators(sensors, 2), sensors, window=100)]
    assert levels[0] > 10 * levels[1]
    assert levels[1] < 2 * levels[2]
    assert count(sensors, 2) == 2
