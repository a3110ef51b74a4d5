"""Logs: what was written comes back bit for bit, and a file that isn't a log is refused by name."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gtmbench.errors import InputError
from gtmbench.files.logs import read_log, write_log
from gtmbench.values.channels import CHANNELS
from gtmbench.values.record import Record
from tests.helpers.night import by_day

ENDINGS = (".csv", ".parquet")
PERIODS = (0.01, 0.02, 0.03, 0.04, 1 / 30, 1 / 60, 1 / 128, 0.001)
NAMES = (*CHANNELS, "strain_3", "Vane left", "u1", "température")


@st.composite
def records(draw):
    channels = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=4, unique=True))
    shape = (draw(st.integers(2, 12)), len(channels))
    values = draw(arrays(np.float64, shape, elements=st.floats(allow_infinity=False)))
    start_s = draw(st.floats(-1e5, 1e5))
    return Record(values, channels=channels, sample_period_s=draw(st.sampled_from(PERIODS)), start_s=start_s)


def bits(values):
    """Return the bits of every number, so that -0.0 isn't 0.0; one pattern for every NaN."""
    return np.where(np.isnan(values), np.nan, values).view(np.int64)


@pytest.mark.parametrize("ending", by_day(ENDINGS))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(record=records())
def test_a_log_comes_back_bit_for_bit(ending, record, tmp_path):
    write_log(record, tmp_path / f"flight{ending}")
    again = read_log(tmp_path / f"flight{ending}")
    assert np.array_equal(bits(again.values), bits(record.values))
    assert again.channels == record.channels
    assert again.sample_period_s == record.sample_period_s
    assert again.start_s == record.start_s


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("channels", [["p", "p_2"], ["p", "p_deg_s"], ["p", "time_s"]], ids=" ".join)
def test_a_log_that_cant_be_read_back_isnt_written(tmp_path, ending, channels):
    """A second roll gyro may be called p_2: its log is either refused at once or read back as it was."""
    record = Record(np.arange(2.0 * len(channels)).reshape(2, -1), channels=channels, sample_period_s=0.01)
    path = tmp_path / f"flight{ending}"
    try:
        write_log(record, path)
    except InputError:
        assert not path.exists()
    else:
        assert read_log(path).channels == record.channels


def columns(path):
    if path.suffix == ".csv":
        return path.read_text(encoding="utf-8").splitlines()[0].split(",")
    return list(pd.read_parquet(path).columns)


@pytest.mark.parametrize("ending", ENDINGS)
def test_headers_carry_the_units(tmp_path, ending):
    path = tmp_path / f"flight{ending}"
    channels = ["p", "beta", "ny", "tas", "altitude", "throttle", "strain_3"]
    write_log(Record(np.ones((2, 7)), channels=channels, sample_period_s=0.01), path)
    units = ["p_deg_s", "beta_deg", "ny_g", "tas_kt", "altitude_ft", "throttle_percent", "strain_3"]
    assert columns(path) == ["time_s", *units]


def log(folder, text):
    path = folder / "flight.csv"
    path.write_text(text, encoding="utf-8")
    return path


NO_LOGS = {
    "radians": ("time_s,p_rad_s\n0,1\n1,2\n", "'p_rad_s' isn't in this package's unit.*name it 'p_deg_s'"),
    "no unit": ("time_s,p\n0,1\n1,2\n", "'p' doesn't state its unit: channel 'p' is in deg/s.*name it 'p_deg_s'"),
    "metres": ("time_s,tas_m_s\n0,1\n1,2\n", "channel 'tas' is in kt"),
    "no time": ("p_deg_s\n1\n2\n", "needs its time"),
    "header only": ("time_s,p_deg_s\n", "0 time stamps"),
    "one row": ("time_s,p_deg_s\n0,1\n", "1 time stamps"),
    "gap": ("time_s,p_deg_s\n0.0,1\n0.1,2\n0.2,2\n0.5,2\n0.6,2\n", "a gap after t = 0.2 s"),
    "no stamp": ("time_s,p_deg_s\n0,1\n,2\n2,3\n", "time stamp of row 1 is nan"),
    "text": ("time_s,p_deg_s\n0,1\n1,stuck\n", "must hold numbers"),
    "clock": ("time_s,p_deg_s\n00:01,1\n00:02,2\n", "time"),
    "twice": ("time_s,p_deg_s,p_deg_s\n0,1,2\n1,2,3\n", "p_deg_s"),
    "prose": ("just a note", "needs its time"),
}


@pytest.mark.parametrize("case", NO_LOGS)
def test_a_csv_that_is_no_log_is_refused_by_name(tmp_path, case):
    text, message = NO_LOGS[case]
    path = log(tmp_path, text)
    with pytest.raises(InputError, match=message) as refused:
        read_log(path)
    assert str(refused.value).startswith(str(path))


@pytest.mark.parametrize("extra", ["", "3"], ids=["comma at the end", "one field more"])
def test_no_column_slides_under_the_name_of_its_neighbour(tmp_path, extra):
    """Rows with a field more than the header are refused, or their named columns are read as they are named."""
    path = log(tmp_path, f"time_s,p_deg_s,q_deg_s\n0,10,20,{extra}\n1,11,21,{extra}\n")
    try:
        record = read_log(path)
    except InputError:
        return
    assert (record["p"].tolist(), record["q"].tolist()) == ([10, 11], [20, 21])


GARBAGE = [b"", bytes(range(256)) * 8, b"\x00" * 64, b"\xff\xfe\n\x80", b"PAR1 no parquet PAR1"]


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("content", GARBAGE, ids=["empty", "bytes", "zeros", "latin", "magic"])
def test_garbage_is_refused_by_name(tmp_path, ending, content):
    path = tmp_path / f"flight{ending}"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_log(path)
    assert str(refused.value).startswith(str(path))


@pytest.mark.parametrize("name", ["flight.xlsx", "flight", "flight.csv.gz"])
def test_another_ending_is_refused_with_the_legal_ones(tmp_path, name):
    record = Record([1.0, 2.0], channels=["p"], sample_period_s=0.01)
    for use in (lambda: write_log(record, tmp_path / name), lambda: read_log(tmp_path / name)):
        with pytest.raises(InputError, match=r"\.csv or \.parquet"):
            use()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_missing_file_or_folder_is_named(tmp_path, ending):
    record = Record([1.0, 2.0], channels=["p"], sample_period_s=0.01)
    with pytest.raises(InputError, match="no such file"):
        read_log(tmp_path / f"none{ending}")
    with pytest.raises(InputError, match="doesn't exist; create it first"):
        write_log(record, tmp_path / "folder" / f"flight{ending}")
    assert list(tmp_path.iterdir()) == []


def test_dates_are_refused_not_taken_for_seconds(tmp_path):
    dates = pd.date_range("2026-01-01", periods=5, freq="10ms")
    frame = pd.DataFrame({"time_s": dates, "p_deg_s": np.arange(5.0)})
    frame.to_parquet(tmp_path / "dates.parquet")
    with pytest.raises(InputError, match="column 'time_s' holds dates; give seconds"):
        read_log(tmp_path / "dates.parquet")
    with pytest.raises(InputError, match="holds dates"):
        Record.from_frame(frame.set_index("time_s"))


def test_rounded_stamps_need_a_stated_period(tmp_path):
    """60 Hz with stamps of a millisecond: 16, 17, 17, 16 ms apart."""
    stamps = np.round(5.0 + np.arange(200) / 60.0, 3)
    pd.DataFrame({"time_s": stamps, "p_deg_s": np.arange(200.0)}).to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(InputError, match="state sample_period_s, if stamps are rounded"):
        read_log(tmp_path / "log.csv")
    record = read_log(tmp_path / "log.csv", sample_period_s=1 / 60)
    assert (record.sample_period_s, record.start_s, len(record)) == (1 / 60, 5.0, 200)
