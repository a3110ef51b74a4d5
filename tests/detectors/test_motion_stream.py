"""Of motion beyond what was identified a stream says what the watch of the whole record says, to the last digit."""

from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.monitor.regime import Regime, RegimeStream
from gtmbench.intake.formats import registry
from gtmbench.log.live_watch import watch_live
from gtmbench.log.watch import watch_log
from gtmbench.values.channels import header_of
from tests.helpers.monitors import chunks, monitor, record
from tests.helpers.night import by_day

PERIOD_S, ROWS = 0.02, 6000
CHUNKS = (37, 1, 1000)
GYROS, ANGLES = ("p", "q", "r"), ("phi", "theta", "psi")


@cache
def regime():
    return Regime.of([record(seed=seed) for seed in (1, 2, 3)])


@cache
def minding(bank="C"):
    """Return a monitor that knows how hard the motion was that it was calibrated on."""
    return replace(monitor(bank), provenance={**monitor(bank).provenance, "regime": regime().table})


def flight(seed, rows=ROWS):
    """Return a flight that is shaken now and then, misses samples and breaks now and then."""
    random, healthy = np.random.default_rng(seed), record(rows, seed=700 + seed)
    values, names = healthy.values.copy(), healthy.channels
    for _ in range(random.integers(1, 4)):
        first, axis = int(random.integers(600, rows - 60)), int(random.integers(0, 3))
        count = min(int(random.integers(5, 300)), rows - first)
        time_s = np.arange(count) * PERIOD_S
        swing = random.uniform(15.0, 40.0) * np.sin(np.pi * np.arange(count) / count) ** 2
        swing *= np.sin(2.0 * np.pi * random.uniform(0.5, 3.0) * time_s)
        shaken = slice(first, first + count)
        values[shaken, names.index(ANGLES[axis])] += swing
        values[shaken, names.index(GYROS[axis])] += np.gradient(swing, PERIOD_S)
        if random.random() < 0.5:  # that isn't known of the motion, and would raise an alarm
            values[shaken, names.index(GYROS[(axis + 1) % 3])] += random.uniform(2.0, 8.0)
    if random.random() < 0.5:
        first = int(random.integers(600, rows - 300))
        values[first : first + int(random.integers(1, 200)), int(random.integers(0, 6))] = np.nan
    shaken = gb.Record(values, channels=names, sample_period_s=PERIOD_S)
    if random.random() < 0.4:
        return shaken
    gyro, onset_s = GYROS[int(random.integers(0, 3))], float(random.uniform(40.0, 0.9 * rows * PERIOD_S))
    faults = gb.Bias(channel=gyro, onset_s=onset_s, size=3.0), gb.Jam(channel=gyro, onset_s=onset_s)
    return gb.inject(shaken, faults[int(random.integers(0, 2))])


def said(alarms):
    """Return all that alarms say, figures to nine digits: sums over chunks round otherwise."""

    def plain(value):
        if isinstance(value, dict):
            return {key: plain(each) for key, each in value.items()}
        if isinstance(value, (list, tuple)):
            return [plain(each) for each in value]
        return f"{value:.9g}" if isinstance(value, float) else value

    return [plain(asdict(alarm)) for alarm in alarms]


@pytest.mark.parametrize("rows", by_day(CHUNKS))
@pytest.mark.parametrize("seed", by_day(range(6), 2))
def test_stretches_beyond_are_those_of_the_rows_so_far(seed, rows):
    flown, known = flight(seed, rows=3000), RegimeStream(regime(), PERIOD_S)
    for number, chunk in enumerate(chunks(flown, rows)):
        known.take(chunk)
        if number % max(2000 // rows, 1) == 0:
            so_far = flown.part(range(min((number + 1) * rows, len(flown))))
            assert list(known.excursions) == regime().stretches(so_far)
    assert list(known.excursions) == regime().stretches(flown)
    assert known.excursions


CASES = [*((seed, (37, 1000)[seed % 2], "C") for seed in range(8)), (3, 61, "C-early"), (4, 1, "C")]


@pytest.mark.parametrize(("seed", "rows", "bank"), by_day(CASES, 0))
def test_a_stream_ends_with_the_alarms_of_the_watch(seed, rows, bank):
    flown = flight(seed)
    whole = minding(bank).watch(flown, outside=regime().stretches(flown))
    stream, told = minding(bank).stream(), {}
    for chunk in chunks(flown, rows):
        told |= {alarm.number: alarm for alarm in stream.push(chunk)}
    assert said(stream.alarms) == said(whole.alarms)
    last = [alarm for _, alarm in sorted(told.items()) if not alarm.has_passed]
    assert said(last) == said(alarm for alarm in whole.alarms if not alarm.has_passed)


@pytest.mark.nightly
def test_chunks_may_have_their_channels_in_any_order_and_lack_witnesses():
    flown = next(each for each in map(flight, range(20)) if regime().stretches(each)).select([*GYROS, *ANGLES, "nz"])
    stream, orders = minding().stream(), ([*ANGLES, *GYROS], ["nz", *GYROS, *ANGLES], flown.channels)
    for number, chunk in enumerate(chunks(flown, 400)):
        stream.push(chunk.select(orders[number % 3]))
    assert said(stream.alarms) == said(minding().watch(flown, outside=regime().stretches(flown)).alarms)


@pytest.mark.nightly
def test_what_was_said_before_a_row_turned_out_to_be_beyond_is_taken_back():
    """A blow that gyros feel first: the alarm is told at once, and is the excursion's when the attitude follows."""
    rows = 3000
    healthy, time_s = record(rows, seed=9), np.arange(rows) * PERIOD_S
    swing = 40.0 * np.sin(2.0 * np.pi * (time_s - 40.2)) * ((time_s >= 40.2) & (time_s < 42.2))
    flown = healthy.replace("phi", healthy["phi"] + swing).replace("p", healthy["p"] + np.gradient(swing, time_s))
    flown = flown.replace("q", flown["q"] + 8.0 * ((time_s >= 40.0) & (time_s < 42.2)))
    stream, told = minding().stream(), []
    for chunk in chunks(flown, 5):
        told += [(chunk.end_s, alarm) for alarm in stream.push(chunk)]
    first, last = told[0], [alarm for _, alarm in told if alarm.number == told[0][1].number][-1]
    assert 40.0 < first[0] < 40.25
    assert not first[1].doubt
    assert last.doubt or last.has_passed
    assert all(alarm.sensor is None for alarm in stream.alarms)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", by_day(range(2)))
def test_a_log_that_comes_in_live_is_told_as_the_log(seed, tmp_path):
    frame = flight(seed, rows=6000).frame().reset_index()
    frame = frame.drop(index=range(3500, 3650))  # a gap of three seconds
    path = tmp_path / "log.parquet"
    frame.rename(columns=header_of).to_parquet(path, index=False)
    whole, told, began_s = watch_log(path, minding()), [{}], -np.inf
    for piece in watch_live(path, minding()):
        for alarm in piece:
            if alarm.time_s > 73.0 > began_s:  # behind the gap alarms are counted anew
                told.append({})
                began_s = alarm.time_s
            told[-1][alarm.number] = alarm
    live = [alarm for segment in told for alarm in segment.values() if not alarm.has_passed]
    assert whole.excursions
    assert said(live) == said(alarm for watch in whole.watches for alarm in watch.alarms if not alarm.has_passed)


@pytest.mark.parametrize("detector", by_day(["C", "auto"], 0))
def test_a_log_is_read_once_whatever_is_wanted_of_it(detector, tmp_path, monkeypatch):
    read, parse = [], registry.read_csv
    monkeypatch.setattr(registry, "CSV", replace(registry.CSV, read=lambda path: read.append(path.name) or parse(path)))
    for seed, name in ((1, "flight"), (2, "other")):
        gb.write_log(record(2500, seed=seed), tmp_path / f"{name}.csv")
    watch_log(tmp_path / "flight.csv", detector, healthy=[(0.0, 30.0), tmp_path / "other.csv"])
    assert sorted(read) == ["flight.csv", "other.csv"]
    read.clear()
    gb.inject_log(tmp_path / "flight.csv", tmp_path / "broken.csv", gb.Bias(channel="p", onset_s=30.0, size=2.0))
    assert read == ["flight.csv"]
