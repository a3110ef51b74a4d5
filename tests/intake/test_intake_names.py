"""Columns become channels where name and unit leave no doubt; units are never guessed."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.names import guess
from gtmbench.intake.units import unit
from gtmbench.values.channels import CHANNELS

SAMPLES = 300


def table(tmp_path, name="log.csv", separator=",", **columns):
    """Write a CSV of 100 Hz: columns by their headers, "_" in a keyword stands for itself."""
    columns = {"time_s": np.round(np.arange(SAMPLES) * 0.01, 9), **columns}
    lines = [separator.join(columns), *(separator.join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n")
    return path


VALUES = np.random.default_rng(5).standard_normal(SAMPLES)

# every header, the channel it is, and how many of its units are one of the table's
HEADERS = {
    "p_rad_s": ("p", np.degrees(1)),
    "p [rad/s]": ("p", np.degrees(1)),
    "p (deg/s)": ("p", 1),
    "p_dps": ("p", 1),
    "p_deg_s": ("p", 1),
    "P [°/s]": ("p", 1),
    "roll_rate_deg_per_s": ("p", 1),
    "RollRate [deg/sec]": ("p", 1),
    "imu.gyro_x [rad s^-1]": ("p", np.degrees(1)),
    "GyrX(rad/s)": ("p", np.degrees(1)),
    "pitch_rate_mrad_s": ("q", np.degrees(1) / 1000),
    "yawRate_radians_per_second": ("r", np.degrees(1)),
    "roll_rad": ("phi", np.degrees(1)),
    "RollDeg": ("phi", 1),
    "bank angle [deg]": ("phi", 1),
    "Pitch, deg": ("theta", 1),
    "aoa_deg": ("alpha", 1),
    "AoA [rad]": ("alpha", np.degrees(1)),
    "sideslip_rad": ("beta", np.degrees(1)),
    "tas_m_s": ("tas", 3600 / 1852),
    "true_airspeed [km/h]": ("tas", 1 / 1.852),
    "V (m/s)": ("tas", 3600 / 1852),
    "KTAS": ("tas", 1),
    "ax_m_s2": ("nx", 1 / 9.80665),
    "accel_y [m/s^2]": ("ny", 1 / 9.80665),
    "ay [m/s²]": ("ny", 1 / 9.80665),
    "az_m_s2": ("nz", -1 / 9.80665),
    "AccZ (ft/s^2)": ("nz", -0.3048 / 9.80665),
    "nz_g": ("nz", 1),
    "load_factor [g]": ("nz", 1),
    "altitude_m": ("altitude", 1 / 0.3048),
    "h [ft]": ("altitude", 1),
    "throttle_percent": ("throttle", 1),
    "elevator_rad": ("elevator", np.degrees(1)),
}


@pytest.mark.parametrize("header", HEADERS)
def test_a_header_says_channel_and_unit(tmp_path, header):
    channel, factor = HEADERS[header]
    log = gb.open_log(table(tmp_path, separator=";", **{header: VALUES}))
    assert log.channels == (channel,)
    np.testing.assert_allclose(log.segments[0][channel], factor * VALUES, rtol=1e-12)
    assert any(line.startswith(f"{channel} = ") and header.split()[0] in line for line in log.method)


def test_every_channel_of_the_table_is_known_by_its_own_header():
    for name, channel in CHANNELS.items():
        told = guess(channel.header)
        assert told.meaning is not None
        assert (told.channel, unit(told.meaning.unit).factor, told.meaning.sign) == (name, 1.0, 1.0)


# headers that look like a channel and aren't taken, and what is said
DOUBTFUL = {
    "gyro_x": "looks like p, but states no unit: --map p=gyro_x:rad/s or :deg/s",
    "p [hPa]": "states 'hPa', not a unit of angular rate",
    "q_Pa": None,
    "heading_m": "states 'm', not a unit of angle",
    "airspeed_m_s": "may be indicated or true: --map tas=airspeed_m_s:m/s",
    "ias_kt": "is indicated, not true",
    "track_deg": "is the way over ground, not the heading",
    "v_m_s": "may be the true airspeed or a velocity's part",
    "angular_velocity.y [rad/s]": "may be in axes that point left and up",
    "roll_cmd_deg": None,
    "attitude_setpoint.roll_deg": None,
    "p_2_deg_s": None,
    "engine_rps": None,
    "g_load": None,
}


@pytest.mark.parametrize("header", DOUBTFUL)
def test_what_is_in_doubt_isnt_taken(tmp_path, header):
    log = gb.open_log(table(tmp_path, **{header: VALUES, "phi_deg": VALUES}))
    assert not set(log.channels) & set(CHANNELS) - {"phi"}
    if header not in CHANNELS:
        np.testing.assert_array_equal(log.segments[0][header], VALUES)  # there by its own name, as it is
    said = [line for line in log.method if line.startswith("not taken") and header in line]
    assert (DOUBTFUL[header] is None) == (not said)
    assert DOUBTFUL[header] is None or DOUBTFUL[header] in said[0]


def test_of_two_columns_that_may_be_a_channel_neither_is_taken(tmp_path):
    path = table(tmp_path, roll_rate_dps=VALUES, gyro_x_dps=2 * VALUES)
    with pytest.raises(gb.InputError, match="'roll_rate_dps' may be p, as may 'gyro_x_dps': --map p=COLUMN"):
        gb.open_log(path, needs=["p"])
    assert gb.open_log(path, mapping=["p=gyro_x_dps"], needs=["p"]).segments[0]["p"][1] == 2 * VALUES[1]


def test_unless_one_is_named_as_this_package_names_it(tmp_path):
    log = gb.open_log(table(tmp_path, gyro_x_dps=2 * VALUES, p_deg_s=VALUES))
    np.testing.assert_array_equal(log.segments[0]["p"], VALUES)
    assert "p = 'p_deg_s' in deg_s, rather than 'gyro_x_dps'" in log.method


@pytest.mark.parametrize(
    ("header", "mapping", "factor"),
    [
        ("gx", "p=gx:rad/s", np.degrees(1)),
        ("gx", "p=-gx:deg/s", -1.0),
        ("az", "nz=-az:m/s2", -1 / 9.80665),
        ("odd:name=x", "p=odd:name=x:rad/s", np.degrees(1)),
        ("odd:deg/s", "p=odd:deg/s:rad/s", np.degrees(1)),
        ("-x", "p=-x:deg/s", 1.0),
        ("GX [rad/s]", "p=GX [rad/s]", np.degrees(1)),
        ("GX [rad/s]", "p=GX:deg/s", 1.0),
        ("strain", "strain_3=strain", 1.0),
        ("p_dps", "p=p_dps:rad/s", np.degrees(1)),
    ],
)
def test_a_mapping_states_column_unit_and_sign(tmp_path, header, mapping, factor):
    channel = mapping.partition("=")[0]
    log = gb.open_log(table(tmp_path, separator=";", **{header: VALUES}), mapping=[mapping], needs=[channel])
    np.testing.assert_allclose(log.segments[0][channel], factor * VALUES, rtol=1e-12)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        (["p"], "isn't CHANNEL=COLUMN:UNIT"),
        (["p="], "isn't CHANNEL=COLUMN:UNIT"),
        (["=gx"], "isn't CHANNEL=COLUMN:UNIT"),
        (["p=gx:rad/s", "p=gx:deg/s"], "gives 'p' twice"),
        (["p=gx"], "the column states no unit; give one behind a colon, as :rad/s or :deg/s"),
        (["p=gx:m"], "'m' isn't a unit of angular rate"),
        (["p=gx:furlong"], "'furlong' isn't a unit of angular rate"),
        (["p=gz:rad/s"], "no column 'gz'; its columns: gx, phi_deg"),
        (["time=gx"], "the column states no unit"),
        (["time=gx:rad"], "'rad' isn't a unit of time"),
    ],
)
def test_a_bad_mapping_is_one_line_that_says_what_to_do(tmp_path, mapping, message):
    path = table(tmp_path, gx=VALUES, phi_deg=VALUES)
    with pytest.raises(gb.InputError, match=r"\A[^\n]*\Z") as refused:
        gb.open_log(path, mapping=mapping)
    assert message in str(refused.value)


def test_needing_nothing_is_refused(tmp_path):
    with pytest.raises(gb.InputError, match="needs is empty"):
        gb.open_log(table(tmp_path, p_dps=VALUES), needs=[])


def test_a_needed_channel_that_isnt_there_is_named_with_what_looks_like_it(tmp_path):
    path = table(tmp_path, gyro_x=VALUES, q_deg_s=VALUES, temperature=VALUES)
    with pytest.raises(gb.InputError) as refused:
        gb.open_log(path, needs=["q", "p"])
    for part in (str(path), "no channel 'p'", "column 'gyro_x' looks like p", "that are there: q", "temperature"):
        assert part in str(refused.value)
    with pytest.raises(gb.InputError, match="no channel 'strain': no column has that name"):
        gb.open_log(path, needs=["strain"])


@pytest.mark.parametrize(("name", "per_second"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_any_clock_unit(tmp_path, name, per_second):
    stamps = (np.arange(SAMPLES) * 10_000_000 + 3_000_000_000) // int(1e9 / per_second) if name != "s" else None
    stamps = np.arange(SAMPLES) * 0.01 + 3 if stamps is None else stamps
    for header, mapping in ((f"t [{name}]", []), (f"time_{name}", []), ("clock", [f"time=clock:{name}"])):
        path = tmp_path / "log.csv"
        rows = "\n".join(f"{t},{v}" for t, v in zip(stamps, VALUES, strict=True))
        path.write_text(f"{header},p_deg_s\n{rows}\n")
        (record,) = gb.open_log(path, mapping=mapping).segments
        assert (record.start_s, record.sample_period_s) == (3.0, 0.01)
        np.testing.assert_array_equal(record["p"], VALUES)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("time", "column 'time' looks like time, but states no unit: --map time=time:s or :us"),
        ("Zeit [ms]", "no column tells the time: --map time=COLUMN:UNIT \\(perhaps 'Zeit \\[ms\\]'\\)"),
        ("tick", "no column tells the time: --map time=COLUMN:UNIT; its columns: tick, p_deg_s"),
    ],
)
def test_a_time_that_is_in_doubt_isnt_taken(tmp_path, header, message):
    path = tmp_path / "log.csv"
    path.write_text(f"{header},p_deg_s\n" + "".join(f"{k},{k % 7}\n" for k in range(50)))
    with pytest.raises(gb.InputError, match=message):
        gb.open_log(path)


def test_of_columns_that_tell_one_time_the_finest_is_taken_and_told(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("timestamp_s,gps_s,t_ms,p_deg_s\n" + _rows())
    log = gb.open_log(path)
    assert log.segments[0].sample_period_s == 0.01
    (told,) = [source for source in log.sources if source.channel == "time"]
    assert (told.column, told.unit) == ("t_ms", "ms")
    assert "agreement with" in told.guessed
    assert gb.open_log(path, mapping=["time=gps_s"]).segments[0].sample_period_s == 0.01


def _rows():
    return "".join(f"{k // 100},{k / 100},{10 * k},{k % 7}\n" for k in range(500))


# how the same table may be written
DIALECTS = {
    "semicolons and decimal commas": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "tabs": lambda text: text.replace(",", "\t").encode(),
    "blanks": lambda text: text.replace(",", "  ").encode(),
    "a byte order mark": lambda text: b"\xef\xbb\xbf" + text.encode(),
    "UTF-16": lambda text: text.encode("utf-16"),
    "Latin-1": lambda text: text.replace("p_deg_s", "p[°/s]").encode("latin-1"),
    "Windows' line ends": lambda text: text.replace("\n", "\r\n").encode(),
    "comments before": lambda text: b"# flown by me\n\n" + text.encode(),
    "a header in a comment": lambda text: b"# " + text.encode(),
    "a row of units": lambda text: text.replace("time_s,p_deg_s", "time,p\n[s],[deg/s]").encode(),
    "a separator at the end": lambda text: text.replace("\n", ",\n").encode(),
    "quoted": lambda text: text.replace("time_s,p_deg_s", '"time_s","p_deg_s"').encode(),
    "a word among the numbers": lambda text: (text + "5.0,n/a\n").encode(),
    "a last line that is cut short": lambda text: (text + "5.0").encode(),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_csv_is_read_as_it_is_written(tmp_path, dialect):
    values = np.round(VALUES, 6)
    text = "time_s,p_deg_s\n" + "".join(f"{k / 100},{v}\n" for k, v in enumerate(values))
    path = tmp_path / "log.csv"
    path.write_bytes(DIALECTS[dialect](text))
    record = gb.open_log(path).segments[0]
    np.testing.assert_array_equal(record["p"][:SAMPLES], values)
    assert (record.channels, record.start_s, record.sample_period_s) == (("p",), 0.0, 0.01)


def test_words_are_left_out_and_said(tmp_path):
    log = gb.open_log(table(tmp_path, p_deg_s=VALUES, mode=["AUTO"] * SAMPLES, armed=[True] * SAMPLES))
    assert log.channels == ("p", "armed")
    assert "not taken, no numbers: mode" in log.method
