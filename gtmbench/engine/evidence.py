"""How much each explanation explains, over windows: likelihood ratios against no fault.

Over a window an equation is e = X d + s c + u: d by how much its constants differ from what all outside the window says
of them, c a fault's size, u white noise whose level is known but for a factor of its own. Two ratios come of that.
*Existence*, within the window, tells whether something is there:

    L = 1/2 sum_k (25 + N_k) log((25 + Q_k) / (25 + Q_k(c))),

Q_k an equation's misfit with no fault, Q_k(c) with one of size c, N_k its blocks. *Placing*, of the whole log, tells
which onset, end and explanation fits best, for all of them share one misfit without a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.engine.imus.imu import gyro_and_imu
from gtmbench.engine.model import Model, unsure
from gtmbench.engine.sums import Products, Window, WindowSums
from gtmbench.values.channels import GYROS, axis_of
from gtmbench.values.record import BoolArray, FloatArray, IntArray

PRIOR_BLOCKS = 25.0  # how many blocks the learnt level of the noise is worth in a window
_HALF = 0.5  # of the evidence: the most that witnesses add
_MOVES_DEG_S = 1.0  # the least spread of turns in which a gain is judged
MIRROR = 1.0 / 3.0  # about a gain of one to one, a factor above 3: a gyro's own noise explains itself
_PARTS, _FEWEST_PARTS = 8, 4  # of a window: what is left without the best of them counts
_WEAK = 6.0  # nats: what shows less isn't looked at by parts
_MOST_DEVIATIONS, _SURELY = 3.0, 2.0  # of a constant's prior; beyond it, of what isn't known of it, without gyros
_ROUNDS = 3  # of a size and the noise beside it
_NOTHING = 1e-9  # of information: less is rounding
_AT_ONCE = 256  # windows that are worked out together, for memory


@dataclass(frozen=True, kw_only=True, eq=False)
class Support:
    """Evidence over windows of cells, each of shape (windows, explanations) but for the first two."""

    # onset, last, shape (windows,): a fault begins at `onset` and ends before `last`
    onset: IntArray
    last: IntArray
    ratio: FloatArray = field(repr=False)  # existence, less the price; -inf where an explanation isn't possible
    total: FloatArray = field(repr=False)  # placing, less the price
    # size, deviation: in the explanation's unit
    size: FloatArray = field(repr=False)
    deviation: FloatArray = field(repr=False)
    # shape (equations, windows, explanations): existence, equation by equation; of few windows alone, for memory
    by_equation: FloatArray = field(repr=False)

    def __len__(self) -> int:
        """Return how many windows there are."""
        return len(self.onset)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """An equation over windows, its constants known from outside; signatures of all explanations."""

    misfit: FloatArray  # (windows,)
    cross: FloatArray  # (windows, explanations)
    power: FloatArray
    counts: FloatArray  # (windows,)
    constants: FloatArray  # (windows, regressors): without a fault
    doubt: FloatArray  # (windows, regressors): deviations of what is known of them
    absorbed: FloatArray  # (windows, own signatures, regressors): what constants take of each signature
    whole: _Whole


@dataclass(frozen=True, kw_only=True, eq=False)
class _Whole:
    """The same equation over the whole log, with one set of constants."""

    misfit: float  # with no fault
    blocks: float
    cross: FloatArray  # (windows, explanations)
    power: FloatArray


def evidence(
    model: Model, onset: IntArray, last: IntArray, sums: tuple[WindowSums, ...] | None = None, *, by_parts: bool = False
) -> Support:
    """Return the evidence of windows that begin at cells `onset` and end before `last`.

    `onset`, `last`, shape (windows,). `sums`: one an equation, where means are taken to wander otherwise than was
    learnt. `by_parts`: whether only that evidence counts which remains without the part of a window that shows most.
    Without it the ratio is an upper bound, at a third of the cost.
    """
    if not len(onset) or model.is_witness.all():
        return _nothing(model, onset, last)
    own = sums or model.sums
    parts = [slice(begin, begin + _AT_ONCE) for begin in range(0, len(onset), _AT_ONCE)]
    if len(parts) == 1:
        return _evidence(model, onset, last, own, by_parts=by_parts)
    found: dict[str, NDArray[Any]] = {}
    for part in parts:
        own_part = _evidence(model, onset[part], last[part], own, by_parts=by_parts)
        for name in ("onset", "last", "ratio", "total", "size", "deviation"):
            values: NDArray[Any] = getattr(own_part, name)
            empty = np.empty((len(onset), *values.shape[1:]), dtype=values.dtype)
            found.setdefault(name, empty)[part] = values
    return Support(**found, by_equation=np.zeros((0, 0, 0)))


def _evidence(model: Model, onset: IntArray, last: IntArray, sums: Sequence[WindowSums], *, by_parts: bool) -> Support:
    count = len(model.explanations)
    seen = [_seen(model, each, onset, last) for each in sums]
    misfit, counts = (
        np.array([getattr(each, name) for each in seen])[:, :, np.newaxis] for name in ("misfit", "counts")
    )
    cross, power = (np.array([getattr(each, name) for each in seen]) for name in ("cross", "power"))
    main: BoolArray = ~model.is_witness
    duration_s = (last - onset)[:, np.newaxis] * model.cell_s
    reach = model.of_explanations("reach") / duration_s
    low, high = np.maximum(model.of_explanations("low"), -reach), np.minimum(model.of_explanations("high"), reach)
    # v, by which an equation is noisier here than where it was learnt: with some blocks of v = 1 as its prior, it is
    # what the misfit says, never quieter. Without a fault first; then v and size in turn
    scale = np.maximum((PRIOR_BLOCKS + misfit) / (PRIOR_BLOCKS + counts), 1.0) * np.ones((1, 1, count))
    for _ in range(_ROUNDS):
        information = (power / scale)[main].sum(axis=0)
        # one size for all equations: sum of s'e / v over sum of s's / v, within what the fault may be
        size = np.clip((cross / scale)[main].sum(axis=0) / (information + 1e-12), low, high)
        left = np.maximum(misfit - 2.0 * size * cross + size**2 * power, 1e-9)
        scale = np.maximum((PRIOR_BLOCKS + left) / (PRIOR_BLOCKS + counts), 1.0)
    # with v integrated out the likelihood ratio is Student's: (n0 + n)/2 log((n0 + e'e) / (n0 + what is left))
    each = 0.5 * (PRIOR_BLOCKS + counts) * np.log((PRIOR_BLOCKS + misfit) / (PRIOR_BLOCKS + left))
    told = each[main].sum(axis=0)
    if by_parts:
        told = told * _lasting_share(model, onset, last, seen, scale, size, told)
    # witnesses bear out or speak against by half of what is said without them, and have no say in the size
    witnesses = np.clip(each[~main].sum(axis=0), -_HALF * np.abs(told), _HALF * np.maximum(told, 0.0))
    price = model.of_explanations("price")
    # what no fault of the kind would be has no ratio at all
    possible = (information > _NOTHING) & (np.abs(size) >= model.of_explanations("least")) & np.isfinite(price)
    possible = possible & (model.of_explanations("shortest_s") <= duration_s) & _moves(model, onset, last)
    possible = possible & _has_healthy_constants(model, seen, size)
    possible &= ~(np.abs(size - model.of_explanations("mirror")) < MIRROR)
    total = _placing(model, seen, low, high) - np.where(np.isfinite(price), price, 0.0)
    return Support(
        onset=onset,
        last=last,
        ratio=np.where(possible, told + witnesses - price, -np.inf),
        total=np.where(possible, total, -np.inf),
        size=size,
        deviation=np.where(information > _NOTHING, np.sqrt(1.0 / np.maximum(information, _NOTHING)), np.inf),
        by_equation=each,
    )


def _nothing(model: Model, onset: IntArray, last: IntArray) -> Support:
    """Return evidence where no equation has a say."""
    shape = (len(onset), len(model.explanations))
    impossible, zero = np.full(shape, -np.inf), np.zeros(shape)
    return Support(
        onset=onset,
        last=last,
        ratio=impossible,
        total=impossible,
        size=zero,
        deviation=np.full(shape, np.inf),
        by_equation=np.zeros((len(model.products), *shape)),
    )


def _placing(model: Model, seen: list[_Seen], low: FloatArray, high: FloatArray) -> FloatArray:
    """Return likelihood ratios of the whole log, with one set of constants: all windows share one misfit without."""
    wholes = [each.whole for each, is_witness in zip(seen, model.is_witness, strict=True) if not is_witness]
    misfit = np.array([each.misfit for each in wholes])[:, np.newaxis, np.newaxis]
    blocks = np.array([each.blocks for each in wholes])[:, np.newaxis, np.newaxis]
    cross, power = np.array([each.cross for each in wholes]), np.array([each.power for each in wholes])
    scale = np.maximum((PRIOR_BLOCKS + misfit) / (PRIOR_BLOCKS + blocks), 1.0)
    size = np.clip((cross / scale).sum(axis=0) / ((power / scale).sum(axis=0) + 1e-12), low, high)
    left = np.maximum(misfit - 2.0 * size * cross + size**2 * power, 1e-9)
    told = 0.5 * (PRIOR_BLOCKS + blocks) * np.log((PRIOR_BLOCKS + misfit) / (PRIOR_BLOCKS + left))
    return np.asarray(told.sum(axis=0))


def _has_healthy_constants(model: Model, seen: list[_Seen], size: FloatArray) -> BoolArray:
    """Tell beside which explanations no constant leaves what a healthy installation may have.

    A gain of one to one makes a gyro's noise explain itself, and another explanation take back the turns: two that
    cancel each other out explain anything. Where no gyro enters, a constant of which a log tells hardly anything may be
    anywhere.
    """
    found = np.ones(size.shape, dtype=bool)
    for each, products, is_witness in zip(seen, model.products, model.is_witness, strict=True):
        if not is_witness:
            own, relation = products.columns.own, products.equation.relation
            count, most = len(relation.prior), _MOST_DEVIATIONS * relation.prior
            fitted = each.constants + np.concatenate(
                [products.equation.constants, np.zeros(each.constants.shape[1] - count)]
            )
            beside = fitted[:, np.newaxis] - size[:, own, np.newaxis] * each.absorbed
            is_of_gyros = bool({*GYROS} & {*relation.channels, *relation.enters})
            most = most + (0.0 if is_of_gyros else _SURELY) * each.doubt[:, np.newaxis, :count]
            found[:, own] &= (np.abs(beside[:, :, :count]) <= most).all(axis=2)
    return found


def _moves(model: Model, onset: IntArray, last: IntArray) -> BoolArray:
    """Tell which explanations may be judged in windows: no gain of what hardly turns."""
    turns = model.turns_deg_s(onset, last)
    found = np.ones((len(onset), len(model.explanations)), dtype=bool)
    for place, each in enumerate(model.explanations):
        gyro, _ = gyro_and_imu(each.suspect)
        if each.is_gain and gyro in GYROS:
            found[:, place] = turns[:, GYROS.index(gyro)] > _MOVES_DEG_S
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class OutsideConstants:
    """What all outside of windows says of an equation's constants, less those that were learnt."""

    shift: FloatArray  # shape (windows, regressors)
    # shape (windows, regressors, regressors): how well they are known inside of a window, where they may differ a bit
    precision: FloatArray


def outside(model: Model, sums: WindowSums, onset: IntArray, last: IntArray) -> OutsideConstants:
    """Return what all outside of cells [onset, last) says of an equation's constants."""
    prior, floor, centre = _beliefs(model, sums)
    zero, end = np.zeros_like(onset), np.full_like(last, sums.cells)
    # before and behind the window: X'X and X'e, with the prior about its centre
    known = sums.known(zero, onset) + sums.known(last, end)
    spread = np.linalg.inv(known[:, 1:, 1:] + np.diag(prior))
    shift = np.einsum("wij,wj->wi", spread, known[:, 1:, 0] - prior * centre)
    # constants differ a bit within a log, by `floor`: inside they are known no better than that
    return OutsideConstants(shift=shift, precision=np.linalg.inv(spread + np.diag(floor**2)))


def _seen(model: Model, sums: WindowSums, onset: IntArray, last: IntArray) -> _Seen:
    """Return an equation over windows, its constants by what is outside."""
    own = sums.products
    begin = np.minimum(onset + 1, last)  # a cell is what a filter forgets: an onset within it would cost thousands
    # e, X and s over the window; what all outside of it says of the constants is its prior, N(shift, precision^-1)
    inside = sums.window(onset, begin, last)
    rest = outside(model, sums, onset, last)
    errors, products, cross = _shifted(inside, rest.shift)
    # constants are marginalised: e'e - e'X (X'X + P)^-1 X'e, and the same for s'e and s's. What they take of a
    # signature is `mixed_gain`
    gain = np.linalg.inv(inside.squares + rest.precision)
    mixed_gain = inside.mixed @ gain
    power = inside.power - np.vecdot(mixed_gain, inside.mixed)
    return _Seen(
        misfit=np.maximum(errors - np.einsum("wi,wij,wj->w", products, gain, products), 0.0),
        cross=_spread_out(cross - (mixed_gain @ products[..., np.newaxis])[..., 0], own, model),
        power=_spread_out(np.maximum(power, 0.0), own, model),
        counts=inside.counts,
        constants=rest.shift + np.einsum("wij,wj->wi", gain, products),
        doubt=np.sqrt(np.maximum(np.einsum("wii->wi", gain), 0.0)),
        absorbed=mixed_gain,
        whole=_whole(model, sums, inside),
    )


def _whole(model: Model, sums: WindowSums, inside: Window) -> _Whole:
    own, (prior, _, centre) = sums.products, _beliefs(model, sums)
    known = sums.known(np.zeros(1, dtype=np.int64), np.array([sums.cells]))[0]
    aim = known[1:, 0] - prior * centre
    spread = np.linalg.inv(known[1:, 1:] + np.diag(prior))
    absorbed = inside.mixed @ spread
    power = inside.power - np.vecdot(absorbed, inside.mixed)
    return _Whole(
        misfit=max(float(known[0, 0] + prior @ centre**2 - aim @ spread @ aim), 0.0),
        blocks=float(own.counts[-1]),
        cross=_spread_out(inside.cross - absorbed @ aim, own, model),
        power=_spread_out(np.maximum(power, 0.0), own, model),
    )


def _beliefs(model: Model, sums: WindowSums) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the precisions of constants a priori, by how much they may differ within a log, and what was learnt."""
    equation = sums.products.equation
    more = unsure(model.explained, equation)
    relation = equation.relation
    return (
        np.concatenate([relation.prior, more]) ** -2.0,
        np.concatenate([relation.floor, more]),
        np.concatenate([equation.constants, np.zeros(len(more))]),
    )


def _shifted(inside: Window, shift: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return e'e, X'e and s'e with X shift taken off e."""
    turned = np.einsum("wij,wj->wi", inside.squares, shift)
    power = inside.errors - 2.0 * np.einsum("wi,wi->w", shift, inside.products) + np.einsum("wi,wi->w", shift, turned)
    return power, inside.products - turned, inside.cross - (inside.mixed @ shift[..., np.newaxis])[..., 0]


def _spread_out(values: FloatArray, own: Products, model: Model) -> FloatArray:
    """Return values of an equation's signatures in the order of all explanations."""
    found = np.zeros((len(values), len(model.explanations)))
    found[:, own.columns.own] = values
    return found


def _lasting_share(
    model: Model,
    onset: IntArray,
    last: IntArray,
    seen: list[_Seen],
    scale: FloatArray,
    size: FloatArray,
    told: FloatArray,
) -> FloatArray:
    """Return which share of the evidence remains without the part of a window that shows most: one gust is no fault."""
    found = np.ones(told.shape)
    lasts = model.of_explanations("lasts").astype(bool)
    strong = np.flatnonzero((np.where(lasts, told, 0.0).max(axis=1) > _WEAK) & (last - onset - 1 >= _FEWEST_PARTS))
    if not len(strong):
        return found
    edges = np.linspace(onset[strong] + 1, last[strong], _PARTS + 1).astype(np.int64)
    first, behind = edges[:-1].ravel(), edges[1:].ravel()
    begin = np.tile(onset[strong], _PARTS)
    shares = np.zeros((_PARTS, len(strong), told.shape[1]))
    for place, sums in enumerate(model.sums):
        if not model.is_witness[place]:
            own = size[np.ix_(strong, sums.products.columns.own)]
            cross, power = _beside_constants(sums.window(begin, first, behind), seen[place], strong, own)
            cross = _spread_out(cross, sums.products, model).reshape(shares.shape)
            power = _spread_out(power, sums.products, model).reshape(shares.shape)
            shares += (2.0 * size[strong] * cross - size[strong] ** 2 * power) / scale[place, strong]
    whole = shares.sum(axis=0)
    rest = whole - shares.max(axis=0)
    found[strong] = np.where(lasts, np.clip(rest / np.maximum(whole, 1e-9), 0.0, 1.0), 1.0)
    return found


def _beside_constants(part: Window, seen: _Seen, strong: IntArray, size: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return s'e and s's of parts, e less what constants make of it that are fitted beside the fault."""
    constants = np.tile(seen.constants[strong], (_PARTS, 1))
    absorbed = np.tile(size[:, :, np.newaxis] * seen.absorbed[strong], (_PARTS, 1, 1))
    cross = part.cross - np.einsum("wsj,wj->ws", part.mixed, constants)
    return cross + np.einsum("wsj,wsj->ws", part.mixed, absorbed), part.power


def axes_of(model: Model) -> IntArray:
    """Return the axis of each explanation's suspect, 0 to 2; -1 of what is no gyro's and no angle's."""
    return np.array([axis_number(each.suspect) for each in model.explanations])


def axis_number(suspect: str) -> int:
    """Return the axis of a gyro, of whichever IMU, or an angle, 0 to 2; -1 of anything else."""
    gyro, _ = gyro_and_imu(suspect)
    own = [GYROS.index(name) for name in axis_of(gyro) if name in GYROS]
    return own[0] if own else -1
