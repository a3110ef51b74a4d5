"""Several sensors hit at once: where no single one explains what all residuals show, each axis is judged by itself.

An angle enters up to three residuals and reads anything, so that it explains a part of whatever happens to several
gyros. One sensor is all that is wrong only if every residual is healthy, or much nearer to it, once that sensor reads
what it should. Otherwise the gyro and the angle of each axis that is hit are weighed by their own residual, their own
readings and the residuals that are healthy: what another axis that is hit shows is another fault's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import NOISE_CHANGED, Judgement
from gtmbench.detectors.bank.calibrated import energy
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.diagnosis import DECISIVE, judge, would_heal
from gtmbench.detectors.isolation.fits import FittedHypothesis, ranked_hypotheses, suspects_in
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.isolation.standing import rounded, standing_beside, standing_still
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.detectors.virtual import ANGLES
from gtmbench.faults.registry import how_of
from gtmbench.faults.shape import SHOWN
from gtmbench.values.channels import GYROS, axis_of
from gtmbench.values.record import FloatArray

SEVERAL = "several sensors are hit at once"
_HEALED = 0.2  # of what is wrong, may be left where one sensor explains all
_NEARLY = 0.75  # of what the gyros of other axes explain, where an angle may be what is wrong
_PARTLY = 0.5  # of the same, where the angle is named by its own axis
_TURNS = 4.0  # of a tone, until it is one
_IN_TUNE = 1.05  # times the frequency of another tone
_FITTING = 0.5  # of what a residual has beyond chance, that a fault explains
_LEAST_SHARE = 0.02  # of what a fault explains of its axis, that is another's on the next
_PLAIN, _LOUDER = 60.0, 0.1  # of -2 log likelihood; of what chance leaves


class _Part(NamedTuple):
    """What is said of one residual by itself, and by how much of BIC that explains it."""

    judged: Judgement
    gain: float


def judge_all(case: Case, ranking: list[FittedHypothesis], first: Judgement, without: Iterable[str] = ()) -> Judgement:
    """Return what is said of a case: of one sensor, or of each axis that is hit.

    `ranking`: of one sensor each, the best first. `first`: what the signature says. `without`: families of hypotheses
    that aren't tried.
    """
    together = standing_still(case) or rounded(case)
    if together:
        return _together(case, together)
    told = _weighed(case, ranking, first, tuple(without))
    others = standing_beside(case, told)
    if not others:
        return told
    # an angle that stands still enters the other axes: what they show is its own
    axes = {name for each in others if each.sensor in ANGLES for name in axis_of(str(each.sensor))}
    named = [each for each in told.together or (told,) if each.failed and (not axes or each.sensor in axes)]
    both = [*named, *others]
    return _together(case, both) if len(both) > 1 else both[0]


def _weighed(case: Case, ranking: list[FittedHypothesis], first: Judgement, without: tuple[str, ...]) -> Judgement:
    """Return what the residuals say of a case."""
    hit = _hit(case, ranking, first)
    parts = {} if hit is None else _parts(case, hit, first, without)
    if hit is None or not _is_beyond(case, parts, ranking[0]):
        told = judge(case, ranking, first)
        gone = {*case.together, *case.others} - {*case.residuals.raw}
        if not gone or told.sensor is None or how_of(told.kind) in SHOWN:
            return told
        own = {case.source: _Part(told, case.deviance - ranking[0].bic)}
        return _with_own_angle(case, own, gone) or told
    alarmed = {*parts, *case.together, *case.others}
    return _with_own_angle(case, parts, alarmed) or _merged(case, _of_their_own(case, parts))


def _hit(case: Case, ranking: Sequence[FittedHypothesis], first: Judgement) -> list[str] | None:
    """Return the residuals that tell of faults of their own, its own among them; None where one sensor explains all."""
    if case.driving or first.sensor is not None or case.source not in case.residuals.raw:
        return None
    best = ranking[0] if ranking else None
    if best is None or best.how == "swapped" or best.bic >= case.deviance - DECISIVE:
        return None
    hit = [
        output
        for output, far in case.sickness.items()
        if output == case.source or far > 1.0 or _is_loud(case.white[output][case.judged])
    ]
    if set(hit) <= set(axis_of(best.channel)):
        return None
    if any(_explains_all(suspect, hit) for suspect in suspects_in(case, ANGLES)):
        return None
    return [output for output in hit if output == case.source or output not in case.others]


def _is_beyond(case: Case, parts: Iterable[str], best: FittedHypothesis) -> bool:
    """Tell whether another axis than the best one's is sick, or has a fault of its own."""
    sick = (output for output, far in case.sickness.items() if far > 1.0)
    return not {*parts, *sick} <= set(axis_of(best.channel))


def _is_loud(white: FloatArray) -> bool:
    """Tell whether a residual holds much more than chance, though no window of it is beyond a threshold."""
    return _excess(white) > max(_PLAIN, _LOUDER * float(np.isfinite(white).sum()))


def _excess(white: FloatArray) -> float:
    """Return by how much a residual holds more than chance, of -2 log likelihood."""
    return energy(white) - float(np.isfinite(white).sum())


def _explains_all(angle: Suspect, hit: Sequence[str]) -> bool:
    """Tell whether nearly nothing is wrong any more with what is hit once an angle reads what it should.

    What its gyro makes it read heals its own axis in any case. So another axis's residual has to be healed with it; or
    else none of them may be louder than chance.
    """
    case = angle.case
    sick = [output for output in hit if output == case.source or case.sickness[output] > 1.0]
    if not all(would_heal(angle, output, _HEALED) for output in sick):
        return False
    others = [output for output in hit if output not in sick]
    return not set(sick) <= set(axis_of(angle.channel)) or not any(map(_is_loud, _left_by(angle, others)))


def _left_by(suspect: Suspect, outputs: Sequence[str]) -> Iterator[FloatArray]:
    """Give what residuals that a suspect enters leave once it reads what it should, and those that it doesn't."""
    shown = suspect.shown(suspect.off[np.newaxis])[0]
    for output in outputs:
        if output in suspect.outputs:
            row = suspect.outputs.index(output)
            yield suspect.white[row] - shown[row]
        else:
            yield suspect.case.white[output][suspect.case.judged]


def _parts(case: Case, outputs: Sequence[str], first: Judgement, without: tuple[str, ...]) -> dict[str, _Part]:
    """Return what is said of each residual by itself, its own first; of others only where that is a fault.

    Noise that wanders, or is a little louder than what was learnt, is none; but it may be the same noise as its own.
    Nor is what is a small share of another axis's: an attitude that a gyro has bent, or a model's error in its motion.
    """
    parts: dict[str, _Part] = {}
    healthy = [name for name, far in case.sickness.items() if far <= 1.0 and name not in outputs]
    for output in sorted(outputs, key=lambda output: output != case.source):
        alone = _alone(case, output, healthy)
        ranking = ranked_hypotheses(alone, alone.suspects, without)
        judged = judge(alone, ranking, replace(first, candidates=alone.suspects))
        gain = alone.deviance - min((fit.bic for fit in ranking), default=alone.deviance)
        own_kind = parts[case.source].judged.kind if parts else None
        is_fitting = case.sickness[output] > 1.0 or gain > _FITTING * _excess(case.white[output][case.judged])
        is_same = judged.doubt == NOISE_CHANGED and judged.kind == own_kind
        if output == case.source and gain < DECISIVE:  # a moment, which any angle's step may have been
            judged = replace(first, time_s=case.end_s, reason=SEVERAL)
        if output == case.source or (is_fitting and (is_same or not judged.doubt)):
            parts[output] = _Part(judged, gain)
    return _large(parts)


def _large(parts: Mapping[str, _Part]) -> dict[str, _Part]:
    """Return the parts that are no small share of the greatest, which stays, though nothing explains it."""
    greatest = max(part.gain for part in parts.values())
    return {output: part for output, part in parts.items() if part.gain >= min(_LEAST_SHARE * greatest, greatest)}


def _of_their_own(case: Case, parts: Mapping[str, _Part]) -> dict[str, Judgement]:
    """Return what is said of all parts, but of those that an angle heals which is named of another."""
    told = {output: part.judged for output, part in parts.items()}
    for output, part in parts.items():
        if part.judged.sensor in ANGLES and output in told:
            (angle,) = suspects_in(case, [str(part.judged.sensor)])
            for other in [name for name in told if name != output and told[name].sensor not in ANGLES]:
                if would_heal(angle, other):
                    del told[other]
    return told


def _with_own_angle(case: Case, parts: Mapping[str, _Part], alarmed: Set[str]) -> Judgement | None:
    """Return what is said where an angle makes the other axes' residuals what they are, and its own gyro failed, too.

    What the angle should read isn't known then, for that gyro integrates to it. But the other axes' residuals are its
    change times their motion: where a smooth change of it explains them as well as faults of theirs do, it may be the
    angle that they tell of. `alarmed` are the residuals of axes of which that may be.
    """
    for angle in suspects_in(case, ANGLES):
        axis = axis_of(angle.channel)
        others = [output for output in parts if output not in axis]
        if not others or not alarmed & set(axis):
            continue
        judged = next((parts[output].judged for output in axis if output in parts), None)
        explained = sum(parts[output].gain for output in others)
        is_named = judged is not None and judged.sensor == angle.channel
        # how much of the other axes a smooth change of the angle explains, beside what their own faults do
        gain = _gain(angle, others, is_named=is_named or judged is None)
        if gain < (_PARTLY if is_named else _NEARLY) * explained:
            continue
        # as much: it may be either. Decisively more: the angle failed beside the sensor that is named
        if judged is None or judged.sensor is None or judged.doubt or gain < explained + DECISIVE:
            names = dict.fromkeys([*axis, *(name for each in parts.values() for name in each.judged.candidates)])
            told = judged or next(iter(parts.values())).judged
            return replace(told, sensor=None, partner=None, candidates=tuple(names), reason=SEVERAL)
        gyro = next(name for name in axis if name != angle.channel)
        other = angle.channel if judged.sensor == gyro else gyro
        unknown = Judgement(time_s=case.end_s, sensor=other, candidates=(other,), kind=UNKNOWN)
        return _together(case, [judged, unknown])
    return None


def _gain(angle: Suspect, outputs: Sequence[str], *, is_named: bool) -> float:
    """Return by how much of BIC some smooth change of an angle explains other axes' residuals; -inf if it can't.

    It is a constant, a ramp, a share of its own reading or of how that turns, and of one that is named what it reads
    beside its gyro's.
    """
    off = angle.off
    angle = Suspect.as_read(angle.case, angle.channel)
    rows = [angle.outputs.index(output) for output in outputs if output in angle.outputs]
    if len(rows) < len(outputs):
        return -np.inf
    since_s = np.where(angle.begun, angle.time_s - angle.time_s[angle.onset], 0.0)
    reading = np.where(angle.begun, np.nan_to_num(angle.measured), 0.0)
    rate = np.where(angle.begun, np.gradient(np.nan_to_num(angle.measured)), 0.0)
    changes = [1.0 * angle.begun, since_s, reading, rate, *([off] if is_named else [])]
    shapes = angle.shown(np.array(changes))[:, rows]
    white = angle.white[rows]
    there = np.isfinite(white)
    of, told = shapes[:, there].T, white[there]
    size = np.linalg.norm(of, axis=0)
    of = of[:, size > 0.0] / size[size > 0.0]
    left = told - of @ np.linalg.lstsq(of, told, rcond=1e-6)[0]
    as_it_is = sum(angle.case.energies[output] for output in outputs)
    return float(as_it_is - energy(left) - of.shape[1] * np.log(max(angle.case.count, 2)))


def _together(case: Case, named: Sequence[Judgement]) -> Judgement:
    """Return that several sensors failed at once."""
    kinds = {judged.kind for judged in named}
    return Judgement(
        time_s=case.end_s,
        sensor=None,
        candidates=tuple(dict.fromkeys(str(judged.sensor) for judged in named)),
        kind=kinds.pop() if len(kinds) == 1 else None,
        together=tuple(named),
    )


def _alone(case: Case, output: str, healthy: Sequence[str]) -> Case:
    """Return a case of one residual and of those that are healthy, with the gyro and the angle of its axis as suspects.

    Healthy ones speak against the angle, which would enter them.
    """
    residuals = replace(case.residuals, raw={name: case.residuals.raw[name] for name in (output, *healthy)})
    suspects = tuple(name for name in case.monitor.bank.suspects if name in axis_of(output))
    return replace(
        case,
        residuals=residuals,
        suspects=suspects,
        source=output,
        others=frozenset(),
        together=frozenset([output]),
    )


def _merged(case: Case, parts: Mapping[str, Judgement]) -> Judgement:
    """Return what is said of all parts in one: several sensors failed at once, or one of these did."""
    definite = [judged for output, judged in parts.items() if output == case.source or _is_definite(case, judged)]
    telling = definite or list(parts.values())[:1]
    if len(telling) == 1:
        return telling[0]
    named = _of_gyros(telling) or telling
    if all(judged.sensor is not None and not judged.doubt for judged in named):
        return _together(case, named)
    told = [judged for judged in telling if judged.candidates] or telling[:1]
    likeliest = told[0] if len({judged.kind for judged in told}) == 1 else replace(told[0], kind=None, parameters={})
    return replace(
        likeliest,
        time_s=case.end_s,
        sensor=None,
        partner=None,
        candidates=tuple(dict.fromkeys(name for judged in told for name in judged.candidates)),
        reason=SEVERAL,
        doubt=told[0].doubt if all(judged.doubt for judged in told) else "",
    )


def _of_gyros(parts: Sequence[Judgement]) -> list[Judgement]:
    """Return what is said of gyros that one cause hits: one of them is named, and none that the others can't be.

    They have the same kind of fault, of a tone the same frequency. Gyros stand in one box; that two of them and the
    angle of a third axis do the same at once has no cause.
    """
    sure = [judged for judged in parts if judged.sensor in GYROS and not judged.doubt]
    if not sure or any(judged.kind != sure[0].kind or judged.doubt not in ("", NOISE_CHANGED) for judged in parts):
        return []
    tones = [judged.parameters["frequency_hz"] for judged in parts if "frequency_hz" in judged.parameters]
    if tones and max(tones) > _IN_TUNE * min(tones):
        return []
    likeliest = [next(iter(judged.candidates), "") for judged in parts]
    if not {*likeliest} <= {*GYROS}:
        return []
    return [
        judged if judged in sure else replace(judged, sensor=gyro, candidates=(gyro,), reason="", doubt="")
        for judged, gyro in zip(parts, likeliest, strict=True)
    ]


def _is_definite(case: Case, judged: Judgement) -> bool:
    """Tell whether a residual beside the one that alarmed is a fault's, and not a model's error.

    A tone that has hardly turned is what anything slow looks like.
    """
    judged_s = (case.judged.stop - case.judged.start) * case.period_s
    if how_of(judged.kind) == "tone" and judged.parameters["frequency_hz"] * judged_s < _TURNS:
        return False
    return bool(judged.candidates) and how_of(judged.kind) not in ("", "walk")
