"""The sensors of a log that no gyro enters, watched against each other: which of them failed.

The cross-check learns on what is healthy of the log and watches the rest. A sensor fails where it is named and the
evidence is large, lasts, and begins in ordinary flight; everything else is told, and nothing comes of it. No verdict on
a gyro rests on this.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.crosscheck.crosscheck import CrossCheck, CrossCheckMonitor
from gtmbench.detectors.crosscheck.relations import ALTITUDE, ATT, CHANNELS, MAG, POSSIBLE, TAS, WIND
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.study.log.records import LIVELY_DEG_S, outside, turning_by_second
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record, Span

_MARGIN = 1.5  # by which bounds exceed the healthy part's noise: a flight is rougher than its beginning
_LASTS_S = 5.0  # evidence that lasts: a glitch of a sample is no failure
_LEVEL, _DOWN = ("accelerometers: north", "accelerometers: east"), "accelerometers: down"
_WITNESSES = 2  # comparisons that have to show an error of a sensor that is named; a magnetometer has its strength
_LARGE = 2.0  # times the bound of another magnetometer, which would show an error of the attitude
_SLOWEST_HZ = 9.0  # of gyros and attitude: slower ones don't tell how sensors turn within a block
_HOVERS_KT = 15.0  # an airspeed below is no wing's
_ABOUT_S = 2.0  # before an excursion, and before the last motion: it may have begun already
_MOVES_S, _FEWEST_LIVELY = 10.0, 3  # after an alarm; seconds in which the aircraft turns
_SHORTEST_S = 1.0  # that is watched
_LEARNT_AT = 2  # the window of `WINDOWS` whose bounds are told: 2 s
_SILENT = 10.0  # times its usual step, and five seconds: it reads nothing
_MOST = {"m/s²": 15.0, "m/s": 30.0, "%": 50.0, "deg": 45.0}  # larger errors aren't worth a comparison
_NO_MOTION = "no gyros and attitude to turn its readings with"
_BY_FORCE = "altitude, accelerometers"
_DIRECTIONS = ("field direction", "field direction, across")
UNITS = {
    "gps, accelerometers": "m/s²",
    "air, accelerometers": "m/s²",
    "altitude, accelerometers": "m/s²",
    "gps, air": "m/s",
    "gps, altitude": "m/s",
    "field strength": "%",
    "field direction": "deg",
}


class Limit(NamedTuple):
    """From which error on a sensor contradicts others, over two seconds."""

    against: tuple[str, ...]
    size: float
    unit: str


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedSensor:
    """A sensor of a log that no gyro enters.

    Attributes
    ----------
    kind : str
        ``magnetometer``, ``gps``, ``accelerometers``, ``tas`` or ``altitude``.
    name : str
        The log's topic.
    columns : tuple of str
    limits : tuple of Limit
        What it is compared with; none where it isn't watched.
    alike : tuple of str
        Those from whose errors its own can't be told, or only by their course, for the same comparisons hold both.
    silent_s : tuple of (start, end)
        Where it reads nothing, for five seconds or longer.
    why_not : str
        Why it isn't watched; "" where it is.
    alarms : tuple of Alarm
        Those that name it, or may be about it; a doubt says why one may be no fault.
    """

    kind: str
    name: str
    columns: tuple[str, ...]
    limits: tuple[Limit, ...] = ()
    alike: tuple[str, ...] = ()
    silent_s: tuple[Span, ...] = ()
    why_not: str = ""
    alarms: tuple[Alarm, ...] = field(default=(), repr=False)

    @property
    def failed(self) -> Alarm | None:
        """The first alarm that names it without a doubt; None where none does."""
        return next((alarm for alarm in self.alarms if alarm.sensor == self.kind and not alarm.doubt), None)


class Flown(NamedTuple):
    """Where a log's flight isn't ordinary, and the seconds in which it moves."""

    excursions: tuple[Excursion, ...]
    lively_s: FloatArray

    @property
    def last_s(self) -> float:
        """When the last motion ends: what begins about then is a landing."""
        return float(self.lively_s[-1]) - _ABOUT_S if len(self.lively_s) else -np.inf

    def moves_about(self, time_s: float) -> bool:
        """Tell whether the aircraft moves about a time."""
        about = (self.lively_s >= time_s - _ABOUT_S) & (self.lively_s <= time_s + _MOVES_S)
        return bool(np.count_nonzero(about) >= _FEWEST_LIVELY)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Told:
    """What a cross-check with one of the magnetometers told: its monitor, and what it said of each record."""

    monitor: CrossCheckMonitor
    watches: tuple[Watch, ...] = field(repr=False)


def watched_sensors(
    sensors: Sequence[SensorReadings],
    moving: Sequence[Record],
    healthy: Sequence[Record],
    learnt_s: Sequence[Span],
    excursions: Sequence[Excursion],
) -> tuple[WatchedSensor, ...]:
    """Watch the sensors of a log that no gyro enters.

    Parameters
    ----------
    sensors : sequence of SensorReadings
    moving, healthy : sequence of Record
        With p, q, r, phi, theta and psi: the log, and what of it is healthy.
    learnt_s : sequence of (start, end)
        What of the log is learnt on, and isn't watched.
    excursions : sequence of Excursion
        Contacts with the ground and motion beyond what was learnt: what begins there may be no fault.
    """
    moving, healthy = (
        [record.select((*GYROS, *ATTITUDE)) for record in records if {*GYROS, *ATTITUDE} <= set(record.channels)]
        for records in (moving, healthy)
    )
    why = _why_nothing(moving, healthy)
    if why:
        return tuple(_unwatched(each, why) for each in sensors)
    hovers = {id(each): why for each in sensors if (why := _hovers(each, healthy))}
    used = [each for each in sensors if id(each) not in hovers]
    plain, fields = ([each for each in used if (kind_of(each) == MAG) == is_mag] for is_mag in (False, True))
    told = [_told([*plain, *beside], moving, healthy, learnt_s) for beside in [[each] for each in fields] or [[]]]
    own = {id(each): told[place] for place, each in enumerate(fields)}
    flown = flown_of(moving, excursions)
    return tuple(
        _unwatched(each, hovers[id(each)])
        if id(each) in hovers
        else _watched(each, own.get(id(each), told[0]), [one for one in told if one is not None], flown)
        for each in sensors
    )


def flown_of(moving: Sequence[Record], excursions: Sequence[Excursion]) -> Flown:
    """Return where a log's flight isn't ordinary, and when it moves."""
    return Flown(excursions=tuple(excursions), lively_s=_lively_s(moving))


def kind_of(sensor: SensorReadings) -> str:
    """Return which sensor some readings are."""
    return next(kind for kind, channels in CHANNELS.items() if set(channels) == set(sensor.channels))


def possible(kinds: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return which relations some kinds of sensors allow, with what enters each.

    >>> possible(["gps", "altitude"])
    {'gps, altitude': ('gps', 'altitude')}
    """
    there = {*kinds, ATT, WIND}
    return {name: sensors for name, sensors in POSSIBLE.items() if set(sensors) <= there}


def not_told_apart(entered: Mapping[str, Sequence[str]], kind: str) -> tuple[str, ...]:
    """Return the sensors from whose errors a sensor's own can't be told: those that enter the same relations.

    The attitude turns the field as an error of the magnetometer does that leaves its length as it is.

    >>> not_told_apart({"gps, altitude": ("gps", "altitude"), "gps, air": ("gps", "tas", "wind")}, "tas")
    ('wind',)
    """
    enters = {each: {axis for axis, own in entered.items() if each in own} for own in entered.values() for each in own}
    alike = [other for other in enters if other != kind and enters[other] == enters.get(kind)]
    turned = [ATT] * (kind == MAG and "field strength" not in entered)
    return tuple(dict.fromkeys([*alike, *turned]))


def _unwatched(sensor: SensorReadings, why: str) -> WatchedSensor:
    return WatchedSensor(kind=kind_of(sensor), name=sensor.name, columns=sensor.columns, why_not=why)


def _why_nothing(moving: Sequence[Record], healthy: Sequence[Record]) -> str:
    """Return why no sensor can be watched; "" where one might."""
    if not moving:
        return _NO_MOTION
    if not healthy:
        return "nothing of the log was learnt as healthy"
    hz = 1.0 / moving[0].sample_period_s
    if hz < _SLOWEST_HZ:
        return f"gyros and attitude come at {hz:.3g} Hz; at least 10 are needed"
    if len(_lively_s(healthy)) < _FEWEST_LIVELY:  # with its motors off, perhaps, which turn the field
        return "nothing moves where the log was learnt as healthy"
    return ""


def _hovers(sensor: SensorReadings, healthy: Sequence[Record]) -> str:
    """Return why an airspeed tells nothing; "" where it does."""
    if kind_of(sensor) != TAS:
        return ""
    read = np.concatenate([sensor.beside(record)["tas"] for record in healthy])
    read = read[np.isfinite(read)]
    usual_kt = float(np.median(read)) if len(read) else 0.0
    return "" if usual_kt >= _HOVERS_KT else f"it reads {usual_kt:.2g} kt where healthy: no airspeed of a wing"


def _told(
    sensors: Sequence[SensorReadings], moving: Sequence[Record], healthy: Sequence[Record], learnt_s: Sequence[Span]
) -> _Told | None:
    """Return what the cross-check of some sensors says of a log; None where nothing can be learnt."""
    taught = [_beside(record, sensors) for record in healthy]
    try:
        monitor = CrossCheck(by_itself=False, margin=_MARGIN).calibrate(taught)
    except InputError:
        return None
    left = [part for part in outside(moving, learnt_s) if part.start_s > min(record.start_s for record in healthy)]
    watched = [part for part in left if part.end_s - part.start_s > _SHORTEST_S]
    return _Told(monitor=monitor, watches=tuple(monitor.watch(_beside(part, sensors)) for part in watched))


def _beside(record: Record, sensors: Sequence[SensorReadings]) -> Record:
    for each in sensors:
        record = each.beside(record)
    return record


def _lively_s(moving: Sequence[Record]) -> FloatArray:
    """Return the seconds in which gyros and attitude both turn."""
    seconds_s, turning = turning_by_second(moving)
    return seconds_s[turning > LIVELY_DEG_S]


def _watched(sensor: SensorReadings, told: _Told | None, all_told: Sequence[_Told], flown: Flown) -> WatchedSensor:
    """Return what is told of a sensor; of a magnetometer also by what the log's others say."""
    if told is None:
        return _unwatched(sensor, "its healthy readings are too few to learn from, or have nothing beside them")
    kind, monitor = kind_of(sensor), told.monitor
    limits = tuple(_limits(kind, monitor))
    if not limits:
        return _unwatched(sensor, "the healthy part is too short or too restless for a bound")
    others = [other for other in all_told if other is not told] if kind == MAG else []
    settled = [
        (_alone(alarm, watch.record.end_s, told, others), watch) for watch in told.watches for alarm in watch.alarms
    ]
    alarms: list[Alarm] = []
    open_s = np.inf
    for alarm, watch in settled:
        judged = _doubted(alarm, watch, flown, open_s)
        if (judged.sensor != kind or judged.doubt) and not out_of_ordinary(alarm, flown):
            open_s = min(open_s, alarm.time_s)
        if _is_about(judged, kind):
            alarms.append(judged)
    known = {axis: monitor.entered[axis] for axis in monitor.entered if np.isfinite(_bound(monitor, axis))}
    return WatchedSensor(
        kind=kind,
        name=sensor.name,
        columns=sensor.columns,
        limits=limits,
        alike=not_told_apart(known, kind),
        silent_s=_silent_s(sensor, told, flown.last_s),
        alarms=tuple(alarms),
    )


def _silent_s(sensor: SensorReadings, told: _Told, flown_s: float) -> tuple[Span, ...]:
    """Return where a sensor reads nothing while the aircraft flies, and the log goes on."""
    most_s = max(_LASTS_S, _SILENT * float(np.median(np.diff(sensor.time_s))))
    found: list[Span] = []
    for watch in told.watches:
        first_s, last_s = watch.record.start_s, min(watch.record.end_s, flown_s)
        own = sensor.time_s[(sensor.time_s > first_s) & (sensor.time_s < last_s)]
        at_s = np.concatenate([[first_s], own, [last_s]])
        found += [(float(at_s[row]), float(at_s[row + 1])) for row in np.flatnonzero(np.diff(at_s) > most_s)]
    return tuple(found)


def _is_about(alarm: Alarm, kind: str) -> bool:
    """Tell whether an alarm names a sensor, or leaves it among those that may be wrong."""
    last = alarm.last
    return last is not None and (last.sensor == kind or (last.sensor is None and kind in last.candidates))


def _bound(monitor: CrossCheckMonitor, axis: str) -> float:
    """Return the bound of a relation's axis over two seconds; inf where it isn't known."""
    for name, learnt in monitor.learnt.items():
        axes = _axes(monitor, name)
        if axis in axes:
            return float(learnt.bounds[: _LEARNT_AT + 1, axes.index(axis)].min())
    return np.inf


def _axes(monitor: CrossCheckMonitor, relation: str) -> list[str]:
    """Return the axes of a relation, in order."""
    return [axis for axis in monitor.entered if axis.split(":")[0] == relation or axis.split()[0] == relation]


def _limits(kind: str, monitor: CrossCheckMonitor) -> Iterator[Limit]:
    """Give from which error on a sensor contradicts others, the worst axis of each relation."""
    found: dict[str, tuple[tuple[str, ...], float]] = {}
    for axis, sensors in monitor.entered.items():
        if kind in sensors and np.isfinite(_bound(monitor, axis)):
            name = axis.split(":")[0].split(", across")[0]
            others = tuple(other for other in sensors if other != kind)
            found[name] = (others, max(found.get(name, ((), 0.0))[1], _bound(monitor, axis)))
    for name, (others, bound) in found.items():
        unit = UNITS[name]
        size = 100.0 * bound if unit == "%" else float(np.degrees(bound)) if unit == "deg" else bound
        if size <= _MOST[unit]:
            yield Limit(others, size, unit)


def _alone(alarm: Alarm, end_s: float, own: _Told, others: Sequence[_Told]) -> Alarm:
    """Return an alarm that names its magnetometer if another one would show an error of the attitude, and doesn't."""
    last = alarm.last
    if last is None or last.sensor is not None or MAG not in last.candidates or not {*last.candidates} <= {MAG, ATT}:
        return alarm
    span = (alarm.time_s, end_s if alarm.ended_s is None else alarm.ended_s)
    shown = [_largest(own, axis, span) * _bound(own.monitor, axis) for axis in _DIRECTIONS]
    for other in others:
        seen = [_largest(other, axis, span) for axis in _DIRECTIONS]
        expected = [size / _bound(other.monitor, axis) for size, axis in zip(shown, _DIRECTIONS, strict=True)]
        if max(expected) > _LARGE and max(seen) < 1.0 and span[1] - span[0] > _LASTS_S:
            reason = "another magnetometer agrees with the attitude"
            judged = replace(last, time_s=span[0] + _LASTS_S, sensor=MAG, candidates=(MAG,), doubt="", reason=reason)
            return replace(alarm, judgements=(*alarm.judgements, judged))
    return alarm


def _largest(told: _Told, axis: str, span: Span) -> float:
    """Return how large a relation's axis gets within a span beside its bound; inf where that isn't known."""
    values = [
        watch.scores[axis].values[(watch.record.time_s >= span[0]) & (watch.record.time_s <= span[1])]
        for watch in told.watches
        if axis in watch.scores
    ]
    known = np.concatenate([np.zeros(0), *(each[np.isfinite(each)] for each in values)])
    return float(known.max()) if len(known) else np.inf


def _doubted(alarm: Alarm, watch: Watch, flown: Flown, open_s: float) -> Alarm:
    """Return an alarm with why it may be no fault: it is short, begins out of the ordinary, or isn't the first.

    Where sensors contradicted each other before, at `open_s`, and nothing came of that, the flight isn't what was
    learnt.
    """
    if alarm.sensor is None:
        return alarm
    why = out_of_ordinary(alarm, flown) or _why_doubted(alarm, watch, open_s)
    if not why:
        return alarm
    last = alarm.last
    assert last is not None  # it names a sensor
    return replace(alarm, judgements=(*alarm.judgements, replace(last, doubt=why)))


def out_of_ordinary(alarm: Alarm, flown: Flown) -> str:
    """Return what the flight does where an alarm begins, or before it names a sensor, if that may be its cause."""
    named_s = alarm.time_s if alarm.isolated_s is None else alarm.isolated_s
    for each in flown.excursions:
        if each.start_s - _ABOUT_S <= named_s and alarm.time_s <= each.end_s + _ABOUT_S:
            return each.reason
    if named_s > flown.last_s:
        return "it begins, or is named, as the motion ends"
    return "" if flown.moves_about(alarm.time_s) else "it begins while nothing moves"


def _why_doubted(alarm: Alarm, watch: Watch, open_s: float) -> str:
    if alarm.time_s > open_s:
        return f"sensors contradicted each other before, from {open_s:.1f} s on, and nothing came of that"
    end_s = np.inf if alarm.ended_s is None else alarm.ended_s
    rows = (watch.record.time_s >= alarm.time_s) & (watch.record.time_s <= end_s)
    loud = {axis: np.nan_to_num(score.values[rows]) > 1.0 for axis, score in watch.scores.items()}
    lasts_s = watch.record.sample_period_s * np.count_nonzero(np.any(list(loud.values()), axis=0))
    if lasts_s < _LASTS_S:
        return f"it lasts {lasts_s:.1f} s in all: too short for a name"
    shown = [axis for axis, each in loud.items() if each.any()]
    upright = {axis.split(":")[0] for axis in shown if not axis.endswith(_LEVEL)}
    level = {axis.split(":")[0] for axis in shown if ALTITUDE not in axis and not axis.endswith(_DOWN)}
    if alarm.sensor == ALTITUDE and shown == [_BY_FORCE]:
        return ""  # only what no force could have moved the aircraft by leaves the altitude alone in it
    if alarm.sensor != MAG and max(len(upright), len(level)) < _WITNESSES:
        return f"no two comparisons of one direction show it, only {' and '.join(shown)}"
    return ""
