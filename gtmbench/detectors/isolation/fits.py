"""Which hypotheses explain a case best: every suspect's, ranked by the BIC."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.driving import likely_suspects_in
from gtmbench.detectors.isolation.fitter import PEERS, Fit, Fitter
from gtmbench.detectors.isolation.hypotheses import known, unknown
from gtmbench.detectors.isolation.suspect import Left, Suspect
from gtmbench.faults.kinds.replacing import Swap
from gtmbench.faults.registry import loaded_faults
from gtmbench.values.attitude_estimators import AttitudeEstimator
from gtmbench.values.channels import ATTITUDE, axis_of

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
