"""Evidence of windows is what least squares make of an equation's rows, one window and one explanation at a time."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.engine.evidence import _has_healthy_constants, _moves, evidence
from gtmbench.engine.explanation import TIMES_S, name_of
from gtmbench.engine.explanations.registry import explanations_of
from gtmbench.engine.model import Explained, learnt
from gtmbench.engine.relations.registry import relations_of
from gtmbench.engine.restless import Place, restless_sums, wanders_beside
from gtmbench.engine.sums import CELL, SignatureSet
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import from_on, motion, with_error

NAMES = ("q bias", name_of("q", "bias", TIMES_S[1]), "p drift", "p bias", "q scale", "r noise", "theta step")
LASTING = [place for place, name in enumerate(NAMES) if name != "theta step"]
ONSET_S, SIZE = 40.0, 1.0
WINDOWS = ((20, 31), (39, 100), (70, 80), (5, 40), (95, 98))


@pytest.fixture(scope="module")
def model():
    """A flight of 100 s whose q is off since 40 s, and louder about 75 s; of its p something was found before."""
    record = with_error(motion(100.0, seed=3), "q", from_on(ONSET_S, SIZE))
    shaken = 0.6 * np.random.default_rng(1).standard_normal(len(record)) * (np.abs(record.time_s - 75.0) < 7.0)
    flight = flight_from(with_error(record, "q", shaken), noise=0.02)
    every = {each.name: each for each in explanations_of(flight)}
    wave = np.sin(0.2 * flight.time_s)
    found = Explained(size=0.4, signatures={("attitude", 0): wave, ("attitude", 2): 0.1 * wave})
    signatures = SignatureSet(flight, [replace(every[name], least=0.0, mirror=np.nan) for name in NAMES])
    return learnt(flight, relations_of(flight), signatures, explained=[found])


@pytest.fixture(scope="module")
def rows(model):
    """Return the rows of each equation, and whether it is a witness."""
    return [(Rows(model, sums), is_witness) for sums, is_witness in zip(model.sums, model.is_witness, strict=True)]


class Rows:
    """Whitened rows of an equation, each chunk's mean marginalised, and what is believed of its constants."""

    def __init__(self, model, sums, wander=None):
        self.model, self.sums, self.own = model, sums, sums.products
        self.equation = equation = self.own.equation
        self.mean, self.wander = equation.mean, equation.wander if wander is None else wander
        felt = [each.signatures.get((equation.relation.name, equation.channel)) for each in model.explained]
        more = [each for each in felt if each is not None]
        self.found = [
            max(0.2 * abs(each.size), 1e-3) for each, of in zip(model.explained, felt, strict=True) if of is not None
        ]
        self.columns = np.column_stack([equation.regressors, *(equation.whitened(each) for each in more)])
        self.prior = np.concatenate([equation.relation.prior, self.found])
        self.floor = np.concatenate([equation.relation.floor, self.found])
        self.centre = -np.concatenate([equation.constants, np.zeros(len(more))])

    def between(self, first, last, values):
        """Return rows of cells [first, last) by the root of the inverse of their covariance."""
        rows = np.arange(first * CELL, min(last * CELL, len(values)))
        chunks = rows // (self.own.per_chunk * CELL)
        found = [np.zeros((0, *values.shape[1:]))]
        for chunk in np.unique(chunks):
            part = rows[chunks == chunk]
            shape = self.mean[part]
            power = shape @ shape
            kept = 1.0 - np.sqrt(1.0 - power / (power + self.wander**-2.0)) if power and self.wander else 0.0
            own = values[part]
            found.append(own - kept * np.multiply.outer(shape, shape @ own) / max(power, 1e-300))
        return np.concatenate(found)

    def signature(self, place, onset):
        shape = self.model.signatures.over(
            self.equation.relation, self.equation.channel, self.equation.constants, place, onset, self.own.cells
        )
        return self.equation.whitened(np.zeros(len(self.mean)) if shape is None else shape)

    def fitted(self, parts, values, centre, deviations):
        """Return the constants that fit parts of the log best beside a belief, and what is left with that."""
        rows = np.concatenate([self.between(*part, self.columns) for part in parts])
        own = np.concatenate([self.between(*part, values) for part in parts])
        root = np.linalg.cholesky(np.linalg.inv(deviations)).T
        rows, own = np.concatenate([rows, root]), np.concatenate([own, root @ centre])
        constants = np.linalg.lstsq(rows, own)[0]
        return constants, float(np.square(own - rows @ constants).sum()), np.linalg.inv(rows.T @ rows)

    @cache  # noqa: B019
    def outside(self, onset, last):
        """Return what all outside says of the constants inside, where they may differ a bit."""
        errors = self.equation.errors
        parts = [(0, onset), (last, self.own.cells)]
        centre, _, spread = self.fitted(parts, errors, self.centre, np.diag(self.prior**2))
        return centre, spread + np.diag(self.floor**2)

    def inside(self, onset, last, place, size):
        """Return constants beside a fault of a size, and what is left of the window."""
        begin = min(onset + 1, last)
        values = self.equation.errors - size * self.signature(place, onset)
        return self.fitted([(begin, last)], values, *self.outside(onset, last))

    def ratio_of(self, onset, last, place):
        """Return Q, s'e and s's beside constants, by what is left with sizes of 1, 0 and -1; and known blocks."""
        more, none, less = (self.inside(onset, last, place, size)[1] for size in (1.0, 0.0, -1.0))
        rows = slice(min(onset + 1, last) * CELL, last * CELL)
        return none, 0.25 * (less - more), 0.5 * (more + less) - none, self.equation.known[rows].sum()


def likelihoods(found, low, high):
    """Return the size that equations tell together, each by its own noise, and what each says of it, in nats."""
    misfit, cross, power, blocks = np.array(found).T
    noise = np.maximum((25.0 + misfit) / (25.0 + blocks), 1.0)
    for _ in range(3):
        size = np.clip((cross / noise).sum() / (power / noise).sum(), low, high)
        left = misfit - 2.0 * size * cross + size**2 * power
        information = (power / noise).sum()
        noise = np.maximum((25.0 + left) / (25.0 + blocks), 1.0)
    return size, information**-0.5, 0.5 * (25.0 + blocks) * np.log((25.0 + misfit) / (25.0 + left))


def judged(model, rows, window, place):
    """Return size, deviation and nats of one window and explanation; witnesses have no say in the size."""
    onset, last = window
    of = model.explanations[place]
    reach = of.reach / ((last - onset) * model.cell_s)
    own = [(each.ratio_of(onset, last, place), is_witness) for each, is_witness in rows]
    main = [each for each, is_witness in own if not is_witness]
    size, deviation, told = likelihoods(main, max(of.low, -reach), min(of.high, reach))
    beside = 0.0
    for (misfit, cross, power, blocks), is_witness in own:
        left = misfit - 2.0 * size * cross + size**2 * power
        beside += is_witness * 0.5 * (25.0 + blocks) * np.log((25.0 + misfit) / (25.0 + left))
    return size, deviation, told.sum(), beside


def ratio_by(told, beside, of):
    """Return the nats of equations with those of witnesses, which add or take at most half."""
    return told + np.clip(beside, -0.5 * abs(told), 0.5 * max(told, 0.0)) - of.price


def pairs(found, model):
    """Give windows and explanations that are possible."""
    return [
        (row, place) for row, place in np.argwhere(np.isfinite(found.ratio)).tolist() if place < len(model.explanations)
    ]


@pytest.fixture(scope="module")
def found(model):
    return evidence(model, *np.array(WINDOWS).T)


def test_what_a_window_shows_is_the_likelihood_ratio_of_its_rows_beside_constants_by_all_outside(model, rows, found):
    for row, place in pairs(found, model):
        size, deviation, told, beside = judged(model, rows, WINDOWS[row], place)
        assert found.size[row, place] == pytest.approx(size, rel=1e-5, abs=1e-7)
        assert found.deviation[row, place] == pytest.approx(deviation, rel=1e-5)
        ratio = ratio_by(told, beside, model.explanations[place])
        assert found.ratio[row, place] == pytest.approx(ratio, rel=1e-5, abs=1e-4)
    assert found.size[WINDOWS.index((39, 100)), NAMES.index("q bias")] == pytest.approx(SIZE, abs=0.1)


def test_where_a_fault_lies_is_told_by_the_whole_log_with_one_set_of_constants(model, rows, found):
    for row, place in pairs(found, model):
        (onset, last), of = WINDOWS[row], model.explanations[place]
        reach, told = of.reach / ((last - onset) * model.cell_s), []
        for own, is_witness in rows:
            if is_witness:
                continue
            whole, deviations = [(0, own.own.cells)], np.diag(own.prior**2)
            constants, misfit, spread = own.fitted(whole, own.equation.errors, own.centre, deviations)
            inside = (min(onset + 1, last), last)
            shape, columns = (own.between(*inside, each) for each in (own.signature(place, onset), own.columns))
            errors = own.between(*inside, own.equation.errors)
            mixed = shape @ columns
            told.append(
                (
                    misfit,
                    shape @ errors - mixed @ constants,
                    shape @ shape - mixed @ spread @ mixed,
                    own.equation.known.sum(),
                )
            )
        misfit, cross, power, blocks = np.array(told).T
        noise = np.maximum((25.0 + misfit) / (25.0 + blocks), 1.0)
        size = np.clip((cross / noise).sum() / (power / noise).sum(), max(of.low, -reach), min(of.high, reach))
        left = misfit - 2.0 * size * cross + size**2 * power
        nats = (0.5 * (25.0 + blocks) * np.log((25.0 + misfit) / (25.0 + left))).sum()
        assert found.total[row, place] == pytest.approx(nats - of.price, rel=1e-5, abs=1e-4)


def test_what_shows_in_one_part_of_a_window_alone_counts_as_the_rest_of_it_does(model, rows, found):
    """By the sums over eight parts, with the constants that fit beside the fault."""
    parted = evidence(model, *np.array(WINDOWS).T, by_parts=True)
    shows = found.by_equation[~model.is_witness].sum(axis=0)[:, LASTING].max(axis=1) > 6.0
    for row, place in pairs(found, model):
        (onset, last), of = WINDOWS[row], model.explanations[place]
        size, _, told, beside = judged(model, rows, WINDOWS[row], place)
        edges = np.linspace(onset + 1, last, 9).astype(int)
        shown = np.zeros(8)
        for own, is_witness in rows:
            if is_witness:
                continue
            misfit, cross, power, blocks = own.ratio_of(onset, last, place)
            noise = max((25.0 + misfit - 2.0 * size * cross + size**2 * power) / (25.0 + blocks), 1.0)
            constants, _, _ = own.inside(onset, last, place, size)
            left = own.equation.errors - own.columns @ constants
            shape = own.signature(place, onset)
            for at, part in enumerate(pairwise(edges.tolist())):
                of_part, errors = own.between(*part, shape), own.between(*part, left)
                shown[at] += (2.0 * size * of_part @ errors - size**2 * of_part @ of_part) / noise
        share = (
            np.clip((shown.sum() - shown.max()) / max(shown.sum(), 1e-9), 0.0, 1.0) if of.lasts and shows[row] else 1.0
        )
        ratio = ratio_by(share * told, beside, of)
        assert parted.ratio[row, place] == pytest.approx(ratio, rel=1e-4, abs=1e-3)


def test_windows_of_any_number_are_worked_out_as_each_alone(model):
    onset = np.tile(np.arange(10, 80), 8)
    last = onset + np.repeat([4, 6, 8, 10, 12, 15, 18, 20], 70)
    many = evidence(model, onset, last)
    assert len(many) == len(onset)
    for at in (0, 255, 256, 300, 511, 512, 559):
        one = evidence(model, onset[at : at + 1], last[at : at + 1])
        for name in ("ratio", "total", "size", "deviation"):
            np.testing.assert_allclose(getattr(many, name)[at], getattr(one, name)[0], rtol=1e-9)


def test_what_several_findings_account_for_is_taken_away_together(model):
    key, time_s = ("attitude", 0), model.flight.time_s
    parts = [np.sin(0.1 * time_s), 0.01 * time_s, np.cos(0.3 * time_s)]
    left = [
        learnt(model.flight, model.relations[:1], model.signatures, explained=explained).products[0].equation.left
        for explained in (
            [Explained(size=size, signatures={key: each}) for size, each in zip((2.0, -3.0, 0.5), parts, strict=True)],
            [Explained(size=1.0, signatures={key: 2.0 * parts[0] - 3.0 * parts[1] + 0.5 * parts[2]})],
        )
    ]
    np.testing.assert_allclose(*left, atol=1e-9)


def test_cells_know_how_much_of_them_is_judged_and_how_fast_it_turns(model):
    first, last, rates = np.array([0, 10, 20]), np.array([10, 10, 60]), model.flight.blocks.rates
    assert model.known_share(first, last).tolist() == [1.0, 0.0, 1.0]
    turns = model.turns_deg_s(first, last)
    np.testing.assert_allclose(turns, [rates[:50].std(axis=0), np.zeros(3), rates[100:300].std(axis=0)], atol=1e-9)


# what is possible -----------------------------------------------------------------------------------------------


def test_an_explanation_is_possible_as_far_as_its_bounds_say(model, found):
    """A bias of q from 40 s on, of which more is said."""
    size = found.size[WINDOWS.index((39, 100)), NAMES.index("q bias")]
    impossible = [{"least": 1.01 * size}, {"shortest_s": 61.1}, {"price": np.inf}, {"mirror": size - 0.33}]
    possible = [{}, {"least": 0.99 * size}, {"shortest_s": 60.9}, {"mirror": size + 0.34}]
    bounded = {0.4: {"high": 0.4}, 0.3: {"reach": 0.3 * 61.0}, 1.5: {"low": 1.5}}
    every = [*impossible, *possible, *bounded.values(), {"price": 3.0}]
    bias = model.explanations[NAMES.index("q bias")]
    own = SignatureSet(model.flight, [replace(bias, kind=f"bias {at}", **said) for at, said in enumerate(every)])
    told = evidence(learnt(model.flight, model.relations, own), np.array([39]), np.array([100]))
    ratio, total, sizes = told.ratio[0], told.total[0], told.size[0]
    assert sizes[4] == pytest.approx(size, abs=1e-3)
    assert np.isneginf([*ratio[:4], *total[:4]]).all()
    assert ratio[4:8] == pytest.approx(np.full(4, ratio[4]), rel=1e-9)
    assert sizes[8:11] == pytest.approx([*bounded])
    assert (total[8:11] < total[4]).all()
    assert (ratio[11], total[11]) == pytest.approx((ratio[4] - 3.0, total[4] - 3.0))


@pytest.mark.parametrize(
    ("error", "is_possible"), [(8.0, True), (10.0, False), (lambda q: 0.4 * q, True), (lambda q: 0.48 * q, False)]
)
def test_beside_constants_that_no_installation_has_nothing_is_explained(error, is_possible):
    """Three deviations: nine degrees a second, and three tenths of what is read of each turn."""
    record = motion(100.0, seed=3)
    broken = with_error(record, "q", error if isinstance(error, float) else error(record["q"]))
    flight = flight_from(broken, has_forces=False)
    (bias,) = [each for each in explanations_of(flight) if each.name == "q bias"]
    own = learnt(flight, relations_of(flight)[:1], SignatureSet(flight, [replace(bias, least=0.0)]))
    assert np.isfinite(evidence(own, np.array([39]), np.array([100])).ratio[0, 0]) == is_possible


@pytest.mark.parametrize(("turns_deg_s", "is_judged"), [(0.95, False), (1.05, True)])
def test_a_gain_is_judged_of_what_turns(turns_deg_s, is_judged):
    model = SimpleNamespace(
        turns_deg_s=lambda onset, _: np.tile([9.0, turns_deg_s, 9.0], (len(onset), 1)),
        explanations=[
            SimpleNamespace(suspect=of, is_gain=gain)
            for of, gain in (("q of IMU2", True), ("q", False), ("theta", True))
        ],
    )
    assert _moves(model, np.zeros(2), np.ones(2)).tolist() == [[is_judged, True, True]] * 2


@pytest.mark.parametrize(
    ("enters", "constant", "is_healthy"),
    [
        (("q",), 5.9, True),
        (("q",), 6.1, False),
        ((), 6.1, True),
        ((), 6.9, True),  # twice what isn't known of it
        ((), 7.1, False),
    ],
)
def test_a_constant_that_is_hardly_known_may_be_anywhere_where_no_gyro_enters(enters, constant, is_healthy):
    """Learnt as 3, 1 more inside, and as much more as a fault of size 2 takes of it; a prior of 2."""
    relation = SimpleNamespace(prior=np.array([2.0]), channels=("up",), enters=enters)
    own = SimpleNamespace(own=np.array([1]))
    products = SimpleNamespace(columns=own, equation=SimpleNamespace(relation=relation, constants=np.array([3.0])))
    for sign in (1.0, -1.0):
        seen = SimpleNamespace(
            constants=np.array([[sign * constant - 3.0 + 1.0, 99.0]]),
            absorbed=np.array([[[0.5, 9.0]]]),
            doubt=np.array([[0.5, 0.0]]),
        )
        model = SimpleNamespace(products=[products] * 2, is_witness=[False, True])
        found = _has_healthy_constants(model, [seen, None], np.array([[7.0, 2.0]]))
        assert found.tolist() == [[True, is_healthy]]


# how far means wander -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["q bias", "q bias (7 s)", "p drift"])
@pytest.mark.parametrize(("onset", "last", "size"), [(39, 100, SIZE), (10, 25, 0.0), (50, 62, -0.5), (38, 40, 0.0)])
def test_means_wander_as_far_as_is_left_of_them_beside_a_fault_and_is_not_known(model, name, onset, last, size):
    """A mean of each chunk and the constants are fitted at once."""
    place = NAMES.index(name)
    found = wanders_beside(model, Place(onset=onset, last=last, explanation=place, size=size))
    for sums, wander in zip(model.sums, found, strict=True):
        rows = Rows(model, sums, wander=0.0)
        inside, width = np.arange((onset + 1) * CELL, last * CELL), rows.own.per_chunk * CELL
        chunks = np.unique(inside // width, return_inverse=True)[1]
        means = rows.mean[inside, np.newaxis] * (chunks[:, np.newaxis] == np.arange(chunks.max() + 1))
        centre, spread = Rows(model, sums).outside(onset, last)
        root = np.linalg.cholesky(np.linalg.inv(spread)).T
        known, count = len(centre), means.shape[1]
        design = np.block(
            [
                [rows.columns[inside], means],
                [root, np.zeros((known, count))],
                [np.zeros((count, known)), np.eye(count) / rows.equation.wander],
            ]
        )
        errors = (rows.equation.errors - size * rows.signature(place, onset))[inside]
        fitted = np.linalg.lstsq(design, np.concatenate([errors, root @ centre, np.zeros(count)]))[0][known:]
        unknown = np.diag(np.linalg.inv(design.T @ design))[known:]
        assert wander == pytest.approx(np.sqrt(np.mean(fitted**2 + unknown)), rel=1e-5)


def wanders_of(sums):
    return np.array([each._precision**-0.5 for each in sums])


def test_where_means_wander_both_axes_of_the_tilt_do_and_about_a_window_as_they_do_there(model):
    least = np.array([each.equation.wander for each in model.products])
    place = Place(onset=39, last=60, explanation=NAMES.index("q bias"), size=SIZE)
    inside = wanders_beside(model, place)
    inside[:2] = inside[:2].max()
    np.testing.assert_allclose(wanders_of(restless_sums(model, place)), np.maximum(inside, least))
    before = wanders_beside(model, replace(place, onset=24, last=39, size=0.0))
    goes_on = wanders_beside(model, replace(place, last=75))
    is_over = wanders_beside(model, replace(place, onset=60, last=75, size=0.0))
    around = np.max([wanders_beside(model, place), before, np.minimum(goes_on, is_over)], axis=0)
    around[:2] = around[:2].max()
    np.testing.assert_allclose(wanders_of(restless_sums(model, place, is_around=True)), np.maximum(around, least))
    assert goes_on[1] < is_over[1]  # for so it is: it stays
    for each, sums in zip(restless_sums(model, place), model.sums, strict=True):
        assert (each is sums) == (each._precision == sums._precision)
    late = replace(place, onset=6, last=95)
    np.testing.assert_allclose(
        wanders_of(restless_sums(model, late, is_around=True)), wanders_of(restless_sums(model, late))
    )  # too little is before and behind it


def test_of_what_is_not_known_no_mean_wanders(model):
    place = Place(onset=39, last=40, explanation=0, size=0.0)
    assert np.isnan(wanders_beside(model, place)).all()
    assert [*restless_sums(model, place)] == [*model.sums]


def test_parts_are_looked_at_where_that_is_asked_for(model, found):
    windows = np.array(WINDOWS).T
    np.testing.assert_array_equal(found.ratio, evidence(model, *windows, by_parts=False).ratio)
    assert (evidence(model, *windows, by_parts=True).ratio < found.ratio).any()
