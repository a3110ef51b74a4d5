"""From an alarm to judgements: which sensor, since when it could be said, what kind of fault, whether it ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.isolation.fits import (
    Case,
    FittedHypothesis,
    corrected,
    corrected_residuals,
    standard_errors,
    stretch_of,
    virtual_sensor,
)
from gtmbench.detectors.isolation.hypotheses import HYPOTHESES
from gtmbench.detectors.virtual import ANGLES, integrable

DECISIVE = 20.0  # of BIC: odds of e^10
_END = 20.0  # nats
_CLEAR_S = 1.0  # of healthy residuals, until a fault has ended
_PASSED_S = 15.0  # until an alarm that nothing explains has passed: a weak fault has yet to show what it is


def entered(bank: Bank, candidates: Sequence[str]) -> set[str]:
    """Return the residuals that a fault of any candidate enters.

    Where the attitude follows from the gyros, a fault of one enters them all.
    """
    if bank.attitude_from_gyros and candidates:
        return {spec.output for spec in bank.residuals}
    return {output for name in candidates for output in bank.affects(name)}


def suspects_of(bank: Bank, trusted: Sequence[str]) -> tuple[str, ...]:
    """Return the suspects whose residuals can all be trusted to tell of them: no earlier fault enters one."""
    return tuple(name for name in bank.suspects if set(bank.affects(name)) <= set(trusted))


def by_signature(bank: Bank, trusted: Sequence[str], output: str, time_s: float) -> Judgement:
    """Return what can be said with the alarm: the suspects whose faults enter the residual that rose."""
    able = tuple(name for name in suspects_of(bank, trusted) if output in bank.affects(name))
    able = able or tuple(name for name in bank.suspects if output in bank.affects(name))
    return Judgement(time_s=time_s, sensor=able[0] if len(able) == 1 else None, candidates=able)


def end_s(case: Case) -> float:
    """Return when the last sample of a case is there."""
    return round(float(case.record.time_s[case.stop - 1]), 9)


def judge(case: Case, ranking: list[FittedHypothesis], first: Judgement) -> Judgement:
    """Weigh the hypotheses: decided where one suspect's is decisively better than all others'.

    Of several that explain something, but not most of what is wrong, none is taken. Where the signature left one
    suspect only, hypotheses tell no more than the kind of its fault.
    """
    time_s = end_s(case)
    if first.sensor is not None:
        ranking = [fit for fit in ranking if fit.channel == first.sensor]
    healthy, _ = case.energy(dict(case.residuals.raw))
    good = [fit for fit in ranking if fit.bic < healthy - DECISIVE]
    if not good:
        return replace(first, time_s=time_s, candidates=_unexplained(case, first))
    best, untestable = good[0], _untestable(case)
    explains = _explains(case, best)
    order = tuple(dict.fromkeys(fit.channel for fit in good if not explains or fit.bic < best.bic + DECISIVE))
    alone = order == (best.channel,) and not untestable
    sensor = first.sensor or (best.channel if alone else None)
    others = [fit.bic for fit in ranking if fit.channel == best.channel and fit.kind != best.kind]
    return Judgement(
        time_s=time_s,
        sensor=sensor,
        candidates=(sensor,) if sensor else (*order, *(name for name in untestable if name not in order)),
        kind=best.kind if explains else None,
        parameters=best.parameters if explains else {},
        errors=standard_errors(case, best) if explains else {},
        kind_margin=min(others, default=float("inf")) - best.bic if explains else 0.0,
    )


def _unexplained(case: Case, first: Judgement) -> tuple[str, ...]:
    """Return whom an alarm leaves under suspicion that no fault explains: none, if residuals are healthy by now."""
    if first.sensor is not None or (case.stop - case.sure) * case.record.sample_period_s < _PASSED_S:
        return first.candidates
    return tuple(_untestable(case)) if _excess(case, list(case.residuals.raw)) > 0.0 else ()


def _untestable(case: Case) -> list[str]:
    """Return the suspects that nothing predicts and nothing clears: the residuals they don't enter are healthy."""
    bank, untestable = case.monitor.bank, []
    for name in suspects_of(bank, tuple(case.residuals.raw)):
        if name not in case.residuals.raw and not integrable(name, bank.channels):
            spared = [output for output in case.residuals.raw if output not in bank.affects(name)]
            if not spared or _excess(case, spared) <= 0.0:
                untestable.append(name)
    return untestable


def _excess(case: Case, outputs: list[str]) -> float:
    """Return what residuals have over their healthy energy and six deviations of it."""
    energy, count = case.energy({name: case.residuals.raw[name] for name in outputs})
    return float(energy - count - 6.0 * np.sqrt(2.0 * max(count, 1)))


def _explains(case: Case, best: FittedHypothesis) -> bool:
    """Tell whether the best hypothesis leaves its residuals healthy, or takes most of what was wrong with them."""
    own = list(case.monitor.bank.affects(best.channel))
    energy, count = case.energy({name: case.residuals.raw[name] for name in own})
    over = (best.left - 1.0) * count
    return bool(over <= max(0.5 * (energy - count), 6.0 * np.sqrt(2.0 * max(count, 1))))


def ended_s(case: Case, best: FittedHypothesis, rival: float) -> float | None:
    """Return when a fault had gone, if it has: what came since is healthy, and the fault would have shown.

    Since then the residuals as they are must look healthy, and explain the record decisively better than with the
    fault undone to the end, and than `rival`, the BIC of the best fault that lasts: a saturation that isn't reached
    ends nothing. For gyros only: where an angle should be, the gyros can't say for long.
    """
    virtual = virtual_sensor(case, best.channel)
    if virtual is None or best.channel in ANGLES:
        return None
    reads = HYPOTHESES[best.kind].reads(stretch_of(case, best.channel, virtual), best.parameters)
    undone = corrected_residuals(case, best.channel, corrected(case, best.channel, virtual, reads))
    gain = np.zeros(case.stop - case.sure)  # of leaving the record as it is, in nats
    over = np.zeros(len(gain))  # what the residuals as they are have over what is tolerated
    for output, values in undone.items():
        as_is, better = (case.squares(output, of) for of in (case.residuals.raw[output], values))
        gain[: len(better)] += 0.5 * np.nan_to_num(better - as_is)
        over[: len(as_is)] += np.nan_to_num(as_is - case.monitor.tolerances[output].high)
    ended = int(np.argmax(np.cumsum(gain[::-1])[::-1]))  # since then, leaving it gains most
    clear = ended + 1 + max(case.monitor.whiteners[output].order for output in undone)  # whitening remembers the fault
    since = len(gain) - clear
    if since * case.record.sample_period_s < _CLEAR_S:
        return None
    cost = (len(best.parameters) + 1) * np.log(max(len(gain), 2))
    lasting = case.energy(dict(case.residuals.raw))[0] + 2.0 * float(gain[:ended].sum()) + cost
    healthy = over[clear:].sum() <= 6.0 * np.sqrt(2.0 * since * len(undone))
    if not healthy or gain[ended:].sum() < _END or lasting > rival - DECISIVE:
        return None
    return round(float(case.record.time_s[case.sure + ended]), 9)
