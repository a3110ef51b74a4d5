"""A suspect: one sensor of a case, how a fault of its own would show, and how well residuals are explained."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from gtmbench.detectors.bank.calibrated import MOST, CalibratedBank, energy, greatest
from gtmbench.detectors.isolation.case import Case, own
from gtmbench.detectors.isolation.effects import Bend, Effects, Path, bent_paths, outputs_of, paths_of
from gtmbench.detectors.isolation.own_noise import ALIKE
from gtmbench.detectors.virtual import ANGLES
from gtmbench.errors import InputError
from gtmbench.values.channels import ATTITUDE, GYROS, axis_of
from gtmbench.values.record import BoolArray, FloatArray

_BLOCK = 32_768  # numbers at a time: they stay in the cache
_ANOTHER = 200.0  # of -2 log likelihood, that a second fault costs
_LIKELIEST = 8.9  # of -2 log likelihood a row: its noise has gone (3.5), its gain nearly (4.6), any gain will do (0.8)
_FAR_DEG = 5.0  # an angle's change that is larger isn't linear: it is taken out first
_LEAST_GAIN = 0.05  # of a whitening filter for what is slow
# of an attitude that bends, beside noise that is a hundred times as small as an attitude's of its own
_LINEAR_DEG = 1.0
_MISTAKEN = 0.01  # of what bent angles and motion make of a rate
_MOTION_S = 1.0  # over which what bent angles and motion make is averaged
_EARLIEST_S = 60.0  # before the fault is sure: no earlier onset is tried


@dataclass(frozen=True, eq=False)
class Left:
    """What a hypothesis leaves."""

    deviance: float  # -2 log likelihood of the residuals that the suspect enters
    outputs: tuple[str, ...]  # whose these are
    # gives `white`: of most hypotheses nobody asks for it, and memory is dear
    work_out: Callable[[], FloatArray] = field(repr=False)

    @cached_property
    def white(self) -> FloatArray:
        """They, rid of the fault, shape (outputs, rows); noise that belongs to it is still there."""
        return np.asarray(self.work_out())

    def denser(self, volume: float) -> Left:
        """Return what is left by a density that is so much denser, in -2 log likelihood."""
        return replace(self, deviance=self.deviance - volume)

    def heals(self, monitor: CalibratedBank) -> bool:
        """Tell whether it is healthy by the monitor's test, of the case that it is of."""
        if "healed" not in vars(self):
            vars(self)["healed"] = self._heals(monitor)
        return bool(vars(self)["healed"])

    def _heals(self, monitor: CalibratedBank) -> bool:
        return all(
            greatest(monitor, output, white, is_corrected=True, enough=1.0) <= 1.0
            for output, white in zip(self.outputs, self.white, strict=True)
            if output in monitor.whiteners
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Suspect:
    """A suspect of a case."""

    case: Case
    channel: str
    # measured, virtual, shape (rows,): what it read and what it should have read, from the case's `start` on
    measured: FloatArray = field(repr=False)
    virtual: FloatArray = field(repr=False)
    time_s: FloatArray = field(repr=False)  # shape (rows,)
    # gives its ways into the residuals, over the whole case: of a suspect that is left out nobody asks for them
    find_paths: Callable[[], Sequence[Path]] = field(repr=False)
    bend: Bend | None = field(default=None, repr=False)  # of a gyro that drives the attitude
    # shape (rows,): what has been taken out of its readings, attitude and all, so that only the rest has to be small
    away: FloatArray | None = field(default=None, repr=False)
    near: Case | None = field(default=None, repr=False)  # the case without that

    @classmethod
    def of(cls, case: Case, channel: str) -> Suspect | None:
        """Return a suspect, or None where nothing predicts it."""
        virtual = case.virtual.get(channel)
        if virtual is None:
            return None
        return cls._made(case, channel, virtual, partial(paths_of, case.monitor, case.record, channel, virtual))

    @classmethod
    def as_read(cls, case: Case, channel: str) -> Suspect:
        """Return a suspect about its own reading, where what it should have read isn't known."""
        reading = case.record[channel]
        return cls._made(case, channel, reading, partial(paths_of, case.monitor, case.record, channel, reading))

    @classmethod
    def driving(cls, case: Case, channel: str, bend: Bend, away: FloatArray | None = None) -> Suspect:
        """Return a gyro that drives the attitude through an estimator: what it should have read, its references say."""
        near = None if away is None else case.with_record(bend.record)
        virtual = (near or case).undriven(channel, bend.estimator)
        find_paths = partial(bent_paths, case.monitor, bend.record, channel, virtual)
        return cls._made(case, channel, virtual, find_paths, bend=bend, away=away, near=near)

    @classmethod
    def _made(
        cls, case: Case, channel: str, virtual: FloatArray, find_paths: Callable[[], Sequence[Path]], **more: Any
    ) -> Suspect:
        rows = slice(case.start, None)
        return cls(
            case=case,
            channel=channel,
            measured=case.record[channel][rows],
            virtual=virtual[rows],
            time_s=case.record.time_s[rows],
            find_paths=find_paths,
            **more,
        )

    @cached_property
    def paths(self) -> list[Path]:
        """Its ways into the residuals from the case's `start` on, and into its own innovations, the last."""
        paths = [path.later(self.case.start) for path in self.find_paths()]
        habit = self.case.habits.get(self.channel)
        if habit is not None:
            paths.append(Path(output=own(self.channel), kernel=habit.taps, ahead=0, of_value=1.0, of_slope=None))
        return [path for path in paths if path.output in self.case.white]

    def without(self, change: FloatArray) -> Suspect:
        """Return a driving gyro of which a change is taken out, attitude and all: what shows of the rest is linear.

        Itself, where the attitude bends by so little that all is, or where its estimator can't have made the attitude.
        """
        bend = self.bend
        if (
            bend is None
            or max(float(np.abs(angle).max()) for angle in bend.of(change[np.newaxis]).values()) < _LINEAR_DEG
        ):
            return self
        start = np.concatenate([np.zeros(self.case.start), change])
        try:
            straight = bend.about(self.case.record).straightened(start)
        except InputError:  # too steep for Euler angles
            return self
        return Suspect.driving(self.case, self.channel, straight, away=change)

    @property
    def onset(self) -> int:
        """The row from `start` on where the fault may have begun."""
        return self.case.onset - self.case.start

    @property
    def sure(self) -> int:
        """The row from `start` on where it is surely there."""
        return self.case.sure - self.case.start

    @property
    def earliest_s(self) -> float:
        """When the fault may have begun, at the earliest."""
        sure_s = float(self.time_s[self.sure])
        return sure_s - max(_EARLIEST_S, 2.0 * (sure_s - float(self.time_s[0])))

    @cached_property
    def judged(self) -> slice:
        """The rows from `start` on that are judged."""
        judged = self.case.judged
        return slice(judged.start - self.case.start, judged.stop - self.case.start)

    @cached_property
    def begun(self) -> BoolArray:
        """At which rows the fault may have begun."""
        return np.arange(len(self.measured)) >= self.onset

    @cached_property
    def off(self) -> FloatArray:
        """What it has read beside what it should have, since the onset; 0 where either is missing."""
        return np.nan_to_num(np.where(self.begun, self.measured - self.virtual, 0.0))

    @cached_property
    def expected(self) -> FloatArray:
        """What it should have read, without the virtual sensor's noise; what it read, where that isn't known."""
        if self.bend is None and self.channel in self.case.expected:
            return self.case.expected[self.channel][self.case.start :]
        return np.where(np.isfinite(self.virtual), self.virtual, np.nan_to_num(self.measured))

    @cached_property
    def wander(self) -> float:
        """How far what an angle should have read may be off on average, for it is its gyro's integral.

        A gyro whose noise has a deviation s over long spans, a sample, is off by s^2 Ts (t / 2 + t^2 / (3 B)) in the
        mean over t, where its bias is known from B seconds.
        """
        gyro = axis_of(self.channel)[0]
        if self.channel not in ANGLES or self.bend is not None or gyro not in self.case.monitor.whiteners:
            return 0.0
        whitener, period_s = self.case.monitor.whiteners[gyro], self.case.period_s
        slow = whitener.deviation / max(abs(float(whitener.coefficients.sum())), _LEAST_GAIN)
        since_s = float(self.time_s[self.judged.stop - 1] - self.time_s[self.onset])
        baseline_s = self.case.monitor.bank.statistic.baseline_s
        return float(slow * np.sqrt(period_s * (since_s / 2.0 + since_s**2 / (3.0 * baseline_s))))

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """The whitened residuals that it enters, its own innovations last."""
        if self.bend is not None:
            return tuple(dict.fromkeys(path.output for path in self.paths))
        own_innovations = [own(self.channel)] if self.channel in self.case.habits else []
        entered = [*outputs_of(self.case.monitor, self.channel), *own_innovations]
        return tuple(output for output in entered if output in self.case.white)

    @cached_property
    def white(self) -> FloatArray:
        """These residuals over the rows judged, shape (outputs, rows); NaN where one is missing.

        Its own innovations are missing where it isn't known what it should have read, too.
        """
        white = self._as_measured if self._taken_out is None else self._with(*self._taken_out)
        unknown = ~np.isfinite(self.virtual)
        if unknown[: self.judged.stop].any() and self.channel in self.case.habits:
            reach = np.ones(len(self.case.habits[self.channel].taps))
            white[-1, np.convolve(unknown, reach)[self.judged] > 0.5] = np.nan
        return self._free_of_bend(white / self._tolerance)

    @property
    def _as_measured(self) -> FloatArray:
        return np.asarray([self.case.white[output][self.case.judged] for output in self.outputs], dtype=float)

    @property
    def _taken_out(self) -> tuple[Case, FloatArray] | None:
        """The case without a change that is too large to be linear, and that; None where none is."""
        case = self.case
        if self.near is not None and self.away is not None:
            return self.near, self.away
        if self.channel in ANGLES and np.abs(self.off[self.sure :]).max(initial=0.0) > _FAR_DEG:
            readings = case.record[self.channel].copy()
            readings[case.start :] -= self.off
            return case.with_record(case.record.replace(self.channel, readings)), self.off
        return None

    def _with(self, near: Case, change: FloatArray) -> FloatArray:
        """Return the residuals without a change, and what the change adds as if that were linear."""
        white, shown = self._as_measured, self._added(change[np.newaxis])[0]
        for i, output in enumerate(self.outputs):
            if output in self.case.residuals.raw:  # its own innovations are linear, however far
                white[i] = near.white[output][self.case.judged] + shown[i]
        return white

    @cached_property
    def there(self) -> BoolArray:
        """Which of these samples are there."""
        return np.isfinite(self.white)

    @cached_property
    def filled(self) -> FloatArray:
        """These samples, 0 where one is missing."""
        return np.nan_to_num(self.white)

    @cached_property
    def is_whole(self) -> bool:
        """Whether all are."""
        return bool(self.there.all())

    @cached_property
    def elsewhere(self) -> float:
        """-2 log likelihood of everything that it doesn't enter, the other suspects' readings included."""
        case = self.case
        others = sum(energy for output, energy in case.energies.items() if output not in self.outputs)
        surprises = sum(surprise for channel, surprise in case.surprises.items() if channel != self.channel)
        return float(others + surprises + self._volume)

    @cached_property
    def at_least(self) -> float:
        """-2 log likelihood that no fault of it goes below: `elsewhere`, and rows as likely as ever."""
        likely = _LIKELIEST * float(self.judged.stop - self.judged.start)
        return self.elsewhere - self.sick_elsewhere - likely

    @cached_property
    def sick_elsewhere(self) -> float:
        """What residuals that it doesn't enter leave over what another fault of theirs would, if that is much."""
        over = 0.0
        for output in self.case.residuals.raw:
            if output not in self.outputs:
                white = self.case.white[output][self.case.judged]
                over += max(self.case.energies[output] - float(np.isfinite(white).sum()) - _ANOTHER, 0.0)
        return over

    @cached_property
    def _effects(self) -> Effects:
        return Effects(self.paths, self.outputs, len(self.measured), self.case.period_s, self.bend)

    def shown(self, changes: FloatArray) -> FloatArray:
        """Return what changes of its readings, shape (changes, rows), add: shape (changes, outputs, rows judged)."""
        added = self._added(changes)
        return added if self.bend is None else self._free_of_bend(added / self._tolerance)

    def shown_in(self, changes: FloatArray, rows: slice) -> FloatArray:
        """Return what changes add in some rows from `start` on, shape (changes, outputs, rows)."""
        return np.asarray(self._effects.of(changes, rows) / self._spread[:, rows])

    @cached_property
    def _spread(self) -> FloatArray:
        """What whitened residuals have been divided by, shape (outputs, rows)."""
        spread = np.ones((len(self.outputs), len(self.measured)))
        for i, output in enumerate(self.outputs):
            of = self.case.spread(output)
            spread[i] = of if isinstance(of, float) else of[self.case.start :]
        return spread

    def _added(self, changes: FloatArray) -> FloatArray:
        clean = changes if np.isfinite(changes).all() else np.nan_to_num(changes)
        block = max(_BLOCK // changes.shape[1], 1)
        parts = [self.shown_in(clean[first : first + block], self.judged) for first in range(0, len(clean), block)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _free_of_bend(self, values: FloatArray) -> FloatArray:
        """Return residuals, shape (..., outputs, rows), without what fits best of a bend from before the onset.

        An attitude that the gyro drives has bent since the fault began, and when that was the test tells roughly. What
        it had bent until then decays as the estimator's references have it.
        """
        before = self._bent_before
        if before is None:
            return values
        size = np.einsum("...or,or->...", np.nan_to_num(values), before)
        return np.asarray(values - size[..., np.newaxis, np.newaxis] * before)

    @cached_property
    def _tolerance(self) -> FloatArray:
        """What residuals are divided by, shape (outputs, rows): an attitude that has bent far is known less exactly.

        Residuals of bent angles are small differences of large terms, motion times bend, and logs have these at other
        steps than the estimator had.
        """
        tolerance = np.ones((len(self.outputs), self.judged.stop - self.judged.start))
        if self.near is None or self.away is None:
            return tolerance
        straight, record, rows = self.near.record, self.case.record, self.case.judged
        there = [name for name in ATTITUDE if name in record.channels]
        bend = np.sqrt(sum(np.square(np.deg2rad(record[name] - straight[name])) for name in there))
        rate = np.sqrt(sum(np.square(straight[name]) for name in GYROS if name in record.channels))
        smooth = np.ones(max(round(_MOTION_S / self.case.period_s), 1))
        smooth /= len(smooth)
        turned = np.convolve(np.nan_to_num(bend * rate), smooth, mode="same")[rows]
        for i, output in enumerate(self.outputs):
            if output in self.case.residuals.raw:
                off = turned + (np.abs(self.away[self.judged]) if output == self.channel else 0.0)
                tolerance[i] = np.sqrt(1.0 + np.square(_MISTAKEN * off / self.case.monitor.whiteners[output].deviation))
        return tolerance

    @cached_property
    def _volume(self) -> float:
        """What that tolerance costs of -2 log likelihood."""
        return float(2.0 * np.log(self._tolerance)[np.isfinite(self._as_measured)].sum())

    @cached_property
    def _bent_before(self) -> FloatArray | None:
        """What such a bend leaves in the residuals, of unit energy, shape (outputs, rows); None where nothing."""
        if self.bend is None:
            return None
        pulse = np.zeros((1, len(self.measured)))
        pulse[0, self.onset] = 1.0
        left = self._added(pulse)[0] / self._tolerance
        left[~np.isfinite(self._as_measured)] = 0.0
        size = float(np.sqrt(np.square(left).sum()))
        return left / size if size > 0.0 else None

    def rescaled(self, factor: float) -> Left:
        """Weigh a sensor whose readings have been multiplied by a factor, their noise too, or all but that.

        Divided by it they are healthy; a density of what is divided is one of what was read over the factor.
        """
        first = self.measured[self.onset] if self.channel == "psi" else 0.0  # a heading's zero is any
        changes = np.where(self.begun, (1.0 - 1.0 / factor) * (self.measured - first), 0.0)
        left = self.white - self.shown(changes[np.newaxis])[0]
        deviance, louder = 0.0, float(np.log(factor**2))
        for output, white in zip(self.outputs, left, strict=True):
            count = float(np.isfinite(white).sum())
            if output != own(self.channel):
                deviance += energy(white) + (count * louder if output == self.channel else 0.0)
            elif self.case.habits[self.channel].is_steady:
                deviance += min(energy(white) + count / ALIKE * louder, self._as_read)
            else:
                deviance += self._as_read
        return Left(deviance=deviance, outputs=self.outputs, work_out=lambda: left)

    def plain(self, left: FloatArray) -> Left:
        """Weigh residuals, shape (outputs, rows), that should be healthy noise."""
        return Left(deviance=float(self.deviances(left)), outputs=self.outputs, work_out=lambda: left)

    def deviances(self, left: FloatArray) -> FloatArray:
        """Return -2 log likelihood of residuals that should be healthy noise, shape (..., outputs, rows).

        What it reads instead has its own noise, or none: where its innovations are better as they were read, they are
        taken so. The sensor's own noise may have gone, as that of a stuck one has: its variance may be less than ever.
        """
        squares = np.square(np.clip(left, -MOST, MOST))
        if not self.is_whole:
            squares = np.nan_to_num(squares)
        sums = squares.sum(axis=-1)
        if self.channel not in self.case.habits:
            return np.asarray(sums.sum(axis=-1))
        return np.asarray(sums[..., :-1].sum(axis=-1) + np.minimum(self._quiet(sums[..., -1]), self._as_read))

    def _quiet(self, squares: FloatArray) -> FloatArray:
        """Return -2 log likelihood of its own noise by its sum of squares."""
        return self.case.habits[self.channel].deviance(squares, self._count)

    @cached_property
    def _count(self) -> int:
        return int(self.there[-1].sum())

    @cached_property
    def _as_read(self) -> float:
        """-2 log likelihood of its innovations as they were read."""
        return float(self._quiet(np.asarray(energy(self.white[-1]))))
