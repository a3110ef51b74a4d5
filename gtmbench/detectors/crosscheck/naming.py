"""Which sensor is wrong, by which relations are violated and by what the others would show.

All relations but the field's compare two of four accelerations: the GPS's (g), the accelerometers' (a), that of the
air data (t) and the altitude's (h, downwards only). A sensor that is wrong shows the same error in each relation that
it enters. So a sensor remains suspect if every violated relation holds it, and if no other relation is silent in which
its error, as a violated one tells it, would have been twice beyond the bound. The wind changes in any flight: what it
may explain rules nobody out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gtmbench.checks import listed
from gtmbench.detectors.crosscheck.learnt import WINDOWS, Learnt, moving_mean
from gtmbench.detectors.crosscheck.relations import (
    ACCEL,
    ALPHA,
    ALTITUDE,
    ATT,
    BETA,
    BLOCK_S,
    GPS,
    MAG,
    TAS,
    WIND,
    Relation,
)
from gtmbench.values.channels import G_M_S2, GPS_VELOCITY, MAGNETOMETER
from gtmbench.values.record import FloatArray

_CLEAR = 2.0  # times its bound: an error that would be seen
_LOUD, _NEARLY_ALL = 5.0, 0.95  # deviations of a healthy block, and of what is seen beyond them
_UNEXPLAINED = 0.35  # of what is seen
_FASTEST_RAD = 0.35  # in a block: 100 deg/s
_MOST_G = 2.0  # what is turned, in an ordinary manoeuvre
_MOST_PULLED = 10.0 * G_M_S2  # by any aircraft
_STORM_M_S, _GUST_M_S2 = 25.0, 30.0  # no wind changes by more, or by more in a block: 6 m/s in 0.2 s
AIR = "air"
FIELD = "field"
_GPS_FORCE, _GPS_AIR, _AIR_FORCE = "gps, accelerometers", "gps, air", "air, accelerometers"
_ALTITUDE_FORCE = "altitude, accelerometers"


class _Pair(NamedTuple):
    """Two accelerations that a relation compares, as one + sign two, and whether by the speeds that they come to."""

    one: str
    two: str
    second: float
    is_speed: bool

    @property
    def sides(self) -> tuple[str, str]:
        return self.one, self.two

    def sign(self, side: str) -> float:
        return 1.0 if side == self.one else self.second


_PAIRS: Mapping[str, _Pair] = {
    "gps, accelerometers": _Pair(GPS, ACCEL, -1.0, is_speed=False),
    "air, accelerometers": _Pair(AIR, ACCEL, -1.0, is_speed=False),
    "gps, air": _Pair(GPS, AIR, -1.0, is_speed=True),
    "gps, altitude": _Pair(GPS, ALTITUDE, 1.0, is_speed=True),
    "altitude, accelerometers": _Pair(ALTITUDE, ACCEL, 1.0, is_speed=False),
}
_SIDE = {GPS: GPS, ACCEL: ACCEL, TAS: AIR, ALPHA: AIR, BETA: AIR, ALTITUDE: ALTITUDE, ATT: ACCEL}


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """A relation on a record, and what of it is usual.

    Attributes
    ----------
    relation : Relation
    learnt : Learnt
    errors : shape (blocks, axes)
        In the axes in which they are judged.
    widening : shape (blocks, axes)
        By how much less is known of them for what isn't known of the constants.
    ratios : shape (blocks, axes)
        How large they are beside their bounds.
    """

    relation: Relation
    learnt: Learnt
    errors: FloatArray = field(repr=False)
    widening: FloatArray = field(repr=False)
    ratios: FloatArray = field(repr=False)

    @classmethod
    def of(cls, relation: Relation, learnt: Learnt) -> Seen:
        """Return what is seen of a relation."""
        errors, widening = learnt.errors(relation), learnt.widening(relation)
        ratios = learnt.beside_bounds(errors, widening)
        return cls(relation=relation, learnt=learnt, errors=errors, widening=widening, ratios=ratios)


def candidates(seen: Sequence[Seen], own: Mapping[str, float], blocks: range, turns_rad: FloatArray) -> tuple[str, ...]:
    """Return the sensors that may be wrong, given what is seen in some blocks.

    Parameters
    ----------
    seen : sequence of Seen
    own : mapping of sensor to float
        What sensors show by themselves, beside what is usual.
    blocks : range
        From the onset to now.
    turns_rad : shape (blocks,)
        By how much the attitude turned since the block before.

    Returns
    -------
    tuple of str
        The only one left is the one that is wrong. None: more than one sensor is.
    """
    part = slice(blocks.start, blocks.stop)
    peaks = {each.relation.name: _peaks(each.ratios[part]) for each in seen}
    holding = [
        sensors
        for each in seen
        for (_, sensors), peak in zip(each.relation.axes, peaks[each.relation.name], strict=True)
        if peak > 1.0
    ]
    holding += [frozenset({sensor}) for sensor, ratio in own.items() if ratio > 1.0]
    left = _held_by_all(holding)
    if not _is_no_wind({each.relation.name: each for each in seen}, part):
        left |= _held_by_all([sensors for sensors in holding if WIND not in sensors])  # beside a wind that changes
    return tuple(sorted(sensor for sensor in left if not _is_cleared(sensor, seen, peaks, part, turns_rad)))


def _held_by_all(holding: Sequence[frozenset[str]]) -> frozenset[str]:
    return frozenset.intersection(*holding) if holding else frozenset()


def _peaks(ratios: FloatArray) -> FloatArray:
    return np.asarray(np.max(np.nan_to_num(ratios), axis=0, initial=0.0))


def _is_cleared(
    sensor: str, seen: Sequence[Seen], peaks: Mapping[str, FloatArray], part: slice, turns_rad: FloatArray
) -> bool:
    """Tell whether a sensor's error would have been seen in a relation that is silent."""
    by_name = {each.relation.name: each for each in seen}
    if sensor == ATT and (_is_sudden(by_name, part, turns_rad) or _explains_little(by_name, part)):
        return True
    if sensor == WIND and _is_no_wind(by_name, part):
        return True
    if sensor in (ACCEL, ATT) and _is_no_force(by_name, part):
        return True
    air = [peaks[name] > 1.0 for name in (_GPS_AIR, _AIR_FORCE) if name in by_name]
    if sensor == TAS and any(each.any() for each in air) and not any(each[0] for each in air):
        return True  # it shows along the way first
    for name, each in by_name.items():
        if name in _PAIRS and (peaks[name] > 1.0).any():
            for other, expected in _expected(sensor, each, by_name, part):
                mainly = expected >= 0.5 * expected.max()  # the rest may be what turns within a block leave
                if (mainly & (peaks[other] <= 1.0) & (expected > _CLEAR)).any():
                    return True
    return False


def _is_no_force(by_name: Mapping[str, Seen], part: slice) -> bool:
    """Tell whether the altitude moves as no force moves an aircraft, whichever way it is turned.

    Were the accelerometers wrong, the aircraft would have to be pulled by e less what they read; were the attitude, it
    could turn what they read by no more than twice its size.
    """
    seen = by_name.get(_ALTITUDE_FORCE)
    if seen is None or seen.relation.force is None:
        return False
    allowed = seen.learnt.allowed(1, np.nan_to_num(seen.widening[part], nan=np.inf))[:, 0]
    most = 2.0 * seen.relation.force[part] + _MOST_PULLED + allowed
    return bool((np.abs(np.nan_to_num(seen.errors[part, 0])) > most).any())


def _is_no_wind(by_name: Mapping[str, Seen], part: slice) -> bool:
    """Tell whether the wind would have changed by more, or more suddenly, than any wind does."""
    for name, window, most in ((_GPS_AIR, WINDOWS[2], _STORM_M_S), (_AIR_FORCE, WINDOWS[0], _GUST_M_S2)):
        if name in by_name and (np.nan_to_num(np.abs(moving_mean(by_name[name].errors[part], window))) > most).any():
            return True
    return False


def _expected(
    sensor: str, violated: Seen, by_name: Mapping[str, Seen], part: slice
) -> Iterator[tuple[str, FloatArray]]:
    """Give by relation how large a sensor's error, as a violated one tells it, would be there beside the bounds."""
    name = violated.relation.name
    pair, side = _PAIRS[name], _SIDE.get(sensor)
    if side not in pair.sides:
        return
    frames = np.nan_to_num(violated.relation.frame[part])
    told = np.nan_to_num(violated.errors[part])
    if sensor == ATT:  # turned gravity shows the same wherever accelerometers enter, along the way at least
        if name != _AIR_FORCE:
            return
        told = told * [1.0, 0.0, 0.0]
    told = told * pair.sign(side)
    for other, its in _PAIRS.items():
        if other == name or other not in by_name or side not in its.sides or (sensor == ATT and other != _GPS_FORCE):
            continue
        if frames.shape[1] == 1 and other in (_GPS_AIR, _AIR_FORCE):
            continue  # axes that lean, and only what is down is known
        yield other, _carried(told * its.sign(side), frames, violated, by_name[other], part)


def _carried(told: FloatArray, frames: FloatArray, violated: Seen, other: Seen, part: slice) -> FloatArray:
    """Return the largest that an error of one relation would be in another, beside the bounds there, shape (axes,).

    What healthy noise may have added to it is taken off.
    """
    learnt, count = violated.learnt, len(told)
    is_speed = _PAIRS[violated.relation.name].is_speed
    becomes_speed = _PAIRS[other.relation.name].is_speed
    turned = _turned(frames, np.nan_to_num(other.relation.frame[part]))
    widening = np.nan_to_num(violated.widening[part], nan=np.inf)
    steps = np.arange(1, count + 1)[:, np.newaxis]
    if becomes_speed and not is_speed:
        allowed = _growing(learnt, widening) * steps * BLOCK_S
        gone = np.cumsum(np.einsum("bji,bj->bi", _in_space(frames), told), axis=0) * BLOCK_S  # summed in space
        into = _in_space(np.nan_to_num(other.relation.frame[part]))
        return _most(np.einsum("bij,bj->bi", into, gone), turned, allowed, other, part, 1)
    if becomes_speed:
        return _most(np.einsum("bij,bj->bi", turned, told), turned, learnt.allowed(1, widening), other, part, 1)
    shown = np.einsum("bij,bj->bi", turned, told)
    largest = np.zeros(other.errors.shape[1])
    for window in WINDOWS:
        if is_speed and 2 * window < count:  # from the mean over a window to that over the next
            mean = np.nan_to_num(moving_mean(shown, window))
            change = np.zeros_like(mean)
            change[2 * window :] = (mean[2 * window :] - mean[window:-window]) / (window * BLOCK_S)
            allowed = np.sqrt(2.0) * learnt.allowed(window, widening) / (window * BLOCK_S)
            largest = np.maximum(largest, _most(change, turned, allowed, other, part, window))
        elif not is_speed and window <= count:
            mean = np.nan_to_num(moving_mean(shown, window))
            largest = np.maximum(largest, _most(mean, turned, learnt.allowed(window, widening), other, part, window))
    return largest


def _growing(learnt: Learnt, widening: FloatArray) -> FloatArray:
    """Return what the mean over the first blocks doesn't exceed, of as many as there are up to each."""
    counts = range(1, len(widening) + 1)
    return np.array([learnt.allowed(count, row) for count, row in zip(counts, widening, strict=True)])


def _turned(frames: FloatArray, others: FloatArray) -> FloatArray:
    """Return the rotations from the axes of one relation to those of another."""
    return np.asarray(np.einsum("bin,bjn->bij", _in_space(others), _in_space(frames)))


def _in_space(frames: FloatArray) -> FloatArray:
    """Return the axes of a relation along north, east and down, shape (blocks, axes, 3); a single one is that down."""
    return np.tile([[0.0, 0.0, 1.0]], (len(frames), 1, 1)) if frames.shape[1] == 1 else frames


def _most(
    shown: FloatArray, turned: FloatArray, allowed: FloatArray, other: Seen, part: slice, window: int
) -> FloatArray:
    """Return the largest of an error in a relation's axes, less what noise is allowed, beside the bounds there."""
    noise = np.sqrt(np.einsum("bij,bj->bi", turned**2, np.nan_to_num(allowed, posinf=1e9) ** 2))
    bounds = other.learnt.allowed(window, other.widening[part])
    beyond = np.maximum(np.abs(shown) - noise, 0.0) / bounds
    return np.asarray(np.max(np.nan_to_num(beyond), axis=0, initial=0.0))


def _explains_little(by_name: Mapping[str, Seen], part: slice) -> bool:
    """Tell whether a wrong attitude leaves much of what is seen now unexplained.

    An attitude that is off by a turn R shows (I - R) f in the accelerometers' relation to the GPS, (R' - I) u in that
    of the air, and (R - I) F in the field's direction: three unknowns, found by least squares in units of bounds.
    """
    from scipy.optimize import least_squares  # takes longer to import than all of ours

    for window in WINDOWS[:-1]:  # in longer ones a gyro that is wrong turns it too far for one turn
        now = [told for name in (_GPS_FORCE, _GPS_AIR, FIELD) if (told := _now(by_name.get(name), part, window))]
        if not now:
            continue
        target = np.concatenate([each.errors for each in now])
        if len(target) < 3:  # axes whose bounds are known: three unknowns explain fewer
            continue

        def left(turn: FloatArray, now: Sequence[_Now] = now) -> FloatArray:
            rotation = _by(turn)
            return np.concatenate([each.errors - each.shown(rotation) for each in now])

        found = least_squares(left, np.zeros(3), method="lm", max_nfev=60)
        if np.abs(found.fun).max() > max(_CLEAR, _UNEXPLAINED * float(np.abs(target).max())):
            return True
    return False


@dataclass(frozen=True, kw_only=True, eq=False)
class _Now:
    """The mean errors of a relation over the last blocks, in units of bounds, and what turns of the attitude show."""

    errors: FloatArray
    scaled: FloatArray  # shape (axes, 3): from north, east, down to units of bounds
    turned: FloatArray  # what a turn turns, north, east, down
    sign: float  # of what it shows: sign (R - I) turned, or (R' - I) turned
    is_inverse: bool

    def shown(self, rotation: FloatArray) -> FloatArray:
        """Return what a turn of the attitude shows, in units of bounds."""
        by = rotation.T if self.is_inverse else rotation
        return np.asarray(self.scaled @ (self.sign * (by @ self.turned - self.turned)))


def _by(turn: FloatArray) -> FloatArray:
    """Return the rotation of a rotation vector in rad, by Rodrigues' formula."""
    x, y, z = turn.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    once, twice = (math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2) if angle > 1e-8 else (1.0, 0.5)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + once * across + twice * (across @ across))


def _now(seen: Seen | None, part: slice, window: int) -> _Now | None:
    """Return what is seen now of a relation that an attitude turns; None where there is none, or too little."""
    if seen is None or part.stop - part.start < window:
        return None
    name, last = seen.relation.name, slice(part.stop - window, part.stop)
    errors = np.nan_to_num(seen.errors[last]).mean(axis=0)
    bounds = seen.learnt.allowed(window, np.nan_to_num(seen.widening[last], nan=np.inf).max(axis=0))
    frame = np.nan_to_num(seen.relation.frame[last]).mean(axis=0)
    own = np.isfinite(bounds)
    own[0] &= name != FIELD  # the length of the field is as it is in any attitude
    return _Now(
        errors=errors[own] / bounds[own],
        scaled=frame[own] / bounds[own, np.newaxis],
        turned=_reference(seen, last),
        sign=-1.0 if name == _GPS_FORCE else 1.0,
        is_inverse=name == _GPS_AIR,
    )


def _reference(seen: Seen, last: slice) -> FloatArray:
    """Return what an attitude turns in a relation: the field, the velocity through the air or the specific force."""
    if seen.relation.name == FIELD:
        return seen.relation.usual[[0, 3, 6]]
    if seen.relation.name == _GPS_AIR:  # of whose constants the fourth has u as its column
        return np.asarray(np.nan_to_num(seen.relation.design[last, :, 3]).mean(axis=0))
    return np.array([0.0, 0.0, -G_M_S2])


def _is_sudden(by_name: Mapping[str, Seen], part: slice, turns_rad: FloatArray) -> bool:
    """Tell whether the aircraft would have turned faster than any does, while its attitude didn't jump."""
    before = slice(max(part.start - 1, 0), part.stop)
    still = (turns_rad[before][1:] < _FASTEST_RAD) & (turns_rad[before][:-1] < _FASTEST_RAD)
    for name, axes, size in ((FIELD, slice(1, 3), 1.0), (_GPS_FORCE, slice(0, 3), _MOST_G * G_M_S2)):
        if name in by_name:
            seen = by_name[name]
            jumps = np.linalg.norm(np.diff(np.nan_to_num(seen.errors[before, axes]), axis=0), axis=1)
            allowed = _FASTEST_RAD * size + float(np.linalg.norm(seen.learnt.bounds_over(1)[axes]))
            if (still & (jumps > allowed)).any():
                return True
    return False


def axis_of(sensor: str, seen: Sequence[Seen], blocks: range) -> str:
    """Return the channel of a magnetometer or a GPS in which nearly all of what is seen of its error lies; "" if none.

    The field's relation has the axes of the magnetometer, and the GPS's to the accelerometers those of the GPS.
    """
    name, channels = {MAG: (FIELD, MAGNETOMETER), GPS: (_GPS_FORCE, GPS_VELOCITY)}.get(sensor, ("", ()))
    own = next((each for each in seen if each.relation.name == name), None)
    if own is None:
        return ""
    left = own.relation.y - own.relation.design @ own.learnt.constants
    noise = _LOUD * float(own.learnt.noise.max())
    beyond = np.maximum(np.abs(np.nan_to_num(left[blocks.start : blocks.stop])) - noise, 0.0)
    energy = np.sum(beyond**2, axis=0)
    is_one = energy.sum() > 0.0 and energy.max() >= _NEARLY_ALL * energy.sum()
    return channels[int(np.argmax(energy))] if is_one else ""


def text(left: Sequence[str]) -> str:
    """Say why no sensor is named."""
    if not left:
        return "more than one sensor is wrong, or the motion is beyond what was learnt"
    if tuple(left) == (ATT,):
        return "a wrong attitude may explain it, which a bank judges by gyros and attitude"
    if tuple(left) == (WIND,):
        return "a change of the wind may explain it"
    return f"{listed(left, 'or')} explains what is seen"


NAMED = (MAG, GPS, ACCEL, TAS, ALPHA, BETA, ALTITUDE)  # attitude and wind are no sensors: nobody is named for them
