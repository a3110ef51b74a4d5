"""Which surface an alarm is put down to: one whose failure explains more than anything else that could have happened.

Wind shakes everything, damage changes several effects at once, and a sensor's fault looks like a deflection. So a
surface is named only where no other's deviation comes near, no sensor of the flow would explain the same
(`flow_sensors.py`), what no surface explains is small beside it, and kinematics hold. Otherwise it is said what may be,
and that nobody can tell. Who was named stays named while the aircraft is thrown about, which no linear answer explains,
unless another surface or a sensor comes up. Then drag isn't what it was, either, so a throttle that comes up after a
surface was named changes nothing.

Which kind of fault it has, stuck, weak, slow or off, its answer tells. Over sixteen seconds behind an alarm, b is the
share of the command that is missing and c how late it comes. A surface that is stuck answers nothing, b = -1, wherever
it is; one that has lost effectiveness answers less, at once; one that is slow answers later; a bent one answers as it
did, with another zero. Where the command hardly moved, none of it shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.surfaces.deviation import LABELS
from gtmbench.detectors.surfaces.thrust import THROTTLE
from gtmbench.values.record import FloatArray

_DECISIVE = 3.0  # nats by which a sensor of the flow has to explain it worse: 20 times less likely
_DECISIVE_OF_THROTTLE = 5.0  # it is looked at up to five times, and wind is no white noise
_NEAR = 0.4  # of the greatest: as much of another surface's, if that is above its threshold, too
_LEFT = 0.5  # of the greatest: as much of what no surface explains
_LEFT_AT_LEAST = 0.5  # of its threshold


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What is known of an alarm at a look."""

    surfaces: tuple[str, ...]
    # shape (series,): the greatest of every series' tests over its threshold since the alarm: first the surfaces, then
    # what none of them explains. NaN where nothing is known
    peaks: FloatArray
    sensors: tuple[str, ...]  # those that kinematics speak of
    # shape (surfaces,): by how many nats, at most, each surface has explained what is off better than any sensor of the
    # flow would
    margins: FloatArray
    named: str | None = None  # the surface that was named before
    kind: str | None = None  # the kind of fault, as far as it shows, of the surface with the greatest peak


def judged(seen: Seen, time_s: float) -> Judgement:
    """Return the judgement of an alarm.

    >>> from dataclasses import replace
    >>> told = np.array([9.0, 9.0])
    >>> seen = Seen(surfaces=("elevator", "rudder"), peaks=np.array([9.0, 0.3, 0.2]), sensors=(), margins=told)
    >>> judged(seen, 5.0).verdict, judged(replace(seen, peaks=np.array([9.0, 8.0, 0.2])), 5.0).verdict
    ('elevator failed', "can't tell: surface or wind: elevator or rudder")
    >>> judged(replace(seen, peaks=np.array([9.0, 0.3, 6.0])), 5.0).verdict  # no surface explains that
    "can't tell: surface, wind, or a sensor of the flow: elevator"
    >>> judged(replace(seen, margins=np.array([-2.0, 9.0])), 5.0).verdict  # the angle of attack would explain it, too
    "can't tell: surface, wind, or a sensor of the flow: elevator"
    >>> judged(replace(seen, sensors=("q",)), 5.0).verdict
    "can't tell: a sensor, for kinematics don't hold (q)"
    """
    own = np.nan_to_num(seen.peaks[: len(seen.surfaces)], nan=0.0)
    if seen.named not in (None, THROTTLE) and THROTTLE in seen.surfaces:
        own[seen.surfaces.index(THROTTLE)] = 0.0
    left = float(np.max(np.nan_to_num(seen.peaks[len(seen.surfaces) :], nan=0.0), initial=0.0))
    ranked = np.argsort(-own, kind="stable")
    greatest = float(own[ranked[0]])
    alike = tuple(seen.surfaces[i] for i in ranked if own[i] > 1.0 and own[i] >= _NEAR * greatest)
    alike = alike or (seen.surfaces[ranked[0]],)
    if seen.sensors:
        why = f"a sensor, for kinematics don't hold ({' or '.join(seen.sensors)})"
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=why)
    names = " or ".join(alike)
    certain = Judgement(time_s=time_s, sensor=alike[0], candidates=alike, kind=seen.kind)
    margin = float(seen.margins[ranked[0]])
    if alike[0] == seen.named and (alike[0] != THROTTLE or margin > 0.0):  # its motion since proves no more
        return certain
    decisive = _DECISIVE_OF_THROTTLE if alike[0] == THROTTLE else _DECISIVE
    if left > max(_LEFT * greatest, _LEFT_AT_LEAST) or (len(alike) == 1 and margin < decisive):
        why = f"surface, wind, or a sensor of the flow: {names}"
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=why)
    if len(alike) > 1:
        return Judgement(time_s=time_s, sensor=None, candidates=alike, doubt=f"surface or wind: {names}")
    return certain


KIND_TESTS = (LABELS.index("offset 16 s"), LABELS.index("answer 16 s"))
_SURE = 4.0  # deviations
_KNOWN = 0.15  # of b, whose deviation has to be less: more tells neither that it changed nor that it didn't
_SMALL = 0.25  # of the command: a loss below passes for none, and one above 1 less that for all


def kind_of(ratios: FloatArray, fit: FloatArray, spread: FloatArray, error: float = 0.0) -> str | None:
    """Return ``jam``, ``scale_factor``, ``lag``, ``bias``, or None where several would do.

    `ratios`, shape (2,): the tests of the offset and of the answer over their thresholds. `fit`, `spread`: by how much
    b and c have changed, and their covariance. `error`: by how much b would have had to change to be seen by one
    deviation: large where the command stood still.

    >>> sure = np.diag([0.05, 0.02]) ** 2
    >>> changes = {"stuck": (-0.98, 0.01), "weak": (-0.5, 0.0), "slow": (0.1, -0.2), "off": (0.02, 0.0)}
    >>> {what: kind_of(np.array([3.0, 9.0 * (what != "off")]), np.array(fit), sure) for what, fit in changes.items()}
    {'stuck': 'jam', 'weak': 'scale_factor', 'slow': 'lag', 'off': 'bias'}
    >>> kind_of(np.array([3.0, 2.0]), np.array([-0.7, 0.1]), 20.0 * sure) is None  # weak or stuck
    True
    """
    if not (np.isfinite(spread).all() and np.isfinite(fit).all()):
        return None
    loss, late = fit
    of_loss, of_late = np.sqrt(np.maximum(np.diag(spread), 0.0))
    offset, answer = np.nan_to_num(ratios)
    if max(of_loss, error) > _KNOWN:
        return None
    if answer <= 1.0:
        return "bias" if offset > 1.0 and abs(loss) < _SMALL else None
    if abs(loss + 1.0) < _SMALL and loss < -_SURE * of_loss:
        return "jam"
    if late < -_SURE * of_late and loss > -_SMALL:
        return "lag"
    if -1.0 + _SMALL < loss < -_SMALL and abs(late) < _SURE * of_late:
        return "scale_factor"
    return None
