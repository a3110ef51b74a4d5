"""Where other sensors are clear: an error that began until then, and is as large as is stated, isn't there."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.course import cleared as subject
from gtmbench.engine.course.explanations.registry import explanations_of
from gtmbench.engine.course.judged import course_judged
from gtmbench.engine.course.misread import misread
from gtmbench.engine.course.relations.registry import relations_of
from gtmbench.engine.findings import found_by
from gtmbench.values.channels import ACCELEROMETERS, WHOLE, names_of
from gtmbench.verdict.timeline import State, laid_out
from tests.engine.course.test_course_contract import END_S, SIZES, course_from, flight_from, flown, others_of, said_of
from tests.helpers.night import by_day

HELD = ("accelerometers", "alpha", "beta", "altitude")  # by two relations; the wind leaves the others open


def clear_of(said):
    return {sensor: span for sensor, span in said.clear if span.state is State.CLEAR}


@pytest.mark.parametrize("seed", by_day([3, 4]))
def test_what_two_relations_hold_is_clear_up_to_less_than_a_failure_and_one_alone_clears_nobody(seed):
    clear = clear_of(said_of(flown(seed=seed)))
    for sensor in HELD:
        assert clear[sensor].duration_s > 0.5 * END_S
    assert (clear["accelerometers"].start_s, clear["accelerometers"].end_s) == (4.0, END_S - 4.0)
    assert clear["accelerometers"].sizes.error < SIZES["nx"]
    assert clear["accelerometers"].sizes.within_s == 60.0
    assert "magnetometer" not in clear


def test_a_sensor_that_one_relation_holds_is_not_clear():
    record = flown()
    others = {name: each for name, each in others_of(record).items() if name in (*ACCELEROMETERS, "altitude")}
    assert clear_of(course_judged(flight_from(record), others)) == {}


@pytest.mark.parametrize("share", by_day([0.05, 0.2, 0.5, 0.8]))
@pytest.mark.parametrize(
    "channel", by_day(["nx", "ny", "nz", "alpha", "beta", "tas", "altitude", "gps_north", "gps_down"])
)
def test_no_error_is_beside_a_clear_span_that_states_a_smaller_one(channel, share):
    """Whether it begins before the span or in it, is found or not; beside a second cause, too."""
    gust = gb.Bias(channel="tas", onset_s=0.4 * END_S, size=4.0)
    broken = gb.inject(flown(seed=4), [gb.Bias(channel=channel, onset_s=share * END_S, size=SIZES[channel]), gust])
    sensor = names_of(channel)[-1]
    claims = {sensor: [span for name, span in said_of(broken).claims if names_of(name)[-1] == sensor]}
    for span in laid_out((0.0, END_S), claims).of(sensor, State.CLEAR):
        assert span.end_s < share * END_S + 1.0 or span.sizes.error >= SIZES[channel]


def test_what_shows_and_is_no_finding_is_told_and_not_clear():
    said = said_of(gb.inject(flown(), gb.Bias(channel="mag_x", onset_s=60.0, size=15.0)))
    (span,) = [span for name, span in said.clear if name == "magnetometer"]
    assert span.reason.startswith("it parts from what others tell")
    assert (span.start_s, span.end_s) == (pytest.approx(60.0, abs=5.0), END_S)


def test_a_sensor_is_clear_where_less_may_hide_than_twice_what_users_ask_for(monkeypatch):
    """Of a magnetometer, which one relation holds, nothing is small enough."""
    course = course_from(flown())
    found = found_by(course.flight, relations_of(course), explanations_of(course))
    most = {"accelerometers": 0.4, "gps": 6.0, "tas": 20.0, "alpha": 6.0, "beta": 6.0, "altitude": 200.0}
    units = {sensor: abs(course.unit_of(WHOLE.get(sensor, (sensor,))[0])) for sensor in (*most, "magnetometer")}

    def hides(share):
        def hidden(scan, _, channel):
            sensor = names_of(channel)[-1]
            return np.full(scan.model.cells, share * most.get(sensor, 0.1) / units[sensor])

        monkeypatch.setattr(subject, "_hidden", hidden)
        claims = subject.cleared(course, found, others_of(flown()), ())
        return {sensor for sensor, span in claims if span.state is State.CLEAR}

    assert hides(0.99) == {*most}
    assert hides(1.01) == set()


# ---- units and frames ----


def scaled(record, factor, *channels):
    for name in channels:
        record = record.replace(name, factor * record[name])
    return record


MISREAD = {
    "m/s for kt": ("tas", lambda record: scaled(record, 0.514444, "tas")),
    "up": ("gps", lambda record: scaled(record, -1.0, "gps_down")),
    "-1 g": ("accelerometers", lambda record: scaled(record, -1.0, "nz")),
}


@pytest.mark.parametrize("how", by_day(MISREAD))
def test_another_unit_or_frame_is_asked_for_and_nobody_is_accused_of_it(how):
    sensor, changed = MISREAD[how]
    said = said_of(changed(flown()))
    ((name, why),) = said.asked
    assert name == sensor
    assert how in why
    assert (said.accused, said.standing) == ((), ())
    assert sensor not in clear_of(said)
    assert not said.course.has(*WHOLE.get(sensor, (sensor,)))
    assert said.course.has("alpha", "beta")


def asked_of(record):
    return list(misread(course_from(record)))


def test_what_is_read_as_it_is_is_asked_for_nothing_nor_is_what_breaks_amid_a_log():
    assert asked_of(flown()) == asked_of(flown(seed=4)) == []
    for channel, size in SIZES.items():
        assert asked_of(gb.inject(flown(), gb.Bias(channel=channel, onset_s=60.0, size=3.0 * size))) == []
