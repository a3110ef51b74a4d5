"""Logs as loggers, spreadsheets and scripts leave them: read without a question where one reading fits, else asked.

Most headers follow public documentation and code: OnSpeed, WitMotion, INAV's and Betaflight's blackbox_decode, OpenLog
Artemis, MetaWear, X-Plane, Sense HAT, AppLift. The flight is the same everywhere, so that what is read is known.
"""

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.log_makers import flight

START = pd.Timestamp("2026-05-04 11:59:50.020")
G = 9.80665
SIX = (*GYROS, *ATTITUDE)


@pytest.fixture(scope="module")
def truth():
    """A minute, the first 10 s at rest, with gyros and angles that are noisy."""
    table = flight(50.0)
    table = pd.concat([table.iloc[[0]].assign(p=0.0, q=0.0, r=0.0)] * 500 + [table], ignore_index=True)
    noise = np.random.default_rng(69).standard_normal((len(table), 6)) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.01]
    table[list(SIX)] += noise
    return table.assign(time_s=np.arange(len(table)) / 50.0)


def stamps(truth, how):
    return [(START + pd.Timedelta(seconds=s)).strftime(how)[:-3] for s in truth.time_s]


def frame(truth, names, rate=1.0, angle=1.0):
    factors = (*(rate,) * 3, *(angle,) * 3)
    return {name: truth[own] * by for name, own, by in zip(names, SIX, factors, strict=False)}


def numbered(truth, per_second, first=0):
    return np.round(first + truth.time_s * per_second).astype(np.int64)


GX = ("gx", "gy", "gz", "roll", "pitch", "yaw")
RAD = np.pi / 180.0
# of each: what it is, the header and columns, and how it is written
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
}


def saved(columns, path):
    table = pd.DataFrame(columns)
    table.to_csv(path, index=False, header=["" if name == "" else name for name in table], float_format="%.12g")
    return path


def check(log, truth):
    """Whatever is read is the truth, in its unit, with its sign, when it was; and gyros are read."""
    (record,) = log.segments
    assert set(GYROS) <= set(record.channels)
    assert record.end_s - record.start_s == pytest.approx(truth.time_s.iloc[-1], abs=1.1)
    for name in set(SIX) & set(record.channels):
        expected = np.interp(record.time_s - record.start_s, truth.time_s, truth[name])
        read = record[name] - (360.0 * np.round((record[name] - expected).mean() / 360.0) if name == "psi" else 0.0)
        off, spread = np.std(read - expected), np.std(expected)
        assert off < (0.35 if len(record) < len(truth) or "timestamp" in log.sources[-1].column else 0.05) * spread, (
            name
        )


@pytest.mark.parametrize("case", ODD)
def test_an_odd_log_is_read_without_a_question(tmp_path, truth, case):
    log = gb.open_log(saved(ODD[case](truth), tmp_path / "log.csv"))
    check(log, truth)


@pytest.mark.parametrize("index", ["dates", "durations"])
def test_the_index_of_a_frame_in_parquet_is_its_time(tmp_path, truth, index):
    since = pd.to_timedelta(np.round(truth.time_s * 1e6), unit="us")
    table = pd.DataFrame(frame(truth, GX, RAD, 1.0)).set_index(since if index == "durations" else START + since)
    table.to_parquet(tmp_path / "log.parquet")
    check(gb.open_log(tmp_path / "log.parquet"), truth)


def test_dates_in_a_workbook_are_its_time(tmp_path, truth):
    dates = START + pd.to_timedelta(np.round(truth.time_s[:1500] * 1e3), unit="ms")
    table = pd.DataFrame({"Time": dates, **{name: values[:1500] for name, values in frame(truth, GX).items()}})
    table.to_excel(tmp_path / "log.xlsx", index=False)
    check(gb.open_log(tmp_path / "log.xlsx"), truth[:1500])


def test_a_guess_is_told_with_what_shows_it(tmp_path, truth):
    log = gb.open_log(saved(ODD["deg, and gyros alone"](truth), tmp_path / "log.csv"))
    assert {source.unit for source in log.sources if source.channel in GYROS} == {"deg/s"}
    assert all("readings up to" in source.guessed for source in log.sources if source.channel in GYROS)


@pytest.mark.parametrize("factor", [0.2, RAD, 0.003])
def test_what_rad_and_deg_both_allow_is_asked_for_by_one_option(tmp_path, truth, factor):
    """Readings up to 10 may be a calm flight in deg/s or a wild one in rad/s; up to 1 a rest or a flight."""
    path = saved({"t": truth.time_s, **frame(truth, ("gx", "gy", "gz"), factor)}, tmp_path / "log.csv")
    with pytest.raises(gb.InputError, match="gx, gy, gz may be in rad/s or in deg/s: --units rad or --units deg"):
        gb.open_log(path, needs=GYROS)
    log = gb.open_log(path, mapping=["units=deg"], needs=GYROS)
    assert np.std(log.segments[0]["p"]) == pytest.approx(np.std(truth.p * factor), rel=0.01)


def test_times_that_disagree_are_asked_for(tmp_path, truth):
    columns = {"time_ms": numbered(truth, 1e3), "t_s": 2.0 * truth.time_s, **frame(truth, GX)}
    with pytest.raises(gb.InputError, match="'time_ms' and 't_s' both tell the time, and not the same; choose: --map"):
        gb.open_log(saved(columns, tmp_path / "log.csv"))


def test_swapped_axes_are_never_read_left_handed(tmp_path, truth):
    """A phone's x points to the right, its y ahead and its z up or down: two readings fit, and both are typed."""
    columns = {
        "t_s": truth.time_s,
        "rotation_x [rad/s]": truth.q * RAD,
        "rotation_y [rad/s]": truth.p * RAD,
        "rotation_z [rad/s]": -truth.r * RAD,
        "motion roll [rad]": truth.phi * RAD,
        "motion pitch [rad]": truth.theta * RAD,
        "motion yaw [rad]": -truth.psi * RAD,
    }
    with pytest.raises(gb.InputError, match="two readings fit alike") as refused:
        gb.open_log(saved(columns, tmp_path / "log.csv"), needs=GYROS)
    for p, q, r in (("rotation_y", "rotation_x", "-rotation_z"), ("rotation_y", "-rotation_x", "rotation_z")):
        assert all(f"{name}={column} [" in str(refused.value) for name, column in zip(GYROS, (p, q, r), strict=True))


def test_gyros_alone_are_watched_and_never_accused_where_they_are_healthy(tmp_path, truth):
    watched = gb.watch_log(saved(ODD["deg, and gyros alone"](truth), tmp_path / "log.csv"), "auto")
    assert watched.verdict.exit_code in (0, 3)
    assert set(GYROS) <= set(watched.verdict.timeline.sensors)
