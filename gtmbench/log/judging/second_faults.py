"""What a bank says beside a gyro that failed: the log is watched once more, the gyro replaced by what is predicted.

While a fault lasts, a bank explains what rises by it, and watches that gyro no more. With the prediction in its place
nothing of the fault is left, so that what breaks later stands alone. It is watched about the fault and where another
gyro parts from the attitude, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.predicting import PredictingMonitor, predicts
from gtmbench.detectors.protocol import Detector, Monitor, Watch
from gtmbench.intake.tracks import overlaps, union
from gtmbench.log.judging.claims import began_s
from gtmbench.values.channels import GYROS
from gtmbench.values.record import Record, Span

_MOST = 2  # faults that are taken away, one after another: a third is told with them, or not judged
_EARLIER_S = 1.0  # than it is dated, a fault may have begun
_LATER_S = 3.0  # than the first one, another begins: nearer ones are told together, or not at all
# About a change of level: the baseline before it, and the half minute behind it within which a gyro is named. Chosen:
# from 60 to 240 s the corpus of verdicts stays as it is.
_ABOUT_S = 120.0


def second_faults(
    monitor: Monitor | Detector,
    watches: Sequence[Watch],
    before: Record | None,
    shifted_s: Mapping[str, Sequence[float]],
) -> tuple[Alarm, ...]:
    """Return the alarms of other gyros that are raised when those that failed read what is predicted.

    `shifted_s`: by the gyros whose alarms are told, when they part from the attitude.
    """
    if not predicts(monitor):
        return ()
    told = (alarm for watch in watches for alarm in _beside(monitor, watch, before, shifted_s))
    return tuple(alarm for alarm in told if alarm.sensor in shifted_s)


def _beside(
    monitor: PredictingMonitor, watch: Watch, before: Record | None, shifted_s: Mapping[str, Sequence[float]]
) -> Iterator[Alarm]:
    first = _first_named(watch, ())
    if first is None or first.sensor not in watch.predictions:
        return
    replaced, named = _without(watch, first), [first]
    for start_s, end_s in overlaps(_about(first, shifted_s), (replaced.start_s, replaced.end_s)):
        part = replaced.between(start_s, end_s)
        for _ in range(_MOST):
            if not {*shifted_s} - {each.sensor for each in named}:
                break
            again = monitor.watch(part, outside=watch.outside, before=before)
            found = _first_named(again, named)
            if found is None:
                break
            yield found
            named.append(found)
            if found.sensor not in again.predictions:
                break
            part = _without(again, found)


def _about(first: Alarm, shifted_s: Mapping[str, Sequence[float]]) -> list[Span]:
    """Return the spans about the first fault, and about changes of other gyros that come behind it."""
    times_s = [time_s for sensor, those in shifted_s.items() if sensor != first.sensor for time_s in those]
    behind_s = [time_s for time_s in times_s if time_s + _ABOUT_S > began_s(first)]
    return union([(time_s - _ABOUT_S, time_s + _ABOUT_S) for time_s in (began_s(first), *behind_s)])


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
