"""Which surface an alarm is put down to: one that is off by far more than the others, while nothing else tells.

Wind shakes everything, damage changes several effects at once, and a sensor's fault looks like a deflection. So a
surface is named only where its own deviation is three times its threshold or more, no other's comes near, what
no surface explains is usual, and kinematics hold. Otherwise it is said what may be, and that nobody can tell. Who was
named stays named while the aircraft is thrown about, which no linear answer explains, unless another surface or a
sensor comes up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.values.record import FloatArray

_DECISIVE = 3.0  # times its threshold: severe gusts have come to twice
_NEAR = 0.4  # of the greatest: as much of another surface's, if that is above its threshold, too
_LEFT, _LEFT_LATE = 0.05, 0.12  # of the greatest: as much of what no surface explains, first and in the end
_LEFT_AT_LEAST = 0.35  # of its threshold


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What is known of an alarm at a look.

    Attributes
    ----------
    surfaces : tuple of str
    peaks : shape (series,)
        The greatest of every series' tests over its threshold since the alarm: first the surfaces, then what none of
        them explains. NaN where nothing is known.
    sensors : tuple of str
        Those that kinematics speak of.
    named : str or None
        The surface that was named before.
    is_last : bool
        Whether nobody looks again. A surface that throws the aircraft leaves more unexplained by then.
    """

    surfaces: tuple[str, ...]
    peaks: FloatArray
    sensors: tuple[str, ...]
    named: str | None = None
    is_last: bool = False


def judged(seen: Seen, time_s: float) -> Judgement:
    """Return the judgement of an alarm.

    Examples
    --------
    >>> from dataclasses import replace
    >>> seen = Seen(surfaces=("elevator", "rudder"), peaks=np.array([9.0, 0.3, 0.2]), sensors=())
    >>> judged(seen, 5.0).verdict, judged(replace(seen, peaks=np.array([9.0, 8.0, 0.2])), 5.0).verdict
    ('elevator failed', "can't tell: surface or wind: elevator or rudder")
    >>> judged(replace(seen, peaks=np.array([9.0, 0.3, 4.0])), 5.0).verdict  # no surface explains that
    "can't tell: surface, wind, or a sensor of the flow: elevator"
    >>> judged(replace(seen, sensors=("q",)), 5.0).verdict
    "can't tell: a sensor, for kinematics don't hold (q)"
    """
    own = np.nan_to_num(seen.peaks[: len(seen.surfaces)], nan=0.0)
    left = float(np.max(np.nan_to_num(seen.peaks[len(seen.surfaces) :], nan=0.0), initial=0.0))
    ranked = np.argsort(-own, kind="stable")
    greatest = float(own[ranked[0]])
    alike = tuple(seen.surfaces[i] for i in ranked if own[i] > 1.0 and own[i] >= _NEAR * greatest)
    alike = alike or (seen.surfaces[ranked[0]],)
    if seen.sensors:
        why = f"a sensor, for kinematics don't hold ({' or '.join(seen.sensors)})"
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=why)
    names = " or ".join(alike)
    if seen.named is not None and alike == (seen.named,):  # what it does to the motion since proves no more
        return Judgement(time_s=time_s, sensor=alike[0], candidates=alike)
    if left > max((_LEFT_LATE if seen.is_last else _LEFT) * greatest, _LEFT_AT_LEAST):
        why = f"surface, wind, or a sensor of the flow: {names}"
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=why)
    if len(alike) > 1 or greatest < _DECISIVE:
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=f"surface or wind: {names}")
    return Judgement(time_s=time_s, sensor=alike[0], candidates=alike)
