"""What earlier flights say of the next one: as likely as it says, whatever the spread, in every unit."""

import numpy as np
import pytest

from gtmbench.history.entry import OFFSET, Constant, Entry
from gtmbench.history.spread import FEWEST, predicted
from tests.helpers.night import by_day

KEY = ("q", OFFSET)


def entries(values, deviations, temperatures=None):
    temperatures = np.full(len(values), 20.0) if temperatures is None else temperatures
    return [
        Entry(
            digest=str(number),
            log="",
            airframe="a",
            temperature_c=float(temperature),
            constants=(Constant(sensor="q", name=OFFSET, value=float(value), deviation=float(deviation)),),
        )
        for number, (value, deviation, temperature) in enumerate(zip(values, deviations, temperatures, strict=True))
    ]


@pytest.mark.parametrize("flights", by_day([5, 8, 20]))
@pytest.mark.parametrize("spread", by_day([0.3, 1.0]))
def test_a_healthy_flight_is_called_unlikely_as_often_as_it_is(flights, spread):
    random = np.random.default_rng([flights, round(10 * spread)])
    level, count, trials = 0.05, 0, 250
    for _ in range(trials):
        deviations = random.uniform(0.05, 0.4, flights + 1)
        values = 1.0 + np.hypot(spread, deviations) * random.standard_normal(flights + 1)
        *earlier, last = entries(values, deviations)
        count += predicted(earlier, last)[KEY].chance(values[-1]) < level
    assert count / trials == pytest.approx(level, abs=0.042)  # three deviations of such a count


def test_no_spread_is_believed_that_is_smaller_than_sensors_have():
    *earlier, last = entries(np.full(20, 0.2), np.full(20, 1e-4))
    assert predicted(earlier, last)[KEY].spread == pytest.approx(0.1, rel=0.01)


def test_the_own_error_of_a_flight_widens_what_it_may_be():
    *earlier, last = entries(0.1 * np.arange(10.0), np.r_[np.full(9, 0.01), 2.0])
    assert predicted(earlier, last)[KEY].deviation > 2.0


def test_a_flight_that_tells_little_counts_little():
    values, deviations = np.r_[np.zeros(9), 9.0, 0.0], np.r_[np.full(9, 0.05), 10.0, 0.05]
    *earlier, last = entries(values, deviations)
    assert abs(predicted(earlier, last)[KEY].value) < 0.05


@pytest.mark.parametrize("shift", [-3.0, 7.0])
def test_what_all_flights_are_off_by_moves_what_is_expected_by_as_much(shift):
    random = np.random.default_rng(4)
    values, deviations = random.standard_normal(12), np.full(12, 0.1)
    *earlier, last = entries(values, deviations)
    *moved, of_moved = entries(values + shift, deviations)
    one, other = predicted(earlier, last)[KEY], predicted(moved, of_moved)[KEY]
    assert other.value - one.value == pytest.approx(shift)
    assert other.deviation == pytest.approx(one.deviation)


def test_temperature_explains_what_it_explained_before_and_widens_where_nobody_has_flown():
    random = np.random.default_rng(5)
    temperatures = np.r_[random.uniform(10.0, 25.0, 20), -10.0]
    values, deviations = 0.05 * (temperatures - 15.0) + 0.05 * random.standard_normal(21), np.full(21, 0.02)
    *earlier, last = entries(values, deviations, temperatures)
    told = predicted(earlier, last)[KEY]
    assert told.chance(values[-1]) > 0.01
    assert told.chance(values[-1] + 2.0) < 1e-4
    *_, warm = entries(values, deviations, np.r_[temperatures[:-1], 18.0])
    assert predicted(earlier, warm)[KEY].deviation < 0.8 * told.deviation


def test_where_no_temperature_is_logged_another_season_is_possible():
    values, deviations = 0.01 * np.arange(12.0), np.full(12, 0.02)
    *earlier, last = entries(values, deviations)
    *unlogged, of_unlogged = entries(values, deviations, np.full(12, np.nan))
    assert predicted(unlogged, of_unlogged)[KEY].deviation > 2.0 * predicted(earlier, last)[KEY].deviation


def test_fewer_than_five_flights_say_nothing():
    *earlier, last = entries(np.zeros(FEWEST), np.full(FEWEST, 0.1))
    assert predicted(earlier, last) == {}
    assert predicted([], last) == {}
