"""What the messages of autopilots mean by their documentation: of PX4's topics, ArduPilot's and MAVLink's messages.

Body axes point forward, right, down. Of two columns of one channel the first here is preferred. Commands are those
before the mixer: positive ones roll right, pitch up and yaw right, which our surfaces' signs do not. Their full throw
is taken for 45 deg, for no log tells what a linkage makes of it.
"""

from __future__ import annotations

from collections.abc import Mapping

from gtmbench.intake.formats.raw import ANGLES, Meaning
from gtmbench.values.channels import ATTITUDE

Documented = Mapping[tuple[str, str], Meaning]


def _axes(topic: str, fields: str, channels: str, unit: str) -> dict[tuple[str, str], Meaning]:
    """Return what fields mean, each a channel, "-" before one whose axis points away; a topic's own, in order."""
    return {
        (topic, field): Meaning(channel=name.lstrip("-"), unit=unit, sign=-1.0 if name.startswith("-") else 1.0)
        for field, name in zip(fields.split(), channels.split(), strict=True)
    }


def _numbered(topic: str, field: str, channels: str, unit: str) -> dict[tuple[str, str], Meaning]:
    return _axes(topic, " ".join(field.format(axis) for axis in range(3)), channels, unit)


PX4: Documented = {
    **_numbered("sensor_combined", "gyro_rad[{}]", "p q r", "rad/s"),
    **_numbered("sensor_combined", "accelerometer_m_s2[{}]", "nx ny -nz", "m/s2"),
    **_numbered("vehicle_angular_velocity", "xyz[{}]", "p q r", "rad/s"),
    **_axes("vehicle_attitude", "rollspeed pitchspeed yawspeed", "p q r", "rad/s"),  # until 2018, less biases
    **_numbered("vehicle_acceleration", "xyz[{}]", "nx ny -nz", "m/s2"),
    **{
        ("vehicle_attitude", f"q({angle})"): Meaning(channel=channel, unit="deg")
        for angle, channel in zip(ANGLES, ATTITUDE, strict=True)
    },
    **_axes("actuator_controls_0", "control[0] control[1] control[2]", "-aileron -elevator -rudder", "throw"),
    ("actuator_controls_0", "control[3]"): Meaning(channel="throttle", unit="norm"),
    **_axes("vehicle_torque_setpoint", "xyz[0] xyz[1] xyz[2]", "-aileron -elevator -rudder", "throw"),
    ("vehicle_thrust_setpoint", "xyz[0]"): Meaning(channel="throttle", unit="norm"),
    ("airspeed_validated", "true_airspeed_m_s"): Meaning(channel="tas", unit="m/s"),
    ("airspeed", "true_airspeed_m_s"): Meaning(channel="tas", unit="m/s"),
    ("vehicle_global_position", "alt"): Meaning(channel="altitude", unit="m"),
    ("vehicle_air_data", "baro_alt_meter"): Meaning(channel="altitude", unit="m"),
}
ARDUPILOT: Documented = {
    **_axes("IMU", "GyrX GyrY GyrZ", "p q r", "rad/s"),
    **_axes("IMU", "AccX AccY AccZ", "nx ny -nz", "m/s/s"),
    **_axes("ATT", "Roll Pitch Yaw", "phi theta psi", "deg"),
    **_axes("AOA", "AOA SSA", "alpha beta", "deg"),
    **_axes("AETR", "Ail Elev Rudd", "-aileron -elevator -rudder", "cdeg"),
    ("AETR", "Thr"): Meaning(channel="throttle", unit="%"),
    ("POS", "Alt"): Meaning(channel="altitude", unit="m"),
    ("GPS", "Alt"): Meaning(channel="altitude", unit="m"),
}
MAVLINK: Documented = {
    **_axes("HIGHRES_IMU", "xgyro ygyro zgyro", "p q r", "rad/s"),
    **_axes("HIGHRES_IMU", "xacc yacc zacc", "nx ny -nz", "m/s/s"),
    **_axes("SCALED_IMU", "xgyro ygyro zgyro", "p q r", "mrad/s"),
    **_axes("SCALED_IMU", "xacc yacc zacc", "nx ny -nz", "mg"),
    **_axes("RAW_IMU", "xgyro ygyro zgyro", "p q r", "mrad/s"),  # of ArduPilot; others' are as they come
    **_axes("RAW_IMU", "xacc yacc zacc", "nx ny -nz", "mg"),
    **_axes("ATTITUDE", "rollspeed pitchspeed yawspeed", "p q r", "rad/s"),
    **_axes("ATTITUDE", "roll pitch yaw", "phi theta psi", "rad"),
    **_axes("AOA_SSA", "AOA SSA", "alpha beta", "deg"),
    ("VFR_HUD", "alt"): Meaning(channel="altitude", unit="m"),
    ("GLOBAL_POSITION_INT", "alt"): Meaning(channel="altitude", unit="mm"),
}
ALL: Documented = {**PX4, **ARDUPILOT, **MAVLINK}
