"""The gate before every monitor: what no sensor reads is missing, counted and told, and many of it aren't judged."""

import numpy as np
import pytest

import gtmbench as gb
from tests.helpers import monitors
from tests.helpers.night import by_day


def above_fifty(record):
    """Return when p is above 50 deg/s; what is missing isn't."""
    return record.time_s[record["p"] > 50.0]


class Level(gb.SimpleDetector):
    """How far q is from nothing."""

    name, channels, memory_s = "level", ("q",), 0.0

    def learn(self, records):
        return {"q": max(np.nanmax(np.abs(record["q"])) for record in records)}

    def scores(self, record, learned):
        return {"q": np.abs(record["q"]) / learned["q"] / 1.5}


def simple():
    return Level().calibrate([monitors.record(seed=2)])


MONITORS = {
    "bank": monitors.monitor,
    "simple": simple,
    "function": lambda: gb.FunctionDetector(above_fifty, channels=("p",), memory_s=0.0).calibrate(),
}


def absurd(rows, value=1e30, channel="q"):
    """Return a healthy record and one in which some readings are what no sensor reads, and where these are missing."""
    record = monitors.record(4000, seed=31)
    values, missing = record[channel].copy(), record[channel].copy()
    values[rows], missing[rows] = value, np.nan
    return record.replace(channel, values), record.replace(channel, missing)


def same(watched, other):
    assert [(alarm.time_s, alarm.source, alarm.sensor) for alarm in watched.alarms] == [
        (alarm.time_s, alarm.source, alarm.sensor) for alarm in other.alarms
    ]
    for name, score in watched.scores.items():
        assert np.array_equal(score.values, other.scores[name].values, equal_nan=True)


@pytest.mark.parametrize("kind", MONITORS)
@pytest.mark.parametrize("value", [1e30, -np.inf, 2e5])
def test_a_reading_that_no_sensor_reads_is_missing_and_told(kind, value):
    monitor = MONITORS[kind]()
    broken, missing = absurd([2500], value)
    with pytest.warns(gb.NoteWarning, match="1 reading of q is .*: taken as missing"):
        watched = monitor.watch(broken)
    other = monitor.watch(missing)
    same(watched, other)
    assert [(each.channel, each.count, each.first) for each in watched.out_of_range] == [("q", 1, value)]
    assert not other.out_of_range


@pytest.mark.parametrize("seed", by_day(range(12), 2))
@pytest.mark.parametrize("kind", ["bank", "simple"])
def test_a_second_of_which_more_than_one_percent_is_outside_is_never_armed(kind, seed):
    """More than one in a hundred of any second: whichever readings, whatever they read, whosever they are."""
    monitor, random = MONITORS[kind](), np.random.default_rng(seed)
    channel = str(random.choice(["q", "phi", "psi"])) if kind == "bank" else "q"
    first = int(random.integers(600, 3800))
    rows = first + random.choice(50, int(random.integers(1, 51)), replace=False)
    broken, missing = absurd(rows, random.choice([1e30, -1e9, np.inf, 1e308]), channel)
    with pytest.warns(gb.NoteWarning, match=f"of {channel} (is|are) .*: taken as missing"):
        watched = gb.watch(monitor, broken)
    near, told = slice(rows.min() - 49, rows.max() + 50), False
    for name, score in monitor.watch(missing).scores.items():
        armed, entered = watched.scores[name].armed, not score.channels or channel in score.channels
        told |= entered and score.armed[near].any()
        assert not (entered and armed[near].any())
        assert np.array_equal(armed[: first - 50], score.armed[: first - 50])
        assert np.array_equal(armed[first + 101 :], score.armed[first + 101 :])
        assert entered or np.array_equal(armed, score.armed)
    assert told
    same(watched, monitor.watch(missing))


@pytest.mark.parametrize("kind", MONITORS)
def test_a_stream_passes_the_same_gate(kind):
    monitor = MONITORS[kind]()
    broken, missing = absurd(slice(2500, 3000, 2), channel="p")
    streams = monitor.stream(), monitor.stream()
    for first in range(0, len(broken), 500):
        with_them, without = (each.part(range(first, first + 500)) for each in (broken, missing))
        if np.nanmax(with_them["p"]) > 1e5:
            with pytest.warns(gb.NoteWarning, match="readings of p"):
                streams[0].push(with_them)
        else:
            streams[0].push(with_them)
        streams[1].push(without)
    told = [[(alarm.time_s, alarm.source, alarm.sensor) for alarm in stream.alarms] for stream in streams]
    assert told[0] == told[1]
    assert kind != "bank" or told[0]


def test_a_monitor_of_ones_own_is_watched_through_the_gate():
    class Own(gb.BaseMonitor):
        name, channels = "own", ("p",)

        def watch(self, record):
            assert not (np.abs(record["q"]) > 1e5).any()
            return gb.Watch(monitor=self, record=record, alarms=())

    with pytest.warns(gb.NoteWarning, match="is 1e30"):
        assert gb.watch(Own(), absurd([7])[0]).out_of_range[0].first == 1e30


@pytest.fixture(scope="module")
def flown():
    """All sensors and commands, at 25 Hz, four times."""
    truth = gb.fly(excitation="multisine", duration_s=90.0, seed=1)

    def sensed(seed):
        read = gb.with_gps(gb.measure(truth, noise="t2", seed=seed, commands=True), truth, gb.Gps(), seed=seed)
        return gb.decimate(gb.with_magnetometer(read, truth, gb.Magnetometer(), seed=seed), 4)

    return [sensed(seed) for seed in range(1, 5)]


@pytest.mark.parametrize(
    "name", by_day(["dissertation", "limits", "kalman", "ksfd", "surfaces-no-vanes", "cross-check"], 2)
)
def test_monitors_of_every_sort_pass_the_gate(name, flown):
    *healthy, last = flown
    monitor, random = gb.find_detector(name).calibrate(healthy), np.random.default_rng(68)
    channel = str(random.choice([each for each in monitor.channels or last.channels if each in last.channels]))
    rows = int(random.integers(900, 2000)) + np.arange(20)
    values, missing = last[channel].copy(), last[channel].copy()
    values[rows], missing[rows] = 1e30, np.nan
    broken, without = last.replace(channel, values), last.replace(channel, missing)
    with pytest.warns(gb.NoteWarning, match=f"20 readings of {channel} are .*: taken as missing"):
        watched = monitor.watch(broken)
    same(watched, monitor.watch(without))
    assert [(each.channel, each.count) for each in watched.out_of_range] == [(channel, 20)]
    stream, other = monitor.stream(), monitor.stream()
    with pytest.warns(gb.NoteWarning, match="taken as missing"):
        stream.push(broken)
    other.push(without)
    assert [(alarm.time_s, alarm.sensor) for alarm in stream.alarms] == [
        (alarm.time_s, alarm.sensor) for alarm in other.alarms
    ]
