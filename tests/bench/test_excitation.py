"""Excitations: the dissertation's formulas, and lines, pulses and sums as they are said to be."""

import itertools

import numpy as np
import pytest

from gtmbench.bench.excitation import EXCITATIONS, SURFACES, excitation
from gtmbench.errors import InputError

PERIOD_S = 0.01
HUNDRED_S = np.arange(10_000) * PERIOD_S  # lines 0.01 Hz apart fall on the bins of its FFT


def test_the_dissertations_surfaces_follow_its_text():
    """Section 4.4: da = sin(W k Ts), de = sin(W k Ts + 45), dr = cos(W k Ts) deg, W = 30 deg/s, 0 <= k <= 50,000."""
    k = np.arange(50_001)
    degrees = 30.0 * k * 0.01
    moved = excitation("dissertation", k * 0.01, seed=1).surfaces
    np.testing.assert_allclose(moved["aileron"], np.sin(np.radians(degrees)), atol=1e-10)
    np.testing.assert_allclose(moved["elevator"], np.sin(np.radians(degrees + 45.0)), atol=1e-10)
    np.testing.assert_allclose(moved["rudder"], np.cos(np.radians(degrees)), atol=1e-10)


def lines(deflection):
    """Return the amplitudes at 0, 0.01, 0.02 ... Hz."""
    return np.abs(np.fft.rfft(deflection)) * 2.0 / len(deflection)


@pytest.mark.parametrize("seed", [1, 1001])
def test_every_surface_of_the_multisine_moves_as_much_as_a_sinusoid_of_1_deg_on_lines_of_its_own(seed):
    moved = excitation("multisine", HUNDRED_S, seed).surfaces
    used = {}
    for surface, deflection in moved.items():
        assert np.sqrt(np.mean(deflection**2)) == pytest.approx(np.sqrt(0.5), abs=1e-9)
        amplitudes = lines(deflection)
        used[surface] = set(np.flatnonzero(amplitudes > 1e-6))
        assert np.ptp(amplitudes[list(used[surface])]) < 1e-9
    for name, other in itertools.combinations(SURFACES, 2):
        assert not used[name] & used[other]
    # 0.05..2 Hz, none left out
    assert set.union(*used.values()) == set(range(5, 201))


def test_only_the_multisine_depends_on_the_seed():
    for name in EXCITATIONS:
        first, again, other = (excitation(name, HUNDRED_S, seed).surfaces for seed in (1, 1, 2))
        for surface in first:
            assert np.array_equal(first[surface], again[surface])
            assert np.array_equal(first[surface], other[surface]) == (name != "multisine")


def test_every_doublet_of_a_surface_adds_up_to_nothing():
    for deflection in excitation("doublets", HUNDRED_S[:9000], seed=1).surfaces.values():
        for turn in deflection.reshape(-1, 1500):  # 15 s, in which every surface has its turn
            assert turn.sum() == 0.0
            assert np.count_nonzero(turn == 2.0) == np.count_nonzero(turn == -2.0) == 100  # 1 s each


def test_doublets_take_turns_every_5_s():
    moved = excitation("doublets", HUNDRED_S, seed=1).surfaces
    moving = np.array([moved[name] != 0.0 for name in ("elevator", "aileron", "rudder")])
    assert moving.sum(axis=0).max() == 1
    begins = [np.flatnonzero(np.diff(row.astype(int), prepend=0) == 1)[:2] * PERIOD_S for row in moving]
    np.testing.assert_allclose(begins, [[0.0, 15.0], [5.0, 20.0], [10.0, 25.0]])


@pytest.mark.parametrize("name", EXCITATIONS)
def test_a_deflection_depends_on_its_time_alone(name):
    whole = excitation(name, HUNDRED_S, seed=3).surfaces
    part = excitation(name, HUNDRED_S[700:1900:3], seed=3).surfaces
    for surface in whole:
        np.testing.assert_allclose(part[surface], whole[surface][700:1900:3], atol=1e-12)


def test_turbulence_alone_moves_the_air_and_no_surface():
    assert [name for name in EXCITATIONS if excitation(name, HUNDRED_S, seed=1).turbulence] == ["turbulence"]
    assert not excitation("turbulence", HUNDRED_S, seed=1).surfaces


@pytest.mark.parametrize("pair", list(itertools.permutations(EXCITATIONS, 2)), ids="+".join)
def test_a_sum_is_the_sum_of_its_parts(pair):
    total = excitation(" + ".join(pair), HUNDRED_S, seed=1)
    parts = [excitation(name, HUNDRED_S, seed=1) for name in pair]
    assert total.turbulence == any(part.turbulence for part in parts)
    for surface in SURFACES:
        expected = sum(part.surfaces.get(surface, 0.0 * HUNDRED_S) for part in parts)
        np.testing.assert_allclose(total.surfaces[surface], expected, atol=1e-15)


@pytest.mark.parametrize("name", ["chirp", "", "multisine+", "multisine+gusts", "Multisine", "+"])
def test_an_unknown_excitation_is_refused_with_the_legal_ones(name):
    with pytest.raises(InputError, match="no excitation") as refused:
        excitation(name, HUNDRED_S, seed=1)
    assert all(known in str(refused.value) for known in EXCITATIONS)
