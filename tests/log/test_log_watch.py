"""`watch_log`: what is identified on isn't watched, and the other way round; spans, rates, gaps, reasons."""

from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.detectors.alarm import Judgement
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.judging.monitored import _limits, beyond
from gtmbench.log.opening.records import first_part, healthy_spans, within, without
from gtmbench.log.watch import bank_between, watch_log
from gtmbench.values.channels import header_of
from gtmbench.verdict.timeline import State
from gtmbench.verdict.verdict import Outcome
from tests.helpers import monitors as made_up
from tests.helpers.airliner import airliner

C = gb.load_bank("C")
QUICK = bank_between(["p", "beta", "ny"], ["r"])


@pytest.fixture(scope="module")
def folder():
    return Path(mkdtemp())


@cache
def flight(seed=1, rate_hz=25):
    """Return a minute, all axes moved in either half, on a clock that begins at 100 s."""
    flown = airliner("minute", seed, rate_hz=rate_hz, duration_s=60)
    return gb.Record(flown.values, channels=flown.channels, sample_period_s=1.0 / rate_hz, start_s=100.0)


@pytest.fixture(scope="module")
def logs(folder):
    """Write a flight, one with a fault, one with a gap, others, and return a function that names them."""
    healthy = flight()
    broken = gb.inject(healthy, gb.Drift(channel="q", onset_s=143.0, slope=0.5))
    written = {"healthy": healthy, "broken": broken, "other": flight(7), "fast": flight(3, 100)}
    for name, record in written.items():
        gb.write_log(record, folder / f"{name}.csv")
    lines = (folder / "broken.csv").read_text().splitlines(keepends=True)
    (folder / "gap.csv").write_text("".join(lines[:401] + lines[501:]))  # 116 to 120 s
    return lambda name: folder / f"{name}.csv"


def times(parts):
    return [round(float(t), 6) for part in parts for t in part.time_s]


def a_log(start_s, period_s, gaps):
    """Return a log of 200 samples, split at gaps, of a channel that counts them."""
    count = gb.Record(np.arange(200.0), channels=["p"], sample_period_s=period_s, start_s=start_s)
    edges = [0, *sorted(gaps), 200]
    stretches = [(a, b) for a, b in pairwise(edges) if b - a > 3]
    segments = tuple(count.between(count.time_s[a], count.time_s[b - 2]) for a, b in stretches)
    return FlightLog(path=Path("x.csv"), segments=segments, remarks=(), method=())


def kept(log, span):
    """Return the samples of every segment that lie in a span."""
    slack = 1e-6 * log.sample_period_s
    return [
        segment["p"][(segment.time_s >= span[0] - slack) & (segment.time_s <= span[1] + slack)]
        for segment in log.segments
    ]


bounds = st.one_of(st.floats(-0.2, 1.2), st.integers(0, 199).map(lambda k: k / 199.0), st.just(np.inf))


@given(
    st.sampled_from([0.0, 100.0, -3.3, 1.7e9]),
    st.sampled_from([0.04, 0.01, 1.0 / 30.0]),
    st.lists(st.integers(1, 199), max_size=3),
    st.lists(st.tuples(bounds, bounds), min_size=1, max_size=4),
)
def test_every_sample_is_identified_on_or_watched_never_both(start_s, period_s, gaps, given_spans):
    log = a_log(start_s, period_s, gaps)
    spans = [tuple(sorted(start_s + 199 * period_s * share for share in pair)) for pair in given_spans]
    assume(all(b - a > 3 * period_s for a, b in spans))
    there = [any(k.size > 1 for k in kept(log, span)) for span in spans]
    if not all(there):
        with pytest.raises(InputError, match=r"hold nothing of x\.csv"):
            healthy_spans(log, spans)
        return
    healthy = healthy_spans(log, spans)
    assert all(end < later for (_, end), (later, _) in pairwise(healthy))
    learnt, watched = (
        [v for part in parts for v in part["p"]] for parts in (within(log, healthy), without(log, healthy))
    )
    assert len(set(learnt)) == len(learnt)
    assert not set(learnt) & set(watched)
    alone = 2 * (len(healthy) + len(log.segments)) + 2 * len(healthy)  # single samples, and those beside a span's ends
    assert len(learnt) + len(watched) >= sum(map(len, log.segments)) - alone
    slack = 1e-6 * period_s + 1e-6
    asked = [k for k in learnt if any(a - slack <= start_s + k * period_s <= b + slack for a, b in spans)]
    assert asked == learnt


def test_a_span_that_ends_on_a_sample_has_it_and_the_watch_begins_with_the_next():
    log = a_log(10.0, 0.04, [])
    (part,) = within(log, [(10.4, 11.2)])
    before, after = without(log, [(10.4, 11.2)])
    assert (part.start_s, round(part.end_s, 9)) == (10.4, 11.2)
    assert (round(before.end_s, 9), round(after.start_s, 9)) == (10.36, 11.24)


def test_a_bank_learns_from_what_is_healthy_and_watches_the_rest(logs):
    watched = watch_log(logs("broken"), C, healthy=[(100.0, 130.0)])
    assert watched.outcome is Outcome.FAILED
    assert [alarm.sensor for alarm in watched.alarms] == ["q"]
    assert watched.identified_s == ((100.0, 130.0),)
    assert [(watch.record.start_s, watch.record.end_s) for watch in watched.watches] == [(130.04, 160.0)]
    assert watched.monitor.provenance["healthy_s"] == [[100.0, 130.0]]
    assert watched.reasons == ()


def test_it_is_the_same_as_cutting_by_hand(logs):
    watched = watch_log(logs("healthy"), QUICK, healthy=[(100.0, 130.0)])
    record = gb.read_log(logs("healthy")).select(QUICK.channels)
    monitor = gb.calibrate(record.between(100.0, 130.0), bank=QUICK, false_alarms_per_hour=1.0)  # as for all energies
    by_hand = gb.watch(monitor, record.between(130.04, 160.0))
    np.testing.assert_allclose(watched.watches[0].scores["r"].values, by_hand.scores["r"].values, rtol=1e-9)


@pytest.mark.nightly
def test_other_logs_teach_and_all_of_this_one_is_watched(logs):
    watched = watch_log(logs("broken"), C, healthy=[logs("other")])
    assert watched.identified_s == ()
    assert (watched.watches[0].record.start_s, watched.watches[0].record.end_s) == (100.0, 160.0)
    assert [alarm.sensor for alarm in watched.alarms] == ["q"]
    assert [log["name"] for log in watched.monitor.provenance["logs"]] == ["other.csv"]
    both = watch_log(logs("broken"), QUICK, healthy=[(100.0, 130.0), str(logs("other"))])
    assert [log["name"] for log in both.monitor.provenance["logs"]] == ["other.csv", "broken.csv"]
    assert both.monitor.provenance["records"] == 2


def test_a_gap_inside_a_span_makes_two_records_of_it(logs):
    watched = watch_log(logs("gap"), QUICK, healthy=[(100.0, 130.0)])
    assert watched.monitor.provenance["records"] == 2
    assert [round(watch.record.start_s, 6) for watch in watched.watches] == [130.04]
    outside = watch_log(logs("gap"), QUICK, healthy=[(125.0, 160.0)])
    assert [round(watch.record.end_s, 6) for watch in outside.watches] == [115.96, 124.96]


def test_what_is_too_short_beside_the_longest_isnt_identified_on_and_that_is_said(logs):
    watched = watch_log(logs("healthy"), QUICK, healthy=[(100.0, 130.0), (150.0, 152.0)])
    assert watched.monitor.provenance["records"] == 1
    assert len(watched.watches) == 2
    assert "1 of 2 healthy stretches weren't identified on" in watched.reasons[-1]


def test_without_a_word_the_first_part_is_taken_as_healthy_and_that_is_said(logs):
    watched = watch_log(logs("healthy"), QUICK)
    assert watched.identified_s == ((100.0, 124.0),)
    assert "100..124 s were taken as healthy, for nothing else was said" in watched.reasons
    assert first_part(a_log(0.0, 10.0, [])) == (0.0, 300.0)


@pytest.mark.nightly
def test_rates_follow_the_log_up_to_100_hz_and_the_monitor(logs, folder):
    fast = flight(3, 100)
    doubled = np.column_stack([np.interp(np.arange(12_000) / 2.0, np.arange(6001), column) for column in fast.values.T])
    twice = gb.Record(doubled, channels=fast.channels, sample_period_s=0.005)
    gb.write_log(twice, folder / "double.csv")
    assert watch_log(logs("healthy"), QUICK).log.sample_period_s == 0.04
    assert watch_log(logs("fast"), QUICK).log.sample_period_s == 0.01
    brought = watch_log(folder / "double.csv", QUICK)
    assert brought.log.sample_period_s == 0.01
    assert watch_log(logs("fast"), QUICK, rate_hz=50.0).log.sample_period_s == 0.02
    again = watch_log(folder / "double.csv", brought.monitor)
    assert (again.log.sample_period_s, again.alarms) == (0.01, ())
    assert again.timeline.at("r", 130.0 - 100.0).reason.startswith("only an error of 3")  # of so little motion
    slower = watch_log(logs("healthy"), QUICK, healthy=[logs("fast")])
    assert slower.monitor.sample_period_s == 0.04


def test_samples_far_slower_than_the_monitor_are_refused_in_a_line(folder):
    """What lies between a 10 Hz attitude's samples isn't in them; gyros beside it at the monitor's rate don't help."""
    slow = made_up.record(3000, seed=91).frame().reset_index()
    slow.loc[slow.index % 5 != 0, ["phi", "theta", "psi"]] = np.nan
    slow.rename(columns=header_of).to_csv(folder / "slow.csv", index=False)
    with pytest.raises(InputError, match=r"slow.csv: samples of phi come at 10 Hz, and the monitor watches at 50 Hz"):
        watch_log(folder / "slow.csv", made_up.monitor())


@pytest.mark.nightly
def test_a_log_that_loses_every_fiftieth_row_is_watched_throughout(folder):
    whole = made_up.record(12_000, seed=92).frame().reset_index()
    kept = np.random.default_rng(1).random(len(whole)) >= 0.02
    spans = []
    for name, rows in (("whole.csv", whole), ("lossy.csv", whole[kept])):
        rows.rename(columns=header_of).to_csv(folder / name, index=False)
        watched = watch_log(folder / name, made_up.monitor())
        assert watched.outcome is Outcome.HEALTHY
        spans.append(watched.armed_hours)
    assert spans[1] > 0.95 * spans[0]


def test_nothing_left_and_too_little_left_cant_be_told(logs):
    nothing = watch_log(logs("healthy"), QUICK, healthy=[(-np.inf, np.inf)])
    assert (nothing.outcome, nothing.watches) == (Outcome.UNKNOWN, ())
    assert nothing.reasons[0] == "nothing of the log is left to watch"
    little = watch_log(logs("healthy"), QUICK, healthy=[(100.0, 159.5)])
    assert (little.outcome, little.reasons[0]) == (Outcome.UNKNOWN, "what is left to watch is too short")


@pytest.mark.parametrize(
    ("spreads", "level", "said"),
    [
        ([3.1] * 10 + [1.0] * 90, 1.0, "10 % of the time the motion was beyond what identification held"),
        ([3.1] * 9 + [2.9] * 91, 1.0, ""),
        ([1.0], 3.1, "the noise is another one than calibrated for (p 3.1 times as strong)"),
        ([1.0], 2.9, ""),
        ([1.0], 0.34, ""),
        ([1.0], 0.32, "the noise is another one than calibrated for (p 0.32 times as strong)"),
    ],
)
def test_motion_and_noise_beyond_what_was_identified_on_are_said(spreads, level, said):
    watch = SimpleNamespace(widening={"p": np.array(spreads)}, noise_levels={"p": level}, scores={}, armed_hours=1.0)
    told = _limits([watch])
    assert len(told) == bool(said)
    assert said in "".join(told)


@pytest.mark.parametrize(("since_s", "is_other"), [(-15.1, True), (-14.9, False), (39.9, False), (40.1, True)])
def test_an_alarm_of_a_gyro_that_is_named_within_a_quarter_of_a_minute_is_no_other(since_s, is_other):
    named = Judgement(time_s=55.0, sensor="q", candidates=("q",))
    told = gb.Alarm(number=0, time_s=52.0, onset_s=50.0, source="q", judgements=(named,), ended_s=90.0)
    other = gb.Alarm(number=1, time_s=50.0 + since_s, onset_s=0.0, source="q", judgements=(named,))
    assert beyond([told], [other]) == ((other,) if is_other else ())


@pytest.mark.parametrize(
    ("healthy", "words"),
    [
        ([(0.0, 50.0)], r"0..50 s hold nothing of healthy.csv, which runs from 100 to 160 s; choose a span inside"),
        ([(200.0, 300.0)], r"200..300 s hold nothing"),
        ([(120.0, 110.0)], r"120..110 s hold nothing"),
        ([(np.nan, 110.0)], r"nan..110 s hold nothing"),
        ([(100.0, 103.0)], r"a healthy record of 3.04 s is too short"),
        (["nowhere.csv"], r"nowhere.csv"),
        (["healthy"], r"healthy.csv is the log that is watched; give a span of it"),
    ],
)
def test_what_isnt_there_or_isnt_fair_is_refused(logs, healthy, words):
    healthy = [logs("healthy") if source == "healthy" else source for source in healthy]
    with pytest.raises(InputError, match=words):
        watch_log(logs("healthy"), QUICK, healthy=healthy)


def test_a_monitor_that_is_ready_takes_no_other_orders(logs):
    ready = watch_log(logs("healthy"), QUICK).monitor
    with pytest.raises(InputError, match="isn't identified anew"):
        watch_log(logs("other"), ready, healthy=[(100.0, 120.0)])
    with pytest.raises(InputError, match="a rate of 50 Hz is given, and the monitor has its own, 25 Hz"):
        watch_log(logs("other"), ready, rate_hz=50.0)


def nothing_said(watched, sensor):
    """Return why a sensor isn't judged at any time, and a log without an alarm no all-clear."""
    (span,) = {(span.state, span.reason) for span in watched.timeline.sensors[sensor] if span.reason not in ("gap",)}
    assert (span[0], watched.outcome) == (State.NOT_JUDGED, Outcome.UNKNOWN)
    return span[1]


class Limit(gb.SimpleDetector):
    """Somebody's own: it learns the greatest |p|, and promises no rate."""

    name, channels, memory_s = "limit", ("p",), 0.0

    def learn(self, records):
        return {"p": 1.2 * max(np.nanmax(np.abs(record["p"])) for record in records)}

    def scores(self, record, learned):
        return {"p": np.abs(record["p"]) / learned["p"]}


def test_a_detector_of_ones_own_learns_from_what_is_healthy_and_watches_the_rest(logs):
    watched = watch_log(logs("healthy"), Limit(), healthy=[(100.0, 120.0), logs("other")])
    assert (watched.alarms, watched.reasons) == ((), ())
    assert nothing_said(watched, "p") == "limit states no size that it would find, so its silence says nothing"
    largest = max(
        np.abs(gb.read_log(logs("other"))["p"]).max(), np.abs(gb.read_log(logs("healthy")).between(100, 120)["p"]).max()
    )
    assert watched.monitor.learned["p"] == pytest.approx(1.2 * largest)
    assert watched.monitor.provenance["healthy_s"] == [[100.0, 120.0]]
    assert [log["name"] for log in watched.monitor.provenance["logs"]] == ["other.csv", "healthy.csv"]
    assert 3600.0 * watched.armed_hours == pytest.approx(40.0, abs=0.1)
    with pytest.raises(InputError, match=r"'limit' can't promise 0\.1 false alarms an hour; leave the rate out"):
        watch_log(logs("healthy"), Limit(), false_alarms_per_hour=0.1)


def test_a_function_learns_nothing_and_watches_all_of_it(logs):
    def fast(record):
        return record.time_s[[20, 300]]

    watched = watch_log(logs("gap"), fast)
    assert watched.identified_s == ()
    assert [alarm.time_s for alarm in watched.alarms] == [
        watch.record.time_s[k] for watch in watched.watches for k in (20, 300)
    ]
    assert (watched.outcome, watched.monitor.name, len(watched.watches)) == (Outcome.FAILED, "fast", 2)
    states = {sensor: span.state for sensor in watched.timeline.sensors for span in watched.timeline.sensors[sensor]}
    assert set(states.values()) == {State.SUSPECTED}  # a function that says of no channels what it reads: of each
    silent = watch_log(logs("gap"), lambda _: [])
    assert {nothing_said(silent, sensor) for sensor in silent.log.channels} == {
        "<lambda> states no size that it would find, so its silence says nothing"
    }
    assert watch_log(logs("fast"), fast, rate_hz=50.0).log.sample_period_s == 0.02
    with pytest.raises(InputError, match="isn't identified anew"):
        watch_log(logs("gap"), fast, healthy=[(100.0, 110.0)])


def test_the_dissertations_operator_takes_two_healthy_stretches(logs):
    between = gb.DissertationOperator(inputs=("p", "beta", "ny"), causal_order=10, noncausal_order=10, window=50)
    watched = watch_log(logs("healthy"), between, healthy=[(100.0, 115.0), (120.0, 140.0)])
    assert (watched.verdict.scope.sensors, watched.alarms) == (("r", "p", "beta", "ny"), ())
    assert nothing_said(watched, "r") == "dissertation states no size that it would find, so its silence says nothing"
    by_hand = gb.identify(
        gb.read_log(logs("healthy")).between(100.0, 115.0),
        inputs=between.inputs,
        outputs=["r"],
        causal_order=10,
        noncausal_order=10,
    )
    np.testing.assert_allclose(watched.monitor.operator.markov, by_hand.markov, rtol=1e-9, atol=1e-12)
    with pytest.raises(InputError, match="takes its threshold from another; 1 given"):
        watch_log(logs("healthy"), between, healthy=[(100.0, 115.0)])


def test_a_score_that_stands_above_from_the_start_cant_be_told_and_that_is_said(logs, folder):
    """No alarm, and not healthy either: a fault from the beginning, or other sensors."""
    ready = watch_log(logs("healthy"), Limit()).monitor
    shaken = gb.read_log(logs("healthy"))
    gb.write_log(shaken.replace("p", shaken["p"] + 50.0), folder / "shaken.csv")
    watched = watch_log(folder / "shaken.csv", ready)
    assert (watched.outcome, watched.alarms, watched.armed_hours, watched.stuck_above) == (
        Outcome.UNKNOWN,
        (),
        0.0,
        ("p",),
    )
    (reason,) = watched.reasons
    assert reason.startswith(
        "the score of p stood above its threshold from 100.00 s on and never came down, so it has no verdict"
    )
