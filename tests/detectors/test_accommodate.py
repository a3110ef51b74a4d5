"""Flying without a gyro: what stands in, when it does, and that no verdict makes it worse than none."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.accommodate import GIVEN_BACK, REPLACED, SUSPECTED, Accommodate, distrusted, lesser
from gtmbench.values.channels import SENSORS
from tests.helpers.monitors import monitor as made_up
from tests.helpers.monitors import truth
from tests.helpers.rescuing import early_monitor

GYROS = ("p", "q", "r")
ONSET_S = 20.0


def undecided(time_s, *candidates):
    return gb.Judgement(time_s=time_s, sensor=None, candidates=candidates)


def names(time_s, sensor, **more):
    return gb.Judgement(time_s=time_s, sensor=sensor, candidates=(sensor,), **more)


def passed(time_s):
    return gb.Judgement(time_s=time_s, sensor=None, candidates=())


def alarm(source, *judgements, number=0, time_s=ONSET_S, **more):
    return gb.Alarm(number=number, time_s=time_s, onset_s=time_s, source=source, judgements=judgements, **more)


@dataclass(frozen=True)
class Scripted:
    """A monitor that says what it was told to, at its times: a time, and every alarm as it is known by then."""

    script: tuple = ()
    hidden: tuple = ()  # scores that are disarmed
    name: str = "scripted"
    channels: tuple = ("p",)
    suspects: tuple = GYROS
    sample_period_s: float | None = None

    def stream(self):
        return Saying(self)


class Saying:
    def __init__(self, monitor):
        self.rest, self.alarms = list(monitor.script), ()
        self.armed = {name: name not in monitor.hidden for name in GYROS}

    def push(self, chunk):
        told = ()
        while self.rest and chunk.start_s >= self.rest[0][0] - 1e-9:
            self.alarms = told = self.rest.pop(0)[1]
        return told


def naming(gyro, time_s=ONSET_S):
    return Scripted(((time_s, (alarm(gyro, names(time_s, gyro)),)),))


def fly(faults=(), accommodate=None, duration_s=30.0, **more):
    return gb.fly_in_loop(duration_s=duration_s, faults=faults, accommodate=accommodate, **more)


def told(flight):
    return [(event.kind, event.channel) for event in flight.events]


def same(one, other):
    return one.truth.values.tobytes() == other.truth.values.tobytes()


# ---- with a bank ----


@pytest.mark.parametrize("gyro", ["q", "r"])
def test_an_aircraft_that_would_depart_stays_in_the_air(gyro):
    flip = gb.SignFlip(channel=gyro, onset_s=ONSET_S)
    assert fly(flip, duration_s=25.0).departed_s is not None
    first = fly(flip, Accommodate(early_monitor()), duration_s=28.0)
    assert first.departed_s is None
    assert (SUSPECTED, gyro) in told(first)
    assert told(first)[0] == (SUSPECTED, gyro)
    assert (REPLACED, gyro) in told(first)
    healthy = fly(duration_s=28.0)
    for name in GYROS:
        late = first.truth.time_s > 26.0
        assert np.std(first.truth[name][late]) < 2.5 * np.std(healthy.truth[name][late])


def test_it_begins_anew_with_each_flight():
    flip, rescue = gb.SignFlip(channel="r", onset_s=15.0), Accommodate(early_monitor())
    assert same(*(fly(flip, rescue, duration_s=17.0) for _ in range(2)))


def test_on_a_healthy_flight_it_does_nothing():
    flown, alone = fly(accommodate=Accommodate(early_monitor()), duration_s=40.0, seed=3), fly(duration_s=40.0, seed=3)
    assert flown.events == ()
    assert same(flown, alone)


def test_what_is_wrong_from_the_first_sample_on_is_not_told():
    """Nothing was armed, so nothing can be said; the loop holds what it read last."""
    gone = [gb.Dropout(channel=name, onset_s=0.0) for name in SENSORS]
    flight = fly(gone, Accommodate(early_monitor()), duration_s=15.0, excitation=gb.Excitation())
    assert {kind for kind, _ in told(flight)} == {"out of loop"}
    flip = gb.SignFlip(channel="p", onset_s=0.0)
    assert same(fly(flip, Accommodate(early_monitor()), duration_s=12.0), fly(flip, duration_s=12.0))


# ---- what stands in ----


@pytest.mark.parametrize("gyro", GYROS)
@pytest.mark.parametrize("samples", [2, 4, 9])
def test_the_stand_in_is_the_rate_over_the_last_samples(gyro, samples):
    """The oracle is a smooth attitude's own rate; the heading comes wrapped, and runs through north."""
    smooth = truth(samples=1000, period_s=0.01)
    values = np.column_stack([smooth[name] if name in smooth else np.zeros(len(smooth)) for name in SENSORS])
    wrapped = np.array(values)
    wrapped[:, SENSORS.index("psi")] = (wrapped[:, SENSORS.index("psi")] - 45.0) % 360.0
    wrapped[:, SENSORS.index(gyro)] = 1e3  # as it reads
    accommodate = Accommodate(naming(gyro, time_s=0.5), slope_samples=samples)
    hand_on = accommodate.start(0.01, lambda *_: None)
    column = SENSORS.index(gyro)
    flown = np.array([hand_on(k * 0.01, row)[column] for k, row in enumerate(wrapped.tolist())])
    assert (flown[:50] == 1e3).all()
    steps = np.arange(1, samples)
    weights = steps * (samples - steps)  # a straight line's slope is this mean of those between samples
    between = 0.5 * (values[1:, column] + values[:-1, column])
    expected = np.convolve(between, weights / weights.sum())[: len(between)]
    np.testing.assert_allclose(flown[60:], expected[59:], rtol=0.0, atol=0.02 * np.std(expected))


def test_a_zero_stands_in_where_that_is_wanted():
    handed = Accommodate(naming("q"), stand_in="zero").start(0.01, lambda *_: None)(ONSET_S, [5.0] * len(SENSORS))
    assert handed[SENSORS.index("q")] == 0.0
    assert handed[SENSORS.index("p")] == 5.0


def test_the_lesser_of_two_lies_between_0_and_both():
    for one, other in np.random.default_rng(1).normal(size=(200, 2)):
        of_both = lesser(one, other)
        assert abs(of_both) <= min(abs(one), abs(other))
        assert of_both * one >= 0.0
        assert of_both * other >= 0.0
        assert of_both == lesser(other, one)
    assert lesser(math.nan, 2.0) == lesser(2.0, math.nan) == 2.0


# ---- verdicts ----


@pytest.mark.parametrize("gyro", ["q", "r"])
def test_without_any_verdict_it_is_rescued_too(gyro):
    """The lesser of both rates needs an alarm, and no name."""
    silent = Scripted(((ONSET_S + 0.15, (alarm(gyro, undecided(ONSET_S, gyro, "psi"), time_s=ONSET_S + 0.15),)),))
    flight = fly(gb.SignFlip(channel=gyro, onset_s=ONSET_S), Accommodate(silent))
    assert flight.departed_s is None
    assert told(flight) == [(SUSPECTED, gyro)]


@pytest.mark.parametrize("gyro", GYROS)
def test_a_healthy_gyro_that_is_named_costs_noise_and_no_more(gyro):
    flown, alone = fly(accommodate=Accommodate(naming(gyro))), fly()
    late = flown.truth.time_s > ONSET_S + 1.0
    assert flown.departed_s is None
    for name in GYROS:
        assert np.std(flown.truth[name][late]) < 1.6 * np.std(alone.truth[name][late])


@pytest.mark.parametrize(("angle", "gyro"), [("phi", "p"), ("theta", "q"), ("psi", "r")])
def test_a_gyro_that_is_named_for_an_angle_throws_nothing(angle, gyro):
    """The wrong verdict: the virtual rate comes from the angle that has failed."""
    for fault in (gb.Jam(channel=angle, onset_s=ONSET_S), gb.Bias(channel=angle, onset_s=ONSET_S, size=3.0)):
        assert fly(fault).departed_s is None
        assert fly(fault, Accommodate(naming(gyro))).departed_s is None


def test_a_gyro_is_given_back_when_its_fault_has_ended():
    first = alarm("q", names(10.0, "q"), time_s=10.0)
    script = ((10.0, (first,)), (12.0, (replace(first, ended_s=11.5, end_known_s=12.0),)))
    flight = fly(accommodate=Accommodate(Scripted(script)), duration_s=15.0)
    assert told(flight) == [(REPLACED, "q"), (GIVEN_BACK, "q")]
    assert [event.time_s for event in flight.events] == [10.0, 12.0]
    assert flight.events[1].value == flight.sensed["q"][1200]


def of(*alarms, hidden=()):
    stream = Saying(Scripted(hidden=hidden))
    stream.alarms = alarms
    return distrusted(stream, GYROS)


def test_who_is_distrusted():
    asked = undecided(20.0, "p", "phi")
    assert of() == {}
    assert of(alarm("p")) == {"p": SUSPECTED}
    assert of(alarm("p", asked)) == {"p": SUSPECTED}
    assert of(alarm("p_att", asked)) == {"p": SUSPECTED}  # an early residual is about its gyro
    assert of(alarm("p", asked, names(20.7, "p"))) == {"p": REPLACED}
    assert of(alarm("p", asked, names(20.7, "q"))) == {"p": SUSPECTED, "q": REPLACED}
    assert of(alarm("p", names(20.7, "p"), undecided(21.0, "p", "phi"))) == {"p": SUSPECTED}
    assert of(alarm("p", names(20.7, "p", kind="swap", partner="r"))) == {"p": REPLACED, "r": REPLACED}
    assert of(alarm("p", asked, passed(25.0))) == {}
    assert of(alarm("p", asked, names(20.7, "p"), ended_s=23.0)) == {}
    assert of(alarm("q", names(20.7, "q"), test="missing")) == {"q": REPLACED}


def test_an_angle_that_is_named_gives_back_the_one_gyro_that_it_explains():
    angle = names(20.7, "phi")
    assert of(alarm("p", angle)) == {}
    assert of(alarm("p", angle), hidden=GYROS) == {"q": SUSPECTED, "r": SUSPECTED}  # nobody would say if they failed
    second = alarm("r", number=1, fault=0)
    assert of(alarm("p", angle), second) == {"p": SUSPECTED, "r": SUSPECTED}  # two gyros look like an angle
    assert of(replace(alarm("p", angle), ended_s=22.0), replace(second, ended_s=22.0)) == {}


def test_a_second_fault_is_not_hidden_by_an_undecided_one():
    asked = undecided(20.0, "p", "phi", "psi")
    assert of(alarm("p", asked), hidden=("p", "r")) == {"p": SUSPECTED, "r": SUSPECTED}
    assert of(alarm("p", names(20.7, "p")), hidden=("p", "r")) == {"p": REPLACED}


# ---- bad input ----


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Accommodate(gb.find_detector("C")), r"monitor is .*; give a calibrated one"),
        (lambda: Accommodate("C"), r"monitor is 'C'; give a calibrated one"),
        (lambda: Accommodate(Scripted(), stand_in="spare"), r"no stand-in 'spare'; there are attitude, zero"),
        (lambda: Accommodate(Scripted(), slope_samples=1), r"slope_samples is 1; it must be a whole number"),
        (lambda: Accommodate(Scripted(suspects=("phi",))), r"scripted names no gyro"),
        (lambda: Accommodate(Scripted(channels=("p", "rpm"))), r"scripted needs rpm, and a loop senses p, q, "),
        (
            lambda: fly(accommodate=Accommodate(made_up("C"))),
            r"calibrated at 0.02 s a sample, and the loop runs at 0.0",
        ),
    ],
)
def test_bad_input_is_one_line(make, said):
    with pytest.raises(gb.InputError, match=said) as refused:
        make()
    assert "\n" not in str(refused.value)
