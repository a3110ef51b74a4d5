"""The judge on entries whose truth is known: what knows nothing gets nothing, what knows all gets 1."""

import math
from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.study.benchmark.definition import SINGLE, TEST
from gtmbench.study.benchmark.entry import read_entry
from gtmbench.study.benchmark.flights import references
from gtmbench.study.benchmark.judge import differences, drawn_anew, estimated, judge, places, quickness_of, ranked
from gtmbench.study.benchmark.run import run_benchmark, write_yardsticks
from tests.helpers.night import by_day
from tests.helpers.small_benchmark import describe, finds, noise_of, tiny, write_scores


@pytest.fixture(scope="module")
def definition(tmp_path_factory):
    return tiny(tmp_path_factory.mktemp("definition"))


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return tmp_path_factory.mktemp("references")


@pytest.fixture(scope="module")
def told(definition, kept):
    return references(definition, list(definition.flights(TEST)), kept)


@pytest.fixture
def row_of(tmp_path, definition, told):
    def judged(score, channels=(), extra=""):
        folder = write_scores(
            tmp_path / f"entry{len(list(tmp_path.iterdir()))}", definition, TEST, score, ".parquet", channels
        )
        if extra:
            describe(folder, definition, extra)
        return judge(read_entry(folder, definition, TEST), definition, TEST, told)

    return judged


def shuffled(score):
    """The same scores at other times, of a flight and of its twin alike."""

    def scores(flight, time_s):
        whole = np.arange(4001) * 0.01
        return np.random.default_rng([flight.seed, 9]).permutation(score(flight, whole))[: len(time_s)]

    return scores


def test_a_run_that_was_stopped_flies_no_flight_twice_for_the_reference(definition, kept, told, monkeypatch):
    monkeypatch.setattr("gtmbench.study.benchmark.flights.fly", None)
    assert references(definition, list(definition.flights(TEST)), kept) == told


def test_yardsticks_get_what_they_know(tmp_path, definition, told):
    folders = write_yardsticks(tmp_path, definition, TEST, told)
    rows = {
        row.name: row for row in (judge(read_entry(one, definition, TEST), definition, TEST, told) for one in folders)
    }
    assert rows["reference"].quickness.value == pytest.approx(1.0, abs=0.2)  # of six flights; the full set has 1.00
    assert (rows["reference"].right, rows["reference"].detected) == (6, 6)
    assert rows["oracle"].quickness.value >= rows["reference"].quickness.value
    assert (rows["oracle"].easy, rows["oracle"].second, rows["oracle"].accused) == ((1, 1), (1, 1), (1, 1))
    assert (rows["never"].quickness.value, rows["never"].false_alarms.events) == (0.0, 0)
    assert rows["always"].quickness is None
    assert rows["always"].false_alarms.value == pytest.approx(360.0, rel=0.3)  # one in ten seconds, each counted
    assert [row.name for row in ranked(list(rows.values()))][-1] == "always"


def test_who_finds_is_scored_by_mean_delays_over_the_references(row_of):
    row = row_of(lambda flight, time_s: finds(flight, time_s, late_s=2.0))
    assert (row.detected, row.flights, row.false_alarms.events) == (6, 6, 0)
    assert row.median_delay_s == pytest.approx(2.0, abs=0.011)
    means_s = [np.mean([each.reference_s for each in row.outcomes if each.case == case]) for case in (0, 1)]
    expected = 2.0 * math.log(15.0 / 2.0) / sum(math.log(15.0 / max(mean_s, 0.1)) for mean_s in means_s)
    assert row.quickness.value == pytest.approx(expected, abs=0.01)
    assert row.quickness.low == pytest.approx(row.quickness.high, abs=0.1)


def test_one_lucky_flight_counts_as_much_as_an_unlucky_one():
    cases, horizon_s, reference_s = np.zeros(2, dtype=int), np.full(2, 60.0), np.full(2, 3.0)
    even, uneven = (quickness_of(np.array(each), reference_s, horizon_s, cases) for each in ([3.0, 3.0], [0.5, 5.5]))
    assert uneven == even == 1.0  # no cap on single flights
    assert quickness_of(np.array([0.5, np.inf]), reference_s, horizon_s, cases) < 0.3


def test_scores_that_are_shuffled_in_time_land_at_randoms_place(tmp_path, row_of, definition, told):
    folders = {path.name: path for path in write_yardsticks(tmp_path / "y", definition, TEST, told)}
    random = judge(read_entry(folders["random"], definition, TEST), definition, TEST, told)
    honest, mixed = row_of(finds), row_of(shuffled(finds))
    mixed_noise = row_of(shuffled(noise_of))
    assert honest.quickness.value > 0.5
    assert mixed.quickness is None  # it alarms before every onset
    assert mixed_noise.quickness is None or mixed_noise.quickness.value <= random.quickness.value + 0.2
    assert ranked([mixed, random, honest])[0].name == honest.name


def test_a_score_that_stands_above_from_the_start_never_alarms(row_of):
    row = row_of(lambda flight, time_s: np.full(len(time_s), 1e6 if flight.split == TEST else 0.0))
    assert (row.detected, row.quickness.value, row.false_alarms.events) == (0, 0.0, 0)


def test_who_raises_certainly_more_false_alarms_than_are_allowed_has_no_number(row_of):
    def loud(flight, time_s):
        score = finds(flight, time_s)
        if flight.split == TEST:
            score[1000:1010] += 1000.0
        return score

    row = row_of(loud)
    assert row.quickness is None
    assert row.false_alarms.low > 6.0
    assert row.detected == row.flights  # what it finds is told all the same


def test_it_does_not_matter_how_a_score_is_scaled(row_of):
    plain, scaled = row_of(finds), row_of(lambda flight, time_s: 1e-6 * finds(flight, time_s) - 5.0)
    assert vars(plain.quickness) == pytest.approx(vars(scaled.quickness), abs=1e-6)


def test_a_score_with_an_end_can_be_passed(row_of):
    def share(flight, time_s):
        return 1.0 - np.exp(-finds(flight, time_s) / 40.0)

    assert row_of(share, extra="bound = 1.0000001\n").detected > 0


@pytest.mark.parametrize(
    ("channels", "named"),
    by_day([(("p", "q", "r"), "right"), (("p",), None), ((), "unnamed")]),
    ids=["own", "some", "none"],
)
def test_channels_name_by_their_own_thresholds(row_of, channels, named):
    row = row_of(finds, channels=channels)
    assert {outcome.told for outcome in row.outcomes if outcome.channel == "p" and outcome.role == SINGLE} == {
        named or "right"
    }


def names(folder, definition, sensor, late_s):
    broken = [flight for flight in definition.flights(TEST) if flight.role == SINGLE]
    rows = [(flight, flight.onset_s + late_s) for flight in broken]
    lines = [f"{of.id},{at_s},{sensor or of.faults[0].channel}" for of, at_s in rows if at_s <= of.end_s]
    (folder / "names.csv").write_text("\n".join(["flight,time_s,sensor", *lines]) + "\n")


@pytest.mark.parametrize(
    ("sensor", "late_s", "named"),
    by_day(
        [
            ("", 5.0, "right"),
            ("beta", 5.0, "wrong"),
            ("p|q|r", 5.0, "either-or"),
            ("", 0.5, "unnamed"),
            ("", 22.0, "unnamed"),
        ]
    ),
)
def test_names_count_within_twenty_seconds_of_the_alarm(tmp_path, definition, told, sensor, late_s, named):
    folder = write_scores(tmp_path / "named", definition, TEST, finds)
    names(folder, definition, sensor, late_s)
    row = judge(read_entry(folder, definition, TEST), definition, TEST, told)
    assert {outcome.told for outcome in row.outcomes if outcome.role == SINGLE} <= {named, "unnamed"}
    assert named in {outcome.told for outcome in row.outcomes}


def test_the_curve_holds_the_point_of_the_table_and_rises_with_the_rate(row_of):
    row = row_of(noise_of)
    own = next(point for point in row.curve if point.allowed_per_hour == 6.0)
    assert (own.quickness, own.false_alarms) == (
        row.quickness.value if row.quickness is not None else own.quickness,
        row.false_alarms,
    )
    counts = [point.false_alarms.events for point in row.curve]
    assert counts == sorted(counts)


def test_rows_differ_where_the_same_draws_say_so(row_of):
    quick, alike, slow = (
        row_of(lambda flight, time_s, by=by: finds(flight, time_s, late_s=by)) for by in (1.0, 1.0, 5.0)
    )
    rows = [quick, alike, slow]
    told = differences(rows)
    assert {(each.first, each.second) for each in told if each.p <= 0.05} == {
        (one.name, slow.name) for one in (quick, alike)
    }
    assert list(places(rows, told).values()) == [(1, 2), (1, 2), (3, 3)]
    apart = next(each.quickness for each in told if each.p <= 0.05)
    assert 0.0 < apart.low <= apart.value <= apart.high


def faults_drawn(draw, count):
    """Delays on six flights of so many faults, whose means differ."""
    means_s = np.exp(draw.normal(0.5, 0.6, count))
    return draw.exponential(np.repeat(means_s, 6)), np.repeat(np.arange(count), 6)


@pytest.mark.nightly
def test_an_interval_holds_what_all_faults_would_give_as_often_as_it_says(row_of):
    row, draw = row_of(finds), np.random.default_rng(1)
    delays_s, cases = faults_drawn(draw, 20_000)
    known = quickness_of(delays_s, np.ones(len(cases)), np.full(len(cases), 30.0), cases)
    held = 0
    for _ in range(60):
        delays_s, cases = faults_drawn(draw, 40)
        outcomes = tuple(
            replace(row.outcomes[0], role=SINGLE, case=case, kind="bias", horizon_s=30.0, reference_s=1.0)
            for case in cases.tolist()
        )
        estimate = estimated(known, drawn_anew(outcomes, delays_s[np.newaxis]))
        held += estimate.low <= known <= estimate.high
    assert 52 <= held <= 60  # 95 % of 60 are 57


def test_two_rows_of_one_name_are_refused(tmp_path, definition):
    folder = write_scores(tmp_path / "never", definition, TEST, finds)
    with pytest.raises(gb.InputError, match="two rows would be called 'never'"):
        run_benchmark(definition, TEST, tmp_path / "run", detectors={}, entries=[folder])
    assert not (tmp_path / "run").exists()
