"""Another noise: sensors that became louder or quieter, which by itself is no fault of any.

A residual's tests hold for the noise that was learnt before the alarm. Where another level of it, each residual's own,
explains the case as well as any fault does, nothing says that a sensor failed. What passes three times the learnt level
is a fault, and so is silence: a sensor that is stuck.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import NOISE_CHANGED, TIMES_LOUDER, Judgement
from gtmbench.detectors.bank.calibrated import MOST
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.fits import FittedHypothesis
from gtmbench.detectors.statistics.learnt_noise import BLOCK_S
from gtmbench.faults.kinds.additive import Noise
from gtmbench.faults.registry import how_of, passes_for
from gtmbench.values.record import FloatArray

NOISE_WANDERS = "the noise wanders"
_WANDERS = 0.15  # sigma^2 of the noise, beyond which names stand on what is left by `_wandering`
_PLAIN = 60.0  # of BIC: what a fault explains of noise that wanders
_LEAST = 1e-6  # of the power: silence has none


def changed_noise(case: Case, ranking: Sequence[FittedHypothesis], told: Judgement, decisive: float) -> Judgement:
    """Return what is told of an alarm, or that the noise changed, where no fault explains it decisively better.

    `ranking`: the best first. `decisive`: of BIC.
    """
    if not told.candidates or not ranking or _is_rounded(case, told):
        return told
    best = ranking[0]
    is_noise = _explains_as_well(ranking, best, told, decisive)
    if not is_noise and best.bic < _bic(case) + decisive:
        return told
    channels = (best.channel,) if is_noise else tuple(dict.fromkeys([*told.candidates, *case.residuals.raw]))
    concerned = [power for name in channels for power in (_power(case, name), _grown(case, name)) if power]
    if not concerned or max(concerned) > TIMES_LOUDER**2:
        return told
    times = float(np.sqrt(max(concerned) if max(concerned) > 1.0 else min(concerned)))
    return replace(
        told,
        sensor=None,
        partner=None,
        kind=Noise.kind,
        parameters={"times": times},
        intervals={},
        reason=f"it is {times:.2g} times what was learnt",
        doubt=NOISE_CHANGED,
    )


def _is_rounded(case: Case, told: Judgement) -> bool:
    """Tell whether a sensor reads multiples of a quantum that read none before: no noise does that."""
    habit = case.habits.get(str(told.sensor))
    return how_of(told.kind) == "rounded" and habit is not None and not habit.is_counted


def _explains_as_well(
    ranking: Sequence[FittedHypothesis], best: FittedHypothesis, told: Judgement, decisive: float
) -> bool:
    """Tell whether noise of the likeliest sensor explains as much as the kind of fault that is told of it.

    A kind is told, too, where it only explains nearly all.
    """
    noise, kind = (
        min((fit.bic for fit in ranking if (fit.channel, fit.kind) == (best.channel, meant)), default=np.inf)
        for meant in (Noise.kind, told.kind)
    )
    return told.kind is not None and noise <= kind and noise < best.bic + decisive


def wandering_noise(case: Case, ranking: Sequence[FittedHypothesis], told: Judgement, decisive: float) -> Judgement:
    """Return what is told of an alarm, without a name where noise that wanders may be what is there.

    Which of two sensors' faults explains more must not hang on a level of noise that has changed meanwhile: what is
    told has to be decisively better by `_wandering`, too. An either-or is weighed likewise, both against the others.
    """
    whiteners, outputs = case.monitor.whiteners, tuple(case.residuals.raw)
    unsteady = max((whiteners[output].unsteady for output in outputs), default=0.0)
    accused = (told.sensor,) if told.sensor else told.candidates
    if told.doubt or told.kind is None or unsteady <= _WANDERS:
        return told
    doubted = replace(told, sensor=None, partner=None, doubt=NOISE_WANDERS)
    if how_of(told.kind) in ("white", "walk") or passes_for(told.kind, "motion"):
        return replace(doubted, reason=f"a fault of {' or '.join(accused)} explains it")
    as_is = {output: _wandering(case, output, case.white[output][case.judged]) for output in outputs}
    left = {fit: _left(case, fit, as_is) for fit in ranking}
    best = min((left[fit] for fit in ranking if fit.channel in accused), default=np.inf)
    near = {fit.channel for fit in ranking if fit.channel not in accused and left[fit] <= best + decisive}
    if not near and best + _PLAIN < sum(as_is.values()):
        return told
    order = tuple(dict.fromkeys([*accused, *(fit.channel for fit in ranking if fit.channel in near)]))
    return replace(doubted, candidates=order, reason=f"a fault of {' or '.join(order)} explains it")


def _left(case: Case, fit: FittedHypothesis, as_is: Mapping[str, float]) -> float:
    """Return the BIC of what a fault leaves in the residuals, by noise that wanders; `as_is` of those it doesn't enter.

    Noise that belongs to a fault is left: it may be what wanders.
    """
    entered = zip(fit.left.outputs, fit.left.white, strict=True)
    own = {output: _wandering(case, output, white) for output, white in entered if output in as_is}
    return sum({**as_is, **own}.values()) + fit.free * float(np.log(max(case.count, 2)))


def _wandering(case: Case, output: str, white: FloatArray) -> float:
    """Return -2 log likelihood of a residual whose noise has a level of its own in every block.

    Student's, nu = 2 / sigma^2: of L samples with the sum of squares s it is L + (nu + L) log((nu + s) / (nu + L)),
    which is s where noise is steady (sigma^2 = 0).
    """
    squares = np.square(_clipped(white))
    if not len(squares):
        return 0.0
    rows = max(round(BLOCK_S / case.period_s), 1)
    firsts = np.arange(0, max(len(squares) - rows, 0) + 1, rows)  # the last one takes what is over
    counts = np.diff(firsts, append=len(squares))
    freedom = 2.0 / max(case.monitor.whiteners[output].unsteady, 1e-9) + counts
    return float(np.sum(counts + freedom * np.log1p((np.add.reduceat(squares, firsts) - counts) / freedom)))


def _judged(case: Case, output: str) -> FloatArray:
    return _clipped(case.white[output][case.judged])


def _clipped(values: FloatArray) -> FloatArray:
    return np.clip(values[np.isfinite(values)], -MOST, MOST)


def _power(case: Case, output: str) -> float | None:
    """Return a residual's power over the rows judged, 1 by what was learnt; None where there is none."""
    values = _judged(case, output) if output in case.residuals.raw else np.zeros(0)
    return max(float(np.mean(np.square(values))), _LEAST) if len(values) else None


def _grown(case: Case, channel: str) -> float | None:
    """Return the power of a sensor's own innovations over the rows judged, 1 before the alarm; None if not known."""
    habit = case.habits.get(channel)
    if habit is None:
        return None
    values = _clipped(habit.innovations(case.record[channel])[case.judged])
    return max(float(np.mean(np.square(values))), _LEAST) if len(values) else None


def _bic(case: Case) -> float:
    """Return -2 log likelihood of the case by a level of noise for each residual, and what that many cost.

    Sensors' own innovations have one where they are louder; how quiet they are depends on motion.
    """
    total, count, levels = sum(case.surprises.values()), 2, 0
    for output, energy in case.energies.items():
        values = _judged(case, output)
        power = max(float(np.mean(np.square(values))), _LEAST) if len(values) else 1.0
        count += len(values)
        if output in case.residuals.raw or power > 1.0:
            total += len(values) * (1.0 + float(np.log(power)))
            levels += 1
        else:
            total += energy
    return total + levels * float(np.log(count))
