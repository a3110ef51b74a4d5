"""A gyro that nobody is named for may bend the attitude: then no other sensor is named by it."""

from types import SimpleNamespace

import pytest

import gtmbench as gb
from gtmbench.engine.course.judged import _far_off
from gtmbench.values.attitude_estimators import ESTIMATORS
from gtmbench.verdict.timeline import SensorSpan, Sizes, State


@pytest.mark.nightly
def test_no_accelerometer_is_named_by_an_attitude_that_a_gyro_bends(tmp_path):
    """Two gyros fail, the first of which isn't named; through a filter of 20 s it leans the attitude by tens of deg."""
    healthy = gb.measure(gb.fly(excitation="multisine+turbulence", duration_s=150.0, seed=730105), snr=50, seed=730105)
    broken = gb.inject(healthy, gb.Bias(channel="p", onset_s=34.584, size=3.0))
    broken = gb.inject(broken, gb.Bias(channel="q", onset_s=84.584, size=6.0))
    gb.write_log(ESTIMATORS["filter 20 s"].bent(healthy, broken), tmp_path / "flight.csv")
    watched = gb.watch_log(tmp_path / "flight.csv", "auto")
    assert any(change.of == "error" for change in watched.judged.cleared.changes)
    assert any(finding.best.suspect == "ny" for finding in watched.course.found)
    failed = {
        sensor for sensor in watched.timeline.sensors if watched.timeline.of(sensor, State.FAILED, State.SUSPECTED)
    }
    assert failed <= {"p", "q", "phi", "theta"}


@pytest.mark.parametrize(("sizes_deg", "told"), [((3.0, 19.9), []), ((3.0, 20.1), ["phi may be off by 20 deg"])])
def test_a_bank_that_may_be_off_by_twenty_degrees_is_told(sizes_deg, told):
    clear = [
        SensorSpan(start_s=0.0, end_s=9.0, state=State.CLEAR, sizes=Sizes(error=each, within_s=60.0))
        for each in sizes_deg
    ]
    open_to = SensorSpan(start_s=9.0, end_s=12.0, state=State.NOT_JUDGED, reason="gap")
    heading = SensorSpan(
        start_s=0.0, end_s=9.0, state=State.CLEAR, sizes=Sizes(error=170.0, within_s=60.0)
    )  # turns no force
    claims = {"phi": (*clear, open_to), "theta": (open_to,), "psi": (heading,)}
    assert list(_far_off(SimpleNamespace(cleared=SimpleNamespace(claims=claims)))) == told
