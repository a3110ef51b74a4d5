"""An airframe's constants as its page shows them: what parts is told, and nothing else of the sensor that failed."""

from gtmbench.history.entry import OFFSET
from gtmbench.history.overview import overviews_of
from gtmbench.history.standing import stood
from tests.history.flights import AT_REST, flight, flights


def test_of_a_sensor_that_failed_the_constants_that_are_as_before_are_shown_so():
    random, means, earlier = flights(1, 12)
    own = flight(random, 12, means, off={("q", OFFSET): 4.1, ("q", AT_REST): 4.1})
    shown = overviews_of([*earlier, stood(earlier, own).entered(["q"])])
    apart = [(each.sensor, each.name) for each in shown if each.is_apart[-1]]
    assert sorted(apart) == [("q", OFFSET), ("q", AT_REST)]
    assert (shown[0].sensor, shown[1].sensor) == ("q", "q")
    assert not any(each.is_apart[:-1].any() for each in shown)
