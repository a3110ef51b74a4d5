"""Commands in autopilots' logs: read by their documentation, in our signs; who has none is told what that costs."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS
from tests.helpers.autopilot_logs import ardupilot, at, imus, px4

ROLL, PITCH, YAW, THRUST = 0.2, -0.1, 0.05, 0.6  # of the throw, and of all


@pytest.fixture(scope="module")
def record():
    return imus(1)[0]


def rows(record, values):
    return [(time_s, *values) for time_s in record.time_s.tolist()]


def read(content, path):
    path.write_bytes(content)
    log = gb.open_log(path, needs=("p", *COMMANDS))
    return {name: float(np.nanmedian(log.segments[0][name])) for name in COMMANDS}


@pytest.mark.parametrize("new", [False, True], ids=["actuator_controls", "setpoints"])
def test_px4s_controls_become_degrees_in_our_signs(tmp_path, record, new):
    """Roll right is a negative aileron, pitch up a negative elevator, yaw right a negative rudder."""
    turns = {
        "vehicle_torque_setpoint": (["float[3] xyz"], rows(record, (ROLL, PITCH, YAW))),
        "vehicle_thrust_setpoint": (["float[3] xyz"], rows(record, (THRUST, 0.0, 0.0))),
    }
    old = {"actuator_controls_0": (["float[8] control"], rows(record, (ROLL, PITCH, YAW, THRUST, 0, 0, 0, 0)))}
    found = read(px4(record, more=turns if new else old), tmp_path / "flight.ulg")
    wanted = {"elevator": -45.0 * PITCH, "aileron": -45.0 * ROLL, "rudder": -45.0 * YAW, "throttle": 100.0 * THRUST}
    assert found == pytest.approx(wanted, rel=1e-4)


def test_ardupilots_outputs_become_degrees_in_our_signs(tmp_path, record):
    told = (4500 * ROLL, 4500 * PITCH, 100 * THRUST, 4500 * YAW)
    stamped = [(at(time_s), *told) for time_s in record.time_s.tolist()]
    log = ardupilot([record], more={"AETR": ("Qffff", "TimeUS,Ail,Elev,Thr,Rudd", stamped)})
    found = read(log, tmp_path / "flight.bin")
    wanted = {"elevator": -45.0 * PITCH, "aileron": -45.0 * ROLL, "rudder": -45.0 * YAW, "throttle": 100.0 * THRUST}
    assert found == pytest.approx(wanted, rel=1e-4)


SERVOS = {  # functions of SERVO1.., and the pulses of each
    "a plane": ((4, 19, 70, 21), (1500 + 400 * ROLL, 1500 + 400 * PITCH, 1100 + 800 * THRUST, 1500 + 400 * YAW)),
    "elevons": (
        (77, 78, 70, 21),
        (1500 + 200 * (PITCH - ROLL), 1500 + 200 * (PITCH + ROLL), 1100 + 800 * THRUST, 1500 + 400 * YAW),
    ),
    "a V-tail": (
        (4, 79, 70, 80),
        (1500 + 400 * ROLL, 1500 + 200 * (PITCH + YAW), 1100 + 800 * THRUST, 1500 + 200 * (PITCH - YAW)),
    ),
}


@pytest.mark.parametrize("is_reversed", [False, True])
@pytest.mark.parametrize("aircraft", SERVOS)
def test_ardupilots_servos_become_degrees_by_what_its_parameters_tell(tmp_path, record, aircraft, is_reversed):
    functions, pulses = SERVOS[aircraft]
    settings = [(0.0, f"SERVO{number}_FUNCTION", float(function)) for number, function in enumerate(functions, 1)]
    if is_reversed:
        settings += [(0.0, "SERVO1_REVERSED", 1.0)]
        pulses = (3000 - pulses[0], *pulses[1:])
    stamped = [(at(time_s), *map(round, pulses)) for time_s in record.time_s.tolist()]
    stamped[0] = (stamped[0][0], 0, 0, 0, 0)  # not armed yet
    log = ardupilot([record], settings=settings, more={"RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4", stamped)})
    found = read(log, tmp_path / "flight.bin")
    wanted = {"elevator": -45.0 * PITCH, "aileron": -45.0 * ROLL, "rudder": -45.0 * YAW, "throttle": 100.0 * THRUST}
    assert found == pytest.approx(wanted, rel=0.02, abs=0.06)


def test_servos_of_a_copter_are_no_surfaces(tmp_path, record):
    settings = [(0.0, f"SERVO{number}_FUNCTION", 32.0 + number) for number in range(1, 5)]
    stamped = [(at(time_s), 1500, 1500, 1500, 1500) for time_s in record.time_s.tolist()]
    (tmp_path / "flight.bin").write_bytes(
        ardupilot([record], settings=settings, more={"RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4", stamped)})
    )
    with pytest.raises(InputError, match="elevator"):
        gb.open_log(tmp_path / "flight.bin", needs=("p", *COMMANDS))


PX4_SURFACES = {  # of each surface: its type, and its torques about roll, pitch and yaw
    "a plane": ((1, -0.5, 0.0, 0.0), (2, 0.5, 0.0, 0.0), (3, 0.0, 1.0, 0.0), (4, 0.0, 0.0, 1.0)),
    "elevons": ((5, -0.5, 0.5, 0.0), (6, 0.5, 0.5, 0.0), (4, 0.0, 0.0, 1.0), (9, 0.3, 0.0, 0.0)),  # and a flap
    "a V-tail": ((1, -0.5, 0.0, 0.0), (2, 0.5, 0.0, 0.0), (7, 0.0, 0.5, 0.5), (8, 0.0, 0.5, -0.5)),
}
TRIM = 0.05


def px4_plane(surfaces):
    """Return parameters of a plane, and how far each servo is driven: by the torques' pseudoinverse, from its trim."""
    settings = {"CA_AIRFRAME": 1, "CA_ROTOR_COUNT": 1, "CA_SV_CS_COUNT": len(surfaces)}
    for number, (kind, *torques) in enumerate(surfaces):
        settings |= {f"CA_SV_CS{number}_TYPE": kind, f"CA_SV_CS{number}_TRIM": TRIM}
        settings |= {f"CA_SV_CS{number}_TRQ_{axis}": torque for axis, torque in zip("RPY", torques, strict=True)}
    torques = np.array([[0.0] * 3 if kind == 9 else of for kind, *of in surfaces]).T
    full = np.abs(torques).sum(axis=1)
    return settings, TRIM + np.linalg.pinv(torques) @ (full * np.array([ROLL, PITCH, YAW]))


@pytest.mark.parametrize("logged", ["servos", "pulses", "pulses beside another driver's"])
@pytest.mark.parametrize("aircraft", PX4_SURFACES)
def test_px4s_servos_become_degrees_by_what_its_parameters_tell(tmp_path, record, aircraft, logged):
    settings, driven = px4_plane(PX4_SURFACES[aircraft])
    if logged == "servos":
        more = {
            "actuator_servos": (["float[8] control"], rows(record, (*driven, *[np.nan] * (8 - len(driven))))),
            "actuator_motors": (["float[12] control"], rows(record, (THRUST, *[np.nan] * 11))),
        }
    else:
        is_reversed = [False, True, False, False]
        pulses = [1500 + 400 * each * (-1 if turned else 1) for each, turned in zip(driven, is_reversed, strict=True)]
        pulses = [*np.round(pulses), 1100 + 800 * THRUST]
        settings |= {f"PWM_MAIN_FUNC{number}": 200 + number for number in range(1, 5)}
        settings |= {"PWM_MAIN_FUNC5": 101, "PWM_MAIN_REV": 0b10, "PWM_AUX_FUNC1": 0}
        for number in range(1, 6):
            settings |= {f"PWM_MAIN_MIN{number}": 1100, f"PWM_MAIN_MAX{number}": 1900}
        stamped = rows(record, (*pulses, 0, 0, 0))
        stamped[0] = (stamped[0][0], *[900] * 5, 0, 0, 0)  # not armed yet
        own = "actuator_outputs" if logged == "pulses" else "actuator_outputs#1"
        more = {own: (["float[8] output"], stamped)}
        if own.endswith("#1"):
            more["actuator_outputs"] = (["float[8] output"], rows(record, [0.0] * 8))
    found = read(px4(record, more=more, settings=settings), tmp_path / "flight.ulg")
    wanted = {"elevator": -45.0 * PITCH, "aileron": -45.0 * ROLL, "rudder": -45.0 * YAW, "throttle": 100.0 * THRUST}
    assert found == pytest.approx(wanted, rel=0.01, abs=0.1)


def test_px4s_setpoints_come_before_its_servos(tmp_path, record):
    settings, _ = px4_plane(PX4_SURFACES["a plane"])
    more = {
        "actuator_servos": (["float[8] control"], rows(record, [0.9] * 8)),
        "vehicle_torque_setpoint": (["float[3] xyz"], rows(record, (ROLL, PITCH, YAW))),
        "vehicle_thrust_setpoint": (["float[3] xyz"], rows(record, (THRUST, 0.0, 0.0))),
    }
    found = read(px4(record, more=more, settings=settings), tmp_path / "flight.ulg")
    assert found["elevator"] == pytest.approx(-45.0 * PITCH, rel=1e-4)


@pytest.mark.parametrize(
    "settings",
    [{}, {"CA_AIRFRAME": 0, "CA_SV_CS_COUNT": 4}, {"CA_AIRFRAME": 1}],
    ids=["no parameters", "a multirotor", "no surfaces"],
)
def test_px4s_servos_whose_function_nobody_tells_are_not_read(tmp_path, record, settings):
    more = {"actuator_servos": (["float[8] control"], rows(record, [0.1] * 8))}
    (tmp_path / "flight.ulg").write_bytes(px4(record, more=more, settings=settings))
    with pytest.raises(InputError, match="elevator"):
        gb.open_log(tmp_path / "flight.ulg", needs=("p", *COMMANDS))


def test_a_log_without_commands_says_which_are_missing(tmp_path, record):
    path = tmp_path / "flight.ulg"
    path.write_bytes(px4(record))
    with pytest.raises(InputError, match="elevator"):
        gb.open_log(path, needs=("p", *COMMANDS))
