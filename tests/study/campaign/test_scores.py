"""Scores: known rows, known answers; intervals that hold what they promise; no score without quiet; ties as ties."""

import math

import numpy as np
import pytest
from scipy.stats import binomtest, chi2

from gtmbench.errors import InputError
from gtmbench.report.figures.scores import price_curves
from gtmbench.report.page.campaign import who_sees_what
from gtmbench.report.style import strokes
from gtmbench.report.tables.scores import tables
from gtmbench.study.campaign.rows import LADDER, table_of
from gtmbench.study.scores.curves import characteristic, delays_at
from gtmbench.study.scores.intervals import FEWEST_BLOCKS, exact_interval, mean, quantile, rate, share
from gtmbench.study.scores.ranking import compared, holm, ranks
from gtmbench.study.scores.scoring import CANT_TELL, MISSED, scored
from tests.helpers.night import by_day


def healthy(detector, flight, **cells):
    return {
        "task": flight,
        "noise_seed": 1,
        "seed": flight,
        "detector": detector,
        "false_alarms": 0,
        "armed_hours": 0.1,
        **cells,
    }


def trial(detector, flight, delay_s=None, **cells):
    found = {"detected": delay_s is not None, "detection_delay_s": delay_s, "look_ahead_s": 0.1, "peak_ratio": 2.0}
    about = {"fault": "jam", "channel": "p", "severity_name": None}
    return {"task": flight, "noise_seed": 1, "seed": flight, "detector": detector, **about, **found, **cells}


def scores_of(rows, **how):
    return scored(table_of(rows).to_pandas(), **how)


def only(rows, **how):
    (found,) = scores_of(rows, **how).detectors
    return found


# ---- intervals ----


@pytest.mark.parametrize(("hits", "trials"), [(0, 7), (7, 7), (3, 10), (99, 100)])
def test_the_exact_interval_is_scipys(hits, trials):
    known = binomtest(hits, trials).proportion_ci(method="exact")
    assert exact_interval(hits, trials) == pytest.approx((known.low, known.high))


def covered(rng, p, alike, flights=20, trials=12, times=300):
    """Return how often the interval of a share holds the truth, where trials of a flight are alike."""
    held = 0
    for _ in range(times):
        own = np.full(flights, p)
        if alike == 1.0:
            own = (rng.random(flights) < p).astype(float)
        elif alike > 0.0:
            own = rng.beta(p * (1 / alike - 1), (1 - p) * (1 / alike - 1), flights)
        hits = rng.random((flights, trials)) < own[:, None]
        found = share(hits.ravel(), np.repeat(np.arange(flights), trials))
        held += found.low <= p <= found.high
    return held / times


@pytest.mark.parametrize("p", by_day([0.5, 0.9, 0.98], 2))
@pytest.mark.parametrize("alike", [0.0, 0.2, 1.0])
def test_the_interval_of_a_share_holds_the_truth_however_alike_the_trials_of_a_flight_are(p, alike):
    assert covered(np.random.default_rng(5), p, alike) >= 0.93


def test_one_flight_says_next_to_nothing_and_nothing_tried_says_nothing():
    alone = share(np.ones(500, dtype=bool), np.zeros(500, dtype=int))
    assert (alone.low, alone.high) == pytest.approx((0.025, 1.0))
    nothing = share(np.zeros(0, dtype=bool), np.zeros(0, dtype=int))
    assert (nothing.value, nothing.low, nothing.high) == (None, 0.0, 1.0)


@pytest.mark.parametrize(("events", "hours"), [(0, 10.0), (3, 2.0)])
def test_a_rate_has_the_exact_interval_of_a_poisson_process(events, hours):
    counts = np.zeros(10, dtype=int)
    counts[:events] = 1  # one a record: no more than chance
    found = rate(counts, np.full(10, hours / 10), np.arange(10))
    low = chi2.ppf(0.025, 2 * events) / 2 / hours if events else 0.0
    assert (found.value, found.low) == pytest.approx((events / hours, low))
    assert found.high == pytest.approx(chi2.ppf(0.975, 2 * events + 2) / 2 / hours)


def test_alarms_that_come_in_heaps_bound_a_rate_less():
    hours, flights = np.full(20, 0.5), np.arange(20)
    heap = np.zeros(20, dtype=int)
    heap[3] = 10
    spread = np.zeros(20, dtype=int)
    spread[:10] = 1
    heaped, even = rate(heap, hours, flights), rate(spread, hours, flights)
    assert heaped.value == even.value
    assert heaped.low < even.low < even.high < heaped.high


@pytest.mark.parametrize("of", by_day(["mean", "median"]))
def test_the_bootstrap_over_flights_holds_the_truth(of):
    rng, held = np.random.default_rng(7), 0
    flights = np.repeat(np.arange(15), 8)
    for _ in range(200):
        delays = 1.0 + np.repeat(0.3 * rng.standard_normal(15), 8) + 0.1 * rng.standard_normal(120)
        found = mean(delays, flights) if of == "mean" else quantile(delays, 0.5, flights)
        held += found.low <= 1.0 <= found.high
    assert held / 200 >= 0.9


def test_too_few_flights_bound_no_delay():
    flights = np.repeat(np.arange(FEWEST_BLOCKS - 1), 100)
    assert quantile(np.arange(float(len(flights))), 0.5, flights).low is None
    assert mean(np.arange(float(len(flights))), flights).high is None


def test_a_quantile_is_one_of_the_values_and_may_be_infinite():
    values, flights = np.array([0.1, np.inf, 0.2, 0.3, np.inf, np.inf, np.inf]), np.arange(7)
    assert quantile(values, 0.4, flights).value == 0.3
    assert quantile(values, 0.9, flights).value == np.inf


# ---- who is sooner ----


def test_holms_steps_by_hand():
    assert holm([0.005, 0.011, 0.02, 0.04, 0.13]) == pytest.approx([0.025, 0.044, 0.06, 0.08, 0.13])
    assert holm([0.6, 0.7]) == [1.0, 1.0]


def test_what_is_drawn_is_flights_and_not_trials():
    """A thousand trials of four flights tell no two detectors apart: 2 of 16 signs are as one-sided."""
    few, many = np.repeat(np.arange(4), 250), np.repeat(np.arange(12), 84)
    for flights, better in ((few, None), (many, "quick")):
        delays_s = {"quick": np.full(len(flights), 0.1), "slow": np.full(len(flights), 9.0)}
        (pair,) = compared(delays_s, flights)
        assert pair.better == better
        assert pair.p == pytest.approx(2.0 * 0.5 ** len(np.unique(flights)))


def test_missed_is_later_than_any_delay_and_both_missed_is_a_tie():
    flights = np.arange(8)
    (pair,) = compared({"a": np.array([50.0] * 6 + [np.inf] * 2), "b": np.full(8, np.inf)}, flights)
    assert (pair.sooner, pair.later, pair.tied) == (6, 0, 2)


def test_ranks_share_a_place_where_no_test_tells():
    flights = np.repeat(np.arange(10), 3)
    turns = np.where(flights % 2 == 0, 0.1, 0.3)  # now the one is sooner and now the other
    delays_s = {"a": turns, "b": 0.4 - turns, "c": np.full(30, np.inf)}
    places = {rank.detector: (rank.best, rank.worst) for rank in ranks(list(delays_s), compared(delays_s, flights))}
    assert places == {"a": (1, 2), "b": (1, 2), "c": (3, 3)}


# ---- what rows say ----


def test_every_figure_of_made_up_rows():
    told = {
        "isolated": True,
        "named_wrong": False,
        "axis_right": True,
        "sensor": "p",
        "kind": "jam",
        "kind_right": True,
    }
    wrong = {**told, "isolated": False, "named_wrong": True, "sensor": "q", "kind": "drift", "kind_right": False}
    open_ = {**told, "isolated": False, "sensor": None, "kind": None, "kind_right": False}
    nothing = {"isolated": False, "named_wrong": False, "axis_right": False, "kind_right": False}
    rows = [healthy("C", flight) for flight in range(8)]
    for flight in range(8):
        rows += [
            trial("C", flight, 0.2, **told),
            trial("C", flight, 0.4, **wrong),
            trial("C", flight, 30.0, **open_),
            trial("C", flight, None, fault="drift", **nothing),
        ]
    found = only(rows, deadline_s=10.0)
    own = found.merits
    assert (own.trials, own.flights, own.failed) == (32, 8, 0)
    assert (own.detected.hits, own.in_time.hits) == (24, 16)
    delays = own.delays
    assert (delays.median.value, delays.most.value, delays.worst, delays.look_ahead) == (0.4, 30.0, 30.0, 0.1)
    assert delays.mean.value == pytest.approx(10.2)
    naming = own.naming
    hits = [each.hits for each in (naming.right, naming.wrong, naming.undecided, naming.missed)]
    assert hits == [8, 8, 8, 8]
    assert (naming.axis_right.hits, naming.kind_right.hits) == (24, 8)
    assert found.sensors.injected == ("p",)
    assert dict(zip(found.sensors.told, found.sensors.counts[0], strict=True)) == {
        "p": 8,
        "q": 8,
        CANT_TELL: 8,
        MISSED: 8,
    }
    assert found.kinds.counts == ((8, 8, 8, 0), (0, 0, 0, 8))
    assert {kind: merits.trials for kind, merits in found.faults.items()} == {"jam": 24, "drift": 8}


def test_a_detector_that_names_no_sensors_has_no_names():
    found = only([healthy("limit", 0), trial("limit", 0, 1.0)])
    assert found.merits.naming is found.sensors is found.kinds is None


def test_who_certainly_raises_more_than_the_target_gets_no_score():
    rows = [healthy("C", flight) for flight in range(10)] + [trial("C", flight, 5.0) for flight in range(10)]
    rows += [healthy("siren", flight, false_alarms=9) for flight in range(10)]
    rows += [trial("siren", flight, 0.0) for flight in range(10)]
    scores = scores_of(rows)
    quiet, siren = scores.detectors
    assert quiet.is_quiet
    assert siren.merits is None
    assert siren.faults == siren.channels == {}
    assert "more than 7" in siren.no_score
    assert [rank.detector for rank in scores.ranks] == ["C"]
    assert scores.comparisons == ()
    assert all(one.is_quiet for one in scores_of(rows, target_per_hour=100.0).detectors)


def test_one_alarm_in_little_flight_refutes_nothing():
    rows = [healthy("C", 0, false_alarms=1), healthy("C", 1), trial("C", 0, 1.0)]
    assert only(rows, target_per_hour=1.0).is_quiet  # 1 in 0.2 h may well be one in 8 h


def test_who_fails_has_missed_and_what_fails_for_all_counts_for_none():
    rows = [healthy(name, flight) for name in "ab" for flight in range(6)]
    rows += [trial("a", flight, 1.0) for flight in range(6)]
    rows += [trial("a", 0, None, detected=None, error="can't be broken so")]
    rows += [trial("b", 0, None, detected=None, error="broke down")] + [
        trial("b", flight, 1.0) for flight in range(1, 6)
    ]
    rows += [trial("b", 0, None, detected=None, error="can't be broken so")]
    a, b = scores_of(rows).detectors
    assert (a.merits.trials, a.merits.failed, a.merits.detected.hits) == (6, 0, 6)
    assert (b.merits.trials, b.merits.failed, b.merits.detected.hits) == (6, 1, 5)


def test_a_flight_is_one_block_however_many_tasks_and_noises_it_has():
    rows = [trial("C", task, 1.0, seed=1, noise_seed=noise) for task in range(3) for noise in range(4)]
    assert only(rows).merits.flights == 1


def test_without_healthy_records_there_is_a_score_and_no_rate():
    found = only([trial("C", flight, 1.0) for flight in range(6)])
    assert found.is_quiet
    assert found.false_alarms.value is None
    assert found.false_alarms.high == np.inf


def test_no_rows_are_refused_and_those_of_another_version():
    with pytest.raises(InputError, match="no rows"):
        scores_of([])
    with pytest.raises(InputError, match="no column 'closed_loop', so another version made them"):
        scored(table_of([healthy("C", 0)]).to_pandas().drop(columns="closed_loop"))


# ---- curves and the smallest ----


def test_the_curve_counts_what_lies_above_each_factor():
    rng = np.random.default_rng(10)
    quiet, loud = rng.gamma(4.0, 0.1, 50), rng.gamma(4.0, 0.4, 80)
    curve = characteristic(quiet, 0.1, loud)
    for factor, alarmed, detected in zip(curve.factors, curve.alarmed, curve.detected, strict=True):
        assert alarmed == pytest.approx(np.mean(quiet > factor))
        assert detected == pytest.approx(np.mean(loud > factor))
    assert np.all(np.diff(curve.per_hour) >= 0.0)
    assert characteristic(np.full(5, np.nan), 0.1, loud) is None


@pytest.mark.parametrize("flights", [40, 300])
def test_the_marker_of_a_campaigns_curve_lies_on_it_at_the_detectors_own_thresholds(flights):
    """Also where flights alarm more than once, which the counted rate tells and no curve of records does."""
    rng = np.random.default_rng(flights)
    peaks, broken = rng.gamma(4.0, 0.15, flights), rng.gamma(4.0, 0.4, flights)
    rows = [
        healthy("A", flight, peak_ratio=peak, false_alarms=3 * int(peak > 1.0), armed_hours=10.0)
        for flight, peak in enumerate(peaks)
    ]
    rows += [trial("A", flight, 2.0, peak_ratio=peak) for flight, peak in enumerate(broken)]
    figure = price_curves([only(rows, target_per_hour=1.0)], 1.0, strokes(["A"]))
    line, *others = figure.axes[0].lines
    marker = next(each for each in others if each.get_marker() not in ("None", "", None))
    (rate,), (share,) = marker.get_data()
    assert rate == pytest.approx(-np.log1p(-np.mean(peaks > 1.0)) / 10.0)
    assert share == pytest.approx(np.mean(broken > 1.0))
    assert min(np.hypot(line.get_xdata() - rate, line.get_ydata() - share)) < 1e-12


def test_what_a_sooner_alarm_costs_is_told_at_every_factor_and_a_miss_is_infinitely_late():
    rows = [healthy("A", flight, peak_ratio=0.55 if flight < 2 else 0.2) for flight in range(10)]
    for flight in range(10):
        at = {name: 1.0 + factor for factor, name in LADDER.items() if factor < 1.4 or flight < 3}
        rows.append(trial("A", flight, 2.0, **at))
    price = only(rows).price
    assert price.factors.tolist() == sorted(LADDER)
    expected = [1.0 + factor if factor < 1.4 else np.inf for factor in sorted(LADDER)]
    assert price.delays_s == pytest.approx(expected)
    rates = dict(zip(price.factors.tolist(), price.per_hour.tolist(), strict=True))
    assert rates[0.5] == pytest.approx(-np.log(0.8) / 0.1), "2 of 10 records of 0.1 h alarm"
    assert rates[0.6] == 0.0
    assert only([row for row in rows if row.get("fault") is None] + [trial("A", 0, 2.0)]).price is None


def test_look_ahead_windows_and_the_rest_are_the_delay():
    rows = [trial("A", 0, delay_s, window_s=window_s) for delay_s, window_s in ((0.1, 2.0), (0.6, 2.0), (5.1, 2.0))]
    assert only(rows).merits.delays.windows == pytest.approx((0.0 + 0.5 + 2.0) / 3)  # the rest: 0, 0, 3 s
    assert only([*rows, trial("A", 0, 1.0)]).merits.delays.windows is None, "one doesn't say"


def test_the_short_table_has_fourteen_rows_and_names_the_others():
    rows = []
    for number in range(16):
        rows += [
            row for flight in range(12) for row in (healthy(f"D{number}", flight), trial(f"D{number}", flight, 1.0))
        ]
    rows += [healthy("loud", flight, false_alarms=9) for flight in range(12)]
    told = who_sees_what(scores_of(rows)).splitlines()
    assert [line.split(" | ")[0] for line in told if line.startswith("| ")][2:] == ["| 1-16"] * 14, "a tie is a tie"
    assert told[-3] == "Behind these: D14 and D15."
    assert told[-1] == "No score, since 1 false alarms an hour are refuted for loud (108 in 1.2 h: 74 at least)."


def search(flight, smallest, mildest=0.01, severest=100.0, **cells):
    about = {"severity_name": "size", "mildest": mildest, "severest": severest}
    found = {"smallest": smallest, "detected": smallest is not None}
    return trial("C", flight, None, fault="bias", **about) | found | cells


def test_the_smallest_is_what_nine_of_ten_searches_find():
    rows = [search(flight, 0.1 * (flight + 1)) for flight in range(10)]
    (found,) = only(rows).smallest
    assert found.severity.value == pytest.approx(0.9)
    assert found.severity.low <= 0.9 <= found.severity.high
    assert (found.found.hits, found.found.of) == (10, 10)
    (found,) = only([*rows[:8], search(8, None), search(9, None)]).smallest
    assert found.is_beyond


def test_of_a_limit_the_smallest_fault_is_the_greatest_limit():
    rows = [search(flight, 10.0 - flight, mildest=100.0, severest=0.01) for flight in range(10)]
    assert only(rows).smallest[0].severity.value == 2.0  # 10 ... 2 are nine of ten that detect at 2


def test_what_alarms_without_the_fault_isnt_asked():
    rows = [search(flight, 0.5) for flight in range(6)] + [search(6, None, detected=None)]
    assert only(rows).smallest[0].found.of == 6


def test_searches_are_no_trials():
    found = only([healthy("C", 0), search(0, 0.5)])
    assert found.merits is None
    assert len(found.smallest) == 1


# ---- luck ----


def test_delays_between_factors_lie_between_theirs():
    nan = np.nan
    ladder = {
        0.8: np.array([0.1, 0.5, 2.0, nan]),
        1.0: np.array([0.2, 0.5, 4.0, nan]),
        1.25: np.array([0.3, 0.5, nan, nan]),
    }
    for factor, delays_s in ladder.items():
        np.testing.assert_array_equal(delays_at(ladder, factor), np.nan_to_num(delays_s, nan=np.inf))
    np.testing.assert_allclose(delays_at(ladder, math.sqrt(0.8)), [0.15, 0.5, 3.0, np.inf])
    np.testing.assert_allclose(delays_at(ladder, math.sqrt(1.25)), [0.25, 0.5, np.inf, np.inf])
    np.testing.assert_array_equal(delays_at(ladder, 9.0), [0.3, 0.5, np.inf, np.inf])  # beyond what was watched
    along = np.array([delays_at(ladder, factor) for factor in np.geomspace(0.8, 1.25, 30)])
    assert (np.diff(along[:, :2], axis=0) >= 0.0).all()


def with_ladder(detector, seed, delay_s, steep=1.0):
    """Return a trial whose delay grows as thresholds do, to a power."""
    delays = {name: delay_s * factor**steep for factor, name in LADDER.items()}
    return trial(detector, seed, delay_s) | delays


def test_other_calibrations_move_delays_alarms_and_places():
    rows = [healthy("C", seed, peak_ratio=0.95 if seed < 3 else 0.4) for seed in range(10)]
    rows += [healthy("slow", seed) for seed in range(10)]
    rows += [with_ladder("C", seed, 1.0) for seed in range(10)]
    rows += [with_ladder("slow", seed, 1.05) for seed in range(10)]
    C, slow = scores_of(rows, spreads={"C": 1.2}).detectors
    assert slow.luck is None
    assert C.luck.median_s == pytest.approx((1.0 / 1.2, 1.2), rel=0.02)
    assert C.luck.detected == (10, 10)
    assert C.luck.alarmed == (0, 3)  # whose peaks lie above 1 / 1.2
    assert (C.luck.place.best, C.luck.place.worst) == (1, 2)  # it is sooner, and with higher thresholds later
    (shown,) = [
        table for table in tables(scores_of(rows, spreads={"C": 1.2})) if table.title == "Luck of the calibration"
    ]
    assert [cell.text for cell in shown.rows[0]] == ["C", "1.20", "0.83 to 1.20", "10 to 10", "0 to 3", "1-2"]
    assert "| 1 | C | 10 of 10 | 1.00 (0.83 to 1.20) |" in who_sees_what(scores_of(rows, spreads={"C": 1.2}))


def test_without_spread_or_ladder_nothing_is_said_of_luck():
    rows = [healthy("C", seed) for seed in range(6)] + [trial("C", seed, 1.0) for seed in range(6)]
    assert scores_of(rows).detectors[0].luck is None
    assert scores_of(rows, spreads={"C": 1.2}).detectors[0].luck is None
    assert all(table.title != "Luck of the calibration" for table in tables(scores_of(rows)))
