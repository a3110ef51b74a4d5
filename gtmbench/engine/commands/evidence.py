"""How much of a change of the answer each suspect explains.

Every equation is y = X theta + e, e made white. A flight is divided where its effects theta change most, all equations
together. Those of the first part, known to P^-1 and to a tenth of themselves, predict the second; Q is the misfit there
with no error, Q(k) with one of sizes k, and Q* if effects are others altogether. By 1/2 (Q - Q(k)) nats a suspect
explains the change, of 1/2 (Q - Q*) that there are. Noise that is louder in the second part counts by its own level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.surfaces.identification import SETTLES_S, STEP_S, in_coloured_noise
from gtmbench.detectors.surfaces.whitened import ORDER
from gtmbench.engine.commands.commanded import Commanded
from gtmbench.engine.commands.suspects import Culprit
from gtmbench.values.record import FloatArray

_CHUNK_S = 4.0  # as closely as a flight is divided
BEFORE_S, AFTER_S = 40.0, 10.0  # the least that tells effects, and that shows a change
_CHANCE = 9.2  # of squared deviations: odds of 100 to 1
_SHARE = 1e-2  # of an error, by which it is worked out what it changes: equations are hardly curved
_DIFFER = 0.1  # of an effect: no aircraft answers quite linearly
_RIDGE, _NOTHING = 3.0, 1e-9  # a priori precision; a division's guard
_BEGUN = round(SETTLES_S / STEP_S)  # steps that filters take to settle


@dataclass(frozen=True, kw_only=True, eq=False)
class SuspectEvidence:
    """What a suspect explains."""

    suspect: Culprit
    nats: float  # less what each size costs
    # sizes, deviations, shape (wrong,): zero of what isn't used
    sizes: FloatArray
    deviations: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class AnswerChange:
    """A change of the answer."""

    # step, last: it begins at `step` and is looked at until `last`
    step: int
    last: int
    # between which steps it begins, at odds of 100 to 1: neither what was before nor what is behind
    between: tuple[int, int]
    nats: float  # that there are to explain
    ranked: tuple[SuspectEvidence, ...] = field(repr=False)  # whoever explains most first


def divided(commanded: Commanded) -> tuple[int, int, int] | None:
    """Return at which step the effects change most, and between which it may be; None of what is too short."""
    rows, told = round(_CHUNK_S / STEP_S), np.zeros(0)
    for part in commanded.steps.values():
        white = in_coloured_noise([part]).white(part)
        white = white[: len(white) // rows * rows]
        white = white / np.maximum(np.sqrt(np.mean(np.square(white), axis=0)), 1e-12)
        chunks = white.reshape(-1, rows, white.shape[1])
        before = np.cumsum(np.einsum("mki,mkj->mij", chunks, chunks), axis=0)
        whole = _misfit(before[-1])
        gained = whole - _misfit(before[:-1]) - _misfit(before[-1] - before[:-1])
        gained = gained * len(white) / np.maximum(whole, _NOTHING)
        told = gained if not len(told) else told[: len(gained)] + gained[: len(told)]
    first, last = round(BEFORE_S / _CHUNK_S), len(told) - round(AFTER_S / _CHUNK_S) - 1
    if last <= first:
        return None
    near = first + np.flatnonzero(told[first:last] > told[first:last].max() - _CHANCE)
    ends = (first + int(np.argmax(told[first:last])), int(near.min()) - 1, int(near.max()) + 1)
    step, earliest, latest = (_BEGUN + rows * (end + 1) for end in ends)
    return step, earliest, latest


def _misfit(products: FloatArray) -> FloatArray:
    """Return the squares that the best effects leave, by products of causes and, last, of what is explained."""
    inner, mixed = products[..., :-1, :-1], products[..., :-1, -1:]
    whole = inner + _RIDGE * np.eye(inner.shape[-1])
    return np.asarray(products[..., -1, -1] - (mixed * np.linalg.solve(whole, mixed)).sum(axis=(-1, -2)))


def change_of(
    commanded: Commanded, suspects: Sequence[Culprit], step: int, last: int, between: tuple[int, int]
) -> AnswerChange:
    """Return what the change at a step is, and who explains it until another."""
    own = commanded.steps
    wrong = {each.name: [commanded.off_by(each.name, _SHARE * of).steps for of in each.wrong] for each in suspects}
    nats = 0.0
    sums = {each.name: (np.diag(each.spread**-2.0), np.zeros(len(each.wrong))) for each in suspects}
    before, after = slice(0, between[0] - _BEGUN), slice(between[1] - _BEGUN, last - _BEGUN)
    for name, part in own.items():
        of = _Equation(part, before, after)
        nats += max(of.nats, 0.0)
        for each in suspects:
            errors = [
                _changed(part, off[name], of.theta, each, kind, name) for kind, off in enumerate(wrong[each.name])
            ]
            squares, products = of.explained(np.column_stack(errors))
            known = sums[each.name]
            sums[each.name] = known[0] + squares, known[1] + products
    ranked = [_explained(each, *sums[each.name], last - between[1]) for each in suspects]
    return AnswerChange(
        step=step,
        last=last,
        between=between,
        nats=nats,
        ranked=tuple(sorted(ranked, key=lambda each: -each.nats)),
    )


def _changed(
    part: FloatArray, off: FloatArray, theta: FloatArray, suspect: Culprit, kind: int, name: str
) -> FloatArray:
    """Return what an error changes of what an equation leaves.

    A gain of what is itself explained multiplies what was to be read, not its noise, or noise would explain itself.
    """
    explained = (off[:, -1] - part[:, -1]) / _SHARE
    if suspect.name == name and kind == 1:
        made = part[:, :-1] @ theta
        explained = made - made.mean()
    return np.asarray(explained - (off[:, :-1] - part[:, :-1]) @ theta / _SHARE)


class _Equation:
    """An equation, its effects by what was before a change, and what they leave behind it."""

    def __init__(self, part: FloatArray, before: slice, after: slice) -> None:
        effects = in_coloured_noise([part[before]])
        self.theta, self._effects, self._after = effects.theta, effects, after
        white = effects.white(part[before])
        left = white[:, -1] - white[:, :-1] @ self.theta
        noise = max(float(np.mean(np.square(left))), 1e-300)
        white = effects.white(part)[after.start - ORDER : after.stop - ORDER]
        self._causes, self._left = white[:, :-1], white[:, -1] - white[:, :-1] @ self.theta
        squares, products = self._causes.T @ self._causes / noise, self._causes.T @ self._left / noise
        free = float(self._left @ self._left / noise - products @ np.linalg.pinv(squares) @ products)
        self._noise = noise * max(free / len(self._left), 1.0)  # of what is louder
        squares, products = squares * noise / self._noise, products * noise / self._noise
        known = effects.white(part[before])[:, :-1]
        known = known.T @ known / noise
        known += np.diag(1e-8 * np.diag(known) + _NOTHING)
        most = part[before][:, -1].std() / np.maximum(
            np.sqrt(np.mean(np.square(part[before][:, :-1]), axis=0)), _NOTHING
        )
        differ = _DIFFER * np.minimum(np.abs(self.theta), most)  # two causes that are alike may cancel each other
        spread = np.linalg.pinv(known) + np.diag(np.square(differ))
        self._gain = np.linalg.pinv(squares + np.linalg.pinv(spread))
        self._products = products
        self.nats = 0.5 * float(products @ (np.linalg.pinv(squares) - self._gain) @ products) - 0.5 * len(self.theta)

    def explained(self, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the normal equations of the sizes of errors, whatever the effects are."""
        white = self._effects.white(errors)[self._after.start - ORDER : self._after.stop - ORDER]
        mixed = self._causes.T @ white / self._noise
        squares = white.T @ white / self._noise - mixed.T @ self._gain @ mixed
        return squares, white.T @ self._left / self._noise - mixed.T @ self._gain @ self._products


def _explained(suspect: Culprit, squares: FloatArray, products: FloatArray, steps: int) -> SuspectEvidence:
    """Return what a suspect explains at best, in the ways that can be."""
    best = SuspectEvidence(
        suspect=suspect, nats=-np.inf, sizes=np.zeros(len(products)), deviations=np.full(len(products), np.inf)
    )
    for used in suspect.ways:
        own, aim = squares[np.ix_(used, used)], products[[*used]]
        sizes: FloatArray = np.linalg.solve(own, aim).astype(np.float64)
        nats = 0.5 * float(aim @ sizes) - 0.25 * len(used) * float(np.log(steps))
        if suspect.allows(sizes, used) and nats > best.nats:
            found, deviations = np.zeros(len(products)), np.zeros(len(products))
            found[[*used]], deviations[[*used]] = sizes, np.sqrt(np.diag(np.linalg.inv(own)))
            best = SuspectEvidence(suspect=suspect, nats=nats, sizes=found, deviations=deviations)
    return best
