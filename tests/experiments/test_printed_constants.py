"""What the scripts of `experiments/` take from the dissertation, held against the print, typed off it once more."""

import numpy as np
import pytest

from gtmbench.values.record import Record
from tests.helpers.scripts import script
from theory import plants
from theory.plate import Plate
from theory.realisation import block_hankel

PRINTED = {  # script: constant: what is printed, and where
    "why_time_domain": {
        "SYSTEM.A": ([[-0.5, 0.2], [0, 0.7]], "(1.1)"),
        "SYSTEM.B": ([[4], [1]], "(1.1)"),
        "SYSTEM.C": ([[1.25, -3]], "(1.1)"),
        "SYSTEM.D": ([[0]], "(1.1)"),
        "REPEATED": (500, "N, Fig. 1.1"),
        "START": ([1000, 1000], "x(0), Fig. 1.2"),
        "SHORT": (10_000, "L, Fig. 1.2"),
        "LONG": (100_000, "L, Fig. 1.2"),
    },
    "exact_operators": {
        "MODEL_2_4_2.A": ([[-1, 1, 0], [0, -1, 1], [0, 0, -1]], "(2.67)"),
        "MODEL_2_4_2.B": ([[1, 0], [0, 1], [1, 1]], "(2.68)"),
        "MODEL_2_4_2.Ci": ([[1, 0, 0], [0, 1, 0]], "(2.69)"),
        "MODEL_2_4_2.Co": ([[0, 0, 1]], "(2.69)"),
        "MODEL_2_4_2.Di": ([[1, 0], [0, 0]], "(2.70)"),
        "MODEL_2_4_2.Do": ([[0, 0]], "(2.70)"),
    },
    "orders_of_models": {
        "SAMPLES": (10_000, "Ex. 3.2.1"),
        "SNR": (10, "Ex. 3.2.1"),
        "PRINTED_RUNS": (100, "Ex. 3.2.1"),
        "MU": (range(1, 51), "Fig. 3.2"),
        "DELAYED": ([2 * d for d in range(1, 26)], "mu = 2 d, Fig. 3.9"),
    },
    "laurent_series": {"ORDERS.causal_order": (25, "r, Ex. 3.1"), "ORDERS.noncausal_order": (25, "d, Ex. 3.1")},
    "closed_loop": {
        "R": (50, "r, Ex. 3.2"),
        "D": (50, "d, Ex. 3.2"),
        "SNR": (10, "Ex. 3.2"),
        "LENGTH": (10_000, "l, Fig. 3.13"),
        "RUNS": (50, "(3.100)"),
    },
    "order_and_realisation": {
        "RUNS": (100, "Figs. 3.3-3.16"),
        "SNR": (10, "Ex. 3.2.1, 3.3"),
        "SAMPLES_3_2": (10_000, "Ex. 3.2.1, 3.2.2"),
        "SAMPLES_3_3": (5000, "l, Ex. 3.3"),
        "LAGS": (25, "r = d, Ex. 3.3"),
        "REACH": (2 * 10 - 1, "n-hat = 10, Ex. 3.3, (3.101)"),
        "LONG": (range(2 * 20), "n-hat = 20, Fig. 3.4, (3.2)"),
    },
    "aircraft_gyros": {
        "R": (50, "r, section 4.4"),
        "D": (50, "d, section 4.4"),
        "SNR": (50, "section 4.4"),
        "LEARNT_S": ([25, 200], "2,500 <= k <= 20,000, section 4.4"),
        "SHOWN.start": (28_000, "Fig. 4.2"),
        "SHOWN.stop": (28_500 + 1, "Fig. 4.2"),
        "ONSET_S": (300, "Figs. 4.3, 4.4"),
        "SLOPE": (0.05, "Fig. 4.3, deg/s^2"),
        "WINDOW": (1000, "w, Figs. 4.3, 4.4"),
    },
    "plate": {
        "FORCES": ([(0.3, 0.3), (1, 1), (4, 0.25)], "section 4.5"),
        "SENSORS": ([(0.5, 0.1), (1, 0.5), (2, 0.8), (3, 0.6), (3, 0.75)], "section 4.5"),
        "AMPLITUDE": ([600, 500, 300], "u_1..u_3, section 4.5"),
        "OMEGA": ([5, 10, 20], "u_1..u_3, section 4.5"),
        "SAMPLES": (20_000 + 1, "1 <= k <= 20,000, section 4.5"),
        "LEARNT": (2000, "l, section 4.5"),
        "ORDER": (25, "r = d, section 4.5"),
        "WINDOW": (1000, "w, Fig. 4.6"),
        "SOFTER_S": (5, "Fig. 4.8"),
    },
    "drum": {
        "PERIOD_S": (1 / 1000, "1000 Hz, section 4.6"),
        "SAMPLES": (30_000 + 1, "1 <= k <= 30,000, section 4.6"),
        "ORDER": (25, "r = d, section 4.6"),
        "WINDOW": (1000, "w, Fig. 4.10"),
        "QUIET": (5000, "l, Fig. 4.13"),
        "SHOWN.start": (15_000, "Fig. 4.11"),
        "SHOWN.stop": (15_300 + 1, "Fig. 4.11"),
        "TONES": ([100 * np.pi, 120 * np.pi], "u_1, u_2 of Fig. 4.13"),
        "REMOVED_S": ([10, 21], "Fig. 4.13"),
    },
    "structures": {"FIG_5_1.M": (np.eye(6), "Ex. 5.8.1")},
    "beam": {
        "MODULUS": (200e9, "E, Ex. 5.8.2"),
        "LENGTH": (0.100, "L, Ex. 5.8.2"),
        "HEIGHT": (0.010, "h, Ex. 5.8.2"),
        "WIDTH": (0.001, "w, Ex. 5.8.2"),
        "DRIVEN": (0.0833, "x_a, Ex. 5.8.2"),
        "SENSED": (0.0211, "x_s, Ex. 5.8.2"),
    },
    "hammerstein": {"REALISATIONS": (200, "(6.34)"), "SHOWN": ([2, 3, 4, 5], "Figs. 6.5-6.9")},
}


def constant(name, path):
    """Return what a script has under a path of names and keys."""
    value = script(name)
    for part in path.split("."):
        value = value[part] if isinstance(value, dict) else getattr(value, part)
    return value


@pytest.mark.parametrize(("name", "path"), [(name, path) for name, constants in PRINTED.items() for path in constants])
def test_a_constant_is_the_printed_one(name, path):
    printed, place = PRINTED[name][path]
    ours = np.asarray(constant(name, path), dtype=float)
    assert ours.shape == np.shape(printed), place
    np.testing.assert_allclose(ours, printed, rtol=1e-15, err_msg=place)


@pytest.mark.parametrize(
    ("place", "plant", "printed"),
    [
        (
            "(3.1)",
            plants.example_3_2_1(),
            lambda z: (
                ((z**2 + 0.16) * (z - 0.3) * (z + 0.3))
                / ((z + 0.8) * (z + 0.7) * (z + 0.6) * (z - 0.7) * (z - 0.6) * (z**2 + 0.25))
            ),
        ),
        (
            "(3.5)",
            plants.example_3_2_2().plant,
            lambda z: (
                ((z**2 + 0.16) * (z - 0.3) * (z + 0.3))
                / ((z + 0.6) * (z - 0.7) * (z**2 + 0.25) * (z - 1.6) * (z - 1.7) * (z - 1.8))
            ),
        ),
        (
            "(3.98)",
            plants.example_3_2().plant,
            lambda z: (
                ((z**2 + 0.16) * (z - 0.3) * (z + 0.3))
                / ((z + 0.7) * (z + 0.6) * (z**2 + 0.25) * (z - 1.8) * (z - 1.7) * (z - 1.6))
            ),
        ),
        (
            "Ex. 3.4.1",
            script("laurent_series")["EXAMPLES"]["Ex. 3.4.1"],
            lambda z: (z - 1) * (z - 0.5) / ((z - 2) * (z - 3)),
        ),
        (
            "Ex. 3.4.2",
            script("laurent_series")["EXAMPLES"]["Ex. 3.4.2"],
            lambda z: 1 / ((z - 0.5) * (z - 1.5)),
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_plant_is_the_printed_rational_function(place, plant, printed):
    z = 2.5 * np.exp(1j * np.linspace(0.1, 6.0, 16))  # as many values as pin numerator and denominator of order 7
    np.testing.assert_allclose(plant.at(z)[:, 0, 0], printed(z), rtol=1e-12, err_msg=place)


def test_the_realisation_of_example_3_1_is_3_96():
    plant = plants.example_3_1().plant
    np.testing.assert_array_equal(plant.A, [[1.5, 0.2], [2, 0.5]])
    np.testing.assert_array_equal(plant.B, [[1, -1], [-1, 3]])
    np.testing.assert_array_equal(plant.C, [[1, 2], [0, -4]])
    np.testing.assert_array_equal(plant.D, np.zeros((2, 2)))


def test_the_transfer_functions_of_example_3_3_are_the_printed_ones():
    assert script("order_and_realisation")["PRINTED"] == {
        "(3.111), G_s(z)": ([0.07241, 0.02234, 0.01606, -0.00113], [1, 1.3020, 0.7590, 0.3697, 0.08392]),
        "(3.112), G_u(1/z)": ([0.0096, -0.0898, 0.0147, -0.00002], [1, -1.7680, 1.0400, -0.2028]),
        "(3.113), G_u(z)": ([0.00002, -0.0147, 0.0898, -0.0096], [0.2028, -1.0400, 1.7680, -1]),
        "(3.114), G(z)": (
            [0.0001, -0.0001, -0.0006, 1.0070, 0.0018, 0.1573, -0.0694, 0.0016],
            [1, -3.8249, 2.8011, 2.8991, -1.6149, -0.9494, -1.0912, -0.4138],
        ),
    }


def test_the_hankel_matrices_of_example_3_3_have_the_lags_of_3_101_and_3_103():
    """(3.101) from H_s,1 to H_s,2n-1; (3.103), turned about, from H_u,0 to H_u,-2n+2; n = 10."""
    stable, unstable = (
        block_hankel(np.array(lags, float)) for lags in script("order_and_realisation")["SIDES"].values()
    )
    i = np.add.outer(np.arange(10), np.arange(10))
    np.testing.assert_array_equal(stable, i + 1)
    np.testing.assert_array_equal(unstable, -i)


def test_the_trim_is_held_against_the_printed_one():
    """Section 4.4, the paragraph below (4.13)."""
    printed = {"altitude_ft": 8000.00, "eas_kt": 89.18, "tas_kt": 100.58, "alpha_deg": 3.00, "beta_deg": 0}
    printed |= {"gamma_deg": 0, "roll_deg": 0.066, "pitch_deg": 3.00, "yaw_deg": 45.00, "ground_track_deg": 45.00}
    printed |= {"elevator_deg": 2.70, "throttle_percent": 22.84}
    assert {name: value for name, (value, _) in script("aircraft_gyros")["PRINTED_TRIM"].items()} == printed


def test_the_plate_is_that_of_section_4_5():
    assert (Plate().a, Plate().b, Plate().h) == (5, 1, 0.01)
    snrs = script("plate")["SNRS"]  # Fig. 4.7
    assert (snrs.min(), snrs.max()) == (1, 100)


@pytest.mark.parametrize(("name", "samples", "learnt"), [("plate", 20_001, 2000), ("drum", 30_001, 10_000)])
def test_operators_are_identified_on_the_printed_first_samples(name, samples, learnt):
    """Sections 4.5 and 4.6: k = 1..l."""
    k = np.arange(samples, dtype=float)
    record = Record(k[:, np.newaxis], channels=["k"], sample_period_s=script(name)["PERIOD_S"])
    np.testing.assert_array_equal(script(name)["learnt"](record)["k"], np.arange(1, learnt + 1))


def test_the_springs_of_fig_5_1_join_the_printed_masses():
    """Ex. 5.8.1: k_01, k_12, k_14, k_15, k_23, k_36, k_45, k_46, all 1 N/m."""
    assert sorted(script("structures")["SPRINGS"]) == [(0, 1), (1, 2), (1, 4), (1, 5), (2, 3), (3, 6), (4, 5), (4, 6)]


def test_the_beams_operator_is_held_against_5_115():
    printed = [1, 0, 156.4, 0, -1.814e4, 0, 3.454e6], [63.38, 0, 1.426e4, 0, 8.057e5, 0, 9.591e6]
    assert [[float(c) for c in polynomial] for polynomial in script("beam")["PRINTED"]] == [*printed]


def test_the_hammerstein_systems_are_6_31_and_6_32():
    s, z = script("hammerstein"), 2.5 * np.exp(1j * np.linspace(0.1, 6.0, 8))
    first = (4 * z + 1) / ((z - 0.6) * (z + 0.8) * (z - 0.9))
    second = (2 * z + 5) / ((z - 0.55) * (z + 0.6) * (z - 0.4))
    for system, above, below, printed in (("G1", "B1", "A1", first), ("G2", "B2", "A2", second)):
        np.testing.assert_allclose(s[system].at(z)[:, 0, 0], printed, rtol=1e-12)
        np.testing.assert_allclose(np.polyval(s[above], z) / np.polyval(s[below], z), printed, rtol=1e-12)


U = np.linspace(-4.7, 4.7, 48)
PAIRS = {  # Ex. 6.5.1..6.5.5: N_1 but for the mean that M takes away, N_2, the density (6.30) with a = 5 or N(0, 1)
    "6.5.1": (np.sign(U), np.sin(U), "uniform"),
    "6.5.2": (U**2, np.cos(U), "normal"),
    "6.5.3": (np.sinh(U), U**3, "normal"),
    "6.5.4": (np.sign(U), np.exp(U), "uniform"),
    "6.5.5": (U**2 * np.exp(U), np.sin(U) + 10, "uniform"),
}
DENSITIES = {
    "uniform": np.where(np.abs(2 * U) <= 5, 0.1, 0.0),
    "normal": np.exp(-((2 * U) ** 2) / 2) / np.sqrt(2 * np.pi),
}


@pytest.mark.parametrize("place", PAIRS)
def test_a_pair_of_nonlinearities_is_the_printed_one(place):
    pair = [*script("hammerstein")["EXAMPLES"].values()][[*PAIRS].index(place)]
    first, second, density = PAIRS[place]
    offset = pair.first(U) - first
    np.testing.assert_allclose(offset, offset[0], atol=1e-10 * np.abs(first).max(), err_msg="a mean is one number")
    assert (abs(offset[0]) > 1e-3) == (place in ("6.5.2", "6.5.5"))
    np.testing.assert_allclose(pair.second(U), second, rtol=1e-12)
    np.testing.assert_allclose(pair.density.pdf(2 * U), DENSITIES[density], rtol=1e-12)
