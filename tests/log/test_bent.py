"""A monitor calibrated for an attitude of its own, on a log whose attitude the gyros drive: one name at most."""

from pathlib import Path

import pytest

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from tests.helpers import monitors
from tests.helpers.autopilot_logs import px4
from tests.helpers.night import by_day

ONSET_S = 60.0
BANK_C = Path(gb.__file__).parent / "baselines" / "bank-C.json"


@pytest.mark.parametrize("channel", by_day(["p", "q", "r"]))
@pytest.mark.parametrize("time_constant_s", by_day([1.0, 5.0]))
def test_no_other_sensor_is_accused_for_what_a_gyro_did_to_the_attitude(tmp_path, channel, time_constant_s):
    broken = gb.inject(monitors.record(6000, seed=31), gb.Bias(channel=channel, onset_s=ONSET_S, size=6.0))
    driven = gb.filtered_attitude(broken, reference_noise_deg=0.05, time_constant_s=time_constant_s, seed=1)
    (tmp_path / "flight.ulg").write_bytes(px4(driven))
    watched = gb.watch_log(tmp_path / "flight.ulg", monitors.monitor("C"))
    assert any("calibrated for one of its own" in reason for reason in watched.reasons)
    accused = [alarm.sensor for alarm in watched.alarms if not (alarm.has_passed or alarm.doubt)]
    assert accused in ([channel], [])
    assert watched.alarms  # that something is wrong is said, whoever it is
    assert all(alarm.time_s > ONSET_S for alarm in watched.alarms)


@pytest.mark.nightly
@pytest.mark.parametrize("channel", by_day(["p", "q", "r"]))
def test_nor_where_the_log_documents_nothing(tmp_path, channel):
    """Of lines of CSV, samples tell that what each gyro reads stands in the attitude's rate."""
    broken = gb.inject(monitors.record(6000, seed=4), gb.Bias(channel=channel, onset_s=ONSET_S, size=4.0))
    driven = estimated_attitude(broken, monitors.truth(6000, seed=4), "filter 5 s", 4)
    gb.write_log(driven, tmp_path / "flight.csv")
    watched = gb.watch_log(tmp_path / "flight.csv", monitors.monitor("C"))
    assert watched.alarms
    assert {alarm.sensor for alarm in watched.alarms if alarm.accuses and alarm.sensor} <= {channel}


@pytest.mark.nightly
def test_of_an_attitude_of_its_own_two_faults_are_named(tmp_path):
    flight = gb.measure(gb.fly("gtm", "multisine+turbulence", 150, seed=62), noise="t2", seed=62)
    faults = [gb.Bias(channel="q", onset_s=80.0, size=4.0), gb.Bias(channel="p", onset_s=115.0, size=5.0)]
    gb.write_log(gb.inject(flight, faults), tmp_path / "flight.csv")
    watched = gb.watch_log(tmp_path / "flight.csv", gb.load_monitor(BANK_C))
    assert {alarm.sensor for alarm in watched.alarms if alarm.accuses} == {"p", "q"}
