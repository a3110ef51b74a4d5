"""Sums over windows of a log are those that brute force makes of whitened columns, chunk by chunk."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine import sums as of_windows
from gtmbench.engine.equation import learn
from gtmbench.engine.explanation import TIMES_S
from gtmbench.engine.explanations.registry import explanations_of
from gtmbench.engine.relation import Effect, on_axis
from gtmbench.engine.relations.registry import relations_of
from gtmbench.engine.sums import CELL, SignatureSet, WindowSums, products_of
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import motion

EXACT = 1e-9
EQUATIONS = (("attitude", 0), ("attitude", 2), ("gravity", 1), ("roughness", 1))
# first and last, in cells, of windows for each onset; a chunk has four, and None is the log's end
WINDOWS = {
    4: ((5, 8), (5, 24), (6, 7), (16, 20), (30, 33), (33, 80), (44, 47), (5, None)),
    11: ((12, 13), (12, 16), (12, 37), (50, 61), (12, None), (75, None)),
    60: ((61, 63), (61, 64), (63, 70), (61, None), (82, None)),
}


@pytest.fixture(scope="module")
def flight():
    """A flight whose last cell isn't whole, with a gap of its gyros and heavy tails."""
    record = motion(83.4, seed=4)
    random = np.random.default_rng(7)
    gyros = record.matrix(GYROS) + 0.3 * random.standard_t(3.0, (len(record), 3))
    gyros[900:1050] = np.nan
    values = np.column_stack([gyros, record.matrix(record.channels[3:])])
    return flight_from(gb.Record(values, channels=record.channels, sample_period_s=0.05), noise=0.02)


@pytest.fixture(scope="module")
def signatures(flight):
    return SignatureSet(flight, explanations_of(flight))


@pytest.fixture(scope="module")
def relations(flight):
    return {relation.name: relation for relation in relations_of(flight)}


@pytest.fixture(scope="module")
def beside(flight):
    """A further regressor, as what was found before makes one."""
    return np.sin(0.3 * flight.time_s)[:, np.newaxis]


@pytest.fixture(scope="module")
def products(flight, signatures, relations, beside):
    """Return the products of an equation."""

    @cache
    def of(name, channel):
        equation = learn(flight, relations[name], channel)
        return products_of(signatures, equation, signatures.answers([equation])[0], beside)

    return of


@pytest.fixture(scope="module")
def columns(flight, signatures, products, beside):
    """Return what an equation's sums are of, whitened one by one, for signatures that begin at an onset."""

    @cache
    def of(name, channel, onset):
        own = products(name, channel)
        equation = own.equation
        every = [
            signatures.over(equation.relation, channel, equation.constants, int(place), onset, own.cells)
            for place in own.columns.own
        ]
        felt = np.column_stack([np.zeros(len(flight)) if each is None else each for each in every])
        return np.column_stack(
            [equation.errors, equation.regressors, equation.whitened(beside), equation.whitened(felt)]
        )

    return of


def by_brute_force(columns, mean, wander, rows, per_chunk):
    """Return the products of columns over a window, the mean of each chunk marginalised by Sherman and Morrison."""
    chunks = np.arange(len(columns)) // per_chunk
    found = np.zeros((columns.shape[1], columns.shape[1]))
    for chunk in np.unique(chunks[rows]):
        inside = rows[chunks[rows] == chunk]
        own, shape = columns[inside], mean[inside]
        found += own.T @ own
        if wander > 0.0:
            found -= np.outer(shape @ own, shape @ own) / (shape @ shape + wander**-2.0)
    return found


def blocks_in(first, last, count):
    return np.arange(first * CELL, min(last * CELL, count))


def window_as_matrix(window, at):
    """Return the products of what is left and the regressors."""
    return np.block(
        [[window.errors[at], window.products[at]], [window.products[at][:, np.newaxis], window.squares[at]]]
    )


def lengths(brute, known):
    """Return how long columns are: products of two are compared beside the product of their lengths."""
    found = np.sqrt(np.maximum(np.diag(brute), 0.0))
    found[:known] = np.maximum(found[:known], 1e-9)
    found[known:] = np.maximum(found[known:], 1e-3 * found[known:].max(initial=1e-6))
    return found


@pytest.mark.parametrize("wander", [None, 0.0, 0.7])
@pytest.mark.parametrize("onset", WINDOWS)
@pytest.mark.parametrize("name", EQUATIONS, ids="{0[0]} {0[1]}".format)
def test_a_window_has_the_sums_of_brute_force(products, columns, name, onset, wander):
    own, every = products(*name), columns(*name, onset)
    first, last = np.array([(a, own.cells if b is None else b) for a, b in WINDOWS[onset]]).T
    window = WindowSums(own, wander).window(np.full_like(first, onset), first, last)
    wandering = own.equation.wander if wander is None else wander
    known = 1 + own.regressors
    assert window.cross.shape == window.power.shape == (len(first), len(own.columns.own))
    for at in range(len(first)):
        rows = blocks_in(first[at], last[at], len(every))
        brute = by_brute_force(every, own.equation.mean, wandering, rows, own.per_chunk * CELL)
        size = lengths(brute, known)
        brute = brute / np.outer(size, size)
        found = window_as_matrix(window, at) / np.outer(size[:known], size[:known])
        np.testing.assert_allclose(found, brute[:known, :known], atol=EXACT)
        np.testing.assert_allclose(window.cross[at] / size[known:] / size[0], brute[known:, 0], atol=EXACT)
        mixed = window.mixed[at] / np.outer(size[known:], size[1:known])
        np.testing.assert_allclose(mixed, brute[known:, 1:known], atol=EXACT)
        np.testing.assert_allclose(window.power[at] / size[known:] ** 2, np.diag(brute)[known:], atol=EXACT)
        assert window.counts[at] == np.count_nonzero(own.equation.known[rows])


def test_every_kind_of_signature_is_among_those_that_are_compared(signatures, products):
    felt = {int(place) for name in EQUATIONS for place in products(*name).columns.own}
    every = signatures.explanations
    assert {each.kind for each in every} == {every[place].kind for place in felt}
    assert {each.fades_s for each in every} == {0.0, *TIMES_S}
    assert {every[place].fades_s for place in felt if every[place].since} == {0.0, *TIMES_S}


@pytest.mark.parametrize("name", EQUATIONS, ids="{0[0]} {0[1]}".format)
def test_what_is_known_without_an_explanation_is_the_same_as_in_a_window(products, name):
    own = products(*name)
    sums = WindowSums(own)
    first, last = np.array([(0, 1), (5, 23), (9, 10), (0, own.cells), (40, 60), (80, own.cells)]).T
    window, known = sums.window(first, first, last), sums.known(first, last)
    assert known.shape == (6, 1 + own.regressors, 1 + own.regressors)
    for at in range(len(first)):
        np.testing.assert_allclose(known[at], window_as_matrix(window, at), rtol=EXACT, atol=1e-12)
    np.testing.assert_array_equal(sums.known_blocks(first, last), window.counts)


def test_an_empty_window_has_no_sums(products):
    sums, at = WindowSums(products("attitude", 0)), np.array([0, 7, 8])
    window = sums.window(np.zeros(3, dtype=np.int64), at, at)
    assert np.abs(window.errors).max() < EXACT
    assert np.abs(window.power).max() < EXACT
    assert np.abs(sums.known(at, at)).max() < EXACT


@pytest.mark.parametrize("name", EQUATIONS, ids="{0[0]} {0[1]}".format)
def test_sums_with_the_chunks_mean_are_those_of_columns(products, columns, name):
    own, onset = products(*name), 11
    sums, edges, every = WindowSums(own), np.array([12, 16, 20, 21, 24]), columns(*name, onset)
    mean, known = own.equation.mean, 1 + own.regressors
    pieces = [blocks_in(first, last, len(every)) for first, last in pairwise(edges)]
    means, powers = sums.chunk_means(edges[:-1], edges[1:])
    for at, rows in enumerate(pieces):
        np.testing.assert_allclose(means[at, :known], mean[rows] @ every[rows, :known], rtol=EXACT, atol=1e-9)
        np.testing.assert_allclose(powers[at], mean[rows] @ mean[rows], rtol=EXACT)
    for signature in range(len(own.columns.own)):
        found = sums.signature_means(onset, edges, signature)
        brute = np.array([mean[rows] @ every[rows, known + signature] for rows in pieces])
        np.testing.assert_allclose(found, brute, rtol=EXACT, atol=1e-9 * max(np.abs(brute).max(), 1.0))


def filtered_from(flight, begin, wrong, fades_s):
    """Return, block by block, the attitude that an estimator at rest is off by from an onset on, and its growth."""
    step, off = flight.blocks.period_s, np.zeros(3)
    turned, turning = np.zeros((2, len(flight), 3))
    for row in range(begin, len(flight)):
        driven = flight.matrices[row] @ wrong[row]
        before, off = off, off + step * (driven - off / fades_s)
        turned[row], turning[row] = off, driven - 0.5 * (before + off) / fades_s  # behind the block, and amid it
    return turned, turning


def wrong_of(flight, kind, axis, first):
    """Return what a gyro is off by at size one from a cell on, shape (blocks, 3)."""
    since_s = flight.time_s - first * CELL * flight.blocks.period_s
    errors = {"bias": np.ones(len(flight)), "drift": since_s, "scale": flight.gyros[:, axis]}
    return on_axis(errors[kind], axis)


def place_of(signatures, suspect, kind, fades_s):
    """Return which explanation is of a gyro and a kind, through an estimator."""
    return signatures.place_of(
        next(
            each
            for each in signatures.explanations
            if (each.suspect, each.kind, each.fades_s) == (suspect, kind, fades_s)
        )
    )


KINDS = ("bias", "drift", "scale")


@pytest.mark.parametrize("fades_s", TIMES_S)
@pytest.mark.parametrize("kind", KINDS)
def test_a_signature_is_what_an_estimator_makes_that_was_right_at_the_onset(
    flight, signatures, relations, kind, fades_s
):
    first, last = 17, 61
    begin, end = first * CELL, last * CELL
    leans = np.array([0.5, 2.0, -1.0, 3.0])
    for axis, gyro in enumerate(GYROS):
        wrong = wrong_of(flight, kind, axis, first)
        turned, turning = filtered_from(flight, begin, wrong, fades_s)
        place, effect = place_of(signatures, gyro, kind, fades_s), Effect(gyros=wrong, turned=turned, turning=turning)
        for name, channel, constants in (("attitude", axis, np.zeros(6)), ("gravity", 0, leans)):
            found = signatures.over(relations[name], channel, constants, place, first, last)
            brute = relations[name].answer(flight, effect, channel, constants)
            np.testing.assert_allclose(found[begin:end], brute[begin:end], atol=EXACT * np.abs(brute).max())
            assert not found[:begin].any()
            assert not found[end:].any()


@pytest.mark.parametrize("kind", KINDS)
def test_how_far_an_attitude_is_turned_is_what_an_estimator_makes_that_was_right_at_the_onset(flight, signatures, kind):
    first, last, fades_s = 17, 61, TIMES_S[1]
    for axis, gyro in enumerate(GYROS):
        turned, _ = filtered_from(flight, first * CELL, wrong_of(flight, kind, axis, first), fades_s)
        found = signatures.turned(place_of(signatures, gyro, kind, fades_s), first, last)
        assert found.shape == ((last - first) * CELL, 3)
        turned = turned[first * CELL : last * CELL]
        np.testing.assert_allclose(found, turned, atol=EXACT * np.abs(turned).max())
    for own in signatures.explanations:  # nothing follows what doesn't fade, whether it turns the attitude or not
        assert own.fades_s or signatures.turned(signatures.place_of(own), first, last).shape == (0, 3)


@pytest.mark.parametrize("angle", ATTITUDE)
def test_a_drift_of_an_angle_begins_with_nothing(flight, signatures, relations, angle):
    own = next(
        each for each in signatures.explanations if each.base == f"{angle} step" and each.kind.startswith("drift")
    )
    first, axis, constants = 23, ATTITUDE.index(angle), np.array([0.0, 5.0, 5.0, 0.0])
    begin = first * CELL
    since = flight.time_s - begin * flight.blocks.period_s
    turned = flight.angle_axes[:, :, axis] * since[:, np.newaxis]
    turning = np.gradient(turned, flight.blocks.period_s, axis=0)
    for name, channel in (("attitude", 0), ("attitude", 2), ("gravity", 1)):
        chosen = constants if name == "gravity" else np.zeros(6)
        found = signatures.over(relations[name], channel, chosen, signatures.place_of(own), first, 84)
        brute = relations[name].answer(flight, Effect(turned=turned, turning=turning), channel, chosen)
        brute = np.where(np.arange(len(flight)) < begin, 0.0, brute)
        own_scale = max(np.abs(brute).max(), 1.0)
        np.testing.assert_allclose(0.0 if found is None else found, brute, atol=EXACT * own_scale)


def test_a_relation_that_feels_nothing_of_an_explanation_has_no_signature(signatures, relations):
    noise = next(each for each in signatures.explanations if each.kind == "noise")
    bias = next(each for each in signatures.explanations if each.kind == "bias" and not each.fades_s)
    assert signatures.over(relations["attitude"], 0, np.zeros(6), signatures.place_of(noise), 5, 20) is None
    assert signatures.over(relations["gravity"], 0, np.zeros(4), signatures.place_of(bias), 5, 20) is None
    assert signatures.over(relations["roughness"], 0, np.zeros(3), signatures.place_of(noise), 5, 20).sum() == 15 * CELL


@pytest.mark.parametrize("name", EQUATIONS, ids="{0[0]} {0[1]}".format)
def test_without_signatures_what_is_known_stays(products, name):
    own = products(*name)
    first, last = np.array([(0, 1), (5, 23), (40, 60), (0, own.cells)]).T
    alone = WindowSums(own.without_signatures)
    np.testing.assert_array_equal(alone.known(first, last), WindowSums(own).known(first, last))
    assert alone.window(first, first, last).cross.shape == (4, 0)


STEPS = tuple((40 - step, 40 + step) for step in range(3, 40, 2))


@pytest.mark.parametrize("windows", [((30, 34),), ((30, 38), (10, 70)), ((60, 80), (12, 33), (0, 84)), STEPS])
def test_windows_that_are_asked_one_by_one_have_the_sums_of_all_at_once(products, windows):
    own = products("attitude", 0)
    every = np.array([(0, own.cells), *windows]).T
    at_once, one_by_one = WindowSums(own, 0.5), WindowSums(own, 0.5)
    wanted = at_once.between(*every)
    for at, window in enumerate(windows, 1):
        found = one_by_one.between(*(np.array([cell]) for cell in window))[0]
        np.testing.assert_allclose(found, wanted[at], rtol=EXACT, atol=1e-9 * np.abs(wanted[0]).max())


def test_sums_of_a_long_flight_are_worked_out_in_pieces(signatures, products, beside, monkeypatch):
    whole = products("attitude", 0)
    monkeypatch.setattr(of_windows, "_AT_ONCE", 7)
    own = products_of(signatures, whole.equation, signatures.answers([whole.equation])[0], beside)
    np.testing.assert_array_equal(own.sums, whole.sums)
    np.testing.assert_array_equal(own.means, whole.means)
    monkeypatch.undo()
    window = np.array([0]), np.array([own.cells])
    at_once = WindowSums(whole).between(*window)
    monkeypatch.setattr(of_windows, "_AT_ONCE", 2)
    np.testing.assert_allclose(WindowSums(own).between(*window), at_once, rtol=EXACT, atol=1e-9)


def test_a_long_flights_effects_are_worked_out_anew_and_are_the_same(signatures, monkeypatch):
    monkeypatch.setattr(of_windows, "_KEPT", 0)
    again = SignatureSet(signatures.flight, signatures.explanations)
    place = place_of(signatures, "q", "drift", TIMES_S[0])
    assert again.effect(place) is not again.effect(place)
    np.testing.assert_array_equal(again.turned(place, 17, 61), signatures.turned(place, 17, 61))
