"""What a log says happened: each message at its own time, once, in the log's words; nothing where no time is known."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.events import Event, EventKind, in_order
from tests.helpers import intake_files as files

SECOND = 1_000_000  # in us


def stamps(hz, duration_s=60, start_s=100):
    return np.round((start_s + np.arange(duration_s * hz) / hz) * SECOND).astype(int).tolist()


def moved(times):
    return [(t, *np.sin([t / 9e5, t / 7e5, t / 8e5]).tolist()) for t in times]


def quaternion(angle_deg):
    half = np.radians(angle_deg) / 2
    return np.cos(half), 0.0, 0.0, np.sin(half)


def told(log):
    return [(str(event.kind), round(event.time_s, 3), event.text) for event in log.events]


@pytest.fixture(scope="module")
def px4(tmp_path_factory):
    """A PX4 log: a takeoff and a landing with contact before, a reset of 3 deg, an arming that was there before."""

    def attitude(t):
        after = t >= 120.5 * SECOND
        return (t, *quaternion(3.0 * after), *(quaternion(3.0) if after else quaternion(0.0)), int(after))

    def flags(changes, count):
        return [(int(t * SECOND), *row) for t, row in changes if len(row) == count]

    topics = {
        "vehicle_angular_velocity": (["float[3] xyz"], moved(stamps(50))),
        "vehicle_attitude": (
            ["float[4] q", "float[4] delta_q_reset", "uint8_t quat_reset_counter"],
            [attitude(t) for t in stamps(50)],
        ),
        "vehicle_land_detected": (
            ["uint8_t landed", "uint8_t ground_contact"],
            flags([(100, (1, 1)), (105, (0, 0)), (110, (0, 1)), (111, (0, 0)), (150, (0, 1)), (152, (1, 1))], 2),
        ),
        "vehicle_status": (["uint8_t arming_state"], flags([(100, (2,)), (155, (1,)), (156, (2,))], 1)),
        "failure_detector_status": (["uint8_t fd_roll", "uint8_t fd_motor"], flags([(100, (1, 0)), (140, (0, 1))], 2)),
        "estimator_selector_status": (["uint8_t primary_instance"], flags([(100, (0,)), (130, (1,))], 1)),
    }
    path = tmp_path_factory.mktemp("px4") / "log.ulg"
    path.write_bytes(files.ulog(topics))
    return path


def test_a_px4_log_tells_of_resets_landings_arming_and_failures(px4):
    assert told(gb.open_log(px4)) == [
        ("takeoff", 105.0, "land detector"),
        ("reset", 120.5, "attitude by 3 deg"),
        ("reset", 130.0, "estimator 1 took over"),
        ("failure", 140.0, "failure detector: motor"),
        ("touchdown", 150.0, "land detector"),
        ("disarm", 155.0, "commander"),
        ("arm", 156.0, "commander"),
    ]


def test_what_an_attitude_jumped_by_is_what_the_log_says(px4):
    log = gb.open_log(px4, needs=["psi"])
    jumped = np.abs(np.diff(log.segments[0]["psi"])).argmax()
    assert log.segments[0].time_s[jumped + 1] == pytest.approx(120.5, abs=log.sample_period_s)
    assert np.diff(log.segments[0]["psi"])[jumped] == pytest.approx(3.0, abs=1e-3)


COPTER = {
    "EV": [(101, 10), (103, 28), (120, 62), (149, 17), (151, 18), (152, 11), (152.2, 99)],
    "ERR": [(110, 16, 2), (111, 16, 0), (112, 11, 2), (115, 24, 0)],
    "MSG": [
        (119.9, b"EKF2 IMU0 in-flight yaw alignment complete"),
        (125, b"EKF2 IMU1 in-flight yaw alignment complete"),
        (126, b"Mission: 1 WP"),
    ],
}
SAID = [
    ("arm", 101, "EV ARMED"),
    ("takeoff", 103, "EV NOT_LANDED"),
    ("failure", 110, "ERR EKFCHECK 2"),
    ("reset", 115, "ERR EKF_PRIMARY: estimator 0 took over"),
    ("reset", 119.9, "EKF2 IMU0 in-flight yaw alignment complete; EV EKF_YAW_RESET"),
    ("touchdown", 149, "EV LAND_COMPLETE"),
    ("disarm", 152, "EV DISARMED"),
]


def ardupilot(*, old=False, more=()):
    """Return an ArduPilot log's tables; old ones have milliseconds, and stamp what comes again and again only."""
    letter, clock, per_second = ("f", "TimeMS", 1000) if old else ("Q", "TimeUS", SECOND)

    def steady(columns, hz):
        rows = [(t * per_second // SECOND, *row) for t, *row in moved(stamps(hz))]
        return (f"{letter}fff", f"{clock},{columns}", rows)

    def rare(letters, columns, rows):
        at = [(int(t * per_second), *row) for t, *row in rows]
        return (letters, columns, at) if old else (f"{letter}{letters}", f"{clock},{columns}", at)

    return {
        "IMU": steady("GyrX,GyrY,GyrZ", 50),
        "ATT": steady("Roll,Pitch,Yaw", 25),
        "EV": rare("B", "Id", COPTER["EV"]),
        "ERR": rare("BB", "Subsys,ECode", COPTER["ERR"]),
        "MSG": rare("Z", "Message", COPTER["MSG"]),
        **{name: rare(*table) for name, table in dict(more).items()},
    }


@pytest.mark.parametrize("write", [files.dataflash, files.dataflash_text])
def test_an_ardupilot_log_tells_the_same_as_binary_and_as_text(tmp_path, write):
    path = tmp_path / ("log.bin" if write is files.dataflash else "log.log")
    path.write_bytes(write(ardupilot()))
    assert told(gb.open_log(path)) == SAID


@pytest.mark.parametrize("write", [files.dataflash, files.dataflash_text])
def test_what_old_logs_dont_stamp_came_after_the_sample_before_it(tmp_path, write):
    path = tmp_path / ("log.bin" if write is files.dataflash else "log.log")
    path.write_bytes(write(ardupilot(old=True)))
    events = gb.open_log(path).events
    assert [(event.kind, event.text) for event in events] == [(kind, text) for kind, _, text in SAID]
    lags_s = [time_s - event.time_s for event, (_, time_s, _) in zip(events, SAID, strict=True)]
    assert min(lags_s) >= -1e-3
    assert max(lags_s) <= 0.0211  # the steady message's period


def test_the_first_estimator_is_the_one_in_use(tmp_path):
    lanes = {"XKF4": ("B", "PI", [(101, 0), (122, 1), (140, 1)])}
    (tmp_path / "log.bin").write_bytes(files.dataflash(ardupilot(more=lanes)))
    resets = [(time_s, text) for kind, time_s, text in told(gb.open_log(tmp_path / "log.bin")) if kind == "reset"]
    assert (122.0, "estimator 1 took over") in resets
    assert (125.0, "EKF2 IMU1 in-flight yaw alignment complete") in resets


def test_a_plane_says_whether_it_flies(tmp_path):
    tables = ardupilot(more={"STAT": ("B", "isFlying", [(101, 0), (107, 1), (108, 1), (144, 0)])})
    (tmp_path / "log.bin").write_bytes(files.dataflash({**tables, "EV": ("QB", "TimeUS,Id", [])}))
    flown = [(kind, time_s) for kind, time_s, text in told(gb.open_log(tmp_path / "log.bin")) if "STAT" in text]
    assert flown == [("takeoff", 107.0), ("touchdown", 144.0)]


def test_events_of_a_clock_that_was_set_back_are_left_out_and_that_is_said(tmp_path):
    def set_back(rows):
        return [(t, t - 30 * SECOND if t > 130 * SECOND else t, *row) for t, *row in rows]

    tables = {name: (letters, columns, set_back(rows)) for name, (letters, columns, rows) in ardupilot().items()}
    (tmp_path / "log.bin").write_bytes(files.dataflash(tables))
    log = gb.open_log(tmp_path / "log.bin")
    assert log.events == ()
    assert any("events of the log aren't taken, for its clock was set back" in line for line in log.method)


def test_what_is_far_from_the_flight_isnt_the_flights(tmp_path):
    more = ardupilot()
    letters, columns, rows = more["EV"]
    more["EV"] = (letters, columns, [*rows, (90 * SECOND, 11), (900 * SECOND, 10)])
    (tmp_path / "log.bin").write_bytes(files.dataflash(more))
    assert told(gb.open_log(tmp_path / "log.bin")) == SAID


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("MSG", ("QQ", "TimeUS,Message", [(110 * SECOND, 2**62)])),
        ("EV", ("Qf", "TimeUS,Id", [(110 * SECOND, np.nan)])),
        ("ERR", ("QBN", "TimeUS,Subsys,ECode", [(110 * SECOND, 24, b"x")])),
        ("XKF4", ("Qf", "TimeUS,PI", [(t * SECOND, np.nan) for t in range(101, 150)])),
    ],
)
def test_messages_of_another_kind_than_documented_are_no_events_and_no_errors(tmp_path, name, table):
    (tmp_path / "log.bin").write_bytes(files.dataflash({**ardupilot(), name: table}))
    others = [row for row in SAID if row[1] in {time_s for time_s, *_ in COPTER.get(name, ())}]
    said = told(gb.open_log(tmp_path / "log.bin"))
    assert len(said) >= len(SAID) - len(others) - 1
    assert all(np.isfinite(time_s) for _, time_s, _ in said)


def test_at_one_time_a_flight_ends_before_the_next_begins():
    kinds = [EventKind.ARM, EventKind.TAKEOFF, EventKind.DISARM, EventKind.TOUCHDOWN]
    ordered = in_order(Event(kind=kind, time_s=1.0, text="") for kind in kinds)
    assert [event.kind for event in ordered] == ["touchdown", "disarm", "arm", "takeoff"]
