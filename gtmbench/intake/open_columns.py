"""What open columns must be for gyros and attitude to tell of one motion: units and signs, tried and never assumed.

The attitude's rates are those of the gyros, whatever either is called and in whatever unit. A common scale of both
stays open in that. What only one unit allows settles it (angles beyond pi, a heading that jumps by a turn), or a
witness: gravity, of which accelerometers feel the pitch's sine, or the climb at an airspeed, which is that sine, too.
"""

from __future__ import annotations

import math
import operator
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice, permutations, product

import numpy as np

from gtmbench.intake.formats.raw import Meaning, RawLog, RawSeries
from gtmbench.intake.imus import hardly_moves_in_deg_s, only_deg_s
from gtmbench.intake.names import Triple, guess, triples, unnamed_rates
from gtmbench.intake.units import unit
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray

_DEG = math.degrees(1.0)  # a radian
_FINE_UNITS = ("cdeg", "ddeg", "mdeg", "mrad")  # of angles that are beyond what deg allows
_FINE_RATES = ("mrad/s", "ddeg/s", "cdeg/s", "mdeg/s")
_MOST_DEG = (361.0, 361.0, 800.0)  # roll, pitch and heading
# deg/s each
_RATE_UNITS = {"deg/s": 1.0, "rad/s": _DEG, "mrad/s": _DEG / 1e3, "ddeg/s": 0.1, "cdeg/s": 0.01, "mdeg/s": 1e-3}
# whole numbers a deg/s, of the sensors that loggers are made of: ranges of 250 to 2,000 deg/s
_COUNTS = {f"{1 / each:.6g} deg/s": 1 / each for each in (131.0, 65.5, 32.8, 16.4, 114.3, 57.14, 28.57, 14.29)}
_MOST_ROWS, _FEWEST = 20_000, 60  # of an attitude that are looked at
_SMOOTHED_S, _SLOW_S = 0.4, 4.0  # a mean over so long leaves motion; over the latter what is slow
_LEAST_DEG_S = 0.5  # deviation of an axis that moves
_CORRELATED, _MOSTLY = 0.6, 0.8  # of every axis, and of two of them
_LEAST_OF_OTHER_ORDER = 0.9  # share of the motion: that names are at the wrong axes must be plain
_FRAMES = ((1.0, 1.0, 1.0), (1.0, -1.0, -1.0))  # signs of angles: right and down, left and up
_ALONG = 0.5  # of what accelerometers feel, along z: less is no level flight, or a failure
_WITHIN, _FINELY = 0.3, 0.1  # of a unit's factor, as a logarithm; of one that has others within half of it
_APART = 0.04  # logarithms, by which any other unit has to be further off
_ALIKE, _PRICE = 0.03, 0.04  # of scores; of a turned sign
_ROLL_RAD, _PITCH_RAD, _YAW_RAD = 3.3, 1.65, 6.6  # beyond, an angle is in deg
_WITNESS, _WITNESS_GAIN = 0.6, (0.2, 5.0)  # correlation, and gain, of a witness: rad and deg are 57 apart
_USUALLY = 99.5  # %
_SHARED = 0.5  # of the stamps that repeat the one before
_GAP = 5.0  # usual intervals


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """What physics say of open columns."""

    meanings: Mapping[str, Meaning]  # of columns, by name
    why_not: str = ""  # what is still open, with what to type; "" where nothing is, or nothing could be tried


NOTHING = Found(meanings={})


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """A triple of gyros and one of angles that tell of one motion, read so."""

    gyros: Triple
    angles: Triple
    units: tuple[str, str]
    signs: tuple[tuple[float, ...], tuple[float, ...]]  # of the gyros, of the angles
    score: float
    share: float  # of the gyros' motion that the attitude explains
    evidence: str  # of the angles' unit

    @property
    def meanings(self) -> dict[str, Meaning]:
        """What each column is."""
        order = f" in the order {', '.join(each.name for each in self.gyros.series)}" if self.gyros.is_reordered else ""
        why = (f"the attitude{order}, which explains {100 * self.share:.0f} % of them", self.evidence)
        return {
            series.name: Meaning(channel=channel, unit=unit, sign=sign, guessed=told)
            for triple, channels, unit, signs, told in zip(
                (self.gyros, self.angles), (GYROS, ATTITUDE), self.units, self.signs, why, strict=True
            )
            for series, channel, sign in zip(triple.series, channels, signs, strict=False)
        }

    def agrees_with(self, known: Iterable[tuple[RawSeries, Meaning]]) -> bool:
        """Tell whether it reads the columns that are known as they are."""
        told = ((self.meanings.get(series.name), meaning) for series, meaning in known)
        return all(
            own is None or (own.channel, own.unit, own.sign) == (meaning.channel, meaning.unit, meaning.sign)
            for own, meaning in told
        )


def found(raw: RawLog, known: Mapping[str, tuple[RawSeries, Meaning]], angle_unit: str = "") -> Found:
    """Return what open gyros and angles of a log must be."""
    if {*GYROS, *ATTITUDE} <= set(known) or not raw.clocks:
        return NOTHING
    named = [triple for triple in triples(raw.series) if triple.clock in raw.clocks]
    gyros = _candidates(named, "rate", GYROS, known) or unnamed_rates(raw.series)
    angles = _candidates(named, "angle", ATTITUDE, known)

    def fits_of(read: Iterable[Triple]) -> list[_Fit]:
        fits = (fit for one, other in product(read, angles) for fit in _fits(raw, one, other, angle_unit))
        return [fit for fit in fits if fit.agrees_with(known.values())]

    fits = fits_of(gyros)
    if not fits:  # names may stand at the wrong axes
        others = fits_of(turned for one in gyros for turned in _other_orders(one))
        fits = [fit for fit in others if fit.share > _LEAST_OF_OTHER_ORDER]
    if gyros and not angles:
        return _alone(gyros, known, angle_unit)
    if not fits and gyros and angles:
        names = " and ".join(", ".join(series.name for series in triple.series) for triple in (gyros[0], angles[0]))
        return Found(meanings={}, why_not=f"{names} don't show one motion in any unit, or too little of it")
    if not fits:
        return NOTHING
    best = min(fits, key=lambda fit: fit.score)
    if not best.evidence:
        fits = list(_by_scale(fits))
        if not fits:
            why = "gyros and attitude fit each other in rad and in deg, and neither gravity nor a climb shows which"
            return Found(meanings={}, why_not=f"{why}: --units rad or --units deg")
        best = min(fits, key=lambda fit: fit.score)
    alike = [fit for fit in fits if fit is not best and fit.score < best.score + _ALIKE]
    if alike:
        other = min(alike, key=lambda fit: fit.score)
        return Found(meanings={}, why_not=f"two readings fit alike: {typed(best.meanings)}, or {typed(other.meanings)}")
    settled = {series.name for series, _ in known.values()}
    return Found(meanings={name: meaning for name, meaning in best.meanings.items() if name not in settled})


def tells_of_one_motion(raw: RawLog) -> bool:
    """Tell whether gyros and attitude of a log, whose columns are said to be known, turn together so."""
    told = {each.meaning.channel: (each, each.meaning) for each in reversed(raw.series) if each.meaning is not None}
    if not {*GYROS, *ATTITUDE} <= set(told):
        return False
    gyros, angles = _candidates((), "rate", GYROS, told)[0], _candidates((), "angle", ATTITUDE, told)[0]
    return any(fit.signs[0] == gyros.signs for fit in _fits(raw, gyros, angles, ""))


def rates_beside_attitude(
    raw: RawLog, gyros: Sequence[RawSeries], angles: Sequence[RawSeries], factors: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return what gyros read over the intervals of an attitude, and what turns it does in deg/s; None of too few."""
    told = (Triple(kind=kind, series=tuple(own)) for kind, own in (("rate", gyros), ("angle", angles)))
    motion = _motion(raw, *told)
    if motion is None:
        return None
    return motion.rates, _smoothed(_body_rates(motion.angles * factors, motion.time_s), motion.time_s)


def _by_scale(fits: Sequence[_Fit]) -> Iterator[_Fit]:
    """Give those of some fits whose units the size of what gyros and angles read allows, with what shows it."""
    pairs = {fit.units for fit in fits}
    for fit in fits:
        evidence = ""
        if fit.units[0] == "deg/s":
            evidence = only_deg_s(fit.gyros.series)
        elif len(pairs) == 1:
            own = hardly_moves_in_deg_s(fit.gyros.series) if fit.units == ("rad/s", "rad") else ""
            evidence = "the gyros, in no other unit beside them" if fit.units[1] in _FINE_UNITS else own
        if evidence:
            yield replace(fit, evidence=evidence)


def _alone(gyros: Sequence[Triple], known: Mapping[str, tuple[RawSeries, Meaning]], angle_unit: str) -> Found:
    """Return what gyros are that no attitude is beside: their unit by how fast they turn, their axes as named."""
    exact = [triple for triple in gyros if triple.is_exact] or gyros
    if set(GYROS) & set(known) or len(exact) > 1:
        return NOTHING
    (only,) = exact
    if only.stated or angle_unit:
        unit_told, why = only.stated or f"{angle_unit}/s", "its unit and order"
    else:
        unit_told, why = "deg/s", only_deg_s(only.series)
    if not why:
        names = ", ".join(series.name for series in only.series)
        return Found(meanings={}, why_not=f"{names} may be in rad/s or in deg/s: --units rad or --units deg")
    return Found(
        meanings={
            series.name: Meaning(channel=channel, unit=unit_told, guessed=why)
            for series, channel in zip(only.series, GYROS, strict=True)
        }
    )


def typed(meanings: Mapping[str, Meaning]) -> str:
    """Return the options that state what columns are.

    >>> typed({"az": Meaning(channel="nz", unit="m/s2", sign=-1.0)})
    '--map nz=-az:m/s2'
    """
    options = (
        f"{meaning.channel}={'-' if meaning.sign < 0 else ''}{name}:{meaning.unit}"
        for name, meaning in meanings.items()
    )
    return " ".join(f"--map {shlex.quote(option)}" for option in options)


def _candidates(
    named: Sequence[Triple], kind: str, channels: Sequence[str], known: Mapping[str, tuple[RawSeries, Meaning]]
) -> list[Triple]:
    """Return the columns that may be three channels: those that are known, else what is named so, exactly at best."""
    for wanted in (channels, channels[:2]) if kind == "angle" else (channels,):  # an attitude may lack its heading
        if set(wanted) <= set(known):
            series, meanings = zip(*(known[channel] for channel in wanted), strict=True)
            return [Triple(kind=kind, series=series, meanings=meanings)]
        own = [triple for triple in named if triple.kind == kind and len(triple.series) == len(wanted)]
        if own:
            exact = [triple for triple in own if triple.is_exact]
            return (exact if len(exact) == 1 else own)[:6]
    return []


def _other_orders(gyros: Triple) -> Iterator[Triple]:
    """Give three columns in every other order of their axes; none where the format documents which is which."""
    if not gyros.meanings:
        for order in islice(permutations(range(3)), 1, None):
            handed = float(np.linalg.det(np.eye(3)[list(order)]))
            series = tuple(gyros.series[place] for place in order)
            yield replace(gyros, series=series, is_reordered=True, handed=handed)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """Gyros and angles over the same intervals, as they are stored."""

    time_s: FloatArray  # the intervals' ends, shape (intervals + 1,)
    rates: FloatArray  # the gyros' means, smoothed, shape (intervals, 3)
    angles: FloatArray  # at the ends, shape (intervals + 1, 3)


def _fits(raw: RawLog, gyros: Triple, angles: Triple, angle_unit: str) -> Iterator[_Fit]:
    """Give the ways to read gyros and angles under which they tell of one motion."""
    motion = _motion(raw, gyros, angles)
    if motion is None:
        return
    units, shown = _angle_units(angles, motion.angles, angle_unit)
    fits = list(_fits_in(raw, gyros, angles, motion, units, shown))
    if not fits and units == ["deg"] and not (angles.stated or angle_unit):  # of small angles in fine units, too
        fine = _fits_in(raw, gyros, angles, motion, _FINE_UNITS, "")  # not of both: that is any scale
        fits = [fit for fit in fine if fit.units[0] not in _FINE_RATES]
    yield from fits


def _fits_in(
    raw: RawLog, gyros: Triple, angles: Triple, motion: _Motion, units: Sequence[str], shown: str
) -> Iterator[_Fit]:
    """Give those with the angles in some units; `shown` says what leaves one of them only."""
    witnesses = list(_witnesses(raw, motion.time_s, gyros.clock))
    axes = len(angles.series)
    is_named = gyros.is_exact and angles.is_exact and axes == len(GYROS) and len(units) == 1
    felt = None if gyros.is_reordered else _axes_felt(raw, gyros)
    for named, signs in product(units, [angles.signs] if angles.signs else list(product((1.0, -1.0), repeat=axes))):
        known = unit(named)
        turned = motion.angles * (np.asarray(signs) * (known.factor if known else 1.0))
        rates = _smoothed(_body_rates(turned, motion.time_s), motion.time_s)
        told = _gains(motion.rates[:, :axes], rates[:, :axes])
        if told is None and is_named and min(signs) > 0.0:
            told = _gain_as_named(motion.rates, rates)
        if told is None:
            continue
        gains, correlations = told
        own = tuple(np.sign(gains).tolist())
        own = own if axes == len(GYROS) else (*own, own[0] * own[1])  # axes are right-handed
        rate_unit = _rate_unit(gyros, gains)
        is_frame = own == gyros.signs if gyros.signs else math.prod(own) == gyros.handed
        if rate_unit is None or not is_frame:  # a sign on one axis alone, or two axes swapped, are a fault and no frame
            continue
        sines = [(_gain_of_sine(witness, turned, motion.time_s), why) for witness, why in witnesses]
        witnessed = [why for gain, why in sines if _WITNESS_GAIN[0] < abs(gain) < _WITNESS_GAIN[1]]
        if not shown and not gyros.stated and any(gain for gain, _ in sines) and not witnessed:
            continue  # what a witness tells is another scale's
        share = float(np.mean(np.square(correlations)))
        if signs not in _FRAMES and not angles.signs and axes == len(GYROS) and share < _LEAST_OF_OTHER_ORDER:
            continue  # a sign on one angle alone is a convention, where it is plain
        turned_signs = sum(sign < 0 for sign in (*own, *signs))
        flips = turned_signs if felt is None else 2 * sum(map(operator.ne, own, felt)) + 0.5 * turned_signs
        goes_down = any(gain < 0 for gain, _ in sines)  # where a nose goes up
        if goes_down and signs[1] < 0.0 and not angles.signs:
            continue  # a pitch is turned to agree with gravity, and never against it
        yield _Fit(
            gyros=gyros,
            angles=angles,
            units=(rate_unit, named),
            signs=(own, signs),
            score=1.0 - share + _PRICE * flips + (1.0 if goes_down else 0.0),
            share=share,
            evidence=shown or ("the gyros' unit" if gyros.stated else next(iter(witnessed), "")),
        )


def _motion(raw: RawLog, gyros: Triple, angles: Triple) -> _Motion | None:
    """Return the motion over the intervals between the attitude's samples; None where there are too few."""
    time_s, values = _clean(raw.clocks[angles.clock], [*angles.series])
    if len(time_s) > _MOST_ROWS:
        first = (len(time_s) - _MOST_ROWS) // 2
        time_s, values = time_s[first : first + _MOST_ROWS], values[first : first + _MOST_ROWS]
    at_s, rates = _clean(raw.clocks[gyros.clock], [*gyros.series])
    inside = (time_s >= at_s[0]) & (time_s <= at_s[-1]) if len(at_s) > 1 else np.zeros(len(time_s), dtype=bool)
    time_s, values = time_s[inside], values[inside]
    if len(time_s) < _FEWEST:
        return None
    turned = np.vstack([np.zeros(3), np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(at_s)[:, np.newaxis], axis=0)])
    at_ends = np.column_stack([np.interp(time_s, at_s, column) for column in turned.T])
    steps = np.diff(time_s)
    means = np.diff(at_ends, axis=0) / steps[:, np.newaxis]
    means[steps > _GAP * np.median(steps)] = np.nan
    return _Motion(time_s=time_s, rates=_smoothed(means, time_s), angles=values)


def _clean(time_s: FloatArray, series: Sequence[RawSeries]) -> tuple[FloatArray, FloatArray]:
    """Return the stamps that rise, and columns there, where all are numbers."""
    values = np.column_stack([each.values() for each in series])
    time_s = _spread(time_s)
    there = np.isfinite(time_s) & np.isfinite(values).all(axis=1)
    time_s, values = time_s[there], values[there]
    rising = np.diff(np.maximum.accumulate(time_s), prepend=-np.inf) > 0 if len(time_s) else np.zeros(0, dtype=bool)
    return time_s[rising], values[rising]


def _spread(time_s: FloatArray) -> FloatArray:
    """Return stamps that lie evenly between those of whole seconds, where several rows share one."""
    steps = np.diff(time_s)
    if len(steps) < _FEWEST or not np.all(steps >= 0.0) or np.mean(steps == 0.0) < _SHARED:
        return time_s
    rows = np.append(0, np.flatnonzero(steps > 0.0) + 1)
    return np.asarray(np.interp(np.arange(len(time_s)), rows, time_s[rows]))


def _angle_units(angles: Triple, values: FloatArray, told: str) -> tuple[list[str], str]:
    """Return the units that angles may be in, and what shows it where one is left."""
    if angles.stated or told:
        return [angles.stated or told], "the unit that is stated"
    most = np.percentile(np.abs(values), _USUALLY, axis=0)
    if any(most > _MOST_DEG[: len(most)]):
        return list(_FINE_UNITS), ""
    if most[0] > _ROLL_RAD or most[1] > _PITCH_RAD:
        return ["deg"], f"angles up to {max(most[:2]):.3g}"
    if values.shape[1] < len(ATTITUDE):
        return ["deg", "rad"], ""
    steps = np.abs(np.diff(values[:, 2]))
    for name, turn in (("deg", 360.0), ("rad", math.tau)):
        jumps = np.abs(steps - turn) < 0.05 * turn
        if jumps.any() and (name == "deg" or most[2] < _YAW_RAD):
            return [name], f"a heading that jumps by {steps[jumps][0]:.3g}"
    return ["deg", "rad"], ""


def _body_rates(angles: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return p, q, r over the intervals between angles in deg."""
    steps = np.diff(angles, axis=0)
    steps -= 360.0 * np.rint(steps / 360.0)
    phi, theta = np.deg2rad(angles[:-1, :2] + 0.5 * steps[:, :2]).T
    turning = steps / np.diff(time_s)[:, np.newaxis]
    phi_rate, theta_rate = turning[:, :2].T
    psi_rate = turning[:, 2] if turning.shape[1] == len(ATTITUDE) else np.zeros(len(turning))  # as if it flew straight
    return np.column_stack(
        [
            phi_rate - psi_rate * np.sin(theta),
            theta_rate * np.cos(phi) + psi_rate * np.cos(theta) * np.sin(phi),
            psi_rate * np.cos(theta) * np.cos(phi) - theta_rate * np.sin(phi),
        ]
    )


def _smoothed(rates: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return means over a few tenths of a second: an attitude's differences are noise beyond that."""
    width = max(1, round(_SMOOTHED_S / float(np.median(np.diff(time_s)))))
    sums = np.cumsum(np.vstack([np.zeros(rates.shape[1]), rates]), axis=0)
    if not np.isnan(sums[-1]).any():
        return np.asarray((sums[width:] - sums[:-width]) / width)
    # means that hold a missing one are missing
    return np.asarray(np.lib.stride_tricks.sliding_window_view(rates, width, axis=0).mean(axis=-1))


def _gains(rates: FloatArray, told: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return what the gyros are of the rates that the attitude tells, axis by axis, and how they correlate; or None."""
    there = np.isfinite(rates).all(axis=1) & np.isfinite(told).all(axis=1)
    if np.count_nonzero(there) < _FEWEST:
        return None
    y, u = (own[there] - own[there].mean(axis=0) for own in (rates, told))
    powers = np.mean(np.square(u), axis=0)
    if not np.all(powers > _LEAST_DEG_S**2) or not np.all(np.mean(np.square(y), axis=0) > 0):
        return None
    cross = np.mean(y * u, axis=0)
    correlations = np.abs(cross) / np.sqrt(powers * np.mean(np.square(y), axis=0))
    if correlations.min() < _CORRELATED or np.sort(correlations)[1] < _MOSTLY:
        return None
    return cross / (powers * correlations), correlations  # by the deviations: noise makes neither side smaller


def _gain_as_named(rates: FloatArray, told: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return the same of gyros that are named as such, in motion that tells little of some axis: one gain for all.

    A steady turn is about axes that hardly change; its mean rates show the unit. Nothing else may be in the readings, a
    gyro's offset neither: nine tenths of them have to be the attitude's.
    """
    there = np.isfinite(rates).all(axis=1) & np.isfinite(told).all(axis=1)
    if np.count_nonzero(there) < _FEWEST:
        return None
    y, u = rates[there], told[there]
    power, cross = float(np.mean(np.square(u).sum(axis=1))), float(np.mean((y * u).sum(axis=1)))
    if power < _LEAST_DEG_S**2 or cross <= 0.0:
        return None
    gain = cross / power
    left = float(np.mean(np.square(y - gain * u).sum(axis=1)) / np.mean(np.square(y).sum(axis=1)))
    return (np.full(3, gain), np.full(3, math.sqrt(1.0 - left))) if left < 1.0 - _LEAST_OF_OTHER_ORDER else None


def _rate_unit(gyros: Triple, gains: FloatArray) -> str | None:
    """Return the unit in which gyros read what the attitude tells, the stated one where one is; None of no one unit."""
    stated = unit(gyros.stated)
    units = {gyros.stated: stated.factor} if stated else _RATE_UNITS | (_COUNTS if _is_counted(gyros) else {})
    off = {name: float(np.abs(np.log(np.abs(gains) * factor)).max()) for name, factor in units.items()}
    best, *others = sorted(off, key=off.__getitem__)[:2]
    if off[best] > (_WITHIN if stated or best in ("deg/s", "rad/s") else _FINELY):
        return None
    return None if others and off[others[0]] - off[best] < _APART else best


def _is_counted(gyros: Triple) -> bool:
    """Tell whether gyros read whole numbers, as the counts of a sensor are."""
    read = (series.values()[:_MOST_ROWS] for series in gyros.series)
    return all(bool(np.all(values[np.isfinite(values)] % 1.0 == 0.0)) for values in read)


def _witnesses(raw: RawLog, time_s: FloatArray, clock: str) -> Iterator[tuple[FloatArray, str]]:
    """Give what should be the pitch's sine, at some times, with what it is."""
    named = triples(raw.series)
    felt = [triple for triple in named if triple.kind == "acceleration" and triple.clock in raw.clocks]
    for triple in [triple for triple in felt if triple.clock == clock][:1] or felt[:1]:
        at_s, forces = _clean(raw.clocks[triple.clock], triple.series)
        norm = float(np.median(np.linalg.norm(forces, axis=1))) if len(forces) else 0.0
        if norm > 0.0:
            yield np.interp(time_s, at_s, forces[:, 0] / norm), "gravity in the accelerometers"
    height, speed = (_first(raw, channel) for channel in ("altitude", "tas"))
    if height is not None and speed is not None:
        up, along = (
            np.interp(time_s, at_s, values[:, 0])
            for at_s, values in (_clean(raw.clocks[each.clock], [each]) for each in (height, speed))
        )
        with np.errstate(all="ignore"):
            yield np.nan_to_num(np.gradient(up, time_s) / along, posinf=0.0, neginf=0.0), "the climb at its airspeed"


def _axes_felt(raw: RawLog, gyros: Triple) -> tuple[float, ...] | None:
    """Return the gyros' signs by the accelerometers of the same sensor: where z feels gravity it points up."""
    beside = [triple for triple in triples(raw.series) if triple.kind == "acceleration" and triple.clock == gyros.clock]
    felt = np.array([each.values() for each in beside[0].series]) if beside else np.zeros((3, 1))
    along = np.nanmean(felt, axis=1)
    if not abs(along[2]) > max(np.abs(along[:2]).max(), _ALONG * float(np.nanmedian(np.linalg.norm(felt, axis=0)))):
        return None
    return (1.0, -1.0, -1.0) if along[2] > 0 else (1.0, 1.0, 1.0)


def _first(raw: RawLog, channel: str) -> RawSeries | None:
    """Return the first column that is named as a channel and moves."""
    named = (each for each in raw.series if guess(each.name, each.unit).channel == channel and each.clock in raw.clocks)
    return next((each for each in named if np.ptp(np.nan_to_num(each.values())) > 0), None)


def _gain_of_sine(witness: FloatArray, angles: FloatArray, time_s: FloatArray) -> float:
    """Return what a witness is of the pitch's sine, in slow motion; 0 where they have little to do with each other."""
    width = max(1, round(_SLOW_S / float(np.median(np.diff(time_s)))))
    if len(witness) < 3 * width:
        return 0.0
    window = np.ones(width) / width
    told, sine = (
        np.convolve(column - column.mean(), window, mode="valid")
        for column in (witness, np.sin(np.deg2rad(angles[:, 1])))
    )
    cross, power, other = (float(np.mean(product)) for product in (told * sine, np.square(sine), np.square(told)))
    return cross / power if power * other > 0.0 and abs(cross) > _WITNESS * math.sqrt(power * other) else 0.0
