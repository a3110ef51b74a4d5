"""An answer to commands piece by piece: which stretch is judged, where it is divided, what stands against a name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.detectors.surfaces.commanded import AIRSPEED, Commanded
from gtmbench.detectors.surfaces.evidence import AnswerChange, Culprit, SuspectEvidence
from gtmbench.engine import commands as of_commands
from gtmbench.engine.commands import COMPARED, CommandsJudged, _doubts, _excluded, divided
from gtmbench.engine.samples import Samples
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, GYROS, SURFACES
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, unjudged
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import motion

STEP_S = 0.05

# the stretch ----------------------------------------------------------------------------------------------------


@pytest.fixture
def framed_of(monkeypatch):
    """Return which records a frame was asked of, in place of an identification."""
    asked = []

    def frame_of(flow, records, period_s):
        assert period_s == STEP_S
        asked.extend(records)
        return SimpleNamespace(flow=flow)

    monkeypatch.setattr(of_commands, "frame_of", frame_of)
    return asked


def flown(speed_kt=lambda _: 100.0, *, duration_s=120.0, step_s=0.1, out=(), vanes=("alpha", "beta")):
    """Return what is commanded on a flight on which every reading grows by itself in a straight line."""
    time_s = np.arange(0.0, duration_s + step_s, step_s)
    names = (*GYROS, *vanes, "nx", "ny", "nz", "altitude", *COMMANDS)
    read = {name: Samples(time_s, place + 0.01 * place * time_s) for place, name in enumerate(names, 1)}
    read["tas"] = Samples(time_s, np.array([speed_kt(each) for each in time_s]))
    flight = flight_from(motion(duration_s), is_driven=False, has_forces=False).without(out)
    return of_commands.commanded_of(flight, read), read, flight


def test_a_stretch_holds_the_means_of_what_is_read_five_seconds_from_where_it_begins_and_ends(framed_of):
    found, read, flight = flown()
    assert (found.start_s, found.end_s, found.period_s) == pytest.approx(
        (5.0, 114.8, STEP_S)
    )  # a fifth of a second before it lands no angle is known
    amid_s = found.start_s + STEP_S * (np.arange(len(found.values)) + 0.5)
    for name in (*GYROS, "alpha", "nz", *COMMANDS):
        np.testing.assert_allclose(found.column(name), np.interp(amid_s, *read[name]), atol=1e-9)
    angles = dict(zip(("phi", "theta"), flight.angles.T[:2], strict=True))
    for name, own in angles.items():  # by the flight's own, though no sensor of that name is handed over
        np.testing.assert_allclose(found.column(name), np.interp(amid_s, flight.blocks.time_s, own), atol=0.1)
    np.testing.assert_array_equal(framed_of[0], found.values)
    bare = flown(vanes=())[0]
    assert not {"phi", "alpha", "nx"} & {*bare.channels}
    assert bare.end_s == pytest.approx(flight.blocks.end_s - 5.0)


@pytest.mark.usefixtures("framed_of")
def test_a_stretch_begins_amid_a_step_by_where_its_middle_is_flown(monkeypatch):
    flight = flight_from(motion(120.0), is_driven=False, has_forces=False)
    monkeypatch.setattr(type(flight), "flown", flight.blocks.time_s > 30.0)
    found, _, flight = flown(vanes=())
    begins_s = flight.blocks.time_s[flight.flown][0] - 0.5 * flight.blocks.period_s
    assert found.start_s == pytest.approx(begins_s + 5.0, abs=0.01)


def test_effects_are_told_by_five_minutes_before_a_time(framed_of):
    found, _, _ = flown(duration_s=330.0)
    split = of_commands.framed(found, 310.0)
    np.testing.assert_array_equal(framed_of[0], found.values[:6000])
    np.testing.assert_array_equal(framed_of[1], found.until(310.0).values[-6000:])
    assert split.values is found.values


@pytest.mark.usefixtures("framed_of")
@pytest.mark.parametrize(
    ("speed_kt", "start_s", "end_s"),
    [
        (lambda time_s: 50.0 if time_s > 90.0 else 100.0, 5.0, 85.0),  # the wheels roll
        (lambda time_s: 100.0 if time_s < 40.0 else 70.0, 5.0, 114.8),  # a third of it is faster
        (lambda time_s: 130.0 if time_s < 12.0 else 70.0, 5.0, 114.8),  # a tenth of it is far faster
        (lambda time_s: 50.0 if 25.0 < time_s < 30.0 else 100.0, 35.0, 114.8),  # the longest stretch
    ],
)
def test_it_flies_where_it_is_about_as_fast_as_in_its_faster_quarter(speed_kt, start_s, end_s):
    found, _, _ = flown(speed_kt)
    assert (found.start_s, found.end_s) == pytest.approx((start_s, end_s), abs=0.06)


@pytest.mark.usefixtures("framed_of")
def test_what_is_too_short_too_slow_or_not_read_is_not_judged(monkeypatch):
    assert flown(duration_s=70.2)[0] is not None
    assert flown(duration_s=69.8)[0] is None
    assert flown(step_s=0.125)[0] is not None
    assert flown(step_s=0.13)[0] is None
    assert flown(out=[(0.0, 120.0)])[0] is None
    assert flown(out=[(0.0, 40.0)])[0].start_s == pytest.approx(45.0, abs=0.3)
    _, read, flight = flown()
    for name in ("rudder", "tas", "ny"):
        assert of_commands.commanded_of(flight, {of: each for of, each in read.items() if of != name}) is None
    needed = {name: read[name] for name in (*GYROS, *COMMANDS, "ny", "nz", "tas", "altitude")}
    assert of_commands.commanded_of(flight, needed) is not None
    slow = {name: Samples(*(each[::2] for each in read[name])) for name in ("altitude", "tas")}
    assert of_commands.commanded_of(flight, read | slow) is not None  # only gyros and surfaces have to be fast
    for name in ("p", SURFACES[0]):
        slow = {name: Samples(*(each[::2] for each in read[name]))}
        assert of_commands.commanded_of(flight, read | slow) is None

    def unmoved(*_):
        raise InputError("no surface moved")

    monkeypatch.setattr(of_commands, "frame_of", unmoved)
    assert flown()[0] is None


# where it is divided --------------------------------------------------------------------------------------------


def answers(onset_s, *, duration_s=160.0, change=3.0, noise=1.0, seed=1):
    """Return causes, and last what they explain, whose effects are others from an onset on."""
    random, count = np.random.default_rng(seed), round(duration_s / STEP_S)
    causes = random.standard_normal((count, 2)) * [1.0, 4.0]
    effects = np.array([2.0, 0.3]) + np.outer(np.arange(count) * STEP_S >= onset_s, [change, 0.0])
    return np.column_stack([causes, (causes * effects).sum(axis=1) + noise * random.standard_normal(count)])


def by_least_squares(relations, ridge=3.0, rows=80):
    """Return when effects change most, and between when at odds of 100 to 1: the misfit of one fit over that of two."""
    told = 0.0
    for part in relations.values():
        scaled = part / np.sqrt(np.mean(np.square(part), axis=0))
        priors = np.sqrt(ridge) * np.eye(scaled.shape[1])[:-1]

        def misfit(own, priors=priors):
            own = np.concatenate([own, priors])
            return float(np.square(own[:, -1] - own[:, :-1] @ np.linalg.lstsq(own[:, :-1], own[:, -1])[0]).sum())

        ends = range(rows, len(scaled) - rows + 1, rows)
        gained = [misfit(scaled) - misfit(scaled[:end]) - misfit(scaled[end:]) for end in ends]
        told = told + np.array(gained) * len(scaled) / misfit(scaled)
    whole_s, at_s = 4.0 * (len(told) + 1), 4.0 * np.arange(1, len(told) + 1)
    told[(at_s - 4.0 < 40.0) | (whole_s - at_s - 4.0 < 10.0)] = -np.inf  # four seconds less are known before and behind
    likely_s = at_s[told > told.max() - 9.2]
    return at_s[np.argmax(told)], likely_s.min() - 4.0, likely_s.max() + 4.0


@pytest.fixture
def white(monkeypatch):
    """What is white already stays as it is."""
    monkeypatch.setattr(of_commands, "in_coloured_noise", lambda _: SimpleNamespace(white=lambda part: part))


@pytest.mark.usefixtures("white")
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("onset_s", "change"), [(80.0, 3.0), (60.0, 0.35), (120.0, 0.25), (10.0, 3.0), (158.0, 3.0)])
def test_a_flight_is_divided_where_two_fits_leave_least_all_equations_together(onset_s, change, seed):
    both = {"p": answers(onset_s, change=change, seed=seed), "q": answers(onset_s, change=0.5 * change, seed=seed + 9)}
    air = {AIRSPEED: answers(100.0, change=50.0)}  # whose wind tells nothing of surfaces
    found = divided(SimpleNamespace(start_s=7.0, relations=both | air))
    assert found == pytest.approx([12.0 + each for each in by_least_squares(both)])  # behind five seconds that settle
    if change == 3.0 and 40.0 < onset_s < 150.0:
        assert found == pytest.approx((12.0 + onset_s, 8.0 + onset_s, 16.0 + onset_s))


@pytest.mark.usefixtures("white")
@pytest.mark.parametrize(("duration_s", "is_told"), [(59.9, False), (60.1, True)])
def test_less_than_a_minute_is_too_short_to_be_divided(duration_s, is_told):
    found = divided(SimpleNamespace(start_s=0.0, relations={"p": answers(20.0, duration_s=duration_s)}))
    assert (found is not None) == is_told


# what stands against a name -------------------------------------------------------------------------------------


def explains(name="rudder", nats=100.0, share=1.0, deviation=0.05, *, is_surface=True, off=0.0):
    suspect = Culprit(name=name, wrong=(), spread=np.zeros(0), is_surface=is_surface)
    deviations = np.array([0.1, deviation, 0.05])
    return SuspectEvidence(suspect=suspect, nats=nats, sizes=np.array([off, share, 0.0]), deviations=deviations)


def said_of(*ranked, nats=110.0, onset_s=80.0, last_s=150.0, values=None, vanes=True):
    """Return what is said of a flight of 200 s whose answer changes between 78 and 84 s."""
    names = (*GYROS, *SURFACES)
    values = 0.01 * np.random.default_rng(1).standard_normal((4000, len(names))) if values is None else values
    frame = SimpleNamespace(surfaces=SURFACES, flow=SimpleNamespace(vanes=vanes))
    return CommandsJudged(
        commanded=Commanded(start_s=0.0, period_s=STEP_S, channels=names, values=values, frame=frame),
        end_s=210.0,
        change=AnswerChange(onset_s=onset_s, nats=nats, ranked=ranked or (explains(),)),
        between_s=(78.0, 84.0),
        last_s=last_s,
    )


def doubts(said, claims=(), found=()):
    return [*_doubts(said, claims, found)]


@pytest.mark.parametrize(
    ("sound", "doubtful", "why"),
    [
        ([explains(), explains("q", 85.0)], [explains(), explains("q", 86.0)], "q or rudder explains it"),
        ([explains()], [explains("q", is_surface=False)], "and q explains it"),
        ([explains(nats=66.5)], [explains(nats=65.5)], "more than any surface explains"),
    ],
)
def test_a_surface_is_named_where_it_alone_explains_most_of_what_there_is(sound, doubtful, why):
    assert doubts(said_of(*sound)) == []
    (found,) = doubts(said_of(*doubtful))
    assert found.endswith(why)


def test_of_many_suspects_three_are_told():
    several = [explains(name, 100.0 - place) for place, name in enumerate(("rudder", "p", "q", "r", "beta"))]
    assert doubts(said_of(*several)) == ["its answer changes, and p, q or rudder explains it"]
    assert said_of(*several).likely == ["rudder", "p", "q", "r", "beta"]


@pytest.mark.parametrize(("best", "there"), [(100.0, 16.0), (16.0, 20.0)])
def test_little_evidence_of_a_change_is_none_whoever_explains_it(best, there):
    assert doubts(said_of(explains(nats=best - 0.1), nats=there - 0.1)) == [COMPARED]
    assert doubts(said_of(explains(nats=best + 0.1), nats=there + 0.1)) == []


@pytest.mark.parametrize(("last_s", "is_doubted"), [(94.2, False), (93.8, True)])
def test_ten_seconds_behind_a_change_are_seen(last_s, is_doubted):
    assert bool(doubts(said_of(last_s=last_s))) == is_doubted


@pytest.mark.parametrize(
    ("share", "deviation", "is_stuck"),
    [
        (1.19, 0.05, True),
        (1.21, 0.05, False),
        (0.81, 0.05, True),
        (0.79, 0.05, False),
        (1.0, 0.09, True),
        (1.0, 0.11, False),
    ],
)
def test_without_vanes_or_in_other_motion_only_what_surely_answers_nothing_is_named(share, deviation, is_stuck):
    own = explains(share=share, deviation=deviation)
    assert bool(doubts(said_of(own, vanes=False))) != is_stuck
    for name, grows, is_livelier in (("q", 1.6, True), ("aileron", 1.6, True), ("q", 1.4, False)):
        assert bool(doubts(said_of(own, values=moving(name, grows)))) == (is_livelier and not is_stuck)
    sensor = explains("beta", share=share, deviation=deviation, is_surface=False)
    assert "without vanes" in doubts(said_of(sensor, vanes=False))[1]


def moving(name, grows):
    """Return what a flight reads of which one moves more from 84 s on: about other means every four seconds.

    Before the change, and once nobody looks any more, at 150 s, it moves far more.
    """
    time_s = STEP_S * np.arange(4000)
    names = (*GYROS, *SURFACES)
    values = np.sin(2.0 * np.pi * time_s)[:, np.newaxis] * np.ones(len(names))
    size = np.where(time_s > 150.0, 9.0, np.where(time_s > 84.0, grows, np.where(time_s > 78.0, 9.0, 1.0)))
    means = 5.0 * (np.floor(time_s / 4.0) % 2.0) * (time_s > 84.0)
    values[:, names.index(name)] = size * values[:, names.index(name)] + means
    return values


@pytest.mark.parametrize(("late_s", "is_doubted"), [(9.5, True), (-9.5, True), (10.5, False), (-10.5, False)])
def test_what_gyros_show_within_ten_seconds_is_no_surfaces(late_s, is_doubted):
    best = SimpleNamespace(suspect="q")
    other = SimpleNamespace(best=best, is_healthy=False, onset_s=80.0 + late_s)
    assert doubts(said_of(), found=[other]) == (["q is off there"] if is_doubted else [])
    assert doubts(said_of(), found=[SimpleNamespace(best=best, is_healthy=True, onset_s=80.0)]) == []


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize(
    ("start_s", "end_s", "meets"), [(0.0, 70.5, True), (0.0, 69.5, False), (199.0, 300.0, True), (201.0, 300.0, False)]
)
def test_a_sensor_that_failed_from_ten_seconds_before_on_leaves_no_name(state, start_s, end_s, meets):
    claims = [("tas", SensorSpan(start_s=start_s, end_s=end_s, state=state))]
    is_accused = state in (State.FAILED, State.SUSPECTED)
    assert bool(doubts(said_of(), claims)) == (meets and is_accused)


# what is claimed ------------------------------------------------------------------------------------------------


def test_a_surface_that_is_named_failed_until_the_flight_ends_and_the_others_show_no_change():
    said = said_of(explains(share=0.5, deviation=0.02))
    claims = [(name, span.state, span.start_s, span.end_s) for name, span in said.claims]
    whole = [(name, State.NOT_JUDGED, 0.0, 200.0) for name in SURFACES]
    assert sorted(claims) == sorted([*whole, ("rudder", State.FAILED, 80.0, 210.0)])
    (judgement,) = (span.judgement for _, span in said.claims if span.judgement)
    assert (judgement.sensor, judgement.kind, judgement.time_s) == ("rudder", "scale_factor", 150.0)
    assert judgement.parameters == {"factor": pytest.approx(0.5), "onset_s": 80.0}
    assert judgement.intervals == {"onset_s": (78.0, 84.0)}
    bent = said_of(explains(share=0.0, off=3.0))
    assert bent.kind == "bias"
    (judgement,) = (span.judgement for _, span in bent.claims if span.judgement)
    assert judgement.parameters == {"size": -3.0, "onset_s": 80.0}


def test_a_doubt_leaves_open_those_that_may_be_behind_it_from_then_on():
    doubted = replace(said_of(explains(), explains("aileron", 95.0)), doubt="why")
    assert (doubted.named, doubted.kind) == (None, None)
    opened = {(name, span.start_s, span.end_s) for name, span in doubted.claims if span.reason == "why"}
    assert opened == {("rudder", 80.0, 200.0), ("aileron", 80.0, 200.0)}


def test_what_is_too_short_to_be_divided_is_not_judged_and_has_no_change():
    whole = said_of()
    short = CommandsJudged(commanded=whole.commanded, end_s=210.0)
    assert (short.best, short.named, short.kind, short.onset_s, short.likely) == (None, None, None, 200.0, [])
    assert [(name, span) for name, span in short.claims] == [
        (name, unjudged((0.0, 200.0), COMPARED)) for name in SURFACES
    ]


# what others exclude --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spans", "error"),
    [
        ([(0.0, 200.0, 2.0)], 2.0),
        ([(0.0, 96.5, 2.0)], 2.0),  # but for less than four seconds
        ([(0.0, 96.0, 2.0)], None),
        ([(0.0, 90.0, 2.0), (90.0, 98.0, 5.0)], 5.0),  # the largest that may hide
        ([(0.0, 80.0, 9.0), (80.0, 99.0, 2.0)], 2.0),  # before the change
        ([], None),
    ],
)
def test_an_error_is_excluded_of_a_sensor_that_is_clear_throughout_up_to_the_largest_that_may_hide(spans, error):
    claims = [
        ("accelerometers", SensorSpan(start_s=a, end_s=b, state=State.CLEAR, sizes=Sizes(error=size, within_s=60.0)))
        for a, b, size in spans
    ]
    suspected = ("nz", SensorSpan(start_s=0.0, end_s=100.0, state=State.SUSPECTED))
    told = dict(_excluded([*claims, suspected], ("nz", "q"), (80.0, 100.0)))
    assert told == ({} if error is None else {"nz": error})
