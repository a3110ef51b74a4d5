"""What of a log is taken as healthy where nobody says what is, and what is too little or too slow to learn from."""

from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.gyro_figures import _blocks, _median
from gtmbench.log.opening import records
from gtmbench.log.opening.records import between_pauses, flying_part, healthy_spans, lively_seconds


def log_of(seconds=1000.0, period_s=0.5):
    record = gb.Record(np.zeros((round(seconds / period_s) + 1, 1)), channels=["p"], sample_period_s=period_s)
    return FlightLog(path=Path("log.csv"), segments=(record,), remarks=(), method=())


@pytest.mark.parametrize(
    ("turning", "lively"),
    [
        ([1.4, 1.6] * 10, [1.6]),  # deg/s
        ([1.9, 2.1] * 5 + [10.0] * 10, [2.1, 10.0]),  # a fifth of the liveliest tenth
        ([1.9] * 17 + [10.0] * 3, [10.0]),
        ([1.9] * 19 + [10.0], [1.9, 10.0]),  # of which one second of twenty is none
    ],
)
def test_what_turns_is_lively_by_itself_and_beside_the_liveliest(turning, lively, monkeypatch):
    monkeypatch.setattr(records, "turning_by_second", lambda _: (np.array(turning), np.array(turning)))
    assert sorted({*lively_seconds([]).tolist()}) == lively


def every(step, count, since=0.0):
    return since + step * np.arange(count)


HANDLED = every(1.0, 5, 100.0)


@pytest.mark.parametrize(
    ("lively_s", "span"),
    [
        (every(1.0, 600, 300.0), (300.0, 541.0)),  # 40 % of the motion
        (every(1.0, 10, 300.0), (300.0, 360.0)),  # a minute at least
        (every(1.0, 20, 900.0), (900.0, 940.0)),  # or 40 % of what is left
        (every(1.0, 1000), (0.0, 300.0)),  # five at most
        (every(1.0, 100, 49.0), (0.0, 90.0)),  # from the log's begin on, where motion begins soon
        (every(1.0, 100, 51.0), (51.0, 111.0)),
        (every(1.0, 9, 500.0), (0.0, 300.0)),  # hardly any motion: of the log
        (np.r_[HANDLED, every(1.0, 12, 500.0)], (500.0, 560.0)),  # motion that lasts, if it is twice as much
        (np.r_[HANDLED, every(1.0, 10, 500.0)], (100.0, 400.0)),
        (np.r_[HANDLED, every(2.2, 30, 500.0)], (500.0, 560.0)),  # ten seconds of it within twenty
        (np.r_[HANDLED, every(2.3, 30, 500.0)], (100.0, 400.0)),
    ],
)
def test_what_is_taken_is_the_first_part_of_the_motion(lively_s, span, monkeypatch):
    monkeypatch.setattr(records, "lively_seconds", lambda _: lively_s)
    assert flying_part(log_of(), ()) == span


@pytest.mark.parametrize(("missing", "parts"), [(2, 1), (3, 2)])
def test_records_are_cut_where_three_samples_in_a_row_are_missing(missing, parts):
    values = np.ones((400, 2))
    values[200 : 200 + missing, 1] = np.nan
    record = gb.Record(values, channels=["p", "q"], sample_period_s=0.02)
    assert len(between_pauses([record], ["p", "q"])) == parts
    assert len(between_pauses([record], ["p"])) == 1


@pytest.mark.parametrize(("period_s", "lasts", "is_enough"), [(1.0, 9, False), (1.0, 10, True), (0.9, 9, True)])
def test_of_samples_a_second_apart_and_more_ten_are_the_fewest(period_s, lasts, is_enough):
    log, given = log_of(100.0, period_s), [(0.0, lasts * period_s)]
    if is_enough:
        assert healthy_spans(log, given) == tuple(given)
    else:
        with pytest.raises(gb.InputError, match=r"hold too few samples of log\.csv, which are 1 s apart"):
            healthy_spans(log, given)


def test_attitude_and_gyros_come_two_and_a_half_times_a_second_at_least():
    records._check_rate(log_of(100.0, 0.38))
    with pytest.raises(gb.InputError, match=r"2\.38 samples a second; at least 2\.5 are needed"):
        records._check_rate(log_of(100.0, 0.42))


def test_a_gyros_figures_are_medians_of_three_blocks_of_ten_seconds_and_more_that_are_half_there():
    values = np.tile(np.arange(10.0), 4)
    values[[0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 15]] = np.nan
    assert [len(block) for block in _blocks(values[:39], 1.0)] == [10, 10]
    assert _median([np.ones(2), np.full(2, 3.0)]) == 2.0
    assert _median([np.ones(2)]) is None
    assert _median([np.ones(2), np.ones(1)]) == 1.0
