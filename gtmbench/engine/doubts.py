"""What an accusation needs beside evidence: rules under which a finding names nobody, each with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gtmbench.engine.evidence import MIRROR, axis_number
from gtmbench.engine.explanation import TIMES_S, name_of
from gtmbench.engine.explanations import gyros
from gtmbench.engine.explanations.angle import MOST_DEG
from gtmbench.engine.finding import NOISE, REFERENCES, Finding, Side
from gtmbench.engine.flight import LIVELY_S, Flight
from gtmbench.engine.imus.agreement import apart, change, means_part
from gtmbench.engine.imus.between import relation_of
from gtmbench.engine.model import Model
from gtmbench.engine.relations.attitude import log_rough, over_second
from gtmbench.engine.relations.roughness import in_motion
from gtmbench.engine.sides import constants_of_gyro
from gtmbench.engine.sums import CELL, blocks_of_cells
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Span

OWN, SHARE = 12.0, 0.1  # nats, and of all: what the broken axis itself must show between gyro and attitude
_SEEN_S, _OUTSIDE, _AS_LIVELY = 10.0, 0.5, 0.5  # of motion elsewhere; of what lies outside; of the usual there
_JOINED_S = 40.0  # findings of the same suspects that follow each other are one fault's
_AT_ONCE_S = 3.0  # as well as three onsets are dated
_SHORTEST_S = 10.0  # what lasts no longer is a contact's or a gust's, and no gyro's
_PASSES_S, _LEFT_S = 25.0, 20.0  # what passes so soon may be references'; unless the log ends soon after
_OFTEN = 2.0  # samples of a gyro in a block, or a factor is made by what it folds back
_BESIDE, _AS_STRONG = 0.5, 0.3  # of its time and its evidence: two that cancel each other
_LEARNT_DEG_S = 2.5  # the largest offset of a healthy gyro that an estimator learns in flight
_NOTHING, _HALF = 1e-3, 0.5  # of turns; of what a gain would change, or an error turns
_ABOUT_S = 5.0  # over which an angle is read, before an error and at its end
_LATE_S, _STAYS, YAW = (20.0, 60.0), 0.2, 2  # behind an onset; of an error; the axis that a compass corrects
_VOTERS, _PARTS = 2, 0.35  # further IMUs; of what the furthest is from the watched one
_ASKEW = 0.06  # three degrees
_OF_TURNS = 0.25  # of how fast they turn: by less healthy IMUs part, scales, axes and lag taken together
_SHARED, _ROUGHER = 0.25, 0.5  # of a gyro's rise of roughness; of another's usual one, which rises as well
_FAR_DEG = 45.0  # by the slowest estimator: from there on its attitude is no witness of the gyro that drives it
# times the usual: of 90 attitudes that follow a healthy gyro none is above 1.3; of 8 that follow a sign, none below 1.7
_RESTLESS = 1.5
# a log of two minutes never asks; of ten healthy hours a model's error showed after 500 times as long
_TIMES_AS_LONG = 20.0
_TIPPED_DEG = 60.0  # from level: two g in a level turn, and the heading's rate halved by a pitch
BENT_DEG = 20.0  # an attitude that is further off turns other axes in a way that no signature has


def with_doubts(model: Model, found: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return findings as one each a fault, with what speaks against naming anybody."""
    one_each = _joined(found)
    together = _at_once(one_each)
    return tuple(_with_doubt(model, each, one_each, is_together=each in together) for each in one_each)


def _joined(found: Sequence[Finding]) -> list[Finding]:
    """Return findings of the same suspects that follow each other as one; the strongest says what it is."""
    joined: list[Finding] = []
    for each in sorted(found, key=lambda each: each.onset_s):
        place = next((at for at, other in enumerate(joined) if _goes_on(other, each)), None)
        if place is None:
            joined.append(each)
            continue
        other = joined[place]
        strongest = max(other, each, key=lambda one: one.evidence)
        joined[place] = replace(
            strongest,
            first=other.first,
            last=max(other.last, each.last),
            onset_s=other.onset_s,
            onset_range_s=other.onset_range_s,
            end_s=max(other.end_s, each.end_s),
            evidence=other.evidence + each.evidence,
            own_axis=other.own_axis + each.own_axis,
            shown=other.shown + each.shown,
        )
    return joined


def _goes_on(first: Finding, then: Finding) -> bool:
    """Tell whether two are one fault's. What its own axis hardly shows dates nothing: the other may leave it.

    Nor does noise date what else is wrong: a gyro that reads nothing any more was noisier before.
    """
    is_near = then.onset_s - first.end_s < _JOINED_S
    are_noise = {each.best.kind == NOISE for each in (first, then)}
    return is_near and set(first.suspects) == set(then.suspects) and not _own_axis(first) and len(are_noise) == 1


def _at_once(found: Sequence[Finding]) -> list[Finding]:
    """Return findings that all gyros share, or noise that several do: the logger's, the attitude's or what shakes."""
    shared: list[Finding] = []
    for each in found:
        near = [other for other in found if other.named and not other.is_frozen]
        near = [other for other in near if abs(other.onset_s - each.onset_s) < _AT_ONCE_S]
        noisy = {other.named for other in near if other.best.kind == "noise"}
        if len({other.named for other in near}) == len(GYROS) or len(noisy) > 1:
            shared += near
    return shared


def _with_doubt(model: Model, finding: Finding, found: Sequence[Finding], *, is_together: bool) -> Finding:
    if finding.is_frozen:
        return finding
    others: tuple[str, ...] = (
        (REFERENCES,) if is_together or _passes(model, finding) or _is_cancelled(finding, found) else ()
    )
    others += _twin(model, finding, found)
    others += _own_angle(model, finding)
    others += (ATTITUDE[axis_number(finding.best.suspect)],) if finding.best.of_turns else ()
    others += _tipped(model.flight, finding)
    if finding.is_healthy:
        return replace(finding, others=others)
    reasons = [*_short(finding), *_seldom(model, finding), *_is_own_noise(model, finding), *_own_axis(finding)]
    reasons += [*_regime(model, finding), *_bent(model, finding, found), *_sides(finding), *_learns(model, finding)]
    reasons += [*_follows(model, finding), *_gain_between(model, finding), *_shaken(model, finding)]
    reasons += [
        *_leaks(finding, found),
        *_of_other(finding, found),
        *_outvoted(model, finding),
        *_shakes_all(model.flight, finding),
    ]
    reasons += [*_late(model.flight, finding), *_never_read(model.flight, finding)]
    return replace(finding, others=others, doubt="; ".join(reasons))


def _passes(model: Model, finding: Finding) -> bool:
    """Tell whether it is over soon, or was.

    References that turn an attitude farther than an angle may be off leave it wrong before or behind, about all axes.
    """
    start_s = model.flight.blocks.start_s
    end_s = start_s + model.cells * model.cell_s
    if finding.best.kind not in gyros.kinds():  # a gyro that fails seldom heals
        return False
    if finding.best.kind == "drift" and finding.end_s < end_s - _LEFT_S:
        return True  # what grows doesn't end at once
    if finding.side is Side.BEFORE:
        return finding.onset_s - start_s < _PASSES_S
    if finding.best.kind == "bias" and not finding.best.fades_s and abs(finding.turned_deg) > MOST_DEG:
        return False
    return finding.end_s - finding.onset_s < _PASSES_S and finding.end_s < end_s - _LEFT_S


def _is_cancelled(finding: Finding, found: Sequence[Finding]) -> bool:
    """Tell whether a healthy cause on its axis is about as strong: two that cancel each other explain anything."""
    length, axis = finding.last - finding.first, axis_number(finding.best.suspect)
    healthy = [other for other in found if other is not finding and all(each.is_healthy for each, _ in other.ranked)]
    healthy = [other for other in healthy if axis in other.best.axes]
    return any(
        other.evidence > _AS_STRONG * finding.evidence
        and min(other.last, finding.last) - max(other.first, finding.first) > _BESIDE * length
        for other in healthy
    )


def _late(flight: Flight, finding: Finding) -> list[str]:
    """Name nobody for what shows only over far longer than is known before it: a model errs a little, all the time."""
    known_s, shows_s = finding.onset_s - flight.blocks.start_s, finding.shows_s - finding.onset_s
    if finding.side is Side.BEFORE or shows_s <= _TIMES_AS_LONG * known_s:
        return []
    return [f"it shows after {shows_s:.0f} s, and {known_s:.0f} s are known before it"]


def _never_read(flight: Flight, finding: Finding) -> list[str]:
    """Name nobody for a gyro that reads one value: it stands, or was never a sensor's."""
    if not finding.best.of_turns:
        return []
    inside = blocks_of_cells(finding.first, finding.last, len(flight))
    stands = flight.blocks.held_s[inside, axis_number(finding.best.suspect)] > 0.0
    return [f"{finding.best.suspect} reads one value"] if stands.mean() > _HALF else []


def _short(finding: Finding) -> list[str]:
    if finding.end_s - finding.onset_s >= _SHORTEST_S:
        return []
    return [f"it lasts {finding.end_s - finding.onset_s:.0f} s"]


def _seldom(model: Model, finding: Finding) -> list[str]:
    flight = model.flight
    if not finding.best.is_gain or flight.gyro_step_s * _OFTEN <= flight.blocks.period_s:
        return []
    return [f"gyros are sampled every {flight.gyro_step_s:.2g} s, too seldom for a factor"]


def _is_own_noise(model: Model, finding: Finding) -> list[str]:
    """Doubt a gain of one to one before or behind: there a gyro's own noise explains itself."""
    axis = axis_number(finding.best.suspect)
    is_watched = finding.best.suspect in GYROS or finding.best.suspect in ATTITUDE
    known = constants_of_gyro(model, axis) if finding.best.kind == "scale" and is_watched else None
    if known is None or min(abs(1.0 - known[1]), abs(1.0 - known[1] - finding.size)) > MIRROR:
        return []
    return [f"{finding.best.suspect} and the attitude show no one motion"]


def _sides(finding: Finding) -> list[str]:
    """Name nobody where either side of a change may be the broken one: a healthy one would be called failed."""
    return [f"{finding.best.suspect} is off before or after it"] if finding.side is Side.OPEN else []


def _learns(model: Model, finding: Finding) -> list[str]:
    """Doubt a slow drift beside an estimator: one that learns a gyro's offset shows the same as it learns."""
    reached = finding.reached_deg_s
    if finding.best.kind != "drift" or not model.flight.is_driven or reached > _LEARNT_DEG_S:
        return []
    return [f"{finding.best.suspect} drifts by {reached:.1f} deg/s, as an estimator does that learns its offset"]


def _follows(model: Model, finding: Finding) -> list[str]:
    """Name nobody beside an angle that may follow the gyros: it is an estimator's, and no sensor of its own."""
    angles = [name for name in finding.suspects if name in ATTITUDE]
    return [f"{' and '.join(angles)} may follow the gyros"] if model.flight.is_driven and angles else []


def _twin(model: Model, finding: Finding, found: Sequence[Finding]) -> tuple[str, ...]:
    """Give the gyro of the other IMU of two, where no attitude tells which of both it is.

    An estimator that one of them drives is bent so far by its error that no signature tells what it does then.
    """
    flight, best = model.flight, finding.best
    if len(flight.compared) != 1 or not flight.is_driven or not finding.parts_imus or best.kind == "noise":
        return ()
    axis, (imu,) = axis_number(best.suspect), flight.compared
    watched, further = GYROS[axis], imu.channels[axis]
    bends = max(_bend_deg(model, finding, fades_s, of=watched) for fades_s in TIMES_S)
    is_restless = not best.fades_s and _is_restless(model, finding, found)
    if "attitude" not in {name for name, _, _ in finding.shown_by}:
        is_open = best.is_gain or (bends > _FAR_DEG and (is_restless or not _stays(model, finding)))
    else:  # one that follows the other IMU shows a gain of either alike, until it is bent so far that all axes do
        is_open = is_restless or (best.is_gain and not best.fades_s and bends < BENT_DEG)
    return (further if best.suspect == watched else watched,) if is_open else ()


def _own_angle(model: Model, finding: Finding) -> tuple[str, ...]:
    """Give the angle that runs as far as its gyro's error turns, or far: one of its own would stay, were it right.

    An angle that is off by more than a flight could hide explains nothing by itself (`explanations/angle.py`), so that
    the gyro alone would be left.
    """
    flight, best, axis = model.flight, finding.best, axis_number(finding.best.suspect)
    if best.suspect not in GYROS or axis == YAW or (flight.is_driven and not flight.is_assumed):
        return ()
    about = max(round(_ABOUT_S / flight.blocks.period_s), 1)
    first, last, angle = finding.first * CELL, finding.last * CELL, flight.angles[:, axis]
    ran_deg = angle[max(last - about, first) : last].mean() - angle[max(first - about, 0) : first + 1].mean()
    far_deg = _HALF * abs(finding.turned_deg) if best.fades_s else min(_HALF * abs(finding.turned_deg), MOST_DEG)
    is_as_far = -ran_deg * np.sign(finding.turned_deg) > far_deg > _HALF * BENT_DEG
    return (ATTITUDE[axis],) if is_as_far else ()


def _tipped(flight: Flight, finding: Finding) -> tuple[str, ...]:
    """Give bank or pitch where it reads far from level for most of a span, and more often than elsewhere.

    Both tell what every gyro should read: upside down, q and r seem to have the other sign, and a gain about another
    axis is made by half as much. Who flies so is rare, and an angle that is off so far explains nothing by itself
    (`explanations/angle.py`).
    """
    if finding.best.kind == "noise" or finding.best.fades_s or (flight.is_driven and not flight.is_assumed):
        return ()  # one that follows its gyro is bent by it
    inside = blocks_of_cells(finding.first, finding.last, len(flight))
    here, rest = (flight.angles[part & flight.judged] for part in (inside, ~inside))
    if not len(here) or not len(rest):
        return ()
    far, elsewhere = (
        np.mean(np.cos(np.radians(part)) < np.cos(np.radians(_TIPPED_DEG)), axis=0) for part in (here, rest)
    )
    tipped = (far > _HALF) & (far > elsewhere)
    if finding.best.is_gain:
        turned = np.abs(np.median(here, axis=0) - np.median(rest, axis=0)) > _HALF * _TIPPED_DEG
        turned[0] &= axis_number(finding.best.suspect) != 0  # what p should read, the pitch tells, and not the bank
        tipped |= turned
    return tuple(name for angle, name in enumerate(ATTITUDE) if angle != YAW and tipped[angle])


def _is_restless(model: Model, finding: Finding, found: Sequence[Finding]) -> bool:
    """Tell whether gyros and attitude agree less about other axes than they do outside, or more was found of them.

    A gyro that no attitude follows leaves other axes as they are. References that turn an attitude back don't: it
    follows the other IMU, which is the broken one.
    """
    others = [other for other in found if other is not finding and other.meets(finding.first, finding.last)]
    if any(name == "attitude" for other in others for name, _, _ in other.shown_by):
        return True
    second = np.ones(max(round(1.0 / model.flight.blocks.period_s), 1))
    inside = blocks_of_cells(finding.first, finding.last, len(model.flight))
    for axis in {*range(len(GYROS))} - {axis_number(finding.best.suspect)}:
        sums = model.own_axis(axis)
        if sums is not None:
            equation = sums.products.equation
            squares = np.convolve(equation.left / equation.level * equation.known, second, "same") ** 2
            here, elsewhere = (np.mean(squares[part & equation.known]) for part in (inside, ~inside))
            if not here < _RESTLESS**2 * elsewhere:
                return True
    return False


def _stays(model: Model, finding: Finding) -> bool:
    """Tell whether a gyro and the attitude still agree when references have turned back what an error bent.

    Heading is corrected too slowly for that.
    """
    axis, size_deg_s = axis_number(finding.best.suspect), finding.reached_deg_s
    sums, period_s = model.own_axis(axis), model.flight.blocks.period_s
    if sums is None or axis == YAW or not size_deg_s:
        return False
    left, known = sums.products.equation.left, sums.products.equation.known
    onset = finding.first * CELL
    before = slice(max(onset - round(_LATE_S[0] / period_s), 0), onset)
    late = slice(onset + round(_LATE_S[0] / period_s), min(onset + round(_LATE_S[1] / period_s), finding.last * CELL))
    if min(np.count_nonzero(known[part]) for part in (before, late)) * period_s < 0.5 * _LATE_S[0]:
        return False
    shift = left[late][known[late]].mean() - left[before][known[before]].mean()
    return bool(abs(shift) < _STAYS * size_deg_s)


def _gain_between(model: Model, finding: Finding) -> list[str]:
    """Doubt a gain that IMUs show of each other where their noise may make it."""
    if not (finding.best.is_gain and finding.parts_imus):
        return []
    axis, flight = axis_number(finding.best.suspect), model.flight
    inside = blocks_of_cells(finding.first, finding.last, len(flight))
    shown = {name for name, _, _ in finding.shown_by}
    own = [imu for imu in flight.compared if relation_of(imu) in shown]
    if any(_bears_out(finding, change(flight, imu, axis, inside)) for imu in own):
        return []
    return [f"noise of {finding.best.suspect}, or of another IMU, may do the same"]


def _leaks(finding: Finding, found: Sequence[Finding]) -> list[str]:
    """Doubt an offset beside a far larger one about another axis: axes are never quite square to each other."""
    axis, reached = axis_number(finding.best.suspect), finding.reached_deg_s
    for other in found:
        is_beside = axis_number(other.best.suspect) not in (-1, axis) and other.meets(finding.first, finding.last)
        if other is not finding and is_beside and 0.0 < reached < _ASKEW * other.reached_deg_s:
            return [f"{other.best.suspect} is off so far that it shows about this axis, too"]
    return []


def _of_other(finding: Finding, found: Sequence[Finding]) -> list[str]:
    """Name neither gyro nor angle where both seem to fail at once: one is what the other's signature leaves."""
    axis, suspect = axis_number(finding.best.suspect), finding.best.suspect
    for other in found:
        is_twin = axis_number(other.best.suspect) == axis and (other.best.suspect in ATTITUDE) != (suspect in ATTITUDE)
        is_at_once = abs(other.onset_s - finding.onset_s) < _AT_ONCE_S
        is_sure = other.is_frozen or NOISE in (other.best.kind, finding.best.kind)
        if is_twin and is_at_once and not is_sure and other.evidence > _AS_STRONG * finding.evidence:
            return [f"{other.best.suspect} seems to fail with it, and one may be what the other leaves"]
    return []


def _outvoted(model: Model, finding: Finding) -> list[str]:
    """Doubt a gyro of three IMUs where the other two don't agree, or it doesn't part from both."""
    flight, best = model.flight, finding.best
    if len(flight.compared) < _VOTERS or not finding.parts_imus or best.kind == "noise":
        return []
    axis, inside = axis_number(best.suspect), blocks_of_cells(finding.first, finding.last, len(flight))
    far = apart(flight, axis, inside)
    most = float(np.nanmax(far, initial=0.0))
    own = np.array([best.suspect in imu.channels for imu in flight.compared])
    parts = far > _PARTS * most
    is_alone = bool((parts == own).all()) if own.any() else bool(parts[np.isfinite(far)].all())
    return [] if is_alone else ["more than one of the IMUs parts from the others"]


def _shaken(model: Model, finding: Finding) -> list[str]:
    """Doubt noise that leaves the means of IMUs as they are: it is what shakes one more than another."""
    flight = model.flight
    if finding.best.kind != "noise" or not flight.compared:
        return []
    axis, inside = axis_number(finding.best.suspect), blocks_of_cells(finding.first, finding.last, len(flight))
    own = [imu for imu in flight.compared if finding.best.suspect in (*imu.channels, GYROS[axis])]
    if all(means_part(flight, imu, axis, inside) for imu in own):
        return []
    return ["the means of the IMUs agree, and only noise differs: vibration"]


def _shakes_all(flight: Flight, finding: Finding) -> list[str]:
    """Doubt noise of a gyro where others got rougher by a part of as much: what shakes all shows in the quietest most.

    A relation of logarithms can't tell: the same shaking is a larger part of what a quiet gyro usually has. Nor does it
    know of a frame that shakes about one axis: accelerometers feel that, and no gyro's noise.
    """
    if finding.best.kind != "noise" or finding.best.suspect not in GYROS:
        return []
    inside, axis = blocks_of_cells(finding.first, finding.last, len(flight)), axis_number(finding.best.suspect)
    rises, usual = _rises(flight, np.exp(log_rough(flight)), inside)
    if np.delete((rises > _SHARED * rises[axis]) & (rises > _ROUGHER * usual), axis).any():
        return ["other gyros are rougher, too: vibration"]
    if flight.felt_rough is None:
        return []
    rises, usual = _rises(flight, over_second(flight, flight.felt_rough), inside)
    return ["the accelerometers are rougher, too: vibration"] if (rises > _ROUGHER * usual).any() else []


def _rises(flight: Flight, rough: FloatArray, inside: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much roughness in motion is more within a span than elsewhere, and what it is there; else 0."""
    known = in_motion(flight) & np.isfinite(rough).all(axis=1)
    if not (inside & known).any() or not (~inside & known).any():
        return np.zeros(3), np.zeros(3)
    usual = np.median(rough[~inside & known], axis=0)
    return np.median(rough[inside & known], axis=0) - usual, usual


def _bears_out(finding: Finding, changed: Span) -> bool:
    """Tell whether shares of turns change as a gain of a gyro has it: y = f w, f = 1 / (1 - k)."""
    left = 1.0 - finding.size
    if finding.best.suspect not in GYROS:
        left = 1.0 / left if abs(left) > _NOTHING else np.inf
    least, most = changed if left > 1.0 else (-changed[1], -changed[0])
    return least > 0.0 and most > _HALF * abs(left - 1.0)


def _own_axis(finding: Finding) -> list[str]:
    """Ask for the own axis: standing, gravity and the others are witnesses."""
    if finding.best.kind == "noise" or finding.own_axis >= max(OWN, SHARE * finding.shown):
        return []
    return [f"{finding.best.suspect}'s own axis hardly shows it"]


def _regime(model: Model, finding: Finding) -> list[str]:
    """Judge nothing in motion that the rest of the log hasn't seen: as far as it takes to show, or all of a factor.

    A factor shows by motion alone: one of the whole flight is how its sensor is, or its reference. IMUs that part by
    far more than motion makes of how they are mounted need no other of its kind.
    """
    axis, flight = axis_number(finding.best.suspect), model.flight
    rates = np.minimum(np.abs(np.nan_to_num(flight.blocks.rates)), 400.0)
    own = rates[:, axis] if axis >= 0 else np.linalg.norm(rates, axis=1)
    lively = _over(own, max(round(LIVELY_S / flight.blocks.period_s), 1))
    last = finding.last
    if finding.lasts and not finding.best.is_gain:
        shows = int(np.ceil((finding.shows_s - flight.blocks.start_s) / model.cell_s))
        last = max(min(shows, last), finding.first + 1)
    inside = blocks_of_cells(finding.first, last, len(flight))
    there = inside & flight.judged
    turns_deg_s = np.sqrt(np.square(rates[there]).sum() / max(np.count_nonzero(there), 1))
    if finding.parts_imus and finding.reached_deg_s > _OF_TURNS * turns_deg_s:
        return []
    sides = [inside] if finding.side is Side.AFTER else [inside, ~inside]  # either may be the broken one
    if all(_is_seen(flight, lively, inside=each) for each in sides):
        return []
    return ["it moves more there than anywhere else"]


def _is_seen(flight: Flight, lively: FloatArray, *, inside: BoolArray) -> bool:
    """Tell whether an axis turns as much outside of a span as within it, for some seconds at least."""
    there, rest = inside & flight.judged, ~inside & flight.judged
    if not there.any():
        return False
    alike_s = np.count_nonzero(rest & (lively > _AS_LIVELY * np.median(lively[there]))) * flight.blocks.period_s
    return bool(alike_s >= min(_SEEN_S, _OUTSIDE * np.count_nonzero(rest) * flight.blocks.period_s))


def _over(values: FloatArray, count: int) -> FloatArray:
    """Return root mean squares about each value."""
    return np.asarray(np.sqrt(np.convolve(values**2, np.ones(count) / count, "same")))


def _bent(model: Model, finding: Finding, found: Sequence[Finding]) -> list[str]:
    """Judge no other axis while a gyro bends the attitude far, by its own estimator or by the one that is seen here.

    Where gyros drive the attitude and neither tells by which, it is the fastest: a slow one would bend it farther.
    """
    fastest_s = min(TIMES_S) if model.flight.is_driven else 0.0
    for other in found:
        fades_s = other.best.fades_s or finding.best.fades_s or fastest_s
        meets = other.meets(finding.first, finding.last)
        if other is finding or not fades_s or not (meets or _may_be_learnt(model.flight, finding, other)):
            continue
        if axis_number(other.best.suspect) == axis_number(finding.best.suspect) or _is_behind(other, finding):
            continue
        bend_deg = _bend_deg(model, other, fades_s)
        if meets and bend_deg > BENT_DEG:
            return [f"{other.best.suspect} bends the attitude by {bend_deg:.0f} deg there"]
        if not meets and bend_deg > _HALF * BENT_DEG:
            return [f"{other.best.suspect} bent the attitude by {bend_deg:.0f} deg, from which offsets may be learnt"]
    return []


def _is_behind(other: Finding, finding: Finding) -> bool:
    """Tell whether a weaker finding begins when another has long shown: it may be made by that, and doesn't make it."""
    return other.onset_range_s[0] > finding.shows_s and other.evidence < finding.evidence


def _may_be_learnt(flight: Flight, finding: Finding, other: Finding) -> bool:
    """Tell whether it is an offset that an estimator may have learnt from a fault before, and forgets but slowly."""
    comes_after = flight.is_driven and other.onset_s < finding.onset_s
    return comes_after and 0.0 < finding.reached_deg_s < _LEARNT_DEG_S


def _bend_deg(model: Model, finding: Finding, fades_s: float, of: str = "") -> float:
    """Return how far an attitude is off at most that follows a finding's gyro, or another of its error.

    0 of what no estimator follows.
    """
    name = name_of(of or finding.best.suspect, finding.best.kind, fades_s)
    place = next((place for place, each in enumerate(model.explanations) if each.name == name), None)
    if place is None:
        return 0.0
    bent = model.signatures.turned(place, finding.first, finding.last)
    return float(abs(finding.size) * np.linalg.norm(bent, axis=1).max(initial=0.0))
