"""The identified answer and the tests of deviations, on made-up aircraft whose answer is known."""

import numpy as np
import pytest

from gtmbench.detectors.surfaces.answer import Flow, answer_of
from gtmbench.detectors.surfaces.deviation import LABELS, Comparing, changes, normal_of
from gtmbench.detectors.surfaces.identification import identified
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, GYROS

PERIOD_S = 0.02
AT = round(76.0 / 0.1)  # a block whose last 16 s are broken, and nothing before
FLOW = Flow()
CHANNELS = (*GYROS, *FLOW.channels, *COMMANDS)
EFFECTS = {"elevator": ("q", -20.0), "aileron": ("p", -25.0), "rudder": ("r", -30.0)}


def lag(values, lag_s):
    out, state = np.empty(len(values)), values[0]
    for i, value in enumerate(values):
        state += (1.0 - np.exp(-PERIOD_S / lag_s)) * (value - state)
        out[i] = state
    return out


def aircraft(seed, broken=None, samples=6000, gain=0.0):
    """Return samples of an aircraft that turns by its surfaces and is damped; `broken` changes what they do.

    `gain`: of a controller that answers every turn, in deg per deg/s.
    """
    draw = np.random.default_rng(seed)
    time_s = np.arange(samples) * PERIOD_S
    values = {name: np.zeros(samples) for name in CHANNELS}
    values["tas"] += 100.0
    values["nz"] += 1.0
    for surface, (gyro, effect) in EFFECTS.items():
        phases = draw.uniform(0.0, 2.0 * np.pi, 12)
        waves = np.sin(2.0 * np.pi * np.outer(time_s, np.linspace(0.05, 1.0, 12)) + phases)
        values[surface] = waves.sum(axis=1) / np.sqrt(12.0)
        gust = lag(draw.standard_normal(samples), 0.3) * 3.0
        turn, driven = np.zeros(samples), values[surface][0]
        changed = values[surface] if broken is None else broken(surface, values[surface], time_s)
        for i in range(1, samples):
            answer = gain * turn[i - 1]
            values[surface][i] += answer
            driven += (1.0 - np.exp(-PERIOD_S / 0.04)) * (changed[i] + answer * (broken is not None) - driven)
            turn[i] = turn[i - 1] + PERIOD_S * (effect * driven + gust[i] - 3.0 * turn[i - 1])
        values[gyro] = turn + 0.1 * draw.standard_normal(samples)
    for name in ("alpha", "beta", "ny", "nz"):
        values[name] = values[name] + 0.02 * draw.standard_normal(samples)
    return np.column_stack([values[name] for name in CHANNELS])


@pytest.fixture(scope="module")
def answer():
    return identified(FLOW, [aircraft(1), aircraft(2)], PERIOD_S)


def blocks(answer, values):
    return answer.start(PERIOD_S).push(values)


def test_effects_of_surfaces_are_found_in_their_axes(answer):
    assert answer.frame.surfaces == ("elevator", "aileron", "rudder")
    equations = list(answer.frame.equations)
    for surface, (gyro, effect) in EFFECTS.items():
        found = answer.effects[equations.index(gyro), answer.frame.surfaces.index(surface)]
        assert found == pytest.approx(effect, rel=0.1)


@pytest.mark.parametrize("surface", EFFECTS)
def test_a_deviation_is_that_of_the_surface_in_degrees_and_nobody_elses(answer, surface):
    def bent(name, commanded, time_s):
        return commanded + 2.0 * (time_s > 60.0) * (name == surface)

    off = blocks(answer, aircraft(3, bent)).means[..., 3]
    seen = off[800:].mean(axis=0) - off[200:580].mean(axis=0)
    for i, name in enumerate(answer.frame.surfaces):
        assert seen[i] == pytest.approx(2.0 if name == surface else 0.0, abs=0.3)


def test_deviations_come_in_chunks_as_in_one(answer):
    values = aircraft(4)
    whole = answer.start(PERIOD_S).push(values)
    working = answer.start(PERIOD_S)
    parts = [working.push(values[first : first + 75]).means for first in range(0, len(values), 75)]
    np.testing.assert_allclose(np.concatenate(parts), whole.means, atol=1e-9)


@pytest.mark.nightly
def test_less_effect_and_a_slow_servo_change_the_answer_and_nothing_else(answer):
    def weak(name, commanded, time_s):
        return np.where((time_s > 60.0) & (name == "rudder"), 0.5 * commanded, commanded)

    def slow(name, commanded, time_s):
        return np.where((time_s > 60.0) & (name == "rudder"), lag(commanded, 0.24), commanded)

    normal = normal_of([blocks(answer, aircraft(5)), blocks(answer, aircraft(6))])
    test = LABELS.index("answer 16 s")
    for seed, broken in ((7, weak), (8, slow)):
        nats = normal.nats(changes(blocks(answer, aircraft(seed, broken)), normal.white))[AT, test]
        assert nats[answer.frame.surfaces.index("rudder")] > 50.0
        assert nats[[answer.frame.surfaces.index(name) for name in ("elevator", "aileron")]].max() < 12.0


@pytest.mark.nightly
def test_healthy_changes_are_as_large_as_they_are_said_to_be(answer):
    normal = normal_of([blocks(answer, aircraft(seed)) for seed in range(10, 16)])
    nats = normal.nats(changes(blocks(answer, aircraft(20)), normal.white))
    assert np.nanmax(nats) < 12.0
    assert np.nanmean(2.0 * nats) < 1.2  # of T^2, less what is tolerated


@pytest.mark.nightly
def test_stronger_gusts_make_a_test_less_sensitive_not_false(answer):
    normal = normal_of([blocks(answer, aircraft(seed)) for seed in range(10, 14)])
    values = aircraft(21)
    shaken = values.copy()
    noise = np.random.default_rng(3).standard_normal((len(values), 3))
    shaken[3000:, :3] += noise[3000:]  # from one moment on ten times what was learnt
    assert np.nanmax(normal.nats(changes(blocks(answer, shaken), normal.white))) < 12.0


@pytest.mark.nightly
def test_effects_are_found_though_a_controller_answers_every_gust():
    """The oracle: a controller turns surfaces against gusts, which plain least squares take for a weak surface."""
    found = identified(FLOW, [aircraft(seed, gain=0.15) for seed in (30, 31)], PERIOD_S)
    equations = list(found.frame.equations)
    for surface, (gyro, effect) in EFFECTS.items():
        own = found.effects[equations.index(gyro), found.frame.surfaces.index(surface)]
        assert own == pytest.approx(effect, rel=0.15)


@pytest.mark.nightly
def test_tests_come_in_chunks_as_in_one(answer):
    floor = normal_of([blocks(answer, aircraft(5))]).white
    whole = blocks(answer, aircraft(9))
    holed = whole._replace(there=np.arange(len(whole.there)) != 400)
    at_once = changes(holed, floor)
    testing = Comparing(floor, whole.block_s)
    parts = [
        testing.push(holed._replace(means=holed.means[first : first + 7], there=holed.there[first : first + 7]))
        for first in range(0, len(whole.there), 7)
    ]
    for field, values in at_once._asdict().items():
        pieces = np.concatenate([getattr(part, field) for part in parts])
        np.testing.assert_allclose(pieces, values, rtol=1e-6, atol=1e-9)
    assert np.isnan(at_once.size[404:425, LABELS.index("offset 2 s")]).all()  # not over a hole
    assert np.isfinite(at_once.size[1000, :, 0]).all()


def test_a_table_gives_the_same_answer_back_and_what_is_wrong_in_it_is_named(answer):
    table = answer.table()
    again = answer_of("answer", table)
    np.testing.assert_array_equal(again.effects, answer.effects)
    assert again.table() == table
    for key, wrong, said in (
        ("vanes", 1, "answer.vanes is 1; it must be true or false"),
        ("surfaces", ["flaps"], "it may hold elevator, aileron, rudder"),
        ("covariance", (-np.eye(5)).tolist(), "is no covariance"),
        ("servo_s", 0.0, "servo_s"),
        ("engine", {"lag_s": 0.0, "lags": 1, "bend": 0.0, "level": 0.0}, "engine.lag_s"),
        ("theta", {}, "it must hold p, q, r, ny, nz"),
    ):
        with pytest.raises(InputError, match=said):
            answer_of("answer", {**table, key: wrong})
