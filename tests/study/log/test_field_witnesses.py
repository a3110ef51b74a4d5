"""A log's magnetometers between r and psi: who is named, who never is, and what is told of it."""

import json
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.magnetometer import Magnetometer, with_magnetometer
from gtmbench.intake.magnetometers import FieldReadings
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.log import detail_lines
from gtmbench.study.log.field_witnesses import field_witnesses, settled
from gtmbench.study.log.slow_means import slow_means
from gtmbench.study.log.watch import watch_log
from gtmbench.values.channels import ATTITUDE, GYROS, MAGNETOMETER
from tests.helpers.autopilot_logs import STEP, ardupilot, at, imus, truth

DURATION_S, ONSET_S, HEALTHY = 240.0, 120.0, (0.0, 110.0)
BIAS = gb.Bias(channel="r", onset_s=ONSET_S, size=2.5)


@cache
def field(seed=1):
    """Return what a magnetometer read on a flight, at 10 Hz."""
    flight = truth(DURATION_S, seed)
    read = with_magnetometer(flight, flight, Magnetometer(rate_hz=10.0), seed=seed)
    return read.time_s[::STEP], read.matrix(MAGNETOMETER)[::STEP]


def readings(seed=1, *, disturbed=(0.0, 0.0, 0.0), name="MAG"):
    time_s, own = field(seed)
    grown = np.clip((time_s - ONSET_S) / 60.0, 0.0, 2.0)
    return FieldReadings(
        name=name, columns=("MagX", "MagY", "MagZ"), time_s=time_s, field=own + np.outer(grown, disturbed)
    )


@cache
def flown(*faults, seed=1):
    return imus(1, faults=[(0, fault) for fault in faults], seed=seed, duration_s=DURATION_S)[0]


def wandering(record, deg_s):
    return record.replace("psi", record["psi"] + deg_s * np.maximum(record.time_s - ONSET_S, 0.0))


def told(record, *magnetometers):
    """Return the alarms of slow means, as magnetometers settle them."""
    means = slow_means([record], healthy=[HEALTHY], is_driven=True)
    witnesses = field_witnesses(magnetometers, [record], [record.between(*HEALTHY)])
    return [settled(alarm, witnesses, means) for alarm in means.alarms]


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("size", [2.5, -4.0])
def test_a_broken_yaw_gyro_is_named(seed, size):
    record = flown(gb.Bias(channel="r", onset_s=ONSET_S, size=size), seed=seed)
    (before,), (alarm,) = told(record), told(record, readings(seed))
    assert (alarm.sensor, alarm.doubt) == ("r", "")
    assert alarm.last.witness.startswith("MAG: r reads ")
    assert f"{np.sign(size):+.0f}"[0] in alarm.last.witness
    if before.sensor is None:  # else it has turned the heading round, and needs no witness
        assert before.candidates == ("r", "psi")
    assert (alarm.time_s, alarm.onset_s) == (before.time_s, before.onset_s)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_heading_that_wanders_accuses_no_gyro(seed):
    record = wandering(flown(seed=seed), 1.2)
    assert told(record)[0].candidates[0] == "r"
    (alarm,) = told(record, readings(seed))
    assert alarm.sensor in (None, "psi")
    assert alarm.candidates == ("psi",)


def test_a_doubt_stays_one_where_the_heading_wanders():
    record = wandering(flown(), -0.6)
    (before,), (alarm,) = told(record), told(record, readings())
    assert before.doubt
    assert (alarm.sensor, alarm.candidates, alarm.doubt) == (None, ("psi",), "the heading wanders")


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("disturbed", [(15.0, 0.0, 0.0), (0.0, -25.0, 10.0), (3.0, 3.0, -3.0), (0.0, 0.0, 60.0)])
def test_a_disturbed_magnetometer_names_nobody_while_the_heading_follows_it(seed, disturbed):
    record = wandering(flown(seed=seed), 0.8)
    for alarm in told(record, readings(seed, disturbed=disturbed)):
        assert alarm.sensor is None


def test_magnetometers_that_contradict_each_other_settle_nothing():
    record = flown(BIAS)
    yaw = np.radians(BIAS.size * np.maximum(record.time_s - ONSET_S, 0.0))
    own = readings().field
    turned = np.column_stack(  # a second field that turns with the broken gyro
        [
            own[:, 0] * np.cos(yaw) + own[:, 1] * np.sin(yaw),
            own[:, 1] * np.cos(yaw) - own[:, 0] * np.sin(yaw),
            own[:, 2],
        ]
    )
    liar = FieldReadings(name="MAG2", columns=("MagX", "MagY", "MagZ"), time_s=record.time_s, field=turned)
    assert [alarm.sensor for alarm in told(record, readings())] == ["r"]
    for order in ([readings(), liar], [liar, readings()]):
        (alarm,) = told(record, *order)
        assert alarm.sensor is None
        assert "MAG: " in alarm.last.witness
        assert "MAG2: " in alarm.last.witness


@pytest.mark.parametrize("channel", ["p", "q"])
def test_nobody_is_asked_about_another_axis(channel):
    record = flown(gb.Bias(channel=channel, onset_s=ONSET_S, size=0.9))
    assert told(record, readings()) == told(record)


def test_a_magnetometer_in_wrong_axes_knows_too_little():
    record, own = flown(BIAS), readings()
    wrong = FieldReadings(name="MAG", columns=own.columns, time_s=own.time_s, field=own.field[:, [1, 2, 0]])
    (alarm,) = told(record, wrong)
    assert alarm.sensor is None
    assert alarm.last.witness.startswith("MAG: ")


def test_without_healthy_seconds_there_is_no_witness():
    record = flown()
    assert field_witnesses([readings()], [record], [record.between(0.0, 8.0)]) == ()
    (short,) = field_witnesses([readings()], [record], [record.between(0.0, 20.0)])
    assert np.isnan(short.bound_deg_s)


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """Return what is said of an ArduPilot log with a bias of r, and of the same without its magnetometer."""
    path, own = tmp_path_factory.mktemp("log") / "flight.bin", readings()
    rows = [(at(time_s), *row) for time_s, row in zip(own.time_s, own.field.tolist(), strict=True)]
    path.write_bytes(ardupilot([flown(BIAS)], more={"MAG": ("Qfff", "TimeUS,MagX,MagY,MagZ", rows)}))
    return [watch_log(path, "auto", healthy=[HEALTHY], mapping=mapping) for mapping in ((), ("mag_x=none",))]


def test_a_log_says_on_which_witness_a_name_rests(watched):
    by, without = watched
    assert [each.name for each in by.witnesses] == ["MAG"]
    assert without.witnesses == ()
    open_ones = [alarm for alarm in without.alarms if alarm.sensor is None and alarm.candidates[:1] == ("r",)]
    assert {alarm.sensor for alarm in by.alarms} <= {None, "r"}
    text = "\n".join(detail_lines(by))
    assert "asked where a gyro or its angle is left open, over 30 s: MAG (knows r to " in text
    results = log_results(by)
    (witness,) = results["witnesses"]
    assert (witness["name"], witness["columns"][0]) == ("MAG", "MAG.MagX")
    assert 0.0 < witness["bound_deg_s"] < 1.0
    asked = [judged["witness"] for finding in results["findings"] for judged in finding["judgements"]]
    assert any(asked) == bool(open_ones)
    assert json.dumps(results["witnesses"])


def test_channels_of_a_log_are_as_they_were(watched):
    by, without = watched
    assert by.log.channels == without.log.channels
    assert {*GYROS, *ATTITUDE} <= set(by.log.channels)
    assert [alarm.time_s for alarm in by.alarms] == [alarm.time_s for alarm in without.alarms]
