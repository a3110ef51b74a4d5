"""How probable it is that a judgement is right: that the sensors are those it tells, and the kind is.

Log odds grow with the time t judged and with the margin m, by how much BIC whatever else there is explains worse:

    log(p / (1 - p)) = a + b log(1 + t / 0.1 s) + c sign(m) log(1 + |m| / 10),    p at most `MOST_PROBABLE`.

The BIC alone isn't a probability: residuals aren't white to the last nat, and models are models. The figures are fitted
by ``experiments/believed_names.py --fit`` to flights of their own, and compared with others in its report.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import MOST_PROBABLE, Judgement
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.diagnosis import EARLY
from gtmbench.detectors.isolation.fits import HOPELESS, FittedHypothesis
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.faults.registry import how_of
from gtmbench.faults.shape import CONSTANT, SHOWN
from gtmbench.values.channels import axis_of
from gtmbench.values.record import FloatArray

NAMES = 0.99  # the least probability with which a sensor is named
_SOON_S = 0.1  # from which on time counts as its logarithm
_FAR = 1e4  # of BIC: further apart says no more


class Odds(NamedTuple):
    """Log odds: at no time and no margin, how they grow with the time, and with the margin."""

    at_once: float
    by_time: float
    by_margin: float

    def probabilities(self, judged_s: FloatArray, margins: FloatArray) -> FloatArray:
        """Return the probability of each of some judgements.

        >>> Odds(0.0, 1.0, 0.0).probabilities(np.array([0.0, 0.1]), np.array([50.0, 50.0])).round(3).tolist()
        [0.5, 0.667]
        """
        odds = self.at_once + self.by_time * np.log1p(judged_s / _SOON_S)
        odds = odds + self.by_margin * np.sign(margins) * np.log1p(np.minimum(np.abs(margins), _FAR) / 10.0)
        return np.asarray(np.minimum(1.0 / (1.0 + np.exp(-odds)), MOST_PROBABLE))


# a, b and c as the fit of the module's text gives them, on seeds 725001 to 725060
NAMED = Odds(1.56, 1.91, 0.43)  # that one sensor is the right one,
SUSPECTED = Odds(3.27, 2.86, 0.26)  # the right one among several,
TOGETHER = Odds(0.64, 0.75, 0.06)  # or all of several
KIND = Odds(-0.71, 0.37, 1.0)  # that a kind is right,
KIND_HELD = Odds(-0.01, 0.75, 0.08)  # of kinds that look constant until they have moved


class JudgementEvidence(NamedTuple):
    """What a judgement's probabilities are made of."""

    judged_s: float  # how long the fault was surely there, and judged
    # margin, kind_margin: by how much BIC the best explanation by another sensor is worse, and by another kind of the
    # likeliest sensor
    margin: float
    kind_margin: float
    together: bool  # whether several sensors are named at once

    @classmethod
    def of(cls, case: Case, ranking: Sequence[FittedHypothesis], judged: Judgement) -> JudgementEvidence:
        """Return the evidence of a judgement of a case."""
        return cls(
            judged_s=(case.judged.stop - case.judged.start) * case.period_s,
            margin=_margin(ranking, judged),
            kind_margin=math.inf if _is_shown(judged) else kind_margin(ranking, judged),
            together=bool(judged.together),
        )

    def by(self, odds: Odds, margin: float) -> float:
        """Return a probability by a margin."""
        return float(odds.probabilities(np.array([self.judged_s]), np.array([margin]))[0])


def with_probability(case: Case, ranking: Sequence[FittedHypothesis], judged: Judgement) -> Judgement:
    """Return a judgement with its probabilities; a doubted one has none, for nobody is accused.

    A sensor is named with 99 % and more. Otherwise it is one of those that explain nearly as much, or share its axis.
    """
    if judged.doubt or not judged.candidates:
        return judged
    evidence = JudgementEvidence.of(case, ranking, judged)
    if judged.sensor is not None and evidence.by(NAMED, evidence.margin) < NAMES:
        judged = replace(judged, sensor=None, partner=None, candidates=_near(ranking, judged), reason=EARLY)
        evidence = JudgementEvidence.of(case, ranking, judged)
    odds = TOGETHER if judged.together else NAMED if judged.sensor is not None else SUSPECTED
    of_kind = KIND_HELD if how_of(judged.kind) in CONSTANT else KIND  # others look constant until they have moved
    is_known = judged.kind is not None and judged.kind != UNKNOWN
    return replace(
        judged,
        probability=evidence.by(odds, evidence.margin),
        kind_probability=evidence.by(of_kind, evidence.kind_margin) if is_known else None,
    )


def _near(ranking: Sequence[FittedHypothesis], judged: Judgement) -> tuple[str, ...]:
    """Return the sensor that a judgement names, those that explain nearly as much, and those of its axis."""
    least: dict[str, float] = {}
    for fit in ranking:
        least[fit.channel] = min(fit.bic, least.get(fit.channel, math.inf))
    most = least.get(str(judged.sensor), math.inf) + HOPELESS
    axis = [name for name in axis_of(str(judged.sensor)) if name in least]
    return tuple(dict.fromkeys([*judged.candidates, *(name for name, bic in least.items() if bic < most), *axis]))


def _margin(ranking: Sequence[FittedHypothesis], judged: Judgement) -> float:
    """Return by how much BIC the best explanation by another sensor is worse; 0 where it is better."""
    inside = _least(fit.bic for fit in ranking if fit.channel in judged.candidates)
    outside = _least(fit.bic for fit in ranking if fit.channel not in judged.candidates)
    return max(outside - inside, 0.0) if inside < math.inf else 0.0


def _is_shown(judged: Judgement) -> bool:
    """Tell whether readings show a kind as no other kind's do; a constant may be others' that have yet to move."""
    how = how_of(judged.kind)
    return how in SHOWN and how not in CONSTANT


def kind_margin(ranking: Sequence[FittedHypothesis], judged: Judgement) -> float:
    """Return by how much BIC the next kind of the likeliest sensor is worse than the one told; inf without another."""
    likeliest = judged.sensor or next(iter(judged.candidates), None)
    own = [fit for fit in ranking if fit.channel == likeliest and fit.kind != UNKNOWN]
    told = _least(fit.bic for fit in own if fit.kind == judged.kind)
    return _least(fit.bic for fit in own if fit.kind != judged.kind) - told if told < math.inf else 0.0


def _least(values: Iterable[float]) -> float:
    return min(values, default=math.inf)
