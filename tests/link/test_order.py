"""Samples are put in order within a bound: each once, by what arrived and not by when."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.link.packets import LinkSample
from gtmbench.link.rows import BOUND_S, InOrder, LinkRows, Numbering, Route, SenderClock, measured_period

PERIOD_S = 0.01
WITHIN = int(BOUND_S / PERIOD_S) - 1  # samples by which one may be late


def sample(place, topic=""):
    return LinkSample(topic=topic, time_s=place * PERIOD_S, values=(float(place),))


@st.composite
def arrivals(draw):
    """Draw places in an order in which none is late by more than the bound, some lost, some twice."""
    places = draw(st.lists(st.integers(0, 300), min_size=2, unique=True).map(sorted))
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    late = np.array(places) + random.uniform(0, WITHIN, len(places))
    order = [places[k] for k in np.argsort(late, kind="stable")]
    for _ in range(draw(st.integers(0, 5))):
        order.insert(int(random.integers(1, len(order) + 1)), order[0])
    return places, order


@given(arrivals())
def test_what_is_late_within_the_bound_is_put_in_its_place(drawn):
    places, arrived = drawn
    order = InOrder(PERIOD_S)
    order.push(sample(-1))
    given_ = [each for place in arrived for each in order.push(sample(place))] + order.rest()
    assert [round(each.time_s / PERIOD_S) for each in given_] == places
    assert order.doubled == len(arrived) - len(places)
    assert order.late == 0
    assert order.lost == places[-1] + 1 - len(places)


def test_what_is_later_is_lost_and_counted():
    order = InOrder(PERIOD_S)
    given_ = [each for place in [0, *range(2, 40), 1] for each in order.push(sample(place))]
    assert [round(each.time_s / PERIOD_S) for each in given_] == [0, *range(2, 40)]
    assert (order.late, order.lost, order.doubled) == (1, 1, 0)


def test_a_sample_in_order_waits_for_nothing():
    order = InOrder(PERIOD_S)
    assert all(len(order.push(sample(place))) == 1 for place in range(50))


def test_memory_stays_bounded_whatever_is_missing():
    order = InOrder(PERIOD_S)
    for place in range(0, 5000, 3):
        order.push(sample(place))
        assert len(order._waiting) <= WITHIN + 3


def rows_of(rows, samples):
    given_ = [record for each in samples if (record := rows.push([each])) is not None]
    last = rows.end()
    return np.concatenate([record.values for record in [*given_, *([] if last is None else [last])]])


ROUTES = [Route(topic="a", channels=("p",), period_s=PERIOD_S), Route(topic="b", channels=("phi",), period_s=PERIOD_S)]


def test_two_messages_of_one_clock_become_rows_as_they_are():
    samples = [sample(place, topic) for place in range(100) for topic in "ab"]
    assert rows_of(LinkRows(ROUTES, 0.0, PERIOD_S), samples).tolist() == [[place, place] for place in range(100)]


@pytest.mark.parametrize("many", [2, 50, 5000])
def test_rows_are_the_same_in_whatever_pieces(many):
    random = np.random.default_rng(many)
    samples = [sample(place, topic) for place in range(900) for topic in ("ab" if not 300 <= place < 600 else "a")]
    samples = [each for each in samples if random.random() > 0.05]
    samples = [samples[k] for k in np.argsort(np.arange(len(samples)) + random.uniform(0, 5, len(samples)))]
    rows, alone = LinkRows(ROUTES, 0.0, PERIOD_S), rows_of(LinkRows(ROUTES, 0.0, PERIOD_S), samples)
    pieces = [rows.push(samples[k : k + many]) for k in range(0, len(samples), many)]
    values = np.concatenate([record.values for record in [*pieces, rows.end()] if record is not None])
    assert np.array_equal(values, alone, equal_nan=True)


def test_a_message_that_stops_leaves_rows_out_for_all_sensors_alike():
    """A sensor whose message a link loses hasn't dropped out."""
    samples = [sample(place, topic) for place in range(900) for topic in ("ab" if not 200 <= place < 600 else "a")]
    rows = LinkRows(ROUTES, 0.0, PERIOD_S)
    values = rows_of(rows, samples)
    lost = np.isnan(values)
    assert np.array_equal(lost[:, 0], lost[:, 1])
    assert 390 <= np.count_nonzero(lost[:, 0]) == rows.left_out <= 410
    assert values[~lost[:, 0]][:, 0].tolist() == np.flatnonzero(~lost[:, 0]).tolist()


def test_messages_that_come_faster_are_filtered_all_alike():
    """An operator between two channels stays what it is only if both are filtered."""
    time_s = np.arange(2000) * 0.005
    wave = np.sin(2.0 * time_s)
    routes = [Route(topic="a", channels=("p",), period_s=0.005), Route(topic="b", channels=("phi",), period_s=0.01)]
    samples = []
    for k, (at, value) in enumerate(zip(time_s, wave, strict=True)):
        samples.append(LinkSample(topic="a", time_s=at, values=(value,)))
        if k % 2 == 0:
            samples.append(LinkSample(topic="b", time_s=at, values=(value,)))
    rows = LinkRows(routes, 0.0, 0.01)
    given_ = [record for each in samples if (record := rows.push([each])) is not None]
    values = np.concatenate([record.values for record in given_])
    assert given_[0].start_s == pytest.approx(0.13)
    assert np.abs(values[:, 0] - values[:, 1]).max() < 1e-4
    assert np.abs(values[:, 0] - np.sin(2.0 * (0.13 + 0.01 * np.arange(len(values))))).max() < 1e-4


def test_a_period_is_measured_through_loss_and_disorder():
    random = np.random.default_rng(1)
    places = random.permutation(np.flatnonzero(random.random(300) > 0.1))
    assert measured_period((places * 0.02).tolist()) == pytest.approx(0.02, rel=0.01)
    assert measured_period([1.0]) == np.inf


def test_a_late_stamp_is_no_jump_and_two_clocks_are_found():
    clock = SenderClock()
    pushed = [clock.push(at) for at in (10.0, 10.1, 3.0, 10.2, 10.3)]
    assert (pushed, clock.has_jumped, clock.is_mixed) == ([True, True, False, True, True], False, False)
    for k in range(20):
        clock.push(10.4 + 0.1 * k)
        clock.push(500.0 + 0.1 * k)
    assert clock.is_mixed


def test_numbers_that_are_lost_or_reordered_are_one_senders():
    random = np.random.default_rng(2)
    order = np.argsort(np.arange(2000) + random.uniform(0, 4, 2000))
    numbering = Numbering()
    for number in order[random.random(2000) > 0.1]:
        numbering.push(int(number) % 256)
        assert not numbering.is_mixed


def test_the_values_of_messages_are_those_of_the_record():
    from gtmbench.link.telemetry import Telemetry
    from tests.helpers import links, monitors

    record = monitors.record(100, seed=3)
    telemetry = Telemetry()
    read = {name: [] for name in ("p", "q", "r", "phi", "theta", "psi")}
    for _, packet in links.packets(record):
        for message in telemetry.read(packet, is_whole=True):
            channels = ("p", "q", "r") if message.topic == "HIGHRES_IMU" else ("phi", "theta", "psi")
            for name, value in zip(channels, telemetry.sample(message, channels).values, strict=True):
                read[name].append(value)
    for name, values in read.items():
        assert np.abs(np.array(values) - record[name]).max() < 1e-5, name
    assert isinstance(record, gb.Record)
