"""gtmbench-2 is frozen: its definition's digest, its flights' bits on a sample, what its splits share (nothing)."""

import re
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.files.shipped import shipped_benchmarks
from gtmbench.study.benchmark.definition import (
    EASY,
    JUDGED_SPLITS,
    PAIR,
    PRIVATE,
    SINGLE,
    TEST,
    axis_index,
    load_definition,
    with_secret,
)
from gtmbench.study.benchmark.flights import Conditions, digest_of, make, shipped_digests
from tests.helpers.night import by_day
from tests.helpers.small_benchmark import tiny

FROZEN = "5c6a94c6239a0671"
PUBLIC = ("learn", "calibration", "development", "test")
FULL, QUICK = load_definition(), load_definition(quick=True)


def every(definition, splits=PUBLIC):
    return [flight for split in splits for flight in definition.flights(split)]


@cache
def of(split):
    return list(FULL.flights(split))


def test_the_definition_is_frozen():
    assert FULL.digest.startswith(FROZEN), "a change of the definition is gtmbench-3"


def test_what_ships_of_flights_is_a_digest_alone():
    judged = {flight.id for flight in every(QUICK, ("calibration", "test"))}
    assert set(shipped_digests(QUICK.name)) == judged
    assert set(shipped_digests(FULL.name)) == {flight.id for flight in every(FULL, ("calibration", "test"))}
    text = next(iter(shipped_benchmarks().values())).with_name(f"{QUICK.name}.csv").read_text()
    assert re.fullmatch(r"id,digest\n([0-9a-f]{12},[0-9a-f]{16}\n)+", text)


@pytest.mark.parametrize("group", by_day([group.name for group in FULL.groups]))
def test_flights_have_the_bits_that_ship(group):
    if FULL.differing:
        pytest.skip(f"not gtmbench-2: {FULL.differing}")
    shipped = shipped_digests(FULL.name)
    flight = next(each for each in of(TEST) if each.group.name == group and each.id in shipped)
    assert digest_of(make(FULL, flight)) == shipped[flight.id]


def test_no_two_flights_share_a_name_or_a_seed_not_even_quick_and_full():
    flights = [flight for flight in (*every(FULL), *every(QUICK)) if not flight.twin]
    assert len({flight.id for flight in flights}) == len({flight.seed for flight in flights}) == len(flights)
    assert all(flight.seed.bit_length() > 96 for flight in flights)


def test_the_order_and_the_length_of_flights_tell_nothing_of_their_faults():
    flights = [flight for flight in of(TEST) if flight.group.name == "gtm" and not flight.twin]
    assert {flight.rows for flight in flights} == {8001}
    broken = np.array([bool(flight.faults) for flight in flights])
    assert 0.4 < broken[: len(broken) // 2].mean() / broken.mean() / 2.0 < 0.6
    assert sorted(flight.id for flight in flights) != [flight.id for flight in flights]


def test_a_fault_is_flown_six_times_with_other_onsets_and_all_that_it_is_is_drawn():
    singles = [flight for flight in of(TEST) if flight.role == SINGLE and not flight.twin]
    cases = Counter((flight.group.name, flight.case) for flight in singles)
    assert set(cases.values()) == {6}
    onsets_s = [flight.onset_s for flight in singles]
    assert min(onsets_s) < 6.0
    assert max(onsets_s) > 69.0
    faults = {(flight.group.name, flight.case): flight.faults[0] for flight in singles}.values()
    assert len({(fault.kind, *fault.severities.values()) for fault in faults}) == len(faults)
    assert len({fault.frequency_hz for fault in faults if fault.kind == "oscillation"}) > 20
    assert {np.sign(fault.size) for fault in faults if fault.kind == "bias"} == {-1.0, 1.0}


def test_second_faults_come_later_on_another_axis():
    pairs = [flight for flight in of(TEST) if flight.role == PAIR]
    assert len(pairs) > 30
    for flight in pairs:
        first, second = flight.faults
        assert 9.9 <= second.onset_s - first.onset_s <= 20.1
        assert second.onset_s <= FULL.onset_s[1]
        assert axis_index(first.channel) != axis_index(second.channel)


def test_a_twin_is_the_beginning_of_its_flight(tmp_path):
    definition = tiny(tmp_path)
    flights = {flight.id: flight for flight in definition.flights(TEST)}
    twins = [flight for flight in flights.values() if flight.twin]
    assert len(twins) == 2
    for twin in twins:
        short, full = make(definition, twin), make(definition, flights[twin.twin])
        assert len(short) < len(full)
        assert np.array_equal(short.values, full.values[: len(short)], equal_nan=True)


def test_a_fault_changes_what_its_element_makes_of_the_motion_and_nothing_else(tmp_path):
    definition = tiny(tmp_path)
    flight = next(each for each in definition.flights(TEST) if each.faults and each.faults[0].kind == "bias")
    broken, healthy = make(definition, flight), make(definition, replace(flight, role="healthy", faults=()))
    assert np.array_equal(np.isnan(broken.values), np.isnan(healthy.values))
    fault = flight.faults[0]
    held_s, length_s = Conditions.of(flight.seed, definition.duration_s).held_s
    apart = (broken.time_s < held_s - 0.1) | (broken.time_s > held_s + length_s + 0.1)
    there = ~np.isnan(broken["p"]) & apart
    change, since = (broken[fault.channel] - healthy[fault.channel])[there], broken.time_s[there] >= fault.onset_s
    step = definition.quanta.get(fault.channel, 0.0)
    assert np.abs(change[since] - fault.size).max() <= step + 1e-9
    assert not change[~since].any()
    assert all(
        np.array_equal(broken[name], healthy[name], equal_nan=True) for name in broken.channels if name != fault.channel
    )


def statistics(definition, record):
    """Of exact equality, zeros and grids: the largest over gyros and angles."""
    found = []
    for name in ("p", "q", "r", "phi", "theta", "psi"):
        values = record[name][~np.isnan(record[name])]
        equal = np.diff(values) == 0.0
        runs = np.diff(np.flatnonzero(np.concatenate([[True], ~equal, [True]])))
        counts = np.round(values / definition.quanta[name]).astype(int)
        grid = max(steps * np.bincount(counts % steps).max() / len(counts) for steps in (2, 3, 5, 10))
        found.append((equal.mean(), runs.max(), (values == 0.0).mean(), grid))
    return np.max(found, axis=0)


@pytest.mark.nightly
def test_no_reading_that_repeats_is_zero_or_lies_on_a_grid_betrays_a_fault_but_in_the_column_of_easy_ones():
    """Flights with their fault and the very same ones without it, so that no luck of other motions enters."""

    def areas(role, most):  # under the curve: 0.5 is chance
        flights = [flight for flight in QUICK.flights(TEST) if flight.role == role and not flight.twin][:most]
        broken = np.array([statistics(QUICK, make(QUICK, flight)) for flight in flights])
        without = [replace(flight, role="healthy", faults=()) for flight in flights]
        healthy = np.array([statistics(QUICK, make(QUICK, flight)) for flight in without])
        return np.mean((broken[:, np.newaxis] > healthy) + 0.5 * (broken[:, np.newaxis] == healthy), axis=(0, 1))

    assert np.abs(areas(SINGLE, 48) - 0.5).max() < 0.06
    assert areas(EASY, 8)[1] > 0.9  # the same statistic finds those


def test_a_private_split_follows_from_its_secret_and_shares_no_seed_with_the_others(tmp_path):
    (tmp_path / "one").write_bytes(b"0123456789abcdef")
    (tmp_path / "two").write_bytes(b"0123456789abcdeg")
    one, again, two = (with_secret(QUICK, tmp_path / name) for name in ("one", "one", "two"))
    assert [flight.id for flight in one.flights(PRIVATE)] == [flight.id for flight in again.flights(PRIVATE)]
    names = [{flight.id for flight in each.flights(PRIVATE)} for each in (one, two)]
    seeds = [{flight.seed for flight in each.flights(PRIVATE)} for each in (one, two)]
    assert not names[0] & names[1]
    assert not seeds[0] & seeds[1]
    assert not seeds[0] & {flight.seed for flight in every(QUICK)}
    assert len(list(one.flights(PRIVATE))) == len(list(one.flights(TEST)))
    for split in PUBLIC:  # a secret changes nothing else
        assert [flight.id for flight in one.flights(split)] == [flight.id for flight in QUICK.flights(split)]


def test_the_published_digest_of_a_secret_tells_nothing_of_its_flights(tmp_path):
    import hashlib

    (tmp_path / "one").write_bytes(b"0123456789abcdef")
    (tmp_path / "digest").write_bytes(hashlib.sha256(b"0123456789abcdef").digest())
    one, guessed = (with_secret(QUICK, tmp_path / name) for name in ("one", "digest"))
    assert not {flight.seed for flight in one.flights(PRIVATE)} & {flight.seed for flight in guessed.flights(PRIVATE)}


def test_a_secret_that_could_be_guessed_or_is_none_is_refused(tmp_path):
    (tmp_path / "short").write_bytes(b"1234")
    with pytest.raises(gb.InputError, match="4 bytes could be guessed"):
        with_secret(FULL, tmp_path / "short")
    with pytest.raises(gb.InputError, match="no such file"):
        with_secret(FULL, tmp_path / "none")
    with pytest.raises(gb.InputError, match="follows from a secret"):
        next(FULL.flights(PRIVATE))


def test_other_versions_are_refused_and_named():
    other = replace(FULL, versions={**FULL.versions, "numpy": "1.0"})
    with pytest.raises(gb.InputError, match=r"this isn't gtmbench-2: there is numpy .* for 1.0; .*--any-versions"):
        other.check_versions()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("[extra]\n", "unknown key 'extra'"),
        ('[[groups]]\nname = "x"\n', "it is no definition of a benchmark: TypeError"),
    ],
)
def test_a_definition_that_is_none_is_refused(tmp_path, change, said):
    with pytest.raises(gb.InputError, match=said):
        tiny(tmp_path, extra=change)


def test_splits_that_are_judged_have_faults_and_the_others_none():
    for split in PUBLIC:
        assert any(flight.faults for flight in QUICK.flights(split)) == (split in JUDGED_SPLITS)
