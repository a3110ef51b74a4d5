"""Logs as loggers, spreadsheets and scripts leave them: read without a question where one reading fits, else asked.

The flight is the same everywhere, so that what is read is known.
"""

import re

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.values.channels import GYROS
from tests.helpers.log_makers import flight
from tests.helpers.night import by_day
from tests.helpers.odd_logs import ALL, GX, ODD, RAD, SIX, START, frame, numbered, saved, written

# their y points to the left and z up: read so, and alike, for nothing shows which way is down
LEFT_AND_UP = ("Crazyflie: y to the left, z up, and pitch turned", "Betaflight: facts above the table, gyros alone")
# what no reading of the log alone settles, and how the question begins
ASKED = {
    "SensorLog: a phone whose x points to the right": "two readings fit alike: --map 'p=",
    "Sensor Logger: z before y before x, gyros alone": "nothing looks like p, q or r: --map p=",
    "Razor: no header": "no header: columns are called by their numbers, as in --map",
    "two lines of names": "nothing looks like p, q or r",
}


@pytest.fixture(scope="module")
def truth():
    """A minute, the first 10 s at rest, with gyros and angles that are noisy."""
    table = flight(50.0)
    table = pd.concat([table.iloc[[0]].assign(p=0.0, q=0.0, r=0.0)] * 500 + [table], ignore_index=True)
    noise = np.random.default_rng(69).standard_normal((len(table), 6)) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.01]
    table[list(SIX)] += noise
    return table.assign(time_s=np.arange(len(table)) / 50.0)


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


@pytest.mark.parametrize("case", by_day([case for case in ALL if case not in ASKED], 10))
def test_an_odd_log_is_read_without_a_question(tmp_path, truth, case):
    of_axes = truth.assign(**{name: -truth[name] for name in ("q", "r", "theta", "psi") if case in LEFT_AND_UP})
    check(gb.open_log(written(case, truth, tmp_path / "log.csv")), of_axes)


@pytest.mark.parametrize("case", ASKED)
def test_what_nothing_settles_is_asked(tmp_path, truth, case):
    with pytest.raises(gb.InputError, match=re.escape(ASKED[case])):
        gb.open_log(written(case, truth, tmp_path / "log.csv"), needs=GYROS)


@pytest.fixture(scope="module")
def flown():
    """Three minutes of a simulated flight, healthy, and with a pitch gyro that breaks."""
    flight = gb.fly(excitation="multisine+turbulence", duration_s=180, seed=11)
    record = gb.decimate(gb.measure(flight, noise="t2", seed=11), 2).select(SIX)
    broken = gb.inject(record, gb.Bias(channel="q", onset_s=110.0, size=5.0))
    tables = [each.frame().reset_index() for each in (record, broken)]
    return [table.assign(time_s=table.time_s - table.time_s[0]) for table in tables]


@pytest.mark.nightly
@pytest.mark.parametrize("case", [case for case in ALL if case not in ASKED])
def test_an_odd_log_gets_a_verdict_and_nobody_healthy_is_accused(tmp_path, flown, case):
    """Gyros alone tell no fault from a new motion: they end with 3, and with the size that would show."""
    codes = []
    for name, table in zip(("healthy", "broken"), flown, strict=True):
        watched = gb.watch_log(written(case, table, tmp_path / f"{name}.csv"), "auto")
        assert {sensor for sensor, _ in watched.verdict.failed} <= {"q"}
        codes.append(watched.verdict.exit_code)
    assert codes == ([0, 1] if {"phi", "theta"} <= set(watched.log.channels) else [3, 3])


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
