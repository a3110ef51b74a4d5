"""Logs watched by made-up monitors: what the report of `gtmbench monitor` is made of."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import gtmbench as gb
from gtmbench.detectors.bank.bank import bank_of
from gtmbench.intake.flight_log import FlightLog, Remark
from gtmbench.log.watched_log import WatchedLog
from tests.helpers.monitors import monitor, record

ODD = ("Motor #2 (rpm)", "strain 1/left", "$x^2$")


def watched_log(segments, watched, by, *, remarks=(), identified=(), reasons=(), name="flight.csv"):
    log = FlightLog(
        path=Path(name), segments=tuple(segments), remarks=tuple(remarks), method=("resampled to 50 Hz, held",)
    )
    watches = tuple(gb.watch(by, part) for part in watched)
    return WatchedLog(log=log, monitor=by, identified_s=tuple(identified), watches=watches, reasons=tuple(reasons))


def remark(start_s, end_s, kind="gap", channel=None, text="no samples"):
    return Remark(kind=kind, channel=channel, start_s=start_s, end_s=end_s, text=text)


@cache
def jammed():
    """Three segments, identified on the first; p misses 2 s in the second, q is jammed at 170 s in the third."""
    flight = gb.inject(record(12_000, seed=51), gb.Jam(channel="q", onset_s=170.0))
    missing = np.where(np.abs(flight.time_s - 101.0) <= 1.0, np.nan, flight["p"])
    flight = flight.replace("p", missing)
    segments = [flight.between(*span) for span in ((0.0, 60.0), (63.0, 140.0), (146.5, 239.0))]
    remarks = [remark(60.0, 63.0), remark(100.0, 102.0, "missing", "p"), remark(140.0, 146.5)]
    return watched_log(segments, segments[1:], monitor(), remarks=remarks, identified=[(0.0, 60.0)])


@cache
def passing():
    """Two faults: a saturation that ends, and a heading that lasts, so that nothing is left to watch."""
    limited = gb.Saturation(channel="p", onset_s=60.0, limit=3.0, duration_s=30.0)
    flight = gb.inject(gb.inject(record(12_000, seed=52), limited), gb.Jam(channel="psi", onset_s=170.0))
    return watched_log([flight], [flight], monitor())


@cache
def short():
    """Half a minute, healthy."""
    flight = record(1500, seed=53)
    return watched_log([flight], [flight], monitor(), reasons=["30 s are little"])


@cache
def unexplained():
    """The same, with an alarm that nothing is left to explain of."""
    (*_, alarm), healthy = jammed().alarms, short()
    last = replace(
        alarm.judgements[-1],
        sensor=None,
        candidates=(),
        kind=None,
        parameters={},
        intervals={},
        probability=None,
        kind_probability=None,
    )
    false = replace(alarm, time_s=20.0, onset_s=19.0, judgements=(replace(last, time_s=21.0),))
    return replace(healthy, watches=(replace(healthy.watches[0], alarms=(false,)),))


@cache
def unwatched():
    """Too short to watch."""
    return watched_log([record(300, seed=54)], [], monitor(), reasons=["6 s are too short"])


@cache
def never_armed():
    """Given to the monitor, but too short for its tests."""
    flight = record(100, seed=54)
    return watched_log([flight], [flight], monitor())


@cache
def odd():
    """Channels that no table knows, one residual, a clock that starts late; the second of them fails at 1200 s."""
    noise = np.random.default_rng(3).standard_normal((14_500, 5))
    left, x = noise[:, 0] + np.roll(noise[:, 0], 1), noise[:, 1]
    motor = 0.7 * left - 0.4 * x
    values = np.column_stack([motor, left, x]) + 0.02 * noise[:, 2:]
    flight = gb.Record(values, channels=ODD, sample_period_s=0.02, start_s=1000.0)
    flight = flight.replace(ODD[1], np.where(flight.time_s > 1200.0, flight[ODD[1]][10_000], flight[ODD[1]]))
    spec = {"output": ODD[0], "inputs": list(ODD[1:])}
    by = gb.calibrate(
        [flight.between(1000.0, 1120.0)], bank=bank_of("own", {"suspects": list(ODD), "residuals": [spec]})
    )
    remarks = [remark(1150.0, 1150.0, "saturated", ODD[2])]
    part = flight.between(1120.02, flight.end_s)
    name = "odd [name] $x$ #1.csv"
    return watched_log([flight], [part], by, remarks=remarks, identified=[(1000.0, 1120.0)], name=name)


@cache
def normed():
    """The third segment of `jammed`, watched by E(k) of the second; q is jammed at 170 s."""
    before, part = jammed().log.segments[0], jammed().log.segments[2]
    by = gb.DissertationOperator(inputs=("theta", "nz"), outputs=("q",), causal_order=5, noncausal_order=5, window=50)
    ready = by.calibrate([before.between(0.0, 30.0), before.between(30.02, 60.0)])
    return watched_log([part], [part], ready)


@cache
def standing():
    """The same, watched by a plain function, which alarms at every sample where q stands still: often."""
    part = jammed().log.segments[2]
    by = gb.FunctionDetector(
        lambda record: record.time_s[1:][np.diff(record["q"]) == 0.0][:300], name="still"
    ).calibrate([])
    return watched_log([part], [part], by)


@cache
def silent():
    """A function that never says anything."""
    part = jammed().log.segments[0]
    return watched_log([part], [part], gb.FunctionDetector(lambda _: [], name="nothing").calibrate([]))


CASES = {
    "jammed": jammed,
    "passing": passing,
    "short": short,
    "unexplained": unexplained,
    "unwatched": unwatched,
    "never armed": never_armed,
    "odd": odd,
    "E(k)": normed,
    "function": standing,
    "silent function": silent,
}
