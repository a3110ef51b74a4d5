"""`gtmbench monitor LOG --list`: what a log holds and allows, on one screen; no column spoils the others'."""

import json
import re

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.intake.contents import log_contents
from gtmbench.report.words.listing import listing_lines
from tests.helpers import intake_files as files
from tests.helpers.clocked_logs import ATTITUDE, FORMATS, GYRO, messages, write
from tests.helpers.night import by_day

SCREENS = [(80, 24), (120, 40)]


def many_topics(path, topics=40, fields=50):
    """A ULog of two thousand columns, as an autopilot's, with what no reader can use."""
    sent = messages(duration_s=20.0)
    write("log.ulg", sent, path.parent)
    rows = [(20_000 * k, *np.full(fields, 0.1 * k)) for k in range(30)]
    stamped = {
        "vehicle_angular_velocity": (["float[3] xyz"], _rows(sent["gyro"], np.radians)),
        "sensor_gyro#1": (["float[3] xyz"], _rows(sent["gyro"], np.radians)),
        "vehicle_air_data": (["float baro_alt_meter"], [(1_000_000 * k, 10.0 * k) for k in range(7)]),
    }
    others = {f"topic_{number}": ([f"float[{fields}] value"], rows) for number in range(topics)}
    path.write_bytes(files.ulog({**stamped, **others}))
    return path


def _rows(message, turned):
    return [(round(t * 1e6), *row) for t, row in zip(message.time_s, turned(message.values), strict=True)]


@pytest.mark.parametrize(("columns", "rows"), SCREENS)
@pytest.mark.parametrize("name", by_day(FORMATS, 3, seed=78))
def test_every_format_fits_a_screen(name, columns, rows, tmp_path):
    path, mapping = write(name, messages(duration_s=20.0), tmp_path)
    contents = log_contents(path, mapping=mapping)
    lines = listing_lines(contents, columns)
    assert set(contents.usable) >= {*GYRO, *ATTITUDE}
    assert len(lines) <= rows - 2
    assert max(map(len, lines)) <= columns
    gyros, attitude = (next(line for line in lines if line.startswith(kind)) for kind in ("gyros", "attitude"))
    assert re.search(r"p q r +100 Hz", gyros)
    assert re.search(r"phi theta psi +50 Hz", attitude)


@pytest.mark.parametrize(("columns", "rows"), SCREENS)
def test_two_thousand_columns_fit_a_screen(columns, rows, tmp_path):
    contents = log_contents(many_topics(tmp_path / "big.ulg"))
    assert len(contents.columns) > 2000
    lines = listing_lines(contents, columns)
    assert len(lines) <= rows - 2
    assert max(map(len, lines)) <= columns
    assert contents.usable == GYRO
    text = " ".join(lines)
    assert "(altitude)" in text
    assert "'vehicle_air_data.baro_alt_meter' holds 7 samples" in text
    assert contents.imus == ("sensor_gyro#1",)
    assert "bank auto: no, it" in text


def test_every_bank_that_it_offers_can_watch_the_log_and_no_other(tmp_path, cli):
    sent = messages(duration_s=40.0, attitude_hz=100)
    write("log.csv", sent, tmp_path)
    contents = log_contents(tmp_path / "log.csv")
    (offered,) = [line for line in listing_lines(contents, 300) if line.startswith("with --detector")]
    names = offered.partition("bank ")[2].split(", ")
    assert "C" in names
    assert "B" not in names
    for name in ("C", "B"):
        code, _, err = cli("monitor", str(tmp_path / "log.csv"), "--detector", name, "--healthy", "0:20")
        assert (code == 2) == (name not in names), err


def test_what_is_mapped_shows(tmp_path, cli):
    time_s = np.arange(0, 20, 0.02)
    frame = pd.DataFrame({"t": time_s, "wx": np.sin(time_s), "theta_deg": np.cos(time_s)})
    frame.to_csv(tmp_path / "log.csv", index=False)
    path = str(tmp_path / "log.csv")
    code, out, _ = cli("monitor", path, "--list")
    assert code == 0
    assert "time: column 't' in s, by its steps of 0.02" in " ".join(out.split())
    assert "open: 'wx' looks like p" in " ".join(out.split())
    code, out, _ = cli("monitor", path, "--list", "--map", "time=t:s", "--map", "p=wx:rad/s", "--map", "psi=theta_deg")
    assert code == 0
    assert re.search(r"gyros +p +50 Hz +wx", out)
    assert re.search(r"attitude +theta psi +50 Hz +theta_deg", out)
    assert "open:" not in out
    listed = json.loads(cli("monitor", path, "--list", "--json", "--map", "time=t:s", "--map", "p=wx:rad/s")[1])
    assert [(each["name"], each["column"], each["samples"]) for each in listed["channels"]] == [
        ("p", "wx", 1000),
        ("theta", "theta_deg", 1000),
    ]


def test_a_repeated_attitude_is_told_with_both_rates(tmp_path):
    record = gb.open_log(*write("log.csv", messages(duration_s=20.0, attitude_hz=100), tmp_path)[:1]).segments[0]
    held = record.matrix(ATTITUDE)[np.arange(len(record)) // 5 * 5]
    for name, column in zip(ATTITUDE, held.T, strict=True):
        record = record.replace(name, column)
    gb.write_log(record, tmp_path / "held.csv")
    contents = log_contents(tmp_path / "held.csv")
    rates = {each.name: (round(each.logged_hz, 6), round(each.fresh_hz, 6)) for each in contents.channels}
    assert rates["phi"] == (100.0, 20.0)
    assert rates["p"] == (100.0, 100.0)
    assert any("20 Hz (logged at 100)" in line for line in listing_lines(contents, 80))


def test_stamps_that_are_all_zero_are_one_channels_own_matter(tmp_path):
    """As of a GPS that never had a fix."""
    stamps = [*[0] * 7, 590_839_200_000, 0]
    fixes = [(100_000 * k, stamp, 10.0) for k, stamp in enumerate(stamps)]
    gyros = [(20_000 * k, *np.sin([0.1 * k, 0.2 * k, 0.3 * k])) for k in range(1000)]
    tables = {"IMU": ("Qfff", "TimeUS,GyrX,GyrY,GyrZ", gyros), "GPS": ("Qf", "TimeUS,Alt", fixes)}
    (tmp_path / "log.bin").write_bytes(files.dataflash(tables))
    told = {each.name: each for each in log_contents(tmp_path / "log.bin").channels}
    assert told["altitude"].why_not
    assert np.isnan(told["altitude"].fresh_hz)
    assert told["p"].fresh_hz > 0.0
