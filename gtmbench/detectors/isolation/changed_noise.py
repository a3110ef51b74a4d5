"""Another noise: sensors that became louder or quieter, which by itself is no fault of any.

A residual's tests hold for the noise that was learnt before the alarm. Where another level of it, each residual's own,
explains the case as well as any fault does, nothing says that a sensor failed. What passes three times the learnt level
is a fault, and so is silence: a sensor that is stuck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.fits import FittedHypothesis
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.isolation.health import MOST
from gtmbench.record import FloatArray

NOISE_CHANGED, NOISE_WANDERS = "the noise changed", "the noise wanders"
_WANDERS = 0.15  # sigma^2 of the noise, beyond which nobody is named
_NOISY = ("noise", "random_walk", "oscillation")  # kinds that vibration passes for, however loud it gets
_CLEARLY = 0.05  # of what a fault explains, that no other sensor's does, where noise wanders
_LOUD = 3.0  # times the level that was learnt: a fault
_LEAST = 1e-6  # of the power: silence has none


def changed_noise(case: Case, ranking: Sequence[FittedHypothesis], told: Judgement, decisive: float) -> Judgement:
    """Return what is told of an alarm, or that the noise changed, where no fault explains it decisively better.

    Parameters
    ----------
    case : Case
    ranking : sequence of FittedHypothesis
        The best first.
    told : Judgement
    decisive : float
        Of BIC.
    """
    if not told.candidates or not ranking:
        return told
    best = ranking[0]
    is_noise = best.kind == "noise" and told.kind == "noise"
    if not is_noise and best.bic < _bic(case) + decisive:
        return told
    channels = (best.channel,) if is_noise else tuple(dict.fromkeys([*told.candidates, *case.residuals.raw]))
    concerned = [power for name in channels for power in (_power(case, name), _grown(case, name)) if power]
    if not concerned or max(concerned) > _LOUD**2:
        return told
    times = float(np.sqrt(max(concerned) if max(concerned) > 1.0 else min(concerned)))
    return replace(
        told,
        sensor=None,
        partner=None,
        kind="noise",
        parameters={"times": times},
        errors={},
        reason=f"it is {times:.2g} times what was learnt",
        doubt=NOISE_CHANGED,
    )


def wandering_noise(case: Case, ranking: Sequence[FittedHypothesis], told: Judgement) -> Judgement:
    """Return what is told of an alarm, without a name where noise that wanders may be what is there.

    Of sensors whose faults explain nearly as much, such noise decides which one does it better. An either-or is weighed
    likewise, both against the others.
    """
    whiteners, outputs = case.monitor.whiteners, tuple(case.residuals.raw)
    unsteady = max((whiteners[output].unsteady for output in outputs), default=0.0)
    accused = (told.sensor,) if told.sensor else told.candidates
    if told.doubt or told.kind is None or unsteady <= _WANDERS:
        return told
    loudest = max((_power(case, output) or 0.0 for output in outputs), default=0.0)
    best = min((fit.bic for fit in ranking if fit.channel in accused), default=case.deviance)
    others = [fit for fit in ranking if fit.channel not in accused and fit.kind != UNKNOWN]
    is_clear = all(fit.bic - best > _clearly(fit.kind) * (case.deviance - best) for fit in others)
    if told.kind not in _NOISY and loudest > _LOUD**2 and is_clear:
        return told
    reason = f"a fault of {' or '.join(accused)} explains it"
    return replace(told, sensor=None, partner=None, reason=reason, doubt=NOISE_WANDERS)


def _clearly(kind: str) -> float:
    """Return the share of what a fault explains that another sensor's, of a kind, must leave, so that it isn't meant.

    What noise passes for fits anything a little.
    """
    return 0.4 * _CLEARLY if kind in _NOISY else _CLEARLY


def _judged(case: Case, output: str) -> FloatArray:
    return _told(case.white[output][case.judged])


def _told(values: FloatArray) -> FloatArray:
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
    values = _told(habit.innovations(case.record[channel])[case.judged])
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
