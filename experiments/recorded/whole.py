"""Whole logs as `gtmbench monitor LOG --detector auto` watches them: as they are, and with faults put on a gyro.

A broken log goes through every stage but one: what was learnt before the fault began is learnt from the same samples.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm
from gtmbench.engine.imus.beside import with_imus
from gtmbench.errors import InputError
from gtmbench.jobs.progress import silent
from gtmbench.log.judging.monitored import Monitored, doubted, first_alarms, listened
from gtmbench.log.learning.crashes import CONTACTS
from gtmbench.log.learning.healthy_part import chosen
from gtmbench.log.learning.learnt_monitor import Learnt, learnt
from gtmbench.log.opening.driven_attitude import FROM_LOG
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.log.opening.opened_log import Opened, OpenedLog, opened
from gtmbench.log.opening.question import asked
from gtmbench.log.watched_log import WatchedLog, concluded
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record
from gtmbench.verdict.timeline import State

DETECTOR = "auto"
ALONE = "alone"
THROUGH = "5 s"
ESTIMATOR = gb.AttitudeEstimator(time_constant_s=5.0)
LEFT_S = 20.0  # of a stretch, after the onset: time to judge
NAMED, EITHER_OR, CANT_TELL, WRONG, NOTHING = "named", "either-or", "can't tell", "named wrong", "nothing"
USUAL, SLOW, CONTACT = "usual", "slow", "at a contact"
AT_CONTACT, BEFORE_S = ("jam", "bias 5 deg/s", "sign"), 0.5  # what is put so long before a contact with the ground
FAULTS: dict[str, tuple[str, type[gb.Fault], dict[str, float]]] = {
    "jam": (USUAL, gb.Jam, {}),
    "drift 0.5 deg/s2": (USUAL, gb.Drift, {"slope": 0.5}),
    "bias 5 deg/s": (USUAL, gb.Bias, {"size": 5.0}),
    "scale 0.7": (USUAL, gb.ScaleFactor, {"factor": 0.7}),
    "deadzone 2 deg/s": (USUAL, gb.Deadzone, {"half_width": 2.0}),
    "sign": (USUAL, gb.SignFlip, {}),
    "bias 1 deg/s": (SLOW, gb.Bias, {"size": 1.0}),
    "drift 0.05 deg/s2": (SLOW, gb.Drift, {"slope": 0.05}),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Whole:
    """A log that was watched as it is.

    Attributes
    ----------
    path : Path
    learnt : Learnt
    said : Monitored
    watched : WatchedLog
    cpu_s : float
        What that took, from the file to the verdict.
    """

    path: Path
    learnt: Learnt
    said: Monitored
    watched: WatchedLog
    cpu_s: float


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A fault that was put on a log, and what is said of it.

    Attributes
    ----------
    sensor, fault, kind : str
    attitude : str
        `ALONE`, or the time constant of the estimator that makes the attitude follow.
    onset_s : float
    found_s : float
        How long after the onset the first alarm came; NaN where none is left.
    said : str
        `NAMED`; `EITHER_OR`, among others; `CANT_TELL`, by every alarm; `WRONG`, another sensor, or an either-or
        without the one that failed; `NOTHING`.
    exit : int
    doubt : str
        Of what can't be told, why.
    """

    sensor: str
    fault: str
    kind: str
    attitude: str
    onset_s: float
    found_s: float
    said: str
    exit: int
    doubt: str


def watch_whole(path: Path) -> Whole:
    """Watch all of a log, as a user does who says nothing of it.

    Raises
    ------
    InputError
        Where it can't be watched.
    """
    began = time.process_time()
    question = asked(
        path,
        DETECTOR,
        healthy=(),
        mapping=(),
        rate_hz=None,
        false_alarms_per_hour=None,
        attitude=FROM_LOG,
    )
    known = learnt(chosen(opened(question)), silent)
    said = said_of(known)
    watched = concluded(said)
    return Whole(path=path, learnt=known, said=said, watched=watched, cpu_s=time.process_time() - began)


def tried(whole: Whole, kinds: Sequence[str] = tuple(FAULTS), *, seed: int = 0) -> Iterator[Tried]:
    """Give what is said of faults of some kinds, alone and through an estimator: of a gyro at a time, by turns.

    The first gyro and one onset a kind are drawn, evenly over what is watched and leaves `LEFT_S`. Where a contact with
    the ground was explained, faults that begin with it are put, too.
    """
    random = np.random.default_rng([zlib.crc32(whole.path.name.encode()), seed])
    onsets_s, gyros = _onsets_s(whole.watched), [name for name in GYROS if name in _suspects(whole.watched)]
    first = int(random.integers(len(GYROS)))
    for turn, kind in enumerate(kinds):
        share, is_turned = random.random(), bool(random.integers(2))
        if gyros and len(onsets_s):
            sensor, onset_s = gyros[(first + turn) % len(gyros)], float(onsets_s[int(share * len(onsets_s))])
            for attitude in (ALONE, THROUGH):
                yield from _tried(whole, sensor, kind, onset_s, attitude, is_turned=is_turned)
    contacts_s = [alarm.onset_s - BEFORE_S for alarm in whole.watched.alarms if alarm.doubt in CONTACTS]
    for turn, (onset_s, kind) in enumerate((at_s, kind) for at_s in contacts_s for kind in kinds if kind in AT_CONTACT):
        sensor = gyros[(first + turn) % len(gyros)]
        for each in _tried(whole, sensor, kind, onset_s, THROUGH, is_turned=False):
            yield replace(each, kind=CONTACT)


def coverage(watched: WatchedLog) -> tuple[float, float, float]:
    """Return how long a log is, for how long of that residuals watch, and for how long all gyros are judged.

    Seconds are those in which it is logged.
    """
    whole = [time_s for record in watched.log.segments for time_s in _seconds(record)]
    armed = {int(at) for watch in watched.watches for at in watch.record.time_s[watch.armed]}
    timeline = watched.timeline
    is_judged = [
        all(timeline.at(gyro, time_s).state is not State.NOT_JUDGED for gyro in GYROS if gyro in timeline.sensors)
        for time_s in whole
    ]
    return float(len(whole)), float(len({int(at) for at in whole} & armed)), float(sum(is_judged))


def said_of(known: Learnt) -> Monitored:
    """Return what is said of a log by what was learnt on it."""
    return doubted(listened(known, silent), silent)


def _seconds(record: Record) -> FloatArray:
    return np.arange(np.ceil(record.start_s), record.end_s)


def _suspects(watched: WatchedLog) -> Sequence[str]:
    return getattr(watched.monitor, "suspects", ())


def _onsets_s(watched: WatchedLog) -> FloatArray:
    """Return when an alarm was possible, up to a first accusation, with time left in the stretch."""
    parts = [np.zeros(0)]
    for watch in watched.watches:
        times_s = watch.record.time_s[watch.armed]
        parts.append(times_s[times_s <= watch.record.end_s - LEFT_S])
    return np.concatenate(parts)


def _tried(whole: Whole, sensor: str, kind: str, onset_s: float, attitude: str, *, is_turned: bool) -> Iterator[Tried]:
    """Give what is said of a fault; nothing where it would bend the attitude beyond Euler angles."""
    group, fault_type, parameters = FAULTS[kind]
    sign = -1.0 if is_turned and kind.startswith(("bias", "drift")) else 1.0
    sized: dict[str, Any] = {name: sign * value for name, value in parameters.items()}
    fault = fault_type(channel=sensor, onset_s=onset_s, **sized)
    try:
        broken = broken_log(whole.learnt.opened, fault, None if attitude == ALONE else ESTIMATOR)
    except InputError:
        return
    said = said_of(replace(whole.learnt, opened=broken))
    new = alarms_after(said, whole.said, onset_s)
    verdict = verdict_on(new, sensor)
    yield Tried(
        sensor=sensor,
        fault=kind,
        kind=group,
        attitude=attitude,
        onset_s=onset_s,
        found_s=min((alarm.time_s - onset_s for alarm in new), default=np.nan),
        said=verdict,
        exit=int(concluded(said).outcome),
        doubt="; ".join(dict.fromkeys(alarm.doubt for alarm in new if alarm.doubt)) if new else "",
    )


def broken_log(log: Opened, fault: gb.Fault, estimator: gb.AttitudeEstimator | None) -> Opened:
    """Return an opened log with a fault from its onset on, put through an estimator if one is given.

    The estimator goes on over gaps as if nothing had moved. Of several IMUs the one that is watched breaks.
    """
    changed = replace(log.log, segments=tuple(broken_record(record, fault, estimator) for record in log.log.segments))
    motion = changed if log.own.motion is log.log else None
    flight = log.flight
    if flight is not None and motion is not None:
        own = flight_of_records(changed.segments, is_driven=flight.is_driven, is_assumed=flight.is_assumed)
        flight = with_imus(own, log.imus)
    # what the engine said of the healthy flight would be taken for what it says of this one
    return replace(log, own=OpenedLog(log=changed, motion=motion), flight=flight, judged=None)


def broken_record(record: Record, fault: gb.Fault, estimator: gb.AttitudeEstimator | None) -> Record:
    """Return a stretch with a fault from its onset on, put through an estimator if one is given."""
    if record.end_s < fault.onset_s:
        return record
    broken = gb.inject(record, _from(fault, record.start_s))
    if estimator is not None and {*GYROS, *ATTITUDE} <= set(record.channels):
        broken = estimator.bent(record, broken)
    return broken


def _from(fault: gb.Fault, start_s: float) -> list[gb.Fault]:
    """Return a fault as it is in a stretch that begins then: a drift has gone on meanwhile."""
    if fault.onset_s >= start_s:
        return [fault]
    later = [replace(fault, onset_s=start_s)]
    if isinstance(fault, gb.Drift):
        reached = fault.slope * (start_s - fault.onset_s)
        later.append(gb.Bias(channel=fault.channel, onset_s=start_s, size=reached))
    return later


def _left(said: Monitored) -> list[Alarm]:
    told = first_alarms(said.watches, said.judged)
    return [alarm for alarm in told if not alarm.has_passed]


def alarms_after(said: Monitored, before: Monitored, onset_s: float) -> list[Alarm]:
    """Return the alarms after an onset that weren't there without the fault."""
    was = {(alarm.source, alarm.test, alarm.time_s, alarm.verdict) for alarm in _left(before)}
    late = [alarm for alarm in _left(said) if alarm.time_s >= onset_s]
    return [alarm for alarm in late if (alarm.source, alarm.test, alarm.time_s, alarm.verdict) not in was]


def verdict_on(alarms: Sequence[Alarm], sensor: str) -> str:
    """Return what alarms say of a sensor that is broken."""
    sure = [alarm for alarm in alarms if not alarm.doubt]
    if any(sensor not in alarm.candidates or alarm.sensor not in (None, sensor) for alarm in sure):
        return WRONG
    if any(alarm.sensor == sensor for alarm in sure):
        return NAMED
    if sure:
        return EITHER_OR
    return CANT_TELL if alarms else NOTHING
