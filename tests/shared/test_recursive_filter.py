"""The recursive filter: its own recursion, row by row, in whatever stretches it is taken."""

import numpy as np
import pytest
from scipy.signal import lfilter

from gtmbench.values.attitude_estimators import filtered


@pytest.mark.parametrize("shape", [(40,), (40, 3), (1, 2), (2,), (0, 3)])
@pytest.mark.parametrize(
    ("over", "under"), [([0.1], [1.0, -0.9]), ([0.2, 0.4], [1.0, -1.9, 0.91]), ([2.0, 1.0], [1.0])]
)
def test_it_is_the_filter_that_scipy_has(over, under, shape):
    signal = np.random.default_rng(1).standard_normal(shape)
    expected = lfilter(over, under, signal, axis=0) if len(signal) else signal
    np.testing.assert_allclose(filtered(over, under, signal), expected, rtol=1e-12, atol=1e-14)


def test_a_filter_goes_on_where_it_stopped():
    signal = np.random.default_rng(2).standard_normal(50)
    whole = filtered([0.2, 0.3], [1.0, -0.7], signal)
    rest = filtered([0.2, 0.3], [1.0, -0.7], signal[20:], (signal[19], whole[19]))
    np.testing.assert_array_equal(rest, whole[20:])
