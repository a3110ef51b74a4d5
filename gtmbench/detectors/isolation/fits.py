"""Which hypotheses explain a case best: every suspect's, ranked by the BIC; and how well the best is known.

A gyro that drives the attitude does so through an estimator, of those that attitudes usually come from. Which one bent
the attitude simple shapes of faults tell: linear of all, and by the whole equations of the likeliest few. Gyros that
explain far less than another one by the linear are left at that. The intervals of what was fitted hold a fault's
parameters with a probability of 95 %, a model's error included.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.effects import CANDIDATES, Bend, sharpness_of
from gtmbench.detectors.isolation.fitter import PEERS, Fit, Fitter, Simple, simplest
from gtmbench.detectors.isolation.hypotheses import known, unknown
from gtmbench.detectors.isolation.suspect import Left, Suspect
from gtmbench.faults.kinds.replacing import Swap
from gtmbench.faults.registry import loaded_faults, shape_of
from gtmbench.values.attitude_estimators import AttitudeEstimator
from gtmbench.values.channels import ATTITUDE, axis_of
from gtmbench.values.record import FloatArray, Span

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


TAIL = 0.025  # of the probability, on either side of an interval
QUANTILE = 1.96  # deviations on either side: 95 % of a normal distribution
MODEL_ERROR = 1.3  # times the error by residuals of unit noise, as `experiments/believed_names.py` finds it


def intervals_of(fit: Fit) -> dict[str, Span]:
    """Return the interval of each parameter of a fit that the rows tell; a search that ended at a bound has one side.

    An error of +inf says that the parameter is at least its value, one of -inf that it is at most that.
    """
    shape = shape_of(fit.kind)
    more = 1.0 if shape is None else shape.spread
    return {
        name: interval(fit.parameters[name], more * error)
        for name, error in fit.errors().items()
        if not math.isnan(error)
    }


def rows_between(deviances: FloatArray, kappa: float) -> tuple[int, int, int]:
    """Return the row before which a change came in 2.5, 50 and 97.5 %, by -2 log likelihood D of each row.

    With a flat prior p ~ exp(-(D - min D) / (2 kappa)), kappa for the model's error.

    >>> rows_between(np.array([90.0, 60.0, 0.0, 0.0, 80.0]), 1.0)
    (2, 2, 3)
    """
    share = np.cumsum(np.exp(-0.5 * (deviances - deviances.min()) / kappa))
    low, row, high = np.searchsorted(share / share[-1], [TAIL, 0.5, 1.0 - TAIL]).tolist()
    return low, row, high


def interval(value: float, error: float) -> Span:
    """Return the interval about a value, by its standard error by residuals of unit noise.

    >>> interval(2.0, 0.0), interval(2.0, math.inf), interval(2.0, -math.inf)
    ((2.0, 2.0), (2.0, inf), (0.0, 2.0))
    """
    if math.isinf(error):
        return (float(value), math.inf) if error > 0.0 else (0.0, float(value))
    half = QUANTILE * MODEL_ERROR * error
    return (float(value - half), float(value + half))


HOPELESS = 200.0  # of -2 log likelihood
_LARGEST_DEG = 720.0  # by which an angle may read wrong


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedHypothesis(Fit):
    """The fit of a suspect, and its BIC: log(samples) a number fitted, residuals that it leaves alone included."""

    channel: str
    bic: float
    estimator: AttitudeEstimator | None = None  # through which it bends the attitude


def ranked_hypotheses(case: Case, channels: Sequence[str], without: Iterable[str] = ()) -> list[FittedHypothesis]:
    """Return every hypothesis on the suspects that have a virtual sensor, best first.

    What a sensor's own readings show, and heals its residuals, needs no other fault to be absent: what it leaves alone
    may be another's. An axis whose suspects leave far more than the best so far with whatever simple shape and noise
    isn't tried further; nor is a suspect that could explain all that it enters and would still leave far more.
    """
    penalty = float(np.log(max(case.count, 2)))
    suspects = likely_suspects_in(case, channels)
    ranking: list[FittedHypothesis] = []
    for axis in _likely_first([Fitter(suspect, without) for suspect in suspects]):
        most = min((fit.bic for fit in ranking), default=np.inf) + HOPELESS
        if all(_leaves_more(fitter, most) for fitter in axis):
            continue
        for fitter in axis:
            if fitter.suspect.at_least <= min((fit.bic for fit in ranking), default=np.inf) + HOPELESS:
                ranking += _fitted(fitter, penalty)
    ranking.sort(key=lambda fit: fit.bic)
    is_open = bool(ranking) and ranking[0].is_absorbing and not ranking[0].left.heals(case.monitor)
    if is_open and Swap.shape.family not in set(without):
        swaps = _swaps(case, suspects, ranking[0].bic + HOPELESS)
        ranking = sorted([*ranking, *swaps], key=lambda fit: fit.bic)
    return ranking


def hopeless(case: Case, ranking: Sequence[FittedHypothesis], suspects: Sequence[str]) -> set[str]:
    """Return the suspects that no more data will prove right; none, until a case is long enough to tell.

    Those of the best one's axis always may.
    """
    if not ranking or not case.is_telling:
        return set()
    best = ranking[0]
    near = {fit.channel for fit in ranking if fit.bic <= best.bic + HOPELESS}
    return {name for name in suspects if name not in near and name not in axis_of(best.channel)}


def _fitted(fitter: Fitter, penalty: float) -> Iterator[FittedHypothesis]:
    """Give the hypotheses on a suspect; `penalty` is what a fitted number costs."""
    suspect, case = fitter.suspect, fitter.suspect.case
    beside = suspect.elsewhere + case.objection(suspect.channel)
    estimator = None if suspect.bend is None else suspect.bend.estimator
    prices = {kind: 2.0 * cls.shape.price for kind, cls in loaded_faults().items() if cls.shape is not None}
    for fit in (*known(fitter), *unknown(fitter)):
        if suspect.channel in ATTITUDE and abs(fit.parameters.get("size", 0.0)) > _LARGEST_DEG:
            continue  # near the vertical an angle shows so little that any size of it explains anything
        bic = fit.left.deviance + beside + fit.free * penalty + prices.get(fit.kind, 0.0)
        if suspect.sick_elsewhere and fit.is_shown and fit.left.heals(case.monitor):
            bic -= suspect.sick_elsewhere
        yield FittedHypothesis(**vars(fit), channel=suspect.channel, bic=bic, estimator=estimator)


def _likely_first(fitters: Sequence[Fitter]) -> list[list[Fitter]]:
    """Return suspects axis by axis: first those whose readings look held or clipped, then whose own residual is worst.

    What the first leave rules out most of the others, before any of their shapes is filtered.
    """
    axes: dict[tuple[str, ...], list[Fitter]] = {}
    for fitter in fitters:
        axes.setdefault(axis_of(fitter.suspect.channel), []).append(fitter)

    def place(axis: tuple[str, ...]) -> tuple[bool, float, float]:
        beside = min(fitter.suspect.sick_elsewhere for fitter in axes[axis])
        energies = fitters[0].suspect.case.energies
        return (
            not any(fitter.is_traced for fitter in axes[axis]),
            beside,
            -max((energies[name] for name in axis if name in energies), default=0.0),
        )

    return [sorted(axes[axis], key=lambda fitter: not fitter.is_traced) for axis in sorted(axes, key=place)]


def _leaves_more(fitter: Fitter, most: float) -> bool:
    """Tell whether a suspect leaves more than so much with whatever simple shape and noise.

    Of one that holds or clips shapes don't tell.
    """
    elsewhere = fitter.suspect.elsewhere
    if fitter.is_traced or not np.isfinite(most):
        return False
    if elsewhere > most:
        return True
    if fitter.plain(*fitter.shapes).deviance + elsewhere <= most:
        return False
    return all(noise.left.deviance + elsewhere > most for noise in fitter.noises([tuple(fitter.shapes)])[0])


def _swaps(case: Case, suspects: Sequence[Suspect], most: float) -> Iterator[FittedHypothesis]:
    """Give the hypotheses that two sensors have changed places, each from both sides.

    Not those that leave more than so much of BIC in residuals that neither enters.
    """
    for one, other in combinations(suspects, 2):
        if any({one.channel, other.channel} <= set(group) for group in PEERS):
            entered = {*one.outputs, *other.outputs}
            if sum(case.energies[name] for name in case.residuals.raw if name not in entered) > most:
                continue
            left = _swapped_back(case, one.channel, other.channel)
            for channel, partner in ((one.channel, other.channel), (other.channel, one.channel)):
                yield FittedHypothesis(
                    kind=Swap.kind,
                    family=Swap.shape.family,
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
