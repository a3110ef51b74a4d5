"""How much of a change of the answer each suspect explains: surfaces and sensors compete on the same evidence.

Every relation is y = X theta + e, e made white. Its effects theta are those of a stretch before the change, beside
what is known of them a priori; they predict what comes after, but for a tenth of themselves. Q is the misfit since an
onset with no error, Q(k) with one of sizes k, and Q* if effects are others altogether. By 1/2 (Q - Q(k)) nats a suspect
explains the change, of 1/2 (Q - Q*) that there are. Noise that is louder since the onset counts by its own level. Of
several onsets that one is taken since which somebody explains most.

Who may be behind a change of the answer: a surface that isn't where it was commanded, or a sensor that is off.

Of either kind it is said in one way: what stands in the log is wrong by a + b x + c x', x what it reads there. A sensor
is biased by a, has another gain, or is stuck (b = 1). A surface is off by -a, lacks the share b of its command - all of
it, stuck or floating (b = 1), wherever it then is, at its end too - or follows late, by c seconds. What other relations
exclude of a sensor, by where they call it clear, is all that it may be off by here.

Which surface a change of the answer is put down to, and how it failed.

Wind shakes everything, damage changes several effects at once, and a sensor's fault looks like a deflection. So a
surface is named only where it explains most of the change, nobody else comes near, and kinematics hold. Otherwise it is
said what may be, and that nobody can tell. Who was named stays named while the aircraft is thrown about, which no
linear answer explains, unless somebody else explains most of it. Then drag isn't what it was, either, so a throttle
that comes up after a surface was named changes nothing.

Which kind of fault it has, stuck, weak, slow or off, its answer tells. b is the share of the command that is missing
and c how late it comes. A surface that is stuck answers nothing, b = 1, wherever it is; one that has lost effectiveness
answers less, at once; one that is slow answers later; a bent one answers as it did, with another zero. Where the
command hardly moved, none of it shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.surfaces.commanded import AIRSPEED, Commanded
from gtmbench.detectors.surfaces.equations import SLOW_ENGINE_S, SLOW_S, STEP_PERCENT, THROTTLE
from gtmbench.detectors.surfaces.identification import STEP_S, in_coloured_noise
from gtmbench.detectors.surfaces.whitened import ORDER, whitening
from gtmbench.values.channels import COMMANDS
from gtmbench.values.record import FloatArray

_OFF_DEG, _LACKS, _LATE_S = 10.0, 1.0, 1.0  # a surface's a, b and c: standard deviations about zero
_ANY = 1e6  # of a sensor that nothing else holds
_EXCLUDED = 0.5  # of what is excluded in 95 of 100
_ENDS = "altitude"  # a thousand feet change the answer by 3 %


@dataclass(frozen=True, kw_only=True, eq=False)
class Culprit:
    """Who may be behind it."""

    name: str  # a channel
    wrong: tuple[FloatArray, ...] = field(repr=False)  # shape (samples,): what its reading may be off by, of size one
    spread: FloatArray  # shape (wrong,): how large each may be: standard deviations about zero
    is_surface: bool

    def allows(self, sizes: FloatArray, used: tuple[int, ...]) -> bool:
        """Tell whether sizes can be: a surface doesn't answer backwards, more than all, or early."""
        found = dict(zip(used, sizes.tolist(), strict=True))
        return not self.is_surface or (0.0 <= found.get(1, 0.0) <= _MOST and found.get(2, 0.0) >= 0.0)

    @property
    def share(self) -> float:
        """By how much of an error it is worked out what that changes: of a command by all, for thrust is curved."""
        return -1.0 if self.is_surface else 1e-2

    @property
    def ways(self) -> tuple[tuple[int, ...], ...]:
        """Which of the errors may be there together."""
        return ((0,), (0, 1), (0, 2), (0, 1, 2)) if self.is_surface else ((0,), (0, 1))


_MOST = 1.3  # of a share: what is fitted is noisy


def suspects_of(commanded: Commanded, until_s: float, excluded: Mapping[str, float]) -> Iterator[Culprit]:
    """Give everybody who may be behind a change after some time.

    `excluded`, by channel: the largest error of sensors that may hide, where others call them clear, in their unit.
    """
    healthy = commanded.until(until_s)
    for name in commanded.channels:
        read, ones = commanded.column(name), np.ones(len(commanded.values))
        from_mean = read - healthy.column(name).mean()
        if name in commanded.frame.surfaces:
            slow_s, unit = (SLOW_ENGINE_S, STEP_PERCENT) if name == THROTTLE else (SLOW_S, 1.0)
            late = (read - _behind(read, np.exp(-commanded.period_s / slow_s))) / slow_s
            spread = np.array([_OFF_DEG * unit, _LACKS, _LATE_S])
            yield Culprit(name=name, wrong=(ones, from_mean, late), spread=spread, is_surface=True)
        elif name not in (*COMMANDS, _ENDS):
            most = _EXCLUDED * excluded.get(name, _ANY)
            spread = np.array([most, most / max(float(healthy.column(name).std()), 1e-9)])
            yield Culprit(name=name, wrong=(ones, from_mean), spread=spread, is_surface=False)


def _behind(values: FloatArray, pole: float) -> FloatArray:
    from scipy.signal import lfilter  # half a second to import

    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], values - values[0]) + values[0])


_DIFFER = 0.1  # of an effect: no aircraft answers quite linearly
_KNOWN_TO = 0.2  # of an effect that was identified on other flights, at other trims
_TURNS = 2  # of fitting effects and making their noise white, from what is known a priori
_LEVEL_KT, _SLOPE_KT = 1.0, 3.0  # by how much wind's mean may change from one minute to the next, and its slope
_NOTHING = 1e-9  # a division's guard


@dataclass(frozen=True, kw_only=True, eq=False)
class SuspectEvidence:
    """What a suspect explains."""

    suspect: Culprit
    nats: float  # less what each size costs
    sizes: FloatArray  # shape (wrong,): zero of what isn't used
    deviations: FloatArray  # shape (wrong,)


@dataclass(frozen=True, kw_only=True, eq=False)
class AnswerChange:
    """A change of the answer."""

    onset_s: float
    nats: float  # that there are to explain
    ranked: tuple[SuspectEvidence, ...] = field(repr=False)  # whoever explains most first

    @property
    def best(self) -> SuspectEvidence:
        """Who explains it best."""
        return self.ranked[0]

    def likely(self, nats: float, misfit: float) -> list[SuspectEvidence]:
        """Return who may be behind it: whoever explains as much as the best, but for nats and a share of its own."""
        return [each for each in self.ranked if each.nats > (1.0 - misfit) * self.best.nats - nats]


class _Error(NamedTuple):
    """An error of a suspect."""

    suspect: Culprit
    kind: int  # which of its own: 1 is a gain
    relations: Mapping[str, FloatArray]  # with a share of it


class _Sums(NamedTuple):
    """What a relation shows since an onset: normal equations of all errors' sizes, and nats that there are."""

    squares: FloatArray
    products: FloatArray
    nats: float


def change_of(
    commanded: Commanded,
    suspects: Sequence[Culprit],
    until_s: float,
    onsets_s: Sequence[float],
    effects: Mapping[str, FloatArray] | None = None,
) -> AnswerChange:
    """Return what the change is that begins at one of some onsets, and who explains it.

    `until_s`: until when the answer is as it was. `onsets_s`: the latest first. `effects`, by relation: what is known a
    priori; by default nothing.
    """
    errors = [
        _Error(each, kind, commanded.off_by(each.name, each.share * wrong).relations)
        for each in suspects
        for kind, wrong in enumerate(each.wrong)
    ]
    told = []
    for name, part in commanded.relations.items():
        relation = _Relation(commanded, name, part, until_s, None if effects is None else effects.get(name))
        told.append([*relation.sums(np.column_stack([relation.changed(each) for each in errors]), onsets_s)])
    found = [_change(commanded, suspects, onset_s, sums) for onset_s, *sums in zip(onsets_s, *told, strict=True)]
    return max(found, key=lambda each: each.best.nats)


def _change(commanded: Commanded, suspects: Sequence[Culprit], onset_s: float, sums: Sequence[_Sums]) -> AnswerChange:
    squares = np.sum([each.squares for each in sums], axis=0)
    products = np.sum([each.products for each in sums], axis=0)
    steps, first, ranked = (commanded.end_s - onset_s) / STEP_S, 0, []
    for each in suspects:
        part = slice(first, first := first + len(each.wrong))
        ranked.append(_explained(each, squares[part, part], products[part], steps))
    ranked.sort(key=lambda each: -each.nats)
    return AnswerChange(onset_s=onset_s, nats=sum(max(each.nats, 0.0) for each in sums), ranked=tuple(ranked))


class _Relation:
    """A relation, its effects by what was before a change, and what they leave behind it."""

    def __init__(
        self, commanded: Commanded, name: str, part: FloatArray, until_s: float, known: FloatArray | None
    ) -> None:
        self._name, self._part = name, part
        self._step_s = commanded.step_s(name)
        self._start_s = commanded.start_s + commanded.settled(name) * self._step_s
        self._before = before = part[: self._step(until_s)]
        self._theta, self._taps, precision = _learnt(before, known)
        white = self._white(before)[ORDER:]
        left = white[:, -1] - white[:, :-1] @ self._theta
        self._noise = max(float(np.mean(np.square(left))), 1e-300)
        precision = precision + white[:, :-1].T @ white[:, :-1] / self._noise
        precision += np.diag(1e-8 * np.diag(precision) + _NOTHING)
        differ = np.array([_LEVEL_KT, _SLOPE_KT]) if name == AIRSPEED else _DIFFER * _sizes(before, self._theta)
        self._certain = np.linalg.inv(np.linalg.inv(precision) + np.diag(np.square(differ)))

    def _step(self, time_s: float) -> int:
        return max(round((time_s - self._start_s) / self._step_s), 0)

    def _white(self, columns: FloatArray) -> FloatArray:
        from scipy.signal import lfilter  # half a second to import

        return np.asarray(lfilter(self._taps, [1.0], columns, axis=0))

    def changed(self, error: _Error) -> FloatArray:
        """Return what an error changes of what is left.

        A gain of what is itself explained multiplies what was to be read, not its noise, or noise would explain itself.
        """
        change = (error.relations[self._name] - self._part) / error.suspect.share
        explained = change[:, -1]
        if error.kind == 1 and error.suspect.name == self._name != AIRSPEED:
            made = self._part[:, :-1] @ self._theta
            explained = made - made[: len(self._before)].mean()
        return np.asarray(explained - change[:, :-1] @ self._theta)

    def sums(self, errors: FloatArray, onsets_s: Sequence[float]) -> Iterator[_Sums]:
        """Give what is shown since each onset, the latest first."""
        left = self._part[:, -1] - self._part[:, :-1] @ self._theta
        columns = np.column_stack([self._part[:, :-1], left, errors]) / np.sqrt(self._noise)
        white, end, products = self._white(columns), len(columns), np.zeros((columns.shape[1],) * 2)
        for onset_s in onsets_s:
            first = min(self._step(onset_s), len(columns))
            if self._name == AIRSPEED:
                since = self._white(_begun(columns, max(first, 1), errors.shape[1]))[first:]
                yield self._solved(since.T @ since, len(since))
                continue
            begin = min(first + ORDER, end)  # what is white before doesn't know of the onset
            products = products + white[begin:end].T @ white[begin:end]
            end = begin
            yield self._solved(products, len(white) - end)

    def _solved(self, sums: FloatArray, count: int) -> _Sums:
        causes, errors = len(self._theta), slice(len(self._theta) + 1, None)
        squares, products, whole = sums[:causes, :causes], sums[:causes, causes], float(sums[causes, causes])
        free = whole - float(products @ np.linalg.pinv(squares, hermitian=True) @ products)
        level = max(free / max(count, 1), 1.0)  # of noise that is louder
        gain = np.linalg.inv(squares / level + self._certain)
        mixed = sums[:causes, errors] / level
        nats = 0.5 * ((whole - free) / level - float(products @ gain @ products) / level**2 - causes)
        return _Sums(
            squares=sums[errors, errors] / level - mixed.T @ gain @ mixed,
            products=sums[errors, causes] / level - mixed.T @ gain @ products / level,
            nats=0.0 if self._name == AIRSPEED else nats,  # wind that is like no wind is no surface's
        )


def _learnt(before: FloatArray, known: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return effects, the filter that makes their noise white, and how certain they were a priori."""
    if known is None:
        effects = in_coloured_noise([before])
        return effects.theta, effects.taps, np.zeros((len(effects.theta),) * 2)
    theta, precision = known, np.diag(1.0 / np.square(_KNOWN_TO * _sizes(before, known)))
    for _ in range(_TURNS):
        left = before[:, -1] - before[:, :-1] @ theta
        taps = whitening(np.array([float(left[lag:] @ left[: len(left) - lag]) for lag in range(ORDER + 1)]))
        white = np.stack([np.convolve(each, taps)[ORDER : len(before)] for each in before.T], axis=-1)
        noise = max(float(np.mean(np.square(white[:, -1] - white[:, :-1] @ theta))), 1e-300)
        squares, beyond = white[:, :-1].T @ white[:, :-1], white[:, -1] - white[:, :-1] @ known
        theta = known + np.linalg.solve(squares / noise + precision, white[:, :-1].T @ beyond / noise)
    return theta, taps, precision


def _sizes(before: FloatArray, theta: FloatArray) -> FloatArray:
    """Return how large effects can be, from what they explain: two causes that are alike may cancel each other."""
    largest = before[:, -1].std() / np.maximum(np.sqrt(np.mean(np.square(before[:, :-1]), axis=0)), _NOTHING)
    return np.asarray(np.maximum(np.minimum(np.abs(theta), largest), _NOTHING))


def _begun(columns: FloatArray, first: int, errors: int) -> FloatArray:
    """Return columns of which the last, errors that add up, begin with an onset."""
    begun = columns.copy()
    begun[:first, -errors:] = 0.0
    begun[first:, -errors:] -= columns[first - 1, -errors:]
    return begun


def _explained(suspect: Culprit, squares: FloatArray, products: FloatArray, steps: float) -> SuspectEvidence:
    """Return what a suspect explains at best, in the ways that can be."""
    squares = squares + np.diag(suspect.spread**-2.0)
    unused = np.sqrt(np.diag(np.linalg.inv(squares)))
    best = SuspectEvidence(suspect=suspect, nats=-np.inf, sizes=np.zeros(len(products)), deviations=unused)
    for used in suspect.ways:
        own, aim = squares[np.ix_(used, used)], products[[*used]]
        sizes: FloatArray = np.linalg.solve(own, aim).astype(np.float64)
        nats = 0.5 * float(aim @ sizes) - 0.25 * len(used) * float(np.log(max(steps, 1.0)))
        if suspect.allows(sizes, used) and nats > best.nats:
            found, deviations = np.zeros(len(products)), unused.copy()
            found[[*used]], deviations[[*used]] = sizes, np.sqrt(np.diag(np.linalg.inv(own)))
            best = SuspectEvidence(suspect=suspect, nats=nats, sizes=found, deviations=deviations)
    return best


_DECISIVE = 3.0  # nats by which others have to explain it worse: 20 times less likely
_DECISIVE_OF_THROTTLE = 5.0  # it is looked at up to five times, and wind is no white noise
_MISFIT = 0.05  # of the evidence: what a slightly wrong effect makes; of nx the airspeed tells, which has none
_OF_CHANGE, _OF_ANOTHER = (
    0.3,
    0.5,
)  # of all that changed, which hard motion shares; of who didn't alarm, or wasn't named


def judged(
    change: AnswerChange, time_s: float, *, source: str, sensor: str = "", named: str | None = None
) -> Judgement:
    """Return the judgement of an alarm.

    `source`: the surface that alarms. `sensor`: why a sensor must have failed; "" if none must. `named`: the surface
    that was named before.
    """
    likely = _likely(change, named)
    share = _OF_CHANGE if likely[0].suspect.name == (named or source) else _OF_ANOTHER
    is_told = len(likely) == 1 and likely[0].nats > share * change.nats
    surfaces = [each for each in likely if each.suspect.is_surface]
    names = tuple(each.suspect.name for each in surfaces) or (source,)
    if sensor:
        return Judgement(time_s=time_s, sensor=None, candidates=names, doubt=sensor)
    if named is not None and (not is_told or names[0] == named):
        is_it = bool(surfaces) and names[0] == named
        kind = kind_of(surfaces[0].sizes, surfaces[0].deviations) if is_it else None
        return Judgement(time_s=time_s, sensor=named, candidates=(named,), kind=kind)
    if is_told and surfaces:
        kind = kind_of(surfaces[0].sizes, surfaces[0].deviations)
        return Judgement(time_s=time_s, sensor=names[0], candidates=names, kind=kind)
    what = "surface or wind" if len(surfaces) > 1 else "surface, wind, or a sensor of the flow"
    return Judgement(time_s=time_s, sensor=None, candidates=names, doubt=f"{what}: {' or '.join(names)}")


def _likely(change: AnswerChange, named: str | None) -> list[SuspectEvidence]:
    """Return who may be behind a change; a throttle isn't after a surface."""
    if named not in (None, THROTTLE):
        change = replace(change, ranked=tuple(each for each in change.ranked if each.suspect.name != THROTTLE))
    if change.best.suspect.name == THROTTLE:
        return change.likely(_DECISIVE_OF_THROTTLE, 0.0)
    return change.likely(_DECISIVE, _MISFIT)


_SURE = 4.0  # deviations
_KNOWN = 0.15  # of b, whose deviation has to be less: more tells neither that it changed nor that it didn't
_SMALL = 0.25  # of the command: a loss below passes for none, and one above 1 less that for all
_LEAST = 1e-3  # a deviation of a size that isn't there


def kind_of(sizes: FloatArray, deviations: FloatArray) -> str | None:
    """Return ``jam``, ``scale_factor``, ``lag``, ``bias``, or None where several would do: by a, b and c of a surface.

    >>> sure = np.array([0.1, 0.05, 0.02])
    >>> changes = {"stuck": (1.0, 0.98, 0.0), "weak": (0.0, 0.5, 0.0), "slow": (0.0, 0.1, 0.2), "off": (1.0, 0.0, 0.0)}
    >>> {what: kind_of(np.array(sizes), sure) for what, sizes in changes.items()}
    {'stuck': 'jam', 'weak': 'scale_factor', 'slow': 'lag', 'off': 'bias'}
    >>> kind_of(np.array([0.0, 0.7, 0.0]), 4.0 * sure) is None  # weak or stuck
    True
    """
    lacks = sizes[1]
    is_off, is_less, is_late = np.abs(sizes) > _SURE * np.maximum(deviations, _LEAST)
    if deviations[1] > _KNOWN:
        return None
    if is_less and abs(lacks - 1.0) < _SMALL:
        return "jam"
    if is_late and lacks < _SMALL:
        return "lag"
    if is_less and not is_late and _SMALL < lacks < 1.0 - _SMALL:
        return "scale_factor"
    return "bias" if is_off and not (is_less or is_late) else None
