"""Published data sets' layouts: what failed when is read, flights as any log's; hostile ones in one line."""

import json

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.intake.formats.registry import is_log_folder
from gtmbench.intake.formats.table_folder import is_alfa
from tests.helpers.autopilot_logs import imus, px4
from tests.helpers.turning import quaternions

RFLY = ["uint32_t index", "uint32_t id", "uint32_t mode", "float[16] controls"]
NEEDS = ["p", "q", "r", "phi", "theta", "psi"]
EPOCH_NS = 1_531_943_810_962_830_689


@pytest.fixture(scope="module")
def flight():
    return imus(1)[0]


def told(path):
    return [
        (each.sensor, each.channels, each.kind, round(each.onset_s, 3), each.end_s and round(each.end_s, 3))
        for each in gb.open_log(path, needs=["p", "q", "r"]).injections
    ]


# ---- RflyMAD: PX4 logs with a topic of their own ----


def controls(*values):
    return tuple(values) + (0.0,) * (16 - len(values))


def commanded(*rows):
    return {"rfly_ctrl_lxl": (RFLY, [(at_s, 7, kind, mode, *controls(*values)) for at_s, kind, mode, values in rows])}


def test_rflymads_topic_says_what_is_in_force(tmp_path, flight):
    more = commanded(
        (10.0, 0, 0, ()),
        (20.0, 123453, 4, (1.3, 1.0, 0.8)),
        (20.1, 123453, 4, (1.3, 1.0, 0.8)),
        (40.0, 123549, 0, ()),
        (60.0, 123450, 1, (0.0, 1.0, 1.0, 1.0)),
        (80.0, 123456, 3, (2.0,)),
    )
    (tmp_path / "TestCase_1.ulg").write_bytes(px4(flight, more=more))
    assert told(tmp_path / "TestCase_1.ulg") == [
        ("gyro", ("p", "q", "r"), "scale factor", 20.0, 40.0),
        ("motor", (), "mode 1", 60.0, 80.0),
        ("GPS", (), "noise", 80.0, None),
    ]
    texts = [each.text for each in gb.open_log(tmp_path / "TestCase_1.ulg", needs=NEEDS).injections]
    assert texts == ["gyro scale factor: 1.3, 1, 0.8", "motor mode 1: 0, 1, 1, 1", "GPS noise: 2"]


@pytest.mark.parametrize("ids", [(0, 0, 123549, 123540), (0, 0), ()])
def test_a_log_of_rflymad_without_a_fault_tells_of_none(tmp_path, flight, ids):
    more = commanded(*[(10.0 * (k + 1), kind, 0, ()) for k, kind in enumerate(ids)]) if ids else {}
    (tmp_path / "log.ulg").write_bytes(px4(flight, more=more))
    assert told(tmp_path / "log.ulg") == []


def test_a_slow_channel_that_ends_early_hides_no_failure(tmp_path, flight):
    altitude = (["double alt"], [(float(at_s), 100.0 + at_s) for at_s in range(1, 121)])
    more = commanded((20.0, 0, 0, ()), (125.0, 123450, 1, (0.0,))) | {"vehicle_global_position": altitude}
    (tmp_path / "log.ulg").write_bytes(px4(flight, more=more))
    (row,) = gb.score_log(tmp_path / "log.ulg", "C").rows
    assert row.why_not == "no motor is watched"


def test_a_hostile_topic_of_rflymads_name_costs_little(tmp_path, flight):
    fields = ["float id", "float mode"]
    rows = [(10.0 + 0.01 * k, float("nan") if k % 3 == 0 else 123453.0, float("nan")) for k in range(4000)]
    (tmp_path / "log.ulg").write_bytes(px4(flight, more={"rfly_ctrl_lxl": (fields, rows)}))
    found = gb.open_log(tmp_path / "log.ulg", needs=NEEDS).injections
    assert 0 < len(found) <= 1000
    assert "gyro" in {each.sensor for each in found}


# ---- UAV-SEAD: PX4 logs, annotated beside ----


def sead(folder, flight, mapping, name="2019-01-08/09_05_30"):
    path = folder / "ulg_files" / f"{name}.ulg"
    path.parent.mkdir(parents=True)
    path.write_bytes(px4(flight))
    (folder / "mapping.json").write_text(mapping if isinstance(mapping, str) else json.dumps(mapping))
    return path


def test_uav_seads_annotations_stand_beside_its_logs(tmp_path, flight):
    ranges = [["vehicle_local_position.z", [[30e6, 40e6], [70e6, 75e6]]], ["sensor_combined.gyro", [[35e6, 45e6]]]]
    of_log = [{"class": "Altitude", "ranges": ranges}, {"class": "Normal", "ranges": [["x", [[0, 1e6]]]]}]
    path = sead(tmp_path, flight, {"2019-01-08/09_05_30": {"annotations": of_log}, "other": {"annotations": []}})
    assert told(path) == [("altitude", (), "anomaly", 30.0, 45.0), ("altitude", (), "anomaly", 70.0, 75.0)]
    first = gb.open_log(path, needs=NEEDS).injections[0]
    assert first.text == "Altitude, seen in vehicle_local_position.z, sensor_combined.gyro"


def test_another_logs_annotations_and_another_mapping_json_are_nobodys(tmp_path, flight):
    path = sead(tmp_path, flight, {"2019-01-08/09_05_31": {"annotations": [{"class": "Altitude", "ranges": []}]}})
    assert told(path) == []
    alone = tmp_path / "alone"
    alone.mkdir()
    (alone / "log.ulg").write_bytes(path.read_bytes())
    (alone / "mapping.json").write_text("[not ours]")
    assert told(alone / "log.ulg") == []


@pytest.mark.parametrize(
    "mapping",
    [
        "{",
        "[]",
        '{"2019-01-08/09_05_30": 3}',
        '{"2019-01-08/09_05_30": {"annotations": [{"ranges": []}]}}',
        '{"2019-01-08/09_05_30": {"annotations": [{"class": "Altitude", "ranges": [["z", [[2, 1]]]]}]}}',
        '{"2019-01-08/09_05_30": {"annotations": [{"class": "Altitude", "ranges": [["z", [["a", 1]]]]}]}}',
        '{"2019-01-08/09_05_30": {"annotations": [{"class": "Altitude", "ranges": [["z", [[NaN, 1]]]]}]}}',
    ],
)
def test_annotations_in_another_layout_are_refused_in_one_line(tmp_path, flight, mapping):
    path = sead(tmp_path, flight, mapping)
    with pytest.raises(
        gb.InputError, match=r"mapping\.json: no annotations can be read of 2019-01-08/09_05_30"
    ) as told:
        gb.open_log(path, needs=NEEDS)
    assert "\n" not in str(told.value)


# ---- ALFA: a folder of tables ----


def alfa(folder, flight, *, failed=(), how="field", rate=2):
    """Write a sequence as ALFA has it; the axes of REP 103, and angles as a quaternion from east."""
    name = "carbonZ_2018-09-11-14-41-51_elevator_failure"
    own = folder / name
    own.mkdir()
    rows = np.arange(0, len(flight), rate)
    values = {channel: flight[channel][rows] for channel in NEEDS}
    stamps = EPOCH_NS + np.round(rows * flight.sample_period_s * 1e9).astype(np.int64)
    w, x, y, z = quaternions(np.column_stack([values["phi"], -values["theta"], 90.0 - values["psi"]])).T
    columns = {"orientation.x": x, "orientation.y": y, "orientation.z": z, "orientation.w": w}
    rates = [np.radians(values["p"]), -np.radians(values["q"]), -np.radians(values["r"])]
    columns |= {f"angular_velocity.{axis}": rate for axis, rate in zip("xyz", rates, strict=True)}
    table(own / f"{name}-mavros-imu-data.csv", stamps, columns, how)
    table(own / f"{name}-mavros-nav_info-roll.csv", stamps, {"measured": values["phi"]}, how)
    for what, onset_s, end_s in failed:
        at = EPOCH_NS + (np.arange(onset_s - 1.0, end_s + 1.0, 0.2) * 1e9).astype(np.int64)
        is_on = (at >= EPOCH_NS + int(onset_s * 1e9)) & (at < EPOCH_NS + int(end_s * 1e9))
        table(own / f"{name}-failure_status-{what}.csv", at, {"data": is_on if how == "." else is_on * 2}, how)
    return own


def table(path, stamps, columns, how):
    if how == "field":  # as `rostopic echo -p` writes it
        frame = {"%time": stamps + 5_000_000, "field.header.seq": np.arange(len(stamps)), "field.header.stamp": stamps}
        frame |= {f"field.{name}": values for name, values in columns.items()}
        if "failure_status" in path.name:
            frame = {"%time": stamps, "field.data": columns["data"]}
    else:
        dates = pd.to_datetime(stamps).strftime("%Y/%m/%d/%H:%M:%S.%f")
        frame = {"time": dates, ".header.stamp.secs": stamps // 10**9, ".header.stamp.nsecs": stamps % 10**9}
        frame |= {f".{name}": values for name, values in columns.items()} | {".header.frame_id": "base_link"}
        if "failure_status" in path.name:
            frame = {"time": dates, ".data": columns["data"]}
    pd.DataFrame(frame).to_csv(path, index=False)


@pytest.mark.parametrize("how", ["field", "."])
def test_a_sequence_of_alfa_is_a_log_in_aircraft_axes_with_its_failures(tmp_path, flight, how):
    path = alfa(tmp_path, flight, failed=[("elevator", 60.0, 80.0), ("engines", 90.0, 500.0)], how=how)
    assert is_log_folder(path)
    log = gb.open_log(path, needs=NEEDS)
    (record,) = log.segments
    start = round(record.start_s / flight.sample_period_s)
    rows = start + 2 * np.arange(len(record))
    for channel in NEEDS:
        wrong = (record[channel] - flight[channel][rows] + 180.0) % 360.0 - 180.0
        assert np.abs(wrong).max() < 1e-3, channel
    assert log.attitude_from_gyros
    found = [(each.sensor, each.kind) for each in log.injections]
    assert found == [("elevator", "stuck"), ("engines", "off")]
    onset_s, end_s = log.injections[0].onset_s, log.injections[0].end_s
    assert onset_s == pytest.approx(60.0, abs=0.21)
    assert end_s == pytest.approx(80.0, abs=0.21)


def test_a_sequence_without_a_failure_tells_of_none(tmp_path, flight):
    assert told(alfa(tmp_path, flight)) == []


@pytest.mark.parametrize("content", ["", "a,b\n1,2\n", "%time,field.x\nyesterday,2\n", "\x00\xff", "%time,field.x\n"])
def test_a_broken_table_of_alfa_is_one_line(tmp_path, flight, content):
    path = alfa(tmp_path, flight)
    next(path.glob("*-mavros-imu-data.csv")).write_text(content, encoding="latin-1")
    with pytest.raises(gb.InputError) as said:
        gb.open_log(path, needs=NEEDS)
    assert "mavros-imu-data" in str(said.value)
    assert "\n" not in str(said.value)


def test_two_sequences_in_one_folder_are_none(tmp_path, flight):
    path = alfa(tmp_path, flight)
    assert is_alfa(path)
    (path / "carbonZ_other-mavros-imu-data.csv").write_text("%time,field.x\n1,2\n")
    assert not is_alfa(path)
