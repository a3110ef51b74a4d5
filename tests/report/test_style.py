"""Colours that mean something are told apart by who sees no red or green, and on paper by who prints in grey."""

from itertools import combinations

import numpy as np
import pytest

from gtmbench.report.style import COLOURS

# Machado, Oliveira and Fernandes (2009), Table 1, severity 1.0, on linear RGB
DEFICIENCIES = {
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])  # D65


def linear(colour):
    """Return linear RGB of a colour as #rrggbb (IEC 61966-2-1)."""
    stored = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """Return CIELAB of linear RGB."""
    shares = TO_XYZ @ np.clip(rgb, 0.0, 1.0) / WHITE
    roots = np.where(shares > (6 / 29) ** 3, np.cbrt(shares), shares / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * roots[1] - 16, 500 * (roots[0] - roots[1]), 200 * (roots[1] - roots[2])])


@pytest.mark.parametrize("seen", DEFICIENCIES)
def test_no_two_colours_become_one(seen):
    """A difference of 10 is plain on lines; the palette before this test had two colours 3 apart."""
    places = {name: lab(np.array(DEFICIENCIES[seen]) @ linear(colour)) for name, colour in COLOURS.items()}
    apart = {(a, b): np.linalg.norm(places[a] - places[b]) for a, b in combinations(places, 2)}
    assert {pair: apart[pair] for pair in apart if apart[pair] < 15.0} == {}


@pytest.mark.parametrize("other", ["virtual", "threshold"])
def test_what_is_measured_isnt_taken_for_what_is_expected_in_print(other):
    grey = {name: lab(linear(colour))[0] for name, colour in COLOURS.items()}
    assert abs(grey["healthy"] - grey[other]) > 15.0
