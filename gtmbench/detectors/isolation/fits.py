"""Which hypotheses explain a case best: every suspect's, ranked by the BIC."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from gtmbench.detectors.isolation.bend import CANDIDATES, Bend, sharpness_of
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.fitter import PEERS, UNKNOWN, Fit, Fitter, simplest
from gtmbench.detectors.isolation.hypotheses import known, unknown
from gtmbench.detectors.isolation.suspect import Left, Suspect
from gtmbench.values.channels import axis_of

_LIKELY = 3  # estimators
_RARELY = 10.0  # of -2 log likelihood: an attitude that is taken for driven isn't
_HOPELESS = 200.0  # of -2 log likelihood
ABSORBING = (UNKNOWN, "random_walk", "noise")  # explain a little of everything


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedHypothesis(Fit):
    """The fit of a suspect, and its BIC: log(samples) a number fitted, residuals that it leaves alone included."""

    channel: str
    bic: float


def suspects_in(case: Case, channels: Sequence[str]) -> list[Suspect]:
    """Return those of some channels that have a virtual sensor."""
    return [suspect for name in channels if (suspect := _suspect(case, name)) is not None]


@lru_cache(maxsize=12)  # one case is judged in several steps
def _suspect(case: Case, channel: str) -> Suspect | None:
    return _driving(case, channel) if channel in case.driving else Suspect.of(case, channel)


def _driving(case: Case, channel: str) -> Suspect:
    """Return a gyro that drives the attitude, through the estimator by which simple shapes explain most.

    Which that is the linear tells but for a few, and of these the whole equations. It may also be that the estimator
    takes another gyro than the one that is logged, or that there is none: then the attitude stays straight.
    """
    sharpness = sharpness_of(case.monitor.operators[channel])
    bends = [Bend(estimator, case.record, case.start, channel, sharpness) for estimator in CANDIDATES]
    tried = [simplest(Suspect.driving(case, channel, bend)) for bend in bends]
    likely = sorted(tried, key=lambda simple: simple.deviance)[:_LIKELY]
    bent = [simple.suspect.without(simple.change) for simple in likely]
    best = likely[0] if bent[0] is likely[0].suspect else min(map(simplest, bent), key=lambda simple: simple.deviance)
    straight = Suspect.of(case, channel)
    if straight is not None and simplest(straight).least + _RARELY < best.least:
        return straight
    return best.suspect


def ranked_hypotheses(case: Case, channels: Sequence[str], without: Iterable[str] = ()) -> list[FittedHypothesis]:
    """Return every hypothesis on the suspects that have a virtual sensor, best first.

    What a sensor's own readings show, and heals its residuals, needs no other fault to be absent: what it leaves alone
    may be another's. An axis whose suspects leave far more than the best so far with whatever simple shape and noise
    isn't tried further; nor is a suspect that could explain all that it enters and would still leave far more.
    """
    penalty = float(np.log(max(case.count, 2)))
    suspects = suspects_in(case, channels)
    fitters = [Fitter(suspect, without) for suspect in suspects]
    mates = {
        fitter: [other for other in fitters if other.suspect.channel in axis_of(fitter.suspect.channel)]
        for fitter in fitters
    }
    ranking: list[FittedHypothesis] = []
    for fitter in sorted(fitters, key=lambda fitter: _likely_first(fitter, mates[fitter])):
        best = min(ranking, key=lambda fit: fit.bic, default=None)
        if best is not None and _is_out(fitter, mates[fitter], best):
            continue
        objection = case.objection(fitter.suspect.channel)
        for fit in (*known(fitter), *unknown(fitter)):
            bic = fit.left.deviance + fitter.suspect.elsewhere + fit.free * penalty + objection
            if fit.is_shown and fitter.suspect.sick_elsewhere and fit.left.heals(case.monitor):
                bic -= fitter.suspect.sick_elsewhere
            ranking.append(FittedHypothesis(**vars(fit), channel=fitter.suspect.channel, bic=bic))
    ranking.sort(key=lambda fit: fit.bic)
    is_open = bool(ranking) and ranking[0].kind in ABSORBING and not ranking[0].left.heals(case.monitor)
    if is_open and "cross-axis" not in set(without):
        ranking = sorted([*ranking, *_swaps(case, suspects)], key=lambda fit: fit.bic)
    return ranking


def hopeless(case: Case, ranking: Sequence[FittedHypothesis], suspects: Sequence[str]) -> set[str]:
    """Return the suspects that no more data will prove right; none, until a case is long enough to tell.

    Those of the best one's axis always may.
    """
    if not ranking or not case.is_telling:
        return set()
    best = ranking[0]
    near = {fit.channel for fit in ranking if fit.bic <= best.bic + _HOPELESS}
    return {name for name in suspects if name not in near and name not in axis_of(best.channel)}


def _is_out(fitter: Fitter, mates: Sequence[Fitter], best: FittedHypothesis) -> bool:
    """Tell whether a suspect leaves far more than the best so far, and its mates too.

    Simple shapes are no measure of a suspect where they aren't of the best one, its mate: a sign that has flipped isn't
    one.
    """
    most = best.bic + _HOPELESS
    if fitter.suspect.at_least > most:
        return True
    is_other = all(best.channel != mate.suspect.channel for mate in mates)
    return is_other and all(_leaves_more(mate, most) for mate in mates)


def _likely_first(fitter: Fitter, mates: Sequence[Fitter]) -> tuple[float, float]:
    """Return what orders suspects: about the least that those of an axis leave without noise, then one alone."""
    if any(mate.is_traced for mate in mates):
        return -np.inf, float(not fitter.is_traced)
    return min(map(_left_by_shapes, mates)), _left_by_shapes(fitter)


def _left_by_shapes(fitter: Fitter) -> float:
    """Return about the least that a suspect leaves without noise; of one that holds or clips shapes don't tell."""
    return -np.inf if fitter.is_traced else fitter.plain(*fitter.shapes).deviance + fitter.suspect.elsewhere


def _leaves_more(fitter: Fitter, most: float) -> bool:
    """Tell whether a suspect leaves more than so much with whatever simple shape and noise."""
    elsewhere = fitter.suspect.elsewhere
    if _left_by_shapes(fitter) <= most:
        return False
    return elsewhere > most or all(
        noise.left.deviance + elsewhere > most for noise in fitter.noises([tuple(fitter.shapes)])[0]
    )


def _swaps(case: Case, suspects: Sequence[Suspect]) -> Iterator[FittedHypothesis]:
    """Give the hypotheses that two sensors have changed places, each from both sides."""
    for one, other in combinations([suspect.channel for suspect in suspects], 2):
        if any({one, other} <= set(group) for group in PEERS):
            left = _swapped_back(case, one, other)
            for channel, partner in ((one, other), (other, one)):
                yield FittedHypothesis(
                    kind="swap",
                    family="cross-axis",
                    left=left,
                    parameters={},
                    free=0,
                    partner=partner,
                    channel=channel,
                    bic=left.deviance,
                )


def _swapped_back(case: Case, one: str, other: str) -> Left:
    """Return what all of a case leaves with two channels changed places since the onset."""
    since = np.arange(len(case.record)) >= case.onset
    ones, others = case.record[one], case.record[other]
    record = case.record.replace(one, np.where(since, others, ones)).replace(other, np.where(since, ones, others))
    swapped = case.with_record(record)
    white = np.array([values[case.judged] for values in swapped.white.values()])
    return Left(deviance=swapped.deviance, outputs=tuple(swapped.white), work_out=lambda: white)
