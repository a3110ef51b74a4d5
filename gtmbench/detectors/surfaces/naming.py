"""Which surface a change of the answer is put down to, and how it failed.

Wind shakes everything, damage changes several effects at once, and a sensor's fault looks like a deflection. So a
surface is named only where it explains most of the change, nobody else comes near, and kinematics hold. Otherwise it is
said what may be, and that nobody can tell. Who was named stays named while the aircraft is thrown about, which no
linear answer explains, unless somebody else explains most of it. Then drag isn't what it was, either, so a throttle
that comes up after a surface was named changes nothing.

Which kind of fault it has, stuck, weak, slow or off, its answer tells. b is the share of the command that is missing
and c how late it comes. A surface that is stuck answers nothing, b = 1, wherever it is; one that has lost effectiveness
answers less, at once; one that is slow answers later; a bent one answers as it did, with another zero. Where the
command hardly moved, none of it shows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.surfaces.equations import THROTTLE
from gtmbench.detectors.surfaces.evidence import AnswerChange, SuspectEvidence
from gtmbench.values.record import FloatArray

_DECISIVE = 3.0  # nats by which others have to explain it worse: 20 times less likely
_DECISIVE_OF_THROTTLE = 5.0  # it is looked at up to five times, and wind is no white noise
_MISFIT = 0.05  # of the evidence: what a slightly wrong effect makes; of nx the airspeed tells, which has none
_OF_CHANGE, _OF_ANOTHER = (
    0.3,
    0.5,
)  # of all that changed, which hard motion shares; of who didn't alarm, or wasn't named


def judged(
    change: AnswerChange, time_s: float, *, source: str, sensor: str = "", named: str | None = None
) -> Judgement:
    """Return the judgement of an alarm.

    `source`: the surface that alarms. `sensor`: why a sensor must have failed; "" if none must. `named`: the surface
    that was named before.
    """
    likely = _likely(change, named)
    share = _OF_CHANGE if likely[0].suspect.name == (named or source) else _OF_ANOTHER
    is_told = len(likely) == 1 and likely[0].nats > share * change.nats
    surfaces = [each for each in likely if each.suspect.is_surface]
    names = tuple(each.suspect.name for each in surfaces) or (source,)
    if sensor:
        return Judgement(time_s=time_s, sensor=None, candidates=names, doubt=sensor)
    if named is not None and (not is_told or names[0] == named):
        is_it = bool(surfaces) and names[0] == named
        kind = kind_of(surfaces[0].sizes, surfaces[0].deviations) if is_it else None
        return Judgement(time_s=time_s, sensor=named, candidates=(named,), kind=kind)
    if is_told and surfaces:
        kind = kind_of(surfaces[0].sizes, surfaces[0].deviations)
        return Judgement(time_s=time_s, sensor=names[0], candidates=names, kind=kind)
    what = "surface or wind" if len(surfaces) > 1 else "surface, wind, or a sensor of the flow"
    return Judgement(time_s=time_s, sensor=None, candidates=names, doubt=f"{what}: {' or '.join(names)}")


def _likely(change: AnswerChange, named: str | None) -> list[SuspectEvidence]:
    """Return who may be behind a change; a throttle isn't after a surface."""
    if named not in (None, THROTTLE):
        change = replace(change, ranked=tuple(each for each in change.ranked if each.suspect.name != THROTTLE))
    if change.best.suspect.name == THROTTLE:
        return change.likely(_DECISIVE_OF_THROTTLE, 0.0)
    return change.likely(_DECISIVE, _MISFIT)


_SURE = 4.0  # deviations
_KNOWN = 0.15  # of b, whose deviation has to be less: more tells neither that it changed nor that it didn't
_SMALL = 0.25  # of the command: a loss below passes for none, and one above 1 less that for all
_LEAST = 1e-3  # a deviation of a size that isn't there


def kind_of(sizes: FloatArray, deviations: FloatArray) -> str | None:
    """Return ``jam``, ``scale_factor``, ``lag``, ``bias``, or None where several would do: by a, b and c of a surface.

    >>> sure = np.array([0.1, 0.05, 0.02])
    >>> changes = {"stuck": (1.0, 0.98, 0.0), "weak": (0.0, 0.5, 0.0), "slow": (0.0, 0.1, 0.2), "off": (1.0, 0.0, 0.0)}
    >>> {what: kind_of(np.array(sizes), sure) for what, sizes in changes.items()}
    {'stuck': 'jam', 'weak': 'scale_factor', 'slow': 'lag', 'off': 'bias'}
    >>> kind_of(np.array([0.0, 0.7, 0.0]), 4.0 * sure) is None  # weak or stuck
    True
    """
    lacks = sizes[1]
    is_off, is_less, is_late = np.abs(sizes) > _SURE * np.maximum(deviations, _LEAST)
    if deviations[1] > _KNOWN:
        return None
    if is_less and abs(lacks - 1.0) < _SMALL:
        return "jam"
    if is_late and lacks < _SMALL:
        return "lag"
    if is_less and not is_late and _SMALL < lacks < 1.0 - _SMALL:
        return "scale_factor"
    return "bias" if is_off and not (is_less or is_late) else None
