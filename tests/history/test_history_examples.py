"""An airframe's history, by example."""

import numpy as np

from gtmbench.history.entry import Constant, Entry
from gtmbench.history.overview import Trend, trend_text, trends_of
from gtmbench.history.spread import Prediction, alike_of, fitted, predicted
from gtmbench.history.standing import explanations_of, reads_text


def test_explanations_of():
    told = list(explanations_of({("q", "offset"): 4.1, ("q", "noise"): 0.1}))
    assert [each.kind for each in told if each.suspects] == ["bias", "noise"]


def test_trends_of():
    def flight(number):
        read = Constant(sensor="q", name="offset", value=0.2 * number + 0.1 * (number % 2), deviation=0.02)
        return Entry(digest=str(number), log="", airframe="a", constants=(read,))

    (trend,) = trends_of([flight(number) for number in range(10)])
    assert (round(trend.slope, 1), round(trend.crossing), trend.between[0] < 25.0 < trend.between[1]) == (0.2, 25, True)


def test_trend_text():
    told = {
        "sensor": "q",
        "name": "offset",
        "flights": 12,
        "slope": 0.1,
        "deviation": 0.01,
        "limit": 5.0,
        "crossing": 43.2,
    }
    assert trend_text(Trend(between=(38.0, 51.4), **told)) == (
        "changes by 0.1 deg/s a flight; it reaches 5 deg/s at flight 43 (38 to 51)"
    )


def test_fitted():
    random = np.random.default_rng(1)
    values, one = 2.0 + 0.5 * random.standard_normal((1, 400)), np.ones((400, 1))
    own = np.full((1, 400), 0.01), one, np.array([[np.inf]]), np.array([0.1]), np.array([0])
    lines = fitted(values, *own)
    assert (lines.theta.round(1).item(), lines.spread.round(1).item()) == (2.0, 0.5)


def test_predicted():
    def flight(number, value):
        read = Constant(sensor="q", name="offset", value=value, deviation=0.05)
        return Entry(digest=str(number), log="", airframe="a", temperature_c=20.0, constants=(read,))

    flights = [flight(number, 0.1 * (number % 3)) for number in range(12)]
    told = predicted(flights, flight(12, 4.1))["q", "offset"]
    assert (told.flights, round(told.value, 1), told.chance(4.1) < 1e-6 < 0.1 < told.chance(0.2)) == (12, 0.1, True)


def test_reads_text():
    read = Constant(sensor="q", name="offset", value=4.2, deviation=0.05)
    before = Prediction(flights=12, value=0.1, deviation=0.2, degrees=11.0, spread=0.2, low=-0.2, high=0.4)
    assert reads_text(read, before) == ("q reads 4.1 deg/s too much throughout; in 12 flights before at most 0.3")


def test_history():
    assert alike_of([("p", "offset"), ("q", "offset"), ("q", "misalignment p"), ("q of IMU2", "offset")]).tolist() == [
        0,
        0,
        1,
        2,
    ]
