"""The autopilot's word: which messages are complaints, of what; and beside our alarms, on the log's clock."""

import pytest

import gtmbench as gb
from gtmbench.intake.events import Event, EventKind
from gtmbench.log.truth.autopilot_messages import NEAR_S, beside, words_of
from gtmbench.report.figures.log import write_log_figure
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.log import log_report
from tests.helpers.autopilot_logs import ardupilot, broken, imus, px4

BIAS = gb.Bias(channel="q", onset_s=90.0, size=4.0)


def complaints(path):
    events = gb.open_log(path, needs=["p", "q", "r"]).events
    kinds = [event for event in events if event.kind is EventKind.COMPLAINT]
    return [(event.about, event.number, round(event.time_s, 2)) for event in kinds]


@pytest.fixture(scope="module")
def flight():
    return imus(1)[0]


def test_px4_says_which_gyro_isnt_healthy_what_its_estimators_reject_and_which_sensor_failed(tmp_path, flight):
    estimator = ["float hdg_test_ratio", "uint32_t filter_fault_flags"]
    slots = ["uint32_t[4] gyro_device_ids", "uint8_t[4] gyro_healthy"]

    def healthy(time_s, *flags):
        return (time_s, 11, 12, 0, 0, *flags, 0, 0)

    more = {
        "sensors_status_imu": (slots, [healthy(t, 1, int(t != 40.0)) for t in (10.0, 39.0, 40.0, 41.0)]),
        "estimator_status": (
            estimator,
            [(10.0, 2.0, 0), (11.0, 0.5, 0), (50.0, 1.5, 0), (51.0, 0.9, 0), (60.0, 0.2, 4)],
        ),
        "estimator_status#1": (estimator, [(10.0, 0.1, 0), (55.0, 1.1, 0)]),
        "estimator_selector_status": (
            ["uint8_t gyro_fault_detected", "uint8_t[2] healthy"],
            [(10.0, 0, 1, 1), (70.0, 1, 1, 1), (71.0, 0, 0, 1)],
        ),
    }
    texts = [(80.0, "[sensors] Gyro #1 fail: TIMEOUT!"), (81.0, "Takeoff detected")]
    (tmp_path / "log.ulg").write_bytes(px4(flight, more=more, texts=texts))
    assert complaints(tmp_path / "log.ulg") == [
        ("gyro", 2, 40.0),
        ("estimator", None, 50.0),
        ("estimator", None, 55.0),
        ("estimator", None, 60.0),
        ("gyro", None, 70.0),
        ("estimator", None, 71.0),
        ("gyro", 2, 80.0),
    ]


def test_ardupilot_says_so_by_health_by_lanes_and_by_texts(tmp_path):
    lanes = [(t, lane, 1.4 if (t, lane) == (50.0, 1) else 0.2) for t in (10.0, 50.0, 51.0) for lane in (0, 1)]
    texts = [(30.0, "PreArm: Gyros inconsistent"), (31.0, "EKF3 IMU1 is using GPS"), (60.0, "EKF variance: over")]
    (tmp_path / "log.bin").write_bytes(ardupilot(imus(2), texts=texts, unhealthy=[(1, 40.0)], lanes=lanes))
    assert complaints(tmp_path / "log.bin") == [
        ("gyro", None, 30.0),
        ("gyro", 2, 40.0),
        ("estimator", None, 50.0),
        ("estimator", None, 60.0),
    ]


def test_a_flag_that_flutters_is_said_once_until_it_was_calm(tmp_path, flight):
    ratios = [(20.0, 0.1), *((30.0 + 0.5 * k, 2.0 * (k % 2)) for k in range(20)), (60.0, 0.1), (61.0, 2.0)]
    more = {"estimator_status": (["float mag_test_ratio"], ratios)}
    (tmp_path / "log.ulg").write_bytes(px4(flight, more=more))
    assert [time_s for *_, time_s in complaints(tmp_path / "log.ulg")] == [30.5, 61.0]


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """A gyro's bias, of which the autopilot says so five seconds later."""
    path = tmp_path_factory.mktemp("said") / "log.bin"
    path.write_bytes(ardupilot(broken(BIAS), unhealthy=[(0, 95.0)], texts=[(10.0, "Throttle armed")]))
    return gb.watch_log(path, "C", healthy=[(0, 80)])


@pytest.mark.nightly
def test_a_complaint_is_no_reason_for_doubt(said):
    assert [alarm.verdict for alarm in said.alarms][:1] == ["q failed"]
    assert [event.kind for event in said.log.events] == [EventKind.COMPLAINT]
    assert not [each for each in said.excursions if "autopilot" in each.reason]


def test_beside_an_alarm_stands_the_nearest_word_of_a_sensor_else_of_an_estimator():
    def word(time_s, about):
        return Event(kind=EventKind.COMPLAINT, time_s=time_s, text=about, about=about)

    alarm = gb.Alarm(number=0, time_s=100.0, onset_s=99.0, source="q")
    words = [word(99.0, "estimator"), word(110.0, "gyro"), word(100.0 + NEAR_S + 1.0, "gyro")]
    assert beside([alarm], words)[0].ahead_s == 10.0
    assert beside([alarm], words[:1])[0].ahead_s == -1.0
    assert beside([alarm], words[2:])[0].word is None
    arm = Event(kind=EventKind.ARM, time_s=1.0, text="")
    assert words_of([arm, *words]) == tuple(words)


@pytest.mark.nightly
def test_the_report_the_json_and_the_figure_tell_both(said, tmp_path):
    lines = log_report(said)
    assert "autopilot: 'gyro 1 isn't healthy (IMU.GH)' at 95.00 s" in lines
    alarm = said.alarms[0]
    told = f"beside our alarm at {alarm.time_s:.2f} s: 'gyro 1 isn't healthy (IMU.GH)' at 95.00 s, "
    assert f"autopilot: {told}{95.0 - alarm.time_s:.2f} s later" in lines
    table = log_results(said)["autopilot"]
    assert [word["about"] for word in table["words"]] == ["gyro"]
    assert table["beside"][0]["word_s"] == pytest.approx(95.0)
    assert table["beside"][0]["ahead_s"] == pytest.approx(95.0 - alarm.time_s)
    write_log_figure(said, tmp_path / "log.png")
    assert (tmp_path / "log.png").stat().st_size > 10_000


@pytest.mark.nightly
def test_a_log_without_events_says_nothing_of_an_autopilot(tmp_path):
    gb.write_log(imus(1)[0].between(0.0, 40.0), tmp_path / "flight.csv")
    watched = gb.watch_log(tmp_path / "flight.csv", "C", healthy=[(0, 30)])
    assert not [line for line in log_report(watched) if line.startswith("autopilot")]
