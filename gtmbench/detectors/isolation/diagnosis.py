"""From an alarm to judgements: which sensor, since when it could be said, what kind of fault, whether it ended.

What may be said, of every bank:

- A sensor is named where one suspect's hypotheses are decisively better than those of all others, its fault enters the
  residual that alarmed, and no residual that it doesn't enter is left that another sensor of its axis would heal; in
  the first seconds only where its own readings show the fault, or its correction makes the residuals healthy by the
  monitor's own calibrated test.
- A kind is named where its correction leaves the suspect's own residuals healthy, or nothing that belongs to no kind
  explains them decisively better; otherwise the kind is `unknown`.
- Else it is either-or, with the reason. Physically equal faults (`SAME`) are either-or, too.
- Noise of another level, up to three times the one learnt, is no fault: `changed_noise`.
- Nothing is left to explain only where the residuals are healthy and no step of an angle would have made them so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.calibrated import MOST, CalibratedBank, energy, greatest
from gtmbench.detectors.isolation.case import Case, own
from gtmbench.detectors.isolation.changed_noise import changed_noise, wandering_noise
from gtmbench.detectors.isolation.fits import (
    FittedHypothesis,
    interval,
    intervals_of,
    likely_suspects_in,
    suspect_through,
    suspects_in,
)
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.isolation.own_noise import ALIKE
from gtmbench.detectors.isolation.referee import Excess, whose_excess
from gtmbench.detectors.isolation.suspect import Left, Suspect
from gtmbench.detectors.isolation.transients import transients
from gtmbench.detectors.virtual import ANGLES, integrable
from gtmbench.faults.kinds.additive import Bias
from gtmbench.faults.kinds.shaping import ScaleFactor
from gtmbench.faults.registry import FAULTS, how_of, passes_for
from gtmbench.faults.shape import SHOWN
from gtmbench.values.attitude_estimators import AttitudeEstimator
from gtmbench.values.channels import GYROS, axis_of
from gtmbench.values.record import FloatArray

DECISIVE = 20.0  # of BIC: odds of e^10
_NEARLY, _MOSTLY = 0.97, 0.9  # of what is wrong
_ALIKE = 200.0  # between faults that are physically the same
_EARLY, _EARLY_ROW = 33.0, 1.2  # of BIC, between sensors of an axis in the first seconds; and a row judged
_OTHER_AXES = 6.0  # of -2 log likelihood: of a gyro's wrong gain, against its angle's
_VAGUE, _FREELY = 0.015, 700.0  # of what is explained; of -2 log likelihood: a predicted reading has noise of its own
_PLAIN = 60.0  # of BIC: what residuals hide that are healthy by test; what plainly stands still
_QUIET = 0.5  # of the thresholds: what has passed leaves no more
_PASSED_S = 15.0  # until an alarm that nothing explains has passed: a weak fault has yet to show what it is

# of a cautious monitor's alarm:
_EXPLAINED = 60.0  # of BIC, what a fault has to explain of it
_LASTING_S, _SHOWN_S = 8.0, 4.0  # of the case, until a sensor is named; whose readings show it
_LEFT, _MOST_LEFT = 0.1, 2.0  # of what was wrong; of the thresholds
_LEFT_OF_BENT = 0.05  # of what was wrong, where the attitude bends with the sensor: it bends far
_EVEN = 0.25  # of the mean power, in every quarter of noise that came to stay
_ESTIMATED_S = 18.0  # of the case, until an angle is that its readings don't show: estimators wander
_DEAD = 0.1  # the factor of a gyro that reads nothing of a turn: one that is dead is stuck, or an estimator turned
_SHARED = 0.25  # of the rise of its noise, that other residuals may have: more is vibration
_FARTHEST_DEG = 45.0  # that a gyro may have bent the attitude
_OF_ESTIMATES = (*SHOWN, "white", "spikes")  # what an estimator's angle has
ESTIMATED = "an estimator that the gyros drive has no such fault of its own"
EARLY = "too early to tell"
DOUBT = "motion or model"

# faults of a gyro, and of the angle about the same axis, that look the same near wings level
SAME = frozenset((kind, angle) for kind, cls in FAULTS.items() if cls.shape for angle in cls.shape.of_angle)
_RATES = frozenset(angle for gyro, angle in SAME if gyro == Bias.kind)  # of an angle: what a bias of its gyro is
# and whose noise alone tells them apart, which counts hide; an estimator's angle has no such fault
_SAME_IN_COUNTS = frozenset({(ScaleFactor.kind, ScaleFactor.kind)})


def entered(bank: Bank, candidates: Sequence[str]) -> set[str]:
    """Return the residuals that a fault of any candidate enters.

    Where the attitude follows from the gyros, a fault of one enters them all.
    """
    if bank.attitude_from_gyros and candidates:
        return {spec.output for spec in bank.diagnostic}
    return {output for name in candidates for output in bank.affects(name)}


def suspects_of(bank: Bank, trusted: Sequence[str]) -> tuple[str, ...]:
    """Return the suspects that a residual tells of which no earlier fault enters: by those they are judged."""
    return tuple(name for name in bank.suspects if set(bank.affects(name)) & set(trusted))


def by_signature(monitor: CalibratedBank, trusted: Sequence[str], output: str, time_s: float) -> Judgement:
    """Return what can be said with the alarm: the suspects whose faults enter the residual that rose.

    A cautious monitor's alarm alone says nothing of a fault.
    """
    bank = monitor.bank
    able = tuple(name for name in suspects_of(bank, trusted) if output in bank.affects(name))
    if monitor.is_cautious:
        return Judgement(time_s=time_s, sensor=None, candidates=able, reason=EARLY, doubt=DOUBT)
    return Judgement(time_s=time_s, sensor=able[0] if len(able) == 1 else None, candidates=able)


def judge(case: Case, ranking: list[FittedHypothesis], first: Judgement) -> Judgement:
    """Weigh the hypotheses on a case, those of a cautious monitor as `_cautious` says."""
    told = _weighed(case, ranking, replace(first, reason="", doubt=""))
    if case.monitor.is_cautious:
        told = _cautious(case, ranking, told)
    if told.sensor in ANGLES and case.driving and how_of(told.kind) not in _OF_ESTIMATES:
        told = replace(told, sensor=None, partner=None, candidates=first.candidates, reason=ESTIMATED)
    return wandering_noise(case, ranking, changed_noise(case, ranking, told, DECISIVE), DECISIVE)


def _cautious(case: Case, ranking: Sequence[FittedHypothesis], told: Judgement) -> Judgement:
    """Say of an alarm of a monitor that stands on little flight only what must be a fault; all else is doubted.

    Motion that it doesn't know and its model's error raise alarms, too, and a sensor that reads anything explains
    those as well as a fault. A kind doesn't: it has to explain what is wrong, decisively and to the end of the case.
    """
    if not told.candidates:
        return told
    # noise heals no residual: it has to be what explains best
    weighed = [fit for fit in ranking if fit.how != "white" or fit.bic < ranking[0].bic + _EXPLAINED]
    explained = [fit for fit in weighed if fit.bic < case.deviance - _EXPLAINED and _must_be(case, fit)]
    if not explained:
        likeliest = ranking[0].channel if ranking else told.candidates[0]
        reason = told.reason or f"no kind of fault of {likeliest} explains it"
        return replace(told, sensor=None, partner=None, reason=reason, doubt=DOUBT)
    best, untestable = explained[0], _untestable(case)
    rivals = (*_rivals(case, explained), *_better(ranking, best), *_of_other_gain(case, best))
    order = tuple(dict.fromkeys([*rivals, *untestable]))
    if best.channel in ANGLES and best.kind in _RATES:
        order = tuple(dict.fromkeys([*order, *_axis(case, best.channel)]))
    least_s = _ESTIMATED_S if best.channel in ANGLES else _SHOWN_S if best.is_shown else _LASTING_S
    if not best.is_held and (case.judged.stop - case.judged.start) * case.period_s < least_s:
        return replace(told, sensor=None, candidates=order, partner=None, reason=EARLY, doubt=DOUBT)
    sensor = best.channel if set(order) == {best.channel} else None
    return replace(
        told,
        sensor=sensor,
        candidates=_named(best, sensor) if sensor else order,
        kind=best.kind,
        parameters=dict(best.parameters),
        intervals=intervals_of(best),
        partner=best.partner,
        reason="" if sensor else _reason(best, rivals, untestable, ()),
    )


def _better(ranking: Sequence[FittedHypothesis], best: FittedHypothesis) -> tuple[str, ...]:
    """Return the other sensors of which a kind of fault explains decisively more, though it isn't sure to be one."""
    definite = (fit for fit in ranking if fit.kind != UNKNOWN and fit.how not in ("walk", "white"))
    better = (fit.channel for fit in definite if fit.bic < best.bic - DECISIVE)
    return tuple(dict.fromkeys(name for name in better if name != best.channel))


def looks_like_motion(judged: Judgement) -> bool:
    """Tell whether what is told is of no definite kind, or of one that a model's error in motion looks like."""
    how = how_of(judged.kind)
    return judged.kind is None or how in ("", "walk", "white", "spikes") or passes_for(judged.kind, "motion")


def _must_be(case: Case, fit: FittedHypothesis) -> bool:
    """Tell whether a kind of fault explains what is wrong, and no motion or model's error would look like it."""
    if fit.kind == UNKNOWN or fit.how == "walk" or passes_for(fit.kind, "motion"):
        return False
    if fit.channel in ANGLES and passes_for(fit.kind, "estimator"):
        return False
    if fit.how == "gain" and abs(fit.parameters["factor"]) < _DEAD:
        return False
    if passes_for(fit.kind, "excitation") and not set(axis_of(fit.channel)) & set(case.monitor.bank.kinematic):
        return False
    # all residuals that are sick are explained, one of its own axis among them, and nothing else is sick
    worst = max(case.sickness.values())
    sick = {output for output, far in case.sickness.items() if far > max(1.0, _LEFT * worst)}
    sick = (sick - case.others) | case.together
    if not sick <= set(fit.left.outputs) or not sick & set(axis_of(fit.channel)):
        return False
    least = 1.0 if fit.how == "white" else _QUIET
    if all(case.sickness.get(output, 0.0) <= least for output in axis_of(fit.channel)):
        return False
    if fit.how == "spikes" and not _rose_alone(case, fit.channel):
        return False
    if fit.how == "white":
        return _is_steady(case, fit.channel)
    return all(_is_healed(case, fit, output) for output in case.sickness if output in fit.left.outputs)


def _is_healed(case: Case, fit: FittedHypothesis, output: str) -> bool:
    """Tell whether a residual is healthy once a fault is undone, or nearly all that was wrong with it has gone."""
    white = fit.left.white[fit.left.outputs.index(output)]
    most = min(_LEFT * case.sickness[output], _MOST_LEFT)
    if fit.channel in case.driving:
        most = max(most, _LEFT_OF_BENT * max(case.sickness.values()))
    most = max(1.0, most)
    return greatest(case.monitor, output, white, is_corrected=True, enough=most) <= most


def _is_steady(case: Case, channel: str) -> bool:
    """Tell whether a sensor's residual alone is stronger than it was, all through the case: noise that came to stay."""
    if not _rose_alone(case, channel):
        return False
    squares = _squares(case, channel)
    quarters = [float(np.nanmean(part)) for part in np.array_split(squares, 4) if np.isfinite(part).any()]
    return len(quarters) > 2 and min(quarters) > _EVEN * float(np.nanmean(squares))


def _rose_alone(case: Case, channel: str) -> bool:
    """Tell whether a sensor's residual is stronger than it was, and others aren't: what shakes all is vibration."""
    if channel not in case.residuals.raw:
        return False
    squares = {output: _squares(case, output) for output in case.residuals.raw}
    power = {output: float(np.nanmean(of)) if np.isfinite(of).any() else 0.0 for output, of in squares.items()}
    shared = max((of for output, of in power.items() if output not in (channel, *case.others)), default=0.0)
    return power[channel] > case.monitor.tolerances[channel].high and shared < 1.0 + _SHARED * (power[channel] - 1.0)


def _squares(case: Case, output: str) -> FloatArray:
    return np.square(np.clip(case.white[output][case.judged], -MOST, MOST))


def _weighed(case: Case, ranking: list[FittedHypothesis], first: Judgement) -> Judgement:
    """Weigh the hypotheses on a case.

    Where the signature left one suspect only, hypotheses tell no more than the kind of its fault.
    """
    if first.sensor is not None:
        ranking = [fit for fit in ranking if fit.channel == first.sensor]
    healthy, worst = case.deviance, max(case.sickness.values())
    # explanations that are decisively better than none; of what alarms no more, plainly so
    good = [fit for fit in ranking if fit.bic < healthy - DECISIVE and fit.channel in first.candidates]
    if first.sensor is None and worst <= 1.0:
        step = None if _is_anothers(case, ranking, first) else _stepped(case, first)
        if step is not None:
            return step
        good = [fit for fit in good if good[0].bic < healthy - _PLAIN]
    if not good:
        return _unexplained(case, first)
    best = good[0]
    # who else may it be? A second fault (strays), one that absorbs anything (excess), one that is as likely (rivals),
    # or has more freedom; and whose readings hold what they differ by
    strays = [] if first.sensor is not None else _strays(case, best)
    excess = whose_excess(case, best.channel) if best.is_absorbing and first.sensor is None else None
    order = (*_rivals(case, good, excess), *_freer(case, best), *_of_other_gain(case, best))
    holder = _holder(case, good, strays, excess)
    if holder is not None:
        is_near = holder.channel in order or strays
        order = (holder.channel, *(name for name in order if not is_near or name not in axis_of(holder.channel)))
        best, strays = holder, []
    # a name needs all others ruled out, and enough to tell
    untestable = _untestable(case)
    pair = {best.channel, best.partner} if best.how == "swapped" else {best.channel}
    alone = set(order) <= pair and not untestable
    is_early = not (case.is_telling or best.is_shown or best.left.heals(case.monitor))
    sensor = first.sensor or (best.channel if alone and not strays and not is_early else None)
    kind = _kind(case, [fit for fit in ranking if fit.channel == best.channel])
    return Judgement(
        time_s=case.end_s,
        sensor=sensor,
        candidates=_named(best, sensor)
        if sensor
        else _candidates(case, order, untestable, whole_axis=bool(strays) or is_early),
        kind=kind.kind,
        parameters=dict(kind.parameters),
        intervals=intervals_of(kind),
        partner=kind.partner,
        reason="" if sensor else _reason(best, order, untestable, strays),
    )


def _named(best: FittedHypothesis, sensor: str) -> tuple[str, ...]:
    """Return the sensors that a decided fault is of: two, where they have changed places."""
    return (sensor, best.partner) if best.how == "swapped" and best.partner is not None else (sensor,)


def _candidates(case: Case, order: Sequence[str], untestable: Sequence[str], *, whole_axis: bool) -> tuple[str, ...]:
    """Return whom an undecided alarm leaves under suspicion; where the best doesn't explain all, its axis."""
    return tuple(dict.fromkeys([*order, *untestable, *(_axis(case, order[0]) if whole_axis else [])]))


def _rivals(case: Case, good: Sequence[FittedHypothesis], excess: Excess | None = None) -> tuple[str, ...]:
    """Return the suspects that the best doesn't decisively beat, likeliest first; or that likely hold the excess."""
    best = {channel: next(fit for fit in good if fit.channel == channel) for channel in _channels(good)}
    first = good[0]
    turns = first.channel in GYROS and (first.kind == UNKNOWN or passes_for(first.kind, "turn"))
    resembles = turns or passes_for(first.kind, "loop") or first.channel in case.driving

    def is_near(channel: str, fit: FittedHypothesis) -> bool:
        # as likely; more so where the two look the same, or are read coarsely
        is_alike = _are_same(case, good, first.channel, channel) or _is_coarse(case, first, channel)
        if fit.bic < first.bic + (_ALIKE if is_alike else DECISIVE):
            return True
        # soon after an onset gyro and angle of an axis look alike: what is decisive begins high and falls with the rows
        is_early = resembles and not case.is_telling and channel in axis_of(first.channel)
        if is_early and fit.bic < first.bic + _EARLY + _EARLY_ROW * (case.judged.stop - case.judged.start):
            return True
        if fit.is_held and not first.is_held and case.surprises.get(channel, 0.0) > _PLAIN:
            return channel in axis_of(first.channel)  # it stands still where others move, whatever else explains more
        # and what explains a large share of what the best does may be it, if the best could read anything
        is_vague = fit.bic < first.bic + _VAGUE * (case.deviance - first.bic)
        return (is_vague or (excess is not None and channel == excess.holder)) and _reads_anything(case, first, fit)

    return tuple(channel for channel, fit in best.items() if is_near(channel, fit))


def _is_coarse(case: Case, first: FittedHypothesis, channel: str) -> bool:
    """Tell whether two sensors of an axis are alike because one reads in counts that are coarser than its noise.

    What counts leave is no noise of any spectrum, and what absorbs a little of everything absorbs that, too.
    """
    axis = axis_of(first.channel)
    counted = (case.habits[name].is_coarse for name in axis if name in case.habits)
    return first.is_absorbing and channel in axis and any(counted)


def _reads_anything(case: Case, first: FittedHypothesis, other: FittedHypothesis) -> bool:
    """Tell whether two sensors of an axis are alike where what each reads is anything, as nothing definite explains it.

    Noise explains whatever is left, a little better or worse as its spectrum happens to fit. What tells then is what
    the readings as a whole, beside what they should have been, do to the axes that one of the two enters.
    """
    is_noise = first.how != "tone" and 0.0 < first.misfit <= 1.0  # and fits; a tone has too little spectrum
    if (
        not first.is_absorbing
        or is_noise
        or other.channel not in axis_of(first.channel)
        or first.left.heals(case.monitor)
    ):
        return False
    left = [_left_elsewhere(case, fit.channel, fit.estimator) for fit in (first, other)]
    return left[1] - left[0] < _FREELY


def _freer(case: Case, best: FittedHypothesis) -> tuple[str, ...]:
    """Return the sensors of other axes that heal far more than the best one does, were each to read what it should.

    Asked where the best one is noise that doesn't fit, which explains a little of everything.
    """
    if best.misfit <= 1.0 or case.driving or best.left.heals(case.monitor):
        return ()
    most = _left_elsewhere(case, best.channel, best.estimator) - _FREELY
    others = [name for name in case.suspects if name not in axis_of(best.channel)]
    return tuple(name for name in others if _left_elsewhere(case, name, None) < most)


def _of_other_gain(case: Case, best: FittedHypothesis) -> tuple[str, ...]:
    """Return the angle that may read 1/g of itself where its gyro, which drives the attitude, would read g of its turn.

    About the gyro's own axis both look the same. An angle enters the other axes' rates, too, and tells there.
    """
    if best.channel not in case.driving or best.how not in ("gain", "sign"):
        return ()
    factor = best.parameters.get("factor", -1.0)
    angles = suspects_in(case, [name for name in axis_of(best.channel) if name in ANGLES])
    if not angles or abs(factor) < _DEAD:
        return ()
    (angle,) = angles
    of_gyro, of_angle = (_energies(case, left, best.channel) for left in (best.left, angle.rescaled(1.0 / factor)))
    return (angle.channel,) if of_angle < of_gyro + _OTHER_AXES else ()


def _energies(case: Case, left: Left, channel: str) -> float:
    """Return what is left of the other axes' residuals once a fault is undone."""
    undone = dict(zip(left.outputs, left.white, strict=True))
    others = (output for output in case.residuals.raw if output not in axis_of(channel))
    return sum(energy(undone.get(output, case.white[output][case.judged])) for output in others)


def _left_elsewhere(case: Case, channel: str, estimator: AttitudeEstimator | None) -> float:
    """Return what is left of all but an axis's own residuals once its suspect reads what it should."""
    suspect = suspect_through(case, channel, estimator)
    if suspect is None:
        return np.inf
    axis = axis_of(channel)
    left = dict(zip(suspect.outputs, suspect.white - suspect.shown(suspect.off[np.newaxis])[0], strict=True))
    others = (output for output in case.residuals.raw if output not in axis)
    mates = (own(name) for name in axis if name != channel)
    return (
        sum(energy(left.get(output, case.white[output][case.judged])) for output in others)
        + sum(case.energies.get(name, 0.0) for name in mates)
        + _of_its_own(case, channel)
    )


def _of_its_own(case: Case, channel: str) -> float:
    """Return -2 log likelihood of a sensor's own noise, which may be of any level."""
    habit, squares = case.habits.get(channel), case.energies.get(own(channel))
    if habit is None or squares is None:
        return 0.0
    count = int(np.isfinite(case.white[own(channel)][case.judged]).sum())
    level = squares * ALIKE / max(count, 1)
    return float(habit.deviance(np.array(squares), count) if level < 1.0 else squares / level * (1.0 + np.log(level)))


def _holder(
    case: Case, good: Sequence[FittedHypothesis], strays: Sequence[str], excess: Excess | None
) -> FittedHypothesis | None:
    """Return the best fit of the sensor that must hold what the best one's shapes only absorb; None where that is open.

    It is the one whose reading clearly holds what the gyro and the attitude differ by. It is the angle, too, where the
    residual of another axis is sick that it would heal: no fault of the gyro enters that. It has to explain most of
    what is wrong.
    """
    best = good[0]
    if not best.is_absorbing or not case.is_telling:
        return None
    name = excess.holder if excess is not None and excess.is_clear else None
    if strays:
        mates = suspects_in(case, [mate for mate in axis_of(best.channel) if mate in ANGLES and mate != best.channel])
        healers = [mate.channel for mate in mates if all(would_heal(mate, output) for output in strays)]
        name = next((healer for healer in healers if name in (None, healer)), None)
    least = _MOSTLY * (case.deviance - best.bic)
    return next((fit for fit in good if fit.channel == name and case.deviance - fit.bic >= least), None)


def _channels(fits: Iterable[FittedHypothesis]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(fit.channel for fit in fits))


def _are_same(case: Case, good: Sequence[FittedHypothesis], one: str, other: str) -> bool:
    """Tell whether two sensors' likeliest kinds, or those that would be told of them, are physically the same fault."""
    if one == other or other not in axis_of(one):
        return False
    gyro, angle = (one, other) if other in ANGLES else (other, one)
    hidden = not case.driving and angle in case.habits and not case.habits[angle].is_fine
    same = SAME | _SAME_IN_COUNTS if hidden else SAME
    return any(
        (of_gyro, of_angle) in same for of_gyro in _likely(case, good, gyro) for of_angle in _likely(case, good, angle)
    )


def _likely(case: Case, good: Sequence[FittedHypothesis], channel: str) -> set[str]:
    """Return the kinds of a sensor that its best doesn't decisively beat, and the one that would be told of it.

    A kind is told although what reads anything is better still, which would then be the only likely one.
    """
    own = [fit for fit in good if fit.channel == channel]
    return {fit.kind for fit in own if fit.bic < own[0].bic + DECISIVE} | {_kind(case, own).kind}


def _kind(case: Case, fits: Sequence[FittedHypothesis]) -> FittedHypothesis:
    """Return, of a sensor's fits, the one whose kind may be named, or that of no kind.

    What explains a little of everything (noise, a random walk) is a kind only where nothing definite explains the rest.
    """
    best, healthy = fits[0], case.deviance
    definite = [fit for fit in fits if not fit.is_absorbing]
    absorbing = [fit for fit in fits if fit.is_absorbing and fit.kind != UNKNOWN and fit.misfit <= 1.0]
    for fit in (*definite, *absorbing):
        explained = (healthy - fit.bic) / max(healthy - best.bic, 1e-9)
        if fit.bic < best.bic + DECISIVE or explained > _NEARLY or fit.left.heals(case.monitor):
            return fit
    is_no_kind = best.how in ("white", "walk") and best.misfit > 1.0
    return next((fit for fit in fits if fit.kind == UNKNOWN), best) if is_no_kind else best


def _strays(case: Case, best: FittedHypothesis) -> list[str]:
    """Return the residuals that the best suspect doesn't enter and another sensor of its axis would heal.

    One that no fault of this axis heals tells of a fault of its own.
    """
    sick = [output for output, far in case.sickness.items() if output not in best.left.outputs and far > 1.0]
    mates = suspects_in(case, [name for name in _axis(case, best.channel) if name != best.channel] if sick else [])
    return [output for output in sick if any(would_heal(mate, output) for mate in mates)]


def would_heal(suspect: Suspect, output: str, share: float = 0.5) -> bool:
    """Tell whether a residual is healthy, or a share as far from it at most, once a suspect reads what it should."""
    case = suspect.case
    if output not in suspect.outputs:
        return False
    row = suspect.outputs.index(output)
    left = suspect.white[row] - suspect.shown(suspect.off[np.newaxis])[0, row]
    most = max(share * case.sickness[output], 1.0)
    return greatest(case.monitor, output, left, enough=most) < most


def _axis(case: Case, channel: str) -> list[str]:
    return [name for name in case.monitor.bank.suspects if name in axis_of(channel)]


def _reason(best: FittedHypothesis, order: Sequence[str], untestable: Sequence[str], strays: Sequence[str]) -> str:
    """Say why no sensor is named."""
    if strays:
        return f"a fault of {best.channel} doesn't explain the residual of {', '.join(strays)}"
    if len(order) > 1:
        return f"a fault of {order[1]} explains it nearly as well as one of {order[0]}"
    return f"nothing predicts {', '.join(untestable)}" if untestable else EARLY


def _is_anothers(case: Case, ranking: Sequence[FittedHypothesis], first: Judgement) -> bool:
    """Tell whether a sensor's own readings show a fault that isn't under suspicion: what it does is no step."""
    if not ranking or not ranking[0].is_shown or ranking[0].channel in first.candidates:
        return False
    return ranking[0].bic < case.deviance - DECISIVE


def _stepped(case: Case, first: Judgement) -> Judgement | None:
    """Say that an angle has stepped, or one of two did, where a step explains what was there for a moment; or None."""
    ranked = transients(case, suspects_in(case, first.candidates))
    best = ranked[0] if ranked else None
    if best is None or not best.is_step or best.channel not in ANGLES or best.gain < DECISIVE:
        return None
    rivals = [each.channel for each in ranked if each.gain > best.gain - DECISIVE]
    names = tuple(dict.fromkeys([best.channel, *rivals]))
    return Judgement(
        time_s=case.end_s,
        sensor=names[0] if len(names) == 1 else None,
        candidates=names,
        kind=Bias.kind,
        parameters={"size": best.size, "onset_s": float(case.record.time_s[best.row])},
        intervals={"size": interval(best.size, abs(best.size) / float(np.sqrt(best.gain)))},
        reason="" if len(names) == 1 else f"a short fault of {names[1]} explains it nearly as well",
    )


def _unexplained(case: Case, first: Judgement) -> Judgement:
    """Say of an alarm that no hypothesis explains whether anything is left of it."""
    told = replace(first, time_s=case.end_s)
    if first.sensor is not None:
        return told
    left = max(case.sickness.values())
    if left > 1.0:
        return replace(told, reason="no hypothesis explains the residuals")
    if left > _QUIET or (len(case.record) - case.sure) * case.period_s < _PASSED_S:
        return replace(told, reason="too little is left of it to tell")
    return replace(told, candidates=tuple(_untestable(case)))


def _untestable(case: Case) -> list[str]:
    """Return the suspects that nothing predicts and nothing clears: the residuals they don't enter are healthy."""
    bank, predicted = case.monitor.bank, case.residuals.raw
    return [
        name
        for name in suspects_of(bank, tuple(predicted))
        if name not in predicted and not integrable(name, bank.channels)
        if all(far <= 1.0 for output, far in case.sickness.items() if output not in bank.affects(name))
    ]


def is_bent_far(case: Case) -> bool:
    """Tell whether a gyro seems to have bent the attitude so far that its fit errs: what was said stands."""
    for suspect in likely_suspects_in(case, case.driving):
        if suspect.bend is None:
            continue
        change = suspect.off if suspect.away is None else suspect.away
        if any(float(np.abs(bend).max()) > _FARTHEST_DEG for bend in suspect.bend.of(change[np.newaxis]).values()):
            return True
    return False


def only_doubts(case: Case, judged: Judgement, last: Judgement | None) -> bool:
    """Tell whether a look says no more than that a named gyro's fault isn't explained as well as it was.

    The attitude that the gyro drives has bent farther since, and how far is known less and less.
    """
    if last is None or last.sensor not in case.driving or judged.doubt != DOUBT or not judged.candidates:
        return False
    return set(judged.candidates) <= set(axis_of(last.sensor))
