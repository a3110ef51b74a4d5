"""Tables as people have them: what stands above and below, how numbers are written, no header, and types of a bag."""

import contextlib
import time
import zipfile

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.dialect_samples import RAD, SAMPLES, csv, quaternion
from tests.helpers.log_makers import flight

SIX = (*GYROS, *ATTITUDE)
HEADER = [*(f"{name} (rad/s)" for name in GYROS), *(f"{name} (rad)" for name in ATTITUDE)]


@pytest.fixture(scope="module")
def truth():
    return flight(30.0)


def columns(t, **more):
    return {"t (s)": t.time_s, **more, **{header: RAD * t[name] for header, name in zip(HEADER, SIX, strict=True)}}


def check(log, truth):
    (record,) = log.segments
    assert record.end_s - record.start_s == pytest.approx(truth.time_s.iloc[-1], abs=0.05)
    for name in SIX:
        assert record[name] == pytest.approx(truth[name].to_numpy(), abs=0.01), name


def opened(tmp_path, text, **options):
    path = tmp_path / "log.csv"
    path.write_text(text)
    return gb.open_log(path, **options)


ABOVE = {
    "facts in another width": "A flight\nof 2026, by somebody\n\n1500 rows, 7 columns\n\n",
    "groups of columns": "Time,Gyro,Gyro,Gyro,Attitude,Attitude,Attitude\n",
    "pairs of facts": "".join(f'"key{k}","value of {k}"\n' for k in range(200))
    + '"rcRate","1"\n"looptime","500"\n"acc_1G","2048"\n',
    "numbers among them": "Session,3\nGain,0.5,1.5\nOffset,1,2\n",
    "comments": "# made by a logger\n// and another\n",
    "a separator": "sep=,\n",
    "nothing": "",
}


@pytest.mark.parametrize("above", ABOVE)
def test_what_stands_above_a_table_is_passed_over(tmp_path, truth, above):
    check(opened(tmp_path, csv(columns(truth), above=ABOVE[above])), truth)


@pytest.mark.parametrize("sep", ["\t", ";", "|", "  "])
def test_units_and_empty_lines_below_the_names(tmp_path, truth, sep):
    rows = [["T", *map(str.upper, GYROS), "PHI", "THE", "PSI"], ["S", *["RAD/S"] * 3, *["RAD"] * 3]]
    values = np.column_stack(list(columns(truth).values()))
    text = "Flight record\n\n" + "\n".join(sep.join(row) for row in rows) + "\n\n"
    check(opened(tmp_path, text + "\n".join(sep.join(f"{cell:.7f}" for cell in row) for row in values) + "\n"), truth)


def test_lines_below_a_table_are_missing_rows(tmp_path, truth):
    log = opened(tmp_path, csv(columns(truth)) + "\nEnd of data\n")
    check(log, truth)
    assert any("hold no number and count as missing" in line for line in log.method)


@pytest.mark.parametrize(
    ("between", "point", "sep"), [(",", ".", ","), (",", ".", ";"), (".", ",", ";"), ("'", ".", ",")]
)
def test_thousands_are_read_as_such(tmp_path, truth, between, point, sep):
    def text(value):
        return f"{value:,.3f}".replace(",", "#").replace(".", point).replace("#", between)

    table = pd.DataFrame({"t (ms)": [text(1e3 * s + 12_000) for s in truth.time_s], **columns(truth)})
    table[HEADER] = table[HEADER].map(lambda value: f"{value:.9f}".replace(".", point))
    check(opened(tmp_path, table.drop(columns="t (s)").to_csv(sep=sep, index=False)), truth)


@pytest.mark.parametrize("said", ["# Sample rate: 50.0Hz\n", "// Update Rate = 0.05 kHz\n", "Data Rate,50\n\n"])
@pytest.mark.parametrize("counter", [True, False])
def test_a_stated_rate_is_the_time_of_a_counter_or_of_rows(tmp_path, truth, said, counter):
    count = {"PacketCounter": (65_500 + np.arange(len(truth))) % 65_536} if counter else {}
    table = {**count, **{name: values for name, values in columns(truth).items() if name != "t (s)"}}
    log = opened(tmp_path, csv(table, above=said))
    check(log, truth)
    assert "the stated 50 Hz" in " ".join(log.method)


def test_without_a_header_columns_go_by_their_numbers(tmp_path, truth):
    text = csv(columns(truth, note="alike"), header=False)
    with pytest.raises(gb.InputError, match="no header: columns are called by their numbers, as in --map time=1:s"):
        opened(tmp_path, text, needs=SIX)
    assert "no header" in " ".join(gb.open_log(tmp_path / "log.csv").method)
    mapping = [
        f"{name}={place}:{unit}"
        for place, (name, unit) in enumerate(zip(SIX, ["rad/s"] * 3 + ["rad"] * 3, strict=True), 3)
    ]
    check(opened(tmp_path, text, mapping=["time=1:s", *mapping], needs=SIX), truth)


def test_a_date_that_never_changes_is_no_time_where_nothing_names_it(tmp_path, truth):
    text = csv(
        {"day": "2024-05-05T10:00:00", "ms": np.round(1e3 * truth.time_s).astype(int), **columns(truth)}, header=False
    )
    with pytest.raises(gb.InputError, match="no header"):
        opened(tmp_path, text, needs=SIX)


def kitti(truth):
    samples = [
        text for name, text in SAMPLES["kitti_oxts"](truth.assign(nx=0.0, ny=0.0, nz=1.0)).items() if "data" in name
    ]
    return "".join(samples[::5])  # 10 Hz


def test_a_width_is_a_sources_where_gyros_and_attitude_agree(tmp_path, truth):
    (record,) = opened(tmp_path, kitti(truth), needs=SIX).segments
    assert record["q"] == pytest.approx(truth.q.to_numpy()[::5], abs=0.01)


def test_a_width_alone_is_no_sources(tmp_path, truth):
    rows = [line.split() for line in kitti(truth).splitlines()]
    text = "\n".join(" ".join([*row[:17], *row[17:20][::-1], *row[20:]]) for row in rows) + "\n"
    with pytest.raises(gb.InputError, match="no header"):
        opened(tmp_path, text, needs=SIX)


def packed(files, path):
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def test_a_zip_of_tables_and_facts_is_one_log(tmp_path, truth):
    files = SAMPLES["phyphox"](truth)
    check(gb.open_log(packed(files, tmp_path / "phyphox.zip")), truth)
    deeper = {f"export/{name}": text for name, text in files.items()}
    check(gb.open_log(packed(deeper, tmp_path / "deeper.zip")), truth)


def test_a_zip_of_a_data_set_is_one_log(tmp_path, truth):
    """EuRoC's own zips hold mav0 in a folder or without, and pictures, which are no tables."""
    files = SAMPLES["euroc"](truth.assign(nx=0.0, ny=0.0, nz=1.0)) | {"mav0/cam0/data/1.png": "no picture"}
    check(gb.open_log(packed(files, tmp_path / "one.zip")), truth)
    check(gb.open_log(packed({f"MH_01/{name}": text for name, text in files.items()}, tmp_path / "two.zip")), truth)


@pytest.mark.parametrize("line", ["sampl" + "_" * 500_000, "x" + "\t" * 500_000, '"' * 500_000, "1," * 250_000])
def test_a_line_without_end_above_a_table_costs_no_time(tmp_path, truth, line):
    began_s = time.process_time()
    with contextlib.suppress(gb.InputError):
        opened(tmp_path, line + "\n" + csv(columns(truth)))
    assert time.process_time() - began_s < 5.0


def test_a_zip_never_writes_outside_of_its_folder(tmp_path):
    path = packed({"imu.csv": "time_s,p_deg_s\n0,1\n", "../../att.csv": "time_s,roll_deg\n0,1\n"}, tmp_path / "z.zip")
    with pytest.raises(gb.InputError):
        gb.open_log(path)
    assert not list(tmp_path.parent.rglob("att.csv"))


DEFINITIONS = {
    "px4_msgs/msg/SensorCombined": "uint64 timestamp\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\n"
    "float32[3] accelerometer_m_s2\n",
    "px4_msgs/msg/VehicleAttitude": "uint64 timestamp\nfloat32[4] q\nuint8 quat_reset_counter\n",
}


@pytest.fixture(params=["SQLITE3", "MCAP"])
def bag(request, tmp_path, truth):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(typesys.get_types_from_msg(text, name))
    turns = np.column_stack(quaternion(truth)).astype(np.float32)
    rates = np.ascontiguousarray(RAD * truth[list(GYROS)].to_numpy(), dtype=np.float32)
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=rosbag2.StoragePlugin[request.param]) as writer:
        imu, attitude = (
            writer.add_connection(f"/fmu/out/{topic}", kind, typestore=store)
            for topic, kind in zip(("sensor_combined", "vehicle_attitude"), DEFINITIONS, strict=True)
        )
        for k, time_s in enumerate(truth.time_s):
            us, ns = round(1e6 * time_s) + 5_000_000, 1_600_000_000_000_000_000 + round(1e9 * time_s)
            down = np.array([0, 0, -9.8], dtype=np.float32)
            for topic, values in ((imu, (us, rates[k], 20_000, down)), (attitude, (us, turns[k], 0))):
                message = store.types[topic.msgtype](*values)
                writer.write(topic, ns, store.serialize_cdr(message, topic.msgtype))
    return tmp_path / "bag"


def test_types_that_a_bag_defines_are_read(bag, truth):
    log = gb.open_log(bag)
    check(log, truth)
    assert log.attitude_from_gyros
    for file in bag.glob("*.mcap"):
        check(gb.open_log(file), truth)


@pytest.mark.parametrize(
    "text", ["float64 import\n", "float64 x = 1\nfloat64 class\n", "int32 __init__\n", "garbage ( here\n"]
)
def test_a_definition_that_is_not_plain_is_passed_over(text):
    typesys = pytest.importorskip("rosbags.typesys")
    from gtmbench.intake.formats.rosbag import define, numbers_of

    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    define(store, "odd_msgs/msg/Odd", text, "MSG")
    assert numbers_of(store, "odd_msgs/msg/Odd") is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (",".join(f"c{k}" for k in range(100_000)) + "\n", "it has 100000 columns"),
        ("word " * 5 + "\n" + "a note\n" * 200_000, "lines hold no row of numbers; cut what stands above the table"),
        ("# note 7\n" * 200_000 + "t,p\n0,1\n", "lines hold no row of numbers; cut what stands above the table"),
        ("word word\n0 1\n", "stands there twice"),
        ("{" * 1000, "begins as a file of JSON|its first line|no column tells|no row of values"),
    ],
)
def test_what_is_no_log_is_said_in_one_line(tmp_path, text, said):
    with pytest.raises(gb.InputError, match=said) as refused:
        opened(tmp_path, text)
    assert "\n" not in str(refused.value)


def test_two_aircraft_in_a_log_of_paparazzi_are_asked_for(tmp_path, truth):
    (text,) = SAMPLES["paparazzi"](truth).values()
    path = tmp_path / "flight.data"
    path.write_text(text + text.replace(" 2 ", " 3 "))
    with pytest.raises(gb.InputError, match="systems 2 and 3 sent; say which is meant: --system 2"):
        gb.open_log(path)
    (record,) = gb.open_log(f"{path}:3").segments
    assert record["p"] == pytest.approx(truth.p.to_numpy(), abs=0.02)


@pytest.mark.parametrize("name", ["mission_planner", "paparazzi"])
def test_a_broken_line_among_messages_is_said_or_passed_over(tmp_path, truth, name):
    ((file, text),) = SAMPLES[name](truth).items()
    lines = text.splitlines()
    lines[10], lines[20] = lines[10][: len(lines[10]) // 2], lines[20].replace("2", "x")
    (tmp_path / file).write_text("\n".join(lines))
    with contextlib.suppress(gb.InputError):
        gb.open_log(tmp_path / file)
