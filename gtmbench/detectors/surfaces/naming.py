"""Which surface an alarm is put down to: one that is off by far more than the others, while nothing else tells.

Wind shakes everything, damage changes several effects at once, and a sensor's fault looks like a deflection. So a
surface is named only where its own deviation is decisive and has the shape of a surface's, no other's comes near, what
no surface explains is usual, and kinematics hold. Otherwise it is said what may be, and that nobody can tell. Who was named stays named while the
aircraft is thrown about, which no linear answer explains, unless another surface or a sensor comes up. An engine is
never named: one equation has it, and the accelerometer nx can be wrong there as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.values.record import FloatArray

_DECISIVE = 1.2  # times its threshold, of a test that knows the shape of what a surface does
_NEAR = 0.4  # of the greatest: as much of another surface's, if that is above its threshold, too
_LEFT, _LEFT_AT_LEAST = 0.12, 0.35  # of the greatest, and of its threshold: as much of what no surface explains
_ENGINE = "throttle"


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What is known of an alarm at a look.

    Attributes
    ----------
    surfaces : tuple of str
    peaks : shape (series,)
        The greatest of every series' tests over its threshold since the alarm: first the surfaces, then what none of
        them explains. NaN where nothing is known.
    shapes : shape (series,)
        The same of the tests that know a shape: an offset, less of an answer, a late one. Noise alone has none.
    sensors : tuple of str
        Those that kinematics speak of.
    named : str or None
        The surface that was named before.
    """

    surfaces: tuple[str, ...]
    peaks: FloatArray
    shapes: FloatArray
    sensors: tuple[str, ...]
    named: str | None = None


def judged(seen: Seen, time_s: float) -> Judgement:
    """Return the judgement of an alarm.

    Examples
    --------
    >>> from dataclasses import replace
    >>> one, both = np.array([9.0, 0.3, 0.2]), np.array([9.0, 8.0, 0.2])
    >>> seen = Seen(surfaces=("elevator", "rudder"), peaks=one, shapes=one, sensors=())
    >>> judged(seen, 5.0).verdict, judged(replace(seen, peaks=both, shapes=both), 5.0).verdict
    ('elevator failed', "can't tell: surface or wind: elevator or rudder")
    >>> judged(replace(seen, shapes=0.1 * one), 5.0).verdict  # it is noisy, and that is all
    "can't tell: surface or wind: elevator"
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
    if alike == (seen.named,):  # what it does to the motion since proves no more
        return Judgement(time_s=time_s, sensor=alike[0], candidates=alike)
    if left > max(_LEFT * greatest, _LEFT_AT_LEAST):
        why = f"surface, wind, or a sensor of the flow: {names}"
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=why)
    if alike == (_ENGINE,):
        why = f"engine, wind, or the accelerometer nx: {names}"
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=why)
    shape = float(np.nan_to_num(seen.shapes[ranked[0]], nan=0.0))
    if len(alike) > 1 or shape < _DECISIVE:
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=f"surface or wind: {names}")
    return Judgement(time_s=time_s, sensor=alike[0], candidates=alike)
