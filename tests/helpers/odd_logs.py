"""Forty logs as loggers, spreadsheets and scripts leave them, of one flight: names, units, clocks and layouts.

Most headers follow public documentation and code: OnSpeed, WitMotion, INAV's and Betaflight's blackbox_decode, OpenLog
Artemis, MetaWear, X-Plane, Sense HAT, AppLift, LPMS, Shimmer, SensorLog, Sensor Logger, Crazyflie's client, SparkFun's
Razor, AiM, a GoPro's telemetry, RaceBox, MEMS Studio.
"""

import numpy as np
import pandas as pd

from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.turning import quaternions

START = pd.Timestamp("2026-05-04 11:59:50.020")
RAD = np.pi / 180.0
SIX = (*GYROS, *ATTITUDE)
GX = ("gx", "gy", "gz", "roll", "pitch", "yaw")
# how those begin that hold gyros alone, or with a heading only
ALONE = ("OpenLog Artemis", "MetaWear", "deg, and gyros alone", "Shimmer", "Sensor Logger", "Betaflight", "AiM")
ALONE = (*ALONE, "GoPro", "MEMS Studio", "RaceBox")


def stamps(t, how):
    return [(START + pd.Timedelta(seconds=s)).strftime(how)[:-3] for s in t.time_s]


def frame(t, names, rate=1.0, angle=1.0):
    factors = (*(rate,) * 3, *(angle,) * 3)
    return {name: t[own] * by for name, own, by in zip(names, SIX, factors, strict=False)}


def numbered(t, per_second, first=0):
    return np.round(first + t.time_s * per_second).astype(np.int64)


# of each: what it is, and its columns
ODD = {
    "OnSpeed: no heading": lambda t: {
        "timeStamp": numbered(t, 1e3, 81_234),
        "imuTemp": 40.1,
        **frame(t, ("RollRate", "PitchRate", "YawRate")),
        "Pitch": t.theta,
        "Roll": t.phi,
    },
    "WitMotion: a name and a temperature beside": lambda t: {
        "time": stamps(t, "%Y-%m-%dT%H:%M:%S.%f"),
        "DeviceName": "HC-06(00:0C:BF:19:3F:0D)",
        **frame(t, ("AsX(°/s)", "AsY(°/s)", "AsZ(°/s)", "AngleX(°)", "AngleY(°)", "AngleZ(°)")),
        "T(°)": 33.1,
    },
    "INAV: tenths of a degree": lambda t: {
        "loopIteration": numbered(t, 16),
        "time (us)": numbered(t, 1e6, 41_512_387),
        **frame(t, [f"gyroADC[{k}]" for k in range(3)]),
        **{f"attitude[{k}]": np.round(10 * (t[name] % 360 if k == 2 else t[name])) for k, name in enumerate(ATTITUDE)},
    },
    "OpenLog Artemis: date and time in two columns, gyros alone": lambda t: {
        "rtcDate": stamps(t, "%m/%d/%Y000"),
        "rtcTime": stamps(t, "%H:%M:%S.%f"),
        **frame(t, ("gX", "gY", "gZ")),
    },
    "MetaWear: three times, gyros alone": lambda t: {
        "epoch (ms)": numbered(t, 1e3, 1_714_564_800_000),
        "time (01:00)": stamps(t, "%Y-%m-%dT%H:%M:%S.%f"),
        "elapsed (s)": t.time_s,
        **frame(t, ("x-axis (deg/s)", "y-axis (deg/s)", "z-axis (deg/s)")),
    },
    "X-Plane: three times, Q before P": lambda t: {
        "_real,_time": t.time_s + 12.5,
        "_totl,_time": t.time_s + 100.0,
        "____Q,rad/s": t.q * RAD,
        "____P,rad/s": t.p * RAD,
        "____R,rad/s": t.r * RAD,
        "pitch,__deg": t.theta,
        "_roll,__deg": t.phi,
        "hding,_true": t.psi % 360,
    },
    "Sense HAT: all angles from 0 to 360": lambda t: {
        "temp": 24.1,
        **{name: t[own] % 360 for name, own in (("yaw", "psi"), ("pitch", "theta"), ("roll", "phi"))},
        **frame(t, ("gyro_x", "gyro_y", "gyro_z"), RAD),
        "datetime": stamps(t, "%Y-%m-%d %H:%M:%S.%f"),
    },
    "whole seconds only": lambda t: {"timestamp": stamps(t, "%Y-%m-%dT%H:%M:%S000"), **frame(t, GX)},
    "an index that pandas saved": lambda t: {"": stamps(t, "%Y-%m-%d %H:%M:%S.%f"), **frame(t, GX)},
    "durations that pandas saved": lambda t: {
        "": [f"0 days 00:{int(s // 60):02d}:{s % 60:09.6f}" for s in t.time_s],
        **frame(t, GX, RAD, RAD),
    },
    "numbers that pandas saved, beside a time": lambda t: {"": range(len(t)), "t": numbered(t, 1e3), **frame(t, GX)},
    "days first": lambda t: {"Time": stamps(t, "%d.%m.%Y %H:%M:%S.%f"), **frame(t, GX)},
    "12 hours over noon": lambda t: {
        "time": [f"{clock} {half}" for clock, half in zip(stamps(t, "%I:%M:%S.%f"), stamps(t, "%p000"), strict=True)],
        **frame(t, GX),
    },
    "MATLAB's seconds": lambda t: {"Time": [f"{s:.2f} sec" for s in t.time_s], **frame(t, GX, RAD, 1.0)},
    "days of a spreadsheet": lambda t: {"Date/Time": 46_146.4309 + t.time_s / 86_400.0, **frame(t, GX)},
    "hundredths of a degree": lambda t: {"time_us": numbered(t, 1e6, 10_000_000), **frame(t, GX, RAD, 100.0)},
    "rad, with an attitude that is too calm in deg": lambda t: {"t": t.time_s, **frame(t, GX, RAD, RAD)},
    "deg, and gyros alone": lambda t: {"t": t.time_s, **frame(t, ("gx", "gy", "gz"))},
    # the second half
    "LPMS: a space before each name": lambda t: {
        "SensorId": 1,
        " TimeStamp (s)": t.time_s + 3.0,
        " FrameNumber": numbered(t, 50),
        **frame(
            t, [f" {name}{axis} ({unit})" for name, unit in (("Gyro", "deg/s"), ("Euler", "deg")) for axis in "XYZ"]
        ),
    },
    "Crazyflie: y to the left, z up, and pitch turned": lambda t: {
        "Timestamp": numbered(t, 1e3, 61_000),
        "stabilizer.roll": t.phi,
        "stabilizer.pitch": t.theta,
        "stabilizer.yaw": -t.psi,
        "gyro.x": t.p,
        "gyro.y": -t.q,
        "gyro.z": -t.r,
    },
    "SensorLog: a phone whose x points to the right": lambda t: {
        "loggingTime(txt)": [f"{stamp}+02:00" for stamp in stamps(t, "%Y-%m-%dT%H:%M:%S.%f")],
        "loggingSample(N)": range(len(t)),
        "motionTimestamp_sinceReboot(s)": 405_121.25 + t.time_s,
        "motionYaw(rad)": -t.psi * RAD,
        "motionRoll(rad)": t.phi * RAD,
        "motionPitch(rad)": t.theta * RAD,
        "motionRotationRateX(rad/s)": t.q * RAD,
        "motionRotationRateY(rad/s)": t.p * RAD,
        "motionRotationRateZ(rad/s)": -t.r * RAD,
    },
    "GPS week and time of week": lambda t: {"week": 2313, "tow_ms": numbered(t, 1e3, 129_590_020), **frame(t, GX)},
    "seconds of the day": lambda t: {"UTC_sod": 43_190.02 + t.time_s, **frame(t, GX)},
    "a quaternion, and nanoseconds since 1970": lambda t: {
        "stamp_ns": numbered(t, 1e9, 1_714_564_800_000_000_000),
        **dict(zip(("qw", "qx", "qy", "qz"), quaternions(t[[*ATTITUDE]].to_numpy()).T, strict=True)),
        **frame(t, ("wx", "wy", "wz"), RAD),
    },
    "powers in units": lambda t: {
        "t [s]": t.time_s,
        **frame(t, [f"ω_{axis} [rad·s⁻¹]" for axis in "xyz"], RAD),
        **{f"{name} [rad]": t[own] * RAD for name, own in zip("φθψ", ATTITUDE, strict=True)},
    },
    "MATLAB's days": lambda t: {"datenum": 740_106.4998 + t.time_s / 86_400.0, **frame(t, GX)},
    "milliradians": lambda t: {
        "time_s": t.time_s,
        **frame(t, [f"{name} (mrad/s)" for name in ("roll rate", "pitch rate", "yaw rate")], 1e3 * RAD),
        **{f"{name} (mrad)": 1e3 * RAD * t[own] for name, own in zip(("roll", "pitch", "yaw"), ATTITUDE, strict=True)},
    },
    "hours, minutes, seconds and milliseconds in columns": lambda t: {
        "Hour": stamps(t, "%H000"),
        "Minute": stamps(t, "%M000"),
        "Second": stamps(t, "%S000"),
        "Ms": [int(stamp) // 1000 for stamp in stamps(t, "%f000")],
        **frame(t, GX),
    },
    "a date and time without marks": lambda t: {"time": stamps(t, "%Y%m%dT%H%M%S.%f"), **frame(t, GX)},
    "Sensor Logger: z before y before x, gyros alone": lambda t: {
        "time": numbered(t, 1e9, 1_714_564_800_000_000_000),
        "seconds_elapsed": t.time_s + 0.07,
        **{axis: t[own] * RAD for axis, own in (("z", "r"), ("y", "q"), ("x", "p"))},
    },
    "GoPro: z before x before y, gyros alone": lambda t: {
        "cts": t.time_s * 1e3 + 12.5,
        "date": [f"{stamp}Z" for stamp in stamps(t, "%Y-%m-%dT%H:%M:%S.%f")],
        **{f"Gyroscope ({axis}) [rad/s]": t[own] * RAD for axis, own in (("z", "r"), ("x", "p"), ("y", "q"))},
        "temperature [°C]": 41.5,
    },
    "MEMS Studio: thousandths of a degree per second, gyros alone": lambda t: {
        "Time [s]": t.time_s,
        **{f"A_{axis} [mg]": value for axis, value in zip("XYZ", (0.0, 0.0, -1000.0), strict=True)},
        **frame(t, [f"G_{axis} [mdps]" for axis in "XYZ"], 1000.0),
    },
}


def _betaflight(t, path):
    head = '"Product","Blackbox flight data recorder"\n"firmwareType","Cleanflight"\n"looptime","125"\n'
    names = ["loopIteration", "time", *(f"gyroADC[{k}]" for k in range(3)), *(f"accSmooth[{k}]" for k in range(3))]
    rows = np.column_stack(
        [numbered(t, 50), numbered(t, 1e6, 7_100_000), t.p, -t.q, -t.r, 0 * t.p, 0 * t.p, 2048 + 0 * t.p]
    )
    _write(path, head + ",".join(f'"{name}"' for name in names) + "\n", rows, ",")


def _shimmer(t, path):
    names = ["Timestamp_Unix_CAL", *(f"Gyro_{axis}_CAL" for axis in ["X", "Y", "Z"])]
    units = "\t".join(["ms", *["deg/s"] * 3])
    head = "sep=\\t\n" + "\t".join(f"Shimmer_4A2B_{name}" for name in names) + f"\t\n{units}\t\n"
    _write(path, head, np.column_stack([numbered(t, 1e3, 1_714_564_800_000), t.p, t.q, t.r]), "\t", end="\t")


def _aim(t, path):
    head = '"Format","AiM CSV File"\n"Session","Field"\n"Sample Rate","50"\n\n"Time","RollRate","PitchRate","YawRate"\n'
    _write(path, head + '"s","deg/s","deg/s","deg/s"\n\n', np.column_stack([t.time_s, t.p, t.q, t.r]), ",")


def _racebox(t, path):
    head = (
        "Format,RaceBox CSV\nTrack,Field\n\nRecord,Time,GForceX (g),Heading,GyroX (deg/s),GyroY (deg/s),GyroZ (deg/s)\n"
    )
    times = [f"{stamp}Z" for stamp in stamps(t, "%Y-%m-%dT%H:%M:%S.%f")]
    rows = zip(range(1, len(t) + 1), times, 0 * t.p, t.psi % 360, t.p, t.q, t.r, strict=True)
    path.write_text(head + "".join(",".join(map(str, row)) + "\n" for row in rows))


def _razor(t, path):
    _write(path, "", np.column_stack([numbered(t, 1e3, 812), t.p, t.q, t.r, t.theta, t.phi, t.psi % 360]), ",")


def _german(t, path):
    turn, angle = ([f"Drehrate {axis} [°/s]" for axis in "XYZ"], [f"{of}winkel [°]" for of in ("Roll", "Nick", "Gier")])
    table = pd.DataFrame({"Zeit [s]": t.time_s, **frame(t, [*turn, *angle])})
    table.to_csv(path, index=False, sep=";", decimal=",", encoding="latin-1")


def _two_headers(t, path):
    head = "t,gyro,gyro,gyro,attitude,attitude,attitude\ns,x,y,z,roll,pitch,yaw\n"
    _write(path, head, np.column_stack([t.time_s, *(t[name] for name in SIX)]), ",")


def _savetxt(t, path):
    np.savetxt(path, np.column_stack([t.time_s, *(t[name] for name in SIX)]), header="t p q r phi theta psi")


WRITTEN = {
    "Betaflight: facts above the table, gyros alone": _betaflight,
    "Shimmer: units below the names, gyros alone": _shimmer,
    "AiM: facts above and units below the names, gyros alone": _aim,
    "RaceBox: facts above, and a heading beside the gyros": _racebox,
    "Razor: no header": _razor,
    "German names, semicolons and decimal commas": _german,
    "two lines of names": _two_headers,
    "numpy's savetxt": _savetxt,
}


def _write(path, head, rows, separator, end=""):
    lines = (separator.join(f"{value:.15g}" for value in row) + end for row in rows.tolist())
    path.write_text(head + "\n".join(lines) + "\n")


def saved(columns, path):
    table = pd.DataFrame(columns)
    table.to_csv(path, index=False, header=["" if name == "" else name for name in table], float_format="%.15g")
    return path


def written(name, t, path):
    """Write one of the forty, and return its path."""
    if name in ODD:
        return saved(ODD[name](t), path)
    WRITTEN[name](t, path)
    return path


ALL = (*ODD, *WRITTEN)
