"""Banks in the stream and in the batch: one engine, so the same alarms in any chunks and wherever a record is cut."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.bank import load_bank
from gtmbench.detectors.bank_detector import calibrate
from gtmbench.detectors.monitor.open_faults import Arming
from gtmbench.detectors.monitor.scores import ScoreTrack
from gtmbench.values.record import Record
from tests.helpers.monitors import chunks, monitor, record
from tests.helpers.night import by_day

PERIOD_S = 0.02
STATISTICS = {
    "cusum": {"name": "cusum"},
    "energy": {"name": "energy", "windows_s": (0.5, 5.0), "two_sided": False},
    "whitened_energy": {"name": "whitened_energy", "windows_s": (0.5, 5.0)},
}


@cache
def by(statistic):
    """Return a monitor of bank C with another statistic."""
    bank = load_bank("C")
    bank = replace(bank, statistic=replace(bank.statistic, **STATISTICS[statistic]))
    return calibrate([record(seed=seed) for seed in range(1, 4)], bank=bank)


@cache
def uncertain():
    """Return a monitor that stands on one minute."""
    monitor = calibrate(record(3000, seed=1), bank=load_bank("C"))
    assert monitor.uncertainties
    return monitor


@cache
def healthy():
    return record(4000, seed=7)


def changed(given, channel, row, change):
    """Return a record whose channel is another function of itself from a row on."""
    values = np.array(given[channel])
    values[row:] = change(values[row:])
    return given.replace(channel, values)


def jammed(given, channel, row, stop=None):
    values = np.array(given[channel])
    values[row:stop] = values[row - 1]
    return given.replace(channel, values)


def drifting(given, channel, row, slope):
    return changed(given, channel, row, lambda of: of + slope * PERIOD_S * np.arange(len(of)))


def gappy(given):
    for channel, rows in {"p": (900, 902), "psi": (1200, 1300), "r": (1500, 1501), "theta": (3000, 3010)}.items():
        values = np.array(given[channel])
        values[slice(*rows)] = np.nan
        given = given.replace(channel, values)
    return given


FLIGHTS = {
    "decided": lambda: gb.inject(record(7000, seed=23), gb.Lag(channel="q", onset_s=60.0, lag_s=0.3)),
    "healthy": lambda: healthy(),
    "jam": lambda: jammed(healthy(), "p", 2800),
    "two at once": lambda: drifting(jammed(healthy(), "p", 2800), "r", 2820, 1.0),
    "ended, then another": lambda: drifting(jammed(healthy(), "q", 1500, 1900), "q", 2900, 1.0),
    "ended, not known yet": lambda: drifting(jammed(healthy(), "q", 2500, 3250), "q", 3300, 5.0),
    "angle": lambda: drifting(healthy(), "phi", 2800, 2.0),
    "drift": lambda: drifting(healthy(), "r", 2800, 10.0),
    "saturation": lambda: changed(healthy(), "r", 2800, lambda of: np.clip(of, -4.0, 4.0)),
    "gaps": lambda: gappy(drifting(healthy(), "r", 2800, 1.0)),
    "gaps, short": lambda: gappy(jammed(healthy(), "p", 2800)).between(0.0, 61.0),
    "wild from the start": lambda: changed(healthy(), "p", 0, lambda of: of * 3.0),
}


@cache
def flight_of(name):
    return FLIGHTS[name]()


@cache
def watched_by(used, name):
    return used.watch(flight_of(name))


def fed(used, given, size):
    """Return a stream and what its pushes returned."""
    stream = used.stream()
    return stream, [stream.push(chunk) for chunk in chunks(given, size)]


def said(alarms):
    """Return what alarms say, but for figures that round otherwise in other chunks."""
    return [
        (
            *(alarm.number, alarm.time_s, alarm.onset_s, alarm.source, alarm.test),
            [(each.time_s, each.sensor, each.candidates, each.kind) for each in alarm.judgements],
        )
        for alarm in alarms
    ]


def ends(alarms):
    return [(alarm.fault, alarm.ended_s, alarm.end_known_s) for alarm in alarms]


def check_stream(used, name, size):
    given, watched = flight_of(name), watched_by(used, name)
    stream, told = fed(used, given, size)
    assert said(stream.alarms) == said(watched.alarms)
    assert ends(stream.alarms) == ends(watched.alarms)
    for alarm, other in zip(stream.alarms, watched.alarms, strict=True):
        for each, its in zip(alarm.judgements, other.judgements, strict=True):
            # a search may take another turn where residuals differ by a rounding error
            assert each.parameters == pytest.approx(its.parameters, rel=5e-3, nan_ok=True)
    last = {alarm.number: alarm for of in told for alarm in of}
    assert tuple(last[number] for number in sorted(last)) == stream.alarms  # what was returned last is what is known
    assert dict(stream.armed) == {
        name: bool(score.armed[known(score, given)]) for name, score in watched.scores.items()
    }
    return watched


def known(score, given):
    """Return the last row that exists and is known at the end."""
    return np.flatnonzero(score.exists & (score.known_s <= given.end_s + 1e-9))[-1]


@pytest.mark.parametrize(
    ("flight", "size"),
    by_day(
        [
            *((flight, 100) for flight in FLIGHTS if flight != "gaps, short"),
            *((flight, 1) for flight in ("two at once", "ended, then another")),
            ("gaps", 7),
            ("two at once", 4000),
        ]
    ),
)
def test_chunks_of_any_size_say_the_same(flight, size):
    check_stream(monitor("C"), flight, size)


@pytest.mark.parametrize("statistic", by_day(STATISTICS, 0))
def test_every_statistic_streams(statistic):
    assert check_stream(by(statistic), "ended, then another", 50).alarms


def test_a_monitor_in_doubt_streams():
    assert check_stream(uncertain(), "jam", 500).alarms


def exactly(alarms, until_s=np.inf):
    """Return all that is said by a time, figures to nine digits: products of other lengths round otherwise."""
    told = [
        (
            *(alarm.time_s, alarm.onset_s, alarm.source, alarm.test),
            [each for each in alarm.judgements if each.time_s <= until_s],
        )
        for alarm in alarms
        if alarm.time_s <= until_s
    ]
    return re.sub(r"-?\d+\.\d+(?:e-?\d+)?", lambda figure: f"{float(figure[0]):.9g}", repr(told))


@pytest.mark.parametrize(
    ("bank", "flight"),
    by_day(
        [
            ("C", "ended, not known yet"),
            *(("C", flight) for flight in ("two at once", "ended, then another", "angle", "saturation")),
            ("B", "drift"),
            ("leave-one-out", "drift"),
        ]
    ),
)
def test_what_is_said_by_a_time_stands_on_the_record_up_to_then(bank, flight):
    given, whole = flight_of(flight), watched_by(monitor(bank), flight)
    assert whole.alarms
    times = sorted({judged.time_s for alarm in whole.alarms for judged in alarm.judgements})[1::2]
    times += [whole.alarms[0].time_s + after_s for after_s in (0.0, 0.49)] + [given.end_s - 2.0]
    for time_s in times:
        cut = monitor(bank).watch(given.between(0.0, time_s))
        assert exactly(cut.alarms) == exactly(whole.alarms, time_s)
        for output, score in cut.scores.items():
            rows = score.known_s <= time_s + 1e-9
            np.testing.assert_array_equal(score.armed[rows], whole.scores[output].armed[: len(rows)][rows])


def test_a_level_above_from_the_start_is_no_alarm_and_isnt_armed():
    watched = watched_by(monitor("C"), "wild from the start")
    score = watched.scores["p"]
    assert all(watched.scores[alarm.source].armed_s < alarm.time_s for alarm in watched.alarms)
    above = np.flatnonzero(score.exists)[0]
    assert score.armed[above] == (score.values[above] <= 1.0)


def test_a_rise_while_it_was_disarmed_is_told_once_it_is_armed_again_and_chatter_isnt():
    arming = Arming(output="p", source="p", track=ScoreTrack.of(monitor("C"), "p"))
    assert not arming.take(2.0, 0)  # above from the start
    assert not arming.take(0.5, 1)
    assert arming.take(2.0, 2)
    arming.disarm(3, 2)
    assert [arming.take(level, 3) for level in (2.0, np.nan, 3.0)] == [False] * 3
    arming.rearm(6)
    assert not arming.take(2.0, 6)  # it has never come down since
    arming.disarm(7, 7)
    assert [arming.take(level, 7) for level in (0.5, 2.0)] == [False] * 2
    arming.rearm(9)
    assert arming.take(2.0, 9)
    arming.begin_anew(10)
    assert not arming.armed
    assert [arming.take(level, 10) for level in (2.0, 1.0, 2.0)] == [False, False, True]


@pytest.mark.parametrize("seed", range(20))
def test_rows_without_news_change_nothing_of_an_arming(seed):
    random = np.random.default_rng(seed)
    one, other = (Arming(output="p", source="p", track=ScoreTrack.of(monitor("C"), "p"), changes=[]) for _ in range(2))
    for start in range(0, 600, 100):
        scores = random.choice([0.5, 1.0, 2.0, np.nan, np.inf], 100, p=random.dirichlet(np.ones(5)))
        news = one.news(scores)
        assert news.tolist() == sorted(set(news.tolist()))
        risen = [at for at in news.tolist() if one.take(scores[at], start + at)]
        assert risen == [at for at, score in enumerate(scores.tolist()) if other.take(score, start + at)]
        assert vars(one) | {"track": None} == vars(other) | {"track": None}
        for arming in (one, other):
            (arming.disarm, arming.rearm)[start // 100 % 2](start + 100, *(start,) * (1 - start // 100 % 2))


def test_an_alarm_rises_where_its_score_is_armed_and_disarms_it():
    watched = watched_by(monitor("C"), "jam")
    (alarm,) = watched.alarms
    score = watched.scores[alarm.source]
    row = int(np.flatnonzero(np.isclose(score.known_s, alarm.time_s))[0])
    assert score.armed[row]
    assert score.values[row] > 1.0
    assert not score.armed[row + 1 :].any()
    assert score.disarmed_s == pytest.approx(alarm.time_s, abs=1e-9)
    assert watched.disarmed == {alarm.source: score.disarmed_s}


def test_nothing_is_said_of_rows_that_are_known_after_the_end():
    for used in (monitor("C"), uncertain()):
        watched = used.watch(healthy())
        for score in watched.scores.values():
            assert not score.exists[score.known_s > healthy().end_s + 1e-9].any()


def test_an_uncertain_banks_stream_may_begin_with_single_samples():
    """Fewer than an operator looks ahead, too, which once ended it."""
    used, broken = uncertain(), jammed(healthy(), "r", 2000)
    stream, found = used.stream(), {}
    for part in (*(range(row, row + 1) for row in range(30)), range(30, len(broken))):
        found |= {alarm.number: alarm for alarm in stream.push(broken.part(part))}
    assert list(found.values()) == list(used.watch(broken).alarms)
    assert found[0].sensor == "r"


# memory and cost


@pytest.mark.nightly
def test_a_streams_memory_doesnt_grow():
    used = monitor("C")
    stream = used.stream()
    sizes, values, start = [], healthy().values, 0
    for _ in range(16):  # 21 minutes, with an alarm at every seam: how much is held back then is another after each
        for row in range(0, len(values), 250):
            part = values[row : row + 250]
            stream.push(Record(part, channels=healthy().channels, sample_period_s=PERIOD_S, start_s=start * PERIOD_S))
            start += len(part)
        tracks = stream._tracks.values()
        sizes.append(
            (
                len(stream._memory._table),
                max(len(track._rows) for track in tracks),
                max(len(track.values) for track in tracks),
            )
        )
    assert (np.max(sizes[8:], axis=0) <= np.max(sizes[:8], axis=0)).all()


def test_a_record_full_of_alarms_is_diagnosed_a_few_times_only():
    rng = np.random.default_rng(1)
    wild = np.array(healthy().values)
    for row in range(1500, 4000, 40):  # every 0.8 s another burst of another gyro
        wild[row : row + 20, rng.integers(0, 3)] += 20.0 * rng.standard_normal(20)
    given = Record(wild, channels=healthy().channels, sample_period_s=PERIOD_S)
    watched = monitor("C").watch(given)
    assert sum(len(alarm.judgements) > 1 for alarm in watched.alarms) <= 8
