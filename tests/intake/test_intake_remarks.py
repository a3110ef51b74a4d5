"""What looks wrong in a log is remarked with its times, and what only looks so isn't."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.flight_log import Remark, summed_up

CHANNELS = ["p", "q", "r", "phi", "nz"]


@pytest.fixture(scope="module")
def flight():
    truth = gb.fly(duration_s=60, excitation="multisine+turbulence", seed=1)
    return gb.measure(truth, noise="t2", seed=1).select(CHANNELS)


@pytest.fixture
def remarked(tmp_path):
    def open_record(record, **options):
        gb.write_log(record, tmp_path / "log.csv")
        log = gb.open_log(tmp_path / "log.csv", **options)
        np.testing.assert_array_equal(
            log.segments[0].matrix(record.channels), np.where(np.isfinite(record.values), record.values, np.nan)
        )
        return log.remarks

    return open_record


def quantised(values, step):
    return step * np.round(values / step)


def test_a_healthy_flight_has_no_remarks(flight, remarked):
    assert remarked(flight) == ()


@pytest.mark.parametrize("bits", [16, 12, 10])
def test_nor_has_a_quantised_one(flight, remarked, bits):
    """Of gyros of 500 deg/s in 16, 12 and 10 bits (1 deg/s a step, twice the noise), nothing is stuck or at a limit."""
    for channel in "pqr":
        flight = flight.replace(channel, quantised(flight[channel], 1000 / 2**bits))
    assert remarked(flight) == ()


def test_nor_one_that_begins_at_rest(flight, remarked):
    """Before take-off quantised sensors stand still for minutes, all of them."""
    still = flight.time_s < 25
    for channel in CHANNELS:
        values = quantised(flight[channel], 0.05)
        flight = flight.replace(channel, np.where(still, values[0], values))
    assert remarked(flight) == ()


@pytest.mark.parametrize("channel", ["p", "q", "r"])
def test_a_gyro_that_is_stuck_is_remarked_and_left_as_it_is(flight, remarked, channel):
    (remark,) = remarked(gb.inject(flight, gb.Jam(channel=channel, onset_s=30, duration_s=12.0)))
    assert (remark.kind, remark.channel) == ("constant", channel)
    assert (remark.start_s, remark.end_s) == (pytest.approx(30, abs=0.02), pytest.approx(42, abs=0.02))
    assert "while others move" in remark.text


def test_a_channel_that_never_moves_is_constant(flight, remarked):
    (remark,) = remarked(flight.replace("r", np.full(len(flight), 3.5)))
    assert (remark.kind, remark.channel, remark.start_s, remark.end_s) == ("constant", "r", 0.0, 60.0)
    assert "r is 3.5 from start to end" in remark.text


@pytest.mark.parametrize("factor", [0.4, 0.7])
def test_a_gyro_at_its_limit_is_remarked(flight, remarked, factor):
    """At its greatest and its smallest value, with the share of samples that were cut off."""
    limit = factor * np.abs(flight["p"]).max()
    remarks = remarked(flight.replace("p", np.clip(flight["p"], -limit, limit)))
    assert {(remark.kind, remark.channel) for remark in remarks} == {("saturated", "p")}
    for remark in remarks:
        side = 1 if "greatest" in remark.text else -1
        cut_off = np.flatnonzero(side * flight["p"] >= limit)
        assert f"{len(cut_off)} samples" in remark.text
        assert (remark.start_s, remark.end_s) == (flight.time_s[cut_off[0]], flight.time_s[cut_off[-1]])


def test_missing_samples_are_counted_and_stay_missing_but_single_ones(flight, tmp_path):
    """One is told by its neighbours, three in a row aren't, nor those of a sensor that loses every other one."""
    values = flight["q"].copy()
    values[500:503], values[2000], values[4000:4100:2] = np.nan, np.inf, -np.inf
    gb.write_log(flight.replace("q", values), tmp_path / "log.csv")
    log = gb.open_log(tmp_path / "log.csv")
    remark, beyond = log.remarks
    assert (remark.kind, remark.channel, beyond.kind) == ("missing", "q", "out of range")
    assert "54 of 6001 samples are missing (NaN or out of range), in 52 places, at most 3 in a row" in remark.text
    assert (remark.start_s, remark.end_s) == (5.0, 40.98)
    (record,) = log.segments
    there = np.isfinite(values)
    np.testing.assert_array_equal(record["q"][there], values[there])
    assert np.isnan(record["q"][500:503]).all()
    assert abs(record["q"][2000] - flight["q"][2000]) < 4 * np.std(np.diff(flight["q"])) / np.sqrt(2)
    assert np.isnan(record["q"][4050:4100:2]).all()


@pytest.mark.parametrize(
    ("column", "message"),
    [("-nz:g", "g at the mean, level flight reads +1: its sign is turned"), ("p:g", "gravity taken off")],
)
def test_a_turned_vertical_acceleration_is_said_not_righted(flight, tmp_path, column, message):
    frame = flight.frame().reset_index()
    frame.to_csv(tmp_path / "log.csv", index=False)
    log = gb.open_log(tmp_path / "log.csv", mapping=[f"nz={column}"], needs=["nz"])
    (remark,) = log.remarks
    assert remark.kind == "sign"
    assert message in remark.text
    sign, name = (-1, "nz") if column.startswith("-") else (1, "p")
    np.testing.assert_array_equal(log.segments[0]["nz"], sign * flight[name])


def test_channels_that_arent_needed_are_remarked_on_in_nothing(flight, tmp_path):
    broken = flight.replace("r", np.full(len(flight), np.nan)).replace("phi", np.zeros(len(flight)))
    gb.write_log(broken, tmp_path / "log.csv")
    assert gb.open_log(tmp_path / "log.csv", needs=["p", "q"]).remarks == ()


def test_alike_remarks_are_summed_up():
    """However many there are: a few dozen at most, in time, none lost from the counts."""
    many = [
        Remark(kind=kind, channel=channel, start_s=float(k), end_s=k + 0.5, text=f"{channel} at {k} s")
        for k in range(200)
        for kind in ("gap", "constant", "saturated")
        for channel in (None, *(f"x{n}" for n in range(40)))
    ]
    few = summed_up(many)
    assert len(few) <= 36
    assert [remark.start_s for remark in few] == sorted(remark.start_s for remark in few)
    assert sum(int(remark.text.split()[0]) for remark in few) == len(many)
    assert all((remark.start_s, remark.end_s) == (0.0, 199.5) for remark in few)
