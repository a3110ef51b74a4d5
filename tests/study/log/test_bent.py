"""A monitor calibrated for an attitude of its own, on a log whose attitude the gyros drive: one name at most."""

import pytest

import gtmbench as gb
from tests.helpers import monitors
from tests.helpers.autopilot_logs import px4

ONSET_S = 60.0


@pytest.mark.parametrize("channel", ["p", "q", "r"])
@pytest.mark.parametrize("time_constant_s", [1.0, 5.0])
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
