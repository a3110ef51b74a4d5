"""An airframe's history, by example."""

from gtmbench.history.entry import Constant
from gtmbench.history.overview import Trend, trend_text
from gtmbench.history.spread import Prediction
from gtmbench.history.standing import reads_text


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


def test_reads_text():
    read = Constant(sensor="q", name="offset", value=4.2, deviation=0.05)
    before = Prediction(flights=12, value=0.1, deviation=0.2, degrees=11.0, spread=0.2, low=-0.2, high=0.4)
    assert reads_text(read, before) == ("q reads 4.1 deg/s too much throughout; in 12 flights before at most 0.3")
