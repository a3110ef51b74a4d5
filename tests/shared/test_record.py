"""`Record`: it can't be changed, its times are exact, and what can't be meant is refused."""

from fractions import Fraction
from itertools import product

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.errors import InputError
from gtmbench.values.clock import even_period_s
from gtmbench.values.record import Record

# as they are meant, and as they are typed
PERIODS = {
    Fraction(1, 100): 0.01,
    Fraction(1, 50): 0.02,
    Fraction(3, 100): 0.03,
    Fraction(1, 25): 0.04,
    Fraction(1, 30): 1 / 30,
    Fraction(1, 60): 1 / 60,
    Fraction(1, 128): 1 / 128,
    Fraction(1, 1000): 0.001,
}
CLOCKS = (0.0, 12.34, 1e5, 1.7e9)  # the last one is a Unix time


def ramp(samples=50_001, period=0.01, start_s=0.0):
    """Return a record whose value is its sample number."""
    return Record(range(samples), channels=["p"], sample_period_s=period, start_s=start_s)


def test_a_record_keeps_its_own_copy_of_the_values():
    given_values = np.zeros((5, 2))
    record = Record(given_values, channels=["p", "q"], sample_period_s=0.01)
    given_values[:] = 7.0
    assert not record.values.any()


@pytest.mark.parametrize(
    "array",
    [lambda record: record.values, lambda record: record["p"], lambda record: record.matrix(["q", "p"])],
    ids=["values", "channel", "matrix"],
)
def test_no_array_of_a_record_can_be_written(array):
    record = Record(np.zeros((5, 2)), channels=["p", "q"], sample_period_s=0.01)
    with pytest.raises(ValueError, match="read-only"):
        array(record)[0] = 1.0


@pytest.mark.parametrize("name", ["values", "channels", "sample_period_s", "start_s"])
def test_no_attribute_of_a_record_can_be_set(name):
    record = ramp(5)
    with pytest.raises(AttributeError):
        setattr(record, name, getattr(record, name))


def test_select_reorders_and_replace_touches_one_channel():
    record = Record([[1, 2, 3], [4, 5, 6]], channels=["p", "q", "r"], sample_period_s=0.01, start_s=3.0)
    assert record.select(["r", "p"]).values.tolist() == [[3, 1], [6, 4]]
    changed = record.replace("q", [8, 9])
    assert changed.values.tolist() == [[1, 8, 3], [4, 9, 6]]
    assert (changed.start_s, changed.sample_period_s) == (3.0, 0.01)
    assert record["q"].tolist() == [2, 5]


@given(
    meant=st.sampled_from(sorted(PERIODS)),
    start_s=st.integers(-1000, 1000),
    ends=st.lists(st.integers(0, 2000), min_size=2, max_size=2).map(sorted),
)
def test_between_the_times_of_two_samples_holds_both_of_them(meant, start_s, ends):
    first, last = ends
    record = ramp(2001, PERIODS[meant], start_s)
    part = record.between(record.time_s[first], record.time_s[last])
    assert part["p"].tolist() == list(range(first, last + 1))
    np.testing.assert_allclose(part.time_s, record.time_s[first : last + 1], rtol=0, atol=1.5e-9)


@pytest.mark.parametrize(
    "span", [(-0.01, 1), (0, 10.01), (5, 4), (0.001, 0.009), (-1, 99), (0, np.inf), (-np.inf, 1), (np.nan, 1)], ids=str
)
def test_a_span_that_isnt_in_the_record_is_refused(span):
    with pytest.raises(InputError, match="isn't a span of this record, which runs from 0 to 10 s"):
        ramp(1001).between(*span)


@pytest.mark.parametrize("meant", PERIODS, ids=str)
def test_every_time_is_the_nearest_float_to_its_nanosecond(meant):
    record = ramp(50_001, PERIODS[meant])
    exact = [float(Fraction(round(k * meant * 10**9), 10**9)) for k in range(0, 50_001, 10)]
    assert record.time_s[::10].tolist() == exact
    assert record.end_s == exact[-1]


@pytest.mark.parametrize("meant", PERIODS, ids=str)
def test_the_period_is_found_again_from_the_times_whatever_the_clock(meant):
    for samples, start_s in product((2, 3, 1000, 50_001), CLOCKS):
        assert even_period_s(ramp(samples, PERIODS[meant], start_s).time_s) == PERIODS[meant], (samples, start_s)


@pytest.mark.parametrize("meant", PERIODS, ids=str)
def test_a_frame_makes_the_same_record_again(meant):
    rng = np.random.default_rng(2)
    values = rng.standard_normal((300, 3))
    values[17, 1] = np.nan
    record = Record(values, channels=["p", "beta", "strain_3"], sample_period_s=PERIODS[meant], start_s=12.5)
    again = Record.from_frame(record.frame())
    np.testing.assert_array_equal(again.values, record.values)
    assert again.channels == record.channels
    assert (again.sample_period_s, again.start_s) == (record.sample_period_s, 12.5)


def test_a_frame_may_name_its_channels_by_header_and_be_told_its_period():
    frame = pd.DataFrame({"p_deg_s": [1.0, 2.0], "strain_3": [3.0, 4.0]})
    record = Record.from_frame(frame, sample_period_s=0.5)
    assert (record.channels, record.start_s, record.end_s) == (("p", "strain_3"), 0.0, 0.5)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (pd.DataFrame({"p": [1.0, 2.0]}), "needs its time"),
        (pd.DataFrame({"time_s": [0.0, 1.0], "p": ["a", "b"]}), "must hold numbers"),
        (pd.DataFrame({"time_s": ["00:01", "00:02"], "p": [1.0, 2.0]}), "time"),
        (pd.DataFrame({"time_s": [0.0], "p": [1.0]}), "1 time stamps give no sample period"),
        (pd.DataFrame({"time_s": [0.0, 1.0], "p_rad_s": [1.0, 2.0]}), "convert it and name it 'p_deg_s'"),
    ],
    ids=["no time", "text", "clock text", "one row", "radians"],
)
def test_a_frame_that_is_no_record_is_refused(frame, message):
    with pytest.raises(InputError, match=message):
        Record.from_frame(frame)


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        ([0, 1, 2, 4, 5, 6], r"a gap after t = 2 s \(row 2\): the next stamp comes 2 s later, the others every 1 s"),
        ([0, 1, 2, 2, 3, 4], r"a doubled or early stamp after t = 2 s \(row 2\)"),
        ([0, 1, 2, 1.5, 3, 4], r"a doubled or early stamp after t = 2 s \(row 2\)"),
        ([3, 2, 1, 0], "runs backwards"),
        ([1, 1, 1, 1], "stands still"),
        ([0, 1, np.nan, 3], "time stamp of row 2 is nan"),
        ([0, 1, 2, np.inf], "time stamp of row 3 is inf"),
        ([0.0], "1 time stamps give no sample period"),
        ([], "0 time stamps give no sample period"),
    ],
    ids=["gap", "doubled", "early", "backwards", "still", "nan", "inf", "one", "none"],
)
def test_uneven_time_is_refused_by_the_first_stamp_that_is_wrong(stamps, message):
    with pytest.raises(InputError, match=message):
        even_period_s(np.array(stamps, dtype=float))


@pytest.mark.parametrize(
    ("values", "keywords", "message"),
    [
        ([[1, 2], [3]], {}, "rows of equal length"),
        ([["a", "b"]], {}, "must be numbers"),
        ([[1, 2, 3]], {}, r"shape \(1, 3\) don't fit 2 channels"),
        ([1, 2], {}, r"shape \(2,\) don't fit 2 channels"),
        (5.0, {}, r"shape \(\) don't fit 2 channels"),
        ([[1, 2]], {"channels": ["p", "p"]}, "given twice: p"),
        ([[1, 2]], {"sample_period_s": 0.0}, "sample_period_s is 0.0"),
        ([[1, 2]], {"sample_period_s": -0.01}, "sample_period_s is -0.01"),
        ([[1, 2]], {"sample_period_s": np.nan}, "sample_period_s is nan"),
        ([[1, 2]], {"sample_period_s": np.inf}, "sample_period_s is inf"),
        ([[1, 2]], {"start_s": np.nan}, "start_s is nan"),
        ([[1, 2]], {"start_s": np.inf}, "start_s is inf"),
    ],
)
def test_what_cant_be_a_record_is_refused(values, keywords, message):
    with pytest.raises(InputError, match=message):
        Record(values, **{"channels": ["p", "q"], "sample_period_s": 0.01, **keywords})


def test_an_unknown_channel_is_refused_with_the_ones_there_are():
    record = Record([[1, 2]], channels=["p", "q"], sample_period_s=0.01)
    for ask in (lambda: record["r"], lambda: record.select(["p", "r"]), lambda: record.replace("r", [1])):
        with pytest.raises(InputError, match="no channel 'r' in this record; it has p, q"):
            ask()


def test_replacing_a_channel_by_one_of_another_length_is_refused():
    with pytest.raises(InputError):
        ramp(5).replace("p", [1.0, 2.0])


def test_a_stated_period_that_the_stamps_contradict_is_refused():
    """Rows that are missing must not be squeezed together; stamps that are rounded may."""
    frame = pd.DataFrame({"time_s": np.arange(400) / 25, "p": np.arange(400.0)})
    with pytest.raises(InputError, match=r"350 rows every 0\.04 s last 13\.96 s, .* after 3\.96 s, row 99\): rows are"):
        Record.from_frame(frame.drop(index=range(100, 150)), sample_period_s=0.04)
    with pytest.raises(InputError, match="the period is another"):
        Record.from_frame(frame, sample_period_s=0.05)
    for digits in (1, 2, 3):  # to more than a period, too
        rounded = frame.assign(time_s=frame["time_s"].round(digits))
        assert Record.from_frame(rounded, sample_period_s=0.04).end_s == pytest.approx(15.96)


@pytest.mark.parametrize("names", [[0, 1], ["p", ""], ["p", "a\nb"], ["p", None]], ids=range(4))
def test_names_that_arent_words_are_refused(names):
    with pytest.raises(InputError, match="channel names must be words"):
        Record(np.ones((3, 2)), channels=names, sample_period_s=1.0)


def test_what_is_there_is_what_is_finite_or_only_not_known():
    values = [[1.0, np.nan], [np.nan, 2.0], [np.inf, np.nan]]
    record = Record(values, channels=["p", "q"], sample_period_s=1.0)
    np.testing.assert_array_equal(record.there, np.isfinite(values))
    known = Record(values, channels=["p", "q"], sample_period_s=1.0, there=[[0, 0], [1, 0], [0, 1]])
    expected = np.array([[True, False], [True, True], [False, True]])
    np.testing.assert_array_equal(known.there, expected)
    np.testing.assert_array_equal(known.select(["q"]).there, expected[:, 1:])
    np.testing.assert_array_equal(known.between(1.0, 2.0).there, expected[1:])
    np.testing.assert_array_equal(known.replace("p", [np.nan] * 3).there[:, 0], [False, True, False])
    np.testing.assert_array_equal(known.replace("p", [3.0] * 3).there[:, 0], [True] * 3)
    assert (record.is_in_part_unknown, known.is_in_part_unknown) == (False, True)
    with pytest.raises(ValueError, match="read-only"):
        known.there[0] = True
    with pytest.raises(InputError, match=r"what is there has shape \(2,\), values have \(3, 2\)"):
        Record(values, channels=["p", "q"], sample_period_s=1.0, there=[True, False])
