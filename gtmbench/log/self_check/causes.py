"""Why gyros and attitude of a log don't tell of the same motion: every cause is tried, and the simplest that fits wins.

A guess is scored by the mean over the live gyros of log(what is left / the gyro's own motion), plus a fixed price for
every change that it makes: of guesses that fit alike the one with fewer changes wins.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, permutations, product

import numpy as np
from numpy.typing import NDArray

from gtmbench.log.self_check.motion import (
    LONGEST_LAG_S,
    Moments,
    Piece,
    moments,
    pieces_of,
    rates_from,
    shifted,
    slopes,
    slow_motion,
    turned,
)
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record

# in a radian
_DEG = math.degrees(1.0)
_PRICE = 0.12  # of a change: a mean log ratio
_LEAST_LAG_S = 0.06  # less is a filter's, or half a sample's
_OWN_LAG_S, _CLEAR = 0.07, 0.3  # of one gyro, which is known less well; of its motion that is explained as it is read
_FITS = 0.6  # of its motion that every live gyro is explained by where a cause is named
_ALIKE = 0.04  # scores that tell nothing apart
_WORST = 4.0  # of a variance ratio: worse is as bad
_BEST = 1e-4  # of it: better is as good
_STEPS, _LEAST_STEP_S = 5, 0.01  # of the search for a lag
_PARTS, _SHORTEST_PART_S = 16, 4.0  # of a record
_TELLS, _SAME_FIT = 0.4, 0.05  # of a gyro's motion in a part: it is read as it is; no difference
_MUCH_BETTER = 0.15  # of a gyro's motion: a guess that isn't named is a doubt
_LEAST_GAIN = 0.8  # or its inverse: healthy logs have 0.83 to 1.13, by clocks that err as much
_HELD = 3  # readings alike in a row, by the median
_STILL = 1e-6  # deg/s, deg
_LEAST_CLOCK = 1.4  # a factor, or its inverse, by which a time base is wrong: a filter costs less
_SAME_FACTOR = 1.2  # or its inverse: one factor, of all gyros
_MOST_PHI, _MOST_THETA, _USUALLY = 181.0, 91.0, 0.99  # deg: an attitude, but for so many rows
_REFINED = 6  # guesses that are tried with lags of single sensors
_ORDER = (
    "held",
    "sign",
    "unit",
    "late",
    "clock",
    "swap",
    "euler",
)  # of undoing: a swap last, the others name what was read
# of a sign, and of rad for deg or deg for rad
_GAINS = np.array([1.0, -1.0, _DEG, -_DEG, 1.0 / _DEG, -1.0 / _DEG])


@dataclass(frozen=True, kw_only=True)
class WiringChange:
    """One thing that has to be undone."""

    # ``sign``; ``unit`` (times `size`); ``swap`` (each reads as the next one, the last as the first); ``late`` (by
    # `size` seconds); ``clock`` (its steps are `size` times too long); ``held`` (each reading repeated for `size`
    # seconds); ``euler`` (the rates of phi, theta and psi instead of the body's)
    kind: str
    channels: tuple[str, ...]
    size: float = 0.0


@dataclass(frozen=True, kw_only=True)
class WiringGuess:
    """How a log may have to be read."""

    changes: tuple[WiringChange, ...]  # None: as it is
    score: float  # less is better
    # how much of each live gyro's slow motion it explains: 1 all, 0 nothing
    fits: Mapping[str, float] = field(default_factory=dict)
    # between what the gain of each live gyro on its rate lies, as it is read; of the guess without changes alone
    gains: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # by how much the rate of each live gyro is late against it, likewise; by "" that of all of them together
    lags_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def explains(self) -> bool:
        """Whether every live gyro is explained well enough for a cause to be named."""
        return bool(self.fits) and min(self.fits.values()) > _FITS


@dataclass(frozen=True, kw_only=True, eq=False)
class _Reading:
    """Angles as they may have to be read, with what that changes."""

    order: tuple[int, ...] = (0, 1, 2)
    factors: tuple[float, ...] = (1.0, 1.0, 1.0)
    late_s: Mapping[int, float] = field(default_factory=dict)

    def angles(self, pieces: Sequence[Piece]) -> list[FloatArray]:
        read = turned(pieces, self.order, self.factors)
        return shifted(read, self.late_s, pieces[0].period_s) if self.late_s else read

    @property
    def changes(self) -> tuple[WiringChange, ...]:
        made = []
        if self.order != (0, 1, 2):
            made.append(WiringChange(kind="swap", channels=tuple(ATTITUDE[i] for i in range(3) if self.order[i] != i)))
        for factor in dict.fromkeys(self.factors):
            if factor != 1.0:
                own = tuple(ATTITUDE[self.order[i]] for i in range(3) if self.factors[i] == factor)
                made.append(WiringChange(kind="unit", channels=tuple(sorted(own, key=ATTITUDE.index)), size=factor))
        made += [
            WiringChange(kind="late", channels=(ATTITUDE[self.order[column]],), size=size)
            for column, size in self.late_s.items()
        ]
        return tuple(made)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Wiring:
    """A reading of the angles, their signs, and which rate each gyro reads: what is tried with every gain and lag."""

    reading: _Reading
    signs: tuple[float, ...]
    order: tuple[int, ...]
    table: _Table
    live: tuple[int, ...]

    @property
    def changes(self) -> tuple[WiringChange, ...]:
        turned_signs = [self.reading.order[i] for i in range(3) if self.signs[i] < 0]
        swapped = [WiringChange(kind="swap", channels=_cycle(self.order))] if self.order != (0, 1, 2) else []
        return (
            *self.reading.changes,
            *(WiringChange(kind="sign", channels=(ATTITUDE[i],)) for i in turned_signs),
            *swapped,
        )

    @property
    def total(self) -> FloatArray:
        """The score's part of the gyros at every common lag."""
        return np.asarray(sum(self.table.cost[i, self.order[i]] for i in self.live)) / len(self.live)

    def read(self, reading: _Reading, pieces: Sequence[Piece]) -> _Wiring:
        """Return the same with the angles read in another way."""
        table = _Table.of(moments(pieces, reading.angles(pieces)), self.signs, len(self.live))
        return replace(self, reading=reading, table=table)

    def score(self) -> float:
        """Return the best score with a common lag, or without."""
        total, price = self.total, _PRICE * _count(self.changes)
        return price + min(float(total[self.table.now]), _PRICE + float(total.min()))

    def guess(
        self, places: Sequence[int], extra: Sequence[WiringChange] = (), scale: float = 1.0, *, plain: bool = False
    ) -> WiringGuess:
        """Return what comes of a lag a gyro, given by its place, with the best gains or, `plain`, with signs only."""
        gains, left = {}, {}
        for i in self.live:
            j, place = self.order[i], places[i]
            gain = float(self.table.gain[i, j, place])
            gains[i] = float(np.sign(gain)) if plain else gain
            left[i] = self.table.left(i, j, place, gains[i], scale)
        changes = (*self.changes, *extra, *_gain_changes(gains))
        return _guess(changes, left)


def guesses(records: Iterable[Record]) -> list[WiringGuess]:
    """Return how some records may have to be read, the likeliest first; empty where nothing moves.

    `records`: with p, q, r, phi, theta, psi.
    """
    records = list(records)
    made, held = _guesses(records), _repeated_channels(records)
    if held:
        fresh = [undone(record, held) for record in records]
        made += [_with(guess, held) for guess in _guesses(fresh)]
    best: dict[tuple[WiringChange, ...], WiringGuess] = {}
    for guess in sorted(made, key=lambda guess: guess.score):
        best.setdefault(guess.changes, guess)
    return list(best.values())


def _repeated_channels(records: Sequence[Record]) -> list[WiringChange]:
    """Return the channels whose readings are repeated: as many at a time, by the median, as it takes to be noticed."""
    changes: dict[float, list[str]] = {}
    for name in (*GYROS, *ATTITUDE) if records else ():
        runs = np.concatenate([np.diff(_fresh(record[name])) for record in records])
        length = float(np.median(runs)) if len(runs) else 1.0
        if length >= _HELD:
            changes.setdefault(length * records[0].sample_period_s, []).append(name)
    return [WiringChange(kind="held", channels=tuple(names), size=seconds) for seconds, names in changes.items()]


def _fresh(values: FloatArray) -> NDArray[np.int64]:
    """Return the rows at which a channel reads another value than before."""
    return np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)


def _with(guess: WiringGuess, changes: Sequence[WiringChange]) -> WiringGuess:
    made = tuple(sorted((*guess.changes, *changes), key=lambda change: (change.kind, change.channels)))
    return replace(guess, changes=made, score=guess.score + _PRICE * len(changes))


def _guesses(records: Sequence[Record]) -> list[WiringGuess]:
    pieces = pieces_of(records)
    if not pieces:
        return []
    wirings = [wiring for reading in _readings(pieces) for wiring in _wirings(reading, pieces)]
    if not wirings:
        return []
    wirings.sort(key=_Wiring.score)
    plain = next(wiring for wiring in wirings if not wiring.changes)
    made = [_unchanged(plain)]
    for wiring in dict.fromkeys([*wirings[:_REFINED], plain]):
        made += [*_gyros_late(wiring), *_a_little_late(wiring, pieces), *_clocks(wiring), *_angles_late(wiring, pieces)]
    return [*made, _euler_rates(pieces, plain.live)]


def _euler_rates(pieces: Sequence[Piece], live: Sequence[int]) -> WiringGuess:
    """Return the guess that what is read as gyros are the angles' own rates, in the unit that fits best."""
    gyros, rates, both = np.zeros(3), np.zeros(3), np.zeros(3)
    for piece in pieces:
        motion, _ = slow_motion(np.column_stack([piece.gyros, slopes(piece.angles, piece.period_s)]))
        y, u = motion[:, :3], motion[:, 3:]
        gyros, rates, both = gyros + np.square(y).sum(0), rates + np.square(u).sum(0), both + (y * u).sum(0)
    made = []
    for factor in (1.0, _DEG, 1.0 / _DEG):
        own = np.maximum(factor**2 * gyros, 1e-300)
        left = 1.0 - 2.0 * factor * both / own + rates / own
        changes = [WiringChange(kind="euler", channels=GYROS)]
        changes += [WiringChange(kind="unit", channels=GYROS, size=factor)] if factor != 1.0 else []
        made.append(_guess(changes, {i: float(left[i]) for i in live}))
    return min(made, key=lambda guess: guess.score)


def causes_among(tried: Sequence[WiringGuess], records: Sequence[Record]) -> list[WiringGuess]:
    """Return the guesses that are the cause of what is wrong with some records; two are either-or.

    None where nothing is wrong, where nothing makes every live gyro fit, where more than two guesses fit alike, or
    where what fits isn't in all parts of the records: what comes in half-way is a fault, not a matter of how to read.

    >>> from gtmbench.bench.flight import fly
    >>> flight = fly(excitation="multisine", duration_s=20.0, seed=1).select(["p", "q", "r", "phi", "theta", "psi"])
    >>> turned = [flight.replace("q", -flight["q"])]
    >>> [guess.changes for guess in causes_among(guesses(turned), turned)]
    [(WiringChange(kind='sign', channels=('q',), size=0.0),)]
    """
    if not tried or not tried[0].changes or not tried[0].explains:
        return []
    first = tried[0]
    alike = [
        guess
        for guess in tried
        if guess.score - first.score < _ALIKE and _count(guess.changes) <= _count(first.changes)
    ]
    is_told = len(alike) <= 2 and all(guess.changes for guess in alike)
    return alike if is_told and all(holds(guess.changes, records) for guess in alike) else []


def is_doubtful(tried: Sequence[WiringGuess], outputs: Iterable[str]) -> bool:
    """Tell whether a gyro would read much better in another way, be it that no cause can be named."""
    as_read = next((guess.fits for guess in tried if not guess.changes), {})
    best = tried[0].fits if tried else {}
    return any(best.get(name, 0.0) > max(_FITS, as_read.get(name, 0.0) + _MUCH_BETTER) for name in outputs)


def other_scales(tried: Sequence[WiringGuess]) -> dict[str, tuple[float, float]]:
    """Return the gyros that turn much less, or more, than their attitude, and between what their gain on it lies.

    >>> from gtmbench.bench.flight import fly
    >>> flight = fly(excitation="multisine", duration_s=20.0, seed=1).select(["p", "q", "r", "phi", "theta", "psi"])
    >>> small = flight.replace("q", 0.7 * flight["q"])
    >>> [(name, round(low, 2), round(high, 2)) for name, (low, high) in other_scales(guesses([small])).items()]
    [('q', 0.71, 0.71)]
    """
    gains = next((guess.gains for guess in tried if not guess.changes), {})
    return {name: (low, high) for name, (low, high) in gains.items() if high < _LEAST_GAIN or low > 1.0 / _LEAST_GAIN}


def small_lags_s(tried: Sequence[WiringGuess]) -> dict[str, float]:
    """Return by how much the attitude is late against some gyros, or they against it (less than 0): by "" all of them.

    Such a lag is a part of a sample, or hardly more than a filter's: it is no cause that could be named, and yet is
    there. Samples that come seldom tell it by the top of the correlation between them.

    >>> from gtmbench.bench.flight import fly
    >>> flight = fly(excitation="multisine", duration_s=40.0, seed=1).select(["p", "q", "r", "phi", "theta", "psi"])
    >>> late = flight
    >>> for name in ("phi", "theta"):
    ...     late = late.replace(name, np.interp(late.time_s - 0.09, late.time_s, late[name]))
    >>> {name: round(lag_s, 2) for name, lag_s in small_lags_s(guesses([late])).items()}
    {'p': 0.09, 'q': 0.09}
    """
    told = next((guess for guess in tried if not guess.changes), None)
    if told is None:
        return {}
    clear = {name for name, fit in told.fits.items() if fit > _CLEAR}
    if clear == told.fits.keys() and abs(told.lags_s.get("", 0.0)) >= _LEAST_LAG_S:
        return {"": told.lags_s[""]}
    return {name: told.lags_s[name] for name in GYROS if name in clear and abs(told.lags_s[name]) >= _OWN_LAG_S}


def holds(changes: Sequence[WiringChange], records: Sequence[Record]) -> bool:
    """Tell whether some changes are in all of some records: no part has what they concern explained as it is."""
    parts = [part for record in records for part in _parts(record)]
    return not any(_is_right(part, undone(part, changes)) for part in parts)


def _is_right(part: Record, mended: Record) -> bool:
    """Tell whether the gyros that a change concerns are explained as they are, and better than with it undone."""
    as_read, better = as_it_is([part]), as_it_is([mended])
    if as_read is None or better is None:
        return False
    common = as_read.fits.keys() & better.fits.keys()
    concerned = [name for name in common if abs(as_read.fits[name] - better.fits[name]) > _SAME_FIT]
    return as_read.score < better.score and bool(concerned) and min(as_read.fits[name] for name in concerned) > _TELLS


def _parts(record: Record) -> list[Record]:
    count = max(1, min(_PARTS, int((record.end_s - record.start_s) / _SHORTEST_PART_S)))
    edges = np.linspace(record.start_s, record.end_s, count + 1)
    return [record.between(first, last) for first, last in pairwise(edges.tolist())]


def as_it_is(records: Iterable[Record]) -> WiringGuess | None:
    """Return the guess that records read as they are; None where nothing moves."""
    pieces = pieces_of(records)
    wirings = _wirings(_Reading(), pieces) if pieces else []
    return _unchanged(wirings[0]) if wirings else None


def undone(record: Record, changes: Iterable[WiringChange]) -> Record:
    """Return a record as it would read without some changes.

    >>> record = Record([[1.0, 5.0], [2.0, 6.0], [3.0, 7.0]], channels=["p", "q"], sample_period_s=0.1)
    >>> swapped, turned = WiringChange(kind="swap", channels=("p", "q")), WiringChange(kind="sign", channels=("p",))
    >>> undone(record, [swapped, turned])["q"]
    array([-1., -2., -3.])
    """
    for change in sorted(changes, key=lambda change: _ORDER.index(change.kind)):
        record = _without(record, change)
    return record


def _without(record: Record, change: WiringChange) -> Record:
    columns = {name: record[name] for name in change.channels if name in record}
    if change.kind == "clock":
        return Record(
            record.values,
            channels=record.channels,
            sample_period_s=record.sample_period_s / change.size,
            start_s=record.start_s,
        )
    if change.kind == "swap":
        last, *others = change.channels[-1:] + change.channels[:-1]
        columns = {name: record[before] for name, before in zip(change.channels, (last, *others), strict=True)}
    elif change.kind == "euler":
        columns = _body_rates(record)
    elif change.kind == "held":
        for name, values in columns.items():
            rows = _fresh(values)
            columns[name] = np.interp(np.arange(len(values)), rows, values[rows])
    elif change.kind == "late":
        at_s = record.time_s + change.size
        columns = {name: np.interp(at_s, record.time_s, values, right=np.nan) for name, values in columns.items()}
    else:
        factor = -1.0 if change.kind == "sign" else change.size
        columns = {name: factor * values for name, values in columns.items()}
    for name, values in columns.items():
        record = record.replace(name, values)
    return record


def _body_rates(record: Record) -> dict[str, FloatArray]:
    """Return what p, q and r are where they read the rates of phi, theta and psi."""
    phi, theta = np.deg2rad(record["phi"]), np.deg2rad(record["theta"])
    rolling, pitching, heading = (record[name] for name in GYROS)
    return {
        "p": rolling - heading * np.sin(theta),
        "q": pitching * np.cos(phi) + heading * np.cos(theta) * np.sin(phi),
        "r": heading * np.cos(theta) * np.cos(phi) - pitching * np.sin(phi),
    }


def _readings(pieces: Sequence[Piece]) -> list[_Reading]:
    """Return the orders and units of the angles that are possible: no pitch is beyond 90 deg, no bank beyond 180."""
    units = [(1.0, 1.0, 1.0)]
    for factor in (_DEG, 1.0 / _DEG):
        units += [(factor,) * 3, (factor, 1.0, 1.0), (1.0, factor, 1.0), (1.0, 1.0, factor)]
    most = np.nanquantile(np.abs(np.concatenate([piece.angles for piece in pieces])), _USUALLY, axis=0)
    readings = [_Reading(order=order, factors=factors) for order in ((0, 1, 2), (1, 0, 2)) for factors in units]

    def is_possible(reading: _Reading) -> bool:
        phi, theta = (most[reading.order[i]] * reading.factors[i] for i in (0, 1))
        return bool(phi <= _MOST_PHI and theta <= _MOST_THETA)

    return [_Reading(), *filter(is_possible, readings[1:])]


def _wirings(reading: _Reading, pieces: Sequence[Piece]) -> list[_Wiring]:
    of = moments(pieces, reading.angles(pieces))
    live = tuple(i for i in range(3) if of.gyros[i] > _STILL**2)
    if not live:
        return []
    return [
        _Wiring(reading=reading, signs=signs, order=order, table=table, live=live)
        for signs in product((1.0, -1.0), repeat=3)
        for table in [_Table.of(of, signs, len(live))]
        for order in permutations(range(3))
    ]


def _unchanged(wiring: _Wiring) -> WiringGuess:
    table, live = wiring.table, wiring.live
    left = {i: table.left(i, i, table.now, 1.0) for i in live}
    lags_s = {GYROS[i]: table.between([i], wiring.order, int(np.argmin(table.cost[i, i]))) for i in live}
    lags_s[""] = table.between(live, wiring.order, int(np.argmin(wiring.total)))
    return replace(_guess((), left), gains={GYROS[i]: table.gains_between(i) for i in live}, lags_s=lags_s)


def _gyros_late(wiring: _Wiring) -> list[WiringGuess]:
    """Return the guesses without a lag, with one of all, and with one gyro late."""
    table = wiring.table
    now = [table.now] * 3
    made = [wiring.guess(now)]
    far, early = np.abs(table.lags_s) >= _LEAST_LAG_S, table.lags_s <= -_LEAST_LAG_S
    if far.any():
        place = int(np.flatnonzero(far)[np.argmin(wiring.total[far])])
        lag_s = table.between(wiring.live, wiring.order, place)
        made.append(
            wiring.guess(
                [place] * 3, [WiringChange(kind="late", channels=ATTITUDE if lag_s > 0 else GYROS, size=abs(lag_s))]
            )
        )
    for i in wiring.live if early.any() else ():
        places = list(now)
        places[i] = int(np.flatnonzero(early)[np.argmin(table.cost[i, wiring.order[i]][early])])
        lag_s = table.between([i], wiring.order, places[i])
        made.append(wiring.guess(places, [WiringChange(kind="late", channels=(GYROS[i],), size=abs(lag_s))]))
    return made


def _a_little_late(wiring: _Wiring, pieces: Sequence[Piece]) -> list[WiringGuess]:
    """Return the guess of a common lag that is less than a sample, where samples come so seldom that it counts."""
    table = wiring.table
    lag_s = table.between(wiring.live, wiring.order, table.now)
    if abs(lag_s) < _LEAST_LAG_S or int(np.argmin(wiring.total)) != table.now:
        return []
    late = wiring.read(replace(wiring.reading, late_s=dict.fromkeys(range(3), lag_s)), pieces)
    change = WiringChange(kind="late", channels=ATTITUDE if lag_s > 0 else GYROS, size=abs(lag_s))
    return [replace(late, reading=wiring.reading).guess([late.table.now] * 3, [change])]


def _clocks(wiring: _Wiring) -> list[WiringGuess]:
    """Return the guess that the time base is wrong, where all gyros say by the same factor, and no unit's."""
    table, order = wiring.table, wiring.order
    if len(wiring.live) < 2 or set(wiring.reading.factors) != {1.0}:
        return []
    rates = np.array([table.rates[order[i]] for i in wiring.live])
    covariances = np.abs([table.covariance[i, order[i], table.now] for i in wiring.live])
    if not (rates > 0).all() or not (covariances > 0).all():
        return []
    ratios = covariances / rates
    factor = float(np.median(ratios))
    is_usual = 1.0 / _LEAST_CLOCK < factor < _LEAST_CLOCK
    is_unit = any(1.0 / _SAME_FACTOR < factor / unit < _SAME_FACTOR for unit in (_DEG, 1.0 / _DEG))
    if is_usual or is_unit or not (ratios / factor < _SAME_FACTOR).all() or not (factor / ratios < _SAME_FACTOR).all():
        return []
    clock = WiringChange(kind="clock", channels=("time",), size=factor)
    return [wiring.guess([table.now] * 3, [clock], factor, plain=True)]


def _angles_late(wiring: _Wiring, pieces: Sequence[Piece]) -> list[WiringGuess]:
    """Return the guesses that one angle is late, by what the gyro that it turns says, step by step."""
    made = []
    for i in wiring.live:
        j, late, lag_s = wiring.order[i], wiring, 0.0
        for _ in range(_STEPS):
            more_s = late.table.best_lag(i, j, -lag_s)
            if abs(more_s) < _LEAST_STEP_S:
                break
            lag_s = min(lag_s + more_s, LONGEST_LAG_S)
            if lag_s < _LEAST_LAG_S:
                break
            late = wiring.read(replace(wiring.reading, late_s={j: lag_s}), pieces)
        if late is not wiring and lag_s >= _LEAST_LAG_S:
            made.append(late.guess([late.table.now] * 3))
    return made


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    """Gyro i read as rate j at a lag: the log of what is left with the best gain, with its price, and that gain."""

    cost: FloatArray = field(repr=False)  # shape (3, 3, lags)
    gain: FloatArray = field(repr=False)
    covariance: FloatArray = field(repr=False)
    gyros: FloatArray  # mean squares
    rates: FloatArray
    lags_s: FloatArray = field(repr=False)

    @classmethod
    def of(cls, of: Moments, signs: Sequence[float], live: int) -> _Table:
        mixed = rates_from(signs)
        covariance = np.einsum("gtl,tj->gjl", of.cross, mixed)
        rates = np.einsum("tj,ts,sj->j", mixed, of.terms, mixed)
        own = np.maximum(of.gyros, 1e-200)[:, np.newaxis, np.newaxis]
        gains = _GAINS[:, np.newaxis, np.newaxis, np.newaxis]
        left = 1.0 - 2.0 * covariance / (gains * own) + rates[:, np.newaxis] / (gains**2 * own)
        price = _PRICE * live * ((gains < 0) + (np.abs(np.log(np.abs(gains))) > 1.0))
        costs = np.log(np.clip(left, _BEST, _WORST)) / 2.0 + price
        best = np.argmin(costs, axis=0)
        return cls(
            cost=np.take_along_axis(costs, best[np.newaxis], axis=0)[0],
            gain=_GAINS[best],
            covariance=covariance,
            gyros=of.gyros,
            rates=rates,
            lags_s=of.lags_s,
        )

    @property
    def now(self) -> int:
        """The place of no lag."""
        return len(self.lags_s) // 2

    def left(self, i: int, j: int, place: int, gain: float, scale: float = 1.0) -> float:
        """Return the mean square of (gain y - scale u) over that of gain y: gyro i read as rate j."""
        ratio = scale / gain
        own = max(float(self.gyros[i]), 1e-300)
        return float(1.0 - 2.0 * ratio * self.covariance[i, j, place] / own + ratio**2 * self.rates[j] / own)

    def gains_between(self, i: int) -> tuple[float, float]:
        """Return between what gyro i's gain on its rate lies: the rate's noise lowers one, its own raises the other."""
        both = float(self.covariance[i, i, self.now])
        return both / max(float(self.rates[i]), 1e-300), float(self.gyros[i]) / both if both > 0.0 else math.inf

    def best_lag(self, i: int, j: int, least_s: float) -> float:
        """Return by how much rate j has to come earlier to fit gyro i best, not less than told."""
        there = np.flatnonzero(self.lags_s > least_s - 1e-9)
        cost = self.cost[i, j, there]
        return self.between([i], {i: j}, int(there[np.argmin(cost)]))

    def between(self, live: Sequence[int], order: Sequence[int] | Mapping[int, int], place: int) -> float:
        """Return a lag between samples: the top of the parabola through the correlations beside a place."""
        lags_s = self.lags_s
        if not 0 < place < len(lags_s) - 1:
            return float(lags_s[place])
        beside = slice(place - 1, place + 2)
        alike = sum(
            np.sign(self.gain[i, order[i], place])
            * self.covariance[i, order[i], beside]
            / math.sqrt(max(self.gyros[i] * self.rates[order[i]], 1e-300))
            for i in live
        )
        before, at, after = np.asarray(alike).tolist()
        bend = before - 2.0 * at + after
        aside = min(max(0.5 * (before - after) / bend, -0.5), 0.5) if bend < 0 else 0.0
        return float(lags_s[place] + aside * (lags_s[1] - lags_s[0]))


def _guess(changes: Sequence[WiringChange], left: Mapping[int, float]) -> WiringGuess:
    logs = [math.log(min(max(each, _BEST), _WORST)) / 2.0 for each in left.values()]
    return WiringGuess(
        changes=tuple(sorted(changes, key=lambda change: (change.kind, change.channels))),
        score=sum(logs) / len(logs) + _PRICE * _count(changes),
        fits={GYROS[i]: 1.0 - math.sqrt(max(each, 0.0)) for i, each in left.items()},
    )


def _count(changes: Sequence[WiringChange]) -> int:
    """Return how many changes some are: three sensors that have changed places did so twice."""
    return sum(2 if change.kind == "swap" and len(change.channels) > 2 else 1 for change in changes)


def _gain_changes(gains: Mapping[int, float]) -> list[WiringChange]:
    changes = [WiringChange(kind="sign", channels=(GYROS[i],)) for i, gain in gains.items() if gain < 0]
    for factor in (_DEG, 1.0 / _DEG):
        own = [GYROS[i] for i, gain in gains.items() if math.isclose(abs(gain), factor)]
        if len(own) == len(gains) > 1:
            changes.append(WiringChange(kind="unit", channels=tuple(own), size=factor))
        else:
            changes += [WiringChange(kind="unit", channels=(name,), size=factor) for name in own]
    return changes


def _cycle(order: Sequence[int]) -> tuple[str, ...]:
    """Return the gyros that have changed places: each reads the rate of the next."""
    start = next(i for i in range(3) if order[i] != i)
    cycle = [start]
    while order[cycle[-1]] != start:
        cycle.append(order[cycle[-1]])
    return tuple(GYROS[i] for i in cycle)
