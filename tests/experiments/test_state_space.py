"""Linear systems and the loop about them, against scipy and by what they must satisfy."""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from theory import plants
from theory.closed_loop import loop_records
from theory.state_space import StateSpace, companion


def drawn(seed, order=4, outputs=2, inputs=3, radius=0.9):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((order, order))
    A *= radius / max(np.abs(np.linalg.eigvals(A)).max(), 1e-9)
    return StateSpace(A, *(rng.standard_normal(s) for s in ((order, inputs), (outputs, order), (outputs, inputs))))


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.integers(1, 6))
def test_the_response_is_the_sum_of_the_markov_parameters(seed, order):
    system = drawn(seed, order)
    z = 1.5 * np.exp(1j * np.linspace(0.0, 3.0, 7))
    terms = system.markov(200)
    summed = np.tensordot(z[:, np.newaxis] ** -np.arange(200), terms, 1)
    np.testing.assert_allclose(system.at(z), summed, atol=1e-12 * np.abs(terms).max())


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.integers(0, 4))
def test_simulation_is_scipys(seed, runs):
    system = drawn(seed)
    rng = np.random.default_rng([seed, 1])
    u, x0 = rng.standard_normal((runs + 1, 60, 3)), rng.standard_normal((runs + 1, 4))
    outputs = system.simulate(u, x0)
    for inputs, start, y in zip(u, x0, outputs, strict=True):
        _, expected, _ = scipy.signal.dlsim((system.A, system.B, system.C, system.D, 1.0), inputs, x0=start)
        np.testing.assert_allclose(y, expected, atol=1e-11)
        np.testing.assert_allclose(system.simulate(inputs, start), y, atol=1e-11)  # a run by itself


@pytest.mark.parametrize(("b", "a"), [([1.0, 0.2], [2.0, -1.0, 0.5]), ([3.0, 1.0], [1.0, 0.5]), ([2.0], [4.0])])
def test_a_companion_form_has_its_transfer_function(b, a):
    z = np.exp(1j * np.linspace(0.1, 3.0, 9))
    system = companion(b, a)
    assert system.order == len(a) - 1
    np.testing.assert_allclose(system.at(z)[:, 0, 0], np.polyval(b, z) / np.polyval(a, z), rtol=1e-13)


def test_the_printed_gains_belong_to_the_plants():
    np.testing.assert_allclose(plants.example_3_1().gain, [[2.5446, 0.4259], [1.3095, 0.2707]], atol=5e-5)
    printed = [3.5197, -3.1272, -3.0739, 2.0825, 1.0096, 0.7134, 0.4997]
    np.testing.assert_allclose(plants.example_3_2().gain[0], printed, atol=5e-5)
    printed = [0.3337, 1.7995, 0.6122, -0.3158, -0.2112, -0.2001, -0.0862]
    np.testing.assert_allclose(plants.example_3_2_2_as_printed().gain[0], printed, atol=5e-5)
    assert np.sum(np.abs(plants.example_3_2_2().plant.poles) > 1.0) == 3  # (3.5), which (3.6) doesn't realise
    assert np.sum(np.abs(plants.example_3_2_2_as_printed().plant.poles) > 1.0) == 1


def by_u(plant, record):
    """Return y of the plant by the u that is measured; the plant is unstable, so from a record's beginning only."""
    return plant.simulate(record["u"][:12, np.newaxis])[:, 0]


def test_where_noise_enters_decides_what_the_plant_is_seen_to_do():
    example = plants.example_3_2()

    def of(noise, snr=10.0):
        return loop_records(example.plant, example.gain, samples=4000, runs=2, snr=snr, noise=noise, seed=5)[1]

    clean, process, measured, sensor_u, sensor_y = (
        of("process", None),
        of("process"),
        of("measured"),
        of("input"),
        of("output"),
    )
    for record in (clean, measured):  # u0 + v is what drives the plant
        np.testing.assert_allclose(by_u(example.plant, record), record["y"][:12], atol=1e-9)
    assert np.array_equal(process["y"], measured["y"])
    assert not np.allclose(by_u(example.plant, process), process["y"][:12], atol=1e-3)
    assert np.array_equal(sensor_u["y"], clean["y"])
    assert np.array_equal(sensor_y["u"], clean["u"])
    for noise, signal in (
        (measured["u"] - process["u"], clean["c"]),
        (sensor_u["u"] - clean["u"], clean["u"]),
        (sensor_y["y"] - clean["y"], clean["y"]),
    ):
        assert np.var(signal) / np.var(noise) == pytest.approx(10.0, rel=0.1)  # a ratio of powers
