"""Faults that are put on what a monitor watched, of a size that it should find, and what it says of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank_detector import BankMonitor, BankWatch
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.study.log.certificate import KINDS, Smallest
from gtmbench.study.log.records import outside
from gtmbench.study.log.slow_means import beyond, slow_means
from gtmbench.study.log.starts import steady
from gtmbench.study.log.watched import WatchedLog
from gtmbench.values.attitude import FASTEST_S, SLOWEST_S
from gtmbench.values.channels import ATTITUDE, GYROS

TIMES = (1, 3)  # the certificate's size
CERTIFICATE, EVERYDAY = "certificate", "everyday"  # whence a fault's size
USUAL = {"bias": 5.0, "drift": 0.5, "scale_factor": 0.5, "deadzone": 5.0, "noise": 5.0}  # that gyros have; deg/s
LEFT_S = 12.0  # of a stretch, after the onset: time to judge
NAMED, EITHER_OR, CANT_TELL, WRONG, NOTHING = "named", "either-or", "can't tell", "named wrong", "nothing"
TOO_STEEP = "too steep"
CHANNELS = (*GYROS, *ATTITUDE)
_SLOW_FROM = 10_000  # numbers of alarms that means raise
ALONE = "alone"
THROUGH = {f"{tau:g} s": gb.AttitudeEstimator(time_constant_s=tau) for tau in (FASTEST_S, SLOWEST_S)}

_KIND = {kind.fault.kind: kind for kind in KINDS}


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A fault that was put on a flight.

    Attributes
    ----------
    sensor, kind : str
    attitude : str
        `ALONE`, the gyro breaks and the attitude stays; else the time constant of the estimator through which it
        follows, of `THROUGH`.
    of : str
        Whose size it has: `CERTIFICATE`, or `EVERYDAY`, one of `USUAL`.
    times : int
        How many times that size.
    size, onset_s : float
    found : bool
        Whether an alarm was raised within the certificate's time.
    said : str
        `NAMED`; `EITHER_OR`, among others; `CANT_TELL`, by every alarm; `WRONG`, another sensor, or an either-or
        without the one that failed; `NOTHING`, for no alarm was raised, or all have passed; `TOO_STEEP`, not put, for
        the attitude would bend beyond Euler angles.
    names : str
        Which sensors are named, or left undecided, in the end, and the likeliest kind of fault of each.
    """

    sensor: str
    kind: str
    attitude: str
    of: str
    times: int
    size: float
    onset_s: float
    found: bool
    said: str
    names: str = ""


def tried(said: WatchedLog, count: int, seed: int) -> Iterator[Tried]:
    """Yield so many faults of every gyro and kind: as large as its certificate says, larger, and of an everyday size.

    Each begins in another equal share of what was watched, at a time that is drawn, whatever its size. Where the
    monitor takes the attitude for driven by the gyros, it follows, as well as stays.
    """
    random = np.random.default_rng(seed)
    watches = [watch for watch in said.watches if isinstance(watch, BankWatch)]
    before = _before(said)
    for row in said.certificate.rows:
        for i in range(count):
            place = _drawn(watches, row.within_s, (i + random.random()) / count)
            is_turned = bool(random.integers(2))
            if place is not None:
                for put in _sizes(row):
                    for attitude in (ALONE, *(THROUGH if row.time_constant_s is not None else ())):
                        yield _tried(said, *place, before, row, put | {"attitude": attitude}, is_turned=is_turned)


def _sizes(row: Smallest) -> Iterator[dict[str, Any]]:
    """Yield how large a fault is put."""
    if row.size is not None:
        yield from ({"of": CERTIFICATE, "times": times, "size": times * row.size} for times in TIMES)
    yield {"of": EVERYDAY, "times": 1, "size": USUAL[row.kind]}


def _before(said: WatchedLog) -> gb.Record | None:
    """Return the last stretch that was identified on: the noise was learnt there, before watching began."""
    left_out = [each.span for each in said.left_out]
    stretches = [
        segment.between(max(first_s, segment.start_s), min(last_s, segment.end_s))
        for first_s, last_s in said.identified_s
        for segment in said.log.segments
        if segment.start_s <= last_s and segment.end_s >= first_s
    ]
    return next(reversed(outside(stretches, left_out)), None)


def _drawn(watches: Sequence[BankWatch], within_s: float, share: float) -> tuple[BankWatch, float] | None:
    """Return the time by when a share of all that may be an onset has gone by, with its watch; None without any."""
    places = [(watch, _onsets_s(watch, max(within_s, LEFT_S))) for watch in watches]
    at = int(share * sum(len(onsets_s) for _, onsets_s in places))
    for watch, onsets_s in places:
        if at < len(onsets_s):
            return watch, float(onsets_s[at])
        at -= len(onsets_s)
    return None


def _onsets_s(watch: BankWatch, left_s: float) -> np.ndarray:
    """Return when an alarm was possible, none came for some time without a fault, and that time was left.

    And up to where a sensor is accused though none failed: that can't be named right any more.
    """
    time_s = watch.record.time_s
    own_s = _own_s(watch)
    quiet = own_s[np.searchsorted(own_s, time_s)] > time_s + left_s
    accused_s = min((alarm.time_s for alarm in watch.faults if _is_left(alarm) and not alarm.doubt), default=np.inf)
    return time_s[watch.armed & quiet & (time_s <= watch.record.end_s - left_s) & (time_s < accused_s)]


def _own_s(watch: BankWatch) -> np.ndarray:
    """Return when alarms come without a fault; at last never."""
    return np.array([*sorted(alarm.time_s for alarm in watch.alarms), np.inf])


def _tried(
    said: WatchedLog,
    watch: BankWatch,
    onset_s: float,
    before: gb.Record | None,
    row: Smallest,
    put: Mapping[str, Any],
    *,
    is_turned: bool,
) -> Tried:
    """Put a fault, watch anew, and sum up what is said until an alarm comes that would have come without it."""
    assert isinstance(watch.monitor, BankMonitor)
    fault = _KIND[row.kind].at(row.sensor, onset_s, put["size"], is_turned=is_turned)
    put = {**put, "sensor": row.sensor, "kind": row.kind, "onset_s": onset_s}
    broken = gb.inject(watch.record, fault)
    if put["attitude"] != ALONE:
        try:
            broken = THROUGH[put["attitude"]].bent(watch.record, broken)
        except InputError:
            return Tried(**put, found=False, said=TOO_STEEP)
    again = steady(watch.monitor, watch.monitor.watch(broken, outside=watch.outside, before=before), before)
    own_s = _own_s(watch)
    until_s = own_s[np.searchsorted(own_s, onset_s)]
    raised = [*again.alarms, *_slow(said, watch, again, broken)]
    alarms = [alarm for alarm in raised if onset_s <= alarm.time_s < until_s]
    of = {alarm.fault for alarm in alarms}
    told = [alarm for alarm in raised if alarm.number in of]
    return Tried(
        **put,
        found=any(alarm.time_s <= onset_s + row.within_s for alarm in alarms),
        said=_said(told, row.sensor),
        names=_names(told),
    )


def _slow(said: WatchedLog, watch: BankWatch, again: Watch, broken: gb.Record) -> list[Alarm]:
    """Return what means over tens of seconds say of a log with a stretch broken, beyond what was said of that."""
    if said.means is None or said.attitude is None or not set(CHANNELS) <= set(said.log.channels):
        return []
    rest = outside(said.log.segments, [(watch.record.start_s, watch.record.end_s)])
    whole = [(record.start_s, record.end_s) for record in outside(rest, [each.span for each in said.left_out])]
    healthy = [
        (max(first_s, start_s), min(last_s, end_s))
        for first_s, last_s in said.identified_s
        for start_s, end_s in whole
        if max(first_s, start_s) < min(last_s, end_s)
    ]
    parts = [part.select(CHANNELS) for part in (*rest, broken)]
    means = slow_means(
        sorted(parts, key=lambda part: part.start_s),
        healthy=healthy,
        excursions=said.excursions,
        is_driven=said.attitude.is_driven,
    )
    told = beyond(again.faults, means)
    return [replace(alarm, number=alarm.number + _SLOW_FROM, fault=alarm.number + _SLOW_FROM) for alarm in told]


def _said(alarms: Sequence[Alarm], sensor: str) -> str:
    """Sum up what some alarms say in the end of a sensor that failed."""
    left = list(filter(_is_left, alarms))
    names = {name for alarm in left for name in _accused(alarm)}
    open_between = [alarm.candidates for alarm in left if alarm.sensor is None and not alarm.doubt]
    if names - {sensor} or any(sensor not in candidates for candidates in open_between):
        return WRONG
    if names:
        return NAMED
    if open_between:
        return EITHER_OR
    return CANT_TELL if left else NOTHING


def _names(alarms: Sequence[Alarm]) -> str:
    """Write what some alarms accuse in the end, and of which kind of fault."""
    kinds = [
        (alarm.verdict, "" if alarm.last is None else alarm.last.kind or "no kind")
        for alarm in alarms
        if _is_left(alarm) and not alarm.doubt
    ]
    return "; ".join(f"{verdict} ({kind})" for verdict, kind in dict.fromkeys(kinds))


def _is_left(alarm: Alarm) -> bool:
    """Tell whether something is left to explain."""
    return not alarm.has_passed


def _accused(alarm: Alarm) -> set[str]:
    """Return the sensors that an alarm names: both of two that have changed places."""
    if alarm.last is None or alarm.sensor is None:
        return set()
    both = (alarm.sensor, alarm.last.partner if alarm.last.swapped else None)
    return {name for name in both if name is not None}
