"""A program of somebody else's, as a type checker sees it: what gtmbench gives has types, none of them `Any`."""

from __future__ import annotations

from pathlib import Path
from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import gtmbench as gb


def above(record: gb.Record) -> NDArray[np.float64]:
    """Return when p is above 20 deg/s: a detector of one's own."""
    times_s: NDArray[np.float64] = record.time_s[record["p"] > 20.0]
    return times_s[:1]


def main() -> None:
    """Fly, break, watch, with a monitor and with a detector of one's own."""
    truth = gb.fly("gtm", "multisine+turbulence", 60.0, seed=1)
    assert_type(truth, gb.Record)
    readings = gb.measure(truth, noise="t2", seed=1)
    assert_type(readings, gb.Record)
    broken = gb.inject(readings, gb.Bias(channel="q", onset_s=40.0, size=5.0))
    assert_type(broken, gb.Record)
    monitor = gb.load_monitor(Path(str(gb.__file__)).parent / "baselines" / "bank-C.json")
    watch = monitor.watch(broken)
    assert_type(watch, gb.Watch)
    for alarm in watch.alarms:
        assert_type(alarm, gb.Alarm)
        assert_type(alarm.time_s, float)
        assert_type(alarm.sensor, str | None)
    assert_type(watch.alarm_s, float | None)
    mine = gb.FunctionDetector(above, channels=("p",)).calibrate()
    assert_type(mine.watch(broken).alarms, tuple[gb.Alarm, ...])
    stream = monitor.stream()
    assert_type(stream.push(broken), tuple[gb.Alarm, ...])
    trials = gb.run(gb.load_scenario("faults/drift.toml"))
    for trial in trials:
        assert_type(trial.detected, bool)
        assert_type(trial.alarm_time_s, float | None)


if __name__ == "__main__":
    main()
