"""Several sensors hit at once: where no single one explains what all residuals show, each axis is judged by itself.

An angle enters up to three residuals and reads anything, so that it explains a part of whatever happens to several
gyros. One sensor is all that is wrong only if every residual is healthy, or much nearer to it, once that sensor reads
what it should. Otherwise the gyro and the angle of each axis that is hit are weighed by their own residual and their
own readings alone: what another axis shows is another fault's.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import NOISE_CHANGED, Judgement
from gtmbench.detectors.isolation.case import Case
from gtmbench.detectors.isolation.diagnosis import DECISIVE, judge, would_heal
from gtmbench.detectors.isolation.driving import suspects_in
from gtmbench.detectors.isolation.fits import FittedHypothesis, ranked_hypotheses
from gtmbench.detectors.isolation.fitter import UNKNOWN
from gtmbench.detectors.isolation.health import energy
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.detectors.virtual import ANGLES
from gtmbench.faults.replacing import Jam, Stale
from gtmbench.values.channels import GYROS, axis_of
from gtmbench.values.record import BoolArray, FloatArray, runs

SEVERAL = "several sensors are hit at once"
_HEALED = 0.2  # of what is wrong, may be left where one sensor explains all
_NEARLY = 0.75  # of what the gyros of other axes explain, where an angle may be what is wrong
_PARTLY = 0.5  # of the same, where the angle is named by its own axis
_OFTEN, _OFTENER = 10.0, 4.0  # rows that repeat in several channels at once, beyond so many times as before
_TOGETHER = 0.8  # of the rows that any channel repeats, that all do
_IN_TUNE = 1.05  # times the frequency of another tone
_PLAIN, _LOUDER = 60.0, 0.1  # of -2 log likelihood; of what chance leaves


def judge_all(case: Case, ranking: list[FittedHypothesis], first: Judgement, without: Iterable[str] = ()) -> Judgement:
    """Return what is said of a case: of one sensor, or of each axis that is hit.

    Parameters
    ----------
    case : Case
    ranking : list of FittedHypothesis
        Of one sensor each, the best first.
    first : Judgement
        What the signature says.
    without : iterable of str
        Families of hypotheses that aren't tried.
    """
    standing = _standing(case)
    if standing is not None:
        return standing
    hit = _hit(case, ranking, first)
    if hit is None:
        return judge(case, ranking, first)
    parts, gains = _parts(case, hit, first, tuple(without))
    with_angle = _with_own_angle(case, hit, parts, gains)
    if with_angle is not None:
        return with_angle
    return _merged(case, parts)


def _hit(case: Case, ranking: Sequence[FittedHypothesis], first: Judgement) -> list[str] | None:
    """Return the residuals that tell of faults of their own, its own among them; None where one sensor explains all."""
    if case.driving or first.sensor is not None or case.source not in case.residuals.raw:
        return None
    best = ranking[0] if ranking else None
    if best is None or best.kind == "swap" or best.bic >= case.deviance - DECISIVE:
        return None
    hit = [output for output in case.residuals.raw if output == case.source or _is_hit(case, output)]
    if set(hit) <= set(axis_of(best.channel)):
        return None
    if any(_explains_all(suspect, hit) for suspect in suspects_in(case, ANGLES)):
        return None
    return [output for output in hit if output == case.source or output not in case.others]


def _is_hit(case: Case, output: str) -> bool:
    """Tell whether a residual is sick, or holds much more than chance, though no window of it is beyond a threshold."""
    return case.sickness[output] > 1.0 or _is_loud(case.white[output][case.judged])


def _is_loud(white: FloatArray) -> bool:
    count = int(np.isfinite(white).sum())
    return energy(white) - count > max(_PLAIN, _LOUDER * count)


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


def _parts(
    case: Case, outputs: Sequence[str], first: Judgement, without: tuple[str, ...]
) -> tuple[dict[str, Judgement], dict[str, float]]:
    """Return what is said of each residual by itself, but of those that an angle heals which is named of another."""
    parts: dict[str, Judgement] = {}
    gains: dict[str, float] = {}
    for output in outputs:
        alone = _alone(case, output)
        ranking = ranked_hypotheses(alone, alone.suspects, without)
        signature = replace(first, candidates=alone.suspects)
        gains[output] = alone.deviance - min((fit.bic for fit in ranking), default=alone.deviance)
        parts[output] = judge(alone, ranking, signature)
    for output, judged in tuple(parts.items()):
        if judged.sensor in ANGLES and output in parts:
            (angle,) = suspects_in(case, [str(judged.sensor)])
            for other in [name for name in parts if name != output and would_heal(angle, name)]:
                if parts[other].sensor not in ANGLES:
                    del parts[other]
    return parts, gains


def _with_own_angle(
    case: Case, hit: Sequence[str], parts: Mapping[str, Judgement], gains: Mapping[str, float]
) -> Judgement | None:
    """Return what is said where an angle makes the other axes' residuals what they are, and its own gyro failed, too.

    What the angle should read isn't known then, for that gyro integrates to it. But the other axes' residuals are its
    change times their motion: where some sum of what the gyro says, a constant, a ramp and its own reading heals them,
    it is the angle that they tell of.
    """
    alarmed = {*hit, *case.together, *case.others}
    for angle in suspects_in(case, ANGLES):
        axis = axis_of(angle.channel)
        others = [output for output in hit if output not in axis]
        if not others or not alarmed & set(axis):
            continue
        judged = next((parts[output] for output in axis if output in parts), None)
        explained = sum(gains[output] for output in others)
        is_named = judged is not None and judged.sensor == angle.channel
        gain = _gain(angle, others, is_named=is_named or judged is None)
        if gain < (_PARTLY if is_named else _NEARLY) * explained:
            continue
        if judged is None or judged.sensor is None or judged.doubt or gain < explained + DECISIVE:
            names = dict.fromkeys([*axis, *(name for each in parts.values() for name in each.candidates)])
            told = judged or parts[case.source]
            return replace(told, sensor=None, partner=None, candidates=tuple(names), reason=SEVERAL)
        gyro = next(name for name in axis if name != angle.channel)
        other = angle.channel if judged.sensor == gyro else gyro
        unknown = Judgement(time_s=case.end_s, sensor=other, candidates=(other,), kind=UNKNOWN)
        return _together(case, [judged, unknown])
    return None


def _gain(angle: Suspect, outputs: Sequence[str], *, is_named: bool) -> float:
    """Return by how much of BIC some smooth change of an angle explains other axes' residuals; -inf if it can't.

    It is a constant, a ramp, a share of its own reading, and of one that is named what it reads beside its gyro's.
    """
    off = angle.off
    angle = Suspect.as_read(angle.case, angle.channel)
    rows = [angle.outputs.index(output) for output in outputs if output in angle.outputs]
    if len(rows) < len(outputs):
        return -np.inf
    since_s = np.where(angle.begun, angle.time_s - angle.time_s[angle.onset], 0.0)
    reading = np.where(angle.begun, np.nan_to_num(angle.measured), 0.0)
    changes = [1.0 * angle.begun, since_s, reading, *([off] if is_named else [])]
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


def _alone(case: Case, output: str) -> Case:
    """Return a case of one residual, with the gyro and the angle of its axis as suspects."""
    raw = {output: case.residuals.raw[output]}
    suspects = tuple(name for name in case.monitor.bank.suspects if name in axis_of(output))
    return replace(
        case,
        residuals=replace(case.residuals, raw=raw),
        suspects=suspects,
        source=output,
        others=frozenset(),
        together=frozenset(raw),
    )


def _merged(case: Case, parts: Mapping[str, Judgement]) -> Judgement:
    """Return what is said of all parts in one: several sensors failed at once, or one of these did."""
    telling = [judged for output, judged in parts.items() if output == case.source or _is_definite(judged)]
    if len(telling) == 1:
        return telling[0]
    named = _of_gyros(telling) or telling
    if all(judged.sensor is not None and not judged.doubt for judged in named):
        return _together(case, named)
    told = [judged for judged in telling if judged.candidates] or telling[:1]
    kinds = {judged.kind for judged in told}
    return Judgement(
        time_s=case.end_s,
        sensor=None,
        candidates=tuple(dict.fromkeys(name for judged in told for name in judged.candidates)),
        kind=kinds.pop() if len(kinds) == 1 else None,
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
    gyros = [next((name for name in judged.candidates if name in GYROS), None) for judged in parts]
    if None in gyros or any(judged.sensor in ANGLES for judged in parts):
        return []
    return [
        judged if judged in sure else replace(judged, sensor=gyro, candidates=(str(gyro),), reason="", doubt="")
        for judged, gyro in zip(parts, gyros, strict=True)
    ]


def _standing(case: Case) -> Judgement | None:
    """Return that all channels, or all gyros, repeat the same rows, as of a logger or a box; None where they don't.

    Noise never repeats in several sensors at once. Counts do where nothing moves, so that other sensors have to.
    """
    channels = [name for name in case.monitor.bank.suspects if name in case.habits]
    gyros = [name for name in channels if name in GYROS]
    since = slice(case.sure, case.judged.stop)
    for group in (channels, gyros):
        others = [name for name in channels if name not in group]
        is_counted = any(case.habits[name].is_counted for name in group)
        if len(group) < len(GYROS) or (is_counted and not (others and all(map(case.moves, others)))):
            continue
        readings = [case.record[name][since] for name in group]
        repeated = _repeats(readings)
        before = _repeats([case.habits[name].before for name in group])
        if repeated.sum() < _OFTEN + _OFTENER * before.mean() * len(repeated):
            continue
        if all(repeated.sum() >= _TOGETHER * _repeats([values]).sum() for values in readings):
            return _together(case, [_stands(case, name, repeated) for name in group])
    return None


def _stands(case: Case, channel: str, repeated: BoolArray) -> Judgement:
    """Return that a sensor stands still, or that it is read every so often."""
    starts, ends = runs(repeated)
    longest = float((ends - starts).max())
    if longest > 0.5 * float(repeated.sum()):
        value = float(case.record[channel][case.sure + int(starts[np.argmax(ends - starts)])])
        return Judgement(
            time_s=case.end_s, sensor=channel, candidates=(channel,), kind=Jam.kind, parameters={"value": value}
        )
    hold_s = case.period_s * len(repeated) / max(float(np.count_nonzero(~repeated)), 1.0)
    return Judgement(
        time_s=case.end_s, sensor=channel, candidates=(channel,), kind=Stale.kind, parameters={"hold_s": hold_s}
    )


def _repeats(readings: Sequence[FloatArray]) -> BoolArray:
    """Tell which rows are the same as the one before, in every channel."""
    rows = min(len(values) for values in readings)
    return np.asarray(np.all([np.diff(values[-rows:]) == 0.0 for values in readings], axis=0))


def _is_definite(judged: Judgement) -> bool:
    """Tell whether a residual beside the one that alarmed is a fault's, and not a model's error."""
    return bool(judged.candidates) and judged.kind not in (None, UNKNOWN, "random_walk")
