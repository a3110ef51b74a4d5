"""Running sums of products against the same products of filtered values."""

import numpy as np
from scipy.signal import lfilter

from gtmbench.detectors.surfaces.whitened import ORDER, BlockSums, left, whitening


def coloured(seed, samples, pole):
    return lfilter([1.0], [1.0, -pole], np.random.default_rng(seed).standard_normal(samples))


def test_products_of_filtered_values_are_those_of_the_filtered_series():
    """The oracle: filter first, multiply then. Pieces, and what is forgotten, change nothing."""
    draw = np.random.default_rng(1)
    values = draw.standard_normal((400, 2, 3))
    taps = np.concatenate([np.ones((1, 2, 1)), draw.standard_normal((1, 2, ORDER))], axis=-1)
    sums = BlockSums(2, 3, 60)
    for first in range(0, 400, 50):
        sums.push(values[first : first + 50], np.ones(50, dtype=bool))
    begin, end = np.array([350]), np.array([390])
    found = sums.whitened(begin, end, taps)[0]
    for series in range(2):
        filtered = lfilter(taps[0, series], [1.0], values[:, series], axis=0)[350:390]
        np.testing.assert_allclose(found[series], filtered.T @ filtered, atol=1e-9)
    assert sums.held(begin, end)[0] == 40.0


def test_the_filter_of_a_process_of_first_order_is_its_own():
    noise = coloured(2, 50_000, 0.8)[:, np.newaxis, np.newaxis]
    sums = BlockSums(1, 1, 50_000)
    sums.push(noise, np.ones(len(noise), dtype=bool))
    lagged = sums.lagged(np.array([0]), np.array([len(noise)]), np.zeros((1, 1, 0)))
    np.testing.assert_allclose(whitening(lagged)[0, 0], [1.0, -0.8, 0.0, 0.0, 0.0], atol=0.02)


def test_what_a_fit_leaves_is_never_negative():
    assert left(np.array([[1.0, 1.0], [1.0, 1.0 - 1e-12]]), np.array([1.0])) == 0.0
