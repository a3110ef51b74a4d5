"""Truth in a log: injected failures are read with onset and end, and scored; hostile ones are passed over."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as settings_of
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.intake.published_failures import spells
from gtmbench.log.truth.score import NAMED, WRONG, _before, _windows, score_log, scored
from gtmbench.report.tables.log import score_results
from gtmbench.report.words.log import log_report
from gtmbench.report.words.others import score_report
from tests.helpers.autopilot_logs import ardupilot, broken, imus, px4
from tests.helpers.hostile import Tried, damaged, refused

BIAS = gb.Bias(channel="q", onset_s=90.0, size=float(np.degrees(0.08)))
BIASED = [(0.0, "SIM_GYR1_BIAS_Y", 0.0), (90.0, "SIM_GYR1_BIAS_Y", 0.08)]


def injections(path):
    return [
        (
            each.sensor,
            each.number,
            each.channels,
            each.kind,
            each.size and round(each.size, 4),
            each.onset_s,
            each.end_s,
        )
        for each in gb.open_log(path, needs=["p", "q", "r"]).injections
    ]


@pytest.fixture(scope="module")
def flight():
    return imus(1)[0]


def test_ardupilots_simulation_parameters_are_faults_from_their_change_to_their_return(tmp_path, flight):
    settings = [
        (0.0, "SIM_GYR1_BIAS_X", 0.0),
        (0.0, "SIM_DRIFT_SPEED", 0.05),
        (20.0, "SIM_GYR1_BIAS_X", 0.1),
        (30.0, "SIM_GYR1_BIAS_X", 0.2),
        (40.0, "SIM_GYR1_BIAS_X", 0.0),
        (50.0, "SIM_GYR2_SCALE_Z", 20.0),
        (60.0, "SIM_GYR_FAIL_MSK", 3.0),
        (70.0, "SIM_GYR_FAIL_MSK", 2.0),
        (80.0, "SIM_GYR_RND", 9.0),
        (100.0, "SIM_DRIFT_SPEED", 6.0),
        (110.0, "SIM_GPS1_JAM", 1.0),
    ]
    (tmp_path / "log.bin").write_bytes(ardupilot([flight], settings=settings))
    assert injections(tmp_path / "log.bin") == [
        ("gyro", 1, ("p",), "bias", 11.4592, 20.0, 40.0),
        ("gyro", 2, ("r",), "scale factor", 0.2, 50.0, None),
        ("gyro", 1, ("p", "q", "r"), "stuck", None, 60.0, 70.0),
        ("gyro", 2, ("p", "q", "r"), "stuck", None, 60.0, None),
        ("gyro", 1, ("p", "q", "r"), "noise", 9.0, 80.0, None),
        ("gyro", None, ("p", "q", "r"), "drift", 0.1, 100.0, None),
    ]


COMMAND = ["uint32_t command", "float param1", "float param2", "float param3"]


def test_px4s_commands_are_failures_until_all_is_well_and_refused_ones_arent(tmp_path, flight):
    more = {
        "vehicle_command": (
            COMMAND,
            [
                (20.0, 420, 0, 2, 1),
                (30.0, 420, 4, 1, 0),
                (35.0, 400, 1, 0, 0),
                (40.0, 420, 0, 0, 0),
                (50.0, 420, 0, 1, 2),
            ],
        ),
        "vehicle_command_ack": (["uint32_t command", "uint8_t result"], [(20.1, 420, 0), (50.1, 420, 3)]),
    }
    (tmp_path / "log.ulg").write_bytes(px4(flight, more=more))
    assert injections(tmp_path / "log.ulg") == [
        ("gyro", 1, ("p", "q", "r"), "stuck", None, 20.0, 40.0),
        ("GPS", None, (), "off", None, 30.0, None),
    ]


def test_px4s_topic_says_what_is_in_force(tmp_path, flight):
    fields = ["uint8_t count", "uint8_t[4] unit", "uint16_t[4] instance_mask", "uint8_t[4] failure_type"]

    def said(time_s, *entries):
        padded = [*entries, *[(0, 0, 0)] * (4 - len(entries))]
        return (time_s, len(entries), *(value for column in zip(*padded, strict=True) for value in column))

    rows = [said(20.0, (0, 0b10, 2)), said(30.0, (0, 0b10, 2), (3, 0xFFFF, 1)), said(40.0)]
    command = [(20.0, 420, 1, 1, 0)]  # asked for, and not in force
    more = {"failure_injection": (fields, rows), "vehicle_command": (COMMAND, command)}
    (tmp_path / "log.ulg").write_bytes(px4(flight, more=more))
    assert injections(tmp_path / "log.ulg") == [
        ("gyro", 2, ("p", "q", "r"), "stuck", None, 20.0, 40.0),
        ("barometer", None, (), "off", None, 30.0, 40.0),
    ]


def test_a_spell_has_the_value_furthest_off():
    assert list(spells([(0.0, 1.0), (2.0, 1.0)], usual=1.0)) == []
    assert list(spells([(0.0, -2.0), (2.0, 1.0), (3.0, 0.0)], usual=0.0)) == [(0.0, 3.0, -2.0)]


@pytest.fixture(scope="module")
def biased(tmp_path_factory):
    """A SITL flight: its gyro's bias is set at 90 s, the autopilot says so at 96 s; another gyro's later, unwatched."""
    path = tmp_path_factory.mktemp("sitl") / "sitl.bin"
    settings = [*BIASED, (125.0, "SIM_GYR3_BIAS_X", 0.1)]
    path.write_bytes(ardupilot(broken(BIAS), settings=settings, unhealthy=[(0, 96.0)]))
    return path


@pytest.fixture(scope="module")
def scores(biased):
    return score_log(biased, "C")


@pytest.mark.nightly
def test_a_sitl_flight_is_a_trial_of_both(scores, biased, cli):
    (row,) = scores.trials
    assert scores.watched.identified_s == ((pytest.approx(0.0, abs=1.5), pytest.approx(84.0)),)
    assert row.said == NAMED
    assert row.alarm.sensor == "q"
    assert 0.0 < row.delay_s < 6.0
    assert row.word_delay_s == pytest.approx(6.0)
    assert scores.false_alarms == scores.false_words == ()
    code, out, err = cli("score", str(biased), "--detector", "C")
    assert (code, err) == (int(scores.watched.outcome), "")
    assert "q of gyro 1: bias 4.58" in out
    assert "not scored: gyro 3" in out


def test_what_isnt_watched_isnt_scored(scores):
    assert [row.why_not for row in scores.rows] == ["", "gyro 3 isn't watched"]


def test_alarms_belong_to_the_failure_in_whose_window_they_are(scores):
    """The same watch, held against other truths."""

    def against(*onsets_s, channels=("q",)):
        injected = [replace(scores.rows[0].injection, onset_s=at_s, channels=channels) for at_s in onsets_s]
        log = replace(scores.watched.log, injections=tuple(injected))
        return scored(replace(scores.watched, log=log))

    alarm = scores.rows[0].alarm
    late = against(alarm.time_s + 1.0)
    assert late.false_alarms[:1] == (alarm,)
    assert [row.said for row in against(89.0, alarm.time_s - 0.01).rows] == ["", NAMED]
    assert against(90.0, channels=("p",)).rows[0].said == WRONG
    assert against(10.0).rows[0].why_not == "it began while nothing was watched"


def test_words_and_json_tell_both(scores):
    told = score_report(scores)
    assert told[0].startswith("we: 1 of 1 failure found (1 named)")
    assert told[1] == "the autopilot: 1 of 1 failure reported as a sensor's; 0 false words outside of them"
    row = score_results(scores)["failures"][0]
    assert (row["said"], row["autopilot_delay_s"]) == (NAMED, pytest.approx(6.0))
    (line,) = (line for line in log_report(scores.watched) if line.startswith("injected: q"))
    assert line.startswith("injected: q of gyro 1: bias 4.58 deg/s from 90.00 s on; we ")


def test_a_window_lasts_ten_seconds_behind_a_failure_and_health_ends_six_before_the_first():
    def failed(onset_s, end_s=None):
        return gb.Injection(sensor="gyro", number=None, channels=("q",), kind="", onset_s=onset_s, end_s=end_s, text="")

    assert list(_windows([failed(20.0, 30.0), failed(60.0)], 100.0)) == [(20.0, 40.0), (60.0, 100.0)]
    healthy = [_before([failed(at_s)], 0.0, Path("log.bin")) for at_s in (21.1, 400.0)]
    assert healthy == [(0.0, pytest.approx(15.1)), (0.0, 300.0)]  # five minutes at most
    with pytest.raises(gb.InputError, match=r"begins 20\.9 s after the log does, and 21 s are wanted"):
        _before([failed(20.9)], 0.0, Path("log.bin"))


def test_without_truth_it_is_one_line(cli, tmp_path, flight):
    (tmp_path / "log.bin").write_bytes(ardupilot([flight]))
    gb.write_log(flight, tmp_path / "log.csv")
    for name in ("log.bin", "log.csv"):
        found = cli("score", name)
        refused(found)
        assert "the log records no failure that was injected" in found[2]


@pytest.mark.parametrize(
    ("settings", "arguments", "said"),
    [
        ([(8.0, "SIM_GYR1_BIAS_X", 0.1)], (), "21 s are wanted to identify on"),
        (BIASED, ("--healthy", "0:100"), "give a span without a failure"),
    ],
)
def test_what_is_healthy_holds_no_failure(cli, tmp_path, flight, settings, arguments, said):
    (tmp_path / "log.bin").write_bytes(ardupilot([flight], settings=settings))
    found = cli("score", "log.bin", "--detector", "C", *arguments)
    refused(found)
    assert said in found[2]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0, 1e30, 255.0])
def test_hostile_settings_raise_nothing(tmp_path, flight, value):
    names = ["SIM_GYR_FAIL_MSK", "SIM_GYR1_BIAS_X", "SIM_GYR9_SCALE_Z", "SIM_DRIFT_SPEED", "SIM_GYR_RND", "\x1b[2J"]
    settings = [(float(10 + place), name, value) for place, name in enumerate(names)]
    (tmp_path / "log.bin").write_bytes(ardupilot([flight], settings=settings))
    assert all(text.isprintable() for text in (each.text for each in gb.open_log(tmp_path / "log.bin").injections))


def test_damaged_logs_are_read_or_refused_in_a_line(tmp_path, flight, record_property):
    """Everything that the new messages are read by: health, lanes, texts, settings, commands."""
    short = flight.between(0.0, 20.0)
    commands = (COMMAND, [(5.0, 420, 0, 1, 1), (6.0, 420, 0, 0, 1)])
    settings = [(5.0, "SIM_GYR1_BIAS_X", 0.1), (6.0, "SIM_GYR_FAIL_MSK", 1.0)]
    logs = {
        "log.bin": ardupilot([short, short], settings=settings, texts=[(5.0, "EKF variance")], unhealthy=[(0, 9.0)]),
        "log.ulg": px4(short, more={"vehicle_command": commands}, texts=[(5.0, "Gyro #0 fail: OFF!")]),
    }
    tried = Tried()

    @given(st.sampled_from(list(logs)), st.data())
    @settings_of(max_examples=80, suppress_health_check=list(HealthCheck))
    def read(name, data):
        (tmp_path / name).write_bytes(data.draw(damaged(logs[name])))
        tried(gb.open_log, tmp_path / name)

    read()
    tried.report(record_property)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1e30, 1e30])
def test_hostile_commands_raise_nothing(tmp_path, flight, value):
    rows = [(20.0, 420, value, 1.0, 0.0), (21.0, 420, 0.0, value, 0.0), (22.0, 420, 0.0, 1.0, value)]
    (tmp_path / "log.ulg").write_bytes(px4(flight, more={"vehicle_command": (COMMAND, rows)}))
    assert len(gb.open_log(tmp_path / "log.ulg").injections) <= 3
