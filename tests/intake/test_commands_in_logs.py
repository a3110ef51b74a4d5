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


def test_a_log_without_commands_says_which_are_missing(tmp_path, record):
    path = tmp_path / "flight.ulg"
    path.write_bytes(px4(record))
    with pytest.raises(InputError, match="elevator"):
        gb.open_log(path, needs=("p", *COMMANDS))
