"""From an alarm to a finding: which sensor, since when it could be said, what kind of fault, whether it ended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.bank.explain import (
    Case,
    Explanation,
    corrected,
    corrected_residuals,
    explanations,
    open_case,
    standard_errors,
    stretch_of,
    virtual_sensor,
    within_reach,
)
from gtmbench.detectors.bank.kinds import KINDS
from gtmbench.detectors.bank.levels import Crossing
from gtmbench.detectors.virtual import ANGLES, integrable
from gtmbench.record import Record

HORIZONS_S = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)  # after the alarm: when the case is looked at anew
_DECISIVE = 20.0  # of BIC: odds of e^10
_END = 20.0  # nats
_LOOK_S = 20.0
_CLEAR_S = 1.0  # of healthy residuals, until a fault has ended
_PASSED_S = 15.0  # until an alarm that nothing explains has passed: a weak fault has yet to show what it is


def diagnose(monitor: CalibratedBank, record: Record, residuals: BankResiduals, crossing: Crossing) -> Alarm:
    """Judge an alarm at growing horizons, as far as the record goes.

    Parameters
    ----------
    monitor : CalibratedBank
    record : Record
    residuals : BankResiduals
        Of the record; missing values where a residual is no longer watched.
    crossing : Crossing
        The alarm.
    """
    known_row = round((crossing.time_s - record.start_s) / record.sample_period_s)
    stops = [known_row + 1 + round(horizon_s / record.sample_period_s) for horizon_s in HORIZONS_S]
    judgements = [_by_signature(monitor, residuals, crossing)]
    suspects = _suspects(monitor, residuals)
    held: Explanation | None = None  # the last that was decisive
    ended_s = resumed_s = None
    for stop in [*stops, *_later(stops[-1], record)]:
        rows = {"onset_row": crossing.onset_row, "sure_row": known_row + 2, "stop_row": min(stop, len(record))}
        case = open_case(monitor, record, residuals, **rows)
        if case.stop - case.sure < 10:  # too few rows yet
            continue
        ranking = explanations(case, suspects) if stop <= stops[-1] else []
        if held is not None:
            ended_s = _ended_s(case, held, ranking[0].score if ranking else float("inf"))
            if ended_s is not None:
                resumed_s = _end_s(case)
                break
        if ranking:
            suspects = within_reach(ranking)
            judgements.append(_judge(case, ranking, judgements[0]))
            if judgements[-1].sensor is not None and judgements[-1].kind_margin > _DECISIVE:
                held = next(one for one in ranking if one.channel == judgements[-1].sensor)
        if stop >= len(record):
            break
    return Alarm(
        number=0,
        time_s=crossing.time_s,
        onset_s=float(record.time_s[crossing.onset_row]),
        source=crossing.output,
        test=crossing.series,
        judgements=tuple(judgements),
        ended_s=ended_s,
        end_known_s=resumed_s,
    )


def _later(last: int, record: Record) -> list[int]:
    """Return rows after the last horizon: there a fault's end is looked for, nothing else."""
    step = round(_LOOK_S / record.sample_period_s)
    return list(range(last + step, len(record) + step, step))


def _end_s(case: Case) -> float:
    """Return when the last sample of a case is there."""
    return round(float(case.record.time_s[case.stop - 1]), 9)


def _suspects(monitor: CalibratedBank, residuals: BankResiduals) -> tuple[str, ...]:
    """Return the suspects whose residuals are all still watched."""
    return tuple(name for name in monitor.bank.suspects if set(monitor.bank.disturbs(name)) <= set(residuals.raw))


def _judge(case: Case, ranking: list[Explanation], first: Judgement) -> Judgement:
    """Weigh the explanations: decided where one suspect's is decisively better than all others'.

    Of several that explain something, but not most of what is wrong, none is taken. Where the signature left one
    suspect only, explanations tell no more than the kind of its fault.
    """
    time_s = _end_s(case)
    if first.sensor is not None:
        ranking = [one for one in ranking if one.channel == first.sensor]
    healthy, _ = case.energy(dict(case.residuals.raw))
    good = [one for one in ranking if one.score < healthy - _DECISIVE]
    if not good:
        return replace(_undecided(time_s, _unexplained(case, first)), sensor=first.sensor)
    best, untestable = good[0], _untestable(case)
    explained = _explained(case, best)
    order = tuple(dict.fromkeys(one.channel for one in good if not explained or one.score < best.score + _DECISIVE))
    alone = order == (best.channel,) and not untestable
    sensor = first.sensor or (best.channel if alone else None)
    kinds = [one.score for one in ranking if one.channel == best.channel and one.kind != best.kind]
    return Judgement(
        time_s=time_s,
        sensor=sensor,
        candidates=(sensor,) if sensor else (*order, *(name for name in untestable if name not in order)),
        kind=best.kind if explained else None,
        parameters=best.parameters if explained else {},
        errors=standard_errors(case, best) if explained else {},
        kind_margin=min(kinds, default=float("inf")) - best.score if explained else 0.0,
    )


def _unexplained(case: Case, first: Judgement) -> tuple[str, ...]:
    """Return whom an alarm leaves under suspicion that no fault explains: none, if residuals are healthy by now."""
    if first.sensor is not None or (case.stop - case.sure) * case.record.sample_period_s < _PASSED_S:
        return first.candidates
    return tuple(_untestable(case)) if _excess(case, list(case.residuals.raw)) > 0.0 else ()


def _undecided(time_s: float, candidates: tuple[str, ...]) -> Judgement:
    return Judgement(
        time_s=time_s, sensor=None, candidates=candidates, kind=None, parameters={}, errors={}, kind_margin=0.0
    )


def _by_signature(monitor: CalibratedBank, residuals: BankResiduals, crossing: Crossing) -> Judgement:
    """Return what can be said with the alarm: the suspects whose faults enter the residual that rose."""
    able = [name for name in _suspects(monitor, residuals) if crossing.output in monitor.bank.disturbs(name)]
    alone = able[0] if len(able) == 1 else None
    return replace(_undecided(crossing.time_s, tuple(able)), sensor=alone)


def _untestable(case: Case) -> list[str]:
    """Return the suspects that nothing predicts and nothing clears: the residuals they don't enter are healthy."""
    bank, found = case.monitor.bank, []
    for name in _suspects(case.monitor, case.residuals):
        if name not in case.residuals.raw and not integrable(name, bank.channels):
            spared = [output for output in case.residuals.raw if output not in bank.disturbs(name)]
            if not spared or _excess(case, spared) <= 0.0:
                found.append(name)
    return found


def _excess(case: Case, outputs: list[str]) -> float:
    """Return what residuals have over their healthy energy and six deviations of it."""
    energy, count = case.energy({name: case.residuals.raw[name] for name in outputs})
    return float(energy - count - 6.0 * np.sqrt(2.0 * max(count, 1)))


def _explained(case: Case, best: Explanation) -> bool:
    """Tell whether the best explanation leaves its residuals healthy, or takes most of what was wrong with them."""
    own = list(case.monitor.bank.disturbs(best.channel))
    energy, count = case.energy({name: case.residuals.raw[name] for name in own})
    over = (best.left - 1.0) * count
    return bool(over <= max(0.5 * (energy - count), 6.0 * np.sqrt(2.0 * max(count, 1))))


def _ended_s(case: Case, best: Explanation, rival: float) -> float | None:
    """Return when a fault had gone, if it has: what came since is healthy, and the fault would have shown.

    Since then the residuals as they are must look healthy, and explain the record decisively better than with the
    fault undone to the end, and than `rival`, the BIC of the best fault that lasts: a saturation that isn't reached
    ends nothing. For gyros only: where an angle should be, the gyros can't say for long.
    """
    virtual = virtual_sensor(case, best.channel)
    if virtual is None or best.channel in ANGLES:
        return None
    reads = KINDS[best.kind].reads(stretch_of(case, best.channel, virtual), best.parameters)
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
    if not healthy or gain[ended:].sum() < _END or lasting > rival - _DECISIVE:
        return None
    return round(float(case.record.time_s[case.sure + ended]), 9)
