"""Every format: values as they were logged, units and signs right, and the same file as its own library reads it."""

import numpy as np
import pytest

import gtmbench as gb
from tests.helpers import log_makers as makers

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


@pytest.mark.parametrize("name", makers.MAKERS)
def test_it_is_listed(tmp_path, cli, name):
    code, out, err = cli("monitor", str(makers.make(tmp_path, name)), "--list")
    assert (code, err) == (0, "")
    assert all(f" {channel} " in out for channel in CHANNELS)
