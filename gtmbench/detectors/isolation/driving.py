"""Gyros that drive the attitude: through which estimator, of those that attitudes usually come from.

Which one bent the attitude simple shapes of faults tell: linear of all, and by the whole equations of the likeliest
few. Gyros that explain far less than another one by the linear are left at that.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from gtmbench.detectors.isolation.bend import CANDIDATES, Bend, sharpness_of
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.fitter import Simple, simplest
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.values.attitude_estimators import AttitudeEstimator

_SCOUTS = (CANDIDATES[2], CANDIDATES[5])  # 2 and 20 s: of two gyros they tell which explains more
_LIKELY = 3  # estimators
_RARELY = 10.0  # of -2 log likelihood: an attitude that is taken for driven isn't
_FAR, _FAR_SHARE = 200.0, 0.5  # of -2 log likelihood; of what the best one explains


def suspects_in(case: Case, channels: Sequence[str]) -> list[Suspect]:
    """Return those of some channels that have a virtual sensor."""
    return [suspect for name in channels if (suspect := _suspect(case, name)) is not None]


def likely_suspects_in(case: Case, channels: Sequence[str]) -> list[Suspect]:
    """Return them without gyros that drive the attitude and explain far less than another one."""
    least = {name: min(of.deviance for of in _scouted(case, name)) for name in channels if name in case.driving}
    best = min(least.values(), default=0.0)
    most = best + max(_FAR, _FAR_SHARE * (case.deviance - best))
    return suspects_in(case, [name for name in channels if least.get(name, best) <= most])


def suspect_through(case: Case, channel: str, estimator: AttitudeEstimator | None) -> Suspect | None:
    """Return a suspect whose way into the attitude is known: an estimator, or none."""
    if channel not in case.driving or estimator is None:
        return Suspect.of(case, channel)
    simple = _tried(case, channel, estimator)
    return simple.suspect.without(simple.change)


@lru_cache(maxsize=12)  # one case is judged in several steps
def _suspect(case: Case, channel: str) -> Suspect | None:
    return _driving(case, channel) if channel in case.driving else Suspect.of(case, channel)


def _driving(case: Case, channel: str) -> Suspect:
    """Return a gyro that drives the attitude, through the estimator by which simple shapes explain most.

    It may also be that the estimator takes another gyro than the one that is logged, or that there is none: then the
    attitude stays straight.
    """
    others = [_tried(case, channel, estimator) for estimator in CANDIDATES if estimator not in _SCOUTS]
    likely = sorted([*_scouted(case, channel), *others], key=lambda simple: simple.deviance)[:_LIKELY]
    bent = [simple.suspect.without(simple.change) for simple in likely]
    best = likely[0] if bent[0] is likely[0].suspect else min(map(simplest, bent), key=lambda simple: simple.deviance)
    straight = Suspect.of(case, channel)
    if straight is not None and simplest(straight).least + _RARELY < best.least:
        return straight
    return best.suspect


@lru_cache(maxsize=6)
def _scouted(case: Case, channel: str) -> list[Simple]:
    return [_tried(case, channel, estimator) for estimator in _SCOUTS]


def _tried(case: Case, channel: str, estimator: AttitudeEstimator) -> Simple:
    sharpness = sharpness_of(case.monitor.operators[channel])
    return simplest(Suspect.driving(case, channel, Bend(estimator, case.record, case.start, channel, sharpness)))
