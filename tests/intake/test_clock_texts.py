"""Dates, times of day and durations as text: however a program writes them, the same seconds come back."""

from datetime import datetime, timedelta

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.intake.formats.clock_texts import ClockKind, clock_texts
from tests.helpers.night import by_day

# how a moment may be written, and what of it a reader is told
STYLES = {
    "ISO": ("{:%Y-%m-%dT%H:%M:%S}.{f}", ClockKind.STAMP),
    "a zone": ("{:%Y-%m-%d %H:%M:%S}.{f} +0200", ClockKind.STAMP),
    "days first": ("{:%d.%m.%Y %H:%M:%S},{f}", ClockKind.STAMP),
    "slashes, a year first": ("{:%Y/%m/%d %H:%M:%S}.{f}", ClockKind.STAMP),
    "12 hours": ("{:%m/%d/%Y %I:%M:%S}.{f} {:%p}", ClockKind.STAMP),
    "12 hours without a date": ("{:%I:%M:%S}.{f} {:%p}", ClockKind.CLOCK),
    "a clock": ("{:%H:%M:%S}.{f}", ClockKind.CLOCK),
    "a colon before what is beyond seconds": ("{:%H:%M:%S}:{f}", ClockKind.CLOCK),
    "12 hours without halves": ("{:%I:%M:%S}.{f}", ClockKind.CLOCK),
    "minutes and seconds": ("{:%M:%S}.{f}", ClockKind.CLOCK),
}


def written(style, moment):
    return STYLES[style][0].replace("{f}", f"{moment.microsecond // 1000:03d}").format(moment, moment)


@pytest.mark.parametrize("style", by_day(STYLES, 5, seed=78))
@given(st.datetimes(datetime(2001, 1, 1), datetime(2049, 1, 1)), st.integers(20, 900), st.integers(0, 20))
def test_a_moment_comes_back_however_it_is_written(style, first, step_ms, missing):
    """Beyond noon, midnight and the ends of months; no log lasts 12 hours between two rows."""
    first = first.replace(microsecond=first.microsecond // 1000 * 1000)
    moments = [first + timedelta(milliseconds=step_ms * k) for k in range(40)]
    cells = [written(style, moment) for moment in moments]
    cells[missing] = None
    told = clock_texts(cells)
    assert told.told is STYLES[style][1]
    expected = step_ms * (np.arange(40) - (missing == 0)) / 1e3
    expected[missing] = np.nan
    np.testing.assert_allclose(told.seconds, expected, atol=1e-9)


@pytest.mark.parametrize("step", ["1D", "20ms", "3h"])
def test_what_pandas_saves_comes_back(step):
    index = pd.timedelta_range("0s", periods=50, freq=step)
    told = clock_texts(list(index.astype(str)))
    assert told.told is ClockKind.DURATION
    np.testing.assert_allclose(told.seconds, index.total_seconds())


def test_day_and_month_are_told_apart_where_anything_does():
    midnight = ["04/05/2026 23:59:59.5", "04/06/2026 00:00:00.5"]
    assert clock_texts(midnight).seconds.tolist() == [0.0, 1.0]
    assert clock_texts(midnight).since_s == datetime(2026, 4, 5, 23, 59, 59, 500_000).timestamp() - _zone_s()
    note = clock_texts(["04/05/2026 10:00:00", "04/05/2026 10:00:01"]).note
    assert note.startswith("date and time: times are since the first, 10:00:00.000; which is its day")
    for cells in (["04.05.2026 10:00:00", "04.05.2026 10:00:01"], ["23/05/2026 10:00:00", "23/05/2026 10:00:01"]):
        assert "isn't known" not in clock_texts(cells).note


def _zone_s():
    return datetime(1970, 1, 1).timestamp()


@pytest.mark.parametrize(
    "cells",
    [
        ["on", "off"],
        ["1.2.3", "1.2.4"],  # a version
        ["12:30", "12:31"],  # a clock without seconds, or a ratio
        ["HC-06(00:0C:BF:19:3F:0D)"] * 3,
        ["5 m", "6 m"],
        [None, ""],
    ],
)
def test_other_words_are_no_times(cells):
    assert clock_texts(cells) is None


def test_a_date_stands_beside_its_clock():
    days, clocks = clock_texts(["31.12.2025", "01.01.2026"]), clock_texts(["23:59:59.0", "00:00:01.0"])
    assert days.told is ClockKind.DAY
    both = clocks.on(days)
    assert both.seconds.tolist() == [0.0, 2.0]
    assert both.since_s == datetime(2025, 12, 31, 23, 59, 59).timestamp() - _zone_s()
