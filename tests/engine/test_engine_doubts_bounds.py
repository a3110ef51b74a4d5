"""Every bound of a rule that names nobody: a finding just within it, and one just beyond."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.engine import doubts
from gtmbench.engine.doubts import with_doubts
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.explanations.dead import DEAD
from gtmbench.engine.finding import Side
from gtmbench.engine.imus.imu import FlightImu, Mounting
from gtmbench.engine.relation import Effect
from gtmbench.engine.sums import CELL, blocks_of_cells
from gtmbench.values.channels import GYROS
from tests.engine.conftest import DURATION_S, frozen

BETWEEN = (("between IMUs: IMU2", 1, 50.0),)


def other(suspect="p", kind="bias", **rest):
    """Return a finding that needs no signature."""
    own = Explanation(suspect=suspect, kind=kind, effect=lambda _: Effect())
    return replace(frozen(suspect, 60.0, DURATION_S), ranked=((own, 0.0),), **rest)


@pytest.mark.parametrize(
    ("rule", "name", "sound", "doubtful"),
    [
        ("_short", "q bias", {"end_s": 70.0}, {"end_s": 69.9}),
        ("_own_axis", "q bias", {"own_axis": 12.0, "shown": 60.0}, {"own_axis": 11.9, "shown": 60.0}),
        ("_own_axis", "q bias", {"own_axis": 20.0, "shown": 200.0}, {"own_axis": 19.9, "shown": 200.0}),
        ("_sides", "q bias", {"side": Side.BEFORE}, {"side": Side.OPEN}),
    ],
)
def test_a_finding_by_itself(finding, rule, name, sound, doubtful):
    assert getattr(doubts, rule)(finding(name, **sound)) == []
    assert len(getattr(doubts, rule)(finding(name, **doubtful))) == 1


@pytest.mark.parametrize(
    ("rule", "name", "sound", "doubtful"),
    [
        ("_learns", "q drift", {"size": 2.51 / 140.0}, {"size": -2.49 / 140.0}),
        ("_is_own_noise", "theta scale", {"size": 0.6}, {"size": 0.7}),
        ("_is_own_noise", "q scale", {"size": 1.4}, {"size": 1.3}),
    ],
)
def test_a_finding_in_its_log(model, finding, rule, name, sound, doubtful):
    for rest, is_doubted in ((sound, False), (doubtful, True)):
        assert bool(getattr(doubts, rule)(model, finding(name, **rest))) == is_doubted
    alone = replace(model, flight=replace(model.flight, is_driven=False))
    assert bool(getattr(doubts, rule)(alone, finding(name, **doubtful))) == (rule != "_learns")


@pytest.mark.parametrize(
    ("name", "rest", "passes"),
    [
        ("q bias", {"end_s": 84.9, "size": 1.5}, True),
        ("q bias", {"end_s": 85.0, "size": 1.5}, False),
        ("q bias", {"end_s": 80.0, "size": -1.99}, True),
        ("q bias", {"end_s": 80.0, "size": -2.01}, False),  # 40 deg: no angle is off so far
        ("q bias (7 s)", {"end_s": 80.0, "size": 2.5}, True),  # its attitude follows
        ("q bias", {"onset_s": 160.0, "end_s": 179.9}, True),
        ("q bias", {"onset_s": 160.0, "end_s": 180.0}, False),
        ("q drift", {"end_s": 179.9}, True),
        ("q drift", {"end_s": 180.0}, False),
        ("q bias", {"onset_s": 24.9, "side": Side.BEFORE}, True),
        ("q bias", {"onset_s": 25.0, "side": Side.BEFORE}, False),
        ("q noise", {"end_s": 70.0}, False),
    ],
)
def test_what_passes_within_25_s_unless_the_log_ends_20_s_later(model, finding, name, rest, passes):
    assert doubts._passes(model, finding(name, **rest)) == passes


@pytest.mark.parametrize(
    ("rest", "is_cancelled"),
    [
        ({"evidence": 30.0}, False),
        ({"evidence": 30.1}, True),
        ({"evidence": 99.0, "first": 130}, False),  # half of it, and no more
        ({"evidence": 99.0, "first": 129}, True),
        ({"evidence": 99.0, "last": 131}, True),
    ],
)
def test_a_healthy_cause_cancels_that_is_a_third_as_strong_over_half_of_it(finding, rest, is_cancelled):
    own = finding("q bias", first=60, last=200)
    healthy = finding("references lean of pitch", **{"first": 60, "last": 200, **rest})
    assert doubts._is_cancelled(own, [own, healthy]) == is_cancelled
    for name in (
        "references lean of bank",
        ("references lean of pitch", "q drift"),
    ):  # another axis; perhaps no healthy one
        assert not doubts._is_cancelled(own, [own, finding(name, first=60, last=200)])


@pytest.mark.parametrize(("apart_s", "are_one"), [(39.9, True), (40.0, False)])
def test_findings_within_40_s_are_one_unless_the_first_dates_nothing(finding, apart_s, are_one):
    first = finding("q bias", end_s=100.0)
    assert doubts._goes_on(first, finding("q bias", onset_s=100.0 + apart_s)) == are_one
    assert not doubts._goes_on(replace(first, own_axis=0.0), finding("q bias", onset_s=110.0))


@pytest.mark.parametrize(("late_s", "is_at_once"), [(2.9, True), (3.0, False)])
def test_within_three_seconds_is_at_once(finding, late_s, is_at_once):
    three = [finding(f"{gyro} bias", 60.0 + late) for gyro, late in (("p", 0.0), ("q", 0.0), ("r", late_s))]
    assert len(doubts._at_once(three)) == (9 if is_at_once else 0)
    angle, gyro = finding("theta scale", 60.0 + late_s), finding("q bias")
    assert bool(doubts._of_other(gyro, [gyro, angle])) == bool(doubts._of_other(angle, [gyro, angle])) == is_at_once


@pytest.mark.parametrize(("evidence", "is_doubted"), [(30.0, False), (30.1, True)])
def test_a_gyro_and_its_angle_leave_a_third_of_each_other(finding, evidence, is_doubted):
    gyro, angle = finding("q bias"), finding("theta scale", evidence=evidence)
    assert bool(doubts._of_other(gyro, [gyro, angle])) == is_doubted
    assert doubts._of_other(gyro, [gyro, replace(gyro, evidence=99.0), finding("phi scale")]) == []
    for sure in (frozen("theta", 60.0, DURATION_S), other("theta", "noise")):
        assert doubts._of_other(gyro, [gyro, replace(sure, evidence=99.0)]) == []


@pytest.mark.parametrize(("size", "leaks"), [(0.59, True), (0.61, False), (0.0, False)])
def test_an_offset_leaks_from_one_that_is_seventeen_times_as_large_about_another_axis(finding, size, leaks):
    own, far = finding("q bias", size=size), finding("p bias", size=-10.0)
    assert bool(doubts._leaks(own, [own, far])) == leaks
    assert doubts._leaks(own, [own, replace(far, first=0, last=50)]) == []
    assert doubts._leaks(own, [own, finding("q bias", size=10.0), other("gps", size=10.0)]) == []


def test_a_factor_needs_two_samples_of_a_gyro_in_a_block(model, finding):
    for step_s, is_doubted in ((0.1, False), (0.101, True)):
        own = replace(model, flight=replace(model.flight, gyro_step_s=step_s))
        assert bool(doubts._seldom(own, finding("q scale"))) == is_doubted
        assert doubts._seldom(own, finding("q bias")) == []


@pytest.mark.parametrize(("shows_s", "side", "is_late"), [(105.0, Side.AFTER, False), (105.1, Side.AFTER, True)])
def test_what_shows_after_twenty_times_as_long_as_is_known(model, finding, shows_s, side, is_late):
    assert bool(doubts._late(model.flight, finding(onset_s=5.0, shows_s=shows_s, side=side))) == is_late
    assert doubts._late(model.flight, finding(onset_s=5.0, shows_s=shows_s, side=Side.BEFORE)) == []


@pytest.mark.parametrize(("size", "is_bent"), [(2.8, False), (2.95, True)])
def test_an_attitude_bends_other_axes_from_twenty_degrees_on(model, finding, size, is_bent):
    bends, own = finding("p bias (7 s)", 40.0, size=size), finding("q bias", 80.0)
    same_axis = finding("q bias (7 s)", 40.0, size=9.0)
    for found in ([own, bends], [same_axis, own, bends], [bends, own, same_axis]):
        assert bool(doubts._bent(model, own, found)) == is_bent
    for other_ in (finding("p bias", 40.0, size=9.0), finding("p bias (7 s)", 0.0, 70.0, size=9.0)):
        alone = replace(model, flight=replace(model.flight, is_driven=False))
        assert doubts._bent(alone, own, [own, other_]) == []  # nothing follows it; before
    before = finding("p bias (7 s)", 5.0, 70.0, size=9.0)
    for own_size, is_learnt in ((2.4, True), (2.6, False)):  # so large an offset no estimator learns
        small = finding("q bias", 80.0, size=own_size)
        assert bool(doubts._bent(model, small, [small, before])) == is_learnt
    assert doubts._bent(model, own, [own, finding("p bias (7 s)", 5.0, 70.0, size=1.3)]) == []  # ten degrees
    assert doubts._bent(model, own, [own, finding("p bias (7 s)", 5.0, 70.0, size=1.6)])
    steady = doubts._bend_deg(model, finding("p bias (7 s)", 40.0, size=-3.0), 7.0)
    assert steady == pytest.approx(21.0, rel=0.02)
    assert doubts._bend_deg(model, bends, 7.0, of="q of IMU2") == 0.0


# an angle that runs with its gyro's error -------------------------------------------------------------------------


def running(model, axis, ran_deg):
    """Return a log of which an angle is 5 about 60 s, and so far off that in its last five seconds; else anything."""
    blocks = model.flight.blocks
    angles = np.zeros_like(blocks.angles)
    time_s = blocks.time_s
    angles[:, axis] = np.where(time_s < 53.9, -70.0, np.where(time_s < 80.0, 0.0, 70.0))
    angles[time_s > 194.9, axis] = ran_deg
    angles += 5.0  # as it was trimmed
    blocks = replace(blocks, angles=angles, euler_rates=0.0 * angles)
    return replace(model, flight=replace(model.flight, blocks=blocks))


@pytest.mark.parametrize(
    ("name", "size", "ran_deg", "is_told"),
    [
        ("q bias", 0.2, -14.1, True),  # of 28
        ("q bias", 0.2, -13.9, False),
        ("q bias", 0.2, 14.1, False),
        ("q bias", -0.2, 14.1, True),
        ("q bias", 0.145, -99.0, True),  # of 20.3
        ("q bias", 0.140, -99.0, False),
        ("q bias", 2.0, -40.1, True),  # of 280, but far
        ("q bias", 2.0, -39.9, False),
        ("p drift", 0.0021, -10.4, True),  # of 20.6
        ("p drift", 0.0021, -10.2, False),
        ("q scale", 5.0, -99.0, False),
        ("r bias", 0.2, -14.1, False),
    ],
)
def test_an_angle_may_be_wrong_that_runs_half_as_far_as_its_gyros_error_turns(
    model, finding, name, size, ran_deg, is_told
):
    own = running(model, GYROS.index(name[0]), ran_deg)
    assert bool(doubts._own_angle(own, finding(name, size=size))) == is_told
    sure = replace(own, flight=replace(own.flight, is_assumed=False))
    assert doubts._own_angle(sure, finding(name, size=size)) == ()
    alone = replace(sure, flight=replace(sure.flight, is_driven=False))
    assert bool(doubts._own_angle(alone, finding(name, size=size))) == is_told


@pytest.mark.parametrize(
    ("name", "angle", "deg", "since", "suspects"),
    [
        ("q scale", 0, 178.0, 0.0, ("phi",)),
        ("p bias", 0, -61.0, 0.0, ("phi",)),
        ("p bias", 0, -59.0, 0.0, ()),
        ("q bias", 0, 418.0, 0.0, ()),  # a turn and 58 deg
        ("q scale", 0, 31.0, 0.49, ("phi",)),  # which makes a gain
        ("q scale", 0, 29.0, 0.0, ()),
        ("q bias", 0, 31.0, 0.0, ()),
        ("p scale", 0, 59.0, 0.0, ()),  # what p should read, the pitch tells
        ("p scale", 1, 31.0, 0.0, ("theta",)),
        ("q scale", 2, 178.0, 0.0, ()),  # a heading
        ("q bias", 1, 80.0, 0.49, ("theta",)),
        ("q bias", 1, 80.0, 0.51, ()),  # less than half of its time
    ],
)
def test_an_angle_far_from_level_for_half_of_a_finding_is_a_suspect_too(
    model, finding, name, angle, deg, since, suspects
):
    found = finding(name)
    flight = replace(model.flight, is_driven=False)
    rows = np.flatnonzero(blocks_of_cells(found.first, found.last, len(flight)) & flight.judged)
    angles = np.zeros_like(flight.blocks.angles)
    angles[rows[round(since * len(rows)) :], angle] = deg
    tipped = replace(flight, blocks=replace(flight.blocks, angles=angles, euler_rates=0.0 * angles))
    assert doubts._tipped(tipped, found) == suspects
    assert doubts._tipped(replace(tipped, is_driven=True, is_assumed=False), found) == ()
    assert doubts._tipped(replace(tipped, is_driven=True, is_assumed=True), found) == suspects
    assert doubts._tipped(replace(tipped, is_assumed=False), found) == suspects
    always = replace(tipped, blocks=replace(tipped.blocks, angles=np.full_like(angles, 80.0)))
    assert doubts._tipped(always, found) == ()  # as it flies


# of two IMUs ------------------------------------------------------------------------------------------------------


def equation(left, level=1.0, known=True):
    left = np.asarray(left, dtype=float)
    told = SimpleNamespace(left=left, level=np.full(len(left), level), known=np.full(len(left), known))
    return SimpleNamespace(products=SimpleNamespace(equation=told))


@pytest.mark.parametrize(("louder", "is_restless"), [(1.45, False), (1.55, True)])
@pytest.mark.parametrize("axis", [0, 2])
def test_other_axes_are_restless_that_differ_half_as_much_again(model, finding, axis, louder, is_restless):
    """By means over a second: what changes its sign within it is noise."""
    count, flight = len(model.flight), model.flight
    own = finding("q bias", first=60, last=200)
    inside = np.arange(count) >= 300
    quick = np.resize([9.0, -9.0, 9.0, -9.0, 0.0], count) * inside
    known = np.arange(count) % 40 != 4
    left = np.where(known, np.where(inside, louder, 1.0) + quick, 1e6)
    sums = {axis: equation(left, level=2.0, known=known), 1: equation(np.where(inside, 99.0, 1.0))}
    assert doubts._is_restless(SimpleNamespace(flight=flight, own_axis=sums.get), own, [own]) == is_restless
    calm = SimpleNamespace(flight=flight, own_axis=lambda _: None)
    shown = replace(finding("p bias"), shown_by=(("attitude", 0, 50.0),))
    assert doubts._is_restless(calm, own, [own, shown])
    assert not doubts._is_restless(calm, own, [own, replace(shown, shown_by=BETWEEN)])
    assert not doubts._is_restless(calm, own, [own, replace(shown, first=0, last=50)])


@pytest.mark.parametrize(
    ("share", "from_s", "to_s", "stays"),
    [
        (0.19, 59.0, 200.0, True),
        (0.21, 59.0, 200.0, False),
        (-0.21, 59.0, 200.0, False),
        (1.0, 59.0, 78.9, True),
        (1.0, 119.1, 200.0, True),
        (1.0, 59.0, 90.0, False),
        (1.0, 0.0, 38.9, True),
    ],
)
def test_gyro_and_attitude_agree_again_from_20_to_60_s_behind_an_onset(model, finding, share, from_s, to_s, stays):
    """As in the 20 s before it, of an error of 2 deg/s that begins at 59 s."""
    time_s = model.flight.blocks.time_s
    left = 0.5 + 2.0 * share * ((time_s > from_s - 0.1) & (time_s < to_s - 0.1))
    own = SimpleNamespace(flight=model.flight, own_axis=lambda axis: equation(left) if axis == 1 else None)
    assert doubts._stays(own, finding("q bias")) == stays
    assert not doubts._stays(own, finding("q scale"))
    assert not doubts._stays(own, finding("p bias"))


@pytest.mark.parametrize(("known_s", "stays"), [(10.1, True), (9.9, False)])
def test_of_ten_seconds_that_are_known_it_is_told_whether_they_agree(model, finding, known_s, stays):
    sums = equation(np.zeros(len(model.flight)))
    time_s = model.flight.blocks.time_s
    for begins_s in (59.0 - known_s, 119.0 - known_s):
        sums.products.equation.known = (time_s >= begins_s) | (np.abs(time_s - 109.0) < 9.9 * (begins_s < 59.0))
        sums.products.equation.known &= (time_s < 59.0) | (time_s >= max(begins_s, 79.0))
        if begins_s > 59.0:
            sums.products.equation.known |= time_s < 59.0
        assert doubts._stays(SimpleNamespace(flight=model.flight, own_axis=lambda _: sums), finding("q bias")) == stays


def beside(model, *readings):
    """Return a log with further IMUs."""
    flight = model.flight
    rest = np.zeros_like(flight.gyros)
    imus = tuple(
        FlightImu(name=f"IMU{number}", gyros=each, rough=rest, held_s=rest, mounting=Mounting())
        for number, each in enumerate(readings, 2)
    )
    return replace(model, flight=replace(flight, imus=imus))


@pytest.mark.parametrize(
    ("name", "size", "shown_by", "are_both"),
    [
        ("q bias", 2.7, BETWEEN, False),  # 43 degrees behind the slowest estimator
        ("q bias", 2.95, BETWEEN, True),  # 47
        ("q scale", 0.5, BETWEEN, True),
        ("q noise", 2.0, BETWEEN, False),
        ("q bias", 9.0, (), False),  # nothing parts IMUs
        ("q bias", 9.0, (*BETWEEN, ("attitude", 1, 50.0)), False),  # the attitude tells, and no other axis is restless
        ("q scale", 0.5, (*BETWEEN, ("attitude", 1, 50.0)), True),
        ("q scale (7 s)", 0.5, (*BETWEEN, ("attitude", 1, 50.0)), False),
    ],
)
def test_of_two_imus_both_are_left_where_an_attitude_that_one_drives_tells_nothing(
    monkeypatch, model, finding, name, size, shown_by, are_both
):
    monkeypatch.setattr(doubts, "_stays", lambda *_: False)
    monkeypatch.setattr(doubts, "_is_restless", lambda *_: False)
    two, own = beside(model, model.flight.gyros), finding(name, size=size, shown_by=shown_by)
    assert doubts._twin(two, own, [own]) == (("q of IMU2",) if are_both else ())
    assert doubts._twin(beside(model, *[model.flight.gyros] * 2), own, [own]) == ()
    assert doubts._twin(replace(two, flight=replace(two.flight, is_driven=False)), own, [own]) == ()
    twin = replace(own, ranked=((replace(own.best, suspect="q of IMU2"), 0.0),))
    assert doubts._twin(two, twin, [twin]) == (("q",) if are_both else ())
    monkeypatch.setattr(doubts, "_stays", lambda *_: True)
    if name == "q bias" and shown_by == BETWEEN:
        assert doubts._twin(two, own, [own]) == ()
        monkeypatch.setattr(doubts, "_is_restless", lambda *_: True)
        assert bool(doubts._twin(two, own, [own])) == are_both


@pytest.mark.parametrize(("grows", "is_doubted"), [(1.3, False), (1.2, True), (0.6, True)])
def test_a_gain_between_imus_is_borne_out_by_shares_of_turns(model, finding, grows, is_doubted):
    """A gyro that reads two thirds of its turns: the other one reads half as much again of what it does."""
    gyros, inside = model.flight.gyros, np.arange(len(model.flight)) >= 295
    two = beside(model, gyros * np.where(inside, grows, 1.0)[:, np.newaxis])
    own = finding("q scale", size=-0.5, shown_by=BETWEEN)
    assert bool(doubts._gain_between(two, own)) == is_doubted
    assert doubts._gain_between(two, replace(own, shown_by=())) == []
    assert doubts._gain_between(two, finding("q bias", shown_by=BETWEEN)) == []
    assert doubts._gain_between(two, replace(own, shown_by=(("between IMUs: IMU3", 1, 9.0),)))


@pytest.mark.parametrize(
    ("suspect", "sizes", "is_doubted"),
    [
        ("q", (1.0, 1.0), False),
        ("q", (1.0, 0.36), False),  # both part from it by more than a third of the most
        ("q", (1.0, 0.34), True),
        ("q of IMU2", (1.0, 0.34), False),
        ("q of IMU2", (1.0, 0.36), True),
        ("q of IMU3", (1.0, 0.34), True),
    ],
)
def test_of_three_imus_one_is_named_that_parts_alone_from_both(model, finding, suspect, sizes, is_doubted):
    wave = np.sin(np.arange(len(model.flight)))[:, np.newaxis]
    three = beside(model, *(model.flight.gyros + size * wave for size in sizes))
    own = finding("q bias", shown_by=BETWEEN)
    own = replace(own, ranked=((replace(own.best, suspect=suspect), 0.0),))
    assert bool(doubts._outvoted(three, own)) == is_doubted
    assert doubts._outvoted(beside(model, model.flight.gyros), own) == []
    assert doubts._outvoted(three, replace(own, shown_by=())) == []


@pytest.mark.parametrize("suspect", ["q", "q of IMU2"])
@pytest.mark.parametrize(("parts", "is_doubted"), [(0.3, False), (0.0, True)])
def test_noise_that_leaves_the_means_of_imus_is_vibration(model, finding, suspect, parts, is_doubted):
    random, inside = np.random.default_rng(1), (np.arange(len(model.flight)) >= 295)[:, np.newaxis]
    apart = random.standard_normal((len(inside), 3)) * (0.1 + parts * inside)
    two = beside(model, model.flight.gyros + apart)
    own = finding("q noise")
    own = replace(own, ranked=((replace(own.best, suspect=suspect), 0.0),))
    assert bool(doubts._shaken(two, own)) == is_doubted
    assert doubts._shaken(two, finding("q bias")) == doubts._shaken(model, own) == []


# vibration, and motion --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("others", "felt", "is_doubted"),
    [
        (1.45, 1.0, False),  # by less than half of what is usual
        (1.55, 1.0, True),
        (1.0, 1.45, False),
        (1.0, 1.55, True),
    ],
)
def test_noise_of_a_gyro_beside_others_or_forces_that_are_half_as_loud_again_is_vibration(
    model, finding, others, felt, is_doubted
):
    flight, count = model.flight, len(model.flight)
    inside = (np.arange(count) >= 295)[:, np.newaxis]
    rough = np.where(inside, [others, 2.0, 1.0], 1.0) + np.zeros((count, 3))
    forces = 1e-4 * np.where(inside, [1.0, felt, 1.0], 1.0) + np.zeros((count, 3))
    shaken = replace(flight, blocks=replace(flight.blocks, rough=rough), felt_rough=forces)
    assert bool(doubts._shakes_all(shaken, finding("q noise"))) == is_doubted
    assert doubts._shakes_all(shaken, finding("q bias")) == doubts._shakes_all(shaken, other("gps", "noise")) == []
    louder = replace(
        shaken, blocks=replace(shaken.blocks, rough=np.where(inside, [others, 4.0, 1.0], 1.0) + 0.0 * rough)
    )
    if felt == 1.0:  # 0.55 is less than a quarter of three
        assert doubts._shakes_all(louder, finding("q noise")) == []
    for missing in (inside, ~inside):
        nothing = replace(
            shaken, blocks=replace(shaken.blocks, rough=np.where(missing, np.nan, rough)), felt_rough=None
        )
        assert doubts._shakes_all(nothing, finding("q noise")) == []
        rises = doubts._rises(shaken, np.where(missing, np.nan, rough), inside[:, 0])
        assert [each.tolist() for each in rises] == [[0.0] * 3] * 2


@pytest.mark.parametrize(
    ("calm_deg_s", "lively_s", "is_seen"),
    [
        (5.1, 0.0, True),  # half as fast elsewhere
        (4.9, 0.0, False),
        (1.0, 10.0, True),  # for ten seconds
        (1.0, 9.8, False),
    ],
)
def test_motion_is_seen_elsewhere_that_is_half_as_fast_for_ten_seconds(model, calm_deg_s, lively_s, is_seen):
    time_s = model.flight.blocks.time_s
    lively = np.where(time_s >= 149.9, 10.0, calm_deg_s)
    lively[: round(5.0 * lively_s)] = 6.0
    assert doubts._is_seen(model.flight, lively, inside=time_s >= 149.9) == is_seen
    short = time_s >= 185.0  # of fifteen seconds beside it half are enough
    lively = np.where((time_s < 10.0) & (time_s >= 10.0 - lively_s), 6.0, calm_deg_s)
    assert doubts._is_seen(model.flight, np.where(short, 10.0, lively), inside=short) == is_seen
    assert not doubts._is_seen(model.flight, lively, inside=time_s < 0.0)


def test_imus_that_part_by_a_quarter_of_how_fast_they_turn_need_no_motion_elsewhere(model, finding):
    blocks = model.flight.blocks
    late = blocks.time_s >= 59.0
    rates = np.where(late, np.resize([8.0, -8.0], len(late)), 0.1)[:, np.newaxis] * np.ones(3)
    own = replace(model, flight=replace(model.flight, blocks=replace(blocks, rates=rates)))
    for size, parts, is_doubted in ((3.51, True, False), (3.41, True, True), (3.51, False, True)):
        told = finding("q bias", size=size, shown_by=BETWEEN if parts else ())
        assert bool(doubts._regime(own, told)) == is_doubted
    assert with_doubts(own, [finding("q bias")])[0].doubt == "it moves more there than anywhere else"


def test_motion_is_that_of_its_own_axis_as_far_as_it_takes_to_show_on_the_logs_clock(model, finding):
    """p turns from 100 s on; q and r all the time."""
    blocks = replace(model.flight.blocks, start_s=1000.0)
    late = blocks.time_s >= 1099.9
    rates = np.resize([8.0, -8.0], len(late))[:, np.newaxis] * np.column_stack(
        [np.where(late, 1.0, 0.01), *np.ones((2, len(late)))]
    )
    own = replace(model, flight=replace(model.flight, blocks=replace(blocks, rates=rates)))
    for name, shows_s, is_doubted in (("p bias", 1090.0, False), ("p bias", 1200.0, True), ("q bias", 1200.0, False)):
        told = finding(name, 60.0, shows_s=shows_s, lasts=True)
        assert bool(doubts._regime(own, told)) == is_doubted


@pytest.mark.parametrize(
    ("name", "shows_s", "until"),
    [
        ("q bias", 1063.0, 63),
        ("q bias", 1063.1, 64),  # amid a cell
        ("q bias", 1010.0, 60),  # one at least
        ("q bias", 1900.0, 200),
        ("q scale", 1063.0, 200),  # a factor shows by all of it
        ("q bias", None, 200),  # what ends does so by all of it
    ],
)
def test_motion_is_asked_for_from_the_onset_to_the_end_of_the_cell_in_which_it_shows(
    monkeypatch, model, finding, name, shows_s, until
):
    asked = []
    monkeypatch.setattr(doubts, "_is_seen", lambda *_, inside: not asked.append(np.flatnonzero(inside)))
    own = replace(model, flight=replace(model.flight, blocks=replace(model.flight.blocks, start_s=1000.0)))
    told = finding(name, shows_s=shows_s or 1063.0, lasts=shows_s is not None)
    assert doubts._regime(own, told) == []
    (blocks,) = asked
    assert blocks.tolist() == [*range(59 * CELL, until * CELL)]


def test_other_axes_are_restless_by_a_few_blocks_that_are_far_off(model, finding):
    own, bursts = finding("q bias", first=60, last=200), np.ones(len(model.flight))
    bursts[500:520] = 50.0
    sums = {0: equation(bursts)}
    assert doubts._is_restless(SimpleNamespace(flight=model.flight, own_axis=sums.get), own, [own])


def test_motion_of_a_sensor_that_has_no_axis_is_that_of_all(monkeypatch, model, finding):
    own, asked = finding("q bias"), []
    best = replace(own.best, suspect="gps")
    monkeypatch.setattr(doubts, "_over", lambda turning, _: asked.append(turning) or turning)
    doubts._regime(model, replace(own, ranked=((best, 0.0),)))
    np.testing.assert_allclose(asked[0], np.linalg.norm(np.nan_to_num(model.flight.blocks.rates), axis=1))


# what is made by another ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shows_s", "evidence", "is_behind"), [(72.9, 99.0, True), (73.1, 99.0, False), (72.9, 101.0, False)]
)
def test_a_weaker_finding_that_begins_when_another_has_shown_doesnt_speak_against_it(
    model, finding, shows_s, evidence, is_behind
):
    """It would bend the attitude by 45 deg, were it no artefact."""
    own = finding("q bias", 40.0, evidence=100.0, shows_s=shows_s)
    later = finding("p bias (7 s)", 80.0, evidence=evidence, size=9.0, onset_range_s=(73.0, 81.0), shows_s=95.0)
    assert bool(doubts._bent(model, own, [own, later])) != is_behind
    assert doubts._bent(model, later, [own, replace(own, ranked=finding("q bias (7 s)").ranked, size=9.0)])


@pytest.mark.parametrize(("held", "is_named"), [(0.4, True), (0.6, False)])
def test_a_gyro_that_reads_one_value_for_most_of_it_is_not_said_to_be_dead(model, finding, held, is_named):
    blocks = model.flight.blocks
    stands = np.where(np.arange(len(blocks)) % 10 < 10 * held, 0.5, 0.0)
    held_s = np.where(np.arange(6) == 1, stands[:, np.newaxis], 0.0)
    flight = replace(model.flight, blocks=replace(blocks, held_s=held_s))
    dead = finding("q bias", 60.0)
    dead = replace(dead, ranked=((replace(dead.best, kind=DEAD, of_turns=True), 0.0),))
    assert bool(doubts._never_read(flight, dead)) != is_named
    assert doubts._never_read(flight, finding("q bias", 60.0)) == []
