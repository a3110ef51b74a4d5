"""The search, over evidence that is known: which windows it looks at, what it finds, and how it says so."""

from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.engine import findings, search
from gtmbench.engine.evidence import Support
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.finding import FROZEN, Finding
from gtmbench.engine.findings import tempers_of
from gtmbench.engine.relation import Effect
from gtmbench.engine.search import BOUND, Scan, WindowSearch

CELLS = 200


def explained(suspect, kind="bias", **rest):
    return Explanation(suspect=suspect, kind=kind, effect=lambda _: Effect(), **rest)


OURS = (explained("q"), explained("q", fades_s=7.0), explained("p"), explained("gps"), explained("psi", "step"))


def model_of(explanations=OURS, *, cells=CELLS, cell_s=1.0, start_s=1000.0, known=1.0, is_assumed=False):
    """Return a log of which nothing but its length and its equations is known: three of axes, and a witness."""
    equations = [("attitude", 0, True), ("attitude", 1, True), ("roughness", 1, False), ("gravity", 1, True)]
    products = [
        SimpleNamespace(equation=SimpleNamespace(relation=SimpleNamespace(name=name, is_of_axes=of), channel=channel))
        for name, channel, of in equations
    ]

    class Blocked(SimpleNamespace):
        def __len__(self):
            return round(5 * cells - 2)

    flight = Blocked(blocks=SimpleNamespace(start_s=start_s, period_s=0.2 * cell_s), is_assumed=is_assumed)
    return SimpleNamespace(
        flight=flight,
        explanations=explanations,
        signatures=SimpleNamespace(place_of=explanations.index),
        products=products,
        is_witness=np.array([name == "gravity" for name, _, _ in equations]),
        cells=cells,
        cell_s=cell_s,
        known_share=lambda onset, last: np.full(len(onset), known) if np.isscalar(known) else known(onset, last),
        of_explanations=lambda name: np.array([getattr(each, name) for each in explanations]),
    )


def searching(model, *, tempers=1.0, found=()):
    return WindowSearch(scan=Scan(model=model), tempers=np.full(len(model.explanations), tempers), found=tuple(found))


@pytest.fixture
def evident(monkeypatch):
    """Say what evidence of a window is, by explanation: nats, and of existence how much less; a size and its error."""

    def of(nats, *, less=0.0, size=2.0, deviation=0.1, by_equation=(30.0, 60.0, 5.0, 9.0)):
        def evidence(_, onset, last, *__, **___):
            total = np.array([nats(float(a), float(b)) for a, b in zip(onset, last, strict=True)])
            total = total.reshape(len(onset), -1)
            ratio = total - less
            by = np.multiply.outer(by_equation, np.ones_like(total))
            spread = deviation(onset, last) if callable(deviation) else np.full(len(onset), deviation)
            sizes = size * np.ones_like(total) + 0.01 * (onset[:, np.newaxis] - 50.0)
            return Support(
                onset=onset,
                last=last,
                ratio=ratio,
                total=total,
                size=sizes,
                by_equation=by,
                deviation=np.multiply.outer(spread, np.ones(total.shape[1])),
            )

        monkeypatch.setattr(search, "evidence", evidence)
        monkeypatch.setattr(search, "restless_sums", lambda *_, **__: ())

    return of


def peaked(*peaks, at=50, until=CELLS, slope=3.0, ends=1.0):
    """Return nats that fall off from an onset and an end: by so many a cell."""
    return lambda onset, last: np.array(peaks) - slope * abs(onset - at) - ends * abs(last - until)


# windows ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("cells", "step"), [(200, 1), (1000, 6)])
def test_windows_are_of_four_lengths_by_thirds_of_them_and_to_the_end_of_the_log(cells, step):
    onset, last = Scan(model=model_of(cells=cells)).windows
    lengths = {(5, 2), (10, 3), (20, 7), (60, 20)}
    expected = {(a, a + width) for width, third in lengths for a in range(4, cells - width + 1, third)}
    expected |= {(a, cells) for a in {*range(4, cells - 4, step), *range(cells - 25, cells - 4)}}
    assert sorted(zip(onset.tolist(), last.tolist(), strict=True)) == sorted(expected)


def test_a_window_has_three_cells_at_least_and_begins_four_seconds_behind_the_log():
    onset, last = Scan(model=model_of(cells=40, cell_s=2.0)).windows
    assert (onset.min(), (last - onset).min()) == (2, 3)
    assert {3, 5, 10, 30} <= {*(last - onset).tolist()}
    assert len(Scan(model=model_of(cells=8)).windows[0]) == 0
    assert [*zip(*(each.tolist() for each in Scan(model=model_of(cells=9)).windows), strict=True)] == [(4, 9)]


def test_of_a_window_two_fifths_are_known():
    onset, last = Scan(model=model_of(known=lambda a, _: np.where(a < 100, 0.39, 0.4))).windows
    assert onset.min() == 100
    assert len(last)


def test_what_is_louder_than_chance_is_looked_at_by_parts(evident, monkeypatch):
    asked = []
    evident(lambda onset, _: [6.5 if onset == 50 else 5.5] * len(OURS))
    plain = search.evidence

    def evidence(model, onset, last, sums=None, *, by_parts=False):
        asked.append((by_parts, {*onset.tolist()}))
        found = plain(model, onset, last, sums)
        return Support(**{**found.__dict__, "ratio": 0.5 * found.ratio}) if by_parts else found

    monkeypatch.setattr(search, "evidence", evidence)
    scan = Scan(model=model_of())
    left = scan.left
    assert asked[1] == (True, {50})
    assert {*left[scan.seen.onset == 50].ravel()} == {3.25}
    assert {*left[scan.seen.onset != 50].ravel()} == {5.5}


# what is found ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("temper", "cell_s"), [(1.0, 1.0), (2.0, 0.5)])
def test_a_finding_is_placed_ranked_and_sized_where_its_evidence_is_greatest(evident, temper, cell_s):
    """Within 4.6 nats and a twentieth of the evidence: of 100 nats, 9.6."""
    peaks = temper * np.array([100.0, 91.0, 92.0, 90.0, 50.0])
    evident(peaked(*peaks, slope=3.0 * temper), less=10.0 * temper)
    found = searching(model_of(cell_s=cell_s), tempers=temper).strongest(BOUND)
    assert (found.first, found.last, found.lasts) == (50, CELLS, True)
    assert (found.onset_s, found.end_s) == pytest.approx((1000.0 + 51 * cell_s, 1000.0 + 0.2 * cell_s * 998))
    # of nine nats and less, and a cell that is left out
    assert found.onset_range_s == pytest.approx((1000.0 + 47 * cell_s, 1000.0 + 55 * cell_s))
    assert [(each.suspect, each.fades_s, nats) for each, nats in found.ranked] == [
        ("q", 0.0, 0.0),
        ("p", 0.0, pytest.approx(8.0)),
        ("q", 7.0, pytest.approx(9.0)),
    ]
    assert (found.size, found.evidence) == pytest.approx((2.0, 90.0))
    shows = (found.shows_s - 1000.0) / cell_s  # of 0.1 it is known at once
    assert shows == pytest.approx(53.0)
    spread = 0.2 * np.sqrt(temper)
    assert found.interval == pytest.approx((1.97 - spread, 2.03 + spread))
    assert (found.own_axis, found.shown) == (69.0, 95.0)  # by q's own axis; by all but the witness
    assert found.shown_by == (("attitude", 1, 60.0), ("attitude", 0, 30.0), ("gravity", 1, 9.0), ("roughness", 1, 5.0))


def test_behind_an_estimator_a_size_is_known_to_a_tenth(evident):
    evident(peaked(50.0, 100.0, 50.0, 50.0, 50.0), less=10.0)
    found = searching(model_of()).strongest(BOUND)
    assert found.best.fades_s == 7.0
    assert found.interval == pytest.approx((1.97 - 2.0 * 0.3, 2.03 + 2.0 * 0.3))


@pytest.mark.parametrize(("ends", "last"), [(5.8, CELLS), (6.2, 104)])
def test_a_fault_that_ends_has_to_be_six_nats_better_than_one_that_stays(evident, ends, last):
    evident(peaked(100.0, 50.0, 50.0, 50.0, 50.0, at=44, until=104, ends=ends / 96.0), less=10.0)
    found = searching(model_of()).strongest(BOUND)
    assert (found.first, found.last, found.lasts) == (44, last, last == CELLS)


@pytest.mark.parametrize("until", [47, 90, 134, 140])
def test_an_end_is_the_best_of_those_near_and_of_some_later_ones(evident, until):
    evident(peaked(100.0, 50.0, 50.0, 50.0, 50.0, at=44, until=until))
    found = searching(model_of())._end(44, 104, 0, 1.0)
    assert found == until if until <= 134 else abs(found - until) <= 2


def test_a_finding_exceeds_the_bound_is_calm_where_it_is_placed_and_half_as_much_where_it_was_found(evident):
    own, at = searching(model_of()), search.Place(onset=45, last=CELLS, explanation=0, size=2.0)  # by 85 nats
    bias = SimpleNamespace(best=OURS[0], first=45, last=CELLS)
    for less, is_told in ((83.9, True), (84.1, False)):
        evident(peaked(100.0, 0.0, 0.0, 0.0, 0.0), less=less)
        assert bool(searching(model_of()).strongest(BOUND)) == is_told
    for less, is_told in ((85.0 - 0.51 * BOUND, True), (85.0 - 0.49 * BOUND, False)):
        evident(peaked(100.0, 0.0, 0.0, 0.0, 0.0), less=less)
        assert bool(own._withstands(at, BOUND)) == is_told
    for less, is_told in ((85.0 - 0.71 * BOUND, True), (85.0 - 0.69 * BOUND, False)):
        evident(peaked(100.0, 0.0, 0.0, 0.0, 0.0), less=less)
        assert bool(own.again(bias, BOUND)) == is_told


def test_an_onset_is_dated_again_within_twelve_seconds(evident):
    evident(peaked(100.0, 50.0, 50.0, 50.0, 50.0), less=10.0)
    own, bias = searching(model_of()), SimpleNamespace(best=OURS[0], last=CELLS)
    for first, dated in ((39, 50), (38, 50), (37, 49), (62, 50), (64, 52)):
        bias.first = first
        assert own.again(bias, BOUND).first == dated
    bias.first = 50
    assert own.again(bias, 89.9) is not None
    assert own.again(bias, 90.1) is None
    evident(peaked(100.0, 50.0, 50.0, 50.0, 50.0, at=58, until=60), less=10.0)
    bias.last = 60
    assert own.again(bias, BOUND).first == 58  # two cells before it ends
    evident(peaked(100.0, 50.0, 50.0, 50.0, 50.0, at=2), less=10.0)
    bias.first, bias.last = 8, CELLS
    assert own.again(bias, BOUND).first == 4  # four seconds are known before it


@pytest.mark.parametrize(("cells", "last", "step"), [(200, 200, 1), (200, 50, 1), (2000, 2000, 6)])
def test_onsets_lie_from_four_seconds_on_to_two_cells_before_an_end(cells, last, step):
    onsets = searching(model_of(cells=cells))._onsets(last)
    assert onsets.tolist() == [*range(4, last - 1, step)]


def test_windows_that_do_not_withstand_are_left_with_those_like_them(evident, monkeypatch):
    evident(lambda onset, _: [100.0 - 0.01 * onset] * 5)
    tried = []
    monkeypatch.setattr(WindowSearch, "_withstands", lambda _, at, __: tried.append((at.onset, at.last)))
    assert searching(model_of()).strongest(BOUND) is None
    assert len(tried) == 12
    for at, (onset, last) in enumerate(tried):
        for other in tried[:at]:
            shared = min(last, other[1]) - max(onset, other[0])
            assert shared <= 0.5 * (max(last, other[1]) - min(onset, other[0]))


# what earlier findings leave ----------------------------------------------------------------------------------------


def earlier(suspect, kind="bias", *, fades_s=0.0, shown_by=(), evidence=200.0):
    return Finding(
        first=40,
        last=60,
        onset_s=41.0,
        end_s=60.0,
        onset_range_s=(40.0, 42.0),
        size=1.0,
        interval=(1.0, 1.0),
        ranked=((explained(suspect, kind, fades_s=fades_s), 0.0),),
        evidence=evidence,
        shown_by=shown_by,
    )


@pytest.mark.parametrize(
    ("found", "closed", "more"),
    [
        (earlier("q"), [], 0.0),
        (earlier("p"), [], 0.0),
        (earlier("q", FROZEN), ["q", "theta"], 0.0),
        (earlier("q of IMU2", FROZEN), ["q of IMU2"], 0.0),
        (earlier("q of IMU2", shown_by=(("between IMUs: IMU2", 1, 9.0),)), ["q", "q of IMU2", "theta"], 0.0),
        (earlier("gps"), ["gps"], 0.0),
        (earlier("q", fades_s=7.0), [], 20.0),
    ],
)
def test_beside_what_was_found_more_is_needed_and_some_cannot_be(found, closed, more):
    own = tuple(map(explained, ("q", "q of IMU2", "theta", "p", "gps", "tas")))
    bounds = searching(model_of(own), found=[found])._bounds(
        np.array([10, 10, 59, 60]), np.array([40, 41, 90, 90]), 10.0
    )
    for row, meets in ((0, False), (1, True), (2, True), (3, False)):
        expected = [np.inf if meets and each.suspect in closed else 15.0 + more * meets for each in own]
        assert bounds[row].tolist() == pytest.approx(expected)
    twice = searching(model_of(own), found=[found, earlier("p")])
    assert np.isfinite(twice._allowed(10, 40)).all()
    assert twice._bounds(np.array([10]), np.array([40]), 10.0).max() == 20.0


def test_what_cannot_be_beside_what_was_found_is_not_found_however_much_it_explains(evident):
    evident(peaked(60.0, 50.0, 50.0, 100.0, 50.0, slope=6.0), less=10.0)
    found = searching(model_of(), found=[earlier("gps")]).strongest(BOUND)
    assert [each.suspect for each, _ in found.ranked] == ["q"]
    assert searching(model_of()).strongest(BOUND).best.suspect == "gps"


# odds ---------------------------------------------------------------------------------------------------------------


def test_chances_are_odds_of_a_hundred_to_one_at_the_margin_summed_by_sensor_and_kind():
    kinds = [("q", 0.0), ("q", 7.0), ("p", 0.0), ("r", 0.0), ("phi", 0.0), ("theta", 0.0), ("psi", 0.0), ("tas", 0.0)]
    own = tuple(explained(suspect, fades_s=fades_s) for suspect, fades_s in kinds)
    behind = np.array([0.0, 0.0, 1.0, 1.1, 1.2, 1.3, 1.4, 9.0])
    told = searching(model_of(own))._chances(50.0 - 12.0 * behind, 12.0)
    odds = np.exp(-4.6 * behind)
    assert [suspect for suspect, _, _ in told] == ["q", "p", "r", "phi", "theta"]
    assert told[0] == ("q", "bias", pytest.approx(2.0 * odds[0] / odds.sum()))
    assert told[1][2] == pytest.approx(odds[2] / odds.sum())
    rare = searching(model_of(own[:3]))._chances(np.array([50.0, 30.0, 50.0 - 1.6 * 12.0]), 12.0)
    assert [suspect for suspect, _, _ in rare] == ["q"]


@pytest.mark.parametrize("is_assumed", [True, False])
def test_r_and_a_heading_are_only_two_where_the_gyros_may_drive_it(is_assumed):
    own = tuple(map(explained, ("r", "psi", "q")))
    alike = [searching(model_of(own, is_assumed=is_assumed))._alike(place).tolist() for place in range(3)]
    assert alike == ([[1.0, 2.0, 1.0], [2.0, 1.0, 1.0], [1.0, 1.0, 1.0]] if is_assumed else [[1.0] * 3] * 3)


@pytest.mark.parametrize(("temper", "price"), [(1.0, 0.0), (2.0, 3.0)])
def test_it_shows_once_its_size_is_known_so_well_that_it_would_be_a_finding(evident, temper, price):
    """s^2 / 2 d^2 of 16 nats, tempered, and the price; known better by the root of how long it was seen."""
    own = (explained("q", price=price),)
    evident(peaked(100.0), deviation=lambda onset, last: 1.0 / np.sqrt(last - onset))
    model = model_of(own)
    nats = 0.5 * (BOUND * temper + price)  # of s = 2 and d = 1 / root of n it takes n = nats / 2
    shows = searching(model, tempers=temper)._shows(50, CELLS, 0, 2.0, ())
    ends = np.unique(50 + np.geomspace(3, 150, 30).astype(int))
    assert shows == ends[np.searchsorted(ends - 50, nats)]
    assert searching(model, tempers=100.0)._shows(50, CELLS, 0, 2.0, ()) == CELLS


def test_of_what_has_no_axis_every_axis_counts(evident):
    evident(peaked(50.0, 50.0, 50.0, 100.0, 50.0), less=10.0)
    found = searching(model_of()).strongest(BOUND)
    assert (found.best.suspect, found.own_axis) == ("gps", 99.0)


# what all findings leave --------------------------------------------------------------------------------------------


def left_of(left, *, onset=(10, 40, 59, 60), last=(40, 41, 90, 90), kinds=("bias", "noise")):
    """Return what is left in four windows of each of some explanations: of q and of gps, by kind."""
    own = tuple(explained(suspect, kind) for suspect in ("q", "theta", "gps") for kind in kinds)
    seen = SimpleNamespace(onset=np.array(onset), last=np.array(last))
    return SimpleNamespace(seen=seen, left=np.full((4, len(own)), left), model=model_of(own))


def test_chance_makes_more_of_what_is_left_anywhere_than_six_nats():
    assert tempers_of(left_of(5.0)).tolist() == [1.0] * 6
    assert tempers_of(left_of(9.0)) == pytest.approx(np.full(6, 1.5))
    scan = left_of(0.0)
    scan.left[2, 3] = 12.0
    assert tempers_of(scan).tolist() == [1.0, 1.0, 1.0, 2.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("found", "freed"),
    [
        (earlier("q", evidence=30.0), [0, 1, 2, 3, 4, 5]),  # three nats, a tenth of it
        (earlier("q", FROZEN, evidence=30.0), []),
        (earlier("q", evidence=0.0), []),
        (earlier("gps", "noise", evidence=0.0), [5]),
        (earlier("q", "noise", evidence=0.0), []),
        (earlier("q of IMU2", evidence=0.0, shown_by=(("between IMUs: IMU2", 1, 9.0),)), [0, 1, 2, 3]),
    ],
)
def test_what_a_finding_leaves_where_it_is_counts_as_little_as_it_may_be_wrong(found, freed):
    for meets, rows in ((True, (1, 2)), (False, (0, 3))):
        scan = left_of(0.0)
        scan.left[list(rows)] = 9.0
        less = 6.0 / 6.0 if found.evidence else 1.0
        expected = [less if meets and place in freed else 1.5 for place in range(6)]
        assert tempers_of(scan, [found]).tolist() == pytest.approx(expected)


def test_each_finding_is_judged_again_with_all_others_taken_away(monkeypatch):
    asked = []
    still, gone, stays, last = earlier("p", FROZEN), earlier("q"), earlier("r"), earlier("gps")

    class Searching:
        def __init__(self, *, scan, found, **_):
            self.others = found
            assert scan == ("without", found)

        def again(self, finding, bound):
            assert bound == BOUND
            asked.append((finding, self.others))
            return None if finding is gone else finding

    monkeypatch.setattr(findings, "WindowSearch", Searching)
    bench = SimpleNamespace(without=lambda found: ("without", found))
    assert findings._each_again(bench, [still, gone, stays, last], np.ones(1)) == [still, stays, last]
    assert asked == [(gone, (still, stays, last)), (stays, (still, last)), (last, (still, stays))]


@pytest.mark.parametrize(
    ("found", "where"),
    [
        (earlier("q"), "attitude"),
        (earlier("q", shown_by=(("between IMUs: IMU2", 1, 9.0),)), "between IMUs"),
        (earlier("gps"), ""),
        (earlier("gps", "noise"), None),
    ],
)
def test_about_an_onset_and_an_end_what_is_left_is_no_chance(found, where):
    axis = 1 if where == "attitude" else -1
    told = [] if where is None else [(where, axis, 190, 210), (where, axis, 290, 310)]
    assert findings._edges(found) == told


def test_a_heading_stays_beside_r_that_is_up_to_twice_as_far_behind_as_others(evident):
    own = tuple(map(explained, ("r", "psi", "q")))
    evident(peaked(100.0, 85.0, 85.0))
    found = searching(model_of(own, is_assumed=True)).strongest(BOUND)
    assert [each.suspect for each, _ in found.ranked] == ["r", "psi"]


def test_five_equations_that_show_a_finding_are_told():
    own = searching(model_of())
    relation = SimpleNamespace(name="attitude", is_of_axes=True)
    own.scan.model.products = [
        SimpleNamespace(equation=SimpleNamespace(relation=relation, channel=axis)) for axis in range(8)
    ]
    one = SimpleNamespace(by_equation=np.arange(20.0, 28.0)[:, np.newaxis, np.newaxis] * np.ones((8, 1, 5)))
    assert [axis for _, axis, _ in own._shown_by(one, 0)] == [7, 6, 5, 4, 3]
