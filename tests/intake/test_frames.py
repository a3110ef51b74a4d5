"""Axes that point left and up, and sensors that are mounted turned, are told and undone; a single sign is no frame."""

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from tests.helpers.dialect_samples import RAD, G
from tests.helpers.log_makers import flight
from tests.helpers.night import by_day


@pytest.fixture(scope="module")
def truth():
    table = flight(40.0)
    f, t = np.deg2rad(table.phi), np.deg2rad(table.theta)
    forces = np.column_stack([np.sin(t), -np.cos(t) * np.sin(f), np.cos(t) * np.cos(f)])
    table = table.assign(**dict(zip(ACCELEROMETERS, forces.T, strict=True)))
    noise = np.random.default_rng(7).standard_normal((len(table), 3))
    return table.assign(**{name: table[name] + 0.3 * own for name, own in zip(GYROS, noise.T, strict=True)})


# a row: the sensor's x, y and z in the aircraft's axes
MOUNTED = {
    "left and up": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "backwards": [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    "a quarter to the right": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    "on its side": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "all three": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
}


def logged(t, path, mounted=MOUNTED["left and up"], angles=(1, 1, 1), *, forces=True):
    turn = np.array(mounted, dtype=float)
    rates = t[list(GYROS)].to_numpy() @ turn.T
    felt = (t[list(ACCELEROMETERS)].to_numpy() * [1, 1, -1]) @ turn.T
    columns = {"t [s]": t.time_s, **{f"gyro_{a} [rad/s]": RAD * rates[:, k] for k, a in enumerate("xyz")}}
    columns |= {f"acc_{a} [m/s2]": G * felt[:, k] for k, a in enumerate("xyz")} if forces else {}
    names = ("roll [deg]", "pitch [deg]", "yaw [deg]")
    columns |= {name: sign * t[own] for name, own, sign in zip(names, ATTITUDE, angles, strict=True)}
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def check(log, truth):
    (record,) = log.segments
    for name in set(record.channels) & {*GYROS, *ATTITUDE, *ACCELEROMETERS}:
        off = record[name] - np.interp(record.time_s, truth.time_s, truth[name])
        assert np.std(off) < 0.02 * np.std(truth[name]) + 1e-6, name


@pytest.mark.parametrize("forces", [True, False])
@pytest.mark.parametrize("mounted", MOUNTED)
def test_a_sensor_that_is_mounted_otherwise_is_read_as_if_it_was_not(tmp_path, truth, mounted, forces):
    log = gb.open_log(logged(truth, tmp_path / "log.csv", MOUNTED[mounted], forces=forces))
    check(log, truth)
    assert any("the attitude, beside which" in source.guessed for source in log.sources)


def test_an_attitude_of_axes_left_and_up_is_turned_where_the_gyros_feel_gravity_downwards(tmp_path, truth):
    log = gb.open_log(logged(truth, tmp_path / "log.csv", np.eye(3), (1, -1, -1)))
    check(log, truth)
    assert {source.channel for source in log.sources if source.guessed} == {"theta", "psi"}


def test_what_somebody_maps_is_read_as_mapped(tmp_path, truth):
    path = logged(truth, tmp_path / "log.csv")
    log = gb.open_log(path, mapping=[f"{name}=gyro_{axis}:rad/s" for name, axis in zip(GYROS, "xyz", strict=True)])
    assert not any(source.guessed for source in log.sources)
    assert np.std(log.segments[0]["q"] + np.interp(log.segments[0].time_s, truth.time_s, truth.q)) < 1e-6


def test_our_own_headers_say_which_way_they_point(tmp_path, truth):
    columns = {"time_s": truth.time_s, **{f"{name}_deg_s": truth[name] * (-1 if name != "p" else 1) for name in GYROS}}
    pd.DataFrame(columns | {f"{name}_deg": truth[name] for name in ATTITUDE}).to_csv(tmp_path / "log.csv", index=False)
    assert not any(source.guessed for source in gb.open_log(tmp_path / "log.csv").sources)


@pytest.mark.parametrize(
    ("counts", "unit"),
    by_day([(1.0, "g"), (G, "m/s2"), (2048.0, "0.00048828125 g"), (16384.0, None), (1000.0, "")], 3, seed=3),
)
@pytest.mark.parametrize("mounted", ["left and up", "as named"])
def test_accelerometers_without_a_unit_feel_one_g(tmp_path, truth, counts, unit, mounted):
    """Milligrams can't be told from 1,024 counts a g, and are asked for."""
    path = logged(truth, tmp_path / "log.csv", MOUNTED.get(mounted, np.eye(3)))
    table = pd.read_csv(path)
    table = table.rename(columns={f"acc_{a} [m/s2]": f"acc_{a}" for a in "xyz"})
    table[[f"acc_{a}" for a in "xyz"]] *= counts / G
    table.to_csv(path, index=False)
    log = gb.open_log(path)
    check(log, truth)
    told = {source.channel: source.unit for source in log.sources if source.channel in ACCELEROMETERS}
    assert bool(told) == (unit != "")
    assert not unit or set(told.values()) == {unit}


@pytest.mark.parametrize("counts", [131.0, 65.5, 32.8, 16.4, 57.14])
def test_counts_of_a_usual_sensor_are_known_beside_an_attitude(tmp_path, truth, counts):
    """131 a deg/s were once read as hundredths: a scale that is wrong by a third."""
    table = {"t [s]": truth.time_s, **{f"g{a}": np.round(counts * truth[n]) for a, n in zip("xyz", GYROS, strict=True)}}
    table |= {name: truth[own] for name, own in zip(("roll", "pitch", "yaw"), ATTITUDE, strict=True)}
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    check(gb.open_log(tmp_path / "log.csv", needs=(*GYROS, *ATTITUDE)), truth)


@pytest.mark.parametrize("scale", by_day([75.0, 30.0, 200.0, 3.0], 2))
def test_counts_of_no_sensor_that_is_known_are_asked_for(tmp_path, truth, scale):
    table = {"t [s]": truth.time_s, **{f"g{a}": scale * truth[n] for a, n in zip("xyz", GYROS, strict=True)}}
    table |= {name: truth[own] for name, own in zip(("roll", "pitch", "yaw"), ATTITUDE, strict=True)}
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(gb.InputError):
        gb.open_log(tmp_path / "log.csv", needs=GYROS)
