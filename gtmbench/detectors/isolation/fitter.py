"""Fits of one suspect: what its hypotheses share, shapes of faults above all, filtered together."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any, cast

import numpy as np

from gtmbench.detectors.isolation.case import ACCELEROMETERS, LazyMapping, own
from gtmbench.detectors.isolation.columns import Columns, vertex
from gtmbench.detectors.isolation.noise import FittedNoise, NoiseFit
from gtmbench.detectors.isolation.own_noise import ALIKE, is_straighter, straight_rows
from gtmbench.detectors.isolation.suspect import Left, Suspect
from gtmbench.detectors.virtual import ANGLES
from gtmbench.faults.distortions import lagged
from gtmbench.faults.fault import Fault, Following
from gtmbench.faults.registry import grows, how_of, loaded_faults, size_one
from gtmbench.faults.shape import HELD
from gtmbench.values.channels import axis_of
from gtmbench.values.record import FloatArray

UNKNOWN = "unknown"
PEERS = (("p", "q", "r"), ("phi", "theta", "psi"), ("nx", "ny", "nz"))  # of the same make
_LAG_S = 0.1  # of the shape that stands for lags of any length
_FINER = 4  # lines of a spectrum than rows
_LEAST_GAIN = 0.01  # of a sensor's own noise
_MOST_GAIN = 0.5  # beside 1: where that is far off, nothing is near enough to matter
_CONSTANT = 0.98  # of the rows judged: the same
_AGAIN, _PILED = 10, 0.05  # rows, and of those judged, at the readings' ends
_LATE = 0.05  # of what the best shapes explain
WORTH = 10.0  # of -2 log likelihood, that a search is worth

Parameters = dict[str, float]  # by name, in the channel's unit (per second for slopes; times in seconds)

# shapes of faults that belong to no kind; () is one that has gone
ANYTHING: tuple[tuple[str, ...], ...] = (
    (),
    ("1",),
    ("t",),
    ("1", "t"),
    ("x",),
    ("1", "x"),
    ("x'",),
    ("x", "x'"),
    ("lag",),
    ("x", "lag"),
    ("1", "lag", "x'"),
    ("x", "sgn"),
    ("sin", "cos"),
    ("1", "sin", "cos"),
    ("1", "x", "x'"),
    ("t", "x"),  # an offset of a rate is a slope of its angle: what one may have, the other may
    ("t", "sin", "cos"),
    ("t", "x", "x'"),
)

WALKING: tuple[tuple[str, ...], ...] = ((), ("1",), ("1", "t"))  # a random walk may go with
_NOISY = 5  # sets of shapes that are tried with noise
_SIMPLE: tuple[tuple[str, ...], ...] = (("1",), ("1", "t"), ("x",), ("1", "x"), ("x", "x'"), ("sgn",))


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A hypothesis fitted to a suspect."""

    kind: str  # `UNKNOWN` where it has none
    family: str
    left: Left = field(repr=False)
    parameters: Parameters  # of the kind
    free: int  # how many numbers were fitted
    partner: str | None = None  # the other sensor of a fault that mixes two
    errors: Callable[[], Parameters] = field(default=dict, repr=False)  # gives the parameters' standard errors
    lasts: bool = True  # whether the fault is there to the end; one that comes and goes may have gone
    misfit: float = 0.0  # of noise, how far its spectrum is from what it leaves; up to 1 that is such noise

    @property
    def is_absorbing(self) -> bool:
        """Whether it explains a little of everything: noise of whatever spectrum, and what belongs to no kind."""
        return self.kind == UNKNOWN or self.how in ("white", "walk") or self.misfit > 0.0

    @property
    def how(self) -> str:
        """How its kind is looked for."""
        return how_of(self.kind)

    @property
    def is_shown(self) -> bool:
        """Whether the sensor's own readings show it: they are held, clipped or rounded."""
        return self.family == "clipping" or self.is_held

    @property
    def is_held(self) -> bool:
        """Whether they are held."""
        return self.how in HELD


class Fitter:
    """Fits of one suspect: shapes are computed once, filtered together. `without`: families that aren't tried."""

    def __init__(self, suspect: Suspect, without: Iterable[str] = ()) -> None:
        self.suspect, self.without = suspect, frozenset(without)
        case = suspect.case
        self.period_s = case.period_s
        self.virtual = suspect.expected
        self.after_s = suspect.time_s - suspect.time_s[suspect.sure]
        self.on = suspect.begun.astype(float)
        self.peers = _peers(suspect)
        self.felt = _felt(suspect)
        self.measured = np.where(np.isfinite(suspect.measured), suspect.measured, self.virtual)
        self._plain: dict[tuple[str, ...], Left] = {}
        self._volumes: dict[tuple[str, ...], float] = {}
        self._noises: dict[tuple[str, ...], tuple[NoiseFit, NoiseFit]] = {}

    # ---- what all hypotheses are made of ----

    @cached_property
    def shapes(self) -> Mapping[str, FloatArray]:
        """What a fault may add, per unit; nothing before the onset.

        Where the attitude bends with the sensor, what it should have read is known far worse than what it read, which
        tells the same: a gain is one over another. Noise is left out, or a shape would take the sensor's own away.
        """
        names = ["1", "t", "x", "x'", "lag", "sgn", "sin", "cos"]
        names += [f"of {name}" for name in (*self.peers, *self.felt)]
        for kind, cls in self.given.items():
            names += [f"own {kind}", f"late {kind}"] if grows(cls) else [f"own {kind}"]
        return LazyMapping(names, self._shape)

    @cached_property
    def given(self) -> dict[str, type[Fault]]:
        """The kinds that are linear in a shape which their class alone gives.

        None where the attitude bends with the sensor: what it reads is known there, and no such shape of what it
        should read.
        """
        if self.is_driven:
            return {}
        return {
            kind: cls
            for kind, cls in loaded_faults().items()
            if (of := cls.shape) is not None and of.how == "linear" and not (of.column or of.beside)
        }

    def _given(self, name: str) -> FloatArray:
        """Return what a kind adds at size one, or how much more it does a second later."""
        what, kind = name.split(" ")
        cls = self.given[kind]
        unit = size_one(cls)
        own = self.added(cls, [unit], expected=self._expected)[0]
        if what != "own":
            own = self.added(cls, [unit], expected=self._expected, late_s=1.0)[0] - own
        return np.asarray(own)

    def _shape(self, name: str) -> FloatArray:
        if name.partition(" ")[2] in self.given:
            return self._given(name)
        v, t = self._expected, self.after_s
        level = v - (v[0] if self.suspect.channel == "psi" else 0.0)
        of: dict[str, Callable[[], FloatArray]] = {
            "1": lambda: np.ones_like(t),
            "t": lambda: t,
            "x": lambda: level,
            "x'": lambda: np.gradient(v) / self.period_s,
            "lag": lambda: _lagged(v, _LAG_S, self.period_s) - v,
            "sgn": lambda: np.sign(self.measured if self.is_driven else level),
            "sin": lambda: np.sin(2.0 * np.pi * self.frequency_hz * t),
            "cos": lambda: np.cos(2.0 * np.pi * self.frequency_hz * t),
        }
        beside = self.peers | self.felt
        return np.asarray((of[name]() if name in of else beside[name.removeprefix("of ")]) * self.on)

    @cached_property
    def _expected(self) -> FloatArray:
        return self.suspect.case.smooth(self.measured) if self.is_driven else self.virtual

    @property
    def is_driven(self) -> bool:
        """Whether the attitude bends with the sensor."""
        return self.suspect.bend is not None

    def gain(self, more: float) -> float:
        """Return the factor by which a sensor reads, from how much of shape x there is."""
        return 1.0 / (1.0 - more) if self.is_driven and more != 1.0 else 1.0 + more

    @cached_property
    def frequency_hz(self) -> float:
        """Where the spectrum of the residual that holds most of the fault peaks."""
        from scipy.fft import next_fast_len

        residuals = [i for i, output in enumerate(self.suspect.outputs) if output != own(self.suspect.channel)]
        whites = self.suspect.filled[residuals]
        white = whites[int(np.argmax(np.square(whites).sum(axis=1)))]
        rows = len(white)
        size = next_fast_len(_FINER * rows, real=True)
        spectrum = np.abs(np.fft.rfft(white * np.hanning(rows), size))
        frequency = np.arange(len(spectrum)) / (size * self.period_s)
        spectrum[frequency < 1.5 / (rows * self.period_s)] = 0.0
        peak = int(np.argmax(spectrum))
        at, around = float(frequency[peak]), slice(peak - 1, peak + 2)
        if not 0 < peak < len(spectrum) - 1:
            return at
        top, bend = vertex(frequency[around], spectrum[around])
        return top if bend < 0.0 else at

    @cached_property
    def columns(self) -> Columns:
        """The shapes, filtered."""
        return Columns(self.suspect, self.shapes)

    @cached_property
    def anything(self) -> dict[tuple[str, ...], Left]:
        """What a few shapes leave, of those sets that there are samples enough for."""
        return dict(zip(self._sets, self._plains(self._sets), strict=True))

    @property
    def _sets(self) -> list[tuple[str, ...]]:
        return [names for names in ANYTHING if 3 * len(names) < self.suspect.white.size]

    @cached_property
    def _noise(self) -> FittedNoise:
        return FittedNoise(self.suspect)

    def weights(self, *names: str) -> FloatArray:
        """Return how much of some shapes there is, per unit."""
        return self.columns.weights(names)

    def weigh_all(self) -> None:
        """Solve for all sets of shapes that hypotheses ask for, together: one by one takes several times as long.

        So for the noise beside some of them.
        """
        mixed = [("x", f"of {name}") for name in self.peers] + [(f"of {name}",) for name in self.felt]
        self._plains([*self._sets, ("sin", "cos", "x"), *mixed])
        self.noises(list(dict.fromkeys([*WALKING, *self.noisy])))

    @cached_property
    def possible(self) -> list[tuple[str, ...]]:
        """The sets of a few shapes that don't say that the sensor reads ahead of time."""
        return [names for names in self.anything if not leads(names, self.weights(*names))]

    @cached_property
    def noisy(self) -> list[tuple[str, ...]]:
        """The best of them: they are tried with noise, too."""
        return sorted(self.possible, key=lambda names: self.plain(*names).deviance + 8.0 * len(names))[:_NOISY]

    def plain(self, *names: str) -> Left:
        """Return what some shapes leave."""
        found = self._plain.get(names)
        return found if found is not None else self._plains([names])[0]

    def _plains(self, sets: Sequence[tuple[str, ...]]) -> list[Left]:
        new = [names for names in sets if names not in self._plain]
        for names, deviance in zip(new, self.columns.deviances(new), strict=True):
            self._plain[names] = Left(deviance, self.suspect.outputs, partial(self.columns.left, names))
        by_gain = [names for names in new if "x" in names]
        volumes = self.volumes(np.array([self.weights(*names)[names.index("x")] for names in by_gain]))
        for names, volume in zip(by_gain, volumes.tolist(), strict=True):
            self._plain[names] = self._plain[names].denser(volume)
            self._volumes[names] = volume
        return [self._plain[names] for names in sets]

    def noises(self, sets: Sequence[tuple[str, ...]]) -> list[tuple[NoiseFit, NoiseFit]]:
        """Return the best white noise and the best random walk beside the shapes of each of some sets."""
        new = [names for names in sets if names not in self._noises]
        for names, (white, walk) in zip(new, self._noise.fits(self._plains(new)), strict=True):
            volume = self._volumes.get(names)
            self._noises[names] = (white.denser(volume), walk.denser(volume)) if volume else (white, walk)
        return [self._noises[names] for names in sets]

    @cached_property
    def band(self) -> NoiseFit:
        """The best noise around the frequency at which the residual is strongest."""
        return self._noise.band(self.plain(), self.frequency_hz)

    def volumes(self, weights: FloatArray) -> FloatArray:
        """Return by what -2 log likelihood of what shares of its reading leave is more than that of what was read.

        What the angle should have read is made of its gyro's readings, so w of it adds w H of these to the gyro's own
        residual, H what smoothing passes: a density of that is one of the readings over |1 + w H|, frequency by
        frequency. Without, gains that make the gyro's noise smaller would seem likelier than they are. A gyro that
        drives the attitude is undone by a share w of what it reads: 1 - w H of its own noise is left.
        """
        channel, outputs = self.suspect.channel, self.suspect.outputs
        gyro = axis_of(channel)[0]
        counts = dict(zip(outputs, np.count_nonzero(self.suspect.there, axis=1).tolist(), strict=True))
        if self.is_driven:
            kept = np.square(1.0 - np.outer(weights, self.suspect.case.smoothing))
            count = counts.get(channel, 0) + counts.get(own(channel), 0) / ALIKE
            return np.asarray(count * np.log(np.clip(kept, _LEAST_GAIN**2, 1.0)).mean(axis=1))
        if channel not in ANGLES or gyro not in outputs:
            return np.zeros(len(weights))
        few = np.clip(weights, -_MOST_GAIN, _MOST_GAIN)
        return np.asarray(
            counts[gyro] * np.log(np.square(1.0 + np.outer(few, self.suspect.case.smoothing))).mean(axis=1)
        )

    def added(
        self,
        cls: type[Fault],
        parameters: Sequence[Mapping[str, float]],
        *,
        expected: FloatArray | None = None,
        late_s: float = 0.0,
    ) -> FloatArray:
        """Return what faults of a kind add to the readings, by its own class, shape (faults, rows).

        From where it is surely there. It starts from the sensor's own reading there, and has been there for `late_s`.
        Where errors would add up from sample to sample (`Following`), each starts from its own reading before. Where
        the attitude bends with the sensor, it is hardly known what that should read, and what the readings say of it
        is taken (`Fault.undone`).
        """
        sure, should = self.suspect.sure, self.virtual if expected is None else expected
        readings, should, before = self.measured[sure:], should[sure:], self.measured[sure - 1 : -1]
        elapsed_s, column = self.after_s[sure:] + late_s, should[:, np.newaxis]
        changes, hashable = np.zeros((len(parameters), len(self.virtual))), cast("Hashable", cls)
        for change, figures in zip(changes[:, sure:], parameters, strict=True):
            fault = _fault(hashable, self.suspect.channel, tuple(figures.items()))
            undone = fault.undone(readings, should) if self.is_driven else None
            if undone is not None:
                np.subtract(readings, undone, out=change)
            elif isinstance(fault, Following):
                np.subtract(fault.follow(should, before, self.period_s), should, out=change)
            else:
                reads, _ = fault.distort(column, elapsed_s, self.period_s, fault.begin(before[:1]))
                np.subtract(reads, should, out=change)
        return changes

    def shown(self, cls: type[Fault], parameters: Sequence[Mapping[str, float]], late_s: float) -> FloatArray:
        """Return what faults of a kind show in the residuals that are there, shape (faults, outputs, rows)."""
        shown = self.suspect.shown(self.added(cls, parameters, late_s=late_s))
        return shown if self.suspect.is_whole else shown * self.suspect.there

    @cached_property
    def is_constant(self) -> bool:
        """Whether the sensor reads the same over nearly all rows judged."""
        judged = self.suspect.measured[self.suspect.judged]
        there = judged[np.isfinite(judged)]
        return len(there) > 0 and float(np.mean(there == np.median(there))) > _CONSTANT

    @property
    def is_traced(self) -> bool:
        """Whether its readings look as if they were held or clipped."""
        return self.is_straight or self.is_at_limit

    @cached_property
    def is_straight(self) -> bool:
        """Whether it is dead straight more often than it was."""
        suspect, case = self.suspect, self.suspect.case
        straighter = is_straighter(suspect.measured[suspect.judged], case.habits.get(suspect.channel))
        return straighter and case.is_told_by_lines(suspect.channel)

    @property
    def is_at_limit(self) -> bool:
        """Whether its greatest and smallest readings come again and again: coarse ones may never run straighter."""
        return self.limit > 0.0

    @cached_property
    def limit(self) -> float:
        """The magnitude of its greatest and smallest readings, where they come again and again; 0 otherwise."""
        judged = self.suspect.measured[self.suspect.judged]
        there = judged[np.isfinite(judged)]
        extreme = int(np.count_nonzero((there == there.max()) | (there == there.min()))) if len(there) else 0
        return float(np.abs(there).max()) if extreme >= max(_AGAIN, _PILED * len(there)) else 0.0

    @cached_property
    def straight_step(self) -> float:
        """The usual step from sample to sample where the reading runs dead straight; 0 without."""
        judged = self.suspect.measured[self.suspect.judged]
        steps = np.abs(np.diff(judged))[straight_rows(judged)[1:]]
        return float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0

    def stale(self) -> FloatArray:
        """Return what repeating readings adds, as they are repeated."""
        rows = np.arange(len(self.virtual))
        fresh = np.concatenate([[True], np.diff(self.suspect.measured) != 0.0])
        last = np.maximum.accumulate(np.where(fresh, rows, 0))
        return np.asarray((self.virtual[last] - self.virtual) * self.on)

    def shaped(
        self,
        kind: str,
        family: str,
        names: tuple[str, ...],
        parameters: Parameters,
        errors: Callable[[], Parameters],
        *,
        more: int = 0,
        partner: str | None = None,
    ) -> Fit:
        """Return the fit of a fault that adds some shapes; `more` numbers were fitted than their weights."""
        return Fit(
            kind=kind,
            family=family,
            left=self.plain(*names),
            parameters=parameters,
            free=len(names) + more,
            partner=partner,
            errors=errors,
        )

    def fixed(
        self,
        kind: str,
        family: str,
        changes: FloatArray,
        parameters: Parameters,
        free: int,
        errors: Callable[[], Parameters] = dict,
    ) -> Fit:
        """Return the fit of changes that need no more fitting."""
        left = self.suspect.plain(self.suspect.white - self.suspect.shown(changes[np.newaxis])[0])
        return Fit(kind=kind, family=family, left=left, parameters=parameters, free=free, errors=errors)

    def deviations(self, *names: str) -> FloatArray:
        """Return the standard errors of the weights of shapes."""
        return np.asarray(np.sqrt(np.diag(self.columns.covariance(names))))

    def looks(self, when: str) -> bool:
        """Tell whether the readings look as a kind wants it: late, growing, held (straight), or held or clipped."""
        if when == "late":
            return self.is_late()
        if when == "growing":
            ramp = self.plain("1", "t").deviance
            return self.plain("1").deviance - ramp > WORTH and ramp < self.half_explained
        return not when or (self.is_straight if when == "straight" else self.is_traced)

    def is_late(self) -> bool:
        """Whether shapes of readings that come late explain enough of what any shape does for a search of how late."""
        nothing = self.anything[()].deviance
        late = [nothing - self.anything[names].deviance for names in (("lag",), ("x'",)) if names in self.anything]
        return max(late, default=0.0) > max(WORTH, 2.0 * _LATE * (nothing - self.half_explained))

    @cached_property
    def half_explained(self) -> float:
        """-2 log likelihood of what explains half as much as the best few shapes do: no more is no kind of fault."""
        return 0.5 * (self.anything[()].deviance + min(left.deviance for left in self.anything.values()))


@dataclass(frozen=True, kw_only=True, eq=False)
class Simple:
    """What a few simple shapes explain of a suspect: about the least deviance, a number fitted costing two of it.

    Its change is that by the best of them; where the suspect is held or clipped, that by what it should have read.
    """

    fitter: Fitter = field(repr=False)
    deviance: float
    change: FloatArray = field(repr=False)

    @property
    def suspect(self) -> Suspect:
        """Whom they explain."""
        return self.fitter.suspect

    @property
    def least(self) -> float:
        """About the least deviance, with noise in place of a shape, too."""
        if self.fitter.is_constant:
            return self.deviance
        return min(self.deviance, *(of.left.deviance + self.suspect.elsewhere for of in self.fitter.noises([()])[0]))


def simplest(suspect: Suspect) -> Simple:
    """Return how simple shapes explain a suspect.

    What a stuck one should have read explains its own residual whatever drives the attitude: others tell of that.
    """
    fitter = Fitter(suspect)
    change = (fitter.measured - fitter.virtual) * fitter.on
    if fitter.is_constant:
        left = suspect.white - suspect.shown(change[np.newaxis])[0]
        left[[output == suspect.channel for output in suspect.outputs]] = 0.0
        deviance = suspect.plain(left).deviance
    else:
        columns = Columns(suspect, {name: fitter.shapes[name] for name in dict.fromkeys(sum(_SIMPLE, ()))})
        deviances = [of + 2.0 * len(names) for of, names in zip(columns.deviances(_SIMPLE), _SIMPLE, strict=True)]
        best = int(np.argmin(deviances))
        deviance = deviances[best]
        if not fitter.is_traced:
            weights = zip(columns.weights(_SIMPLE[best]), _SIMPLE[best], strict=True)
            change = np.asarray(sum(weight * fitter.shapes[name] for weight, name in weights))
    return Simple(fitter=fitter, deviance=deviance + suspect.elsewhere, change=change)


@lru_cache(maxsize=1024)  # the same values are tried at every look
def _fault(cls: Any, channel: str, figures: tuple[tuple[str, float], ...]) -> Fault:
    return cast("Fault", cls(channel=channel, onset_s=0.0, **dict(figures)))


def leads(names: tuple[str, ...], weights: FloatArray) -> bool:
    """Tell whether shapes say that a sensor reads ahead of time, which none does."""
    by = dict(zip(names, weights.tolist(), strict=True))
    lag, lead_s = by.get("lag", 0.0), by.get("x'", 0.0)
    return bool(lag < -0.02 or (lead_s > 0.002 and lag * _LAG_S < lead_s))


def _peers(suspect: Suspect) -> dict[str, FloatArray]:
    """Return the readings of the bank's sensors of the same make."""
    group = next((group for group in PEERS if suspect.channel in group), ())
    record = suspect.case.record
    return {
        name: np.nan_to_num(record[name][suspect.case.start :])
        for name in group
        if name != suspect.channel and name in suspect.case.monitor.bank.channels
    }


def _felt(suspect: Suspect) -> dict[str, FloatArray]:
    """Return what accelerometers read that may leak into a sensor, in g; their mean where a reading is missing."""
    record = suspect.case.record
    felt = {name: record[name][suspect.case.start :] for name in ACCELEROMETERS if name in record.channels}
    there = {name: np.isfinite(readings) for name, readings in felt.items()}
    return {
        name: np.where(there[name], readings, readings[there[name]].mean())
        for name, readings in felt.items()
        if there[name].any()
    }


def _lagged(values: FloatArray, lag_s: float, sample_period_s: float) -> FloatArray:
    return lagged(values, lag_s, sample_period_s, (float(values[0]), 0.0, 0.0))[0]
