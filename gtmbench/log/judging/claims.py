"""What today's pipelines claim of a log's sensors: their alarms, the self-check, contacts, and what wasn't read.

Each claim is a span of a sensor's timeline. An alarm that names a sensor is a failure; one that leaves several is a
suspicion of each; one that may be no fault's, or that nothing explains, is a span that isn't judged. None of these
clears a sensor: what does is the relation of gyros and attitude (`hindsight`), or a certificate.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.alarm import OUTSIDE, Alarm
from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.detectors.protocol import Watch
from gtmbench.faults.kinds.additive import Bias, Noise
from gtmbench.faults.kinds.shaping import ScaleFactor
from gtmbench.intake.flight_log import Unread
from gtmbench.intake.tracks import union
from gtmbench.log.self_check.refusal import SelfCheck
from gtmbench.values.channels import axis_of, names_of
from gtmbench.values.ranges import REASON as OUT_OF_RANGE
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import BoolArray, Record, Span, runs
from gtmbench.verdict.timeline import Claim, SensorSpan, Sizes, State, unjudged

if TYPE_CHECKING:
    from gtmbench.log.judging.certificate import Certificate

UNHELD = "its residual rose, and the whole log doesn't show why"
_PASSED = "its residual rose, and no fault explains it"
_BESIDE = "too little is known before or behind it"  # to raise an alarm in time
_SHORT_S = 0.5  # of what wasn't armed: a statistic looks back as far


def began_s(alarm: Alarm) -> float:
    """Return when a fault began: as its last judgement estimates it, of several the first, or else the alarm's test."""
    judged = () if alarm.last is None else (alarm.last, *alarm.last.together)
    onsets_s = [each.parameters["onset_s"] for each in judged if "onset_s" in each.parameters]
    return min(onsets_s, default=alarm.onset_s)


def of_alarm(
    alarm: Alarm, end_s: float, concerned: Sequence[str], watched_imu: str, excursions: Sequence[Excursion] = ()
) -> Iterator[Claim]:
    """Give what an alarm claims, until its end, or the log's; one of an excursion alone, until that ends.

    `concerned`: the sensors that its statistic depends on, which are meant where it names nobody. `watched_imu`: the
    IMU whose gyros p, q and r are; "" where a log has one.
    """
    last, since_s = alarm.last, min(began_s(alarm), alarm.time_s)
    until_s = end_s if alarm.ended_s is None else max(alarm.ended_s, alarm.time_s)
    if alarm.test == OUTSIDE:
        about_it = [each.end_s for each in excursions if each.start_s <= alarm.time_s and each.end_s >= since_s]
        until_s = min(max([alarm.time_s, *about_it]), until_s)
    about = partial(SensorSpan, start_s=since_s, end_s=until_s)
    if last is None:
        reason = f"{alarm.source} raised an alarm at {alarm.time_s:.1f} s"
        suspects = tuple(concerned)
        for sensor in suspects:
            yield sensor, about(state=State.SUSPECTED, reason=reason, suspects=suspects)
    elif alarm.has_passed or last.doubt:
        passed_s = max(last.time_s, alarm.time_s) if alarm.has_passed and alarm.ended_s is None else until_s
        reason = last.doubt or last.reason or _PASSED
        for sensor in dict.fromkeys(
            [*last.candidates, *(axis_of(alarm.source) if alarm.source in concerned else concerned)]
        ):
            yield sensor, SensorSpan(start_s=since_s, end_s=passed_s, state=State.NOT_JUDGED, reason=reason)
    elif last.failed:
        for judged in last.together or (last,):
            how = "" if judged.kind else judged.reason  # of a kind that no fit has: a GPS that lost its fix
            for sensor in judged.failed:
                yield _of_imu(sensor, judged.imu, watched_imu), about(state=State.FAILED, reason=how, judgement=judged)
    else:
        for sensor in last.candidates:
            claim = about(state=State.SUSPECTED, reason=last.reason, suspects=last.candidates, judgement=last)
            yield _of_imu(sensor, last.imu, watched_imu), claim


def _of_imu(sensor: str, imu: str, watched_imu: str) -> str:
    """Return whose a gyro is: one of the IMU that is watched has its own name."""
    return f"{sensor} of {imu}" if imu and imu != watched_imu else sensor


def of_check(check: SelfCheck, span_s: Span, sensors: Sequence[str], whole: Collection[str] = ()) -> Iterator[Claim]:
    """Give what the self-check claims: where it stops, no sensor is judged; a doubt is of those that it names.

    `whole`: those that are judged by all of the log: what holds for a part that is learnt from says nothing of them.
    """
    causes = list(dict.fromkeys(cause.text for cause in check.causes))
    if causes:
        yield from ((sensor, unjudged(span_s, " or ".join(causes))) for sensor in sensors)
        return
    for stop in check.stops[:1]:
        yield from ((sensor, unjudged(span_s, stop.text)) for sensor in sensors if sensor not in whole)
    for stop in check.stops:
        concerned = stop.sensors or sensors
        yield from ((sensor, unjudged(span_s, stop.text)) for sensor in concerned if sensor in whole)
    for doubt in check.doubts:
        for sensor in doubt.sensors or sensors:
            if not (doubt.is_learnt and sensor in whole):
                yield sensor, unjudged(span_s, doubt.text)


def of_excursions(excursions: Iterable[Excursion], sensors: Sequence[str]) -> Iterator[Claim]:
    """Give the stretches in which nothing can be told, such as a contact with the ground; hard motion alone is none."""
    for each in excursions:
        if excuses(each):
            for sensor in sensors:
                yield sensor, unjudged((each.start_s, each.end_s), each.reason)


def excused_s(excursions: Iterable[Excursion]) -> list[Span]:
    """Return the spans in which gyros and attitude are asked nothing."""
    return [(each.start_s, each.end_s) for each in excursions if excuses(each)]


def excuses(excursion: Excursion) -> bool:
    """Tell whether gyros and attitude are asked nothing in an excursion: they show one motion however hard it is."""
    return excursion.reason != MOTION and not excursion.is_judged


def of_unread(unread: Iterable[Unread], sensors: Sequence[str]) -> Iterator[Claim]:
    """Give the spans that weren't read."""
    for each in unread:
        for sensor in sensors:
            yield sensor, unjudged((each.start_s, each.end_s), each.reason)


def of_out_of_range(found: Iterable[OutOfRange], rows: Container[str]) -> Iterator[Claim]:
    """Give the spans in which too many of a sensor's readings are beyond its range, by the rows that there are."""
    for each in found:
        for row in names_of(each.channel):
            yield from ((row, unjudged(span_s, OUT_OF_RANGE)) for span_s in each.spans if row in rows)


def of_watches(watches: Iterable[Watch]) -> Iterator[Claim]:
    """Give the residuals that no test could judge: those above their threshold throughout."""
    for watch in watches:
        for name, score in watch.scores.items():
            if score.is_stuck_above:
                reason = f"the score of {name} never came down: a fault from the beginning, or other noise"
                for sensor in axis_of(name):
                    yield sensor, unjudged((watch.record.start_s, watch.record.end_s), reason)


def of_certificate(certificate: Certificate, watches: Sequence[Watch]) -> Iterator[Claim]:
    """Give where a bank's certificate clears the sensors that it predicts: where it was armed, but for the ends."""
    sensors = dict.fromkeys(row.sensor for row in certificate.rows)
    for sensor in sensors:
        bias, scale, noise = (certificate.of(sensor, kind.kind) for kind in (Bias, ScaleFactor, Noise))
        if bias is None:
            continue
        if bias.size is None:
            for watch in watches:
                yield sensor, unjudged((watch.record.start_s, watch.record.end_s), "no error of it would show here")
            continue
        factor = None if scale is None else scale.size
        sizes = Sizes(
            error=bias.size,
            within_s=bias.within_s,
            factors=None if factor is None else (1.0 - factor, 1.0 + factor),
            noise=None if noise is None else noise.size,
        )
        for watch in watches:
            since_s = watch.record.start_s
            for start_s, end_s in _armed_s(watch, sensor, bias.within_s):
                yield sensor, SensorSpan(start_s=start_s, end_s=end_s, state=State.CLEAR, sizes=sizes)
                yield sensor, unjudged((since_s, start_s), _BESIDE)
                since_s = end_s
            yield sensor, unjudged((since_s, watch.record.end_s), _BESIDE)


def _armed_s(watch: Watch, sensor: str, within_s: float) -> Iterator[Span]:
    record, score = watch.record, watch.scores.get(sensor)
    armed = watch.armed if score is None else score.armed
    starts, ends = runs(_closed(armed, record))
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        start_s, end_s = record.time_at(start), record.time_at(end - 1) - within_s
        if end_s > start_s:
            yield start_s, end_s


def _closed(armed: BoolArray, record: Record) -> BoolArray:
    """Return what was armed, with pauses that a statistic looks over."""
    closed = armed.copy()
    starts, ends = runs(~armed)
    short = (ends - starts) * record.sample_period_s <= _SHORT_S
    for start, end in zip(starts[short].tolist(), ends[short].tolist(), strict=True):
        closed[start:end] = start > 0 and end < len(armed)
    return closed


def motion_spans(lively_s: Sequence[float], span_s: Span, unread: Iterable[Unread] = ()) -> tuple[Span, ...]:
    """Return where a log moves: seconds that do, and what wasn't read with motion on both sides, or up to an end.

    >>> gaps = [Unread(start_s=3.0, end_s=7.0, reason="gap"), Unread(start_s=8.0, end_s=12.0, reason="other rate")]
    >>> motion_spans([0.5, 1.5, 2.5, 7.5], (0.0, 12.0), gaps)
    ((0.0, 12.0),)
    """
    seconds = np.asarray(lively_s, dtype=np.float64)
    own = [(max(time_s - 0.5, span_s[0]), min(time_s + 0.5, span_s[1])) for time_s in seconds.tolist()]
    for each in unread:
        before = bool(np.any((seconds > each.start_s - _BESIDE_S) & (seconds <= each.start_s + 0.5)))
        behind = bool(np.any((seconds >= each.end_s - 0.5) & (seconds < each.end_s + _BESIDE_S)))
        is_first, is_last = each.start_s <= span_s[0] + 1e-6, each.end_s >= span_s[1] - 1e-6
        if (before or is_first) and (behind or is_last) and (before or behind) and each.reason not in _CLOCK:
            own.append((each.start_s, each.end_s))
    return tuple(union(own, join_s=_APART_S))


_BESIDE_S = 5.0  # of what wasn't read: motion on that side
_APART_S = 1e-3  # no pause: seconds are rounded
_CLOCK = ("clock jump", "clock set back")  # no time that was flown
