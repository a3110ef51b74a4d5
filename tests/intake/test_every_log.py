"""Every format: values as they were logged, units and signs right, and the same file as its own library reads it."""

import re
import shlex
import subprocess
import sys
import zipfile

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from tests.helpers import log_makers as makers
from tests.helpers.hostile import refused
from tests.helpers.night import by_day

CHANNELS = ["p", "q", "r", "phi", "theta", "psi"]
EXACT = {"flight.tlog": 1e-5, "flight.bag": 1e-9, "bag2": 1e-9, "flight.xlsx": 1e-9}  # floats of 32 bits; quaternions


@pytest.mark.parametrize("name", makers.MAKERS)
def test_a_flight_comes_back_in_aircraft_axes_and_our_units(tmp_path, name):
    table = makers.flight()
    log = gb.open_log(makers.make(tmp_path, name, table), needs=CHANNELS)
    (record,) = log.segments
    first = round((record.start_s % 5.0 if name == "flight.tlog" else record.start_s % 7.0) * makers.RATE_HZ)
    for channel in CHANNELS:
        told = table[channel].to_numpy()[first : first + len(record)]
        read = record[channel] - 360.0 * np.round((record[channel] - told).mean() / 360.0)
        assert np.abs(read - told).max() < EXACT.get(name, 1e-9), channel


@pytest.mark.nightly
def test_a_bare_table_is_read_by_its_motion_and_says_so(tmp_path, cli):
    table = makers.flight(60.0)
    bare = {"t": 1000 * table.time_s, "gyro_x": makers.RAD * table.p, "gyro_y": makers.RAD * table.q}
    bare |= {"gyro_z": makers.RAD * table.r, "roll": table.phi, "pitch": table.theta, "yaw": table.psi}
    path, kept = tmp_path / "bare.csv", tmp_path / "columns.toml"
    pd.DataFrame(bare).to_csv(path, index=False)
    code, out, err = cli("monitor", str(path), "--healthy", "0:30", "--details", "--map", str(kept))
    assert (code, err) == (3, "") or code == 0
    said = " ".join(out.split())
    assert "Guessed: p, q, r in rad/s by the attitude" in said
    (typed,) = (line for line in out.splitlines() if line.startswith("to state what was guessed: gtmbench monitor"))
    assert "--map time=t:ms" in typed
    assert "--map p=gyro_x:rad/s" in typed
    for stated in (shlex.split(typed.partition("monitor")[2])[1:], ["--map", str(kept)]):
        code, out, err = cli("monitor", str(path), "--list", *stated)
        assert (code, err, "guessed" in out) == (0, "", False)


SCALES = {"rad": 1.0, "deg": 180.0 / np.pi}


@pytest.mark.parametrize("units", SCALES)
def test_a_common_scale_needs_somebodys_word(tmp_path, units):
    table = makers.flight(60.0)
    small = {"time_s": table.time_s} | {name: 0.12 * table[name] for name in CHANNELS}
    path = tmp_path / "small.csv"
    pd.DataFrame(small).to_csv(path, index=False)
    with pytest.raises(gb.InputError, match=r"fit each other in rad and in deg, .*: --units rad or --units deg"):
        gb.open_log(path, needs=CHANNELS)
    log = gb.open_log(path, needs=CHANNELS, mapping=[f"units={units}"])
    factor = 0.12 if units == "deg" else 0.12 / makers.RAD
    assert np.abs(log.segments[0]["q"] - factor * table.q).max() < 1e-9


def test_jsbsims_own_output_is_read_as_it_comes(tmp_path, monkeypatch):
    import jsbsim

    monkeypatch.chdir(tmp_path)  # the aircraft's own output, too, goes where it is run
    directive = '<?xml version="1.0"?><output name="own.csv" type="CSV" rate="50"><rates>ON</rates>'
    (tmp_path / "own.xml").write_text(f"{directive}<position>ON</position></output>")
    plane = jsbsim.FGFDMExec(None)
    plane.set_debug_level(0)
    plane.load_model("c172x")
    plane["ic/h-sl-ft"], plane["ic/vc-kts"] = 4000.0, 90.0
    plane.set_output_path(str(tmp_path))
    plane.set_output_directive(str(tmp_path / "own.xml"))
    plane.run_ic()
    for step in range(1200):
        plane["fcs/aileron-cmd-norm"] = 0.05 * np.sin(0.02 * step)
        plane.run()
    log = gb.open_log(tmp_path / "own.csv", needs=CHANNELS)
    rates = gb.derive(log.segments[0], ["p_att"])
    assert np.nanstd(rates["p"] - rates["p_att"]) < 0.05 * np.std(rates["p"])


def test_tables_of_one_length_share_the_time_of_one_of_them(tmp_path):
    table = makers.flight()
    folder = tmp_path / "parts"
    folder.mkdir()
    own = {"time": {"time (sec)": table.time_s}, "gyro": {f"{name} (deg/s)": table[name] for name in "pqr"}}
    own["attitude"] = {f"{name} (deg)": table[name] for name in ("phi", "theta", "psi")}
    for name, columns in own.items():
        pd.DataFrame(columns).to_csv(folder / f"{name}.csv", index=False)
    record = gb.open_log(folder, needs=CHANNELS).segments[0]
    assert (record["q"] == table.q.to_numpy()).all()


def test_a_zip_of_one_flights_tables_is_one_log_and_any_other_is_asked_about(tmp_path):
    tables = makers.make(tmp_path, "tables")
    packed, two = tmp_path / "tables.zip", tmp_path / "two.zip"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for table in tables.iterdir():
            archive.write(table, f"flight/{table.name}")
    record, own = (gb.open_log(path, needs=CHANNELS).segments[0] for path in (packed, tables))
    assert all(np.array_equal(record[channel], own[channel]) for channel in CHANNELS)
    with zipfile.ZipFile(two, "w") as archive:
        for name in ("monday.csv", "tuesday.csv"):
            archive.writestr(name, makers.columns(makers.flight()).to_csv(index=False))
    with pytest.raises(gb.InputError, match=r"it holds 2 files; say which is meant: .*two.zip:monday.csv"):
        gb.open_log(two)


def test_of_several_quaternions_none_is_taken(tmp_path):
    table = makers.flight()
    turns = np.column_stack([np.cos(0.1 * table.time_s), *[np.sin(0.1 * table.time_s) / 3**0.5] * 3])
    columns = {f"{name}_q{i}": turns[:, i] for name in ("left", "right") for i in range(4)}
    path = tmp_path / "two.csv"
    pd.DataFrame({"time_s": table.time_s} | columns).to_csv(path, index=False)
    with pytest.raises(gb.InputError, match="no channel 'phi'"):
        gb.open_log(path, needs=["phi"])


def test_of_two_gyros_that_fit_alike_none_is_taken(tmp_path):
    table = makers.flight(60.0)
    two = {"time_s": table.time_s} | {f"{name}_deg": table[name] for name in ("phi", "theta", "psi")}
    for sensor in ("left", "right"):
        two |= {f"gyro_{sensor}_{axis}": table[name] for axis, name in zip("xyz", "pqr", strict=True)}
    path = tmp_path / "two.csv"
    pd.DataFrame(two).to_csv(path, index=False)
    with pytest.raises(gb.InputError, match=r"two readings fit alike: .*gyro_left_x:deg/s.*, or .*gyro_right_x:deg/s"):
        gb.open_log(path, needs=CHANNELS)


@pytest.mark.parametrize(
    ("order", "signs"),
    [("yxz", (1, 1, 1)), ("xzy", (1, 1, 1)), ("xyz", (-1, 1, 1)), ("xyz", (1, -1, 1)), ("xyz", (1, 1, -1))],
)
def test_what_no_rotation_explains_is_a_fault_and_never_undone(tmp_path, order, signs):
    """Two gyros at each other's axes, or one that reads the other way round."""
    table = makers.flight(60.0)
    columns = {"time_s": table.time_s} | {f"{name}_deg": table[name] for name in ("phi", "theta", "psi")}
    columns |= {
        f"g{axis}": sign * makers.RAD * table[name] for axis, name, sign in zip(order, "pqr", signs, strict=True)
    }
    path = tmp_path / "turned.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    with pytest.raises(gb.InputError, match="don't show one motion in any unit"):
        gb.open_log(path, needs=CHANNELS)


@pytest.mark.parametrize("angle", by_day([1.0, 0.1, 0.01, 1e-3, np.degrees(1e-3), np.degrees(1.0)], 2))
@pytest.mark.parametrize("rate", by_day([1.0, 0.1, 0.01, 1e-3, np.degrees(1e-3), np.degrees(1.0)], 3))
def test_a_unit_that_nothing_states_is_read_rightly_or_asked_for(tmp_path, rate, angle):
    """Of gyros and angles in parts of a degree, or of a radian: never in another unit that fits them as well."""
    table = makers.flight(60.0)
    columns = {"time_s": table.time_s} | {
        f"g{axis}": table[name] / rate for axis, name in zip("xyz", "pqr", strict=True)
    }
    columns |= {name: table[own] / angle for name, own in zip(("roll", "pitch", "yaw"), CHANNELS[3:], strict=True)}
    path = tmp_path / "open.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    said = ""
    try:
        (record,) = gb.open_log(path, needs=CHANNELS).segments
    except gb.InputError as error:
        said = str(error)
    if said:
        assert rate not in (1.0, np.degrees(1.0))
        assert re.search("two readings fit alike|neither gravity nor a climb shows which|in any unit", said)
        return
    assert all(np.abs(record[name] - table[name]).max() < 1e-4 for name in "pqr")


def faulty(table, fault):
    """Gyros in deg/s, angles in deg and specific force in m/s2, of forward, right, down; one of them fails."""
    theta, phi = np.radians(table.theta), np.radians(table.phi)
    down = (np.sin(theta), -np.cos(theta) * np.sin(phi), -np.cos(theta) * np.cos(phi))
    columns = {f"g{axis}": table[name].to_numpy(copy=True) for axis, name in zip("xyz", "pqr", strict=True)}
    columns |= {"roll": table.phi.to_numpy(copy=True), "pitch": table.theta, "yaw": table.psi}
    columns |= {f"a{axis}": 9.81 * np.array(each) for axis, each in zip("xyz", down, strict=True)}
    late = slice(len(table) * 4 // 10, None)
    if fault == "an accelerometer turns":
        columns["az"][late] *= -1.0
    elif fault == "a bank is 40 deg off":
        columns["roll"] += 40.0
    elif fault == "a gyro reads the other way round":
        columns["gy"] *= -1.0
    return {"time_s": table.time_s, **columns}


@pytest.mark.parametrize(
    "fault", ["none", "an accelerometer turns", "a bank is 40 deg off", "a gyro reads the other way round"]
)
def test_no_fault_becomes_a_unit_or_a_frame(tmp_path, fault):
    """What is read of a failed sensor's log is read as of a healthy one; or it is asked about."""
    path = tmp_path / "open.csv"
    pd.DataFrame(faulty(makers.flight(60.0), fault)).to_csv(path, index=False)
    try:
        sources = {each.channel: each for each in gb.open_log(path, needs=CHANNELS).sources if each.channel in CHANNELS}
    except gb.InputError:
        sources = {}
    assert sources or fault != "none"
    assert all((each.unit.removesuffix("/s"), each.sign) == ("deg", 1.0) for each in sources.values())


def test_an_autopilots_controllers_and_estimates_are_no_gyros(tmp_path):
    table = makers.flight()
    columns = {
        "time_s": table.time_s,
        "PIDR.P (deg/s)": table.p,
        "XKF1.GY (deg/s)": table.q,
        "NKF2.gz (deg/s)": table.r,
    }
    path = tmp_path / "estimates.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    with pytest.raises(gb.InputError, match="nothing looks like p, q or r"):
        gb.open_log(path, needs=["p", "q", "r"])


@pytest.mark.parametrize(("name", "number"), [("fs", 50.0), ("flight/sample_rate", 50), ("dt", 0.02)])
def test_a_number_of_samples_a_second_is_a_time(tmp_path, name, number):
    table = makers.flight()
    arrays = {
        "gyro_rad_s": makers.RAD * table[["p", "q", "r"]].to_numpy(),
        "euler_deg": table[["phi", "theta", "psi"]].to_numpy(),
    }
    np.savez(tmp_path / "flight.npz", **arrays, **{name: np.asarray(number)})
    log = gb.open_log(tmp_path / "flight.npz", needs=CHANNELS)
    assert np.abs(log.segments[0].time_s - table.time_s).max() < 1e-9
    assert next(each.guessed for each in log.sources if each.channel == "time").startswith(f"{name} = {number:g}")


def test_systems_of_a_telemetry_log_are_asked_for(tmp_path, cli):
    path = tmp_path / "two.tlog"
    for system in (1, 7):
        makers.telemetry(path, makers.flight(10.0), system=system)
    assert "systems 1 and 7 sent; say which is meant: --system 1" in refused(cli("monitor", str(path), "--list"))
    assert cli("monitor", str(path), "--list", "--system", "7")[0] == 0


PARTS = {"flight.mat:flight/imu": 4, "flight73.mat:flight/ahrs": 4}


@pytest.mark.parametrize("part", by_day(PARTS))
def test_a_branch_of_a_tree_is_a_log(tmp_path, part):
    makers.make(tmp_path, part.partition(":")[0])
    assert len(gb.log_columns(f"{tmp_path}/{part}")) == PARTS[part]
    with pytest.raises(gb.InputError, match="it has no 'nowhere'; it holds flight/"):
        gb.log_columns(f"{tmp_path}/{part.partition(':')[0]}:nowhere")


NAMED = {
    "box.bbl": (b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n", "black box .* blackbox_decode"),
    "dump.txt": (b"1970-01-01 00:00:00.00: FMT {Type : 128, Length : 89, Name : FMT}\n", "what mavlogdump.py prints"),
    "track.kml": (b'<?xml version="1.0"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">', "positions only, no gyros"),
    "quad.param": (b"ACRO_BAL_PITCH,1\nACRO_BAL_ROLL,1\nACRO_LOCKING,0\n", "parameters of an autopilot"),
    "log.bin": (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n", "type: git lfs pull"),
    "plot.png": (b"\x89PNG\r\n\x1a\n", "is a picture"),
    "log.pkl": (b"\x80\x04\x95\x10\x00\x00\x00\x00\x00\x00\x00\x8c\x05numpy", "is a pickle, which could run anything"),
    "log.dat": (bytes(range(200)), "is of no format that is known"),
}


@pytest.mark.parametrize("name", NAMED)
def test_what_cant_be_read_is_named_with_what_would_do(tmp_path, name):
    content, message = NAMED[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(gb.InputError, match=message):
        gb.open_log(tmp_path / name)


@pytest.mark.parametrize("name", by_day(["flight.tlog", "bag2", "flight.mat", "flight.zip", "tables"]))
def test_a_typed_fault_breaks_any_log(tmp_path, cli, name):
    log, out = makers.make(tmp_path, name), tmp_path / "broken.csv"
    healthy = gb.open_log(log, needs=CHANNELS).segments[0]
    onset_s = round(healthy.start_s + 10.0, 2)
    typed = ["--fault", "bias:r:size=2", "--onset", str(onset_s), "--attitude", "own", "--out", str(out)]
    code, said, err = cli("inject", str(log), *typed)
    assert (code, err) == (0, "")
    assert "left out" in said or name in ("flight.tlog", "flight.zip")
    broken = gb.open_log(out, needs=CHANNELS).segments[0]
    assert np.abs(broken["r"] - healthy["r"] - 2.0 * (healthy.time_s > onset_s - 1e-6)).max() < 1e-5


@pytest.mark.nightly
def test_the_readers_libraries_stay_out_of_the_way_of_a_csv(tmp_path):
    makers.columns(makers.flight()).to_csv(tmp_path / "log.csv", index=False)
    late = {"pymavlink", "rosbags", "h5py", "openpyxl", "apsw", "lz4", "mcap", "pyulog"}
    code = f"import sys, gtmbench as gb; gb.open_log(sys.argv[1]); print(sorted({late} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code, str(tmp_path / "log.csv")], capture_output=True, check=True)
    assert run.stdout.strip() == b"[]"
