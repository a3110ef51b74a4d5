"""The detector of surfaces on flights of the GTM: who is named, who isn't, and the contract of every detector."""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.registry import find_detector
from gtmbench.errors import InputError
from gtmbench.intake.resampling import decimate
from gtmbench.log.judging.certificate import certificate_of
from gtmbench.testing.contract.subject import contract_case
from gtmbench.testing.contract.suite import CONTRACT, check_property
from gtmbench.values.channels import COMMANDS, GYROS
from tests.helpers.monitors import shared
from tests.helpers.night import by_day

ONSET_S = 60.0


def sensed(loop, seed, *faults, duration_s=90.0, excitation="doublets+turbulence"):
    """Return what is read of a flight, and its commands, from when it has settled."""
    if loop:
        readings = gb.fly_in_loop("gtm", excitation, duration_s, seed, faults=faults, sensors="ideal")
        return readings.readings(commands=True)
    truth = gb.fly("gtm", excitation, duration_s, seed, faults=tuple(f for f in faults if f.channel in COMMANDS))
    readings = gb.measure(truth, noise="t2", seed=seed, commands=True)
    return gb.inject(readings, [fault for fault in faults if fault.channel not in COMMANDS])


@cache
def monitor():
    """One that takes seconds to calibrate: both workers have the same."""

    def make():
        flown = ["multisine", "doublets", "doublets", "multisine", "multisine", "doublets"]
        flights = [
            sensed(number % 2 == 1, 700 + number, duration_s=150.0, excitation=f"{excitation}+turbulence")
            for number, excitation in enumerate(flown)
        ]
        return find_detector("surfaces").calibrate(flights)

    return shared("surfaces", make)


def said(record):
    return [alarm for alarm in monitor().watch(record).alarms if alarm.is_first]


FAIL = {  # in closed loop or open, on which flight, how long
    "weak elevator": (True, 810, 90.0, gb.ScaleFactor(channel="elevator", onset_s=ONSET_S, factor=0.4)),
    "weak elevator, open loop": (False, 810, 90.0, gb.ScaleFactor(channel="elevator", onset_s=ONSET_S, factor=0.4)),
    "bent aileron": (
        True,
        810,
        90.0,
        gb.Bias(channel="aileron", onset_s=ONSET_S, size=-3.0),
    ),  # open loop it rolls over
    "bent rudder": (True, 810, 90.0, gb.Bias(channel="rudder", onset_s=ONSET_S, size=-1.5)),
    "floating rudder": (False, 810, 90.0, gb.Float(channel="rudder", onset_s=ONSET_S, flow="beta", ratio=0.5)),
    "engine out": (True, 830, 130.0, gb.ScaleFactor(channel="throttle", onset_s=ONSET_S, factor=0.0)),
    "half throttle": (True, 830, 130.0, gb.ScaleFactor(channel="throttle", onset_s=ONSET_S, factor=0.5)),
    "engine out, open loop": (False, 830, 130.0, gb.ScaleFactor(channel="throttle", onset_s=ONSET_S, factor=0.0)),
}


@pytest.mark.parametrize("name", by_day(FAIL, 0))
def test_who_fails_is_named_and_no_sensor_is(name):
    loop, seed, duration_s, fault = FAIL[name]
    record = sensed(loop, seed, fault, duration_s=duration_s)
    alarms = said(record)
    assert alarms[0].time_s >= ONSET_S
    assert {alarm.sensor for alarm in alarms} - {None} == {fault.channel}
    assert not set(GYROS) & {name for alarm in alarms for name in alarm.candidates}
    bank = monitor().kinematics.watch(record)
    assert [alarm.sensor for alarm in bank.alarms if alarm.sensor and not alarm.doubt] == []


SENSORS = [
    gb.Bias(channel="q", onset_s=ONSET_S, size=3.0),
    gb.Jam(channel="p", onset_s=ONSET_S),
    gb.ScaleFactor(channel="r", onset_s=ONSET_S, factor=0.5),
    gb.Jam(channel="alpha", onset_s=ONSET_S),
    gb.Bias(channel="beta", onset_s=ONSET_S, size=1.0),
    gb.Bias(channel="nz", onset_s=ONSET_S, size=0.1),
    gb.Noise(channel="ny", onset_s=ONSET_S, deviation=0.1),
]
LIKE_A_THROTTLE = [
    gb.Bias(channel="nx", onset_s=ONSET_S, size=0.08),
    gb.Drift(channel="nx", onset_s=ONSET_S, slope=-0.005),
    gb.Bias(channel="alpha", onset_s=ONSET_S, size=-1.5),
    gb.ScaleFactor(channel="tas", onset_s=ONSET_S, factor=0.85),
]


@pytest.mark.parametrize("loop", by_day([True, False], 0), ids=["closed", "open"])
@pytest.mark.parametrize(
    "fault", by_day([*SENSORS, *LIKE_A_THROTTLE], 0), ids=lambda fault: f"{fault.kind} of {fault.channel}"
)
def test_a_sensor_that_fails_makes_no_surface_fail(loop, fault):
    seed, duration_s = (831, 120.0) if fault in LIKE_A_THROTTLE else (811, 90.0)
    assert {alarm.sensor for alarm in said(sensed(loop, seed, fault, duration_s=duration_s))} <= {None}


@pytest.mark.nightly
@pytest.mark.parametrize("trim", by_day([{}, {"tas_kt": 88.0}, {"tas_kt": 120.0}, {"altitude_ft": 2000.0}]))
def test_healthy_flight_elsewhere_raises_nothing(trim):
    flight = gb.fly_in_loop("gtm", "doublets+turbulence", 120.0, 812, sensors="ideal", **trim)
    watch = monitor().watch(flight.readings(commands=True))
    assert watch.alarms == ()
    assert watch.armed_hours > 60.0 / 3600.0


@pytest.mark.nightly
def test_commands_that_are_missing_for_a_while_raise_nothing():
    record = sensed(True, 814)
    values = np.array(record.values)
    values[6000:6400, record.columns(["elevator"])] = np.nan
    holed = gb.Record(values, channels=record.channels, sample_period_s=0.01)
    watch = monitor().watch(holed)
    assert watch.alarms == ()
    assert watch.scores["elevator"].armed[-1]


@pytest.mark.nightly
def test_a_surface_that_never_moved_is_nobody_to_suspect():
    records = [sensed(False, 720 + i, duration_s=120.0, excitation="multisine+turbulence") for i in range(3)]
    still = [record.replace("rudder", np.zeros(len(record))) for record in records]
    assert find_detector("surfaces").calibrate(still).suspects == ("elevator", "aileron")
    for name in ("elevator", "aileron"):
        still = [record.replace(name, np.zeros(len(record))) for record in still]
    with pytest.raises(InputError, match="no command of elevator, aileron, rudder moves in the healthy records"):
        find_detector("surfaces").calibrate(still)


def test_records_that_are_short_or_slow_are_refused_in_a_line():
    record = sensed(False, 730, duration_s=30.0)
    with pytest.raises(InputError, match="compares what it sees with the minute before"):
        find_detector("surfaces").calibrate([record])
    slow = gb.Record(record.values[::25], channels=record.channels, sample_period_s=0.25)
    with pytest.raises(InputError, match="needs 8 samples a second or more"):
        find_detector("surfaces").calibrate([slow])


@pytest.mark.parametrize("loop", by_day([True, False], 0), ids=["closed", "open"])
def test_a_loss_beyond_the_certificates_is_detected_and_a_tenth_of_it_isnt(loop):
    healthy = sensed(loop, 816, duration_s=120.0)
    loss = monitor().sizes(healthy)["rudder"].loss
    assert 0.1 < loss < 0.6
    for share, detected in ((min(1.6 * loss, 1.0), True), (0.1 * loss, False)):
        weak = gb.ScaleFactor(channel="rudder", onset_s=ONSET_S, factor=1.0 - share)
        assert bool(said(sensed(loop, 816, weak, duration_s=120.0))) == detected


@pytest.mark.nightly
def test_a_logs_certificate_has_a_row_for_every_surface_and_kind():
    healthy = sensed(True, 816, duration_s=120.0)
    certificate = certificate_of(monitor(), [monitor().watch(healthy)])
    sizes = monitor().sizes(healthy)
    for surface in monitor().suspects:
        bias, loss = certificate.of(surface, "bias"), certificate.of(surface, "scale_factor")
        assert bias.size == sizes[surface].offset
        assert loss.size is None or loss.size == sizes[surface].loss
    short = sensed(False, 817, duration_s=20.0)
    assert certificate_of(monitor(), [monitor().watch(short)]).missing.startswith(
        "nothing of this record can be judged"
    )
    with pytest.raises(InputError, match="nothing of this record can be judged"):
        monitor().sizes(short)


@pytest.mark.nightly
def test_the_kind_is_told_where_it_shows_and_never_another():
    faults = {
        "jam": gb.Jam(channel="rudder", onset_s=ONSET_S),
        "scale_factor": gb.ScaleFactor(channel="rudder", onset_s=ONSET_S, factor=0.5),
        "bias": gb.Bias(channel="rudder", onset_s=ONSET_S, size=-1.5),
        "lag": gb.Lag(channel="rudder", onset_s=ONSET_S, lag_s=0.3),
    }
    told = {}
    for kind, fault in faults.items():
        (alarm,) = (each for each in said(sensed(True, 818, fault, duration_s=100.0)) if each.sensor)
        told[kind] = {each.kind for each in alarm.judgements} - {None}
    assert all(of <= {kind} for kind, of in told.items())
    assert sum(map(len, told.values())) >= 3


@pytest.mark.nightly
def test_a_monitor_of_before_one_search_is_refused_in_a_line():
    figures = monitor().figures()
    again = find_detector("surfaces").restore(figures)
    assert again.figures() == figures
    older = figures | {"answer": figures["answer"] | {"by_airspeed": [0.0] * 6, "alpha": 3.0}}
    with pytest.raises(InputError, match="calibrate anew"):
        find_detector("surfaces").restore(older)


@pytest.mark.parametrize("name", by_day(["surfaces-no-vanes", "surfaces-no-air"], 0))
def test_without_vanes_or_airspeed_a_weak_surface_is_told_too(name):
    detector = find_detector(name)
    assert not {"alpha", "beta"} & set(detector.channels)
    flights = [sensed(False, 740 + i, duration_s=150.0, excitation="multisine+turbulence") for i in range(3)]
    monitor = detector.calibrate(flights)
    weak = gb.ScaleFactor(channel="rudder", onset_s=ONSET_S, factor=0.2)
    watch = monitor.watch(sensed(False, 815, weak, excitation="multisine+turbulence"))
    assert {alarm.candidates for alarm in watch.alarms if alarm.is_first} == {("rudder",)}
    assert {alarm.sensor for alarm in watch.alarms if alarm.is_first} <= {"rudder", None}


@cache
def contracted():
    """Return a case of the contract: a surface's fault can't be injected, a gyro's alarms without a name."""
    flights = [sensed(False, 750 + i, duration_s=130.0, excitation="multisine+turbulence") for i in range(4)]
    flights = [decimate(flight, 2) for flight in flights]
    return contract_case("surfaces", flights, fault=gb.Bias(channel="beta", onset_s=100.0, size=3.0))


@pytest.mark.parametrize("name", by_day(CONTRACT, 0))
def test_it_keeps_the_contract_of_every_detector(name):
    check_property(contracted(), name)
