"""A gyro that acceleration leaks into: told by the accelerometers where a record has them, and by nothing else."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.isolation.case import WITNESSES
from tests.helpers import monitors
from tests.helpers.night import by_day

ONSET_S, COEFFICIENT = 60.0, 3.0


@pytest.fixture(scope="module")
def monitor():
    return monitors.monitor("C")


@pytest.fixture(scope="module")
def healthy():
    return monitors.record(6000, seed=11)


def leaking(record, channel="p"):
    return gb.inject(record, gb.GSensitivity(channel=channel, onset_s=ONSET_S, axis="nz", coefficient=COEFFICIENT))


def without(record):
    return record.select([name for name in record.channels if name not in WITNESSES])


def last(watched):
    (alarm,) = watched.faults
    return alarm.judgements[-1]


def pushed(monitor, chunks):
    stream = monitor.stream()
    for chunk in chunks:
        stream.push(chunk)
    return repr(stream.alarms)


@pytest.mark.parametrize("channel", by_day(["p", "q", "r"]))
def test_it_is_named_with_its_axis_and_measured(monitor, healthy, channel):
    judged = last(monitor.watch(leaking(healthy, channel)))
    assert (judged.sensor, judged.kind, judged.partner) == (channel, "g_sensitivity", "nz")
    low, high = judged.intervals["coefficient"]
    assert low < COEFFICIENT < high
    assert high - low < 0.1 * COEFFICIENT


@pytest.mark.nightly
def test_no_bank_needs_an_accelerometer_for_it_and_one_that_reads_nothing_is_none(monitor, healthy):
    assert not set(WITNESSES) & set(monitor.channels)
    broken = leaking(healthy)
    alone = monitor.watch(without(broken))
    assert last(alone).sensor == "p"
    assert last(alone).kind != "g_sensitivity"
    silent = monitor.watch(
        broken.replace("nz", np.full(len(broken), np.nan)).replace("ny", np.full(len(broken), np.nan))
    )
    assert repr(silent.alarms) == repr(alone.alarms)
    with_them = monitor.watch(broken)
    assert [(each.time_s, each.onset_s, each.source) for each in with_them.alarms] == [
        (each.time_s, each.onset_s, each.source) for each in alone.alarms
    ]


def test_at_a_constant_acceleration_it_is_a_bias(monitor, healthy):
    judged = last(monitor.watch(leaking(healthy.replace("nz", np.full(len(healthy), 1.0)))))
    assert (judged.sensor, judged.kind, judged.partner) == ("p", "bias", None)


@pytest.mark.nightly
@pytest.mark.parametrize("size", [1, 100])
def test_a_stream_that_loses_its_accelerometers_goes_on(monitor, healthy, size):
    broken = leaking(healthy)
    lost = np.arange(len(broken)) >= 3300  # between judgements
    known = broken
    for name in ("ny", "nz"):
        known = known.replace(name, np.where(lost, np.nan, broken[name]))
    parts = (without(chunk) if chunk.start_s > 65.99 else chunk for chunk in monitors.chunks(broken, size))
    said = monitor.watch(known)
    assert pushed(monitor, parts) == repr(said.alarms)
    assert any(judged.kind == "g_sensitivity" for judged in said.faults[0].judgements)


@pytest.mark.nightly
def test_an_accelerometer_that_drops_out_is_no_finding(monitor, healthy):
    gone = healthy.replace("nz", np.where(healthy.time_s > 30.0, np.nan, healthy["nz"]))
    assert monitor.watch(gone).alarms == ()
    assert pushed(monitor, monitors.chunks(gone, 1)) == "()"
