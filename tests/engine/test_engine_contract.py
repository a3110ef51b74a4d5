"""What holds for every explanation and every relation; and that a signature is what an injected fault makes."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.explanation import TIMES_S
from gtmbench.engine.explanations.registry import KINDS, explanations_of
from gtmbench.engine.relation import Effect
from gtmbench.engine.relations import attitude, gravity, rest, roughness
from gtmbench.engine.relations.registry import RELATIONS, relations_of
from gtmbench.engine.sums import CELL, SignatureSet
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import SENSORS, motion

ONSET_S = 20.0
FIRST = round(ONSET_S / (0.2 * CELL))
PARTS = tuple(each.name for each in fields(Effect))
NAMES = ("attitude", "gravity", "rest", "roughness")
PARTS_OF_LEAN = np.array([0.3, 2.0, -3.0, 0.0])  # constants of gravity: a share of phi and of theta among them


def named(module):
    return module.__name__.rsplit(".", 1)[-1]


def standing(flight):
    """Return a flight whose second half stands: so that all relations are there."""
    blocks, half = flight.blocks, len(flight) // 2
    rates, gyros = blocks.rates.copy(), blocks.gyros.copy()
    rates[half:] = 0.0
    gyros[half:] = 0.1 * np.random.default_rng(5).standard_normal(gyros[half:].shape)
    return replace(flight, blocks=replace(blocks, rates=rates, gyros=gyros), shaking=np.full(len(flight), 0.001))


@cache
def flown(is_driven):
    return standing(flight_from(motion(60.0, seed=6), is_driven=is_driven, noise=0.01))


@pytest.fixture(params=[True, False], ids=["driven", "own"])
def flight(request):
    return flown(request.param)


def parts_of(effect):
    return {part: values for part in PARTS if (values := getattr(effect, part)) is not None}


def scaled(effect, size):
    return Effect(**{part: size * values for part, values in parts_of(effect).items()})


def answers(relation, flight, effect):
    """Return what a relation answers to an effect in all its channels, with constants that aren't nil."""
    constants = 0.5 + np.arange(relation.regressors.shape[2])
    every = [relation.answer(flight, effect, channel, constants) for channel in range(len(relation.channels))]
    return np.column_stack([np.zeros(len(flight)) if each is None else each for each in every])


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_effects_are_finite_and_of_three_axes(flight, kind):
    for each in kind.explanations(flight):
        parts = parts_of(each.effect(flight))
        assert parts, each.name
        for part, values in parts.items():
            assert values.shape == (len(flight), 3), (each.name, part)
            assert np.isfinite(values).all(), (each.name, part)
        assert any(values.any() for values in parts.values()), each.name


@pytest.mark.parametrize("kind", KINDS, ids=named)
@pytest.mark.parametrize("name", NAMES)
def test_a_relation_answers_in_proportion_to_the_size_and_with_nothing_to_nothing(flight, kind, name):
    relation = next(each for each in relations_of(flight) if each.name == name)
    for each in kind.explanations(flight):
        effect = each.effect(flight)
        one = answers(relation, flight, effect)
        assert np.isfinite(one).all(), each.name
        scale = max(np.abs(one).max(), 1.0)
        np.testing.assert_allclose(answers(relation, flight, scaled(effect, -2.5)), -2.5 * one, atol=1e-9 * scale)
        assert not answers(relation, flight, scaled(effect, 0.0)).any(), each.name


@pytest.mark.parametrize("name", NAMES)
def test_two_effects_together_add_up(flight, name):
    relation = next(each for each in relations_of(flight) if each.name == name)
    effects = [each.effect(flight) for each in explanations_of(flight)]
    whole = Effect(**{part: sum(getattr(each, part) for each in effects if part in parts_of(each)) for part in PARTS})
    apart = sum(answers(relation, flight, each) for each in effects)
    np.testing.assert_allclose(answers(relation, flight, whole), apart, atol=1e-8 * np.abs(apart).max())


def test_nothing_is_what_no_effect_makes(flight):
    for relation in relations_of(flight):
        assert not answers(relation, flight, Effect()).any()


def test_names_are_unique_and_every_base_exists(flight):
    every = explanations_of(flight)
    names = [each.name for each in every]
    assert len(set(names)) == len(names)
    for each in every:
        assert (each.since is None) == (each.base == ""), each.name
        assert each.base == "" or each.base in names, each.name


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_prices_and_bounds_are_those_of_a_size_about_nil(flight, kind):
    for each in kind.explanations(flight):
        assert each.price >= 0.0, each.name
        assert each.low <= 0.0 <= each.high, each.name
        assert each.low < each.high, each.name
        assert 0.0 <= each.least < max(-each.low, each.high), each.name
        assert each.reach > 0.0, each.name
        assert each.shortest_s >= 0.0, each.name
        assert each.fades_s in (0.0, *TIMES_S), each.name


@pytest.mark.parametrize("kind", KINDS, ids=named)
def test_a_failure_has_a_sensor_and_a_healthy_cause_has_axes(flight, kind):
    for each in kind.explanations(flight):
        assert (each.suspect in SENSORS) != each.is_healthy, each.name
        assert not each.is_healthy or each.axes, each.name
        assert set(each.axes) <= {0, 1, 2}, each.name


def test_what_grows_is_told_at_every_block(flight):
    for each in explanations_of(flight):
        if each.since is not None:
            since = each.since(flight)
            assert since.shape == (len(flight),), each.name
            assert np.isfinite(since).all(), each.name


def test_every_gyro_may_fail_in_the_same_ways(flight):
    ways = {
        gyro: {(each.kind, each.fades_s) for each in explanations_of(flight) if each.suspect == gyro} for gyro in GYROS
    }
    assert ways["p"] == ways["q"] == ways["r"]
    assert {kind for kind, _ in ways["p"]} >= {"bias", "drift", "scale", "noise"}


def test_angles_that_gyros_are_known_to_drive_do_not_fail_by_themselves():
    known = replace(flown(True), is_assumed=False)
    possible = [each for each in explanations_of(known) if np.isfinite(each.price)]
    assert not any(each.suspect in ("phi", "theta") for each in possible)
    for other in (flown(False), flown(True)):  # its own, or perhaps
        assert {each.suspect for each in explanations_of(other) if np.isfinite(each.price)} >= set(ATTITUDE)


@pytest.mark.parametrize("make", RELATIONS, ids=lambda make: named_of(make))
def test_a_relation_has_the_shapes_that_it_says(flight, make):
    relation = make(flight)
    channels, constants = len(relation.channels), len(relation.prior)
    assert relation.values.shape == (len(flight), channels)
    assert relation.regressors.shape == (len(flight), channels, constants)
    assert relation.floor.shape == (constants,)
    assert (relation.prior > 0.0).all()
    assert (relation.floor > 0.0).all()
    assert relation.wander > 0.0
    assert relation.asked.shape == (len(flight),)
    assert relation.asked.dtype == bool
    assert relation.asked.any()
    assert relation.regime is None or relation.regime.shape == (len(flight), channels)


def named_of(make):
    return make.__module__.rsplit(".", 1)[-1]


def test_relations_are_there_where_their_sensors_are():
    record = motion(60.0, seed=6)
    with_forces = flight_from(record, noise=0.2)  # it shakes: it doesn't stand
    assert [each.name for each in relations_of(flown(True))] == list(NAMES)
    assert [each.name for each in relations_of(with_forces)] == ["attitude", "gravity", "roughness"]
    assert [each.name for each in relations_of(flight_from(record, has_forces=False))] == ["attitude", "roughness"]
    assert rest.relation(with_forces) is None
    assert gravity.relation(replace(with_forces, forces=2.0 * with_forces.forces)) is None


# what faults make --------------------------------------------------------------------------------


@cache
def smooth(rate_hz):
    return motion(60.0, rate_hz, seed=3, noise=0.0)


def broken(fault, rate_hz, fades_s=0.0):
    """Return a smooth record with a fault; through an estimator of a time constant, unless that is 0."""
    record = smooth(rate_hz)
    found = gb.inject(record, fault)
    return gb.AttitudeEstimator(time_constant_s=fades_s).bent(record, found) if fades_s else found


def change_and_signature(fault, suspect, kind, size, *, relation, constants, rate_hz=50.0, fades_s=0.0):
    """Return what a fault changes y - X theta of a relation by, and what the explanation says, shape (blocks, 2)."""
    healthy = flight_from(smooth(rate_hz), is_driven=bool(fades_s))
    flight = flight_from(broken(fault, rate_hz, fades_s), is_driven=bool(fades_s), healthy=smooth(rate_hz))
    signatures = SignatureSet(flight, explanations_of(flight))
    own = next(
        each for each in signatures.explanations if (each.suspect, each.kind, each.fades_s) == (suspect, kind, fades_s)
    )
    before, behind = relation(healthy), relation(flight)
    changes, told = [], []
    for channel in range(len(before.channels)):
        found = signatures.over(behind, channel, constants, signatures.place_of(own), FIRST, signatures.cells)
        told.append(size * (np.zeros(len(flight)) if found is None else found))
        fits = [each.regressors[:, channel] @ constants for each in (before, behind)]
        changes.append(behind.values[:, channel] - fits[1] - before.values[:, channel] + fits[0])
    inside = slice(FIRST * CELL + CELL, None)  # a jump at the onset itself is no part of it
    return np.column_stack(changes)[inside], np.column_stack(told)[inside]


def misfit(change, told):
    return np.linalg.norm(change - told) / np.linalg.norm(told)


GYRO_FAULTS = {
    "bias": (lambda gyro: gb.Bias(channel=gyro, onset_s=ONSET_S, size=0.5), 0.5),
    "drift": (lambda gyro: gb.Drift(channel=gyro, onset_s=ONSET_S, slope=-0.05), -0.05),
    "scale": (lambda gyro: gb.ScaleFactor(channel=gyro, onset_s=ONSET_S, factor=0.8), 1.0 - 1.0 / 0.8),
    "deadzone": (lambda gyro: gb.Deadzone(channel=gyro, onset_s=ONSET_S, half_width=0.5), 0.5),
}
ALONE = {"bias": 1e-9, "drift": 1e-9, "scale": 1e-9, "deadzone": 0.25}  # within the zone its error is no constant
THROUGH = {"bias": 0.02, "drift": 0.03, "scale": 0.2, "deadzone": 0.3}  # e of a block's beginning fades in it


@pytest.mark.parametrize("kind", GYRO_FAULTS)
@pytest.mark.parametrize("gyro", GYROS)
def test_a_gyro_alone_is_off_by_its_signature(gyro, kind):
    make, size = GYRO_FAULTS[kind]
    found = change_and_signature(
        make(gyro), gyro, kind, size, relation=attitude.relation, constants=np.zeros(6), rate_hz=100.0
    )
    assert misfit(*found) < ALONE[kind]
    others = np.delete(found[0], GYROS.index(gyro), axis=1)
    assert np.abs(others).max() < 1e-9


@pytest.mark.parametrize("fades_s", TIMES_S)
@pytest.mark.parametrize("kind", GYRO_FAULTS)
@pytest.mark.parametrize("gyro", GYROS)
def test_an_attitude_that_follows_a_gyro_is_off_by_its_signature(gyro, kind, fades_s):
    make, size = GYRO_FAULTS[kind]
    found = change_and_signature(
        make(gyro), gyro, kind, size, relation=attitude.relation, constants=np.zeros(6), fades_s=fades_s
    )
    assert misfit(*found) < THROUGH[kind]


@pytest.mark.parametrize("fades_s", TIMES_S)
@pytest.mark.parametrize("gyro", ["p", "q"])
def test_an_attitude_that_follows_a_gyro_leans_by_its_signature(gyro, fades_s):
    fault = gb.Bias(channel=gyro, onset_s=ONSET_S, size=0.3)
    found = change_and_signature(
        fault, gyro, "bias", 0.3, relation=gravity.relation, constants=PARTS_OF_LEAN, fades_s=fades_s
    )
    assert misfit(*found) < 0.05


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.25, 3.0, -1.0])
def test_a_factor_of_a_gyro_is_one_over_one_less_its_size(factor):
    fault, size = gb.ScaleFactor(channel="q", onset_s=ONSET_S, factor=factor), 1.0 - 1.0 / factor
    found = change_and_signature(fault, "q", "scale", size, relation=attitude.relation, constants=np.zeros(6))
    assert misfit(*found) < 1e-9
    assert factor == pytest.approx(1.0 / (1.0 - size))


ANGLE_FAULTS = {
    "step": (lambda angle: gb.Bias(channel=angle, onset_s=ONSET_S, size=1.0), 1.0),
    "drift": (lambda angle: gb.Drift(channel=angle, onset_s=ONSET_S, slope=0.05), 0.05),
    "scale": (lambda angle: gb.ScaleFactor(channel=angle, onset_s=ONSET_S, factor=0.97), 1.0 - 1.0 / 0.97),
}


@pytest.mark.parametrize("kind", ANGLE_FAULTS)
@pytest.mark.parametrize("angle", ATTITUDE)
def test_an_angle_is_off_by_its_signature(angle, kind):
    make, size = ANGLE_FAULTS[kind]
    change, told = change_and_signature(
        make(angle), angle, kind, size, relation=attitude.relation, constants=np.zeros(6)
    )
    if (angle, kind) == ("psi", "step"):  # a compass that is off by a constant turns nothing
        assert np.abs(change).max() < 1e-9
        assert np.abs(told).max() < 1e-9
    else:
        assert misfit(change, told) < 0.25
        assert abs(np.sum(change * told) / np.sum(told**2) - 1.0) < 0.06  # its size is right all the same


@pytest.mark.parametrize("kind", ANGLE_FAULTS)
@pytest.mark.parametrize("angle", ["phi", "theta"])
def test_an_angle_leans_by_its_signature(angle, kind):
    make, size = ANGLE_FAULTS[kind]
    found = change_and_signature(make(angle), angle, kind, size, relation=gravity.relation, constants=PARTS_OF_LEAN)
    assert misfit(*found) < 0.04


def test_a_heading_that_is_off_does_not_lean():
    fault = gb.Bias(channel="psi", onset_s=ONSET_S, size=20.0)
    change, told = change_and_signature(fault, "psi", "step", 20.0, relation=gravity.relation, constants=PARTS_OF_LEAN)
    assert np.abs(change).max() < 1e-9
    assert np.abs(told).max() < 1e-9


@pytest.mark.parametrize("gyro", GYROS)
def test_noise_raises_the_roughness_of_its_own_gyro_by_its_size(gyro):
    record = motion(120.0, 50.0, seed=3)
    louder = gb.inject(record, gb.Noise(channel=gyro, onset_s=ONSET_S, deviation=0.6, seed=1))
    size = np.log((0.15**2 + 0.6**2) / 0.15**2)
    before, behind = (roughness.relation(flight_from(each)).values for each in (record, louder))
    change = (behind - before)[FIRST * CELL + CELL :]
    effect = next(
        each.effect(flight_from(louder))
        for each in explanations_of(flight_from(louder))
        if (each.suspect, each.kind) == (gyro, "noise")
    )
    told = size * roughness.response(flight_from(louder), effect)[FIRST * CELL + CELL :]
    np.testing.assert_allclose(change.mean(axis=0), told.mean(axis=0), atol=0.08)


# units -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("angle", "channel"), [("phi", 0), ("theta", 1)])
@pytest.mark.parametrize("heading", [0.0, 130.0, -60.0])
def test_a_tilt_against_the_force_is_in_degrees(angle, channel, heading):
    """An aircraft that flies level, whatever its heading, and an attitude that says a degree too much."""
    level = {name: np.zeros(500) for name in SENSORS}
    level["psi"] = np.full(500, heading)
    record = gb.Record(np.column_stack(list(level.values())), channels=SENSORS, sample_period_s=0.05)
    off = record.replace(angle, np.ones(500))
    values = gravity.relation(flight_from(off, healthy=record)).values
    known = values[np.isfinite(values).all(axis=1)]
    assert len(known) > 0.9 * len(values)
    np.testing.assert_allclose(known[:, channel], 1.0, rtol=1e-3)
    np.testing.assert_allclose(known[:, 1 - channel], 0.0, atol=1e-9)


def test_gyros_at_rest_are_in_degrees_per_second():
    flight = flown(True)
    values = rest.relation(flight).values[flight.stands]
    assert np.abs(values).max() < 0.6
    assert values.std() == pytest.approx(0.1, rel=0.1)
