"""What a bank says beside a gyro that failed: the log is watched once more, the gyro replaced by what is predicted.

While a fault lasts, a bank explains what rises by it, and watches that gyro no more. With the prediction in its place
nothing of the fault is left, so that what breaks later stands alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.predicting import PredictingMonitor, predicts
from gtmbench.detectors.protocol import Detector, Monitor, Watch
from gtmbench.study.log.claims import began_s
from gtmbench.values.channels import GYROS
from gtmbench.values.record import Record

_MOST = 2  # faults that are taken away, one after another: a third is told with them, or not judged
_EARLIER_S = 1.0  # than it is dated, a fault may have begun
_LATER_S = 3.0  # than the first one, another begins: nearer ones are told together, or not at all


def second_faults(
    monitor: Monitor | Detector, watches: Sequence[Watch], before: Record | None, wanted: Collection[str]
) -> tuple[Alarm, ...]:
    """Return the alarms of other gyros that are raised when those that failed read what is predicted.

    `wanted`: the gyros whose alarms are told; once none of them is left, the log isn't watched any more.
    """
    if not predicts(monitor):
        return ()
    told = (alarm for watch in watches for alarm in _beside(monitor, watch, before, wanted))
    return tuple(alarm for alarm in told if alarm.sensor in wanted)


def _beside(
    monitor: PredictingMonitor, watch: Watch, before: Record | None, wanted: Collection[str]
) -> Iterator[Alarm]:
    named = [_first_named(watch, ())]
    for _ in range(_MOST):
        last = named[-1]
        is_left = {*wanted} - {None if each is None else each.sensor for each in named}
        if last is None or last.sensor not in watch.predictions or not is_left:
            return
        watch = monitor.watch(_without(watch, last), outside=watch.outside, before=before)
        found = _first_named(watch, [alarm for alarm in named if alarm is not None])
        if found is not None:
            yield found
        named.append(found)


def _first_named(watch: Watch, told: Sequence[Alarm]) -> Alarm | None:
    """Return the first alarm that names a gyro that isn't told yet, later than those that are."""
    sensors = {alarm.sensor for alarm in told}
    since_s = max([began_s(each) + _LATER_S for each in told], default=-np.inf)
    for alarm in watch.faults:
        is_new = alarm.sensor in GYROS and alarm.sensor not in sensors and began_s(alarm) >= since_s
        if is_new and alarm.accuses and alarm.test != MISSING:
            return alarm
    return None


def _without(watch: Watch, alarm: Alarm) -> Record:
    """Return a record in which a gyro reads what is predicted, from when it failed on, and the noise that it had.

    Without any noise it would be told as a change of its noise, which takes others' alarms for its own.
    """
    record, sensor = watch.record, str(alarm.sensor)
    predicted, first = watch.predictions[sensor], began_s(alarm) - _EARLIER_S
    broken = (record.time_s >= first) & np.isfinite(predicted)
    usual = record[sensor][record.time_s < first] - predicted[record.time_s < first]
    usual = usual[np.isfinite(usual)]
    noise = np.resize(usual - np.median(usual), len(record)) if len(usual) else np.zeros(len(record))
    return record.replace(sensor, np.where(broken, predicted + noise, record[sensor]))
