"""The judge on entries whose truth is known: what knows nothing gets nothing, what knows all gets 1."""

import math

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.rivals.catalogue import RIVALS
from gtmbench.study.benchmark.definition import TEST
from gtmbench.study.benchmark.entry import read_entry
from gtmbench.study.benchmark.flights import limits_s
from gtmbench.study.benchmark.judge import judge, places, quickness_of, ranked
from gtmbench.study.benchmark.run import run_benchmark
from gtmbench.study.benchmark.yardsticks import write_yardsticks
from tests.helpers.small_benchmark import finds, noise_of, tiny, write_scores


@pytest.fixture(scope="module")
def definition(tmp_path_factory):
    return tiny(tmp_path_factory.mktemp("definition"))


@pytest.fixture(scope="module")
def limits(definition):
    return limits_s(definition, list(definition.flights(TEST)))


@pytest.fixture
def row_of(tmp_path, definition, limits):
    def judged(score, channels=(), extra=""):
        folder = write_scores(
            tmp_path / f"entry{len(list(tmp_path.iterdir()))}", definition, TEST, score, channels=channels
        )
        if extra:
            (folder / "entry.toml").write_text(extra)
        return judge(read_entry(folder, definition, TEST), definition, TEST, limits)

    return judged


def shuffled(score):
    """The same scores at other times, of a flight and of its twin alike."""

    def scores(flight, time_s):
        whole = np.arange(4001) * 0.01
        return np.random.default_rng([flight.seed, 9]).permutation(score(flight, whole))[: len(time_s)]

    return scores


def test_yardsticks_get_what_they_know(tmp_path, definition, limits):
    folders = write_yardsticks(tmp_path, definition, TEST, limits)
    rows = {
        row.name: row for row in (judge(read_entry(one, definition, TEST), definition, TEST, limits) for one in folders)
    }
    assert rows["limit"].quickness == rows["oracle"].quickness == 1.0
    assert (rows["limit"].right, rows["limit"].detected) == (rows["limit"].findable, rows["limit"].findable)
    assert rows["limit"].times_limit == pytest.approx(1.0)
    assert (rows["never"].quickness, rows["never"].false_alarms.events) == (0.0, 0)
    assert rows["always"].quickness is None
    assert rows["always"].false_alarms.value == pytest.approx(90.0, rel=0.6)  # one at the start of each flight
    assert [row.name for row in ranked(list(rows.values()))][-1] == "always"


def test_who_finds_is_scored_by_delay_over_the_limit(row_of, limits):
    row = row_of(lambda flight, time_s: finds(flight, time_s, late_s=2.0))
    findable = [limit_s for limit_s in limits.values() if limit_s < 15.0]
    assert (row.detected, row.findable, row.false_alarms.events) == (len(findable), len(findable), 0)
    assert row.median_delay_s == pytest.approx(2.0, abs=0.011)
    expected = np.mean([quickness_of(row.outcomes[0].delay_s, limit_s, 15.0) for limit_s in findable])
    assert row.quickness == pytest.approx(expected, abs=0.01)
    assert row.spread == pytest.approx((row.quickness, row.quickness), abs=0.02)


def test_scores_that_are_shuffled_in_time_land_at_randoms_place(tmp_path, row_of, definition, limits):
    folders = {path.name: path for path in write_yardsticks(tmp_path / "y", definition, TEST, limits)}
    random = judge(read_entry(folders["random"], definition, TEST), definition, TEST, limits)
    honest, mixed = row_of(finds), row_of(shuffled(finds))
    mixed_noise = row_of(shuffled(noise_of))
    assert honest.quickness > 0.5
    assert mixed.quickness is None  # it alarms before every onset
    assert mixed_noise.quickness is None or mixed_noise.quickness <= random.quickness + 0.2
    assert ranked([mixed, random, honest])[0].name == honest.name


def test_a_score_that_stands_above_from_the_start_never_alarms(row_of):
    row = row_of(lambda flight, time_s: np.full(len(time_s), 1e6 if flight.split == TEST else 0.0))
    assert (row.detected, row.quickness, row.false_alarms.events) == (0, 0.0, 0)


def test_who_raises_certainly_more_false_alarms_than_are_allowed_has_no_number(row_of):
    def loud(flight, time_s):
        score = finds(flight, time_s)
        if flight.split == TEST:
            score[1000:1010] += 1000.0
        return score

    row = row_of(loud)
    assert row.quickness is None
    assert row.false_alarms.low > 6.0
    assert row.detected == row.findable  # what it finds is told all the same


def test_it_does_not_matter_how_a_score_is_scaled(row_of):
    plain, scaled = row_of(finds), row_of(lambda flight, time_s: 1e-6 * finds(flight, time_s) - 5.0)
    assert (plain.quickness, *plain.spread) == pytest.approx((scaled.quickness, *scaled.spread), abs=1e-6)


def test_a_score_with_an_end_can_be_passed(row_of):
    def share(flight, time_s):
        return 1.0 - np.exp(-finds(flight, time_s) / 40.0)

    assert row_of(share, extra="bound = 1.0000001\n").detected > 0


@pytest.mark.parametrize(
    ("channels", "told"), [(("p", "q", "r"), "right"), (("p",), None), ((), "unnamed")], ids=["own", "some", "none"]
)
def test_channels_name_by_their_own_thresholds(row_of, channels, told):
    row = row_of(finds, channels=channels)
    assert {outcome.told for outcome in row.outcomes if outcome.channel == "p" and math.isfinite(outcome.delay_s)} == {
        told or "right"
    }


def names(folder, definition, sensor, late_s):
    broken = [flight for flight in definition.flights(TEST) if flight.fault is not None]
    rows = [(flight, flight.fault.onset_s + late_s) for flight in broken]
    lines = [f"{of.id},{at_s},{sensor or of.fault.channel}" for of, at_s in rows if at_s <= of.end_s]
    (folder / "names.csv").write_text("\n".join(["flight,time_s,sensor", *lines]) + "\n")


@pytest.mark.parametrize(
    ("sensor", "late_s", "told"),
    [
        ("", 5.0, "right"),
        ("beta", 5.0, "wrong"),
        ("p|q|r", 5.0, "either-or"),
        ("", 0.5, "unnamed"),
        ("", 22.0, "unnamed"),
    ],
)
def test_names_count_within_twenty_seconds_of_the_alarm(tmp_path, definition, limits, sensor, late_s, told):
    folder = write_scores(tmp_path / "named", definition, TEST, finds)
    names(folder, definition, sensor, late_s)
    row = judge(read_entry(folder, definition, TEST), definition, TEST, limits)
    wrong = {"sensor": "wrong"}.get(told, told)
    assert {outcome.told for outcome in row.outcomes if math.isfinite(outcome.delay_s)} <= {wrong, "unnamed"}
    assert wrong in {outcome.told for outcome in row.outcomes}


def test_the_curve_holds_the_point_of_the_table_and_rises_with_the_rate(row_of):
    row = row_of(noise_of)
    own = next(point for point in row.curve if point.allowed_per_hour == 6.0)
    assert (own.quickness, own.false_alarms) == (
        row.quickness if row.quickness is not None else own.quickness,
        row.false_alarms,
    )
    counts = [point.false_alarms.events for point in row.curve]
    assert counts == sorted(counts)


def test_places_overlap_where_spreads_do(row_of):
    quick, slow = row_of(finds), row_of(lambda flight, time_s: finds(flight, time_s, late_s=5.0))
    assert list(places([quick, slow]).values()) == [(1, 1), (2, 2)] or quick.name == slow.name


@pytest.mark.nightly
def test_our_own_detectors_go_through_the_same_files(tmp_path, definition):
    rows = run_benchmark(definition, TEST, tmp_path / "run", detectors={"limits": RIVALS["limits"]})
    found = {row.name: row for row in rows}
    assert set(found) == {"limit", "oracle", "random", "never", "always", "raw-reading", "limits"}
    assert (tmp_path / "run/entries/limits/entry.toml").is_file()
    again = run_benchmark(definition, TEST, tmp_path / "run", detectors={"limits": RIVALS["limits"]})
    assert [(row.name, row.quickness) for row in again] == [(row.name, row.quickness) for row in rows]
    with pytest.raises(gb.InputError, match="holds another run: split differ"):
        run_benchmark(definition, "development", tmp_path / "run", detectors={})


def test_two_rows_of_one_name_are_refused(tmp_path, definition):
    folder = write_scores(tmp_path / "never", definition, TEST, finds)
    with pytest.raises(gb.InputError, match="two rows would be called 'never'"):
        run_benchmark(definition, TEST, tmp_path / "run", detectors={}, entries=[folder])
    assert not (tmp_path / "run").exists()
