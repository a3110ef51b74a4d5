"""A channel whose samples go missing is a finding of its own, with its times; a common gap is none."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.detectors.alarm import MISSING
from gtmbench.detectors.monitor.missing import MissingSamples
from gtmbench.files.shipped import shipped_banks
from gtmbench.testing.contract.subject import contract_case
from gtmbench.testing.contract.suite import check_property
from gtmbench.testing.contract.watching import STREAM, WATCH
from tests.helpers import watching
from tests.helpers.monitors import chunks, monitor, record
from tests.helpers.night import by_day

PERIOD_S = 0.02
TOLERATED = 25  # samples: half a second
ONSET_S = 60.0
CHANNELS = [(bank, channel) for bank in ("C", "B") for channel in gb.load_bank(bank).channels]


@cache
def healthy():
    return record(5000, seed=11)


def dropped(channel, onset_s=ONSET_S, of=None, **settings):
    return gb.inject(healthy() if of is None else of, gb.Dropout(channel=channel, onset_s=onset_s, **settings))


def without(channels, rows, of=None):
    """Return a record whose channels miss some rows."""
    of = healthy() if of is None else of
    for channel in channels:
        values = np.array(of[channel])
        values[rows] = np.nan
        of = of.replace(channel, values)
    return of


def dropouts(watch):
    return [alarm for alarm in watch.alarms if alarm.test == MISSING]


def others(watch):
    return [alarm for alarm in watch.alarms if alarm.test != MISSING]


# who, and when


@pytest.mark.parametrize(("bank", "channel"), by_day(CHANNELS, 6, seed=78))
def test_every_channel_of_a_bank_that_goes_missing_is_found_named_and_seen_to_come_back(bank, channel):
    (alarm,) = monitor(bank).watch(dropped(channel, duration_s=15.0)).alarms
    assert (alarm.onset_s, alarm.time_s) == (ONSET_S, pytest.approx(ONSET_S + TOLERATED * PERIOD_S))
    assert (alarm.source, alarm.sensor, alarm.candidates, alarm.last.kind) == (channel, channel, (channel,), "dropout")
    assert alarm.isolated_s == alarm.time_s
    assert alarm.ended_s == ONSET_S + 15.0
    assert alarm.ended_s < alarm.end_known_s <= alarm.ended_s + 4 * TOLERATED * PERIOD_S
    assert not alarm.has_passed


@pytest.mark.parametrize("bank", by_day(shipped_banks(), 2))
def test_a_channel_that_stays_away_has_no_end_and_one_that_was_never_there_is_missing_from_the_start(bank):
    (gone,) = monitor(bank).watch(dropped("r")).alarms
    assert (gone.ended_s, gone.end_known_s) == (None, None)
    (never,) = monitor(bank).watch(without(["r"], slice(None))).alarms
    assert (never.sensor, never.onset_s, never.time_s, never.ended_s) == ("r", 0.0, TOLERATED * PERIOD_S, None)


# common gaps


def test_a_common_gap_is_no_finding():
    assert monitor("C").watch(without(healthy().channels, slice(3000, 3500))).alarms == ()
    assert monitor("C").watch(without(monitor("C").channels, slice(3000, 3500))).alarms == ()  # others don't count
    assert monitor("C").watch(without(healthy().channels, slice(None))).alarms == ()


@example(runs=[("a ", 1), ("  ", 14), ("a ", 5)], cuts=[])  # the first of a window is missing
@example(runs=[("a ", 6), ("  ", 13), (" b", 8)], cuts=[])  # one is back where the other goes
@given(
    runs=st.lists(st.tuples(st.sampled_from(["  ", "a ", " b", "ab"]), st.integers(1, 22)), min_size=1, max_size=12),
    cuts=st.one_of(st.just(range(270)), st.lists(st.integers(0, 270), max_size=6)),
)
def test_the_rule_is_the_one_that_is_told_in_whatever_chunks(runs, cuts):
    """Half a second is five samples here, two seconds are twenty, a tenth of a second is one."""
    values = np.array([[np.nan if name in row else 0.0 for name in "abc"] for row, long in runs for _ in range(long)])
    values[np.isnan(values[:, :2]).all(axis=1), 2] = np.nan
    edges = sorted({0, len(values), *(cut for cut in cuts if cut < len(values))})
    taken = MissingSamples(("a", "b", "c"), 0.1)
    for first, stop in pairwise(edges):
        if stop == first + 1:
            taken.take_one(values[first].tolist())
        else:
            taken.take(np.isfinite(values[first:stop]))
    told = {}
    for row in range(len(values)):
        news = taken.tell(row, float, len(told))
        assert all(row == (alarm.time_s if alarm.end_known_s is None else alarm.end_known_s) for alarm in news)
        told |= {alarm.number: alarm for alarm in news}
    said = [(each.source, each.onset_s, each.time_s, each.ended_s, each.end_known_s) for each in told.values()]
    assert said == by_the_rule(values, 5, 20)


def by_the_rule(values, tolerated, window):
    """Return whose samples are missing since when, when that is known, and when they are back: by the rule."""
    live = [row for row in range(len(values)) if not np.isnan(values[row]).all()]
    found, out = [], {}
    for at, row in enumerate(live):
        last = live[max(at + 1 - window, 0) : at + 1]
        for column, name in enumerate("abc"):
            missing = int(np.isnan(values[last, column]).sum())
            if name in out and missing <= tolerated / 5:
                back = next(float(row) for row in last if not np.isnan(values[row, column]))
                found[out.pop(name)][3:] = back, float(row)
            elif name not in out and missing > tolerated:
                out[name] = len(found)
                since = next(float(row) for row in last if np.isnan(values[row, column]))
                found.append([name, since, float(row), None, None])
    return [tuple(each) for each in found]


# beside other faults


@pytest.mark.parametrize(
    ("bank", "missing", "failed"),
    by_day([("C", "p", "q"), ("C", "q", "r"), ("C", "r", "p"), ("B", "beta", "p"), ("B", "tas", "q"), ("B", "p", "q")]),
)
def test_a_fault_of_a_sensor_that_doesnt_need_the_missing_one_is_found_as_ever(bank, missing, failed):
    drift = gb.Drift(channel=failed, onset_s=ONSET_S + 5.0, slope=1.0)
    alone = monitor(bank).watch(gb.inject(healthy(), drift)).alarms
    watch = monitor(bank).watch(gb.inject(dropped(missing, ONSET_S), drift))
    assert [alarm.sensor for alarm in dropouts(watch)] == [missing]
    assert watch.alarms[0] == dropouts(watch)[0]
    found = others(watch)[0]
    assert found.source == alone[0].source
    assert found.time_s == pytest.approx(alone[0].time_s, abs=1.0)
    assert found.number == 1
    assert found.fault == 1
    assert failed in found.candidates


def test_a_dropout_changes_nothing_that_was_said_before_or_is_said_of_others_scores():
    jam = gb.inject(healthy(), gb.Jam(channel="q", onset_s=50.0))
    alone, with_dropout = monitor("C").watch(jam), monitor("C").watch(dropped("p", 80.0, of=jam))
    assert others(with_dropout)[0].judgements[:4] == alone.alarms[0].judgements[:4]
    np.testing.assert_array_equal(with_dropout.scores["q"].values, alone.scores["q"].values)
    assert [alarm.number for alarm in with_dropout.alarms] == list(range(len(with_dropout.alarms)))


def test_two_channels_at_once_are_two_findings_in_the_banks_order():
    watch = monitor("C").watch(without(["theta", "p"], slice(3000, 3200)))
    assert [(alarm.number, alarm.sensor, alarm.fault) for alarm in watch.alarms] == [(0, "p", 0), (1, "theta", 1)]


# in time


@cache
def wild():
    """Dropouts that overlap, come and go, begin late, and a fault among them."""
    broken = gb.inject(without(["beta", "phi"], slice(0, 80)), gb.Jam(channel="q", onset_s=52.0, duration_s=15.0))
    broken = dropped("p", 51.0, of=broken, intermittent=gb.Intermittent(period_s=1.5, duty=0.5, jitter=0.3, seed=2))
    return without(["r"], slice(3000, 3300), of=without(broken.channels, slice(2900, 3100), of=broken))


def said(alarms):
    return [
        (alarm.number, alarm.time_s, alarm.onset_s, alarm.source, alarm.test, alarm.ended_s, alarm.end_known_s)
        for alarm in alarms
    ]


@pytest.mark.parametrize("size", by_day([100, 1, 7, 3333]))
def test_a_stream_says_what_the_batch_says_when_it_is_known(size):
    watched = monitor("C").watch(wild())
    assert {alarm.sensor for alarm in dropouts(watched)} == {"p", "r", "phi"}
    assert others(watched)
    stream, told = monitor("C").stream(), {}
    for chunk in chunks(wild(), size):
        for alarm in stream.push(chunk):
            if alarm.number not in told:
                assert chunk.start_s - 1e-9 <= alarm.time_s <= chunk.end_s + 1e-9
            if alarm.end_known_s is not None and getattr(told.get(alarm.number), "end_known_s", None) is None:
                assert chunk.start_s - 1e-9 <= alarm.end_known_s <= chunk.end_s + 1e-9
            told[alarm.number] = alarm
    assert said(stream.alarms) == said(watched.alarms)
    assert tuple(told.values()) == stream.alarms


# scored, watched in logs, told


@pytest.mark.parametrize("channel", by_day(monitor("C").channels))
def test_a_dropout_is_scored_as_found_named_and_of_the_right_kind(channel):
    fault = gb.Dropout(channel=channel, onset_s=ONSET_S, duration_s=10.0)
    broken = gb.inject(healthy(), fault)
    verdict = gb.score(monitor("C").watch(broken), fault=fault, healthy=healthy(), broken=broken)
    assert (verdict.detected, verdict.isolated, verdict.named_wrong) == (True, True, False)
    assert (verdict.axis_right, verdict.kind_right, verdict.kind_right_20s) == (True, True, True)
    assert (verdict.false_alarms, verdict.altered_share) == (0, 1.0)
    assert verdict.detection_delay_s == verdict.isolation_delay_s == TOLERATED * PERIOD_S
    assert verdict.end_error_s == 0.0


@pytest.mark.nightly
def test_the_shipped_scenario_is_named_by_bank_c_as_it_expects():
    trials = gb.run("dropout", detectors=[watching.monitor()])
    assert [(trial.channel, trial.sensor, trial.kind) for trial in trials] == [(c, c, "dropout") for c in "pqr"]
    assert all(trial.expected is not None and trial.unexpected == () for trial in trials)


@cache
def case_of(channel):
    fault = gb.Dropout(channel=channel, onset_s=30.0, duration_s=5.0)
    return contract_case(monitor("C"), [record(2750, seed=seed) for seed in (1, 4)], fault=fault)


@pytest.mark.parametrize("channel", ["p", "psi"])
@pytest.mark.parametrize("name", by_day(sorted([*WATCH, *STREAM], key="cut".__ne__), 3))
def test_a_bank_keeps_the_contract_on_a_record_with_a_dropout(channel, name):
    check_property(case_of(channel), name)
