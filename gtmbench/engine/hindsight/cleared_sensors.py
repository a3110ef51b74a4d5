"""Where gyros and angles are clear by their relation over the whole log, up to which sizes, and where nobody can tell.

A level that shifts says that something broke, and not what: its gyro and its angle aren't judged then, before the shift
or behind it, unless one of them is named. Where no level shifts, a gyro is clear from every onset from which a
shift would have shown, up to the size that would.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from gtmbench.engine.blocks import Blocks
from gtmbench.engine.hindsight.alignment import (
    Alignment,
    Jumps,
    alignment_of,
    error_level,
    gain_level,
    jumps_deg,
    noise_levels,
    noise_size,
    of_euler_rates,
)
from gtmbench.engine.hindsight.levels import (
    PROMISED_S,
    SPARE,
    WINDOWS_S,
    Shift,
    both_shift,
    shift_of,
)
from gtmbench.values.attitude_estimators import SLOWEST_S
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Span, runs
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, unjudged

_STANDS_S, OF_USUAL = 3.0, 5.0  # a sensor reads one value; times the longest that it does otherwise
_MOVES_DEG_S = 1.5  # the attitude meanwhile, or one who stands still is right
_JUMP_FLOOR_DEG = 1.0  # a smaller jump is an estimator's correction
OFTEN = 0.95  # of the onsets in a span, from which its size shows
_COARSER = 1.4  # from a stated size to the next: what is twice as bad is told apart
_MOST_OFFSET_DEG_S, _GAINS = 5.0, (0.75, 1.33)  # throughout: the limits of what is a sensor's own constant
_PULLED_DEG_S = (1.0, 1.0, 2.0)  # by references, of an estimator's attitude: so much is no gyro's failure by itself
_AT_EDGE, _MASKED = "too little is known before or behind it", "it stands, or gyros or attitude are missing"


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelChange:
    """A level that shifts: of which axis, what of it, when, and by how much."""

    axis: int
    of: str
    time_s: float
    size: float
    stays: bool = True

    @property
    def text(self) -> str:
        """Say it in words."""
        gyro = GYROS[self.axis]
        when = f"from {self.time_s:.0f} s on than before" if self.stays else f"for a time about {self.time_s:.0f} s"
        if self.of == "error":
            more = "more" if self.size > 0.0 else "less"
            return f"{gyro} reads {abs(self.size):.2g} deg/s {more}, against the attitude, {when}"
        if self.of == "gain":
            return f"{gyro} turns {100.0 * abs(self.size):.0f} % {'further' if self.size > 0.0 else 'less'} {when}"
        if self.of == "offset":
            return f"{gyro} reads {self.size:+.2g} deg/s, against the attitude, throughout"
        if self.of == "scale":
            return f"{gyro} turns {self.size:.2g} times as far as the attitude throughout"
        return f"{gyro} is {np.exp(0.5 * self.size):.2g} times as noisy, beside the other gyros, {when}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Hindsight:
    """What the relation of gyros and attitude says over a whole log."""

    # by sensor: of p, q, r, phi, theta and psi: where each is clear, and where it isn't judged
    claims: Mapping[str, tuple[SensorSpan, ...]] = field(repr=False)
    changes: tuple[LevelChange, ...] = ()  # the levels that shift


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Where a sensor failed, or may have: its axis isn't asked there.

    `is_constant`: its error is a bias or a drift, beside which an angle's jump still shows.
    """

    start_s: float
    end_s: float
    is_constant: bool = False


def hindsight_of(
    blocks: Blocks,
    *,
    is_driven: bool,
    is_sure: bool = False,
    failures: Mapping[str, Sequence[Failure]] | None = None,
) -> Hindsight:
    """Return what the relation of gyros and attitude says over a whole log.

    `is_driven`: whether the gyros drive the attitude: then their errors show late, and a wrong factor doesn't.
    `is_sure`: whether that is known, and not assumed: then references pull the attitude about in health, the heading
    most. `failures`, by sensor: of p, q, r, phi, theta and psi.

    >>> from gtmbench.engine.blocks import blocks_of
    >>> from gtmbench.values.record import Record
    >>> random = np.random.default_rng(1)
    >>> time_s = 0.1 * np.arange(1200)
    >>> level = np.column_stack([0.1 * random.standard_normal((1200, 3)), 0.02 * random.standard_normal((1200, 3))])
    >>> healthy = Record(level, channels=[*GYROS, *ATTITUDE], sample_period_s=0.1)
    >>> broken = healthy.replace("q", healthy["q"] + np.where(time_s < 16.0, 0.0, 2.0))
    >>> said = hindsight_of(blocks_of([broken]), is_driven=False)
    >>> [(change.of, change.text) for change in said.changes]
    [('error', 'q reads 2 deg/s more, against the attitude, from 16 s on than before')]
    >>> {span.state.value for span in said.claims["q"]}, said.claims["p"][1].state.value
    ({'not judged'}, 'clear')
    """
    named = {} if failures is None else failures
    failed_s = [(each.start_s, each.end_s) for spans in named.values() for each in spans]
    share, error = of_euler_rates(blocks, failed_s)
    if abs(share - 1.0) < _EULER and share > _CERTAIN * error:
        misread = unjudged(_span(blocks), "p, q, r are the rates of phi, theta, psi, not of a gyro")
        return Hindsight(claims=dict.fromkeys(JUDGED, (misread,)))
    alignment, gentle = _alignment(blocks, named)
    claims: dict[str, tuple[SensorSpan, ...]] = {}
    changes: list[LevelChange] = []
    jumps = jumps_deg(alignment, gentle)
    wanders = _PULLED_DEG_S if is_driven and is_sure else (0.0, 0.0, 0.0)
    for axis, (gyro, angle) in enumerate(_AXES):
        known = alignment.known[:, axis]
        shifts = {
            "error": shift_of(error_level(alignment, axis, known, wanders[axis]), _shown(is_driven=is_driven)),
            "noise": _noise_shift(alignment, axis, known),
        }
        if not is_driven:  # an attitude that its gyros drive turns as they say
            shifts["gain"] = shift_of(gain_level(alignment, axis, known))
        own = list(_changes(alignment, axis, shifts, is_driven=is_driven))
        changes += own
        claims[gyro] = tuple(_of_gyro(alignment, axis, shifts, own))
        claims[angle] = tuple(_of_angle(alignment, axis, Jumps(*(each[:, axis] for each in jumps)), own))
    return Hindsight(claims=claims, changes=tuple(changes))


JUDGED = (*GYROS, *ATTITUDE)
_AXES = tuple(zip(GYROS, ATTITUDE, strict=True))
_CERTAIN, _EULER = 4.0, 0.3  # deviations, and by how much of it: gyros that read Euler rates


def _alignment(blocks: Blocks, failures: Mapping[str, Sequence[Failure]]) -> tuple[Alignment, BoolArray]:
    """Return the relation where nothing failed, and whose errors tell of angles all the same, shape (blocks, 3)."""
    own = [[*failures.get(gyro, ()), *failures.get(angle, ())] for gyro, angle in _AXES]
    alignment = alignment_of(blocks, [[(each.start_s, each.end_s) for each in axis] for axis in own])
    broken = [[(each.start_s, each.end_s) for each in axis if not each.is_constant] for axis in own]
    return alignment, np.column_stack([~blocks.within(spans) for spans in broken])


def _noise_shift(alignment: Alignment, axis: int, known: BoolArray) -> Shift:
    """Return what shifts of a gyro's noise alone; where the others shift, too, it is the aircraft that shakes."""
    own, beside, others = (shift_of(level) for level in noise_levels(alignment, axis, known))
    shift = both_shift(own, beside)
    return replace(shift, rises=0.0, falls=0.0, onset=None) if others.size else shift


def _shown(*, is_driven: bool) -> FloatArray:
    """Return which share of a gyro's error shows in each window: behind the slowest estimator, what it takes back.

    The mean of 1 - exp(-t / tau) over the window.
    """
    if not is_driven:
        return np.ones(len(WINDOWS_S))
    ends = np.array(WINDOWS_S)
    decayed = np.exp(-ends / SLOWEST_S)
    return np.asarray(1.0 - SLOWEST_S * (decayed[:, 0] - decayed[:, 1]) / (ends[:, 1] - ends[:, 0]))


def _changes(alignment: Alignment, axis: int, shifts: Mapping[str, Shift], *, is_driven: bool) -> Iterator[LevelChange]:
    """Give the shifts of an axis; a gyro that becomes quieter is none."""
    start_s = alignment.blocks.start_s
    for of, shift in shifts.items():
        size = shift.rises if of == "noise" else shift.size
        if size and shift.onset is not None:
            time_s = start_s + shift.onset * alignment.chunk_s
            yield LevelChange(axis=axis, of=of, time_s=time_s, size=size, stays=shift.stays)
    offset, gain = float(alignment.offsets[axis]), float(alignment.gains[axis])
    if abs(offset) > _MOST_OFFSET_DEG_S:
        yield LevelChange(axis=axis, of="offset", time_s=start_s, size=offset)
    if not is_driven and np.isfinite(gain) and not _GAINS[0] <= gain <= _GAINS[1]:
        yield LevelChange(axis=axis, of="scale", time_s=start_s, size=gain)


def _of_gyro(
    alignment: Alignment,
    axis: int,
    shifts: Mapping[str, Shift],
    changes: Sequence[LevelChange],
) -> Iterator[SensorSpan]:
    """Give the spans in which a gyro is clear, and those in which it isn't judged."""
    held_s = alignment.blocks.held_s[:, axis]
    stands, usual_s = _standing(alignment, held_s, GYROS[axis])
    yield from stands
    start_s, end_s = _span(alignment.blocks)
    if changes:
        yield unjudged((start_s, end_s), changes[0].text)
        return
    errors = shifts["error"].bounds
    gains = shifts["gain"].bounds if "gain" in shifts else np.full(len(errors), np.inf)
    noises = noise_size(alignment, axis, shifts["noise"].bounds)
    repeats = OF_USUAL * usual_s <= PROMISED_S
    known = _chunks_known(alignment, alignment.known[:, axis])
    for first, stop, level in _as_good(errors, known):
        part = slice(first, stop)
        span = start_s + first * alignment.chunk_s, min(start_s + stop * alignment.chunk_s, end_s)
        gain = float(gains[part].max())
        if not np.isfinite(level):
            yield unjudged(span, _AT_EDGE if known[first] else _why_masked(alignment, axis, first, stop))
        elif not repeats and gain > 1.0:
            yield unjudged(span, f"{GYROS[axis]} might stand still, and that would not show")
        else:
            noise = float(noises[part].max())
            sizes = Sizes(
                error=level,
                within_s=PROMISED_S,
                factors=(1.0 - gain, 1.0 + gain) if gain < _LARGEST_GAIN else None,
                noise=noise if noise < _LARGEST_NOISE else None,
            )
            yield SensorSpan(start_s=span[0], end_s=span[1], state=State.CLEAR, sizes=sizes)


_LARGEST_GAIN, _LARGEST_NOISE = 2.0, 1e3  # a turned sign shows at the first; no gyro's noise is larger than the second


def _of_angle(alignment: Alignment, axis: int, jumps: Jumps, changes: Sequence[LevelChange]) -> Iterator[SensorSpan]:
    """Give the same of an angle: an error that stays begins with a jump that no gyro reads."""
    angle = ATTITUDE[axis]
    stands, _ = _standing(alignment, alignment.blocks.held_s[:, 3 + axis], angle)
    yield from stands
    start_s, end_s = _span(alignment.blocks)
    shifted = [change for change in changes if change.of != "noise"]
    if shifted:
        yield unjudged((start_s, end_s), shifted[0].text)
        return
    jump, usual, stay = jumps
    bounds = np.where(np.isfinite(jump), jump + SPARE * np.maximum(usual, _JUMP_FLOOR_DEG), np.inf)
    seen = np.isfinite(jump) & (jump > np.maximum(usual, _JUMP_FLOOR_DEG)) & (stay > 0.5 * jump)
    whole = bounds + np.maximum(stay - jump, 0.0)  # where samples are rare, a jump takes longer than a few blocks
    left = np.maximum.accumulate(np.where(seen, whole, 0.0))  # an angle that jumped may be wrong from there on
    worst_row = int(np.argmax(np.where(seen, jump, 0.0)))
    since_s = start_s + worst_row * alignment.blocks.period_s
    chunks = alignment.chunked(np.maximum(bounds, left))
    worst = np.where(np.isnan(chunks), 0.0, chunks).max(axis=1)
    for first, stop, level in _as_good(worst, np.isfinite(worst)):
        span = start_s + first * alignment.chunk_s, min(start_s + stop * alignment.chunk_s, end_s)
        if np.isfinite(level):
            sizes = Sizes(error=level, within_s=PROMISED_S)
            jumped = f"{angle} jumps by {jump[worst_row]:.0f} deg at {since_s:.0f} s, and no gyro turns"
            reason = jumped if seen.any() and span[1] > since_s else ""
            yield SensorSpan(start_s=span[0], end_s=span[1], state=State.CLEAR, reason=reason, sizes=sizes)
        else:
            yield unjudged(span, _why_masked(alignment, axis, first, stop))


def _standing(alignment: Alignment, held_s: FloatArray, sensor: str) -> tuple[list[SensorSpan], float]:
    """Return where a sensor reads one value while the aircraft turns, and for how long it does so otherwise."""
    blocks = alignment.blocks
    starts, ends = runs(np.asarray(held_s > 0.5 * blocks.period_s))
    lengths = np.array([held_s[stop - 1] for stop in ends.tolist()])
    others = [float(np.delete(lengths, place).max(initial=0.0)) for place in range(len(lengths))]
    spans, usual_s = [], 0.0
    for start, stop, length, other in zip(starts.tolist(), ends.tolist(), lengths.tolist(), others, strict=True):
        if length > max(_STANDS_S, OF_USUAL * other) and _turns(blocks, slice(start, stop), sensor):
            end_s = blocks.start_s + stop * blocks.period_s
            since_s = end_s - length - blocks.period_s
            spans.append(unjudged((since_s, end_s), f"{sensor} reads one value from {since_s:.1f} to {end_s:.1f} s"))
        else:
            usual_s = max(usual_s, length)
    return spans, usual_s


def _turns(blocks: Blocks, rows: slice, sensor: str) -> bool:
    """Tell whether the aircraft turns about an axis that a sensor should feel, by those that don't stand still."""
    tells = blocks.rates if sensor in GYROS else blocks.gyros
    own = np.abs(tells[rows])
    return bool(np.isfinite(own).any() and float(np.nanquantile(own, 0.75)) > _MOVES_DEG_S)


def _as_good(bounds: FloatArray, known: BoolArray) -> Iterator[tuple[int, int, float]]:
    """Give runs of chunks whose bounds are about alike, with what most of each keep; infinite ones apart.

    Most chunks are as good as the median, or a little worse; others stand in runs of their own.
    """
    finite = np.isfinite(bounds)
    usual = float(np.median(bounds[finite])) * _COARSER if finite.any() else 1.0
    steps = np.where(known, -1, -2)
    steps[finite] = np.ceil(np.maximum(np.log(np.maximum(bounds[finite], 1e-12) / usual), 0.0) / np.log(_COARSER))
    edges = [0, *(np.flatnonzero(np.diff(steps)) + 1).tolist(), len(bounds)]
    for first, stop in pairwise(edges):
        own = bounds[first:stop]
        yield first, stop, float(np.quantile(own, OFTEN, method="higher")) if steps[first] >= 0 else np.inf


def _why_masked(alignment: Alignment, axis: int, first: int, stop: int) -> str:
    """Say why nothing is asked of an axis in some chunks: what is there, and isn't asked, is of one that failed."""
    rows = slice(first * alignment.per_chunk, stop * alignment.per_chunk)
    there = np.isfinite(alignment.error[rows, axis])
    is_failed = len(there) and float(there.mean()) > 0.5 > float(alignment.known[rows, axis].mean())
    if not is_failed and there.all() and (first == 0 or rows.stop >= len(alignment.error)):
        return _AT_EDGE
    return f"{' or '.join(_AXES[axis])} failed, and nothing else tells" if is_failed else _MASKED


def _chunks_known(alignment: Alignment, known: BoolArray) -> BoolArray:
    """Tell in which chunks at least half of the blocks are known."""
    return np.asarray(np.nan_to_num(alignment.chunked(known.astype(np.float64))).mean(axis=1) >= 0.5)


def _span(blocks: Blocks) -> Span:
    return blocks.start_s, blocks.end_s
