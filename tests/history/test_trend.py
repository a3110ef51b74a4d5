"""Constants that change over flights: told before they reach their limit, and when."""

import numpy as np
import pytest

from gtmbench.history.entry import OFFSET
from gtmbench.history.overview import trends_of
from tests.history.flights import flight, flights


def drifting(seed, slope, count):
    """Return flights whose q drifts, and its offset at the first."""
    random, means, _ = flights(seed, 0)
    return means["q", OFFSET], [
        flight(random, number, means, off={("q", OFFSET): slope * (number - 1)}) for number in range(1, count + 1)
    ]


def test_constants_that_stay_drift_nowhere():
    assert not any(trends_of(flights(seed, 20)[2]) for seed in range(40))


@pytest.mark.parametrize("slope", [0.15, -0.15])
def test_a_drift_is_told_before_the_limit_and_its_crossing_lies_in_the_interval(slope):
    inside = []
    for seed in range(40):
        start, flown = drifting(seed, slope, 20)
        own = [each for each in trends_of(flown) if each.sensor == "q"]
        assert own, seed
        crossing = 1.0 + (np.sign(slope) * 5.0 - start) / slope
        inside.append(own[0].between[0] <= crossing <= own[0].between[1])
    assert np.mean(inside) >= 0.9


def test_the_first_to_reach_its_limit_stands_first():
    random, means, _ = flights(3, 0)
    drifts = {("p", OFFSET): 0.1, ("r", OFFSET): 0.3}
    flown = [
        flight(random, number, means, off={key: slope * number for key, slope in drifts.items()})
        for number in range(20)
    ]
    assert [each.sensor for each in trends_of(flown)] == ["r", "p"]


def test_a_season_is_no_drift():
    random, means, _ = flights(4, 0)
    temperatures = 20.0 - 1.5 * np.arange(20)  # winter comes
    flown = [
        flight(random, number, means, off={("q", OFFSET): 0.04 * temperature}, temperature_c=float(temperature))
        for number, temperature in enumerate(temperatures)
    ]
    assert not [each for each in trends_of(flown) if each.deviation < 0.3 * abs(each.slope)]
