"""Whether what is said of an alarm hangs on where watching began: then nothing is.

Scores are held against what was just before, so where a record begins, moves what they say a little. A fault is there
wherever one begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.predicting import PredictingMonitor
from gtmbench.detectors.protocol import Watch
from gtmbench.values.record import Record

DOUBT = "it hangs on where watching began"
_LATER_S = (1.3, 2.9, 6.1)  # other beginnings, after the first that is far enough back
_SETTLED_S = 10.0  # before an alarm's onset
_SOON_S = 5.0  # apart, two alarms tell of one thing
_MOST = 6  # alarms that are looked at anew: of more, the log says enough


def steady(monitor: PredictingMonitor, watch: Watch, before: Record | None = None) -> Watch:
    """Return a watch with doubts of what isn't said again when watching begins elsewhere.

    Parameters
    ----------
    monitor : PredictingMonitor
        One that is cautious; others are calibrated for such chances.
    watch : Watch
    before : Record, optional
        On which it had learnt the noise.
    """
    if not monitor.basis.is_cautious:
        return watch
    accusing = [alarm for alarm in watch.faults if alarm.accuses and alarm.test != MISSING]
    if not accusing:
        return watch
    doubtful = {alarm.number for alarm in accusing[:_MOST] if not _is_said_again(monitor, watch, alarm, before)}
    return replace(
        watch, alarms=tuple(_doubted(alarm) if alarm.number in doubtful else alarm for alarm in watch.alarms)
    )


def _doubted(alarm: Alarm) -> Alarm:
    last = alarm.judgements[-1]
    judged = replace(
        last, sensor=None, partner=None, doubt=DOUBT, reason=f"{last.verdict} only where watching began there"
    )
    return replace(alarm, judgements=(*alarm.judgements, judged), ended_s=None, end_known_s=None)


def _is_said_again(monitor: PredictingMonitor, watch: Watch, alarm: Alarm, before: Record | None) -> bool:
    for record in _begun_elsewhere(monitor, watch.record, alarm):
        said = monitor.watch(record, outside=watch.outside, before=before).faults
        if not any(_tells_the_same(other, alarm) for other in said):
            return False
    return True


def _begun_elsewhere(monitor: PredictingMonitor, record: Record, alarm: Alarm) -> Iterator[Record]:
    """Give the record up to the alarm's last judgement, begun later."""
    assert alarm.last is not None
    first_s = max(record.start_s, alarm.onset_s - monitor.basis.looks_back_s - _SETTLED_S)
    for later_s in _LATER_S:
        if alarm.onset_s - first_s - later_s >= _SETTLED_S:
            yield record.between(first_s + later_s, min(alarm.last.time_s + monitor.look_ahead_s, record.end_s))


def _tells_the_same(other: Alarm, alarm: Alarm) -> bool:
    is_near = abs(other.time_s - alarm.time_s) <= _SOON_S
    return (
        is_near and not other.doubt and (other.sensor, set(other.candidates)) == (alarm.sensor, set(alarm.candidates))
    )
