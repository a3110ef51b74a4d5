"""gtmbench-1 is frozen: its definition's digest, its flights' bits on a sample, what its splits share (nothing)."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.study.benchmark.definition import JUDGED_SPLITS, PRIVATE, TEST, load_definition, with_secret
from gtmbench.study.benchmark.flights import make, shipped_facts
from tests.helpers.night import by_day
from tests.helpers.small_benchmark import tiny

FROZEN = "eb081dc7c72c04d0"
PUBLIC = ("learn", "calibration", "development", "test")
FULL, QUICK = load_definition(), load_definition(quick=True)


def every(definition, splits=PUBLIC):
    return [flight for split in splits for flight in definition.flights(split)]


def test_the_definition_is_frozen():
    assert FULL.digest.startswith(FROZEN), "a change of the definition is gtmbench-2"


@pytest.mark.parametrize("definition", [FULL, QUICK], ids=["full", "quick"])
def test_every_public_flight_ships_its_digest_and_its_limit(definition):
    facts = shipped_facts(definition.name)
    assert set(facts) == {flight.id for flight in every(definition)}
    broken = {flight.id for flight in every(definition) if flight.fault is not None}
    assert {name for name, (_, limit_s) in facts.items() if not np.isnan(limit_s)} == broken


@pytest.mark.parametrize("group", by_day([group.name for group in FULL.groups], 2))
def test_flights_have_the_bits_that_ship(group):
    if FULL.differing:
        pytest.skip(f"not gtmbench-1: {FULL.differing}")
    flight = next(each for each in FULL.flights(TEST) if each.group.name == group and each.fault is not None)
    digest, limit_s = shipped_facts(FULL.name)[flight.id]
    made = make(FULL, flight)
    assert made.digest == digest
    assert made.limit_s == pytest.approx(limit_s, abs=0.006) or made.limit_s == limit_s


def test_no_two_flights_share_a_name_or_a_seed():
    flights = [flight for flight in (*every(FULL), *every(QUICK)) if not flight.twin]
    assert len({flight.id for flight in flights}) == len(flights)
    assert len({(flight.group.aircraft, flight.seed) for flight in every(FULL) if not flight.twin}) == len(
        [flight for flight in every(FULL) if not flight.twin]
    )


def test_the_order_and_the_length_of_flights_tell_nothing_of_their_faults():
    flights = [flight for flight in FULL.flights(TEST) if flight.group.name == "gtm" and not flight.twin]
    assert {flight.rows for flight in flights} == {20001}
    broken = np.array([flight.fault is not None for flight in flights])
    assert 0.1 < broken[: len(broken) // 2].mean() / broken.mean() / 2.0 < 0.9
    assert sorted(flight.id for flight in flights) != [flight.id for flight in flights]


def test_a_twin_is_the_beginning_of_its_flight(tmp_path):
    definition = tiny(tmp_path)
    flights = {flight.id: flight for flight in definition.flights(TEST)}
    twins = [flight for flight in flights.values() if flight.twin]
    assert len(twins) == 2
    for twin in twins:
        short, full = make(definition, twin).record, make(definition, flights[twin.twin]).record
        assert len(short) < len(full)
        assert np.array_equal(short.values, full.values[: len(short)], equal_nan=True)


def test_a_flight_is_what_its_definition_says(tmp_path):
    definition = tiny(tmp_path)
    flight = next(each for each in definition.flights(TEST) if each.lost and each.fault and each.fault.kind == "bias")
    broken = make(definition, flight).record
    healthy = make(definition, replace(flight, fault=None)).record
    gone = np.isnan(broken.values).any(axis=1)
    assert 0.005 < gone.mean() < 0.04
    assert np.array_equal(gone, np.isnan(healthy.values).any(axis=1))
    change = (broken[flight.fault.channel] - healthy[flight.fault.channel])[~gone]
    since = broken.time_s[~gone] >= flight.fault.onset_s
    assert np.allclose(change[since], flight.fault.size)
    assert not change[~since].any()


def test_a_private_split_follows_from_its_secret_and_shares_no_seed_with_the_others(tmp_path):
    (tmp_path / "one").write_bytes(b"0123456789abcdef")
    (tmp_path / "two").write_bytes(b"0123456789abcdeg")
    one, again, two = (with_secret(FULL, tmp_path / name) for name in ("one", "one", "two"))
    assert [flight.id for flight in one.flights(PRIVATE)] == [flight.id for flight in again.flights(PRIVATE)]
    names = [{flight.id for flight in each.flights(PRIVATE)} for each in (one, two)]
    assert not names[0] & names[1]
    assert not names[0] & {flight.id for flight in every(FULL)}
    assert len(list(one.flights(PRIVATE))) == len(list(one.flights(TEST)))
    for split in PUBLIC:  # a secret changes nothing else
        assert [flight.id for flight in one.flights(split)] == [flight.id for flight in FULL.flights(split)]
    guessed = replace(one, secret=b"")  # who finds out a seed can't find its flight's name
    flight = next(one.flights(PRIVATE))
    assert guessed._id(flight.seed, PRIVATE, PRIVATE) != flight.id == one._id(flight.seed, PRIVATE, PRIVATE)


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
    with pytest.raises(gb.InputError, match=r"this isn't gtmbench-1: there is numpy .* for 1.0; .*--any-versions"):
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
        assert any(flight.fault is not None for flight in QUICK.flights(split)) == (split in JUDGED_SPLITS)
