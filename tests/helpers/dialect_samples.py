"""One flight as each known source writes it: rows made from the source's public documentation, never anybody's file.

Most were written before the readers. Each returns what lies in a folder: texts (or tables) by file name. The truth is
the same everywhere: p, q, r in deg/s, phi, theta, psi in deg, nx, ny, nz in g.
"""

import numpy as np
import pandas as pd

from tests.helpers.turning import quaternions

RAD, G = np.pi / 180.0, 9.80665
RATES, ANGLES, FORCES = ("p", "q", "r"), ("phi", "theta", "psi"), ("nx", "ny", "nz")
FLU = (1.0, -1.0, -1.0)  # of axes that point forward, left and up
SAMPLES = {}


def sample(function):
    SAMPLES[function.__name__] = function
    return function


def scaled(t, channels, names, factor=1.0, signs=(1.0, 1.0, 1.0)):
    return {name: t[own] * factor * sign for own, name, sign in zip(channels, names, signs, strict=True)}


def xyz(pattern):
    return [pattern.format(axis) for axis in "xyz"]


def forces(t, names, factor=1.0, *, up=False):
    """Specific force: along forward, right, down; or along forward, left, up."""
    return scaled(t, FORCES, names, factor, (1.0, -1.0, 1.0) if up else (1.0, 1.0, -1.0))


def quaternion(t, up=""):
    """w, x, y, z from forward, right, down to north, east, down; or from forward, left, up to NWU or ENU."""
    n = -1.0 if up else 1.0
    turned = quaternions(np.column_stack([t.phi, t.theta, t.psi - 90.0 * (up == "ENU")]))
    return tuple((turned * [1.0, 1.0, n, n]).T)


def turned_by(t, names, up=""):
    return dict(zip(names, quaternion(t, up), strict=True))


def us(t, first=3_000_000):
    return np.round(first + 1e6 * t.time_s).astype(np.int64)


def csv(columns, sep=",", above="", header=True, **options):
    return above + pd.DataFrame(columns).to_csv(sep=sep, index=False, header=header, float_format="%.9g", **options)


@sample
def jsbsim_properties(t):
    """JSBSim's <output> by <property>: names with their units."""
    path = "/fdm/jsbsim/"
    names = [f"{path}velocities/{c}-rad_sec" for c in RATES], [f"{path}attitude/{c}-rad" for c in ANGLES]
    return {"out.csv": csv({"Time": t.time_s, **scaled(t, RATES, names[0], RAD), **scaled(t, ANGLES, names[1], RAD)})}


@sample
def microstrain(t):
    """SensorConnect: facts about the recording, then the table; fields by their descriptors."""
    columns = {"GPS TFlags": 6, "GPS Week": 2200, "GPS TOW": 100_000 + t.time_s}
    columns |= forces(t, [f"{a} Accel [x8004]" for a in "XYZ"])
    columns |= scaled(t, RATES, [f"{a} Gyro [x8005]" for a in "XYZ"], RAD)
    columns |= scaled(t, ANGLES, [f"{a} [x800C]" for a in ("Roll", "Pitch", "Yaw")], RAD)
    return {"imu.csv": csv(columns, above="SESSION_INFO\nFile Type,IMU Data\nData Rate,50\n\nDATA_START\n")}


@sample
def xsens_csv(t):
    """MT Manager's CSV: forward, left, up in east, north, up; SampleTimeFine counts tenths of milliseconds."""
    columns = {"PacketCounter": np.arange(len(t)) % 65536, "SampleTimeFine": np.round(1e4 * t.time_s).astype(int)}
    columns |= forces(t, [f"Acc_{a}" for a in "XYZ"], G, up=True)
    columns |= scaled(t, RATES, [f"Gyr_{a}" for a in "XYZ"], RAD, FLU)
    return {"MT.csv": csv(columns | turned_by(t, [f"Quat_q{k}" for k in range(4)], "ENU"), above="sep=,\n")}


@sample
def xsens_text(t):
    """MT Manager's text: a counter, and the rate in a comment."""
    columns = {"Counter": (65_000 + np.arange(len(t))) % 65536, **forces(t, [f"Acc_{a}" for a in "XYZ"], G, up=True)}
    columns |= scaled(t, RATES, [f"Gyr_{a}" for a in "XYZ"], RAD, FLU)
    columns |= {"Roll": t.phi, "Pitch": -t.theta, "Yaw": 90.0 - t.psi}
    return {"MT.txt": csv(columns, sep="\t", above="// Start Time: Unknown\n// Sample rate: 50.0Hz\n")}


@sample
def euroc(t):
    """EuRoC and other ASL data sets: a folder a sensor."""
    ns = 1_500_000_000_000_000_000 + np.round(1e9 * t.time_s).astype(np.int64)
    imu = {"#timestamp [ns]": ns, **scaled(t, RATES, xyz("w_RS_S_{} [rad s^-1]"), RAD, FLU)}
    imu |= forces(t, xyz("a_RS_S_{} [m s^-2]"), G, up=True)
    truth = {"#timestamp": ns, **dict.fromkeys(xyz(" p_RS_R_{} [m]"), 0.0)}
    truth |= turned_by(t, [f" q_RS_{a} []" for a in "wxyz"], "NWU")
    truth |= dict.fromkeys([*xyz(" b_w_RS_S_{} [rad s^-1]"), *xyz(" b_a_RS_S_{} [m s^-2]")], 0.001)
    return {"mav0/imu0/data.csv": csv(imu), "mav0/state_groundtruth_estimate0/data.csv": csv(truth)}


@sample
def uzh_fpv(t):
    """UZH-FPV: tables between spaces, named in comments; images by their names."""
    imu = {"# id": np.arange(len(t)), "timestamp": 1_540_113_000.0 + t.time_s}
    imu |= scaled(t, RATES, xyz("ang_vel_{}"), RAD, FLU) | forces(t, xyz("lin_acc_{}"), G, up=True)
    w, x, y, z = quaternion(t, "NWU")
    truth = {"# timestamp": imu["timestamp"], "tx": 0.0, "ty": 0.0, "tz": 0.0, "qx": x, "qy": y, "qz": z, "qw": w}
    images = {"# id": [0, 1, 2], "timestamp": [0.0, 0.1, 0.2], "image_name": ["img/0.png", "img/1.png", "img/2.png"]}
    tables = {"imu": imu, "groundtruth": truth, "left_images": images}
    return {
        f"{name}.txt": pd.DataFrame(table)
        .to_csv(sep=" ", index=False, float_format="%.12f", quoting=3, escapechar="~")
        .replace("~", "")
        for name, table in tables.items()
    }


@sample
def kitti_oxts(t):
    """KITTI's oxts: a file a sample, 30 numbers by position; roll, pitch, yaw of FLU from east."""
    files = {}
    for k, row in enumerate(t.itertuples()):
        roll, pitch, yaw = RAD * row.phi, -RAD * row.theta, RAD * (90.0 - row.psi)
        f = (G * row.nx, -G * row.ny, G * row.nz)
        w = (RAD * row.p, -RAD * row.q, -RAD * row.r)
        cells = (49.0, 8.4, 112.8, roll, pitch, yaw, 0, 0, 10, 0, 0, *f, *f, *w, *w, 0.1, 0.1, 4, 10, 4, 4, 0)
        files[f"oxts/data/{k:010d}.txt"] = " ".join(f"{cell:.12g}" for cell in cells) + "\n"
    stamps = pd.Timestamp("2011-09-26 13:02:25.964389445") + pd.to_timedelta(t.time_s, unit="s")
    return files | {"oxts/timestamps.txt": "".join(f"{each:%Y-%m-%d %H:%M:%S.%f}\n" for each in stamps)}


@sample
def phyphox(t):
    """Phyphox: a table a sensor, and facts beside."""
    gyroscope = {"Time (s)": t.time_s, **scaled(t, RATES, xyz("Gyroscope {} (rad/s)"), RAD, FLU)}
    attitude = {"Time (s)": t.time_s, **turned_by(t, "wxyz", "NWU")}
    attitude |= scaled(t, ANGLES, ("Roll (°)", "Pitch (°)", "Yaw (°)"), 1.0, FLU)
    return {
        "Gyroscope.csv": csv(gyroscope),
        "Attitude.csv": csv(attitude),
        "meta/device.csv": "property,value\ndeviceModel,none\n",
        "meta/time.csv": "event,experiment time,system time,system time text\nSTART,0,1600000000,2020-09-13\n",
    }


@sample
def plotjuggler(t):
    """PlotJuggler's CSV of a ULog: /topic/field.00."""
    columns = {
        "__time": 50 + t.time_s,
        **scaled(t, RATES, [f"/vehicle_angular_velocity/xyz.0{k}" for k in range(3)], RAD),
    }
    return {"p.csv": csv(columns | turned_by(t, [f"/vehicle_attitude/q.0{k}" for k in range(4)]))}


@sample
def mission_planner(t):
    """Mission Planner's CSV of a tlog: a row a message, names and values by turns."""
    rows = []
    for row in t.itertuples():
        stamp = f"2015-03-03T11:54:{5 + row.time_s % 50:06.3f},FE,1C,7D, 1, 1"
        names = ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed")
        values = (RAD * getattr(row, name) for name in (*ANGLES, *RATES))
        told = ",".join(f"{name},{value:.9g}" for name, value in zip(names, values, strict=True))
        rows.append(f"{stamp},1E,mavlink_attitude_t,time_boot_ms,{490_309 + round(1e3 * row.time_s)},{told},,Len,36")
        hud = f"airspeed,0,groundspeed,0.005,alt,{30 + row.time_s:.3f},climb,0,heading,19,throttle,0"
        rows.append(f"{stamp},4A,mavlink_vfr_hud_t,{hud},,Len,28")
    return {"flight.csv": "\n".join(rows) + "\n"}


@sample
def paparazzi(t):
    """Paparazzi's .data: time, aircraft, message, fields by position; rates in 2^-12 rad/s."""
    rows = []
    for row in t.itertuples():
        raw = " ".join(f"{round(4096 * RAD * getattr(row, name))}" for name in RATES)
        rows.append(f"{row.time_s:.6f} 2 IMU_GYRO_SCALED {raw}")
        rows.append(f"{row.time_s:.6f} 2 AHRS_EULER {RAD * row.phi:.6f} {RAD * row.theta:.6f} {RAD * row.psi:.6f}")
        rows.append(f"{row.time_s:.6f} 2 ALIVE 1,2,3")
    return {"20_12_08__09_18_56.data": "\n".join(rows) + "\n"}


@sample
def sbg(t):
    """SBG's sbgBasicLogger: a text a log between tabs, units below the names."""
    imu = {"timestamp": us(t), "status": 127, **forces(t, ("accelX", "accelY", "accelZ"), G)}
    imu |= scaled(t, RATES, ("gyroX", "gyroY", "gyroZ")) | {"temperature": 30.1}
    euler = {"timestamp": us(t), "status": 127, **scaled(t, ANGLES, ("roll", "pitch", "yaw"))}
    euler |= dict.fromkeys(("rollStd", "pitchStd", "yawStd", "magHeading", "magDecl", "magIncl"), 0.1)
    units = {
        "imuData": "(us) (na)" + 3 * " (m.s^-2)" + 3 * " (deg.s^-1)" + " (degC)",
        "euler": "(us) (na)" + 9 * " (deg)",
    }
    files = {}
    for name, table in {"imuData": imu, "euler": euler}.items():
        header, _, rows = csv(table, sep="\t").partition("\n")
        files[f"{name}.txt"] = f"{header}\n{units[name].replace(' ', chr(9))}\n{rows}"
    return files


@sample
def x_plane(t):
    """X-Plane's Data.txt: between bars, names padded by lines, a unit behind a comma."""
    columns = {"_real,_time": t.time_s + 12.5, "_totl,_time": t.time_s + 100.0}
    columns |= scaled(t, ("q", "p", "r"), ("____Q,rad/s", "____P,rad/s", "____R,rad/s"), RAD)
    columns |= {"pitch,__deg": t.theta, "_roll,__deg": t.phi, "hding,_true": t.psi % 360, "hding,__mag": t.psi % 360}
    header = "|".join(f" {name} " for name in columns)
    rows = csv(columns, sep="|", header=False).replace("\n", "|\n")
    return {"Data.txt": f"\n{header}|\n{rows}"}


@sample
def datcon(t):
    """DatCon's CSV of a DJI log: gyros in deg/s, accelerometers in g, angles worked out in deg."""
    columns = {"Clock:Tick#": us(t), "Clock:offsetTime": t.time_s - 3.2}
    columns |= scaled(t, RATES, [f"IMU_ATTI(0):gyro{a}" for a in "XYZ"])
    columns |= forces(t, [f"IMU_ATTI(0):accel{a}" for a in "XYZ"])
    columns |= scaled(t, ANGLES, [f"IMU_ATTI(0):{a}:C" for a in ("roll", "pitch", "yaw")])
    columns |= scaled(t, RATES, [f"IMU_ATTI(1):gyro{a}" for a in "XYZ"])
    return {"FLY124.csv": csv(columns | {"Attribute|Value": "Firmware|1"})}


@sample
def ngimu(t):
    """NGIMU's and x-io's folder: forward, left, up in north, west, up."""
    inertial = {"Time (s)": t.time_s, **scaled(t, RATES, [f"Gyroscope {a} (deg/s)" for a in "XYZ"], 1.0, FLU)}
    inertial |= forces(t, [f"Accelerometer {a} (g)" for a in "XYZ"], up=True)
    angles = scaled(t, ANGLES, ("Roll (deg)", "Pitch (deg)", "Yaw (deg)"), 1.0, FLU)
    return {
        "sensors.csv": csv(inertial),
        "euler.csv": csv({"Time (s)": t.time_s, **angles}),
        "battery.csv": csv({"Time (s)": t.time_s[::50], "Percentage (%)": 90.0}),
    }


@sample
def vectornav(t):
    """A table of VectorNav's fields: no export of theirs is documented, so it is known by its names and by physics."""
    columns = {"TimeStartup": 1e9 * t.time_s, "Yaw": t.psi, "Pitch": t.theta, "Roll": t.phi}
    columns |= scaled(t, RATES, [["GyroX", "GyroY", "GyroZ"][k] for k in range(3)], RAD)
    return {"vn.csv": csv(columns | forces(t, ("AccelX", "AccelY", "AccelZ"), G))}


@sample
def inav(t):
    """blackbox_decode of INAV and Betaflight: whole deg/s, tenths of degrees, 2048 counts a g."""
    columns = {"loopIteration": np.arange(len(t)) * 20, "time (us)": us(t)}
    columns |= {f"gyroADC[{k}]": t[c].round().astype(int) for k, c in enumerate(RATES)}
    columns |= {
        f"accSmooth[{k}]": np.round(2048 * s * t[c]) for k, (c, s) in enumerate(zip(FORCES, (1, 1, 1), strict=True))
    }
    return {"LOG.csv": csv(columns | {f"attitude[{k}]": (10 * t[c]).round().astype(int) for k, c in enumerate(ANGLES)})}


@sample
def gyroflow(t):
    """GCSV: facts above, among them what a count is; gyros and accelerometers alone."""
    above = "GYROFLOW IMU LOG\nversion,1.3\nid,custom_logger\norientation,XYZ\ntimestamp,1644159993\nvendor,none\n"
    above += "tscale,0.001\ngscale,0.00122173047\nascale,0.00048828125\n"
    columns = {"t": np.round(1e3 * t.time_s).astype(int)}
    columns |= {f"g{a}": np.round(RAD * t[c] / 0.00122173047) for a, c in zip("xyz", RATES, strict=True)}
    columns |= {f"a{a}": np.round(2048 * s * t[c]) for a, c, s in zip("xyz", FORCES, (1, 1, -1), strict=True)}
    return {"video.gcsv": csv(columns, above=above)}


@sample
def rostopic(t):
    """An Imu by rostopic echo -p: every field by its path, in the axes of REP 103."""
    stamp = 1_600_000_000_000_000_000 + np.round(1e9 * t.time_s).astype(np.int64)
    columns = {"%time": stamp + 5_000_000, "field.header.seq": np.arange(len(t)), "field.header.stamp": stamp}
    columns |= turned_by(t, [f"field.orientation.{a}" for a in "wxyz"], "ENU") | {"field.orientation_covariance0": 0.0}
    columns |= scaled(t, RATES, xyz("field.angular_velocity.{}"), RAD, FLU)
    return {"imu.csv": csv(columns | forces(t, xyz("field.linear_acceleration.{}"), G, up=True))}


def dot(t, attitude):
    columns = {"PacketCounter": np.arange(len(t)), "SampleTimeFine": us(t), **attitude}
    columns |= forces(t, [f"Acc_{a}" for a in "XYZ"], G, up=True)
    return {"DOT.csv": csv(columns | scaled(t, RATES, [f"Gyr_{a}" for a in "XYZ"], 1.0, FLU), above="sep=,\n")}


@sample
def dot_euler(t):
    """Movella DOT's export: microseconds, deg/s, angles in east, north, up."""
    return dot(t, {"Euler_X": t.phi, "Euler_Y": -t.theta, "Euler_Z": 90.0 - t.psi})


@sample
def dot_quaternion(t):
    """The same with a quaternion."""
    return dot(t, turned_by(t, [f"Quat_{a}" for a in "WXYZ"], "ENU"))


@sample
def ngimu_quaternion(t):
    """NGIMU's folder without angles: its quaternion is of the world beside the sensor."""
    w, x, y, z = quaternion(t, "NWU")
    turned = {"Time (s)": t.time_s, "W": w, "X": -x, "Y": -y, "Z": -z}
    return {name: text for name, text in ngimu(t).items() if name != "euler.csv"} | {"quaternion.csv": csv(turned)}


@sample
def mission_planner_of_2013(t):
    """The same of an older version: dates as the computer writes them, to a second; the ground station is system FF."""
    began = pd.Timestamp("2013-03-17 12:37:41")
    lines = []
    for line, time_s in zip(mission_planner(t)["flight.csv"].splitlines()[::2], t.time_s, strict=True):
        at = began + pd.Timedelta(time_s, unit="s")
        stamp = f"{at.month}/{at.day}/{at.year} {at:%I:%M:%S %p}"
        lines.append(f"{stamp},{line.partition(',')[2]}")
        if time_s % 1 == 0:
            lines.append(f"{stamp},FE,9,7E,FF,BE,0,mavlink_heartbeat_t,custom_mode,0,type,6,autopilot,8,,Len,17")
    return {"flight.csv": "\n".join(lines) + "\n"}


@sample
def paparazzi_since_2022(t):
    """The same, where a sensor's number stands before its axes; a second one, upside down, is another sensor."""
    rows = []
    for row in t.itertuples():
        rates = [RAD * getattr(row, name) for name in RATES]
        felt = (G * row.nx, G * row.ny, -G * row.nz)
        for sensor, sign in ((1, 1.0), (2, -1.0)):
            rows.append(f"{row.time_s:.6f} 2 IMU_GYRO {sensor} " + " ".join(f"{sign * rate:.6f}" for rate in rates))
            rows.append(f"{row.time_s:.6f} 2 IMU_ACCEL {sensor} " + " ".join(f"{sign * each:.6f}" for each in felt))
        angles = " ".join(f"{round(4096 * RAD * getattr(row, name))}" for name in ANGLES)
        rows.append(f"{row.time_s:.6f} 2 AHRS_EULER_INT 0 0 0 {angles} 1")
    return {"22_12_08__09_18_56.data": "\n".join(rows) + "\n"}


@sample
def datcon_with_units(t):
    """DatCon's CSV until version 3: units behind the names, with semicolons in them."""
    columns = {"Tick#": us(t), "offsetTime": t.time_s + 12.3}
    columns |= forces(t, [f"IMU_ATTI(0):accel:{a}[G]" for a in "XYZ"])
    columns |= scaled(t, RATES, [f"IMU_ATTI(0):gyro:{a}[degrees/Sec]" for a in "XYZ"])
    angles = [f"IMU_ATTI(0):{a}[degrees [-180;180]]" for a in ("roll", "pitch", "yaw")]
    return {"FLY124.csv": csv(columns | scaled(t, ANGLES, angles) | {"Attribute|Value": ""})}


@sample
def datcon_3(t):
    """The same with the units left out."""
    header, _, rows = datcon_with_units(t)["FLY124.csv"].partition("\n")
    plain = [name.partition("[")[0] for name in header.split(",")]
    return {"FLY124.csv": ",".join(plain) + "\n" + rows}


@sample
def vectornav_quaternion(t):
    """The exporter of VectorNav's SDK: fields by its names, none with a unit; QuatS is a quaternion's first part."""
    columns = {"TimeStartup": np.round(1e9 * t.time_s).astype(np.int64) + 7_123_456_789}
    columns |= turned_by(t, [f"Quat{a}" for a in "SXYZ"])
    columns |= scaled(t, RATES, [f"UncompGyro{a}" for a in "XYZ"], RAD)
    return {"vn.csv": csv(columns | forces(t, [f"UncompAcc{a}" for a in "XYZ"], G))}


@sample
def x_plane_again(t):
    """Data.txt of which the output was switched on twice: the header stands there again."""
    lines = x_plane(t)["Data.txt"].splitlines()
    return {"Data.txt": "\n".join([*lines[: len(t) // 2], lines[1], *lines[len(t) // 2 :]]) + "\n"}


@sample
def phyphox_tables(t):
    """Phyphox of another experiment: axes alone beside the tables' names, and what is left without gravity."""
    tables = {
        "Gyroscope": scaled(t, RATES, [f"{a} (rad/s)" for a in "XYZ"], RAD, FLU),
        "Accelerometer": forces(t, [f"{a} (m/s^2)" for a in "XYZ"], G, up=True),
        "Linear Accelerometer": {f"{a} (m/s^2)": 0.1 * t.nx for a in "XYZ"},
    }
    return {f"{name}.csv": csv({"Time (s)": t.time_s, **columns}, sep=";") for name, columns in tables.items()}


@sample
def emlid(t):
    """RTKLIB's .pos, which Emlid writes: facts and the header as comments, one name above a date and a time of day."""
    stamps = pd.Timestamp("2022-08-24 09:12:32") + pd.to_timedelta(t.time_s, unit="s")
    above = "% program   : RTKPOST\n% pos mode  : Kinematic\n%\n%  GPST  latitude(deg) longitude(deg) height(m) Q ns\n"
    rows = [f"{at:%Y/%m/%d %H:%M:%S.%f} 60.1 30.2 {120.0 + k % 7} 1 14\n" for k, at in enumerate(stamps)]
    return {"rover.pos": above + "".join(rows)}
