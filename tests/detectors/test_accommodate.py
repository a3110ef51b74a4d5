"""Flying without a sensor: what stands in, when it does, and that no verdict makes it worse than none."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.accommodation.stand_in import VirtualRates
from gtmbench.detectors.accommodation.without_sensor import (
    GIVEN_BACK,
    REPLACED,
    SUSPECTED,
    Accommodate,
    doubted_gyros,
    lesser,
)
from gtmbench.values.channels import ATTITUDE, SENSORS
from tests.helpers.monitors import monitor as made_up
from tests.helpers.monitors import truth
from tests.helpers.night import by_day
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


def fly(faults=(), accommodate=None, duration_s=30.0, *, sensors="ideal", **more):
    return gb.fly_in_loop(duration_s=duration_s, faults=faults, accommodate=accommodate, sensors=sensors, **more)


def told(flight):
    return [(event.kind, event.channel) for event in flight.events]


def same(one, other):
    return one.truth.values.tobytes() == other.truth.values.tobytes()


# ---- with a bank ----


@pytest.mark.nightly
@pytest.mark.parametrize("gyro", ["q", "r"])
def test_an_aircraft_that_would_depart_stays_in_the_air(gyro):
    flip = gb.SignFlip(channel=gyro, onset_s=ONSET_S)
    assert fly(flip, duration_s=25.0).departed_s is not None
    first = fly(flip, Accommodate(early_monitor()), duration_s=28.0)
    assert first.departed_s is None
    assert (SUSPECTED, gyro) in told(first)
    assert told(first)[0] == (SUSPECTED, gyro)
    assert {channel for kind, channel in told(first) if kind == REPLACED} <= {gyro}
    healthy = fly(duration_s=28.0)
    for name in GYROS:
        late = first.truth.time_s > 26.0
        assert np.std(first.truth[name][late]) < 2.5 * np.std(healthy.truth[name][late])


@pytest.mark.nightly
def test_it_begins_anew_with_each_flight():
    flip, rescue = gb.SignFlip(channel="r", onset_s=15.0), Accommodate(early_monitor())
    assert same(*(fly(flip, rescue, duration_s=17.0) for _ in range(2)))


@pytest.mark.nightly
def test_on_a_healthy_flight_it_does_nothing():
    flown, alone = fly(accommodate=Accommodate(early_monitor()), duration_s=40.0, seed=3), fly(duration_s=40.0, seed=3)
    assert flown.events == ()
    assert same(flown, alone)


@pytest.mark.nightly
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
    rates = VirtualRates(samples, 0.01)
    column = SENSORS.index(gyro)
    flown = []
    for row in wrapped.tolist():
        rates.take(row)
        flown.append(rates.rate(gyro))
    assert np.isnan(flown[0])
    steps = np.arange(1, samples)
    weights = steps * (samples - steps)  # a straight line's slope is this mean of those between samples
    between = 0.5 * (values[1:, column] + values[:-1, column])
    expected = np.convolve(between, weights / weights.sum())[: len(between)]
    np.testing.assert_allclose(flown[60:], expected[59:], rtol=0.0, atol=0.02 * np.std(expected))


def test_a_zero_stands_in_where_that_is_wanted():
    hand_on = Accommodate(naming("q", 1.0), stand_in="zero").start(0.01, lambda *_: None)
    for k in range(200):
        handed = hand_on(0.01 * k, [5.0, 5.0, *[0.01 * k] * (len(SENSORS) - 2)])
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


@pytest.mark.parametrize("gyro", by_day(["q", "r"]))
def test_without_any_verdict_it_is_rescued_too(gyro):
    """The lesser of both rates needs an alarm, and no name."""
    silent = Scripted(((ONSET_S + 0.15, (alarm(gyro, undecided(ONSET_S, gyro, "psi"), time_s=ONSET_S + 0.15),)),))
    flight = fly(gb.SignFlip(channel=gyro, onset_s=ONSET_S), Accommodate(silent))
    assert flight.departed_s is None
    assert (SUSPECTED, gyro) in told(flight)


@pytest.mark.parametrize("sensor", by_day([*GYROS, *ATTITUDE]))
def test_a_healthy_sensor_that_is_named_is_never_replaced(sensor):
    """The path contradicts nobody, so a wrong name costs damping and no more."""
    script = Scripted(naming(GYROS[0]).script, suspects=(*GYROS, *ATTITUDE))
    gyro = GYROS[ATTITUDE.index(sensor)] if sensor in ATTITUDE else sensor
    script = replace(script, script=((ONSET_S, (alarm(gyro, names(ONSET_S, sensor)),)),))
    flown, alone = fly(accommodate=Accommodate(script)), fly()
    late = flown.truth.time_s > ONSET_S + 1.0
    assert flown.departed_s is None
    assert {kind for kind, _ in told(flown)} == {SUSPECTED}
    for name in GYROS:
        assert np.std(flown.truth[name][late]) < 1.8 * np.std(alone.truth[name][late])


@pytest.mark.parametrize(("angle", "gyro"), by_day([("phi", "p"), ("theta", "q"), ("psi", "r")], 0))
def test_a_gyro_that_is_named_for_an_angle_throws_nothing(angle, gyro):
    """The wrong verdict: the virtual rate comes from the angle that has failed."""
    script = replace(naming(gyro), suspects=(*GYROS, *ATTITUDE))
    for fault in (gb.Jam(channel=angle, onset_s=ONSET_S), gb.Bias(channel=angle, onset_s=ONSET_S, size=3.0)):
        assert fly(fault).departed_s is None
        flight = fly(fault, Accommodate(script))
        assert flight.departed_s is None
        assert {channel for kind, channel in told(flight) if kind == REPLACED} <= {angle}


def test_a_gyro_is_given_back_only_when_it_has_proved_well():
    """It is stuck for a while; the monitor says at once that the fault has ended, and is not believed at once."""
    first = alarm("q", names(15.0, "q"), time_s=15.0)
    script = ((15.0, (first,)), (17.0, (replace(first, ended_s=17.0, end_known_s=17.0),)))
    stuck = gb.Jam(channel="q", onset_s=14.9, duration_s=2.0)
    flight = fly(stuck, Accommodate(Scripted(script), proving_s=4.0), duration_s=24.0)
    of_q = [(event.kind, event.time_s) for event in flight.events if event.channel == "q"]
    assert [kind for kind, _ in of_q] == [SUSPECTED, REPLACED, GIVEN_BACK]
    assert 16.9 + 4.0 < of_q[-1][1] < 23.0
    latched = fly(stuck, Accommodate(Scripted(script)), duration_s=24.0)
    assert GIVEN_BACK not in {kind for kind, channel in told(latched) if channel == "q"}


def test_an_alarm_that_has_passed_gives_back_without_a_bump_who_was_only_suspected():
    first = alarm("q", undecided(10.0, "q"), time_s=10.0)
    script = ((10.0, (first,)), (12.0, (replace(first, judgements=(passed(12.0),)),)))
    handed = Handed(Accommodate(Scripted(script)))
    assert told(fly(accommodate=handed, duration_s=13.0)) == [(SUSPECTED, "q"), (GIVEN_BACK, "q")]
    read, flown = (np.array([row[SENSORS.index("q")] for row in rows]) for rows in (handed.read, handed.flown))
    at = 1200
    assert abs(flown[at] - flown[at - 1]) < 0.2 * abs(read[at] - flown[at - 1]) + 0.2
    np.testing.assert_array_equal(flown[at + 40 :], read[at + 40 :])


class Handed:
    """Keeps what an accommodation is given and what it hands on."""

    def __init__(self, of):
        self.of, self.read, self.flown = of, [], []

    def start(self, sample_period_s, tell):
        on = self.of.start(sample_period_s, tell)

        def hand_on(time_s, readings):
            self.read.append(readings)
            self.flown.append(on(time_s, readings))
            return self.flown[-1]

        return hand_on


def of(*alarms, hidden=(), **more):
    stream = Saying(Scripted(hidden=hidden))
    stream.alarms = alarms
    return doubted_gyros(stream, GYROS, **more)


def test_whose_axis_is_doubted():
    asked = undecided(20.0, "p", "phi")
    assert of() == set()
    assert of(alarm("p")) == of(alarm("p", asked)) == {"p"}
    assert of(alarm("p_att", asked)) == {"p"}  # an early residual is about its gyro
    assert of(alarm("p", asked, names(20.7, "q"))) == {"p", "q"}
    assert of(alarm("p", names(20.7, "theta"))) == {"p", "q"}
    assert of(alarm("p", names(20.7, "p", kind="swap", partner="r"))) == {"p", "r"}
    assert of(alarm("p", asked, passed(25.0))) == set()
    assert of(alarm("p", asked, names(20.7, "p"), ended_s=23.0)) == set()
    assert of(alarm("q", names(20.7, "q"), test="missing")) == {"q"}


def test_a_second_fault_is_not_hidden_by_an_undecided_one():
    asked = undecided(20.0, "p", "phi", "psi")
    assert of(alarm("p", asked), hidden=("p", "r")) == {"p", "r"}
    assert of(alarm("p", asked), hidden=("p", "r"), is_settled=True) == {"p"}
    assert of(alarm("p", names(20.7, "p")), hidden=("p", "r")) == {"p"}


# ---- on the chain ----


@pytest.mark.parametrize("channel", by_day(["phi", "theta"]))
def test_on_the_chain_an_angle_that_jumps_far_is_carried_on(channel):
    """The gyros and the flight path say that it didn't turn."""
    gyro = GYROS[ATTITUDE.index(channel)]
    script = Scripted(((15.1, (alarm(gyro, undecided(15.1, gyro), time_s=15.1),)),), suspects=(*GYROS, *ATTITUDE))
    fault = gb.Bias(channel=channel, onset_s=15.0, size=25.0)
    flight = fly(fault, Accommodate(script), sensors="chain", duration_s=30.0)
    assert flight.departed_s is None
    assert np.abs(flight.truth["phi"]).max() < 30.0
    assert {name for kind, name in told(flight) if kind == REPLACED} <= {channel}


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
