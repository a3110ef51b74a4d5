"""When a fault began and ended: estimated by itself, with an interval that holds it, and by nothing that came later."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.isolation.fits import rows_between
from tests.helpers import monitors
from tests.helpers.night import by_day

PERIOD_S = 0.02
RECORD = dict(samples=6000, seed=11)  # noqa: C408


def drawn(name, fault, **at):
    """Return a fault of a kind, strong enough to be found on the made-up record."""
    truth = monitors.truth(**RECORD)[at["channel"]]
    figures = {
        gb.Bias: {"size": 2.0},
        gb.Drift: {"slope": 0.5},
        gb.ScaleFactor: {"factor": 0.5},
        gb.Oscillation: {"amplitude": 4.0, "frequency_hz": 3.0},
        gb.Noise: {"deviation": 4.0, "seed": 5},
        gb.Saturation: {"limit": 0.4 * float(np.abs(truth).max())},
        gb.RateSaturation: {"rate_limit": 0.2 * float(np.abs(np.diff(truth)).max()) / PERIOD_S},
        gb.Hysteresis: {"width": float(truth.std())},
        gb.Stale: {"hold_s": 0.2},
        gb.Quantisation: {"quantum": 3.0},
        gb.Jam: {},
    }
    return fault(**at, **figures[fault], **name)


READ = (gb.Jam, gb.Stale, gb.Quantisation, gb.Hysteresis)  # kinds whose first wrong reading dates itself
ALL = (*READ, gb.Bias, gb.Drift, gb.ScaleFactor, gb.Oscillation, gb.Noise, gb.Saturation, gb.RateSaturation)


@pytest.mark.parametrize("kind", by_day(ALL, 2))
def test_the_interval_of_the_onset_holds_it(kind):
    held, off_s, drawing = 0, [], np.random.default_rng(3)
    for channel in ("p", "q", "r"):
        onset_s = 60.0 + float(drawing.uniform(0.0, 1.0))  # between two samples
        broken = gb.inject(monitors.record(**RECORD), drawn({}, kind, channel=channel, onset_s=onset_s))
        judged = monitors.monitor("C").watch(broken).faults[0].last
        assert judged.sensor == channel
        low_s, high_s = judged.intervals["onset_s"]
        assert low_s <= judged.parameters["onset_s"] <= high_s
        held += low_s - 1e-9 <= onset_s <= high_s + 1e-9
        off_s.append(abs(judged.parameters["onset_s"] - onset_s))
    assert held >= 2  # of three, of which one in twenty may be outside
    assert np.median(off_s) <= (PERIOD_S if kind in READ else 1.5 if kind is gb.Drift else 0.3)


@pytest.mark.parametrize("onset_s", by_day([8.0, 12.0]))
@pytest.mark.parametrize("kind", by_day(ALL, 2))
def test_an_onset_soon_after_watching_began_is_told_or_left_open(kind, onset_s):
    for channel in ("q", "phi"):
        if kind in (gb.Drift, gb.RateSaturation) and channel == "phi":
            continue
        fault = gb.Jam(channel=channel, onset_s=onset_s) if kind is gb.Jam else None
        fault = fault or drawn({}, kind, channel=channel, onset_s=onset_s)
        watch = monitors.monitor("C").watch(gb.inject(monitors.record(**RECORD), fault).between(0.0, 40.0))
        for judged in (each for alarm in watch.faults for each in alarm.judgements):
            low_s, high_s = judged.intervals.get("onset_s", (0.0, 40.0))
            assert low_s <= high_s


@pytest.mark.parametrize("kind", by_day([gb.Bias, gb.ScaleFactor, gb.Saturation]))
def test_the_interval_of_the_end_holds_it(kind):
    fault = drawn({"duration_s": 8.37}, kind, channel="p", onset_s=60.0)
    (alarm,) = monitors.monitor("C").watch(gb.inject(monitors.record(**RECORD), fault)).faults
    low_s, high_s = alarm.ended_between_s
    assert low_s <= alarm.ended_s <= high_s < low_s + 3.0
    assert low_s <= 68.37 <= high_s


def test_limits_and_quanta_are_read_off_the_readings():
    for kind, name in ((gb.Saturation, "limit"), (gb.RateSaturation, "rate_limit"), (gb.Quantisation, "quantum")):
        fault = drawn({}, kind, channel="q", onset_s=60.0)
        judged = monitors.monitor("C").watch(gb.inject(monitors.record(**RECORD), fault)).faults[0].last
        assert judged.parameters[name] == pytest.approx(getattr(fault, name), rel=1e-6)
        low, high = judged.intervals[name]
        assert low <= getattr(fault, name) <= high


def test_a_change_of_known_size_in_white_noise_is_in_its_interval_as_often_as_stated():
    random, held = np.random.default_rng(4), 0
    for _ in range(400):
        change = int(random.integers(100, 200))
        noise = random.standard_normal(300)
        left = noise[:, np.newaxis] + (np.arange(300)[:, np.newaxis] >= change) * 1.0
        undone = left - (np.arange(300)[:, np.newaxis] >= np.arange(300)) * 1.0
        low, row, high = rows_between(np.square(undone).sum(axis=0), 1.0)
        assert low <= row <= high
        held += low <= change <= high
    assert 0.92 <= held / 400 <= 0.99
